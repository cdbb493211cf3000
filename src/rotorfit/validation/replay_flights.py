"""Which flights are replayed: a result's own, read again, or others of the same vehicle."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rotorfit.dataset.dataset import LoadedFlight, load_flight
from rotorfit.errors import ExperimentError, LogError
from rotorfit.experiment.experiment import (
    Experiment,
    FlightEntry,
    experiment_of_settings,
    named_flight,
)
from rotorfit.preprocessing.motors.motor_model import MotorResponse
from rotorfit.reduction.frequency_bands import retimed
from rotorfit.results.result import IdentificationResult
from rotorfit.validation.fitted_flights import fitted_flights
from rotorfit.validation.replay import WINDOW, Entrant, Replay, replay
from rotorfit.validation.replay_vehicle import ReplayVehicle


@dataclass(frozen=True, slots=True, kw_only=True)
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
    seconds: float = WINDOW,
    tell: Callable[[str], None] | None = None,
) -> list[Replay]:
    """Return the replays of a configuration's flights, or of others.

    Parameters
    ----------
    result
        With the settings of its experiment, by which flights are read and prepared.
    owner
        The configuration; its flights of the fit, then those kept apart.
    vehicles
        By label, each with the timing of the motors that was found with it.
    others
        Logs to replay instead.
    log_number
        Which log of their files, where they have several, from 1.
    seconds
        Length of a window [s].
    tell
        Is told what is being done.

    Raises
    ------
    ExperimentError
        If a flight of the result is gone, or has changed since the fit.
    LogError, FlightError, FrameError
        If a log cannot be used.
    """
    experiment = experiment_of_settings(result.settings)
    entries = [named_flight(path, log_number=log_number) for path in others]
    replays: list[Replay] = []
    for entry in entries or _own(experiment, owner):
        if tell is not None:
            tell(f"replaying {Path(entry.file).name}")
        used = load_flight(entry, experiment) if entries else _unchanged(result, experiment, entry)
        replays.append(
            replay(
                used.prepared.data,
                {
                    label: Entrant(
                        vehicle=timed.vehicle,
                        rotor_speed=retimed(used.prepared, timed.response).rotor_speed,
                    )
                    for label, timed in vehicles.items()
                },
                flight=Path(entry.file).name,
                sha256=used.log.sha256,
                configuration=owner,
                seconds=seconds,
            )
        )
    return replays


def _own(experiment: Experiment, owner: str) -> list[FlightEntry]:
    return [
        entry
        for configuration in experiment.configuration
        if configuration.name == owner
        for entry in (*configuration.flights, *configuration.validation)
    ]


def _unchanged(
    result: IdentificationResult, experiment: Experiment, entry: FlightEntry
) -> LoadedFlight:
    """Return a flight of the result itself, refused where it is not what the fit has seen."""
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
