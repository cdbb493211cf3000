"""Widen intervals by known faults of the sensors: a low-pass on board, an estimated velocity.

A low-pass of the gyro delays and weakens the motion by which IMU and rotors are compared; a fit
takes it for lag and delay of the motors, which are not of its shape.

An autopilot's estimate of its velocity by GPS is wrong by decimetres a second, slowly. A
coefficient over a velocity with errors comes out too small, by the share of the errors in its
variance (errors in variables).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.logs.formats import FORMATS
from rotorfit.model.parameters import PARAMETERS
from rotorfit.model.terms.air import VELOCITY

if TYPE_CHECKING:
    from rotorfit.fit.dataset.dataset import ConfigurationData, Dataset
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.fit.timing.timed_dataset import TimedDataset

FLOWN_AT: Final = 3.0
"""About where quick rolls and nods are [Hz]."""
LENGTH: Final = 2e-4
"""What the wrong shape moves a centre by [m], .2 mm in ArduPilot's simulator at 20 Hz."""
ERROR: Final = 0.4
"""Standard deviation of an estimate's error along each axis [m/s]: PX4's was off by .2 to .5 in its
simulator, whose true velocity is in the log; an interval is to hold the larger ones."""
OVER: Final = {
    name: info.velocity_axis for name, info in PARAMETERS.items() if info.velocity_axis is not None
}
"""Coefficients, and the axis of the velocity that they are over."""
LARGEST: Final = 0.9
"""Share of the errors, beyond which the velocity is nothing else."""
MOMENTS: Final = ("Ixx", "Iyy", "Izz")
PLACES: Final = ("com_x", "com_y", "com_z", "rotor_center_x", "rotor_center_y")


def allow_for_gyro_lowpass(fit: Fit) -> Fit:
    """Append the fault of taking a low-pass of the gyro for a motor lag."""
    return fit.with_terms(lowpass_term(fit.numbers, fit.dataset))


def lowpass_term(numbers: Numbers, dataset: TimedDataset) -> IntervalTerm:
    """Return the term of inertia and places by taking a low-pass of the gyro for a motor lag."""
    from rotorfit.fit.timing.timing_faults import lowpass_of

    cutoff, timing = lowpass_of(dataset), dataset.timing
    half = np.zeros(len(numbers.names))
    term = IntervalTerm(
        name="gyro filter", half_width=half, source="the gyro's low-pass taken for a motor lag"
    )
    if cutoff is None or timing is None:
        return term
    passed = 1.0 / np.sqrt(1.0 + (FLOWN_AT / cutoff) ** 4)
    taken = 1.0 / np.sqrt(1.0 + (2.0 * np.pi * FLOWN_AT * timing.mean_lag) ** 2)
    for i, name in enumerate(numbers.names):
        base = name.partition("@")[0]
        if base.startswith(MOMENTS):
            half[i] = abs(taken - passed) * abs(numbers.values[i])
        elif base in PLACES:
            half[i] = LENGTH
    return term


def velocity_estimated(dataset: Dataset) -> bool:
    """Return whether a velocity in the model is an autopilot's estimate."""
    formats = {flight.log.format for flight in dataset.flights}
    known = VELOCITY in dataset.model.layout.added
    return known and any(is_estimate(form) for form in formats)


def is_estimate(form: str) -> bool:
    """Return whether the velocity in logs of a format is an autopilot's estimate."""
    return form in {known.name for known in FORMATS if known.velocity_estimated}


def allow_for_velocity_errors(fit: Fit) -> Fit:
    """Append the errors of an estimated velocity to the coefficients over it."""
    return fit.with_terms(velocity_term(fit.numbers, fit.dataset))


def velocity_term(numbers: Numbers, dataset: Dataset) -> IntervalTerm:
    """Return the term by the errors of an estimated velocity."""
    half = np.zeros(len(numbers.names))
    term = IntervalTerm(
        name="velocity errors", half_width=half, source="errors of a velocity by GPS"
    )
    if not velocity_estimated(dataset):
        return term
    for i, name in enumerate(numbers.names):
        base, _, owner = name.partition("@")
        axes = (0, 1) if base in numbers.by_velocity else (OVER[base],) if base in OVER else ()
        if not axes:
            continue
        own = [c for c in dataset.configurations if owner in ("", c.entry.name)]
        variance = max(_velocity_variance(own, axis) for axis in axes)
        share = LARGEST if variance <= 0.0 else min(ERROR**2 / variance, LARGEST)
        half[i] = abs(numbers.values[i]) * share / (1.0 - share)
        half[i] += vertical_partner(numbers, name, rotors=len(dataset.vehicle.rotors))
    return term


def vertical_partner(numbers: Numbers, name: str, *, rotors: int) -> float:
    """Compute the share of a coefficient that may be the other one's: drag along z and inflow."""
    base, _, owner = name.partition("@")
    values = dict(zip(numbers.names, numbers.values.tolist(), strict=True))
    at = next((n.partition("@")[2] for n in values if n.startswith("drag_z@")), "")
    speeds = abs(values.get(f"hover_speed@{owner or at}", np.nan)) * rotors
    # Both are a force against climb; only what they do to roll and pitch, where damping of the
    # frame does the same, separates them.
    if base == "drag_z" and "inflow" in values:
        return abs(values["inflow"]) * speeds
    if base == "inflow" and at:
        return abs(values[f"drag_z@{at}"]) / speeds
    return 0.0


def _velocity_variance(configurations: list[ConfigurationData], axis: int) -> float:
    """Compute the variance of a velocity over the used samples, its errors included."""
    parts = [
        data.velocity[s.start : s.stop, axis]
        for c in configurations
        for data in (flight.prepared.data for flight in c.flights)
        if data.velocity is not None
        for s in data.segments
    ]
    known = np.concatenate(parts) if parts else np.zeros(0)
    known = known[np.isfinite(known)]
    return float(known.var()) if len(known) else 0.0
