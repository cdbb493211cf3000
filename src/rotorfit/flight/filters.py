"""Recursive and windowed filters, as `scipy.signal` has them.

To import `scipy.signal`, which imports `scipy.stats`, takes longer than to identify a short flight.
A recursive filter is a banded triangular system of equations, which LAPACK solves.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.flight.recursion import solve_recursion

if TYPE_CHECKING:
    from jaxtyping import Complex, Float


def butterworth(
    order: int, cutoff: float | tuple[float, float], sample_rate: float
) -> Float[np.ndarray, "s 6"]:
    """Design a Butterworth low-pass, or a band-pass between two frequencies [Hz].

    The sections are those of `scipy.signal.butter` up to how zeros are paired with poles: analog
    poles on a circle, the bilinear transform with both cut-offs warped, and real gains that are 1
    at rest, or in the middle of the band.
    """
    on_circle = np.exp(0.5j * np.pi * (2.0 * np.arange(order) + order + 1.0) / order)
    # The bilinear transform bends frequencies by tan: warped beforehand, the cut-off stays in
    # place.
    warped = 2.0 * np.tan(np.pi * np.atleast_1d(np.asarray(cutoff, dtype=float)) / sample_rate)
    if len(warped) == 1:
        analog, zeros, middle = warped[0] * on_circle, (-1.0, -1.0), 1.0 + 0.0j
    else:
        # Low-pass to band-pass: s -> (s^2 + w1 w2) / (s (w2 - w1)), two poles for each.
        half = 0.5 * (warped[1] - warped[0]) * on_circle
        root = np.sqrt(half**2 - warped[0] * warped[1])
        analog, zeros = np.concatenate([half + root, half - root]), (1.0, -1.0)
        center = np.sqrt(warped[0] * warped[1])
        middle = complex((2.0 + 1j * center) / (2.0 - 1j * center))
    return _pair_sections((2.0 + analog) / (2.0 - analog), zeros, middle)


def _pair_sections(
    poles: Complex[np.ndarray, " p"], zeros: tuple[float, float], middle: complex
) -> Float[np.ndarray, "s 6"]:
    """Pair the poles with their conjugates; every section has gain 1 in size at `middle`."""
    height = np.imag(poles)
    real: Float[np.ndarray, " r"] = np.sort(np.real(poles[np.abs(height) < 1e-12]))
    paired: list[complex] = poles[height >= 1e-12].tolist()
    sections = [(-2.0 * p.real, abs(p) ** 2, False) for p in sorted(paired, key=abs)]
    if len(real) % 2:
        # A real pole without a partner is a section of first order.
        sections.insert(0, (-float(real[0]), 0.0, True))
        real = real[1:]
    sections += [(-float(p + q), float(p * q), False) for p, q in real.reshape(-1, 2)]
    rows: list[list[float]] = []
    for a1, a2, is_first_order in sections:
        b = np.array([1.0, 1.0, 0.0]) if is_first_order else np.poly(zeros)
        a = np.array([1.0, a1, a2])
        gain = abs(np.polyval(a, middle) / np.polyval(b, middle))
        rows.append([*(gain * b), *a])
    return np.array(rows)


def slowest_pole(sos: Float[np.ndarray, "s 6"]) -> float:
    """Return the factor by which a filter's response fades with each sample in the end."""
    a1, a2 = sos[:, 4].astype(complex), sos[:, 5]
    root = np.sqrt(a1**2 - 4.0 * a2)
    return float(0.5 * np.abs([root - a1, root + a1]).max())


def first_order_recursion(
    forcing: Float[np.ndarray, "n *k"], keep: float
) -> Float[np.ndarray, "n *k"]:
    r"""Solve :math:`y_n = keep\, y_{n-1} + forcing_n`, with nothing before the first sample."""
    right = np.array(forcing, dtype=float, order="F")
    if not len(right):
        return right
    bands = np.ones((2, len(right)), order="F")
    bands[1] = -keep
    solved = solve_recursion(bands, right.reshape(len(right), -1, order="F"))
    return np.ascontiguousarray(solved.reshape(right.shape, order="F"))


def filter_both_ways(
    sos: Float[np.ndarray, "s 6"], values: Float[np.ndarray, "n *k"]
) -> Float[np.ndarray, "n *k"]:
    """Filter forward and backward, without a shift in phase.

    The ends are continued by point reflection, as `scipy.signal.sosfiltfilt` does, and each pass
    begins settled at its first sample.
    """
    if not values.size:
        return np.array(values)
    columns = values.reshape(len(values), -1)
    both = np.empty(columns.shape)
    # One after the other: the passes need several copies of what they act on.
    for k in range(columns.shape[1]):
        both[:, k : k + 1] = _filter_column(sos, columns[:, k : k + 1])
    return both.reshape(values.shape)


def _filter_column(
    sos: Float[np.ndarray, "s 6"], x: Float[np.ndarray, "n 1"]
) -> Float[np.ndarray, "n 1"]:
    """Filter one column forward and backward, its ends continued by point reflection."""
    count, pad = len(x), min(3 * (2 * len(sos) + 1), len(x) - 1)
    if pad > 0:
        x = np.concatenate([2.0 * x[:1] - x[pad:0:-1], x, 2.0 * x[-1:] - x[-2 : -pad - 2 : -1]])
    both = _filter_settled(sos, _filter_settled(sos, x)[::-1])[::-1]
    return both[pad : pad + count]


def _filter_settled(
    sos: Float[np.ndarray, "s 6"], x: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "n k"]:
    """Filter forward, as if the first sample had stood for ever before."""
    bands = np.ones((3, len(x)), order="F")
    for b0, b1, b2, _, a1, a2 in sos:
        first = x[:1]
        settled = (b0 + b1 + b2) / (1.0 + a1 + a2) * first
        right = np.empty(x.shape, order="F")
        np.multiply(x, b0, out=right)
        right[1:] += b1 * x[:-1]
        right[2:] += b2 * x[:-2]
        right[:1] += (b1 + b2) * first - (a1 + a2) * settled
        right[1:2] += b2 * first - a2 * settled
        bands[1], bands[2] = a1, a2
        x = solve_recursion(bands, right)
    return x


def tukey_window(count: int, taper: float) -> Float[np.ndarray, " n"]:
    """Compute a window that is 1 but for half a cosine at each end, `taper` of it together."""
    if count <= 1 or taper <= 0.0:
        return np.ones(count)
    from_end = np.minimum(np.arange(count), np.arange(count)[::-1])
    phase = np.minimum(2.0 * from_end / (min(taper, 1.0) * (count - 1)), 1.0)
    return 0.5 * (1.0 - np.cos(np.pi * phase))


def kaiser_low_pass(
    cutoff: float, width: float, damping: float, sample_rate: float
) -> Float[np.ndarray, " t"]:
    """Design a linear-phase low-pass of odd length with Kaiser's window.

    Parameters
    ----------
    cutoff, width
        Middle and width of the transition [Hz].
    damping
        Least damping behind it [dB], above 50.

    References
    ----------
    Kaiser, "Nonrecursive digital filter design using the I0-sinh window function", 1974.
    """
    relative = np.pi * width / (0.5 * sample_rate)
    count = int(np.ceil((damping - 7.95) / (2.285 * relative) + 1.0)) | 1
    away = np.arange(count) - 0.5 * (count - 1)
    pass_share = cutoff / (0.5 * sample_rate)
    weights = np.sinc(pass_share * away) * np.kaiser(count, 0.1102 * (damping - 8.7))
    return weights / weights.sum()


def thinned_sums(
    weights: Float[np.ndarray, " t"], values: Float[np.ndarray, "n k"], step: int
) -> Float[np.ndarray, "m k"]:
    """Sum as many consecutive samples as there are weights, beginning at every `step`-th one."""
    count = max((len(values) - len(weights)) // step + 1, 0)
    parts = -(-len(weights) // step)
    padded = np.zeros(parts * step)
    padded[: len(weights)] = weights
    rows = (count + parts - 1) * step
    sums, own = np.zeros((count, values.shape[1])), np.zeros(max(rows, len(values)))
    # One column after the other: of a long log the products would fill the memory.
    for column in range(values.shape[1] if count else 0):
        own[: len(values)] = values[:, column]
        # Steps of the samples times steps of the weights, of which those that meet are summed.
        products = own[:rows].reshape(-1, step) @ padded.reshape(parts, step).T
        for part in range(parts):
            sums[:, column] += products[part : part + count, part]
    return sums


def fast_length(least: int) -> int:
    """Return the smallest length from `least` on that has no prime factor over 5."""
    # As `scipy.fft.next_fast_len`, which takes longer to import than a short flight to transform.
    best = 1 << (least - 1).bit_length()
    five = 1
    while five < best:
        odd = five
        while odd < best:
            best = min(best, odd << (-(-least // odd) - 1).bit_length())
            odd *= 3
        five *= 5
    return best


def correlate(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " m"]) -> Float[np.ndarray, " k"]:
    """Correlate two records over all lags, from one less than the length of y before x."""
    size = len(x) + len(y) - 1
    fast = fast_length(size)
    return np.fft.irfft(np.fft.rfft(x, fast) * np.fft.rfft(y[::-1], fast), fast)[:size]


def without_line(values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """Subtract from each column the straight line nearest to it."""
    t = np.arange(len(values)) - 0.5 * (len(values) - 1)
    slope = t @ values / max(float(t @ t), 1.0)
    return values - values.mean(axis=0) - t[:, None] * slope
