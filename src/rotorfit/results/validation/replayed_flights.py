"""Replay the flights of a result, or other ones, with the parameters of several."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import ExperimentError, FlightError, LogError
from rotorfit.fit.dataset.load import load_flight
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.fit.experiment.experiment import Experiment, experiment_of_settings, unseen_entry
from rotorfit.fit.reduction.frequency_bands import retimed
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.air_force import air_wrenches
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.rotors import DRAG_OF_ROTORS
from rotorfit.results.validation.replay import IDENTIFIED, Entrant, Replay, replay
from rotorfit.results.validation.replay_vehicle import AIR_NAMES, ReplayVehicle, replay_vehicle
from rotorfit.results.validation.validate import (
    compare_wrenches,
    fitted_flights,
    fitted_response,
    load_other_flight,
    signals_of_terms,
    with_air_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from rotorfit.fit.dataset.dataset import LoadedFlight
    from rotorfit.fit.experiment.flight_entries import FlightEntry
    from rotorfit.flight.motors.motor_model import MotorResponse
    from rotorfit.flight.prepare import PreparedFlight
    from rotorfit.model.signals import SignalLayout
    from rotorfit.model.vehicle import Vehicle
    from rotorfit.results.result import IdentificationResult
    from rotorfit.results.validation.wrench_comparison import WrenchComparison


@frozen_dataclass
class Timed:
    """A vehicle (and draws of it), and its motors' timing; None leaves flights as prepared."""

    vehicle: ReplayVehicle
    response: MotorResponse | None


def replay_flights(
    result: IdentificationResult,
    owner: str,
    vehicles: Mapping[str, Timed],
    *,
    others: Sequence[Path] = (),
    log_number: int | None = None,
    report: Callable[[str], None] | None = None,
) -> list[Replay]:
    """Replay a configuration's flights, of the fit and kept apart, or other logs in their place.

    `vehicles` by label, each with the timing of the motors found with it. Raises `ExperimentError`
    where a flight of the result is gone, or has changed since the fit; `LogError`, `FlightError` or
    `FrameError` where a log cannot be used.
    """
    return [
        _replay_flight(result, used, owner, vehicles)
        for used in _load_flights(result, owner, others, log_number, report)
    ]


def compared_flights(
    result: IdentificationResult,
    owner: str,
    *,
    others: Sequence[Path] = (),
    log_number: int | None = None,
    report: Callable[[str], None] | None = None,
) -> list[WrenchComparison]:
    """Compare the wrenches of flights that cannot be replayed: of thrust, where that is known.

    Arguments and errors are those of `replay_flights`.
    """
    return [
        compare_wrenches(result, used, configuration=owner)
        for used in _load_flights(result, owner, others, log_number, report)
    ]


def _load_flights(
    result: IdentificationResult,
    owner: str,
    others: Sequence[Path],
    log_number: int | None,
    report: Callable[[str], None] | None,
) -> Iterator[LoadedFlight]:
    """Load the flights of a configuration one by one, or other logs in their place."""
    experiment = experiment_of_settings(result.settings)
    entries = [unseen_entry(path, experiment, log_number=log_number) for path in others]
    for entry in entries or _flights_of(experiment, owner):
        if report is not None:
            report(f"replaying {Path(entry.file).name}")
        yield (
            load_other_flight(entry, experiment)
            if entries
            else _load_unchanged(result, experiment, entry)
        )


def _replay_flight(
    result: IdentificationResult,
    used: LoadedFlight,
    owner: str,
    vehicles: Mapping[str, Timed],
) -> Replay:
    """Replay one loaded flight, and compare its wrenches."""
    experiment = experiment_of_settings(result.settings)
    vehicle = vehicle_of(experiment.airframe, experiment.identification.source)
    flown = with_air_of(result, owner, used, vehicle)
    known = [p.name for p in result.parameters if p.value is not None]
    layout = regressor(vehicle, added=signals_of_terms(used, known)).layout
    found = replay(
        used.prepared.data,
        {
            label: _make_entrant(flown.prepared, vehicle, layout, timed)
            for label, timed in vehicles.items()
        },
        flight=Path(used.entry.file).name,
        sha256=used.log.sha256,
        configuration=owner,
    )
    try:
        compared = compare_wrenches(result, used, configuration=owner)
    except FlightError:
        return found
    return dataclasses.replace(found, comparison=compared)


def _make_entrant(
    flown: PreparedFlight, vehicle: Vehicle, layout: SignalLayout, timed: Timed
) -> Entrant:
    """Return a vehicle with its rotor speeds on a flight, and the air where a velocity is known."""
    data = retimed(flown, timed.response)
    air = None
    if DRAG_OF_ROTORS in layout.added and data.velocity is not None:
        moving = dataclasses.replace(data, velocity=np.nan_to_num(data.velocity))
        found = {name: wrench for _, name, wrench in air_wrenches(moving, vehicle, layout)}
        nothing = np.zeros((len(data.time), 6))
        air = np.stack([found.get(name, nothing) for name in AIR_NAMES], axis=1)
    return Entrant(vehicle=timed.vehicle, rotor_speed=data.rotor_speed, air=air)


def validated_flight(
    result: IdentificationResult, used: LoadedFlight, *, configuration: str | None = None
) -> tuple[WrenchComparison, tuple[Replay, ...]]:
    """Compare the wrenches of a flight, and replay it where the result has all that it takes."""
    compared = compare_wrenches(result, used, configuration=configuration)
    owner = compared.configuration
    try:
        vehicle = replay_vehicle(result, owner)
        timed = Timed(vehicle=vehicle, response=fitted_response(result))
        return compared, (_replay_flight(result, used, owner, {IDENTIFIED: timed}),)
    except (ExperimentError, FlightError):
        return compared, ()


def _flights_of(experiment: Experiment, owner: str) -> list[FlightEntry]:
    return [
        entry
        for configuration in experiment.configuration
        if configuration.name == owner
        for entry in (*configuration.flights, *configuration.validation)
    ]


def _load_unchanged(
    result: IdentificationResult, experiment: Experiment, entry: FlightEntry
) -> LoadedFlight:
    """Load a flight of the result; refuse it where it has changed since the fit."""
    name = Path(entry.file).name
    if not Path(entry.file).exists():
        raise ExperimentError(
            f"the result's flight {name} is no longer where it was ({entry.file}); say where it "
            f"is now (--flight PATH/{name}), or give another flight of this vehicle"
        )
    try:
        used = load_flight(entry, experiment)
    except LogError as error:
        raise LogError(f"{error}; or give another flight of this vehicle (--flight LOG)") from error
    seen = {fitted.file: record.sha256 for _, fitted, record in fitted_flights(result)}
    if used.log.sha256 != seen.get(entry.file, used.log.sha256):
        raise ExperimentError(
            f"{name} has changed since the fit (its SHA-256 is another); identify again, or replay "
            f"it all the same (--flight {name})"
        )
    return used
