"""Logs of Hover, a made-up autopilot: a magic line, a line of settings, then rows of numbers.

A row is time [s], gyro [rad/s], accelerometer [m/s^2] and four commands (0 to 1), FLU, as doubles.
"""

from collections.abc import Mapping, Set
from pathlib import Path
from typing import Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.logs.files import read_bytes, sha256_of
from rotorfit.logs.firmware import (
    NO_BATTERY,
    SLOW_IMU,
    Advice,
    Filter,
    Lack,
    asked_for,
    low_pass,
    settings_of,
)
from rotorfit.logs.flight_log import Channel, FlightLog

MAGIC: Final = b"HOVER1\n"
COLUMNS: Final = {"gyro": slice(1, 4), "accel": slice(4, 7), "command": slice(7, 11)}
SETTINGS: Final = settings_of(
    ("log_rate", "500", "the IMU at the loop's rate", SLOW_IMU),
    ("log_battery", "1", "logs the battery", NO_BATTERY),
)


def is_hoverlog(head: bytes) -> bool:
    """Tell a log of Hover by its first bytes."""
    return head.startswith(MAGIC)


def read_hoverlog(path: Path) -> FlightLog:
    """Read a log of Hover."""
    settings, _, rows = read_bytes(path).removeprefix(MAGIC).partition(b"\n")
    if not rows or len(rows) % 88:
        raise LogError(f"{path}: {len(rows)} bytes of rows, expected whole rows of 88: copy again")
    values = np.frombuffer(rows, "<f8").reshape(-1, 11)
    if not np.isfinite(values).all() or (np.diff(values[:, 0]) <= 0.0).any():
        raise LogError(f"{path}: times do not rise, or numbers are none: copy it again")
    pairs = (word.partition("=") for word in settings.decode("latin-1").split())
    return FlightLog(
        path=path,
        sha256=sha256_of(path),
        format="hoverlog",
        channels={
            name: Channel(time=values[:, 0], values=values[:, columns], source=f"row, {name}")
            for name, columns in COLUMNS.items()
        },
        seconds=float(values[-1, 0] - values[0, 0]),
        metadata={name: value for name, _, value in pairs},
    )


def advice(lacks: Set[Lack], metadata: Mapping[str, str]) -> Advice:
    """Advise settings of Hover, those apart that the log has already."""
    kept = (s for s in asked_for(SETTINGS, lacks) if metadata.get(s.name) != s.value)
    return Advice(settings=tuple(kept), file="hover.txt")


def filters(log: FlightLog) -> list[Filter]:
    """Find the low-pass of Hover's gyro, which logged samples went through."""
    return low_pass(log.metadata, "gyro", "gyro_cutoff", passed=True)
