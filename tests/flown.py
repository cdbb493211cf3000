"""Experiments on simulated and real flights: written as files, read back, identified."""

import copy
import dataclasses
import warnings
from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path

from rotorfit.errors import FlightWarning
from rotorfit.findings import Finding
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.model.vehicle import Rotor, Vehicle
from rotorfit.results.result import IdentificationResult
from rotorfit.simulation import (
    Scenario,
    SimulatedFlight,
    SimulatedVehicle,
    layout_vehicle,
    paper_vehicle,
    simulate_flight,
    variant,
    write_flight_table,
)

VEHICLES = ("A", "B", "quad-x", "hexa-x", "octo", "x8", "hexa-tilted")


def with_findings(result: IdentificationResult, *findings: Finding) -> IdentificationResult:
    """Return a result that has further findings."""
    return dataclasses.replace(result, findings=(*result.findings, *findings))


def advised(result: IdentificationResult) -> IdentificationResult:
    """Return a result with what its simulated vehicle needs, as `identify` makes it."""
    from rotorfit.tools.planning.next_step import advise_flights

    advice = advise_flights(result)
    if advice is None:
        return result
    parameters = [
        dataclasses.replace(p, advice=words, asks=asks)
        for p in result.parameters
        for words, asks in [advice.by_number.get(p.full_name, (p.advice, p.asks))]
    ]
    return with_findings(
        dataclasses.replace(result, parameters=tuple(parameters)), *advice.findings
    )


def simulated_vehicle(name: str) -> SimulatedVehicle:
    return paper_vehicle(name) if name in ("A", "B") else layout_vehicle(name)


def simulated(name: str, kind: str = "clean", *, seed: int, **scenario: object) -> SimulatedFlight:
    """Return a flight of a named vehicle with the sensors of a variant; its arrays are the test's.

    What was flown lately for another test is not flown again.
    """
    return copy.deepcopy(_fly_once(name, kind, seed, tuple(sorted(scenario.items()))))


@lru_cache(maxsize=16)  # of some megabytes each
def _fly_once(
    name: str, kind: str, seed: int, scenario: tuple[tuple[str, object], ...]
) -> SimulatedFlight:
    flown, sensors = variant(simulated_vehicle(name), kind)
    return simulate_flight(*flown, Scenario(**{"sensors": sensors, **dict(scenario)}), seed=seed)


def airframe_table(vehicle: Vehicle) -> str:
    rotors = ", ".join(_rotor(rotor) for rotor in vehicle.rotors)
    place, off = list(vehicle.imu_position or ()), vehicle.imu_position_std
    imu = f"imu = {{ position = {place}, position_std = {off} }}\n" if place else ""
    return f"[airframe]\nrotors = [{rotors}]\narm_std = {vehicle.arm_std}\n{imu}"


def experiment_file(
    path: Path,
    vehicle: Vehicle,
    flights: Sequence[Path],
    *,
    mass: float | str,
    extra: str = "",
) -> Path:
    """Write an experiment with one configuration."""
    files = ", ".join(f'"{flight}"' for flight in flights)
    weight = f'"{mass}"' if isinstance(mass, str) else repr(float(mass))
    text = f"{airframe_table(vehicle)}\n{extra}\n[[configuration]]\nmass = {weight}\n"
    path.write_text(f"{text}flights = [{files}]\n", encoding="utf-8")
    return path


def identified(
    folder: Path,
    flights: Sequence[SimulatedFlight],
    *,
    vehicle: Vehicle | None = None,
    mass: float | str | None = None,
    extra: str = "",
) -> IdentificationResult:
    """Write flights and an experiment into a folder, and identify from the files."""
    tables: list[Path] = []
    for number, flight in enumerate(flights):
        tables.append(folder / f"flight{number}.csv")
        tables[-1].unlink(missing_ok=True)
        write_flight_table(flight, tables[-1])
    first = flights[0]
    path = experiment_file(
        folder / "experiment.toml",
        vehicle or first.vehicle,
        [table.relative_to(folder) for table in tables],
        mass=first.truth.mass if mass is None else mass,
        extra=extra,
    )
    return quietly_identified(path)


def runs(
    folder: Path, kind: str, *, seeds: Iterable[int], extra: str = "", **scenario: object
) -> list[tuple[SimulatedFlight, IdentificationResult]]:
    """Return a flight of vehicle A for each seed, with its result."""
    flights = [simulated("A", kind, seed=seed, **scenario) for seed in seeds]
    return [(flight, identified(folder, [flight], extra=extra)) for flight in flights]


def quietly_identified(path: Path) -> IdentificationResult:
    """Identify; doubts about a flight are expected, other warnings are not."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        return identify(load_experiment(path))


def _rotor(rotor: Rotor) -> str:
    place, axis = list(rotor.position), list(rotor.axis)
    group = f', group = "{rotor.group}"' if rotor.group is not None else ""
    return f'{{ position = {place}, spin = "{rotor.spin}", axis = {axis}{group} }}'
