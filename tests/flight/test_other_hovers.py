"""Hovers that the search for flight leaves out."""

import numpy as np
import pytest
from scipy import ndimage

from rotorfit.flight.airborne import GRAVITY, Motion
from rotorfit.flight.other_hovers import other_hovers

RATE = 50.0


def motion(thrusts, *, seconds=10.0, flies=True, seed=0):
    """Fly ten seconds on each thrust, with changes that the accelerometer feels where it flies."""
    random = np.random.default_rng(seed)
    n = round(seconds * RATE)
    change = ndimage.gaussian_filter1d(random.normal(size=len(thrusts) * n), 8)
    change = 0.05 * change / change.std()
    push = np.repeat(thrusts, n) * (1.0 + change)
    force = np.zeros((len(push), 3))
    force[:, 2] = GRAVITY * (1.0 + flies * change) + random.normal(0.0, 0.05, len(push))
    rates = 0.05 * flies * random.normal(size=force.shape)
    speed = np.sqrt(push / 4.0)[:, None] * np.ones(4)
    return Motion(
        sample_rate=RATE,
        specific_force=force,
        angular_velocity=rates,
        rotor_speed=speed,
        arm=0.2,
        stretches=((0, len(push)),),
    )


def found(thrusts, **settings):
    flown = motion(thrusts, **settings)
    n = len(flown.rotor_speed)
    return other_hovers(flown, [(0, n // len(thrusts))], np.arange(n) / RATE)


@pytest.mark.parametrize("thrust", [0.5, 1.6])
def test_a_hover_on_another_thrust_is_found_with_its_seconds(thrust):
    [hover] = found([1.0, thrust])
    assert hover.thrust == pytest.approx(thrust, rel=0.02)
    assert (hover.start, hover.end) == pytest.approx((10.0, 20.0), abs=0.3)


def test_what_does_not_contradict_is_no_other_hover():
    assert found([1.0, 1.1]) == ()
    assert found([1.0, 0.5], seconds=3.0) == ()


@pytest.mark.parametrize("thrust", [0.1, 0.5])
def test_motors_on_the_ground_are_no_hover(thrust):
    assert found([1.0, thrust], flies=False) == ()
