"""The flight table: one row a time, one column a quantity, as CSV or Parquet.

pyarrow (the extra ``parquet``) reads the latter: of the readers at hand it alone answers every
damaged file with an exception.
"""

from __future__ import annotations

import re
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rotorfit.errors import LogError, OutputError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.columns import (
    EULER,
    TIME,
    ColumnSpec,
    Group,
    complete_groups,
    quantity_of,
    resolve,
    unit_of,
)
from rotorfit.logs.delimited import DelimitedText, open_delimited
from rotorfit.logs.files import (
    open_mapped,
    read_bytes,
    read_head,
    report_progress,
    sha256_of,
    write_whole,
)
from rotorfit.logs.filled_rows import sampled_rows
from rotorfit.logs.flight_log import Channel, FlightLog, grid_step
from rotorfit.logs.units import (
    UNITS,
    Axes,
    Conversion,
    attitude_from_euler,
    attitude_to_flu,
    conversion,
    vectors_to_flu,
)
from rotorfit.logs.world_velocity import turn_world_velocity

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from jaxtyping import Bool, Float

PARQUET_MAGIC: Final = b"PAR1"
"""The first four bytes of every Parquet file, and the last four."""

ROWS_AT_ONCE: Final = 65_536
_LARGEST_EXPANSION: Final = 100
_ALWAYS_ALLOWED: Final = 64_000_000
"""A table in memory may be so many times as large as its file, or have so many bytes."""
_LEAST_ELEMENT: Final = 3
"""Bytes in the footer of an element of its long lists: a small one may not declare a million."""

# Types by their names in Arrow.
_NUMBER: Final = re.compile(r"u?int\d+|halffloat|float|double|decimal\d+\(.*\)|null")
_CLOCK: Final = re.compile(r"(?:timestamp|duration|time|date)(32)?(?:64)?\[(s|ms|us|ns|day)\b.*\]")
_SECONDS: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "day": 86400.0}


@frozen_dataclass
class ParquetTable:
    """A Parquet file of which only the columns asked for are decoded."""

    data: bytes
    names: tuple[str, ...]

    def numbers(self, names: Sequence[str]) -> Float[np.ndarray, "n k"]:
        """Read columns as numbers, NaN if the file has none.

        Durations and dates become seconds.
        """
        try:
            file = _open_parquet(self.data)
            rows = file.metadata.num_rows
            _check_size(rows, 8 * rows * len(names), len(self.data))
            pages = (file.metadata.row_group(i) for i in range(file.metadata.num_row_groups))
            _check_size(rows, sum(page.total_byte_size for page in pages), len(self.data))
            values, done = np.empty((rows, len(names))), 0
            pieces = file.iter_batches(ROWS_AT_ONCE, columns=list(names), use_threads=False)
            for piece in pieces:
                columns = [_as_float(name, piece.column(name)) for name in names]
                values[done : done + piece.num_rows] = np.stack(columns, axis=1)
                done += piece.num_rows
                report_progress(done, rows)
            return values[:done]
        except LogError:
            raise
        except Exception as error:
            raise _damaged_parquet(error) from error

    def place(self, row: int) -> str:
        """Return the words for one row, counted from 0, as a person counts it."""
        return f"row {row + 1}"


def open_parquet(data: bytes) -> ParquetTable:
    """Return the table of a Parquet file given as bytes."""
    if not data.endswith(PARQUET_MAGIC):
        raise LogError("Parquet file without its end: it was cut off, copy or write it again")
    try:
        import_module("pyarrow.parquet")
    except ImportError as error:
        raise LogError(
            "reading Parquet needs pyarrow: pip install 'rotorfit[parquet]', or save as CSV"
        ) from error
    try:
        return ParquetTable(data=data, names=tuple(_open_parquet(data).schema_arrow.names))
    except Exception as error:
        raise _damaged_parquet(error) from error


def _open_parquet(data: bytes) -> Any:  # pyarrow has no types
    buffer = import_module("pyarrow").BufferReader(data)
    footer = min(int.from_bytes(data[-8:-4], "little"), len(data))
    return import_module("pyarrow.parquet").ParquetFile(
        buffer, thrift_container_size_limit=max(footer // _LEAST_ELEMENT, 1)
    )


def _damaged_parquet(error: Exception) -> LogError:
    """Return the refusal of a file that pyarrow cannot read, with its reason on one line."""
    text = str(error).partition("\n")[0][:200]
    reason = "".join(letter if letter.isprintable() else "\ufffd" for letter in text)
    return LogError(f"damaged Parquet file ({reason or type(error).__name__}): write it again")


def _check_size(rows: int, needed: int, file_size: int) -> None:
    """Raise if a small file declares a table that would fill the memory."""
    if rows < 0 or needed > max(_ALWAYS_ALLOWED, _LARGEST_EXPANSION * file_size):
        raise LogError(
            f"Parquet file of {file_size} bytes declares {rows} rows, {needed / 1e6:.0f} MB: "
            "damaged or no flight log; write it again, or save as CSV"
        )


def _as_float(name: str, column: Any) -> Float[np.ndarray, " n"]:
    """Return an Arrow column of numbers as it is, and one of times in seconds."""
    kind = str(column.type)
    seconds = 1.0
    if clock := _CLOCK.fullmatch(kind):
        seconds = _SECONDS[clock[2]]
        column = column.cast("int32" if clock[1] else "int64")
    elif not _NUMBER.fullmatch(kind):
        raise LogError(f"column {name!r} holds {kind}, expected numbers: convert it first")
    numbers = column.cast("float64", safe=False)
    return seconds * np.array(numbers.to_numpy(zero_copy_only=False), np.float64)


_LONGEST_STEP: Final = 0.5
_SHORTEST_STEP: Final = 1e-6
_USUAL_STEP: Final = 4e-3
"""Median time between rows that a flight log may have, and what it usually has [s]."""

_FULLEST_COMMAND: Final = 2.0
"""A command beyond this is no fraction of full."""

_VECTORS: Final = ("gyro", "accel", "velocity", "reference", "position")
_SENSORS: Final = (*_VECTORS, "attitude")
"""Channels whose copied samples are left out: a command holds until the next one."""
_NOT_TO_BE_EMPTY: Final = ("gyro", "accel", "rotor_speed", "command")
_FEWEST_LEVELS: Final = 16
_ROUNDING: Final = 1e-15
_SAMPLES_FOR_RESOLUTION: Final = 50_000

Source = DelimitedText | ParquetTable


def read_table(
    path: Path,
    *,
    columns: Mapping[str, ColumnSpec] | None = None,
    axes: Axes = "FLU",
    motor_poles: int | None = None,
) -> FlightLog:
    """Read the flight in a table."""
    try:
        source = open_table(path)
        channels, notes, time = _make_channels(source, columns or {}, axes, motor_poles, path=path)
    except LogError as error:
        raise LogError(f"{path}: {error}") from error.__cause__
    turned = turn_world_velocity(channels)
    if turned is not None:
        channels, notes = {**channels, "velocity": turned[0]}, [*notes, turned[1]]
    return FlightLog(
        path=path,
        sha256=sha256_of(path),
        format="table",
        channels=channels,
        seconds=float(time[-1]) - float(time[0]),
        metadata={"rows": str(len(time)), "columns": ", ".join(source.names)},
        notes=tuple(notes),
    )


def open_table(path: Path) -> Source:
    """Open the table in a file; its columns are read when asked for."""
    if read_head(path, len(PARQUET_MAGIC)) == PARQUET_MAGIC:
        return open_parquet(read_bytes(path))
    return open_delimited(open_mapped(path))


def _make_channels(
    source: Source,
    columns: Mapping[str, ColumnSpec],
    axes: Axes,
    motor_poles: int | None,
    *,
    path: Path,
) -> tuple[dict[str, Channel], list[str], Float[np.ndarray, " n"]]:
    """Return channels, notes, and the clock of the table."""
    specs = resolve(source.names, columns, path=path)
    groups, notes = complete_groups(specs, columns)
    values = _si_values(source, specs, groups, motor_poles)
    timed = np.isfinite(values[TIME])
    time = values[TIME][timed]
    _check_clock(source, timed, time, specs[TIME])
    if isinstance(source, DelimitedText) and source.is_cut:
        notes.append(
            "Left out the last line, which ends early, as where a recorder lost its power."
        )
    if not timed.all():
        notes.append(f"Left out {np.count_nonzero(~timed)} rows without a time.")
    if axes == "FRD":
        notes.append("Turned from FRD to FLU axes, and the world from north-east-down to z up.")
    channels: dict[str, Channel] = {}
    for group in groups:
        block = np.empty((len(time), len(group.names)))
        for column, name in enumerate(group.names):
            block[:, column] = values[name][timed]
        _check_values(group, block, specs)
        if np.isfinite(block).any(axis=0).all():
            channels[group.channel] = _make_channel(group, time, block, specs, axes, notes)
        elif group.channel in _NOT_TO_BE_EMPTY:
            raise LogError(_empty_column(group, block, specs))
        else:
            notes.append(f"Left out {group.channel}: {_empty_column(group, block, specs)}.")
    return channels, notes, time


def _si_values(
    source: Source,
    specs: Mapping[str, ColumnSpec],
    groups: Sequence[Group],
    motor_poles: int | None,
) -> dict[str, Float[np.ndarray, " n"]]:
    """Read every column that is needed, by canonical name, in SI units; NaN for no number."""
    wanted = [TIME, *(name for group in groups for name in group.names)]
    to_si = {name: _column_conversion(name, specs[name], motor_poles) for name in wanted}
    recorded = source.numbers([specs[name].name for name in wanted])
    for name, column in zip(wanted, recorded.T, strict=True):
        spec = specs[name]
        with np.errstate(over="ignore", invalid="ignore"):
            column[:] = to_si[name](column * spec.scale + spec.offset)
        column[~np.isfinite(column)] = np.nan
    return dict(zip(wanted, recorded.T, strict=True))


def _column_conversion(name: str, spec: ColumnSpec, motor_poles: int | None) -> Conversion:
    quantity = quantity_of(name)
    assert quantity is not None  # resolve() let only canonical names pass
    if not (np.isfinite([spec.scale, spec.offset]).all() and spec.scale != 0):
        raise LogError(
            f"column {spec.name!r} for {name!r}: scale {spec.scale:g} and offset {spec.offset:g} "
            "must be finite, and the scale not 0"
        )
    if spec.range is not None and quantity != "command":
        raise LogError(f"column {spec.name!r} for {name!r}: only a command has a range")
    try:
        return conversion(
            quantity, unit_of(name, spec), motor_poles=motor_poles, recorded_range=spec.range
        )
    except LogError as error:
        raise LogError(f"column {spec.name!r} for {name!r}: {error}") from error.__cause__


def _check_clock(
    source: Source,
    timed: Bool[np.ndarray, " n"],
    time: Float[np.ndarray, " m"],
    spec: ColumnSpec,
) -> None:
    """Raise if the rows cannot be instants of one flight, in order, in the stated unit."""
    if len(timed) == 0:
        raise LogError("no rows below the column names: nothing was recorded")
    if len(time) == 0:
        raise LogError(f"column {spec.name!r} for {TIME!r} holds no number")
    if len(time) == 1:
        raise LogError("one sample only: a flight log needs two at least, and seconds of flight")
    with np.errstate(over="ignore"):
        steps = np.diff(time)
    if (steps < 0).any():
        first = int(np.argmax(steps < 0))
        row = int(np.flatnonzero(timed)[first + 1])
        raise LogError(
            f"{source.place(row)}: time goes back from {time[first]:.9g} to "
            f"{time[first + 1]:.9g} s: sort the rows, or keep one recording a file"
        )
    if not (steps > 0).any():
        raise LogError(
            f"all {len(time)} rows have the time {time[0]:.9g} s: the clock stands; export it with "
            "more digits, such as seconds from the first row"
        )
    _check_time_unit(float(np.median(steps[steps > 0])), spec)


def _check_time_unit(step: float, spec: ColumnSpec) -> None:
    if _SHORTEST_STEP <= step <= _LONGEST_STEP:
        return
    unit = unit_of(TIME, spec)
    recorded = step / UNITS["time"].get(unit.strip(), 1.0)
    fitting = {
        name: abs(np.log(recorded * seconds / _USUAL_STEP))
        for name, seconds in UNITS["time"].items()
        if 1e-5 <= recorded * seconds <= _LONGEST_STEP
    }
    start = f"rows are {step:.4g} s apart with {spec.name!r} in {unit}"
    if not fitting:
        raise LogError(f"{start}: not a flight log, which has several rows a second")
    best = min(fitting, key=lambda name: fitting[name])
    raise LogError(
        f"{start}; {best} would fit: say so with "
        f'columns = {{ {TIME} = {{ name = "{spec.name}", unit = "{best}" }} }}'
    )


def _check_values(
    group: Group, block: Float[np.ndarray, "n k"], specs: Mapping[str, ColumnSpec]
) -> None:
    """Raise an error if the numbers are certainly not in the stated unit."""
    for name, column in zip(group.names, block.T, strict=True):
        value = float(np.abs(np.nan_to_num(column)).max())
        spec = specs[name]
        if group.channel == "command" and value > _FULLEST_COMMAND:
            raise LogError(
                f"column {spec.name!r} for {name!r} reaches {value:.5g}, expected 0 (stop) to 1 "
                f'(full): say what it holds, as {name} = {{ name = "{spec.name}", '
                'unit = "us", range = [1000, 2000] }, or unit "%", or a scale'
            )
        # Yaw may be counted over several turns; roll and pitch of a table hardly are.
        if name in EULER.names[:2] and spec.unit is None and value > 2 * np.pi:
            raise LogError(
                f"column {spec.name!r} for {name!r} reaches {value:.4g}, too much for rad: "
                f'say the unit, as {name} = {{ name = "{spec.name}", unit = "deg" }}'
            )


def _empty_column(
    group: Group, block: Float[np.ndarray, "n k"], specs: Mapping[str, ColumnSpec]
) -> str:
    empty = int(np.argmin(np.isfinite(block).any(axis=0)))
    name = group.names[empty]
    return f"column {specs[name].name!r} for {name!r} holds no number"


def _make_channel(
    group: Group,
    time: Float[np.ndarray, " n"],
    block: Float[np.ndarray, "n k"],
    specs: Mapping[str, ColumnSpec],
    axes: Axes,
    notes: list[str],
) -> Channel:
    """Return one channel on its own clock: the rows in which any of its columns has a number."""
    recorded = np.isfinite(block).any(axis=1)
    values = block
    if not recorded.all():
        time, values = time[recorded], block[recorded]
    sampled = sampled_rows(time, values) if group.channel in _SENSORS else None
    if sampled is not None:
        notes.append(
            f"Left out {np.count_nonzero(~sampled)} rows of {group.channel} that copy its last "
            "sample, as tools write that join messages of different clocks."
        )
        time, values = time[sampled], values[sampled]
    resolution = None if group is EULER else resolution_of(values)
    if group.channel == "attitude":
        quaternion = (
            attitude_from_euler(values) if group is EULER else _normalise_quaternions(values, notes)
        )
        values = attitude_to_flu(quaternion, axes)
    elif group.channel in _VECTORS:
        values = vectors_to_flu(values, axes)
    elif group.channel == "rotor_speed":
        values = _without_spin_signs(values, group, notes)
    return Channel(
        time=time, values=values, source=_source_words(group, specs), resolution=resolution
    )


def _without_spin_signs(
    speeds: Float[np.ndarray, "n k"], group: Group, notes: list[str]
) -> Float[np.ndarray, "n k"]:
    """Reverse the columns that are negative on the whole; the airframe says which way rotors spin.

    Noise about zero at rest keeps its sign in all columns.
    """
    with np.errstate(over="ignore"):
        is_negative = np.nansum(speeds, axis=0) < 0.0
    if not is_negative.any():
        return speeds
    names = [name for name, one in zip(group.names, is_negative, strict=True) if one]
    notes.append(f"Took {', '.join(names)} without the minus sign: the airframe has the spins.")
    return np.where(is_negative, -speeds, speeds)


def _normalise_quaternions(
    quaternion: Float[np.ndarray, "n 4"], notes: list[str]
) -> Float[np.ndarray, "n 4"]:
    """Bring quaternions to length 1; those that cannot be rounding of such become NaN."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(quaternion, axis=1)
    good = np.abs(length - 1) < 0.05
    if np.count_nonzero(good) < len(good) / 2:
        known = length[np.isfinite(length)]
        median = f" (median {np.median(known):.3g})" if len(known) else ""
        raise LogError(
            f"most quaternions have not length 1{median}: check the columns and their scale"
        )
    if not good.all():
        notes.append(f"{np.count_nonzero(~good)} attitudes are no unit quaternions: set to NaN.")
    return quaternion / np.where(good, length, np.nan)[:, np.newaxis]


def _source_words(group: Group, specs: Mapping[str, ColumnSpec]) -> str:
    """Name the columns, scales and units that a channel comes from."""
    used = [specs[name] for name in group.names]
    scales = {
        f"{'' if spec.scale == 1 else f' x {spec.scale:g}'}"
        f"{'' if spec.offset == 0 else f' + {spec.offset:g}'} [{unit_of(name, spec)}]"
        for name, spec in zip(group.names, used, strict=True)
    }
    if len(scales) == 1:
        return f"columns {', '.join(spec.name for spec in used)}{scales.pop()}"
    return f"columns {', '.join(spec.name for spec in used)}, each in its own unit"


def resolution_of(values: Float[np.ndarray, "n k"]) -> float | None:
    """Return the step of the grid on which recorded values lie, None if they lie on none.

    A column lies on a grid if the steps between its distinct values are whole multiples of the
    smallest one (to a tenth, since converters round), and if the values are not too few to show it.
    """
    thinned = values[:: max(1, len(values) // _SAMPLES_FOR_RESOLUTION)]
    columns = [column[np.isfinite(column)] for column in thinned.T]
    steps = [grid_step(column, fewest=_FEWEST_LEVELS, rounding=_ROUNDING) for column in columns]
    known = [step for step in steps if step is not None]
    return min(known) if len(known) == len(steps) > 0 else None


def format_table(columns: Mapping[str, Float[np.ndarray, " n"]]) -> str:
    """Write canonical columns as CSV text that reads back to the same numbers."""
    unknown = [name for name in columns if quantity_of(name) is None]
    if unknown:
        raise OutputError(f"{unknown[0]!r} is no column of a flight table: use {TIME}, gyro_x, ...")
    if TIME not in columns:
        raise OutputError(f"a flight table needs the column {TIME!r} [s]")
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise OutputError(f"the columns of a flight table differ in length: {listed}")
    cells = [[_cell_text(value) for value in column.tolist()] for column in columns.values()]
    rows = [",".join(columns), *(",".join(row) for row in zip(*cells, strict=True))]
    return "\n".join(rows) + "\n"


def _cell_text(value: float) -> str:
    return repr(value) if value == value else ""  # NaN alone differs from itself


def write_table(
    path: Path, columns: Mapping[str, Float[np.ndarray, " n"]], *, force: bool = False
) -> None:
    """Write canonical columns as CSV, whole or not at all."""
    write_whole(path, format_table(columns), force=force)
