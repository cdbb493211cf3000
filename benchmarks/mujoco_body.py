"""The paper's vehicles flown by MuJoCo, identified from commands alone, beside the paper's preset.

    python benchmarks/mujoco_body.py [--seeds 5] [--seconds 75] [--workers 1]

A and B, one flight each, 40 ms motor lag that nobody tells, gyro noise 0.01 rad/s and bias,
accelerometer noise 0.15 m/s^2, lateral drag 0.12 N s/m (`tests/recovery/mujoco_flight.py` is the
body, and says how the log is timed). Printed per number: the mean error over the seeds, the largest
one, its limit, how often the 95 % interval holds the truth, and the errors of the preset; then the
validation errors on a flight that was not used.
"""

import argparse
import os
import sys
import tempfile
import warnings
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "recovery"))

import mujoco_paper
import numpy as np

from rotorfit.errors import FlightWarning
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify

Run = tuple[dict[str, mujoco_paper.Error], dict[str, float]]
UNITS = {"msx": (1e6, "1e-6 kg m"), "msy": (1e6, "1e-6 kg m"), "motor_lag_total": (1e3, "ms")}
PERCENT = (100.0, "%")


def one_seed(seed: int, *, seconds: float) -> tuple[Run, Run]:
    """Fly A and B, and identify: the recipe, then the paper's preset."""
    runs: list[Run] = []
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        folder = Path(name)
        mujoco_paper.fly_paper(folder, seed=seed, seconds=seconds)
        for settings in ("", mujoco_paper.PRESET):
            experiment = load_experiment(mujoco_paper.write_paper(folder, extra=settings))
            result = identify(experiment)
            runs.append((mujoco_paper.errors(result), mujoco_paper.residuals(result)))
    return runs[0], runs[1]


def table(recipe: list[Run], preset: list[Run]) -> list[str]:
    """Return one line per number, then one per validation error."""
    lines = [
        f"{'':18s} {'unit':>10s} {'mean':>8s} {'largest':>8s} {'limit':>6s} {'half':>6s} "
        f"{'held':>5s}   {'preset: mean':>12s} {'held':>5s}"
    ]
    for name in recipe[0][0]:
        own = [run[0][name] for run in recipe]
        paper = [run[0][name] for run in preset if name in run[0]]
        factor, unit = UNITS.get(name.partition("@")[0], PERCENT)
        error = factor * np.array([e.error for e in own])
        half = factor * np.median([e.half_width for e in own])
        beside = f"{'-':>12s}"
        if paper:
            mean = factor * np.mean([e.error for e in paper])
            beside = f"{mean:+12.2f} {np.mean([e.held for e in paper]):5.2f}"
        lines.append(
            f"{name:18s} {unit:>10s} {error.mean():+8.2f} {np.abs(error).max():8.2f} "
            f"{factor * own[0].limit:6.4g} {half:6.2f} {np.mean([e.held for e in own]):5.2f}   "
            f"{beside}"
        )
    lines.append("largest validation error, %, recipe and preset")
    for name in recipe[0][1]:
        worst = [100 * max(run[1].get(name, np.nan) for run in runs) for runs in (recipe, preset)]
        lines.append(f"{name:18s} {worst[0]:8.2f} {worst[1]:8.2f}")
    return lines


def main() -> None:
    """Run the seeds, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=75.0)
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    seeds = range(asked.first_seed, asked.first_seed + asked.seeds)
    with ProcessPoolExecutor(asked.workers) as pool:
        runs = list(pool.map(partial(one_seed, seconds=asked.seconds), seeds))
    print(f"{asked.seeds} seeds, {asked.seconds:g} s each of A and of B")
    print("\n".join(table([own for own, _ in runs], [preset for _, preset in runs])))


if __name__ == "__main__":
    main()
