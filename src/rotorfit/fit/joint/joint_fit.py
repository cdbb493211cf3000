"""The joint fit of all flights: bands, a start, the informative bands, and the estimate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final, TypedDict

import numpy as np

from rotorfit.errors import UnsettledError
from rotorfit.estimation.banded import SMALLEST_STEP, BandedEstimate
from rotorfit.estimation.factors import flights_of
from rotorfit.fit.joint.closed_loop import NOMINAL_RESPONSE, ClosedLoopResponse, estimated_response
from rotorfit.fit.joint.informative_bands import select_informative_bands, select_slow_bands
from rotorfit.fit.joint.joint_problem import JointConfiguration, joint_estimate, separate_flights
from rotorfit.fit.joint.trims import ENOUGH_FLIGHTS, Scatter, scatters
from rotorfit.fit.reduction.frequency_bands import LEAST_RATIO
from rotorfit.fit.row_fits import fit_rows
from rotorfit.fit.timing.sensor_bandwidth import sensor_reach
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import INERTIA
from rotorfit.model.terms.registry import DEFAULT_TERMS

if TYPE_CHECKING:
    from rotorfit.fit.timing.timed_dataset import TimedDataset

INTERMEDIATE: Final = 0.1
"""Convergence tolerance of intermediate fits, in standard deviations: they find the informative
bands, the scatter of the flights, or where to reduce them again."""


SMALLEST_BODY: Final = 1e-6
"""Moment of inertia over mass times arm squared, far below that of any body (about .1)."""


@frozen_dataclass
class FittedFactors:
    """A fit's factors and values, to fit it again alone or with other flights; without samples.

    - `configurations`: factors at the timing that was found, with what counts of them.
    - `terms`: optional terms of the model.
    - `values`: free parameters of the fit by name, to begin with.
    """

    configurations: tuple[JointConfiguration, ...]
    terms: tuple[str, ...]
    values: Mapping[str, float]


class FitSettings(TypedDict, total=False):
    """The options of `joint_fit` with which a fit is made again; as there by default."""

    top: float
    begin: Mapping[str, float] | None
    guess: Mapping[str, float] | None
    known: Mapping[str, tuple[float, float]]
    least_ratio: float
    close: float


def joint_fit(
    dataset: TimedDataset,
    *,
    top: float = np.inf,
    terms: Sequence[str] = DEFAULT_TERMS,
    begin: Mapping[str, float] | None = None,
    guess: Mapping[str, float] | None = None,
    known: Mapping[str, tuple[float, float]] | None = None,
    least_ratio: float = LEAST_RATIO,
    close: float = SMALLEST_STEP,
) -> tuple[BandedEstimate, list[JointConfiguration]]:
    """Return the fit of all flights, and its configurations with what counts.

    - `dataset`: with the timing of the motors, and what the fit may move of it.
    - `top`: only bands that begin under this edge are fitted [Hz].
    - `terms`: optional terms of the model.
    - `begin`: where to begin, near enough to tell the pilot's motion from disturbances; None: where
      a first fit ends, of the turns in the pilot's band alone or, if that does not settle, of all.
    - `guess`: where that one begins; None: at the row fits.
    - `known`: mean and standard deviation of free parameters from elsewhere, by name.
    - `least_ratio`: as for `select_informative_bands`.
    - `close`: convergence tolerance, in deviations.
    """
    joint = [
        JointConfiguration(
            name=configured.entry.name,
            mass=configured.mass,
            factors=factors.select(factors.band[:, 0] < top),
            model=dataset.model,
            vehicle=dataset.vehicle,
            payload=configured.payload,
            payload_of=configured.entry.payload_of,
            reach=sensor_reach(configured, factors)[factors.band[:, 0] < top],
            timing=dataset.free_timing,
        )
        for factors, configured in zip(dataset.timed_bands, dataset.configurations, strict=True)
    ]
    estimate = partial(joint_estimate, known=known or {}, terms=terms)
    select = partial(
        select_informative_bands,
        known=known or {},
        terms=terms,
        least_ratio=least_ratio,
    )
    if begin is not None:
        return _fit_from(joint, begin, select=select, estimate=estimate, close=close)
    starts = [fit_rows(c.factors, c.model, mass=c.mass) for c in joint] if guess is None else []

    def first(looked_at: list[JointConfiguration]) -> Mapping[str, float]:
        return estimate(looked_at, starts, begin=guess, close=INTERMEDIATE).estimate.by_name

    # Before the first fit nobody can tell the pilot's motion from disturbances: further up an
    # autopilot's answer to the noise of its gyro may well be all there is.
    try:
        slow = first([select_slow_bands(c) for c in joint])
        return _fit_from(joint, slow, select=select, estimate=estimate, close=close)
    except UnsettledError:
        return _fit_from(joint, first(joint), select=select, estimate=estimate, close=close)


Select = Callable[[list[JointConfiguration], Mapping[str, float]], list[JointConfiguration]]


def _fit_from(
    joint: list[JointConfiguration],
    begin: Mapping[str, float],
    *,
    select: Select,
    estimate: Callable[..., BandedEstimate],
    close: float,
) -> tuple[BandedEstimate, list[JointConfiguration]]:
    """Fit the informative bands, selected at `begin`; return the fit and its configurations."""
    joint = select(joint, begin)
    several = _several_flights(joint)
    fit = estimate(joint, [], begin=begin, close=max(close, INTERMEDIATE) if several else close)
    refuse_collapse(fit.estimate.by_name, joint)
    if not several:
        return fit, joint  # one flight each
    response, differ = _closed_loop_response(fit, joint), _flight_scatters(fit, joint)
    joint = [
        replace(c, response=response, scatter=differ.get(k, c.scatter)) for k, c in enumerate(joint)
    ]
    return estimate(joint, [], begin=fit.estimate.by_name, close=close), joint


def refuse_collapse(at: Mapping[str, float], joint: Sequence[JointConfiguration]) -> None:
    """Refuse a fit whose body shrinks to nothing, as where the rotors explain no turn at all."""
    for c in joint:
        least = SMALLEST_BODY * c.mass * c.vehicle.arm**2
        # The equations of the turns are homogeneous: what an autopilot answers of pure noise then
        # outweighs what holds up their scale.
        if any(abs(at.get(f"{name}@{c.name}", np.inf)) < least for name in INERTIA[:3]):
            raise UnsettledError(
                f"{c.name}: the rotors explain nothing of how the vehicle rolls and pitches, so "
                "that no body fits the flights: vibration or a loose IMU hides the turns, or "
                "nobody flew any; fix the IMU to the frame, and fly 20 s of quick rolls and nods "
                "(pitching forward and back)",
                reached=at,
            )


def _several_flights(joint: Sequence[JointConfiguration], least: int = 2) -> bool:
    """Return whether any configuration has so many flights."""
    return any(len(flights_of(c.factors)) >= least for c in joint)


def _closed_loop_response(
    fit: BandedEstimate, joint: Sequence[JointConfiguration]
) -> ClosedLoopResponse:
    return estimated_response(fit) if _several_flights(joint, ENOUGH_FLIGHTS) else NOMINAL_RESPONSE


def _flight_scatters(
    fit: BandedEstimate, joint: Sequence[JointConfiguration]
) -> dict[int, Scatter]:
    owners, flights = separate_flights(joint)
    return scatters(fit.estimate, owners, [c.mass * c.vehicle.arm for c in flights])
