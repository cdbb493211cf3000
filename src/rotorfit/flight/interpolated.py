"""The rate from which a recorder drew its samples: lines or steps between them bend regularly.

The bend of a signal, :math:`|x_{n+m} - 2 x_n + x_{n-m}|`, of motion and noise has no rhythm of its
own. Where a recorder draws lines between samples of a slower source, or repeats them, it has: a
line in its spectrum at the rate of the source, which rounding does not hide.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from rotorfit.flight.signals import running_mean
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

TINY: Final = 1e-300

SPANS: Final = (0.008, 0.02, 0.04)
"""Distances between the samples of a bend [s]: the longer, the less rounding hides it, and the
slower the source must be."""
LEVEL: Final = 0.5
"""Over which the usual bend is taken [s]."""
WINDOW: Final = 8.0
"""Window of one spectrum [s]."""
LOWEST, HIGHEST = 4.0, 60.0
"""Rates that are looked for [Hz], up to a quarter of the recorder's."""
HARMONICS: Final = 4
"""Harmonics of a source, all of which must stand out: of lines or steps they are alike."""
AROUND: Final = 40
NEAR: Final = 4
"""Lines on each side with which one is compared, but for the nearest."""
OVERLAP: Final = 0.6
"""Share of a window's worth that each further window adds, which overlaps by half (Welch 1967)."""
CHANCE: Final = -25.0
"""Log of the chance of such lines in motion without a rhythm, under which there is a source. On
random worlds and real logs motion comes to -14, of slow sources nine in ten to less than -50."""
LEAST_SHARE: Final = 0.2
"""Least share of the bends that a source makes: rhythms of autopilots and limit cycles made up to
.12."""
CLEAR: Final = -4.0
"""The same of a single line, from which it is looked at."""
OWN_LINE: Final = 5.0
"""Ratio of a line of the signals themselves, which bend by swinging."""


@frozen_dataclass
class BendSource:
    """The likeliest source of a signal.

    - `rate`: of its samples [Hz].
    - `chance`: log of the chance that motion without a rhythm bends so regularly.
    - `share`: of the bends that come at that rate: one of lines without rounding.
    """

    rate: float
    chance: float
    share: float

    @property
    def clear(self) -> bool:
        """Whether lines were drawn: neither chance nor a rhythm of the motion bends so."""
        return self.chance < CHANCE and self.share > LEAST_SHARE


def source_rate(values: Float[np.ndarray, "n k"], sample_rate: float) -> float | None:
    """Estimate the rate of the samples that a recorder drew lines between [Hz].

    None where it drew none. `values`: on a uniform clock.
    """
    found = likeliest_source(values, sample_rate)
    return found.rate if found is not None and found.clear else None


def slowest_source_rate(values: Float[np.ndarray, "n k"], sample_rate: float) -> float | None:
    """Estimate the slowest rate of a channel's columns that lines were drawn between [Hz].

    None where none were drawn. A bus that asks one motor after the other gives each column a turn
    of its own: all together then bend at as many times the rate of each, or without a rhythm.
    """
    parts = (values, *(values[:, [k]] for k in range(values.shape[1])))
    rates = (source_rate(part, sample_rate) for part in parts)
    return min((rate for rate in rates if rate is not None), default=None)


def likeliest_source(values: Float[np.ndarray, "n k"], sample_rate: float) -> BendSource | None:
    """Find the rate at which a signal bends with least chance; None if it is too short."""
    every = [_of_span(values, sample_rate, span) for span in SPANS]
    return min((one for one in every if one is not None), key=lambda one: one.chance, default=None)


def _of_span(
    values: Float[np.ndarray, "n k"], sample_rate: float, span: float
) -> BendSource | None:
    """Find the rate at which bends over a span come with least chance."""
    rows = min(round(WINDOW * sample_rate), len(values) - 1)
    bend = _bend_of_samples(values, max(round(span * sample_rate), 1))
    if len(bend) < rows or sample_rate < 4.0 * LOWEST or rows < 2 * AROUND:
        return None
    frequency = np.fft.rfftfreq(rows, 1.0 / sample_rate)
    top = min(HIGHEST, 0.25 * sample_rate, 0.5 / span)
    bend /= np.maximum(running_mean(bend, round(LEVEL * sample_rate), beyond="symmetric"), 1e-9)
    windows = 1.0 + OVERLAP * ((len(bend) - rows) // max(rows // 2, 1))
    power = _mean_power(bend, rows)
    chance = _chance_of_lines(power, windows)
    looked = np.flatnonzero((frequency >= LOWEST) & (frequency <= top)).tolist()
    clear = [i for i in looked if chance[i] < CLEAR]
    if not clear:
        return None
    own = sum((_mean_power(column, rows) for column in values.T), np.zeros(rows // 2 + 1))
    own_line = own > OWN_LINE * _median_levels(own)
    swings = [i for i in clear if _has_line_in_signal(own_line, i)]
    drawn = [i for i in clear if not any(_is_multiple(i, k) for k in swings)]
    last = int(np.searchsorted(frequency, top, "right")) - 1
    best = min(((_chance_of_harmonics(chance, i, last), i) for i in drawn), default=None)
    if best is None:
        return None
    rate = float(frequency[best[1]])
    share = _line_share(power, best[1], rows) / float(bend.mean())
    lines = 2.0 * float(np.sinc(rate * max(round(span * sample_rate), 1) / sample_rate)) ** 2
    return BendSource(rate=rate, chance=best[0], share=share / lines)


def _line_share(power: Float[np.ndarray, " f"], i: int, rows: int) -> float:
    """Compute the amplitude of a line over that of those around it."""
    level = float(np.median(power[max(i - AROUND, 1) : i + AROUND]))
    above = max(float(power[i - 1 : i + 2].max()) - level, 0.0)
    return 2.0 * above**0.5 / float(np.hanning(rows).sum())


def _chance_of_lines(power: Float[np.ndarray, " f"], windows: float) -> Float[np.ndarray, " f"]:
    """Compute the log of the chance of each line among those around it (a chi-square)."""
    from scipy import special  # slow to import

    ratio = power / _median_levels(power)
    size: Float[np.ndarray, " f"] = np.log(2.0) * windows * ratio
    tail = np.asarray(special.gammaincc(windows, size))
    return np.log(np.maximum(tail, TINY))


def _chance_of_harmonics(chance: Float[np.ndarray, " f"], i: int, last: int) -> float:
    """Compute the log of the chance that a line and its harmonics all stand out so far."""
    count = int(np.clip(last // i, 1, HARMONICS))
    each = [
        float(chance[k * i - k // 2 : min(k * i + k // 2, last) + 1].min())
        for k in range(1, count + 1)
    ]
    return count * max(each)


def _has_line_in_signal(line: Bool[np.ndarray, " f"], i: int) -> bool:
    """Return whether signals themselves have a line at a rate or at half of it."""
    return bool(line[[i - 1, i, i + 1, i // 2, (i + 1) // 2]].any())


def _is_multiple(i: int, of: int) -> bool:
    """Return whether a line is a harmonic of another, each to one place."""
    times = max(round(i / of), 1)
    return abs(i - times * of) <= times + 1


def _bend_of_samples(values: Float[np.ndarray, "n k"], m: int) -> Float[np.ndarray, " b"]:
    """Compute by how much each sample is off the line through those `m` before and after."""
    off: Float[np.ndarray, " b"] = np.zeros(max(len(values) - 2 * m, 0))
    for column in values.T:
        off += np.abs(column[2 * m :] - 2.0 * column[m:-m] + column[: -2 * m])
    return off


def _mean_power(bend: Float[np.ndarray, " b"], rows: int) -> Float[np.ndarray, " f"]:
    """Average the power spectrum of windows that overlap by half."""
    window = np.hanning(rows)
    firsts = range(0, len(bend) - rows + 1, max(rows // 2, 1))
    spectra = (
        np.abs(np.fft.rfft((bend[a : a + rows] - bend[a : a + rows].mean()) * window)) ** 2
        for a in firsts
    )
    return sum(spectra, np.zeros(rows // 2 + 1)) / len(firsts)


def _median_levels(power: Float[np.ndarray, " f"]) -> Float[np.ndarray, " f"]:
    """Compute the median of the lines around each, but for the nearest and the mean's."""
    padded = np.pad(power, AROUND, constant_values=np.nan)
    padded[AROUND] = np.nan
    near = np.r_[0 : AROUND - NEAR, AROUND + NEAR + 1 : 2 * AROUND + 1]
    around = sliding_window_view(padded, 2 * AROUND + 1)[:, near]
    # The median of what is no NaN: those are sorted last. NumPy's own takes four times as long.
    ordered = np.sort(around, axis=1)
    count, rows = np.isfinite(around).sum(axis=1), np.arange(len(around))
    level = 0.5 * (ordered[rows, (count - 1) // 2] + ordered[rows, count // 2])
    return np.where(level > 0.0, level, np.inf)
