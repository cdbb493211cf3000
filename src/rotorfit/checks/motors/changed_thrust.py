"""Check whether a rotor changed during a flight, or differs from the others.

A single rotor is held against itself, between halves of a flight, and against all the others.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rotorfit.digits import with_half
from rotorfit.estimation.measured import change_of_means
from rotorfit.findings import Evidence, Finding, doubt

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Float

    from rotorfit.fit.dataset.dataset import LoadedFlight
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.model.vehicle import Vehicle

LEAST_CHANGE: Final = 0.035
"""Least change of a rotor's share of all squared speeds between a flight's halves: sound logs have
up to 0.013, one of fast outdoor flight 0.025."""
LEAST_UNLIKE: Final = 0.1
USUAL: Final = 0.06
"""Difference of a rotor's thrust coefficient from the others': sound vehicles have up to the
second, with the whole interval; the first is what is worth a word."""
ALONE: Final = 0.5
"""Share of a rotor's difference, up to which the others may differ from one another: more is a
pattern over all rotors, which no single propeller makes."""
OF_ONE_ROTOR: Final = ("kd", "Jr", "twist")
"""Means over all rotors that one speed on another scale bends, beside thrust and balance."""
SHORTEST: Final = 5.0
"""Flight [s] of which halves are compared."""
PARTS: Final = 12
"""Parts of a flight, whose scatter tells a change from motion."""
FEWEST_PARTS: Final = 3
"""Parts on either side of a change, of which the scatter is known."""
LEAST_PART: Final = 2.0
"""Length of a part in which motion averages out [s]."""
LEAST_ALONE: Final = 0.01
"""Least change of one rotor's share over the others': a propeller of four that loses 4 %."""
OTHERS: Final = 0.3
"""Share of a change that is not of one rotor alone: of a push in roll and pitch it is .58."""
CERTAIN: Final = 8.0
"""Deviations from which one rotor surely changed."""
SURE: Final = 5.0
"""Deviations from which halves differ: 26 random courses of 5 to 15 m/s, which lean to one side for
many seconds, have up to 3.1, and a change of up to .09."""


def changed_in_flight(fit: Fit) -> Iterator[Finding]:
    """Check that no rotor turns otherwise late in a flight than early."""
    for flight in fit.dataset.flights:
        data = flight.prepared.data
        squares = data.rotor_speed[data.used_rows] ** 2
        if len(squares) < SHORTEST * data.sample_rate:
            continue
        parts = len(squares) / (LEAST_PART * data.sample_rate)
        alone = lone_change(squares) if parts >= PARTS else None
        change = half_change(squares, max(int(parts), 4)) if alone is None else alone
        if change is not None:
            yield doubt(
                "rotor-changed",
                _describe_changed_rotor(flight, change),
                flights=(flight.entry.written,),
                doubtful_because=None if alone is None else "one rotor changed during a flight",
            )
            return


class RotorChange(NamedTuple):
    """Share of a rotor in all squared speeds before and after a moment.

    - `rotor`: from 0.
    - `before`, `after`: its share.
    - `moment`: share of the flight before the change.
    """

    rotor: int
    before: float
    after: float
    moment: float


def half_change(squares: Float[np.ndarray, "n N"], count: int = PARTS) -> RotorChange | None:
    """Return the largest change between a flight's halves, for whatever reason.

    None if it is small, or less than what `count` parts of the flight differ by.
    """
    first, second = (_shares_of_thrust(half) for half in np.array_split(squares, 2))
    worst = int(np.argmax(np.abs(second - first)))
    change = float(second[worst] - first[worst])
    each = min(count, PARTS) // 2
    halves = (
        np.array([_shares_of_thrust(part)[worst] for part in np.array_split(half, each)])
        for half in np.array_split(squares, 2)
    )
    _, std = change_of_means(*halves)
    if abs(change) < max(LEAST_CHANGE, SURE * float(std)):
        return None
    return RotorChange(worst, float(first[worst]), float(second[worst]), 0.5)


def lone_change(squares: Float[np.ndarray, "n N"]) -> RotorChange | None:
    """Return the surest change of one rotor alone; None if chance or motion may make it.

    A propeller that loses thrust turns faster, and the others share what is left as before. A
    push of the air, or a battery that shifts, changes roll and pitch torques without yaw: a
    pattern over all rotors. Motion makes the parts of a flight differ without any such moment.
    """
    parts = np.array([_shares_of_thrust(part) for part in np.array_split(squares, PARTS)])
    rotors = parts.shape[1]
    pattern = np.eye(rotors) - 1.0 / rotors
    sizes = parts @ pattern / (1.0 - 1.0 / rotors)
    found: RotorChange | None = None
    surest = CERTAIN
    for k in range(FEWEST_PARTS, PARTS - FEWEST_PARTS):
        # The part in which it changes is on neither side.
        first, second = parts[:k].mean(axis=0), parts[k + 1 :].mean(axis=0)
        own, std = change_of_means(sizes[:k], sizes[k + 1 :])
        left = np.linalg.norm(second - first - own[:, None] * pattern, axis=1)
        deviations = np.abs(own) / np.maximum(std, np.finfo(float).tiny)
        alone = left <= OTHERS * np.linalg.norm(second - first)
        sure = np.where(alone & (np.abs(own) >= LEAST_ALONE), deviations, 0.0)
        i = int(np.argmax(sure))
        if sure[i] > surest:
            surest = float(sure[i])
            found = RotorChange(i, float(first[i]), float(second[i]), (k + 0.5) / PARTS)
    return found


def _describe_changed_rotor(flight: LoadedFlight, change: RotorChange) -> str:
    """Explain that a rotor's share of the squared speeds changed during a flight."""
    part, rest = "half", "the second"
    if abs(change.moment - 0.5) > 1.0 / PARTS:
        part, rest = f"{100 * change.moment:.0f} %", "the rest"
    return (
        f"{Path(flight.entry.file).name}: rotor {change.rotor + 1} has {100 * change.before:.0f} % "
        f"of all squared rotor speeds in the first {part} of the flight and "
        f"{100 * change.after:.0f} % in "
        f"{rest}: its propeller broke or slipped, the battery shifted, or its speed is wrong in "
        "one of them; identify each part by itself (start and end)"
    )


def _shares_of_thrust(squares: Float[np.ndarray, "n N"]) -> Float[np.ndarray, " N"]:
    mean = squares.mean(axis=0)
    return mean / max(float(mean.sum()), np.finfo(float).tiny)


def unlike_rotors(fit: Fit) -> Iterator[Finding]:
    """Check that the rotors' thrust coefficients are alike."""
    # What a wrong scale leaves open does not make the excess itself less certain.
    numbers = fit.numbers.without_term("rotor speed scale")
    excess = most_unlike(numbers, fit.dataset.vehicle)
    if excess is None:
        return
    rotor, evidence = excess
    alone = others_differ(numbers, rotor) < ALONE * abs(evidence.value)
    sentence = unlike_sentence(rotor, evidence, alone=alone)
    is_pattern = bool(sentence) and not alone
    because = "one rotor's speed has another scale, or its propeller is another"
    if is_pattern:
        because = "something pushes the vehicle off its centre of mass"
    found = Finding(
        kind="rotor-pattern" if is_pattern else "rotor-unlike",
        severity="passed",
        numbers=("kt", "msx", "msy", *(() if is_pattern else OF_ONE_ROTOR)),
        evidence=(evidence,),
    )
    yield (
        found
        if sentence is None
        else replace(
            found,
            severity="doubt",
            sentence=sentence,
            doubtful_because=because,
            next_step=f"check rotor {rotor + 1}: its propeller, and the poles of its motor",
        )
    )


def most_unlike(numbers: Numbers, vehicle: Vehicle) -> tuple[int, Evidence] | None:
    """Estimate the additional thrust of the most outlying rotor over the others.

    None where they are not identifiable, or most pull down; rotors of declared groups may differ.
    """
    names = [f"kt_{i}" for i in range(1, len(vehicle.rotors) + 1)]
    if any(r.group is not None for r in vehicle.rotors) or not set(names) <= set(numbers.names):
        return None
    own = np.array([numbers.number(name)[0] for name in names])
    usual = float(np.median(own))
    if usual <= 0.0:
        return None
    rotor = int(np.argmax(np.abs(own / usual - 1.0)))
    value = float(own[rotor]) / usual - 1.0
    slopes = np.full(len(own), -(1.0 + value) / (len(own) - 1.0))
    slopes[rotor] = 1.0
    std = float(np.sqrt(slopes @ numbers.covariance(names) @ slopes)) / usual
    interval = (value - 1.96 * std, value + 1.96 * std)
    limit = float(np.copysign(USUAL, value))
    return rotor, Evidence(name="rotor_thrust_excess", value=value, interval=interval, limit=limit)


def others_differ(numbers: Numbers, rotor: int) -> float:
    """Compute the largest share by which other rotors' coefficients differ from their median."""
    own = [float(v) for n, v in zip(numbers.names, numbers.values, strict=True) if n[:3] == "kt_"]
    others = np.delete(own, rotor)
    return float(np.abs(others / np.median(others) - 1.0).max())


def unlike_sentence(rotor: int, excess: Evidence, *, alone: bool = True) -> str | None:
    """Explain that a rotor's thrust is far from the others'; None if chance may make it so.

    `alone`: whether it is one rotor, and no pattern over all.
    """
    low, high = excess.interval or (-np.inf, np.inf)
    if abs(excess.value) < LEAST_UNLIKE or low < USUAL < high or low < -USUAL < high:
        return None
    seen = (
        f"rotor {rotor + 1} makes {with_half(100 * abs(excess.value), 50 * (high - low))} % "
        f"{'more' if excess.value > 0 else 'less'} thrust than the others at the same speed"
    )
    if not alone:
        return (
            f"{seen}, and the others differ, too, which no single propeller does: wind or a "
            "cable pushes the vehicle off its centre of mass, or a rotor is not where it is "
            "declared; fly in still air, log the velocity, check the rotors' positions, and "
            "until then do not trust kt, the single rotors and the centre of mass"
        )
    return (
        f"{seen}: its "
        "speed has another scale (poles), or its propeller is damaged or of another type; until "
        "this is fixed do not trust kt and the centre of mass"
    )


CHECKS: Final = (unlike_rotors,)
FLIGHT_CHECKS: Final = (changed_in_flight,)
