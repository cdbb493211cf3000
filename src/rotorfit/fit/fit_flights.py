"""Fit the flights: the terms of the model, and interval terms by equally plausible settings.

The settings are the timing of the motors, the range of the frequencies, and the geometry, which is
measured with a tape before the flight and taken for exact by the fit: what an error of each shifts,
the numbers show when everything is fitted once more.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import UnsettledError
from rotorfit.estimation.factors import flights_of
from rotorfit.findings import Finding, doubt, note
from rotorfit.fit.fit import Fit, numbers_of, shift_of
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.joint.joint_fit import joint_fit
from rotorfit.fit.joint.joint_problem import (
    COM_HEIGHT,
    HELD_STD,
    JointConfiguration,
    joint_estimate,
)
from rotorfit.fit.joint.term_choice import chosen
from rotorfit.fit.joint.trims import ENOUGH_FLIGHTS
from rotorfit.fit.reduction.frequency_bands import EDGES, OTHER_RATIOS
from rotorfit.fit.timing.timing_fit import timed_again
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.registry import DEFAULT, DROPPED
from rotorfit.model.terms.rotors import IMU_MOUNTING, MOUNTING_STD

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.estimation.banded import BandedEstimate
    from rotorfit.fit.timing.timed_dataset import TimedDataset
    from rotorfit.model.vehicle import Rotor, Vehicle

    Shift = Callable[[TimedDataset, float], Float[np.ndarray, " q"]]
    """How far each number moves with other flights, or at another timing of theirs, and with the
    bands that begin under an edge [Hz]."""


def setting_terms(dataset: TimedDataset, shift: Shift, *, timed: bool) -> Iterator[IntervalTerm]:
    """Yield a term of twice the rms shift for every kind of setting that could be another one.

    `dataset`: what was fitted. `shift`: how far each number moves. `timed`: whether what the
    flights leave open of the motors' timing is among the terms already.
    """
    yield IntervalTerm(
        name="frequency range",
        half_width=2.0 * np.abs(shift(dataset, 0.5 * EDGES[-1])),
        source="fit with the lower half of the frequencies",
    )
    timings = [] if timed else _other_timings(dataset)
    if timings:
        yield IntervalTerm(
            name="motor lag",
            half_width=_twice_rms(shift, timings),
            source="fits with other times of the motors",
        )
    for name, others in other_geometries(dataset).items():
        yield IntervalTerm(
            name=name,
            half_width=_twice_rms(shift, [[other] for other in others]),
            source="declared tolerance",
        )


def _twice_rms(shift: Shift, groups: Sequence[Sequence[TimedDataset]]) -> Float[np.ndarray, " q"]:
    """Compute twice the root of the mean squared shift of each group, groups in quadrature."""
    squares = [np.mean([shift(t, np.inf) ** 2 for t in group], axis=0) for group in groups]
    return 2.0 * np.sqrt(np.sum(squares, axis=0))


def _other_timings(dataset: TimedDataset) -> list[list[TimedDataset]]:
    """Return the flights at other timings, in groups that are independent of each other."""
    found = dataset.motor_timing
    if found is None:
        return []
    half = 0.5 / dataset.configurations[0].flights[0].recorded.sample_rate
    # Half a sample, or a deviation of what the flights show of lag plus delay.
    step, at = max(half, found.total_std), found.response
    groups = [[dataset.at(replace(at, delay=at.delay + move)) for move in (-step, step)]]
    if found.lag_std is not None and found.delay_std is not None:
        # Lag taken for delay, by a deviation of the split.
        lag, delay = at.lag + found.lag_std, at.delay - found.lag_std
        groups.append([dataset.at(replace(at, lag=lag, delay=delay))])
    return groups


def other_geometries(dataset: TimedDataset) -> dict[str, list[TimedDataset]]:
    """Return the flights with each measured length off by its standard deviation, if it has one.

    By the name of the interval term. `dataset`: with the deviations in its vehicle.
    """
    vehicle, added = dataset.vehicle, dataset.model.layout.added
    others: dict[str, list[Vehicle]] = {}
    if vehicle.arm_std > 0.0:
        others["arm lengths"] = [longer_arms(vehicle, vehicle.arm_std)]
    if vehicle.imu_position is not None and vehicle.imu_position_std > 0.0:
        std = vehicle.imu_position_std
        others["IMU position"] = [moved_imu(vehicle, axis, std) for axis in range(3)]
    return {
        name: [replace(dataset, vehicle=v, model=regressor(v, added=added)) for v in vehicles]
        for name, vehicles in others.items()
    }


def longer_arms(vehicle: Vehicle, length: float) -> Vehicle:
    """Return the vehicle with all arms longer by one share, on average by a length [m]."""
    share = length / vehicle.arm
    centre = vehicle.positions.mean(axis=0)

    def moved(rotor: Rotor) -> Rotor:
        x, y, z = rotor.position
        place = (x + share * (x - float(centre[0])), y + share * (y - float(centre[1])), z)
        return replace(rotor, position=place)

    return replace(vehicle, rotors=tuple(moved(rotor) for rotor in vehicle.rotors))


def moved_imu(vehicle: Vehicle, axis: int, length: float) -> Vehicle:
    """Return the vehicle with its IMU moved along an axis by a length [m]."""
    place = list(vehicle.imu_position or (0.0, 0.0, 0.0))
    place[axis] += length
    return replace(vehicle, imu_position=(place[0], place[1], place[2]))


def fit_flights(
    dataset: TimedDataset, wanted: Sequence[str] | None, *, begin: Mapping[str, float] | None = None
) -> Fit:
    """Fit the flights with the terms of the user, or (None) with those that the likelihood selects.

    `begin`: values of free parameters to begin with; None: where the timing of the motors ended.
    """
    begin = dataset.reached if begin is None else begin
    estimate, joint, present, unsettled = _fit_with_most_terms(dataset, wanted, begin)

    def refit(terms: Sequence[str], at: BandedEstimate) -> BandedEstimate:
        return joint_estimate(joint, [], terms=terms, begin=at.estimate.by_name)

    choice, estimate = chosen(wanted, estimate, joint, refit=refit, present=present)
    if set(choice.terms) - set(present):
        dataset = timed_again(dataset, choice.terms, begin=estimate.estimate.by_name)
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


def _fit_with_most_terms(
    dataset: TimedDataset, wanted: Sequence[str] | None, begin: Mapping[str, float] | None
) -> tuple[BandedEstimate, list[JointConfiguration], tuple[str, ...], tuple[Finding, ...]]:
    """Fit with all default terms, or the most of them with which the fit settles."""
    if wanted is not None:
        return *joint_fit(dataset, terms=wanted, begin=begin), tuple(wanted), ()
    usual = [term.name for term in DEFAULT if term.stands_in(dataset.model.layout)]
    for count in range(len(DROPPED) + 1):
        dropped = tuple(term.name for term in DROPPED[:count])
        terms = tuple(t for t in usual if t not in dropped)
        try:
            estimate, joint = joint_fit(dataset, terms=terms, begin=begin)
        except UnsettledError:
            # Terms that the user asks for are kept above, and a fit that does not settle is
            # refused.
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


def allow_for_settings(fit: Fit) -> Fit:
    """Append the interval terms by the shifts with equally plausible settings."""

    def shift(other: TimedDataset, top: float) -> Float[np.ndarray, " q"]:
        return shift_of(fit, other, top=top)

    timed = fit.dataset.free_timing is not None
    return fit.with_terms(
        *setting_terms(fit.dataset, shift, timed=timed),
        *(TOLERANCE_TERMS[n](fit, std) for n, std in fit.dataset.vehicle.tolerances.items() if std),
        _by_other_bands(fit),
    )


def mounting_term(fit: Fit, std: float) -> IntervalTerm:
    """Return the term by a declared deviation of the IMU's angles about each axis [rad]."""
    # A fit takes the three angles for known to `MOUNTING_STD` about zero: that is in its prior
    # term. Where the mounting is known less well, the prior should be centred elsewhere: an error d
    # of its centre moves the numbers by S d, so that the variance beyond that of the prior adds S
    # S^T (std^2 - MOUNTING_STD^2). Flights that show the mounting leave S small.
    beyond = float(np.sqrt(max(std**2 - MOUNTING_STD**2, 0.0)))
    names = [n for n in IMU_MOUNTING.names if n in fit.estimate.estimate.names and beyond > 0.0]
    shifts = [
        shift_of(fit, fit.dataset, known={**fit.known, name: (beyond, MOUNTING_STD)})
        for name in names
    ]
    half = 1.96 * np.sqrt(np.sum(np.square(shifts), axis=0)) * np.ones(len(fit.numbers.names))
    return IntervalTerm(name="IMU mounting", half_width=half, source="declared tolerance")


def height_term(fit: Fit, std: float) -> IntervalTerm:
    """Return the term by the height of a CoM that is held at the origin's, to a deviation [m]."""
    moved = {
        f"msz@{c.name}": (c.mass * std, c.mass * HELD_STD)
        for c in fit.configurations
        if c.payload_of is None
    }
    shift = shift_of(fit, fit.dataset, known={**fit.known, **moved})
    return IntervalTerm(
        name="CoM height", half_width=1.96 * np.abs(shift), source="fit with a higher CoM"
    )


TOLERANCE_TERMS: Final[Mapping[str, Callable[[Fit, float], IntervalTerm]]] = {
    "IMU mounting": mounting_term,
    COM_HEIGHT: height_term,
}
"""What a declared standard deviation of a vehicle leaves open, by the name of the term."""


def _by_other_bands(fit: Fit) -> IntervalTerm:
    """Return the term by the limit between informative bands and the others."""
    half = np.zeros(len(fit.numbers.names))
    # One band near that limit may have the information of a flight; many flights scatter by it.
    if max(len(flights_of(c.factors)) for c in fit.configurations) < ENOUGH_FLIGHTS:
        shifts = [shift_of(fit, fit.dataset, least_ratio=r) for r in OTHER_RATIOS]
        half = 2.0 * np.sqrt(np.mean(np.square(shifts), axis=0))
    return IntervalTerm(
        name="choice of bands",
        half_width=half,
        source="fits with more and fewer frequency bands",
    )
