"""Select the informative bands, correlate the errors, mark where the autopilot responds.

Bands in which no pilot moves an axis do not count for it (`frequency_bands.py`). In the others the
autopilot still responds to disturbances, and by how much is known well enough: wholly, up to the
frequencies that a pilot uses (`rotorfit.estimation.feedback`). Bands in which the model does not
explain the thrust do not count for it: motors are no first-order lag further up, accelerometers are
filtered, and many quiet lines of no thrust at all would outvote those that show k_t. Where it
explains the thrust in no band, only the mean counts. No band counts above the bandwidth of the
sensor that shows it (`bandwidth.py`).

Gusts and drag push at one place and turn the vehicle about another, its centre of mass. What of the
errors of the turns comes with those of the forces is therefore known, and is taken off them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.banded_equations import evaluated
from rotorfit.estimation.banded_problem import power_of, signal_power, split_blocks
from rotorfit.estimation.factors import Factors, flights_of
from rotorfit.fit.joint.joint_problem import (
    NOISY,
    TURN_ERRORS,
    JointConfiguration,
    at_values,
    error_correlation_std,
    joint_problem,
)
from rotorfit.fit.reduction.frequency_bands import (
    LEAST_RATIO,
    counted_bands,
    excited_bands,
    followed_bands,
    or_every,
    slow_bands,
)
from rotorfit.fit.row_fits import turned_flights
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.terms.registry import DEFAULT_TERMS

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from jaxtyping import Bool, Float, Int

    from rotorfit.model.vehicle import Vehicle

THRUST: Final = NOISY.index("az")
FORCES: Final = tuple(NOISY.index(name) for name in ("ax", "ay", "az"))
TURNS: Final = tuple(NOISY.index(name) for name in ("dwx", "dwy", "dwz"))
YAW: Final = TURNS[2]
REWEIGHTED: Final = 4
"""Passes of a regression whose variances are those of what it leaves."""
FEWEST_ROWS: Final = 30
"""Fewest rows of a regression."""
_TINY: Final = float(np.finfo(float).tiny)


def select_slow_bands(configuration: JointConfiguration) -> JointConfiguration:
    """Count turns in the pilot's band alone, each axis of the flights that move it."""
    c = configuration
    counted = np.ones((len(c.factors), len(NOISY)), dtype=bool)
    # A flight in which an axis is calm holds the autopilot's response to gusts, which would bias
    # the first fit of that axis; where no flight moves it, all count.
    turned = turned_flights(c.factors, c.model, mass=c.mass)
    counted[:, list(TURNS)] = slow_bands(c.factors) & or_every(turned)
    return replace(c, counted=within_reach(counted, c))


def within_reach(
    counted: Bool[np.ndarray, "b 6"], configuration: JointConfiguration
) -> Bool[np.ndarray, "b 6"]:
    """Keep the bands that the sensors can show; those with the mean unless they show nothing."""
    band, reach = configuration.factors.band, configuration.reach
    if reach is None:
        return counted
    mean = (band[:, :1] == 0.0) & (reach >= 0.0)
    return counted & ((band.mean(axis=1)[:, None] <= reach) | mean)


def select_informative_bands(
    configurations: Sequence[JointConfiguration],
    values: Mapping[str, float],
    *,
    known: Mapping[str, tuple[float, float]] | None = None,
    terms: Collection[str] = DEFAULT_TERMS,
    least_ratio: float = LEAST_RATIO,
) -> list[JointConfiguration]:
    """Select the informative bands, and mark those in which the autopilot responds.

    `configurations`: with their factors per stretch and band. `values`: free parameters by name,
    near enough to separate the pilot's motion from disturbances. `known`, `terms`: as for
    `joint_estimate`. `least_ratio`: explained over residual power of an angular acceleration, from
    which a band counts.
    """
    problem = joint_problem(configurations, known=known, terms=terms)
    phi = at_values(problem, values, np.zeros(len(problem.map.names)))
    every = evaluated(problem, phi).residual
    signal, errors = (
        split_blocks(blocks, [c.factors for c in configurations])
        for blocks in (signal_power(problem), every)
    )
    counted = [
        with_counted_bands(*part, least_ratio=least_ratio)
        for part in zip(configurations, signal, errors, strict=True)
    ]
    return [
        replace(c, error_correlation=error_correlation([pushes(c, e)], c.vehicle))
        for c, e in zip(counted, errors, strict=True)
    ]


def with_counted_bands(
    configuration: JointConfiguration,
    signal: Float[np.ndarray, "b 6"],
    errors: Float[np.ndarray, "b m 6"],
    *,
    least_ratio: float = LEAST_RATIO,
) -> JointConfiguration:
    """Mark the informative bands, and those in which the autopilot responds.

    `signal`: power of the accelerations; `errors`: what the model leaves of them.
    """
    residual = power_of(errors)
    factors, turns = configuration.factors, list(TURNS)
    flown = np.zeros_like(signal, dtype=bool)
    thrust = _followed_thrust(configuration, errors[:, :, THRUST])
    flown[:, turns] = excited_bands(
        factors, signal[:, turns], residual[:, turns], least_ratio=least_ratio
    )
    counted = counted_bands(factors, flown)
    counted[:, THRUST] = thrust | (factors.band[:, 0] == 0.0)
    counted = within_reach(counted, configuration)
    counted[:, YAW] &= _yawed_flights(factors, flown[:, YAW])
    with_response = flown[:, [NOISY.index(name) for name in TURN_ERRORS]]
    return replace(configuration, counted=counted, with_response=with_response)


def _yawed_flights(factors: Factors, flown: Bool[np.ndarray, " b"]) -> Bool[np.ndarray, " b"]:
    """Mark the blocks of the flights that yaw anywhere; all where none does."""
    yawed = np.zeros((len(factors), 1), dtype=bool)
    for own in flights_of(factors):
        # The means of a flight that does not yaw hold a steady push, and no more of k_d than that.
        yawed[own] = flown[own].any()
    return or_every(yawed)[:, 0]


def _followed_thrust(
    configuration: JointConfiguration, error: Float[np.ndarray, "b m"]
) -> Bool[np.ndarray, " b"]:
    """Return in which blocks the vehicle accelerates upwards as the model says, at any gain."""
    factors = configuration.factors
    measured = np.zeros_like(error)
    own = factors.R[:, :, configuration.model.layout.index("az")]
    measured[:, : own.shape[1]] = own
    # At any gain: changes of commands without a law make less or more thrust than the mean.
    return followed_bands(factors, measured, measured - error)


@frozen_dataclass
class Pushes:
    """Sums for the regression of an angular error on the force errors, per block.

    - `squares`: of the forces' errors with one another.
    - `shared`: of theirs with the turn's.
    - `power`: sum of squares of the turn's.
    """

    squares: Float[np.ndarray, "b p p"]
    shared: Float[np.ndarray, "b p"]
    power: Float[np.ndarray, " b"]
    rows: Int[np.ndarray, " b"]


def pushes(configuration: JointConfiguration, error: Float[np.ndarray, "b m 6"]) -> list[Pushes]:
    """Return the pushes on roll, pitch and yaw, of the blocks that count."""
    counted, with_response = configuration.counted, configuration.with_response
    assert counted is not None and with_response is not None
    found: list[Pushes] = []
    for axis, turn in enumerate(TURNS):
        own = counted[:, turn] & (configuration.factors.band[:, 0] > 0.0)
        # Of an axis that is flown in no band none: it shows nothing, and would bias k_t.
        own &= bool(with_response[:, axis].any())
        X, y = error[own][:, :, list(FORCES)], error[own][:, :, turn]
        found.append(
            Pushes(
                squares=X.transpose(0, 2, 1) @ X,
                shared=(X * y[:, :, None]).sum(axis=1),
                power=(y * y).sum(axis=1),
                rows=configuration.factors.rows[own],
            )
        )
    return found


def error_correlation(
    flights: Sequence[list[Pushes]], vehicle: Vehicle
) -> Float[np.ndarray, "6 6"]:
    """Return how much of the errors of the turns comes with those of the forces.

    `flights`: their pushes. `vehicle`: for its size.
    """
    shares, std = np.zeros((len(NOISY), len(NOISY))), error_correlation_std(vehicle)
    for turn, parts in zip(TURNS, zip(*flights, strict=True), strict=True):
        rows = np.concatenate([part.rows for part in parts])
        if rows.sum() <= FEWEST_ROWS:
            continue
        squares = np.concatenate([part.squares for part in parts])
        shared = np.concatenate([part.shared for part in parts])
        power = np.concatenate([part.power for part in parts])
        own: Float[np.ndarray, " p"] = np.zeros(len(FORCES))
        for _ in range(REWEIGHTED):
            # |e - P own|^2 of each block, by its sums alone.
            left = power - np.einsum("bp,p->b", 2.0 * shared - squares @ own, own)
            weight = rows / np.maximum(left, _TINY)
            known: Float[np.ndarray, "p p"] = np.eye(len(FORCES)) / std**2
            # Known before the flight: pushes are within the vehicle (`joint_problem.PUSHED_STD`).
            information: Float[np.ndarray, "p p"] = np.tensordot(weight, squares, axes=1) + known
            asked: Float[np.ndarray, " p"] = weight @ shared
            own = np.asarray(np.linalg.solve(information, asked))
        shares[turn, list(FORCES)] = own
    return shares
