"""Choose the optional terms of the model: those of the user, else by the likelihood.

A term that most vehicles have little of (drag, a constant torque) enters where the log-likelihood
rises by more than `LEAST_GAIN` with it. Whether a fit with it is worth its time is seen beforehand
from the slope of the likelihood at the fit without (Rao's score test).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import UnsettledError
from rotorfit.estimation.banded import BandedEstimate, normal_equations
from rotorfit.estimation.estimate import Estimate
from rotorfit.fit.joint.joint_problem import JointConfiguration, joint_problem, size_of
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.terms.air import DRAG
from rotorfit.model.terms.registry import BY_LIKELIHOOD, DEFAULT_TERMS, OPTIONAL, terms_named
from rotorfit.model.terms.rotors import DRAG_OF_ROTORS

if TYPE_CHECKING:
    from rotorfit.model.terms.term import Term

LEAST_GAIN = 50.0
"""Of the log-likelihood, per configuration, for which a term enters. Of chance alone the three
parameters of a torque gain 1.5 on average, and 8 once in a thousand, the nine of drag 4.5 and 14;
the response to gusts makes up to 23 on simulated flights without the term, and throws
and pulses up to 40 on real ones, where flights of the same vehicle contradict one another. Drag
that spoils anything gains over 100."""
SECOND_DRAG = 1.4
"""Times as much is needed of the frame's drag beside that of the rotors, which forces hardly tell
apart: drag that spoils anything gains over 100, and what goes with the velocity by chance (trims, a
room's own air) gained 62 in a flight of NeuroBEM, and gave the frame half of the rotors' drag."""
SURE = 4.0
"""Deviations by which what brakes must be more than none."""
LIKELY = 2.0
"""Deviations by which what brakes may be less than none by chance."""


@frozen_dataclass
class Choice:
    """The terms of the model, and why.

    - `gains`: of the log-likelihood, by each further term that was looked at.
    - `least_gain`: for which they were added; None if the user chose.
    """

    terms: tuple[str, ...]
    gains: dict[str, float] = dataclasses.field(default_factory=dict[str, float])
    least_gain: float | None = None

    @property
    def settings(self) -> dict[str, object]:
        """Its entries among the settings of a result."""
        said: dict[str, object] = {"terms": list(self.terms)}
        if self.least_gain is None:
            return {**said, "terms_chosen": "by the experiment file"}
        gains = {name: round(gain, 1) for name, gain in self.gains.items()}
        return {
            **said,
            "terms_chosen": "by log-likelihood",
            "terms_gain": gains,
            "terms_least_gain": self.least_gain,
        }

    @property
    def sentences(self) -> tuple[str, ...]:
        """Say of each term that was added, why."""
        words = {term.name: term.words for term in OPTIONAL}
        return tuple(
            f"the model includes {words[name]} ({name}), as the flights show it"
            for name in self.gains
            if name in self.terms
        )


Refit = Callable[[Sequence[str], BandedEstimate], BandedEstimate]
"""The fit with other terms, begun at a fit."""


def chosen(
    terms: Sequence[str] | None,
    fit: BandedEstimate,
    joint: Sequence[JointConfiguration],
    *,
    refit: Refit,
    present: tuple[str, ...] = DEFAULT_TERMS,
) -> tuple[Choice, BandedEstimate]:
    """Choose the terms of the model, and fit with them.

    `terms`: as the user chose; None for what the flights ask for. `fit`: with the user's terms, or
    the default ones. `joint`: what was fitted. `refit`: fits again. `present`: the terms of the
    fit, where the user chose none.
    """
    if terms is not None:
        return Choice(terms=tuple(terms)), fit
    for term in terms_named(present):
        if term.one_sided and _surely_drives(term, fit, joint):
            with suppress(UnsettledError):
                without = tuple(name for name in present if name != term.name)
                present, fit = without, refit(without, fit)
    gains: dict[str, float] = {}
    least = LEAST_GAIN * len(joint)
    layout = joint[0].model.layout
    times = {DRAG.name: SECOND_DRAG if DRAG_OF_ROTORS in layout.added else 1.0}
    open_terms = [term.name for term in BY_LIKELIHOOD if term.stands_in(layout)]
    while open_terms:
        # The one first that explains most: what is left for another is then its own.
        for one in open_terms:
            gains[one] = expected_gain(fit, joint, (*present, one))
        name = max(open_terms, key=lambda one: gains[one] / times.get(one, 1.0))
        needed = least * times.get(name, 1.0)
        if gains[name] < 0.5 * needed:
            break
        open_terms.remove(name)
        wider = (*present, name)
        try:
            trial = refit(wider, fit)
        except UnsettledError:
            continue  # the flights do not separate it from the other terms
        gains[name] = trial.log_likelihood - fit.log_likelihood
        if gains[name] >= needed and matters(name, trial, joint):
            present, fit = wider, trial
    return Choice(terms=present, gains=gains, least_gain=least), fit


def _surely_drives(term: Term, fit: BandedEstimate, joint: Sequence[JointConfiguration]) -> bool:
    """Test whether a one-sided term surely drives in every configuration: no air does that."""
    names = [f"{name}@{c.name}" for c in joint for name in term.one_sided]
    if not set(names) <= set(fit.estimate.names):
        return False
    at = [fit.estimate.names.index(name) for name in names]
    return bool((fit.estimate.values[at] < -LIKELY * fit.estimate.std[at]).all())


def matters(name: str, fit: BandedEstimate, joint: Sequence[JointConfiguration]) -> bool:
    """Return whether a term is more than a trace in some configuration, and of the air a brake."""
    (term,) = terms_named([name])
    rule = term.significance
    assert rule is not None
    for c in joint:
        own = "" if term.owner == "shared" else f"@{c.name}"
        at = [fit.estimate.names.index(f"{n}{own}") for n in rule.parameters]
        size, sure = fit.estimate.values[at], SURE * fit.estimate.std[at]
        least = rule.least(size_of(c))
        if not rule.brakes:
            size, sure = np.abs(size), np.zeros(len(at))
        if (size > np.maximum(sure, least)).any():
            return True
    return False


def expected_gain(
    fit: BandedEstimate, joint: Sequence[JointConfiguration], terms: Sequence[str]
) -> float:
    """Compute the gain of log-likelihood with these terms, to second order."""
    problem = joint_problem(joint, terms=terms)
    known = fit.estimate.by_name
    names = problem.map.names
    values = np.array([known.get(name, 0.0) for name in names])
    at = Estimate(
        names=names,
        values=values,
        covariance=np.zeros((len(names), len(names))),
        condition_number=1.0,
    )
    wide = dataclasses.replace(fit, problem=problem, estimate=at)
    every = np.ones(len(fit.influence), dtype=bool)
    equations = normal_equations(wide, every)
    return 0.5 * float(equations.scores.sum(axis=0) @ equations.step)
