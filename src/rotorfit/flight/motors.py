"""From commanded to actual rotor speed: the motor's law, its lag and its delay."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy import signal

from rotorfit.flight.speed_law import SpeedLaw as SpeedLaw
from rotorfit.flight.speed_law import speed_from_command as speed_from_command

NOISE_ROWS = 256
"""Length of the spectra in which the noise of rotor speeds is looked for."""


def first_order_lag(
    held: Float[np.ndarray, "n N"], sample_rate: float, lag: float
) -> Float[np.ndarray, "n N"]:
    r"""Return the speed of motors that follow a held command with a first-order lag.

    The command is held between samples (zero-order hold), for which
    :math:`O_{k+1} = a O_k + (1 - a) u_k, a = e^{-dt/\tau}` is exact; an ordinary sampled low-pass
    would be off by half a sample. The motors start settled.

    Parameters
    ----------
    held
        Speed that each command would settle at, held from its sample to the next [rad/s].
    sample_rate
        Of the samples [Hz].
    lag
        Time constant tau [s]; 0 returns the command as it is.
    """
    if lag <= 0:
        return held
    a = float(np.exp(-1.0 / (sample_rate * lag)))
    lagged, _ = signal.lfilter([0.0, 1.0 - a], [1.0, -a], held, axis=0, zi=held[:1])
    return lagged


def shift_time(
    values: Float[np.ndarray, "n N"], sample_rate: float, delay: float
) -> Float[np.ndarray, "n N"]:
    """Return values as they were `delay` seconds before each sample.

    By the polynomial through the ten nearest samples. A straight line between two would average
    their noise away at half a sample, and a search for the delay would take that for a good fit.
    The first and the last value are held.
    """
    if delay == 0:
        return values
    whole = int(np.floor(delay * sample_rate))
    part = delay * sample_rate - whole
    nodes = np.arange(-4, 6)
    weights = [
        float(np.prod([(part - m) / (k - m) for m in nodes if m != k])) for k in nodes.tolist()
    ]
    rows = np.arange(len(values)) - whole
    taken = [values[np.clip(rows - k, 0, len(values) - 1)] for k in nodes.tolist()]
    return np.einsum("k,knr->nr", weights, np.array(taken))


def white_noise_std(
    values: Float[np.ndarray, "n N"], stretches: Sequence[tuple[int, int]]
) -> float:
    """Return the standard deviation of the white noise in measured rotor speeds [rad/s].

    A rotor cannot follow the fastest changes that a log can hold: what is left of its spectrum
    close to the Nyquist frequency is error of measurement. The median over that tenth of the
    spectrum, so that a single line of vibration does not count.

    Parameters
    ----------
    values
        Measured speeds on a uniform clock.
    stretches
        Start and stop (exclusive) of the rows to look at.
    """
    levels: list[float] = []
    for start, stop in stretches:
        if stop - start < NOISE_ROWS:
            continue
        spectrum = signal.welch(
            values[start:stop], fs=1.0, nperseg=NOISE_ROWS, axis=0, detrend="constant"
        )
        top: Float[np.ndarray, "f N"] = np.asarray(spectrum[1], dtype=float)[-NOISE_ROWS // 20 :]
        levels.append(0.5 * float(np.median(top)))  # one-sided density, half a cycle a sample
    return float(np.sqrt(np.median(levels))) if levels else 0.0
