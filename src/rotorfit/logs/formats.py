"""The formats that rotorfit reads: all that the project asks of a format by its name.

Each is a table of `formats.toml`; its functions stand there as ``module:function`` below
`rotorfit.logs`. `load` imports one when a file asks for it, so that no reader is imported for the
files of another format.
"""

from __future__ import annotations

import tomllib
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.foreign import FOREIGN

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rotorfit.logs.columns import ColumnSpec
    from rotorfit.logs.units import Axes


@frozen_dataclass
class ReadOptions:
    """How to read a file, where its content leaves that open.

    Attributes
    ----------
    format
        Name of a format of `FORMATS`; None: by the content.
    log_number
        Which log of a file with several, from 1; None: the reader's choice.
    columns
        For tables: canonical name to column. For motion capture with several rigid bodies: the
        name of one under ``position``, for Vicon's also ``"helical"`` under ``attitude`` where the
        file does not say. For ROS bags: channel to topic, or canonical name to
        ``TOPIC.path``.
    axes
        For tables: the file's body axes.
    motor_poles
        For tables: magnet poles of a motor, for rotor speeds in ``erpm``.
    """

    format: str | None = None
    log_number: int | None = None
    columns: Mapping[str, ColumnSpec] | None = None
    axes: Axes = "FLU"
    motor_poles: int | None = None


@frozen_dataclass
class LogEntry:
    """One log of a file with several: its number from 1, its byte range, and what it is."""

    number: int
    start: int
    stop: int
    description: str


@frozen_dataclass
class Format:
    """A format that rotorfit reads; functions are places for `load`, empty if it has none.

    - `name`: as in `ReadOptions` and `FlightLog`.
    - `title`: for people.
    - `recognises`, `recognises_folder`: from the first bytes of a file, or the path of a folder, to
      whether it has this format.
    - `read`, `takes`: from a path to a `FlightLog`, and the `ReadOptions` that it takes.
    - `list_logs`: from a path to the entries of a file that may hold several logs.
    - `suffixes`: of files that are logs of this format by their names.
    - `certain`: whether the first bytes identify this format for sure.
    - `names_fields`: whether the file names its fields, units and axes: no map of units is taken.
    - `map_refusal`: why a columns map or axes are refused; empty if the reader takes them.
    - `map_format`: name of the format that the file is read as where a columns map is given.
    - `single`: what to call a file that holds one log only.
    - `advice`: from what a log lacks and its metadata to the `firmware.Advice` for the next log.
    - `filters`: from a `FlightLog` to the `firmware.Filter` on board.
    - `notes_filters`: whether the notes of the reader name the filters already.
    - `motor_order`: whose motor numbering the log usually has, of `model.layouts`.
    - `velocity_estimated`: whether the velocity is an autopilot's estimate.
    - `with_controller`: from a path to its `FlightLog` and `ControllerLog`.
    """

    name: str
    title: str
    recognises: str
    read: str
    takes: tuple[str, ...] = ()
    recognises_folder: str = ""
    list_logs: str = ""
    suffixes: tuple[str, ...] = ()
    certain: bool = True
    names_fields: bool = False
    map_refusal: str = ""
    map_format: str = ""
    single: str = ""
    advice: str = ""
    filters: str = ""
    notes_filters: bool = False
    motor_order: str | None = None
    velocity_estimated: bool = False
    with_controller: str = ""


def _read_formats() -> Iterator[Format]:
    """Read the table beside this module."""
    text = Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    for name, row in tomllib.loads(text).items():
        lists = {key: tuple(row.get(key, ())) for key in ("takes", "suffixes")}
        yield Format(name=name, **row | lists)


FORMATS: Final = tuple(_read_formats())
"""What rotorfit reads, tried in this order."""

BY_NAME: Final[Mapping[str, Format]] = {form.name: form for form in FORMATS}


def load(place: str) -> Any:
    """Import a function of a format, given as ``module:function`` below `rotorfit.logs`."""
    module, _, name = place.partition(":")
    return getattr(import_module(f"rotorfit.logs.{module}"), name)


def recognise(head: bytes) -> Format | None:
    """Find the first format that has a file's first bytes."""
    return next((form for form in FORMATS if load(form.recognises)(head)), None)


# Nearly any text may be a table, unless it is known to be something else.

_PRINTABLE: Final = bytes(range(32, 256)) + b"\t\n\r\f"


def is_table(head: bytes) -> bool:
    """Return whether the bytes are Parquet or text that may begin with a row of names."""
    if head.startswith((b"PAR1", b"\xff\xfe", b"\xfe\xff")):
        return True
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    is_foreign = any(recognises(text) for _, recognises in FOREIGN)
    return bool(text) and not text.translate(None, _PRINTABLE) and not is_foreign
