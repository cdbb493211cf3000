r"""Sampled signals as smooth functions of time: one low-pass, one spline, every derivative from it.

Differences see a signal through a window: the second difference over three samples is
:math:`x_{n+1} - 2 x_n + x_{n-1} = h^2 \int (1 - |u|) \ddot x(t + uh) du`, the derivative through
two one-sample boxcars (a linear B-spline). An equation stays true if its other columns are averaged
alike, with Numerov's [1 10 1]/12 (what [1 4 1]/6 is for the first central difference); but where a
derivative is first turned by an attitude and then multiplied, the window no longer stands outside.
So it is undone instead: dividing the differences by those averages is what an interpolating spline
does, and a quintic one holds to the fourth order. All columns then belong to the same instant, and
what still acts on each of them is the one low-pass.
"""

import numpy as np
from jaxtyping import Float
from scipy import interpolate, signal

from rotorfit.preprocessing.signals import whole_samples

ORDER = 4
"""Of one pass of the Butterworth filter whose forward and backward pass `low_pass` equals."""
DEGREE = 5


def low_pass(
    values: Float[np.ndarray, "n k"], sample_rate: float, cutoff: float
) -> Float[np.ndarray, "n k"]:
    r"""Return the values through a zero-phase Butterworth low-pass, forward and backward in one.

    Its gain is :math:`1 / (1 + (\sqrt 2 - 1)(f/f_c)^8)`, 3 dB at the cut-off, whatever the sample
    rate: two channels on different clocks see the same filter, which a recursive filter would not
    give them near half their rates. The ends are continued by point reflection.
    """
    n = len(values)
    pad = min(n - 1, whole_samples(4.0 * sample_rate / cutoff))
    wide = np.concatenate(
        [
            2.0 * values[:1] - values[pad:0:-1],
            values,
            2.0 * values[-1:] - values[-2 : -pad - 2 : -1],
        ]
    )
    # A straight line keeps the two ends of the periodic continuation together.
    size = len(wide)
    ramp = np.linspace(0.0, 1.0, size)[:, None] * (wide[-1] - wide[0])
    frequency = np.fft.rfftfreq(size, 1.0 / sample_rate)
    gain = (1.0 + (np.sqrt(2.0) - 1.0) * (frequency / cutoff) ** (2 * ORDER)) ** -1.0
    lines = np.fft.rfft(wide - ramp, axis=0) * gain[:, None]
    return (np.fft.irfft(lines, n=size, axis=0) + ramp)[pad : pad + n]


def spline_derivatives(
    values: Float[np.ndarray, "n k"], sample_rate: float
) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n k"]]:
    """Return first and second time derivative at the samples, of the quintic spline through them.

    Near the ends they are not to be used: a few samples hold what the spline does not know.
    """
    rows = np.arange(len(values), dtype=float)
    spline = interpolate.make_interp_spline(rows, values, k=DEGREE)
    return spline(rows, nu=1) * sample_rate, spline(rows, nu=2) * sample_rate**2


def spline_at(
    values: Float[np.ndarray, "n k"],
    rows: Float[np.ndarray, " m"],
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "m k"]]:
    """Return values and derivatives per sample at fractional rows; beyond the ends, at the ends."""
    spline = interpolate.make_interp_spline(np.arange(len(values)), values, k=DEGREE)
    inside = np.clip(rows, 0.0, len(values) - 1.0)
    return spline(inside), spline(inside, nu=1)


def smooth_motors(
    speed: Float[np.ndarray, "n N"], sample_rate: float, *, lag: float, delay: float
) -> tuple[Float[np.ndarray, "n N"], Float[np.ndarray, "n N"]]:
    """Return rotor speed and acceleration, `delay` later and behind a first-order lag.

    Parameters
    ----------
    speed
        Low-passed, without gaps [rad/s].
    sample_rate
        Of the samples [Hz].
    lag
        Time constant [s].
    delay
        By how much the motors act later than recorded [s].
    """
    if lag > 0:
        speed = _lagged(speed, 1.0 / (sample_rate * lag))
    rows = np.arange(len(speed)) - delay * sample_rate
    value, slope = spline_at(speed, rows)
    return value, slope * sample_rate


def _lagged(speed: Float[np.ndarray, "n N"], step: float) -> Float[np.ndarray, "n N"]:
    """Return a smooth signal behind a lag; `step` is the sample period over the time constant.

    Exact for what is linear between samples, where a held command would come half a sample later.
    """
    a = float(np.exp(-step))
    mean = (1.0 - a) / step
    b = [1.0 - mean, mean - a]
    start = speed[:1] * b[1] + a * speed[:1]  # settled before the first sample
    lagged, _ = signal.lfilter(b, [1.0, -a], speed, axis=0, zi=start)
    return lagged
