"""What the timing of the motors leaves open besides noise: held samples, and unknown low-passes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from rotorfit.fit.dataset.dataset import Dataset, LoadedFlight

HOLD_FAULT: Final = 0.25
"""Fault of a hold, in samples: half of the half-sample that lies between the two ways a command may
have held."""
SLOW_DELAY: Final = float(np.sqrt(2.0) / (2.0 * np.pi))
"""Delay of slow motion by a low-pass of second order (Butterworth), times its cut-off."""
FILTER_SHAPE: Final = 0.1
"""Deviation of lag and of delay, as a share of the filter's, which is neither: pieces of one flight
in ArduPilot's simulator (11 ms at 20 Hz, motors without lag) give a lag of 5.1 to 9.8 ms."""


def hold_fault(dataset: Dataset) -> float:
    """Estimate the deviation of a delay by not knowing how long a command held [s]."""
    if dataset.motors.speed == "measured":
        return 0.0
    rates = [f.prepared.motor_rate for f in dataset.flights]
    # A command holds until the next one of the log or, where the log keeps only some of a faster
    # loop's commands, is over sooner: up to half a sample of the log later on the whole.
    return HOLD_FAULT / min(rates)


def lowpass_of(dataset: Dataset) -> float | None:
    """Return the lowest cut-off [Hz] of the gyros' low-pass on board, absorbed by commanded motors.

    In Hz; None if there is none, or where speeds are measured.
    """
    if dataset.motors.speed == "measured":
        return None
    found = [f.log.gyro_lowpass for f in dataset.flights if not _passed_by_rotors(f)]
    return min((cutoff for cutoff in found if cutoff), default=None)


def _passed_by_rotors(flight: LoadedFlight) -> bool:
    """Return whether the rotors' speeds passed the low-pass of the gyro as well."""
    filters = flight.prepared.data.filters
    return any(one.channel == "gyro" and one.kind == "low-pass" for one in filters)


def filter_delay(cutoff: float) -> float:
    """Compute the delay of slow motion by a low-pass of second order (Butterworth) [s]."""
    return SLOW_DELAY / cutoff


def shape_fault(dataset: Dataset) -> float:
    """Compute the deviation of the times of motors that absorb a filter's delay [s]."""
    cutoff = lowpass_of(dataset)
    return 0.0 if cutoff is None else FILTER_SHAPE * filter_delay(cutoff)
