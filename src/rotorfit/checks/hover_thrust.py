"""Compare thrust and accelerometer with gravity: in hover the thrust is the weight."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.thrust_against_weight import OF_THRUST
from rotorfit.digits import with_half
from rotorfit.estimation.banded import shift_without
from rotorfit.estimation.distributions import normal_quantile
from rotorfit.findings import Evidence, Finding, doubt_or_passed
from rotorfit.fit.dataset.carried_weight import (
    HeightForce,
    height_force_of,
    vertical_motions,
)
from rotorfit.fit.dataset.weight_balance import held_together, held_up, hovering, turning
from rotorfit.fit.experiment.payload import MOMENTS
from rotorfit.fit.intervals.joint_numbers import slopes_of_numbers
from rotorfit.fit.reduction.frequency_bands import retimed
from rotorfit.fit.weight.hover_thrusts import HoverThrust, hover_thrusts
from rotorfit.flight.airborne import GRAVITY
from rotorfit.logs.files import file_name
from rotorfit.model.terms.body import ACCEL_BIAS_STD

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rotorfit.fit.dataset.dataset import ConfigurationData
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.fit.joint.joint_problem import JointConfiguration
    from rotorfit.model.vehicle import Vehicle

UNLIKELY = 1e-4
"""Probability of chance alone below which two estimates differ."""
LEAST_THRUST_ERROR = 0.01
"""Thrust that misses the weight by less than this share is not worth words: so much do tilt, wind
and a propeller's inflow make."""
LIKELY_FORCE = 0.99
"""Probability of a force that grows with height from which it is said: of 150 random sound flights
.94 at most."""
LEAST_SAG = 0.05
"""The same for the change of thrust at one rotor speed during a flight."""

AGAINST_GRAVITY: Final = "accelerometer-against-gravity"


def accelerometer_against_gravity(fit: Fit) -> Iterator[Finding]:
    """Check that the accelerometer reads gravity, over all of the flights that is hover."""
    if fit.dataset.source != "imu":
        return
    sentences: list[str] = []
    measured: dict[str, float] = {}
    for configured in fit.dataset.configurations:
        data = [flight.prepared.data for flight in configured.flights]
        held = held_together(held_up(turning(hovering(one)), one.specific_force) for one in data)
        if held is None:
            continue
        measured[f"accelerometer_over_gravity@{configured.entry.name}"] = held.ratio
        limit = ACCEL_BIAS_STD / GRAVITY + 1.96 * held.std
        if abs(held.ratio - 1.0) > limit:
            several = len(fit.dataset.configurations) > 1
            owner = f" of configuration {configured.entry.name}" if several else ""
            sentences.append(
                f"in hover{owner} the accelerometer reads "
                f"{with_half(held.ratio * GRAVITY, 1.96 * held.std * GRAVITY)} m/s^2 where "
                f"gravity is {GRAVITY:.2f}: calibrate it; a bias is estimated and removed, but "
                "a wrong scale goes straight into kt and all inertia"
            )
    yield doubt_or_passed(AGAINST_GRAVITY, "; ".join(sentences) or None, measured)


def thrust_consistency(fit: Fit) -> Iterator[Finding]:
    """Compare the thrust of every flight over its weight with other flights, and over time."""
    if not fit.mass_known:
        return
    dataset = fit.dataset
    found = hover_thrusts(
        dataset.configurations,
        fit.numbers,
        dataset.vehicle,
        layout=dataset.model.layout,
        timing=dataset.timing,
        source=dataset.source,
    )
    law = dataset.motors.law
    commanded = dataset.motors.speed == "commanded" and not dataset.speeds_commanded
    has_voltage = all(flight.battery is not None for flight in dataset.flights)
    by_battery = commanded and (law is None or law.voltage is None or not has_voltage)
    kt = fit.numbers.index("kt")
    reach = float(fit.numbers.half_width[kt] / abs(fit.numbers.values[kt]))
    yield doubt_unreached(hovers_differ(found, by_battery=by_battery), found, reach=reach)
    yield thrust_sags(found, by_battery=by_battery, has_voltage=has_voltage)


def hovers_differ(found: Sequence[HoverThrust], *, by_battery: bool) -> Finding:
    """Check that no flight needs more thrust for its weight than another.

    `by_battery`: rotor speed is known by commands alone, without the battery's voltage.
    """
    kind = "hovers-differ"
    if len(found) < 2:
        return doubt_or_passed(kind, None)
    *_, high = low, *_ = sorted(found, key=lambda one: one.thrust.ratio)
    if low.thrust.ratio <= 0.0:
        return doubt_or_passed(kind, None)
    ratio = high.thrust.ratio / low.thrust.ratio
    std = float(np.hypot(low.thrust.std, high.thrust.std))
    measured = {"largest_hover_ratio": ratio}
    if ratio - 1.0 <= max(LEAST_THRUST_ERROR, unlikely_deviations() * std):
        return doubt_or_passed(kind, None, measured)
    first, second = (_of_flight(f, found) for f in (high, low))
    if high.configuration == low.configuration:
        battery = "the battery (give the law its voltage), " if by_battery else ""
        cause = f"{battery}the propellers or the load changed"
    else:
        battery = "the battery or " if by_battery else ""
        cause = (
            f"one of the masses is wrong, {battery}the propellers changed, or they are two "
            "different vehicles, which need an experiment each; weigh both again"
        )
    sentence = (
        f"{first} hovers on {with_half(100 * (ratio - 1.0), 196 * std)} % more thrust for its mass "
        f"than {second}: {cause}"
    )
    return doubt_or_passed(
        kind, sentence, measured, flights=(file_name(high.flight), file_name(low.flight))
    )


def doubt_unreached(finding: Finding, found: Sequence[HoverThrust], *, reach: float) -> Finding:
    """Make thrust doubtful where hovers differ and the interval of k_t does not reach one of them.

    `reach`: half of that interval over k_t.
    """
    beyond = max(
        (abs(one.thrust.ratio - 1.0) - 1.96 * one.thrust.std for one in found), default=0.0
    )
    if finding.severity != "doubt" or beyond <= reach:
        return finding
    return replace(
        finding,
        numbers=OF_THRUST,
        doubtful_because="the flights hover on different thrust for their masses",
        next_step="weigh the vehicle as it flew in each flight",
    )


def thrust_sags(
    found: Sequence[HoverThrust], *, by_battery: bool, has_voltage: bool = False
) -> Finding:
    """Check that one rotor speed (or command) gives the same thrust late in a flight as early.

    `by_battery`: as for `hovers_differ`. `has_voltage`: whether the logs have the battery's.
    """
    kind = "thrust-sags"
    known = [one for one in found if one.sag is not None]
    if not known:
        return doubt_or_passed(kind, None)
    # The halves' means are half a flight apart.
    worst = max(known, key=lambda one: abs(one.sag or 0.0) / one.sag_std)
    change = 2.0 * (worst.sag or 0.0)
    measured = {"thrust_change": change}
    if abs(change) <= max(LEAST_SAG, 2.0 * unlikely_deviations() * worst.sag_std):
        return doubt_or_passed(kind, None, measured)
    way = "less" if change > 0 else "more"
    logged = ", which is in the log" if has_voltage else " and log that"
    battery = ""
    if by_battery and change > 0.0:
        battery = f"the battery sags (log rotor speed, or declare a law with voltage{logged}), or "
    sentence = (
        f"{_of_flight(worst, found)}: the same motor data give {100 * abs(change):.0f} % {way} "
        f"thrust at the end of the flight than at its beginning: {battery}"
        "drag in climb or descent, ground effect, a wall or a tether carried part of the weight: "
        "fly slower, higher and clear of obstacles; the intervals cover the change"
    )
    return doubt_or_passed(kind, sentence, measured, flights=(file_name(worst.flight),))


def force_by_height(fit: Fit) -> Iterator[Finding]:
    """Check that no force grows with the height of a flight, as a tether's weight does."""
    if not fit.mass_known:
        return
    kt = fit.numbers.number("kt")[0]
    vehicle, sentences, flights = fit.dataset.vehicle, list[str](), list[str]()
    measured: list[Evidence] = []
    for configured in fit.dataset.configurations:
        for flight in configured.flights:
            data = retimed(flight.prepared, fit.dataset.timing)
            push = kt / configured.mass * (data.rotor_speed**2) @ vehicle.axes
            found = [
                height_force_of(motion) for motion in vertical_motions(flight.turning, data, push)
            ]
            forces = [one for one in found if one is not None]
            if not forces:
                continue
            worst = max(forces, key=lambda one: one.probability)
            measured.append(_by_height(worst))
            if worst.probability > LIKELY_FORCE:
                flights.append(file_name(flight.entry.file))
                sentences.append(f"{flights[-1]}: {_height_force_sentence(worst)}")
    yield doubt_or_passed(
        "force-by-height",
        "; ".join(sentences) or None,
        flights=tuple(flights),
        evidence=tuple(measured),
    )


def _by_height(force: HeightForce) -> Evidence:
    """Return the share of the weight by which a force grows a metre, as evidence."""
    low, value, high = (
        (force.value + side * 1.96 * force.std) / GRAVITY for side in (-1.0, 0.0, 1.0)
    )
    return Evidence(name="force_by_height", value=value, interval=(low, high))


def _height_force_sentence(force: HeightForce) -> str:
    """Explain a force that grows with height: a tether below, or a line above."""
    share = with_half(100 * force.value / GRAVITY, 196 * force.std / GRAVITY)
    return (
        f"with every metre of height the vehicle needs {share} % of its weight more thrust: a "
        "tether or cable hangs on it, or the ground carried part of it; kt is therefore that of "
        "changes of thrust rather than of the weight, with intervals that cover it: fly free, and "
        "higher"
    )


def _of_flight(one: HoverThrust, found: Sequence[HoverThrust]) -> str:
    """Return a flight's name, with its configuration where there are several."""
    name = file_name(one.flight)
    several = len({other.configuration for other in found}) > 1
    return f"{one.configuration} ({name})" if several else name


def unlikely_deviations() -> float:
    """Compute the number of deviations that chance alone does not reach."""
    return -normal_quantile(0.5 * UNLIKELY)


CHECKS: Final = (accelerometer_against_gravity, thrust_consistency, force_by_height)


LEAST_TILT = 0.5
"""Mean tilt of the motors about their arms that is worth words [degrees]."""
LEAST_TRIM = 0.03
"""Share by which rotors of one direction may carry more: drag of unequal propellers makes 0.01."""

MOST_UNCERTAIN = 10.0
"""Deviation of a number's shift without the means over its own, from which changes of motion alone
do not show it: on random worlds those that are wrong are thousands of times as uncertain."""


def missing_constant_wrench(fit: Fit) -> Iterator[Finding]:
    """Check that the estimate does not move when the mean of every stretch is left out."""
    estimate = fit.estimate
    bands = np.concatenate([factors.band for factors in estimate.problem.factors])
    # A constant force or torque that the model does not have (tilted motors, a tilted IMU, wind)
    # acts there and nowhere else.
    mean = bands[:, 0] == 0.0
    if not mean.any():
        return
    shift, names = shift_without(estimate, mean), estimate.estimate.names
    chosen = [i for i, n in enumerate(names) if n.partition("@")[0] in ("kt", "kd", *MOMENTS)]
    size = np.abs(shift.values[chosen]) / shift.std[chosen]
    half = np.array([fit.numbers.half_width[fit.numbers.index(names[i])] for i in chosen])
    # What only the means show no change of motion contradicts.
    shown = shift.std[chosen] < MOST_UNCERTAIN * half / 1.96
    outside = shown & (np.abs(shift.values[chosen]) > half)
    limit = -normal_quantile(0.5 * UNLIKELY / len(chosen))
    worst = chosen[int(np.argmax(np.where(outside, size, 0.0)))]
    value = float(estimate.estimate.values[worst])
    sentence = (
        f"{names[worst].replace('@', ' of ')} is {value:.3g}, but "
        f"{value + float(shift.values[worst]):.3g} by the changes of motion alone: the model lacks "
        "a constant force or torque, such as that of tilted motors; set them upright"
    )
    yield doubt_or_passed(
        "constant-wrench-missing",
        sentence if (outside & (size > limit)).any() else None,
        {"shift_without_mean": float(size.max())},
        numbers=(names[worst],),
    )


def steady_yaw_torque(fit: Fit) -> Iterator[Finding]:
    """Check whether the rotors hold a steady yaw torque that the model lacks."""
    sentences: list[str] = []
    evidence: list[Evidence] = []
    numbers = fit.numbers
    for configured, c in zip(fit.dataset.configurations, fit.configurations, strict=True):
        # Without the term `twist` motors tilted by two tenths of a degree are enough to spoil k_d.
        # Two signs: rotors of one direction carry more than those of the other, or yaw, fitted
        # without the mean of every stretch, responds to the rotors otherwise than in the whole fit.
        trim, shift = _yaw_trim(configured, c.vehicle), _yaw_shift_without_mean(fit, c)
        evidence.append(Evidence(name=f"yaw_trim@{c.name}", value=trim))
        evidence += [] if shift is None else [shift]
        differs = shift is not None and shift.limit is not None and abs(shift.value) > shift.limit
        if f"twist@{c.name}" in numbers.names and not differs:
            sentences += _tilt_sentence(c, numbers)
        elif abs(trim) > LEAST_TRIM or differs:
            sentences.append(_steady_torque_sentence(c.name, trim))
    found = doubt_or_passed(
        "steady-yaw-torque",
        "; ".join(sentences) or None,
        numbers=("kd", "Jr", "Izz"),
        doubtful_because="a steady yaw torque is not in the model",
        next_step="set the motors and arms upright, then fly again",
    )
    yield replace(found, evidence=tuple(evidence))


def _steady_torque_sentence(name: str, trim: float) -> str:
    """Explain what shows a steady yaw torque that the model does not have."""
    more, less = ("ccw", "cw") if trim > 0 else ("cw", "ccw")
    seen = f"the {more} rotors carry {100.0 * abs(trim):.1f} % of the thrust more than the {less}"
    if abs(trim) <= LEAST_TRIM:
        seen = "the mean of each stretch and the motion around it disagree about yaw"
    return (
        f"{name}: {seen}: a steady yaw torque that is not in the model, as from tilted motors or "
        "twisted arms; set them upright, and until then do not trust kd, Jr and Izz"
    )


def _tilt_sentence(c: JointConfiguration, numbers: Numbers) -> list[str]:
    """Explain the motors' mean tilt about their arms, where it is large and certain."""
    i = numbers.index(f"twist@{c.name}")
    tilt, half = np.degrees([numbers.values[i], numbers.half_width[i]]) / c.vehicle.arm
    if abs(tilt) - half <= LEAST_TILT:
        return []
    way = "counter-clockwise" if tilt > 0 else "clockwise"
    return [
        f"{c.name}: the thrust turns the vehicle {way} (seen from above) as if all motors leaned "
        f"by {abs(tilt):.1f} degrees about their arms; the model includes it (twist), but it costs "
        "yaw authority: set them upright"
    ]


def _yaw_trim(configured: ConfigurationData, vehicle: Vehicle) -> float:
    """Compute the share of all thrust by which the ccw rotors carry more than the cw ones."""
    more = total = 0.0
    for flight in configured.flights:
        data = flight.prepared.data
        for segment in data.segments:
            squares = data.rotor_speed[segment.start : segment.stop] ** 2
            more += float((squares @ (vehicle.spins - vehicle.spins.mean())).sum())
            total += float(squares.sum())
    return more / total if total > 0.0 else 0.0


def _yaw_shift_without_mean(fit: Fit, c: JointConfiguration) -> Evidence | None:
    """Measure the shift of k_d / Izz without the means, as a share; None if there are none."""
    mean = np.concatenate([factors.band for factors in fit.estimate.problem.factors])[:, 0] == 0.0
    name = f"kd_over_Izz@{c.name}"
    value, half = fit.numbers.number(name)
    if not mean.any() or mean.all() or value == 0.0 or not np.isfinite(half):
        return None
    # In one step of the joint fit, which allows for the autopilot's response: the yaw row alone
    # calls 37 to 46 % too little of short flights a torque.
    estimate, shift = fit.estimate.estimate, shift_without(fit.estimate, mean)
    [slopes] = slopes_of_numbers(
        [name], estimate.values, estimate.std, fit.estimate.problem.map, fit.configurations
    )
    moved = float(slopes @ shift.values) / value
    std = float(np.sqrt(slopes @ shift.covariance @ slopes)) / abs(value)
    return Evidence(
        name=f"yaw_shift_without_mean@{c.name}",
        value=moved,
        interval=(moved - 1.96 * std, moved + 1.96 * std),
        # The interval of k_d / Izz, or chance.
        limit=max(half / abs(value), unlikely_deviations() * std),
    )


WRENCH_CHECKS: Final = (missing_constant_wrench,)
YAW_CHECKS: Final = (steady_yaw_torque,)
