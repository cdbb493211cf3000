"""Write a simulated flight as `FlightData`, `FlightLog`, a flight table, an experiment's folder.

The folder is like a real one, with the truth in a file of its own.
"""

from __future__ import annotations

import json
import shutil
from functools import reduce
from hashlib import sha256
from io import StringIO
from math import fsum
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.errors import ExperimentError, OutputError
from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.logs.files import write_whole
from rotorfit.logs.flight_log import Channel, FlightLog
from rotorfit.simulation.experiments import (
    LAW,
    SECONDS,
    ExperimentPlan,
    FlownConfiguration,
    Quality,
    ScenarioName,
    battery_volts,
    command_of,
    fly,
    plan_experiment,
    planned_flights,
)
from rotorfit.simulation.sensors import SimulatedFlight, at_place

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from jaxtyping import Bool, Float

    from rotorfit.model.vehicle import Vehicle
    from rotorfit.simulation.truth import Truth

    Columns = dict[str, Float[np.ndarray, " n"]]

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
    """Collect airborne samples with central differences, unfiltered; force at the IMU."""
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
        velocity=flight.velocity_measured if measured else flight.velocity_body,
    )


def to_flight_log(
    flight: SimulatedFlight,
    *,
    channels: Sequence[LoggedChannel] = ("gyro", "accel", "rotor_speed", "command"),
) -> FlightLog:
    """Convert the measured flight to a log in memory, as if a reader had found it."""
    values = {name: _logged_values(flight, name) for name in channels}
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


def _logged_values(flight: SimulatedFlight, channel: LoggedChannel) -> Float[np.ndarray, "n k"]:
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
            return flight.velocity_measured
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
    """Write the measured flight as a flight table (CSV); nan where a channel has no sample."""
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


EXPERIMENT_FILE = "experiment.toml"
TRUTH_FILE = "truth.json"
SHARED = ("kt", "kd", "Jr", "motor_lag", "motor_delay")


def file_names(plan: ExperimentPlan) -> list[str]:
    """List the names of all files of an experiment."""
    return [*(flight.file for flight in planned_flights(plan)), EXPERIMENT_FILE, TRUTH_FILE]


def experiment_files(
    plan: ExperimentPlan, *, progress: Callable[[str], None] | None = None
) -> dict[str, str]:
    """Fly an experiment, and return its files by their names; `progress` gets a few words."""
    files: dict[str, str] = {}
    flights = planned_flights(plan)
    for number, flight in enumerate(flights, start=1):
        if progress is not None:
            progress(f"simulating flight {number} of {len(flights)}, {flight.file}")
        files[flight.file] = table_text(plan, fly(plan, flight))
    files[EXPERIMENT_FILE] = experiment_text(plan)
    files[TRUTH_FILE] = json.dumps(true_values(plan), indent=1) + "\n"
    return files


def table_text(plan: ExperimentPlan, flight: SimulatedFlight) -> str:
    """Write a flight as a flight table (CSV); cells without a sample are empty."""
    channels: tuple[LoggedChannel, ...] = ("gyro", "accel")
    if plan.measures_speed:
        channels = (*channels, "rotor_speed")
    columns: Columns = {"time": flight.time}
    for channel, recorded in to_flight_log(flight, channels=(*channels, *POSE)).channels.items():
        cells = np.full((len(flight.time), recorded.values.shape[1]), np.nan)
        # Frames of the motion capture fall on samples of the IMU: its rate divides theirs.
        cells[np.searchsorted(flight.time, recorded.time)] = recorded.values
        columns |= _name_columns(channel, cells)
    columns |= _name_columns("command", _logged_command(plan, flight))
    if plan.measures_speed:
        columns["battery"] = battery_volts(flight)
    text = StringIO()
    table = np.column_stack(list(columns.values()))
    np.savetxt(text, table, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
    return text.getvalue().replace("nan", "")


def _logged_command(plan: ExperimentPlan, flight: SimulatedFlight) -> Float[np.ndarray, "n N"]:
    """Return the command as the variant logs it, 0 to 1."""
    if plan.quality == "clean":
        return command_of(flight.rotor_speed)
    if plan.measures_speed:
        return command_of(flight.commanded_speed, battery_volts(flight))
    return command_of(flight.commanded_speed)


def _name_columns(channel: str, values: Float[np.ndarray, "n k"]) -> Columns:
    return dict(zip(column_names(channel, values.shape[1]), values.T, strict=True))


def experiment_text(plan: ExperimentPlan) -> str:
    """Write the experiment file that a user would write for these flights."""
    vehicle = plan.configurations[0].simulated.vehicle
    rotors = "\n".join(
        f'  {{ position = {list(rotor.position)}, spin = "{rotor.spin}" }},'
        for rotor in vehicle.rotors
    )
    head = f"""\
# Simulated: rotorfit simulate {plan.scenario} --variant {plan.quality} --seed {plan.seed}
name = "{plan.scenario}-{plan.quality}"

[airframe]
axes = "FLU"
rotors = [
{rotors}
]
imu = {{ position = {list(vehicle.imu_position or (0.0, 0.0, 0.0))} }}

[motors]
{_motors_text(plan)}

[identification]
method = "banded"
"""
    return "\n".join([head, *(_configuration_text(c) for c in plan.configurations)])


def _motors_text(plan: ExperimentPlan) -> str:
    if plan.measures_speed:
        return 'speed = "measured"'
    lines = [
        'speed = "commanded"',
        f"law = {{ polynomial = {list(LAW)} }}  # rad/s of a command from 0 to 1",
    ]
    if plan.states_lag:
        lag, delay = plan.lag_of_log
        lines += [f"lag = {lag}", f"delay = {delay}"]
    return "\n".join(lines)


def _configuration_text(configuration: FlownConfiguration) -> str:
    weight = f"weight = {configuration.weight}\n" if configuration.weight != 1.0 else ""
    return f"""\
[[configuration]]
name = "{configuration.name}"
mass = {configuration.simulated.truth.mass:.10g}
{weight}flights = ["{configuration.name}1.csv"]
validation = ["{configuration.name}2.csv"]
"""


def true_values(plan: ExperimentPlan) -> dict[str, object]:
    """Collect the truth by the names in results: what is shared, and each configuration's own."""
    shared: dict[str, float] = {}
    own: dict[str, dict[str, float]] = {}
    for c in plan.configurations:
        values = configuration_truth(plan, c)
        shared |= {name: v for name, v in values.items() if name in SHARED or name[:3] == "kt_"}
        own[c.name] = {name: v for name, v in values.items() if name not in shared}
    return {
        "scenario": plan.scenario,
        "variant": plan.quality,
        "seed": plan.seed,
        "shared": shared,
        "configurations": own,
    }


def configuration_truth(plan: ExperimentPlan, flown: FlownConfiguration) -> dict[str, float]:
    """Collect everything that is true of one configuration, its sensors and its log included."""
    truth, vehicle = flown.simulated
    values = true_parameters(truth, rotors=len(vehicle.rotors))
    values |= zip(("motor_lag", "motor_delay"), plan.lag_of_log, strict=True)
    names = ("accel_bias_x", "accel_bias_y", "accel_bias_z")
    return values | dict(zip(names, flown.sensors.accel_bias, strict=True))


def true_parameters(truth: Truth, *, rotors: int) -> dict[str, float]:
    """Collect the parameters of a vehicle and the numbers derived from them; kt is the mean."""
    values = truth.parameters()
    rotor_kt: list[float] = truth.rotor_kt(rotors).tolist()
    values["kt"] = fsum(rotor_kt) / rotors
    values |= {f"kt_{number}": kt for number, kt in enumerate(rotor_kt, start=1)}
    values |= {f"com_{axis}": values[f"ms{axis}"] / truth.mass for axis in "xyz"}
    values["kd_over_Izz"] = values["kd"] / values["Izz_com"]
    values["Jr_over_Izz"] = values["Jr"] / values["Izz_com"]
    return values


def simulate(
    folder: Path,
    scenario: ScenarioName,
    variant: Quality = "real",
    *,
    seed: int = 1,
    seconds: float = SECONDS,
    force: bool = False,
) -> Path:
    """Fly an experiment of known truth, and write its logs and its experiment file.

    Parameters
    ----------
    folder
        Made where it is missing.
    scenario
        ``"paper"``: the experiment of Six et al. 2020. ``"single"``: one quad-x. ``"hexa"``: one
        hexa-x. ``"payload-pair"``: the quad-x bare, and with 0.1 kg at both ends of one arm.
    variant
        ``"clean"``: perfect sensors, motors as commanded. ``"lag"``: with the motors' lag.
        ``"noisy"``: and noise and bias of all sensors. ``"real"``: and gusts, drag, rotor inertia,
        unequal rotors, a battery that sags.
    seed
        The same seed gives the same files.
    seconds
        Of each flight between take-off and landing [s].
    force
        Replace files that are there.

    Returns
    -------
    Path
        The experiment file; the truth is beside it, in ``truth.json``.

    Raises
    ------
    ExperimentError
        If the flights would be too short to identify anything.
    OutputError
        If the folder holds some of the files and `force` is false, or cannot be written.
    """
    plan = plan_experiment(scenario, variant, seed=seed, seconds=seconds)
    there = [name for name in file_names(plan) if (folder / name).exists()]
    if there and not force:
        raise OutputError(
            f"{folder} already holds {', '.join(there)}; name another folder, or force"
        )
    files = experiment_files(plan)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder} cannot be made a folder ({error}); name another") from error
    write_all(folder, files)
    return folder / EXPERIMENT_FILE


def write_all(folder: Path, files: Mapping[str, str]) -> None:
    """Write temporary files first, then move all of them into place, or none."""
    unfinished = folder / ".unfinished"
    try:
        unfinished.mkdir(exist_ok=True)
        for name, content in files.items():
            write_whole(unfinished / name, content, force=True)
        for name in files:
            (unfinished / name).replace(folder / name)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{folder}: cannot be written ({reason}); name another") from error
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
