"""Load an experiment: read its flights, put each on one clock, and refuse what contradicts it."""

import dataclasses
from collections.abc import Callable, Sequence
from itertools import combinations
from pathlib import Path
from typing import Literal

import numpy as np

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
    load_flight,
    velocity_known,
)
from rotorfit.errors import ExperimentError
from rotorfit.experiment.declared_vehicle import payload_of, vehicle_of
from rotorfit.experiment.experiment import ConfigurationEntry, Experiment, MotorsEntry
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.air import CLIMB, VELOCITY
from rotorfit.model.terms.registry import added_signals, considered_terms, terms_named
from rotorfit.model.vehicle import Vehicle

Method = Literal["banded", "ols", "tls"]
Progress = Callable[[str], None]


def resolved_method(experiment: Experiment) -> Method:
    """Return the method of an experiment; the preset of the paper brings its own."""
    given = experiment.identification
    method = "tls" if given.preset == "paper" else given.method
    if method == "ols" and len(experiment.configuration) > 1:
        names = ", ".join(entry.name for entry in experiment.configuration)
        raise ExperimentError(
            f'method = "ols" takes one configuration, not {len(experiment.configuration)} '
            f'({names}); use "banded" or "tls", or leave one [[configuration]] in the file'
        )
    return method


def load_dataset(experiment: Experiment, report: Progress) -> Dataset:
    """Read, prepare and screen the flights of every configuration; report each stage in words."""
    source = experiment.identification.source
    vehicle = vehicle_of(experiment.airframe, source)
    loaded = tuple(_load(entry, experiment, vehicle, report) for entry in experiment.configuration)
    flights = [flight for configuration in loaded for flight in configuration.flights]
    _refuse_copies(flights)
    _refuse_mixed_commands(flights)
    carried = any(flight.prepared.data.carried is not None for flight in flights)
    added = added_signals(_terms_considered(experiment, loaded), carried=carried)
    if VELOCITY in added and CLIMB in added:
        loaded = tuple(_felt_where_unknown(configuration) for configuration in loaded)
    return Dataset(
        vehicle=vehicle,
        model=regressor(vehicle, added=added),
        motors=agreed_motors(experiment.motors, flights),
        configurations=loaded,
        source=source,
    ).reduced()


def _felt_where_unknown(configuration: ConfigurationData) -> ConfigurationData:
    """Return a configuration whose flights feel no climb where they know their velocity."""

    def without(flight: LoadedFlight) -> LoadedFlight:
        data = flight.prepared.data
        known = dataclasses.replace(data, climb=np.zeros(len(data.time)))
        return dataclasses.replace(
            flight, prepared=dataclasses.replace(flight.prepared, data=known)
        )

    flights = [without(f) if velocity_known([f]) else f for f in configuration.flights]
    return dataclasses.replace(configuration, flights=flights)


def _load(
    entry: ConfigurationEntry, experiment: Experiment, vehicle: Vehicle, report: Progress
) -> ConfigurationData:
    """Load the flights of one configuration, screened against its declaration."""
    flights: list[LoadedFlight] = []
    for flight in entry.flights:
        report(f"reading {Path(flight.file).name}")
        flights.append(load_flight(flight, experiment))
    report("checking axes, units and rotors")
    if experiment.identification.source == "imu":
        for f in flights:
            refuse_gyro_in_degrees(
                {Path(f.entry.file).name: f.prepared.data}, takes_columns=f.log.takes_columns
            )
    motors = agreed_motors(experiment.motors, flights)
    if motors.speed == "measured":
        refuse_wrong_speeds(flights, vehicle)
    check_flights(flights, vehicle, motors)
    return ConfigurationData(
        entry=entry,
        flights=_screen_speeds(flights, vehicle.arm, motors),
        payload=payload_of(entry, experiment.airframe.axes),
    )


def agreed_motors(declared: MotorsEntry, flights: Sequence[LoadedFlight]) -> MotorsEntry:
    """Return the declared motors, completed by the parameters on which all logs agree."""
    if not flights:
        return declared
    first = flights[0]
    for other in flights:
        if other.motors != first.motors:
            one, two = (Path(f.entry.file).name for f in (first, other))
            raise ExperimentError(
                f"{one} and {two} have other motor parameters in their logs "
                f"({_logged(first)}; {_logged(other)}), and [motors] has no law: give the one that "
                "holds for all, or identify them separately"
            )
    return first.motors


def _logged(flight: LoadedFlight) -> str:
    """Return the motor parameters of a log in words."""
    return "none" if flight.log.motors is None else flight.log.motors.words


def _terms_considered(
    experiment: Experiment, configurations: Sequence[ConfigurationData]
) -> list[str]:
    """Select the optional terms whose signals the fit needs."""
    if resolved_method(experiment) != "banded":
        return []
    terms = experiment.identification.terms
    wanted = velocity_wanted(terms, configurations)
    # A flight without a velocity needs what it feels, whatever the others know.
    felt = not wanted or not all(velocity_known(c.flights) for c in configurations)
    felt = felt and experiment.identification.source == "imu"
    return considered_terms(terms, velocity=wanted, felt=felt)


def velocity_wanted(
    terms: Sequence[str] | None, configurations: Sequence[ConfigurationData]
) -> bool:
    """Return whether the model needs the body's velocity: chosen, or known and not decided yet.

    Known of one flight is enough for terms that nobody asked for: it may need them, and the others
    do without.
    """
    asked = [term.name for term in terms_named(terms or ()) if term.needs == "velocity"]
    flights = [f for c in configurations for f in c.flights]
    unknown = [f for f in flights if not velocity_known([f])]
    if not unknown or not asked:
        return bool(asked) or (terms is None and len(unknown) < len(flights))
    names = ", ".join(Path(flight.entry.file).name for flight in unknown)
    raise ExperimentError(
        f'terms has "{asked[0]}", but {names} has no velocity of the body throughout the flight: '
        "log it (columns vel_x, vel_y, vel_z in body axes, or position and attitude of motion "
        f'capture), or take "{asked[0]}" out'
    )


def _screen_speeds(
    flights: list[LoadedFlight], arm: float, motors: MotorsEntry
) -> list[LoadedFlight]:
    """Refuse impossible rotor speeds, and add a warning to flights with unusual ones."""
    law = motors.law is not None
    commands = motors.speed == "commanded" and not any(f.speeds_commanded for f in flights)
    if commands and motors.law_is_relative:
        return flights  # a command without a law has no unit that could be wrong
    screened: list[LoadedFlight] = []
    for flight in flights:
        data, takes = flight.prepared.data, flight.log.takes_columns
        name = Path(flight.entry.file).name
        refuse_rotors_too_fast({name: data}, arm, law=law, takes_columns=takes)
        slow = slow_rotor_doubts(data, arm, law=law, takes_columns=takes)
        prepared = dataclasses.replace(flight.prepared, warnings=(*flight.prepared.warnings, *slow))
        screened.append(dataclasses.replace(flight, prepared=prepared))
    return screened


def _refuse_copies(flights: list[LoadedFlight]) -> None:
    """Refuse a flight that is there twice, under two names or in two configurations."""
    for flight, other in combinations(flights, 2):
        if flight.log.sha256 == other.log.sha256 and flight.entry.overlaps(other.entry):
            one, two = (Path(used.entry.file).name for used in (flight, other))
            same = "is listed twice" if one == two else f"has the same content as {one}"
            raise ExperimentError(
                f"{two} {same}; it would count twice: list it once, with the mass that it flew with"
            )


def _refuse_mixed_commands(flights: list[LoadedFlight]) -> None:
    """Refuse flights of which some command rotor speeds and others shares of full output."""
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
