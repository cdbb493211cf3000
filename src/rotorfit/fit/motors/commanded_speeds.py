"""Uncertainty of the speeds of commanded motors: their law, and their speeds at the limits.

A law that is wrong by a factor leaves forces and inertia as they are, and takes k_t, k_d and J_r
with it: by its inverse square, and its inverse. One whose slope is wrong makes changes of thrust
another share of the weight.

A law that the flight shows, or that a setting of the firmware states, has the slope of the motors
about hover, and not their curvature. Rotors that hover on unequal thrust then differ in slope as no
model of equal rotors does, and the fit makes unequal rotors of it, which moves the centre of mass.

At its lowest and highest command a motor does what its law does not say: it coasts, or gives what
the battery has. Where commands tell the speed, those two speeds are as open as that.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.motors.bent_law import bend_speed
from rotorfit.fit.weight.kt_from_weight import kt_from_weight
from rotorfit.fit.weight.weigh_thrust import HELD_TO, kt_of
from rotorfit.flight.motors.motor_model import with_motors
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import EVERY

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.fit.dataset.dataset import Dataset
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.fit.timing.timed_dataset import TimedDataset
    from rotorfit.flight.prepare import PreparedFlight
    from rotorfit.logs.motor_law import MotorLaw

    Speeds = Float[np.ndarray, "n N"]
    Change = Callable[[Speeds, Float[np.ndarray, "m N"]], Speeds]
    """From speeds [rad/s], kept or recorded, and those of the flight's used part, to others."""


def with_other_speeds(dataset: TimedDataset, change: Change) -> TimedDataset:
    """Return the flights with other speeds of the motor channel, before lag and delay."""
    from rotorfit.fit.dataset.dataset import with_prepared

    return with_prepared(dataset, lambda prepared: _change_speeds(prepared, dataset, change))


def _change_speeds(
    prepared: PreparedFlight, dataset: TimedDataset, change: Change
) -> PreparedFlight:
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
    """Compute the shift of the numbers with other speeds, and of k_t with the weight they carry."""
    from rotorfit.fit.fit import shift_of

    weights = [
        kt_from_weight(one.configurations, one.vehicle, source=one.source, timing=one.timing)
        for one in (fit.dataset, other)
    ]
    here, there = (None if one is None else one.value for one in weights)
    if here is None or there is None:
        return shift_of(fit, other)
    kt = kt_of(fit.numbers)[0] * there / here
    return shift_of(fit, other, known={"kt": (kt, HELD_TO * kt)})


@frozen_dataclass
class LawError:
    """What a law from command to speed leaves open, as the step `allow_for_law` found it.

    - `speed_std`: deviation of its speeds, as a share.
    - `reach`: half of the 95 % interval of inertia by its slope, as a share.
    - `widths`: half-width of each moment of roll and pitch with it, as a share.
    """

    speed_std: float
    reach: float
    widths: Mapping[str, float]


def inertia_widths(numbers: Numbers) -> dict[str, float]:
    """Return the half-width over the value of each moment of inertia of roll and pitch."""
    names = [name for name in numbers.names if name.partition("@")[0] in ("Ixx", "Iyy")]
    return {name: numbers.number(name)[1] / abs(numbers.number(name)[0]) for name in names}


def allow_for_law(fit: Fit) -> Fit:
    """Append the uncertainty of the law from command to speed."""
    law = fit.dataset.motors.law
    if law is None:
        return fit
    std = speed_std(law, [f.battery for f in fit.dataset.flights])
    if not (std or law.slope_std):
        return fit
    scale = scale_shift(fit.numbers, std)
    slope = _slope_shift(fit, law) if law.slope_std else np.zeros(len(scale))
    has_open_curve = law.stated or fit.dataset.law_found
    curve = _curve_shift(fit) if has_open_curve else np.zeros(len(scale))
    fit = fit.with_terms(
        IntervalTerm(
            name="motor law",
            half_width=1.96 * np.linalg.norm([scale, slope, curve], axis=0),
            source="deviations of the law's speeds, of its slope and of its curvature",
        )
    )
    reach = 1.96 * law.slope_std
    return fit.with_record(LawError(speed_std=std, reach=reach, widths=inertia_widths(fit.numbers)))


def speed_std(law: MotorLaw, voltages: Sequence[float | None]) -> float:
    """Return the deviation of a law's speeds, as a share, on flights at these voltages [V].

    None is a flight whose log has no voltage.
    """
    factor = law.voltage
    if factor is None:
        return law.speed_std
    missing = factor.missing_std or 0.0
    by_voltage = [
        missing if volts is None else factor.exponent_std * abs(np.log(volts / factor.nominal))
        for volts in voltages
    ]
    return float(np.hypot(law.speed_std, np.sqrt(np.mean(np.square(by_voltage)))))


def scale_shift(numbers: Numbers, std: float) -> Float[np.ndarray, " q"]:
    """Compute the shift of the numbers where all speeds are off by a share `std`."""
    return np.array(speed_powers(numbers), dtype=float) * std * np.abs(numbers.values)


def speed_powers(numbers: Numbers) -> list[int]:
    """Return the power of the rotor speed with which each number goes."""
    return [EVERY[name.partition("@")[0]].speed_power for name in numbers.names]


def _slope_shift(fit: Fit, law: MotorLaw) -> Float[np.ndarray, " q"]:
    """Compute how far numbers go where the speed grows more with the command, by a deviation."""

    def steeper(speed: Speeds, flown: Float[np.ndarray, "m N"]) -> Speeds:
        usual = law.usual_speed or float(np.median(flown))
        return bend_speed(speed, 1.0 + law.slope_std, anchor=usual)

    return shift_by_speeds(fit, with_other_speeds(fit.dataset, steeper))


CURVE_STD: Final = 0.14
"""Deviation of d ln(dT/du)/d ln T in hover, T the thrust over the command u, of real motors from a
power of the command with their slope there: rms of thrust curves f u^2 + (1 - f) u, f from 0 to 1,
that start at -10 to 15 % of the command, with hover at 30 to 70 %."""


def _curve_shift(fit: Fit) -> Float[np.ndarray, " q"]:
    """Compute how far numbers go where the law is bent about hover, its slope there unchanged."""

    def bent(speed: Speeds, flown: Float[np.ndarray, "m N"]) -> Speeds:
        usual = float(np.median(flown))
        thrust = np.square(speed / usual)
        return usual * np.sqrt(thrust + 0.5 * CURVE_STD * np.square(thrust - 1.0))

    return shift_by_speeds(fit, with_other_speeds(fit.dataset, bent))


def hover_share(law: MotorLaw, speed: float, std: float) -> float:
    """Return the deviation, as a share, of a speed in hover by the law alone.

    The command in hover does not hang on it. `std`: deviation of all speeds (`speed_std`).
    """
    usual = law.usual_speed or speed
    return float(np.hypot(std, (speed / usual) ** law.slope_std - 1.0))


LEAST_WIDENED: Final = 0.001
"""The same, from which the intervals hold it: less moves no number."""
OPEN: Final = 0.03
"""Deviation of the speeds at the ends, of the range of speeds that was flown: battery and coasting
make some per cent of a law."""
End = Literal["lowest", "highest"]


def allow_for_motor_limits(fit: Fit) -> Fit:
    """Append the uncertainty of commanded motors' speeds at the ends of their commands."""
    dataset = fit.dataset
    if dataset.motors.speed != "commanded" or _largest_share_at_limits(dataset) < LEAST_WIDENED:
        return fit
    ends: tuple[End, ...] = ("lowest", "highest")
    moved = [shift_by_speeds(fit, _with_end(dataset, end)) for end in ends]
    return fit.with_terms(
        IntervalTerm(
            name="motors at their limits",
            half_width=1.96 * np.linalg.norm(moved, axis=0),
            source="fits with other speeds at the lowest and the highest command",
        )
    )


def _largest_share_at_limits(dataset: Dataset) -> float:
    """Return the largest share of a flight's commands that stand at either end."""
    return max((f.limits.share for f in dataset.flights if f.limits is not None), default=0.0)


def _with_end(dataset: TimedDataset, end: End) -> TimedDataset:
    """Return the flights with another speed where the commands are at one end."""

    def cut(speed: Speeds, flown: Float[np.ndarray, "m N"]) -> Speeds:
        low, high = float(flown.min()), float(flown.max())
        step = OPEN * (high - low)
        return np.maximum(speed, low + step) if end == "lowest" else np.minimum(speed, high - step)

    return with_other_speeds(dataset, cut)
