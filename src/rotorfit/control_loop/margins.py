"""How far an open loop is from oscillating."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float


@dataclass(frozen=True, slots=True, kw_only=True)
class Margins:
    """Margins of D open loops; NaN where a loop has none.

    Attributes
    ----------
    crossover
        Frequency at which the gain falls to 1 for the last time [Hz].
    phase
        Phase left at any crossing of gain 1, the least [deg].
    gain
        Factor of the gain at which the loop oscillates.
    delay
        Time by which the loop may be later until it oscillates, the least [s].
    sensitivity
        Peak of 1 / |1 + L|: by how much disturbances are amplified at worst.
    stable
        Whether the closed loop is stable.
    """

    crossover: Float[np.ndarray, " D"]
    phase: Float[np.ndarray, " D"]
    gain: Float[np.ndarray, " D"]
    delay: Float[np.ndarray, " D"]
    sensitivity: Float[np.ndarray, " D"]
    stable: Bool[np.ndarray, " D"]


def margins(frequency: Float[np.ndarray, " f"], loops: Complex[np.ndarray, "D f"]) -> Margins:
    """Compute the margins of open loops L(f), on a grid of rising frequencies [Hz].

    A loop with its integrators alone at zero frequency is stable if its phase has not passed -180
    degrees where the gain falls to 1, and the gain is under 1 wherever it does later.
    """
    rows = [_margins(frequency, loop) for loop in loops]
    columns = np.array(rows, dtype=float).reshape(len(rows), 6).T
    return Margins(
        crossover=columns[0],
        phase=columns[1],
        gain=columns[2],
        delay=columns[3],
        sensitivity=columns[4],
        stable=columns[5] > 0.0,
    )


def _margins(
    frequency: Float[np.ndarray, " f"], loop: Complex[np.ndarray, " f"]
) -> tuple[float, float, float, float, float, bool]:
    """Return crossover, phase, gain and delay margin, peak of the sensitivity, whether stable."""
    size: Float[np.ndarray, " f"] = np.log(np.abs(loop))
    phase = open_phase(loop)
    at = np.log(frequency)
    crossings = [_between(at, size, i) for i in _changes(size)]
    left = [np.pi + float(np.interp(x, at, phase)) for x in crossings]
    turns = [_between(at, phase + np.pi, i) for i in _changes(phase + np.pi)]
    gains = [-float(np.interp(x, at, size)) for x in turns]
    above = [gain for gain in gains if gain > 0.0]
    later = [
        margin / (2.0 * np.pi * float(np.exp(x))) for x, margin in zip(crossings, left, strict=True)
    ]
    last = crossings[-1] if crossings else np.nan
    beyond = [gain for x, gain in zip(turns, gains, strict=True) if crossings and x > last]
    stable = bool(crossings) and left[-1] > 0.0 and all(gain > 0.0 for gain in beyond)
    return (
        float(np.exp(last)),
        float(np.degrees(min(left, default=np.nan))),
        float(np.exp(min(above, default=np.nan))),
        float(min(later, default=np.nan)),
        float(np.max(1.0 / np.abs(1.0 + loop))),
        stable,
    )


def open_phase(loop: Complex[np.ndarray, " f"]) -> Float[np.ndarray, " f"]:
    """Compute the phase of an open loop, from the lowest frequency on without a leap [rad]."""
    turned: Float[np.ndarray, " f"] = np.asarray(np.unwrap(np.angle(loop)), dtype=float)
    # From -180 degrees of two integrators, or -90 of one, downwards; never a full turn off.
    turns_off = round((float(turned[0]) + 0.75 * np.pi) / (2.0 * np.pi))
    return turned - 2.0 * np.pi * turns_off


def _changes(values: Float[np.ndarray, " f"]) -> list[int]:
    """Find the intervals of the grid in which the values change their sign."""
    return [int(i) for i in np.flatnonzero(np.signbit(values[:-1]) != np.signbit(values[1:]))]


def _between(at: Float[np.ndarray, " f"], values: Float[np.ndarray, " f"], i: int) -> float:
    """Find where the values are zero in an interval of the grid."""
    share = values[i] / (values[i] - values[i + 1])
    return float(at[i] + share * (at[i + 1] - at[i]))
