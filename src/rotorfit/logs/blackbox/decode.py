"""One log of a Blackbox file as arrays: every field of every frame."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Int, UInt8

from rotorfit.errors import LogError
from rotorfit.logs.blackbox.encodings import ByteIndex, index_bytes, read_frames
from rotorfit.logs.blackbox.events import LOGGING_RESUME, Event
from rotorfit.logs.blackbox.header import (
    MAX_BYTES,
    FrameDefinition,
    Header,
    find_logs,
    read_header,
)
from rotorfit.logs.blackbox.predict import (
    add_constants,
    gps_values,
    main_values,
    position_after_intra,
    wrap,
)
from rotorfit.logs.blackbox.scan import DAMAGE, Scan, scan_frames

MAX_TIME_JUMP: Final = 10_000_000
"""Longest credible time between consecutive main frames [us]."""
MAX_ITERATION_JUMP: Final = 5000 * 500
"""Most credible loop iterations between consecutive I frames."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """All frames of one kind.

    Attributes
    ----------
    names
        Of the fields.
    values
        One row per frame in the order of the file, one column per field; as recorded, no units.
    positions
        Of the first field of each frame [bytes from the first frame of the log].
    """

    names: tuple[str, ...]
    values: Int[np.ndarray, "n k"]
    positions: Int[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.values)

    def column(self, name: str) -> Int[np.ndarray, " n"]:
        """Return one field of all frames."""
        return self.values[:, self.names.index(name)]


@dataclass(frozen=True, slots=True, kw_only=True)
class BlackboxLog:
    """One decoded log.

    Attributes
    ----------
    header
        What the log declares.
    main
        I and P frames together.
    is_intra
        Which of the main frames are I frames.
    slow, gps, home
        S, G and H frames; without rows or columns where there are none.
    events
        E frames.
    damaged_stretches, skipped_bytes
        Where bytes had to be skipped to find the next frame, and how many in all.
    dropped_frames
        Whole frames left out: P frames after damage, and those with impossible times or numbers.
    trailing_bytes
        After the end-of-log event, or of the frame being written when recording stopped.
    ended
        Whether the log has an end-of-log event.
    log_number, logs_in_file
        Which log of the file this is (from 1), and how many there are.
    """

    header: Header
    main: Table
    is_intra: Bool[np.ndarray, " n"]
    slow: Table
    gps: Table
    home: Table
    events: tuple[Event, ...]
    damaged_stretches: int
    skipped_bytes: int
    dropped_frames: int
    trailing_bytes: int
    ended: bool
    log_number: int
    logs_in_file: int


def decode(data: bytes | memoryview, *, log_number: int | None = None) -> BlackboxLog:
    """Decode one log of a Blackbox file.

    Parameters
    ----------
    data
        The whole file.
    log_number
        Which log, from 1; may be left out if there is only one.

    Returns
    -------
    BlackboxLog
        Every field of every frame that can be read.

    Raises
    ------
    LogError
        If there is no such log, the choice is missing, or the header cannot be used.
    """
    data = bytes(data)
    if len(data) > MAX_BYTES:
        raise LogError(
            f"Blackbox file has {len(data)} bytes, expected {MAX_BYTES} at most: "
            "split it before the lines that begin with 'H Product'"
        )
    ranges = find_logs(data)
    number = _chosen(len(ranges), log_number)
    header = read_header(data, *ranges[number - 1])
    body = data[header.data_start : header.stop]
    index = index_bytes(body)
    scan = scan_frames(body, index, header)
    main, is_intra, dropped = _main_frames(scan, index, header)
    slow, bad_slow = _plain_frames("S", scan, index, header)
    home, bad_home = _plain_frames("H", scan, index, header)
    gps, bad_gps = _gps_frames(scan, index, header, main=main, home=home)
    return BlackboxLog(
        header=header,
        main=main,
        is_intra=is_intra,
        slow=slow,
        gps=gps,
        home=home,
        events=scan.events,
        damaged_stretches=int((scan.letters == DAMAGE).sum()),
        skipped_bytes=scan.skipped_bytes,
        dropped_frames=dropped + bad_slow + bad_home + bad_gps,
        trailing_bytes=scan.trailing_bytes,
        ended=scan.ended,
        log_number=number,
        logs_in_file=len(ranges),
    )


def _chosen(count: int, log_number: int | None) -> int:
    """Return the number of the log to decode."""
    if count == 0:
        raise LogError(
            "no Blackbox log in these bytes (no line 'H Product:Blackbox flight data recorder by "
            "Nicholas Sherlock'), expected one at least: pass the file the recorder wrote"
        )
    if log_number is None and count > 1:
        raise LogError(f"Blackbox file holds {count} logs, expected a choice: pass the log number")
    number = 1 if log_number is None else log_number
    if not 1 <= number <= count:
        raise LogError(
            f"Blackbox file has no log {number}, expected a log number from 1 to {count}: "
            "pass one of these"
        )
    return number


def _main_frames(
    scan: Scan, index: ByteIndex, header: Header
) -> tuple[Table, Bool[np.ndarray, " n"], int]:
    """Return I and P frames with their values, which are I frames, and how many were left out."""
    letters, starts = scan.letters, scan.starts
    relevant = np.isin(letters, np.frombuffer(b"IP?", np.uint8))
    letters, starts = letters[relevant], starts[relevant]
    read = len(letters) - int((letters == DAMAGE).sum())
    usable = _has_history(letters, header.i_interval)
    letters, starts = letters[usable], starts[usable]
    is_intra = letters == ord("I")
    intra = header.frames["I"]
    inter = header.frames.get("P", intra)
    written = np.empty((len(starts), len(intra.names)), np.int64)
    bad = np.zeros(len(starts), bool)
    for rows, definition in ((is_intra, intra), (~is_intra, inter)):
        written[rows], bad[rows] = read_frames(index, starts[rows], definition, header.data_version)
    values = main_values(written, is_intra, header)
    table = Table(names=intra.names, values=values, positions=starts)
    keep = _credible(table, is_intra, bad, scan.events)
    table = Table(names=intra.names, values=values[keep], positions=starts[keep])
    return table, is_intra[keep], read - len(table)


def _has_history(letters: UInt8[np.ndarray, " n"], i_interval: int) -> Bool[np.ndarray, " n"]:
    """Return which main frames are I frames, or P frames in unbroken succession to one."""
    is_intra = letters == ord("I")
    after_intra = position_after_intra(is_intra)
    after_damage = position_after_intra(letters == DAMAGE)
    follows = (after_damage < 0) | (after_intra < after_damage)
    return (after_intra >= 0) & (after_intra < i_interval) & follows & (letters != DAMAGE)


def _credible(
    table: Table,
    is_intra: Bool[np.ndarray, " n"],
    bad: Bool[np.ndarray, " n"],
    events: tuple[Event, ...],
) -> Bool[np.ndarray, " n"]:
    """Return which main frames have credible times; what follows a doubtful one is dropped."""
    if len(table) == 0:
        return np.zeros(0, bool)
    time = table.column("time")
    step = np.diff(time, prepend=time[:1]) % (1 << 32)  # the clock overflows after 71 minutes
    bad = bad | (~is_intra & (step > MAX_TIME_JUMP))
    rows = np.flatnonzero(is_intra)
    stretch = np.cumsum(is_intra) - 1
    intra_bad = bad[rows] | ~_intra_in_line(table, rows, events)
    doubts = np.cumsum(bad)
    before = doubts[rows] - bad[rows]
    return (doubts == before[stretch]) & ~intra_bad[stretch]


def _intra_in_line(
    table: Table, rows: Int[np.ndarray, " m"], events: tuple[Event, ...]
) -> Bool[np.ndarray, " m"]:
    """Return which I frames continue the accepted ones before them.

    One that does not is accepted all the same if logging was resumed in between, or if it agrees
    with the I frame after it although that does not continue the accepted ones either.
    """
    time = table.column("time")[rows].tolist()
    iteration = table.column("loopIteration")[rows].tolist()
    resumed = [e.position for e in events if e.kind == LOGGING_RESUME]
    positions = table.positions[rows]
    resumes = np.searchsorted(np.array(resumed, np.int64), positions).tolist()

    def continues(a: int, b: int) -> bool:
        in_time = (time[b] - time[a]) % (1 << 32) <= MAX_TIME_JUMP
        return in_time and 0 < (iteration[b] - iteration[a]) % (1 << 32) <= MAX_ITERATION_JUMP

    accepted, last = np.zeros(len(rows), bool), -1
    for i in range(len(rows)):
        fits = last < 0 or continues(last, i) or resumes[i] > resumes[last]
        if fits or (i + 1 < len(rows) and continues(i, i + 1) and not continues(last, i + 1)):
            accepted[i], last = True, i
    return accepted


def _plain_frames(letter: str, scan: Scan, index: ByteIndex, header: Header) -> tuple[Table, int]:
    """Return the S or H frames, and how many were left out."""
    if letter not in header.frames:
        return _empty_table(), 0
    definition = header.frames[letter]
    written, starts, dropped = _read(letter, scan, index, header)
    values = wrap(add_constants(written, definition, header), definition.signed)
    return Table(names=definition.names, values=values, positions=starts), dropped


def _gps_frames(
    scan: Scan, index: ByteIndex, header: Header, *, main: Table, home: Table
) -> tuple[Table, int]:
    """Return the G frames, and how many were left out."""
    if "G" not in header.frames:
        return _empty_table(), 0
    definition: FrameDefinition = header.frames["G"]
    written, starts, dropped = _read("G", scan, index, header)
    values = gps_values(
        written,
        header,
        home=_latest(home, ("GPS_home[0]", "GPS_home[1]"), starts),
        main_time=_latest(main, ("time",), starts)[:, 0],
    )
    return Table(names=definition.names, values=values, positions=starts), dropped


def _read(
    letter: str, scan: Scan, index: ByteIndex, header: Header
) -> tuple[Int[np.ndarray, "n k"], Int[np.ndarray, " n"], int]:
    """Return the fields as written of all frames of one kind, their positions, and the dropped."""
    starts = scan.starts[scan.letters == ord(letter)]
    written, bad = read_frames(index, starts, header.frames[letter], header.data_version)
    return written[~bad], starts[~bad], int(bad.sum())


def _latest(
    table: Table, names: tuple[str, ...], positions: Int[np.ndarray, " n"]
) -> Int[np.ndarray, "n k"]:
    """Return fields of the last frame before each position; zero where there is none."""
    if len(table) == 0 or not set(names) <= set(table.names):
        return np.zeros((len(positions), len(names)), np.int64)
    row = np.searchsorted(table.positions, positions) - 1
    columns = np.stack([table.column(name) for name in names], axis=1)
    return np.where(row[:, None] >= 0, columns[np.maximum(row, 0)], 0)


def _empty_table() -> Table:
    return Table(names=(), values=np.zeros((0, 0), np.int64), positions=np.zeros(0, np.int64))
