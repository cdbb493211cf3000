"""What drag of the frame and wakes that a model lacks leave open of its other numbers."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.estimation.banded import banded
from rotorfit.estimation.factors import Factors, triangular_factors
from rotorfit.fit.intervals import frame_drag
from rotorfit.fit.intervals.frame_drag import frame_drag_shifts, rms_above_zero, wake_shifts
from rotorfit.fit.joint.joint_problem import joint_problem
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.registry import added_signals

MASS, HOVER = 1.4, 2000.0
"""Of four rotors at 500 rad/s together."""
TERMS = ("rotor_drag",)
AIR = ("rotor_drag", "inflow", "drag")
WAKES = (*AIR, "wake_moment")


def dragged(*, frame, changes, wake=0.0, air=AIR, blocks=12, rows=80):
    """A body whose signals are noise, but for drag; `changes`: share of the rotors' speeds."""
    model = regressor(made_fit.QUAD, added=added_signals(air))
    names, rng = model.layout.names, np.random.default_rng(4)
    Z = np.zeros((blocks, rows, len(names)))
    for i, name in enumerate(names):
        if name.startswith(("O2_", "wx", "wy", "wz")):
            size = 1e5 if name.startswith("O2_") else 1.0
            Z[:, :, i] = size * rng.normal(size=(blocks, rows))
    v = 4.0 * rng.normal(size=(blocks, rows, 3))
    speeds = HOVER * (1.0 + changes * rng.normal(size=(blocks, rows)))
    for axis, name in enumerate("xyz"):
        Z[:, :, names.index(f"v{name}")] = v[:, :, axis]
    for axis, name in enumerate("xy"):
        Z[:, :, names.index(f"Od_F{name}")] = speeds * v[:, :, axis]
    for axis, name in enumerate("xy" if "wake_x" in names else ""):
        Z[:, :, names.index(f"wake_{name}")] = 5.0 * v[:, :, axis]
    Z[:, :, names.index("one")] = 1.0
    true = {**made_fit.BODY, "mass": MASS, "drag_x": frame, "drag_y": frame}
    true |= {"wake_moment_x": wake, "wake_moment_y": wake}
    B = np.einsum("p,pjz->jz", [true.get(name, 0.0) for name in model.names], model.tensor)
    Z[:, :, :6] = -np.linalg.solve(B[:, :6], np.einsum("jz,bmz->bmj", B, Z)[..., None])[..., 0]
    Z[:, :, :6] += rng.normal(size=(blocks, rows, 6)) * [0.3, 0.3, 0.3, 2.0, 2.0, 2.0]
    factors = Factors(
        R=triangular_factors(Z),
        rows=np.full(blocks, rows),
        segment=np.arange(blocks),
        band=np.tile([1.0, 2.0], (blocks, 1)),
    )
    return replace(made_fit.configuration(mass=MASS, factors=factors), model=model)


def fitted(body, terms=TERMS):
    problem = joint_problem([body], terms=terms)
    names = [name.partition("@")[0] for name in problem.map.names]
    return banded(problem, np.array([made_fit.BODY.get(name, 0.0) for name in names]))


def open_and_error(**flown):
    """Return the size of the shifts of `rotor_drag`, and its error."""
    body = dragged(**flown)
    fit = fitted(body)
    place = fit.estimate.names.index("rotor_drag")
    shift = np.linalg.norm(frame_drag_shifts(fit, [body])[:, place])
    return shift, fit.estimate.values[place] - made_fit.BODY["rotor_drag"]


@pytest.mark.parametrize("frame", [0.03, 0.07, 0.12])
def test_the_interval_holds_drag_that_is_the_frames(frame):
    """At one sum of speeds all of it is, and nothing but the prior of .1 m/s limits it."""
    shift, error = open_and_error(frame=frame, changes=0.0)
    assert error == pytest.approx(frame / HOVER, rel=0.25)
    assert error < 1.96 * shift
    assert shift < 0.11 * MASS / HOVER


def test_speeds_that_change_close_it():
    """Where they change by half, no drag of the frame is seen to be none."""
    steady, _ = open_and_error(frame=0.0, changes=0.0)
    lively, _ = open_and_error(frame=0.0, changes=0.5)
    assert lively < 0.2 * steady


def test_a_model_with_drag_of_the_frame_opens_nothing_more():
    body = dragged(frame=0.1, changes=0.5)
    assert not len(frame_drag_shifts(fitted(body, (*TERMS, "drag")), [body]))


def test_a_negative_variance_opens_a_finite_share(monkeypatch):
    body = dragged(frame=0.0, changes=0.0)
    fit, usual = fitted(body), frame_drag.normal_equations

    def spoilt(at, kept):
        found = usual(at, kept)
        H, free = found.information.copy(), len(fit.estimate.names)
        H[:free, free:] *= 1e4
        H[free:, :free] *= 1e4
        return replace(found, information=H)

    monkeypatch.setattr(frame_drag, "normal_equations", spoilt)
    shifts = frame_drag_shifts(fit, [body])
    assert len(shifts) == 3
    assert np.isfinite(shifts).all()


def test_without_a_velocity_nothing_is_shared():
    body = made_fit.configuration(mass=MASS)
    assert not len(frame_drag_shifts(made_fit.fit_of([body], std={}), [body]))


@pytest.mark.parametrize("mean", [-30.0, -3.0, -0.5, 0.0, 1.0, 4.0])
def test_the_air_does_not_drive(mean):
    """By a sum over the density above zero; far below zero next to nothing is left."""
    x = np.linspace(0.0, 12.0, 200_001)
    weight = np.exp(-0.5 * (x - mean) ** 2 + 0.5 * min(mean, 0.0) ** 2)
    found = rms_above_zero(np.array([mean]), np.array([1.0]))[0]
    assert found == pytest.approx(np.sqrt((x**2 * weight).sum() / weight.sum()), rel=2e-3)


@pytest.mark.parametrize("wake", [0.0, 0.01, 0.03])
def test_wakes_that_the_model_lacks_leave_the_height_open(wake):
    """They pitch with the velocity, as drag does over a centre of mass that is low."""
    body = dragged(frame=0.0, changes=0.0, wake=wake, air=WAKES)
    fit = fitted(body)
    place = fit.estimate.names.index("msz@A")
    shift = np.linalg.norm(wake_shifts(fit, [body])[:, place])
    error = abs(fit.estimate.values[place] - made_fit.BODY["msz"])
    assert error < 1.96 * np.hypot(shift, fit.estimate.std[place])
    if wake:
        assert error > 1.96 * fit.estimate.std[place]


def test_wakes_in_the_model_leave_nothing_open():
    body = dragged(frame=0.0, changes=0.0, wake=0.02, air=WAKES)
    fit = fitted(body, (*TERMS, "wake_moment"))
    assert wake_shifts(fit, [body]).shape == (0, len(fit.estimate.names))
    slow = dragged(frame=0.0, changes=0.0)
    assert len(wake_shifts(fitted(slow), [slow])) == 0
