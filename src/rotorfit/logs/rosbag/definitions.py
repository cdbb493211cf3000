"""Message definitions: fields in their order, from the text that a recording holds.

The text is that of .msg files (wiki.ros.org/msg), those of the messages inside below it, after a
line of equals signs and ``MSG: package/Name``.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from rotorfit.errors import LogError
from rotorfit.logs.rosbag.stream import Encoding, kind_of

PRIMITIVES: Final[Mapping[str, str]] = {
    "bool": "u1",
    "byte": "i1",
    "char": "u1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}
"""Kind and size of each number, as in NumPy."""
STRING: Final = "string"
SEQUENCE: Final = -1

_LARGEST_TEXT: Final = 1 << 20
_LARGEST_ARRAY: Final = 1 << 16
_SEPARATOR: Final = re.compile(r"^={10,}$")
_FIELD: Final = re.compile(
    r"^(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?P<array>\[(?:<=\d+|\d*)\])?\s+(?P<name>[A-Za-z]\w*)\s*(?P<constant>=)?"
)
_TIMES: Final = ("time", "duration")


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One field of a message.

    Attributes
    ----------
    name
        Of the field.
    kind
        A primitive, ``string``, or a message as ``package/Name``.
    count
        None: one; `SEQUENCE`: as many as the message says; else so many.
    """

    name: str
    kind: str
    count: int | None


Types = Mapping[str, tuple[Field, ...]]


def types_of(kind: str, text: str, encoding: Encoding) -> dict[str, tuple[Field, ...]]:
    """Return the messages that a definition describes, by name.

    Parameters
    ----------
    kind
        Name of the first one.
    text
        The definition.
    encoding
        ROS 1 and ROS 2 differ in the header.

    Raises
    ------
    LogError
        If a line is no field, or the text is far longer than a definition is.
    """
    if len(text) > _LARGEST_TEXT:
        raise LogError(f"the definition of {kind} has {len(text)} characters: damaged")
    types = dict(_BUILT_IN[encoding])
    name, fields = kind, list[Field]()
    for line in text.splitlines():
        bare = line.partition("#")[0].strip()
        if not bare or _SEPARATOR.match(bare) or bare.startswith("@"):
            continue
        if bare.startswith("MSG:"):
            types[name] = tuple(fields)
            name, fields = kind_of(bare.removeprefix("MSG:").strip()), []
        elif (field := _field(bare, name)) is not None:
            fields.append(field)
    types[name] = tuple(fields)
    return types


def _field(line: str, owner: str) -> Field | None:
    """Return the field of a line; None for a constant."""
    found = _FIELD.match(line)
    if found is None:
        raise LogError(f"the definition of {owner[:80]} has the line {line[:80]!r}, no field")
    if found["constant"]:
        return None
    array = found["array"]
    count = None
    if array is not None:
        size = array[1:-1]
        count = int(size) if size.isdigit() else SEQUENCE
        if count > _LARGEST_ARRAY:
            raise LogError(f"the definition of {owner[:80]} has an array of {count}: damaged")
    return Field(name=found["name"], kind=_full_kind(found["type"], owner), count=count)


def _full_kind(kind: str, owner: str) -> str:
    if kind in PRIMITIVES or kind == STRING:
        return kind
    if kind in _TIMES:
        return "builtin_interfaces/Time"
    if kind == "Header":
        return "std_msgs/Header"
    return kind_of(kind) if "/" in kind else f"{owner.partition('/')[0]}/{kind}"


def _fields(text: str) -> tuple[Field, ...]:
    """Return fields written as ``type name, type name``."""
    found = (_field(line.strip(), "std_msgs/Header") for line in text.split(","))
    return tuple(field for field in found if field is not None)


_TIME: Final = _fields("int32 sec, uint32 nanosec")
_BUILT_IN: Final[Mapping[Encoding, Types]] = {
    "ros1": {
        "builtin_interfaces/Time": _TIME,
        "std_msgs/Header": _fields("uint32 seq, time stamp, string frame_id"),
    },
    "cdr": {
        "builtin_interfaces/Time": _TIME,
        "builtin_interfaces/Duration": _TIME,
        "std_msgs/Header": _fields("builtin_interfaces/Time stamp, string frame_id"),
    },
}

_POSE: Final = (
    "\nMSG: geometry_msgs/Pose\nPoint position\nQuaternion orientation\n"
    "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
    "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
)
_ESC_REPORT: Final = (
    "uint64 timestamp\nuint32 esc_errorcount\nint32 esc_rpm\nfloat32 esc_voltage\n"
    "float32 esc_current\n"
)
_ESC_STATUS: Final = (
    "uint64 timestamp\nuint16 counter\nuint8 esc_count\nuint8 esc_connectiontype\n"
    "uint8 esc_online_flags\nuint8 esc_armed_flags\nEscReport[8] esc\n"
    "MSG: px4_msgs/EscReport\n" + _ESC_REPORT
)
_SENSORS: Final = (
    "uint64 timestamp\nfloat32[3] gyro_rad\nuint32 gyro_integral_dt\n"
    "int32 accelerometer_timestamp_relative\nfloat32[3] accelerometer_m_s2\n"
    "uint32 accelerometer_integral_dt\nuint8 accelerometer_clipping\n"
)

KNOWN: Final[Mapping[str, tuple[str, ...]]] = {
    "sensor_msgs/Imu": (
        "Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance"
        + _POSE,
    ),
    "geometry_msgs/PoseStamped": ("Header header\nPose pose" + _POSE,),
    "geometry_msgs/PoseWithCovarianceStamped": (
        "Header header\nPoseWithCovariance pose\n"
        "MSG: geometry_msgs/PoseWithCovariance\nPose pose\nfloat64[36] covariance" + _POSE,
    ),
    "geometry_msgs/TransformStamped": (
        "Header header\nstring child_frame_id\nTransform transform\n"
        "MSG: geometry_msgs/Transform\nVector3 translation\nQuaternion rotation" + _POSE,
    ),
    "nav_msgs/Odometry": (
        "Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
        "geometry_msgs/TwistWithCovariance twist\n"
        "MSG: geometry_msgs/PoseWithCovariance\nPose pose\nfloat64[36] covariance\n"
        "MSG: geometry_msgs/TwistWithCovariance\nTwist twist\nfloat64[36] covariance\n"
        "MSG: geometry_msgs/Twist\nVector3 linear\nVector3 angular" + _POSE,
    ),
    # What follows the voltage differs between distributions and is not needed.
    "sensor_msgs/BatteryState": ("Header header\nfloat32 voltage",),
    "mavros_msgs/RCOut": ("Header header\nuint16[] channels",),
    "mavros_msgs/ESCStatus": (
        "Header header\nESCStatusItem[] esc_status\n"
        "MSG: mavros_msgs/ESCStatusItem\nHeader header\nint32 rpm\nfloat32 voltage\n"
        "float32 current",
    ),
    "mavros_msgs/ESCTelemetry": (
        "Header header\nESCTelemetryItem[] esc_telemetry\n"
        "MSG: mavros_msgs/ESCTelemetryItem\nHeader header\nfloat32 temperature\nfloat32 voltage\n"
        "float32 current\nfloat32 totalcurrent\nint32 rpm\nuint16 count",
    ),
    "mav_msgs/Actuators": (
        "Header header\nfloat64[] angles\nfloat64[] angular_velocities\nfloat64[] normalized",
    ),
    "px4_msgs/SensorCombined": (
        f"{_SENSORS}uint8 gyro_clipping\nuint8 accel_calibration_count\n"
        "uint8 gyro_calibration_count",
        _SENSORS,
    ),
    "px4_msgs/ActuatorMotors": (
        "uint64 timestamp\nuint64 timestamp_sample\nuint16 reversible_flags\nfloat32[12] control",
    ),
    "px4_msgs/ActuatorOutputs": ("uint64 timestamp\nuint32 noutputs\nfloat32[16] output",),
    "px4_msgs/EscStatus": (
        f"{_ESC_STATUS}float32 esc_temperature\nuint8 esc_address\nuint8 esc_cmdcount\n"
        "uint8 esc_state\nuint8 actuator_function\nuint16 failures\nint8 esc_power",
        f"{_ESC_STATUS}float32 esc_temperature\nint16 motor_temperature\nuint8 esc_state\n"
        "uint8 actuator_function\nuint16 failures\nint8 esc_power",
        f"{_ESC_STATUS}uint8 esc_temperature\nuint8 esc_address\nuint8 esc_state\nuint8 failures",
    ),
    "px4_msgs/VehicleOdometry": (
        "uint64 timestamp\nuint64 timestamp_sample\nuint8 pose_frame\nfloat32[3] position\n"
        "float32[4] q\nuint8 velocity_frame\nfloat32[3] velocity\nfloat32[3] angular_velocity\n"
        "float32[3] position_variance\nfloat32[3] orientation_variance\n"
        "float32[3] velocity_variance\nuint8 reset_counter\nint8 quality",
    ),
}
"""Messages that are read without a definition in the file, as in most ROS 2 bags before Jazzy.

Where a message changed, the variants; the one whose size is that of the messages is taken.
"""
