"""The fit of an experiment's flights: what every step of the recipe takes and returns."""

from __future__ import annotations

import dataclasses
from dataclasses import field
from typing import TYPE_CHECKING, TypeVar, Unpack

import numpy as np

from rotorfit.errors import UnsettledError
from rotorfit.fit.intervals.joint_numbers import joint_numbers, physical
from rotorfit.fit.joint.joint_fit import FitSettings, FittedFactors, joint_fit
from rotorfit.fit.joint.joint_problem import JointConfiguration, at_values
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float

    from rotorfit.estimation.banded import BandedEstimate
    from rotorfit.findings import Finding
    from rotorfit.fit.intervals.interval_terms import IntervalTerm
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.fit.joint.term_choice import Choice
    from rotorfit.fit.reduction.motor_timing import MotorTiming
    from rotorfit.fit.timing.timed_dataset import TimedDataset

Record = TypeVar("Record")


@frozen_dataclass
class Fit:
    """The dataset of an experiment, its estimate, and the numbers of the vehicle.

    - `dataset`: the flights, with the timing of their motors.
    - `terms`, `choice`: optional terms of the model, and why those.
    - `estimate`: the maximum of the joint likelihood.
    - `configurations`: factors of every configuration, with the bands that are informative.
    - `numbers`: physical numbers with 95 % intervals.
    - `findings`: of the steps so far.
    - `records`: what the steps measured on their way, from which checks make their findings.
    - `coupled`: whether turns about two axes act on the third in its model.
    - `withheld`: full names of the numbers that a step has withheld.
    - `known`: mean and standard deviation of free parameters from elsewhere, with which it was
      made.
    """

    dataset: TimedDataset
    terms: tuple[str, ...]
    choice: Choice
    estimate: BandedEstimate
    configurations: tuple[JointConfiguration, ...]
    numbers: Numbers
    findings: tuple[Finding, ...] = ()
    records: tuple[object, ...] = ()
    coupled: bool = True
    withheld: frozenset[str] = frozenset()
    known: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])

    @property
    def mass_known(self) -> bool:
        """Whether every configuration was weighed."""
        return all(c.entry.mass != "unknown" for c in self.dataset.configurations)

    @property
    def factors(self) -> FittedFactors:
        """The fit without samples."""
        return FittedFactors(
            configurations=self.configurations,
            terms=self.terms,
            values=self.estimate.estimate.by_name,
        )

    def found(self, *findings: Finding) -> Fit:
        """Return the fit with further findings."""
        return dataclasses.replace(self, findings=(*self.findings, *findings))

    def with_record(self, record: object) -> Fit:
        """Return the fit with what a step measured, for the checks to judge."""
        return dataclasses.replace(self, records=(*self.records, record))

    def record_of(self, kind: type[Record]) -> Record | None:
        """Return the last record of a kind; None if no step recorded one."""
        return next((one for one in reversed(self.records) if isinstance(one, kind)), None)

    def with_timing(self, timing: MotorTiming) -> Fit:
        """Return the fit with other deviations of its motors' times."""
        dataset = dataclasses.replace(self.dataset, motor_timing=timing)
        return dataclasses.replace(self, dataset=dataset)

    def with_terms(self, *terms: IntervalTerm) -> Fit:
        """Return the fit with further terms of the intervals of its numbers."""
        return dataclasses.replace(self, numbers=self.numbers.with_terms(*terms))


def refit(fit: Fit, dataset: TimedDataset, **settings: Unpack[FitSettings]) -> Fit:
    """Fit a dataset with the terms of a fit and what is known, and compute its numbers.

    `settings` are those of `joint_fit`.
    """
    known = settings.setdefault("known", fit.known)
    estimate, joint = joint_fit(dataset, terms=fit.terms, **settings)
    return dataclasses.replace(
        fit,
        dataset=dataset,
        estimate=estimate,
        configurations=tuple(joint),
        numbers=numbers_of(dataset, estimate, joint),
        known=known,
    )


def numbers_of(
    dataset: TimedDataset, estimate: BandedEstimate, joint: list[JointConfiguration]
) -> Numbers:
    """Compute the physical numbers of a joint estimate, with intervals."""
    mass_std = {c.entry.name: c.entry.mass_std for c in dataset.configurations}
    return joint_numbers(estimate, joint, mass_std)


def shift_of(
    fit: Fit, dataset: TimedDataset, **settings: Unpack[FitSettings]
) -> Float[np.ndarray, " q"]:
    """Compute the shift of the numbers with another dataset, or other settings of its fit.

    The other fit begins where this one ended, unless `settings` say where.
    """
    settings.setdefault("known", fit.known)
    if settings.get("begin") is None:
        settings["begin"] = fit.estimate.estimate.by_name
    try:
        estimate, joint = joint_fit(dataset, terms=fit.terms, **settings)
    except UnsettledError as error:
        # It wanders off from the numbers: by so much at least they are open.
        return _values_at(error.reached, fit.estimate, fit.configurations) - fit.numbers.values
    return _values_at(estimate.estimate.by_name, estimate, joint) - fit.numbers.values


def _values_at(
    reached: Mapping[str, float],
    estimate: BandedEstimate,
    joint: list[JointConfiguration] | tuple[JointConfiguration, ...],
) -> Float[np.ndarray, " q"]:
    """Compute the numbers of an estimate at other values of its free parameters."""
    phi = at_values(estimate.problem, reached, estimate.estimate.values)
    return np.array(list(physical(phi, estimate.problem.map, joint).values()))
