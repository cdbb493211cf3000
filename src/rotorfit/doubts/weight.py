"""Where changes of thrust and the weight disagree about k_t: what that means, in words."""

from collections.abc import Mapping

from rotorfit.experiment.experiment import MotorsEntry, Source
from rotorfit.fit.kt_from_weight import SwallowedWeight, WeighedThrust
from rotorfit.results.verdicts import ADVICE


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


def swallowed(
    wrong: SwallowedWeight,
    weighed: WeighedThrust,
    kt: float,
    source: Source = "imu",
    *,
    estimated: bool = False,
) -> str:
    """Return what it means that the fit makes a bias along z out of the weight."""
    seen = "the accelerometer reads" if source == "imu" else "motion capture sees"
    cause = "thrust that does not follow the motor data as declared"
    cure = "give the motors' law and lag under [motors], or log the rotor speed"
    if estimated:
        cause += ", or drag over an estimated velocity, which is wrong by decimetres a second"
        cure = f"fly slower, {cure}"
    return (
        f"{wrong.configuration}: changes of thrust give kt = {kt:.3g} and a bias of "
        f"{wrong.fitted:+.2f} m/s^2 along z, but over the flight {seen} gravity to "
        f"{wrong.read:+.2f} m/s^2: no bias, but {cause}. kt is taken from the weight "
        f"({weighed.kt:.3g}), inertia with it, and the intervals hold both; {cure}"
    )


def missed(ratio: float, kt: float) -> str:
    """Return what it means that the thrust found misses the weight by a little, but surely."""
    return (
        f"the thrust found is {ratio:.3f} times the weight it carries: kt = {kt:.3g} by changes of "
        f"thrust, {kt / ratio:.3g} by the weight, and the intervals of kt and inertia hold both: "
        "the accelerometer's scale is wrong, or thrust goes a little otherwise than the model has "
        "it, in climb above all"
    )


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
