"""Where the logs of a Blackbox file begin, and what their text headers declare."""

from __future__ import annotations

import re
from enum import IntEnum
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.blackbox import LOG_START

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

MAX_BYTES: Final = 1 << 30
"""Largest file that is decoded; positions are 32-bit integers."""
MAX_FIELDS: Final = 512
"""Most fields of one frame: INDIflight logs 182, Betaflight some 50."""
MAX_UNWRITTEN: Final = 2
"""Most fields of one frame that take no byte, so that no file unpacks without limit.

The firmware has one, loopIteration of the P frames."""
MAX_INTERVAL: Final = 65536
"""Longest cycle between two I frames [loop iterations]; the firmware has 16 bits for it."""
DEFAULT_I_INTERVAL: Final = 32


class Encoding(IntEnum):
    """How a field is written; numbers of the specification.

    Elias codes (4, 5, 11) were an experiment: the specification does not list them, no released
    firmware writes them, and the fourth of their numbers (10) now means something else.
    """

    SIGNED_VB = 0
    UNSIGNED_VB = 1
    NEGATIVE_14BIT = 3
    TAG8_8SVB = 6
    TAG2_3S32 = 7
    TAG8_4S16 = 8
    UNWRITTEN = 9
    TAG2_3SVARIABLE = 10


class Predictor(IntEnum):
    """What is added to a field as written; numbers of the specification."""

    ZERO = 0
    PREVIOUS = 1
    STRAIGHT_LINE = 2
    AVERAGE_2 = 3
    MIN_THROTTLE = 4
    MOTOR_0 = 5
    INCREMENT = 6
    HOME_COORDINATE = 7
    FIFTEEN_HUNDRED = 8
    VBAT_REFERENCE = 9
    LAST_MAIN_FRAME_TIME = 10
    MIN_MOTOR = 11


_CONSTANT: Final = frozenset(
    {
        Predictor.ZERO,
        Predictor.MIN_THROTTLE,
        Predictor.FIFTEEN_HUNDRED,
        Predictor.VBAT_REFERENCE,
        Predictor.MIN_MOTOR,
    }
)
_RELATIVE: Final = frozenset(
    {
        Predictor.PREVIOUS,
        Predictor.STRAIGHT_LINE,
        Predictor.AVERAGE_2,
        Predictor.INCREMENT,
    }
)
_PREDICTORS: Final[dict[str, frozenset[Predictor]]] = {
    "I": _CONSTANT | {Predictor.MOTOR_0},
    "P": _CONSTANT | {Predictor.MOTOR_0} | _RELATIVE,
    "S": _CONSTANT,
    "G": _CONSTANT | {Predictor.HOME_COORDINATE, Predictor.LAST_MAIN_FRAME_TIME},
    "H": _CONSTANT,
}
"""Predictors that each kind of frame can use: only P frames may refer to earlier frames."""

# No control characters: frame data that happen to begin with "H " end the header.
_LINE = re.compile(rb"H ([^:\x00-\x1f]{1,128}):([^\x00-\x09\x0b-\x1f\n]{0,16384})\n")
_NEXT_LINE = re.compile(rb"\nH [A-Za-z_ ]{2,128}:")
_INTEGER = re.compile(r"\s*[+-]?\d{1,10}\s*")


@frozen_dataclass
class FrameDefinition:
    """The fields of one kind of frame, one entry per field in each tuple."""

    names: tuple[str, ...]
    signed: tuple[bool, ...]
    predictors: tuple[Predictor, ...]
    encodings: tuple[Encoding, ...]

    def only(self, names: Collection[str]) -> FrameDefinition:
        """Reduce the definition to some of the fields."""
        kept = [i for i, name in enumerate(self.names) if name in names]
        return FrameDefinition(
            names=tuple(self.names[i] for i in kept),
            signed=tuple(self.signed[i] for i in kept),
            predictors=tuple(self.predictors[i] for i in kept),
            encodings=tuple(self.encodings[i] for i in kept),
        )


@frozen_dataclass
class Header:
    """What the text header of one log declares.

    - `entries`: every header line, by name.
    - `frames`: by letter: I (complete), P (difference), S (slow), G (GPS), H (GPS home).
    - `data_version`: of the encodings: 1 or 2.
    - `i_interval`: loop iterations from one I frame to the next.
    - `p_numerator`, `p_denominator`: of the iterations between, this fraction is logged.
    - `start`, `data_start`, `stop`: byte offsets in the file: of the header, of the first frame,
      and after the last frame.
    - `damaged_bytes`: bytes of the header that are no header line.
    """

    entries: Mapping[str, str]
    frames: Mapping[str, FrameDefinition]
    data_version: int
    i_interval: int
    p_numerator: int
    p_denominator: int
    start: int
    data_start: int
    stop: int
    damaged_bytes: int

    def numbers(self, name: str) -> tuple[int, ...] | None:
        """Read a header line as integers; None if it is missing or something else."""
        return integers(self.entries.get(name, ""))


def integers(text: str) -> tuple[int, ...] | None:
    """Parse comma-separated integers of ten digits at most; None if it is something else."""
    parts = text.split(",")
    if not all(_INTEGER.fullmatch(part) for part in parts):
        return None
    return tuple(int(part) for part in parts)


def find_logs(data: bytes) -> list[tuple[int, int]]:
    """Find the byte range, header included, of every log in a file."""
    starts = [match.start() for match in re.finditer(re.escape(LOG_START), data)]
    return list(pairwise([*starts, len(data)]))


def read_header(data: bytes, start: int, stop: int) -> Header:
    """Read the header of one log."""
    entries, data_start, damaged = _read_lines(data, start, stop)
    i_interval = (integers(entries.get("I interval", "")) or (DEFAULT_I_INTERVAL,))[0]
    if not 1 <= i_interval <= MAX_INTERVAL:
        raise LogError(
            f"Blackbox header has I interval {i_interval}, expected 1 to {MAX_INTERVAL}: "
            "the header is damaged, copy the log from the recorder again"
        )
    numerator, denominator = _p_interval(entries.get("P interval", "1/1"))
    version = (integers(entries.get("Data version", "")) or (1,))[0]
    if version not in (1, 2):
        raise LogError(
            f"Blackbox data version is {version}, expected 1 or 2: "
            "record with Betaflight, INAV or INDIflight firmware"
        )
    return Header(
        entries=entries,
        frames=_frame_definitions(entries),
        data_version=version,
        i_interval=i_interval,
        p_numerator=numerator,
        p_denominator=denominator,
        start=start,
        data_start=data_start,
        stop=stop,
        damaged_bytes=damaged,
    )


def _read_lines(data: bytes, start: int, stop: int) -> tuple[dict[str, str], int, int]:
    """Read the header lines, the offset of the first frame, and the number of damaged bytes."""
    entries: dict[str, str] = {}
    position, damaged = start, 0
    while True:
        line = _LINE.match(data, position, stop)
        if line is not None:
            name, value = (_decode_printable(group) for group in line.groups())
            entries[name] = value
            position = line.end()
            continue
        # A damaged line is skipped if another follows soon; otherwise the frames begin here.
        following = _NEXT_LINE.search(data, position, min(stop, position + 2048))
        if following is None:
            return entries, position, damaged
        damaged += following.start() + 1 - position
        position = following.start() + 1


def _decode_printable(raw: bytes) -> str:
    """Decode text for any terminal."""
    text = raw.decode("utf-8", "replace").strip()
    return "".join(letter if letter.isprintable() else "\ufffd" for letter in text)


def _p_interval(text: str) -> tuple[int, int]:
    """Return the fraction of iterations logged; older firmware writes "1/2", newer "2"."""
    numerator, slash, denominator = text.partition("/")
    parts = integers(f"{numerator},{denominator}" if slash else f"1,{text}")
    if parts is None or len(parts) != 2:
        return 1, 1
    return max(1, parts[0]), max(1, parts[1])  # 0: the log has I frames only


def _frame_definitions(entries: Mapping[str, str]) -> dict[str, FrameDefinition]:
    frames: dict[str, FrameDefinition] = {}
    for letter in "IPSGH":
        # P frames hold the fields of the I frames and state only what differs.
        named = "I" if letter == "P" else letter
        names = entries.get(f"Field {named} name")
        predictors = entries.get(f"Field {letter} predictor")
        if names is None or predictors is None:
            continue
        frames[letter] = _parse_definition(
            letter,
            names=tuple(names.split(",")),
            signed=_field_numbers(entries, named, "signed"),
            predictors=_field_numbers(entries, letter, "predictor"),
            encodings=_field_numbers(entries, letter, "encoding"),
        )
    if "I" not in frames or not {"loopIteration", "time"} <= set(frames["I"].names):
        raise LogError(
            "Blackbox header does not declare the fields loopIteration and time of the I frames "
            '(lines "H Field I name", "... predictor"): the header is damaged, '
            "copy the log from the recorder again"
        )
    return frames


def _field_numbers(entries: Mapping[str, str], letter: str, kind: str) -> tuple[int, ...]:
    """Read the line "Field <letter> <kind>" as integers."""
    name = f"Field {letter} {kind}"
    if name not in entries and kind == "signed":  # absent in the oldest logs
        return (1,) * (entries[f"Field {letter} name"].count(",") + 1)
    numbers = integers(entries.get(name, ""))
    if numbers is None:
        raise LogError(
            f'Blackbox header line "{name}" is {entries.get(name, "missing")[:40]!r}, expected '
            "comma-separated integers: the header is damaged, copy the log from the recorder again"
        )
    return numbers


def _parse_definition(
    letter: str,
    *,
    names: tuple[str, ...],
    signed: tuple[int, ...],
    predictors: tuple[int, ...],
    encodings: tuple[int, ...],
) -> FrameDefinition:
    """Parse the definition of one kind of frame, checked."""
    counts = {len(names), len(signed), len(predictors), len(encodings)}
    if len(counts) > 1 or len(names) > MAX_FIELDS or len(set(names)) != len(names):
        problem = f"{len(names)} names, {len(signed)} signs, {len(predictors)} predictors and "
        problem += f"{len(encodings)} encodings, expected equal numbers of different fields"
    elif unknown := set(encodings) - set(Encoding):
        problem = f"encoding {min(unknown)}, expected one of {[e.value for e in Encoding]}"
    elif unknown := set(predictors) - _PREDICTORS[letter]:
        problem = (
            f"predictor {min(unknown)}, expected one of {sorted(map(int, _PREDICTORS[letter]))}"
        )
    elif encodings.count(Encoding.UNWRITTEN) > MAX_UNWRITTEN:
        problem = f"more than {MAX_UNWRITTEN} unwritten fields, expected that many at most"
    elif clash := _describe_clash(names, predictors, encodings):
        problem = clash
    else:
        return FrameDefinition(
            names=names,
            signed=tuple(bool(flag) for flag in signed),
            predictors=tuple(Predictor(number) for number in predictors),
            encodings=tuple(Encoding(number) for number in encodings),
        )
    raise LogError(
        f"Blackbox header declares {letter} frames with {problem} (limit {MAX_FIELDS} fields): "
        "the header is damaged or the firmware unknown, copy the log from the recorder again"
    )


def _describe_clash(
    names: tuple[str, ...], predictors: tuple[int, ...], encodings: tuple[int, ...]
) -> str:
    """State what predictors and encodings demand of each other; empty if all is well."""
    pairs = list(zip(predictors, encodings, strict=True))
    if any(p == Predictor.INCREMENT and e != Encoding.UNWRITTEN for p, e in pairs):
        return "a counting field that is also written, expected it to be unwritten"
    if Predictor.MOTOR_0 in predictors:
        if "motor[0]" not in names:
            return "fields relative to motor[0], which is missing"
        if predictors[names.index("motor[0]")] == Predictor.MOTOR_0:
            return "motor[0] relative to itself"
    if predictors.count(Predictor.HOME_COORDINATE) > 2:
        return "more than two fields relative to the home position, expected two"
    return ""
