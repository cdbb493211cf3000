"""A simulated experiment as a folder of files, like a real one, and the truth beside them."""

import json
import shutil
from collections.abc import Callable, Mapping
from io import StringIO
from math import fsum
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rotorfit.errors import OutputError
from rotorfit.logs.files import write_whole
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
from rotorfit.simulation.sensors import SimulatedFlight
from rotorfit.simulation.truth import Truth
from rotorfit.simulation.views import POSE, LoggedChannel, column_names, to_flight_log

EXPERIMENT_FILE = "experiment.toml"
TRUTH_FILE = "truth.json"
SHARED = ("kt", "kd", "Jr", "motor_lag", "motor_delay")

Columns = dict[str, Float[np.ndarray, " n"]]


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
        columns |= _named(channel, cells)
    columns |= _named("command", _logged_command(plan, flight))
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


def _named(channel: str, values: Float[np.ndarray, "n k"]) -> Columns:
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
    """Write files beside their places first, then move all of them there, or none."""
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
