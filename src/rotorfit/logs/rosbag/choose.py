"""From topics to channels: which topic is taken, and its numbers in SI units and FLU axes.

`messages.toml` beside this module has what each type of message gives. Nothing here imports
rosbags, which may not be there.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.columns import EULER, ColumnSpec, Group, complete_groups, quantity_of, unit_of
from rotorfit.logs.flight_log import Channel
from rotorfit.logs.units import (
    Axes,
    attitude_from_euler,
    attitude_to_flu,
    conversion,
    unit_or_nan,
    vectors_to_flu,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from jaxtyping import Bool, Float

    from rotorfit.logs.rosbag.stream import Recorded, Timing

Form = Literal[
    "vector",  # body axes, SI
    "position",  # world, m
    "xyzw",  # body to world
    "wxyz",
    "rpm",  # with or without sign
    "rad/s",
    "fraction",  # 0 to 1, NaN for stopped
    "outputs",  # pulse widths [us] or fractions; motors among other things
    "volt",
]


@frozen_dataclass
class Quantity:
    """Numbers of one channel in a message, by paths as of `definitions.taken_by`."""

    paths: tuple[str, ...]
    form: Form


@frozen_dataclass
class MessageKind:
    """A type of message that is read, by channels.

    With `frd` its axes are FRD and north-east-down whatever the user says (PX4). Of several
    `definitions` for files that hold none, the one whose size is that of the messages is taken.
    """

    channels: Mapping[str, Quantity]
    frd: bool
    definitions: tuple[str, ...]


def _read_kinds() -> dict[str, MessageKind]:
    """Read the table beside this module."""
    text = Path(__file__).with_name("messages.toml").read_text(encoding="utf-8")
    return {
        kind: MessageKind(
            channels={
                name: Quantity(paths=tuple(one["paths"]), form=one["form"])
                for name, one in row["channels"].items()
            },
            frd=row.get("frd", False),
            definitions=tuple(row.get("definitions", ("",))),
        )
        for kind, row in tomllib.loads(text).items()
    }


MESSAGES: Final[Mapping[str, MessageKind]] = _read_kinds()
"""What is read without a columns map."""

NOT_MOTORS: Final[Mapping[str, str]] = {
    "mavros_msgs/ActuatorControl": "demands of roll, pitch, yaw and thrust before the mixer",
    "px4_msgs/ActuatorControls0": "demands of roll, pitch, yaw and thrust before the mixer",
    "std_msgs/Float32MultiArray": "numbers without names: say what they are with a columns map",
}
"""Types that may look like motor data, and why they are left out."""

STAMPS: Final[Sequence[Sequence[str]]] = (
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("timestamp_sample",),
    ("timestamp",),
)
"""Paths of the stamp: of ROS in seconds and nanoseconds, of PX4 in microseconds."""

AIMS: Final = ("setpoint", "set_point", "command", "cmd", "target", "desired", "reference", "goal")
"""Words in the name of a topic that is a set point, not a measurement."""
CAMERAS: Final = ("mocap", "vicon", "vrpn", "optitrack", "natnet", "qualisys", "qtm", "motion_cap")
IMU: Final = ("gyro", "accel")
ELSEWHERE: Final = frozenset(
    {
        *("camera", "cam", "realsense", "d435i", "t265", "zed", "oak", "gimbal"),
        *("lidar", "livox", "ouster", "velodyne"),
    }
)
"""Words in the name of an IMU that sits in another device, with axes of its own."""
ALIKE: Final = 0.8
"""Share of the fastest rate from which a raw IMU is taken before one that a driver filtered."""
ESTIMATES: Final = ("local_position", "estimat", "odom", "ekf", "fused", "slam", "vio", "gps")


_RPM: Final = 2.0 * np.pi / 60.0
_PULSE: Final = (1000.0, 2000.0)
"""Widths that mean stop and full [us]."""
_PULSE_RANGE: Final = (700.0, 2300.0)
_FEWEST: Final = 2
_PAIRS: Final = (("gyro", "accel"), ("position", "attitude"))
_SHOWN: Final = 8
MEASURED: Final = ("gyro", "accel", "position", "attitude", "velocity")
"""Channels of which a set-point is no measurement."""


@frozen_dataclass
class Candidate:
    """A topic that can give a channel."""

    topic: str
    kind: str
    channel: Channel
    rate: float


def candidates(
    topics: Sequence[Recorded], clocks: Sequence[Timing], axes: Axes
) -> dict[str, list[Candidate]]:
    """Select the topics that can give each channel."""
    found: dict[str, list[Candidate]] = {}
    for recorded, timing in zip(topics, clocks, strict=True):
        kind = MESSAGES.get(recorded.topic.kind)
        if kind is None:
            continue
        for name, quantity in kind.channels.items():
            own: Axes = "FRD" if kind.frd else axes
            values, detail = converted(recorded.values[name], quantity.form, own)
            known = ~np.all(np.isnan(values), axis=1)
            if values.shape[1] == 0 or np.count_nonzero(known) < _FEWEST:
                continue
            candidate = _make_candidate(recorded, timing, values, known, detail)
            found.setdefault(name, []).append(candidate)
    return found


def _make_candidate(
    recorded: Recorded,
    timing: Timing,
    values: Float[np.ndarray, "n k"],
    known: Bool[np.ndarray, " n"],
    detail: str,
) -> Candidate:
    time = timing.time[known]
    order = np.argsort(time, kind="stable")
    span = float(time[order[-1]] - time[order[0]])
    conversion_note = f", {detail}" if detail else ""
    source = f"{recorded.topic.name} ({recorded.topic.kind}{conversion_note})"
    return Candidate(
        topic=recorded.topic.name,
        kind=recorded.topic.kind,
        channel=Channel(time=time[order], values=values[known][order], source=source),
        rate=(len(time) - 1) / span if span > 0 else 0.0,
    )


def converted(
    numbers: Float[np.ndarray, "n k"], form: Form, axes: Axes
) -> tuple[Float[np.ndarray, "n m"], str]:
    """Convert numbers of a message to SI units and FLU axes; also say how."""
    values = np.where(np.isfinite(numbers), numbers, np.nan)
    if form in ("vector", "position"):
        whole = values if values.shape[1] == 3 else np.full((len(values), 3), np.nan)
        return vectors_to_flu(whole, axes), _turned_words(axes)
    if form in ("xyzw", "wxyz"):
        whole = values if values.shape[1] == 4 else np.full((len(values), 4), np.nan)
        wxyz = np.roll(whole, 1, axis=1) if form == "xyzw" else whole
        return attitude_to_flu(unit_or_nan(wxyz), axes), _turned_words(axes)
    if form == "outputs":
        return _motor_outputs(values)
    if form == "fraction":
        return _clip_fractions(values)
    if form == "rpm":
        return _until_last_used(np.abs(values) * _RPM), "rpm"
    if form == "rad/s":
        return _until_last_used(np.abs(values)), "rad/s"
    return values[:, :1], ""


def _turned_words(axes: Axes) -> str:
    return "turned from FRD" if axes == "FRD" else ""


def _until_last_used(values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n m"]:
    """Select the columns up to the last one that is ever other than zero."""
    used = np.flatnonzero((np.nan_to_num(values) != 0).any(axis=0))
    return values[:, : int(used[-1]) + 1 if len(used) else 0]


def _clip_fractions(values: Float[np.ndarray, "n k"]) -> tuple[Float[np.ndarray, "n m"], str]:
    """Clip commands to 0 to 1; motors that are stopped (NaN) command 0."""
    used = np.flatnonzero(np.isfinite(values).any(axis=0))
    kept = values[:, : int(used[-1]) + 1 if len(used) else 0]
    return np.clip(np.nan_to_num(kept), 0.0, 1.0), ""


def _motor_outputs(values: Float[np.ndarray, "n k"]) -> tuple[Float[np.ndarray, "n m"], str]:
    """Select the outputs that move, as commands: pulses from 1000 to 2000 us, or fractions."""
    known = np.nan_to_num(values)
    if len(known) == 0:
        return known[:, :0], ""
    moving = np.ptp(known, axis=0) > 0
    top = known.max(axis=0)
    pulses = moving & (top > _PULSE_RANGE[0]) & (top < _PULSE_RANGE[1])
    if pulses.any():
        low, high = _PULSE
        which = ", ".join(str(k + 1) for k in np.flatnonzero(pulses))
        return np.clip((known[:, pulses] - low) / (high - low), 0.0, 1.0), (
            f"outputs {which}, pulse widths taken from {low:.0f} to {high:.0f} us"
        )
    shares = moving & (top <= 1.0)
    which = ", ".join(str(k + 1) for k in np.flatnonzero(shares))
    return np.clip(known[:, shares], 0.0, 1.0), f"outputs {which}"


def chosen(
    found: Mapping[str, list[Candidate]], asked: Mapping[str, str]
) -> tuple[dict[str, Candidate], list[str]]:
    """Choose a topic for each channel, and notes on the others."""
    taken: dict[str, Candidate] = {}
    for name, topic in asked.items():
        taken[name] = _asked_for(name, topic, found.get(name, []))
    found, aims = _without_aims(found, taken)
    # Gyro and accelerometer come from one topic, and so do position and attitude, where one has
    # both.
    for pair in _PAIRS:
        _take_pair(pair, found, taken)
    for name, options in found.items():
        if name not in taken and (best := _best_candidate(name, options, taken)) is not None:
            taken[name] = best
    others = [
        note for name, one in taken.items() if (note := _unused_topics(name, one, found[name]))
    ]
    return taken, [*others, *aims]


def _without_aims(
    found: Mapping[str, list[Candidate]], taken: Mapping[str, Candidate]
) -> tuple[dict[str, list[Candidate]], list[str]]:
    """Select the candidates without set-points of what is measured, and notes on these."""
    kept, notes = dict(found), list[str]()
    for name in MEASURED:
        # Motors may be known by what was asked of them alone, and a topic that the user names is
        # taken.
        if name in taken or name not in found:
            continue
        aims = [option.topic for option in found[name] if is_aim(option)]
        kept[name] = [option for option in found[name] if not is_aim(option)]
        if aims and not kept[name]:
            notes.append(
                f"no {name}: {', '.join(aims[:_SHOWN])} is a set-point, what was asked for and not "
                f'what was measured; if it is not, choose it with columns = {{ {name} = "TOPIC" }}.'
            )
    return kept, notes


def _asked_for(name: str, topic: str, options: Iterable[Candidate]) -> Candidate:
    listed = list(options)
    for option in listed:
        if option.topic == topic:
            return option
    have = ", ".join(option.topic for option in listed[:_SHOWN]) or "none"
    raise LogError(f"no topic {topic!r} that gives {name}; those that do: {have}")


def _take_pair(
    pair: tuple[str, str], found: Mapping[str, list[Candidate]], taken: dict[str, Candidate]
) -> None:
    """Take both channels of a pair from the same topic, unless the user chose a topic."""
    a, b = pair
    if a in taken or b in taken:
        # The other one of the same topic goes with it.
        have, lacks = (a, b) if a in taken else (b, a)
        partner = [c for c in found.get(lacks, []) if c.topic == taken[have].topic]
        if lacks not in taken and partner:
            taken[lacks] = partner[0]
        return
    second = {option.topic: option for option in found.get(b, [])}
    both = [option for option in found.get(a, []) if option.topic in second]
    best = _best_candidate(a, both, taken)
    if best is not None:
        taken[a], taken[b] = best, second[best.topic]


def _best_candidate(
    name: str, options: Sequence[Candidate], taken: Mapping[str, Candidate]
) -> Candidate | None:
    """Select the candidate of the best kind, the fastest of these."""
    if name == "velocity":
        place = taken.get("position")
        options = [o for o in options if place is not None and o.topic == place.topic]
    fastest = max((o.rate for o in options), default=0.0)
    raw = name in IMU

    def merit(option: Candidate) -> tuple[int, bool, float]:
        is_raw = raw and "raw" in option.topic.lower() and option.rate > ALIKE * fastest
        return _rank_candidate(name, option), is_raw, option.rate

    return max(options, key=merit, default=None)


def _rank_candidate(name: str, option: Candidate) -> int:
    """Rank the kind of a topic for a channel."""
    words = option.topic.lower()
    merit = -4 if any(word in words for word in AIMS) else 0
    if name in ("position", "attitude", "velocity"):
        merit += 2 * any(word in words for word in CAMERAS)
        merit -= any(word in words for word in ESTIMATES) or "Odometry" in option.kind
        merit -= 2 * (option.kind == "sensor_msgs/Imu")
    if name in IMU:
        merit -= bool(ELSEWHERE & set(re.split(r"[^a-z0-9]+", words)))
    if name == "command":
        merit += option.kind in ("px4_msgs/ActuatorMotors", "mavros_msgs/RCOut")
    return merit


def is_aim(option: Candidate) -> bool:
    """Return whether a topic's name says that it is a set-point."""
    return any(word in option.topic.lower() for word in AIMS)


def _unused_topics(name: str, one: Candidate, options: Sequence[Candidate]) -> str:
    left = [f"{o.topic} ({o.rate:.0f} Hz)" for o in options if o.topic != one.topic]
    if not left:
        return ""
    shown = ", ".join(left[:_SHOWN]) + (" and more" if len(left) > _SHOWN else "")
    return (
        f"{name} is from {one.topic} ({one.rate:.0f} Hz); not used: {shown}; choose with columns = "
        f'{{ {name} = "TOPIC" }}.'
    )


_VECTORS = ("gyro", "accel", "velocity", "reference", "position")


def mapped_paths(topic: str, columns: Mapping[str, ColumnSpec]) -> dict[str, tuple[str, ...]]:
    """Return the paths in a topic's messages that a map names, by canonical name."""
    return {
        name: (spec.name.removeprefix(f"{topic}."),)
        for name, spec in columns.items()
        # The name of a topic may have dots; a path follows it after one.
        if spec.name.startswith(f"{topic}.")
    }


def mapped_channels(
    topics: Sequence[Recorded],
    clocks: Sequence[Timing],
    columns: Mapping[str, ColumnSpec],
    *,
    axes: Axes,
    motor_poles: int | None,
) -> dict[str, Channel]:
    """Return the channels of a map."""
    if not columns:
        return {}
    for name in columns:
        if quantity_of(name) is None or name == "time":
            raise LogError(
                f"the columns map names {name!r}; for a ROS recording it names channels (gyro, "
                "rotor_speed, ...) or columns of flight tables (gyro_x, rotor_1, ...)"
            )
    groups, _ = complete_groups(columns, columns)
    return {
        group.channel: _mapped_channel(group, topics, clocks, columns, axes, motor_poles)
        for group in groups
    }


def _mapped_channel(
    group: Group,
    topics: Sequence[Recorded],
    clocks: Sequence[Timing],
    columns: Mapping[str, ColumnSpec],
    axes: Axes,
    motor_poles: int | None,
) -> Channel:
    """Return one channel, its columns all from one topic."""
    recorded, timing = _home_topic(group, topics, clocks, columns)
    parts: list[np.ndarray] = []
    for name in group.names:
        spec = columns[name]
        to_si = conversion(
            group.quantity,
            unit_of(name, spec),
            motor_poles=motor_poles,
            recorded_range=spec.range,
        )
        values = to_si(recorded.values[name][:, 0] * spec.scale + spec.offset)
        parts.append(np.where(np.isfinite(values), values, np.nan))
    values = np.stack(parts, axis=1)
    if group.channel == "attitude":
        values = attitude_to_flu(attitude_from_euler(values) if group == EULER else values, axes)
    elif group.channel in _VECTORS:
        values = vectors_to_flu(values, axes)
    order = np.argsort(timing.time, kind="stable")
    paths = ", ".join(columns[name].name for name in group.names)
    return Channel(time=timing.time[order], values=values[order], source=f"{paths} (columns map)")


def _home_topic(
    group: Group,
    topics: Sequence[Recorded],
    clocks: Sequence[Timing],
    columns: Mapping[str, ColumnSpec],
) -> tuple[Recorded, Timing]:
    """Select the topic that has all columns of a channel."""
    for recorded, timing in zip(topics, clocks, strict=True):
        have = [name for name in group.names if recorded.values.get(name, _NONE).shape[1] == 1]
        if len(have) == len(group.names):
            return recorded, timing
    wanted = ", ".join(repr(columns[name].name) for name in group.names)
    raise LogError(
        f"no topic has all of {wanted}, which the columns map gives for {group.channel}: write "
        "TOPIC.path.to.number as `ros2 topic echo` shows it, all of one topic"
    )


_NONE = np.zeros((0, 0))
