"""The wind of made flights: noses that turn and do not, drag, bias, gusts, and no wind at all."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

import made_fit
from rotorfit.fit.dataset.wind import LEAST_SHARE, estimate_wind
from rotorfit.flight.flight_data import Segment

RATE = 50.0
SECONDS = 60.0
ROWS = round(RATE * SECONDS)
DRAG = 0.35
"""Of all rotors in hover, over the mass [1/s]."""


def low_passed(rng, columns, cutoff):
    shape = butter(1, cutoff, fs=RATE, output="sos")
    made = sosfilt(shape, rng.normal(size=(ROWS, columns)), axis=0)
    return made / made.std(axis=0)


def made_flight(seed, *, wind, speed=4.0, turning=True):
    """Fly about in a wind [m/s] over the world's x and y, with gusts, noise and a biased sensor."""
    rng = np.random.default_rng(seed)
    heading = np.cumsum(low_passed(rng, 1, 0.1)[:, 0]) / RATE * (1.0 if turning else 0.0)
    world = np.column_stack([speed * low_passed(rng, 2, 0.15), np.zeros(ROWS)])
    ahead = np.column_stack([np.cos(heading), -np.sin(heading), np.zeros(ROWS)])
    left = np.column_stack([np.sin(heading), np.cos(heading), np.zeros(ROWS)])

    def in_body(x, y):
        return x[:, None] * ahead + y[:, None] * left

    velocity = in_body(world[:, 0], world[:, 1])
    through = in_body(world[:, 0] - wind[0], world[:, 1] - wind[1])
    rotors = 500.0 * (1.0 + 0.1 * low_passed(rng, 4, 2.0))
    share = rotors.sum(axis=1, keepdims=True) / rotors.sum(axis=1).mean()
    force = -DRAG * share * through + rng.normal(scale=0.1, size=3)
    force += 0.1 * low_passed(rng, 3, 1.0)
    made = made_fit.prepared(seconds=SECONDS, segments=(Segment(start=1, stop=ROWS - 1),)).data
    return replace(
        made,
        sample_rate=RATE,
        time=np.arange(ROWS) / RATE,
        specific_force=force + np.array([0.0, 0.0, 9.8]),
        angular_velocity=np.zeros((ROWS, 3)),
        angular_acceleration=np.zeros((ROWS, 3)),
        rotor_speed=rotors,
        rotor_acceleration=np.zeros((ROWS, 4)),
        segments=(Segment(start=0, stop=ROWS),),
        velocity=velocity,
        world_axes=np.hstack([ahead, left]),
        carried=None,
        climb=None,
    )


def test_a_steady_wind_is_found_with_its_interval():
    inside = []
    for seed in range(40):
        angle = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi)
        wind = 3.0 * np.array([np.cos(angle), np.sin(angle)])
        found = estimate_wind(made_flight(seed, wind=wind))
        assert found is not None
        error = np.array(found.velocity) - wind
        assert np.abs(error).max() < 0.6
        inside += (np.abs(error) < 1.96 * found.std).tolist()
    assert np.mean(inside) > 0.85


@pytest.mark.parametrize("turning", [True, False])
def test_still_air_and_a_light_wind_are_left_alone(turning):
    for seed in range(40):
        light = 0.8 * LEAST_SHARE * 4.0
        for wind in ((0.0, 0.0), (light, 0.0)):
            found = estimate_wind(made_flight(seed, wind=wind, turning=turning))
            assert found is None or np.hypot(*found.velocity) < 1.6 * LEAST_SHARE * 4.0
            assert found is None or wind != (0.0, 0.0)


def test_a_nose_that_does_not_turn_takes_no_bias_for_wind():
    """Without a turn a wind is a bias, which is known before the flight only so well."""
    for seed in range(20):
        found = estimate_wind(made_flight(seed, wind=(0.0, 0.0), speed=1.0, turning=False))
        assert found is None


def test_a_log_without_attitude_shows_no_wind():
    flight = replace(made_flight(0, wind=(3.0, 0.0)), world_axes=None)
    assert estimate_wind(flight) is None
