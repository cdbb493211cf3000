"""The scale of a gyro by a velocity that does not come from it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rotorfit.fit.dataset.gyro_by_velocity import GyroScale, gyro_scale
from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.flight_data import FlightData, Segment

RATE = 200.0


def _flight(scale: np.ndarray, *, bias: float = 0.0, noise: float = 0.0) -> FlightData:
    """Build 30 s of slow turns with thrust along z, by exact attitudes (Euler angles)."""
    rng = np.random.default_rng(4)
    fine = 20
    time = np.arange(int(30 * RATE) * fine) / (RATE * fine)
    roll, pitch = 0.25 * np.sin(2.1 * time), 0.2 * np.sin(1.7 * time + 1.0)
    yaw = 0.8 * np.sin(0.6 * time)
    attitude = Rotation.from_euler("ZYX", np.column_stack([yaw, pitch, roll]))
    turns = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * RATE * fine
    rates = np.concatenate([turns[:1], 0.5 * (turns[1:] + turns[:-1]), turns[-1:]])
    force = np.zeros((len(time), 3))
    force[:, 2] = GRAVITY / (np.cos(roll) * np.cos(pitch))
    velocity = np.cumsum(attitude.apply(force) - [0.0, 0.0, GRAVITY], axis=0) / (RATE * fine)
    seen = attitude.inv().apply(velocity)[::fine]
    n = len(seen)
    gyro = rates[::fine] * (1.0 + scale) + bias
    return FlightData(
        sample_rate=RATE,
        time=time[::fine],
        specific_force=force[::fine],
        angular_velocity=gyro,
        angular_acceleration=np.gradient(gyro, axis=0) * RATE,
        rotor_speed=np.full((n, 4), 500.0),
        rotor_acceleration=np.zeros((n, 4)),
        differentiation="central",
        segments=(Segment(start=1, stop=n - 1),),
        velocity=seen + noise * rng.standard_normal(seen.shape),
    )


def test_a_scale_is_found_about_each_axis() -> None:
    true = np.array([0.04, -0.03, 0.02])
    found = gyro_scale([_flight(true, bias=0.03, noise=0.03)], np.zeros(3))
    assert found is not None
    assert found.value == pytest.approx(true, abs=2.5 * found.std.max())
    assert found.std.max() < 0.01
    assert min(found.probability(axis) for axis in range(3)) > 0.5


def test_a_sound_gyro_is_sound() -> None:
    found = gyro_scale([_flight(np.zeros(3), noise=0.03)], np.zeros(3))
    assert found is not None
    assert max(found.probability(axis) for axis in range(3)) < 0.03
    assert found.half_widths(np.eye(3)).max() == 0.0


def test_slow_errors_of_the_velocity_are_in_the_deviation() -> None:
    """A random walk beside it, as of an integrated accelerometer, makes no scale."""
    rng = np.random.default_rng(7)
    flight = _flight(np.zeros(3), noise=0.03)
    assert flight.velocity is not None
    walk = np.cumsum(rng.standard_normal(flight.velocity.shape), axis=0) * 0.1 / np.sqrt(RATE)
    flight.velocity[:] += walk
    found = gyro_scale([flight], np.zeros(3))
    assert found is not None
    assert np.abs(found.value / found.std).max() < 2.5
    assert max(found.probability(axis) for axis in range(3)) < 0.2


def test_without_a_velocity_nothing_is_said() -> None:
    flight = _flight(np.zeros(3))
    assert flight.velocity is not None
    flight.velocity[:] = np.nan
    assert gyro_scale([flight], np.zeros(3)) is None


def test_what_no_flight_shows_is_the_prior() -> None:
    """Three of a hundred gyros are off by 4 % (a deviation)."""
    unknown = GyroScale(value=np.full(3, 0.02), std=np.full(3, 0.5), degrees=8)
    assert unknown.probability(0) == pytest.approx(0.03, abs=0.002)
    assert unknown.half_widths(np.eye(3))[0] == 0.0
    clear = GyroScale(value=np.array([0.04, 0.0, 0.0]), std=np.full(3, 0.004), degrees=8)
    assert clear.probability(0) > 0.95
    assert 0.04 < clear.half_widths(np.eye(3))[0] < 0.055
    both = GyroScale(value=np.array([0.04, 0.04, 0.0]), std=np.full(3, 0.004), degrees=8)
    assert both.half_widths(np.ones((3, 1)))[0] > 0.08
