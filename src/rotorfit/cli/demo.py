"""rotorfit demo: fly a simulated quadrotor, identify it, print the estimate beside the truth."""

import json
import math
import tempfile
from pathlib import Path

from rotorfit.cli.identify import quiet_identify
from rotorfit.cli.outputs import refuse_output_folder
from rotorfit.cli.terminal import say, show
from rotorfit.identification.experiment import load_experiment
from rotorfit.identification.result import Derived, IdentificationResult, Parameter
from rotorfit.logs.files import write_whole
from rotorfit.model.vehicle import Vehicle
from rotorfit.report.text import result_text, with_interval
from rotorfit.simulation import (
    Scenario,
    SimulatedFlight,
    Truth,
    flight_table,
    paper_vehicle,
    simulate_flight,
    variant,
)

SECONDS = 60.0
GROUND_SECONDS = 3.0
FILES = ("flight.csv", "experiment.toml", "truth.json", "result.json")
SHOWN = (
    *("kt", "kd_over_Izz", "Jr_over_Izz"),
    *("com_x", "com_y", "com_z", "Ixx_com", "Iyy_com"),
)


def run(output: Path | None, *, seed: int, force: bool, as_json: bool) -> None:
    """Fly, write the files, identify from them, and print."""
    if output is not None:
        _demonstrate(output, seed=seed, force=force, as_json=as_json)
        say(f"wrote {', '.join(FILES)} to {output}")
        return
    with tempfile.TemporaryDirectory() as folder:
        _demonstrate(Path(folder), seed=seed, force=True, as_json=as_json)


def _demonstrate(folder: Path, *, seed: int, force: bool, as_json: bool) -> None:
    refuse_output_folder(folder, FILES, force=force)
    say(f"flying a simulated quadrotor for {SECONDS:.0f} s ...")
    truth, vehicle, flight = _flown(seed)
    experiment = folder / "experiment.toml"
    write_whole(folder / "flight.csv", flight_table(flight), force=force)
    write_whole(experiment, _experiment_text(truth, vehicle), force=force)
    # The truth goes to a file of its own, which identify never reads.
    write_whole(folder / "truth.json", json.dumps(true_values(truth), indent=1) + "\n", force=force)
    result = quiet_identify(load_experiment(experiment))
    result.save(folder / "result.json", force=force)
    if as_json:
        show(result.to_json().rstrip())
        return
    show(result_text(result))
    show(_beside(result, true_values(truth)))


def _flown(seed: int) -> tuple[Truth, Vehicle, SimulatedFlight]:
    """Fly the paper's vehicle with everything that real ones have against them.

    Rotor inertia, unequal rotors, drag, gusts, a biased accelerometer, sensor noise.
    """
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(seconds=SECONDS, ground_seconds=GROUND_SECONDS, sensors=sensors)
    return truth, vehicle, simulate_flight(truth, vehicle, scenario, seed=seed)


def true_values(truth: Truth) -> dict[str, float]:
    """Return the parameters that flew, with the numbers derived from them."""
    values = truth.parameters()
    values |= {f"com_{axis}": values[f"ms{axis}"] / truth.mass for axis in "xyz"}
    values["kt"] *= math.fsum(truth.kt_spread) / max(len(truth.kt_spread), 1) or 1.0
    values["kd_over_Izz"] = values["kd"] / values["Izz_com"]
    values["Jr_over_Izz"] = values["Jr"] / values["Izz_com"]
    return values


def _experiment_text(truth: Truth, vehicle: Vehicle) -> str:
    """Return the experiment file that a user would write for this flight."""
    rotors = "\n".join(
        f'  {{ position = {list(rotor.position)}, spin = "{rotor.spin}" }},'
        for rotor in vehicle.rotors
    )
    return f"""name = "demo"

[airframe]
axes = "FLU"
rotors = [
{rotors}
]
imu = {{ position = {list(vehicle.imu_position or (0.0, 0.0, 0.0))} }}

[motors]
speed = "measured"

[[configuration]]
name = "A"
mass = {truth.mass}
flights = ["flight.csv"]
"""


def _beside(result: IdentificationResult, truth: dict[str, float]) -> str:
    """Return estimate and truth side by side."""
    lines = [f"  {'':<15} {'estimate':>24}  {'truth':>11}  inside its interval"]
    for name in SHOWN:
        number = _number(result, name)
        if number.value is None or number.interval is None:
            lines.append(f"  {name:<15} {'-':>24}  {truth[name]:>11.4g}  not identified")
            continue
        low, high = number.interval
        inside = "yes" if low <= truth[name] <= high else "NO"
        shown = with_interval(number.value, number.interval)
        lines.append(f"  {name:<15} {shown:>24}  {truth[name]:>11.4g}  {inside}")
    return "\n".join(["Estimate beside the truth that flew", *lines])


def _number(result: IdentificationResult, name: str) -> Parameter | Derived:
    known = {p.name for p in result.parameters}
    return result.parameter(name) if name in known else result.derived_value(name)
