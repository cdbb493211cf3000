"""The rate from which a recorder drew its samples: lines or steps between them bend regularly.

The bend of a signal, :math:`|x_{n+m} - 2 x_n + x_{n-m}|`, of motion and noise has no rhythm of its
own. Where a recorder draws lines between samples of a slower source, or repeats them, it has: a
line in its spectrum at the rate of the source, which rounding does not hide.
"""

from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import ndimage

SPAN: Final = 0.008
"""Between the samples of a bend [s]: over one sample rounding would hide it."""
LEVEL: Final = 0.5
"""Over which the usual bend is taken [s]."""
WINDOW: Final = 8.0
"""Of one spectrum [s]."""
LOWEST, HIGHEST = 4.0, 60.0
"""Rates that are looked for [Hz], up to a quarter of the recorder's."""
AROUND: Final = 40
NEAR: Final = 4
"""Lines on each side with which one is compared, but for the nearest."""
LEAST_RATIO: Final = 25.0
"""Of a line over the median of those around it: chance makes 13 in one window, and less in more
(real and simulated speeds); lines drawn between samples 28 to 220."""


def source_rate(values: Float[np.ndarray, "n k"], sample_rate: float) -> float | None:
    """Estimate the rate of the samples that a recorder drew lines between [Hz].

    None where it drew none. `values`: on a uniform clock.
    """
    rows = min(round(WINDOW * sample_rate), len(values) - 1)
    bend = _bend(values, max(round(SPAN * sample_rate), 1))
    frequency = np.fft.rfftfreq(rows, 1.0 / sample_rate)
    if len(bend) < rows or frequency[-1] < 2.0 * LOWEST:
        return None
    bend /= np.maximum(ndimage.uniform_filter1d(bend, round(LEVEL * sample_rate)), 1e-9)
    power = _power(bend, rows)
    looked = (frequency >= LOWEST) & (frequency <= min(HIGHEST, 0.25 * sample_rate))
    clear = [i for i in np.flatnonzero(looked).tolist() if _ratio(power, i) > LEAST_RATIO]
    if not clear:
        return None
    own = sum((_power(column, rows) for column in values.T), np.zeros(rows // 2 + 1))
    swings = [i for i in clear if _swings(own, i)]
    drawn = [i for i in clear if not any(_is_multiple(i, k) for k in swings)]
    return float(frequency[drawn[0]]) if drawn else None


def _swings(power: Float[np.ndarray, " f"], i: int) -> bool:
    """Return whether signals themselves have a line at a rate or at half of it."""
    return any(_ratio(power, k) > LEAST_RATIO for k in (i - 1, i, i + 1, i // 2, (i + 1) // 2))


def _is_multiple(i: int, of: int) -> bool:
    """Return whether a line is a harmonic of another, each to one place."""
    times = max(round(i / of), 1)
    return abs(i - times * of) <= times + 1


def _bend(values: Float[np.ndarray, "n k"], m: int) -> Float[np.ndarray, " b"]:
    """Compute by how much each sample is off the line through those `m` before and after."""
    off: Float[np.ndarray, " b"] = np.zeros(max(len(values) - 2 * m, 0))
    for column in values.T:
        off += np.abs(column[2 * m :] - 2.0 * column[m:-m] + column[: -2 * m])
    return off


def _power(bend: Float[np.ndarray, " b"], rows: int) -> Float[np.ndarray, " f"]:
    """Average the power spectrum of windows that overlap by half."""
    window = np.hanning(rows)
    firsts = range(0, len(bend) - rows + 1, max(rows // 2, 1))
    spectra = (
        np.abs(np.fft.rfft((bend[a : a + rows] - bend[a : a + rows].mean()) * window)) ** 2
        for a in firsts
    )
    return sum(spectra, np.zeros(rows // 2 + 1)) / len(firsts)


def _ratio(power: Float[np.ndarray, " f"], i: int) -> float:
    """Compare a line with the median of those around it."""
    near = np.r_[power[max(i - AROUND, 1) : i - NEAR], power[i + NEAR + 1 : i + AROUND + 1]]
    level = float(np.median(near)) if len(near) else 0.0
    return float(power[i]) / level if level > 0.0 else 0.0
