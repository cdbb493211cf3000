"""Find by how much each rotor turns faster or slower than the others at the same command."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.motors.telemetry_pair import LONGEST_CONSTANT, advance_samples
from rotorfit.flight.signals import true_runs, whole_samples

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

    from rotorfit.flight.motors.telemetry_pair import TelemetryPair

UNLIKE: Final = 0.1
"""Share by which a rotor's speed may differ from the others' at the same command."""
SURE: Final = 4.0
"""Deviations of the mean by which it must."""
FEWEST_ALIKE: Final = 3
"""Rotors of which one can be unlike the others: of two nobody can say which."""
ROUNDS: Final = 8
"""Rounds of the law that all rotors share, each with less weight on speeds far from it."""


def speed_ratios(pair: TelemetryPair, shift: int) -> dict[int, tuple[float, float]]:
    """Estimate each rotor's speed over the others' at the same command, with its deviation.

    One law of a constant and a slope for all, each rotor with a factor of its own. The
    deviation is that of the means of seconds. A rotor that is unlike the others takes no part in
    the law: it would bend it, and sound rotors would be blamed with it.
    """
    if len(pair.live) < 3:
        return {}
    step = whole_samples(pair.rate)
    seconds = np.flatnonzero(pair.used)
    seconds = seconds[: len(seconds) // step * step].reshape(-1, step)
    command = pair.command[:, pair.live][seconds].mean(axis=1)
    speed = advance_samples(_without_stuck(pair), shift)[seconds].mean(axis=1)
    if not np.isfinite(speed).any(axis=0).all():
        return {}
    alike: Bool[np.ndarray, " k"] = np.ones(len(pair.live), dtype=bool)
    found = _ratios_by_law(command, speed, alike)
    while found is not None and alike.sum() > FEWEST_ALIKE and _any_unlike(*found, alike):
        alike[_odd_rotor(command, speed, alike)] = False
        found = _ratios_by_law(command, speed, alike)
    if found is None:
        return {}
    factor, std = found
    return {
        int(i): (_over_others(factor, alike, k), float(std[k])) for k, i in enumerate(pair.live)
    }


def _over_others(factor: Float[np.ndarray, " k"], alike: Bool[np.ndarray, " k"], own: int) -> float:
    """Return a rotor's factor over the median of the others `alike`."""
    others = alike & (np.arange(len(alike)) != own)
    return float(factor[own] / np.median(factor[others]))


def is_unlike(ratio: float, std: float) -> bool:
    """Return whether a rotor's speed is surely another than the others' at the same command."""
    return abs(ratio - 1.0) > max(UNLIKE, SURE * std)


def _any_unlike(
    factor: Float[np.ndarray, " k"], std: Float[np.ndarray, " k"], alike: Bool[np.ndarray, " k"]
) -> bool:
    """Return whether one of the rotors `alike` surely differs from the others."""
    rotors = np.flatnonzero(alike).tolist()
    return any(is_unlike(_over_others(factor, alike, i), float(std[i])) for i in rotors)


def _odd_rotor(
    command: Float[np.ndarray, "m k"],
    speed: Float[np.ndarray, "m k"],
    alike: Bool[np.ndarray, " k"],
) -> int:
    """Return which rotor leaves the others most alike when it takes no part in the law."""
    left: dict[int, float] = {}
    for i in np.flatnonzero(alike).tolist():
        others = alike.copy()
        others[i] = False
        found = _ratios_by_law(command, speed, others)
        left[i] = np.inf if found is None else float(np.abs(np.log(found[0][others])).max())
    return min(left, key=lambda i: left[i])


def _ratios_by_law(
    command: Float[np.ndarray, "m k"],
    speed: Float[np.ndarray, "m k"],
    alike: Bool[np.ndarray, " k"],
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]] | None:
    """Fit the law of the rotors `alike`; return each rotor's factor of it, with its deviation.

    The median of the factors is 1. Law and factors are moved together (Gauss and Newton): in a
    hover the commands differ more between rotors than in time, so that moved in turns they would
    creep, and a rotor that is unlike would bend the law on the way.
    """
    known = np.isfinite(speed)
    filled = np.where(known, speed, 0.0)
    weight = np.where(known & alike, 1.0, 0.0)
    factor: Float[np.ndarray, " k"] = np.ones(len(alike))
    law = _solve_rows(_law_rows(command, np.zeros_like(command)), filled, weight)[:2]
    deviations: Float[np.ndarray, " k"] = np.zeros(len(alike))
    for _ in range(ROUNDS):
        expected = float(law[0]) + float(law[1]) * command
        if not (expected > 0.0).all():
            return None
        rows = _law_rows(command, expected)
        step = _solve_rows(rows, filled / factor - expected, weight)
        law, factor = law + step[:2], factor * np.exp(np.clip(step[2:], -1.0, 1.0))
        expected = float(law[0]) + float(law[1]) * command
        if not (expected > 0.0).all():
            return None
        shares = np.where(known, speed, np.nan) / expected
        # A rotor beside the law has moved by nothing.
        factor = np.where(alike, factor, np.nanmedian(shares, axis=0))
        if not (factor > 0.0).all():
            return None
        middle = float(np.median(factor[alike]))
        law, factor, shares = law * middle, factor / middle, shares / middle
        # Least sums of absolute values: a rotor that reads anything must not bend the law of all.
        off = np.abs(shares / factor - 1.0)
        least = max(float(np.nanmedian(off)), 1e-6)
        weight = np.where(known & alike, 1.0 / np.sqrt(np.maximum(np.nan_to_num(off), least)), 0.0)
        deviations = np.nanstd(shares, axis=0) / np.sqrt(np.maximum(known.sum(axis=0), 1))
    return factor, deviations


def _law_rows(
    command: Float[np.ndarray, "m k"], expected: Float[np.ndarray, "m k"]
) -> Float[np.ndarray, "m k c"]:
    """Stack the slopes of speed over factor: by constant, slope, and logarithms of the factors."""
    own = expected[:, :, None] * np.eye(command.shape[1])
    return np.concatenate([np.ones_like(command)[:, :, None], command[:, :, None], own], axis=2)


def _solve_rows(
    rows: Float[np.ndarray, "m k c"],
    wanted: Float[np.ndarray, "m k"],
    weight: Float[np.ndarray, "m k"],
) -> Float[np.ndarray, " c"]:
    """Solve weighted rows by least squares; what no row shows stays zero."""
    # Columns of one size: speeds are hundreds of rad/s, commands below one.
    weighted = (weight[:, :, None] * rows).reshape(-1, rows.shape[2])
    size = np.linalg.norm(weighted, axis=0)
    size[size == 0.0] = 1.0
    target = (weight * wanted).ravel()
    found = np.asarray(np.linalg.lstsq(weighted / size, target, rcond=1e-9)[0], float)
    return found / size


def _without_stuck(pair: TelemetryPair) -> Float[np.ndarray, "n k"]:
    """Return the speeds of the live rotors, NaN if a speed stands still or is 0 in the air."""
    speed = pair.speed[:, pair.live].copy()
    least = whole_samples(LONGEST_CONSTANT * pair.rate)
    for column in speed.T:
        same = np.concatenate([np.diff(column) == 0.0, [False]])
        for a, b in true_runs(same):
            if b - a > least:
                column[a : b + 1] = np.nan
        column[pair.used & (column == 0.0)] = np.nan
    return speed
