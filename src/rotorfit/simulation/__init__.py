"""Flights with known truth, the independent reference; shares no line with the regressor.

A name is imported when it is first used: who plans with a stick's name needs no simulator.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rotorfit.simulation.controller import Gains as Gains
    from rotorfit.simulation.experiment_files import exact_flight_data as exact_flight_data
    from rotorfit.simulation.experiment_files import flight_table as flight_table
    from rotorfit.simulation.experiment_files import sampled_flight_data as sampled_flight_data
    from rotorfit.simulation.experiment_files import to_flight_log as to_flight_log
    from rotorfit.simulation.experiment_files import write_flight_table as write_flight_table
    from rotorfit.simulation.experiments import SimulatedVehicle as SimulatedVehicle
    from rotorfit.simulation.experiments import layout_vehicle as layout_vehicle
    from rotorfit.simulation.experiments import paper_vehicle as paper_vehicle
    from rotorfit.simulation.experiments import variant as variant
    from rotorfit.simulation.flight import Scenario as Scenario
    from rotorfit.simulation.flight import simulate_flight as simulate_flight
    from rotorfit.simulation.pilot import STILL as STILL
    from rotorfit.simulation.pilot import Course as Course
    from rotorfit.simulation.pilot import Stick as Stick
    from rotorfit.simulation.pilot import Sticks as Sticks
    from rotorfit.simulation.sensors import PERFECT as PERFECT
    from rotorfit.simulation.sensors import TYPICAL as TYPICAL
    from rotorfit.simulation.sensors import Sensors as Sensors
    from rotorfit.simulation.sensors import SimulatedFlight as SimulatedFlight
    from rotorfit.simulation.sensors import measure as measure
    from rotorfit.simulation.truth import GRAVITY as GRAVITY
    from rotorfit.simulation.truth import Truth as Truth
    from rotorfit.simulation.truth import with_payload as with_payload

_MODULES = {
    "Gains": "controller",
    "exact_flight_data": "experiment_files",
    "flight_table": "experiment_files",
    "sampled_flight_data": "experiment_files",
    "to_flight_log": "experiment_files",
    "write_flight_table": "experiment_files",
    "SimulatedVehicle": "experiments",
    "layout_vehicle": "experiments",
    "paper_vehicle": "experiments",
    "variant": "experiments",
    "Scenario": "flight",
    "simulate_flight": "flight",
    "STILL": "pilot",
    "Course": "pilot",
    "Stick": "pilot",
    "Sticks": "pilot",
    "PERFECT": "sensors",
    "TYPICAL": "sensors",
    "Sensors": "sensors",
    "SimulatedFlight": "sensors",
    "measure": "sensors",
    "GRAVITY": "truth",
    "Truth": "truth",
    "with_payload": "truth",
}


def __getattr__(name: str) -> Any:
    """Import a public name from its module."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
