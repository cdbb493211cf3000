"""The recipe, top to bottom: experiment to result."""

import dataclasses
import platform
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from threadpoolctl import threadpool_limits

from rotorfit import version
from rotorfit.dataset.checks.declared_rotors import check_flights
from rotorfit.dataset.checks.plausible_units import (
    refuse_gyro_in_degrees,
    refuse_rotors_too_fast,
    slow_rotor_doubts,
)
from rotorfit.dataset.checks.recorded_motors import refuse_wrong_speeds
from rotorfit.dataset.dataset import (
    ConfigurationData,
    Dataset,
    LoadedFlight,
    levelled_flights,
    load_flight,
)
from rotorfit.diagnostics.assumptions import assumptions
from rotorfit.diagnostics.imu_tilt import estimate_imu_tilt
from rotorfit.diagnostics.imu_tilt_words import lean_sentence, mounting_sentence
from rotorfit.diagnostics.log_metadata import agreed_motors, log_metadata_notes
from rotorfit.errors import EstimationError, ExperimentError, FlightWarning
from rotorfit.experiment.declared_vehicle import payload_of, vehicle_of, with_imu_tilt
from rotorfit.experiment.experiment import Experiment, MotorsEntry
from rotorfit.experiment.model_terms import DEFAULT_TERMS
from rotorfit.fit.joint.joint_fit import FittedFactors, joint_fit
from rotorfit.fit.joint.term_choice import velocity_wanted
from rotorfit.fit.timing.timing_fit import find_timing
from rotorfit.identification.estimates import ESTIMATES, resolved_method
from rotorfit.model.regressor import regressor
from rotorfit.motor_law.fit_law import bounded_recording, fit_law
from rotorfit.preprocessing.flight_data import Velocity
from rotorfit.results.command_law import CommandLaw
from rotorfit.results.command_units import of_commanded_speed
from rotorfit.results.law_tables import law_tables, with_law
from rotorfit.results.parameter_tables import ORIGIN_IS_IMU, Tables
from rotorfit.results.result import FlightRecord, IdentificationResult
from rotorfit.validation.validate import validation_comparisons, validation_rows

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Identified:
    """A result, and what it was made of.

    Attributes
    ----------
    result
        As `identify` returns it.
    dataset
        The flights as they were fitted, their samples too.
    factors
        The flights without their samples; None of methods that fit no joint likelihood.
    """

    result: IdentificationResult
    dataset: Dataset
    factors: FittedFactors | None


ORIGIN_IS_TRACKED = (
    "the origin is the point that motion capture tracks: CoM, first moments and rotor centre are "
    "measured from it; inertia about the CoM does not depend on that choice"
)
IMU_PLACE_UNUSED = (
    "the origin is the point that motion capture tracks: the rotors' positions are taken as "
    "measured from it, and the place of the IMU is not used"
)


def identify(experiment: Experiment, *, progress: Progress | None = None) -> IdentificationResult:
    """Return what the flights of an experiment tell of its vehicle.

    Parameters
    ----------
    experiment
        From `load_experiment` or `single_flight_experiment`.
    progress
        Told in a few words what is being done.

    Raises
    ------
    RotorfitError
        One of its kinds, if the experiment, a log or a flight cannot be used.
    """
    return identify_flights(experiment, progress=progress).result


def identify_flights(experiment: Experiment, *, progress: Progress | None = None) -> Identified:
    """Return the same with what it was made of; see `identify`."""
    # The matrices are small: a second thread of the linear algebra only waits, at ten times the
    # cost where another program uses the other cores.
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            return _identify(experiment, progress or _silent)
        except np.linalg.LinAlgError as error:
            raise EstimationError(
                f"the equations of these flights have no solution ({error}): there is hardly any "
                "motion in them; fly more, and please report it with the log"
            ) from error


def _identify(experiment: Experiment, tell: Progress) -> Identified:
    method = resolved_method(experiment)
    dataset = load_dataset(experiment, tell)
    told = log_metadata_notes(experiment.motors, dataset)
    experiment = experiment.model_copy(update={"motors": dataset.motors})
    # The paper neglects the motors' lag and delay, but takes out the delay of its motion capture.
    if dataset.unknown_times and (method != "tls" or dataset.source == "mocap"):
        tell("timing the motors against the motion")
        dataset = dataclasses.replace(
            dataset, motor_timing=find_timing(dataset, lag=method != "tls")
        )
    tell("fitting")
    experiment, dataset, turned = _correct_imu_tilt(experiment, dataset)
    tables = of_commanded_speed(ESTIMATES[method](experiment, dataset), dataset)
    tables, law = _with_command_law(tables, dataset, tell)
    tables = dataclasses.replace(
        tables,
        warnings=(*told, *turned, *tables.warnings),
        settings={**tables.settings, "hangs_on": list(assumptions(tables, dataset))},
    )
    result = dataclasses.replace(_result(experiment, dataset, tables), command_law=law)
    if any(entry.validation for entry in experiment.configuration):
        tell("validating on flights kept apart")
        comparisons = validation_comparisons(result, experiment)
        written = [entry.written for c in experiment.configuration for entry in c.validation]
        result = dataclasses.replace(result, validation=validation_rows(comparisons, written))
    return Identified(result=result, dataset=dataset, factors=tables.factors)


def _with_command_law(
    tables: Tables, dataset: Dataset, tell: Progress
) -> tuple[Tables, CommandLaw | None]:
    """Return the tables with the motors' law, where commands stand beside measured speeds."""
    flights = [f.command_responses for c in dataset.configurations for f in c.flights]
    recording = bounded_recording(flights)
    if recording is None:
        return tables, None
    tell("fitting the motors' law to commands and speeds")
    try:
        fitted = fit_law(recording)
    except EstimationError as error:
        words = f"no law from command to rotor speed was found: {error}"
        return dataclasses.replace(tables, warnings=(*tables.warnings, words)), None
    law, parameters = law_tables(fitted, len(dataset.vehicle.rotors))
    return with_law(tables, parameters, law), law


def _correct_imu_tilt(
    experiment: Experiment, dataset: Dataset
) -> tuple[Experiment, Dataset, tuple[str, ...]]:
    """Return experiment and flights with the IMU's mounting that the flights tell, and words."""
    if resolved_method(experiment) != "banded" or experiment.airframe.imu_tilt_deg is not None:
        return experiment, dataset, ()
    tilt = estimate_imu_tilt(dataset, joint_fit)
    if tilt is None:
        return experiment, dataset, lean_sentence(dataset)
    dataset = levelled_flights(dataset, tilt).reduced()
    if dataset.motor_timing is not None:
        dataset = dataclasses.replace(dataset, motor_timing=find_timing(dataset))
    return with_imu_tilt(experiment, tilt), dataset, (mounting_sentence(tilt),)


def _silent(words: str) -> None:
    del words


def load_dataset(experiment: Experiment, tell: Progress) -> Dataset:
    """Read, prepare and check the flights of every configuration."""
    source = experiment.identification.source
    vehicle = vehicle_of(experiment.airframe, source)
    configurations: list[ConfigurationData] = []
    for entry in experiment.configuration:
        flights: list[LoadedFlight] = []
        for flight in entry.flights:
            tell(f"reading {Path(flight.file).name}")
            flights.append(load_flight(flight, experiment))
        tell("checking axes, units and rotors")
        if source == "imu":
            for f in flights:
                refuse_gyro_in_degrees(
                    {Path(f.entry.file).name: f.prepared.data}, takes_columns=f.log.takes_columns
                )
        motors = agreed_motors(experiment.motors, flights)
        if motors.speed == "measured":
            refuse_wrong_speeds(flights, vehicle)
        check_flights(flights, vehicle, motors)
        flights = _sound_rotors(flights, vehicle.arm, motors)
        payload = payload_of(entry, experiment.airframe.axes)
        configurations.append(ConfigurationData(entry=entry, flights=flights, payload=payload))
    every = [flight for configured in configurations for flight in configured.flights]
    _refuse_copies(every)
    _refuse_mixed_commands(every)
    velocity = _velocity(experiment, configurations)
    return Dataset(
        vehicle=vehicle,
        model=regressor(vehicle, velocity=velocity),
        motors=agreed_motors(experiment.motors, every),
        configurations=tuple(configurations),
        source=source,
        velocity=velocity,
    ).reduced()


def _velocity(experiment: Experiment, configurations: list[ConfigurationData]) -> Velocity:
    """Return what of the velocity the model needs."""
    terms = experiment.identification.terms
    if resolved_method(experiment) != "banded":
        return "none"
    if velocity_wanted(terms, configurations):
        return "known"
    felt = experiment.identification.source == "imu"
    return "climb" if felt and "climb_drag" in (terms or DEFAULT_TERMS) else "none"


def _sound_rotors(
    flights: list[LoadedFlight], arm: float, motors: MotorsEntry
) -> list[LoadedFlight]:
    """Return the flights, with what is to be doubted of their rotors' speeds; refuse absurd ones.

    A command without a law has no unit that could be wrong.
    """
    law, no_speed = motors.law is not None, motors.law_is_relative
    if motors.speed == "commanded" and no_speed and not any(f.speeds_commanded for f in flights):
        return flights
    sound: list[LoadedFlight] = []
    for flight in flights:
        data, takes = flight.prepared.data, flight.log.takes_columns
        name = Path(flight.entry.file).name
        refuse_rotors_too_fast({name: data}, arm, law=law, takes_columns=takes)
        doubts = slow_rotor_doubts(data, arm, law=law, takes_columns=takes)
        said = (*flight.prepared.warnings, *doubts)
        prepared = dataclasses.replace(flight.prepared, warnings=said)
        sound.append(dataclasses.replace(flight, prepared=prepared))
    return sound


def _refuse_copies(flights: list[LoadedFlight]) -> None:
    """Raise if a flight is there twice, under two names or in two configurations."""
    for flight, other in combinations(flights, 2):
        if flight.log.sha256 == other.log.sha256 and flight.entry.overlaps(other.entry):
            one, two = (Path(used.entry.file).name for used in (flight, other))
            same = "is listed twice" if one == two else f"has the same content as {one}"
            raise ExperimentError(
                f"{two} {same}; it would count twice: list it once, with the mass that it flew with"
            )


def _refuse_mixed_commands(flights: list[LoadedFlight]) -> None:
    """Raise if some flights command rotor speeds and others shares of full output."""
    speeds = {flight.speeds_commanded for flight in flights}
    if len(speeds) > 1:
        one, two = (
            next(Path(f.entry.file).name for f in flights if f.speeds_commanded is kind)
            for kind in (True, False)
        )
        raise ExperimentError(
            f"{one} commands rotor speeds in rad/s, {two} commands from 0 to 1: identify them in "
            "experiments of their own"
        )


def _result(experiment: Experiment, dataset: Dataset, tables: Tables) -> IdentificationResult:
    doubts = (*_about_origin(tables.warnings, experiment), *_mass_warning(dataset))
    records = tuple(
        _record(flight, configured.entry.name)
        for configured in dataset.configurations
        for flight in configured.flights
    )
    for record in records:
        for doubt in record.warnings:
            warnings.warn(f"{Path(record.file).name}: {doubt}", FlightWarning, stacklevel=3)
    return IdentificationResult(
        name=experiment.name,
        method=resolved_method(experiment),
        parameters=tables.parameters,
        derived=tables.derived,
        flights=records,
        covariance_names=tables.covariance_names,
        covariance=tables.covariance,
        settings=_settings(experiment, tables),
        versions=_versions(),
        warnings=doubts,
        diagnostics=tables.diagnostics,
    )


def _about_origin(doubts: tuple[str, ...], experiment: Experiment) -> tuple[str, ...]:
    """Return the doubts in the words of motion capture, where that measured the motion."""
    if experiment.identification.source == "imu":
        return doubts
    imu = experiment.airframe.imu
    mocap = ORIGIN_IS_TRACKED if imu is None else IMU_PLACE_UNUSED
    return (*(doubt for doubt in doubts if doubt != ORIGIN_IS_IMU), mocap)


def _mass_warning(dataset: Dataset) -> tuple[str, ...]:
    if all(c.entry.mass != "unknown" for c in dataset.configurations):
        return ()
    return ("the mass is unknown: forces, moments and inertia are per kilogram of it",)


def _record(flight: LoadedFlight, configuration: str) -> FlightRecord:
    recorded, zero = flight.recorded, flight.recorded.start
    return FlightRecord(
        file=flight.entry.written,
        sha256=flight.log.sha256,
        configuration=configuration,
        seconds_used=recorded.seconds,
        samples_used=recorded.samples,
        used=tuple((start - zero, end - zero) for start, end in recorded.spans),
        cuts=tuple((c.start - zero, c.end - zero, c.reason) for c in flight.prepared.cuts),
        warnings=(*flight.log.warnings, *flight.prepared.warnings),
    )


def _settings(experiment: Experiment, tables: Tables) -> dict[str, Any]:
    resolved = experiment.model_dump(mode="json", exclude_none=True)
    return {**resolved, "used": dict(tables.settings)}


def _versions() -> dict[str, str]:
    return {
        "rotorfit": version.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
    }
