r"""k_t of each flight by the weight that its thrust carries, and of all flights together.

Every flight weighs the same thrust coefficient. Together they know it no worse than the best of
them alone, unless they differ by more than chance allows: :math:`\chi^2` of their logarithms about
the mean (Birge, Phys. Rev. 40, 1932). Then something changed between the flights that no file
says (battery, load, propellers, density of the air), the interval covers what they differ by
(`pooled_weight`), and a check says so.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.distributions import chi_square_tail
from rotorfit.estimation.measured import Measured, mean_scale
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.fit.intervals.numbers import Numbers

CHANCE: Final = 0.01
"""Probability of chance alone below which flights contradict each other: once in a hundred sound
sets of flights, as for the two estimates of one flight (`DOUBTED`)."""
SHARED: Final = "shared by all flights"


@frozen_dataclass
class FlightWeight:
    """k_t that carries the weight in one flight.

    - `file`: name of the log.
    - `kt`: by its stretches of hover.
    """

    file: str
    kt: Measured


def chance_of_difference(flights: Sequence[FlightWeight]) -> float:
    """Compute the probability that flights of one k_t differ as much as these by chance."""
    if len(flights) < 2:
        return 1.0
    measured = [one.kt for one in flights]
    off = np.log([one.value for one in measured]) - np.log(mean_scale(measured).value)
    chi2 = float(np.sum((off / np.array([one.share for one in measured])) ** 2))
    return chi_square_tail(chi2, len(flights) - 1)


def weight_of_flights(pooled: Measured, flights: Sequence[FlightWeight]) -> Measured:
    """Limit the deviation of all flights to that of the best one, unless they contradict."""
    if not flights or chance_of_difference(flights) < CHANCE:
        return pooled
    return replace(pooled, std=min(pooled.std, best_share(flights) * pooled.value))


def best_share(flights: Sequence[FlightWeight]) -> float:
    """Return the least relative deviation of a flight's k_t."""
    return min(one.kt.share for one in flights)


def limit_by_weight(kt: Measured, weight: Measured, flights: Sequence[FlightWeight]) -> Measured:
    """Limit the deviation of k_t to what the best of several flights allows by its weight."""
    if len(flights) < 2:
        return kt
    # Changes of thrust that differ from the weight by chance widen k_t of one flight, as either of
    # the two may be wrong (Birge 1932). Several flights weigh the vehicle as many times, and agree.
    widest = max(weight.share, best_share(flights))
    return replace(kt, std=min(kt.std, widest * kt.value))


def limit_shared_error(numbers: Numbers, widest: float) -> Numbers:
    """Limit what all flights lack alike, so that k_t is no wider than in the best of them."""
    at = numbers.index("kt")
    value, half = numbers.number("kt")
    shared = next((t.half_width[at] for t in numbers.terms if t.name == SHARED), 0.0)
    others = half**2 - shared**2
    # It is in the best flight, too.
    most = float(np.sqrt(max((widest * value) ** 2 - others, 0.0)))
    if shared <= most:
        return numbers
    own = np.arange(len(numbers.names)) == at
    terms = (
        replace(t, half_width=np.where(own, most, t.half_width)) if t.name == SHARED else t
        for t in numbers.terms
    )
    return replace(numbers, terms=tuple(terms))
