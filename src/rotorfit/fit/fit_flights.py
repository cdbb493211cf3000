"""Fit the flights: the terms of the model, and intervals by other settings."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from rotorfit.errors import UnsettledError
from rotorfit.estimation.banded import BandedEstimate
from rotorfit.findings import Finding, doubt, note
from rotorfit.fit.fit import Fit, numbers_of, shift_of
from rotorfit.fit.intervals.other_settings import widened
from rotorfit.fit.joint.joint_fit import joint_fit
from rotorfit.fit.joint.joint_problem import JointConfiguration, joint_estimate
from rotorfit.fit.joint.term_choice import chosen
from rotorfit.fit.joint.trims import ENOUGH_FLIGHTS, flights_of
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.fit.timing.timing_fit import timed_again
from rotorfit.model.terms.registry import DEFAULT, DROPPED
from rotorfit.reduction.frequency_bands import OTHER_RATIOS


def fit_flights(
    dataset: TimedDataset, wanted: Sequence[str] | None, *, begin: Mapping[str, float] | None = None
) -> Fit:
    """Fit the flights with the terms that the user wants, or those that they ask for (None).

    `begin`: values of free parameters to begin with; None: where the timing of the motors ended.
    """
    begin = dataset.reached if begin is None else begin
    estimate, joint, present, unsettled = _settled(dataset, wanted, begin)

    def refit(terms: Sequence[str], at: BandedEstimate) -> BandedEstimate:
        return joint_estimate(joint, [], terms=terms, begin=at.estimate.by_name)

    choice, estimate = chosen(wanted, estimate, joint, refit=refit, present=present)
    if set(choice.terms) - set(present):
        dataset = timed_again(dataset, choice.terms)
        # The signals are made anew at that timing: where it stood before is no place to begin.
        free, ended = dataset.free_timing, estimate.estimate.by_name
        begin = ended if free is None else free.without_times(ended)
        estimate, joint = joint_fit(dataset, terms=choice.terms, begin=begin)
    added = tuple(note("term-added", sentence) for sentence in choice.sentences)
    return Fit(
        dataset=dataset,
        terms=tuple(choice.terms),
        choice=choice,
        estimate=estimate,
        configurations=tuple(joint),
        numbers=numbers_of(dataset, estimate, joint),
        findings=(*unsettled, *added),
    )


def _settled(
    dataset: TimedDataset, wanted: Sequence[str] | None, begin: Mapping[str, float] | None
) -> tuple[BandedEstimate, list[JointConfiguration], tuple[str, ...], tuple[Finding, ...]]:
    """Fit with all default terms, or the most of them with which the fit settles.

    Terms that the user asks for are kept, and a fit that does not settle with them is refused.
    """
    if wanted is not None:
        return *joint_fit(dataset, terms=wanted, begin=begin), tuple(wanted), ()
    usual = [term.name for term in DEFAULT if term.stands_in(dataset.model.layout)]
    for count in range(len(DROPPED) + 1):
        dropped = tuple(term.name for term in DROPPED[:count])
        terms = tuple(t for t in usual if t not in dropped)
        try:
            estimate, joint = joint_fit(dataset, terms=terms, begin=begin)
        except UnsettledError:
            if count == len(DROPPED):
                raise
            continue
        return estimate, joint, terms, (_left_out(dropped),) if dropped else ()
    raise UnsettledError("no terms to try")


def _left_out(dropped: tuple[str, ...]) -> Finding:
    return doubt(
        "terms-left-out",
        "the flights hardly determine all parameters: the fit settles only without "
        f"{' and '.join(dropped)}, which are left out; fly more motion about every axis",
    )


def widen_by_settings(fit: Fit) -> Fit:
    """Widen the intervals by what settings shift that could as well be others."""

    def shift(other: TimedDataset, top: float) -> Float[np.ndarray, " q"]:
        return shift_of(fit, other, top=top)

    timed = fit.dataset.free_timing is not None
    half = widened(fit.numbers.half_width, fit.dataset, shift, timed=timed)
    return fit.with_half_width(np.hypot(half, _by_other_bands(fit)))


def _by_other_bands(fit: Fit) -> Float[np.ndarray, " q"]:
    """Compute the half-width by where the line is drawn between bands that count and others.

    What a flight tells may hang on one band near that line. Of many flights their scatter shows it.
    """
    if max(len(flights_of(c.factors)) for c in fit.configurations) >= ENOUGH_FLIGHTS:
        return np.zeros(len(fit.numbers.names))
    shifts = [shift_of(fit, fit.dataset, least_ratio=r) for r in OTHER_RATIOS]
    return 2.0 * np.sqrt(np.mean(np.square(shifts), axis=0))
