"""Does the recipe land inside its own intervals? Simulated flights with known truth.

    python -m benchmarks.recovery [--runs 40] [--seconds 40] [--vehicle A B hexa-x] [--variant real]

For each vehicle and variant: bias, scatter and median half-width in percent of the truth (of a
scale where the truth is near zero), and how often the 95 % interval holds the truth, beside the
paper's preset on the same files. The last column counts the runs in which the number was given.
"""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from benchmarks.common import PAPER, identify_flights, named_vehicle, scales, true_values

from rotorfit.results.result import IdentificationResult
from rotorfit.simulation import Scenario, SimulatedFlight, simulate_flight, variant

Found = dict[str, tuple[float, float]]


def found_values(result: IdentificationResult | None) -> Found:
    """Return value and half-width of everything that has an interval."""
    numbers = () if result is None else (*result.parameters, *result.derived)
    return {
        number.name: (number.value, 0.5 * (number.interval[1] - number.interval[0]))
        for number in numbers
        if number.value is not None and number.interval is not None
    }


def one_run(seed: int, *, vehicle: str, kind: str, seconds: float) -> list[Found]:
    """Fly once and identify: the recipe, then the paper's preset."""
    flight = flown(vehicle, kind, seconds=seconds, seed=seed)
    return [found_values(result) for result in identify_flights({"A": flight}, ("", PAPER))]


def flown(vehicle: str, kind: str, *, seconds: float, seed: int) -> SimulatedFlight:
    """Return one flight from the ground and back."""
    (truth, known), sensors = variant(named_vehicle(vehicle), kind)
    scenario = Scenario(seconds=seconds, ground_seconds=2.0, sensors=sensors)
    return simulate_flight(truth, known, scenario, seed=seed)


def table(flight: SimulatedFlight, runs: list[Found]) -> list[str]:
    """Return one line for each number that was found at least once."""
    true, scale = true_values(flight), scales(flight)
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
    example = flown(vehicle, kind, seconds=10.0, seed=0)
    for column, method in enumerate(("recipe", "preset paper")):
        print(f"{vehicle} {kind}, {runs} flights of {seconds:g} s, {method}")
        print(f"  {'':12s} {'bias %':>9s} {'std %':>8s} {'half %':>9s} {'cover':>6s} {'runs':>4s}")
        print("\n".join(table(example, [run[column] for run in found])), flush=True)


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
