"""Validate the model on flights kept apart: body wrench against rotor wrench (P16)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rotorfit.errors import ExperimentError, FlightError, LogError, RotorfitError
from rotorfit.fit.dataset.load import load_flight, velocity_known, with_hover_inflow
from rotorfit.fit.dataset.through_air import through_air
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.fit.experiment.experiment import (
    ConfigurationEntry,
    Experiment,
    experiment_of_settings,
    unseen_entry,
)
from rotorfit.fit.reduction.frequency_bands import retimed
from rotorfit.fit.reduction.motor_timing import LAG_PRIOR
from rotorfit.fit.reduction.reduce import LowPass, filtered_signals
from rotorfit.flight.flight_checks import OTHER_MOTOR_DATA
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.logs.flight_log import AIRLESS_ROTORS, DRAGLESS_ROTORS
from rotorfit.model.regressor import Regressor, regressor
from rotorfit.model.terms import body as body_terms
from rotorfit.model.terms.registry import OPTIONAL, TERMS, added_signals, considered_terms
from rotorfit.model.terms.rotors import THRUST
from rotorfit.results.hover_balance import fitted_thrusts, fitted_values
from rotorfit.results.result import (
    FlightRecord,
    IdentificationResult,
    configuration_names,
    meant_configuration,
)
from rotorfit.results.validation.replay_vehicle import ROTOR_CENTER, ROTOR_KT, places_of
from rotorfit.results.validation.wrench_comparison import COMPONENTS, SHOWN, WrenchComparison

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.fit.dataset.dataset import LoadedFlight
    from rotorfit.fit.experiment.flight_entries import FlightEntry
    from rotorfit.flight.prepare import PreparedFlight
    from rotorfit.model.signals import AddedSignals
    from rotorfit.model.vehicle import Vehicle

CUTOFF = 3.0
"""Low-pass of both sides [Hz], the paper's."""
BODY_TERMS = (body_terms.MASS, body_terms.FIRST_MOMENTS, body_terms.INERTIA)
BODY = tuple(name for term in BODY_TERMS for name in term.parameters)
NEEDS = {
    "Fz": ("kt", "mass"),
    "Mx": ("kt", "Ixx"),
    "My": ("kt", "Iyy"),
    "Mz": ("kd", "Izz"),
}
"""Without these a component cannot be predicted, and no error is given for it."""
TRIMS = {"Mx": ("msy", "rotor_center_y"), "My": ("msx", "rotor_center_x")}
"""Where thrust acts and where the mass is: together they are the moment's mean. Where one is not
known, it is that of a hover with the other."""
WHITENESS_LAGS = 10
SPEED_PERCENTILES = (0.1, 99.9)
"""Percentiles of the rotor speeds of a flight."""


def unseen_flight(
    result: IdentificationResult,
    path: Path,
    *,
    log_number: int | None = None,
    start: float | None = None,
    end: float | None = None,
) -> LoadedFlight:
    """Load a flight that a fit has not seen, as its experiment says; see `validate_file`."""
    experiment = experiment_of_settings(result.settings)
    entry = unseen_entry(path, experiment, log_number=log_number, start=start, end=end)
    return _load_unseen(entry, experiment, result)


def validate_file(
    result: IdentificationResult,
    path: Path,
    *,
    configuration: str | None = None,
    cutoff: float = CUTOFF,
    log_number: int | None = None,
    start: float | None = None,
    end: float | None = None,
) -> WrenchComparison:
    """Compare what a result predicts with a flight that its fit has not seen.

    Parameters
    ----------
    result
        With the settings of its experiment, by which the flight is read and prepared.
    path
        The flight's log.
    configuration
        In which it was flown; may be left out where the result has one.
    cutoff
        Low-pass of both sides [Hz].
    log_number
        Which log of a file with several, from 1.
    start, end
        Of what is used of it [s since its first sample].

    Raises
    ------
    ExperimentError
        If the flight was used in the fit, or the configuration is not in the result.
    """
    used = unseen_flight(result, path, log_number=log_number, start=start, end=end)
    return compare_wrenches(result, used, configuration=configuration, cutoff=cutoff)


def _load_unseen(
    entry: FlightEntry, experiment: Experiment, result: IdentificationResult
) -> LoadedFlight:
    """Load a flight; refuse it where the fit has used it."""
    used = load_other_flight(entry, experiment)
    refuse_fitted(used, result)
    return used


def load_other_flight(entry: FlightEntry, experiment: Experiment) -> LoadedFlight:
    """Load a flight that is not the result's own, with motor data of the result's kind."""
    try:
        return load_flight(entry, experiment)
    except RotorfitError as error:
        if error.finding.kind != OTHER_MOTOR_DATA:
            raise
        measured = experiment.motors.speed == "measured"
        own, has = ("measured rotor speeds", "motor commands")[:: 1 if measured else -1]
        speed = "commanded" if measured else "measured"
        raise LogError(
            f"{Path(entry.file).name}: the log has {has} alone, and the result is of {own}: give "
            f"a flight with {own}, or identify the first flights anew with --speed {speed}"
        ) from error


def refuse_fitted(used: LoadedFlight, result: IdentificationResult) -> None:
    """Raise if a validation flight, or a part of it, made the parameters it is to judge."""
    if any(
        record.sha256 == used.log.sha256 and entry.overlaps(used.entry)
        for _, entry, record in fitted_flights(result)
    ):
        raise ExperimentError(
            f"{Path(used.entry.file).name} was used in the fit: it cannot validate it; give "
            "another flight, or keep a part of this one out of the fit (start and end)"
        )


def fitted_comparisons(result: IdentificationResult) -> list[WrenchComparison]:
    """Compute the comparisons on the flights of the fit itself, read again, for figures.

    Parameters
    ----------
    result
        With the settings of its experiment, by which the flights are found.

    Raises
    ------
    ExperimentError
        If a log has changed since the fit.
    """
    experiment = experiment_of_settings(result.settings)
    comparisons: list[WrenchComparison] = []
    for configuration, entry, record in fitted_flights(result):
        used = load_flight(entry, experiment)
        if used.log.sha256 != record.sha256:
            raise ExperimentError(
                f"{Path(entry.file).name} has changed since the fit; identify again"
            )
        comparisons.append(
            compare_wrenches(result, used, configuration=configuration.name, fitted=True)
        )
    return comparisons


def validation_comparisons(
    result: IdentificationResult, experiment: Experiment
) -> list[WrenchComparison]:
    """Compute the comparisons on the flights that the experiment keeps for validation.

    Parameters
    ----------
    result
        What `identify` made of the experiment.
    experiment
        With flights under ``validation``.
    """
    comparisons: list[WrenchComparison] = []
    for configuration in experiment.configuration:
        for entry in configuration.validation:
            used = _load_unseen(entry, experiment, result)
            comparisons.append(compare_wrenches(result, used, configuration=configuration.name))
    return comparisons


def drawn_comparisons(
    result: IdentificationResult, experiment: Experiment
) -> list[WrenchComparison]:
    """Compare wrenches on validation flights, or on the fitted flights if there are none."""
    return validation_comparisons(result, experiment) or fitted_comparisons(result)


def validation_rows(
    comparisons: list[WrenchComparison], files: Sequence[str] | None = None
) -> tuple[dict[str, Any], ...]:
    """Return the ``validation`` list of a result's file; flights by the names of their files."""
    names = [c.flight for c in comparisons] if files is None else files
    return tuple(
        {
            "configuration": c.configuration,
            "flight": name,
            "relative_error": dict(c.relative_error),
            "whiteness": dict(c.whiteness),
        }
        for c, name in zip(comparisons, names, strict=True)
    )


def compare_wrenches(
    result: IdentificationResult,
    used: LoadedFlight,
    *,
    configuration: str | None = None,
    cutoff: float = CUTOFF,
    fitted: bool = False,
) -> WrenchComparison:
    """Compare both sides of the equations of motion on one prepared flight."""
    owner = _select_owner(result, configuration)
    known = _known_values(result, owner)
    # The known numbers were fitted beside the others, and hold together with them alone.
    values = fitted_values(result, owner) | known
    experiment = experiment_of_settings(result.settings)
    vehicle = vehicle_of(experiment.airframe, experiment.identification.source)
    added = signals_of_terms(used, values)
    model = regressor(vehicle, added=added)
    used = with_air_of(result, owner, used, vehicle)
    data = retimed(used.prepared, fitted_response(result))
    lowpass = LowPass(cutoff=cutoff)
    # The two ends of a segment show the filter's transient, not the flight.
    end = round(0.5 * data.sample_rate / cutoff)
    inner = [s for s in data.segments if len(s) > 4 * end]
    if not inner:
        raise FlightError(
            f"{Path(used.entry.file).name}: no airborne stretch is longer than "
            f"{4 * end / data.sample_rate:.1f} s; a longer flight is needed to compare wrenches"
        )
    parts = [filtered_signals(data, vehicle, s, lowpass, added=added)[end:-end] for s in inner]
    Z = np.concatenate(parts)
    body, rotors = _compute_wrenches(_without_bias(Z, values), model, values)
    time = np.concatenate([data.time[s.start + end : s.stop - end] for s in inner])
    time = time - used.recorded.start
    predicted = [
        c
        for c in SHOWN
        # Where the coefficient was removed, the rotors give nothing to compare with.
        if all(name in known for name in NEEDS[c]) and known[NEEDS[c][0]] != 0.0
    ]
    error = {c: relative_error(body, rotors, c) for c in predicted}
    step = max(round(data.sample_rate / cutoff), 1)
    return WrenchComparison(
        configuration=owner,
        flight=Path(used.entry.file).name,
        sha256=used.log.sha256,
        used_in_fit=fitted,
        time=time,
        body_wrench=body,
        rotor_wrench=rotors,
        relative_error=error,
        speeds=_speed_range(used.prepared),
        whiteness={c: whiteness((body - rotors)[::step, COMPONENTS.index(c)]) for c in predicted},
    )


def signals_of_terms(used: LoadedFlight, known: Collection[str]) -> tuple[AddedSignals, ...]:
    """Return the signals that terms with known parameters add on a flight."""
    present = [term for term in OPTIONAL if set(term.parameters) & set(known)]
    asked = any(term.needs == "velocity" for term in present) and velocity_known([used])
    names = considered_terms([term.name for term in present], velocity=asked, felt=False)
    return added_signals(
        names,
        carried=used.prepared.data.carried is not None,
        rotor_air=used.log.simulator not in AIRLESS_ROTORS,
        rotor_drag=used.log.simulator not in DRAGLESS_ROTORS,
    )


def with_air_of(
    result: IdentificationResult, owner: str, used: LoadedFlight, vehicle: Vehicle
) -> LoadedFlight:
    """Return a flight with its velocity through the air, and, with a mass, the inflow of hover."""
    mass = result.parameter("mass", owner).value
    return with_hover_inflow(through_air(used), "unknown" if mass is None else mass, vehicle)


def _speed_range(prepared: PreparedFlight) -> tuple[float, float]:
    """Return the range of rotor speeds, before lag and delay [rad/s]."""
    low, high = np.percentile(
        prepared.motor_channel[prepared.data.used_rows], SPEED_PERCENTILES
    ).tolist()
    return low, high


def _select_owner(result: IdentificationResult, configuration: str | None) -> str:
    """Select the configuration of the body."""
    names = configuration_names(result)
    owner = meant_configuration(names, configuration)
    if owner is not None:
        return owner
    raise ExperimentError(
        f"the result has the configurations {', '.join(names)}; say in which of them the flight "
        "was flown (--configuration NAME)"
    )


def _known_values(result: IdentificationResult, owner: str) -> dict[str, float]:
    """Return the values of a configuration; what was removed as unessential counts as zero."""
    known: dict[str, float] = {}
    for p in result.parameters:
        if p.configuration not in (None, owner):
            continue
        value = 0.0 if p.verdict == "removed" else p.value
        if value is not None:
            known[p.name] = value
    known.setdefault("mass", 1.0)
    known |= fitted_thrusts(result, known)
    # As in a replay: both judge the same vehicle.
    places = places_of(result, owner)
    centre = {name: places[name] for name in ROTOR_CENTER if name in places}
    return {f"ms{a}": known["mass"] * places[f"com_{a}"] for a in "xy"} | centre | known


def fitted_response(result: IdentificationResult) -> MotorResponse | None:
    """Return the motors' timing of the fit; a given one is in the preparation already."""
    times = {p.name: p for p in result.parameters if p.name.startswith("motor_")}
    if experiment_of_settings(result.settings).motors.speed == "measured":
        # The lag is between command and speed: measured speeds have it behind them.
        times = {name: p for name, p in times.items() if name == "motor_delay"}
    if all(p.verdict == "given" for p in times.values()):
        return None
    at = {name: p.value for name, p in times.items() if p.value is not None}
    # Where the flights do not show the lag, it is the usual one, with which they were fitted.
    lag = at.get("motor_lag", LAG_PRIOR[0] if "motor_lag" in times else 0.0)
    return MotorResponse(
        lag=at.get("motor_lag_up", lag),
        delay=at.get("motor_delay", 0.0),
        lag_down=at.get("motor_lag_down"),
    )


def _without_bias(
    Z: Float[np.ndarray, "n z"], known: Mapping[str, float]
) -> Float[np.ndarray, "n z"]:
    """Subtract the accelerometer's bias from the specific force."""
    bias = np.array([known.get(f"accel_bias_{axis}", 0.0) for axis in "xyz"])
    clean = Z.copy()
    clean[:, :3] -= bias
    return clean


def _compute_wrenches(
    Z: Float[np.ndarray, "n z"], model: Regressor, known: Mapping[str, float]
) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6"]]:
    """Compute body wrench and rotor wrench; drag and constant torque belong to the rotors."""
    body = {name: known.get(name, 0.0) for name in BODY}
    kt = known.get("kt", 0.0)
    # A rotor whose own coefficient neither the result nor its fit has, has the mean one.
    rotors = {name: known.get(name, kt) for name in model.names if ROTOR_KT.fullmatch(name)}
    for term in TERMS:
        if term not in (*BODY_TERMS, THRUST) and term.owner != "rotor" and not term.of_sensor:
            for move in term.every_move:
                factor = move.factor if move.times is None else known.get(move.times, 0.0)
                rotors[move.entry] = factor * known.get(move.parameter, 0.0)
    return model.residual(Z, body), -model.residual(Z, rotors)


def relative_error(
    body: Float[np.ndarray, "n 6"], rotors: Float[np.ndarray, "n 6"], component: str
) -> float:
    """Compute the norm of the difference over that of the rotor wrench (Table III)."""
    i = COMPONENTS.index(component)
    size = float(np.linalg.norm(rotors[:, i]))
    return float(np.linalg.norm(body[:, i] - rotors[:, i])) / max(size, np.finfo(float).tiny)


def whiteness(residual: Float[np.ndarray, " n"]) -> float:
    """Compute the largest autocorrelation of a residual sampled once per cut-off period."""
    x = residual - residual.mean()
    power = float(x @ x)
    if len(x) <= WHITENESS_LAGS or power == 0.0:
        return 0.0
    return max(abs(float(x[lag:] @ x[:-lag])) for lag in range(1, WHITENESS_LAGS + 1)) / power


def fitted_flights(
    result: IdentificationResult,
) -> list[tuple[ConfigurationEntry, FlightEntry, FlightRecord]]:
    """Pair configuration, entry and record of each flight of the fit.

    The record has the file as the user wrote it; the entry has the path by which it is found.
    """
    entries = [
        (configuration, entry)
        for configuration in experiment_of_settings(result.settings).configuration
        for entry in configuration.flights
    ]
    if len(entries) != len(result.flights):
        raise ExperimentError(
            f"the result was made from {len(result.flights)} flights, but its settings name "
            f"{len(entries)}: it was edited; identify again"
        )
    return [(*entry, record) for entry, record in zip(entries, result.flights, strict=True)]
