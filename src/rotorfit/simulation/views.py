"""A simulated flight as the rest of rotorfit reads it: `FlightData`, `FlightLog`, flight table."""

from collections.abc import Sequence
from functools import reduce
from hashlib import sha256
from io import StringIO
from pathlib import Path
from typing import Final, Literal

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.errors import ExperimentError, OutputError
from rotorfit.logs.flight_log import Channel, FlightLog
from rotorfit.model.vehicle import Vehicle
from rotorfit.preprocessing.flight_data import FlightData, Segment
from rotorfit.simulation.sensors import SimulatedFlight, at_place

Place = Literal["origin", "imu"]
LoggedChannel = Literal[
    "gyro", "accel", "rotor_speed", "command", "velocity", "reference", "position", "attitude"
]

POSE = ("position", "attitude")
"""Channels on the clock of the motion capture."""


def exact_flight_data(
    flight: SimulatedFlight, vehicle: Vehicle, *, specific_force_at: Place = "origin"
) -> FlightData:
    """Collect exact states and derivatives while airborne; specific force at origin or IMU."""
    if vehicle.positions.shape[0] != flight.rotor_speed.shape[1]:
        raise ExperimentError(
            f"the flight has {flight.rotor_speed.shape[1]} rotors, the vehicle "
            f"{vehicle.positions.shape[0]}: hand over the vehicle that flew"
        )
    place = vehicle.imu_position if specific_force_at == "imu" else None
    w, dw = flight.angular_velocity, flight.angular_acceleration
    return FlightData(
        sample_rate=flight.sample_rate,
        time=flight.time,
        specific_force=at_place(flight.specific_force, w, dw, position=place or (0.0, 0.0, 0.0)),
        angular_velocity=w,
        angular_acceleration=dw,
        rotor_speed=flight.rotor_speed,
        rotor_acceleration=flight.rotor_acceleration,
        differentiation="exact",
        segments=runs(flight.airborne),
        velocity=flight.velocity_body,
    )


def sampled_flight_data(
    flight: SimulatedFlight, *, signals: Literal["exact", "measured"] = "exact"
) -> FlightData:
    """Collect samples with central differences while airborne; specific force at the IMU.

    The specific force is the one at the accelerometer's place. Nothing is filtered.
    """
    measured = signals == "measured"
    w = flight.gyro if measured else flight.angular_velocity
    speed = flight.rotor_speed_measured if measured else flight.rotor_speed
    sensors = flight.sensors
    std = float(np.hypot(sensors.rotor_speed_std, sensors.rotor_speed_resolution / 12**0.5))
    return FlightData(
        sample_rate=flight.sample_rate,
        time=flight.time,
        specific_force=flight.accel if measured else flight.specific_force_imu,
        angular_velocity=w,
        angular_acceleration=_central_difference(w, flight.sample_rate),
        rotor_speed=speed,
        rotor_acceleration=_central_difference(speed, flight.sample_rate),
        differentiation="central",
        segments=tuple(
            Segment(start=run.start + 1, stop=run.stop - 1)
            for run in runs(flight.airborne)
            if len(run) > 2
        ),
        rotor_speed_std=std if measured else 0.0,
        velocity=flight.velocity_body,
    )


def to_flight_log(
    flight: SimulatedFlight,
    *,
    channels: Sequence[LoggedChannel] = ("gyro", "accel", "rotor_speed", "command"),
) -> FlightLog:
    """Convert the measured flight to a log in memory, as if a reader had found it."""
    values = {name: _logged(flight, name) for name in channels}
    content = sha256(flight.time.tobytes())
    for table in values.values():
        content.update(np.ascontiguousarray(table).tobytes())
    steps = {
        "gyro": flight.sensors.gyro_resolution,
        "accel": flight.sensors.accel_resolution,
        "rotor_speed": flight.sensors.rotor_speed_resolution,
    }
    return FlightLog(
        path=Path("simulated"),
        sha256=content.hexdigest(),
        format="simulation",
        channels={
            name: Channel(
                time=flight.pose_time if name in POSE else flight.time,
                values=table,
                source=f"simulated {name}",
                resolution=steps.get(name) or None,
            )
            for name, table in values.items()
        },
        seconds=float(flight.time[-1] - flight.time[0]),
        metadata={"rotors": str(flight.rotor_speed.shape[1])},
    )


def runs(where: Bool[np.ndarray, " n"]) -> tuple[Segment, ...]:
    """Find the stretches of consecutive True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], where, [False]]).astype(int)))
    return tuple(
        Segment(start=int(a), stop=int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)
    )


def _logged(flight: SimulatedFlight, channel: LoggedChannel) -> Float[np.ndarray, "n k"]:
    """Return the measured values of a channel."""
    match channel:
        case "gyro":
            return flight.gyro
        case "accel":
            return flight.accel
        case "rotor_speed":
            return flight.rotor_speed_measured
        case "command":
            return flight.command
        case "velocity":
            return flight.velocity_body
        case "reference":
            return flight.reference
        case "position":
            return flight.position_measured
        case "attitude":
            return flight.attitude_wxyz_measured


def _central_difference(
    values: Float[np.ndarray, "n k"], sample_rate: float
) -> Float[np.ndarray, "n k"]:
    """Compute (x[n+1] - x[n-1]) / 2 dt; the end rows repeat their neighbours."""
    inner = (values[2:] - values[:-2]) * (sample_rate / 2)
    return np.concatenate([inner[:1], inner, inner[-1:]])


_COLUMNS: Final[dict[str, tuple[str, ...]]] = {
    "gyro": ("gyro_x", "gyro_y", "gyro_z"),
    "accel": ("accel_x", "accel_y", "accel_z"),
    "velocity": ("vel_x", "vel_y", "vel_z"),
    "reference": ("ref_x", "ref_y", "ref_z"),
    "position": ("pos_x", "pos_y", "pos_z"),
    "attitude": ("quat_w", "quat_x", "quat_y", "quat_z"),
}
_PER_ROTOR: Final = {"rotor_speed": "rotor", "command": "command"}

IMU_AND_SPEED: Final[tuple[LoggedChannel, ...]] = ("gyro", "accel", "rotor_speed")
IMU_AND_COMMAND: Final[tuple[LoggedChannel, ...]] = ("gyro", "accel", "command")


def flight_table(
    flight: SimulatedFlight, *, channels: Sequence[LoggedChannel] = IMU_AND_SPEED
) -> str:
    """Write the measured flight as a flight table (CSV); nan where a channel has no sample.

    Where a channel has no sample at the time of a row, its cells hold nan.
    """
    log = to_flight_log(flight, channels=channels)
    time = reduce(np.union1d, [recorded.time for recorded in log.channels.values()])
    names, columns = ["time"], [time[:, None]]
    for channel, recorded in log.channels.items():
        names += column_names(channel, recorded.values.shape[1])
        cells = np.full((len(time), recorded.values.shape[1]), np.nan)
        cells[np.searchsorted(time, recorded.time)] = recorded.values
        columns.append(cells)
    text = StringIO()
    np.savetxt(
        text, np.hstack(columns), fmt="%.12g", delimiter=",", header=",".join(names), comments=""
    )
    return text.getvalue()


def write_flight_table(
    flight: SimulatedFlight, path: Path, *, channels: Sequence[LoggedChannel] = IMU_AND_SPEED
) -> None:
    """Write a flight as measured to a new flight table (CSV)."""
    try:
        with path.open("x", encoding="utf-8", newline="\n") as file:
            file.write(flight_table(flight, channels=channels))
    except FileExistsError as error:
        raise OutputError(f"{path} exists: give another name or remove it first") from error
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror}") from error


def column_names(channel: str, columns: int) -> list[str]:
    """List the names of a channel's columns in a flight table."""
    if channel in _PER_ROTOR:
        return [f"{_PER_ROTOR[channel]}_{number}" for number in range(1, columns + 1)]
    return list(_COLUMNS[channel])
