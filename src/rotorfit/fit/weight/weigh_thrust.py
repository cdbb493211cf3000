r"""k_t from the weight and from changes of thrust, weighted by their certainty.

Changes of thrust against changes of specific force give one k_t (with the accelerometer's bias
free), the thrust that carries the weight another (`carried_weight.py`). The two share next to
nothing, and ln k_t is their mean with the weights of their relative variances (`combine_scales`).
Where they differ by more than these allow, one of the two is wrong by what nobody has allowed for:
the variance of the mean is scaled by :math:`\chi^2` of their difference (Birge, Phys. Rev. 40,
1932), and its interval reaches both once they differ by more than sound flights do. Where they
contradict each other, k_t is that of the weight, and doubtful.

Where a law makes speeds of commands, changes of thrust show how wrong its slope is
(`motors/law_from_thrust.py`): what that leaves open is in the k_t of changes. Where the speeds are
by the flight, k_t is that of the weight.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import UnsettledError
from rotorfit.estimation.effective_blocks import half_width_of_parameter
from rotorfit.estimation.measured import (
    CONTRADICTION,
    DOUBTED,
    Measured,
    combine_scales,
    scale_deviations,
)
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.intervals.numbers import Numbers, correlation_of
from rotorfit.fit.weight.estimated_air import estimated_air_force
from rotorfit.fit.weight.flight_weights import (
    FlightWeight,
    best_share,
    limit_by_weight,
    limit_shared_error,
    weight_of_flights,
)
from rotorfit.fit.weight.kt_from_weight import (
    ThrustShares,
    WeighedFlight,
    kt_of_stretches,
    thrust_shares,
    weighed_flights,
)
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.terms.air import VELOCITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.fit.dataset.dataset import ConfigurationData
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.weight.kt_from_weight import AirOverKt
    from rotorfit.flight.flight_data import FlightData

CHANGES_STD = 0.02
"""Share by which thrust that changes differs from the same thrust held: inflow, wakes, the noise
that an altitude hold feeds back."""
FREE_BIAS = 3.0
"""Deviation of a bias that leaves the mean thrust open [m/s^2]."""
AIR_SHARE = 0.25
AIR_STD = 0.4
"""Share of what the model's air does to the k_t of the weight that is taken, and its deviation.
Momentum theory says that rotors carry more in forward flight; the air that a leaning body pushes up
takes some of it. NeuroBEM's flights (k_t 1.55e-6) show none to half of it, simulated ones all."""
HELD_TO = 1e-4
"""Share of itself to which k_t is held: what is open of it is in the interval."""


@frozen_dataclass
class Balance:
    """k_t from changes of thrust and k_t from the weight.

    - `changes`: by changes of thrust; None if they are not informative.
    - `weight`: by what carries the weight.
    """

    changes: Measured | None
    weight: Measured

    @property
    def deviations(self) -> float:
        """How many deviations they differ by, if thrust goes with the square of the speed."""
        if self.changes is None:
            return 0.0
        return scale_deviations(self.weight, self.changes)

    @property
    def is_doubted(self) -> bool:
        """Whether the two differ by more than sound flights do."""
        return self.deviations > DOUBTED

    @property
    def contradicts(self) -> bool:
        """Whether no mean of the two is right."""
        return self.deviations > CONTRADICTION

    @property
    def kt(self) -> Measured:
        """The weighted mean of both; its deviation grows with their difference."""
        return self.weight if self.changes is None else combine_scales(self.weight, self.changes)


@frozen_dataclass
class Weighing:
    """What the step `weigh_thrust` found, from which checks make their findings.

    - `balance`: k_t by changes of thrust and by the weight.
    - `flights`: k_t by the weight in each flight that is long enough.
    """

    balance: Balance
    flights: tuple[FlightWeight, ...]


def weigh_thrust(fit: Fit) -> Fit:
    """Take k_t from changes of thrust and from the weight, and the intervals at that k_t."""
    from rotorfit.fit.fit_flights import allow_for_settings  # `inspect` weighs without a fit

    dataset, shares = fit.dataset, thrust_shares(fit.numbers, fit.dataset.vehicle)
    weighed, weight, air = _weigh_flights(fit, shares)
    if weight is None:
        return allow_for_settings(fit)
    flights = _weights_by_flight(weighed, shares)
    # What the air carries is open of every flight alike: none of them limits it.
    weight = with_open_share(weight_of_flights(weight, flights), air)
    # With changes of thrust a law was found: they say nothing more of k_t.
    changes = None if dataset.law_found else kt_from_changes(fit)
    law = dataset.motors.law
    if changes is not None and law is not None:
        changes = with_open_share(changes, law.slope_std)
    balance = Balance(changes=changes, weight=weight)
    kt = balance.kt if balance.is_doubted else limit_by_weight(balance.kt, weight, flights)
    held = held_at(fit, kt)
    if not balance.is_doubted and len(flights) > 1:
        widest = 1.96 * max(kt.share, best_share(flights))
        held = replace(held, numbers=limit_shared_error(held.numbers, widest))
    return held.with_record(Weighing(balance=balance, flights=tuple(flights)))


def with_open_share(kt: Measured, share: float) -> Measured:
    """Add what a law's slope or the air leaves open of k_t, as a share of it."""
    return replace(kt, std=float(np.hypot(kt.std, share * kt.value)))


def weight_of(fit: Fit) -> Measured | None:
    """Estimate the thrust coefficient that carries the weight in the flights of a fit."""
    _, weight, air = _weigh_flights(fit, thrust_shares(fit.numbers, fit.dataset.vehicle))
    return None if weight is None else with_open_share(weight, air)


def _weigh_flights(
    fit: Fit, shares: ThrustShares | None
) -> tuple[list[WeighedFlight], Measured | None, float]:
    """Weigh the flights of a fit: each, all together, and the share that the air leaves open."""
    dataset, (kt, _) = fit.dataset, kt_of(fit.numbers)

    def air_over_kt(configured: ConfigurationData, data: FlightData) -> Float[np.ndarray, "n 3"]:
        shape = dataset.vehicle, dataset.model.layout
        return estimated_air_force(data, fit.numbers, configured.entry.name, shape) / kt

    def weigh(air: AirOverKt | None) -> list[WeighedFlight]:
        return list(
            weighed_flights(
                dataset.configurations,
                dataset.vehicle,
                source=dataset.source,
                timing=dataset.timing,
                air=air,
            )
        )

    flights = weigh(None)
    still = kt_of_stretches(flights, shares)
    if still is None or VELOCITY not in dataset.model.layout.added:
        return flights, still, 0.0
    moving = kt_of_stretches(weigh(air_over_kt), shares)
    if moving is None:
        return flights, still, 0.0
    gained = moving.value - still.value
    # What scatters is less with the air of the fit, whose coefficients are no better known for it.
    value, std = still.value + AIR_SHARE * gained, max(still.std, moving.std)
    return flights, Measured(value=value, std=std), abs(AIR_STD * gained) / value


def _weights_by_flight(
    weighed: Sequence[WeighedFlight], shares: ThrustShares | None
) -> list[FlightWeight]:
    """Return k_t of every flight that is long enough."""
    found = ((one.file, kt_of_stretches((one,), shares)) for one in weighed)
    return [FlightWeight(file=file, kt=kt) for file, kt in found if kt is not None]


def kt_from_changes(fit: Fit) -> Measured | None:
    """Estimate k_t by changes of thrust, the accelerometer's bias being free; None if open."""
    from rotorfit.fit.fit import refit

    names = [n for n in fit.estimate.estimate.names if n.startswith("accel_bias_z@")]
    begin = fit.estimate.estimate.by_name
    try:
        free = refit(fit, fit.dataset, begin=begin, known=dict.fromkeys(names, (0.0, FREE_BIAS)))
    except UnsettledError:
        return None
    value, std = kt_of(free.numbers)
    # Inflow and an altitude hold act on thrust alone, so that its own blocks, and not the scatter
    # of turns, say how certain changes of thrust are.
    std = max(std, half_width_of_parameter(free.estimate, "kt") / 1.96)
    return Measured(value=value, std=float(np.hypot(std, CHANGES_STD * value)))


def held_at(fit: Fit, kt: Measured) -> Fit:
    """Fit again with k_t held, and its uncertainty in every interval."""
    from rotorfit.fit.fit import refit, shift_of
    from rotorfit.fit.fit_flights import allow_for_settings

    known = {"kt": (kt.value, HELD_TO * kt.value)}
    begin = {**fit.estimate.estimate.by_name, "kt": kt.value}
    held = allow_for_settings(refit(fit, fit.dataset, begin=begin, known=known))
    off = kt.value - min(kt.std, 0.5 * abs(kt.value))
    begin = {**held.estimate.estimate.by_name, "kt": off}
    moved = shift_of(held, held.dataset, begin=begin, known={"kt": (off, HELD_TO * off)})
    moved = moved * kt.std / (kt.value - off)
    # The excitation is that of the fit that follows the flights best.
    best = fit.numbers
    numbers = with_common_shift(held.numbers, moved)
    numbers = replace(numbers, excitation=best.excitation, weighed=best.weighed)
    return replace(held, numbers=numbers)


def with_common_shift(numbers: Numbers, moved: Float[np.ndarray, " q"]) -> Numbers:
    """Append the term of a shift common to all numbers, given for one deviation of k_t."""
    wider = numbers.with_terms(
        IntervalTerm(
            name="thrust by weight",
            half_width=1.96 * np.abs(moved),
            source="the weight in hover and changes of thrust",
        )
    )
    known = np.flatnonzero(np.isfinite(wider.half_width))
    own = numbers.covariance([numbers.names[i] for i in known])
    together = numbers.correlation.copy()
    common = np.outer(moved[known], moved[known])
    together[np.ix_(known, known)] = correlation_of(own + common)
    return replace(wider, correlation=together)


def kt_of(numbers: Numbers) -> tuple[float, float]:
    """Return value and standard deviation of k_t."""
    value, half = numbers.number("kt")
    return value, half / 1.96
