"""The shortest flight that is fitted, and the refusal of shorter ones."""

from __future__ import annotations

from typing import Final

from rotorfit.errors import FlightError

LEAST_SECONDS: Final = 2.0
"""Shortest flight that is fitted [s]: six lines in the band in which a pilot moves the vehicle
(up to 3 Hz). Of half a second nothing but the weight could be fitted."""


def refuse_short_flight(name: str, seconds: float) -> None:
    """Raise where what was flown, or the window that is used of it, is too short to fit."""
    if seconds < LEAST_SECONDS:
        raise FlightError(
            f"{name}: {seconds:.1f} s of flight are too short to identify anything, which needs "
            f"{LEAST_SECONDS:.0f} s at least, and 20 s of quick rolls and nods (pitching forward "
            "and back) for good numbers: fly longer, or give a wider --start and --end"
        ).about(kind="flight-too-short")


def refuse_short_window(name: str, start: float | None, end: float | None) -> None:
    """Raise where a window is too short by itself; whether it is in order is asked elsewhere."""
    if end is not None and end > (start or 0.0):
        refuse_short_flight(name, end - max(start or 0.0, 0.0))
