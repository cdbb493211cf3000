"""A body whose axes do not act on one another is told from a rigid one."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.checks.coupling import ADVICE, REASON, absent_coupling
from rotorfit.checks.impossible_inertia import impossible_inertia
from rotorfit.checks.weak_directions import weak_directions
from rotorfit.fit.coupling import drop_absent_coupling, without_coupling
from rotorfit.fit.dataset.dataset import with_flights
from rotorfit.fit.experiment.experiment import MotorsEntry
from rotorfit.fit.fit_flights import fit_flights
from rotorfit.flight.flight_data import FlightData
from rotorfit.logs.flight_log import SITL
from rotorfit.model.parameters import inertia_matrix
from rotorfit.model.regressor import regressor

MASS, KT, KD, RATE = 1.4, 2e-6, 3e-8, 100.0
NOTHING: tuple[str, ...] = ()
INERTIA = np.diag([0.010, 0.013, 0.021])
BALL = np.diag([0.010, 0.010, 0.010])


def test_without_coupling_torque_is_inertia_times_acceleration():
    model = without_coupling(regressor(made_fit.QUAD))
    rng = np.random.default_rng(1)
    w, dw = rng.normal(size=(2, 5, 3))
    elements = rng.normal(size=6)
    Z = np.zeros((5, len(model.layout)))
    Z[:, 3:6] = dw
    Z[:, 6:9] = w**2
    Z[:, 9:12] = np.stack([w[:, 0] * w[:, 1], w[:, 0] * w[:, 2], w[:, 1] * w[:, 2]], axis=1)
    names = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
    theta = dict(zip(names, elements.tolist(), strict=True))
    expected = dw @ inertia_matrix(elements)
    np.testing.assert_allclose(model.residual(Z, theta)[:, 3:], expected, atol=1e-12)


def flown(inertia, *, coupled):
    """Return 40 s of rolls, nods and turns at once, of a body with or without w x I w."""
    time = np.arange(round(40 * RATE)) / RATE
    sines = [np.cos(2 * np.pi * f * time) for f in (0.83, 0.71, 0.29, 1.13)]
    mixer = np.array([[-1, -1, 1], [1, 1, 1], [1, -1, -1], [-1, 1, -1]])
    hover = MASS * 9.80665 / (4 * KT)
    turns = np.stack([0.03 * sines[0], 0.03 * sines[1], 0.3 * sines[2]], axis=1)
    squares = hover * (1.0 + 0.1 * sines[3][:, None] + turns @ mixer.T)
    vehicle = made_fit.QUAD
    lever = np.cross(vehicle.positions, vehicle.axes)
    torque = KT * squares @ lever - KD * (squares * vehicle.spins).sum(axis=1)[:, None] * [0, 0, 1]
    rates, turned = np.zeros((2, len(time), 3))
    w, inverse = np.zeros(3), np.linalg.inv(inertia)
    for k, moment in enumerate(torque):
        gyro = np.cross(w, inertia @ w) if coupled else np.zeros(3)
        dw = inverse @ (moment - gyro)
        rates[k], turned[k] = w, dw
        w = w + dw / RATE
    rng = np.random.default_rng(2)
    data = FlightData(
        sample_rate=RATE,
        time=time,
        specific_force=np.stack([0 * time, 0 * time, KT * squares.sum(axis=1) / MASS], axis=1)
        + rng.normal(scale=0.05, size=(len(time), 3)),
        angular_velocity=rates,
        angular_acceleration=turned + rng.normal(scale=0.1, size=turned.shape),
        rotor_speed=np.sqrt(squares),
        rotor_acceleration=np.gradient(np.sqrt(squares), axis=0) * RATE,
        differentiation="exact",
        segments=made_fit.prepared(seconds=40.0).data.segments,
    )
    flight = dataclasses.replace(
        made_fit.prepared(seconds=40.0), data=data, phases=data.segments,
        motor_channel=data.rotor_speed,
    )  # fmt: skip
    return made_fit.dataset(flight, mass=MASS, motors=MotorsEntry(speed="measured", delay=0.0))


def uncoupled(inertia, *, coupled, simulator=""):
    """Return the fit of a body with its coupling, and after the step that may drop it."""
    flight = flown(inertia, coupled=coupled)
    flight = with_flights(
        flight, lambda one: replace(one, log=replace(one.log, simulator=simulator))
    )
    fit = fit_flights(flight, NOTHING)
    return fit, drop_absent_coupling(fit)


def test_a_body_without_coupling_is_found_with_correct_ratios():
    coupled, found = uncoupled(INERTIA, coupled=False)
    [finding] = absent_coupling(found)
    assert finding.kind == "no-coupling"
    assert finding.diagnostics["gain_without_coupling"] > 100.0
    Izz = coupled.numbers.number("Izz_com@A")[0]
    assert Izz < 0.7 * INERTIA[2, 2]  # what an expected coupling makes of it
    at = found.estimate.estimate.by_name
    assert (at["Ixx@A"], at["Iyy@A"]) == pytest.approx((0.010, 0.013), rel=0.02)
    assert at["kd"] / at["Izz@A"] == pytest.approx(KD / 0.021, rel=0.05)
    assert {"kd", "Izz@A", "Izz_com@A"} <= set(finding.numbers)
    assert (finding.withheld_because, finding.next_step) == (REASON, ADVICE)


def test_what_the_coupling_would_show_is_judged_no_further():
    _, found = uncoupled(INERTIA, coupled=False)
    assert "Izz@A" in found.withheld
    assert list(impossible_inertia(found)) == []  # of an I_zz that nothing tells
    [direction] = weak_directions(found)
    assert (direction.severity, direction.sentence) == ("passed", "")
    # Where the step withholds nothing both object.
    bare = dataclasses.replace(found, withheld=frozenset())
    assert [one.severity for one in impossible_inertia(bare)] == ["doubt"]
    assert "are known only as a ratio" in next(weak_directions(bare)).sentence


@pytest.mark.parametrize("inertia", [INERTIA, BALL], ids=["flat", "ball"])
def test_a_rigid_body_keeps_its_coupling(inertia):
    fit, found = uncoupled(inertia, coupled=True)
    assert found is fit
    assert list(absent_coupling(found)) == []
    if inertia is INERTIA:
        assert fit.numbers.number("Izz_com@A")[0] == pytest.approx(0.021, rel=0.05)


@pytest.mark.parametrize(("simulator", "kinds"), [("", []), (SITL, ["no-coupling"])])
def test_in_a_simulator_without_coupling_no_gain_speaks_for_one(simulator, kinds):
    """Izz below Iyy, which no multirotor has: there it is another error of the model."""
    fit, found = uncoupled(np.diag([0.010, 0.021, 0.013]), coupled=True, simulator=simulator)
    assert [one.kind for one in absent_coupling(found)] == kinds
    lost = fit.estimate.log_likelihood - found.estimate.log_likelihood
    assert lost == 0.0 if not simulator else lost > 50.0
