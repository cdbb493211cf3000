"""Where does the width of an interval come from? Of any experiment file, number by number.

    python -m benchmarks.widths EXPERIMENT.toml... [--numbers kd Izz_com Jr kd_over_Izz] [--cinerat]

Identifies every experiment (--cinerat: the 13 real throws of `benchmarks.real_flights`) and prints,
for each number, its half-width in percent and its interval terms.
Before them, inside "noise": the likelihood alone and the number's own blocks (1.96 deviations),
the scatter of blocks (pooled with the dispersion of the flight) and of phases.

Last: how many blocks tell the number, and the share of its square that noise has.
"""

import argparse
import os
import tempfile
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from benchmarks.common import real_data_folder
from benchmarks.real_flights import cases

from rotorfit.errors import RotorfitError
from rotorfit.estimation.effective_blocks import effective_blocks
from rotorfit.estimation.estimate import numerical_jacobian
from rotorfit.estimation.reweighted import scatter_covariance
from rotorfit.fit.dataset.load import load_dataset
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.fit import Fit
from rotorfit.fit.fit_flights import fit_flights
from rotorfit.fit.imu_tilt import correct_imu_tilt
from rotorfit.fit.intervals import joint_numbers as intervals
from rotorfit.fit.noise_levels import fit_by_noise
from rotorfit.fit.steps import every_step
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.fit.timing.timing_fit import time_motors

NUMBERS = ("kt", "Ixx_com", "Iyy_com", "kd", "Izz_com", "Jr", "kd_over_Izz", "Jr_over_Izz")


@dataclass(frozen=True, slots=True, kw_only=True)
class Widths:
    """What the half-widths of a fit's numbers are made of, a value for each number and part.

    Attributes
    ----------
    names
        Of the numbers.
    values, half_width
        Of the result.
    parts
        95 % half-widths by the part's name; those before noise are inside it.
    blocks
        That tell each number.
    """

    names: tuple[str, ...]
    values: np.ndarray
    half_width: np.ndarray
    parts: dict[str, np.ndarray]
    blocks: np.ndarray


def fitted(path: Path) -> Fit:
    """Fit an experiment as `identify` does, up to the steps that widen intervals."""
    experiment = load_experiment(path)
    dataset = TimedDataset.of(load_dataset(experiment, lambda _: None))
    dataset = time_motors(dataset, lag=True, report=lambda _: None)
    experiment, dataset, _ = correct_imu_tilt(experiment, dataset)
    wanted = experiment.identification.terms
    return fit_by_noise(fit_flights(dataset, wanted), wanted)


def widths(fit: Fit) -> Widths:
    """Take every step of the recipe, and take the half-widths apart."""
    last = every_step(fit)
    of_fit, blocks = _of_fit(last)
    terms = {term.name: term.half_width for term in last.numbers.terms}
    return Widths(
        names=last.numbers.names,
        values=last.numbers.values,
        half_width=last.numbers.half_width,
        parts=of_fit | terms,
        blocks=blocks,
    )


def _of_fit(fit: Fit) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return what is inside the noise of a fit, and how many blocks tell each number."""
    estimate, configurations = fit.estimate, list(fit.configurations)
    values, std = estimate.estimate.values, estimate.estimate.std
    mapped = estimate.problem.map
    J = numerical_jacobian(
        lambda phi: np.array(list(intervals.physical(phi, mapped, configurations).values())),
        values,
        std,
    )
    formal = intervals.formal_covariance(estimate, J)
    by_flights = np.diagonal(formal) - intervals.prior_variance(estimate, J, formal)
    parts = {
        "likelihood": 1.96 * _std(J @ estimate.estimate.covariance @ J.T),
        "own blocks": 1.96 * _std(J @ scatter_covariance(estimate.influence) @ J.T),
        "blocks": intervals.half_width_between_blocks(estimate, J, by_flights),
        "phases": intervals.half_width_between_phases(estimate, J),
    }
    return parts, effective_blocks(estimate, J)


def _std(covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(np.diagonal(covariance), 0.0))


def table(found: Iterable[tuple[str, Widths]], number: str) -> Iterator[str]:
    """Yield the table of one number, a line an experiment, in percent of its value; its medians."""
    rows = [
        (label, one, i)
        for label, one in found
        for i, name in enumerate(one.names)
        if name.partition("@")[0] == number
    ]
    parts = [
        name for name in rows[0][1].parts if any(one.parts[name][i] > 0.0 for _, one, i in rows)
    ]
    heads = ["half", *(_short(name) for name in parts), "tell", "share"]
    yield f"{number:14s} " + " ".join(f"{head:>9s}" for head in heads)
    lines: list[list[float]] = []
    for label, one, i in rows:
        size = 100.0 / abs(float(one.values[i]))
        line = [size * one.half_width[i], *(size * one.parts[name][i] for name in parts)]
        line += [one.blocks[i], (one.parts["noise"][i] / one.half_width[i]) ** 2]
        lines.append([float(x) for x in line])
        yield f"{label[:14]:14s} " + " ".join(f"{x:9.2f}" for x in lines[-1])
    yield f"{'median':14s} " + " ".join(f"{x:9.2f}" for x in np.median(lines, axis=0))


def _short(name: str) -> str:
    return name[:9]


def _experiments(asked: argparse.Namespace, folder: Path) -> Iterator[Path]:
    yield from asked.experiments
    for case in cases(real_data_folder()) if asked.cinerat else ():
        if case.group == "cinerat":
            path = folder / f"{case.name.removeprefix('cinerat ')}.toml"
            path.write_text(case.declaration, encoding="utf-8")
            yield path


def main() -> None:
    """Print a table for each number that is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiments", nargs="*", type=Path)
    parser.add_argument("--numbers", nargs="+", default=NUMBERS)
    parser.add_argument("--cinerat", action="store_true")
    asked = parser.parse_args()
    found: list[tuple[str, Widths]] = []
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for path in _experiments(asked, Path(folder)):
            try:
                found.append((path.stem, widths(fitted(path))))
            except RotorfitError as error:
                print(f"{path.stem}: {error}")
    for number in asked.numbers:
        if any(name.partition("@")[0] == number for _, one in found for name in one.names):
            print("\n".join(table(found, number)), end="\n\n")


if __name__ == "__main__":
    main()
