"""The recipe, top to bottom: experiment to result."""

import dataclasses
import platform
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from jaxtyping import Float
from threadpoolctl import threadpool_limits

import rotorfit
from rotorfit.errors import ExperimentError, FlightWarning, RotorfitError
from rotorfit.identification.experiment import (
    ConfigurationEntry,
    Experiment,
    motor_model_of,
    vehicle_of,
)
from rotorfit.identification.flights import (
    EDGES,
    UsedFlight,
    check_flights,
    find_delay,
    flight_bands,
    load_flight,
)
from rotorfit.identification.paper import PaperSettings, paper_estimate
from rotorfit.identification.result import FlightRecord, IdentificationResult
from rotorfit.identification.row_parameters import Quantities, row_quantities
from rotorfit.identification.rows import RowFits, fit_rows
from rotorfit.identification.tables import Tables, paper_tables, row_tables
from rotorfit.model.regressor import Regressor, regressor
from rotorfit.model.vehicle import Vehicle

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Configured:
    """One configuration, ready for an estimator."""

    entry: ConfigurationEntry
    vehicle: Vehicle
    model: Regressor
    flights: list[UsedFlight]
    motor_delay: tuple[float, float] | None

    @property
    def mass(self) -> float:
        """[kg]; 1 where it is unknown, and everything is then per kilogram."""
        return 1.0 if self.entry.mass == "unknown" else self.entry.mass


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
    # The matrices are small: a second thread of the linear algebra only waits, at ten times the
    # cost where another program uses the other cores.
    with threadpool_limits(limits=1, user_api="blas"):
        return _identify(experiment, progress or _silent)


def _identify(experiment: Experiment, tell: Progress) -> IdentificationResult:
    configured = _configured(experiment, tell)
    tell("fitting")
    if _resolved_method(experiment) == "tls":
        tables = paper_tables(
            paper_estimate(
                configured.flights,
                configured.vehicle,
                configured.model,
                mass=configured.mass,
                settings=_paper_settings(experiment),
            ),
            configured.entry,
        )
    else:
        tables = _row_estimate(experiment, configured)
    return _result(experiment, configured, tables)


def _silent(words: str) -> None:
    del words


def _configured(experiment: Experiment, tell: Progress) -> Configured:
    """Read, prepare and check the flights of the configuration."""
    entry = _only_configuration(experiment)
    vehicle = vehicle_of(experiment.airframe)
    motors = motor_model_of(experiment.motors)
    flights: list[UsedFlight] = []
    for flight in entry.flights:
        tell(f"reading {Path(flight.file).name}")
        try:
            flights.append(load_flight(flight, experiment.motors, vehicle, motors))
        except RotorfitError as error:
            raise _with_file(error, flight.file) from error
    tell("checking axes and rotors")
    check_flights(flights, vehicle)
    model = regressor(vehicle)
    configured = Configured(
        entry=entry, vehicle=vehicle, model=model, flights=flights, motor_delay=None
    )
    search = motors.speed == "measured" and motors.delay is None
    if not search or _resolved_method(experiment) == "tls":
        return configured
    tell("timing the rotor speed against the gyro")
    delay = find_delay(flights, vehicle, model, mass=configured.mass)
    return dataclasses.replace(configured, motor_delay=delay)


def _with_file(error: RotorfitError, file: str) -> RotorfitError:
    """Return the same error, naming the file if it does not."""
    name = Path(file).name
    return error if name in str(error) else type(error)(f"{name}: {error}")


def _only_configuration(experiment: Experiment) -> ConfigurationEntry:
    if len(experiment.configuration) > 1:
        names = ", ".join(entry.name for entry in experiment.configuration)
        raise ExperimentError(
            f"{len(experiment.configuration)} configurations ({names}): this version identifies "
            "one at a time; leave one [[configuration]] in the file"
        )
    return next(iter(experiment.configuration))


def _resolved_method(experiment: Experiment) -> str:
    return (
        "tls" if experiment.identification.preset == "paper" else (experiment.identification.method)
    )


def _paper_settings(experiment: Experiment) -> PaperSettings:
    """Return the paper's settings with what the experiment overrides."""
    given = experiment.identification
    default = PaperSettings()
    keep_all = given.preset is None and given.r_sigma is None
    return PaperSettings(
        cutoff=given.cutoff or default.cutoff,
        r_sigma=None if keep_all else given.r_sigma or default.r_sigma,
    )


def _row_estimate(experiment: Experiment, configured: Configured) -> Tables:
    """Return the tables of the row by row estimate."""
    found = configured.motor_delay
    fits = _fits_at(configured, None if found is None else found[0])
    quantities = _quantities(configured, fits)
    return row_tables(
        _widened(configured, quantities),
        fits,
        configured.entry,
        vehicle=configured.vehicle,
        motors=experiment.motors,
        motor_delay=found,
    )


def _fits_at(configured: Configured, delay: float | None, *, top: float = np.inf) -> RowFits:
    factors = flight_bands(configured.flights, configured.vehicle, delay)
    factors = factors.select(factors.band[:, 0] < top)
    return fit_rows(factors, configured.model, mass=configured.mass)


def _quantities(configured: Configured, fits: RowFits) -> Quantities:
    return row_quantities(
        fits,
        configured.vehicle,
        mass=configured.mass,
        mass_std=configured.entry.mass_std,
    )


def _widened(configured: Configured, quantities: Quantities) -> Quantities:
    """Return the intervals widened by what settings change that could as well be others.

    Half of the frequency range, and half a sample of delay both ways; twice the rms shift.
    """
    found = configured.motor_delay
    delay = None if found is None else found[0]
    trials = [_fits_at(configured, delay, top=0.5 * EDGES[-1])]
    if delay is not None:
        half = 0.5 / configured.flights[0].prepared.data.sample_rate
        trials += [_fits_at(configured, delay + sign * half) for sign in (-1.0, 1.0)]
    shifts = np.array([_quantities(configured, fits).values - quantities.values for fits in trials])
    rms: Float[np.ndarray, " q"] = np.sqrt((shifts**2).mean(axis=0))
    return dataclasses.replace(quantities, half_width=np.hypot(quantities.half_width, 2.0 * rms))


def _result(experiment: Experiment, configured: Configured, tables: Tables) -> IdentificationResult:
    doubts = (*tables.warnings, *_mass_warning(configured))
    records = tuple(_record(flight, configured.entry.name) for flight in configured.flights)
    for record in records:
        for doubt in record.warnings:
            warnings.warn(f"{Path(record.file).name}: {doubt}", FlightWarning, stacklevel=3)
    return IdentificationResult(
        name=experiment.name,
        method=_resolved_method(experiment),
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


def _mass_warning(configured: Configured) -> tuple[str, ...]:
    if configured.entry.mass != "unknown":
        return ()
    return ("the mass is unknown: forces, moments and inertia are per kilogram of it",)


def _record(flight: UsedFlight, configuration: str) -> FlightRecord:
    data = flight.prepared.data
    zero = float(data.time[0])
    return FlightRecord(
        file=flight.entry.file,
        sha256=flight.log.sha256,
        configuration=configuration,
        seconds_used=data.seconds_used,
        samples_used=data.samples_used,
        used=tuple(
            (float(data.time[s.start]) - zero, float(data.time[s.stop - 1]) - zero)
            for s in data.segments
        ),
        cuts=tuple((c.start - zero, c.end - zero, c.reason) for c in flight.prepared.cuts),
        warnings=(*flight.log.warnings, *flight.prepared.warnings),
    )


def _settings(experiment: Experiment, tables: Tables) -> dict[str, Any]:
    resolved = experiment.model_dump(mode="json", exclude_none=True)
    return {**resolved, "used": dict(tables.settings)}


def _versions() -> dict[str, str]:
    return {
        "rotorfit": rotorfit.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
    }
