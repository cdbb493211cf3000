"""Writes simulated flights as ROS bags with the library rosbags, for tests."""

import dataclasses
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rotorfit.simulation import SimulatedFlight

EPOCH = 1_700_000_000 * 10**9
"""When every flight begins [ns]."""
LATE = 3_000_000
"""How much later a message is received than stamped [ns]."""
DEFINITIONS = {
    "mav_msgs/msg/Actuators": (
        "std_msgs/Header header\nfloat64[] angles\nfloat64[] angular_velocities\n"
        "float64[] normalized\n"
    ),
    "mavros_msgs/msg/ESCStatusItem": (
        "std_msgs/Header header\nint32 rpm\nfloat32 voltage\nfloat32 current\n"
    ),
    "mavros_msgs/msg/ESCStatus": "std_msgs/Header header\nESCStatusItem[] esc_status\n",
    "mavros_msgs/msg/RCOut": "std_msgs/Header header\nuint16[] channels\n",
    "mavros_msgs/msg/ActuatorControl": (
        "std_msgs/Header header\nuint8 group_mix\nfloat32[8] controls\n"
    ),
    "px4_msgs/msg/SensorCombined": (
        "uint64 timestamp\nint32 RELATIVE_TIMESTAMP_INVALID = 2147483647\nfloat32[3] gyro_rad\n"
        "uint32 gyro_integral_dt\nint32 accelerometer_timestamp_relative\n"
        "float32[3] accelerometer_m_s2\nuint32 accelerometer_integral_dt\n"
        "uint8 accelerometer_clipping\nuint8 gyro_clipping\nuint8 accel_calibration_count\n"
        "uint8 gyro_calibration_count\n"
    ),
    "px4_msgs/msg/ActuatorMotors": (
        "uint64 timestamp\nuint64 timestamp_sample\nuint16 reversible_flags\nfloat32[12] control\n"
    ),
    "px4_msgs/msg/ActuatorOutputs": "uint64 timestamp\nuint32 noutputs\nfloat32[16] output\n",
    "px4_msgs/msg/EscReport": (
        "uint64 timestamp\nuint32 esc_errorcount\nint32 esc_rpm\nfloat32 esc_voltage\n"
        "float32 esc_current\nfloat32 esc_temperature\nuint8 esc_address\nuint8 esc_cmdcount\n"
        "uint8 esc_state\nuint8 actuator_function\nuint16 failures\nint8 esc_power\n"
    ),
    "px4_msgs/msg/EscStatus": (
        "uint64 timestamp\nuint16 counter\nuint8 esc_count\nuint8 esc_connectiontype\n"
        "uint8 esc_online_flags\nuint8 esc_armed_flags\nEscReport[8] esc\n"
    ),
    "px4_msgs/msg/VehicleOdometry": (
        "uint64 timestamp\nuint64 timestamp_sample\nuint8 pose_frame\nfloat32[3] position\n"
        "float32[4] q\nuint8 velocity_frame\nfloat32[3] velocity\nfloat32[3] angular_velocity\n"
        "float32[3] position_variance\nfloat32[3] orientation_variance\n"
        "float32[3] velocity_variance\nuint8 reset_counter\nint8 quality\n"
    ),
}


@dataclasses.dataclass(frozen=True)
class Sent:
    """One message: topic, type, time of the data and of receipt [ns], and its fields."""

    topic: str
    kind: str
    stamp: int
    received: int
    fields: dict


def store_of(version: int):
    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


def message_of(store, version: int, kind: str, fields: dict, stamp: int):
    """A message of nested dictionaries; a header is filled in, what is left out is zero."""
    cls = store.types[kind]
    given = {}
    for name, (node, about) in store.fielddefs[kind][1]:
        value = fields.get(name)
        if name == "header":
            given[name] = header_of(store, version, stamp)
        elif node == 2:
            given[name] = message_of(store, version, about, value or {}, stamp)
        elif node in (3, 4) and about[0][0] == 2:
            count = about[1] if node == 3 else len(value or [])
            items = [*(value or []), *[{}] * count][:count]
            given[name] = [message_of(store, version, about[0][1], i, stamp) for i in items]
        elif node in (3, 4):
            base = about[0][1][0]
            size = about[1] if node == 3 else len(value if value is not None else [])
            full = np.zeros(size, dtype=np.dtype(base if base != "string" else object))
            full[: len(value if value is not None else [])] = [] if value is None else value
            given[name] = full
        elif about[0] == "string":
            given[name] = value or ""
        else:
            given[name] = value if value is not None else 0
    return cls(**given)


def header_of(store, version: int, stamp: int):
    time = store.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    extra = {"seq": 0} if version == 1 else {}
    return store.types["std_msgs/msg/Header"](stamp=time, frame_id="base_link", **extra)


def xyz(vector) -> dict:
    return dict(zip("xyz", map(float, vector), strict=True))


def messages_of(flight: SimulatedFlight, *, mocap: bool = True) -> Iterable[Sent]:
    """IMU, measured rotor speed and pose as ROS nodes would publish them."""
    stamps = EPOCH + np.round(1e9 * flight.time).astype(np.int64)
    for k, stamp in enumerate(stamps.tolist()):
        imu = {
            "angular_velocity": xyz(flight.gyro[k]),
            "linear_acceleration": xyz(flight.accel[k]),
        }
        yield Sent("/imu/data_raw", "sensor_msgs/msg/Imu", stamp, stamp + LATE, imu)
        speeds = {"angular_velocities": flight.rotor_speed_measured[k]}
        yield Sent("/motor_speed", "mav_msgs/msg/Actuators", stamp, stamp + LATE, speeds)
    if not mocap:
        return
    times = EPOCH + np.round(1e9 * flight.pose_time).astype(np.int64)
    for k, stamp in enumerate(times.tolist()):
        q = flight.attitude_wxyz_measured[k].tolist()
        orientation = dict(zip("wxyz", q, strict=True))
        pose = {"position": xyz(flight.position_measured[k]), "orientation": orientation}
        kind = "geometry_msgs/msg/PoseStamped"
        yield Sent("/vrpn/quad/pose", kind, stamp, stamp + LATE, {"pose": pose})


def write_ros1(flight: SimulatedFlight, path: Path) -> None:
    write_messages_ros1(messages_of(flight), path)


def write_ros2(flight: SimulatedFlight, path: Path) -> None:
    """A folder with a database and metadata.yaml."""
    write_messages_ros2(messages_of(flight), path)


def write_mcap(flight: SimulatedFlight, path: Path) -> None:
    """A folder with an MCAP file."""
    write_messages_ros2(messages_of(flight), path, storage=StoragePlugin.MCAP)


def write_messages_ros1(
    messages: Iterable[Sent], path: Path, *, compression: str | None = None
) -> None:
    store = store_of(1)
    with_format = Writer1(path)
    if compression:
        with_format.set_compression(getattr(Writer1.CompressionFormat, compression.upper()))
    with with_format as writer:
        connections = {}
        for sent in sorted(messages, key=lambda m: m.received):
            if sent.topic not in connections:
                connections[sent.topic] = writer.add_connection(
                    sent.topic, sent.kind, typestore=store
                )
            message = message_of(store, 1, sent.kind, sent.fields, sent.stamp)
            data = store.serialize_ros1(message, sent.kind)
            writer.write(connections[sent.topic], sent.received, data)


def write_messages_ros2(
    messages: Iterable[Sent],
    path: Path,
    *,
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    compression: str | None = None,
) -> None:
    store = store_of(2)
    writer2 = Writer2(path, version=9, storage_plugin=storage)
    if compression:
        mode = getattr(CompressionMode, compression.upper())
        writer2.set_compression(mode, CompressionFormat.ZSTD)
    with writer2 as writer:
        connections = {}
        for sent in sorted(messages, key=lambda m: m.received):
            if sent.topic not in connections:
                connections[sent.topic] = writer.add_connection(
                    sent.topic, sent.kind, typestore=store
                )
            message = message_of(store, 2, sent.kind, sent.fields, sent.stamp)
            data = store.serialize_cdr(message, sent.kind)
            writer.write(connections[sent.topic], sent.received, data)
