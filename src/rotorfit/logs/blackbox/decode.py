"""One log of a Blackbox file as arrays: every field of every frame."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.blackbox.encodings import (
    add_constants,
    gps_values,
    main_values,
    position_after_intra,
    read_frames,
    wrap,
)
from rotorfit.logs.blackbox.header import MAX_BYTES, FrameDefinition, Header, find_logs, read_header
from rotorfit.logs.blackbox.scan import (
    DAMAGE,
    LOGGING_RESUME,
    MAX_EVENTS,
    Event,
    Window,
    scan_frames,
)
from rotorfit.logs.files import report_progress

if TYPE_CHECKING:
    from collections.abc import Collection

    from jaxtyping import Bool, Int, UInt32

MAX_TIME_JUMP: Final = 10_000_000
"""Longest credible time between consecutive main frames [us]."""
MAX_ITERATION_JUMP: Final = 5000 * 500
"""Most credible loop iterations between consecutive I frames."""


@frozen_dataclass
class Table:
    """All frames of one kind, as 32-bit integers.

    One row per frame in the order of the file; `positions` are of the first field of each frame
    [bytes from the first frame of the log].
    """

    names: tuple[str, ...]
    signed: tuple[bool, ...]
    bits: UInt32[np.ndarray, "n k"]
    positions: Int[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.bits)

    @property
    def values(self) -> Int[np.ndarray, "n k"]:
        """All fields of all frames; as recorded, no units."""
        return wrap(self.bits.astype(np.int64), self.signed)

    def column(self, name: str) -> Int[np.ndarray, " n"]:
        """Read one field of all frames."""
        i = self.names.index(name)
        return self.bits[:, i].astype(np.int32 if self.signed[i] else np.uint32).astype(np.int64)


@frozen_dataclass
class BlackboxLog:
    """One decoded log.

    - `header`: what the log declares.
    - `main`: I and P frames together.
    - `is_intra`: which of the main frames are I frames.
    - `slow`, `gps`, `home`: S, G and H frames; without rows or columns where there are none.
    - `events`: E frames.
    - `damaged_stretches`, `skipped_bytes`: where bytes had to be skipped to find the next frame,
      and how many in all.
    - `dropped_frames`: whole frames left out: P frames after damage, impossible times or numbers.
    - `trailing_bytes`: after the end-of-log event, or of a frame that was not finished.
    - `ended`: whether the log has an end-of-log event.
    - `log_number`, `logs_in_file`: which log of the file this is (from 1), and how many there are.
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


@frozen_dataclass
class _Written:
    """Frames of one kind (I and P are one) before prediction.

    `damages` counts the damaged stretches before each frame; `positions` are as in `Table`.
    """

    is_intra: Bool[np.ndarray, " n"]
    damages: Int[np.ndarray, " n"]
    positions: Int[np.ndarray, " n"]
    bits: UInt32[np.ndarray, "n k"]
    bad: Bool[np.ndarray, " n"]


def decode(
    data: bytes, *, log_number: int | None = None, fields: Collection[str] | None = None
) -> BlackboxLog:
    """Decode one log of a Blackbox file."""
    if len(data) > MAX_BYTES:
        raise LogError(
            f"Blackbox file has {len(data)} bytes, expected {MAX_BYTES} at most: "
            "split it before the lines that begin with 'H Product'"
        )
    ranges = find_logs(data)
    number = _choose_log(len(ranges), log_number)
    whole = read_header(data, *ranges[number - 1])
    header = replace(whole, frames=_keep_fields(whole, fields))
    written, events, damages, last = _read_frames(data, whole, header)
    main, is_intra, dropped = _main_frames(written["IP"], events, header)
    slow, bad_slow = _plain_frames("S", written, header)
    home, bad_home = _plain_frames("H", written, header)
    gps, bad_gps = _gps_frames(written, header, main=main, home=home)
    return BlackboxLog(
        header=whole,
        main=main,
        is_intra=is_intra,
        slow=slow,
        gps=gps,
        home=home,
        events=events,
        damaged_stretches=damages[0],
        skipped_bytes=damages[1],
        dropped_frames=dropped + bad_slow + bad_home + bad_gps,
        trailing_bytes=whole.stop - whole.data_start - (last.stop if last else 0),
        ended=last is not None and last.ended,
        log_number=number,
        logs_in_file=len(ranges),
    )


def _choose_log(count: int, log_number: int | None) -> int:
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


def _keep_fields(header: Header, fields: Collection[str] | None) -> dict[str, FrameDefinition]:
    """Reduce the definitions of all frames to the fields that are kept."""
    if fields is None:
        return dict(header.frames)
    # What P frames and the other motors refer to belongs to the fields.
    wanted = {*fields, "loopIteration", "time", "motor[0]"}
    return {
        letter: definition.only(wanted if letter in "IP" else ())
        for letter, definition in header.frames.items()
    }


def _read_frames(
    data: bytes, whole: Header, kept: Header
) -> tuple[dict[str, _Written], tuple[Event, ...], tuple[int, int], Window | None]:
    """Read all frames by their letters, the events, the damage, and the last window.

    The damage is the number of its stretches and of the bytes skipped.
    """
    kinds = ["IP", *(letter for letter in "SGH" if letter in whole.frames)]
    parts: dict[str, list[_Written]] = {letters: [] for letters in kinds}
    events: list[Event] = []
    stretches = skipped = 0
    window = None
    for window in scan_frames(data, whole):
        for letters in kinds:
            parts[letters].append(_read_window(letters, window, whole, kept, stretches))
        events.extend(window.events)
        report_progress(window.stop, whole.stop - whole.data_start)
        stretches += int((window.letters == DAMAGE).sum())
        skipped += window.skipped_bytes
        if len(events) > MAX_EVENTS:
            raise LogError(
                f"Blackbox log has more than {MAX_EVENTS} events, expected some dozens: "
                "it is damaged, copy it from the recorder again"
            )
    written = {letters: _join_parts(parts.pop(letters), letters, kept) for letters in kinds}
    return written, tuple(events), (stretches, skipped), window


def _read_window(
    letters: str, window: Window, whole: Header, kept: Header, damages_before: int
) -> _Written:
    """Read the frames of one kind in one part of the log."""
    chosen = np.isin(window.letters, np.frombuffer(letters.encode(), np.uint8))
    kind, starts = window.letters[chosen], window.starts[chosen]
    bits = np.zeros((len(starts), len(kept.frames[letters[0]].names)), np.uint32)
    bad = np.zeros(len(starts), bool)
    for letter in letters:
        rows = kind == ord(letter)
        if rows.any():
            definition = whole.frames[letter]
            values, bad[rows] = read_frames(
                window.index, starts[rows], definition, whole.data_version
            )
            names = kept.frames[letter].names
            columns = [i for i, name in enumerate(definition.names) if name in set(names)]
            bits[rows] = values[:, columns].astype(np.uint32)
    damages = damages_before + np.cumsum(window.letters == DAMAGE)[chosen]
    return _Written(
        is_intra=kind == ord("I"),
        damages=damages.astype(np.int32),
        positions=(window.origin + starts).astype(np.int32),
        bits=bits,
        bad=bad,
    )


def _join_parts(parts: list[_Written], letters: str, kept: Header) -> _Written:
    if not parts:
        none, width = np.zeros(0, np.int32), len(kept.frames[letters[0]].names)
        no = np.zeros(0, bool)
        bits = np.zeros((0, width), np.uint32)
        return _Written(is_intra=no, damages=none, positions=none, bits=bits, bad=no)
    return _Written(
        is_intra=np.concatenate([part.is_intra for part in parts]),
        damages=np.concatenate([part.damages for part in parts]),
        positions=np.concatenate([part.positions for part in parts]),
        bits=np.concatenate([part.bits for part in parts]),
        bad=np.concatenate([part.bad for part in parts]),
    )


def _main_frames(
    written: _Written, events: tuple[Event, ...], header: Header
) -> tuple[Table, Bool[np.ndarray, " n"], int]:
    """Return I and P frames with their values, which are I frames, and how many were left out."""
    usable = _has_history(written.is_intra, written.damages, header.i_interval)
    is_intra, positions = written.is_intra[usable], written.positions[usable]
    # Nearly always all are usable; a copy would take as much memory again.
    as_written = written.bits if usable.all() else written.bits[usable]
    bits = main_values(as_written, is_intra, header)
    definition = header.frames["I"]
    table = _frame_table(definition, bits, positions)
    keep = _credible_frames(table, is_intra, written.bad[usable], events)
    if not keep.all():
        table = _frame_table(definition, bits[keep], positions[keep])
    return table, is_intra[keep], len(usable) - len(table)


def _frame_table(
    definition: FrameDefinition, bits: UInt32[np.ndarray, "n k"], positions: Int[np.ndarray, " n"]
) -> Table:
    return Table(names=definition.names, signed=definition.signed, bits=bits, positions=positions)


def _has_history(
    is_intra: Bool[np.ndarray, " n"], damages: Int[np.ndarray, " n"], i_interval: int
) -> Bool[np.ndarray, " n"]:
    """Select which main frames are I frames, or P frames in unbroken succession to one."""
    after_intra = position_after_intra(is_intra)
    intra_before = np.arange(len(is_intra), dtype=np.int32) - np.maximum(after_intra, 0)
    unbroken = damages == damages[intra_before]
    return (after_intra >= 0) & (after_intra < i_interval) & unbroken


def _credible_frames(
    table: Table,
    is_intra: Bool[np.ndarray, " n"],
    bad: Bool[np.ndarray, " n"],
    events: tuple[Event, ...],
) -> Bool[np.ndarray, " n"]:
    """Select which main frames have credible times; what follows a doubtful one is dropped."""
    if len(table) == 0:
        return np.zeros(0, bool)
    time = table.column("time")
    step = np.diff(time, prepend=time[:1]) % (1 << 32)  # the clock overflows after 71 minutes
    bad = bad | (~is_intra & (step > MAX_TIME_JUMP))
    rows = np.flatnonzero(is_intra)
    stretch = np.cumsum(is_intra, dtype=np.int32) - 1
    intra_bad = bad[rows] | ~_intra_in_line(table, rows, events)
    doubts = np.cumsum(bad, dtype=np.int32)
    before = doubts[rows] - bad[rows]
    return (doubts == before[stretch]) & ~intra_bad[stretch]


def _intra_in_line(
    table: Table, rows: Int[np.ndarray, " m"], events: tuple[Event, ...]
) -> Bool[np.ndarray, " m"]:
    """Select which I frames continue the accepted ones before them."""
    # Views give out one Python integer at a time, lists would hold them all.
    time = table.column("time")[rows].data
    iteration = table.column("loopIteration")[rows].data
    resumed = [e.position for e in events if e.kind == LOGGING_RESUME]
    positions = table.positions[rows]
    resumes = np.searchsorted(np.array(resumed, np.int64), positions).data

    def continues(a: int, b: int) -> bool:
        in_time = (time[b] - time[a]) % (1 << 32) <= MAX_TIME_JUMP
        return in_time and 0 < (iteration[b] - iteration[a]) % (1 << 32) <= MAX_ITERATION_JUMP

    accepted, last = np.zeros(len(rows), bool), -1
    for i in range(len(rows)):
        fits = last < 0 or continues(last, i) or resumes[i] > resumes[last]
        # A frame that does not continue is accepted all the same if logging was resumed in between,
        # or if it agrees with the I frame after it although that does not continue the accepted
        # ones either.
        if fits or (i + 1 < len(rows) and continues(i, i + 1) and not continues(last, i + 1)):
            accepted[i], last = True, i
    return accepted


def _plain_frames(letter: str, written: dict[str, _Written], header: Header) -> tuple[Table, int]:
    """Return the S or H frames, and how many were left out."""
    if letter not in written:
        return _empty_table(), 0
    definition, frames = header.frames[letter], written[letter]
    good = ~frames.bad
    values = add_constants(frames.bits[good].astype(np.int64), definition, header)
    table = _frame_table(definition, values.astype(np.uint32), frames.positions[good])
    return table, int(frames.bad.sum())


def _gps_frames(
    written: dict[str, _Written], header: Header, *, main: Table, home: Table
) -> tuple[Table, int]:
    """Return the G frames, and how many were left out."""
    if "G" not in written:
        return _empty_table(), 0
    frames = written["G"]
    good = ~frames.bad
    positions = frames.positions[good]
    values = gps_values(
        frames.bits[good].astype(np.int64),
        header,
        home=_latest_fields(home, ("GPS_home[0]", "GPS_home[1]"), positions),
        main_time=_latest_fields(main, ("time",), positions)[:, 0],
    )
    return _frame_table(header.frames["G"], values.astype(np.uint32), positions), int(
        frames.bad.sum()
    )


def _latest_fields(
    table: Table, names: tuple[str, ...], positions: Int[np.ndarray, " n"]
) -> Int[np.ndarray, "n k"]:
    """Return fields of the last frame before each position; zero if there is none."""
    if len(table) == 0 or not set(names) <= set(table.names):
        return np.zeros((len(positions), len(names)), np.int64)
    row = np.searchsorted(table.positions, positions) - 1
    columns = np.stack([table.column(name) for name in names], axis=1)
    return np.where(row[:, None] >= 0, columns[np.maximum(row, 0)], 0)


def _empty_table() -> Table:
    none = np.zeros((0, 0), np.uint32)
    return Table(names=(), signed=(), bits=none, positions=np.zeros(0, np.int32))
