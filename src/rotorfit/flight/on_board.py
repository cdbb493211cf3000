r"""The filters on board that a log names, applied to what the model makes of the motors.

A gyro behind a low-pass shows the motion late and small. If the rotors' speeds pass the same filter
before the two are compared, both sides of an equation have seen it, and what is left of lateness is
the motors' alone. All filters are linear and stand still: the motor channel passes them before the
motors' lag, with the same result. As analog ones, which the loops of a flight controller (1 kHz and
faster) resemble at the frequencies of a fit; in the frequency domain, where the rate of the log
does not matter. An accelerometer behind filters of its own gets the gyro's in place of them.

The velocity passes the gyro's filters, too: autopilots estimate it from samples that no filter
delayed. Without that the drag would lead the specific force, by 11 ms behind a low-pass at 20 Hz;
the drag then changes as the lean does, which looks like a lever of the accelerometer.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.filters import fast_length
from rotorfit.logs.firmware import Filter, filters_on_board

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from jaxtyping import Complex, Float, Int

    from rotorfit.flight.flight_data import FlightData
    from rotorfit.logs.flight_log import FlightLog

ORDERS: Final = {"pt1": 1, "pt2": 2, "pt3": 3}
FADING: Final = 1.0
"""Length before and after a channel, within which the response of a low-pass at 2 Hz fades [s]."""
MOST_RESTORED: Final = 4.0
"""Largest gain by which a filtered accelerometer is amplified: above it noise of the log's digits
and of vibration aliases is what is left of a channel that lost 12 dB."""


def applied_filters(log: FlightLog) -> tuple[Filter, ...]:
    """Return the filters that the logged samples passed, and whose response is known."""
    return tuple(one for one in filters_on_board(log) if one.passed and one.is_known)


def response_of(
    filters: Iterable[Filter], channel: str, frequency: Float[np.ndarray, " f"]
) -> Complex[np.ndarray, " f"]:
    """Compute the response of all filters of a channel (``gyro`` or ``accel``)."""
    found = np.ones(len(frequency), dtype=complex)
    for one in filters:
        if one.channel == channel:
            found *= filter_response(one, frequency)
    return found


def filter_response(one: Filter, frequency: Float[np.ndarray, " f"]) -> Complex[np.ndarray, " f"]:
    """Compute the response of an analog filter."""
    if one.kind == "notch":
        assert one.middle is not None
        u = frequency / one.middle
        width = (one.high - one.low) / one.middle
        return (1.0 - u**2) / (1.0 - u**2 + 1j * width * u)
    u = frequency / one.low
    if one.shape == "butterworth":
        return second_order(u)
    order = ORDERS[one.shape or "pt1"]
    # Low-passes lose 3 dB at their cut-off: of n first orders in a row each has its own cut-off
    # higher by 1 / sqrt(2^(1/n) - 1) (Betaflight, common/filter.c).
    return first_order(u * np.sqrt(2.0 ** (1.0 / order) - 1.0)) ** order


def first_order(u: Float[np.ndarray, " f"]) -> Complex[np.ndarray, " f"]:
    """Compute the response of a first-order low-pass by frequency over its cut-off."""
    return 1.0 / (1.0 + 1j * u)


def second_order(u: Float[np.ndarray, " f"]) -> Complex[np.ndarray, " f"]:
    """Compute the response of a second-order Butterworth low-pass by frequency over its cut-off."""
    return 1.0 / (1.0 - u**2 + 1j * np.sqrt(2.0) * u)


def passed_through(
    values: Float[np.ndarray, "n N"],
    sample_rate: float,
    filters: Iterable[Filter],
    *,
    jumps: Int[np.ndarray, " j"],
) -> Float[np.ndarray, "n N"]:
    """Pass motor data through the gyro's filters, again after every gap (`jumps`: first rows)."""
    own = [one for one in filters if one.channel == "gyro"]
    if not own:
        return values
    passed = _filter_stretches(values, sample_rate, partial(response_of, own, "gyro"), jumps)
    return np.maximum(passed, 0.0)


def with_filters(
    data: FlightData, filters: Sequence[Filter], *, jumps: Int[np.ndarray, " j"]
) -> FlightData:
    """Return a flight with its filters, force and velocity behind those of the gyro."""
    force, velocity = data.specific_force, data.velocity
    own, gyro = (
        [replace(one, channel="", setting="") for one in filters if one.channel == name]
        for name in ("accel", "gyro")
    )
    if own and own != gyro:
        respond = partial(restoring_response, filters)
        force = _filter_stretches(force, data.sample_rate, respond, jumps)
    if gyro and velocity is not None:
        respond = partial(response_of, filters, "gyro")
        velocity = _filter_stretches(velocity, data.sample_rate, respond, jumps)
    return replace(data, filters=tuple(filters), specific_force=force, velocity=velocity)


def without_lateness(
    data: FlightData,
    low_pass: Callable[[Float[np.ndarray, " f"]], Complex[np.ndarray, " f"]],
    *,
    jumps: Int[np.ndarray, " j"],
) -> FlightData:
    """Return a flight whose specific force is no longer late by a low-pass; its gain stays."""

    def advance(frequency: Float[np.ndarray, " f"]) -> Complex[np.ndarray, " f"]:
        response = low_pass(frequency)
        return np.conj(response) / np.abs(response)

    force = _filter_stretches(data.specific_force, data.sample_rate, advance, jumps)
    return replace(data, specific_force=force)


def restoring_response(
    filters: Sequence[Filter], frequency: Float[np.ndarray, " f"]
) -> Complex[np.ndarray, " f"]:
    """Compute the response that gives the accelerometer the gyro's filters in place of its own."""
    gyro, accel = (response_of(filters, name, frequency) for name in ("gyro", "accel"))
    ratio = accel / gyro
    left = np.abs(ratio)
    # To pass the rotors through the accelerometer's filters instead would weigh the same: the
    # likelihood of a band does not depend on the gain that both sides have. Beyond `MOST_RESTORED`
    # the noise would be all that is left, and the response falls.
    lost = left * MOST_RESTORED < 1.0
    return np.conj(ratio) / np.where(lost, MOST_RESTORED**-2, left**2)


def _filter_stretches(
    values: Float[np.ndarray, "n N"],
    sample_rate: float,
    respond: Callable[[Float[np.ndarray, " f"]], Complex[np.ndarray, " f"]],
    jumps: Int[np.ndarray, " j"],
) -> Float[np.ndarray, "n N"]:
    """Filter the stretches between gaps, each as if it had stood at its ends before and after.

    Rows that are not known (NaN) stay so, and end a stretch.
    """
    known = np.isfinite(values).all(axis=1)
    ends = np.union1d(jumps, np.flatnonzero(np.diff(known)) + 1)
    parts = [
        _filter_stretch(part, sample_rate, respond) if own[:1].all() else part
        for part, own in zip(np.split(values, ends), np.split(known, ends), strict=True)
    ]
    return np.concatenate(parts)


def _filter_stretch(
    values: Float[np.ndarray, "n N"],
    sample_rate: float,
    respond: Callable[[Float[np.ndarray, " f"]], Complex[np.ndarray, " f"]],
) -> Float[np.ndarray, "n N"]:
    """Filter a stretch as if its first and last rows had stood before and after it."""
    pad = round(FADING * sample_rate)
    wide = np.pad(values, ((pad, pad), (0, 0)), mode="edge")
    rows = fast_length(len(wide))
    wide = np.pad(wide, ((0, rows - len(wide)), (0, 0)), mode="edge")
    response = respond(np.fft.rfftfreq(rows, 1.0 / sample_rate))
    # The two ends of the circle differ: their step fades within the rows that are cut off.
    lines = np.fft.rfft(wide, axis=0) * response[:, None]
    return np.fft.irfft(lines, rows, axis=0)[pad : pad + len(values)]
