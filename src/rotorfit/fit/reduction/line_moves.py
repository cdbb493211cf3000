r"""Lines of a flight with its motors later or slower, without its samples.

Behind a delay d and a lag :math:`\tau` the lines of what the rotors make are
:math:`e^{-i \omega d} / (1 + i \omega \tau)` times those of their commands. From
:math:`\tau_0` to :math:`\tau_1` and by a delay d their slopes by delay and lag, which are made
beside the lines, lead to

.. math:: z + S_\tau (\tau_1 - \tau_0) r + S_d \frac{e^{-i \omega d} - 1}{-i \omega} r,
    \quad r = \frac{1 + i \omega \tau_0}{1 + i \omega \tau_1},

exactly for a signal that is linear in the speeds, and to first order for all: parts that do not
move (a mean speed times a turn of the body) have no slope. The ends of a window, and a skew of the
lag, are taken to first order, too. A search for the times moves along such lines; the samples are
reduced again where it ends.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.fit.reduction.motor_timing import FreeTiming, skew_of
from rotorfit.model.signals import SignalLayout, rotor_columns

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Complex, Float

    from rotorfit.fit.reduction.reduce import BandLines
    from rotorfit.flight.motors.motor_model import MotorResponse

    Shares = Complex[np.ndarray, " l"]


def lines_at(
    stretches: Sequence[BandLines], layout: SignalLayout, free: FreeTiming, to: MotorResponse
) -> list[BandLines]:
    """Move lines that were made at `free.at`, with slopes by its times, to another timing."""
    return [_move_stretch(own, layout, free, to) for own in stretches]


def _move_stretch(
    own: BandLines, layout: SignalLayout, free: FreeTiming, to: MotorResponse
) -> BandLines:
    z, sloped = len(layout), rotor_columns(layout, sloped=True)
    lines = own.lines.copy()
    steps, factors = _shares_of_slopes(own.frequency, free, to)
    for t, name in enumerate(free.names):
        columns = slice(z + t * len(sloped), z + (t + 1) * len(sloped))
        slope = own.lines[:, columns]
        lines[:, sloped] += steps[name][:, None] * slope
        lines[:, columns] = factors[name][:, None] * slope
    return replace(own, lines=lines)


def _shares_of_slopes(
    frequency: Float[np.ndarray, " l"], free: FreeTiming, to: MotorResponse
) -> tuple[Mapping[str, Shares], Mapping[str, Shares]]:
    """Return how much of each slope a move adds to the signals, and what becomes of the slope."""
    turn = -2j * np.pi * frequency
    at, later = free.at, to.delay - free.at.delay
    slower = (1.0 - turn * at.mean_lag) / (1.0 - turn * to.mean_lag)
    late = np.exp(turn * later)
    # (e^x - 1) / x about x = 0 by its series: the first line is the mean.
    whole = np.where(turn == 0.0, 1.0, turn)
    delayed = np.where(np.abs(turn * later) < 1e-6, later, (late - 1.0) / whole)
    size = to.mean_lag / at.mean_lag if at.mean_lag > 0.0 else 1.0
    by_skew = size * slower**2 * late
    steps = {
        "motor_delay": delayed * slower,
        "motor_lag": (to.mean_lag - at.mean_lag) * slower,
        "motor_skew": (skew_of(to) - skew_of(at)) * by_skew,
    }
    factors = {
        "motor_delay": slower * late,
        "motor_lag": slower**2 * late,
        "motor_skew": by_skew,
    }
    return steps, factors
