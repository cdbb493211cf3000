"""From a result and a log to the plant of each axis, with what the flights leave open of it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.digits import with_interval
from rotorfit.errors import EstimationError, LogError
from rotorfit.fit.experiment.declared_vehicle import motor_model_of, vehicle_of
from rotorfit.fit.experiment.experiment import experiment_of_settings
from rotorfit.flight.signals import true_runs
from rotorfit.flight.spectral_density import cross_densities
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.motor_law import speed_from_command
from rotorfit.results.result import is_per_command
from rotorfit.results.samples import about_com, normal_draws
from rotorfit.tools.control_loop.plant import GyroFilter, Plant, from_lag

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from jaxtyping import Bool, Complex, Float

    from rotorfit.logs.controller_log import ControllerLog
    from rotorfit.logs.flight_log import FlightLog
    from rotorfit.results.result import Derived, IdentificationResult, Parameter
    from rotorfit.results.samples import Values
    from rotorfit.tools.control_loop.controllers import RateController
    from rotorfit.tools.control_loop.plant import Response

FLYING = 0.5
"""Share of the median squared speed, above which a vehicle flies."""
LEAST = 5.0
"""Length of flight by which anything can be proved [s]."""
SEGMENT = 1024
"""Samples of the spectra by which the two records of the gyro are compared."""
HIGHEST = 40.0
"""Frequency up to which a smooth response is fitted to them [Hz]; loops cross far below."""
SAME = 0.9
"""Coherence above which they show the filter between them."""
LEAST_VARIANCE = 1e-6
"""Least variance of their ratio in a bin."""
INERTIA = ("Ixx_over_kt", "Iyy_over_kt")
TIMES = ("motor_lag", "motor_delay")


@frozen_dataclass
class Flown:
    """The rows of a controller's log in flight, and the squared speeds that it commanded.

    - `log`: of the controller, flying rows only.
    - `commands`: of each motor, as logged.
    - `squares`: squared speed of each rotor, in the result's units.
    - `free`: whether no motor was at an end of its range.
    - `held`: how long a command holds until the next one of the log [s].
    """

    log: ControllerLog
    commands: Float[np.ndarray, "n N"]
    squares: Float[np.ndarray, "n N"]
    free: Bool[np.ndarray, " n"]
    held: float


def flown(log: FlightLog, controller: ControllerLog, result: IdentificationResult) -> Flown:
    """Select the rows in flight, with the squared speeds that were commanded."""
    motors = experiment_of_settings(result.settings).motors
    command = log.channels.get("command")
    if command is None or motors.speed != "commanded":
        raise LogError(
            f"{log.path}: the loop goes through the motors' commands: identify with [motors] speed "
            '= "commanded" from a log that has them, and give that result'
        )
    law = motor_model_of(motors).law
    values = command.values
    if law is not None:
        battery = log.channels.get("battery")
        volts = (
            None
            if battery is None
            else np.interp(command.time, battery.time, battery.values[:, 0])[:, None]
        )
        values = speed_from_command(values, law, battery=volts)
    # The mixer runs behind the controller: its command is the first one from then on.
    row = np.searchsorted(command.time, controller.time - 0.1 * controller.period)
    row_of = np.minimum(row, len(values) - 1)
    squares = values[row_of] ** 2
    mean = squares.mean(axis=1)
    flying = (mean > FLYING * np.median(mean)) & (row < len(values))
    flying &= np.isfinite(squares).all(axis=1)
    begin, end = _longest_flight(flying)
    if (end - begin) * controller.period < LEAST:
        raise LogError(
            f"{log.path}: {(end - begin) * controller.period:.1f} s of flight are too short to "
            "prove a loop: fly 30 s of quick roll and pitch steps"
        )
    rows = slice(begin, end)
    return Flown(
        log=replace(
            controller,
            time=controller.time[rows],
            set_point=controller.set_point[rows],
            rate=controller.rate[rows],
            output=controller.output[rows],
            slope=None if controller.slope is None else controller.slope[rows],
        ),
        commands=command.values[row_of][rows],
        squares=squares[rows],
        free=_between_ends(command.values[row_of][rows]),
        held=float(np.median(np.diff(command.time))),
    )


def _between_ends(commands: Float[np.ndarray, "n N"]) -> Bool[np.ndarray, " n"]:
    """Find the rows in which no motor is at an end of the range that was flown."""
    # A motor's limit is met again and again; without one this leaves out a row or two.
    return ((commands > commands.min()) & (commands < commands.max())).all(axis=1)


def _longest_flight(flying: np.ndarray) -> tuple[int, int]:
    runs = true_runs(flying)
    if not runs:
        raise LogError("no flight is in the log: the motors never ran")
    return max(runs, key=lambda run: run[1] - run[0])


def _measure_mixing(flight: Flown) -> Float[np.ndarray, "5 N"]:
    """Measure each rotor's squared speed by the three outputs, the mean square, and a constant."""
    # At an end of its range a motor follows the output no more.
    output, squares = flight.log.output[flight.free], flight.squares[flight.free]
    columns = np.column_stack([output, squares.mean(axis=1), np.ones(len(output))])
    found, *_ = np.linalg.lstsq(columns, squares, rcond=None)
    return found


def mix(flight: Flown) -> Float[np.ndarray, "3 N"]:
    """Measure the change of each rotor's squared speed by the output of each axis."""
    return _measure_mixing(flight)[:3]


def withheld_output(flight: Flown) -> Float[np.ndarray, "n 3"]:
    """Compute what motors at an end of their range add to the output of each axis."""
    found = _measure_mixing(flight)
    put_out = (flight.squares - found[4]) @ np.linalg.pinv(found[:4])[:, :3]
    return np.where(flight.free[:, None], 0.0, put_out - flight.log.output)


def plant(
    result: IdentificationResult,
    owner: str,
    flight: Flown,
    *,
    axis: int,
    period: float,
    draws: int,
    seed: int = 0,
) -> Plant:
    """Build one axis of the vehicle, and draws of it within the result's uncertainty.

    Raises `EstimationError` if the result does not know the axis.
    """
    drawn = _draw_together(result, owner, draws, seed)
    torque = _torque_per_output(result, owner, flight, axis)
    if axis == 2:
        gain = torque * _draw_ratio(result, "kd_over_Izz", owner, drawn)
        damping = np.zeros_like(gain)
    else:
        moment = _draw_ratio(result, INERTIA[axis], owner, drawn)
        gain = torque / moment
        damping = _read_damping(result, owner, axis) / moment
    lag, delay = _draw_times(result, drawn)
    # Identified with commands that hold until the next one of the log; in flight, to the next run.
    # Without a lag, the mean lateness of what holds is in the delay that is found.
    lagless = any(p.name == "motor_lag" and p.value == 0.0 for p in result.parameters)
    held = 0.0 if lagless else flight.held
    delay = delay + 0.5 * (held - period)
    lag, delay = from_lag(lag, delay)
    return Plant(gain=gain, damping=damping, lag=lag, delay=delay)


def _torque_per_output(result: IdentificationResult, owner: str, flight: Flown, axis: int) -> float:
    """Compute the torque over k_t (or k_d, about z) per output, with the arms about the CoM."""
    experiment = experiment_of_settings(result.settings)
    vehicle = vehicle_of(experiment.airframe, experiment.identification.source)
    factors = mix(flight)[axis]
    if axis == 2:
        return float(-vehicle.spins @ factors)
    other = 1 - axis
    place = vehicle.positions[:, other] - _read_value(result, ("com_x", "com_y")[other], owner)
    if vehicle.imu_position is None:
        name = ("rotor_center_x", "rotor_center_y")[other]
        place = place + _read_value(result, name, owner)
    kt = _read_value(result, "kt", None) or 1.0
    share = [(_read_value(result, f"kt_{i + 1}", None) or kt) / kt for i in range(len(factors))]
    return float((place if axis == 0 else -place) @ (share * factors))


def _read_damping(result: IdentificationResult, owner: str, axis: int) -> float:
    """Read the damping of a turn over k_t; 0 if the model has none."""
    kt = _read_value(result, "kt", None)
    return _read_value(result, f"turn_damping_{'xy'[axis]}", owner) / kt if kt else 0.0


def _read_value(result: IdentificationResult, name: str, owner: str | None) -> float:
    """Read a number; 0 if the result has none."""
    for number in (*result.parameters, *result.derived):
        if number.name == name and number.configuration in (None, owner):
            return number.value or 0.0
    return 0.0


def _draw_together(result: IdentificationResult, owner: str, draws: int, seed: int) -> Values:
    """Draw a configuration's numbers together with the motors' times, the nominal ones first."""
    random = np.random.default_rng(seed)
    shift = np.zeros((1 + draws, len(result.covariance_names)))
    shift[1:] = normal_draws(result.covariance, draws, random)
    columns = {name: i for i, name in enumerate(result.covariance_names)}
    values: Values = {"mass": np.full(1 + draws, _read_value(result, "mass", owner) or 1.0)}
    for p in result.parameters:
        if p.configuration not in (None, owner) or p.value is None:
            continue
        if p.full_name in columns:
            values[p.name] = p.value + shift[:, columns[p.full_name]]
        elif p.std:
            values[p.name] = p.value + np.r_[0.0, p.std * random.standard_normal(draws)]
    return about_com(values)


RATIOS = {
    "Ixx_over_kt": ("Ixx_com", "kt"),
    "Iyy_over_kt": ("Iyy_com", "kt"),
    "kd_over_Izz": ("kd", "Izz_com"),
}


def _advice_for(result: IdentificationResult, parts: tuple[str, str], owner: str) -> str:
    """State what a result advises for the moment of inertia of a ratio."""
    names = [part.removesuffix("_com") for part in parts]
    found = (p.advice for p in result.parameters if p.name in names and p.configuration == owner)
    return next((one for one in found if one), "fly the axis briskly")


def _draw_ratio(
    result: IdentificationResult, name: str, owner: str, drawn: Values
) -> Float[np.ndarray, " D"]:
    """Draw a ratio: as wide as its interval, together with the others as the numbers in it are."""
    number = next((d for d in result.derived if d.name == name and d.configuration == owner), None)
    parts = [drawn.get(part) for part in RATIOS[name]]
    if number is None or number.value is None or number.interval is None:
        raise EstimationError(
            f"{name} of configuration {owner} is not known from these flights: the loop of that "
            f"axis has no gain; {_advice_for(result, RATIOS[name], owner)}, and identify again"
        )
    above, below = parts
    if above is None or below is None:
        return np.full_like(drawn["mass"], number.value)
    ratio = above / below
    off = ratio / ratio[0] - 1.0
    half = 0.5 * (number.interval[1] - number.interval[0])
    wide = half / 1.96 / abs(number.value) / max(float(off[1:].std()), np.finfo(float).tiny)
    return number.value * (1.0 + wide * off)


def _draw_times(
    result: IdentificationResult, drawn: Values
) -> tuple[Float[np.ndarray, " D"], Float[np.ndarray, " D"]]:
    """Draw lag and delay [s]."""
    lag = _read_value(result, "motor_lag", None)
    if not any(p.name == "motor_lag" and p.value is not None for p in result.parameters):
        raise EstimationError(
            "the motor lag is not known from these flights: nobody can say how late the loop is; "
            "fly roll and pitch briskly and identify again"
        )
    still = np.zeros_like(drawn["mass"])
    delay = drawn.get("motor_delay", still + _read_value(result, "motor_delay", None))
    return np.maximum(drawn.get("motor_lag", still + lag), 0.0), delay


def known_words(result: IdentificationResult, owner: str) -> str:
    """State what a result knows of the loop without its controller: effectiveness and delays."""
    per_command = is_per_command(result.parameters)
    found = [
        *(_effect_text(number, per_command=per_command) for number in result.derived
          if number.name in RATIOS and number.configuration == owner),
        *(_in_milliseconds(p) for p in result.parameters if p.name in TIMES),
    ]  # fmt: skip
    words = ", ".join(word for word in found if word)
    if not words:
        return "The result knows neither effectiveness nor delays: fly roll and pitch briskly"
    return f"Known of the loop: {words}"


def _in_milliseconds(time: Parameter) -> str:
    """Write a motor's lag or delay; nothing if it is not known."""
    if time.value is None:
        return ""
    ends = None if time.interval is None else (1e3 * time.interval[0], 1e3 * time.interval[1])
    return f"{time.name} {with_interval(1e3 * time.value, ends)} ms"


def _effect_text(number: Derived, *, per_command: bool) -> str:
    """Write an effectiveness, kt / I or kd / I; nothing if it is not known."""
    if not number.value or number.interval is None:
        return ""
    low, high = number.interval
    if number.name in INERTIA:
        if low <= 0.0:
            return ""
        name, value, low, high = f"kt / {number.name[:3]}", 1.0 / number.value, 1 / high, 1 / low
        unit = "1/(m s^2) per squared command" if per_command else "1/(m rad^2)"
    else:
        name, value, unit = "kd / Izz", number.value, number.unit
    return f"{name} {with_interval(value, (low, high))} {unit}"


def controller_response(
    log: FlightLog,
    flight: Flown,
    controller: RateController,
    axis: int,
) -> Callable[[Float[np.ndarray, " f"]], Response]:
    """Measure the response of the controller's rate to the gyro that identified the vehicle.

    Returns the response as a function of frequency [Hz]: the filters of the controller, times what
    they leave of the ratio of the two records: a delay (their stamps differ), and a size that falls
    or grows with the frequency squared (a record that is a mean over its period).
    """
    gyro, rows = log.channels["gyro"], flight.log
    at = np.arange(rows.time[0], rows.time[-1], rows.period)
    one = np.interp(at, gyro.time, gyro.values[:, axis])
    two = np.interp(at, rows.time, rows.rate[:, axis])
    grid, spectra = cross_spectra([one, two], rows.period, SEGMENT)
    cross, power, rate_power = spectra[0, 1], np.real(spectra[0, 0]), np.real(spectra[1, 1])
    same = np.abs(cross) ** 2 / np.maximum(power * rate_power, np.finfo(float).tiny)
    used = (same > SAME) & (grid > 0.0) & (grid < HIGHEST)
    if not used.any():
        raise LogError(
            f"{log.path}: the gyro and the rate that the controller heard are not of one flight"
        )
    at_bins, same = grid[used], same[used]
    expected = controller.gyro_response(at_bins) / recorded_through(log, at_bins)
    late, growth = left_of_filters(at_bins, cross[used] / power[used] / expected, same)

    def respond(frequency: Float[np.ndarray, " f"]) -> Response:
        grown = np.exp(growth * np.minimum(frequency, at_bins[-1]) ** 2)
        return controller.gyro_response(frequency) * grown * np.exp(-2j * np.pi * frequency * late)

    return respond


def recorded_through(
    log: FlightLog, frequency: Float[np.ndarray, " f"]
) -> Complex[np.ndarray, " f"]:
    """Compute the response of the low-pass that the logged samples went through on board."""
    if log.gyro_lowpass is None:
        return np.ones(len(frequency), dtype=complex)
    return GyroFilter(frequency=log.gyro_lowpass, order=2).response(frequency)


def left_of_filters(
    frequency: Float[np.ndarray, " b"],
    left: Complex[np.ndarray, " b"],
    coherence: Float[np.ndarray, " b"],
) -> tuple[float, float]:
    """Fit a delay [s] and a growth with the frequency squared [s^2] to a measured response."""
    chance = (1.0 - coherence) / (2.0 * coherence) + LEAST_VARIANCE
    # Noise in the first record makes its size too small by up to the coherence: half of that, give
    # or take as much.
    bias = -0.5 * np.log(coherence)
    turn = 2.0 * np.pi * frequency / chance
    late = -(turn @ np.angle(left)) / (turn @ (2.0 * np.pi * frequency))
    square = frequency**2 / (chance + bias**2)
    growth = (square @ (np.log(np.abs(left)) + bias)) / (square @ frequency**2)
    return float(late), float(growth)


def cross_spectra(
    records: Sequence[Float[np.ndarray, " n"]], period: float, length: int
) -> tuple[Float[np.ndarray, " b"], Complex[np.ndarray, "R R b"]]:
    """Compute frequencies [Hz] and the cross-spectra of all pairs of records."""
    return cross_densities(np.stack(records, axis=1), 1.0 / period, length)
