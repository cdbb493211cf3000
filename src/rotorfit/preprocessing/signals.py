"""Small tools on sampled signals: despiking, differences, zero-phase smoothing."""

from functools import cache

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage, signal

from rotorfit.logs.flight_log import LONG, pieces

MEDIAN_WIDTH = 7
SCALE_WIDTH = 51
SPIKE_THRESHOLD = 6.0
"""Robust standard deviations. At 4, one sample in a hundred of plain noise would be touched."""
SLACK = 1e-3
"""By which a count of samples may miss a whole number."""


def hampel(
    values: Float[np.ndarray, "n k"],
) -> tuple[Float[np.ndarray, "n k"], Bool[np.ndarray, " n"]]:
    """Return the values with spikes replaced by the median of their seven neighbours.

    A sample is a spike if it is further from that median than six robust standard deviations.
    Those are taken over 51 samples (over seven, they would jump about and flag ordinary noise),
    and never much below the column's own nor below a thousandth of its range, so that quantised
    stretches and the crests of a smooth signal are left alone.

    Returns
    -------
    values
        A copy; the array that was given where nothing was found.
    spikes
        Which samples had a spike in any column.

    References
    ----------
    Hampel, J. of the American Statistical Association 69, 1974.
    """
    clean = values
    spikes = np.zeros(len(values), dtype=bool)
    if len(values) < SCALE_WIDTH:
        return clean, spikes
    for column in range(values.shape[1]):
        x = values[:, column]
        deviation = np.empty(len(x))
        for rows in pieces(len(x)):
            deviation[rows] = np.abs(x[rows] - _running_median(x, MEDIAN_WIDTH, rows))
        low, high = np.percentile(x, [1.0, 99.0])
        floor = max(0.4 * float(np.percentile(deviation, 95)), 1e-3 * float(high - low))
        for rows in pieces(len(x)):
            local = _running_median(deviation, SCALE_WIDTH, rows)
            bad = deviation[rows] > SPIKE_THRESHOLD * 1.4826 * np.maximum(local, floor)
            if not bad.any():
                continue
            clean = values.copy() if clean is values else clean
            clean[rows, column][bad] = _running_median(x, MEDIAN_WIDTH, rows)[bad]
            spikes[rows] |= bad
    return clean, spikes


def whole_samples(count: float) -> int:
    """Return how many whole samples are in a count of them, a rate times a duration.

    A rate is known up to rounding, which grows with the time at which its clock begins: where the
    count is a whole number, it must not decide about one sample more or less.
    """
    return int(np.floor(count + SLACK))


def _running_median(
    values: Float[np.ndarray, " n"], width: int, rows: slice
) -> Float[np.ndarray, " m"]:
    """Return the median over `width` samples around each of some rows."""
    half = width // 2
    first, last = max(rows.start - half, 0), min(rows.stop + half, len(values))
    median = ndimage.median_filter(values[first:last], width, mode="nearest")
    return median[rows.start - first : rows.stop - first]


def central_difference(
    values: Float[np.ndarray, "n k"], sample_rate: float
) -> Float[np.ndarray, "n k"]:
    """Return the difference over two samples, per second; one-sided at both ends.

    This is the mean of the derivative over the two samples it spans. Averaging the other columns
    of an equation with [1 4 1]/6 (Simpson's rule over the same span) keeps the equation true to
    fourth order.
    """
    result = np.empty_like(values)
    inner = result[1:-1]
    np.subtract(values[2:], values[:-2], out=inner)
    inner *= 0.5 * sample_rate
    result[0] = (values[1] - values[0]) * sample_rate
    result[-1] = (values[-1] - values[-2]) * sample_rate
    return result


def smooth(
    values: Float[np.ndarray, "n k"], sample_rate: float, cutoff: float
) -> Float[np.ndarray, "n k"]:
    """Return the values through a zero-phase second-order low-pass (for looking, not fitting)."""
    sos = _low_pass(sample_rate, cutoff)
    pad = min(9, len(values) - 1)
    if len(values) < LONG:
        return signal.sosfiltfilt(sos, values, axis=0, padlen=pad)
    result = np.empty(values.shape)
    margin = fading_rows(sos)
    for rows in pieces(len(values)):
        first, last = max(rows.start - margin, 0), min(rows.stop + margin, len(values))
        wide = signal.sosfiltfilt(sos, values[first:last], axis=0, padlen=pad)
        result[rows] = wide[rows.start - first : rows.stop - first]
    return result


def fading_rows(sos: Float[np.ndarray, "s 6"]) -> int:
    """Return how many rows it takes a filter's answer to fade to rounding."""
    _, poles, _ = signal.sos2zpk(sos)
    return int(np.ceil(np.log(1e-17) / np.log(np.abs(poles).max())))


@cache
def _low_pass(sample_rate: float, cutoff: float) -> Float[np.ndarray, "1 6"]:
    """Return a second-order Butterworth filter; logs with many gaps ask for it often."""
    return signal.butter(2, min(cutoff, 0.45 * sample_rate), fs=sample_rate, output="sos")


def true_runs(flags: Bool[np.ndarray, " n"]) -> list[tuple[int, int]]:
    """Return start and stop (exclusive) of every run of true values."""
    padded = np.concatenate([[0], flags.astype(np.int8), [0]])
    change = np.diff(padded)
    starts = np.flatnonzero(change == 1)
    stops = np.flatnonzero(change == -1)
    return [(int(a), int(b)) for a, b in zip(starts, stops, strict=True)]
