"""Decide whether open loops oscillate once closed, and how far they are from it.

Nyquist's criterion, by crossings: a loop whose open poles are stable or at zero is stable when its
signed crossings of the negative real axis left of -1 cancel (Astrom and Murray 2008, section 9.2).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Callable

    from jaxtyping import Bool, Complex, Float, Int

STRIDE: Final = 0.25
"""Longest step of a loop between two frequencies, over its distance from -1. The peak of the
sensitivity between them is then at most 1 % higher than at them."""
HALVINGS: Final = 12
"""Most halvings of a step of the grid: a loop that passes through -1 would ask for any number."""
HIGHEST_START: Final = np.radians(5.0)
"""Highest phase at the lowest frequency [rad]: integrators and an unstable damping turn it down to
-360 degrees, and nothing turns it up; 5 degrees allow for rounding."""

TINY: Final = np.finfo(float).tiny
"""Least gain: a notch may leave nothing, and that has a logarithm all the same."""


@frozen_dataclass
class Margins:
    """Margins of D open loops, each the smallest over all crossings; NaN if a loop has none.

    - `crossover`: frequency at which the gain falls to 1 for the last time [Hz].
    - `phase`: smallest distance of the phase from -180 degrees at gain 1, on either side [deg];
      negative for an unstable loop.
    - `gain`: smallest factor above 1 by which a higher gain makes the loop oscillate; for an
      unstable loop the nearest factor below 1 at which that changes.
    - `lower_gain`: largest factor below 1 by which a lower gain makes the loop oscillate; for an
      unstable loop the nearest factor above 1 at which that changes.
    - `delay`: added delay at which the loop oscillates [s]; for an unstable loop minus the delay to
      take away until that changes.
    - `sensitivity`: peak of 1 / |1 + L|: by how much disturbances are amplified at worst.
    - `stable`: whether the closed loop is stable.
    """

    crossover: Float[np.ndarray, " D"]
    phase: Float[np.ndarray, " D"]
    gain: Float[np.ndarray, " D"]
    lower_gain: Float[np.ndarray, " D"]
    delay: Float[np.ndarray, " D"]
    sensitivity: Float[np.ndarray, " D"]
    stable: Bool[np.ndarray, " D"]


def margins(frequency: Float[np.ndarray, " f"], loops: Complex[np.ndarray, "D f"]) -> Margins:
    """Compute the margins of open loops L(f), on a grid of rising frequencies [Hz].

    Between two frequencies, gain and phase are taken as straight lines over the logarithm of the
    frequency; `fine_grid` makes a grid for which that is right. Below the lowest frequency the
    loop has only its integrators and dampings; at the highest its gain must be below 1, or the loop
    counts as unstable.
    """
    size: Float[np.ndarray, "D f"] = np.log(np.maximum(np.abs(loops), TINY))
    phase = open_phase(loops)
    branch: Int[np.ndarray, "D f"] = np.floor((phase + np.pi) / (2.0 * np.pi)).astype(int)
    turns = _negative_axis(size, phase, branch)
    stable = _count_encirclements(size, branch, turns) == 0
    stable &= size[:, -1] < 0.0
    crossings = _gain_one(np.log(frequency), size, phase)
    falling = crossings.rising < 0
    gain, lower_gain = _gain_margins(turns, stable)
    phase_margin, delay = _phase_margins(crossings, stable)
    return Margins(
        crossover=_choose_extreme(np.maximum, crossings.loop[falling], crossings.frequency[falling],
                           len(loops)),
        phase=phase_margin,
        gain=gain,
        lower_gain=lower_gain,
        delay=delay,
        sensitivity=1.0 / np.abs(1.0 + loops).min(axis=1),
        stable=stable,
    )  # fmt: skip


def open_phase(loops: Complex[np.ndarray, "*D f"]) -> Float[np.ndarray, "*D f"]:
    """Compute the phase of open loops, from the lowest frequency on without a leap [rad]."""
    turned: Float[np.ndarray, "*D f"] = np.unwrap(np.angle(loops), axis=-1)
    turns_off = np.ceil((turned[..., :1] - HIGHEST_START) / (2.0 * np.pi))
    return turned - 2.0 * np.pi * turns_off


def last_crossover(frequency: Float[np.ndarray, " f"], loop: Complex[np.ndarray, " f"]) -> float:
    """Find the frequency at which the gain of an open loop falls to 1 for the last time [Hz]."""
    size: Float[np.ndarray, "1 f"] = np.log(np.maximum(np.abs(loop), TINY))[None, :]
    found = _gain_one(np.log(frequency), size, np.zeros_like(size))
    falling = found.frequency[found.rising < 0]
    return float(falling[-1]) if len(falling) else float("nan")


@frozen_dataclass
class _Turns:
    """Crossings of the negative real axis: loop, logarithm of the gain, branches passed upwards."""

    loop: Int[np.ndarray, " c"]
    size: Float[np.ndarray, " c"]
    upward: Int[np.ndarray, " c"]


@frozen_dataclass
class _Crossings:
    """Crossings of gain 1: loop, frequency [Hz], phase above -180 degrees [rad], 1 if it rises."""

    loop: Int[np.ndarray, " c"]
    frequency: Float[np.ndarray, " c"]
    above: Float[np.ndarray, " c"]
    rising: Int[np.ndarray, " c"]


def _negative_axis(
    size: Float[np.ndarray, "D f"], phase: Float[np.ndarray, "D f"], branch: Int[np.ndarray, "D f"]
) -> _Turns:
    """Find where the phase is -180 degrees or full turns off it."""
    loop, i = np.nonzero(branch[:, 1:] != branch[:, :-1])
    border = 2.0 * np.pi * np.maximum(branch[loop, i], branch[loop, i + 1]) - np.pi
    share = (border - phase[loop, i]) / (phase[loop, i + 1] - phase[loop, i])
    return _Turns(
        loop=loop,
        size=size[loop, i] + share * (size[loop, i + 1] - size[loop, i]),
        upward=branch[loop, i + 1] - branch[loop, i],
    )


def _gain_one(
    at: Float[np.ndarray, " f"], size: Float[np.ndarray, "D f"], phase: Float[np.ndarray, "D f"]
) -> _Crossings:
    """Find where the gain is 1; `at` is the logarithm of the frequency."""
    above = size >= 0.0
    loop, i = np.nonzero(above[:, 1:] != above[:, :-1])
    share = size[loop, i] / (size[loop, i] - size[loop, i + 1])
    turned = phase[loop, i] + share * (phase[loop, i + 1] - phase[loop, i])
    return _Crossings(
        loop=loop,
        frequency=np.exp(at[i] + share * (at[i + 1] - at[i])),
        above=np.mod(turned + np.pi, 2.0 * np.pi),
        rising=np.where(above[loop, i + 1], 1, -1),
    )


def _count_encirclements(
    size: Float[np.ndarray, "D f"], branch: Int[np.ndarray, "D f"], turns: _Turns
) -> Int[np.ndarray, " D"]:
    """Count how often each loop encircles -1: pairs of unstable poles of the closed loop."""
    left = turns.size > 0.0
    count = np.where(size[:, 0] > 0.0, -branch[:, 0], 0)
    np.subtract.at(count, turns.loop[left], turns.upward[left])
    return count


def _gain_margins(
    turns: _Turns, stable: Bool[np.ndarray, " D"]
) -> tuple[Float[np.ndarray, " D"], Float[np.ndarray, " D"]]:
    """Find the factors of the gain nearest to 1, on either side, at which the loop passes -1."""
    higher = turns.size < 0.0
    factor = np.exp(-turns.size)
    above = _choose_extreme(np.minimum, turns.loop[higher], factor[higher], len(stable))
    below = _choose_extreme(np.maximum, turns.loop[~higher], factor[~higher], len(stable))
    return np.where(stable, above, below), np.where(stable, below, above)


def _phase_margins(
    crossings: _Crossings, stable: Bool[np.ndarray, " D"]
) -> tuple[Float[np.ndarray, " D"], Float[np.ndarray, " D"]]:
    """Find the smallest phase [deg] and delay [s] by which a crossing of gain 1 reaches -1."""
    lag, lead = crossings.above, 2.0 * np.pi - crossings.above
    pulse = 2.0 * np.pi * crossings.frequency
    nearest, later, earlier = (
        _choose_extreme(np.minimum, crossings.loop, values, len(stable))
        for values in (np.degrees(np.minimum(lag, lead)), lag / pulse, lead / pulse)
    )
    return np.where(stable, nearest, -nearest), np.where(stable, later, -earlier)


def _choose_extreme(
    choose: np.ufunc, loop: Int[np.ndarray, " c"], values: Float[np.ndarray, " c"], count: int
) -> Float[np.ndarray, " D"]:
    """Choose the smallest or largest value of each loop; NaN for a loop without one."""
    start = np.inf if choose is np.minimum else -np.inf
    found = np.full(count, start)
    choose.at(found, loop, values)
    return np.where(np.isfinite(found), found, np.nan)


def fine_grid(
    frequency: Float[np.ndarray, " f"],
    respond: Callable[[Float[np.ndarray, " f"]], Complex[np.ndarray, "D f"]],
) -> Float[np.ndarray, " g"]:
    """Halve the steps of a grid of frequencies [Hz] wherever an open loop passes -1 too quickly.

    `respond` gives all loops at some frequencies. What a loop does between two frequencies without
    a trace at either is not seen: a notch needs a frequency inside it.
    """
    loops = respond(frequency)
    ends = frequency[:-1], frequency[1:], loops[:, :-1], loops[:, 1:]
    grid = [frequency]
    for _ in range(HALVINGS):
        lows, highs, before, after = _coarse_steps(*ends)
        if not len(lows):
            break
        middle = np.sqrt(lows * highs)
        between = respond(middle)
        grid.append(middle)
        ends = (
            np.concatenate([lows, middle]),
            np.concatenate([middle, highs]),
            np.concatenate([before, between], axis=1),
            np.concatenate([between, after], axis=1),
        )
    return np.sort(np.concatenate(grid))


def _coarse_steps(
    lows: Float[np.ndarray, " i"],
    highs: Float[np.ndarray, " i"],
    before: Complex[np.ndarray, "D i"],
    after: Complex[np.ndarray, "D i"],
) -> tuple[
    Float[np.ndarray, " j"],
    Float[np.ndarray, " j"],
    Complex[np.ndarray, "D j"],
    Complex[np.ndarray, "D j"],
]:
    """Keep the steps in which a loop moves by more than `STRIDE` of its distance from -1."""
    near = np.minimum(np.abs(1.0 + before), np.abs(1.0 + after))
    coarse = (np.abs(after - before) > STRIDE * near).any(axis=0)
    return lows[coarse], highs[coarse], before[:, coarse], after[:, coarse]
