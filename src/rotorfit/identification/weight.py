"""k_t from the weight: over a whole flight the thrust carries it, whatever the sensors say.

The fit takes k_t from changes of thrust against changes of specific force. Where thrust does not
go with the square of the speed (commands without their law) or the accelerometer's scale is wrong,
that is another number than the one that carries the weight, along the vertical that the gyro
carries along (`hover.py`). On flights of which all is right the two agree to 3 %, where the weight
is the less sure: propellers in motion differ from those in hover.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorfit.identification.experiment import MotorsEntry, Source
from rotorfit.identification.flights import Configured
from rotorfit.identification.hover import Held, held_up, pooled
from rotorfit.identification.verdicts import ADVICE
from rotorfit.model.vehicle import Vehicle

INFLOW_STD = 0.02
"""Share by which a propeller in motion differs from the same in hover."""
LEAST_CONFLICT = 0.08
"""Share by which k_t of changes and of the weight may differ before the square law is doubted."""
VAGUE = 0.25
"""Share of k_t from which what changes of thrust leave open of it is taken from the weight."""
LIKELY = 3.0
"""Deviations of chance within which they always may."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WeighedThrust:
    """The thrust coefficient that carries the weight, value and standard deviation."""

    kt: float
    std: float

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


def kt_from_weight(configurations: Sequence[Configured], vehicle: Vehicle) -> WeighedThrust | None:
    """Return the thrust coefficient that carries the weight; None if no flight is long enough."""
    found: list[Held] = []
    for configured in configurations:
        for flight in configured.flights:
            data = flight.prepared.data
            per_kt = (data.rotor_speed**2 @ vehicle.axes) / configured.mass
            scale = float(np.abs(per_kt).mean())
            held = held_up(data, per_kt / scale) if scale > 0 else None
            if held is None or held.ratio <= 0:
                continue
            kt = 1.0 / (held.ratio * scale)
            found.append(Held(ratio=kt, std=kt * held.std, seconds=held.seconds))
    if not found:
        return None
    mean = pooled(found)
    return WeighedThrust(kt=mean.ratio, std=float(np.hypot(mean.std, INFLOW_STD * mean.ratio)))


def contradiction(
    weighed: WeighedThrust, kt: float, motors: MotorsEntry, source: Source = "imu"
) -> str:
    """Return what it means that changes of thrust give another k_t than the weight."""
    ratio = kt / weighed.kt
    seen = (
        f"thrust changes with the squared {_SPEED[motors.speed]} as if kt were {kt:.3g}, but "
        f"{weighed.kt:.3g} carries the weight: kt is taken from the weight, inertia with it, and "
        "the intervals hold both"
    )
    if motors.speed == "measured":
        return f"{seen}; calibrate {_SCALE_OF[source]}, or weigh again"
    if motors.law is None:
        return (
            f"{seen}; thrust goes neither with the command nor with its square, but in between "
            f"(about the power {2.0 * ratio:.1f} of it in hover): give law under [motors] as a "
            "thrust stand shows it, or log the rotor speed"
        )
    return f"{seen}; the law under [motors] does not hold: measure it again, or log the rotor speed"


def vagueness(weighed: WeighedThrust, kt: float, std: float) -> str:
    """Return what it means that changes of thrust leave k_t open."""
    return (
        f"changes of thrust tell kt only to {kt:.3g} +- {1.96 * std:.2g}; {weighed.kt:.3g} carries "
        "the weight: kt is taken from the weight, inertia with it, and the intervals hold both "
        f"values; {ADVICE['force']}"
    )


_SCALE_OF: Mapping[Source, str] = {
    "imu": "the accelerometer (its scale)",
    "mocap": "the cameras (their scale)",
}
_SPEED = {"measured": "rotor speed", "commanded": "command"}
