"""Blackbox files: recognise, list and read them."""

import hashlib
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rotorfit.errors import LogError
from rotorfit.findings import doubts
from rotorfit.logs.blackbox import LOG_START
from rotorfit.logs.blackbox.channels import FIELDS, read_channels, seconds
from rotorfit.logs.blackbox.decode import BlackboxLog, decode
from rotorfit.logs.blackbox.header import find_logs, read_header
from rotorfit.logs.files import read_bytes
from rotorfit.logs.flight_log import Circumstances, FlightLog
from rotorfit.logs.formats import LogEntry

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
_FILTER = re.compile(r"(gyro|dterm|rpm|dyn|acc|yaw).*(lpf|lowpass|notch|filter).*", re.IGNORECASE)


def list_blackbox_logs(path: Path) -> tuple[LogEntry, ...]:
    """Return the logs of a Blackbox file, of several the longest first."""
    return _entries(read_bytes(path))


def read_blackbox(path: Path, *, log_number: int | None = None) -> FlightLog:
    """Read one log of a Blackbox file."""
    data = read_bytes(path)
    if log_number is None and data.count(LOG_START) > 1:
        raise LogError(f"{path}: {_choice(_entries(data))}")
    try:
        log = decode(data, log_number=log_number, fields=FIELDS)
    except LogError as error:
        raise LogError(f"{path}: {error}") from error
    if len(log.main) == 0:
        raise LogError(
            f"{path}: log {log.log_number} has no readable main frame in "
            f"{log.header.stop - log.header.data_start} bytes after its header, expected one at "
            "least: record a longer flight, or copy the log from the recorder again"
        )
    channels, missing = read_channels(log)
    time = seconds(log)
    return FlightLog(
        path=path,
        sha256=hashlib.sha256(data).hexdigest(),
        format="blackbox",
        channels=channels,
        log_number=log.log_number,
        logs_in_file=log.logs_in_file,
        seconds=float(time.max() - time.min()),  # its clock may run backwards
        metadata=_metadata(log.header.entries),
        notes=(_frame_counts(log), *missing),
        findings=tuple(doubts("damaged-log", _damage(log))),
        circumstances=_circumstances(log.header.entries),
    )


def _entries(data: bytes) -> tuple[LogEntry, ...]:
    """List the logs in the bytes of a file, of several the longest first."""
    ranges = find_logs(data)
    if len(ranges) < 2:
        return tuple(_entry(data, i, bounds, None) for i, bounds in enumerate(ranges, start=1))
    lasting = {i: _about_seconds(data, *bounds) for i, bounds in enumerate(ranges, start=1)}
    longest_first = sorted(lasting, key=lambda i: -(lasting[i] or 0.0))
    return tuple(_entry(data, i, ranges[i - 1], lasting[i]) for i in longest_first)


def _entry(data: bytes, number: int, bounds: tuple[int, int], lasting: float | None) -> LogEntry:
    """Describe one log in the bytes of a file; lasting [s]."""
    description = _describe(data, *bounds)
    if lasting is not None:
        description = f"about {lasting:.0f} s, {description}"
    return LogEntry(number=number, start=bounds[0], stop=bounds[1], description=description)


def _about_seconds(data: bytes, start: int, stop: int) -> float | None:
    """Read the clock at both ends of a log [s]; None where no frame can be read."""
    try:
        begins = read_header(data, start, stop).data_start
    except LogError:
        return None
    first = _clock(data, start, begins, stop, at_end=False)
    last = _clock(data, start, begins, stop, at_end=True)
    if first is None or last is None:
        return None
    return (last - first) % (1 << 32) * 1e-6  # its 32 bits overflow


def _clock(data: bytes, start: int, begins: int, stop: int, *, at_end: bool) -> int | None:
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


def _describe(data: bytes, start: int, stop: int) -> str:
    """Return firmware, craft, date and size of a log; or why the header cannot be read."""
    size = f"{(stop - start) / 1000:.0f} kB"
    try:
        entries = _metadata(read_header(data, start, stop).entries)
    except LogError as error:
        return f"{size}, {error}"
    names = ("Firmware revision", "Craft name", "Log start datetime")
    return ", ".join([*(entries[name] for name in names if name in entries), size])


def _choice(entries: tuple[LogEntry, ...]) -> str:
    """Describe a file with several logs when none was chosen."""
    listed = "; ".join(f"{e.number}: {e.description}" for e in entries[:_LISTED])
    more = f"; and {len(entries) - _LISTED} more" if len(entries) > _LISTED else ""
    return (
        f"holds {len(entries)} logs ({listed}{more}), expected a choice of one: "
        f"pass a log number from 1 to {len(entries)} (--log, or log of a flight in an experiment)"
    )


def _metadata(entries: Mapping[str, str]) -> dict[str, str]:
    """Select the header lines that tell a person what was flown."""
    named = [name for name in _METADATA if name in entries]
    filters = [name for name in entries if name not in named and _FILTER.fullmatch(name)]
    metadata = {name: entries[name][:200] for name in [*named, *filters] if entries[name]}
    if metadata.get("Log start datetime", "").startswith("0000"):  # the clock was never set
        del metadata["Log start datetime"]
    return metadata


def _circumstances(entries: Mapping[str, str]) -> Circumstances:
    """Return the number of the processor, and when the log began."""
    hardware = entries.get("DeviceUID", "")
    try:
        began = datetime.fromisoformat(entries.get("Log start datetime", "").strip())
    except ValueError:  # none, or the year 0 of a clock that was never set
        return Circumstances(hardware=hardware)
    began = began if began.tzinfo else began.replace(tzinfo=UTC)
    return Circumstances(hardware=hardware, started=began.timestamp())


def _frame_counts(log: BlackboxLog) -> str:
    """Count the frames of each kind that were read."""
    intra = int(log.is_intra.sum())
    counts = {
        "I": intra,
        "P": len(log.main) - intra,
        "S": len(log.slow),
        "G": len(log.gps),
        "H": len(log.home),
        "E": len(log.events),
    }
    return "frames read: " + ", ".join(f"{count} {letter}" for letter, count in counts.items())


def _damage(log: BlackboxLog) -> list[str]:
    """Say what was damaged and passed over, one sentence each."""
    notes: list[str] = []
    if log.damaged_stretches:
        notes.append(
            f"{log.damaged_stretches} corrupt stretches: {log.skipped_bytes} bytes skipped"
        )
    if log.dropped_frames:
        notes.append(
            f"{log.dropped_frames} frames dropped: they follow a corrupt one or are not credible"
        )
    if log.header.damaged_bytes:
        notes.append(f"{log.header.damaged_bytes} bytes of the header skipped: no header lines")
    if not log.ended:
        notes.append(f"no end-of-log event: {log.trailing_bytes} bytes of an unfinished frame left")
    elif log.trailing_bytes:
        notes.append(f"{log.trailing_bytes} bytes after the end of the log ignored")
    return notes
