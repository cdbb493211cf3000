"""Programs that write flight logs as tables: how to recognise one, and the file to prefer to it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from rotorfit.errors import LogError

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True, slots=True, kw_only=True)
class Exporter:
    """A program that writes tables with column names of its own.

    - `title`: name of the program and of what it wrote.
    - `original`: the file to give in place of the table, and why.
    - `marks`: sets of column names or beginnings of them (ending in ``*``); one set must be there.
    - `units`: unit by kind of column (``gyro``, ``accel``, ``rotor``, ``command``), where the
      names do not say it.
    - `erpm_scale`: factor from the recorded numbers to electrical revolutions per minute.
    - `dshot`: whether motor columns hold DShot values (48 to 2047) where they are no pulse widths.
    - `refused`: whether such tables never hold a flight that rotorfit can use.
    """

    title: str
    original: str
    marks: tuple[tuple[str, ...], ...]
    units: dict[str, str] = field(default_factory=dict[str, str])
    erpm_scale: float = 1.0
    dshot: bool = False
    refused: bool = False


EXPORTERS: Final = (
    Exporter(
        title="a Blackbox log as blackbox_decode or Blackbox Explorer writes it",
        original=(
            "better give the Blackbox file itself (.bbl, .bfl, .TXT): it has the scales, the range "
            "of the motors and the filters"
        ),
        marks=(("loopIteration", "time*", "gyroADC*"), ("loopIteration", "time*", "motor[0*")),
        # The firmware logs whole deg/s and hundreds of electrical revolutions per minute.
        units={"gyro": "deg/s", "reference": "deg/s"},
        erpm_scale=100.0,
        dshot=True,
    ),
    Exporter(
        title="a PlotJuggler export",
        original=(
            "better give the log itself (.ulg, .mcap, .bag): it has the parameters, and each "
            "channel on its own clock"
        ),
        marks=(("__time",), ("/*/*.00",)),
    ),
    Exporter(
        title="one topic of a PX4 log as ulog2csv writes it",
        original=(
            "give the .ulg itself: each topic has a file of its own, so that gyro and motors are "
            "never in one table"
        ),
        marks=(
            ("timestamp", "gyro_rad[0]"),
            ("timestamp", "xyz[0]"),
            ("timestamp", "control[0]"),
            ("timestamp", "output[0]"),
            ("timestamp", "q[0]"),
            ("timestamp", "esc[0].timestamp"),
            ("timestamp", "voltage_v"),
        ),
    ),
    Exporter(
        title="a DJI flight record as DatCon or CsvView converts it",
        original="DJI's own .DAT is encrypted or undocumented: this table is the best there is",
        marks=(("Clock:*",), ("IMU_ATTI(0)*",)),
        units={"gyro": "deg/s", "accel": "g", "rotor": "rpm", "command": "%"},
    ),
    Exporter(
        title="messages of an ArduPilot log as mavlogdump writes them",
        original="better give the .bin itself: it has the parameters, and IMU and motors together",
        marks=(("timestamp", "IMU.*"), ("timestamp", "RCOU.*"), ("timestamp", "TimeUS", "GyrX")),
        units={"gyro": "rad/s", "accel": "m/s^2", "command": "us"},
    ),
    Exporter(
        title="a ROS topic as rostopic echo -p or bagpy writes it",
        original=(
            "give the .bag itself: each topic has a file of its own, so that IMU and motors are "
            "never in one table"
        ),
        marks=(("%time", "field.*"), ("Time", "header.seq", "header.stamp.secs")),
        units={"gyro": "rad/s", "accel": "m/s^2"},
    ),
    Exporter(
        title="a radio's telemetry log (EdgeTX, OpenTX)",
        original=(
            "it has a few samples a second, and neither gyro nor motors: take the flight "
            "controller's own log (Blackbox .bbl, ArduPilot .bin, PX4 .ulg)"
        ),
        marks=(
            ("Date", "Time", "Thr", "Rud"),
            ("Date", "Time", "1RSS*"),
            ("Date", "Time", "RxBt*"),
        ),
        refused=True,
    ),
    Exporter(
        title="a DJI flight as the app or AirData writes it",
        original=(
            "it has ten samples a second, and neither gyro nor motors: convert the aircraft's own "
            ".DAT with DatCon, where its firmware allows that"
        ),
        marks=(("time(millisecond)",), ("OSD.flyTime*",), ("CUSTOM.date*",)),
        refused=True,
    ),
    Exporter(
        title="telemetry as QGroundControl writes it",
        original=(
            "it has a few samples a second, and neither gyro nor motors: take the autopilot's own "
            "log (PX4 .ulg, ArduPilot .bin)"
        ),
        marks=(("Timestamp", "rollRate", "groundSpeed"),),
        refused=True,
    ),
)
"""Tried in this order."""


def exporter_of(names: Sequence[str]) -> Exporter | None:
    """Return the program whose column names a table has; None if it is not one of `EXPORTERS`."""
    clean = [name.strip() for name in names]
    return next((one for one in EXPORTERS if _has_marks(one, clean)), None)


def _has_marks(exporter: Exporter, names: Sequence[str]) -> bool:
    return any(all(_is_met(mark, names) for mark in marks) for marks in exporter.marks)


def _is_met(mark: str, names: Sequence[str]) -> bool:
    """Return whether a name is the mark, or begins and ends as its parts between ``*`` say."""
    first, *others = mark.split("*")
    if not others:
        return mark in names
    return any(
        name.startswith(first)
        and name.endswith(others[-1])
        and all(part in name[len(first) :] for part in others)
        for name in names
    )


def refuse_export(names: Sequence[str]) -> None:
    """Raise an error if a table is of a kind that never holds what rotorfit needs."""
    found = exporter_of(names)
    if found is not None and found.refused:
        raise LogError(f"this is {found.title}: {found.original}")


def with_original(words: str, names: Sequence[str]) -> str:
    """Add to a complaint about a table what wrote it, and which file to give in its place."""
    found = exporter_of(names)
    return words if found is None else f"{words}; this is {found.title}: {found.original}"
