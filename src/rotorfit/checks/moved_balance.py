"""Check whether the place about which the rotors balance moves during a flight.

A battery that slips moves the centre of mass, and the rotors on that side carry more from then on.
A fit that weights moments by how well they agree then takes the centre of mass of one part, and
the other part for noise.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.motors.changed_thrust import (
    CERTAIN,
    FEWEST_PARTS,
    LEAST_PART,
    PARTS,
    lone_change,
)
from rotorfit.estimation.measured import change_of_means
from rotorfit.findings import Finding, doubt
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Float

    from rotorfit.fit.fit import Fit

SIDES: Final = (("front", "rear"), ("left", "right"))
"""Where the balance moves along x and y, forward and back."""


@frozen_dataclass
class Move:
    """A move of the place about which the rotors balance.

    - `size`: by how much it moved [m].
    - `moment`: share of the flight before it.
    """

    size: float
    moment: float


def balance_moves(fit: Fit) -> Iterator[Finding]:
    """Check that the rotors balance about one place as long as a flight lasts."""
    places = np.array([rotor.position[:2] for rotor in fit.dataset.vehicle.rotors])
    for configured in fit.dataset.configurations:
        mass = configured.entry.mass
        for flight in configured.flights:
            data = flight.prepared.data
            squares = data.rotor_speed[data.used_rows] ** 2
            if len(squares) < PARTS * LEAST_PART * data.sample_rate or isinstance(mass, str):
                continue
            parts = balance_of_parts(squares, places)
            name = Path(flight.entry.file).name
            for axis, moment in enumerate(("msx", "msy")):
                full_name = f"{moment}@{configured.entry.name}"
                if full_name not in fit.numbers.names:
                    continue
                half = fit.numbers.number(full_name)[1] / mass
                move = surest_move(parts[:, axis])
                if move is None or abs(move.size) < half or lone_change(squares) is not None:
                    continue
                begin, end = data.time[data.used_rows][[0, -1]]
                yield doubt(
                    "balance-moves",
                    _describe_move(name, move, axis, float(move.moment * (end - begin))),
                    numbers=(moment, f"com_{'xy'[axis]}"),
                    flights=(flight.entry.written,),
                    doubtful_because="the centre of mass seems to move in flight",
                )


def balance_of_parts(
    squares: Float[np.ndarray, "n N"], places: Float[np.ndarray, "N 2"]
) -> Float[np.ndarray, "p 2"]:
    """Return the centre of the rotors' thrust in each part of a flight [m]."""
    means = np.array([part.mean(axis=0) for part in np.array_split(squares, PARTS)])
    totals = np.maximum(means.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    return means @ places / totals


def surest_move(place: Float[np.ndarray, " p"]) -> Move | None:
    """Return the surest move of a place between parts; None if their scatter may make it."""
    found, surest = None, CERTAIN
    for k in range(FEWEST_PARTS, len(place) - FEWEST_PARTS):
        # The part in which it moves is on neither side.
        change, std = change_of_means(place[:k], place[k + 1 :])
        size = float(change)
        deviations = abs(size) / max(float(std), np.finfo(float).tiny)
        if deviations > surest:
            found, surest = Move(size=size, moment=(k + 0.5) / len(place)), deviations
    return found


def _describe_move(name: str, move: Move, axis: int, second: float) -> str:
    """Explain that the rotors balance about another place from a moment of the flight on."""
    side = SIDES[axis][0 if move.size > 0.0 else 1]
    return (
        f"{name}: from about {second:.0f} s of the used part on the rotors balance "
        f"{1e3 * abs(move.size):.1f} mm further to the {side} than before: the battery or a load "
        "shifted, or wind began to push; fasten it, and identify each part by itself (--start, "
        "--end)"
    )


CHECKS: Final = (balance_moves,)
