"""Writes ULog files as PX4's logger does, for tests; its own line from docs.px4.io."""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rotorfit.model.vehicle import Vehicle
from rotorfit.simulation import SimulatedFlight

MAGIC = b"ULog\x01\x12\x35"
SYNC = bytes.fromhex("2f731320250cbb12")
TYPES = {
    "uint64_t": "<u8",
    "int64_t": "<i8",
    "uint32_t": "<u4",
    "int32_t": "<i4",
    "uint16_t": "<u2",
    "int16_t": "<i2",
    "uint8_t": "u1",
    "int8_t": "i1",
    "bool": "u1",
    "char": "u1",
    "float": "<f4",
    "double": "<f8",
}
FLIP = np.array([1.0, -1.0, -1.0])
BOOT = 12.5
"""When a log of a flight begins [s]."""

SENSOR_COMBINED = (
    "uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
    "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;"
    "uint32_t accelerometer_integral_dt;uint8_t accelerometer_clipping;uint8_t gyro_clipping;"
    "uint8_t accel_calibration_count;uint8_t gyro_calibration_count;"
)
ESC_REPORT = (
    "uint64_t timestamp;uint32_t esc_errorcount;int32_t esc_rpm;float esc_voltage;"
    "float esc_current;float esc_temperature;uint16_t failures;uint8_t esc_address;"
    "uint8_t esc_cmdcount;uint8_t esc_state;uint8_t actuator_function;int8_t esc_power;"
    "uint8_t[5] _padding0;"
)
ESC_STATUS = (
    "uint64_t timestamp;uint16_t counter;uint8_t esc_count;uint8_t esc_connectiontype;"
    "uint8_t esc_online_flags;uint8_t esc_armed_flags;uint8_t[2] _padding0;esc_report[8] esc;"
)
ACTUATOR_MOTORS = (
    "uint64_t timestamp;uint64_t timestamp_sample;float[12] control;uint16_t reversible_flags;"
    "uint8_t[6] _padding0;"
)
ACTUATOR_OUTPUTS = "uint64_t timestamp;uint32_t noutputs;float[16] output;uint8_t[4] _padding0;"
ACTUATOR_ARMED = "uint64_t timestamp;bool armed;bool prearmed;uint8_t[6] _padding0;"
LAND_DETECTED = "uint64_t timestamp;bool freefall;bool landed;uint8_t[6] _padding0;"
BATTERY_STATUS = "uint64_t timestamp;float voltage_v;float current_a;"
LOCAL_POSITION = (
    "uint64_t timestamp;float vx;float vy;float vz;bool v_xy_valid;bool v_z_valid;"
    "uint8_t[2] _padding0;"
)
ATTITUDE = "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;"
ODOMETRY = (
    "uint64_t timestamp;uint64_t timestamp_sample;float[3] position;float[4] q;float[3] velocity;"
    "uint8_t pose_frame;uint8_t velocity_frame;uint8_t[6] _padding0;"
)
FORMATS = {
    "sensor_combined": SENSOR_COMBINED,
    "esc_report": ESC_REPORT,
    "esc_status": ESC_STATUS,
    "actuator_motors": ACTUATOR_MOTORS,
    "actuator_outputs": ACTUATOR_OUTPUTS,
    "actuator_armed": ACTUATOR_ARMED,
    "vehicle_land_detected": LAND_DETECTED,
    "battery_status": BATTERY_STATUS,
    "vehicle_rates_setpoint": "uint64_t timestamp;float roll;float pitch;float yaw;",
    "vehicle_local_position": LOCAL_POSITION,
    "vehicle_attitude": ATTITUDE,
    "vehicle_mocap_odometry": ODOMETRY,
    "vehicle_visual_odometry": ODOMETRY,
}


@dataclass(frozen=True, kw_only=True)
class Logged:
    """The messages of one topic: its times [s], and its fields by name (nested by a dot)."""

    name: str
    time: np.ndarray
    fields: Mapping[str, object]
    instance: int = 0
    format: str = ""


@dataclass(frozen=True, kw_only=True)
class Parts:
    """What else a file has."""

    parameters: Mapping[str, float | int] = field(default_factory=dict)
    system_defaults: Mapping[str, float | int] = field(default_factory=dict)
    airframe_defaults: Mapping[str, float | int] = field(default_factory=dict)
    changes: Sequence[tuple[float, str, float | int]] = ()
    dropouts: Sequence[tuple[float, int]] = ()
    info: Mapping[str, str | int] = field(default_factory=dict)
    sync_every: int = 50
    flags: bytes = bytes(40)


def message(kind: str, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), ord(kind)) + content


def encode(topics: Sequence[Logged], parts: Parts | None = None, *, start: float = 0.0) -> bytes:
    """Return a whole file, its data messages in order of time."""
    parts = parts or Parts()
    blocks = [MAGIC + b"\x01" + struct.pack("<Q", round(1e6 * start)), message("B", parts.flags)]
    formats = {**FORMATS, **{t.name: t.format for t in topics if t.format}}
    needed = {t.name for t in topics} | {"esc_report"}
    blocks += [message("F", f"{n}:{f}".encode()) for n, f in formats.items() if n in needed]
    blocks += [message("I", _info(key, value)) for key, value in parts.info.items()]
    blocks += [message("P", _value(key, value)) for key, value in parts.parameters.items()]
    for bits, defaults in ((1, parts.system_defaults), (2, parts.airframe_defaults)):
        blocks += [message("Q", bytes([bits]) + _value(k, v)) for k, v in defaults.items()]
    for number, topic in enumerate(topics):
        content = struct.pack("<BH", topic.instance, number) + topic.name.encode()
        blocks.append(message("A", content))
    timed = [(t, data) for n, topic in enumerate(topics) for t, data in _data(topic, n, formats)]
    timed += [(t, message("P", _value(key, value))) for t, key, value in parts.changes]
    timed += [(t, message("O", struct.pack("<H", ms))) for t, ms in parts.dropouts]
    for count, (_, data) in enumerate(sorted(timed, key=lambda item: item[0])):
        if parts.sync_every and count % parts.sync_every == 0:
            blocks.append(message("S", SYNC))
        blocks.append(data)
    return b"".join(blocks)


def _info(key: str, value: str | int) -> bytes:
    if isinstance(value, int):
        return _key("uint32_t", key) + struct.pack("<I", value)
    return _key(f"char[{len(value)}]", key) + value.encode()


def _value(key: str, value: float | int) -> bytes:
    if isinstance(value, int):
        return _key("int32_t", key) + struct.pack("<i", value)
    return _key("float", key) + struct.pack("<f", value)


def _key(kind: str, key: str) -> bytes:
    text = f"{kind} {key}".encode()
    return bytes([len(text)]) + text


def _layout(formats: Mapping[str, str], name: str, *, padded: bool) -> np.dtype:
    """Return the type of a message; the padding at its end is not written."""
    parts = [field.split(" ") for field in formats[name].split(";") if field]
    while not padded and parts[-1][1].startswith("_padding"):
        parts.pop()
    listed = []
    for kind, field_name in parts:
        base, _, rest = kind.partition("[")
        inner = np.dtype(TYPES[base]) if base in TYPES else _layout(formats, base, padded=True)
        listed.append((field_name, inner, (int(rest[:-1]),)) if rest else (field_name, inner))
    return np.dtype(listed)


def _data(topic: Logged, number: int, formats: Mapping[str, str]) -> list[tuple[float, bytes]]:
    rows = np.zeros(len(topic.time), dtype=_layout(formats, topic.name, padded=False))
    rows["timestamp"] = np.round(1e6 * topic.time)
    for name, values in topic.fields.items():
        outer, _, inner = name.partition(".")
        target = rows[outer][inner] if inner else rows[outer]
        values = np.asarray(values)
        if target.ndim == 2 and values.ndim == 2:
            target[:, : values.shape[1]] = values
        else:
            target[...] = values
    head = struct.pack("<HBH", 2 + rows.dtype.itemsize, ord("D"), number)
    return [(float(t), head + row.tobytes()) for t, row in zip(topic.time, rows, strict=True)]


# Topics


def sensor_combined(time, gyro, accel, *, relative=0) -> Logged:
    """FLU rates and forces as FRD."""
    fields = {
        "gyro_rad": np.asarray(gyro) * FLIP,
        "accelerometer_m_s2": np.asarray(accel) * FLIP,
        "accelerometer_timestamp_relative": relative,
    }
    return Logged(name="sensor_combined", time=np.asarray(time), fields=fields)


def esc_status(time, rotor_speed, *, reported=None, functions=None, signs=None) -> Logged:
    """Rotor speeds [rad/s] as whole rpm, the ESCs in the order of the motors or of `functions`."""
    speed = np.asarray(rotor_speed, dtype=float)
    count = speed.shape[1]
    rpm = np.zeros((len(time), 8))
    rpm[:, :count] = np.round(speed * 60 / (2 * np.pi)) * (signs or [1] * count)
    stamps = np.zeros((len(time), 8))
    stamps[:, :count] = np.round(
        1e6 * (np.asarray(time)[:, None] if reported is None else reported)
    )
    motors = np.zeros(8)
    motors[:count] = functions or range(101, 101 + count)
    fields = {
        "esc.esc_rpm": rpm,
        "esc.timestamp": stamps,
        "esc.actuator_function": motors,
        "esc_count": count,
    }
    return Logged(name="esc_status", time=np.asarray(time), fields=fields)


def actuator_motors(time, thrust) -> Logged:
    """Relative thrusts; the motors that are not there are NaN."""
    control = np.full((len(time), 12), np.nan)
    control[:, : np.shape(thrust)[1]] = thrust
    return Logged(name="actuator_motors", time=np.asarray(time), fields={"control": control})


def actuator_outputs(time, output, *, instance=0) -> Logged:
    fields = {"output": np.asarray(output), "noutputs": np.shape(output)[1]}
    return Logged(name="actuator_outputs", time=np.asarray(time), fields=fields, instance=instance)


def armed(time, state) -> Logged:
    return Logged(name="actuator_armed", time=np.asarray(time), fields={"armed": state})


def landed(time, state) -> Logged:
    return Logged(name="vehicle_land_detected", time=np.asarray(time), fields={"landed": state})


def mocap(time, position, attitude_wxyz, *, name="vehicle_mocap_odometry", frame=1) -> Logged:
    """A pose with z up and FLU axes as NED and FRD."""
    fields = {
        "timestamp_sample": np.round(1e6 * np.asarray(time)),
        "position": np.asarray(position) * FLIP,
        "q": np.asarray(attitude_wxyz) * np.concatenate([[1.0], FLIP]),
        "pose_frame": frame,
    }
    return Logged(name=name, time=np.asarray(time), fields=fields)


# A simulated flight


def geometry(vehicle: Vehicle) -> dict[str, float | int]:
    """Return a vehicle's rotors as CA_ROTOR parameters: FRD, thrust downwards negative."""
    found: dict[str, float | int] = {"CA_ROTOR_COUNT": len(vehicle.rotors), "CA_AIRFRAME": 0}
    for i, rotor in enumerate(vehicle.rotors):
        for axis, place, thrust, sign in zip("XYZ", rotor.position, rotor.axis, FLIP, strict=True):
            found[f"CA_ROTOR{i}_P{axis}"] = float(sign * place)
            found[f"CA_ROTOR{i}_A{axis}"] = float(sign * thrust)
        found[f"CA_ROTOR{i}_KM"] = 0.05 if rotor.spin == "ccw" else -0.05
    return found


def flight_topics(flight: SimulatedFlight) -> list[Logged]:
    """Return what PX4 would log of a simulated flight at its sample rate.

    The commands are fractions of full speed; with THR_MDL_FAC = 1 their squares are thrusts.
    """
    time = BOOT + flight.time
    slow = time[:: max(int(flight.sample_rate / 10), 1)]
    last = np.array([time[0], time[-1]])
    q = flight.attitude_wxyz * np.concatenate([[1.0], FLIP])
    velocity = dict(zip(("vx", "vy", "vz"), (flight.velocity * FLIP).T, strict=True))
    return [
        sensor_combined(time, flight.gyro, flight.accel),
        esc_status(time, flight.rotor_speed_measured),
        actuator_motors(time, flight.command**2),
        armed(last, True),
        landed(np.concatenate([last[:1] - 1, last]), [True, False, False]),
        Logged(name="battery_status", time=slow, fields={"voltage_v": 15.8}),
        Logged(
            name="vehicle_local_position",
            time=time,
            fields={**velocity, "v_xy_valid": True, "v_z_valid": True},
        ),
        Logged(name="vehicle_attitude", time=time, fields={"q": q}),
        mocap(BOOT + flight.pose_time, flight.position_measured, flight.attitude_wxyz_measured),
    ]


def write_ulog(flight: SimulatedFlight, path: Path) -> None:
    """Write a simulated flight as PX4 would log it; speeds are whole rpm, numbers single."""
    parameters = {**geometry(flight.vehicle), "THR_MDL_FAC": 1.0, "SYS_AUTOSTART": 4050}
    info = {"ver_sw_release": 0x011001FF, "ver_hw": "PX4_FMU_V6X", "sys_name": "PX4"}
    parts = Parts(parameters=parameters, info=info)
    path.write_bytes(encode(flight_topics(flight), parts, start=BOOT))
