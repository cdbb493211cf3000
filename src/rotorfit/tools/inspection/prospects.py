"""Predict cheaply what one log can show: kt, excitation of each axis, and the motor order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.checks.sensors.log_settings import (
    SPEED_OR_LAW,
    faster_log,
    log_with_speed,
    slow_words,
)
from rotorfit.checks.verdicts.judge import ADVISED, FLOWN, judge
from rotorfit.estimation.measured import Measured
from rotorfit.fit.dataset.carried_weight import carrying_stretches
from rotorfit.fit.dataset.weight_balance import turning
from rotorfit.fit.intervals.excitation import enough_by_weight, mean_ratios, pilots_rows
from rotorfit.fit.intervals.numbers import NO_EXCITATION, attenuation_allowance
from rotorfit.fit.intervals.row_scatter import row_half_widths
from rotorfit.fit.motors.hovers_by_mass import rms_speed
from rotorfit.fit.motors.law_from_thrust import LawFromThrust, anchor_of, exponent_of, thrust_ratio
from rotorfit.fit.reduction.bandwidth import Bandwidth, Sensor, bandwidths
from rotorfit.fit.reduction.frequency_bands import PILOT_BAND, prepared_bands, retimed
from rotorfit.fit.row_fits import RowFits, fit_rows
from rotorfit.fit.weight.kt_from_weight import bias_at_rest, pooled_weight, velocity_std_of
from rotorfit.fit.weight.weigh_thrust import CHANGES_STD, DOUBTED, Balance
from rotorfit.flight.flight_checks import LEAST_RATE
from rotorfit.flight.signals import smooth
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.regressor import regressor
from rotorfit.tools.inspection.flown_part import tried_response
from rotorfit.tools.inspection.guessed_rotors import confirmed_motors, guessed_vehicles
from rotorfit.tools.inspection.lag_search import (
    TriedLag,
    best_lag,
    clearer_lag,
    lines_of_body,
    tried_lags,
    turn_likelihood,
)
from rotorfit.tools.inspection.motor_lateness import LOW_PASS
from rotorfit.tools.planning.advised_step import NextStep

if TYPE_CHECKING:
    from rotorfit.estimation.factors import Factors
    from rotorfit.fit.reduction.reduce import Lines
    from rotorfit.flight.flight_data import FlightData
    from rotorfit.flight.motors.motor_model import MotorResponse
    from rotorfit.flight.prepare import PreparedFlight
    from rotorfit.logs.flight_log import FlightLog
    from rotorfit.logs.motor_law import MotorLaw
    from rotorfit.model.vehicle import Vehicle
    from rotorfit.results.result import Verdict
    from rotorfit.simulation.pilot import Manoeuvre

Axis = Literal["roll", "pitch", "yaw"]
Prospect = Literal["well", "roughly", "not"]
Rows = Mapping[str, tuple[float, float]]
"""Value and half-width by chance of the rows' parameters, by their names."""
AXES: Final[tuple[Axis, ...]] = ("roll", "pitch", "yaw")
PROSPECT: Final[dict[Verdict, Prospect]] = {
    "identified": "well",
    "weak": "roughly",
    "not-identified": "not",
}
IDENTIFY: Final = "describe the vehicle: rotorfit airframe {log}"


@frozen_dataclass
class Excitation:
    """The excitation of one axis, and the prospect of its number.

    Attributes
    ----------
    turning
        Deviation of the angular acceleration below 15 Hz [rad/s^2].
    rho
        Power of the angular acceleration that the rotors explain over the rest, in the pilot's
        band, as in an estimate.
    width
        Expected half of the 95 % interval of Ixx, Iyy, kd / Izz, over the value; None: unbounded.
    """

    axis: Axis
    turning: float
    rho: float
    width: float | None

    @property
    def prospect(self) -> Prospect:
        """How well its number can be found: the verdict that an estimate would have."""
        return _judge_prospect(self.width, axis=self.axis, excitation=self.rho)


@frozen_dataclass
class Thrust:
    """The excitation of thrust, and the coefficient that carries the weight.

    - `change`: deviation of the thrust over its mean.
    - `from_changes`, `from_weight`: kt per kilogram by changes of thrust and by the weight; None
      without a long stretch.
    - `agree`: whether the two agree within what an estimate allows.
    - `ratio`: changes of thrust over the weight; None without a long stretch.
    - `width`: expected half of the 95 % interval, over the value; None: unbounded.
    - `followed`: whether the vehicle turns with the motor data at all: else commands may be no
      rotor speeds.
    - `law_reach`: share by which changes of thrust, with which inertia goes, are open for the law.
    - `law_full`: share by which the thrust at full command is open for a law that is unknown, or
      stated by settings of the firmware.
    """

    change: float
    from_changes: float
    from_weight: float | None
    agree: bool
    width: float | None
    followed: bool
    law_reach: float = 0.0
    law_full: float = 0.0
    ratio: Measured | None = None

    @property
    def prospect(self) -> Prospect:
        """How well kt can be found."""
        return _judge_prospect(self.width, axis="force")

    @property
    def of_inertia(self) -> float | None:
        """The share of an inertia that kt leaves open, for the thrust at the flight's commands."""
        if self.width is None:
            return None
        carried = max(self.width**2 - self.law_full**2, 0.0)
        return float(np.sqrt(carried + self.law_reach**2))


@frozen_dataclass
class Commands:
    """Possible faults of commands in place of speeds.

    - `law_known`: whether the log states how speed goes with the command.
    - `limited`: share of the flight in which a command is 0 or 1.
    - `lag`, `seen_lag`: with which the commands explain the turns best, and by which the vehicle
      responds [s].
    - `rate`: of the slowest of commands and IMU [Hz].
    """

    law_known: bool
    limited: float
    lag: float
    seen_lag: float
    rate: float


@frozen_dataclass
class Prospects:
    """The prospects of a flight; `motors` names the layout and order that explain the motion.

    `useless_because`: why no other flight shows more in such a log; None if one does.
    `bandwidths`: of the sensors that the flight shows to be behind a low-pass.
    """

    excitation: tuple[Excitation, ...]
    thrust: Thrust
    commanded: bool
    motors: str | None
    commands: Commands | None = None
    useless_because: str | None = None
    bandwidths: Mapping[Sensor, Bandwidth] = field(default_factory=dict[Sensor, Bandwidth])

    @property
    def explains_quick_turns_only(self) -> bool:
        """Whether commands confirm a layout, but explain no turn in the pilot's band."""
        return self.commanded and not self.thrust.followed and self.motors is not None


def foreseen_step(log: FlightLog, prepared: PreparedFlight, found: Prospects) -> NextStep:
    """Choose what to do after a flight that is not identified yet, as after an identification."""
    faster = faster_log(log, prepared)
    if faster is not None:
        return NextStep(kind="log", action=faster, because=slow_words(prepared))
    # What yaw lacks first: kd, Jr and Izz at once.
    axes = reversed(found.excitation)
    lacking: list[Manoeuvre] = [ADVISED[a.axis] for a in axes if a.prospect != "well"]
    if found.thrust.prospect != "well":
        lacking.append(ADVISED["force"])
    if not lacking:
        return NextStep(kind="done", action=IDENTIFY.format(log=log.as_argument))
    with_speed = log_with_speed(log, prepared) if found.commanded else None
    if with_speed is not None:
        return NextStep(kind="log", action=with_speed)
    if found.explains_quick_turns_only:
        return NextStep(kind="log", action=SPEED_OR_LAW)
    return NextStep(kind="fly", action=FLOWN[lacking[0]])


def _judge_prospect(width: float | None, *, axis: str, excitation: float | None = None) -> Prospect:
    half_width = np.inf if width is None else width
    found = judge(1.0, half_width, scale=0.0, axis=axis, excitation=excitation)
    return PROSPECT[found.verdict]


def prospects(
    prepared: PreparedFlight,
    motors: MotorResponse | None = None,
    *,
    commanded: bool = False,
    law: MotorLaw | None = None,
) -> Prospects:
    """Predict what a prepared flight can show, whatever its airframe.

    By the rows of an estimate, with the rotors of a usual layout where the flight confirms one,
    else with rotors as the flight itself places them. `motors` is their timing (None: as prepared);
    the lag of commands is searched; `law` is theirs, where the log states it. Raises `FlightError`
    where the flight is too short, `EstimationError` where it does not move its rotors.
    """
    seen = tried_response(motors, commanded=commanded)
    body = lines_of_body(prepared)
    timed = replace(prepared, data=retimed(prepared, seen))
    known = confirmed_motors(timed, body=body)
    vehicle = known[0] if known is not None else _likeliest_rotors(timed, body)
    if commanded and seen is not None:
        fitted = _commanded_rows(prepared, vehicle, seen, body=body)
        timed, fits = fitted.flight, fitted.fits
        commands = _describe_commands(prepared, lags=(seen.lag, fitted.lag), law=law)
    else:
        factors, commands = prepared_bands(timed, vehicle, None, body=body), None
        fits = _by_weight(fit_rows(factors, regressor(vehicle), mass=1.0), factors)
    followed = _follows_motors(fits)
    rows = _with_widths(fits)
    thrust = _estimate_thrust(
        timed.data,
        vehicle,
        rows,
        followed=followed,
        commanded=commanded,
        law=law,
    )
    return Prospects(
        excitation=tuple(
            Excitation(
                axis=axis,
                turning=size,
                rho=fits.excitation[axis],
                width=_predict_width(axis, fits, rows, thrust),
            )
            for axis, size in zip(AXES, _turning_deviations(timed.data), strict=True)
        ),
        thrust=thrust,
        commanded=commanded,
        motors=None if known is None else known[1],
        commands=commands,
        useless_because=slow_words(prepared) if prepared.slowest_rate < LEAST_RATE else None,
        # The lag of commanded motors is known roughly here, and looks like a filter of the sensors.
        bandwidths={}
        if commanded
        else bandwidths(timed.data, vehicle, top=0.4 * prepared.slowest_rate),
    )


def _describe_commands(
    prepared: PreparedFlight, *, lags: tuple[float, float], law: MotorLaw | None
) -> Commands:
    """Describe commands whose motors lag by so much in the log, and as the rows found [s]."""
    seen, found = lags
    return Commands(
        law_known=law is not None,
        limited=_share_at_limits(prepared),
        lag=found,
        seen_lag=seen,
        rate=prepared.slowest_rate,
    )


def _share_at_limits(prepared: PreparedFlight) -> float:
    """Compute the share of the flight in which a motor's speed is at its least or largest."""
    speed = prepared.data.rotor_speed[prepared.data.used_rows]
    low, high = np.nanmin(speed), np.nanmax(speed)
    return float(((speed <= low) | (speed >= high)).any(axis=1).mean())


def _likeliest_rotors(prepared: PreparedFlight, body: tuple[Lines, ...]) -> Vehicle:
    """Select the guessed rotors that explain the turns best."""
    likely = guessed_vehicles(prepared.data)
    if len(likely) == 1:
        return likely[0]

    def likelihood(vehicle: Vehicle) -> float:
        factors = prepared_bands(prepared, vehicle, None, body=body, top=PILOT_BAND[1])
        return turn_likelihood(factors, regressor(vehicle))

    return max(likely, key=likelihood)


@frozen_dataclass
class _CommandedRows:
    """The rows of a flight of commanded motors: at which lag, and the lag of the pilot's band."""

    flight: PreparedFlight
    fits: RowFits
    lag: float


def _commanded_rows(
    prepared: PreparedFlight,
    vehicle: Vehicle,
    motors: MotorResponse,
    *,
    body: tuple[Lines, ...],
) -> _CommandedRows:
    """Fit the rows at the lag of the pilot's band, at a clearer one where that explains nothing."""
    model = regressor(vehicle)
    tried = tried_lags(prepared, vehicle, motors, body=body)
    usual = best_lag(tried, model) or TriedLag(
        response=motors, factors=prepared_bands(prepared, vehicle, motors, body=body)
    )
    fitted, fits = usual, fit_rows(usual.factors, model, mass=1.0)
    if not _follows_motors(fits):
        fitted = clearer_lag(tried, model, usual)
        fits = fits if fitted is usual else fit_rows(fitted.factors, model, mass=1.0)
    return _CommandedRows(
        flight=replace(prepared, data=retimed(prepared, fitted.response)),
        fits=_by_weight(fits, fitted.factors),
        lag=usual.response.lag,
    )


def _by_weight(fits: RowFits, factors: Factors) -> RowFits:
    """Return the rows with the excitation by which an estimate judges them."""
    signal, left = (
        np.column_stack([getattr(fits.fits[axis], power) for axis in AXES])
        for power in ("known_power", "residual_power")
    )
    means = mean_ratios(pilots_rows(factors), (signal, left), np.arange(len(factors)))
    weighed = {str(axis): float(rho) for axis, rho in zip(AXES, means, strict=True)}
    return replace(fits, excitation=enough_by_weight(fits.excitation, weighed))


def _follows_motors(fits: RowFits) -> bool:
    """Test whether roll or pitch shows more of the motors than of disturbances."""
    return max(fits.excitation["roll"], fits.excitation["pitch"]) > NO_EXCITATION


def _estimate_thrust(
    data: FlightData,
    vehicle: Vehicle,
    rows: Rows,
    *,
    followed: bool,
    commanded: bool,
    law: MotorLaw | None,
) -> Thrust:
    """Estimate kt from changes of thrust and from the weight."""
    squares = (data.rotor_speed[data.used_rows] ** 2).sum(axis=1)
    kt, random = rows["force.kt"]
    changes = Measured(value=kt, std=float(np.hypot(random / 1.96, CHANGES_STD * kt)))
    weighed = kt_by_weight(data, vehicle)
    agree, width, reach, full = True, _relative_width(random, kt), 0.0, 0.0
    if commanded and law is None:
        # Commands that do not explain the motion do not show how thrust grows with them either.
        ratio = thrust_ratio(changes, weighed) if followed else None
        found = LawFromThrust(exponent=exponent_of(ratio), flown=ratio, hover=rms_speed([data]))
        reach, full = 1.96 * found.slope_std, 1.96 * found.thrust_std
        held = width if weighed is None else _relative_width(1.96 * weighed.std, weighed.value)
        width = float(np.hypot(held, full))
    elif weighed is not None:
        agree = Balance(changes=changes, weight=weighed).deviations <= DOUBTED
        if law is None:
            balance = Balance(changes=changes, weight=weighed)
            width = _relative_width(1.96 * balance.kt.std, balance.kt.value)
        else:  # where changes contradict a law, they say nothing of k_t
            found = _given_law(data, law, thrust_ratio(changes, weighed) if followed else None)
            reach = 1.96 * found.slope_std
            full = 1.96 * found.thrust_std if law.stated else 0.0
            held = _relative_width(1.96 * weighed.std, weighed.value)
            width = float(np.hypot(held, full))
    return Thrust(
        change=float(squares.std() / squares.mean()) if len(squares) else 0.0,
        from_changes=kt,
        from_weight=None if weighed is None else weighed.value,
        agree=agree,
        width=_finite_or_none(width),
        followed=followed or not commanded,
        law_reach=reach,
        law_full=full,
        ratio=None if weighed is None else changes.over(weighed),
    )


def _given_law(data: FlightData, law: MotorLaw, ratio: Measured | None) -> LawFromThrust:
    """Estimate how well a flight shows a law that is given."""
    hover = rms_speed([data])
    anchor = anchor_of(law, hover)
    return LawFromThrust(
        exponent=exponent_of(ratio, law),
        flown=ratio,
        hover=hover / anchor,
        anchor=anchor,
        given=law,
    )


def kt_by_weight(data: FlightData, vehicle: Vehicle) -> Measured | None:
    """Estimate the kt per kilogram that carries the weight; None without a long stretch."""
    held = carrying_stretches(
        data,
        turning(data),
        vehicle,
        mass=1.0,
        bias=bias_at_rest(data),
        velocity_std=velocity_std_of(data, estimated=True),
    )
    return pooled_weight(list(held))


def _predict_width(axis: Axis, fits: RowFits, rows: Rows, thrust: Thrust) -> float | None:
    """Predict the half-width of the number of an axis, over its value."""
    name = {"roll": "Ixx", "pitch": "Iyy", "yaw": "kd_over_Izz"}[axis]
    bias = attenuation_allowance(name, 1.0, fits.excitation[axis], with_response=True)
    value, random = rows["yaw.kd" if axis == "yaw" else f"{axis}.kt"]
    if axis == "yaw":
        return _finite_or_none(float(np.hypot(_relative_width(random, value), bias)))
    scale = thrust.of_inertia
    if scale is None:
        return None
    return _finite_or_none(float(np.hypot(np.hypot(_relative_width(random, value), bias), scale)))


def _with_widths(fits: RowFits) -> Rows:
    """Return every parameter of the rows, and half of its interval by chance."""
    pairs = zip(fits.values.tolist(), row_half_widths(fits).tolist(), strict=True)
    return dict(zip(fits.names, pairs, strict=True))


def _relative_width(half_width: float, value: float) -> float:
    """Return a half-width over a value that must be positive to mean anything."""
    return half_width / value if value > 0 else float("inf")


def _finite_or_none(width: float) -> float | None:
    return width if np.isfinite(width) else None


def _turning_deviations(data: FlightData) -> list[float]:
    """Return the deviation of each angular acceleration below 15 Hz [rad/s^2]."""
    parts = [
        smooth(data.angular_acceleration[s.start : s.stop], data.sample_rate, LOW_PASS)
        for s in data.segments
    ]
    return [float(x) for x in np.concatenate(parts).std(axis=0)]
