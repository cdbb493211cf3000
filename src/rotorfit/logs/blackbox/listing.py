"""The logs in a Blackbox file: how long each lasts, and what its header says of the flight."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from rotorfit.errors import LogError
from rotorfit.logs.blackbox.decode import decode
from rotorfit.logs.blackbox.header import find_logs, read_header
from rotorfit.logs.files import read_bytes
from rotorfit.logs.formats import LogEntry

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_LISTED: Final = 8
"""Most logs that an error message lists."""
_PIECE: Final = 1 << 14
"""Bytes that are first searched for a frame at either end of a log: some I intervals."""

# Header lines for people, by name or by what filter they set.
_METADATA: Final = (
    "Firmware revision",
    "Firmware date",
    "Board information",
    "Craft name",
    "Log start datetime",
    "Data version",
    "looptime",
    "gyro_sync_denom",
    "pid_process_denom",
    "I interval",
    "P interval",
    "motor_poles",
    "motor_kv",
    "motorOutput",
    "motor_pwm_protocol",
    "dshot_bidir",
    "acc_1G",
    "gyro_scale",
    "blackbox_high_resolution",
    "debug_mode",
    "rpm_gyro_harmonics",
    "rpm_gyro_min_hz",
)
STUB_SECONDS: Final = 1.0
"""Logs that are shorter show no flight, and are not listed among longer ones [s]."""
_FILTER = re.compile(r"(gyro|dterm|rpm|dyn|acc|yaw).*(lpf|lowpass|notch|filter).*", re.IGNORECASE)


def list_blackbox_logs(path: Path) -> tuple[LogEntry, ...]:
    """Return the logs of a Blackbox file, of several the longest first."""
    return entries_of(read_bytes(path))


def entries_of(data: bytes) -> tuple[LogEntry, ...]:
    """List the logs in the bytes of a file, of several the longest first."""
    ranges = find_logs(data)
    if len(ranges) < 2:
        return tuple(
            _describe_entry(data, i, bounds, None) for i, bounds in enumerate(ranges, start=1)
        )
    lasting = {i: _about_seconds(data, *bounds) for i, bounds in enumerate(ranges, start=1)}
    longest_first = sorted(lasting, key=lambda i: -(lasting[i] or 0.0))
    # Arming on the ground leaves stubs; they are listed only where there is nothing else.
    flights = [i for i in longest_first if (lasting[i] or 0.0) >= STUB_SECONDS]
    longest_first = flights or longest_first
    return tuple(_describe_entry(data, i, ranges[i - 1], lasting[i]) for i in longest_first)


def _describe_entry(
    data: bytes, number: int, bounds: tuple[int, int], lasting: float | None
) -> LogEntry:
    """Describe one log in the bytes of a file; lasting [s]."""
    description = _describe_log(data, *bounds)
    if lasting is not None:
        description = f"about {lasting:.0f} s, {description}"
    return LogEntry(number=number, start=bounds[0], stop=bounds[1], description=description)


def _about_seconds(data: bytes, start: int, stop: int) -> float | None:
    """Read the clock at both ends of a log [s]; None if no frame can be read."""
    try:
        begins = read_header(data, start, stop).data_start
    except LogError:
        return None
    first = _read_clock(data, start, begins, stop, at_end=False)
    last = _read_clock(data, start, begins, stop, at_end=True)
    if first is None or last is None:
        return None
    return (last - first) % (1 << 32) * 1e-6  # its 32 bits overflow


def _read_clock(data: bytes, start: int, begins: int, stop: int, *, at_end: bool) -> int | None:
    """Read the first or last time [us] of a log from as few of its bytes as have a frame."""
    size = _PIECE
    while True:
        piece = slice(max(begins, stop - size), stop) if at_end else slice(begins, begins + size)
        try:
            frames = decode(data[start:begins] + data[piece][: stop - begins], fields=()).main
        except LogError:
            return None
        if len(frames):
            return int(frames.column("time")[-1 if at_end else 0])
        if size >= stop - begins:
            return None
        size *= 16  # a recorder's memory may end in megabytes without a frame


def _describe_log(data: bytes, start: int, stop: int) -> str:
    """Return firmware, craft, date and size of a log; or why the header cannot be read."""
    size = f"{(stop - start) / 1000:.0f} kB"
    try:
        entries = metadata_of(read_header(data, start, stop).entries)
    except LogError as error:
        return f"{size}, {error}"
    names = ("Firmware revision", "Craft name", "Log start datetime")
    return ", ".join([*(entries[name] for name in names if name in entries), size])


def choice_words(entries: tuple[LogEntry, ...]) -> str:
    """Describe a file with several logs when none was chosen."""
    listed = "; ".join(f"{e.number}: {e.description}" for e in entries[:_LISTED])
    more = f"; and {len(entries) - _LISTED} more" if len(entries) > _LISTED else ""
    return (
        f"holds {len(entries)} logs ({listed}{more}), expected a choice of one: "
        "pass the number of one (--log, or log of a flight in an experiment)"
    )


def metadata_of(entries: Mapping[str, str]) -> dict[str, str]:
    """Select the header lines that describe the flight to a person."""
    named = [name for name in _METADATA if name in entries]
    filters = [name for name in entries if name not in named and _FILTER.fullmatch(name)]
    metadata = {name: entries[name][:200] for name in [*named, *filters] if entries[name]}
    if metadata.get("Log start datetime", "").startswith("0000"):  # the clock was never set
        del metadata["Log start datetime"]
    return metadata
