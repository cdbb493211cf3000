"""The likelihood of a sensor's channel behind low-passes, by its powers in bands of frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Bool, Complex, Float

OWN: Final = 1.5
"""Windows that share half of their rows with the next, for each that would be its own."""
EDGES: Final = np.array([0.5, 1.0, 2.0, 3.0, 4.5, 7.0, 10.0, 14.0, 19.0, 25.0, 30.0])
"""Edges of the bands of one noise level [Hz]."""
LEAST_COHERENCE: Final = 0.7
"""Least coherence of a channel with the rotors in a band that is looked at. Where gusts make more
of the motion the autopilot works against them, and the rotors follow the channel: late and small,
as if the channel were behind a low-pass. A filter lowers the gain, and leaves the coherence, until
no motion is left."""
MOST_SILENT: Final = 0.5
"""Share of the power that the rotors would make, below which a channel is silent: such a band is
looked at above one with coherence. Gusts that an autopilot works against make more of it, not
less, from where its loop has a gain of 1."""
SHAPE_ERROR: Final = 0.03
"""Share of the motion by which a filter may differ from its shape: far above the cut-off, where
hardly any motion is left, noise-free lines would decide by the shape of the tail alone."""
FEEDBACK: Final = 1.5
"""Error of a band's gain and phase, over the share of the motion that rotors do not explain: at
.15 of it the phase was .13 to .26 off (2 to 3 Hz, random fast worlds), by the rotors' answer to
gusts and by lines below, whose lateness the window brings with them."""
FIRST_BANDS: Final = 3
"""Bands by which the motion without a filter is estimated."""
PASSES: Final = 5
"""Passes of a regression whose variances are those of what it leaves."""
TINY: Final = float(np.finfo(float).tiny)


class Channel(NamedTuple):
    """Lines of a channel and of its causes in every window; the first `made` are of the rotors."""

    y: Complex[np.ndarray, "w l"]
    x: Complex[np.ndarray, "w l k"]
    made: int


class ChannelPowers(NamedTuple):
    """Powers of a channel y and of its causes x, of which the first `made` are of the rotors.

    - `band`: which lines are in each band; `lines`: how many count.
    - `xx`, `xy`: of each line; `yy`: of each band.
    """

    band: Float[np.ndarray, "l b"]
    lines: Float[np.ndarray, " b"]
    xx: Complex[np.ndarray, "l k k"]
    xy: Complex[np.ndarray, "l k"]
    yy: Float[np.ndarray, " b"]
    made: int


def powers_of(
    frequency: Float[np.ndarray, " l"], channel: Channel, *, careful: bool = False
) -> ChannelPowers:
    """Compute a channel's powers; with `careful` a band counts as its own error leaves it."""
    y, x, made = channel
    place = np.digitize(frequency, EDGES)
    band = (place[:, None] == np.unique(place)).astype(float)
    lines = band.sum(axis=0) * len(y) / OWN
    lines = _count_lines(y, x, band, lines, careful=careful)
    size = np.sqrt((np.abs(x) ** 2).sum(axis=(0, 1)))
    x = x / np.where(size > 0.0, size, 1.0)
    return ChannelPowers(
        band=band,
        lines=lines,
        xx=np.einsum("wla,wlb->lab", x.conj(), x),
        xy=np.einsum("wla,wl->la", x.conj(), y),
        yy=(np.abs(y) ** 2).sum(axis=0) @ band,
        made=made,
    )


def likelihoods_of_gains(
    powers: ChannelPowers, H: Complex[np.ndarray, "t l"]
) -> Float[np.ndarray, " t"]:
    """Compute the log-likelihood of a channel with each of some gains of its rotors' share."""
    band, lines, xx, xy, yy, made = powers
    if not lines.any():
        return np.zeros(len(H))
    k = xy.shape[1]
    by = np.ones((*H.shape, k), dtype=complex)
    by[:, :, :made] = H[:, :, None]
    c = _in_bands(np.real(by.conj() * xy), band)
    A = np.empty((len(H), band.shape[1], k, k))
    for i in range(k):
        for j in range(i + 1):
            both = np.real(by[:, :, i].conj() * by[:, :, j] * xx[:, i, j]) @ band
            A[:, :, i, j] = A[:, :, j, i] = both
    unfiltered = np.real(xx[:, 0, 0]) @ band
    gain = float(np.median((yy / unfiltered.clip(min=TINY))[:FIRST_BANDS]))
    return _profile_variances(A, c, yy, lines, least=SHAPE_ERROR**2 * gain * unfiltered)


def _count_lines(
    y: Complex[np.ndarray, "w l"],
    x: Complex[np.ndarray, "w l k"],
    band: Float[np.ndarray, "l b"],
    lines: Float[np.ndarray, " b"],
    *,
    careful: bool,
) -> Float[np.ndarray, " b"]:
    """Count the lines of bands in which the rotors make the motion, or are seen to make none."""
    # Any filter leaves the lowest bands as they are: there the shares of air and damping are true.
    low = band[:, :FIRST_BANDS].any(axis=1)
    causes: Complex[np.ndarray, "n k"] = x[:, low].reshape(-1, x.shape[2])
    channel: Complex[np.ndarray, " n"] = y[:, low].reshape(-1)
    size = np.linalg.norm(causes, axis=0).clip(min=TINY)
    X: Float[np.ndarray, "m k"] = np.concatenate([np.real(causes), np.imag(causes)]) / size
    felt: Float[np.ndarray, " m"] = np.concatenate([np.real(channel), np.imag(channel)])
    share = np.asarray(np.linalg.lstsq(X, felt)[0], dtype=float) / size
    # What else makes the channel (air, damping) is taken off it, as the lowest bands show it.
    own, made = y - x[:, :, 1:] @ share[1:], x[:, :, 0]
    power, driven = ((np.abs(one) ** 2).sum(axis=0) @ band for one in (own, made))
    coherence = _measure_coherence(own, made, band)
    coherent = _mark_falling(coherence, power, driven)
    expected = share[0] ** 2 * driven
    silent = (power < MOST_SILENT * expected) & np.logical_or.accumulate(coherent)
    if careful:
        error = FEEDBACK**2 * coherence * (1.0 - coherence)
        lines = np.where(coherent, lines / (1.0 + 2.0 * lines * error), lines)
    return lines * (coherent | silent)


def _mark_falling(
    coherence: Float[np.ndarray, " b"],
    power: Float[np.ndarray, " b"],
    driven: Float[np.ndarray, " b"],
) -> Bool[np.ndarray, " b"]:
    """Mark the coherent bands whose motion is no larger for its rotors than in the lowest one.

    A low-pass has no more gain above. Where rotors answer gusts or the noise of the gyro, the
    channel moves more for what they do the quicker it is, and they follow it, coherent and late.
    `power`, `driven`: of the channel and of its cause.
    """
    coherent: Bool[np.ndarray, " b"] = coherence >= LEAST_COHERENCE
    if not coherent.any():
        return coherent
    made, lowest = coherence * power, int(np.argmax(coherent))
    return coherent & (LEAST_COHERENCE * made * driven[lowest] <= made[lowest] * driven)


def _measure_coherence(
    y: Complex[np.ndarray, "w l"], x: Complex[np.ndarray, "w l"], band: Float[np.ndarray, "l b"]
) -> Float[np.ndarray, " b"]:
    """Compute the share of a channel's power that goes with a cause, line by line, in each band."""
    both = np.abs((x.conj() * y).sum(axis=0)) ** 2
    explained = both / (np.abs(x) ** 2).sum(axis=0).clip(min=TINY)
    return (explained @ band) / ((np.abs(y) ** 2).sum(axis=0) @ band).clip(min=TINY)


def _in_bands(
    values: Float[np.ndarray, "t l k"], band: Float[np.ndarray, "l b"]
) -> Float[np.ndarray, "t b k"]:
    return np.moveaxis(np.moveaxis(values, 1, 2) @ band, 1, 2)


def _profile_variances(
    A: Float[np.ndarray, "t b k k"],
    c: Float[np.ndarray, "t b k"],
    yy: Float[np.ndarray, " b"],
    lines: Float[np.ndarray, " b"],
    *,
    least: Float[np.ndarray, " b"],
) -> Float[np.ndarray, " t"]:
    """Regress with each band's variance from its residual; return the log-likelihoods."""
    least = np.maximum(least, 1e-6 * yy.clip(min=TINY))
    left = np.tile(np.maximum(yy, least), (len(A), 1))
    t, b, k = c.shape
    ridge = 1e-9 * np.eye(k)
    by_band, by_row = A.reshape(t, b, k * k), A.reshape(t, b * k, k)
    for _ in range(PASSES):
        weight = (lines / left)[:, None, :]
        information = (weight @ by_band).reshape(t, k, k)
        information += ridge * np.trace(information, axis1=1, axis2=2)[:, None, None]
        asked = (weight @ c).transpose(0, 2, 1)
        found: Float[np.ndarray, "t k 1"] = np.asarray(
            np.linalg.solve(information, asked), dtype=float
        )
        made: Float[np.ndarray, "t b k"] = (by_row @ found).reshape(t, b, k) - 2.0 * c
        left = np.maximum(yy + (made @ found)[:, :, 0], 0.0) + least
    return -(lines * np.log(left / yy.clip(min=TINY))).sum(axis=1)
