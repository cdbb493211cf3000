"""Map the columns of a file to quantities: canonical names and maps."""

from __future__ import annotations

import difflib
import re
import shlex
from itertools import islice
from typing import TYPE_CHECKING, Final

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.units import Quantity, si_unit

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path


@frozen_dataclass
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


@frozen_dataclass
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
"""Canonical names of the columns of one channel, by kind."""
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
    in_file: Sequence[str], columns: Mapping[str, ColumnSpec] | None, *, path: Path
) -> dict[str, ColumnSpec]:
    """Return the specification of every canonical quantity that a file has; `path` is its name.

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
    if TIME not in resolved or len(resolved) == 1:
        from rotorfit.logs.exporters import refuse_export

        refuse_export(in_file)
    if TIME not in resolved:
        raise LogError(f"no column {TIME!r}; {_what_is_there(in_file, path)}")
    if len(resolved) == 1:
        raise LogError(f"no known column besides {TIME!r}; {_what_is_there(in_file, path)}")
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
                f"{_did_you_mean(spec.name, in_file)}; the file has {_list_columns(in_file)}"
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


def _what_is_there(in_file: Sequence[str], path: Path) -> str:
    return f"the file has {_list_columns(in_file)}; {_suggest_map(in_file, path)}"


def _list_columns(names: Sequence[str]) -> str:
    named = (name or "(a column without a name)" for name in names)
    clean = (name if name.isprintable() else ascii(name) for name in named)
    shown = ", ".join(name[:40] for name in islice(clean, _LISTED_COLUMNS))
    more = len(names) - _LISTED_COLUMNS
    return f"{shown} and {more} more" if more > 0 else shown


def _suggest_map(in_file: Sequence[str], path: Path) -> str:
    """Return the advice to write a columns map, begun with the nearest names of the file."""
    wanted = (TIME, "gyro_x", "accel_x", "rotor_1", "command_1", "pos_x", "quat_w")
    pairs = [
        (name, near) for name in wanted if (near := _nearest_column(name, in_file)) is not None
    ]
    entries = [f'{name} = {{ name = "{near}" }}' for name, near in pairs[:4]]
    start = ", ".join(entries) or f'{TIME} = {{ name = "NAME IN THE FILE", unit = "s" }}'
    return (
        f"name them in an experiment file, such as columns = {{ {start}, ... }}, with a unit where "
        f"it is not SI, or let rotorfit propose them: rotorfit airframe {shlex.quote(str(path))}"
    )


def _nearest_column(canonical: str, in_file: Sequence[str]) -> str | None:
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
