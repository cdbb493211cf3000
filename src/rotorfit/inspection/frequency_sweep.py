"""Whether an autopilot flew a frequency sweep: ArduPilot's SystemID mode, Betaflight's chirp.

While one is injected, the rate of one axis is nearly a sine whose frequency rises all the time.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import signal, stats

from rotorfit.preprocessing.signals import true_runs

WINDOW_SECONDS: Final = 1.0
STEP_SECONDS: Final = 0.25
BAND: Final = (1.0, 60.0)
"""Looked for; a window holds too little of what is slower [Hz]."""
NEAR: Final = 1.5
"""Within this factor of the strongest frequency is the sine itself."""
PURE: Final = 0.6
"""Least share of the power that is in the sine."""
LEAST_SECONDS: Final = 4.0
LEAST_RISE: Final = 3.0
"""From the first frequency to the last."""
STEADY: Final = 0.95
"""Least rank correlation of frequency and time."""
AXES: Final = ("roll", "pitch", "yaw")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """A frequency sweep about one axis: when it was in `BAND` [s], and its frequencies [Hz]."""

    axis: str
    start: float
    end: float
    lowest: float
    highest: float

    def words(self) -> str:
        """Describe the sweep."""
        return (
            f"{self.axis}: {self.start:.0f} to {self.end:.0f} s, {self.lowest:.2g} to "
            f"{self.highest:.2g} Hz"
        )


def frequency_sweeps(
    time: Float[np.ndarray, " n"], rates: Float[np.ndarray, "n 3"]
) -> tuple[Sweep, ...]:
    """Find the frequency sweeps in body rates about x, y, z, sampled in equal steps [s]."""
    if time[-1] - time[0] < LEAST_SECONDS + WINDOW_SECONDS:
        return ()
    fs = 1.0 / float(np.median(np.diff(time)))
    length = round(WINDOW_SECONDS * fs)
    frequency, at, power = signal.spectrogram(
        rates.T, fs, "hann", length, length - max(round(STEP_SECONDS * fs), 1), nfft=4 * length
    )
    used = (frequency >= BAND[0]) & (frequency <= min(BAND[1], 0.4 * fs))
    found: list[Sweep] = []
    for i, axis in enumerate(AXES):
        strongest, share = _sine(frequency[used], power[i][used])
        found += _rises(axis, at + time[0], strongest, share > PURE)
    return tuple(found)


def _sine(
    frequency: Float[np.ndarray, " f"], power: Float[np.ndarray, "f t"]
) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
    """Find the strongest frequency of each window, and the share of the power about it."""
    strongest = frequency[np.argmax(power, axis=0)]
    ratio = frequency[:, None] / strongest
    near = (ratio < NEAR) & (ratio > 1.0 / NEAR)
    return strongest, (power * near).sum(axis=0) / np.maximum(power.sum(axis=0), 1e-30)


def _rises(
    axis: str,
    at: Float[np.ndarray, " t"],
    strongest: Float[np.ndarray, " t"],
    pure: np.ndarray,
) -> list[Sweep]:
    """Find the stretches of sines whose frequency rises, no window falling far back."""
    goes_on = pure[1:] & pure[:-1] & (strongest[1:] > strongest[:-1] / 1.1)
    goes_on &= strongest[1:] < 2.0 * strongest[:-1]
    sweeps: list[Sweep] = []
    for first, last in true_runs(goes_on):
        f, t = strongest[first : last + 1], at[first : last + 1]
        lowest, highest = float(f.min()), float(f.max())
        long = t[-1] - t[0] >= LEAST_SECONDS and highest >= LEAST_RISE * lowest
        if long and float(stats.spearmanr(t, f).statistic) > STEADY:
            sweep = Sweep(
                axis=axis, start=float(t[0]), end=float(t[-1]), lowest=lowest, highest=highest
            )
            sweeps.append(sweep)
    return sweeps
