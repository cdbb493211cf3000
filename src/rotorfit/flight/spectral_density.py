"""Spectral densities by Welch's method: means over windows that overlap by half.

Welch, IEEE Trans. Audio and Electroacoustics 15, 1967; the numbers are those of `scipy.signal`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Complex, Float


def power_density(
    values: Float[np.ndarray, "n *k"], sample_rate: float, window: int
) -> tuple[Float[np.ndarray, " f"], Float[np.ndarray, "f *k"]]:
    """Compute frequencies [Hz] and the one-sided power density of each column."""
    window = min(window, len(values))
    lines = windowed_lines(values, window, (window + 1) // 2)
    power = (np.abs(lines) ** 2).mean(axis=0)
    sides = _count_sides(window).reshape(-1, *[1] * (values.ndim - 1))
    return np.fft.rfftfreq(window, 1.0 / sample_rate), sides / sample_rate * power


def cross_densities(
    records: Float[np.ndarray, "n R"], sample_rate: float, window: int
) -> tuple[Float[np.ndarray, " f"], Complex[np.ndarray, "R R f"]]:
    """Compute frequencies [Hz] and the one-sided cross-densities conj(X) Y of all pairs."""
    window = min(window, len(records))
    lines = windowed_lines(records, window, (window + 1) // 2)
    cross = np.einsum("wfi,wfj->ijf", lines.conj(), lines) / len(lines)
    frequency = np.fft.rfftfreq(window, 1.0 / sample_rate)
    return frequency, _count_sides(window) / sample_rate * cross


def _count_sides(window: int) -> Float[np.ndarray, " f"]:
    """Count how often a frequency is in a spectrum: once at 0 and half the rate, else twice."""
    sides = np.full(window // 2 + 1, 2.0)
    sides[0] = 1.0
    if window % 2 == 0:
        sides[-1] = 1.0
    return sides


def windowed_lines(
    values: Float[np.ndarray, "n *k"], window: int, step: int, *, padded: int | None = None
) -> Complex[np.ndarray, "w f *k"]:
    """Compute the spectra of windows that begin every `step` rows, each without its mean.

    The window is Hann's; `padded` is its length with zeros added.
    """
    rows = np.lib.stride_tricks.sliding_window_view(values, window, axis=0)[::step]
    taper = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(window) / window)
    taper = taper / np.sqrt(taper @ taper)
    tapered = (rows - rows.mean(axis=-1, keepdims=True)) * taper
    return np.moveaxis(np.fft.rfft(tapered, padded, axis=-1), -1, 1)


def prominent_peaks(level: Float[np.ndarray, " n"], least: float) -> list[tuple[int, float]]:
    """Find local maxima, with how far each rises over the higher of the valleys beside it."""
    starts = np.flatnonzero(np.diff(level, prepend=np.nan) != 0.0)
    tops = level[starts]
    highest = 1 + np.flatnonzero((tops[1:-1] > tops[:-2]) & (tops[1:-1] > tops[2:]))
    found: list[tuple[int, float]] = []
    for run in highest:
        at = int(starts[run] + starts[run + 1] - 1) // 2
        # A valley reaches to the nearest higher sample on its side, or to the end.
        higher = np.flatnonzero(level > level[at])
        place = int(np.searchsorted(higher, at))
        first = int(higher[place - 1]) if place else 0
        last = int(higher[place]) if place < len(higher) else len(level) - 1
        valleys = level[first : at + 1].min(), level[at : last + 1].min()
        rise = float(level[at] - max(valleys))
        if rise >= least:
            found.append((at, rise))
    return found
