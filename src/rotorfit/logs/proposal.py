"""A proposal for the columns of an unknown table: which is which, in what unit, in which axes.

Names say what a column may be, its values decide: gravity gives the unit of the accelerometer and
the axes, the attitude's rate the unit and the signs of the gyro. What neither shows is a question.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.column_names import Candidate, candidates_of
from rotorfit.logs.columns import NAMES, TIME, ColumnSpec, quantity_of
from rotorfit.logs.exporters import Exporter, exporter_of, refuse_export, with_original
from rotorfit.logs.proposed_channels import (
    MOTOR_UNITS,
    MOTORS,
    STATED,
    Found,
    Question,
    accelerometer_found,
    attitude_found,
    attitude_rate,
    attitude_signed,
    battery_found,
    chosen_of,
    gyro_found,
    others_found,
)
from rotorfit.logs.proposed_clock import CLOCK, clock_found
from rotorfit.logs.proposed_motors import motors_found
from rotorfit.logs.proposed_poses import pose_found
from rotorfit.logs.table import Source, open_table
from rotorfit.logs.units import UNITS, Axes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import numpy as np
    from jaxtyping import Float

    from rotorfit.logs.proposed_channels import Numbers

LARGEST_ROWS: Final = 200_000
"""Most rows of a table that are read, the first ones."""


@frozen_dataclass
class Proposal:
    """The columns of a table, as far as its names and values show them.

    - `columns`: canonical name to column, as an experiment file maps them.
    - `axes`: the body axes of the table, by gravity.
    - `reasons`: how unit, axes and signs were found, a sentence each.
    - `doubts`: what to look at before the map is used.
    - `unused`: names of the other columns.
    - `preview`: canonical name to values as recorded, of the first, the middle and the last row.
    """

    columns: Mapping[str, ColumnSpec]
    axes: Axes
    reasons: tuple[str, ...]
    doubts: tuple[str, ...]
    questions: tuple[Question, ...]
    unused: tuple[str, ...]
    preview: Mapping[str, tuple[float, ...]]


def propose_columns(
    path: Path,
    *,
    named: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    axes: Axes | None = None,
) -> Proposal:
    """Propose which column of a table is which, from its names and values.

    Parameters
    ----------
    path
        The table: CSV or Parquet.
    named
        Canonical name to name of a column, where the proposal shall not choose; an empty name
        leaves its whole channel out.
    units
        ``gyro``, ``motors``, ``time``, ... to a unit: it answers a question, or the proposal is
        wrong.
    axes
        The body axes, where those by gravity are wrong.

    Raises
    ------
    LogError
        If the file is no table with a clock, or no gyro, accelerometer or motors are found in it.
    """
    try:
        return _make_proposal(open_table(path), named or {}, units or {}, axes)
    except LogError as error:
        raise LogError(f"{path}: {error}") from error.__cause__


def explains_itself(path: Path) -> bool:
    """Return whether the columns of a table carry rotorfit's own names, for all that it needs."""
    try:
        names = set(open_table(path).names)
    except LogError as error:
        raise LogError(f"{path}: {error}") from error.__cause__
    motors = not names.isdisjoint({"rotor_1", "command_1"})
    is_flight = motors and names.issuperset({TIME, *NAMES["gyro"], *NAMES["accel"]})
    return is_flight or names.issuperset({TIME, *NAMES["position"]})


def _make_proposal(
    source: Source, named: Mapping[str, str], units: Mapping[str, str], axes: Axes | None
) -> Proposal:
    if len(source.names) == 1:
        raise LogError(
            f"one column only, {source.names[0][:40]!r}: cells are separated by comma, semicolon, "
            "tab, | or spaces"
        )
    refuse_export(source.names)
    exporter = exporter_of(source.names)
    _check_given(source, named, units)
    candidates = candidates_of(source.names, named)
    numbers, texts = _read_numbers(source, candidates)
    founds = [clock_found(source, candidates, numbers, units)]
    chosen = {kind: chosen_of(kind, candidates, numbers) for kind in NAMES}
    motors = motors_found(candidates, numbers, units, exporter)
    lacking = [kind for kind in ("gyro", "accel") if chosen[kind] is None]
    attitude = attitude_found(chosen, numbers, units.get("angle"))
    by_pose = bool(lacking) and chosen["position"] is not None and bool(attitude.columns)
    if not motors.columns or (lacking and not by_pose):
        lacking = [*lacking, *([] if motors.columns else ["motors"])]
        words = _lacking_words(lacking, candidates, source)
        if lacking == ["motors"] and motors.reasons:
            words = (
                f"no motor speeds or commands: {'; '.join(motors.reasons)}: record what the motors "
                "are sent or how fast they turn, or name these columns, as --column rotor_1=NAME"
            )
        raise LogError(with_original(words, source.names))
    clock = founds[0].columns[TIME]
    found_by = _propose_poses if by_pose else _propose_sensors
    moving, others, axes = found_by(
        chosen, numbers, attitude=attitude, clock=clock, units=units, axes=axes, exporter=exporter
    )
    written = () if exporter is None else (f"this is {exporter.title}: {exporter.original}",)
    founds += [*moving, motors, *others, Found(columns={}, reasons=written)]
    columns = {name: spec for one in founds for name, spec in one.columns.items()}
    used = {spec.name for spec in columns.values()}
    left_texts = [f"{', '.join(texts)}: holds text, left out"] if texts else []
    preview_rows = _preview_rows(numbers)
    return Proposal(
        columns=columns,
        axes=axes,
        reasons=tuple(dict.fromkeys(words for one in founds for words in one.reasons)),
        doubts=tuple([*(words for one in founds for words in one.doubts), *left_texts]),
        questions=tuple(question for one in founds for question in one.questions),
        unused=tuple(name for name in source.names if name not in used),
        preview={
            name: tuple(float(numbers[spec.name][i]) for i in preview_rows)
            for name, spec in columns.items()
        },
    )


def _propose_sensors(
    chosen: Mapping[str, Candidate | None],
    numbers: Numbers,
    *,
    attitude: Found,
    clock: ColumnSpec,
    units: Mapping[str, str],
    axes: Axes | None,
    exporter: Exporter | None,
) -> tuple[list[Found], list[Found], Axes]:
    """Find gyro and accelerometer, and what goes with them."""
    accel, axes = accelerometer_found(chosen["accel"], numbers, units.get("accel"), axes)
    rate = attitude_rate(attitude, clock, numbers)
    usual = None if exporter is None else exporter.units.get("gyro")
    accel_unit = accel.columns[NAMES["accel"][2]].unit
    gyro = gyro_found(
        chosen["gyro"], rate, numbers, units.get("gyro"), usual=usual, accel_unit=accel_unit
    )
    signed = attitude_signed(attitude, gyro, rate, numbers)
    others = [signed, battery_found(chosen, numbers), others_found(chosen, gyro, units)]
    return [gyro, accel], others, axes


def _propose_poses(
    chosen: Mapping[str, Candidate | None],
    numbers: Numbers,
    *,
    attitude: Found,
    clock: ColumnSpec,
    units: Mapping[str, str],
    axes: Axes | None,
    exporter: Exporter | None,
) -> tuple[list[Found], list[Found], Axes]:
    """Find the position beside an attitude, where gyro or accelerometer are not there."""
    del exporter  # poses need none of its units
    position = chosen["position"]
    assert position is not None
    pose, axes = pose_found(position, attitude, numbers, clock=clock, units=units, axes=axes)
    return [attitude, pose], [battery_found(chosen, numbers)], axes


def _check_given(source: Source, named: Mapping[str, str], units: Mapping[str, str]) -> None:
    """Raise an error if a reply names no column of the table, or no channel or unit."""
    for canonical, name in named.items():
        if quantity_of(canonical) is None:
            raise LogError(f"{canonical!r} is no name of rotorfit: gyro_x, accel_x, rotor_1, ...")
        if name and name not in source.names:
            shown = ", ".join(n[:40] for n in source.names[:12])
            raise LogError(f"no column {name!r} for {canonical}; the table begins with {shown}")
    known = units_to_state()
    for channel, unit in units.items():
        if channel == CLOCK and unit in source.names:
            continue
        if channel not in known:
            raise LogError(f"a unit of {channel!r}: expected one of {', '.join(known)}")
        if unit not in known[channel]:
            raise LogError(
                f"unit {unit!r} of {channel}: expected one of {', '.join(known[channel])}"
            )


def units_to_state() -> dict[str, tuple[str, ...]]:
    """List the units that may be stated, by channel."""
    measured = {channel: tuple(UNITS[quantity]) for channel, quantity in STATED.items()}
    return measured | dict.fromkeys(MOTORS, MOTOR_UNITS)


def _lacking_words(lacking: Sequence[str], candidates: Sequence[Candidate], source: Source) -> str:
    """State which columns are wanted, and whether some are named so but hold no numbers."""
    words = {"gyro": "gyro", "accel": "accelerometer", "motors": "motor speeds or commands"}
    names = [
        name
        for one in candidates
        if one.kind.removesuffix("s") in {kind.removesuffix("s") for kind in lacking}
        for name in one.by_index.values()
    ]
    what = ", ".join(words[one] for one in lacking)
    if names:
        shown = ", ".join(name[:40] for name in names[:8])
        return (
            f"no whole {what}: of {shown} some hold text or no numbers, stand still, or are "
            "too few (x, y, z; three motors or more): record them, or name others with --column"
        )
    example = {"gyro": "gyro_x", "accel": "accel_x", "motors": "rotor_1"}[lacking[0]]
    shown = ", ".join(name[:40] or "(a column without a name)" for name in source.names[:12])
    more = f" and {len(source.names) - 12} more" if len(source.names) > 12 else ""
    return (
        f"no column for {what} by its name; the table has {shown}{more}: name each one, "
        f"as --column {example}=NAME, or record them, too"
    )


def _read_numbers(
    source: Source, candidates: Sequence[Candidate]
) -> tuple[dict[str, Float[np.ndarray, " n"]], list[str]]:
    """Read the columns that may be wanted, and list those that hold text."""
    wanted = list(dict.fromkeys(n for one in candidates for n in one.by_index.values()))
    for name in wanted:
        if source.names.count(name) > 1:
            raise LogError(f"{source.names.count(name)} columns are named {name!r}: rename")
    if not any(one.kind == "time" for one in candidates) and source.names:
        wanted.insert(0, source.names[0])
    texts: list[str] = []
    try:
        block = source.numbers(wanted)
    except LogError as first:
        columns: dict[str, Float[np.ndarray, " n"]] = {}
        for name in wanted:
            try:
                columns[name] = source.numbers([name])[:, 0]
            except LogError:
                texts.append(name)
        if not columns:
            raise first
        return _thin_columns(columns), texts
    return _thin_columns(dict(zip(wanted, block.T, strict=True))), texts


def _thin_columns(
    columns: dict[str, Float[np.ndarray, " n"]],
) -> dict[str, Float[np.ndarray, " n"]]:
    rows = len(next(iter(columns.values()), ()))
    if rows == 0:
        raise LogError("no rows below the column names: nothing was recorded")
    if rows < 10:
        raise LogError(f"{rows} row{'s' if rows > 1 else ''} only: a flight has seconds of them")
    kept = slice(0, LARGEST_ROWS)
    return {name: column[kept] for name, column in columns.items()}


def _preview_rows(numbers: Numbers) -> tuple[int, int, int]:
    rows = len(next(iter(numbers.values())))
    return 0, rows // 2, rows - 1
