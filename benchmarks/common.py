"""What the studies on simulated flights share: truth, scales, and the way through files."""

import os
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from rotorfit.errors import FlightWarning, RotorfitError
from rotorfit.experiment.experiment import load_experiment
from rotorfit.identification.identify import identify
from rotorfit.results.result import IdentificationResult
from rotorfit.simulation import (
    SimulatedFlight,
    SimulatedVehicle,
    layout_vehicle,
    paper_vehicle,
    write_flight_table,
)
from rotorfit.simulation.experiment_files import true_parameters
from rotorfit.simulation.tables import IMU_AND_SPEED
from rotorfit.simulation.views import LoggedChannel

PAPER = '[identification]\npreset = "paper"\n'


def real_data_folder() -> Path:
    """Return where the real logs are: $ROTORFIT_DATA, or ../shared/data beside the repository."""
    beside = Path(__file__).parents[2] / "shared" / "data"
    return Path(os.environ.get("ROTORFIT_DATA") or beside)


def named_vehicle(name: str) -> SimulatedVehicle:
    """Return vehicle A or B of the paper, or a layout."""
    return paper_vehicle(name) if name in ("A", "B") else layout_vehicle(name)


def true_values(flight: SimulatedFlight) -> dict[str, float]:
    """Return what should be found of a flight, by the names of a result."""
    values = true_parameters(flight.truth, rotors=flight.rotor_speed.shape[1])
    bias = zip("xyz", flight.sensors.accel_bias, strict=True)
    values |= {f"accel_bias_{axis}": value for axis, value in bias}
    values["kd_over_kt"] = values["kd"] / values["kt"]
    values["motor_lag_total"] = values["motor_lag"] + values["motor_delay"]
    return values


def scales(flight: SimulatedFlight) -> dict[str, float]:
    """Return what 100 % of each number is: itself, or a size where it may be zero."""
    values = {name: abs(value) for name, value in true_values(flight).items()}
    truth = flight.truth
    Ixx, Iyy, Izz = np.diagonal(truth.com_inertia)
    for name, size in (("xy", Ixx * Iyy), ("xz", Ixx * Izz), ("yz", Iyy * Izz)):
        values[f"I{name}_com"] = values[f"I{name}"] = float(np.sqrt(size))
    values |= {f"com_{a}": 0.2 for a in "xyz"}
    values |= {f"ms{a}": truth.mass * 0.2 for a in "xyz"}
    values |= {f"accel_bias_{a}": 0.2 for a in "xyz"}
    values["Jr"] = values["Jr"] or 1e-3 * float(Izz)
    values["Jr_over_Izz"] = values["Jr_over_Izz"] or 1e-3
    values["rotor_drag"] = 0.1 * truth.mass / 4000.0  # a tenth of the mass per second, four rotors
    values |= {"motor_delay": 0.005, "motor_lag": 0.04, "motor_lag_total": 0.04}
    return values


def experiment_text(flights: Mapping[str, SimulatedFlight], extra: str = "") -> str:
    """Return an experiment with one flight of each configuration, ``A.csv`` of A and so on.

    Parameters
    ----------
    flights
        By the names of the configurations; the vehicle is that of the first.
    extra
        Further tables of the file.
    """
    vehicle = next(iter(flights.values())).vehicle
    rotors = ", ".join(
        f'{{ position = {list(r.position)}, spin = "{r.spin}", axis = {list(r.axis)} }}'
        for r in vehicle.rotors
    )
    place = vehicle.imu_position
    imu = "" if place is None else f"imu = {{ position = {list(place)} }}\n"
    configurations = "".join(
        f'[[configuration]]\nname = "{name}"\nmass = {flight.truth.mass!r}\n'
        f'flights = ["{name}.csv"]\n'
        for name, flight in flights.items()
    )
    return f"[airframe]\nrotors = [{rotors}]\n{imu}{extra}{configurations}"


def identify_flights(
    flights: Mapping[str, SimulatedFlight],
    settings: Sequence[str],
    *,
    channels: Sequence[LoggedChannel] = IMU_AND_SPEED,
) -> Iterator[IdentificationResult | None]:
    """Write the flights, and identify them under each of the settings; None where refused.

    Parameters
    ----------
    flights
        By the names of the configurations.
    settings
        Further tables of the experiment file, one text per result.
    channels
        What the log has.
    """
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        for name, flight in flights.items():
            write_flight_table(flight, Path(folder) / f"{name}.csv", channels=channels)
        path = Path(folder) / "experiment.toml"
        for extra in settings:
            path.write_text(experiment_text(flights, extra), encoding="utf-8")
            try:
                yield identify(load_experiment(path))
            except RotorfitError as error:
                print(f"refused: {error}")
                yield None
