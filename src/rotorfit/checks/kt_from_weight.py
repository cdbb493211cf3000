r"""k_t from the weight and from changes of thrust, weighted by their certainty.

Changes of thrust against changes of specific force give one k_t (with the accelerometer's bias
free), the thrust that carries the weight another (`carried_weight.py`). The two share next to
nothing, and ln k_t is their mean with the weights of their relative variances (`combine_scales`).
Where they differ by more than these allow, one of the two is wrong by what nobody has allowed for:
the variance of the mean is scaled by :math:`\chi^2` of their difference (Birge, Phys. Rev. 40,
1932). Where they contradict each other, k_t is that of the weight, and doubtful.

Where a law makes speeds of commands, changes of thrust show how wrong its slope is
(`motors/law_from_flight.py`): what that leaves open is in the k_t of changes. Where the speeds are
by the flight, k_t is that of the weight.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from rotorfit.checks.estimated_air import estimated_air_force
from rotorfit.checks.verdicts.judge import WEAK
from rotorfit.checks.weight_by_flight import (
    FlightWeight,
    best_share,
    flights_weigh_alike,
    limit_by_weight,
    limit_shared_error,
    weight_of_flights,
)
from rotorfit.digits import with_half
from rotorfit.errors import UnsettledError
from rotorfit.estimation.effective_blocks import half_width_of_parameter
from rotorfit.estimation.measured import (
    CONTRADICTION,
    Measured,
    combine_scales,
    mean_scale,
    scale_deviations,
)
from rotorfit.findings import Evidence, Finding, doubt_or_passed, note
from rotorfit.fit.dataset.carried_weight import carrying_stretches
from rotorfit.fit.dataset.plausible_units import gravity_at_rest
from rotorfit.fit.dataset.weight_balance import Held
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.intervals.numbers import Numbers, correlation_of
from rotorfit.fit.reduction.frequency_bands import retimed
from rotorfit.fit.sensors.known_faults import ERROR, is_estimate
from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.flight_data import FlightData
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.model.parameters import INERTIA, INERTIA_COM
from rotorfit.model.terms.air import VELOCITY
from rotorfit.model.terms.body import ACCEL_BIAS_STD
from rotorfit.model.terms.rotors import spread_std
from rotorfit.model.vehicle import Vehicle

if TYPE_CHECKING:
    from rotorfit.fit.dataset.dataset import ConfigurationData, LoadedFlight
    from rotorfit.fit.experiment.experiment import MotorsEntry, Source
    from rotorfit.fit.fit import Fit

    AirOverKt = Callable[[ConfigurationData, FlightData], Float[np.ndarray, "n 3"]]
    """Force of the air over k_t, of a flight of a configuration."""

CHANGES_STD = 0.02
"""Share by which thrust that changes differs from the same thrust held: inflow, wakes, the noise
that an altitude hold feeds back."""
LAW_OPEN = "law-open"
LAW_FIRST = "find the motors' law first (by a thrust stand, or by rotor speed in the log)"
REST_STD = 0.1
"""Deviation of an accelerometer's bias in flight from that at rest (vibration, heat) [m/s^2]."""
FREE_BIAS = 3.0
"""Deviation of a bias that leaves the mean thrust open [m/s^2]."""
CAMERA_VELOCITY = 0.05
"""Deviation of a velocity by motion capture [m/s]."""
CARRIED_VELOCITY = 0.1
"""The same of one by rare positions, with the accelerometer between them [m/s]: 3 cm over .3 s."""
CAMERA_BIAS = Measured(value=0.0, std=0.01)
"""Bias of an acceleration by motion capture, over seconds [m/s^2]."""
AIR_SHARE = 0.25
AIR_STD = 0.4
"""Share of what the model's air does to the k_t of the weight that is taken, and its deviation.
Momentum theory says that rotors carry more in forward flight; the air that a leaning body pushes up
takes some of it. NeuroBEM's flights (k_t 1.55e-6) show none to half of it, simulated ones all."""
HELD_TO = 1e-4
"""Share of itself to which k_t is held: what is open of it is in the interval."""
OF_THRUST = ("kt", "kd", "Jr", *INERTIA, *INERTIA_COM)
"""Numbers in proportion to k_t."""
CONTRADICTED = "the weight and changes of thrust contradict each other"
DOUBTED = 2.58
"""Deviations by which weight and changes differ once in a hundred sound flights."""
_SPEED = {"measured": "rotor speed", "commanded": "command"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrustShares:
    """Each rotor's k_t over their mean, with its covariance by the fit and before it."""

    values: Float[np.ndarray, " N"]
    covariance: Float[np.ndarray, "N N"]
    prior: Float[np.ndarray, "N N"]

    def std_of_mean(self, load: Float[np.ndarray, " N"]) -> float:
        """Return the deviation of a mean with these weights; no flight makes it larger."""
        return float(np.sqrt(min(load @ self.covariance @ load, load @ self.prior @ load)))


@dataclass(frozen=True, slots=True, kw_only=True)
class WeighedFlight:
    """What carries the weight in one flight.

    - `file`: name of the log.
    - `stretches`: k_t of each stretch of hover.
    - `squares`: sum of each rotor's squared speed over the flight.
    """

    file: str
    stretches: tuple[Held, ...]
    squares: Float[np.ndarray, " N"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Balance:
    """k_t from changes of thrust and k_t from the weight.

    Attributes
    ----------
    changes
        By changes of thrust; None if they are not informative.
    weight
        By what carries the weight.
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
    def contradicts(self) -> bool:
        """Whether no mean of the two is right."""
        return self.deviations > CONTRADICTION

    @property
    def kt(self) -> Measured:
        """The weighted mean of both; its deviation grows with their difference."""
        return self.weight if self.changes is None else combine_scales(self.weight, self.changes)


def weigh_thrust(fit: Fit) -> Fit:
    """Take k_t from changes of thrust and from the weight, and the intervals at that k_t."""
    from rotorfit.fit.fit_flights import allow_for_settings  # `inspect` weighs without a fit

    dataset, shares = fit.dataset, thrust_shares(fit.numbers, fit.dataset.vehicle)
    weighed, weight = _weigh_flights(fit, shares)
    if weight is None:
        return allow_for_settings(fit)
    flights = _weights_by_flight(weighed, shares)
    weight = weight_of_flights(weight, flights)
    # With changes of thrust a law was found: they say nothing more of k_t.
    changes = None if dataset.law_found else kt_from_changes(fit)
    law = dataset.motors.law
    if changes is not None and law is not None:
        changes = with_open_slope(changes, law.slope_std)
    balance = Balance(changes=changes, weight=weight)
    agreed = agreement(balance, dataset.motors)
    doubted = agreed.severity == "doubt"
    kt = balance.kt if doubted else limit_by_weight(balance.kt, weight, flights)
    held = held_at(fit, kt).found(agreed)
    if not doubted and len(flights) > 1:
        widest = 1.96 * max(kt.share, best_share(flights))
        held = replace(held, numbers=limit_shared_error(held.numbers, widest))
    said = flights_weigh_alike(flights)
    return held if said is None else held.found(said)


def with_open_slope(changes: Measured, slope_std: float) -> Measured:
    """Add what is open of a law's slope, as a share, to the k_t of changes of thrust."""
    return replace(changes, std=float(np.hypot(changes.std, slope_std * changes.value)))


def weight_of(fit: Fit) -> Measured | None:
    """Estimate the thrust coefficient that carries the weight in the flights of a fit."""
    return _weigh_flights(fit, thrust_shares(fit.numbers, fit.dataset.vehicle))[1]


def _weigh_flights(
    fit: Fit, shares: ThrustShares | None
) -> tuple[list[WeighedFlight], Measured | None]:
    """Weigh the flights of a fit, with what the air carries where their velocity is known."""
    dataset = fit.dataset
    kt = float(fit.numbers.values[fit.numbers.index("kt")])

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
        return flights, still
    through_air = weigh(air_over_kt)
    moving = kt_of_stretches(through_air, shares)
    if moving is None:
        return flights, still
    gained = moving.value - still.value
    # What scatters is less with the air of the fit, whose coefficients are no better known for it.
    std = float(np.hypot(max(still.std, moving.std), AIR_STD * gained))
    return flights, Measured(value=still.value + AIR_SHARE * gained, std=std)


def _weights_by_flight(
    weighed: Sequence[WeighedFlight], shares: ThrustShares | None
) -> list[FlightWeight]:
    """Return k_t of every flight that is long enough."""
    found = ((one.file, kt_of_stretches((one,), shares)) for one in weighed)
    return [FlightWeight(file=file, kt=kt) for file, kt in found if kt is not None]


def kt_from_changes(fit: Fit) -> Measured | None:
    """Estimate k_t with the accelerometer's bias free, so that the mean thrust does not count.

    None where it is not identifiable so. Inflow and an altitude hold act on thrust alone, so that
    its own blocks, and not the scatter of turns, say how certain changes of thrust are.
    """
    from rotorfit.fit.fit import refit

    names = [n for n in fit.estimate.estimate.names if n.startswith("accel_bias_z@")]
    begin = fit.estimate.estimate.by_name
    try:
        free = refit(fit, fit.dataset, begin=begin, known=dict.fromkeys(names, (0.0, FREE_BIAS)))
    except UnsettledError:
        return None
    value, std = kt_of(free.numbers)
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


def kt_from_weight(
    configurations: Sequence[ConfigurationData],
    vehicle: Vehicle,
    *,
    source: Source = "imu",
    timing: MotorResponse | None = None,
    shares: ThrustShares | None = None,
) -> Measured | None:
    """Estimate the thrust coefficient that carries the weight; None if no flight is long enough.

    `timing`: of the motors, where it was found: commands that swing, as in a limit cycle, have
    larger squares than the speeds that lag behind them. `shares`: of the rotors, where they were
    found: with the centre of mass off the centre, some rotors carry more of the weight than others,
    and it is their k_t.
    """
    return kt_of_stretches(
        list(weighed_flights(configurations, vehicle, source=source, timing=timing)), shares
    )


def weighed_flights(
    configurations: Sequence[ConfigurationData],
    vehicle: Vehicle,
    *,
    source: Source,
    timing: MotorResponse | None,
    air: AirOverKt | None = None,
) -> Iterator[WeighedFlight]:
    """Yield the k_t that carries the weight in the stretches of every flight.

    `air`: force of the air over k_t, where a fit knows it: at speed rotors lose thrust to the air
    through them, and their drag carries a part of the weight.
    """
    for configured in configurations:
        for flight in configured.flights:
            data = retimed(flight.prepared, timing)
            bias, velocity_std = bias_and_velocity_std(flight, source)
            stretches = carrying_stretches(
                data,
                flight.turning,
                vehicle,
                mass=configured.mass,
                bias=bias,
                velocity_std=velocity_std,
                air=None if air is None else air(configured, data),
            )
            squares = np.square(data.rotor_speed[data.used_rows]).sum(axis=0)
            yield WeighedFlight(
                file=Path(flight.entry.file).name, stretches=tuple(stretches), squares=squares
            )


def kt_of_stretches(
    flights: Sequence[WeighedFlight], shares: ThrustShares | None
) -> Measured | None:
    """Average the k_t of the stretches of some flights, for the rotors' mean."""
    weight = pooled_weight([held for one in flights for held in one.stretches])
    if weight is None or shares is None:
        return weight
    squares = np.sum([one.squares for one in flights], axis=0)
    load = squares / squares.sum()
    kt = weight.value / float(load @ shares.values)
    return Measured(value=kt, std=float(np.hypot(weight.std, kt * shares.std_of_mean(load))))


def bias_and_velocity_std(flight: LoadedFlight, source: Source) -> tuple[Measured, float]:
    """Return the bias of a flight's vertical acceleration [m/s^2] and what its velocity is off."""
    data = flight.prepared.data
    bias = bias_at_rest(data) if source == "imu" else CAMERA_BIAS
    return bias, velocity_std_of(data, estimated=is_estimate(flight.log.format))


def velocity_std_of(data: FlightData, *, estimated: bool) -> float:
    """Return the deviation of `FlightData.any_velocity` [m/s].

    `estimated`: where the log's velocity is the autopilot's estimate.
    """
    if data.velocity is None:
        return CARRIED_VELOCITY
    return ERROR if estimated else CAMERA_VELOCITY


def thrust_shares(numbers: Numbers, vehicle: Vehicle) -> ThrustShares | None:
    """Return each rotor's share, by the fit; None if it has one k_t for all."""
    n = len(vehicle.rotors)
    names = [f"kt_{i + 1}" for i in range(n)]
    if not set(names) <= set(numbers.names):
        return None
    kt = np.array([numbers.number(name)[0] for name in names])
    # What all have in common is no share.
    centred = np.eye(n) - 1.0 / n
    known = numbers.covariance(names) / kt.mean() ** 2
    before = np.diag([spread_std(rotor) ** 2 for rotor in vehicle.rotors])
    return ThrustShares(
        values=kt / kt.mean(),
        covariance=centred @ known @ centred,
        prior=centred @ before @ centred,
    )


def pooled_weight(found: Sequence[Held]) -> Measured | None:
    """Average stretches that differ by chance, and by a random effect where they differ more.

    Batteries, air and propellers are not the same in every flight: then each counts alike.

    References
    ----------
    DerSimonian and Laird, Controlled Clinical Trials 7, 1986.
    """
    if not found:
        return None
    measured = [Measured(value=one.ratio, std=one.std) for one in found]
    log_kt = np.log([one.value for one in measured])
    weight = np.array([one.share**-2.0 for one in measured])
    left = float(weight @ (log_kt - weight @ log_kt / weight.sum()) ** 2) - (len(found) - 1)
    spare = float(weight.sum() - weight @ weight / weight.sum())
    effect = max(left / spare, 0.0) if len(found) > 1 else 0.0
    return mean_scale(measured, spread=effect**0.5)


def bias_at_rest(flight: FlightData) -> Measured:
    """Return the accelerometer's bias along the vertical, by its reading at rest [m/s^2]."""
    rest = gravity_at_rest(flight)
    before = Measured(value=0.0, std=ACCEL_BIAS_STD)
    if rest is None:
        return before
    return before.with_other(Measured(value=(rest - 1.0) * GRAVITY, std=REST_STD))


def agreement(balance: Balance, motors: MotorsEntry) -> Finding:
    """State whether weight and changes of thrust agree."""
    kind, weight, changes = "thrust-against-weight", balance.weight, balance.changes
    if changes is None:
        return doubt_or_passed(kind, None, {"kt_of_weight": weight.value})
    ratio = changes.over(weight)
    evidence = (
        Evidence(name="thrust_over_weight", value=ratio.value, interval=ratio.interval),
        Evidence(name="kt_of_weight", value=weight.value),
    )
    sentence = difference(balance, motors) if balance.deviations > DOUBTED else None
    if not balance.contradicts:
        return replace(doubt_or_passed(kind, sentence, numbers=("kt",)), evidence=evidence)
    return replace(
        doubt_or_passed(kind, sentence, numbers=OF_THRUST, doubtful_because=CONTRADICTED),
        evidence=evidence,
    )


def open_law(numbers: Numbers, reach: float) -> Iterator[Finding]:
    """Note of which inertia the law leaves more open than all else does: no flying sharpens it.

    `reach`: half of the 95 % interval that the law leaves, as a share.
    """
    open_ones = [
        name
        for name in numbers.names
        if name.partition("@")[0] in ("Ixx", "Iyy")
        if law_decides(reach, numbers.number(name)[1] / abs(numbers.number(name)[0]))
    ]
    if open_ones:
        because = f"the law from command to rotor speed leaves {100 * reach:.0f} % of it open"
        yield note(
            LAW_OPEN, "", numbers=tuple(open_ones), next_step=LAW_FIRST, useless_because=because
        )


def law_decides(reach: float, width: float) -> bool:
    """Test whether what the law leaves open is the larger part of a half-width, both as shares.

    Or makes a number weak by itself, however it is flown.
    """
    return reach > WEAK or reach**2 > 0.5 * width**2


def difference(balance: Balance, motors: MotorsEntry) -> str:
    """Explain that changes of thrust give another k_t than the weight."""
    changes, weight, kt = balance.changes, balance.weight, balance.kt
    assert changes is not None
    ratio = changes.over(weight)
    off, half = ratio.value - 1.0, 1.96 * ratio.std
    seen = (
        f"by changes of thrust with the squared {_SPEED[motors.speed]} kt is "
        f"{with_half(100 * abs(off), 100 * half)} % {'higher' if off > 0 else 'lower'} than by "
        "the weight"
    )
    cure = "log the rotor speed" if motors.speed == "commanded" else "calibrate the accelerometer"
    if motors.law is not None:
        cure = f"measure the law under [motors] again, {cure}"
    held = (
        f"the result has that of the weight ({kt.value:.3g}), as doubtful"
        if balance.contradicts
        else f"the result has their weighted mean ({kt.value:.3g})"
    )
    return (
        f"{seen}: {held}, and the intervals of kt and "
        "inertia cover the difference; the flight does not show which of the two is wrong: "
        f"{cure}, or weigh again"
    )
