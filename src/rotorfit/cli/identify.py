"""rotorfit identify: parse, call, print."""

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import typer

from rotorfit.cli.outputs import refuse_output_file, refuse_output_folder
from rotorfit.cli.pictures import figure_names, write_pictures
from rotorfit.cli.progress import steps
from rotorfit.cli.terminal import painted, say, show, terminal_width
from rotorfit.errors import ExperimentError, RotorfitWarning
from rotorfit.experiment.experiment import (
    ConfigurationEntry,
    Experiment,
    MotorsEntry,
    load_experiment,
    single_flight_experiment,
)
from rotorfit.identification.identify import identify
from rotorfit.logs.files import read_head
from rotorfit.logs.read import own_kind, read_log
from rotorfit.report.text import result_text
from rotorfit.results.result import IdentificationResult

Window = tuple[float | None, float | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifyRequest:
    """What the user asked for, as the command line gave it."""

    source: Path
    output: Path | None = None
    report: Path | None = None
    figures: Path | None = None
    mass: str | None = None
    airframe: Path | None = None
    log: int | None = None
    window: Window = (None, None)
    speed: Literal["measured", "commanded"] | None = None
    motion: Literal["imu", "mocap"] | None = None
    method: Literal["banded", "ols", "tls"] | None = None
    preset: Literal["paper"] | None = None
    force: bool = False
    as_json: bool = False

    @property
    def is_experiment(self) -> bool:
        """Whether the source is an experiment file, going by its name."""
        return self.source.suffix.lower() == ".toml"


def run(request: IdentifyRequest) -> None:
    """Identify, print the result, and write it where asked."""
    experiment = _with_options(_experiment(request), request)
    for path in (request.output, request.report):
        if path is not None:
            refuse_output_file(path, inputs=_inputs(experiment, request), force=request.force)
    if request.output is not None and request.output == request.report:
        raise typer.BadParameter("-o and --report name the same file")
    if request.figures is not None:
        refuse_output_folder(request.figures, figure_names(), force=request.force)
    result = quiet_identify(experiment)
    if request.output is not None:
        result.save(request.output, force=request.force)
        say(f"wrote {request.output}")
    if request.report is not None or request.figures is not None:
        write_pictures(
            result, experiment, report=request.report, figures=request.figures, force=request.force
        )
    text = painted(result_text(result, width=terminal_width()))
    show((result.to_json() if request.as_json else text).rstrip())


def quiet_identify(experiment: Experiment) -> IdentificationResult:
    """Identify with a progress display; doubts are printed with the result, not as warnings."""
    with warnings.catch_warnings(), steps() as tell:
        warnings.simplefilter("ignore", RotorfitWarning)
        return identify(experiment, progress=tell)


def _inputs(experiment: Experiment, request: IdentifyRequest) -> list[Path]:
    """Return every file that is read, none of which may be written over."""
    flights = [
        Path(flight.file)
        for entry in experiment.configuration
        for flight in (*entry.flights, *entry.validation)
    ]
    return [request.source, *([request.airframe] if request.airframe else []), *flights]


def _experiment(request: IdentifyRequest) -> Experiment:
    if request.is_experiment:
        _refuse_options_of_a_log(request)
        return load_experiment(request.source)
    read_head(request.source, 1)  # a log that is not there is said before what else is missing
    if own_kind(request.source) is not None:
        read_log(request.source)  # which says what it is
    if request.mass is None or request.airframe is None:
        missing = [
            words
            for words, given in (
                ("--mass KG", request.mass),
                ("--airframe AIRFRAME.toml", request.airframe),
            )
            if given is None
        ]
        raise typer.BadParameter(
            f"a log also needs {' and '.join(missing)} (an experiment file ends in .toml)"
        )
    return single_flight_experiment(
        request.source, mass=_mass(request.mass), airframe=request.airframe
    )


def _refuse_options_of_a_log(request: IdentifyRequest) -> None:
    given = {
        "--mass": request.mass,
        "--airframe": request.airframe,
        "--log": request.log,
        "--start": request.window[0],
        "--end": request.window[1],
    }
    for option, value in given.items():
        if value is not None:
            raise typer.BadParameter(
                f"{option} belongs to a log; {request.source.name} is an experiment file, "
                "which says it itself"
            )


def _mass(text: str) -> float | Literal["unknown"]:
    if text == "unknown":
        return "unknown"
    try:
        mass = float(text)
    except ValueError:
        raise typer.BadParameter(
            f'{text!r} is not a mass; give kilograms such as 0.428, or "unknown"',
            param_hint="--mass",
        ) from None
    if not (math.isfinite(mass) and mass > 0):
        raise ExperimentError(
            f"--mass is {text}, expected more than 0 kg; weigh the vehicle as it flies, battery "
            'included, or give "unknown"'
        )
    return mass


def _with_options(experiment: Experiment, request: IdentifyRequest) -> Experiment:
    """Return the experiment with what the command line overrides."""
    given = {"source": request.motion, "method": request.method, "preset": request.preset}
    chosen = {key: value for key, value in given.items() if value is not None}
    return experiment.model_copy(
        update={
            "identification": experiment.identification.model_copy(update=chosen),
            "motors": _motors(experiment.motors, request),
            "configuration": tuple(_chosen(c, request) for c in experiment.configuration),
        }
    )


def _motors(motors: MotorsEntry, request: IdentifyRequest) -> MotorsEntry:
    """Return the motors with the speed that was asked for."""
    if request.speed is None:
        return motors
    # Law and lag turn commands into speed: measured speed has no use for them.
    idle = {"law": None, "lag": None} if request.speed == "measured" else {}
    return motors.model_copy(update={"speed": request.speed, **idle})


def _chosen(entry: ConfigurationEntry, request: IdentifyRequest) -> ConfigurationEntry:
    """Return a configuration with the log and the window that were asked for in its flights."""
    given = {"log": request.log, "start": request.window[0], "end": request.window[1]}
    update = {key: value for key, value in given.items() if value is not None}
    flights = tuple(flight.model_copy(update=update) for flight in entry.flights)
    return entry.model_copy(update={"flights": flights})
