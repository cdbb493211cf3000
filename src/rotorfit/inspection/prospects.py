"""What one log can show, cheaply: kt, what each axis was moved, and whose motor order it has."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy import stats

from rotorfit.dataset.checks.declared_rotors import Response, response
from rotorfit.dataset.weight_balance import held_up, turning
from rotorfit.diagnostics.kt_from_weight import INFLOW_STD, WeighedThrust
from rotorfit.errors import ExperimentError
from rotorfit.estimation.factors import Factors
from rotorfit.fit.intervals.excitation import NO_EXCITATION, attenuation_allowance
from rotorfit.fit.rows.row_fits import RowFits, angular_log_likelihood, fit_rows
from rotorfit.inspection.guessed_rotors import guessed_vehicles
from rotorfit.inspection.motor_lateness import LOOK
from rotorfit.model.layouts import layout_rotors
from rotorfit.model.regressor import Regressor, regressor
from rotorfit.model.vehicle import Rotor, Vehicle
from rotorfit.preprocessing.flight_data import FlightData
from rotorfit.preprocessing.motors.motor_model import MotorResponse
from rotorfit.preprocessing.prepare import PreparedFlight
from rotorfit.preprocessing.signals import smooth
from rotorfit.reduction.frequency_bands import EDGES, STRETCH, retimed, slow_bands
from rotorfit.reduction.motor_timing import LAG_PRIOR
from rotorfit.reduction.reduce import BandPlan, band_factors
from rotorfit.results.result import Verdict
from rotorfit.results.verdicts import judge

Axis = Literal["roll", "pitch", "yaw"]
Prospect = Literal["well", "roughly", "not"]
Convention = Literal["px4", "betaflight", "crazyflie", "paper"]

AXES: Final[tuple[Axis, ...]] = ("roll", "pitch", "yaw")
CONVENTIONS: Final[tuple[Convention, ...]] = ("px4", "betaflight", "crazyflie", "paper")
LAYOUTS: Final = {
    4: ("quad-x", "quad-plus"),
    6: ("hexa-x", "hexa-plus"),
    8: ("octo-x", "octo-plus", "octo-coax-x"),
}
PROSPECT: Final[dict[Verdict, Prospect]] = {
    "identified": "well",
    "weak": "roughly",
    "not-identified": "not",
}
LAGS: Final = (0.01, 0.02, 0.035, 0.05, 0.065, 0.08, 0.1, 0.13)
"""Of commanded motors, tried one by one [s]."""
CLEAR: Final = 0.4
"""Share of roll and pitch that a motor order must explain before it is named."""
LEAST_YAW: Final = 0.1
"""Share of yaw that the spins must explain before they are believed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """How one axis was moved.

    Attributes
    ----------
    turning
        Deviation of the angular acceleration below 15 Hz [rad/s^2].
    rho
        Power of the angular acceleration that the rotors explain over the rest, where a pilot
        flies: what limits an estimate, and seen as that sees it.
    width
        Half of the 95 % interval to be expected, over the value: of Ixx, Iyy, kd / Izz. None where
        nothing bounds it.
    """

    axis: Axis
    turning: float
    rho: float
    width: float | None

    @property
    def prospect(self) -> Prospect:
        """How well its number can be found: the verdict that an estimate would have."""
        return _prospect(self.width, axis=self.axis, excitation=self.rho)


@dataclass(frozen=True, slots=True, kw_only=True)
class Thrust:
    """How the thrust was moved, and what carries the weight.

    Attributes
    ----------
    change
        Deviation of the thrust over its mean.
    from_changes, from_weight
        kt per kilogram by changes of thrust and by the weight; None where no stretch is long enough
        for the weight.
    agree
        Whether the two are one number within what an estimate allows them.
    width
        Half of the 95 % interval to be expected, over the value; None where nothing bounds it.
    followed
        Whether the vehicle turns with the motor data at all: else commands may be no rotor speeds.
    """

    change: float
    from_changes: float
    from_weight: float | None
    agree: bool
    width: float | None
    followed: bool

    @property
    def prospect(self) -> Prospect:
        """How well kt can be found."""
        found = _prospect(self.width, axis="force")
        return "roughly" if found == "well" and not self.followed else found


@dataclass(frozen=True, slots=True, kw_only=True)
class Prospects:
    """What a flight can show.

    Attributes
    ----------
    excitation
        Of roll, pitch and yaw.
    thrust
        Of all rotors together.
    commanded
        Whether commands stand for the rotor speeds.
    motors
        The layout and order whose motors explain the motion, in words; None where none does.
    """

    excitation: tuple[Excitation, ...]
    thrust: Thrust
    commanded: bool
    motors: str | None


def _prospect(width: float | None, *, axis: str, excitation: float | None = None) -> Prospect:
    half_width = np.inf if width is None else width
    found = judge(1.0, half_width, scale=0.0, axis=axis, excitation=excitation)
    return PROSPECT[found.verdict]


def prospects(
    prepared: PreparedFlight, motors: MotorResponse | None = None, *, commanded: bool = False
) -> Prospects:
    """Return what a prepared flight can show, whatever its airframe.

    By the rows of an estimate, with the rotors of a usual layout where one is borne out, else with
    rotors as the flight itself places them: excitation is then the estimate's own.

    Parameters
    ----------
    prepared
        The flight.
    motors
        How late the motors do what their data say; None leaves the flight as it was prepared.
    commanded
        Whether its rotor speeds are commands, whose lag is looked for, then.

    Raises
    ------
    FlightError
        If the flight is too short.
    EstimationError
        If it does not move its rotors at all.
    """
    if commanded and motors is None:
        motors = MotorResponse(lag=LAG_PRIOR[0])
    timed = replace(prepared, data=retimed(prepared, motors))
    stand_in = _stand_in(timed.data.rotor_speed.shape[1])
    known = likely_motors(_factors(timed, stand_in), stand_in)
    vehicle = _guessed(timed) if known is None else known[0]
    model = regressor(vehicle)
    if commanded and motors is not None:
        best = _best_lag(prepared, vehicle, model, motors)
        # At the shortest the autopilot answers its gyro's noise: an estimate keeps to the usual.
        motors = best if best.lag > LAGS[0] else motors
        timed = replace(prepared, data=retimed(prepared, motors))
    fits = fit_rows(_factors(timed, vehicle), model, mass=1.0)
    followed = max(fits.excitation["roll"], fits.excitation["pitch"]) > NO_EXCITATION
    thrust = _thrust(timed.data, vehicle, fits, followed=followed or not commanded)
    return Prospects(
        excitation=tuple(
            Excitation(
                axis=axis,
                turning=size,
                rho=fits.excitation[axis],
                width=_width(axis, fits, thrust),
            )
            for axis, size in zip(AXES, _turning(timed.data), strict=True)
        ),
        thrust=thrust,
        commanded=commanded,
        motors=None if known is None else known[1],
    )


def _guessed(prepared: PreparedFlight) -> Vehicle:
    """Return the rotors that explain the turns best, where no usual layout does."""
    likely = guessed_vehicles(prepared.data)
    if len(likely) == 1:
        return likely[0]
    return max(likely, key=lambda vehicle: _likelihood(prepared, vehicle, regressor(vehicle)))


def _best_lag(
    prepared: PreparedFlight, vehicle: Vehicle, model: Regressor, motors: MotorResponse
) -> MotorResponse:
    """Return the lag with which commands explain the turns best, where a pilot flies."""
    return max(
        (replace(motors, lag=lag) for lag in LAGS),
        key=lambda at: _likelihood(replace(prepared, data=retimed(prepared, at)), vehicle, model),
    )


def _likelihood(prepared: PreparedFlight, vehicle: Vehicle, model: Regressor) -> float:
    """Return the log-likelihood of the turns, where a pilot flies."""
    factors = _factors(prepared, vehicle)
    return angular_log_likelihood(factors, model, mass=1.0, counted=slow_bands(factors))


def _thrust(data: FlightData, vehicle: Vehicle, fits: RowFits, *, followed: bool) -> Thrust:
    """Return what changes of thrust and the weight say of kt."""
    rows = data.used_rows
    kt, random = _with_width(fits, "force.kt")
    weighed = _weighed(data, vehicle)
    agree = weighed is None or not weighed.contradicts(kt, random / 1.96)
    width = _relative(random, kt)
    if weighed is not None and not agree:
        # An estimate then takes the weight's, and its interval holds both.
        width = _relative(abs(kt - weighed.kt) + random, weighed.kt)
    return Thrust(
        change=_thrust_change(data, rows),
        from_changes=kt,
        from_weight=None if weighed is None else weighed.kt,
        agree=agree,
        width=_finite(width),
        followed=followed,
    )


def _weighed(data: FlightData, vehicle: Vehicle) -> WeighedThrust | None:
    """Return the kt per kilogram that carries the weight; None where no stretch is long enough."""
    held = held_up(turning(data), data.rotor_speed**2 @ vehicle.axes)
    if held is None or held.ratio <= 0:
        return None
    kt = 1.0 / held.ratio
    return WeighedThrust(kt=kt, std=kt * float(np.hypot(held.std, INFLOW_STD)))


def _width(axis: Axis, fits: RowFits, thrust: Thrust) -> float | None:
    """Return the half-width to be expected of the number of an axis, over its value."""
    name = {"roll": "Ixx", "pitch": "Iyy", "yaw": "kd_over_Izz"}[axis]
    pull = attenuation_allowance(name, 1.0, fits.excitation[axis], answered=True)
    value, random = _with_width(fits, "yaw.kd" if axis == "yaw" else f"{axis}.kt")
    if axis == "yaw":
        return _finite(float(np.hypot(_relative(random, value), pull)))
    if thrust.width is None:
        return None
    return _finite(float(np.hypot(np.hypot(_relative(random, value), pull), thrust.width)))


def _with_width(fits: RowFits, name: str) -> tuple[float, float]:
    """Return a parameter of the rows and half of its interval, by the bands or by their scatter."""
    i = fits.names.index(name)
    row = fits.fits[name.partition(".")[0]]
    blocks = len(row.variance)
    free = max(blocks - len(row.estimate.names), 1)
    formal = 1.96 * float(np.sqrt(fits.formal[i, i]))
    scatter = float(np.sqrt(fits.covariance[i, i] * blocks / free))
    return float(fits.values[i]), max(formal, float(stats.t.ppf(0.975, free)) * scatter)


def _relative(half_width: float, value: float) -> float:
    """Return a half-width over a value that must be positive to mean anything."""
    return half_width / value if value > 0 else float("inf")


def _finite(width: float) -> float | None:
    return width if np.isfinite(width) else None


def likely_motors(factors: Factors, made_for: Vehicle) -> tuple[Vehicle, str] | None:
    """Return the known layout and motor order that the flight bears out, and its words.

    Parameters
    ----------
    factors, made_for
        Of the flight, and the rotors whose spins are in its signals.
    """
    tried = [
        (response(factors, other, made_for=made_for), other, words)
        for other, words in _known(len(made_for.rotors))
    ]
    found = [one for one in tried if _bears_out(one[0])]
    if not found:
        return None
    best, vehicle, words = max(found, key=lambda one: one[0].score)
    return vehicle, words if best.yaw > LEAST_YAW else f"{words} (spins unsure: yaw hardly moves)"


def _bears_out(found: Response) -> bool:
    return found.roll > CLEAR and found.pitch > CLEAR


def _known(rotor_count: int) -> Iterator[tuple[Vehicle, str]]:
    """Yield vehicles of the common layouts and orders, propellers in and out."""
    for layout in LAYOUTS.get(rotor_count, ()):
        for order in CONVENTIONS:
            try:
                rotors = tuple(layout_rotors(layout, arm=0.2, order=order))
            except ExperimentError:
                continue
            name = f'layout = "{layout}", order = "{order}"'
            yield Vehicle(rotors=rotors), name
            turned = tuple(replace(r, spin="cw" if r.spin == "ccw" else "ccw") for r in rotors)
            yield Vehicle(rotors=turned), f"{name} with every spin reversed (list the rotors)"


def _stand_in(rotor_count: int) -> Vehicle:
    """Return rotors on a circle: only their number counts where places are free."""
    angles = 2.0 * np.pi * np.arange(rotor_count) / rotor_count
    return Vehicle(
        rotors=tuple(
            Rotor(
                position=(float(0.2 * np.cos(a)), float(0.2 * np.sin(a)), 0.0),
                spin="ccw" if i % 2 else "cw",
            )
            for i, a in enumerate(angles)
        )
    )


def _factors(prepared: PreparedFlight, vehicle: Vehicle) -> Factors:
    data = replace(prepared.data, segments=prepared.phases)
    top = min(EDGES[-1], 0.4 * prepared.slowest_rate)
    edges = (*(edge for edge in EDGES if edge < top), top)
    return band_factors(data, vehicle, plan=BandPlan(edges=edges, longest=STRETCH))


def _turning(data: FlightData) -> list[float]:
    """Return the deviation of each angular acceleration below 15 Hz [rad/s^2]."""
    parts = [
        smooth(data.angular_acceleration[s.start : s.stop], data.sample_rate, LOOK)
        for s in data.segments
    ]
    return [float(x) for x in np.concatenate(parts).std(axis=0)]


def _thrust_change(data: FlightData, rows: np.ndarray) -> float:
    squares = (data.rotor_speed[rows] ** 2).sum(axis=1)
    return float(squares.std() / squares.mean()) if len(rows) else 0.0
