"""Repeats, straight lines, limits, vibration and delay are measured where they are, else not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from hand_made_logs import channel, hover_thrust, motion_log
from rotorfit.checks.hover_thrust import AGAINST_GRAVITY
from rotorfit.findings import doubt
from rotorfit.fit.dataset.plausible_units import GravitySeen
from rotorfit.flight.prepare import prepare
from rotorfit.simulation import PERFECT, Scenario, paper_vehicle, simulate_flight, to_flight_log
from rotorfit.tools.inspection.inspect_log import CHECKS
from rotorfit.tools.inspection.motor_lateness import motor_lateness
from rotorfit.tools.inspection.recording import (
    channel_report,
    lacks,
    new_share,
    share_at_limit,
    vibration,
)

RNG = np.random.default_rng(7)
NOISE = RNG.normal(size=(4000, 3)).cumsum(axis=0)


@pytest.mark.parametrize("factor", [2, 4, 10])
def test_repeated_samples_are_unmasked(factor):
    assert new_share(np.repeat(NOISE, factor, axis=0)) == pytest.approx(1 / factor, rel=0.01)


@pytest.mark.parametrize("factor", [2, 4, 10])
def test_straight_lines_between_samples_are_unmasked(factor):
    slow = np.arange(len(NOISE))
    fast = np.arange(0, len(NOISE) - 1, 1 / factor)
    drawn = np.column_stack([np.interp(fast, slow, column) for column in NOISE.T])
    assert new_share(drawn) == pytest.approx(1 / factor, rel=0.02)


@pytest.mark.parametrize("factor", [2.3, 3.24, 7.7])
def test_straight_lines_are_unmasked_at_any_ratio_of_rates(factor):
    slow = np.arange(len(NOISE))
    fast = np.arange(0, len(NOISE) - 1, 1 / factor)
    drawn = np.column_stack([np.interp(fast, slow, column) for column in NOISE.T])
    written = np.array([float(f"{x:.9g}") for x in drawn.ravel()]).reshape(drawn.shape)
    assert new_share(written) == pytest.approx(1 / factor, rel=0.15)


def test_a_single_line_within_motion_is_not_taken_for_more():
    ramped = np.concatenate([NOISE, NOISE[-1] + np.linspace(0.0, 9.0, 900)[:, None] * [1, 2, 3]])
    assert new_share(ramped) == 1.0


@pytest.mark.parametrize(
    "values",
    [NOISE, np.round(0.2 * NOISE), np.round(0.02 * NOISE), np.zeros((900, 3)), NOISE[:3]],
    ids=["fine", "coarse", "very coarse", "still", "three samples"],
)
def test_what_is_only_coarse_is_no_repeat(values):
    assert new_share(values) == 1.0


def test_nothing_is_reported_of_values_that_no_sensor_reads():
    assert new_share(np.repeat(NOISE, 4, axis=0)) < 0.3
    assert new_share(1e300 * np.repeat(NOISE, 4, axis=0)) == 1.0


def test_a_sensor_at_its_limit():
    swing = 40.0 * np.sin(np.arange(2000) / 30.0)[:, None]
    assert share_at_limit(np.clip(swing, -35.0, 35.0), 4.0) == pytest.approx(0.322, abs=0.01)
    assert share_at_limit(swing, 4.0) == 0.0
    assert share_at_limit(np.clip(swing, -35.0, 35.0), 36.0) == 0.0


def test_a_rounded_peak_is_no_limit():
    swing = 7.0 * np.sin(np.arange(4000) / 90.0)[:, None]
    rounded = np.round(swing / np.radians(1.0)) * np.radians(1.0)
    crest = float(rounded.max())
    assert (rounded == crest).sum() > 30  # it stands still there for many samples in a row
    assert share_at_limit(rounded, 4.0) == 0.0
    assert share_at_limit(np.minimum(rounded, 5.0), 4.0) > 0.1


def test_samples_that_are_repeated_are_no_limit():
    repeated = np.repeat(5.0 * np.sin(np.arange(1000) / 2.0)[:, None], 4, axis=0)
    assert share_at_limit(repeated, 4.0) > 0.0
    assert share_at_limit(repeated, 4.0, repeats=4) == 0.0
    t = np.arange(len(repeated)) / 200.0
    assert channel_report("gyro", channel(t, repeated)).at_limit == 0.0


def test_gaps_and_jitter():
    t = np.arange(1000) / 100.0
    t[500:] += 0.7
    report = channel_report("gyro", channel(t, NOISE[:1000]))
    assert (report.gaps, report.rate) == (1, pytest.approx(100.0))
    assert report.longest_gap == pytest.approx(0.71)
    assert report.jitter == pytest.approx(0.0, abs=1e-9)
    uneven = t + RNG.uniform(-0.003, 0.003, len(t))
    assert 0.001 < channel_report("gyro", channel(uneven, NOISE[:1000])).jitter < 0.004


def test_vibration_of_a_known_level():
    thrust = hover_thrust(12)
    t = np.arange(len(thrust)) / 200.0
    force = np.zeros((len(t), 3))
    force[:, 2] = 9.80665 * thrust
    force[:, 0] += 2.0 * np.sqrt(2.0) * np.sin(2 * np.pi * 30.0 * t)
    found = vibration(prepare(motion_log(thrust, force=force), rotor_count=4, arm=0.2).data)
    assert [(v.low, round(v.high)) for v in found] == [(10.0, 50), (50.0, 100)]
    assert found[0].level == pytest.approx(2.0, rel=0.05)
    assert found[1].level < 0.4


@pytest.mark.parametrize("late", [-150, -20, 0, 15, 150, 300])
def test_motors_late_against_the_gyro(late):
    flight = simulate_flight(*paper_vehicle("A"), Scenario(seconds=12.0, sensors=PERFECT), seed=2)
    log = to_flight_log(flight)
    data = prepare(log, rotor_count=4, arm=0.2).data
    step = round(late * 1e-3 * data.sample_rate)
    moved = np.roll(data.rotor_speed, -step, axis=0)
    found = motor_lateness(replace(data, rotor_speed=moved))
    assert found == pytest.approx(step / data.sample_rate, abs=0.002)


def test_what_a_log_lacks():
    log = motion_log(hover_thrust(3), name="command")
    reports = {name: channel_report(name, c) for name, c in log.channels.items()}
    assert lacks(reports, accel_cutoff=10.0) == {"no rotor speed", "no battery", "filtered accel"}
    slow = channel_report("command", channel(np.arange(50) / 10.0, NOISE[:50]))
    assert "slow motors" in lacks({**reports, "command": slow})
    assert lacks({}) == {"no gyro", "no accel", "no rotor speed", "no motors", "no battery"}


@pytest.mark.parametrize(("slow", "seed"), [(85.0, None), (85.0, 1), (25.0, None), (25.0, 1)])
def test_a_source_slower_than_its_log_is_known_by_what_is_new(slow, seed):
    """100 rows a second, of which the source gives 85 or 25, evenly or at random moments."""
    chance = np.random.default_rng(seed or 0)
    new = chance.random(3000) < slow / 100 if seed else (np.arange(3000) * slow % 100) < slow
    values = chance.standard_normal((3000, 3))[np.cumsum(new)]
    report = channel_report("gyro", channel(0.01 * np.arange(3000), values))
    assert report.rate == pytest.approx(100.0)
    assert report.true_rate == pytest.approx(slow, rel=0.03)


def test_the_rate_counts_samples_that_come_late():
    """Every fifth sample is lost, too few in a row for a gap: 80 a second, not 100."""
    kept = np.arange(1000)[np.arange(1000) % 5 != 0]
    report = channel_report("gyro", channel(0.01 * kept, NOISE[kept]))
    assert (report.gaps, report.rate) == (0, pytest.approx(80.0, rel=0.01))


def test_gravity_is_doubted_once_where_the_fit_doubts_it(assert_wording):
    seen = GravitySeen(at_rest=0.97, in_flight=0.97, in_flight_std=0.001)
    by_fit = doubt(AGAINST_GRAVITY, "in hover the accelerometer reads 9.52 m/s^2")
    result = SimpleNamespace(parameters=("kt",), findings=(by_fit,))
    [check] = [one for one in CHECKS if one.__name__ == "_gravity_findings"]
    assert list(check(SimpleNamespace(gravity=seen, result=result))) == []
    [alone] = check(SimpleNamespace(gravity=seen, result=None))
    assert "reads 9.51" in alone.sentence
    assert_wording(alone.sentence)
