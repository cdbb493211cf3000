"""How far a pilot moves roll, pitch and yaw beyond what the fit leaves unexplained.

Disturbances, which an autopilot works against, pull every estimate of an axis by about one over
this ratio.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.factors import Factors, flights_of
from rotorfit.fit.intervals.numbers import AXES, LEAST_EXCITATION
from rotorfit.fit.reduction.frequency_bands import in_pilot_band
from rotorfit.model.terms.rotors import DRAG_OF_ROTORS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from jaxtyping import Float, Int

    from rotorfit.estimation.banded import BandedEstimate
    from rotorfit.fit.joint.joint_problem import JointConfiguration


def excitation(
    fit: BandedEstimate, configurations: Sequence[JointConfiguration]
) -> dict[str, float]:
    """Return explained over residual power of the angular accelerations, where a pilot flies.

    Of a whole flight; of several as `_of_flights` weighs them.
    """
    return _excitation_ratios(fit, configurations, lambda factors: factors.recording)


def weighed_excitation(
    fit: BandedEstimate, configurations: Sequence[JointConfiguration]
) -> dict[str, float]:
    """Compute the mean excitation of single blocks, each for as long as it is."""
    # A short lively phase of a long calm flight is what tells of the vehicle.
    return _excitation_ratios(fit, configurations, lambda factors: np.arange(len(factors)))


def enough_by_weight(plain: Mapping[str, float], weighed: Mapping[str, float]) -> dict[str, float]:
    """Return the excitation by weight where that is enough, else over the whole flights."""
    return {key: rho if rho > LEAST_EXCITATION else plain[key] for key, rho in weighed.items()}


def _excitation_ratios(
    fit: BandedEstimate,
    configurations: Sequence[JointConfiguration],
    parts: Callable[[Factors], Int[np.ndarray, " b"]],
) -> dict[str, float]:
    rho: dict[str, float] = {}
    first = 0
    for c in configurations:
        last = first + len(c.factors)
        power = (fit.signal_power[first:last, 3:], fit.residual_power[first:last, 3:])
        first, flights = last, flights_of(c.factors)
        rows, part = pilots_rows(c.factors), parts(c.factors)
        means = np.array(
            [mean_ratios(rows[own], (power[0][own], power[1][own]), part[own]) for own in flights]
        )
        informative = _block_weights(c, power)
        found = _of_flights(means, np.array([informative[own].sum(axis=0) for own in flights]))
        found = np.where(found > LEAST_EXCITATION, found, np.maximum(found, flown_ratio(c, power)))
        rho |= {f"{axis}@{c.name}": float(m) for axis, m in zip(AXES, found, strict=True)}
    return rho


def flown_ratio(
    configuration: JointConfiguration,
    power: tuple[Float[np.ndarray, "b 3"], Float[np.ndarray, "b 3"]],
) -> Float[np.ndarray, " 3"]:
    """Return explained over residual power in the bands that are flown, wherever they are."""
    flown = configuration.with_response
    # In fast flight the rotors balance the air in the pilot's band, and turn the vehicle above it;
    # an autopilot that works against gusts makes a ratio of one to three there (`LEAST_RATIO`), and
    # no band of it is flown. Where the model does not know the air, zero: a pilot's motion is
    # below.
    if flown is None or DRAG_OF_ROTORS not in configuration.model.layout.added:
        return np.zeros(3)
    moving = flown & (configuration.factors.band[:, :1] > 0.0)
    whole, left = ((one * moving).sum(axis=0) for one in power)
    return (whole - left).clip(min=0.0) / np.maximum(left, np.finfo(float).tiny)


def _block_weights(
    configuration: JointConfiguration,
    power: tuple[Float[np.ndarray, "b 3"], Float[np.ndarray, "b 3"]],
) -> Float[np.ndarray, "b 3"]:
    """Compute the weight of the counted blocks, except the mean: power over residual power."""
    factors, counted = configuration.factors, configuration.counted
    moving = (factors.band[:, 0] > 0.0)[:, None]
    kept = moving & (True if counted is None else counted[:, 3:])
    left = np.maximum(power[1], np.finfo(float).tiny)
    return pilots_rows(factors)[:, None] * np.maximum(power[0] / left, 1.0) * kept


def _of_flights(
    rho: Float[np.ndarray, "f 3"], information: Float[np.ndarray, "f 3"]
) -> Float[np.ndarray, " 3"]:
    """Combine the excitation of flights, axis by axis."""
    if len(rho) == 1:
        return rho[0]
    # Each flight pulls the estimate by its own 1 / (1 + rho), with the weight of its information: a
    # calm one beside a lively one does little harm. Where none has any, all count alike.
    weight = np.where(information.any(axis=0), information, 1.0)
    bias = weight / (1.0 + rho)
    return weight.sum(axis=0) / bias.sum(axis=0) - 1.0


def pilots_rows(factors: Factors) -> Int[np.ndarray, " b"]:
    """Return the rows of each block in the pilot's band; none of the others."""
    return factors.rows * in_pilot_band(factors)


def mean_ratios(
    rows: Int[np.ndarray, " b"],
    power: tuple[Float[np.ndarray, "b 3"], Float[np.ndarray, "b 3"]],
    parts: Int[np.ndarray, " b"],
) -> Float[np.ndarray, " 3"]:
    """Return the mean over parts of explained over residual power in the pilot's band.

    - `rows`: of each block of a flight, as `pilots_rows` counts them.
    - `power`: sums of squares of its angular accelerations, and of what the fit leaves of them.
    - `parts`: number of the part to which each block belongs.
    """
    total = np.zeros(3)
    for number in np.unique(parts):
        own = parts == number
        signal, left = ((one[own] * (rows[own] > 0)[:, None]).sum(axis=0) for one in power)
        explained = np.maximum(signal - left, 0.0)
        total += rows[own].sum() * explained / np.maximum(left, np.finfo(float).tiny)
    return total / max(rows.sum(), 1)
