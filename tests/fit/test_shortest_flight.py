"""Flights and windows too short to fit."""

import pytest

from rotorfit.errors import FlightError
from rotorfit.fit.shortest_flight import (
    LEAST_SECONDS,
    refuse_short_flight,
    refuse_short_window,
)


def refusal(check, *arguments) -> str | None:
    """Return the kind of refusal, or None."""
    try:
        check(*arguments)
    except FlightError as error:
        return error.finding.kind
    return None


@pytest.mark.parametrize("seconds", [0.0, 0.5, LEAST_SECONDS - 0.01])
def test_too_short(seconds):
    assert refusal(refuse_short_flight, "flight.csv", seconds) == "flight-too-short"


@pytest.mark.parametrize("seconds", [LEAST_SECONDS, 20.0])
def test_long_enough(seconds):
    assert refusal(refuse_short_flight, "flight.csv", seconds) is None


@pytest.mark.parametrize(("start", "end"), [(5.0, 5.5), (None, 1.0), (0.0, 1.9), (-3.0, 1.0)])
def test_a_window_that_is_too_short_by_itself(start, end):
    assert refusal(refuse_short_window, "flight.csv", start, end) == "flight-too-short"


@pytest.mark.parametrize(
    ("start", "end"), [(5.0, 7.0), (5.0, None), (None, None), (None, 2.0), (9.0, 7.0), (7.0, 7.0)]
)
def test_a_window_that_is_judged_later(start, end):
    """Open at its end, in the wrong order, or wide enough: the log has to be read first."""
    assert refusal(refuse_short_window, "flight.csv", start, end) is None
