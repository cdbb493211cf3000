"""Uncertainty of the speeds of commanded motors: their law, and their speeds at the limits.

A law that is wrong by a factor leaves forces and inertia as they are, and takes k_t, k_d and J_r
with it: by its inverse square, and its inverse. One whose slope is wrong makes changes of thrust
another share of the weight.

At its lowest and highest command a motor does what its law does not say: it coasts, or gives what
the battery has. Where commands tell the speed, those two speeds are as open as that.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from jaxtyping import Float

from rotorfit.checks.kt_from_weight import HELD_TO, kt_from_weight, kt_of, open_law
from rotorfit.digits import short
from rotorfit.findings import Evidence, Finding
from rotorfit.fit.experiment.law_table import bent_speed
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.flight.motors.motor_model import with_motors
from rotorfit.flight.prepare import PreparedFlight
from rotorfit.model.parameters import EVERY

if TYPE_CHECKING:
    from rotorfit.fit.dataset.dataset import Dataset, LoadedFlight
    from rotorfit.fit.experiment.law_table import LawEntry
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.timing.timed_dataset import TimedDataset

Speeds = Float[np.ndarray, "n N"]
Change = Callable[[Speeds, Float[np.ndarray, "m N"]], Speeds]
"""From speeds [rad/s], as kept or as recorded, and those of the flight's used part, to others."""


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


LAW: Final = "law-uncertain"


def allow_for_law(fit: Fit) -> Fit:
    """Append the uncertainty of the law from command to speed."""
    law = fit.dataset.motors.law
    if law is None:
        return fit
    std = speed_std(law, [f.battery for c in fit.dataset.configurations for f in c.flights])
    if not (std or law.slope_std):
        return fit
    scale = scale_shift(fit.numbers, std)
    slope = _slope_shift(fit, law) if law.slope_std else np.zeros(len(scale))
    fit = fit.with_terms(
        IntervalTerm(
            name="motor law",
            half_width=1.96 * np.hypot(scale, slope),
            source="deviations of the law's speeds and of its slope",
        )
    )
    open_ones = open_law(fit.numbers, 1.96 * law.slope_std)
    said = () if fit.dataset.law_found or law.stated else _note_law_uncertainty(fit.numbers, std)
    return fit.found(*said, *open_ones)


def speed_std(law: LawEntry, voltages: Sequence[float | None]) -> float:
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
    return np.array(_speed_powers(numbers), dtype=float) * std * np.abs(numbers.values)


def _speed_powers(numbers: Numbers) -> list[int]:
    return [EVERY[name.partition("@")[0]].speed_power for name in numbers.names]


def _slope_shift(fit: Fit, law: LawEntry) -> Float[np.ndarray, " q"]:
    """Compute how far numbers go where the speed grows more with the command, by a deviation."""

    def steeper(speed: Speeds, flown: Float[np.ndarray, "m N"]) -> Speeds:
        usual = law.usual_speed or float(np.median(flown))
        return bent_speed(speed, 1.0 + law.slope_std, anchor=usual)

    return shift_by_speeds(fit, with_other_speeds(fit.dataset, steeper))


def hover_share(law: LawEntry, speed: float, std: float) -> float:
    """Return the deviation, as a share, of a speed in hover by the law alone.

    The command in hover does not hang on it. `std`: deviation of all speeds (`speed_std`).
    """
    usual = law.usual_speed or speed
    return float(np.hypot(std, (speed / usual) ** law.slope_std - 1.0))


def _note_law_uncertainty(numbers: Numbers, std: float) -> Iterator[Finding]:
    """Explain the uncertainty of the law's speeds."""
    if not std:
        return
    yield Finding(
        kind=LAW,
        severity="note",
        sentence=(
            f"the law under [motors] gives the rotor speeds to +-{short(196 * std)} %: the "
            "interval of Jr includes as much, those of kt and kd twice as much; log the rotor "
            "speed, or the battery's voltage, for a law that depends on it"
        ),
        numbers=tuple(
            name for name, power in zip(numbers.names, _speed_powers(numbers), strict=True) if power
        ),
        evidence=(Evidence(name="law_speed_std", value=std),),
    )


LEAST_SHARE: Final = 0.02
"""Of the time of all motors at either end, from which it is said."""
LEAST_WIDENED: Final = 0.001
"""The same, from which the intervals hold it: less moves no number."""
OPEN: Final = 0.03
"""Deviation of the speeds at the ends, of the range of speeds that was flown: battery and coasting
make some per cent of a law."""
SWINGING: Final = 3.0
"""Arrivals at an end, a second and motor, from which they are the loop's doing, not the pilot's."""
LIMITS: Final = "motors-at-limits"
GAINS: Final = (
    "the rate loop drives each of them to an end {arrivals:.0f} times a second (a limit cycle, or "
    "noise that it answers): lower the rate gains (P and D of roll and pitch)"
)
GENTLY: Final = "leave such parts out (start, end), or fly more gently"

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


def motors_at_limits(fit: Fit) -> Iterator[Finding]:
    """Check that commanded motors stay inside their limits; report the worst flight."""
    flights = [f for c in fit.dataset.configurations for f in c.flights if f.limits is not None]
    if fit.dataset.motors.speed != "commanded" or not flights:
        return
    worst = max(flights, key=lambda f: 0.0 if f.limits is None else f.limits.share)
    limits = worst.limits
    assert limits is not None
    said = limits.share >= LEAST_SHARE
    yield Finding(
        kind=LIMITS,
        severity=("doubt" if limits.arrivals >= SWINGING else "note") if said else "passed",
        sentence=_explain_limits(worst) if said else "",
        flights=(worst.entry.written,) if said else (),
        evidence=(Evidence(name="share_at_limits", value=limits.share, limit=LEAST_SHARE),),
    )


def _explain_limits(flight: LoadedFlight) -> str:
    """Explain how often the motors of a flight are at which end, and why."""
    limits = flight.limits
    assert limits is not None
    low, high = (100.0 * float(np.mean(each)) for each in (limits.lowest, limits.highest))
    swinging = limits.arrivals >= SWINGING
    return (
        f"{Path(flight.entry.file).name}: the motors are at their limits for {low + high:.0f} % of "
        f"the flight ({low:.0f} % at the lowest command, {high:.0f} % at the highest), where their "
        "speed is not what the law says; the intervals cover a few percent of it: "
        f"{GAINS.format(arrivals=limits.arrivals) if swinging else GENTLY}"
    )


def _largest_share_at_limits(dataset: Dataset) -> float:
    """Return the largest share of a flight's commands that stand at either end."""
    flights = [f for c in dataset.configurations for f in c.flights]
    return max((f.limits.share for f in flights if f.limits is not None), default=0.0)


def _with_end(dataset: TimedDataset, end: End) -> TimedDataset:
    """Return the flights with another speed where the commands are at one end."""

    def cut(speed: Speeds, flown: Float[np.ndarray, "m N"]) -> Speeds:
        low, high = float(flown.min()), float(flown.max())
        step = OPEN * (high - low)
        return np.maximum(speed, low + step) if end == "lowest" else np.minimum(speed, high - step)

    return with_other_speeds(dataset, cut)


CHECKS: Final = (motors_at_limits,)
