"""Accuracy against the Cramer-Rao bound, and how often the intervals hold.

    python -m benchmarks.accuracy [--runs 400] [--steered-by-gyro] [-o accuracy.json]

Monte Carlo on simulated flights of the paper's vehicles A and B, fitted together: S1 (sensor
noise), S2b (and a disturbing wrench) and stress (rotor inertia, drag, unequal rotors, biased
accelerometer, gusts, and a log with commands only). Beside the default method: the paper's preset,
ordinary least squares, and total least squares with columns scaled by the known noise. The bound is
that of the default's own model and priors for the very flights of each run. Exit 1 if a limit is
not kept.

With -o the runs are kept as they finish, and a study that was stopped goes on where it was.
"""

import argparse
import json
import multiprocessing
import os
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from benchmarks.accuracy.runs import KINDS, ScenarioName, Study, one_run
from benchmarks.accuracy.tables import Runs, limits, scored, tables_text
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

SAVE_EVERY = 10
Kept = dict[str, dict[str, Any]]
"""Finished runs by scenario and number."""


def arguments(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.accuracy",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--scenario", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--vehicles", nargs="+", choices=["A", "B"], default=["A", "B"])
    parser.add_argument("--seconds", type=float, default=75.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--steered-by-gyro",
        action="store_true",
        help="autopilots answer the noise of their gyros, as real ones do",
    )
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("-o", "--output", type=Path, help="keep the runs here (JSON)")
    return parser.parse_args(words)


def finished(path: Path | None, settings: Mapping[str, Any]) -> Kept:
    """Return the runs that a file already has.

    Raises
    ------
    SystemExit
        If it is of another study.
    """
    if path is None or not path.exists():
        return {}
    content = json.loads(path.read_text(encoding="utf-8"))
    if content["settings"] != settings:
        sys.exit(
            f"{path} holds runs of {content['settings']}, asked for is {settings}: "
            "give another file"
        )
    return content["runs"]


def keep(path: Path | None, settings: Mapping[str, Any], kept: Kept) -> None:
    """Write all finished runs, whole or not at all."""
    if path is None:
        return
    beside = path.with_suffix(".part")
    beside.write_text(json.dumps({"settings": settings, "runs": kept}), encoding="utf-8")
    beside.replace(path)


def fly_all(asked: argparse.Namespace, study: Study) -> Kept:
    """Do the runs that are missing, with a progress bar on stderr."""
    settings = {
        "vehicles": asked.vehicles,
        "seconds": asked.seconds,
        "seed": asked.seed,
        "steered_by_gyro": asked.steered_by_gyro,
    }
    kept = finished(asked.output, settings)
    missing = [
        (name, str(number))
        for number in range(asked.runs)
        for name in asked.scenario
        if str(number) not in kept.setdefault(name, {})
    ]
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    console = Console(stderr=True)
    with (
        Progress(*columns, TimeRemainingColumn(), console=console) as progress,
        # Not forked: the progress bar has a thread of its own.
        ProcessPoolExecutor(asked.workers, multiprocessing.get_context("spawn")) as pool,
    ):
        task = progress.add_task("flying", total=len(missing))
        jobs = {
            pool.submit(partial(one_run, int(number), scenario=name, study=study)): (name, number)
            for name, number in missing
        }
        for done, job in enumerate(as_completed(jobs), start=1):
            name, number = jobs[job]
            kept[name][number] = job.result()
            progress.advance(task)
            if done % SAVE_EVERY == 0:
                keep(asked.output, settings, kept)
    keep(asked.output, settings, kept)
    return kept


def report(runs: Runs, *, scenario: ScenarioName, study: Study) -> bool:
    """Print the tables of a scenario and its limits; return whether all are kept."""
    print(tables_text(runs, scenario=scenario, study=study), end="\n\n")
    verdicts = limits(scored(runs, "default", scenario=scenario, study=study), scenario)
    print("\n".join(f"{verdict}" for verdict in verdicts))
    spent = {key: sum(run["cpu"][key] for run in runs) / len(runs) for key in runs[0]["cpu"]}
    print(
        "CPU seconds of a run: " + ", ".join(f"{k} {s:.1f}" for k, s in spent.items()), end="\n\n"
    )
    return all(verdict.passed for verdict in verdicts)


def main(words: Sequence[str] | None = None) -> int:
    """Run the study."""
    asked = arguments(words)
    study = Study(
        vehicles=tuple(asked.vehicles),
        seconds=asked.seconds,
        seed=asked.seed,
        steered_by_gyro=asked.steered_by_gyro,
    )
    kept = fly_all(asked, study)
    passed = [
        report([kept[name][str(k)] for k in range(asked.runs)], scenario=name, study=study)
        for name in asked.scenario
    ]
    return 0 if all(passed) else 1


if __name__ == "__main__":
    sys.exit(main())
