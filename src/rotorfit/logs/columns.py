"""Map the columns of a file to quantities: canonical names, maps, and guesses by other names."""

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final

from rotorfit.errors import LogError
from rotorfit.logs.units import Quantity, si_unit


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnSpec:
    """Where a file keeps one canonical quantity, and how.

    The SI value is that of ``scale * recorded + offset`` in ``unit``.

    Attributes
    ----------
    name
        The column's name in the file.
    unit
        Unit of the scaled values; None: the SI unit of the quantity.
    scale
        Factor applied before the unit conversion.
    offset
        Added after the scale, before the unit conversion, in `unit`.
    range
        For commands: scaled values that mean stop and full, such as (1000, 2000) us.
    """

    name: str
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    range: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Columns that make one channel of a `FlightLog`, by canonical names in order of components."""

    channel: str
    names: tuple[str, ...]
    quantity: Quantity


TIME: Final = "time"
QUATERNION: Final = Group(
    channel="attitude",
    names=("quat_w", "quat_x", "quat_y", "quat_z"),
    quantity="quaternion",
)
EULER: Final = Group(channel="attitude", names=("roll", "pitch", "yaw"), quantity="angle")
GROUPS: Final = (
    Group(channel="gyro", names=("gyro_x", "gyro_y", "gyro_z"), quantity="angular velocity"),
    Group(channel="accel", names=("accel_x", "accel_y", "accel_z"), quantity="acceleration"),
    Group(channel="battery", names=("battery",), quantity="voltage"),
    Group(channel="velocity", names=("vel_x", "vel_y", "vel_z"), quantity="velocity"),
    Group(channel="reference", names=("ref_x", "ref_y", "ref_z"), quantity="angular velocity"),
    Group(channel="position", names=("pos_x", "pos_y", "pos_z"), quantity="position"),
    QUATERNION,
    EULER,
)
ROTORS: Final[Mapping[str, tuple[str, Quantity]]] = {
    "rotor": ("rotor_speed", "rotor speed"),
    "command": ("command", "command"),
}
"""Stem of the numbered columns: channel and quantity."""

_NUMBERED: Final = re.compile(r"(rotor|command)_([1-9][0-9]?)")
_QUANTITIES: Final[Mapping[str, Quantity]] = {
    TIME: "time",
    **{name: group.quantity for group in GROUPS for name in group.names},
}
_OTHER_NAMES: Final[Mapping[str, tuple[str, ...]]] = {
    TIME: ("t", "timestamp", "time_s", "time_us", "time_ms", "seconds", "stamp", "clock"),
    "quat_w": ("qw", "q0"),
    "quat_x": ("qx", "q1"),
    "quat_y": ("qy", "q2"),
    "quat_z": ("qz", "q3"),
    **{f"pos_{axis}": (f"p{axis}", axis) for axis in "xyz"},
    **{f"gyro_{axis}": (f"gyr_{axis}", f"w{axis}", f"g{axis}") for axis in "xyz"},
    **{f"accel_{axis}": (f"acc_{axis}", f"a{axis}") for axis in "xyz"},
    **{f"rotor_{i}": (f"rpm_{i}", f"rpm{i}", f"motor_{i}", f"motor{i}", f"m{i}") for i in "1234"},
    "battery": ("vbat", "voltage"),
}
_LISTED_COLUMNS: Final = 12


def quantity_of(canonical: str) -> Quantity | None:
    """Find the quantity of a canonical name; None if the name is not canonical."""
    numbered = _NUMBERED.fullmatch(canonical)
    return ROTORS[numbered[1]][1] if numbered else _QUANTITIES.get(canonical)


def unit_of(canonical: str, spec: ColumnSpec) -> str:
    """Return the unit that a column is recorded in."""
    quantity = quantity_of(canonical)
    if quantity is None:
        raise LogError(f"{canonical!r} is not a canonical name")
    return si_unit(quantity) if spec.unit is None else spec.unit


def resolve(
    in_file: Sequence[str], columns: Mapping[str, ColumnSpec] | None
) -> dict[str, ColumnSpec]:
    """Return the specification of every canonical quantity that a file has.

    What the map names comes from there; columns that carry a canonical name themselves, and that
    the map does not claim for something else, are read as they are.
    """
    mapped = dict(columns or {})
    _check_map(mapped, in_file)
    claimed = {spec.name for spec in mapped.values()}
    own = {
        name: ColumnSpec(name=name)
        for name in in_file
        if quantity_of(name) is not None and name not in claimed and name not in mapped
    }
    resolved = own | mapped
    if TIME not in resolved:
        raise LogError(f"no column {TIME!r}; {_what_is_there(in_file)}")
    if len(resolved) == 1:
        raise LogError(f"no known column besides {TIME!r}; {_what_is_there(in_file)}")
    for spec in resolved.values():
        if in_file.count(spec.name) > 1:
            raise LogError(f"{in_file.count(spec.name)} columns are named {spec.name!r}: rename")
    return resolved


def complete_groups(
    resolved: Iterable[str], mapped: Iterable[str]
) -> tuple[list[Group], list[str]]:
    """Select the groups with all their columns, and a note on each one left out."""
    have, asked = set(resolved), set(mapped)
    groups: list[Group] = []
    notes: list[str] = []
    # Half of the Euler angles next to a quaternion is no loss.
    spare = EULER if have.issuperset(QUATERNION.names) else None
    for group in (*GROUPS, *_rotor_groups(have)):
        missing = [name for name in group.names if name not in have]
        present = [name for name in group.names if name in have]
        if not missing:
            groups.append(group)
        elif present and (not asked or asked.intersection(present)) and group is not spare:
            cure = "name the others in the columns map, too" if asked else f"rename {present[0]!r}"
            raise LogError(
                f"column {missing[0]!r} is missing next to {', '.join(present)}: "
                f"record {', '.join(group.names)} together, or {cure}"
            )
        elif present:
            notes.append(
                f"Left out {', '.join(present)}: {', '.join(missing)} "
                f"{'is' if len(missing) == 1 else 'are'} missing."
            )
    return _one_attitude(groups, notes, asked)


def _one_attitude(
    groups: list[Group], notes: list[str], asked: set[str]
) -> tuple[list[Group], list[str]]:
    if QUATERNION not in groups or EULER not in groups:
        return groups, notes
    euler_is_meant = asked.issuperset(EULER.names) and not asked.intersection(QUATERNION.names)
    spare, used = (QUATERNION, EULER) if euler_is_meant else (EULER, QUATERNION)
    note = f"Left out {', '.join(spare.names)}: the attitude is read from {', '.join(used.names)}."
    return [group for group in groups if group is not spare], [*notes, note]


def _rotor_groups(names: Iterable[str]) -> list[Group]:
    """Select the numbered groups, from 1 to the highest number that occurs."""
    highest: dict[str, int] = {}
    for name in names:
        if numbered := _NUMBERED.fullmatch(name):
            highest[numbered[1]] = max(highest.get(numbered[1], 0), int(numbered[2]))
    return [
        Group(
            channel=channel,
            names=tuple(f"{stem}_{i + 1}" for i in range(highest[stem])),
            quantity=quantity,
        )
        for stem, (channel, quantity) in ROTORS.items()
        if stem in highest
    ]


def _check_map(mapped: Mapping[str, ColumnSpec], in_file: Sequence[str]) -> None:
    users: dict[str, str] = {}
    for canonical, spec in mapped.items():
        if quantity_of(canonical) is None:
            known = [*_QUANTITIES, "rotor_1", "command_1"]
            raise LogError(
                f"the columns map names {canonical!r}, which rotorfit does not know"
                f"{_did_you_mean(canonical, known)}; known are {', '.join(known)} and so on"
            )
        if spec.name not in in_file:
            raise LogError(
                f"no column {spec.name!r}, which the columns map gives for {canonical!r}"
                f"{_did_you_mean(spec.name, in_file)}; the file has {_listed(in_file)}"
            )
        if spec.name in users:
            raise LogError(
                f"the columns map gives {spec.name!r} for both {users[spec.name]!r} "
                f"and {canonical!r}: give each its own column"
            )
        users[spec.name] = canonical


def _did_you_mean(name: str, known: Sequence[str]) -> str:
    close = difflib.get_close_matches(name, known, n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def _what_is_there(in_file: Sequence[str]) -> str:
    return f"the file has {_listed(in_file)}; {_suggestion(in_file)}"


def _listed(names: Sequence[str]) -> str:
    clean = (name if name.isprintable() else ascii(name) for name in names)
    shown = ", ".join(name[:40] for name in islice(clean, _LISTED_COLUMNS))
    more = len(names) - _LISTED_COLUMNS
    return f"{shown} and {more} more" if more > 0 else shown


def _suggestion(in_file: Sequence[str]) -> str:
    """Return the advice to write a columns map, begun with the nearest names of the file."""
    wanted = (TIME, "gyro_x", "accel_x", "rotor_1", "command_1", "pos_x", "quat_w")
    pairs = [(name, near) for name in wanted if (near := _nearest(name, in_file)) is not None]
    entries = [f'{name} = {{ name = "{near}" }}' for name, near in pairs[:4]]
    start = ", ".join(entries) or f'{TIME} = {{ name = "NAME IN THE FILE", unit = "s" }}'
    return (
        "rotorfit airframe TABLE proposes which is which, and writes it down; or say so in an "
        f"experiment file, such as columns = {{ {start}, ... }}, with a unit where it is not SI"
    )


def _nearest(canonical: str, in_file: Sequence[str]) -> str | None:
    """Find the file's column that most likely holds a canonical quantity."""
    lowered = {name.lower(): name for name in reversed(in_file)}
    for candidate in (canonical, *_OTHER_NAMES.get(canonical, ())):
        if candidate in lowered:
            return lowered[candidate]
        inside = [name for name in lowered if len(candidate) > 2 and candidate in name]
        if inside:
            return lowered[min(inside, key=len)]
    close = difflib.get_close_matches(canonical, lowered, n=1, cutoff=0.75)
    return lowered[close[0]] if close else None


_UNIT_WORDS: Final = (
    (("rad", "s"), "rad/s"),
    (("rads",), "rad/s"),
    (("radps",), "rad/s"),
    (("deg", "s"), "deg/s"),
    (("degs",), "deg/s"),
    (("dps",), "deg/s"),
    (("°", "s"), "deg/s"),
    (("m", "s", "2"), "m/s^2"),
    (("ms", "2"), "m/s^2"),
    (("mps", "2"), "m/s^2"),
    (("m", "s", "²"), "m/s^2"),
    (("mss",), "m/s^2"),
    (("m", "s"), "m/s"),
    (("mps",), "m/s"),
    (("µs",), "us"),
    (("percent",), "%"),
    *(((word,), word) for word in ("us", "ms", "ns", "s", "rpm", "erpm", "deg", "rad", "g", "mg")),
    *(((word,), unit) for word, unit in (("sec", "s"), ("hz", "Hz"), ("v", "V"), ("mv", "mV"))),
    *(((word,), word) for word in ("m", "cm", "mm")),
)
"""Words at the end of a name, and the unit that they mean."""
_ANGLES: Final = {"roll": 0, "pitch": 1, "yaw": 2, "phi": 0, "theta": 1, "psi": 2, "heading": 2}
_LETTERS: Final = {"w": -1, "x": 0, "y": 1, "z": 2}
_NO_MEASUREMENT: Final = frozenset(
    (
        *("bias", "std", "var", "cov", "covariance", "temp", "temperature", "mag", "baro"),
        *("status", "flag", "current", "curr", "amps", "offset", "error", "err", "integral"),
        *("accuracy", "percent", "soc", "count"),
    )
)
_SET_POINT: Final = frozenset(["sp", "setpoint", "ref", "reference", "target", "desired", "des"])
SPEED_WORDS: Final = ("rpm", "speed", "omega", "rads", "hz", "rps", "rot")
COMMAND_WORDS: Final = ("pwm", "cmd", "command", "throttle", "duty", "output", "servo", "actuator")
_MOTOR_WORDS: Final = (*SPEED_WORDS, *COMMAND_WORDS, "motor", "esc", "prop", "thrust")
NAMES: Final[Mapping[str, tuple[str, ...]]] = {
    "gyro": ("gyro_x", "gyro_y", "gyro_z"),
    "accel": ("accel_x", "accel_y", "accel_z"),
    "reference": ("ref_x", "ref_y", "ref_z"),
    "position": ("pos_x", "pos_y", "pos_z"),
    "velocity": ("vel_x", "vel_y", "vel_z"),
    "quaternion": ("quat_w", "quat_x", "quat_y", "quat_z"),
    "angle": ("roll", "pitch", "yaw"),
    "battery": ("battery",),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """Columns of one stem: by their index, and the unit that the names give."""

    kind: str
    stem: str
    by_index: Mapping[int, str]
    unit: str | None


def parts_of(name: str) -> tuple[tuple[str, ...], int | None, str | None]:
    """Split the name of a column into words, an index (w, x, y, z: -1 to 2), and a unit."""
    split = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.replace("eRPM", "erpm")).lower()
    words = tuple(re.findall(r"[a-zµ°²]+|\d+", split.replace("μ", "µ")))
    words, unit = _without_unit(words)
    words, index = _without_index(words)
    if unit is None:
        words, unit = _without_unit(words)
    return words, index, unit


def _without_unit(words: tuple[str, ...]) -> tuple[tuple[str, ...], str | None]:
    for ending, unit in _UNIT_WORDS:
        if len(words) > len(ending) and words[-len(ending) :] == ending:
            kept = len(words) if unit in ("rpm", "erpm") else len(words) - len(ending)
            return words[:kept], unit
    return words, words[-1] if words and words[-1] in ("rpm", "erpm") else None


def _without_index(words: tuple[str, ...]) -> tuple[tuple[str, ...], int | None]:
    if not words:
        return words, None
    last = words[-1]
    if last.isdecimal() and len(last) < 3:
        return words[:-1], int(last)
    known = {**_LETTERS, **_ANGLES}
    if last in known:
        is_angle = last in _ANGLES
        return (*words[:-1], *(("angle",) if is_angle else ())), known[last]
    # Glued on: gx, accx, quatw; but no letter of a word such as max.
    if last[-1] in _LETTERS and last[:-1] in _GLUED:
        return (*words[:-1], last[:-1]), _LETTERS[last[-1]]
    # The axis before what it is of: x_gyro, roll_rate, yaw_gyro.
    for word in words[:-1]:
        if word in known:
            angle = ("angle",) if word in _ANGLES else ()
            return (*(other for other in words if other != word), *angle), known[word]
    # A number inside: ESC0 RPM.
    for i, word in enumerate(words[:-1]):
        if word.isdecimal() and len(word) < 3:
            return (*words[:i], *words[i + 1 :]), int(word)
    return words, None


_GLUED: Final = frozenset(
    (
        *("g", "gyr", "gyro", "w", "om", "omega", "a", "acc", "accel", "accelerometer"),
        *("v", "vel", "p", "pos", "q", "quat", "imugyro", "imuacc"),
    )
)


def _kind(words: tuple[str, ...], index: int | None) -> str | None:
    """Tell what a column may hold by the words of its name; None if they say nothing."""
    joined = "".join(words)
    bare = tuple(word for word in words if not word.isdecimal())
    if _NO_MEASUREMENT.intersection(words):
        return None
    if index is None:
        if any(word in joined for word in ("vbat", "batt", "volt")):
            return "battery"
        if re.search(r"time|stamp|clock|second|micros|millis", joined) or joined in ("t", "ts"):
            return "time"
        return None
    turns = re.search(r"gyr|ang(ular)?vel|bodyrate|angularrate|anglerate|rateangle", joined)
    turns = turns or bare in (("w",), ("g",), ("om",)) or "rate" in words or "rates" in words
    if (turns or ("omega" in words and index < 3 and not _is_motor(words))) and index >= 0:
        return "reference" if _SET_POINT.intersection(words) else "gyro"
    if _SET_POINT.intersection(words):
        return None
    if ("acc" in joined or bare in (("a",), ("f",)) or "specificforce" in joined) and index >= 0:
        return "accel"
    return _kind_of_rest(words, bare, joined, index)


def _is_motor(words: tuple[str, ...]) -> bool:
    return any(word in ("motor", "rotor", "prop", "esc") for word in words)


def _kind_of_rest(
    words: tuple[str, ...], bare: tuple[str, ...], joined: str, index: int
) -> str | None:
    if any(word in joined for word in _MOTOR_WORDS) or bare[-1:] in (("m",), ("u",), ("n",)):
        return "motor" if index >= 0 else None
    if "quat" in joined or "orientation" in joined or bare == ("q",):
        return "quaternion"
    if "angle" in words or "euler" in joined:
        return "angle"
    if "vel" in joined or bare == ("v",):
        return "velocity"
    if "pos" in joined or bare in (("p",), ()) or "loc" in joined:
        return "position"
    return None


def candidates_of(names: Sequence[str], named: Mapping[str, str]) -> list[Candidate]:
    """Group columns by the words of their names, those that are named by hand first.

    A canonical name that is given an empty one leaves its kind out.
    """
    groups: dict[tuple[str, str], dict[int, str]] = {}
    units: dict[tuple[str, str], str | None] = {}
    left_out = {_place(canonical)[0] for canonical, name in named.items() if not name}
    for canonical, name in named.items():
        kind, index = _place(canonical)
        if not name:
            continue
        groups.setdefault((kind, ""), {})[index] = name
        units[kind, ""] = parts_of(name)[2]
    for name in names:
        words, index, unit = parts_of(name)
        kind = _kind(words, index)
        if kind is None or name in named.values():
            continue
        # Which wheel of letters counts is the same for q0..q3 and qw..qz only by their values.
        lettered = re.search(r"\d", name) is None if kind == "quaternion" else False
        key = (kind, f"{' '.join(words)}{' lettered' if lettered else ''}" or "plain")
        if kind in ("time", "battery"):
            key = (kind, name)
        groups.setdefault(key, {}).setdefault(0 if index is None else index, name)
        units.setdefault(key, unit)
    return [
        Candidate(kind=kind, stem=stem, by_index=found, unit=units[kind, stem])
        for (kind, stem), found in groups.items()
        if kind not in left_out
    ]


def _place(canonical: str) -> tuple[str, int]:
    """Return kind and index of a canonical name."""
    if canonical == TIME:
        return "time", 0
    for kind, names in NAMES.items():
        if canonical in names:
            return kind, names.index(canonical) - (kind == "quaternion")
    return "motor", int(canonical.rpartition("_")[2])
