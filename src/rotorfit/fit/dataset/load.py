"""Load an experiment: read its flights, put each on one clock, and refuse what contradicts it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.errors import ExperimentError, FlightError, RotorfitError
from rotorfit.findings import doubts
from rotorfit.fit.dataset.channel_findings import (
    blame_telemetry,
    find_motor_faults,
    has_quick_commands,
    motor_channels_of,
    name_resting_numbers,
    with_mended_commands,
)
from rotorfit.fit.dataset.dataset import ConfigurationData, Dataset, LoadedFlight
from rotorfit.fit.dataset.declared_rotors import check_flights
from rotorfit.fit.dataset.plausible_units import (
    refuse_gyro_in_degrees,
    refuse_rotors_too_fast,
    slow_rotor_doubts,
)
from rotorfit.fit.dataset.through_air import through_air
from rotorfit.fit.experiment.declared_vehicle import (
    imu_tilt_of,
    motor_model_of,
    payload_of,
    read_options_of,
    recording_options_of,
    vehicle_of,
)
from rotorfit.fit.reduction.frequency_bands import EDGES
from rotorfit.fit.shortest_flight import refuse_short_flight, refuse_short_window
from rotorfit.flight.decimate import as_recorded, decimated
from rotorfit.flight.flight_checks import OTHER_MOTOR_DATA
from rotorfit.flight.imu_tilt import levelled
from rotorfit.flight.motors.battery_sag import BatterySag, battery_sag
from rotorfit.flight.motors.command_response import (
    command_responses,
    motor_limits,
    responses_within,
)
from rotorfit.flight.motors.rotor_telemetry import (
    RotorTelemetry,
    State,
    telemetry,
)
from rotorfit.flight.prepare import on_one_clock, prepared_from
from rotorfit.logs import read_log
from rotorfit.logs.flight_log import AIRLESS_ROTORS, DRAGLESS_ROTORS, Channel, FlightLog
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.air import CLIMB, VELOCITY, hover_inflow
from rotorfit.model.terms.registry import added_signals, considered_terms, terms_named

if TYPE_CHECKING:
    from rotorfit.fit.experiment.experiment import ConfigurationEntry, Experiment, MotorsEntry
    from rotorfit.fit.experiment.flight_entries import FlightEntry
    from rotorfit.flight.flight_data import FlightData
    from rotorfit.model.vehicle import Vehicle

REFUSED: tuple[State, ...] = ("dead", "swapped", "apart", "unlike", "coarse")
"""States in which the thrust of a rotor is not what its speed says."""


def refuse_wrong_speeds(flights: Sequence[LoadedFlight], vehicle: Vehicle) -> None:
    """Raise an error if measured speeds contradict their commands, as `inspect` says."""
    for flight in flights:
        if flight.telemetry is None:
            continue
        wrong = [r for r in flight.telemetry.rotors if _is_wrong(r, vehicle)]
        if wrong:
            words = "; ".join(flight.telemetry.doubts)
            remedy = ""
            # A rotor that turns at another ratio may be another propeller: with a group of its own
            # it has a thrust coefficient of its own, and is accepted.
            if all(r.state == "unlike" for r in wrong):
                remedy = (
                    "; correct its poles, or, where it really is another one, give it a group of "
                    'its own (group = "..." in [airframe])'
                )
            raise FlightError(f"{Path(flight.entry.file).name}: {words}{remedy}")


def refuse_short_flights(name: str, flights: Sequence[LoadedFlight]) -> None:
    """Raise where all flights of a configuration together are too short to show what is flown."""
    if flights:
        refuse_short_flight(name, sum(_used_seconds(flight) for flight in flights))


def _used_seconds(flight: LoadedFlight) -> float:
    prepared = flight.prepared
    return sum(len(phase) for phase in prepared.phases) / prepared.data.sample_rate


def _is_wrong(rotor: RotorTelemetry, vehicle: Vehicle) -> bool:
    if rotor.state != "unlike":
        return rotor.state in REFUSED
    declared = vehicle.rotors[rotor.rotor - 1] if rotor.rotor <= len(vehicle.rotors) else None
    return declared is None or declared.group is None


Method = Literal["banded", "ols", "tls"]
Progress = Callable[[str], None]


def ignore_progress(words: str) -> None:
    """Take words on what is being done, and show them to nobody."""
    del words


UNRESPONSIVE: Final[tuple[State, ...]] = ("dead", "still", "swapped", "apart", "stuck", "coarse")
"""States of a rotor from whose command and speed no law can be learnt."""


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
    loaded = tuple(
        _load_configuration(entry, experiment, vehicle, report)
        for entry in experiment.configuration
    )
    flights = [flight for configuration in loaded for flight in configuration.flights]
    _refuse_copies(flights)
    _refuse_mixed_commands(flights)
    carried = any(flight.prepared.data.carried is not None for flight in flights)
    simulators = {f.log.simulator for f in flights}
    asked = experiment.identification.terms is not None
    added = added_signals(
        _terms_considered(experiment, loaded),
        carried=carried,
        rotor_air=asked or not simulators <= {*AIRLESS_ROTORS},
        rotor_drag=not simulators <= {*DRAGLESS_ROTORS},
    )
    if VELOCITY in added and experiment.identification.source == "imu":
        loaded = tuple(
            dataclasses.replace(c, flights=[through_air(f) for f in c.flights]) for c in loaded
        )
    if VELOCITY in added and CLIMB in added:
        loaded = tuple(_felt_where_unknown(configuration) for configuration in loaded)
    return Dataset(
        vehicle=vehicle,
        model=regressor(vehicle, added=added),
        motors=agreed_motors(experiment.motors, flights),
        configurations=loaded,
        source=source,
    )


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


def _load_configuration(
    entry: ConfigurationEntry, experiment: Experiment, vehicle: Vehicle, report: Progress
) -> ConfigurationData:
    """Load the flights of one configuration, screened against its declaration."""
    flights: list[LoadedFlight] = []
    likelihood = resolved_method(experiment) == "banded"
    if likelihood and len(entry.flights) == 1:  # a window too short is refused before reading
        only = entry.flights[0]
        refuse_short_window(entry.name, only.start, only.end)
    for flight in entry.flights:
        report(f"reading {Path(flight.file).name}")
        flights.append(with_hover_inflow(load_flight(flight, experiment), entry.mass, vehicle))
    report("checking axes, units and rotors")
    if experiment.identification.source == "imu":
        for f in flights:
            refuse_gyro_in_degrees(
                {Path(f.entry.file).name: f.prepared.data}, takes_columns=f.log.takes_columns
            )
    if likelihood:
        refuse_short_flights(entry.name, flights)
    motors = agreed_motors(experiment.motors, flights)
    if motors.speed == "measured":
        refuse_wrong_speeds(flights, vehicle)
    check_flights(flights, vehicle, motors)
    return ConfigurationData(
        entry=entry,
        flights=_screen_speeds(flights, vehicle.arm, motors),
        payload=payload_of(entry, experiment.airframe.axes),
    )


def with_hover_inflow(
    flight: LoadedFlight, mass: float | Literal["unknown"], vehicle: Vehicle
) -> LoadedFlight:
    """Return a flight with the air's velocity through its rotors in hover, where it was weighed."""
    # Some simulators have no induced velocity.
    if mass == "unknown" or flight.log.simulator in DRAGLESS_ROTORS:
        return flight
    prepared = flight.prepared
    data = dataclasses.replace(prepared.data, hover_inflow=hover_inflow(mass, vehicle))
    return dataclasses.replace(flight, prepared=dataclasses.replace(prepared, data=data))


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
                f"({_motors_text(first)}; {_motors_text(other)}), and [motors] has no law: "
                "give the one that holds for all, or identify them separately"
            )
    return first.motors


def _motors_text(flight: LoadedFlight) -> str:
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
    """Return whether the model needs the body's velocity: chosen, or known and not decided yet."""
    asked = [term.name for term in terms_named(terms or ()) if term.needs == "velocity"]
    flights = [f for c in configurations for f in c.flights]
    unknown = [f for f in flights if not velocity_known([f])]
    if not unknown or not asked:
        # Known of one flight is enough for terms that nobody asked for: it may need them.
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
        slow = doubts("slow-rotors", slow_rotor_doubts(data, arm, law=law, takes_columns=takes))
        every = (*flight.prepared.findings, *name_resting_numbers(slow))
        prepared = dataclasses.replace(flight.prepared, findings=every)
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


def load_flight(entry: FlightEntry, experiment: Experiment) -> LoadedFlight:
    """Read and prepare one flight, its motion from the IMU or from motion capture.

    `entry`: the flight; it need not be one of the experiment's own. `experiment`: whose vehicle,
    motors and source of motion it has.

    Raises `LogError`, `FlightError`, `FrameError` if it cannot be used; the message names the file.
    """
    try:
        return _load_flight(entry, experiment)
    except RotorfitError as error:
        name = Path(entry.file).name
        if name in str(error):
            raise
        raise type(error)(f"{name}: {error}").about(kind=error.finding.kind) from error


def _load_flight(entry: FlightEntry, experiment: Experiment) -> LoadedFlight:
    motors, source = experiment.motors, experiment.identification.source
    vehicle = vehicle_of(experiment.airframe, source)
    log = read_log(Path(entry.file), options=read_options_of(entry, motors))
    log, speeds_commanded = with_commanded_speeds(log, motors)
    motors = motors if speeds_commanded else completed_motors(motors, log)
    motor_model = motor_model_of(motors)
    seen = telemetry(log) if motors.speed == "measured" else None
    unresponsive = [r.rotor - 1 for r in seen.rotors if r.state in UNRESPONSIVE] if seen else []
    by_commands = motors.speed == "commanded" and has_quick_commands(log)
    motor_log = motor_channels_of(log, measured=bool(seen)) if seen or by_commands else None
    log = with_mended_commands(log) if motor_log else log
    responses = command_responses(log, excluded=unresponsive) if seen else ()
    if entry.mocap is not None:
        recording = read_log(Path(entry.mocap.file), options=recording_options_of(entry.mocap))
        from rotorfit.flight.mocap.align import with_poses

        log = with_poses(log, recording)
    window, count = (entry.start, entry.end), len(vehicle.rotors)
    battery, command = log.channels.get("battery"), log.channels.get("command")
    if source == "mocap":
        from rotorfit.flight.mocap.prepare_mocap import prepare_mocap

        prepared = prepare_mocap(
            log, rotor_count=count, arm=vehicle.arm, motors=motor_model, window=window
        )
        log, recorded = dataclasses.replace(log, channels={}), as_recorded(prepared)
    else:
        on_clock = on_one_clock(log, rotor_count=count, motors=motor_model)
        log = dataclasses.replace(log, channels={})  # a long log as recorded would fill the memory
        try:
            prepared = prepared_from(on_clock, arm=vehicle.arm, motors=motor_model, window=window)
        except FlightError as error:
            raise blame_telemetry(error, seen) from error
        del on_clock
        recorded, tilt = as_recorded(prepared), imu_tilt_of(experiment.airframe)
        if experiment.identification.in_bands:
            prepared = decimated(prepared, motor_model, top=EDGES[-1])
        prepared = prepared if tilt is None else levelled(prepared, tilt)
    stuck = find_motor_faults(motor_log, recorded.spans, prepared.findings) if motor_log else ()
    log = dataclasses.replace(log, findings=name_resting_numbers(log.findings))
    every = name_resting_numbers((*prepared.findings, *stuck))
    prepared = dataclasses.replace(prepared, findings=every)
    return LoadedFlight(
        entry=entry,
        log=log,
        prepared=prepared,
        recorded=recorded,
        speeds_commanded=speeds_commanded,
        telemetry=seen,
        limits=None if command is None else motor_limits(command, recorded.spans),
        command_responses=responses_within(responses, recorded.spans),
        motors=motors,
        battery=_mean_voltage(battery, recorded.spans),
        sag=_measure_sag(battery, prepared.data),
    )


def completed_motors(motors: MotorsEntry, log: FlightLog) -> MotorsEntry:
    """Complete the declared motors by the log's parameters; a declared law stands."""
    logged = log.motors
    if motors.speed == "measured" or logged is None or "command" not in log.channels:
        return motors
    law = motors.law or logged.law
    return motors.model_copy(update={"law": law, "lag_on": motors.lag_on or logged.lag_on})


def _mean_voltage(battery: Channel | None, flown: Sequence[tuple[float, float]]) -> float | None:
    """Return the mean voltage in flight [V]; None if none was logged."""
    if battery is None:
        return None
    inside = np.zeros(len(battery.time), dtype=bool)
    for begin, end in flown:
        inside |= (battery.time >= begin) & (battery.time <= end)
    seen = battery.values[inside & np.isfinite(battery.values[:, 0]), 0]
    return float(seen.mean()) if len(seen) else None


def _measure_sag(battery: Channel | None, data: FlightData) -> BatterySag | None:
    """Measure how far the battery's voltage falls under load in flight."""
    if battery is None:
        return None
    rows = data.used_rows
    seen = np.isfinite(battery.values[:, 0])
    if len(rows) < 2 or int(seen.sum()) < 2:
        return None
    time = data.time[rows]
    voltage = np.empty(len(time))
    voltage[:] = np.interp(time, battery.time[seen], battery.values[seen, 0])
    return battery_sag(time, voltage, data.rotor_speed[rows])


def with_commanded_speeds(log: FlightLog, motors: MotorsEntry) -> tuple[FlightLog, bool]:
    """Take commanded rotor speeds as a log's commands; return the log, and whether it has them.

    Simulators command speeds in rad/s, and so did the paper: the motors follow them with a lag, as
    they follow any command, but no law is needed, and one that is given is refused. Only of motors
    with ``speed = "commanded"`` is a rotor speed a command.
    """
    if motors.speed != "commanded" or "command" in log.channels:
        return log, False
    if "rotor_speed" not in log.channels:
        return log, False
    if motors.law is not None:
        raise ExperimentError(
            f"the log commands rotor speeds ({log.channels['rotor_speed'].source}), and [motors] "
            "has a law from command to speed: leave law out"
        ).about(kind=OTHER_MOTOR_DATA)
    channels = dict(log.channels)
    channels["command"] = channels.pop("rotor_speed")
    return dataclasses.replace(log, channels=channels), True


def velocity_known(flights: list[LoadedFlight]) -> bool:
    """Return whether every used sample of every flight has a velocity, its neighbours too."""
    return all(
        flight.prepared.data.velocity is not None
        and all(
            np.isfinite(flight.prepared.data.velocity[max(s.start - 1, 0) : s.stop + 1]).all()
            for s in flight.prepared.data.segments
        )
        for flight in flights
    )
