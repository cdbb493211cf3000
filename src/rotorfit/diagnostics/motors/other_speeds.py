"""The same flights with other rotor speeds behind their commands."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from rotorfit.dataset.dataset import with_prepared
from rotorfit.diagnostics.kt_from_weight import HELD_TO, kt_from_weight, kt_of
from rotorfit.fit.fit import Fit, shift_of
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.preprocessing.motors.motor_model import with_motors
from rotorfit.preprocessing.prepare import PreparedFlight

Speeds = Float[np.ndarray, "n N"]
Change = Callable[[Speeds, Float[np.ndarray, "m N"]], Speeds]
"""From speeds [rad/s], as kept or as recorded, and those of the flight's used part, to others."""


def with_other_speeds(dataset: TimedDataset, change: Change) -> TimedDataset:
    """Return the flights with other speeds of the motor channel, before lag and delay."""
    return with_prepared(dataset, lambda prepared: _changed(prepared, dataset, change))


def _changed(prepared: PreparedFlight, dataset: TimedDataset, change: Change) -> PreparedFlight:
    """Change the speeds of a flight, as recorded and as kept."""
    data = prepared.data
    flown = prepared.motor_channel[data.used_rows]
    if data.held is not None:
        held = dataclasses.replace(data.held, speed=change(data.held.speed, flown))
        data = dataclasses.replace(data, held=held)
    channel = change(prepared.motor_channel, flown)
    return dataclasses.replace(
        prepared, data=with_motors(data, channel, dataset.declared), motor_channel=channel
    )


def shift_by_speeds(fit: Fit, other: TimedDataset) -> Float[np.ndarray, " q"]:
    """Compute how far the numbers move with other speeds, k_t with the weight that they carry."""
    weights = [
        kt_from_weight(one.configurations, one.vehicle, source=one.source, timing=one.timing)
        for one in (fit.dataset, other)
    ]
    here, there = (None if one is None else one.value for one in weights)
    if here is None or there is None:
        return shift_of(fit, other)
    kt = kt_of(fit.numbers)[0] * there / here
    return shift_of(fit, other, known={"kt": (kt, HELD_TO * kt)})
