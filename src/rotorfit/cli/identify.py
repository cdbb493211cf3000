"""rotorfit identify: the parameters of a vehicle from an experiment file, or from one log."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer

from rotorfit.cli.mass import parse_mass
from rotorfit.cli.terminal import (
    AsJson,
    End,
    Figures,
    Force,
    LogNumber,
    Page,
    Speed,
    Start,
    coloured,
    json_file,
    load_modules,
    print_result,
    print_status,
    quiet_steps,
    read_reply,
    refuse_output_files,
    refuse_output_folder,
    terminal_width,
    write_pictures,
)
from rotorfit.errors import RotorfitError

if TYPE_CHECKING:
    from rotorfit.fit.experiment.experiment import Experiment, IdentificationEntry
    from rotorfit.fit.experiment.flight_entries import FlightEntry
    from rotorfit.identification import Adviser
    from rotorfit.results.result import IdentificationResult
    from rotorfit.tools.control_loop.loop import LoopOutcome

    Table = TypeVar("Table", FlightEntry, IdentificationEntry)

RECIPE = "rotorfit.identification"
"""The module that imports all that a fit needs."""
Source = Annotated[
    Path,
    typer.Argument(metavar="EXPERIMENT|LOG", help="An experiment file (.toml), or one flight log."),
]
Output = Annotated[
    Path | None,
    json_file("the result"),
]
Mass = Annotated[
    str | None, typer.Option(metavar="KG", help='With a log: weighed mass in kg, or "unknown".')
]
AirframeFile = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="With a log: file with [airframe] and [motors]."),
]
Motion = Annotated[
    Literal["imu", "mocap"] | None,
    typer.Option("--source", help="Motion from the IMU (default) or from motion capture."),
]
Method = Annotated[
    Literal["banded", "ols", "tls"] | None,
    typer.Option(
        help="banded (default): all equations and configurations at once; ols: equation by "
        "equation; tls: total least squares, as in the paper. Default: as the experiment file says."
    ),
]
Preset = Annotated[
    Literal["paper"] | None,
    typer.Option(help="paper: exactly as Six et al. 2020, their standard deviations included."),
]

Full = Annotated[
    bool,
    typer.Option(
        "--full", help="Print every number with unit and verdict, all advice and all doubts."
    ),
]

Why = Annotated[
    str | None,
    typer.Option(
        metavar="NUMBER",
        help="Print what makes up the interval of a number, such as Ixx, and what would shrink it.",
    ),
]


def identify(
    source: Source,
    output: Output = None,
    report: Page = None,
    figures: Figures = None,
    mass: Mass = None,
    airframe: AirframeFile = None,
    log: LogNumber = None,
    start: Start = None,
    end: End = None,
    speed: Speed = None,
    motion: Motion = None,
    method: Method = None,
    preset: Preset = None,
    full: Full = False,
    why: Why = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Identify a vehicle's parameters from its flights.

    From an experiment file, which names airframe, masses and flights, or from one log with --mass
    and --airframe, which a log of PX4 with its own rotor geometry does not need.
    """
    window = {"log": log, "start": start, "end": end}
    if source.suffix.lower() == ".toml":
        experiment = _load_experiment(source, {"mass": mass, "airframe": airframe, **window})
    else:
        by_likelihood = method in {None, "banded"} and preset is None
        used = (start, end) if by_likelihood else (None, None)
        experiment = _experiment_of_log(source, mass, airframe, log, used)
    chosen = {"source": motion, "method": method, "preset": preset}
    experiment = _with_options(experiment, chosen, speed, window)
    inputs = [source, *([airframe] if airframe else []), *_flight_files(experiment)]
    refuse_output_files({"-o": output, "--report": report}, inputs=inputs, force=force)
    if figures is not None:
        from rotorfit.report.result_page import ALWAYS

        refuse_output_folder(figures, ALWAYS, force=force)
    result = _identify_with_advice(experiment)
    if output is not None:
        result.save(output, force=force)
        print_status(f"wrote {output}")
    if report is not None or figures is not None:
        _write_pictures(result, experiment, report, figures, force=force)
    if why is not None:
        from rotorfit.cli.why import budget_output

        print_result(budget_output(result, why, as_json=as_json))
        return
    from rotorfit.report.summary import summary_text
    from rotorfit.report.text import result_text
    from rotorfit.tools.planning.next_step import asks_for_a_plan

    written = result_text if full else summary_text
    text = result.to_json() if as_json else coloured(written(result, width=terminal_width()))
    print_result(text.rstrip())
    if output is not None and not as_json and asks_for_a_plan(result):
        print_status(f"next: rotorfit plan --after {shlex.quote(str(output))}")


def identify_quietly(
    experiment: Experiment, *, adviser: Adviser | None = None
) -> IdentificationResult:
    """Identify with a progress display; doubts are printed with the result, not as warnings."""
    from rotorfit.identification import identify

    with quiet_steps() as report_progress:
        return identify(experiment, progress=report_progress, adviser=adviser)


def _identify_with_advice(experiment: Experiment) -> IdentificationResult:
    """Identify, and predict what the manoeuvre gives that sharpens the result most."""
    from rotorfit.tools.planning.next_step import advise_flights

    return identify_quietly(experiment, adviser=advise_flights)


def _load_experiment(source: Path, log_options: Mapping[str, Any]) -> Experiment:
    """Load an experiment file; raise an error if options are given that belong to a single log."""
    from rotorfit.fit.experiment.toml_files import read_toml

    tables = read_toml(source)  # a missing or broken file is reported before heavy imports
    is_airframe = "airframe" in tables and "configuration" not in tables  # `load` says so
    for option, value in log_options.items():
        if value is not None and not is_airframe:
            raise typer.BadParameter(
                f"--{option} belongs to a log; {source.name} is an experiment file, "
                "which says it itself"
            )
    load_modules(RECIPE)
    from rotorfit.fit.experiment.experiment import load_experiment

    return load_experiment(source)


def _experiment_of_log(
    source: Path,
    mass: str | None,
    airframe: Path | None,
    log_number: int | None,
    window: tuple[float | None, float | None],
) -> Experiment:
    """Describe one log by options; refuse a window too short to be fitted before any reading."""
    from rotorfit.logs.files import read_head

    if not source.is_dir():
        read_head(source, 1)  # a missing log is reported before missing options and heavy imports
    if window != (None, None):
        from rotorfit.fit.shortest_flight import refuse_short_window

        refuse_short_window(source.name, *window)
    from rotorfit.logs.read import format_of, own_kind, read_log

    if source.is_dir() and format_of(source) is None:
        read_head(source, 1)
    if own_kind(source) is not None:
        read_log(source)  # which says what it is
    described = airframe
    if airframe is None:
        described = _logged_airframe(source, log_number)
    if described is None:
        number = "" if log_number is None else f" --log {log_number}"
        raise typer.BadParameter(
            "a log also needs --airframe FILE, which describes the vehicle; to write that file: "
            f"rotorfit airframe {shlex.quote(str(source))}{number}"
        )
    if mass is None:
        mass = _asked_mass()
    weighed = parse_mass(mass)
    load_modules(RECIPE)
    from rotorfit.fit.experiment.experiment import single_flight_experiment

    return single_flight_experiment(source, mass=weighed, airframe=described)


def _asked_mass() -> str:
    """Ask for the mass; refuse the command where nobody answers."""
    reply = read_reply('Mass as flown, battery included, such as 0.428 or 428g (or "unknown"): ')
    if not reply:
        print_status("")
        raise typer.BadParameter("a log also needs --mass KG (or --mass unknown)")
    return reply


def _logged_airframe(source: Path, log_number: int | None) -> Mapping[str, Any] | None:
    """Read the vehicle off a log whose parameters describe it, and say so; None for others."""
    from rotorfit.logs import ReadOptions, read_log
    from rotorfit.logs.read import format_of
    from rotorfit.tools.inspection.seen_airframe import logged_tables

    form = format_of(source)
    if form is None or form.name != "ulog":
        return None
    tables = logged_tables(read_log(source, options=ReadOptions(log_number=log_number)))
    if tables is None:
        return None
    arms = [math.hypot(*rotor["position"][:2]) for rotor in tables["airframe"]["rotors"]]
    shown = " to ".join(dict.fromkeys(f"{arm:.3g}" for arm in (min(arms), max(arms))))
    print_status(
        f"rotors by CA_ROTOR* of the log: {len(arms)}, arms of {shown} m, speed "
        f"{tables['motors']['speed']}; if that is not the vehicle, give --airframe FILE"
    )
    return tables


def _with_options(
    experiment: Experiment,
    chosen: Mapping[str, Any],
    speed: Literal["measured", "commanded"] | None,
    window: Mapping[str, Any],
) -> Experiment:
    """Override an experiment's method, rotor speed, and log number and window of its flights."""
    motors = experiment.motors
    if speed is not None:
        # Law and lag turn commands into speed: measured speed has no use for them.
        unused = {"law": None, "lag": None} if speed == "measured" else {}
        motors = motors.model_copy(update={"speed": speed, **unused})
    configurations = [
        entry.model_copy(
            update={"flights": tuple(_override_fields(f, window) for f in entry.flights)}
        )
        for entry in experiment.configuration
    ]
    return experiment.model_copy(
        update={
            "identification": _override_fields(experiment.identification, chosen),
            "motors": motors,
            "configuration": tuple(configurations),
        }
    )


def _override_fields(table: Table, options: Mapping[str, Any]) -> Table:
    """Replace the fields of a table for which an option is given."""
    return table.model_copy(update={key: v for key, v in options.items() if v is not None})


def _flight_files(experiment: Experiment) -> list[Path]:
    """List the logs that are read and must not be overwritten."""
    return [
        Path(flight.file)
        for entry in experiment.configuration
        for flight in (*entry.flights, *entry.validation)
    ]


def _judged_loop(result: IdentificationResult, experiment: Experiment) -> LoopOutcome | None:
    """Judge the rate loop of the first flight, where its log and the result show it."""
    from rotorfit.tools.control_loop.loop import first_flight_margins

    try:
        return first_flight_margins(result, experiment)
    except RotorfitError:
        return None  # `rotorfit loop` says why


def _write_pictures(
    result: IdentificationResult,
    experiment: Experiment,
    report: Path | None,
    figures: Path | None,
    *,
    force: bool,
) -> None:
    from rotorfit.report.result_page import figure_texts, report_html
    from rotorfit.results.validation.validate import drawn_comparisons

    with quiet_steps() as report_progress:
        report_progress("drawing")
        comparisons = drawn_comparisons(result, experiment)
    write_pictures(
        report,
        figures,
        page=lambda: report_html(
            result, comparisons=comparisons, loop=_judged_loop(result, experiment)
        ),
        drawings=lambda: figure_texts(result, comparisons),
        force=force,
    )
