"""rotorfit identify: parse, call, print."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import typer

from rotorfit.cli.progress import steps
from rotorfit.errors import ExperimentError, OutputError, RotorfitWarning
from rotorfit.identification.experiment import (
    Experiment,
    load_experiment,
    single_flight_experiment,
)
from rotorfit.identification.identify import identify
from rotorfit.identification.result import IdentificationResult
from rotorfit.report.text import result_text


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifyRequest:
    """What the user asked for, as the command line gave it."""

    source: Path
    output: Path | None
    mass: str | None
    airframe: Path | None
    log: int | None
    method: Literal["ols", "tls"] | None
    preset: Literal["paper"] | None
    force: bool
    as_json: bool


def run(request: IdentifyRequest) -> None:
    """Identify, print the result, and write it where asked."""
    _refuse_existing(request.output, force=request.force)
    experiment = _with_options(_experiment(request), request)
    result = quiet_identify(experiment)
    if request.output is not None:
        result.save(request.output, force=request.force)
    typer.echo(result.to_json() if request.as_json else result_text(result), nl=False)
    if request.output is not None:
        typer.echo(f"wrote {request.output}", err=True)


def quiet_identify(experiment: Experiment) -> IdentificationResult:
    """Identify with a progress display; doubts are printed with the result, not as warnings."""
    with warnings.catch_warnings(), steps() as tell:
        warnings.simplefilter("ignore", RotorfitWarning)
        return identify(experiment, progress=tell)


def _refuse_existing(path: Path | None, *, force: bool) -> None:
    """Refuse to overwrite before the work begins, not after it."""
    if path is not None and path.exists() and not force:
        raise OutputError(f"{path} exists; choose another name, or pass --force to overwrite it")


def _experiment(request: IdentifyRequest) -> Experiment:
    if request.mass is None and request.airframe is None:
        if request.source.suffix.lower() != ".toml":
            raise ExperimentError(
                f"{request.source} is not an experiment file (.toml); for a log give its mass and "
                "airframe too: rotorfit identify LOG --mass KG --airframe AIRFRAME.toml"
            )
        return load_experiment(request.source)
    if request.mass is None or request.airframe is None:
        missing = "--mass KG" if request.mass is None else "--airframe AIRFRAME.toml"
        raise typer.BadParameter(f"a log also needs {missing}")
    return single_flight_experiment(
        request.source, mass=_mass(request.mass), airframe=request.airframe
    )


def _mass(text: str) -> float | Literal["unknown"]:
    if text == "unknown":
        return "unknown"
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(
            f'{text!r} is not a mass; give kilograms such as 0.428, or "unknown"',
            param_hint="--mass",
        ) from None


def _with_options(experiment: Experiment, request: IdentifyRequest) -> Experiment:
    """Return the experiment with what the command line overrides."""
    chosen = {
        key: value
        for key, value in (("method", request.method), ("preset", request.preset))
        if value is not None
    }
    update: dict[str, object] = {}
    if chosen:
        update["identification"] = experiment.identification.model_copy(update=chosen)
    if request.log is not None:
        update["configuration"] = tuple(
            entry.model_copy(
                update={
                    "flights": tuple(
                        flight.model_copy(update={"log": request.log}) for flight in entry.flights
                    )
                }
            )
            for entry in experiment.configuration
        )
    return experiment.model_copy(update=update)
