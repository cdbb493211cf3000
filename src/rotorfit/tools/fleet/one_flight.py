"""One log by itself, as `rotorfit identify` does, to what the fleet keeps of it."""

from __future__ import annotations

import hashlib
import json
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rotorfit.errors import RotorfitError, RotorfitWarning
from rotorfit.estimation.estimate import numerical_jacobian
from rotorfit.estimation.factors import Factors
from rotorfit.fit.experiment.declared_vehicle import read_options_of, vehicle_of
from rotorfit.fit.experiment.experiment import Experiment, single_flight_experiment
from rotorfit.fit.intervals.numbers import correlation_of
from rotorfit.fit.joint.joint_fit import FittedFactors
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.fit.reduction.motor_timing import FreeTiming
from rotorfit.fit.weight.kt_from_weight import kt_from_weight
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.identification import Identified, identify_flights
from rotorfit.logs.files import sha256_of
from rotorfit.logs.read import read_log
from rotorfit.model.parameters import FIRST_MOMENTS, INERTIA, INERTIA_COM, inertia_about
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.registry import signals_named
from rotorfit.results.result import IdentificationResult, verdict_of
from rotorfit.tools.fleet.records import COMPARED, KT_WEIGHT, TRIM, Entry, FlightRecord, refusal

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.findings import Finding
    from rotorfit.fit.dataset.dataset import Dataset
    from rotorfit.logs.flight_log import FlightLog
    from rotorfit.model.vehicle import Vehicle
    from rotorfit.tools.fleet.listing import FlightTask
    from rotorfit.written_mass import Mass

PART_SECONDS: Final = 2.0
"""Parts of a flight, whose means scatter as the mean of the whole is unsure."""
FEWEST_PARTS: Final = 3
AIRBORNE_SHARE: Final = 0.5
"""Share of the usual thrust under which a sample counts as on the ground, where motors alone are
logged."""
Number = tuple[float, float, float, float, str]
"""Value, standard deviation, ends of the interval, verdict."""
NAN: Final = float("nan")
_FACTORS: Final = ("R", "rows", "segment", "band", "noise", "slopes")


def experiment_of(task: FlightTask) -> Experiment:
    """Declare the experiment that `rotorfit identify LOG --mass --airframe` makes of a log."""
    return single_flight_experiment(
        Path(task.file),
        mass=task.mass,
        airframe=Path(task.airframe),
        log_number=task.log_number,
    )


def fingerprint_of(path: Path) -> str:
    """Return the SHA-256 of a log; of a folder that is a bag, of its files' names and bytes."""
    if not path.is_dir():
        return sha256_of(path)
    parts = [f"{p.name} {sha256_of(p)}" for p in sorted(path.iterdir()) if p.is_file()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def entry_of(experiment: Experiment) -> Entry:
    """Identify one log; a log that cannot be identified is no error here."""
    with warnings.catch_warnings():
        for category in (RotorfitWarning, RuntimeWarning):
            warnings.simplefilter("ignore", category)
        try:
            found = identify_flights(experiment)
            return Entry(
                record=_record_flight(found),
                refusal=None,
                hardware=found.dataset.configurations[0].flights[0].log.circumstances.hardware,
                factors={}
                if found.fit is None
                else factor_arrays(found.fit.factors, found.dataset),
            )
        except RotorfitError as error:
            return _refused_entry(experiment, str(error))
        except Exception as error:  # a fault of ours costs this log, not the fleet
            fault = f"internal error ({type(error).__name__}: {error})"
            return _refused_entry(experiment, f"{fault}; please report it with the log")


def refusal_of(message: str) -> Finding:
    """Split an error's message into the problem and the next step."""
    line = " ".join(message.split())
    for mark in ("; ", ": "):
        reason, found, next_step = line.rpartition(mark)
        if found:
            return refusal("not-identified", reason, next_step)
    return refusal("not-identified", line, "")


def _refused_entry(experiment: Experiment, message: str) -> Entry:
    """Record why a log was not identified, and what its motors show all the same."""
    flight = experiment.configuration[0].flights[0]
    for name in (flight.file, Path(flight.file).name):
        message = message.removeprefix(f"{name}: ")
    reason = refusal_of(message)
    try:
        log = read_log(Path(flight.file), options=read_options_of(flight, experiment.motors))
    except RotorfitError:
        return Entry(record=None, refusal=reason)
    hardware = log.circumstances.hardware
    numbers = _trim_of_log(log, vehicle_of(experiment.airframe))
    if not numbers:
        return Entry(record=None, refusal=reason, hardware=hardware)
    record = replace(
        _record_of_numbers(numbers, log, mass=experiment.configuration[0].mass), refused=message
    )
    return Entry(record=record, refusal=reason, hardware=hardware)


def _record_flight(found: Identified) -> FlightRecord:
    result, configured = found.result, found.dataset.configurations[0]
    flight = configured.flights[0]
    numbers = _numbers_of_result(result)
    weighed = kt_from_weight(
        found.dataset.configurations, found.dataset.vehicle, timing=found.dataset.timing
    )
    if weighed is not None:
        numbers[KT_WEIGHT] = _measured_number(weighed.value, weighed.std)
    data = flight.prepared.data
    numbers |= _trim_numbers(
        [data.rotor_speed[s.start : s.stop] for s in data.segments],
        found.dataset.vehicle,
        rows=round(PART_SECONDS * data.sample_rate),
    )
    compared, covariance = _comparable_covariance(result, numbers)
    return replace(
        _record_of_numbers(numbers, flight.log, mass=configured.entry.mass),
        seconds_used=result.flights[0].seconds_used,
        compared=compared,
        covariance=covariance,
        warnings=(*result.warnings, *result.flights[0].warnings),
        checks=dict(result.diagnostics),
        battery=flight.battery,
    )


def _record_of_numbers(
    numbers: Mapping[str, Number], log: FlightLog, *, mass: Mass
) -> FlightRecord:
    """Return a record of these numbers, each by itself, with the log's circumstances."""
    circumstances = log.circumstances
    columns = np.array([number[:4] for number in numbers.values()], dtype=float)
    compared = _comparable_names(numbers)
    return FlightRecord(
        file="",
        sha256=log.sha256,
        vehicle="",
        configuration="",
        log_number=log.log_number,
        mass=None if mass == "unknown" else mass,
        started=circumstances.started,
        seconds_used=0.0,
        names=tuple(numbers),
        values=columns[:, 0],
        std=columns[:, 1],
        low=columns[:, 2],
        high=columns[:, 3],
        verdicts=tuple(number[4] for number in numbers.values()),
        compared=compared,
        covariance=np.diag([numbers[name][1] ** 2 for name in compared]),
        air_density=circumstances.air_density,
        air_temperature=circumstances.air_temperature,
        air_pressure=circumstances.air_pressure,
    )


def _numbers_of_result(result: IdentificationResult) -> dict[str, Number]:
    found: dict[str, Number] = {}
    for entry in (*result.parameters, *result.derived):
        value, std = (NAN if v is None else v for v in (entry.value, entry.std))
        low, high = entry.interval or (NAN, NAN)
        found[entry.name] = (value, std, low, high, verdict_of(result, entry))
    return found


def _measured_number(value: float, std: float) -> Number:
    """Return a number whose deviation is known, without a verdict."""
    return value, std, value - 1.96 * std, value + 1.96 * std, ""


def _comparable_covariance(
    result: IdentificationResult, numbers: Mapping[str, Number]
) -> tuple[tuple[str, ...], Float[np.ndarray, "c c"]]:
    """Select the numbers that can be compared, and compute their covariance."""
    names = _comparable_names(numbers)
    std = np.array([numbers[name][1] for name in names])
    R = np.eye(len(names))
    propagated, correlation = _propagated_correlation(result, numbers)
    at = [(i, propagated.index(name)) for i, name in enumerate(names) if name in propagated]
    # Numbers that are measured by themselves are independent of the others.
    for i, k in at:
        for j, m in at:
            R[i, j] = 1.0 if i == j else correlation[k, m]
    return names, R * np.outer(std, std)


def _propagated_correlation(
    result: IdentificationResult, numbers: Mapping[str, Number]
) -> tuple[list[str], Float[np.ndarray, "g g"]]:
    """Propagate the parameters' correlation to the numbers that follow from them."""
    bases = [name.partition("@")[0] for name in result.covariance_names]
    if not bases:
        return [], np.zeros((0, 0))
    values = np.array([numbers[base][0] for base in bases])
    mass = numbers["mass"][0] if np.isfinite(numbers["mass"][0]) else 1.0
    jacobian = numerical_jacobian(
        lambda at: np.array(list(_from_parameters(bases, at, mass).values())),
        values,
        np.sqrt(np.diagonal(result.covariance)),
    )
    correlation = correlation_of(jacobian @ result.covariance @ jacobian.T)
    return list(_from_parameters(bases, values, mass)), correlation


def _comparable_names(numbers: Mapping[str, Number]) -> tuple[str, ...]:
    return tuple(n for n in COMPARED if n in numbers and np.isfinite(numbers[n][:2]).all())


def _from_parameters(
    bases: Sequence[str], values: Float[np.ndarray, " p"], mass: float
) -> dict[str, float]:
    """Compute the numbers that are compared from parameters with a covariance."""
    p = dict(zip(bases, values.tolist(), strict=True))
    out = {name: p[name] for name in ("kt", "kd", "Jr") if name in p}
    out["hover_speed"] = max(p.get("kt", 1.0), 1e-300) ** -0.5  # but for a constant factor
    com = [p[name] / mass if name in p else 0.0 for name in FIRST_MOMENTS]
    out |= {f"com_{n[-1]}": c for n, c in zip(FIRST_MOMENTS, com, strict=True) if n in p}
    elements = np.array([p.get(name, 0.0) for name in INERTIA])
    about_com = inertia_about(elements, -mass, np.array(com)).tolist()
    pairs = zip(INERTIA, INERTIA_COM, about_com, strict=True)
    return out | {name: value for base, name, value in pairs if base in p}


def _trim_of_log(log: FlightLog, vehicle: Vehicle) -> dict[str, Number]:
    """Return the trim by the motors of a log that cannot be identified; nothing without motors."""
    channel = log.channels.get("rotor_speed", log.channels.get("command"))
    if channel is None or channel.values.shape[1] != len(vehicle.rotors):
        return {}
    whole = np.isfinite(channel.values).all(axis=1) & np.isfinite(channel.time)
    time, motors = channel.time[whole], channel.values[whole]
    if len(time) < 2 or time[-1] <= time[0]:
        return {}
    total = (motors * motors).sum(axis=1)
    airborne = total > AIRBORNE_SHARE * np.percentile(total, 75)
    rate = (len(time) - 1) / (time[-1] - time[0])
    return _trim_numbers([motors[airborne]], vehicle, rows=round(PART_SECONDS * rate))


def _trim_numbers(
    stretches: Sequence[Float[np.ndarray, "_ N"]], vehicle: Vehicle, *, rows: int
) -> dict[str, Number]:
    """Return the mean centre of thrust and the motors' root mean square, with their deviations."""
    if not stretches:
        return {}
    squares = np.concatenate(stretches) ** 2
    count = len(squares) // max(rows, 1)
    if count < FEWEST_PARTS or not squares.any():
        return {}
    parts = np.array_split(squares * vehicle.axes[:, 2], count)
    means = np.array([part.mean(axis=0) for part in parts])
    places = means @ vehicle.positions[:, :2] / means.sum(axis=1)[:, None]
    speeds = np.sqrt(np.abs(means).mean(axis=1))
    table = np.column_stack([places, speeds])
    std = table.std(axis=0, ddof=1) / np.sqrt(count)
    return {
        name: _measured_number(*pair)
        for name, *pair in zip(TRIM, table.mean(axis=0).tolist(), std.tolist(), strict=True)
    }


def factor_arrays(fitted: FittedFactors, dataset: Dataset) -> dict[str, np.ndarray]:
    """Convert the factors of a single flight to arrays by name."""
    (one,) = fitted.configurations
    factors = {name: getattr(one.factors, name) for name in _FACTORS}
    fit = {
        "terms": list(fitted.terms),
        "signals": [signals.name for signals in dataset.model.layout.added],
        "timing": None if one.timing is None else _plain_timing(one.timing),
        "mass": one.mass,
        "name": one.name,
        "values": dict(fitted.values),
    }
    given = {
        "counted": one.counted,
        "answered": one.with_response,
        "tied": one.error_correlation,
        **factors,
    }
    arrays = {name: np.asarray(array) for name, array in given.items() if array is not None}
    return {**arrays, "fit": np.frombuffer(json.dumps(fit).encode(), dtype=np.uint8)}


def fitted_factors(arrays: Mapping[str, np.ndarray], experiment: Experiment) -> FittedFactors:
    """Restore the factors of `factor_arrays`; the vehicle is the experiment's."""
    fit = json.loads(arrays["fit"].tobytes())
    vehicle = vehicle_of(experiment.airframe)
    one = JointConfiguration(
        name=fit["name"],
        mass=fit["mass"],
        factors=Factors(
            R=arrays["R"],
            rows=arrays["rows"],
            segment=arrays["segment"],
            band=arrays["band"],
            noise=arrays.get("noise"),
            slopes=arrays.get("slopes"),
        ),
        model=regressor(vehicle, added=signals_named(fit["signals"])),
        vehicle=vehicle,
        counted=arrays.get("counted"),
        with_response=arrays.get("answered"),
        error_correlation=arrays.get("tied"),
        timing=None if fit["timing"] is None else _timing_from_plain(fit["timing"]),
    )
    return FittedFactors(configurations=(one,), terms=tuple(fit["terms"]), values=fit["values"])


def _plain_timing(timing: FreeTiming) -> dict[str, object]:
    at = timing.at
    return {
        "at": [at.lag, at.delay, at.lag_down],
        "names": list(timing.names),
        "lag_prior": list(timing.lag_prior),
    }


def _timing_from_plain(plain: Mapping[str, Any]) -> FreeTiming:
    lag, delay, lag_down = plain["at"]
    return FreeTiming(
        at=MotorResponse(lag=lag, delay=delay, lag_down=lag_down),
        names=tuple(plain["names"]),
        lag_prior=(plain["lag_prior"][0], plain["lag_prior"][1]),
    )
