"""Check the mean of every stretch: forces and torques that do not change."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy import stats

from rotorfit.dataset.dataset import ConfigurationData
from rotorfit.diagnostics.hover_thrust import UNLIKELY, unlikely_deviations
from rotorfit.estimation.banded import shift_without
from rotorfit.experiment.payload import MOMENTS
from rotorfit.findings import Finding, doubt_or_passed
from rotorfit.fit.fit import Fit
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.fit.rows.row_fits import fit_rows
from rotorfit.model.vehicle import Vehicle

LEAST_YAW_SHIFT = 0.1
"""The yaw response with and without the means may differ by this share: what tilted motors make
goes with thrust, and is not in the mean alone."""
LEAST_TILT = 0.5
"""Mean tilt of the motors about their arms that is worth words [degrees]."""
LEAST_TRIM = 0.03
"""The same for the difference between ccw and cw rotors: drag of unequal propellers makes 0.01."""


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
    outside = np.abs(shift.values[chosen]) > half
    limit = float(stats.norm.isf(0.5 * UNLIKELY / len(chosen)))
    worst = chosen[int(np.argmax(np.where(outside, size, 0.0)))]
    value = float(estimate.estimate.values[worst])
    sentence = (
        f"{names[worst].replace('@', ' of ')}: {value:.3g} with the mean of every stretch of "
        f"flight, {value + float(shift.values[worst]):.3g} without: a constant force or torque is "
        "missing in the model, such as that of tilted motors; check that they are upright"
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
    signs: rotors of one direction carry more than those of the other, or the yaw row, solved
    without the mean of every stretch, responds to the rotors otherwise than the whole fit.
    """
    sentences: list[str] = []
    measured: dict[str, float] = {}
    numbers = fit.numbers
    for configured, c in zip(fit.dataset.configurations, fit.configurations, strict=True):
        trim, response = _yaw_trim(configured, c.vehicle), _yaw_response_without_mean(c)
        measured[f"yaw_trim@{c.name}"] = trim
        differs = False
        if response is not None:
            rest, std = response
            whole = float(numbers.values[numbers.index(f"kd_over_Izz@{c.name}")])
            if rest != 0.0:
                measured[f"yaw_response_with_mean@{c.name}"] = whole / rest
            limit = max(LEAST_YAW_SHIFT * abs(rest), unlikely_deviations() * std)
            differs = abs(whole - rest) > limit
        if f"twist@{c.name}" in numbers.names and not differs:
            sentences += _tilt_sentence(c, numbers)
        elif abs(trim) > LEAST_TRIM or differs:
            sentences.append(_steady_torque_sentence(c.name, trim))
    yield doubt_or_passed("steady-yaw-torque", "; ".join(sentences) or None, measured)


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


def _yaw_response_without_mean(c: JointConfiguration) -> tuple[float, float] | None:
    """Fit k_d / Izz of the yaw row without the means; value and standard deviation.

    None where there are no means, or the rotors are tilted: the yaw row then responds to thrust
    about the tilted axes together with drag.
    """
    mean = c.factors.band[:, 0] == 0.0
    tilted = bool((c.vehicle.axes[:, :2] != 0.0).any())
    if tilted or not mean.any() or mean.all():
        return None
    rest = fit_rows(c.factors.select(~mean), c.model, mass=c.mass)
    if "yaw.kd" not in rest.names:
        return None
    i = rest.names.index("yaw.kd")
    # Of the rest alone: more than that of the difference, which shares its data.
    return float(rest.values[i]), float(np.sqrt(max(rest.covariance[i, i], rest.formal[i, i])))


CHECKS: Final = (missing_constant_wrench,)
YAW_CHECKS: Final = (steady_yaw_torque,)
