"""Motors and gyro on two clocks: said with its size, and no time or inertia is identified."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import flown
from rotorfit.checks.sensors.clock_drift import (
    CERTAIN,
    LEAST_CHANGE,
    PartDelays,
    delay_change,
    part_delays,
)
from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.simulation.pilot import Stick, Sticks

PARTS = np.arange(12) * 5.0 + 2.5
seeds = st.integers(0, 2**32 - 1)


@given(seed=seeds, change=st.floats(-0.5, 0.5), noise=st.floats(0.0, 0.002))
def test_even_change_of_delay_is_found_with_its_size(seed, change, noise):
    rng = np.random.default_rng(seed)
    rate = change / (PARTS[-1] - PARTS[0])
    found = delay_change(PartDelays(PARTS, rate * PARTS + noise * rng.standard_normal(12)))
    assert found.seconds == pytest.approx(change, abs=6.0 * noise + 1e-9)
    if abs(change) > LEAST_CHANGE + 30.0 * noise + CERTAIN * 0.001:
        assert found.is_sure
        assert found.jump is None
        assert found.rate == pytest.approx(rate, abs=(6.0 * noise + 1e-9) / 55.0)


@given(seed=seeds, size=st.floats(0.03, 0.4), after=st.integers(2, 10))
def test_jump_of_a_clock_is_found_where_it_is(seed, size, after):
    rng = np.random.default_rng(seed)
    delay = np.where(np.arange(12) < after, 0.01, 0.01 - size) + 1e-3 * rng.standard_normal(12)
    found = delay_change(PartDelays(PARTS, delay))
    assert found.is_sure
    assert found.jump == pytest.approx(5.0 * after)
    assert found.seconds == pytest.approx(-size, abs=0.004)


@given(seed=seeds, noise=st.floats(0.0, 0.006), delay=st.floats(-0.05, 0.05))
def test_steady_delay_is_no_change_for_all_its_noise(seed, noise, delay):
    rng = np.random.default_rng(seed)
    found = delay_change(PartDelays(PARTS, delay + noise * rng.standard_normal(12)))
    assert not found.is_sure
    assert delay_change(PartDelays(PARTS[:5], np.linspace(0.0, 1.0, 5))) is None


def turning(vehicle, delays, *, seconds=60.0, rate=200.0, seed=1, calm=()):
    """Return a flight whose turns follow the torques by one of some delays in each part."""
    rng = np.random.default_rng(seed)
    n = int(seconds * rate)
    part = np.minimum(np.arange(n) * len(delays) // n, len(delays) - 1)
    speed = 800.0 + 20.0 * rng.standard_normal((n, 4)).cumsum(axis=0) / np.sqrt(rate)
    speed[np.isin(part, calm)] = 800.0 + 1e-3 * rng.standard_normal((np.isin(part, calm).sum(), 4))
    torque = speed**2 @ vehicle.levers
    t = np.arange(n) / rate
    late = t - np.asarray(delays)[part]
    turn = np.column_stack([np.interp(late, t, one) for one in torque.T])
    zeros = np.zeros((n, 3))
    return FlightData(
        sample_rate=rate,
        time=100.0 + t,
        specific_force=zeros,
        angular_velocity=zeros,
        angular_acceleration=turn + 0.01 * turn.std(axis=0) * rng.standard_normal(turn.shape),
        rotor_speed=speed,
        rotor_acceleration=np.zeros_like(speed),
        differentiation="central",
        segments=(Segment(start=100, stop=n // 3), Segment(start=n // 3 + 40, stop=n - 100)),
    )


def test_delays_of_the_parts_are_those_of_the_turns():
    vehicle = flown.simulated("A", seed=3, seconds=12.0, physics_rate=200.0).vehicle
    delays = np.linspace(-0.1, 0.35, 12)
    parts = part_delays(turning(vehicle, delays), vehicle)
    assert len(parts.delay) >= 10
    expected = np.interp(parts.middle, 2.5 + 5.0 * np.arange(12), delays)
    np.testing.assert_allclose(parts.delay, expected, atol=0.004)


def test_calm_parts_show_no_delay_of_the_motors():
    vehicle = flown.simulated("A", seed=3, seconds=12.0, physics_rate=200.0).vehicle
    data = turning(vehicle, [0.0] * 8 + [0.05] * 4, calm=(8, 9, 10, 11))
    parts = part_delays(data, vehicle)
    assert parts.middle.max() < 45.0
    assert not delay_change(parts).is_sure


def test_motors_of_another_clock_are_said_and_doubted(tmp_path):
    brisk = Stick(band=(0.5, 5.0), rms=0.15)
    sticks = Sticks(roll=brisk, pitch=brisk)
    flight = flown.simulated("A", seed=3, seconds=25.0, physics_rate=200.0, sticks=sticks)
    result = flown.identified(tmp_path, [flight])
    (sound,) = (one for one in result.findings if one.kind == "clock-drift")
    assert sound.severity == "passed"
    apart = 1.004
    other = flight.time[0] + apart * (flight.time - flight.time[0])
    speed = [np.interp(flight.time, other, one) for one in flight.rotor_speed_measured.T]
    log = replace(flight, rotor_speed_measured=np.column_stack(speed))
    result = flown.identified(tmp_path, [log])
    (found,) = (one for one in result.findings if one.kind == "clock-drift")
    assert found.severity == "doubt"
    assert "run apart" in found.sentence
    factor = float(found.sentence.rpartition(" ")[2])
    assert factor == pytest.approx(1.0 / apart, abs=3e-4)
    for one in (*result.parameters, *result.derived):
        if one.name.partition("@")[0] in ("Ixx", "Ixx_com", "Iyy", "motor_delay", "kd"):
            assert one.verdict != "identified"
