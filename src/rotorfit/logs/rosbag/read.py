"""ROS recordings: from the file to a FlightLog."""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from rotorfit.errors import LogError
from rotorfit.findings import doubts
from rotorfit.logs.files import open_file
from rotorfit.logs.flight_log import CHANNELS, Channel, FlightLog, seconds_of
from rotorfit.logs.motor_outputs import MOTOR_COUNTS, motor_outputs
from rotorfit.logs.rosbag import files_of
from rotorfit.logs.rosbag.choose import (
    NOT_MOTORS,
    Candidate,
    candidates,
    chosen,
    is_aim,
    mapped_channels,
)
from rotorfit.logs.rosbag.stream import Contents, Recorded, Timing, require_rosbags, timings
from rotorfit.logs.rosbag.vehicles import keep_one_vehicle
from rotorfit.logs.world_velocity import turn_world_velocity

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from rotorfit.logs.columns import ColumnSpec
    from rotorfit.logs.rosbag.stream import Basis
    from rotorfit.logs.units import Axes

_SHOWN: Final = 20


def read_rosbag(
    path: Path,
    *,
    columns: Mapping[str, ColumnSpec] | None = None,
    axes: Axes = "FLU",
    motor_poles: int | None = None,
) -> FlightLog:
    """Read a ROS 1 bag, a ROS 2 bag (SQLite or MCAP, file or folder) or another MCAP of ROS."""
    specs = dict(columns or {})
    # The battery is a channel and a column of that name: a path to a number has a dot.
    mapped = {n: s for n, s in specs.items() if n not in CHANNELS or "." in s.name}
    asked = {name: spec.name for name, spec in specs.items() if name not in mapped}
    try:
        files = files_of(path)
        require_rosbags()
        from rotorfit.logs.rosbag.contents import contents_of

        contents = contents_of(files, mapped)
        log = _make_log(path, files, contents, asked, mapped, axes, motor_poles)
    except LogError as error:
        raise LogError(f"{path}: {error}") from error.__cause__
    except (MemoryError, RecursionError) as error:
        raise LogError(
            f"{path}: needs more memory than there is ({type(error).__name__}): damaged, or record "
            "the sensors only"
        ) from error
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error}): check the path and the disk") from error
    return log


def _make_log(
    path: Path,
    files: Sequence[Path],
    contents: Contents,
    asked: Mapping[str, str],
    mapped: Mapping[str, ColumnSpec],
    axes: Axes,
    motor_poles: int | None,
) -> FlightLog:
    topics = [recorded for recorded in contents.topics if len(recorded.received)]
    start = min((int(recorded.received.min()) for recorded in topics), default=0)
    clocks = timings(topics, start)
    found = candidates(topics, clocks, axes)
    one_vehicle, vehicles = keep_one_vehicle(found, set(asked.values()))
    taken, notes = chosen(one_vehicle, asked)
    channels = {name: one.channel for name, one in taken.items()}
    channels |= mapped_channels(topics, clocks, mapped, axes=axes, motor_poles=motor_poles)
    if not channels:
        raise LogError(_explain_nothing(contents)) from contents.cause
    turned = turn_world_velocity(channels)
    if turned is not None:
        channels["velocity"], words = turned
        notes = [*notes, words]
    used = {one.topic for one in taken.values()}
    unclear: list[str] = []
    if "command" in taken and channels["command"] is taken["command"].channel:
        channels["command"], idle, unclear = _without_idle_outputs(taken["command"], channels)
        notes = [*notes, *idle]
    return FlightLog(
        path=path,
        sha256=_sha256_of_files(files),
        format="rosbag",
        channels={name: channels[name] for name in CHANNELS if name in channels},
        seconds=seconds_of(channels.values()),
        metadata=_read_metadata(contents, start),
        notes=(*notes, *_clock_notes(topics, clocks, used), *_left_out(contents)),
        findings=(
            *doubts("damaged-log", _describe_damage(contents)),
            *doubts("speed-asked-for", _note_aims(taken)),
            *doubts("several-vehicles", vehicles),
            *doubts("unlike-clocks", _compare_clocks(topics, clocks, taken)),
            *doubts("unclear-outputs", unclear),
        ),
    )


def _without_idle_outputs(
    command: Candidate, channels: Mapping[str, Channel]
) -> tuple[Channel, list[str], list[str]]:
    """Drop outputs that the motion does not follow; what to say of them, and a doubt."""
    channel = command.channel
    listed = re.search(r"outputs ([\d, ]+\d)", channel.source)
    if listed is None or "gyro" not in channels or "accel" not in channels:
        return channel, [], []
    numbers = [int(number) for number in listed[1].split(", ")]
    example = f'command_1 = "{command.topic}.channels[{numbers[0] - 1}]"'
    cure = f"name the motors with a columns map, as columns = {{ {example}, ... }}"
    drives = motor_outputs(channel, channels["gyro"], channels["accel"])
    if drives is None or drives.all():
        if len(numbers) in MOTOR_COUNTS:
            return channel, [], []
        words = f"{len(numbers)} outputs of {command.topic} move ({listed[1]}), no multirotor"
        return channel, [], [f"{words} has so many motors: {cure}"]
    kept = [str(n) for n, one in zip(numbers, drives, strict=True) if one]
    idle = [str(n) for n, one in zip(numbers, drives, strict=True) if not one]
    source = channel.source.replace(listed[0], f"outputs {', '.join(kept)}")
    note = (
        f"Output {', '.join(idle)} of {command.topic} moves, but the vehicle does not follow it: "
        f"no motor, left out; where that is wrong, {cure}."
    )
    return replace(channel, values=channel.values[:, drives], source=source), [note], []


def _explain_nothing(contents: Contents) -> str:
    names = [f"{t.name} ({t.kind})" for t in contents.others]
    empty = [f"{r.topic.name} ({_topic_state(r)})" for r in contents.topics]
    listed = ", ".join([*empty, *names][:_SHOWN]) or "none"
    more = len(names) + len(empty) - _SHOWN
    damage = "; ".join(_describe_damage(contents))
    return (
        f"no message that rotorfit knows; topics: {listed}{f' and {more} more' if more > 0 else ''}"
        f"{f'; {damage}' if damage else ''}: record sensor_msgs/Imu and the motors (ESC telemetry "
        "or outputs), or name numbers with a columns map, as columns = "
        '{ gyro_x = "/TOPIC.path.x", ... }'
    )


def _topic_state(recorded: Recorded) -> str:
    count, why = recorded.unreadable
    return f"{count} messages unreadable: {why}" if count else f"{len(recorded.received)} messages"


def _read_metadata(contents: Contents, start: int) -> dict[str, str]:
    known = [f"{r.topic.name} ({r.topic.kind}) {len(r.received)}" for r in contents.topics]
    begin = start if start < 2**62 else 0
    return {
        "started": datetime.fromtimestamp(begin / 1e9, UTC).isoformat(timespec="milliseconds"),
        "topics read": ", ".join(known[:_SHOWN]),
        "other topics": ", ".join(f"{t.name} ({t.kind})" for t in contents.others[:_SHOWN]),
    }


def _clock_notes(topics: Sequence[Recorded], clocks: Sequence[Timing], used: set[str]) -> list[str]:
    """State which clock each used topic is on, the same words together."""
    words: dict[str, list[str]] = {}
    for recorded, timing in zip(topics, clocks, strict=True):
        if recorded.topic.name in used:
            words.setdefault(timing.why, []).append(recorded.topic.name)
    return [f"Time of {', '.join(names)}: {why}." for why, names in words.items()]


_CLOCKS: Final[Mapping[Basis, str]] = {
    "stamps": "stamps of the recorder's clock",
    "moved": "stamps of another clock",
    "receipt": "the times of their receipt",
}


def _compare_clocks(
    topics: Sequence[Recorded], clocks: Sequence[Timing], taken: Mapping[str, Candidate]
) -> list[str]:
    """Explain that gyro and motors have times of two kinds: how late messages are tells one."""
    basis: dict[str, Basis] = {
        recorded.topic.name: timing.basis for recorded, timing in zip(topics, clocks, strict=True)
    }
    motors = taken.get("rotor_speed") or taken.get("command")
    if motors is None or "gyro" not in taken:
        return []
    gyro = basis[taken["gyro"].topic]
    if gyro == basis[motors.topic]:
        return []
    return [
        f"messages of {taken['gyro'].topic} have {_CLOCKS[gyro]} and those of {motors.topic} "
        f"{_CLOCKS[basis[motors.topic]]}, so that motor_delay includes how long messages take: "
        "stamp both by one clock"
    ]


def _left_out(contents: Contents) -> list[str]:
    notes = [
        f"Left out {topic.name} ({topic.kind}): {why}."
        for topic in contents.others
        if (why := NOT_MOTORS.get(topic.kind))
    ]
    coded = [t.name for t in contents.others if t.encoding is None]
    if coded:
        notes.append(f"Left out {', '.join(coded[:_SHOWN])}: neither CDR nor ROS 1 messages.")
    return notes[:_SHOWN]


def _describe_damage(contents: Contents) -> list[str]:
    words = [f"{what} ({count} times)" for what, count in contents.damage.items()]
    for recorded in contents.topics:
        count, why = recorded.unreadable
        if count:
            words.append(f"{count} messages of {recorded.topic.name} are left out: {why}")
    return words


def _note_aims(taken: Mapping[str, Candidate]) -> list[str]:
    speed = taken.get("rotor_speed")
    if speed is None or not is_aim(speed):
        return []
    return [
        f"rotor speeds of {speed.topic} are what was asked for, not what was measured: the lag of "
        "the motors is missing in them; record the measured speeds"
    ]


def _sha256_of_files(files: Sequence[Path]) -> str:
    digest = hashlib.sha256()
    for file in files:
        with open_file(file) as opened:
            while block := opened.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()
