"""Where changes of thrust and the weight disagree about k_t: what that means, in words."""

from collections.abc import Mapping

from rotorfit.experiment.experiment import MotorsEntry, Source
from rotorfit.fit.intervals.kt_from_weight import AbsorbedWeight, WeighedThrust
from rotorfit.results.verdicts import ADVICE


def contradiction(
    weighed: WeighedThrust, kt: float, motors: MotorsEntry, source: Source = "imu"
) -> str:
    """Return what it means that changes of thrust give another k_t than the weight."""
    ratio = kt / weighed.kt
    seen = (
        f"changes of thrust with the squared {_SPEED[motors.speed]} give kt = {kt:.3g}, but "
        f"carrying the weight takes {weighed.kt:.3g}: kt is taken from the weight, inertia is "
        "scaled with it, and the intervals cover both"
    )
    if motors.speed == "measured":
        return f"{seen}; calibrate {_SCALE_OF[source]}, or weigh again"
    if motors.law is None:
        return (
            f"{seen}; thrust is proportional neither to the command nor to its square, but in "
            f"between (about its power {2.0 * ratio:.1f} in hover): measure the law on a thrust "
            "stand and give it under [motors], or log the rotor speed"
        )
    return f"{seen}; the law under [motors] does not hold: measure it again, or log the rotor speed"


def swallowed(
    wrong: AbsorbedWeight,
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
        f"{wrong.fitted:+.2f} m/s^2 along z, but on average over the flight {seen} gravity to "
        f"{wrong.read:+.2f} m/s^2: there is no bias; the cause is {cause}. kt is taken from the "
        f"weight ({weighed.kt:.3g}), inertia is scaled with it, and the intervals cover both; "
        f"{cure}"
    )


def missed(ratio: float, kt: float) -> str:
    """Return what it means that the thrust found misses the weight by a little, but surely."""
    return (
        f"the thrust found is {ratio:.3f} times the weight it carries: kt = {kt:.3g} by changes of "
        f"thrust, {kt / ratio:.3g} by the weight, and the intervals of kt and inertia cover both: "
        "the accelerometer's scale is wrong, or thrust differs a little from the model, most of "
        "all in climb"
    )


def vagueness(weighed: WeighedThrust, kt: float, std: float) -> str:
    """Return what it means that changes of thrust leave k_t open."""
    return (
        f"changes of thrust give kt only as {kt:.3g} +- {1.96 * std:.2g}, carrying the weight "
        f"takes {weighed.kt:.3g}: kt is taken from the weight, inertia is scaled with it, and the "
        f"intervals cover both values; {ADVICE['force']}"
    )


_SCALE_OF: Mapping[Source, str] = {
    "imu": "the accelerometer (its scale)",
    "mocap": "the cameras (their scale)",
}
_SPEED = {"measured": "rotor speed", "commanded": "command"}
