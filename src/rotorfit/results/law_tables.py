"""Tabulate the fitted law of the motors: numbers, verdicts, points of a picture."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rotorfit.checks.verdicts.judge import judge
from rotorfit.checks.verdicts.parameters import found_time
from rotorfit.errors import EstimationError
from rotorfit.estimation.measured import Measured
from rotorfit.findings import note
from rotorfit.fit.intervals.interval_terms import NumberTerm
from rotorfit.fit.motor_law.command_response import Recording, respond_to_commands
from rotorfit.fit.motor_law.fit_law import LawFromSpeeds, bounded_recording, fit_law
from rotorfit.fit.motor_law.law_model import law_of, scales_of, timing_of
from rotorfit.fit.reduction.motor_timing import is_time_identifiable
from rotorfit.flight.flight_checks import LEAST_RATE
from rotorfit.flight.motors.motor_model import (
    ThrustCurve,
    betaflight_linear,
    speeds,
    thrust_curve,
)
from rotorfit.logs.motor_law import MotorLaw, PowerCurve, SquareRootCurve
from rotorfit.model.parameters import PARAMETERS, ROW_ORDER
from rotorfit.results.command_law import USUAL_EXPONENT, CommandLaw, LawNumber, LawPoint
from rotorfit.results.result import Parameter

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.fit.dataset.dataset import Dataset
    from rotorfit.fit.motor_law.form_fit import FormFit
    from rotorfit.results.tables import ResultTables

    Vector = Float[np.ndarray, " p"]

ESTIMATOR: Final = (
    "least squares of the measured speeds over lag, delay and law together, glitches counting "
    "less; the form by its error on blocks of 1 s left out; intervals by a jackknife over blocks "
    "of 0.5 to 8 s, the widest (CR3, Bell and McCaffrey 2002), those of full speed and thrust "
    "reaching to every form that does as well"
)
SEEN: Final = (0.1, 99.9)
"""Percentiles of the commands between which the law was seen."""
POINTS: Final = 16
FEWEST_IN_POINT: Final = 20
SURE_LAG: Final = 0.05
"""Of the lag: a deviation that stands for what the next flight may differ in, at least."""
LEAST_EXPONENT: Final = 1e-3
"""That a law is given, where an autopilot makes up for the battery."""
CHARGE: Final = 0.034
"""Deviation of the voltage between flights that begin at any charge, as a share: a lithium cell
that carries a vehicle gives 3.6 to 4.05 V."""
USUAL_FLIGHTS: Final = 2.0
"""As many flights tell how far speeds at one command differ as is known before."""
NEAR: Final = 0.05
"""To either side of a command, as a share of it, where the slope of a law is taken."""
ONE_CHARGE: Final = (
    "the motors' law (command_law) holds for the battery charge of this flight, and on others its "
    "speeds to +-{percent:.0f} %: {why}; log it to get a law for any charge"
)
NO_VOLTAGE: Final = "the log has no voltage"
SOME_VOLTAGE: Final = "not every log has the battery's voltage"
STILL_VOLTAGE: Final = "the log's voltage stands still, as if none were measured"
USUAL_VOLTAGE: Final = (
    "the log's voltage hardly changes, or says little of the speeds: the motors' law (command_law) "
    "holds at {nominal:.3g} V, and at others its speeds go with the voltage to the power of "
    "{exponent:.2f} +- {half:.2f}, as motors usually do; fly until the battery sags to measure it"
)


def add_motor_law(
    tables: ResultTables, dataset: Dataset, report: Callable[[str], None]
) -> ResultTables:
    """Fit the motors' law, where the log has commands and measured speeds."""
    responses = [f.command_responses for f in dataset.flights]
    recording = bounded_recording(responses)
    if recording is None:
        return tables
    report("fitting the motors' law to commands and speeds")
    try:
        fitted = fit_law(recording)
    except EstimationError as error:
        sentence = f"no law from command to rotor speed was found: {error}"
        return tables.found(note("no-motor-law", sentence))
    law, parameters = law_tables(fitted, len(dataset.vehicle.rotors))
    why = _no_exponent(recording, [f.battery for f in dataset.flights])
    return with_law(tables, parameters, law, why=why)


def _no_exponent(recording: Recording, voltages: Sequence[float | None]) -> str:
    """Explain why a law has no battery voltage, in flights of these mean voltages [V]."""
    if recording.nominal_voltage is not None:
        return STILL_VOLTAGE
    return NO_VOLTAGE if all(volts is None for volts in voltages) else SOME_VOLTAGE


def law_tables(fitted: LawFromSpeeds, rotor_count: int) -> tuple[CommandLaw, tuple[Parameter, ...]]:
    """Tabulate the law of the motors, and the parameters that it gives.

    Some of the `rotor_count` rotors may have had no speeds to fit.
    """
    times = _found_times(fitted)
    full, half = fitted.number(_full_speed)
    verdict = judge(full, half, scale=0.0, axis="force")
    known = verdict.verdict != "not-identified"
    speed = Parameter(
        name="max_speed",
        configuration=None,
        value=full if known else None,
        std=half / 1.96 if known else None,
        interval=(max(full - half, 0.0), full + half) if known else None,
        unit=PARAMETERS["max_speed"].unit,
        verdict=verdict.verdict,
        reason=verdict.reason,
        advice=verdict.advice,
        asks=verdict.asks,
        interval_terms=(full_speed_term(half),) if known else (),
    )
    return _command_law(fitted, rotor_count, known=known, times=times), (*times, speed)


def with_law(
    tables: ResultTables,
    parameters: tuple[Parameter, ...],
    law: CommandLaw,
    *,
    why: str = NO_VOLTAGE,
) -> ResultTables:
    """Add the motors' law and its parameters to a result; `why` a law has no voltage."""
    there = {p.name for p in tables.parameters}
    every = [*tables.parameters, *(p for p in parameters if p.name not in there)]
    shared = [p for p in every if p.configuration is None]
    shared.sort(key=lambda p: ROW_ORDER.index(p.name))
    own = [p for p in every if p.configuration is not None]
    tables = replace(tables, parameters=(*shared, *own), command_law=law)
    if law.nominal_voltage is not None or not law.motors:
        return tables
    return tables.found(note("law-without-voltage", _of_one_charge(law.motors["law"], why)))


def _of_one_charge(entry: Mapping[str, Any], why: str) -> str:
    """Explain how a law holds that has no exponent of the voltage by its own flights."""
    voltage = entry.get("voltage")
    if voltage is None:
        return ONE_CHARGE.format(percent=196.0 * entry["speed_std"], why=why)
    half = 1.96 * voltage["exponent_std"]
    exponent, nominal = voltage["exponent"], voltage["nominal"]
    return USUAL_VOLTAGE.format(nominal=nominal, exponent=exponent, half=half)


def full_speed_term(half: float) -> NumberTerm:
    """Return the interval term of a speed at full command, or of what is proportional to it."""
    source = "the motors' law between the commands that were flown and full command"
    return NumberTerm(name="full speed", half_width=half, source=source)


def _full_speed(fit: FormFit, x: Vector) -> float:
    return float(np.exp(x[0]))


def _found_times(fitted: LawFromSpeeds) -> tuple[Parameter, ...]:
    """Return lag and delay with their intervals."""
    two_way = fitted.best.layout.two_way
    of = {"motor_lag": _mean_lag} | (
        {"motor_lag_up": _rising_lag, "motor_lag_down": _falling_lag} if two_way else {}
    )
    found = {name: fitted.number(lag) for name, lag in of.items()}
    delay, half = fitted.number(_delay_at)
    # Of a faster loop the log keeps some commands: those between may be half a step older.
    step = float(np.median(np.diff(fitted.recording.command_time)))
    found["command_delay"] = delay, half + 0.5 * step
    times = (found_time(name, value, half / 1.96) for name, (value, half) in found.items())
    slow = _slow_words(fitted.recording)
    return tuple(times) if slow is None else tuple(_without_time(time, slow) for time in times)


def _slow_words(recording: Recording) -> str | None:
    """State which of commands and speeds are too slow to time the motors; None if neither is."""
    steps = {
        "commands": np.diff(recording.command_time),
        "rotor speeds": np.diff(recording.time),
    }
    rates = {name: 1.0 / float(np.median(step[step > 0.0])) for name, step in steps.items()}
    slowest = min(rates, key=lambda name: rates[name])
    if rates[slowest] >= LEAST_RATE:
        return None
    return f"{slowest} at {rates[slowest]:.0f} Hz are too slow to time the motors"


def _without_time(time: Parameter, reason: str) -> Parameter:
    """Withhold a time that a slow log does not show."""
    # What to set in the log is the finding of a slow log.
    return replace(
        time,
        value=None,
        std=None,
        interval=None,
        verdict="not-identified",
        reason=reason,
        advice=None,
        asks=None,
    )


def _rising_lag(fit: FormFit, x: Vector) -> float:
    return float(np.exp(timing_of(fit.layout, x).log_lag))


def _falling_lag(fit: FormFit, x: Vector) -> float:
    timing = timing_of(fit.layout, x)
    return float(np.exp(timing.log_lag + timing.log_ratio))


def _delay_at(fit: FormFit, x: Vector) -> float:
    return timing_of(fit.layout, x).delay


def _mean_lag(fit: FormFit, x: Vector) -> float:
    return 0.5 * (_rising_lag(fit, x) + _falling_lag(fit, x))


def _command_law(
    fitted: LawFromSpeeds, rotor_count: int, *, known: bool, times: tuple[Parameter, ...]
) -> CommandLaw:
    best, recording = fitted.best, fitted.recording
    layout = best.layout
    numbers = [_law_number("full_speed", fitted.number(_full_speed), "rad/s")]
    names = {"sqrt": ("thr_mdl_fac",), "linear": ("offset",), "power": ("exponent",)}
    own = names.get(layout.form, ("offset", "exponent"))
    numbers += [
        _law_number(name, fitted.own(layout.curve.start + i), "1") for i, name in enumerate(own)
    ]
    if layout.voltage:
        numbers.append(_law_number("voltage_exponent", fitted.own(layout.exponent), "1"))
    for name, of in (("thrust_factor", thrust_curve), ("thrust_linear", betaflight_linear)):
        numbers.append(_law_number(name, fitted.number(_curve_factor(recording, of)), "1"))
    factors: list[float | None] = [None] * rotor_count
    rotors, _ = scales_of(layout, best.values)
    for i, factor in zip(recording.rotors, rotors.tolist(), strict=True):
        factors[i] = factor
    low, high = np.percentile(recording.command, SEEN).tolist()
    return CommandLaw(
        form=layout.form,
        numbers=tuple(numbers),
        nominal_voltage=recording.nominal_voltage if layout.voltage else None,
        known=known,
        commands=(low, high),
        relative_error=float(np.sqrt(np.mean((recording.speed / best.speed - 1.0) ** 2))),
        held_out={fit.layout.form: fit.error for fit in (best, *fitted.others)},
        rotor_factors=tuple(factors),
        points=_bin_points(recording, best),
        motors=_motors_table(fitted, times) if known else {},
        estimator=ESTIMATOR,
    )


def _curve_factor(
    recording: Recording, curve: Callable[[MotorLaw], ThrustCurve]
) -> Callable[[FormFit, Vector], float]:
    """Return the factor of a curve of thrust as a function of a fit and its parameters."""
    return lambda fit, x: curve(law_of(recording, fit.layout, x)).factor


def _law_number(name: str, number: tuple[float, float], unit: str) -> LawNumber:
    value, half = number
    return LawNumber(name=name, value=value, interval=(value - half, value + half), unit=unit)


def _motors_table(fitted: LawFromSpeeds, times: tuple[Parameter, ...]) -> dict[str, Any]:
    """Return the table ``[motors]`` of the vehicle for flights without measured speeds."""
    law = fitted.law
    entry: dict[str, Any] = {}
    match law.curve:
        case PowerCurve(full_speed, offset, exponent):
            entry["power"] = {
                "full_speed": _round_value(full_speed),
                "offset": _round_value(offset),
                "exponent": _round_value(exponent),
            }
        case SquareRootCurve(full_speed, factor):
            entry["sqrt"] = {
                "full_speed": _round_value(full_speed),
                "thr_mdl_fac": _round_value(factor),
            }
        case _:
            raise TypeError(f"no entry for {law.curve}")
    voltage = _voltage_table(fitted)
    if voltage is not None:
        entry["voltage"] = voltage
    entry |= _law_deviations(fitted, of_one_charge=voltage is None)
    table: dict[str, Any] = {"speed": "commanded", "law": entry}
    lag = next(p for p in times if p.name == "motor_lag")
    if lag.value is not None and lag.std is not None and is_time_identifiable(lag.value, lag.std):
        table["lag"] = _round_value(lag.value)
        table["lag_std"] = _round_value(max(lag.std, SURE_LAG * lag.value))
    if fitted.best.layout.on_thrust:
        table["lag_on"] = "thrust"
    return table


def _voltage_table(fitted: LawFromSpeeds) -> dict[str, float] | None:
    """Return the battery's share of a law, by its flights and by what is usual; None if unknown."""
    nominal, volts = fitted.recording.nominal_voltage, fitted.recording.voltage
    if nominal is None or volts is None or not nominal > 0.0 or float(np.ptp(volts)) == 0.0:
        return None
    exponent = voltage_exponent(fitted.voltage_exponent)
    entry = {
        "nominal": nominal,
        "exponent": min(max(exponent.value, LEAST_EXPONENT), 3.0),
        "exponent_std": exponent.std,
        "missing_std": charge_std(np.zeros(1), exponent.value),
    }
    return {name: _round_value(value) for name, value in entry.items()}


def voltage_exponent(found: tuple[float, float] | None) -> Measured:
    """Weigh the exponent that flights tell, with half of its interval, against the usual one."""
    if found is None:
        return USUAL_EXPONENT
    own = Measured(value=found[0], std=found[1] / 1.96)
    # Where they differ by more than their deviations allow, that of the mean grows with it (Birge).
    return USUAL_EXPONENT.reconciled_with(own)


def charge_std(factors: Vector, exponent: float = USUAL_EXPONENT.value) -> float:
    """Return the deviation, as a share, of another flight's speed at the law's command.

    `factors`: logarithms of what each flight's speeds are of the law's. The variance between
    flights is that of usual charges, and that of these flights.
    """
    flights = len(factors)
    usual = (exponent * CHARGE) ** 2
    seen = float(factors @ factors)
    variance = (USUAL_FLIGHTS * usual + seen) / (USUAL_FLIGHTS + flights - 1)
    return float(np.sqrt(variance * (1.0 + 1.0 / flights)))


def _law_deviations(fitted: LawFromSpeeds, *, of_one_charge: bool) -> dict[str, float]:
    """Return the deviations of the law's speed and slope, as shares, at the usual command."""
    recording = fitted.recording
    usual = float(np.median(recording.command))
    around = usual * (1.0 + NEAR * np.array([-1.0, 0.0, 1.0]))

    def logarithms(fit: FormFit, x: Vector) -> Float[np.ndarray, " s"]:
        return np.log(speeds(law_of(recording, fit.layout, x), around))

    def slope(fit: FormFit, x: Vector) -> float:
        low, _, high = logarithms(fit, x).tolist()
        return (high - low) / (2.0 * NEAR)

    _, speed_half = fitted.number(lambda fit, x: float(logarithms(fit, x)[1]))
    steepness, slope_half = fitted.number(slope)
    _, flights = scales_of(fitted.best.layout, fitted.best.values)
    charge = charge_std(np.log(flights)) if of_one_charge else 0.0
    deviations = {
        "speed_std": min(float(np.hypot(speed_half / 1.96, charge)), 1.0),
        "slope_std": min(slope_half / 1.96 / abs(steepness), 1.0),
        "usual_speed": float(np.exp(logarithms(fitted.best, fitted.best.values)[1])),
    }
    return {name: _round_value(value) for name, value in deviations.items()}


def _round_value(value: float) -> float:
    return float(f"{value:.6g}")


def _bin_points(recording: Recording, fit: FormFit) -> tuple[LawPoint, ...]:
    """Bin the measured speeds by the command that the motors had."""
    command = respond_to_commands(recording, recording.command, fit.timing)
    law = law_of(recording, fit.layout, fit.values)
    steady = respond_to_commands(recording, speeds(law, recording.command), fit.timing)
    speed = recording.speed / fit.speed * steady
    edges = np.linspace(float(command.min()), float(command.max()), POINTS + 1)
    bins = np.clip(np.searchsorted(edges, command, side="right") - 1, 0, POINTS - 1)
    points: list[LawPoint] = []
    for b in range(POINTS):
        rows = bins == b
        if rows.sum() < FEWEST_IN_POINT:
            continue
        low, median, high = np.percentile(speed[rows], [5.0, 50.0, 95.0]).tolist()
        at = float(np.median(command[rows]))
        points.append(LawPoint(command=at, low=low, median=median, high=high))
    return tuple(points)
