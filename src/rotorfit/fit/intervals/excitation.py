"""How far a pilot moves roll, pitch and yaw beyond what the fit leaves unexplained.

Disturbances, which an autopilot works against, pull every estimate of an axis by about one over
this ratio.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from rotorfit.estimation.banded import BandedEstimate
from rotorfit.estimation.factors import Factors, flights_of
from rotorfit.fit.intervals.numbers import AXES, LEAST_EXCITATION
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.reduction.frequency_bands import in_pilot_band, or_every


def excitation(
    fit: BandedEstimate, configurations: Sequence[JointConfiguration]
) -> dict[str, float]:
    """Return explained over residual power of the angular accelerations, where a pilot flies.

    Of several flights the mean, each for as long as it is: the fit gives every flight the weight
    of its own noise, so that a calm one beside a lively one does no harm.
    """
    return _ratios(fit, configurations, lambda c: c.factors.recording, _every_turn)


def weighed_excitation(
    fit: BandedEstimate, configurations: Sequence[JointConfiguration]
) -> dict[str, float]:
    """Compute the mean excitation of single blocks, each with its weight in the fit.

    A short lively phase of a long calm flight is what tells of the vehicle. A flight of which the
    fit counts nothing of an axis, but its mean, is left out of that axis.
    """
    return _ratios(fit, configurations, lambda c: np.arange(len(c.factors)), _fitted_flights)


def enough_by_weight(plain: Mapping[str, float], weighed: Mapping[str, float]) -> dict[str, float]:
    """Return the excitation by weight where that is enough, else over the whole flights."""
    return {key: rho if rho > LEAST_EXCITATION else plain[key] for key, rho in weighed.items()}


def _every_turn(configuration: JointConfiguration) -> Bool[np.ndarray, "b 3"]:
    return np.ones((len(configuration.factors), 3), dtype=bool)


def _fitted_flights(configuration: JointConfiguration) -> Bool[np.ndarray, "b 3"]:
    """Mark roll, pitch and yaw of the flights of which the fit counts any motion of that axis."""
    factors, counted = configuration.factors, configuration.counted
    if counted is None:
        return _every_turn(configuration)
    kept = np.zeros((len(factors), 3), dtype=bool)
    moving = (factors.band[:, 0] > 0.0) & in_pilot_band(factors)
    for own in flights_of(factors):
        kept[own] = counted[own & moving, 3:].any(axis=0)
    return or_every(kept)


def _ratios(
    fit: BandedEstimate,
    configurations: Sequence[JointConfiguration],
    parts: Callable[[JointConfiguration], Int[np.ndarray, " b"]],
    kept: Callable[[JointConfiguration], Bool[np.ndarray, "b 3"]],
) -> dict[str, float]:
    rho: dict[str, float] = {}
    first = 0
    for c in configurations:
        last = first + len(c.factors)
        power = (fit.signal_power[first:last, 3:], fit.residual_power[first:last, 3:])
        first = last
        means = mean_ratios(c.factors, power, parts(c), kept(c))
        rho |= {f"{axis}@{c.name}": float(m) for axis, m in zip(AXES, means, strict=True)}
    return rho


def mean_ratios(
    factors: Factors,
    power: tuple[Float[np.ndarray, "b 3"], Float[np.ndarray, "b 3"]],
    parts: Int[np.ndarray, " b"],
    kept: Bool[np.ndarray, "b 3"],
) -> Float[np.ndarray, " 3"]:
    """Return the mean over parts of explained over residual power in the pilot's band.

    - `factors`: of one configuration.
    - `power`: sums of squares of its angular accelerations, and of what the fit leaves of them.
    - `parts`: number of the part to which each block belongs.
    - `kept`: blocks that are averaged, axis by axis.
    """
    inside = kept & in_pilot_band(factors)[:, None]
    rows = factors.rows[:, None] * inside
    total = np.zeros(3)
    for number in np.unique(parts):
        own = parts == number
        signal, left = ((one[own] * inside[own]).sum(axis=0) for one in power)
        explained = np.maximum(signal - left, 0.0)
        total += rows[own].sum(axis=0) * explained / np.maximum(left, np.finfo(float).tiny)
    return total / np.maximum(rows.sum(axis=0), 1.0)
