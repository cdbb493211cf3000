"""The declared vehicle, payload, motors and columns as the types of other rooms, FLU and SI."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import ExperimentError
from rotorfit.fit.experiment.payload import PointMass
from rotorfit.flight.imu_tilt import ImuTilt
from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.logs import ColumnSpec, ReadOptions
from rotorfit.model.vehicle import Rotor, Vehicle

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rotorfit.fit.experiment.airframe_table import AirframeEntry, Axes, RotorEntry
    from rotorfit.fit.experiment.experiment import (
        ConfigurationEntry,
        Experiment,
        MotorsEntry,
        TableEntry,
    )
    from rotorfit.fit.experiment.flight_entries import (
        ColumnEntry,
        FlightEntry,
        RecordingEntry,
        Source,
    )
    from rotorfit.fit.experiment.strict_tables import Vector


def vehicle_of(airframe: AirframeEntry, source: Source = "imu") -> Vehicle:
    """Convert the ``[airframe]`` table to a vehicle, FLU.

    Motion capture measures at the body origin itself: where an IMU is given, its place only says
    that the rotors' positions are known from that origin, and it counts as there.

    Parameters
    ----------
    airframe
        Of an `Experiment`.
    source
        What measures the motion, ``"imu"`` or ``"mocap"``.
    """
    if airframe.layout is not None:
        rotors = airframe.of_layout()
    else:
        rotors = tuple(_convert_rotor(entry, airframe.axes) for entry in airframe.rotors or ())
    imu = airframe.imu
    place = None if imu is None else _convert_to_flu(imu.position, airframe.axes)
    if place is not None and source == "mocap":
        place = (0.0, 0.0, 0.0)
    return Vehicle(
        rotors=rotors,
        imu_position=place,
        imu_position_std=0.0 if imu is None or source == "mocap" else imu.position_std,
        arm_std=airframe.arm_std,
        propeller=airframe.propeller,
        tolerances=airframe.tolerances(),
    )


def imu_tilt_of(airframe: AirframeEntry) -> ImuTilt | None:
    """Return the declared mounting of the IMU; None if it is not declared."""
    if airframe.imu_tilt_deg is None:
        return None
    roll, pitch = np.radians(airframe.imu_tilt_deg).tolist()
    return ImuTilt(roll=roll, pitch=pitch)


def with_imu_tilt(experiment: Experiment, tilt: ImuTilt) -> Experiment:
    """Declare the mounting of the IMU in an experiment."""
    angles = (float(np.degrees(tilt.roll)), float(np.degrees(tilt.pitch)))
    airframe = experiment.airframe.model_copy(update={"imu_tilt_deg": angles})
    return experiment.model_copy(update={"airframe": airframe})


def payload_of(entry: ConfigurationEntry, axes: Axes) -> tuple[PointMass, ...]:
    """Convert the payload of a configuration to point masses, FLU."""
    return tuple(
        PointMass(
            mass=item.mass,
            position=_convert_to_flu(item.position, axes),
            mass_std=item.mass_std,
            position_std=item.position_std,
        )
        for item in entry.payload
    )


def motor_model_of(motors: MotorsEntry) -> MotorModel:
    """Convert the ``[motors]`` table to the model from motor channel to rotor speed.

    Parameters
    ----------
    motors
        The ``[motors]`` table of an `Experiment`.
    """
    return MotorModel(
        speed=motors.speed,
        law=motors.law,
        lag=motors.lag or 0.0,
        lag_down=motors.lag_down,
        delay=motors.delay,
        lag_on=motors.lag_on or "speed",
    )


def _convert_rotor(entry: RotorEntry, axes: Axes) -> Rotor:
    """Convert a rotor to FLU, its axis normalised; up by default in either convention."""
    up = (0.0, 0.0, 1.0)
    axis = up if entry.axis is None else _convert_to_flu(entry.axis, axes)
    length = sum(component**2 for component in axis) ** 0.5
    if length == 0:
        raise ExperimentError("a rotor's axis is (0, 0, 0); give the direction of its thrust")
    unit = (axis[0] / length, axis[1] / length, axis[2] / length)
    return Rotor(
        position=_convert_to_flu(entry.position, axes),
        spin=entry.spin,
        axis=unit,
        group=entry.group,
    )


def _convert_to_flu(vector: Vector, axes: Axes) -> Vector:
    """Convert a vector to FLU: FRD is half a turn about x from it."""
    x, y, z = vector
    return (x, -y, -z) if axes == "FRD" else vector


def read_options_of(flight: FlightEntry, motors: MotorsEntry) -> ReadOptions:
    """Convert the entry of a flight to the options of its log's reader."""
    return ReadOptions(
        log_number=flight.log,
        columns=_column_specs(flight.columns),
        axes=flight.axes,
        motor_poles=motors.poles,
    )


def table_options_of(entry: TableEntry, poles: int | None) -> ReadOptions:
    """Convert a ``[table]`` to the options of a table's reader."""
    return ReadOptions(columns=_column_specs(entry.columns), axes=entry.axes, motor_poles=poles)


def recording_options_of(recording: RecordingEntry) -> ReadOptions:
    """Convert the entry of a motion-capture file to the options of its reader."""
    return ReadOptions(columns=_column_specs(recording.columns), axes=recording.axes)


def _column_specs(entries: Mapping[str, ColumnEntry | str] | None) -> dict[str, ColumnSpec] | None:
    if entries is None:
        return None
    return {
        key: ColumnSpec(name=entry) if isinstance(entry, str) else ColumnSpec(**entry.model_dump())
        for key, entry in entries.items()
    }
