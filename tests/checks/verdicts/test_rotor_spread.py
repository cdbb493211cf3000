"""From when on a rotor's own thrust coefficient is what was assumed of it: by hand."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.checks.verdicts.parameters import assumed_rotors

NAMES = tuple(f"spread_{i}" for i in (1, 2, 3, 4))
BEFORE = 0.015


def with_covariance(covariance):
    """Return the fit of a quadrotor whose four spreads have this covariance."""
    body = made_fit.configuration()
    fit = made_fit.fit_of([body], std={}, terms=("rotor_spread",))
    at = [fit.estimate.names.index(name) for name in NAMES]
    whole = fit.estimate.covariance.copy()
    whole[np.ix_(at, at)] = covariance
    prior = {name: BEFORE for name in NAMES}
    problem = replace(fit.problem, prior_std={**fit.problem.prior_std, **prior})
    return [body], replace(fit, estimate=replace(fit.estimate, covariance=whole), problem=problem)


@pytest.mark.parametrize(("left", "assumed"), [(0.49, False), (0.51, True)])
def test_a_coefficient_is_assumed_if_half_its_deviation_remains(left, assumed):
    bodies, fit = with_covariance(np.eye(4) * (left * BEFORE) ** 2)
    expected = [f"kt_{i}" for i in (1, 2, 3, 4)] if assumed else []
    assert list(assumed_rotors(fit, bodies)) == expected


def test_an_equal_change_of_all_rotors_is_no_difference():
    """It is a k_t of another size, and known by that."""
    alike = np.full((4, 4), BEFORE**2)
    bodies, fit = with_covariance(np.eye(4) * (0.1 * BEFORE) ** 2 + alike)
    assert assumed_rotors(fit, bodies) == {}


def test_a_difference_of_two_rotors_leaves_the_other_two_known():
    """(1, -1, 0, 0) of deviation s is s of rotors 1 and 2 over the mean, and nothing of 3 and 4."""
    turn = np.array([1.0, -1.0, 0.0, 0.0])
    bodies, fit = with_covariance(np.outer(turn, turn) * (0.6 * BEFORE) ** 2)
    assert list(assumed_rotors(fit, bodies)) == ["kt_1", "kt_2"]
