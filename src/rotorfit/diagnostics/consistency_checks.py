"""Second opinions on an estimate, each from other data than the first: said where they differ."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats

from rotorfit.dataset.dataset import ConfigurationData
from rotorfit.dataset.weight_balance import Held, held_together, held_up, hovering, pooled, turning
from rotorfit.estimation.banded import BandedEstimate, shift_without
from rotorfit.experiment.payload import MOMENTS
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.fit.rows.row_fits import fit_rows
from rotorfit.logs.files import file_name
from rotorfit.model.parameters import ACCEL_BIAS_STD, DRAG
from rotorfit.model.vehicle import Vehicle
from rotorfit.preprocessing.airborne import GRAVITY
from rotorfit.preprocessing.flight_data import FlightData

UNLIKELY = 1e-4
"""Probability of chance alone below which two opinions differ."""
LEAST_YAW_SHIFT = 0.1
"""The yaw response with and without the means may differ by this share: what tilted motors make
goes with thrust, and is not in the mean alone."""
LEAST_TILT = 0.5
"""Mean tilt of the motors about their arms that is worth words [degrees]."""
LEAST_TRIM = 0.03
"""The same for the difference between ccw and cw rotors: drag of unequal propellers makes 0.01."""
LEAST_THRUST_ERROR = 0.01
"""Thrust that misses the weight by less than this share is not worth words: so much do tilt, wind
and a propeller's inflow make."""
LEAST_SAG = 0.05
"""The same for the change of thrust at one rotor speed during a flight."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HoverThrust:
    """What the thrust of the estimate makes of the weight in one flight.

    Attributes
    ----------
    configuration
        That flew.
    flight
        File of the flight.
    thrust
        Mean upward thrust over the weight.
    sag
        The same in the second half of the flight over that in the first, less one; None where
        they are too short.
    sag_std
        Of the sag.
    """

    configuration: str
    flight: str
    thrust: Held
    sag: float | None
    sag_std: float


def without_mean(fit: BandedEstimate, numbers: Numbers) -> tuple[str | None, dict[str, float]]:
    """Return what changes where the mean of every stretch is not used.

    A constant force or torque that the model does not have (tilted motors, a tilted IMU, wind) acts
    there and nowhere else.

    Returns
    -------
    sentence, diagnostics
        The largest shift, in deviations of chance.
    """
    bands = np.concatenate([factors.band for factors in fit.problem.factors])
    mean = bands[:, 0] == 0.0
    if not mean.any():
        return None, {}
    shift, names = shift_without(fit, mean), fit.estimate.names
    chosen = [i for i, n in enumerate(names) if n.partition("@")[0] in ("kt", "kd", *MOMENTS)]
    size = np.abs(shift.values[chosen]) / shift.std[chosen]
    half = np.array([numbers.half_width[numbers.index(names[i])] for i in chosen])
    outside = np.abs(shift.values[chosen]) > half
    diagnostics = {"shift_without_mean": float(size.max())}
    limit = float(stats.norm.isf(0.5 * UNLIKELY / len(chosen)))
    if not (outside & (size > limit)).any():
        return None, diagnostics
    worst = chosen[int(np.argmax(np.where(outside, size, 0.0)))]
    value = float(fit.estimate.values[worst])
    return (
        f"{names[worst].replace('@', ' of ')}: {value:.3g} with the mean of every stretch of "
        f"flight, {value + float(shift.values[worst]):.3g} without: a constant force or torque is "
        "missing in the model, such as that of tilted motors; check that they are upright",
        diagnostics,
    )


def steady_yaw_torque(
    configurations: Sequence[ConfigurationData],
    joint: Sequence[JointConfiguration],
    numbers: Numbers,
) -> tuple[str | None, dict[str, float]]:
    """Return whether the rotors hold a steady yaw torque, and whether the model has it.

    Without the term ``twist`` motors tilted by two tenths of a degree are enough to spoil k_d. Two
    signs: rotors of one direction carry more than those of the other, or the yaw row, solved
    without the mean of every stretch, answers the rotors otherwise than the whole fit.

    Returns
    -------
    sentence, diagnostics
        The difference between the two directions over all thrust, and the yaw response k_d / Izz
        of the fit over that without means.
    """
    doubts: list[str] = []
    diagnostics: dict[str, float] = {}
    for configured, c in zip(configurations, joint, strict=True):
        trim, response = _yaw_trim(configured, c.vehicle), _yaw_response_without_mean(c)
        diagnostics[f"yaw_trim@{c.name}"] = trim
        differs = False
        if response is not None:
            rest, std = response
            whole = float(numbers.values[numbers.index(f"kd_over_Izz@{c.name}")])
            if rest != 0.0:
                diagnostics[f"yaw_response_with_mean@{c.name}"] = whole / rest
            differs = abs(whole - rest) > max(LEAST_YAW_SHIFT * abs(rest), _far() * std)
        if f"twist@{c.name}" in numbers.names and not differs:
            doubts += _tilt_said(c, numbers)
        elif abs(trim) > LEAST_TRIM or differs:
            doubts.append(_steady_torque_said(c.name, trim))
    return _joined(doubts), diagnostics


def _steady_torque_said(name: str, trim: float) -> str:
    """Return a steady yaw torque that the model does not have in words, and what shows it."""
    more, less = ("ccw", "cw") if trim > 0 else ("cw", "ccw")
    seen = f"the {more} rotors carry {100.0 * abs(trim):.1f} % of the thrust more than the {less}"
    if abs(trim) <= LEAST_TRIM:
        seen = "the mean of each stretch and the motion around it disagree about yaw"
    return (
        f"{name}: {seen}: a steady yaw torque that is not in the model, as from tilted motors or "
        "twisted arms; set them upright, and until then do not trust kd, Jr and Izz"
    )


def _tilt_said(c: JointConfiguration, numbers: Numbers) -> list[str]:
    """Return the motors' mean tilt about their arms in words, where it is large and certain."""
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
    """Return by what share of all thrust the ccw rotors carry more than the cw ones."""
    more = total = 0.0
    for flight in configured.flights:
        data = flight.prepared.data
        for segment in data.segments:
            squares = data.rotor_speed[segment.start : segment.stop] ** 2
            more += float((squares @ (vehicle.spins - vehicle.spins.mean())).sum())
            total += float(squares.sum())
    return more / total if total > 0.0 else 0.0


def _yaw_response_without_mean(c: JointConfiguration) -> tuple[float, float] | None:
    """Return k_d / Izz of the yaw row without the means, and its deviation.

    None where there are no means, or the rotors are tilted: what the yaw row then answers is
    thrust about the tilted axes together with drag.
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


def accelerometer_against_gravity(
    configurations: Sequence[ConfigurationData],
) -> tuple[str | None, dict[str, float]]:
    """Return whether the accelerometer reads gravity, over all of the flights that is hover.

    Returns
    -------
    sentence, diagnostics
        The mean reading of each configuration over gravity.
    """
    doubts: list[str] = []
    diagnostics: dict[str, float] = {}
    for configured in configurations:
        data = [flight.prepared.data for flight in configured.flights]
        held = held_together(held_up(turning(hovering(one)), one.specific_force) for one in data)
        if held is None:
            continue
        diagnostics[f"accelerometer_over_gravity@{configured.entry.name}"] = held.ratio
        limit = ACCEL_BIAS_STD / GRAVITY + 1.96 * held.std
        if abs(held.ratio - 1.0) > limit:
            doubts.append(
                f"{configured.entry.name}: where its flights hover the accelerometer reads "
                f"{held.ratio * GRAVITY:.2f} +- {1.96 * held.std * GRAVITY:.2f} m/s^2 where "
                f"gravity is {GRAVITY:.2f}: calibrate it; a bias is estimated and removed, but "
                "a wrong scale goes straight into kt and all inertia"
            )
    return _joined(doubts), diagnostics


def hover_thrusts(
    configurations: Sequence[ConfigurationData], numbers: Numbers, vehicle: Vehicle
) -> list[HoverThrust]:
    """Return what holds each flight up by the estimated thrust coefficients."""
    kt = numbers.values[numbers.index("kt")]
    own = [f"kt_{i + 1}" for i in range(len(vehicle.rotors))]
    each = np.array([numbers.values[numbers.index(n)] if n in numbers.names else kt for n in own])
    found: list[HoverThrust] = []
    for configured in configurations:
        for flight in configured.flights:
            data = flight.prepared.data
            thrust = (data.rotor_speed**2 * each) @ vehicle.axes
            air = _air_force(data, numbers, configured.entry.name, vehicle)
            force = (thrust + air) / configured.mass
            whole = held_up(flight.turning, force)
            if whole is None:
                continue
            sag, sag_std = _sag(
                *(held_up(flight.turning.half(late), force) for late in (False, True))
            )
            found.append(
                HoverThrust(
                    configuration=configured.entry.name,
                    flight=flight.entry.file,
                    thrust=whole,
                    sag=sag,
                    sag_std=sag_std,
                )
            )
    return found


def _air_force(
    data: FlightData, numbers: Numbers, configuration: str, vehicle: Vehicle
) -> Float[np.ndarray, "n 3"]:
    """Return what the air does along the body axes by the estimate [N]; zeros without velocity."""

    def value(name: str) -> float:
        return float(numbers.values[numbers.index(name)]) if name in numbers.names else 0.0

    if data.velocity is None:
        return np.zeros((len(data.time), 3))
    v, n = np.nan_to_num(data.velocity), vehicle.axes
    drag = v * [value(f"{name}@{configuration}") for name in DRAG]
    rising = v @ n.T + data.angular_velocity @ np.cross(vehicle.positions, n).T
    lost = value("inflow") * (data.rotor_speed * rising) @ n
    lift = value("translational_lift") * (v[:, :1] ** 2 + v[:, 1:2] ** 2) * [0.0, 0.0, 1.0]
    return lift - drag - lost


def _sag(first: Held | None, second: Held | None) -> tuple[float | None, float]:
    if first is None or second is None or first.ratio <= 0.0:
        return None, np.inf
    return second.ratio / first.ratio - 1.0, float(np.hypot(first.std, second.std))


def thrust_against_weight(
    found: Sequence[HoverThrust], numbers: Numbers
) -> tuple[str | None, dict[str, float]]:
    """Return whether the estimated thrust carries the weight.

    k_t comes from changes of thrust, the weight is known without them: the accelerometer's scale,
    or thrust that does not go with the square of the speed, parts the two.

    Returns
    -------
    sentence, diagnostics
        The mean thrust of all flights over the weight.
    """
    if not found:
        return None, {}
    held = pooled([one.thrust for one in found])
    i = numbers.index("kt")
    std = float(np.hypot(held.std, numbers.half_width[i] / 1.96 / abs(numbers.values[i])))
    error = held.ratio - 1.0
    diagnostics = {"thrust_over_weight": held.ratio}
    if abs(error) <= max(LEAST_THRUST_ERROR, _far() * std):
        return None, diagnostics
    return (
        f"the thrust found is {held.ratio:.3f} +- {1.96 * std:.3f} times the weight it carries: "
        "the accelerometer's scale is wrong, or thrust is not proportional to the square of rotor "
        "speed; kt and all inertia are off by about as much",
        diagnostics,
    )


def hovers_differ(found: Sequence[HoverThrust]) -> tuple[str | None, dict[str, float]]:
    """Return whether some flight needs more thrust for its weight than another.

    Returns
    -------
    sentence, diagnostics
        The largest ratio between two flights.
    """
    if len(found) < 2:
        return None, {}
    *_, high = low, *_ = sorted(found, key=lambda one: one.thrust.ratio)
    if low.thrust.ratio <= 0.0:
        return None, {}
    ratio = high.thrust.ratio / low.thrust.ratio
    std = float(np.hypot(low.thrust.std, high.thrust.std))
    diagnostics = {"largest_hover_ratio": ratio}
    if ratio - 1.0 <= max(LEAST_THRUST_ERROR, _far() * std):
        return None, diagnostics
    first, second = (_of_flight(f, found) for f in (high, low))
    if high.configuration == low.configuration:
        what = "the battery (give the law its voltage), the propellers or the load changed"
    else:
        what = (
            "one of the masses is wrong, battery or propellers changed, or they are two different "
            "vehicles, which need an experiment each; weigh both again"
        )
    return (
        f"{first} hovers on {100 * (ratio - 1.0):.1f} % more thrust for its mass than {second} "
        f"(+- {196 * std:.1f} %): {what}",
        diagnostics,
    )


def thrust_sags(
    found: Sequence[HoverThrust], *, commanded: bool
) -> tuple[str | None, dict[str, float]]:
    """Return whether one rotor speed (or command) gives less thrust late in a flight than early.

    Parameters
    ----------
    found
        Of the flights.
    commanded
        Whether rotor speed is known by commands alone, which a sagging battery belies.

    Returns
    -------
    sentence, diagnostics
        The largest change between the ends of a flight, as a share.
    """
    known = [one for one in found if one.sag is not None]
    if not known:
        return None, {}
    # The halves' means are half a flight apart.
    worst = max(known, key=lambda one: abs(one.sag or 0.0) / one.sag_std)
    change = 2.0 * (worst.sag or 0.0)
    diagnostics = {"thrust_change": change}
    if abs(change) <= max(LEAST_SAG, 2.0 * _far() * worst.sag_std):
        return None, diagnostics
    way = "less" if change > 0 else "more"
    battery = "log rotor speed, or the battery's voltage and give it to the law; or "
    return (
        f"{_of_flight(worst, found)}: the same motor data give {100 * abs(change):.0f} % {way} "
        f"thrust at the end of the flight than at its beginning: {battery if commanded else ''}"
        "drag carried part of the weight in climb or descent: fly slower",
        diagnostics,
    )


def _of_flight(one: HoverThrust, found: Sequence[HoverThrust]) -> str:
    """Return a flight's name, with its configuration where there are several."""
    name = file_name(one.flight)
    several = len({other.configuration for other in found}) > 1
    return f"{one.configuration} ({name})" if several else name


def _far() -> float:
    """Return how many deviations chance alone does not reach."""
    return float(stats.norm.isf(0.5 * UNLIKELY))


def _joined(doubts: Sequence[str]) -> str | None:
    return "; ".join(doubts) if doubts else None
