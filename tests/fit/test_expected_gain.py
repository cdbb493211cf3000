"""Which terms enter: for what gain of the likelihood, and how surely they are there."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.errors import UnsettledError
from rotorfit.estimation.banded import banded
from rotorfit.estimation.factors import Factors, triangular_factors
from rotorfit.fit.joint import term_choice
from rotorfit.fit.joint.joint_problem import joint_problem
from rotorfit.fit.joint.term_choice import chosen, expected_gain
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.registry import DEFAULT_TERMS, added_signals

G, MASS, ARM = 9.80665, 1.4, 0.25
BARE = ()
"""Terms of the small fits here: what is always in the model."""


def shaken(offset, *, blocks=12, rows=80, seed=0):
    """A body whose signals are noise, but for the six that follow; a torque about x is hidden."""
    model = regressor(made_fit.QUAD)
    layout = model.layout.names
    rng = np.random.default_rng(seed)
    size = {"O2": 1e5, "ww": 1.0}
    Z = np.zeros((blocks, rows, len(layout)))
    for i, name in enumerate(layout):
        if name.startswith("O2_") or name in ("wxwx", "wywy", "wzwz", "wxwy", "wxwz", "wywz"):
            Z[:, :, i] = size[name[:2] if name.startswith("O2") else "ww"] * rng.normal(
                size=(blocks, rows)
            )
    Z[:, :, layout.index("one")] = 1.0
    theta = np.array([{**made_fit.BODY, "mass": MASS, "Mx_0": offset}.get(n, 0.0)
                      for n in model.names])  # fmt: skip
    B = np.einsum("p,pjz->jz", theta, model.tensor)
    wrench = np.einsum("jz,bmz->bmj", B, Z)
    Z[:, :, :6] = -np.linalg.solve(B[:, :6], wrench[..., None])[..., 0]
    Z[:, :, :6] += rng.normal(size=(blocks, rows, 6)) * [0.3, 0.3, 0.3, 2.0, 2.0, 2.0]
    factors = Factors(
        R=triangular_factors(Z),
        rows=np.full(blocks, rows),
        segment=np.arange(blocks),
        band=np.tile([1.0, 2.0], (blocks, 1)),
    )
    return made_fit.configuration(mass=MASS, factors=factors)


def fitted(body, terms):
    problem = joint_problem([body], terms=terms)
    names = [name.partition("@")[0] for name in problem.map.names]
    return banded(problem, np.array([made_fit.BODY.get(name, 0.0) for name in names]))


@pytest.mark.parametrize("offset", [0.0, 0.005])
def test_the_score_foretells_by_how_much_the_likelihood_rises(offset):
    """Of chance alone three parameters gain 1.5 on average; a torque of 5 mN m some 30 here."""
    body = shaken(offset)
    without, with_it = fitted(body, BARE), fitted(body, ("torque_offset",))
    gain = with_it.log_likelihood - without.log_likelihood
    assert (gain > 10.0) is (offset > 0.0)
    assert expected_gain(without, [body], ("torque_offset",)) == pytest.approx(gain, rel=0.1)


def expecting(monkeypatch, gain):
    """Let terms promise a gain of the likelihood that is made up."""
    monkeypatch.setattr(term_choice, "expected_gain", gain)


class Tried(Exception):  # noqa: N818
    """The fit with the term was made."""


@pytest.mark.parametrize(
    ("expected", "configurations", "tried"),
    [(24.9, 1, False), (25.1, 1, True), (49.9, 2, False), (50.1, 2, True)],
)
def test_a_fit_is_tried_from_half_of_the_gain_that_is_asked_for(
    monkeypatch, expected, configurations, tried
):
    bodies = [made_fit.configuration(name) for name in "AB"[:configurations]]
    fit = made_fit.fit_of(bodies, std={})
    expecting(monkeypatch, lambda *_: expected)

    def refit(terms, begin):
        raise Tried

    if tried:
        with pytest.raises(Tried):
            chosen(None, fit, bodies, refit=refit)
    else:
        assert chosen(None, fit, bodies, refit=refit)[0].terms == DEFAULT_TERMS


def only(*asked):
    """Return expected gains of 1000 for the terms that are asked for, the first one more."""
    return lambda fit, joint, terms: 1e3 - asked.index(terms[-1]) if terms[-1] in asked else 0.0


def test_the_best_term_is_tried_first_and_skipped_if_unsettled(
    monkeypatch,
):
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={})
    expecting(monkeypatch, only("torque_offset", "turn_damping"))
    tried = []

    def refit(terms, begin):
        tried.append(terms[-1])
        raise UnsettledError("no")

    choice, found = chosen(None, fit, [body], refit=refit)
    assert tried == ["torque_offset", "turn_damping"]
    assert choice.terms == DEFAULT_TERMS
    assert found is fit


@pytest.mark.parametrize(
    ("value", "std", "matters"),
    [(0.022, 2e-5, True), (0.018, 2e-5, False), (0.022, 6e-3, False), (-1.0, 2e-5, False)],
)
def test_damping_of_turns_is_a_brake_and_more_than_a_trace(value, std, matters):
    """In 1/s over mass times arm squared; four deviations from none."""
    body = made_fit.configuration(mass=MASS)
    size = MASS * ARM**2
    wide = made_fit.fit_of([body], std={"turn_damping_y@A": std * size}, terms=("turn_damping",))
    wide = with_values(wide, {"turn_damping_y@A": value * size})
    assert term_choice.matters("turn_damping", wide, [body]) is matters


@pytest.mark.parametrize(("gain", "added"), [(49.9, False), (50.1, True)])
def test_a_term_enters_for_a_gain_of_50_a_configuration(monkeypatch, gain, added):
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={})
    wide = made_fit.fit_of([body], std={}, terms=("rotor_inertia", "torque_offset"))
    wide = with_values(wide, {"torque_offset_x@A": 1.0}, gain)
    expecting(monkeypatch, only("torque_offset"))
    choice, found = chosen(None, fit, [body], refit=lambda terms, begin: wide)
    assert choice.least_gain == 50.0
    assert ("torque_offset" in choice.terms) is added
    assert found is (wide if added else fit)


def with_values(fit, values, gain=0.0):
    names = fit.estimate.names
    at = np.array([values.get(n, v) for n, v in zip(names, fit.estimate.values, strict=True)])
    return replace(fit, estimate=replace(fit.estimate, values=at), log_likelihood=gain)


@pytest.mark.parametrize(("share", "matters"), [(0.9e-3, False), (1.1e-3, True)])
def test_a_torque_matters_from_a_thousandth_of_weight_times_arm(share, matters):
    body = made_fit.configuration(mass=MASS)
    wide = made_fit.fit_of([body], std={}, terms=("torque_offset",))
    wide = with_values(wide, {"torque_offset_y@A": -share * MASS * G * ARM})
    assert term_choice.matters("torque_offset", wide, [body]) is matters


@pytest.mark.parametrize(
    ("drag", "std", "matters"),
    [
        ({"drag_x@A": 0.39}, 0.1, False),  # four deviations
        ({"drag_x@A": 0.41}, 0.1, True),
        ({"drag_y@A": 0.9e-3 * MASS * G}, 1e-6, False),  # a thousandth of the weight at 1 m/s
        ({"drag_y@A": 1.1e-3 * MASS * G}, 1e-6, True),
        ({"drag_z@A": 1.0}, 0.1, False),
        ({"drag_x@A": -1.0}, 0.1, False),
    ],
)
def test_drag_sideways_matters_from_four_deviations(drag, std, matters):
    body = made_fit.configuration(mass=MASS)
    body = replace(body, model=regressor(made_fit.QUAD, added=added_signals(["drag", "inflow"])),
                   factors=made_fit.blocks([(1.0, 2.0)], width=31))  # fmt: skip
    assert len(body.model.layout) == 31
    stds = {f"drag_{axis}@A": std for axis in "xyz"}
    wide = with_values(made_fit.fit_of([body], std=stds, terms=("drag",)), drag)
    assert term_choice.matters("drag", wide, [body]) is matters
