"""What Betaflight is told of a law: nothing where thrust is linear, else what a search finds."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from rotorfit.flight.motors.motor_model import bends_of_thrust, betaflight_linear
from rotorfit.logs.motor_law import MotorLaw, PolynomialCurve, PowerCurve, SquareRootCurve


def test_thrust_that_is_linear_already_needs_no_factor():
    found = betaflight_linear(MotorLaw(curve=SquareRootCurve(900.0, 0.0)))
    assert found.factor == pytest.approx(0.0, abs=1e-4)
    assert found.error < 1e-4


@pytest.mark.parametrize(
    "curve",
    [PolynomialCurve((60.0, 840.0)), PowerCurve(900.0, 0.05, 0.75), PowerCurve(900.0, 0.0, 0.6)],
)
def test_it_is_the_factor_with_the_straightest_thrust(curve):
    def crooked(c):
        x = np.linspace(0.0, 1.0, 501)
        u = x * (1.0 + c * (1.0 - x) ** 2)
        match curve:
            case PolynomialCurve((offset, slope)):
                thrust = (offset + slope * u) ** 2
            case PowerCurve(_, b, p):
                thrust = (b + (1.0 - b) * u) ** (2.0 * p)
        return np.mean(((thrust - thrust[0]) / (thrust[-1] - thrust[0]) - x) ** 2)

    factors = np.linspace(0.0, 1.5, 301)
    best = factors[np.argmin([crooked(c) for c in factors])]
    assert betaflight_linear(MotorLaw(curve=curve)).factor == pytest.approx(best, abs=0.006)


@pytest.mark.parametrize("seed", range(5))
def test_it_is_the_minimum_that_scipy_finds(seed):
    rng = np.random.default_rng(seed)
    law = MotorLaw(curve=PowerCurve(900.0, rng.uniform(-0.05, 0.1), rng.uniform(0.55, 0.9)))
    expected = minimize_scalar(
        lambda c: float(np.mean(bends_of_thrust(law, np.array([c])) ** 2)),
        bounds=(0.0, 1.5),
        method="bounded",
        options={"xatol": 1e-8},
    )
    assert betaflight_linear(law).factor == pytest.approx(expected.x, abs=2e-5)
