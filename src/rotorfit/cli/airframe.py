"""rotorfit airframe: ask for lengths that a ruler measures, and write the file."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from rotorfit.cli.airframe_text import (
    airframe_text,
    listed_text,
    logged_text,
    proposal_text,
    table_text,
)
from rotorfit.cli.terminal import (
    Force,
    LogNumber,
    OutputFile,
    Speed,
    load_modules,
    print_result,
    print_status,
    read_reply,
    refuse_output_file,
    steps,
)
from rotorfit.errors import LIST_ROTORS, ExperimentError, OutputError

if TYPE_CHECKING:
    from rotorfit.logs import ReadOptions
    from rotorfit.tools.inspection.seen_airframe import SeenAirframe

SMALLEST, LARGEST = 15.0, 10_000.0
"""Limits of a spacing [mm]."""
SPIN_WORDS = {"cw": "clockwise", "ccw": "counterclockwise"}
"""How a rotor turns, seen from above, in a sentence."""
Layout = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="quad-x, quad-plus, hexa-x, ...; asked for if not given."),
]
Order = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Motor numbering: px4, ardupilot, betaflight, crazyflie; asked for if not given.",
    ),
]
Spins = Annotated[
    Literal["usual", "reversed"] | None,
    typer.Option(
        help="Spins of a named layout: usual for its order (props in), or reversed (props out); "
        "asked for if neither given nor shown by the flight."
    ),
]
Spacing = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y",
        help="Between the motor axes, front to back and left to right [mm]; asked for if not "
        "given.",
    ),
]

Named = Annotated[
    list[str] | None,
    typer.Option(
        "--column",
        metavar="NAME=COLUMN",
        help="For a table: which column is time, gyro_x, accel_x, rotor_1, command_1, ..., where "
        "its name does not tell; NAME= leaves one out; repeatable.",
    ),
]
Units = Annotated[
    list[str] | None,
    typer.Option(
        "--unit",
        metavar="CHANNEL=UNIT",
        help="For a table: the unit where nothing in it tells, or the proposed one is wrong, such "
        "as gyro=deg/s, motors=rpm, accel=g or time=us; repeatable.",
    ),
]
TableAxes = Annotated[
    Literal["FLU", "FRD"] | None,
    typer.Option(help="For a table: its body axes, where those that gravity shows are wrong."),
]
Poles = Annotated[
    int | None,
    typer.Option(min=2, max=60, metavar="N", help="For rotor speeds in erpm: magnets of a motor."),
]


def airframe(
    log: Annotated[
        Path | None,
        typer.Argument(
            metavar="LOG",
            help="A flight of the vehicle: it shows motor order and spins. Or an experiment file "
            "(.toml): its first flight.",
        ),
    ] = None,
    output: OutputFile = Path("airframe.toml"),
    log_number: LogNumber = None,
    layout: Layout = None,
    order: Order = None,
    spacing: Spacing = None,
    spins: Spins = None,
    speed: Speed = None,
    column: Named = None,
    unit: Units = None,
    axes: TableAxes = None,
    poles: Poles = None,
    force: Force = False,
) -> None:
    """Write the airframe file that other commands need.

    Asks for what a ruler measures; a log fills in what the flight shows: the number of motors,
    their order and spins, and whether their speed was measured. Of a table with columns of its own
    names it proposes which is which and in what unit, and the file keeps that for later.
    """
    from rotorfit.logs.files import read_head, write_whole

    refuse_output_file(output, inputs=[] if log is None else [log], force=force)
    if log is not None and spacing is not None:
        _parse_spacing(spacing)  # refused before the log is read, not after
    if log is not None and not log.is_dir():
        read_head(log, 1)  # a missing log is reported before heavy imports
    load_modules("rotorfit.tools.inspection.seen_airframe")
    from rotorfit.tools.inspection.seen_airframe import SeenAirframe

    table = None if log is None else _table_of(log, column, unit, axes=axes, poles=poles)
    seen = SeenAirframe() if log is None else _seen_in(log, log_number, table)
    if table is not None and not seen.borne_out:
        layout, order = _shown_by_names(table, layout, order)
    given = (layout, order, spacing)
    if seen.rotors_table and given == (None, None, None):
        text = logged_text(seen.rotors_table, speed=speed or str(seen.speed))
    elif seen.sites and layout is None and order is None:
        spaces, given_speed = _parse_spacing(spacing), speed or str(seen.speed)
        source = "the flight" if seen.sites_flown else "CA_ROTOR* of the log"
        text = listed_text(seen.sites, spaces, speed=given_speed, source=source)
    else:
        text = _named_text(seen, layout, order, spacing=spacing, speed=speed, spins=spins)
    if table is not None:
        text += table_text(table)
    _refuse_unreadable(text)
    write_whole(output, text, force=force)
    # Of a table its columns say so.
    source = " --source mocap" if seen.posed and table is None else ""
    print_result(f"{text}\nwritten to {output}; next:")
    for line in _next_lines(log, log_number, output, mapped=table is not None, source=source):
        print_result(f"  {line}")


def _next_lines(
    log: Path | None, log_number: int | None, output: Path, *, mapped: bool, source: str
) -> list[str]:
    """Write what comes after the airframe file, commands as a shell takes them."""
    file = shlex.quote(str(output))
    if log is None:
        return [f"fly, then identify the log with --airframe {file}"]
    flight = shlex.quote(str(log))
    if log.suffix.lower() == ".toml":
        return [
            f"put these tables in the place of those of {log}, then",
            f"rotorfit identify {flight}",
        ]
    number = "" if log_number is None else f" --log {log_number}"
    looked = [f"rotorfit inspect {flight} --airframe {file}"] if mapped else []
    return [*looked, f"rotorfit identify {flight}{number} --airframe {file}{source}"]


def _table_of(
    log: Path,
    column: list[str] | None,
    unit: list[str] | None,
    *,
    axes: Literal["FLU", "FRD"] | None,
    poles: int | None,
) -> ReadOptions | None:
    """Propose and print the columns of an unknown table; None for every other log."""
    from rotorfit.logs import ReadOptions
    from rotorfit.logs.proposal import explains_itself, propose_columns
    from rotorfit.logs.read import format_of, own_kind

    form = None if own_kind(log) else format_of(log)
    if form is None or form.name != "table" or log.suffix.lower() == ".toml":
        if column or unit or axes:
            raise ExperimentError(
                f"{log}: --column, --unit and --axes are for tables (CSV, Parquet)"
            )
        return None
    named, units = (
        _split_pairs(column, "--column gyro_x=COLUMN"),
        _split_pairs(unit, "--unit gyro=deg/s"),
    )
    if not named and not units and axes is None and explains_itself(log):
        return None
    with steps() as report_progress:
        report_progress(f"reading {log.name}")
        proposal = propose_columns(log, named=named, units=units, axes=axes)
    print_status(proposal_text(proposal))
    for question in proposal.questions:
        choices = list(question.choices)
        words = f"{question.words}: {', '.join(choices)}"
        reply = _ask_choice(choices, words, choices[0], question.option)
        units = {question.channel: reply, **units}
    if proposal.questions:
        proposal = propose_columns(log, named=named, units=units, axes=axes)
    if any(spec.unit == "erpm" for spec in proposal.columns.values()) and poles is None:
        reply = _ask_question(
            "Magnets of a motor's bell, as for erpm (often 14)", None, "--poles N"
        )
        if not reply.isdecimal():
            raise ExperimentError(f"{reply!r} magnets; expected an even number such as 14")
        poles = int(reply)
    return ReadOptions(columns=proposal.columns, axes=proposal.axes, motor_poles=poles)


def _split_pairs(given: list[str] | None, example: str) -> dict[str, str]:
    """Split NAME=VALUE of an option."""
    pairs = [one.partition("=") for one in given or []]
    if any(not (name and sign) for name, sign, _ in pairs):
        raise typer.BadParameter(f"expected such as {example}")
    return {name.strip(): value.strip() for name, _, value in pairs}


def _named_text(
    seen: SeenAirframe,
    layout: str | None,
    order: str | None,
    *,
    spacing: str | None,
    speed: str | None,
    spins: str | None,
) -> str:
    """Write the airframe file of a named layout; ask for what is neither given nor seen."""
    from rotorfit.model.vehicle import LAYOUTS

    layout = _layout_or_order("layout", layout, seen, _list_layouts(seen))
    orders = [order for name, order in LAYOUTS if name == layout]
    order = _layout_or_order("order", order, seen, orders)
    spaces = _parse_spacing(spacing)
    given_speed = speed or seen.speed
    if given_speed is None:
        question = "Rotor speed in the log: measured (ESC telemetry, bidirectional DShot) or "
        choices = ["measured", "commanded"]
        given_speed = _ask_choice(choices, f"{question}commanded", "commanded", "--speed")
    turned = _turned_spins(seen, layout, order, spins)
    return airframe_text(layout, order, spaces, speed=given_speed, turned=turned)


def _seen_in(path: Path, log_number: int | None, table: ReadOptions | None) -> SeenAirframe:
    """Read the airframe off a log, a table by its columns, and print it."""
    from rotorfit.cli.inspect import logs_of_experiment
    from rotorfit.logs import ReadOptions, read_log
    from rotorfit.tools.inspection.seen_airframe import motors_in_flight, seen_airframe

    options = table or ReadOptions(log_number=log_number)
    if path.suffix.lower() == ".toml":
        flight = logs_of_experiment(path)[0]
        path = flight.path
        options = replace(flight.read, log_number=flight.read.log_number or log_number)
    with steps() as report_progress:
        report_progress(f"reading {path.name}")
        log = read_log(path, options=options)
        report_progress(f"looking at {path.name}")
        seen = seen_airframe(log, *motors_in_flight(log))
    if seen.rotors is None:
        raise ExperimentError(
            f"{path}: no motors in this log, so it shows nothing of the rotors: leave it "
            "out and answer the questions, or give a log with motor outputs"
        )
    print_status(f"{path.name}: {log.format}, {seen.rotors} motors, rotor speed {seen.speed}")
    if seen.rotors_table:
        print_status("CA_ROTOR* in the log gives order, spins and places of the rotors: check them")
    elif seen.sites and not seen.sites_flown:
        print_status("CA_ROTOR* in the log gives order and spins of the motors, not their size")
        return seen
    print_status(_shown_by_flight(seen))
    return seen


def _shown_by_flight(seen: SeenAirframe) -> str:
    """State which of layout, motor order and spins the flight shows."""
    if seen.sites_flown:
        motors = (
            f"motor {number} {_place_words(x, y)} ({SPIN_WORDS[spin]})"
            for number, (x, y, spin) in enumerate(seen.sites, start=1)
        )
        return f"the flight shows where each motor is: {', '.join(motors)}"
    if not seen.borne_out:
        return "the flight shows neither layout nor motor order nor spins: look at the vehicle"
    found = f"the flight shows the layout ({seen.layout}), the motor order ({seen.order})"
    if not seen.spins_shown:
        return f"{found}, but not the spins: yaw hardly moves"
    usual = "every one reversed, props out" if seen.turned else "as usual for that order"
    return f"{found} and the spins ({usual})"


def _shown_by_names(
    table: ReadOptions, layout: str | None, order: str | None
) -> tuple[str | None, str | None]:
    """Complete layout and order by the corners that a table's columns of motors name, if any."""
    from rotorfit.logs.column_names import is_by_corner

    motors = [spec for name, spec in (table.columns or {}).items() if name[-1].isdecimal()]
    if len(motors) % 4 or not motors or not all(is_by_corner(spec.name) for spec in motors):
        return layout, order
    return layout or "quad-x", order or "px4"


def _list_layouts(seen: SeenAirframe) -> list[str]:
    """List the layouts with the log's number of rotors."""
    from rotorfit.model.vehicle import LAYOUTS

    names = dict.fromkeys(name for name, _ in LAYOUTS)
    return [
        name
        for name in names
        if seen.rotors in (None, len(next(s for (n, _), s in LAYOUTS.items() if n == name)))
    ]


def _layout_or_order(
    key: Literal["layout", "order"], given: str | None, seen: SeenAirframe, choices: list[str]
) -> str:
    """Select layout or order: as given, else as the flight shows, else by a question."""
    shown = seen.layout if key == "layout" else seen.order
    if not choices:
        raise ExperimentError(f"no named layout has {seen.rotors} rotors: {LIST_ROTORS}")
    # A wrong order would be accepted by many a later command: it is never a default by itself.
    default = shown if shown in choices else choices[0] if key == "layout" else ""
    if given is None and seen.borne_out and shown in choices:
        return str(shown)
    question = f"{key.capitalize()} ({', '.join(choices)})"
    only = choices[0] if len(choices) == 1 else None
    if key == "order" and not (given or only or default):
        print_status(f"Of another motor order than those below, {LIST_ROTORS}")
    reply = given or only or _ask_choice(choices, question, default, f"--{key}")
    if reply not in choices:
        near = get_close_matches(reply, choices, n=1, cutoff=0.5)
        hint = f"; did you mean {near[0]}?" if near else ""
        other = f". Of any other order, {LIST_ROTORS}" if key == "order" and not near else ""
        raise ExperimentError(f"{key} {reply!r}; expected one of {', '.join(choices)}{hint}{other}")
    if seen.borne_out and shown not in (None, reply):
        print_status(
            f"the flight responds like {key} {shown}, not {reply}: make sure that it is right"
        )
    return reply


def _turned_spins(seen: SeenAirframe, layout: str, order: str, given: str | None) -> bool:
    """Return whether every spin is reversed: as given, else as the flight shows, else as asked."""
    is_shown = seen.spins_shown and (layout, order) == (seen.layout, seen.order)
    if given is None and is_shown:
        return seen.turned
    reply = given or _asked_spins(layout, order)
    shown = "reversed" if seen.turned else "usual"
    if is_shown and reply != shown:
        print_status(f"the flight yaws like spins {shown}, not {reply}: make sure that it is right")
    return reply == "reversed"


def _asked_spins(layout: str, order: str) -> str:
    """Ask which way the first motor turns; take the usual way where nobody answers."""
    from rotorfit.model.vehicle import layout_rotors

    first = layout_rotors(layout, arm=1.0, order=order)[0]
    place = _place_words(*first.position[:2])
    other = SPIN_WORDS["ccw" if first.spin == "cw" else "cw"]
    question = (
        f"Motor 1 ({place}), seen from above, turns {SPIN_WORDS[first.spin]}: usual, "
        f"{other}: reversed"
    )
    try:
        return _ask_choice(["usual", "reversed"], question, "usual", "--spins")
    except OutputError:
        print_status("\nthe spins are taken as usual; for the others add --spins reversed")
        return "usual"


def _place_words(x: float, y: float) -> str:
    """Describe where a motor is, such as ``front left``."""
    along = "front" if x > 0.1 else "rear" if x < -0.1 else ""
    across = "left" if y > 0.1 else "right" if y < -0.1 else ""
    return " ".join(filter(None, (along, across)))


def _parse_spacing(given: str | None) -> tuple[float, float]:
    """Parse or ask for the spacing of the motor axes, front to back and left to right [m]."""
    if given is None:
        print_status("Measure between the motors' axes with a ruler:")
        x = _ask_spacing("  front to back [mm]", None)
        return x, _ask_spacing("  left to right [mm]", f"{1e3 * x:g}")
    parts = given.split(",")
    if len(parts) != 2:
        raise ExperimentError(
            f"--spacing {given!r}; expected front to back and left to right in mm, such as 91,127"
        )
    return _parse_millimetres(parts[0]), _parse_millimetres(parts[1])


def _ask_spacing(question: str, default: str | None) -> float:
    """Ask for a spacing in mm until it is one; return it in m."""
    while True:
        reply = _ask_question(question, default, "--spacing X,Y")
        try:
            return _parse_millimetres(reply)
        except ExperimentError as error:
            print_status(str(error))


def _parse_millimetres(text: str) -> float:
    """Parse a spacing in mm; return it in m."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not SMALLEST <= value <= LARGEST:
        raise ExperimentError(
            f"a spacing of {text.strip()!r} mm; expected {SMALLEST:g} to {LARGEST:g} millimetres "
            "between the axes of two motors"
        )
    return round(1e-3 * value, 6)


def _ask_choice(choices: list[str], question: str, default: str, option: str) -> str:
    """Ask a question until the reply is one of the choices."""
    while (reply := _ask_question(question, default, option)) not in choices:
        print_status(f"{reply!r} is none of {', '.join(choices)}")
    return reply


def _ask_question(question: str, default: str | None, option: str) -> str:
    """Ask a question; an empty reply is its default."""
    shown = f" [{default}]" if default else ""
    line = read_reply(f"{question}{shown}: ")
    if line is None:
        raise OutputError(f"no answer to {question.strip()!r}: answer it, or give {option}")
    reply = line or default  # the empty reply is none of the choices
    if reply is None:
        raise OutputError(f"no answer to {question.strip()!r}: a number is needed")
    return reply


def _refuse_unreadable(text: str) -> None:
    """Raise if the airframe cannot be read back."""
    import tomllib

    from pydantic import ValidationError

    from rotorfit.fit.experiment.airframe_table import AirframeEntry

    tables: Mapping[str, object] = tomllib.loads(text)
    try:
        AirframeEntry.model_validate(tables["airframe"])
    except ValidationError as error:
        message = "; ".join(str(one["msg"]) for one in error.errors())
        raise ExperimentError(message.removeprefix("Value error, ")) from error
