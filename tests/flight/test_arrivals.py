"""Times of arrival are evened out; those of samples, some of which were lost, are left alone."""

from dataclasses import replace

import numpy as np
import pytest

from rotorfit.flight.arrivals import ARRIVAL, arrival_doubts, at_sampling_times, find_arrivals
from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.flight.prepare import prepare
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, to_flight_log, variant

STEP = 0.002
TAKEN = 1.7e9 + STEP * np.arange(10_000)


def bunched(taken, *, every, apart=2e-5):
    """Return the times at which a packet every so many seconds brings its samples."""
    packet = np.ceil((taken - taken[0]) / every)
    nth = np.arange(len(taken)) - np.searchsorted(packet, packet)
    return taken[0] + packet * every + nth * apart


def late_by_chance(taken, std):
    late = np.abs(np.random.default_rng(1).normal(0.0, std, len(taken)))
    return np.maximum.accumulate(taken + late) + 1e-9 * np.arange(len(taken))


@pytest.mark.parametrize("every", [0.01, 0.02, 0.033])
def test_samples_of_a_packet_are_spread(every):
    off = at_sampling_times(bunched(TAKEN, every=every)) - TAKEN
    inner = off[100:-100] - np.median(off)
    assert np.abs(inner).max() < 0.15 * every  # they arrived up to `every` late
    assert abs(np.median(off)) < 0.15 * every


@pytest.mark.parametrize("std", [0.002, 0.005])
def test_samples_late_by_chance_are_evened_out(std):
    taken = STEP * np.arange(10_000)
    found = find_arrivals(late_by_chance(taken, std))
    assert found.step == pytest.approx(STEP, rel=0.01)
    off = found.time - taken
    assert np.std(off[100:-100]) < 0.4 * std
    assert found.late == pytest.approx(2.5 * std, rel=0.5)


@pytest.mark.parametrize("seed", range(5))
def test_late_samples_that_seldom_leave_a_gap_are_spread(seed):
    """One step in a hundred is a gap: the flight was refused, as torn by a recorder."""
    taken = 0.005 * np.arange(8000)
    late = np.random.default_rng(seed).exponential(0.0017, len(taken))
    arrived = np.maximum.accumulate(taken + late) + 1e-9 * np.arange(len(taken))
    gaps = np.mean(np.diff(arrived) > 2.5 * np.median(np.diff(arrived)))
    assert 0.0025 < gaps < 0.015
    assert np.std((find_arrivals(arrived).time - taken)[100:-100]) < 0.0005


def test_seldom_lost_samples_with_jitter_are_left():
    for seed in range(100):
        rng = np.random.default_rng(seed)
        kept = np.ones(8000, dtype=bool)
        for first in rng.integers(0, 7900, int(40 * rng.uniform(0.3, 3.0))):
            kept[first : first + rng.integers(1, 20)] = False
        jitter = 0.001 * rng.random(8000)
        assert find_arrivals((0.005 * np.arange(8000) + jitter)[kept]) is None


@pytest.mark.parametrize("lost", [0.0, 0.05, 0.3, 0.6])
def test_times_of_samples_lost_by_chance_are_left(lost):
    kept = TAKEN[np.random.default_rng(2).random(len(TAKEN)) >= lost]
    assert np.array_equal(at_sampling_times(kept), kept)


def test_times_of_lost_samples_with_jitter_are_left():
    for seed in range(200):
        rng = np.random.default_rng(seed)
        jitter = rng.uniform(-0.2 * STEP, 0.2 * STEP, 2000)
        kept = (TAKEN[:2000] + jitter)[rng.random(2000) >= rng.uniform(0.05, 0.25)]
        assert find_arrivals(kept) is None


@pytest.mark.parametrize("pattern", [(1, 1, 0, 0), (1, 1, 1, 0, 0, 0), (1, 0, 0)])
def test_rows_left_out_by_a_pattern_keep_their_times(pattern):
    kept = TAKEN[np.resize(np.array(pattern, dtype=bool), len(TAKEN))]
    assert np.array_equal(at_sampling_times(kept), kept)


def test_jitter_under_a_step_is_left():
    jitter = np.random.default_rng(3).uniform(-0.4 * STEP, 0.4 * STEP, len(TAKEN))
    assert find_arrivals(TAKEN + jitter) is None


def test_a_pause_of_the_recorder_is_kept():
    taken = np.where(np.arange(10_000) < 6000, 0.0, 3.0) + STEP * np.arange(10_000)
    found = find_arrivals(bunched(taken, every=0.02))
    steps = np.diff(found.time)
    assert np.flatnonzero(steps > 0.5).tolist() == [5999]
    assert steps.min() > 0.0


def test_a_flight_with_motors_in_packets_is_used():
    flown, sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(seconds=12.0, ground_seconds=2.0, sensors=sensors)
    log = to_flight_log(simulate_flight(*flown, scenario, seed=5))
    sound = log.channels["rotor_speed"]
    packets = replace(sound, time=bunched(sound.time, every=0.02))
    heard = replace(log, channels={**log.channels, "rotor_speed": packets})
    expected, found = (
        prepare(one, rotor_count=4, arm=0.25, motors=MotorModel(speed="measured"))
        for one in (log, heard)
    )
    assert found.data.seconds_used == pytest.approx(expected.data.seconds_used, abs=0.5)
    assert ARRIVAL not in [one.kind for one in expected.findings]
    [said] = [one for one in found.findings if one.kind == ARRIVAL]
    assert "rotor speeds" in said.sentence
    assert not [*arrival_doubts(log.channels)]
