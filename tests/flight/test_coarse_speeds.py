"""Rotor speeds in coarse steps: the step is found, and too coarse a one is refused."""

import numpy as np
import pytest

from rotorfit.errors import FlightError
from rotorfit.flight.flight_checks import refuse_coarse_speeds
from rotorfit.flight.motors.coarse_speeds import coarse_speeds_sentence, speed_step


def rounded_speeds(step: float, deviation: float, seed: int = 1) -> np.ndarray:
    """Return speeds about different means that move slowly, rounded to a step."""
    rng = np.random.default_rng(seed)
    slow = np.cumsum(rng.normal(size=(4000, 4)), axis=0)
    slow = deviation * (slow - slow.mean(axis=0)) / slow.std(axis=0)
    return step * np.round((rng.uniform(900.0, 2100.0, 4) + slow) / step)


@pytest.mark.parametrize("step", [0.5, 10.0, 100.0])
def test_the_step_of_rounded_speeds_is_found(step):
    assert speed_step(rounded_speeds(step, 120.0)) == pytest.approx(step)


def test_speeds_without_a_grid_have_no_step():
    rng = np.random.default_rng(2)
    assert speed_step(rng.normal(1000.0, 50.0, (4000, 4))) == 0.0
    assert speed_step(np.zeros((4000, 4))) == 0.0
    assert speed_step(np.full((4000, 4), 412.0)) == 0.0


@pytest.mark.parametrize("seed", range(20))
def test_steps_are_too_coarse_from_about_twice_the_motion(seed):
    fine = rounded_speeds(100.0, 80.0, seed)
    assert coarse_speeds_sentence(fine, 100.0) is None
    coarse = rounded_speeds(100.0, 30.0, seed)
    assert "100 rad/s (955 rpm)" in (coarse_speeds_sentence(coarse, 100.0) or "")


def test_too_coarse_speeds_are_refused_in_flight_alone(assert_wording):
    speed = rounded_speeds(100.0, 20.0)
    speed[:1000] = np.linspace(0.0, 1500.0, 1000)[:, None]  # the start makes them vary
    assert coarse_speeds_sentence(speed, 100.0) is None
    with pytest.raises(FlightError) as refused:
        refuse_coarse_speeds(speed, [(1000, 4000)], 100.0)
    assert_wording(str(refused.value))
