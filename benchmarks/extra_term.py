"""What does one more term of the model explain on real logs, and what does it do to k_d?

    python -m benchmarks.extra_term linear_drag_torque FLIGHTS.toml...

Fits every experiment with its terms (by default those that are always in the model) and with one
more: gain of the log-likelihood, the numbers of the term, and k_d, with half of the 95 % intervals
(without what `identify` adds to them for settings that could as well be others).
"""

import argparse
import warnings
from dataclasses import replace
from pathlib import Path

from rotorfit.errors import FlightWarning
from rotorfit.estimation.banded import BandedEstimate
from rotorfit.fit.dataset.load import load_dataset
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.experiment.strict_tables import TERM_NAMES
from rotorfit.fit.intervals.joint_numbers import joint_numbers
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.joint.joint_fit import joint_fit
from rotorfit.fit.joint.joint_problem import joint_estimate
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.fit.timing.timing_fit import find_timing
from rotorfit.model.terms.registry import DEFAULT_TERMS, terms_named


def fitted(path: Path, extra: str) -> tuple[BandedEstimate, BandedEstimate, Numbers, Numbers]:
    """Return the fits without and with a term, and their numbers, from the same bands."""
    experiment = load_experiment(path)
    terms = experiment.identification.terms or DEFAULT_TERMS
    wider = (*terms, extra)
    asked = experiment.identification.model_copy(update={"terms": wider})
    experiment = experiment.model_copy(update={"identification": asked})
    dataset = TimedDataset.of(load_dataset(experiment, lambda _: None))
    dataset = replace(dataset, motor_timing=find_timing(dataset))
    mass_std = {entry.name: entry.mass_std for entry in experiment.configuration}
    before, joint = joint_fit(dataset, terms=terms)
    after = joint_estimate(joint, [], terms=wider, begin=before.estimate.by_name)
    usual, numbers = (joint_numbers(fit, joint, mass_std) for fit in (before, after))
    return before, after, usual, numbers


def main() -> None:
    """Print one line per experiment."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("term", choices=TERM_NAMES)
    parser.add_argument("experiments", nargs="+", type=Path)
    asked = parser.parse_args()
    (term,) = terms_named([asked.term])
    for path in asked.experiments:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FlightWarning)
            before, after, usual, numbers = fitted(path, asked.term)
        gain = after.log_likelihood - before.log_likelihood
        shown = [n for n in numbers.names if n.partition("@")[0] in term.parameters]
        words = [f"{n} {{:.3g}} +- {{:.2g}}".format(*numbers.number(n)) for n in shown]
        kd = ["kd {:.4g} +- {:.2g}".format(*one.number("kd")) for one in (usual, numbers)]
        print(f"{path.name}: gain {gain:.1f}, {', '.join(words)}; {' -> '.join(kd)}", flush=True)


if __name__ == "__main__":
    main()
