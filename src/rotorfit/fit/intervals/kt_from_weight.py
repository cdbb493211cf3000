"""k_t from the weight: over a whole flight the thrust carries it, whatever the sensors say.

The fit takes k_t from changes of thrust against changes of specific force. Where thrust does not go
with the square of the speed (commands without their law) or the accelerometer's scale is wrong,
that is another number than the one that carries the weight, along the vertical that the gyro
carries along (`weight_balance.py`). On flights of which all is right the two agree to 3 %, where
the weight is the less sure: propellers in motion differ from those in hover.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorfit.dataset.dataset import ConfigurationData, Dataset
from rotorfit.dataset.weight_balance import Held, held_together, held_up, pooled
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.model.parameters import ACCEL_BIAS_STD
from rotorfit.model.vehicle import Vehicle
from rotorfit.preprocessing.airborne import GRAVITY

INFLOW_STD = 0.02
"""Share by which a propeller in motion differs from the same in hover."""
LEAST_CONFLICT = 0.08
"""Share by which k_t of changes and of the weight may differ before the square law is doubted."""
VAGUE = 0.25
"""Share of k_t from which what changes of thrust leave open of it is taken from the weight."""
OWN_SHARE = 0.5
"""Of a bias's half-width that counts as chance: thrust that is taken for one makes it scatter."""
LIKELY = 3.0
"""Deviations of chance within which they always may."""
LARGEST_BIAS = 2.0 * ACCEL_BIAS_STD
"""By which a fitted bias along z may miss what the accelerometer reads over gravity, where chance
is less [m/s^2]: sound logs, of measured speeds or a known law, miss by 0.05 to 0.35; a simulated
one whose k_t came out 8 % low by 0.9, commands of which the law is not known by 2 to 3."""
NO_BIAS = Held(ratio=0.0, std=0.0, seconds=0.0)
"""Of cameras, along the vertical."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AbsorbedWeight:
    """A fitted bias of the accelerometer that gravity contradicts.

    Attributes
    ----------
    configuration
        Of the experiment.
    fitted
        Bias along z that the fit finds [m/s^2].
    read
        By how much the accelerometer reads more than gravity over the flights [m/s^2].
    """

    configuration: str
    fitted: float
    read: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WeighedThrust:
    """The thrust coefficient that carries the weight, value and standard deviation.

    `chance`: its deviation but for what is the same in every flight of a vehicle.
    """

    kt: float
    std: float
    chance: float = 0.0

    def contradicts(self, kt: float, std: float) -> bool:
        """Whether another estimate differs by more than chance and the model's own faults."""
        apart = abs(kt - self.kt)
        return apart > max(LEAST_CONFLICT * self.kt, LIKELY * float(np.hypot(std, self.std)))

    def is_surer_than(self, kt: float, std: float, *, timed: bool) -> bool:
        """Whether another estimate leaves open what the weight tells.

        Where the motors' timing is not told, changes of thrust are seen at a wrong time, and the
        mean thrust is not.
        """
        vague = VAGUE * abs(kt) if timed else 0.0
        return 1.96 * std > max(vague, 2.0 * 1.96 * self.std)


def kt_from_weight(
    configurations: Sequence[ConfigurationData], vehicle: Vehicle
) -> WeighedThrust | None:
    """Return the thrust coefficient that carries the weight; None if no flight is long enough."""
    found: list[Held] = []
    for configured in configurations:
        for flight in configured.flights:
            data = flight.prepared.data
            per_kt = (data.rotor_speed**2 @ vehicle.axes) / configured.mass
            scale = float(np.abs(per_kt).mean())
            held = held_up(flight.turning, per_kt / scale) if scale > 0 else None
            if held is None or held.ratio <= 0:
                continue
            kt = 1.0 / (held.ratio * scale)
            found.append(Held(ratio=kt, std=kt * held.std, seconds=held.seconds))
    if not found:
        return None
    mean = pooled(found)
    return WeighedThrust(
        kt=mean.ratio, std=float(np.hypot(mean.std, INFLOW_STD * mean.ratio)), chance=mean.std
    )


def absorbed_weight(dataset: Dataset, numbers: Numbers) -> AbsorbedWeight | None:
    """Return the bias along z that cannot be one, the worst of all configurations; None if none is.

    Over a whole flight an accelerometer reads gravity and its bias, and cameras, which know
    gravity, have none. A fit that finds another one explains thrust that does not carry the
    weight: by the square law of the commands, or a motor channel at a wrong time.

    Parameters
    ----------
    dataset
        The flights.
    numbers
        Of their fit; the bias need not be among them.
    """
    found: list[tuple[float, AbsorbedWeight]] = []
    for configured in dataset.configurations:
        name = f"accel_bias_z@{configured.entry.name}"
        read = NO_BIAS if dataset.source == "mocap" else _read_over_gravity(configured)
        if name not in numbers.names or read is None:
            continue
        fitted, half = numbers.number(name)
        apart = abs(fitted - read.ratio * GRAVITY)
        chance = float(np.hypot(OWN_SHARE * half, 1.96 * read.std * GRAVITY))
        if apart > max(LARGEST_BIAS, chance):
            wrong = AbsorbedWeight(
                configuration=configured.entry.name, fitted=fitted, read=read.ratio * GRAVITY
            )
            found.append((apart, wrong))
    return max(found, key=lambda one: one[0])[1] if found else None


def _read_over_gravity(configured: ConfigurationData) -> Held | None:
    """Return by how much the accelerometer reads more than gravity, as a share of it."""
    held = held_together(
        held_up(flight.turning, flight.prepared.data.specific_force)
        for flight in configured.flights
    )
    return None if held is None else replace(held, ratio=held.ratio - 1.0)
