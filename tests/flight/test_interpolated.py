"""Lines that a recorder draws between slow samples are told from motion, rounded or not."""

import numpy as np
import pytest
from scipy import signal

from rotorfit.errors import FlightError
from rotorfit.flight.flight_checks import (
    refuse_interpolated_commands,
    refuse_interpolated_speeds,
)
from rotorfit.flight.interpolated import likeliest_source, slowest_source_rate, source_rate

RATE = 250.0
TIME = np.arange(round(30.0 * RATE)) / RATE


def speeds(seed, *, noise=3.0):
    """Return four rotors about 800 rad/s, moved up to 12 Hz."""
    rng = np.random.default_rng(seed)
    sos = signal.butter(2, 12.0, fs=RATE, output="sos")
    moves = signal.sosfiltfilt(sos, rng.standard_normal((len(TIME), 4)), axis=0)
    return 800.0 + 200.0 * moves + noise * rng.standard_normal(moves.shape)


def drawn(values, rate, *, phase=0.013):
    """Return values from which a recorder has samples at a rate [Hz], and draws lines between."""
    slow = np.arange(phase, TIME[-1], 1.0 / rate)
    return np.column_stack([np.interp(TIME, slow, np.interp(slow, TIME, x)) for x in values.T])


@pytest.mark.parametrize("step", [0.0, 1.0, 5.0])
@pytest.mark.parametrize("rate", [10.0, 16.3])
def test_the_source_of_drawn_lines_has_its_rate(rate, step):
    values = drawn(speeds(1), rate)
    values = np.round(values / step) * step if step else values
    assert source_rate(values, RATE) == pytest.approx(rate, abs=0.2)
    with pytest.raises(FlightError, match=f"the rotor speeds come at {rate:.0f} Hz"):
        refuse_interpolated_speeds(values, RATE)


def test_repeated_values_are_noted_alike():
    slow = np.arange(0.0, TIME[-1] + 0.1, 0.1)
    repeated = np.column_stack(
        [np.interp(slow, TIME, x)[np.searchsorted(slow, TIME, "right") - 1] for x in speeds(2).T]
    )
    assert source_rate(repeated, RATE) == pytest.approx(10.0, abs=0.2)


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_motion_has_no_source(noise):
    assert all(source_rate(speeds(seed, noise=noise), RATE) is None for seed in range(60))
    rhythm = 5.0 * np.sin(2.0 * np.pi * 11.0 * TIME)[:, None]
    assert source_rate(speeds(0) + rhythm, RATE) is None
    refuse_interpolated_speeds(drawn(speeds(3), 50.0), RATE)  # fast enough
    assert source_rate(speeds(0)[:20], RATE) is None


@pytest.mark.parametrize("rate", [10.0, 20.0])
def test_rotors_that_are_asked_in_turn_are_refused(rate):
    values = speeds(7)
    in_turn = np.hstack(
        [drawn(values[:, [k]], rate, phase=0.013 + k / (4.0 * rate)) for k in range(4)]
    )
    one_slow = np.column_stack([values[:, :3], in_turn[:, 3]])
    for slow in (in_turn, one_slow):
        assert slowest_source_rate(slow, RATE) == pytest.approx(rate, abs=0.2)
        with pytest.raises(FlightError, match=f"the rotor speeds come at {rate:.0f} Hz"):
            refuse_interpolated_speeds(slow, RATE)


def test_the_motion_of_no_rotor_has_a_source():
    assert all(slowest_source_rate(speeds(seed), RATE) is None for seed in range(40))


@pytest.mark.parametrize("rate", [6.0, 9.5])
def test_motors_that_swing_between_their_limits_have_no_source(rate):
    """A limit cycle bends at both of its ends, at twice its own rate."""
    swing = np.clip(1.6 * np.sin(2.0 * np.pi * rate * TIME), -1.0, 1.0)
    b, a = signal.butter(1, 8.0, fs=RATE)
    wide = 150.0 * signal.lfilter(b, a, np.column_stack([swing, -swing, swing, -swing]), axis=0)
    values = speeds(4) + wide
    assert source_rate(values, RATE) is None
    assert source_rate(drawn(values, 16.3), RATE) is not None


def test_rounding_of_a_calm_flight_hides_no_source():
    """Speeds that move by 20 rad/s, in steps of 2: one bend of 8 ms is within a step."""
    values = 400.0 + 0.1 * (speeds(6, noise=0.0) - 800.0)
    found = likeliest_source(np.round(drawn(values, 10.0) / 2.0) * 2.0, RATE)
    assert found is not None
    assert found.rate == pytest.approx(10.0, abs=0.2)
    assert found.chance < -50.0
    assert found.share > 0.2
    assert source_rate(np.round(values / 2.0) * 2.0, RATE) is None


def test_a_rhythm_of_the_autopilot_is_no_source():
    """Steps of ten times a second in commands, small beside what else moves them."""
    steps = np.floor(10.0 * TIME) % 2.0
    values = speeds(7) / 1600.0 + 0.006 * steps[:, None]
    found = likeliest_source(values, RATE)
    assert found is None or not found.clear


def test_commands_that_come_slowly_are_refused():
    command = drawn(speeds(8), 10.0) / 1600.0
    with pytest.raises(FlightError, match="the motors' commands come at 10 Hz"):
        refuse_interpolated_commands(command, RATE, RATE)
    refuse_interpolated_commands(command, RATE, 10.0)  # as the log has them
    refuse_interpolated_commands(speeds(8) / 1600.0, RATE, RATE)
    held = np.repeat(np.random.default_rng(9).uniform(0.3, 0.9, (300, 4)), 25, axis=0)
    refuse_interpolated_commands(held, RATE, RATE)  # so the motors were told


def test_a_speed_that_is_halved_in_stretches_did_not_come_slowly():
    """Half of rotor 3 in every fourth stretch of 100 ms has a rhythm of 10 Hz."""
    values = speeds(8)
    low = np.random.default_rng(1).random(round(10.0 * TIME[-1]) + 1) < 0.25
    values[low[(10.0 * TIME).astype(int)], 2] *= 0.5
    assert slowest_source_rate(values, RATE) == pytest.approx(10.0, abs=0.2)
    with pytest.raises(FlightError, match=r"rotor 3 jumps to half .* low for 2\d %"):
        refuse_interpolated_speeds(values, RATE)
