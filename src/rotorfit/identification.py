"""The recipe: from an experiment to a result, one step after the other."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from threadpoolctl import threadpool_limits

from rotorfit.checks.diagnose import diagnose
from rotorfit.errors import EstimationError, FlightWarning
from rotorfit.findings import Finding, note
from rotorfit.fit.dataset.load import (
    Method,
    Progress,
    ignore_progress,
    load_dataset,
    resolved_method,
)
from rotorfit.fit.fit_flights import fit_flights
from rotorfit.fit.imu_tilt import correct_imu_tilt
from rotorfit.fit.motors.law_search import fit_with_law
from rotorfit.fit.noise_levels import fit_by_noise
from rotorfit.fit.sensors.late_accelerometer import fit_with_force_in_time
from rotorfit.fit.sensors.sensor_place import place_sensor
from rotorfit.fit.steps import every_step
from rotorfit.fit.timing.lag_on_thrust import with_likelier_lag
from rotorfit.fit.timing.sensor_bandwidth import (
    measure_bandwidths,
    measured_at_timing,
    take_off_lateness,
)
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.fit.timing.timing_fit import time_motors
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.results.assemble import (
    log_metadata,
    mark_doubtful,
    with_assumptions,
    with_diagnosis,
)
from rotorfit.results.command_units import in_command_units, with_flight_numbers
from rotorfit.results.full_throttle import with_full_throttle
from rotorfit.results.joint_tables import joint_tables
from rotorfit.results.law_tables import add_motor_law
from rotorfit.results.result import IdentificationResult
from rotorfit.results.row_tables import estimate_by_paper, estimate_by_rows
from rotorfit.results.tables import Advice, ResultTables, finished_result
from rotorfit.results.validation.validate import validation_comparisons, validation_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.fit.experiment.experiment import Experiment, MotorsEntry
    from rotorfit.fit.fit import Fit
    from rotorfit.results.result import FlightRecord

ORIGIN_IS_TRACKED: Final = (
    "the origin is the point that motion capture tracks: CoM, first moments and rotor centre are "
    "measured from it; inertia about the CoM does not depend on that choice"
)
IMU_PLACE_UNUSED: Final = (
    "the origin is the point that motion capture tracks: the rotors' positions are taken as "
    "measured from it, and the place of the IMU is not used"
)


@frozen_dataclass
class Identified:
    """A result, and what it was made of.

    - `experiment`: as declared, completed by the logs and the flights.
    - `dataset`: the flights as they were fitted, their samples too.
    - `fit`: the joint fit; None of estimators that fit no joint likelihood.
    - `result`: as `identify` returns it.
    """

    experiment: Experiment
    dataset: TimedDataset
    fit: Fit | None
    result: IdentificationResult


@frozen_dataclass
class Tabulated:
    """What an estimator returns: the tables of its numbers, and what they were made of.

    - `experiment`, `dataset`, `fit`: as for `Identified`.
    - `tables`: numbers with verdicts and findings, in the units of the fit.
    """

    experiment: Experiment
    dataset: TimedDataset
    fit: Fit | None
    tables: ResultTables


Adviser = Callable[[IdentificationResult, Progress], Advice | None]
"""What plans the next flight of a result's vehicle; it reports on its progress."""


def identify(
    experiment: Experiment,
    *,
    progress: Progress | None = None,
    adviser: Adviser | None = None,
) -> IdentificationResult:
    """Identify the vehicle of an experiment from its flights.

    Parameters
    ----------
    experiment
        From `load_experiment` or `single_flight_experiment`.
    progress
        Called with a few words on what is being done.
    adviser
        Says what to fly next, such as `rotorfit.tools.planning.next_step.advise_flights`; without
        one the result has the general advice for each number.

    Raises
    ------
    RotorfitError
        One of its kinds, if the experiment, a log or a flight cannot be used.
    """
    return identify_flights(experiment, progress=progress, adviser=adviser).result


def identify_flights(
    experiment: Experiment,
    *,
    progress: Progress | None = None,
    adviser: Adviser | None = None,
) -> Identified:
    """Identify a vehicle, and return the flights and their fit with the result; see `identify`."""
    # The matrices are small: a second thread of the linear algebra only waits, at ten times the
    # cost where another program uses the other cores.
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            return _identify_checked(experiment, progress or ignore_progress, adviser)
        except np.linalg.LinAlgError as error:
            raise EstimationError(
                f"the equations of these flights have no solution ({error}): there is hardly any "
                "motion in them; fly more, and please report it with the log"
            ) from error


def _identify_checked(
    experiment: Experiment, report: Progress, adviser: Adviser | None
) -> Identified:
    method = resolved_method(experiment)
    dataset = TimedDataset.of(load_dataset(experiment, report))
    declared = experiment.motors
    experiment = experiment.model_copy(update={"motors": dataset.motors})
    # The paper neglects lag and delay, but takes out the delay of its motion capture.
    if method != "tls" or dataset.source == "mocap":
        # Lines without motion hide the motors' timing, and so does a late accelerometer; commands
        # lag too far to compare them before.
        if dataset.motors.speed == "measured":
            dataset = take_off_lateness(measure_bandwidths(dataset))
        dataset = time_motors(dataset, lag=method != "tls", report=report)
        dataset = measured_at_timing(with_likelier_lag(dataset))
        experiment = experiment.model_copy(update={"motors": dataset.motors})
    report("fitting")
    tabulated = ESTIMATORS[method](experiment, dataset)
    tables = _complete_tables(tabulated, declared, report)
    _issue_warnings(tables.flights)
    return Identified(
        experiment=tabulated.experiment,
        dataset=tabulated.dataset,
        fit=tabulated.fit,
        result=_finish_result(tabulated.experiment, tables, report, adviser),
    )


def by_likelihood(experiment: Experiment, dataset: TimedDataset) -> Tabulated:
    """Fit the joint likelihood of all bands, diagnose the fit, and tabulate it."""
    experiment, dataset, tilt = correct_imu_tilt(experiment, dataset)
    experiment, dataset, placed = place_sensor(experiment, dataset)
    wanted = experiment.identification.terms
    fit = _fit_with_noise(dataset, wanted)
    fit = fit_with_law(fit, wanted)
    if fit.dataset.law_found:
        experiment = experiment.model_copy(update={"motors": fit.dataset.motors})
    fit = fit_with_force_in_time(fit, lambda moved: _fit_timed_anew(moved, fit.terms, wanted))
    fit = every_step(fit)
    tables = joint_tables(fit, diagnose(fit))
    tables = dataclasses.replace(tables, findings=(*tilt, *tables.findings))
    tables = with_diagnosis(tables, placed)
    return Tabulated(experiment=experiment, dataset=fit.dataset, fit=fit, tables=tables)


def _fit_with_noise(dataset: TimedDataset, wanted: Sequence[str] | None) -> Fit:
    return fit_by_noise(fit_flights(dataset, wanted), wanted)


def _fit_timed_anew(
    dataset: TimedDataset, terms: Sequence[str], wanted: Sequence[str] | None
) -> Fit:
    """Time the motors and fit, with signals that have changed a little."""
    near = dataset.motor_timing
    timed = time_motors(dataset, lag=True, report=ignore_progress, near=near, terms=terms)
    return _fit_with_noise(timed, wanted)


def by_rows(experiment: Experiment, dataset: TimedDataset) -> Tabulated:
    """Solve each equation of motion by least squares."""
    tables = estimate_by_rows(experiment, dataset)
    return Tabulated(experiment=experiment, dataset=dataset, fit=None, tables=tables)


def by_paper(experiment: Experiment, dataset: TimedDataset) -> Tabulated:
    """Solve all equations by total least squares, as Six et al. (2020) do."""
    tables = estimate_by_paper(experiment, dataset)
    return Tabulated(experiment=experiment, dataset=dataset, fit=None, tables=tables)


ESTIMATORS: Final[dict[Method, Callable[[Experiment, TimedDataset], Tabulated]]] = {
    "banded": by_likelihood,
    "ols": by_rows,
    "tls": by_paper,
}


def _complete_tables(tabulated: Tabulated, declared: MotorsEntry, report: Progress) -> ResultTables:
    """Add the motors' law, the numbers of flight, the units and the assumptions, then judge all."""
    dataset, fit = tabulated.dataset, tabulated.fit
    tables = in_command_units(tabulated.tables, dataset)
    tables = add_motor_law(tables, dataset, report)
    tables = with_full_throttle(with_flight_numbers(tables, dataset.motors), dataset)
    tables = with_assumptions(tables, dataset, () if fit is None else fit.configurations)
    findings = _describe_units(
        (*log_metadata(declared, dataset), *tables.findings), tabulated.experiment
    )
    return mark_doubtful(dataclasses.replace(tables, findings=findings))


def _describe_units(findings: Sequence[Finding], experiment: Experiment) -> tuple[Finding, ...]:
    """Note where the origin is in motion capture, and that an unknown mass scales all numbers."""
    added: list[Finding] = []
    if experiment.identification.source == "mocap":
        findings = [one for one in findings if one.kind != "origin"]
        tracked = experiment.airframe.imu is None
        added.append(note("origin", ORIGIN_IS_TRACKED if tracked else IMU_PLACE_UNUSED))
    if any(entry.mass == "unknown" for entry in experiment.configuration):
        sentence = "the mass is unknown: forces, moments and inertia are per kilogram of it"
        added.append(note("mass-unknown", sentence))
    return (*findings, *added)


def _issue_warnings(flights: Sequence[FlightRecord]) -> None:
    for record in flights:
        for sentence in record.warnings:
            warnings.warn(f"{Path(record.file).name}: {sentence}", FlightWarning, stacklevel=3)


def _finish_result(
    experiment: Experiment, tables: ResultTables, report: Progress, adviser: Adviser | None
) -> IdentificationResult:
    """Make the result of the tables, with its validation and what to fly next."""
    draft = finished_result(experiment, tables)
    rows = _validate_draft(draft, experiment, report)
    advice = None if adviser is None else adviser(draft, report)
    return finished_result(experiment, tables, validation=rows, advice=advice)


def _validate_draft(
    draft: IdentificationResult, experiment: Experiment, report: Progress
) -> tuple[dict[str, Any], ...]:
    """Tabulate how well the model predicts flights that the fit has not seen."""
    if not any(entry.validation for entry in experiment.configuration):
        return ()
    report("validating on flights kept for it")
    comparisons = validation_comparisons(draft, experiment)
    written = [entry.written for c in experiment.configuration for entry in c.validation]
    return validation_rows(comparisons, written)
