"""Check whether weight and changes of thrust, and the flights, agree about k_t.

The step `weigh_thrust` takes k_t from both, with an interval that covers their difference.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.digits import with_half
from rotorfit.findings import Evidence, Finding, doubt_or_passed
from rotorfit.fit.weight.flight_weights import CHANCE, FlightWeight, chance_of_difference
from rotorfit.fit.weight.weigh_thrust import Balance, Weighing
from rotorfit.model.parameters import INERTIA, INERTIA_COM

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rotorfit.estimation.measured import Measured
    from rotorfit.fit.experiment.experiment import MotorsEntry
    from rotorfit.fit.fit import Fit

KIND: Final = "flights-weigh-differently"
OF_THRUST = ("kt", "kd", "Jr", *INERTIA, *INERTIA_COM)
"""Numbers in proportion to k_t."""
CONTRADICTED = "the weight and changes of thrust contradict each other"
_SPEED = {"measured": "rotor speed", "commanded": "command"}


def thrust_against_weight(fit: Fit) -> Iterator[Finding]:
    """Compare k_t by changes of thrust with k_t by the weight, and the flights' k_t."""
    found = fit.record_of(Weighing)
    if found is None:
        return
    yield agreement(found.balance, fit.dataset.motors)
    said = flights_weigh_alike(found.flights, fit.numbers.interval("kt"))
    if said is not None:
        yield said


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
    sentence = difference(balance, motors) if balance.is_doubted else None
    if not balance.contradicts:
        return replace(doubt_or_passed(kind, sentence, numbers=("kt",)), evidence=evidence)
    return replace(
        doubt_or_passed(kind, sentence, numbers=OF_THRUST, doubtful_because=CONTRADICTED),
        evidence=evidence,
    )


def compare_with_weight(ratio: Measured) -> str:
    """State how far a k_t is from that of the weight, by their ratio, with its 95 % interval."""
    off, half = ratio.value - 1.0, 1.96 * ratio.std
    return (
        f"kt is {with_half(100 * abs(off), 100 * half)} % {'higher' if off > 0 else 'lower'} than "
        "by the weight"
    )


def difference(balance: Balance, motors: MotorsEntry) -> str:
    """Explain that changes of thrust give another k_t than the weight."""
    changes, weight, kt = balance.changes, balance.weight, balance.kt
    assert changes is not None
    seen = (
        f"by changes of thrust with the squared {_SPEED[motors.speed]} "
        f"{compare_with_weight(changes.over(weight))}"
    )
    cure = "log the rotor speed"
    if motors.speed == "measured":
        cure = "look whether the logged speeds are no commands, calibrate the accelerometer"
    if motors.law is not None:
        cure = f"measure the law under [motors] again, {cure}"
    held = (
        f"that of the weight ({kt.value:.3g}), as doubtful"
        if balance.contradicts
        else f"their weighted mean ({kt.value:.3g})"
    )
    return (
        f"{seen}; the result has {held}, with intervals that cover the difference. The flight does "
        f"not show which of the two is wrong: {cure}, or weigh again"
    )


def flights_weigh_alike(
    flights: Sequence[FlightWeight], interval: tuple[float, float] = (-np.inf, np.inf)
) -> Finding | None:
    """State whether the flights carry the weight at one k_t; None of a single flight.

    `interval`: of k_t by all of them.
    """
    if len(flights) < 2:
        return None
    chance = chance_of_difference(flights)
    low = min(flights, key=lambda one: one.kt.value)
    high = max(flights, key=lambda one: one.kt.value)
    difference = 100.0 * (high.kt.value / low.kt.value - 1.0)
    holds = interval[0] <= low.kt.value and high.kt.value <= interval[1]
    covers = "; the interval of kt covers what the flights differ by" if holds else ""
    sentence = (
        f"kt by the weight is {difference:.2g} % higher in {high.file} than in {low.file}, more "
        f"than either allows{covers}. Weigh the vehicle with the battery of each flight; flights "
        "of another load, battery, day or set of propellers become a configuration with its own "
        "mass, or are identified separately"
    )
    return replace(
        doubt_or_passed(KIND, sentence if chance < CHANCE else None, numbers=("kt",)),
        flights=(low.file, high.file) if chance < CHANCE else (),
        evidence=(
            Evidence(name="kt_between_flights_chance", value=chance, limit=CHANCE),
            Evidence(name="kt_between_flights", value=0.01 * difference),
        ),
    )


CHECKS: Final = (thrust_against_weight,)
