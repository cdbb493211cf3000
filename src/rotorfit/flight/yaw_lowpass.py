"""Detect a yaw gyro behind a low-pass that roll and pitch do not have, by the noise of the axes.

Three axes of one gyro have noise alike: white noise of the chip, and vibration, whose lines differ
by some factor. Where one of them is filtered alone its noise falls off against the others' with the
square of the low-pass' gain, over several octaves, whatever is flown and however the motors answer.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rotorfit.findings import Evidence, Finding, doubt
from rotorfit.flight.on_board import first_order, second_order
from rotorfit.flight.spectral_density import windowed_lines

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from jaxtyping import Complex, Float

    from rotorfit.flight.clocks import UniformChannels

YAW_LOWPASS: Final = "yaw-lowpass"
"""Kind of the finding that the yaw gyro alone is filtered."""
WINDOW: Final = 0.5
"""Window of one spectrum [s]."""
SHORTEST: Final = 8
"""Rows of a window: of slower logs no noise is seen."""
MOST_WINDOWS: Final = 200
"""Windows of one stretch of flight that are looked at, spread over it: more show no more."""
LOWEST: Final = 5.0
"""Frequency below which axes differ by what is flown [Hz]."""
USABLE: Final = 0.4
"""Share of the sample rate up to which noise is looked at."""
OCTAVES: Final = 0.5
"""Width of a band."""
CUTOFFS: Final = np.geomspace(6.0, 60.0, 24)
"""Cut-offs that are tried [Hz]."""
FEWEST: Final = 4
"""Bands above the cut-off in which the noise must fall."""
LEAST_FALL: Final = float(np.log(50.0))
"""Fall of the noise's power from which yaw is filtered, 17 dB: in 60 real and simulated logs that
are not it falls by 12 dB at most, but for one (14 dB)."""
LEAST_EXPLAINED: Final = 0.9
"""Share of the differences between bands that a low-pass must explain: low-passes of 5 to 40 Hz
explain .97 and more, where yaw has no low-pass of its own one mostly explains nothing."""


class NoiseFall(NamedTuple):
    """How the noise of yaw falls off against that of roll and pitch.

    - `cutoff`: of the low-pass that fits best [Hz].
    - `fall`: from under the cut-off to the top, as logarithm of the power.
    - `explained`: share of the differences between bands that the low-pass explains.
    """

    cutoff: float
    fall: float
    explained: float

    @property
    def clear(self) -> bool:
        """Whether a low-pass makes it."""
        return self.fall > LEAST_FALL and self.explained > LEAST_EXPLAINED


def yaw_lowpass(uniform: UniformChannels, flights: Sequence[tuple[int, int]]) -> Iterator[Finding]:
    """Find a yaw gyro that alone is behind a low-pass."""
    found = noise_fall(uniform.values["gyro"], flights, uniform.sample_rate)
    if found is None or not found.clear:
        return
    yield doubt(
        YAW_LOWPASS,
        f"the yaw gyro alone is behind a low-pass: from about {found.cutoff:.2g} Hz on its noise "
        "falls off against that of roll and pitch; Jr comes out too small, and kd too large "
        "against Izz: log all axes of the gyro unfiltered, or behind one filter",
        evidence=(Evidence(name="yaw_lowpass", value=found.cutoff),),
    )


def noise_fall(
    gyro: Float[np.ndarray, "n 3"], flights: Sequence[tuple[int, int]], rate: float
) -> NoiseFall | None:
    """Compare the noise of yaw with that of roll and pitch; None where there is too little."""
    bands = _noise_by_band(gyro, flights, rate)
    if bands is None:
        return None
    frequency, power = bands
    ratio = power[:, 2] - power[:, :2].mean(axis=1)
    # A filter of the autopilot runs at a higher rate than its log; one of a log has a zero at half
    # of its own rate (bilinear transform).
    warped = np.tan(np.pi * frequency / rate) * rate / np.pi
    tried = (
        _fit_lowpass(axis, ratio, cutoff, shape)
        for axis in (frequency, warped)
        for shape in (first_order, second_order)
        for cutoff in CUTOFFS.tolist()
    )
    found = [one for one in tried if one is not None]
    return max(found, key=lambda one: one.explained, default=None)


def _fit_lowpass(
    frequency: Float[np.ndarray, " b"],
    ratio: Float[np.ndarray, " b"],
    cutoff: float,
    shape: Callable[[Float[np.ndarray, " b"]], Complex[np.ndarray, " b"]],
) -> NoiseFall | None:
    """Compare a ratio of powers with a low-pass; None where too few bands are above it."""
    used, under = frequency > 0.5 * cutoff, frequency < cutoff
    if not (used & under).any() or (~under).sum() < FEWEST:
        return None
    model = 2.0 * np.log(np.abs(shape(frequency[used] / cutoff)))
    off = ratio[used] - ratio[used].mean()
    left = float(np.sum((off - (model - model.mean())) ** 2))
    return NoiseFall(
        cutoff=cutoff,
        fall=float(ratio[used & under].mean() - ratio[-2:].mean()),
        explained=1.0 - left / max(float(off @ off), np.finfo(float).tiny),
    )


def _noise_by_band(
    gyro: Float[np.ndarray, "n 3"], flights: Sequence[tuple[int, int]], rate: float
) -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, "b 3"]] | None:
    """Return middle frequencies of bands [Hz] and the mean ln of each axis' power in them."""
    window = round(WINDOW * rate)
    if window < SHORTEST:
        return None
    parts = [
        np.abs(windowed_lines(gyro[a:b], window, max(window // 2, (b - a) // MOST_WINDOWS))) ** 2
        for a, b in flights
        if b - a >= window
    ]
    if not parts:
        return None
    power = np.concatenate(parts).mean(axis=0)
    frequency = np.fft.rfftfreq(window, 1.0 / rate)
    count = int(np.log2(USABLE * rate / LOWEST) / OCTAVES)
    edges = LOWEST * 2.0 ** (OCTAVES * np.arange(count + 1))
    rows = [(frequency >= a) & (frequency < b) for a, b in pairwise(edges)]
    rows = [row for row in rows if row.any()]
    if not rows or not (power[frequency >= LOWEST] > 0.0).all():
        return None
    log = np.log(power)
    return (
        np.array([np.exp(np.log(frequency[row]).mean()) for row in rows]),
        np.array([log[row].mean(axis=0) for row in rows]),
    )
