"""Speeds after commands: an independent solver's, and their slopes by differences."""

from types import SimpleNamespace

import numpy as np
import pytest
from motor_responses import motor_responses
from scipy.integrate import solve_ivp

from rotorfit.fit.motor_law.command_response import (
    Timing,
    recording_of,
    speed_response,
    speeds_at_delays,
)
from rotorfit.fit.motor_law.fit_law import fit_law
from rotorfit.fit.motor_law.law_model import Layout, predicted
from rotorfit.flight.motors.command_response import MeasuredResponse, command_responses
from rotorfit.logs.flight_log import Channel

NONE = np.zeros((0, 40))


def one_answer(seed):
    """Irregular commands, and speeds at instants of their own."""
    rng = np.random.default_rng(seed)
    command_time = np.sort(rng.uniform(0.0, 1.0, 40))
    command_time[0] = 0.0
    speed_time = np.sort(rng.uniform(0.55, 0.95, 25))
    return MeasuredResponse(
        rotor=0,
        command_time=command_time,
        command=rng.uniform(0.1, 0.9, 40),
        voltage=None,
        speed_time=speed_time,
        speed=np.ones(25),
    )


def test_speeds_at_many_delays_are_those_at_each():
    answer = one_answer(5)
    settled, recording = 1000.0 * answer.command, recording_of([[answer]])
    delays = (-0.02, 0.0, 0.013, 0.1)
    for lag in (0.008, 0.05):
        many = speeds_at_delays(recording, settled, lag, delays)
        for delay, speed in zip(delays, many, strict=True):
            timing = Timing(log_lag=np.log(lag), log_ratio=0.0, delay=delay)
            expected, _ = speed_response(recording, settled, NONE, timing)
            np.testing.assert_allclose(speed, expected, rtol=1e-12)


@pytest.mark.parametrize(("up", "down", "delay"), [(0.05, 0.05, 0.0), (0.05, 0.02, 0.013)])
def test_speeds_are_those_of_an_ode_solver(up, down, delay):
    answer = one_answer(3)
    settled = 1000.0 * answer.command
    timing = Timing(log_lag=np.log(up), log_ratio=np.log(down / up), delay=delay)
    speed, _ = speed_response(recording_of([[answer]]), settled, NONE, timing)

    expected, now = [], settled[0]
    edges = [*answer.command_time, 1.1]
    for begin, end, goal in zip(edges[:-1], edges[1:], settled, strict=True):
        lag = up if goal > now else down
        found = solve_ivp(
            lambda _, x, goal=goal, lag=lag: (goal - x) / lag,
            (begin, end),
            [now],
            dense_output=True,
            rtol=1e-10,
            atol=1e-8,
        )
        inside = (answer.speed_time - delay >= begin) & (answer.speed_time - delay < end)
        if inside.any():
            expected += found.sol(answer.speed_time[inside] - delay)[0].tolist()
        now = found.y[0, -1]
    assert speed == pytest.approx(np.array(expected), rel=1e-6)


@pytest.mark.parametrize("form", ["linear", "power", "sqrt", "offset power"])
@pytest.mark.parametrize("voltage", [False, True])
def test_slopes_are_those_of_differences(form, voltage):
    flights = [
        motor_responses(1, seconds=4.0, rate=100.0),
        motor_responses(2, seconds=3.0, rate=100.0),
    ]
    recording = recording_of(flights)
    layout = Layout(form=form, voltage=voltage, two_way=True, rotors=4, flights=2)
    rng = np.random.default_rng(0)
    x = 0.01 * rng.normal(size=layout.size)
    x[0] = np.log(4000.0)
    x[layout.curve] = {"linear": 0.1, "power": 0.7, "sqrt": 0.4}.get(form, (0.06, 0.8))
    x[-3:] = np.log(0.03), -0.2, 0.0041
    _, slopes = predicted(recording, layout, x)
    for i in range(layout.size):
        step = 1e-6 * np.eye(layout.size)[i]
        up, down = (predicted(recording, layout, x + s)[0] for s in (step, -step))
        # A measurement at the instant of a command has no slope by the delay there.
        wrong = np.abs((up - down) / 2e-6 - slopes[i]) > 1e-3 * np.abs(slopes[i]).max()
        assert wrong.mean() < 0.002, i


def test_a_stretch_knows_nothing_of_the_one_before():
    alone = recording_of([[one_answer(4)]])
    both = recording_of([[one_answer(3), one_answer(4)]])
    timing = Timing(log_lag=np.log(0.05), log_ratio=0.0, delay=0.0)
    speed, _ = speed_response(alone, 1000.0 * alone.command, NONE, timing)
    joined, _ = speed_response(both, 1000.0 * both.command, np.zeros((0, 80)), timing)
    # The second stretch is 1e4 s later on the clock of both: its times are rounded to 1e-12 s.
    assert joined[-len(speed) :] == pytest.approx(speed, rel=1e-9)


def _follower(speeds_of):
    """Return the log of one motor of 30 ms lag in a hover, 500 Hz: commands, and what is read."""
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 16.0, 0.002)
    command = 0.3 + 0.025 * np.convolve(
        rng.normal(size=len(time) + 399), np.ones(400) / 20.0, "valid"
    )
    speed, now = np.empty(len(time)), 1000.0 * command[0]
    for k, wanted in enumerate(1000.0 * command):
        speed[k], now = now, wanted + np.exp(-0.002 / 0.03) * (now - wanted)
    channels = {
        "command": Channel(time=time, values=command[:, None], source=""),
        "rotor_speed": Channel(time=time, values=speeds_of(speed)[:, None], source=""),
    }
    return SimpleNamespace(channels=channels)


@pytest.mark.parametrize(
    ("speeds_of", "share"),
    [
        (np.round, 1.0),  # coarse: every reading counts
        (lambda speed: np.repeat(speed[::10], 10), 0.1),  # slow: the new ones
    ],
)
def test_coarse_speeds_are_no_slow_telemetry(speeds_of, share):
    log = _follower(speeds_of)
    (answer,) = command_responses(log)
    changed = np.diff(log.channels["rotor_speed"].values[:, 0]) != 0.0
    assert changed.mean() < 0.3
    assert len(answer.speed) == pytest.approx(share * 8000, rel=0.01)
    found = fit_law(recording_of([[answer]])).best.timing
    assert np.exp(found.log_lag) == pytest.approx(0.03, rel=0.02)


def test_noisy_commands_do_not_trap_the_lag_near_its_value():
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 12.0, 0.001)
    slow = np.convolve(rng.normal(size=len(time) + 999), np.ones(1000) / 1000.0**0.5, "valid")
    command = 0.3 + 0.01 * slow + 0.02 * rng.normal(size=len(time))
    speed, now = np.empty(len(time)), 300.0
    for k, wanted in enumerate(1000.0 * command):
        speed[k], now = now, wanted + np.exp(-0.001 / 0.0586) * (now - wanted)
    answer = MeasuredResponse(
        rotor=0,
        command_time=time,
        command=command,
        voltage=None,
        speed_time=time,
        speed=speed + 0.5 * rng.normal(size=len(time)),
    )
    found = fit_law(recording_of([[answer]])).best.timing
    assert np.exp(found.log_lag) == pytest.approx(0.0586, rel=0.02)
    assert found.delay == pytest.approx(0.0, abs=5e-4)
