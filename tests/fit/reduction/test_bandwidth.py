"""The bandwidth of sensors: made flights behind low-passes at random cut-offs, and behind none."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.fast_worlds import draw_world
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.signal import butter, sosfilt, sosfiltfilt

import made_fit
from flown import simulated
from rotorfit.fit.reduction.bandwidth import LEAST_FOLLOWED, Bandwidth, bandwidths
from rotorfit.flight.flight_data import Segment
from rotorfit.flight.prepare import prepare
from rotorfit.logs.read import read_log
from rotorfit.simulation import simulate_flight, write_flight_table

RATE = 200.0
SECONDS = 40.0


def made_flight(seed, *, noise=0.05):
    """Thrust and turns that the rotors make, up to about 10 Hz, with some noise of the sensors."""
    rng = np.random.default_rng(seed)
    rows = round(RATE * SECONDS)
    shaped = butter(1, 6.0, fs=RATE, output="sos")
    motion = sosfilt(shaped, rng.normal(size=(rows, 4)), axis=0)
    speed = 500.0 * (1.0 + 0.15 * motion)
    vehicle = made_fit.QUAD
    made = made_fit.prepared(seconds=SECONDS, segments=(Segment(start=1, stop=rows - 1),)).data
    squares = speed**2
    thrust = squares.sum(axis=1) / (4.0 * 500.0**2) * 9.81
    arms = np.cross(vehicle.positions, vehicle.axes)
    turns = 1e-3 * squares @ arms
    force = np.zeros((rows, 3))
    force[:, 2] = thrust
    size = turns[:, :2].std()
    return vehicle, replace(
        made,
        sample_rate=RATE,
        time=np.arange(rows) / RATE,
        specific_force=force + noise * thrust.std() * rng.normal(size=(rows, 3)),
        angular_velocity=np.zeros((rows, 3)),
        angular_acceleration=turns + noise * size * rng.normal(size=(rows, 3)),
        rotor_speed=speed,
        rotor_acceleration=np.gradient(speed, 1.0 / RATE, axis=0),
        differentiation="exact",
        segments=(Segment(start=0, stop=rows),),
        velocity=None,
        carried=None,
        climb=None,
    )


def low_passed(values, cutoff, shape):
    """Low-pass as an autopilot does, or as the smoothing of motion capture, 3 dB at the cut-off."""
    if shape == "smoothed":
        wider = cutoff / (np.sqrt(2.0) - 1.0) ** 0.25
        return sosfiltfilt(butter(2, wider, fs=RATE, output="sos"), values, axis=0)
    order = {"first order": 1, "second order": 2}[shape]
    return sosfilt(butter(order, cutoff, fs=RATE, output="sos"), values, axis=0)


@settings(max_examples=25, deadline=None)
@given(
    st.floats(1.6, 15.0),
    st.sampled_from(["first order", "second order", "smoothed"]),
    st.integers(0, 1000),
)
@example(4.0, "first order", 2)  # by its noise alone it seems of second order
@example(5.629, "first order", 387)
def test_a_filtered_accelerometer_shows_its_bandwidth(cutoff, shape, seed):
    vehicle, data = made_flight(seed)
    force = low_passed(data.specific_force, cutoff, shape)
    found = bandwidths(replace(data, specific_force=force), vehicle, top=40.0)
    assert set(found) == {"accel"}
    assert found["accel"].cutoff == pytest.approx(cutoff, rel=0.2)


@settings(max_examples=15, deadline=None)
@given(st.floats(2.0, 6.0), st.floats(0.35, 0.5), st.integers(0, 1000))
def test_a_filter_is_found_by_the_silence_above_it(cutoff, air, seed):
    """Fast flight in motion capture: air and noise leave coherence in the lowest bands alone."""
    vehicle, data = made_flight(seed, noise=0.0)
    rng, force = np.random.default_rng(seed), data.specific_force
    size = force.std(axis=0)
    gusts = sosfilt(butter(1, 6.0, fs=RATE, output="sos"), rng.normal(size=force.shape), axis=0)
    pushed = force + air * size * gusts / gusts.std(axis=0)
    smoothed = low_passed(pushed, cutoff, "smoothed") + air * size * rng.normal(size=force.shape)
    found = bandwidths(replace(data, specific_force=smoothed), vehicle, top=40.0)
    assert set(found) == {"accel"}
    assert found["accel"].cutoff == pytest.approx(cutoff, rel=0.25)


@settings(max_examples=15, deadline=None)
@given(st.floats(3.0, 15.0), st.sampled_from(["second order", "smoothed"]), st.integers(0, 1000))
def test_a_filtered_gyro_shows_its_bandwidth(cutoff, shape, seed):
    """Of smoothed motion capture as of an IMU: only the angular acceleration is looked at."""
    vehicle, data = made_flight(seed)
    turns = low_passed(data.angular_acceleration, cutoff, shape)
    found = bandwidths(replace(data, angular_acceleration=turns), vehicle, top=40.0)
    assert set(found) == {"gyro"}
    assert found["gyro"].cutoff == pytest.approx(cutoff, rel=0.2)


@pytest.mark.parametrize("index", [5, 10])
def test_rotors_that_answer_the_noise_of_the_gyro_show_no_filter(index, tmp_path):
    """At speed what they do is coherent with the noise, late, and smaller the slower it is."""
    world = draw_world(1128, index, seconds=25.0)
    flight = simulate_flight(world.truth, world.vehicle, world.scenario, seed=index)
    table = tmp_path / "flight.csv"
    write_flight_table(flight, table, channels=("gyro", "accel", "rotor_speed", "velocity"))
    data = prepare(read_log(table), rotor_count=4, arm=world.vehicle.arm).data
    assert "gyro" not in bandwidths(data, world.vehicle, top=40.0)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.05, 3.0))
def test_sensors_without_a_filter_show_none(seed, noise):
    vehicle, data = made_flight(seed, noise=noise)
    assert bandwidths(data, vehicle, top=40.0) == {}


def test_a_flight_too_short_shows_nothing():
    vehicle, data = made_flight(0)
    force = low_passed(data.specific_force, 4.0, "second order")
    short = replace(data, specific_force=force, segments=(Segment(start=0, stop=900),))
    assert bandwidths(short, vehicle, top=40.0) == {}


def test_a_late_channel_follows_less_far_than_one_that_is_timed():
    """In phase, a second-order low-pass at 10 Hz has lost 15 % at 3.7 Hz, and of its size at 8."""
    grid = np.arange(0.0, 30.0, 0.01)
    one = Bandwidth(shape="second order", cutoff=11.0, interval=(10.0, 12.0), delay=0.0, gain=100.0)
    u = one.follows(grid, in_phase=True) / 10.0
    assert (1.0 - u**2) / (1.0 + u**4) == pytest.approx(LEAST_FOLLOWED, abs=1e-2)
    assert one.follows(grid, in_phase=False) == pytest.approx(
        10.0 * (LEAST_FOLLOWED**-2 - 1.0) ** 0.25, abs=0.02
    )


@pytest.mark.parametrize("seed", range(4))
def test_an_autopilot_that_works_against_gusts_is_no_filter(seed, tmp_path):
    """Above the pilot's motion the rotors follow the gusts, late and small, as if filtered."""
    flight = simulated("A", "real", seed=seed, seconds=20.0)
    write_flight_table(flight, tmp_path / "flight.csv")
    data = prepare(read_log(tmp_path / "flight.csv"), rotor_count=4, arm=flight.vehicle.arm).data
    assert bandwidths(data, flight.vehicle, top=40.0) == {}
