"""Check the mean of every stretch: forces and torques that do not change."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
from scipy import stats

from rotorfit.dataset.dataset import ConfigurationData
from rotorfit.diagnostics.hover_thrust import UNLIKELY, unlikely_deviations
from rotorfit.estimation.banded import shift_without
from rotorfit.estimation.estimate import numerical_jacobian
from rotorfit.experiment.payload import MOMENTS
from rotorfit.findings import Evidence, Finding, doubt_or_passed
from rotorfit.fit.fit import Fit
from rotorfit.fit.intervals.joint_numbers import physical
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.model.vehicle import Vehicle

LEAST_TILT = 0.5
"""Mean tilt of the motors about their arms that is worth words [degrees]."""
LEAST_TRIM = 0.03
"""By this share rotors of one direction may carry more: drag of unequal propellers makes 0.01."""

MOST_UNCERTAIN = 10.0
"""Deviation of a number's shift without the means over its own, from which changes of motion alone
do not tell it: on random worlds those that are wrong are thousands of times as uncertain."""


def missing_constant_wrench(fit: Fit) -> Iterator[Finding]:
    """Check that the estimate does not move when the mean of every stretch is left out.

    A constant force or torque that the model does not have (tilted motors, a tilted IMU, wind) acts
    there and nowhere else.
    """
    estimate = fit.estimate
    bands = np.concatenate([factors.band for factors in estimate.problem.factors])
    mean = bands[:, 0] == 0.0
    if not mean.any():
        return
    shift, names = shift_without(estimate, mean), estimate.estimate.names
    chosen = [i for i, n in enumerate(names) if n.partition("@")[0] in ("kt", "kd", *MOMENTS)]
    size = np.abs(shift.values[chosen]) / shift.std[chosen]
    half = np.array([fit.numbers.half_width[fit.numbers.index(names[i])] for i in chosen])
    # What only the means tell no change of motion contradicts.
    shown = shift.std[chosen] < MOST_UNCERTAIN * half / 1.96
    outside = shown & (np.abs(shift.values[chosen]) > half)
    limit = float(stats.norm.isf(0.5 * UNLIKELY / len(chosen)))
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
    """Check whether the rotors hold a steady yaw torque that the model lacks.

    Without the term ``twist`` motors tilted by two tenths of a degree are enough to spoil k_d. Two
    signs: rotors of one direction carry more than those of the other, or yaw, fitted without the
    mean of every stretch, responds to the rotors otherwise than in the whole fit.
    """
    sentences: list[str] = []
    evidence: list[Evidence] = []
    numbers = fit.numbers
    for configured, c in zip(fit.dataset.configurations, fit.configurations, strict=True):
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
    """Measure by which share k_d / Izz moves without the means; None where there are none.

    In one step of the joint fit, which allows for what the autopilot answers: the yaw row alone
    calls 37 to 46 % too little of short flights a torque. The limit is what its interval leaves
    open, or chance.
    """
    mean = np.concatenate([factors.band for factors in fit.estimate.problem.factors])[:, 0] == 0.0
    name = f"kd_over_Izz@{c.name}"
    value, half = fit.numbers.number(name)
    if not mean.any() or mean.all() or value == 0.0 or not np.isfinite(half):
        return None
    estimate, shift = fit.estimate.estimate, shift_without(fit.estimate, mean)
    slopes = numerical_jacobian(
        lambda phi: np.array([physical(phi, fit.estimate.problem.map, fit.configurations)[name]]),
        estimate.values,
        estimate.std,
    )[0]
    moved = float(slopes @ shift.values) / value
    std = float(np.sqrt(slopes @ shift.covariance @ slopes)) / abs(value)
    return Evidence(
        name=f"yaw_shift_without_mean@{c.name}",
        value=moved,
        interval=(moved - 1.96 * std, moved + 1.96 * std),
        limit=max(half / abs(value), unlikely_deviations() * std),
    )


CHECKS: Final = (missing_constant_wrench,)
YAW_CHECKS: Final = (steady_yaw_torque,)
