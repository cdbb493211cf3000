"""Fit the flights: the terms of the model, and intervals widened by equally plausible settings.

The settings are the timing of the motors, the range of the frequencies, and the geometry, which is
measured with a tape before the flight and taken for exact by the fit: what an error of each shifts,
the numbers show when everything is fitted once more.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from rotorfit.errors import UnsettledError
from rotorfit.estimation.banded import BandedEstimate
from rotorfit.estimation.factors import flights_of
from rotorfit.findings import Finding, doubt, note
from rotorfit.fit.fit import Fit, numbers_of, shift_of
from rotorfit.fit.joint.joint_fit import joint_fit
from rotorfit.fit.joint.joint_problem import JointConfiguration, joint_estimate
from rotorfit.fit.joint.term_choice import chosen
from rotorfit.fit.joint.trims import ENOUGH_FLIGHTS
from rotorfit.fit.reduction.frequency_bands import EDGES, OTHER_RATIOS
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.fit.timing.timing_fit import timed_again
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.registry import DEFAULT, DROPPED
from rotorfit.model.vehicle import Rotor, Vehicle

Shift = Callable[[TimedDataset, float], Float[np.ndarray, " q"]]
"""How far each number moves with other flights, or at another timing of theirs, and with the bands
that begin under an edge [Hz]."""


def widened(
    half_width: Float[np.ndarray, " q"], dataset: TimedDataset, shift: Shift, *, timed: bool
) -> Float[np.ndarray, " q"]:
    """Add twice the rms shift of every group of trials to the half-widths.

    `half_width`: of each number, of chance and of what is always allowed for. `dataset`: what was
    fitted. `shift`: how far each number moves. `timed`: whether what the flights leave open of the
    motors' timing is in the half-width already.
    """
    groups = [[(dataset, 0.5 * EDGES[-1])]]
    groups += [] if timed else [[(other, np.inf) for other in g] for g in _other_timings(dataset)]
    groups += [[(other, np.inf)] for other in other_geometries(dataset)]
    squares = [np.mean([shift(*trial) ** 2 for trial in group], axis=0) for group in groups]
    return np.sqrt(half_width**2 + 4.0 * np.sum(squares, axis=0))


def _other_timings(dataset: TimedDataset) -> list[list[TimedDataset]]:
    """Return the flights at other timings, in groups that are independent of each other.

    The motors off both ways, by half a sample or by a deviation of what the flights show of lag
    plus delay; lag taken for delay, by a deviation of the split.
    """
    found = dataset.motor_timing
    if found is None:
        return []
    half = 0.5 / dataset.configurations[0].flights[0].recorded.sample_rate
    step, at = max(half, found.total_std), found.response
    groups = [[dataset.at(replace(at, delay=at.delay + move)) for move in (-step, step)]]
    if found.lag_std is not None and found.delay_std is not None:
        lag, delay = at.lag + found.lag_std, at.delay - found.lag_std
        groups.append([dataset.at(replace(at, lag=lag, delay=delay))])
    return groups


def other_geometries(dataset: TimedDataset) -> Iterator[TimedDataset]:
    """Yield the flights with each measured length off by its standard deviation, if it has one.

    `dataset`: with the deviations in its vehicle.
    """
    vehicle = dataset.vehicle
    others: list[Vehicle] = []
    if vehicle.arm_std > 0.0:
        others.append(longer_arms(vehicle, vehicle.arm_std))
    if vehicle.imu_position is not None and vehicle.imu_position_std > 0.0:
        others += [moved_imu(vehicle, axis, vehicle.imu_position_std) for axis in range(3)]
    for other in others:
        yield replace(
            dataset, vehicle=other, model=regressor(other, added=dataset.model.layout.added)
        )


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
    estimate, joint, present, unsettled = _settled(dataset, wanted, begin)

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
    """Widen the intervals by the shifts with equally plausible settings."""

    def shift(other: TimedDataset, top: float) -> Float[np.ndarray, " q"]:
        return shift_of(fit, other, top=top)

    timed = fit.dataset.free_timing is not None
    half = widened(fit.numbers.half_width, fit.dataset, shift, timed=timed)
    return fit.with_half_width(np.hypot(half, _by_other_bands(fit)))


def _by_other_bands(fit: Fit) -> Float[np.ndarray, " q"]:
    """Compute the half-width by the limit between informative bands and the others.

    One band near that limit may have the information of a flight; many flights scatter by it.
    """
    if max(len(flights_of(c.factors)) for c in fit.configurations) >= ENOUGH_FLIGHTS:
        return np.zeros(len(fit.numbers.names))
    shifts = [shift_of(fit, fit.dataset, least_ratio=r) for r in OTHER_RATIOS]
    return 2.0 * np.sqrt(np.mean(np.square(shifts), axis=0))
