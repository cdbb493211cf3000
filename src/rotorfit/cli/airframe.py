"""rotorfit airframe: questions that a ruler answers, and the file that comes of them."""

import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from pydantic import ValidationError

from rotorfit.cli.outputs import refuse_output_file
from rotorfit.cli.progress import steps
from rotorfit.cli.terminal import say, show
from rotorfit.errors import ExperimentError, OutputError
from rotorfit.experiment.airframe_table import AirframeEntry
from rotorfit.inspection.inspect_log import inspect_log
from rotorfit.inspection.seen_airframe import SeenAirframe, seen_airframe
from rotorfit.logs import ReadOptions, read_log
from rotorfit.logs.files import write_whole
from rotorfit.model.layouts import LAYOUTS, spaced_rotors

SMALLEST, LARGEST = 15.0, 10_000.0
"""Of a spacing [mm]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AirframeRequest:
    """What the user asked for; what is None is asked."""

    output: Path
    log: Path | None = None
    log_number: int | None = None
    layout: str | None = None
    order: str | None = None
    spacing: str | None = None
    speed: str | None = None
    force: bool = False


def run(request: AirframeRequest) -> None:
    """Look at the log, ask what is missing, write the file."""
    inputs = [] if request.log is None else [request.log]
    refuse_output_file(request.output, inputs=inputs, force=request.force)
    seen = _seen(request)
    layout = _chosen("layout", request.layout, seen, _layouts(seen))
    orders = [order for name, order in LAYOUTS if name == layout]
    order = _chosen("order", request.order, seen, orders)
    spacing = _spacing(request.spacing)
    speed = (
        request.speed
        or seen.speed
        or _one_of(
            ["measured", "commanded"],
            "Rotor speed in the log: measured (ESC telemetry, bidirectional DShot) or commanded",
            "commanded",
            "--speed",
        )
    )
    turned = seen.turned and (layout, order) == (seen.layout, seen.order)
    text = airframe_text(layout, order, spacing, speed=speed, turned=turned)
    _refuse_wrong(text)
    write_whole(request.output, text, force=request.force)
    show(f"{text}\nwritten to {request.output}; next:")
    log = "LOG" if request.log is None else request.log
    show(f"  rotorfit identify {log} --mass KG --airframe {request.output}")


def _seen(request: AirframeRequest) -> SeenAirframe:
    """Return what the log says, and say it."""
    if request.log is None:
        return SeenAirframe()
    with steps() as tell:
        tell(f"reading {request.log.name}")
        log = read_log(request.log, options=ReadOptions(log_number=request.log_number))
        seen = seen_airframe(log, inspect_log(log))
    if seen.rotors is None:
        raise ExperimentError(
            f"{request.log}: no motors in this log, so it shows nothing of the rotors: leave it "
            "out and answer the questions, or give a log with motor outputs"
        )
    say(f"{request.log.name}: {log.format}, {seen.rotors} motors, rotor speed {seen.speed}")
    words = ", every spin reversed (props out)" if seen.turned else ""
    say(
        f"the flight confirms {seen.layout}, motors in the order of {seen.order}{words}"
        if seen.borne_out
        else "the flight does not show which layout and motor order it is: look at the vehicle"
    )
    return seen


def _layouts(seen: SeenAirframe) -> list[str]:
    """Return the layouts of so many rotors."""
    names = dict.fromkeys(name for name, _ in LAYOUTS)
    return [
        name
        for name in names
        if seen.rotors in (None, len(next(s for (n, _), s in LAYOUTS.items() if n == name)))
    ]


def _chosen(what: str, given: str | None, seen: SeenAirframe, choices: list[str]) -> str:
    """Return layout or order: as given, else as asked, the flight's own as default."""
    own = {"layout": seen.layout, "order": seen.order}[what]
    if not choices:
        raise ExperimentError(
            f"no named layout has {seen.rotors} rotors: list them in the file, as docs/experiment "
            "says, with rotors = [ { position = [x, y, z], spin = 'ccw' }, ... ]"
        )
    default = own if own in choices else choices[0]
    if given is None and seen.borne_out and own in choices:
        return str(own)
    question = f"{what.capitalize()} ({', '.join(choices)})"
    only = choices[0] if len(choices) == 1 else None
    answer = given or only or _one_of(choices, question, default, f"--{what}")
    if answer not in choices:
        near = get_close_matches(answer, choices, n=1, cutoff=0.5)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise ExperimentError(f"{what} {answer!r}; expected one of {', '.join(choices)}{hint}")
    if seen.borne_out and own not in (None, answer):
        say(f"the flight responds like {what} {own}, not {answer}: make sure that it is right")
    return answer


def _spacing(given: str | None) -> tuple[float, float]:
    """Return front to back and left to right between the motor axes [m]."""
    if given is None:
        say("Measure between the motors' axes with a ruler:")
        x = _measured("  front to back [mm]", None)
        return x, _measured("  left to right [mm]", f"{1e3 * x:g}")
    parts = given.split(",")
    if len(parts) != 2:
        raise ExperimentError(
            f"--spacing {given!r}; expected front to back and left to right in mm, such as 91,127"
        )
    return _millimetres(parts[0]), _millimetres(parts[1])


def _measured(question: str, default: str | None) -> float:
    """Return a spacing in metres, asked for until it is one."""
    while True:
        answer = _asked(question, default, "--spacing X,Y")
        try:
            return _millimetres(answer)
        except ExperimentError as error:
            say(str(error))


def _millimetres(text: str) -> float:
    """Return a spacing in metres."""
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


def _one_of(choices: list[str], question: str, default: str, option: str) -> str:
    """Return the answer to a question, asked until it is one of the choices."""
    while (answer := _asked(question, default, option)) not in choices:
        say(f"{answer!r} is none of {', '.join(choices)}")
    return answer


def _asked(question: str, default: str | None, option: str) -> str:
    """Return the answer to a question, its default where it is empty."""
    shown = "" if default is None else f" [{default}]"
    sys.stderr.write(f"{question}{shown}: ")
    sys.stderr.flush()
    line = sys.stdin.readline()
    if not line:
        raise OutputError(f"no answer to {question.strip()!r}: answer it, or give {option}")
    answer = line.strip() or default
    if answer is None:
        raise OutputError(f"no answer to {question.strip()!r}: a number is needed")
    return answer


def airframe_text(
    layout: str, order: str, spacing: tuple[float, float], *, speed: str, turned: bool
) -> str:
    """Return the airframe file.

    Parameters
    ----------
    layout, order
        Of `LAYOUTS`.
    spacing
        Front to back and left to right between the motor axes [m].
    speed
        ``measured`` or ``commanded``.
    turned
        Whether every rotor turns the other way than the order has it.
    """
    lines = ["[airframe]"]
    if turned:
        other = {"ccw": "cw", "cw": "ccw"}
        rotors = spaced_rotors(layout, spacing=spacing, order=order)
        lines.append(f"# {layout} in the motor order of {order}, every spin reversed (props out)")
        lines += [
            "rotors = [  # position from the centre, forward, left, up [m]",
            *(f'  {{ position = {list(r.position)}, spin = "{other[r.spin]}" }},' for r in rotors),
            "]",
        ]
    else:
        lines += [
            f'layout = "{layout}"',
            f'order = "{order}"  # whose motor numbering',
            f"spacing = {list(spacing)}  # between motor axes, front to back, left to right [m]",
        ]
    lines += [
        "# imu = { position = [0.0, 0.0, 0.0] }  # of the flight controller, forward, left, up [m]",
        "",
        "[motors]",
        f'speed = "{speed}"',
    ]
    return "\n".join(lines) + "\n"


def _refuse_wrong(text: str) -> None:
    """Raise if the airframe cannot be read back."""
    tables: Mapping[str, object] = tomllib.loads(text)
    try:
        AirframeEntry.model_validate(tables["airframe"])
    except ValidationError as error:
        words = "; ".join(str(one["msg"]) for one in error.errors())
        raise ExperimentError(words.removeprefix("Value error, ")) from error
