"""What each type of message gives, as `messages.toml` beside this module has it.

Channels, where their numbers stand, units and axes; all without rosbags, which may not be there.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

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
Rank = Literal["mocap", "estimate", "sensor", "outputs"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """Numbers of one channel in a message, by paths as of `definitions.taken_by`."""

    paths: tuple[str, ...]
    form: Form


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageKind:
    """A type of message that is read, by channels.

    With `frd` its axes are FRD and north-east-down whatever the user says (PX4). Of several
    `definitions` for files that hold none, the one whose size is that of the messages is taken.
    """

    channels: Mapping[str, Quantity]
    frd: bool
    definitions: tuple[str, ...]


def _read() -> dict[str, MessageKind]:
    """Read the table beside this module."""
    text = Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
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


MESSAGES: Final[Mapping[str, MessageKind]] = _read()
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
"""In the name of a topic: what should be, not what is."""
CAMERAS: Final = ("mocap", "vicon", "vrpn", "optitrack", "natnet", "qualisys", "qtm", "motion_cap")
ESTIMATES: Final = ("local_position", "estimat", "odom", "ekf", "fused", "slam", "vio", "gps")
