"""Any log to a FlightLog: the format is told from the content, not from the name."""

import dataclasses
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rotorfit.errors import LogError
from rotorfit.logs.axes import Axes
from rotorfit.logs.columns import ColumnSpec
from rotorfit.logs.files import read_head
from rotorfit.logs.flight_log import FlightLog
from rotorfit.logs.kinds import own_kind
from rotorfit.logs.progress import Progress, read_for

_HEAD: Final = 65536
_PRINTABLE: Final = bytes(range(32, 256)) + b"\t\n\r\f"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """What a reader is told besides the file.

    Attributes
    ----------
    format
        Name of a format of `FORMATS`; None: told from the content.
    log_number
        Which log of a file with several, from 1; None: the reader's choice.
    columns
        For tables: canonical name to column. For motion capture with several rigid bodies: the
        name of one under ``position``, for Vicon's also ``"helical"`` under ``attitude`` where the
        file does not tell. For ROS bags: channel to topic, or canonical name to
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """A format that rotorfit reads.

    Attributes
    ----------
    name
        As in `ReadOptions` and `FlightLog`.
    title
        For people.
    recognises
        Tells from the first bytes of a file whether it has this format.
    read
        The reader.
    """

    name: str
    title: str
    recognises: Callable[[bytes], bool]
    read: Callable[[Path, ReadOptions], FlightLog]


def read_log(
    path: Path, *, options: ReadOptions | None = None, progress: Progress | None = None
) -> FlightLog:
    """Return the flight in a file of any format that rotorfit reads.

    Parameters
    ----------
    path
        The log.
    options
        What to take from it and how; None: `ReadOptions` as it stands.
    progress
        Told how much of a long log was gone through, from 0 to 1.

    Raises
    ------
    LogError
        If the format is not read by rotorfit, or the file is damaged.
    """
    with read_for(path, progress):
        return _read(path, options or ReadOptions())


def _read(path: Path, chosen: ReadOptions) -> FlightLog:
    """Return the flight in a file, its format told from its first bytes."""
    if chosen.format is not None:
        return _format_named(chosen.format).read(path, chosen)
    if path.is_dir() and _is_rosbag_folder(path):
        return _read_rosbag(path, chosen)
    head = read_head(path, _HEAD)
    for candidate in FORMATS:
        if candidate.recognises(head):
            return candidate.read(path, chosen)
    own = own_kind(path)
    if own is not None:
        raise LogError(f"{path}: this is {own}; give a flight log in its place")
    raise LogError(f"{path}: {_what_it_is(head)}; rotorfit reads {_titles()}")


def kind_of(path: Path) -> str | None:
    """Return what a file is, in words: a flight log, or one of rotorfit's own; None if neither.

    Never raises: it is asked when something else is wrong already.
    """
    own = own_kind(path)
    if own is not None:
        return own
    try:
        head = read_head(path, _HEAD)
    except LogError:
        return None
    form = next((form.name for form in FORMATS if form.recognises(head)), None)
    # Nearly anything may be taken for a table; only text is one for sure.
    known = form is not None and (form != "table" or head.isascii())
    return "a flight log" if known else None


def format_of(path: Path) -> str | None:
    """Return the name of a log's format, by its first bytes; None where it is none.

    Nearly any text may be a table. Never raises: for looking through folders.
    """
    try:
        if path.is_dir():
            return "rosbag" if _is_rosbag_folder(path) else None
        head = read_head(path, _HEAD)
    except (LogError, OSError):
        return None
    return next((form.name for form in FORMATS if form.recognises(head)), None)


def _format_named(name: str) -> Format:
    for candidate in FORMATS:
        if candidate.name == name:
            return candidate
    raise LogError(f"unknown format {name!r}: one of {', '.join(f.name for f in FORMATS)}")


def _titles() -> str:
    return ", ".join(candidate.title for candidate in FORMATS)


def _what_it_is(head: bytes) -> str:
    for name, recognises in FOREIGN:
        if recognises(head):
            what, _, remedy = name.partition(": ")
            advice = f": {remedy}" if remedy else ""
            return f"looks like {what}, which rotorfit does not read (yet){advice}"
    return f"unknown format (begins with {head[:8].hex(' ')})"


def _refuse_map(path: Path, options: ReadOptions, why: str) -> None:
    """Raise where columns or axes are given to a format that knows its own."""
    if options.columns or options.axes != "FLU":
        what = "a columns map" if options.columns else "axes"
        raise LogError(f"{path}: {why}: leave out {what}")


def _refuse_other_log(path: Path, options: ReadOptions, what: str) -> None:
    """Raise where another than the one log of a file is asked for."""
    if options.log_number not in (None, 1):
        raise LogError(f"{path}: {what} is one log, there is no log {options.log_number}")


def _is_blackbox(head: bytes) -> bool:
    from rotorfit.logs.blackbox import is_blackbox

    return is_blackbox(head)


def _read_blackbox(path: Path, options: ReadOptions) -> FlightLog:
    from rotorfit.logs.blackbox import read_blackbox

    _refuse_map(path, options, "a Blackbox log names its own fields and axes")
    return read_blackbox(path, log_number=options.log_number)


def _is_crazyflie(head: bytes) -> bool:
    from rotorfit.logs.crazyflie import is_crazyflie

    return is_crazyflie(head)


def _read_crazyflie(path: Path, options: ReadOptions) -> FlightLog:
    from rotorfit.logs.crazyflie import read_crazyflie

    _refuse_map(path, options, "a Crazyflie log names its own variables")
    _refuse_other_log(path, options, "a Crazyflie file")
    return read_crazyflie(path)


def _is_ulog(head: bytes) -> bool:
    from rotorfit.logs.ulog import is_ulog

    return is_ulog(head)


def _read_ulog(path: Path, options: ReadOptions) -> FlightLog:
    from rotorfit.logs.ulog import read_ulog

    _refuse_map(path, options, "a ULog names its own topics and axes")
    _refuse_other_log(path, options, "a ULog")
    return read_ulog(path)


def _is_dataflash(head: bytes) -> bool:
    from rotorfit.logs.dataflash import is_dataflash

    return is_dataflash(head)


def _read_dataflash(path: Path, options: ReadOptions) -> FlightLog:
    from rotorfit.logs.dataflash import read_dataflash

    _refuse_map(path, options, "a DataFlash log names its own fields and axes")
    _refuse_other_log(path, options, "a DataFlash file")
    return read_dataflash(path)


def _is_rosbag(head: bytes) -> bool:
    from rotorfit.logs.rosbag import is_rosbag

    return is_rosbag(head)


def _is_rosbag_folder(path: Path) -> bool:
    from rotorfit.logs.rosbag import is_rosbag_folder

    return is_rosbag_folder(path)


def _read_rosbag(path: Path, options: ReadOptions) -> FlightLog:
    from rotorfit.logs.rosbag import read_rosbag

    _refuse_other_log(path, options, "a bag")
    return read_rosbag(
        path, columns=options.columns, axes=options.axes, motor_poles=options.motor_poles
    )


def _is_mocap(name: str) -> Callable[[bytes], bool]:
    """Return the recogniser of a motion-capture format; its module is imported when it is asked."""

    def recognises(head: bytes) -> bool:
        from rotorfit.logs import mocap

        known = {
            "qualisys": mocap.is_qualisys,
            "motive": mocap.is_motive,
            "vicon": mocap.is_vicon,
            "trajectory": mocap.is_trajectory,
        }
        return known[name](head)

    return recognises


def _read_mocap(path: Path, options: ReadOptions) -> FlightLog:
    from rotorfit.logs import mocap

    _refuse_other_recording(path, options)
    read = mocap.read_motive if mocap.is_motive(read_head(path, _HEAD)) else mocap.read_qualisys
    return read(path, body=_only_choice(path, options, "position", "rigid body"))


def _read_vicon(path: Path, options: ReadOptions) -> FlightLog:
    from rotorfit.logs.mocap import read_vicon

    _refuse_other_recording(path, options)
    columns = dict(options.columns or {})
    rotation = columns.pop("attitude", None)
    bodies = dataclasses.replace(options, columns=columns)
    return read_vicon(
        path,
        body=_only_choice(path, bodies, "position", "rigid body"),
        rotation=None if rotation is None else rotation.name,
    )


def _refuse_other_recording(path: Path, options: ReadOptions) -> None:
    """Raise where another recording than the one of a file, or other axes, are asked for."""
    _refuse_other_log(path, options, "a recording")
    if options.axes != "FLU":
        raise LogError(f"{path}: the file says its own axes, turned to z up: leave out axes")


def _read_trajectory(path: Path, options: ReadOptions) -> FlightLog:
    from rotorfit.logs.mocap import read_trajectory

    if options.columns:
        return _read_table(path, options)
    _refuse_other_log(path, options, "a trajectory")
    return read_trajectory(path, axes=options.axes)


def _only_choice(path: Path, options: ReadOptions, name: str, what: str) -> str | None:
    """Return what a columns map chooses for the one name it may hold here."""
    chosen = dict(options.columns or {})
    spec = chosen.pop(name, None)
    if chosen:
        raise LogError(
            f"{path}: the file names its own columns; a columns map only chooses the {what}, as "
            f'columns = {{ {name} = "NAME" }}'
        )
    return None if spec is None else spec.name


def _is_table(head: bytes) -> bool:
    """Tell whether the bytes are Parquet or text that may begin with a row of names."""
    if head.startswith((b"PAR1", b"\xff\xfe", b"\xfe\xff")):
        return True
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    is_foreign = any(recognises(text) for _, recognises in FOREIGN)
    return bool(text) and not text.translate(None, _PRINTABLE) and not is_foreign


def _read_table(path: Path, options: ReadOptions) -> FlightLog:
    from rotorfit.logs.table import read_table

    _refuse_other_log(path, options, "a table")
    return read_table(
        path, columns=options.columns, axes=options.axes, motor_poles=options.motor_poles
    )


def _begins(*magic: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.startswith(magic)


def _is_toml(head: bytes) -> bool:
    # A table after comments and plain keys; a list of JSON has no bare word in its brackets.
    return _TOML_TABLE.match(head) is not None


def _is_c3d(head: bytes) -> bool:
    # The block in which its parameters begin, nearly always the second, and its mark.
    return head[1:2] == b"\x50" and 0 < head[0] < 9


_TOML_TABLE: Final = re.compile(
    rb"(?:[ \t]*(?:#[^\r\n]*|[A-Za-z_]\w*[ \t]*=[^\r\n]*)?\r?\n)*"
    rb"[ \t]*\[\[?[A-Za-z_][\w.-]*\]\]?[ \t]*(?:#[^\r\n]*)?\r?\n"
)

FORMATS: Final = (
    Format(
        name="blackbox",
        title="Blackbox (Betaflight, INAV, INDIflight)",
        recognises=_is_blackbox,
        read=_read_blackbox,
    ),
    Format(
        name="crazyflie",
        title="Crazyflie micro-SD logs",
        recognises=_is_crazyflie,
        read=_read_crazyflie,
    ),
    Format(
        name="ulog",
        title="PX4 logs (ULog)",
        recognises=_is_ulog,
        read=_read_ulog,
    ),
    Format(
        name="dataflash",
        title="ArduPilot DataFlash logs (.bin)",
        recognises=_is_dataflash,
        read=_read_dataflash,
    ),
    Format(
        name="rosbag",
        title="ROS bags (ROS 1, ROS 2, MCAP)",
        recognises=_is_rosbag,
        read=_read_rosbag,
    ),
    Format(
        name="qualisys",
        title="Qualisys 6DOF exports (TSV)",
        recognises=_is_mocap("qualisys"),
        read=_read_mocap,
    ),
    Format(
        name="motive",
        title="OptiTrack Motive exports (CSV)",
        recognises=_is_mocap("motive"),
        read=_read_mocap,
    ),
    Format(
        name="vicon",
        title="Vicon Nexus and Tracker exports (CSV)",
        recognises=_is_mocap("vicon"),
        read=_read_vicon,
    ),
    Format(
        name="trajectory",
        title="TUM trajectories",
        recognises=_is_mocap("trajectory"),
        read=_read_trajectory,
    ),
    Format(
        name="table",
        title="flight tables (CSV or Parquet)",
        recognises=_is_table,
        read=_read_table,
    ),
)
"""What rotorfit reads, tried in this order. A new format is one row."""

FOREIGN: Final[tuple[tuple[str, Callable[[bytes], bool]], ...]] = (
    ("a zip archive: unpack it first", _begins(b"PK\x03\x04", b"PK\x05\x06")),
    ("a gzip archive: unpack it first", _begins(b"\x1f\x8b")),
    ("a zstd archive: unpack it first", _begins(b"\x28\xb5\x2f\xfd")),
    ("a PDF document", _begins(b"%PDF")),
    ("an image", _begins(b"\x89PNG", b"\xff\xd8\xff", b"GIF8", b"II*\x00", b"MM\x00*")),
    ("a MATLAB file", _begins(b"MATLAB 5.0 MAT-file", b"\x89HDF\r\n")),
    ("a C3D file: export the rigid bodies as text", _is_c3d),
    ("a TOML file: name the log itself, and an airframe file with --airframe", _is_toml),
    ("JSON", _begins(b"{", b"[")),
    ("a web page or other XML", _begins(b"<")),
)
"""Formats that are met where logs are kept, but not read."""
