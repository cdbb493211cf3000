"""k_t from the weight: over a whole flight the thrust carries it, whatever the sensors say.

The fit takes k_t from changes of thrust against changes of specific force. Where thrust does not go
with the square of the speed (commands without their law) or the accelerometer's scale is wrong,
that is another number than the one that carries the weight, along the vertical that the gyro
carries along (`weight_balance.py`). On flights of which all is right the two agree to 3 %, where
the weight is the less sure: propellers in motion differ from those in hover.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorfit.dataset.dataset import ConfigurationData, Dataset
from rotorfit.dataset.weight_balance import Held, held_together, held_up, pooled
from rotorfit.diagnostics.hover_thrust import hover_thrusts, thrust_against_weight
from rotorfit.diagnostics.sensor_faults import velocity_estimated
from rotorfit.errors import UnsettledError
from rotorfit.experiment.experiment import MotorsEntry, Source
from rotorfit.findings import doubt
from rotorfit.fit.fit import Fit, refit, shift_of
from rotorfit.fit.fit_flights import widen_by_settings, widen_to_reach
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.model.terms.body import ACCEL_BIAS_STD
from rotorfit.model.vehicle import Vehicle
from rotorfit.preprocessing.airborne import GRAVITY
from rotorfit.preprocessing.motors.motor_model import MotorResponse
from rotorfit.reduction.frequency_bands import retimed
from rotorfit.results.verdicts import ADVICE

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
HELD_TO = 1e-4
"""Share of itself to which k_t is held: what the flights say of it otherwise is in the interval."""
_SCALE_OF: Mapping[Source, str] = {
    "imu": "the accelerometer (its scale)",
    "mocap": "the cameras (their scale)",
}
_SPEED = {"measured": "rotor speed", "commanded": "command"}
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
        difference = abs(kt - self.kt)
        return difference > max(LEAST_CONFLICT * self.kt, LIKELY * float(np.hypot(std, self.std)))

    def is_more_certain_than(self, kt: float, std: float, *, timed: bool) -> bool:
        """Whether another estimate leaves open what the weight tells.

        Where the motors' timing is not told, changes of thrust are seen at a wrong time, and the
        mean thrust is not.
        """
        vague = VAGUE * abs(kt) if timed else 0.0
        return 1.96 * std > max(vague, 2.0 * 1.96 * self.std)


def hold_at_weight(fit: Fit) -> Fit:
    """Hold k_t at the value that carries the weight, where changes of thrust contradict it.

    Also where they leave k_t open, or the fit makes an accelerometer bias of the weight.
    """
    dataset, numbers = fit.dataset, fit.numbers
    weighed = kt_from_weight(dataset.configurations, dataset.vehicle, dataset.timing)
    found = kt_of(numbers)
    bias = absorbed_weight(dataset, numbers)
    if weighed is None:
        return fit
    contradicts = weighed.contradicts(*found)
    more_certain = weighed.is_more_certain_than(*found, timed=dataset.timing_identifiable)
    if not (contradicts or more_certain or bias is not None):
        return _reach_weight(fit)
    held = held_at(fit, weighed)
    if contradicts:
        sentence = contradiction(weighed, found[0], dataset.motors, dataset.source)
        kind = "weight-contradicts-thrust"
    elif more_certain or bias is None:
        kind, sentence = "weight-is-surer", vagueness(weighed, *found)
    else:
        estimated = velocity_estimated(dataset)
        sentence = weight_as_bias(bias, weighed, found[0], dataset.source, estimated=estimated)
        kind = "weight-taken-for-bias"
    both = widen_to_reach(held, fit, with_interval=kind != "weight-is-surer")
    return both.found(doubt(kind, sentence, numbers=("kt",)))


def held_at(fit: Fit, weighed: WeighedThrust) -> Fit:
    """Fit again with k_t held at that of the weight, and its uncertainty in every interval."""
    known = {"kt": (weighed.kt, HELD_TO * weighed.kt)}
    held = widen_by_settings(refit(fit, fit.dataset, known=known), known=known)
    off = weighed.kt + weighed.std
    begin = {**held.estimate.estimate.by_name, "kt": off}
    moved = shift_of(held, held.dataset, begin=begin, known={"kt": (off, HELD_TO * off)})
    return held.with_half_width(np.hypot(held.numbers.half_width, 1.96 * moved))


def _reach_weight(fit: Fit) -> Fit:
    """Widen the intervals to reach k_t by the weight, where they surely miss it by a little.

    What the model lacks (thrust in climb and descent is no straight line) is then in them.
    """
    if not fit.mass_known:
        return fit
    dataset = fit.dataset
    found = hover_thrusts(
        dataset.configurations, fit.numbers, dataset.vehicle, timing=dataset.timing
    )
    missed = thrust_against_weight(found, fit.numbers)
    if missed.severity == "passed":
        return fit
    kt, ratio = kt_of(fit.numbers)[0], missed.diagnostics["thrust_over_weight"]
    at = kt / ratio
    begin = {**fit.estimate.estimate.by_name, "kt": at}
    try:
        at_weight = refit(fit, fit.dataset, begin=begin, known={"kt": (at, HELD_TO * at)})
    except UnsettledError:
        return fit
    difference = np.abs(fit.numbers.values - at_weight.numbers.values)
    wider = fit.with_half_width(fit.numbers.half_width + difference)
    return wider.found(doubt("thrust-misses-weight", small_miss(ratio, kt), numbers=("kt",)))


def kt_of(numbers: Numbers) -> tuple[float, float]:
    """Return value and standard deviation of k_t."""
    value, half = numbers.number("kt")
    return value, half / 1.96


def kt_from_weight(
    configurations: Sequence[ConfigurationData],
    vehicle: Vehicle,
    timing: MotorResponse | None = None,
) -> WeighedThrust | None:
    """Return the thrust coefficient that carries the weight; None if no flight is long enough.

    `timing`: of the motors, where it was found: commands that swing, as in a limit cycle, have
    larger squares than the speeds that lag behind them.
    """
    found: list[Held] = []
    for configured in configurations:
        for flight in configured.flights:
            data = retimed(flight.prepared, timing)
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
        difference = abs(fitted - read.ratio * GRAVITY)
        chance = float(np.hypot(OWN_SHARE * half, 1.96 * read.std * GRAVITY))
        if difference > max(LARGEST_BIAS, chance):
            wrong = AbsorbedWeight(
                configuration=configured.entry.name, fitted=fitted, read=read.ratio * GRAVITY
            )
            found.append((difference, wrong))
    return max(found, key=lambda one: one[0])[1] if found else None


def _read_over_gravity(configured: ConfigurationData) -> Held | None:
    """Return by how much the accelerometer reads more than gravity, as a share of it."""
    held = held_together(
        held_up(flight.turning, flight.prepared.data.specific_force)
        for flight in configured.flights
    )
    return None if held is None else replace(held, ratio=held.ratio - 1.0)


def contradiction(
    weighed: WeighedThrust, kt: float, motors: MotorsEntry, source: Source = "imu"
) -> str:
    """Explain that changes of thrust give another k_t than the weight."""
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


def weight_as_bias(
    bias: AbsorbedWeight,
    weighed: WeighedThrust,
    kt: float,
    source: Source = "imu",
    *,
    estimated: bool = False,
) -> str:
    """Explain that the fit takes part of the weight for a bias along z."""
    seen = "the accelerometer reads" if source == "imu" else "motion capture sees"
    cause = "thrust that does not follow the motor data as declared"
    cure = "give the motors' law and lag under [motors], or log the rotor speed"
    if estimated:
        cause += ", or drag over an estimated velocity, which is wrong by decimetres a second"
        cure = f"fly slower, {cure}"
    return (
        f"{bias.configuration}: changes of thrust give kt = {kt:.3g} and a bias of "
        f"{bias.fitted:+.2f} m/s^2 along z, but on average over the flight {seen} gravity to "
        f"{bias.read:+.2f} m/s^2: there is no bias; the cause is {cause}. kt is taken from the "
        f"weight ({weighed.kt:.3g}), inertia is scaled with it, and the intervals cover both; "
        f"{cure}"
    )


def small_miss(ratio: float, kt: float) -> str:
    """Explain that the thrust found misses the weight by a little, but surely."""
    return (
        f"the thrust found is {ratio:.3f} times the weight it carries: kt = {kt:.3g} by changes of "
        f"thrust, {kt / ratio:.3g} by the weight, and the intervals of kt and inertia cover both: "
        "the accelerometer's scale is wrong, or thrust differs a little from the model, most of "
        "all in climb"
    )


def vagueness(weighed: WeighedThrust, kt: float, std: float) -> str:
    """Explain that changes of thrust leave k_t open."""
    return (
        f"changes of thrust give kt only as {kt:.3g} +- {1.96 * std:.2g}, carrying the weight "
        f"takes {weighed.kt:.3g}: kt is taken from the weight, inertia is scaled with it, and the "
        f"intervals cover both values; {ADVICE['force']}"
    )
