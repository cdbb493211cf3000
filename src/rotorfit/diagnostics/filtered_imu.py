"""What a low-pass on board does to a fit that knows only motors with a lag and a delay.

The filter delays and weakens what IMU and rotors have to be compared by; a fit takes it for lag and
delay of the motors, which are not of its shape.
"""

import dataclasses
from typing import Final

import numpy as np

from rotorfit.dataset.dataset import Dataset
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.timing.onboard_filter import filter_delay, lowpass_of

FLOWN_AT: Final = 3.0
"""About where quick rolls and nods are [Hz]."""
LENGTH: Final = 2e-4
"""What the wrong shape moves a centre by [m], .2 mm in ArduPilot's simulator at 20 Hz."""
MOMENTS: Final = ("Ixx", "Iyy", "Izz")
PLACES: Final = ("com_x", "com_y", "com_z", "rotor_center_x", "rotor_center_y")


def lowpass_sentence(dataset: Dataset) -> str | None:
    """Return that the motors' times hold the filter's; None where there is none, or no lag."""
    cutoff = lowpass_of(dataset)
    if cutoff is None:
        return None
    return (
        f"the gyro is low-passed on board at {cutoff:g} Hz: {1e3 * filter_delay(cutoff):.0f} ms of "
        "motor_lag and motor_delay together are the filter's, not the motors'; for the motors' "
        "own, log the IMU raw (ArduPilot: bit 19 of LOG_BITMASK)"
    )


def with_filter_faults(numbers: Numbers, dataset: Dataset) -> Numbers:
    """Return the numbers, inertia and places with the fault of taking a low-pass for a lag."""
    cutoff, timing = lowpass_of(dataset), dataset.timing
    if cutoff is None or timing is None:
        return numbers
    passed = 1.0 / np.sqrt(1.0 + (FLOWN_AT / cutoff) ** 4)
    taken = 1.0 / np.sqrt(1.0 + (2.0 * np.pi * FLOWN_AT * timing.mean_lag) ** 2)
    half = numbers.half_width.copy()
    for i, name in enumerate(numbers.names):
        base = name.partition("@")[0]
        if base.startswith(MOMENTS):
            half[i] += abs(taken - passed) * abs(numbers.values[i])
        elif base in PLACES:
            half[i] += LENGTH
    return dataclasses.replace(numbers, half_width=half)
