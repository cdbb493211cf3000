"""The recipe: from an experiment to a result, one step after the other."""

import dataclasses
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from threadpoolctl import threadpool_limits

from rotorfit.dataset.dataset import Dataset
from rotorfit.dataset.load import Progress, load_dataset, resolved_method
from rotorfit.diagnostics.assumptions import assumptions, log_metadata
from rotorfit.diagnostics.coupling import drop_absent_coupling
from rotorfit.diagnostics.diagnose import diagnose
from rotorfit.diagnostics.kt_from_weight import weigh_thrust
from rotorfit.diagnostics.lever_arms import allow_for_sides
from rotorfit.diagnostics.motors.law_uncertainty import allow_for_law
from rotorfit.diagnostics.motors.motor_limits import allow_for_motor_limits
from rotorfit.diagnostics.motors.motor_time_split import allow_for_noise_feedback
from rotorfit.diagnostics.motors.thrust_change import allow_for_thrust_change
from rotorfit.diagnostics.sensors.imu_tilt import correct_imu_tilt
from rotorfit.diagnostics.sensors.sensor_faults import (
    allow_for_gyro_lowpass,
    allow_for_velocity_errors,
)
from rotorfit.diagnostics.sensors.sensor_response import allow_for_sensor_response
from rotorfit.errors import EstimationError, FlightWarning
from rotorfit.experiment.experiment import Experiment
from rotorfit.findings import Finding, note
from rotorfit.fit.fit import Fit
from rotorfit.fit.fit_flights import fit_flights
from rotorfit.fit.timing.timing_fit import time_motors
from rotorfit.results.assemble import mark_doubtful, with_diagnosis, with_setting
from rotorfit.results.command_units import in_command_units, with_flight_numbers
from rotorfit.results.joint_tables import joint_result
from rotorfit.results.law_tables import add_motor_law
from rotorfit.results.paper_tables import paper_result
from rotorfit.results.result import IdentificationResult
from rotorfit.results.row_tables import row_result
from rotorfit.validation.validate import validation_comparisons, validation_rows

ORIGIN_IS_TRACKED: Final = (
    "the origin is the point that motion capture tracks: CoM, first moments and rotor centre are "
    "measured from it; inertia about the CoM does not depend on that choice"
)
IMU_PLACE_UNUSED: Final = (
    "the origin is the point that motion capture tracks: the rotors' positions are taken as "
    "measured from it, and the place of the IMU is not used"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Identified:
    """A result, and what it was made of.

    Attributes
    ----------
    result
        As `identify` returns it.
    dataset
        The flights as they were fitted, their samples too.
    fit
        The joint fit; None of methods that fit no joint likelihood.
    """

    result: IdentificationResult
    dataset: Dataset
    fit: Fit | None


def identify(experiment: Experiment, *, progress: Progress | None = None) -> IdentificationResult:
    """Identify the vehicle of an experiment from its flights.

    Parameters
    ----------
    experiment
        From `load_experiment` or `single_flight_experiment`.
    progress
        Called with a few words on what is being done.

    Raises
    ------
    RotorfitError
        One of its kinds, if the experiment, a log or a flight cannot be used.
    """
    return identify_flights(experiment, progress=progress).result


def identify_flights(experiment: Experiment, *, progress: Progress | None = None) -> Identified:
    """Identify a vehicle, and return the flights and their fit with the result; see `identify`."""
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


def _identify(experiment: Experiment, report: Progress) -> Identified:
    method = resolved_method(experiment)
    dataset = load_dataset(experiment, report)
    found = log_metadata(experiment.motors, dataset)
    experiment = experiment.model_copy(update={"motors": dataset.motors})
    # The paper neglects lag and delay, but takes out the delay of its motion capture.
    if method != "tls" or dataset.source == "mocap":
        dataset = time_motors(dataset, lag=method != "tls", report=report)
    report("fitting")
    if method == "banded":
        experiment, dataset, tilt = correct_imu_tilt(experiment, dataset)
        fit = _fit(experiment, dataset)
        result = with_diagnosis(joint_result(fit, experiment), diagnose(fit))
        found = (*found, *tilt)
    else:
        fit = None
        result = LEAST_SQUARES[method](experiment, dataset)
    result = dataclasses.replace(result, findings=(*found, *result.findings))
    result = in_command_units(result, dataset)
    result = add_motor_law(result, dataset, report)
    result = with_flight_numbers(result, dataset.motors)
    dataset = dataset if fit is None else fit.dataset
    joint = () if fit is None else fit.configurations
    result = with_setting(result, hangs_on=list(assumptions(result, dataset, joint)))
    result = mark_doubtful(_describe_units(result, experiment))
    _warn(result)
    result = _validate(result, experiment, report)
    return Identified(result=result, dataset=dataset, fit=fit)


STEPS: Final[tuple[Callable[[Fit], Fit], ...]] = (
    drop_absent_coupling,
    weigh_thrust,
    allow_for_motor_limits,
    allow_for_law,
    allow_for_velocity_errors,
    allow_for_gyro_lowpass,
    allow_for_thrust_change,
    allow_for_sensor_response,
    allow_for_noise_feedback,
    allow_for_sides,
)
"""From the fit of the joint likelihood to the intervals of its numbers."""
LEAST_SQUARES: Final = {"ols": row_result, "tls": paper_result}


def _fit(experiment: Experiment, dataset: Dataset) -> Fit:
    """Fit the joint likelihood, and take every step to its intervals."""
    fit = fit_flights(dataset, experiment.identification.terms)
    for step in STEPS:
        fit = step(fit)
    return fit


def _describe_units(result: IdentificationResult, experiment: Experiment) -> IdentificationResult:
    """Note where the origin is in motion capture, and that an unknown mass scales all numbers."""
    added: list[Finding] = []
    kept = result.findings
    if experiment.identification.source == "mocap":
        kept = tuple(one for one in kept if one.kind != "origin")
        tracked = experiment.airframe.imu is None
        added.append(note("origin", ORIGIN_IS_TRACKED if tracked else IMU_PLACE_UNUSED))
    if any(entry.mass == "unknown" for entry in experiment.configuration):
        sentence = "the mass is unknown: forces, moments and inertia are per kilogram of it"
        added.append(note("mass-unknown", sentence))
    return dataclasses.replace(result, findings=(*kept, *added))


def _warn(result: IdentificationResult) -> None:
    """Issue the warnings of every flight."""
    for record in result.flights:
        for sentence in record.warnings:
            warnings.warn(f"{Path(record.file).name}: {sentence}", FlightWarning, stacklevel=3)


def _validate(
    result: IdentificationResult, experiment: Experiment, report: Progress
) -> IdentificationResult:
    """Compare the model with flights that the fit has not seen."""
    if not any(entry.validation for entry in experiment.configuration):
        return result
    report("validating on flights kept for it")
    comparisons = validation_comparisons(result, experiment)
    written = [entry.written for c in experiment.configuration for entry in c.validation]
    return dataclasses.replace(result, validation=validation_rows(comparisons, written))


def _silent(words: str) -> None:
    del words
