"""What each type of message gives: channel, where its numbers stand, unit and axes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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

    With `frd` its axes are FRD and north-east-down whatever the user says (PX4).
    """

    channels: Mapping[str, Quantity]
    frd: bool = False


_QUATERNION: Final = ("x", "y", "z", "w")


def _xyz(path: str) -> tuple[str, ...]:
    return tuple(f"{path}.{axis}" for axis in "xyz")


def _pose(position: str, orientation: str) -> dict[str, Quantity]:
    return {
        "position": Quantity(paths=_xyz(position), form="position"),
        "attitude": Quantity(
            paths=tuple(f"{orientation}.{axis}" for axis in _QUATERNION), form="xyzw"
        ),
    }


MESSAGES: Final[Mapping[str, MessageKind]] = {
    "sensor_msgs/Imu": MessageKind(
        channels={
            "gyro": Quantity(paths=_xyz("angular_velocity"), form="vector"),
            "accel": Quantity(paths=_xyz("linear_acceleration"), form="vector"),
            "attitude": Quantity(
                paths=tuple(f"orientation.{axis}" for axis in _QUATERNION), form="xyzw"
            ),
        }
    ),
    "geometry_msgs/PoseStamped": MessageKind(
        channels=_pose("pose.position", "pose.orientation"),
    ),
    "geometry_msgs/PoseWithCovarianceStamped": MessageKind(
        channels=_pose("pose.pose.position", "pose.pose.orientation"),
    ),
    "geometry_msgs/TransformStamped": MessageKind(
        channels=_pose("transform.translation", "transform.rotation"),
    ),
    "nav_msgs/Odometry": MessageKind(
        channels={
            **_pose("pose.pose.position", "pose.pose.orientation"),
            "velocity": Quantity(paths=_xyz("twist.twist.linear"), form="vector"),
        },
    ),
    "sensor_msgs/BatteryState": MessageKind(
        channels={"battery": Quantity(paths=("voltage",), form="volt")}
    ),
    "mavros_msgs/RCOut": MessageKind(
        channels={"command": Quantity(paths=("channels",), form="outputs")}
    ),
    "mavros_msgs/ESCStatus": MessageKind(
        channels={"rotor_speed": Quantity(paths=("esc_status[].rpm",), form="rpm")}
    ),
    "mavros_msgs/ESCTelemetry": MessageKind(
        channels={"rotor_speed": Quantity(paths=("esc_telemetry[].rpm",), form="rpm")}
    ),
    "mav_msgs/Actuators": MessageKind(
        channels={
            "rotor_speed": Quantity(paths=("angular_velocities",), form="rad/s"),
            "command": Quantity(paths=("normalized",), form="fraction"),
        }
    ),
    "px4_msgs/SensorCombined": MessageKind(
        channels={
            "gyro": Quantity(paths=("gyro_rad",), form="vector"),
            "accel": Quantity(paths=("accelerometer_m_s2",), form="vector"),
        },
        frd=True,
    ),
    "px4_msgs/ActuatorMotors": MessageKind(
        channels={"command": Quantity(paths=("control",), form="fraction")}, frd=True
    ),
    "px4_msgs/ActuatorOutputs": MessageKind(
        channels={"command": Quantity(paths=("output",), form="outputs")}, frd=True
    ),
    "px4_msgs/EscStatus": MessageKind(
        channels={"rotor_speed": Quantity(paths=("esc[].esc_rpm",), form="rpm")}, frd=True
    ),
    "px4_msgs/VehicleOdometry": MessageKind(
        channels={
            "position": Quantity(paths=("position",), form="position"),
            "attitude": Quantity(paths=("q",), form="wxyz"),
        },
        frd=True,
    ),
}
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
