"""Do the measured rotor speeds go with the commands of the same log? What inspect finds too."""

from collections.abc import Sequence
from pathlib import Path

from rotorfit.dataset.dataset import LoadedFlight
from rotorfit.errors import FlightError
from rotorfit.model.vehicle import Vehicle
from rotorfit.preprocessing.motors.rotor_telemetry import RotorTelemetry, State

REFUSED: tuple[State, ...] = ("dead", "swapped", "apart", "unlike")
"""States in which the thrust of a rotor is not what its speed says."""


def refuse_wrong_speeds(flights: Sequence[LoadedFlight], vehicle: Vehicle) -> None:
    """Raise where measured speeds contradict the commands that made them, as `inspect` says.

    A rotor that turns at another ratio may be another propeller: with a group of its own it has a
    thrust coefficient of its own, and is accepted.
    """
    for flight in flights:
        if flight.telemetry is None:
            continue
        wrong = [r for r in flight.telemetry.rotors if _is_wrong(r, vehicle)]
        if wrong:
            words = "; ".join(flight.telemetry.doubts)
            remedy = ""
            if all(r.state == "unlike" for r in wrong):
                remedy = (
                    "; correct its poles, or, where it really is another one, give it a group of "
                    'its own (group = "..." in [airframe])'
                )
            raise FlightError(f"{Path(flight.entry.file).name}: {words}{remedy}")


def _is_wrong(rotor: RotorTelemetry, vehicle: Vehicle) -> bool:
    if rotor.state != "unlike":
        return rotor.state in REFUSED
    declared = vehicle.rotors[rotor.rotor - 1] if rotor.rotor <= len(vehicle.rotors) else None
    return declared is None or declared.group is None
