"""Rounds of a timing search, and the step that the last two of them suggest.

Each round makes the signals at a timing x, and its fit moves the times by f(x), along the signals'
slopes. Where the slopes are not exact, f shrinks by about one share each round (-.6 between lag and
delay of quick motors). Two rounds show that share, and a secant step leaves it out (Anderson,
Iterative procedures for nonlinear integral equations, J. ACM 12, 1965, of depth one).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.reduction.motor_timing import FreeTiming, skew_of
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float

    from rotorfit.estimation.banded import BandedEstimate

MOST_LEAP: Final = 3.0
"""Longest accelerated step over the plain one: beyond it the two rounds do not lie on one line."""


@frozen_dataclass
class TimingRound:
    """One round: where its signals were made, and where its fit goes.

    - `names`: of the times that the fit moves.
    - `at`: the times at which the signals were made [s, s, share].
    - `move`: by how much the fit moves them.
    - `std`: their standard deviations in that fit.
    """

    names: tuple[str, ...]
    at: Float[np.ndarray, " t"]
    move: Float[np.ndarray, " t"]
    std: Float[np.ndarray, " t"]


def timing_round(free: FreeTiming, fit: BandedEstimate) -> TimingRound:
    """Collect where a fit's signals were made and by how much it moves the times."""
    places = [fit.estimate.names.index(name) for name in free.names]
    return TimingRound(
        names=free.names,
        at=_times_of(free),
        move=fit.estimate.values[places],
        std=fit.estimate.std[places],
    )


def round_between(free: FreeTiming, ended: TimingRound) -> TimingRound:
    """Return the round of a search that began with signals made at a timing, and ended so."""
    at = _times_of(free)
    return replace(ended, at=at, move=ended.at + ended.move - at)


def _times_of(free: FreeTiming) -> Float[np.ndarray, " t"]:
    """Return the free times at which the signals were made, in the order of their names."""
    at = {
        "motor_delay": free.at.delay,
        "motor_lag": free.at.mean_lag,
        "motor_skew": skew_of(free.at),
    }
    return np.array([at[name] for name in free.names])


def accelerated_move(
    own: TimingRound, last: TimingRound | None, *, longest: float
) -> Mapping[str, float]:
    """Return the move from a round by the secant through it and the last one.

    The plain move of the fit where there is no last round, where either went further than its
    slopes hold (`longest` [s]), or where the two do not suggest a step of similar length.
    """
    plain = dict(zip(own.names, own.move.tolist(), strict=True))
    if last is None or last.names != own.names:
        return plain
    seconds = [i for i, name in enumerate(own.names) if name != "motor_skew"]
    if max(np.abs(own.move[seconds]).max(), np.abs(last.move[seconds]).max()) > longest:
        return plain
    turned = (own.move - last.move) / own.std
    if not turned.any():
        return plain
    share = float(turned @ (own.move / own.std) / (turned @ turned))
    move = own.move - share * (own.at - last.at + own.move - last.move)
    too_long = np.linalg.norm(move / own.std) > MOST_LEAP * np.linalg.norm(own.move / own.std)
    return plain if too_long else dict(zip(own.names, move.tolist(), strict=True))
