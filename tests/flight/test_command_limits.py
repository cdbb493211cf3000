"""Commands at their ends are counted; commands that merely turn round there are not."""

import numpy as np
import pytest

from rotorfit.flight.motors.command_response import motor_limits
from rotorfit.logs.flight_log import Channel

RATE, SECONDS = 200.0, 20.0
TIME = np.arange(round(RATE * SECONDS)) / RATE
ALL = ((0.0, SECONDS),)


def channel(values):
    return Channel(time=TIME, values=values, source="made")


def swinging(amplitude, *, hertz=5.0):
    """Return commands about .5 of four motors, cut off at 0.1 and 0.9."""
    phases = 2.0 * np.pi * (hertz * TIME[:, None] + np.arange(4) / 4.0)
    return np.clip(0.5 + amplitude * np.sin(phases), 0.1, 0.9)


def test_commands_that_are_cut_off_are_at_their_ends():
    found = motor_limits(channel(swinging(0.8)), ALL)
    # Beyond half of its amplitude a sine is for a third of the time.
    assert found.lowest == pytest.approx([1.0 / 3.0] * 4, abs=0.03)
    assert found.highest == pytest.approx([1.0 / 3.0] * 4, abs=0.03)
    assert found.share == pytest.approx(2.0 / 3.0, abs=0.03)
    assert found.arrivals == pytest.approx(10.0, abs=0.2)


@pytest.mark.parametrize("digits", [2, 6])
def test_commands_that_turn_round_are_at_no_end(digits):
    values = np.round(swinging(0.3), digits)
    found = motor_limits(channel(values), ALL)
    assert (found.share, found.arrivals) == (0.0, 0.0)


def test_one_motor_at_one_end_is_distinguished_from_the_others():
    values = swinging(0.3)
    values[:400, 2] = 1.0
    found = motor_limits(channel(values), ALL)
    assert found.highest == pytest.approx([0.0, 0.0, 0.1, 0.0])
    assert found.lowest == (0.0,) * 4
    # Of the time in flight, not of the log.
    assert motor_limits(channel(values), ((2.0, 20.0),)).share == 0.0


def test_of_no_flight_and_of_still_commands_nothing_is_said():
    assert motor_limits(channel(swinging(0.3)), ()) is None
    assert motor_limits(channel(swinging(0.3)), ((30.0, 40.0),)) is None
    assert motor_limits(channel(np.full((len(TIME), 4), 0.5)), ALL).share == 0.0
