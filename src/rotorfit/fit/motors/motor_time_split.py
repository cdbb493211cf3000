r"""Widen the motors' lag and delay by the uncertainty from the autopilot's response to noise.

A lag and a delay differ by how measured over predicted turns, H, go with frequency:
:math:`d \ln H = -j \omega / (1 + j \omega \tau) \, d\tau - j \omega \, dt`. Their likelihood
takes noise to which the autopilot responds by commands as independent of these; what of it
may go with them is in the deviations of the bands' ratios (`sensor_response`), by which the two are
weighed once more: the sum is well known, the split where the rotors explain quick turns, too.

An IMU on a soft mount, or speeds behind a filter, bend H as a shorter lag does: by how much the
filter that fits these ratios best moves the lag is in its deviation, whether certain or not. By how
much it moves the delay is in that one's where the flights show the filter: of the phase that turns
with frequency a filter and a delay take what is left, and neither says which is right.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.fit import Fit
from rotorfit.fit.reduction.motor_timing import MotorTiming
from rotorfit.fit.sensors.sensor_response import (
    LEAST_SPREAD,
    BandRatio,
    FoundFilter,
    best_filter,
    flight_ratios,
)
from rotorfit.fit.timing.timing_faults import lowpass_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.fit.fit import Fit
    from rotorfit.fit.reduction.motor_timing import MotorTiming

TIMES: Final = ("motor_lag", "motor_delay")
SPREAD: Final = LEAST_SPREAD
"""Mean square of what bands leave over what their deviations allow: the least that is believed."""


def allow_for_noise_feedback(fit: Fit) -> Fit:
    """Widen lag and delay of commanded motors, and their sum; the delay of measured speeds."""
    timing = fit.dataset.motor_timing
    free = () if timing is None else tuple(name for name in TIMES if name in timing.free)
    if timing is None or fit.dataset.source != "imu":
        return fit
    if "motor_lag" not in free:
        return fit.with_timing(widen_delay(timing, fit.record_of(FoundFilter)))
    ratios = flight_ratios(fit)
    if not ratios:
        return fit
    covariance = SPREAD * times_covariance(
        ratios, free, lag=timing.response.mean_lag, prior=fit.dataset.lag_prior[1]
    )
    most = max(fit.dataset.lag_prior[1], timing.lag_std or 0.0)
    bent = None if lowpass_of(fit.dataset) is not None else best_filter(ratios, lagging=True)
    by_filter = 0.0 if bent is None else bent.lag
    widened = _widen_timing(timing, free, covariance, most=most, by_filter=by_filter)
    return fit.with_timing(widen_delay(widened, bent))


def widen_delay(timing: MotorTiming, found: FoundFilter | None) -> MotorTiming:
    """Add what a filter that the flights show moves the delay by, and the sum of delay and lag."""
    if found is None or not found.certain or timing.delay_std is None:
        return timing
    return timing.widened(delay=found.delay / 1.96, total=(found.delay + found.lag) / 1.96)


def times_covariance(
    ratios: Sequence[BandRatio], free: Sequence[str], *, lag: float, prior: float
) -> Float[np.ndarray, "t t"]:
    """Compute the covariance of lag and delay [s^2] by the ratios, each axis with its own factor.

    `lag` [s], and what is known of it beforehand, `prior` [s].
    """
    omega = 2.0 * np.pi * np.array([one.frequency for one in ratios])
    # d log H of H = exp(-i w delay) / (1 + i w lag).
    slopes = {"motor_lag": -1j * omega / (1.0 + 1j * omega * lag), "motor_delay": -1j * omega}
    keys = sorted({(one.flight, one.axis) for one in ratios})
    own = [[(one.flight, one.axis) == key for one in ratios] for key in keys]
    std = np.array([one.std for one in ratios])
    columns = np.array([*own, *(slopes[name] for name in free)], dtype=complex) / std
    # Size and phase of a ratio are two equations of real numbers.
    A = np.concatenate([np.real(columns), np.imag(columns)], axis=1)
    known = np.zeros(len(columns))
    known[len(keys)] = prior**-2
    scale = np.sqrt(np.diagonal(A @ A.T) + known)
    inverse = np.linalg.inv((A @ A.T + np.diag(known)) / np.outer(scale, scale))
    covariance: Float[np.ndarray, "t t"] = (inverse / np.outer(scale, scale))[
        len(keys) :, len(keys) :
    ]
    return covariance


def _widen_timing(
    timing: MotorTiming,
    free: Sequence[str],
    covariance: Float[np.ndarray, "t t"],
    *,
    most: float,
    by_filter: float,
) -> MotorTiming:
    """Add deviations to those of a timing; a lag's is `most` at most [s].

    `covariance` is that of the times `free`, `by_filter` half of the interval that a filter makes
    of the lag [s].
    """
    by = dict(zip(free, np.sqrt(np.diagonal(covariance)).tolist(), strict=True))
    assert timing.lag_std is not None
    delay = timing.delay_std
    if delay is not None and "motor_delay" in by:
        delay = float(np.hypot(delay, by["motor_delay"]))
    return replace(
        timing,
        lag_std=min(
            float(np.linalg.norm([timing.lag_std, by["motor_lag"], by_filter / 1.96])), most
        ),
        delay_std=delay,
        total_std=float(np.hypot(timing.total_std, np.sqrt(covariance.sum()))),
    )
