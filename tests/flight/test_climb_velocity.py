"""The velocity along the thrust that accelerometer and gyro feel, against a known motion."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.flight.kinematics import climb_velocity

RATE, SECONDS = 200.0, 20.0
TIME = np.arange(int(RATE * SECONDS)) / RATE
UP = np.array([0.0, 0.0, 9.81])
ALL = Segment(start=1, stop=len(TIME) - 1)


def swinging(seed, *, slowest=0.4):
    """Return a flight that swings about all axes and turns slowly, and its velocity along z."""
    rng = np.random.default_rng(seed)
    turn = 2.0 * np.pi * rng.integers(slowest * SECONDS, 1.5 * SECONDS, size=(2, 3)) / SECONDS
    phase = rng.uniform(0.0, 2.0 * np.pi, size=(2, 3))
    velocity = rng.uniform(0.3, 1.0, 3) * np.sin(turn[0] * TIME[:, None] + phase[0])
    angles = rng.uniform(0.0, 0.2, 3) * np.sin(turn[1] * TIME[:, None] + phase[1])
    angles[:, 2] += rng.uniform(-0.5, 0.5) * TIME
    attitude = Rotation.from_euler("xyz", angles)
    force = attitude.apply(np.gradient(velocity, TIME, axis=0) + UP, inverse=True)
    rates = (attitude[:-2].inv() * attitude[2:]).as_rotvec() * RATE / 2.0
    rates = np.concatenate([rates[:1], rates, rates[-1:]])
    nothing = np.zeros((len(TIME), 4))
    data = FlightData(
        sample_rate=RATE,
        time=TIME,
        specific_force=force,
        angular_velocity=rates,
        angular_acceleration=np.zeros_like(rates),
        rotor_speed=nothing,
        rotor_acceleration=nothing,
        differentiation="central",
        segments=(ALL,),
    )
    return data, attitude.apply(velocity, inverse=True)[:, 2]


def missed(found, true):
    """Return the error over the middle, as a share of the velocity; both without their mean."""
    middle = slice(200, -200)
    return np.std(found[middle] - true[middle]) / np.std(true[middle])


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_it_is_the_velocity_along_the_bodys_z_axis(seed):
    data, true = swinging(seed)
    assert missed(climb_velocity(data), true) < 0.15


def test_faults_of_the_sensors_hardly_matter():
    data, true = swinging(3)
    worse = replace(
        data,
        specific_force=data.specific_force + np.array([0.2, -0.2, 0.2]),
        angular_velocity=data.angular_velocity + np.array([0.01, -0.01, 0.01]),
    )
    assert missed(climb_velocity(worse), true) < 0.15


def test_what_is_slow_is_left_out():
    data, true = swinging(4)
    drift = 0.5 * np.sin(2.0 * np.pi * 0.05 * TIME)
    rise = data.specific_force + np.gradient(drift, TIME)[:, None] * UP / 9.81
    assert missed(climb_velocity(replace(data, specific_force=rise)), true) < 0.2


def test_outside_the_segments_and_in_a_blink_there_is_none():
    data, _ = swinging(5)
    some = (Segment(start=400, stop=1400), Segment(start=2000, stop=2001))
    found = climb_velocity(replace(data, segments=some))
    assert np.flatnonzero(found[:1500])[[0, -1]] == pytest.approx([399, 1400])
    assert not found[1500:].any()
