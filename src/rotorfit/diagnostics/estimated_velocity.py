"""What the errors of an autopilot's estimate of its velocity can do to what hangs on it.

An estimator on GPS is wrong by decimetres a second, slowly. A coefficient over a velocity with
errors comes out too small, by the share of the errors in its variance (errors in variables).
"""

import dataclasses
from typing import Final

import numpy as np

from rotorfit.dataset.dataset import ConfigurationData, Dataset
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.logs.formats import FORMATS

ERROR: Final = 0.3
"""Standard deviation of an estimate's error along each axis [m/s]: PX4's was off by .2 to .5 in its
simulator, whose true velocity is in the log."""
OVER: Final = {"drag_x": 0, "drag_y": 1, "drag_z": 2, "inflow": 2}
"""Coefficients, and the axis of the velocity that they are over."""
LARGEST: Final = 0.9
"""Share of the errors, beyond which the velocity is nothing else."""


def velocity_estimated(dataset: Dataset) -> bool:
    """Return whether a velocity in the model is an autopilot's estimate."""
    formats = {flight.log.format for c in dataset.configurations for flight in c.flights}
    estimated = {form.name for form in FORMATS if form.velocity_estimated}
    return dataset.velocity == "known" and not formats.isdisjoint(estimated)


def with_velocity_errors(numbers: Numbers, dataset: Dataset) -> Numbers:
    """Return the numbers, those over an estimated velocity with wider intervals."""
    if not velocity_estimated(dataset):
        return numbers
    half = numbers.half_width.copy()
    for i, name in enumerate(numbers.names):
        base, _, owner = name.partition("@")
        if base not in OVER:
            continue
        own = [c for c in dataset.configurations if owner in ("", c.entry.name)]
        variance = _variance(own, OVER[base])
        share = LARGEST if variance <= 0.0 else min(ERROR**2 / variance, LARGEST)
        half[i] += abs(numbers.values[i]) * share / (1.0 - share)
    return dataclasses.replace(numbers, half_width=half)


def _variance(configurations: list[ConfigurationData], axis: int) -> float:
    """Return the variance of a velocity over the used samples, with the errors in it."""
    parts = [
        data.velocity[s.start : s.stop, axis]
        for c in configurations
        for data in (flight.prepared.data for flight in c.flights)
        if data.velocity is not None
        for s in data.segments
    ]
    return float(np.concatenate(parts).var()) if parts else 0.0
