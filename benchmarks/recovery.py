"""Does the recipe land inside its own intervals? Simulated flights with known truth.

    python benchmarks/recovery.py [--runs 40] [--seconds 40] [--vehicle A B hexa-x] [--variant real]

For each vehicle and variant: bias, scatter and median half-width in percent of the truth (of a
scale where the truth is near zero), and how often the 95 % interval holds the truth, beside the
paper's preset on the same files. The last column counts the runs in which the number was given.
"""

import argparse
import os
import tempfile
import warnings
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from rotorfit.errors import FlightWarning, RotorfitError
from rotorfit.identification.experiment import load_experiment
from rotorfit.identification.identify import identify
from rotorfit.identification.result import IdentificationResult
from rotorfit.simulation import (
    Scenario,
    SimulatedFlight,
    SimulatedVehicle,
    Truth,
    layout_vehicle,
    paper_vehicle,
    simulate_flight,
    variant,
    write_flight_table,
)

Found = dict[str, tuple[float, float]]
PAPER = '[identification]\npreset = "paper"\n'


def true_values(truth: Truth) -> dict[str, float]:
    """Return what should be found."""
    inertia, com = truth.com_inertia, truth.center_of_mass
    values = {"kt": truth.kt, "kd": truth.kd, "motor_delay": 0.0}
    values |= {f"com_{a}": float(c) for a, c in zip("xyz", com, strict=True)}
    places = {"Ixx": (0, 0), "Iyy": (1, 1), "Izz": (2, 2), "Ixy": (0, 1), "Ixz": (0, 2)}
    places["Iyz"] = (1, 2)
    for name, (i, j) in places.items():
        values[f"{name}_com"] = float(inertia[i, j])
        values[name] = float(truth.inertia_tensor[i, j])
    values["kd_over_Izz"] = truth.kd / float(inertia[2, 2])
    values["Jr_over_Izz"] = truth.Jr / float(inertia[2, 2])
    values |= {f"ms{a}": m for a, m in zip("xyz", truth.first_moments, strict=True)}
    return values


def scales(truth: Truth) -> dict[str, float]:
    """Return what 100 % of each number is."""
    values = {name: abs(value) for name, value in true_values(truth).items()}
    Ixx, Iyy, Izz = np.diagonal(truth.com_inertia)
    for name, size in (("xy", Ixx * Iyy), ("xz", Ixx * Izz), ("yz", Iyy * Izz)):
        values[f"I{name}_com"] = values[f"I{name}"] = float(np.sqrt(size))
    values |= {f"com_{a}": 0.2 for a in "xyz"}
    values |= {f"ms{a}": truth.mass * 0.2 for a in "xyz"}
    values["Jr_over_Izz"] = values["Jr_over_Izz"] or 1e-3
    values["motor_delay"] = 0.005
    return values


def found_values(result: IdentificationResult) -> Found:
    """Return value and half-width of everything that has an interval."""
    return {
        number.name: (number.value, 0.5 * (number.interval[1] - number.interval[0]))
        for number in (*result.parameters, *result.derived)
        if number.value is not None and number.interval is not None
    }


def experiment_text(flight: SimulatedFlight, files: Iterable[str], extra: str = "") -> str:
    """Return an experiment on flights of one vehicle."""
    rotors = ", ".join(
        f'{{ position = {list(r.position)}, spin = "{r.spin}", axis = {list(r.axis)} }}'
        for r in flight.vehicle.rotors
    )
    place = flight.vehicle.imu_position
    imu = "" if place is None else f"imu = {{ position = {list(place)} }}\n"
    names = ", ".join(f'"{name}"' for name in files)
    return (
        f"[airframe]\nrotors = [{rotors}]\n{imu}{extra}"
        f"[[configuration]]\nmass = {flight.truth.mass!r}\nflights = [{names}]\n"
    )


def identify_flight(flight: SimulatedFlight, extra: tuple[str, ...] = ("", PAPER)) -> list[Found]:
    """Write the flight, and identify it under each of the settings."""
    found: list[Found] = []
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        write_flight_table(flight, Path(folder) / "flight.csv")
        path = Path(folder) / "experiment.toml"
        for settings in extra:
            path.write_text(experiment_text(flight, ["flight.csv"], settings), encoding="utf-8")
            try:
                found.append(found_values(identify(load_experiment(path))))
            except RotorfitError as error:
                print(f"refused: {error}")
                found.append({})
    return found


def named_vehicle(name: str) -> SimulatedVehicle:
    """Return vehicle A or B of the paper, or a layout."""
    return paper_vehicle(name) if name in ("A", "B") else layout_vehicle(name)


def one_run(seed: int, *, vehicle: str, kind: str, seconds: float) -> list[Found]:
    """Fly once and identify: the recipe, then the paper's preset."""
    (truth, known), sensors = variant(named_vehicle(vehicle), kind)
    scenario = Scenario(seconds=seconds, ground_seconds=2.0, sensors=sensors)
    return identify_flight(simulate_flight(truth, known, scenario, seed=seed))


def table(truth: Truth, runs: list[Found]) -> list[str]:
    """Return one line for each number that was found at least once."""
    true, scale = true_values(truth), scales(truth)
    lines: list[str] = []
    for name in true:
        got = np.array([run[name] for run in runs if name in run])
        if len(got) == 0:
            continue
        error = 100.0 * (got[:, 0] - true[name]) / scale[name]
        half = 100.0 * got[:, 1] / scale[name]
        covered = float((np.abs(error) <= half).mean())
        lines.append(
            f"  {name:12s} {error.mean():+9.2f} {error.std():8.2f} {np.median(half):9.2f} "
            f"{covered:6.2f} {len(got):4d}"
        )
    return lines


def study(vehicle: str, kind: str, *, runs: int, seconds: float, workers: int) -> None:
    """Print the tables of one vehicle and variant."""
    job = partial(one_run, vehicle=vehicle, kind=kind, seconds=seconds)
    with ProcessPoolExecutor(workers) as pool:
        found = list(pool.map(job, range(100, 100 + runs)))
    (truth, _), _ = variant(named_vehicle(vehicle), kind)
    for column, method in enumerate(("recipe", "preset paper")):
        print(f"{vehicle} {kind}, {runs} flights of {seconds:g} s, {method}")
        print(f"  {'':12s} {'bias %':>9s} {'std %':>8s} {'half %':>9s} {'cover':>6s} {'runs':>4s}")
        print("\n".join(table(truth, [run[column] for run in found])), flush=True)


def main() -> None:
    """Run the studies that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--vehicle", nargs="+", default=["A", "B", "hexa-x"])
    parser.add_argument("--variant", nargs="+", default=["noisy", "disturbed", "real"])
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    for vehicle in asked.vehicle:
        for kind in asked.variant:
            study(vehicle, kind, runs=asked.runs, seconds=asked.seconds, workers=asked.workers)


if __name__ == "__main__":
    main()
