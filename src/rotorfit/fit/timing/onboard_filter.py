"""A low-pass of the gyro on board: the part of the motors' times that is its delay."""

from typing import Final

import numpy as np

from rotorfit.dataset.dataset import Dataset

SHAPE: Final = 0.1
"""Deviation of lag and of delay, as a share of the filter's, which is neither: pieces of one flight
in ArduPilot's simulator (11 ms at 20 Hz, motors without lag) give a lag of 5.1 to 9.8 ms."""


def lowpass_of(dataset: Dataset) -> float | None:
    """Return the lowest cut-off [Hz] of the gyros' low-pass on board, absorbed by commanded motors.

    In Hz; None where there is none, or where speeds are measured.
    """
    if dataset.motors.speed == "measured":
        return None
    found = [f.log.gyro_lowpass for c in dataset.configurations for f in c.flights]
    return min((cutoff for cutoff in found if cutoff), default=None)


def filter_delay(cutoff: float) -> float:
    """Compute the delay of slow motion by a low-pass of second order (Butterworth) [s]."""
    return float(np.sqrt(2.0) / (2.0 * np.pi * cutoff))


def shape_fault(dataset: Dataset) -> float:
    """Compute the deviation of the times of motors that absorb a filter's delay [s]."""
    cutoff = lowpass_of(dataset)
    return 0.0 if cutoff is None else SHAPE * filter_delay(cutoff)
