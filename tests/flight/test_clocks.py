import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_made_logs import channel
from rotorfit.errors import FlightError
from rotorfit.flight.clocks import GAP_STEPS, uniform_channels, usable_samples


def uniform(channels, *, clock="gyro", **options):
    usable = {name: usable_samples(c, name) for name, c in channels.items()}
    return uniform_channels(usable, clock=clock, **options)


def wave(time):
    return np.sin(2 * np.pi * np.outer(time, (0.5, 1.0, 1.5)))


def used(result):
    return np.concatenate([np.arange(a, b) for a, b in result.stretches])


def test_a_uniform_clock_in_the_time_of_the_log_is_left_alone():
    time = 362.5 + np.arange(1000) / 500
    values = wave(time)
    result = uniform({"gyro": channel(time, values)})
    assert result.time == pytest.approx(time, abs=1e-9)
    assert np.array_equal(result.values["gyro"], values)
    assert result.stretches == ((0, 1000),)
    assert result.sample_rate == pytest.approx(500)
    assert result.gaps == ()


def test_jitter_is_resampled_to_the_mean_rate():
    rng = np.random.default_rng(1)
    time = np.arange(5000) / 500 + rng.uniform(-3e-4, 3e-4, 5000)
    result = uniform({"gyro": channel(time, wave(time))})
    assert np.ptp(np.diff(result.time)) < 1e-9
    assert result.sample_rate == pytest.approx(500, rel=1e-4)
    assert result.values["gyro"][used(result)] == pytest.approx(
        wave(result.time[used(result)]), abs=1e-3
    )
    assert len(used(result)) >= 4998


def test_two_alternating_steps_make_their_mean_the_rate():
    # Two thirds of the steps are 2 ms, so that the median is not the mean.
    time = np.cumsum(np.tile([2e-3, 2e-3, 2.3e-3], 1000))
    assert uniform({"gyro": channel(time, wave(time))}).sample_rate == pytest.approx(
        3 / 6.3e-3, rel=1e-4
    )


def test_a_drifting_clock_keeps_its_own_time():
    k = np.arange(20000)
    time = 0.002 * k + 2e-9 * k**2  # 2 % slower at the end
    result = uniform({"gyro": channel(time, wave(time))})
    assert result.values["gyro"] == pytest.approx(wave(result.time), abs=1e-3)
    assert result.time[-1] == pytest.approx(time[-1], abs=0.002)


def test_single_lost_samples_are_bridged_others_stay():
    time = np.arange(2000) / 500
    kept = np.ones(2000, dtype=bool)
    kept[50::97] = False
    values = np.random.default_rng(0).normal(size=(2000, 3))
    result = uniform({"gyro": channel(time[kept], values[kept])})
    assert result.time == pytest.approx(time, abs=1e-9)
    assert np.array_equal(result.values["gyro"][kept], values[kept])
    assert result.stretches == ((0, 2000),)


def test_values_that_columns_lose_for_a_moment_are_bridged():
    time = np.arange(10_000) / 500
    lost = np.random.default_rng(5).random((10_000, 3)) < 0.05
    values = np.where(lost, np.nan, wave(time))
    result = uniform({"gyro": channel(time, values)})
    assert result.gaps == ()
    rows = used(result)
    # A line over 10 ms misses the crest of 1.5 Hz by (2 pi 1.5 x 0.01)^2 / 8.
    assert result.values["gyro"][rows] == pytest.approx(wave(result.time[rows]), abs=1.2e-3)


def test_values_lost_for_longer_are_a_gap():
    time = np.arange(2000) / 500
    values = wave(time)
    values[700:704, 1] = np.nan
    assert uniform({"gyro": channel(time, values)}).gaps == ()
    values[700:705, 1] = np.nan
    assert uniform({"gyro": channel(time, values)}).stretches == ((0, 700), (700, 1995))
    values[705:720, 0] = np.nan  # one column after another: none of these rows is whole
    assert len(uniform({"gyro": channel(time, values)}).gaps) == 1


def test_no_element_of_a_quaternion_is_bridged():
    time = np.arange(100) / 100
    values = np.tile([1.0, 0.0, 0.0, 0.0], (100, 1))
    values[50, 0] = np.nan
    assert len(usable_samples(channel(time, values), "attitude").time) == 99
    assert len(usable_samples(channel(time, values), "motor").time) == 100


def test_a_gap_in_one_channel_is_cut_and_named():
    time = np.arange(2000) / 500
    kept = (time < 1.0) | (time > 1.5)
    channels = {"gyro": channel(time, wave(time)), "accel": channel(time[kept], wave(time[kept]))}
    result = uniform(channels)
    assert not ((result.time[used(result)] > 0.9981) & (result.time[used(result)] < 1.5019)).any()
    assert len(result.stretches) == 2
    assert result.gaps == ((pytest.approx(0.998), pytest.approx(1.502), "accel"),)


def test_a_jump_of_the_clock_is_a_gap_and_keeps_the_logs_time():
    time = np.arange(1000) / 500
    time[400:] += 1e6
    result = uniform({"gyro": channel(time, wave(time))})
    assert [result.time[a] for a, _ in result.stretches] == [0.0, pytest.approx(1e6 + 0.8)]
    assert result.sample_rate == pytest.approx(500)
    assert len(result.time) == 1000


@pytest.mark.parametrize("damage", [np.nan, np.inf, -np.inf, 1e300])
def test_samples_that_are_no_numbers_are_a_gap(damage):
    time = np.arange(1000) / 500
    values = wave(time)
    values[300:400, 1] = damage
    result = uniform({"gyro": channel(time, values)})
    assert result.stretches == ((0, 300), (300, 900))
    assert result.time[300] == pytest.approx(0.8)
    assert np.abs(result.values["gyro"]).max() <= 1


def test_clocks_of_two_rates_and_spans_meet_in_their_overlap():
    fast, slow = np.arange(1000) / 500, 0.2 + np.arange(100) / 100
    result = uniform({"gyro": channel(fast, wave(fast)), "rotor_speed": channel(slow, wave(slow))})
    rows = used(result)
    assert result.time[rows[0]] == pytest.approx(0.2)
    assert result.time[rows[-1]] == pytest.approx(1.19)
    assert result.rates["rotor_speed"] == pytest.approx(100)
    assert result.values["rotor_speed"][rows] == pytest.approx(wave(result.time[rows]), abs=2e-3)


def test_an_optional_channel_cuts_nothing_and_is_nan_in_gaps():
    fast, slow = np.arange(1000) / 500, 0.5 + np.arange(3, 13) / 10
    result = uniform(
        {"gyro": channel(fast, wave(fast)), "velocity": channel(slow, wave(slow))},
        optional=("velocity",),
    )
    assert result.stretches == ((0, 1000),)
    there = np.isfinite(result.values["velocity"]).all(axis=1)
    assert result.time[there][0] == pytest.approx(0.8)
    assert result.time[there][-1] == pytest.approx(1.7)
    assert result.gaps == ()


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), gaps=st.integers(0, 6), loss=st.floats(0, 0.3))
def test_no_used_sample_is_far_from_recorded_ones_on_either_side(seed, gaps, loss):
    rng = np.random.default_rng(seed)
    channels = {}
    for name, rate in (("gyro", 500.0), ("accel", 250.0), ("rotor_speed", 100.0)):
        time = rng.uniform(0, 0.3) + np.arange(int(rate * rng.uniform(2, 4))) / rate
        time = np.sort(time + rng.uniform(-0.2, 0.2, len(time)) / rate)
        kept = rng.uniform(size=len(time)) >= loss
        for start in rng.uniform(0, 4, gaps):
            kept &= (time < start) | (time > start + rng.uniform(0, 0.2))
        time = time[kept] + 1e5
        if len(time) < 100:
            return
        channels[name] = channel(time, wave(time))
    try:
        result = uniform(channels)
    except FlightError as error:
        assert "never overlap" in str(error)
        return
    assert (np.diff(result.time) > 0).all()
    when = result.time[used(result)]
    for name, c in channels.items():
        longest = GAP_STEPS * np.median(np.diff(c.time)) * 1.01
        right = np.searchsorted(c.time, when - 3e-3 * longest)
        right = np.minimum(right, len(c.time) - 1)
        there = np.abs(c.time[right] - when) < 3e-3 * longest
        left = np.maximum(right - 1, 0)
        between = (c.time[left] <= when + 1e-4 * longest) & (c.time[right] >= when - 3e-3 * longest)
        near = c.time[right] - c.time[left] <= longest
        assert (there | (between & near)).all(), name
    for a, b in result.stretches:
        assert np.diff(result.time[a:b]) == pytest.approx(1 / result.sample_rate, rel=1e-5)


def test_repeated_times_are_dropped_once():
    time = np.repeat(np.arange(100) / 100, 2)
    usable = usable_samples(channel(time, np.arange(200.0)), "gyro")
    assert np.array_equal(usable.time, np.arange(100) / 100)
    assert np.array_equal(usable.values[:, 0], np.arange(0.0, 200.0, 2))


def test_single_precision_becomes_double_in_a_copy():
    values = np.arange(100, dtype=np.float32)[:, None]
    given_channel = channel(np.arange(100) / 100, values)
    assert usable_samples(given_channel, "gyro").values.dtype == np.float64
    assert given_channel.values is values


def test_a_clock_that_runs_backwards_is_refused(assert_text):
    time = np.arange(100) / 100
    time[60:] -= 0.05
    with pytest.raises(FlightError) as refused:
        usable_samples(channel(time, time), "accel")
    assert_text(str(refused.value))


def test_a_clock_that_stands_still_is_refused(assert_text):
    with pytest.raises(FlightError) as refused:
        usable_samples(channel(np.full(50, 3.0), np.ones(50)), "gyro")
    assert_text(str(refused.value))


@pytest.mark.parametrize("samples", [0, 1, 7])
def test_too_few_samples_are_refused(samples, assert_text):
    time = np.arange(samples, dtype=float)
    with pytest.raises(FlightError) as refused:
        usable_samples(channel(time, time), "gyro")
    assert_text(str(refused.value))


def test_channels_that_never_meet_are_refused(assert_text):
    early, late = np.arange(100) / 100, 50 + np.arange(100) / 100
    with pytest.raises(FlightError) as refused:
        uniform({"gyro": channel(early, early), "accel": channel(late, late)})
    assert_text(str(refused.value))


def test_thousands_of_gaps_take_linear_time(benchmark):
    time = np.arange(400_000) / 500 + 0.1 * (np.arange(400_000) // 100)
    result = benchmark.pedantic(
        lambda: uniform({"gyro": channel(time, wave(time))}), rounds=1, iterations=1
    )
    assert len(result.stretches) == 4000
    assert len(result.time) == 400_000


def slow_and_fast(motor, *, held=()):
    """Return a motor of 500 Hz with a gap, away from its ends, on a clock of 50 Hz."""
    slow, fast = np.arange(500) / 50, np.arange(5000) / 500
    fast = fast[(fast < 4.0) | (fast > 4.5)]
    channels = {"gyro": channel(slow, wave(slow)), "motor": channel(fast, motor(fast)[:, None])}
    result = uniform(channels, held=held)
    away = [np.arange(a + 10, b - 10) for a, b in result.stretches]
    assert len(away) == 2
    rows = np.concatenate(away)
    return result.time[rows], result.values["motor"][rows, 0]


def test_quick_commands_do_not_fold_into_a_slow_clock():
    time, kept = slow_and_fast(
        lambda t: np.sin(2 * np.pi * 3 * t) + np.sin(2 * np.pi * 43 * t + 1.0)
    )
    assert kept == pytest.approx(np.sin(2 * np.pi * 3 * time), abs=3e-3)  # 43 Hz would be 7 Hz


def test_a_slow_clock_holds_the_middle_of_quick_commands():
    time, kept = slow_and_fast(lambda t: 0.1 * t, held=("motor",))
    assert kept == pytest.approx(0.1 * (time + 0.5 * (1 / 50 - 1 / 500)), abs=1e-9)
