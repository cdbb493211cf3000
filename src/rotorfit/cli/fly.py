"""rotorfit fly: whether the identified model flies, and predicts the flights it was made from."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import typer
from threadpoolctl import threadpool_limits

from rotorfit.cli.outputs import refuse_output_file, refuse_output_folder
from rotorfit.cli.progress import steps
from rotorfit.cli.terminal import painted, say, show, terminal_width
from rotorfit.errors import OutputError, RotorfitError, RotorfitWarning
from rotorfit.export.mujoco_flight import fly_manoeuvre, flyable, has_mujoco
from rotorfit.export.result_numbers import number_warnings, parse_assumptions
from rotorfit.export.targets import BODY, ROTORS
from rotorfit.export.vehicle import VehicleModel
from rotorfit.export.vehicle_model import owner_of, terms_left_out, vehicle_model
from rotorfit.logs.files import write_whole
from rotorfit.results.command_units import is_per_command
from rotorfit.results.result import IdentificationResult
from rotorfit.results.sound_result import load_sound
from rotorfit.validation.fly_outcome import IDENTIFIED, MANOEUVRES, FlyOutcome, ModelFlight
from rotorfit.validation.replay import WINDOW, Timed, replay_flights
from rotorfit.validation.replay_vehicle import replay_vehicle
from rotorfit.validation.validate import fitted_response

DRAWS = 40
BENCH = "bench"
NEEDS = (*BODY, *ROTORS)
WITHOUT_MUJOCO = (
    "hover and steps skipped: MuJoCo not installed; pip install '.[mujoco]' in the clone adds them"
)
FIGURES = ("replay-1.svg", "replay-errors.svg", "manoeuvres.svg")
PER_SPEED = ("kt", "kd", "Jr")


@dataclass(frozen=True, slots=True, kw_only=True)
class FlyRequest:
    """What the user asked for."""

    result: Path
    configuration: str | None = None
    assume: tuple[str, ...] = ()
    bench: tuple[str, ...] = ()
    against: tuple[Path, ...] = ()
    flights: tuple[Path, ...] = ()
    log_number: int | None = None
    output: Path | None = None
    report: Path | None = None
    figures: Path | None = None
    force: bool = False
    as_json: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class _Side:
    """One set of parameters: what MuJoCo's autopilot is tuned to, and what the replay flies."""

    model: VehicleModel
    timed: Timed


def run(request: FlyRequest) -> None:
    """Replay the flights, fly the model, print what came of it, and write it where asked."""
    assumed = _numbers(request.assume, "--assume")
    bench = _numbers(request.bench, "--bench")
    _refuse_outputs(request)
    if request.log_number is not None and not request.flights:
        raise typer.BadParameter("--log needs a --flight, which names the file")
    result = load_sound(request.result)
    with threadpool_limits(limits=1, user_api="blas"):
        outcome = _outcome(request, result, assumed, bench)
    _write(request, outcome)


def _numbers(words: tuple[str, ...], option: str) -> dict[str, float]:
    try:
        return parse_assumptions(words)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint=option) from error


def _refuse_outputs(request: FlyRequest) -> None:
    files = [path for path in (request.output, request.report) if path is not None]
    if len(set(files)) < len(files):
        raise typer.BadParameter("-o and --report name the same file")
    inputs = [request.result, *request.against, *request.flights]
    for path in files:
        refuse_output_file(path, inputs=inputs, force=request.force)
    if request.figures is not None:
        refuse_output_folder(request.figures, FIGURES, force=request.force)


def _outcome(
    request: FlyRequest,
    result: IdentificationResult,
    assumed: Mapping[str, float],
    bench: Mapping[str, float],
) -> FlyOutcome:
    owner = owner_of(result, request.configuration)
    sides = {IDENTIFIED: _side(result, owner, assumed, draws=DRAWS)}
    if bench:
        sides[BENCH] = _side(result, owner, {**assumed, **bench})
    for path in request.against:
        sides[_label(path, sides)] = _other(path, owner, assumed)
    own = sides[IDENTIFIED].model
    for label, side in sides.items():
        _refuse_other_vehicle(own, side.model, label)
    with warnings.catch_warnings(), steps() as tell:
        warnings.simplefilter("ignore", RotorfitWarning)  # the result has them already
        replays = replay_flights(
            result,
            owner,
            {label: side.timed for label, side in sides.items()},
            others=request.flights,
            log_number=request.log_number,
            tell=tell,
        )
        manoeuvres: dict[str, tuple[ModelFlight, ...]] = {}
        known = [WITHOUT_MUJOCO]
        if has_mujoco():
            tell("flying the model")
            manoeuvres, known = _manoeuvres(sides)
    return FlyOutcome(
        name=result.name,
        configuration=owner,
        seconds=WINDOW,
        draws=len(sides[IDENTIFIED].timed.vehicle.mass) - 1,
        labels=tuple(sides),
        replays=tuple(replays),
        manoeuvres=manoeuvres,
        notes=(*_notes(result, own, bench), *known),
    )


def _manoeuvres(
    sides: Mapping[str, _Side],
) -> tuple[dict[str, tuple[ModelFlight, ...]], list[str]]:
    """Return the identified model flown by autopilots tuned to each side, and what was taken."""
    model, taken = flyable(sides[IDENTIFIED].model)
    flown = {
        label: tuple(
            fly_manoeuvre(model, name, believed=flyable(side.model)[0]) for name in MANOEUVRES
        )
        for label, side in sides.items()
    }
    return flown, list(taken)


def _side(
    result: IdentificationResult, owner: str, assumed: Mapping[str, float], *, draws: int = 0
) -> _Side:
    """Return a set of parameters, refused as an export would be."""
    _refuse_units(result, assumed)
    model = vehicle_model(
        result, configuration=owner, needs=NEEDS, assumed=assumed, speed="full-command"
    )
    # What was assumed, and what followed from it by a ratio, is not drawn.
    fixed = {n.name: n.value for n in model.numbers if n.origin in ("assumed", "from-ratio")}
    fixed = {n: v for n, v in fixed.items() if not n.startswith("motor_") and n != "max_speed"}
    vehicle = replay_vehicle(result, owner, assumed={**_body(assumed), **fixed}, draws=draws)
    return _Side(model=model, timed=Timed(vehicle=vehicle, response=fitted_response(result)))


def _body(assumed: Mapping[str, float]) -> dict[str, float]:
    return {n: v for n, v in assumed.items() if not n.startswith("motor_") and n != "max_speed"}


def _refuse_units(result: IdentificationResult, assumed: Mapping[str, float]) -> None:
    """Raise if numbers per rad/s are to stand among numbers per command."""
    if not is_per_command(result):
        return
    wrong = [n for n in assumed if n.split("_")[0] in PER_SPEED or n == "max_speed"]
    if wrong:
        raise OutputError(
            f"{', '.join(wrong)} is per rad/s, and this result per command (no law from command to "
            "rotor speed): leave it out (Izz_com=VALUE gives kd by its ratio), or give law under "
            "[motors] and identify again"
        )


def _other(path: Path, owner: str, assumed: Mapping[str, float]) -> _Side:
    """Return the parameters of another result: of the same configuration, or of its only one.

    What it has is its own; where it lacks something, the user's numbers stand for it too.
    """
    other = load_sound(path)
    names = {p.configuration for p in other.parameters}
    try:
        whose = owner_of(other, owner if owner in names else None)
        try:
            return _side(other, whose, {})
        except OutputError:
            return _side(other, whose, assumed)
    except RotorfitError as error:
        raise OutputError(f"{path.name}: {error}") from error


def _label(path: Path, taken: Mapping[str, object]) -> str:
    label = path.stem
    return label if label not in taken else f"{label} ({len(taken)})"


def _refuse_other_vehicle(own: VehicleModel, other: VehicleModel, label: str) -> None:
    if len(own.rotors) != len(other.rotors):
        raise OutputError(
            f"{label} has {len(other.rotors)} rotors, the result {len(own.rotors)}: give a result "
            "of the same vehicle"
        )
    if own.in_commands != other.in_commands:
        raise OutputError(
            f"{label} and the result differ in what stands for the rotor speed (rad/s, or commands "
            "without a law): give a result made from the same motor data"
        )


def _notes(
    result: IdentificationResult, model: VehicleModel, bench: Mapping[str, float]
) -> list[str]:
    notes = number_warnings(model.numbers)
    if bench:
        given = ", ".join(f"{name}={value:g}" for name, value in bench.items())
        notes.append(f"bench: {given}; all else as identified, which favours it")
    notes += model.notes
    drag = [p.name for p in result.parameters if p.name.startswith("drag_") and p.value]
    terms = [t for t in terms_left_out(result, model.configuration) if t.split()[0] not in drag]
    if terms:
        notes.append(f"identified, but used in the replay only: {', '.join(terms)}")
    own = [p.value is not None for p in result.parameters if p.name.startswith("kt_")]
    if any(own) and not all(own):
        notes.append(
            "only some rotors have a kt of their own: hover is out of trim, which the CoM and all "
            "rotors make together; identify again with terms that leave rotor_spread out"
        )
    if drag:
        notes.append("the result knows the frame's drag; replay and MuJoCo leave it out")
    return notes


def _write(request: FlyRequest, outcome: FlyOutcome) -> None:
    # jinja2 is not worth its time to those who want numbers only.
    from rotorfit.report.fly_page import write_fly_figures, write_fly_page
    from rotorfit.report.fly_text import fly_text
    from rotorfit.report.pages import HINT, can_write_png

    if request.output is not None:
        write_whole(request.output, outcome.to_json(), force=request.force)
        say(f"wrote {request.output}")
    if request.report is not None:
        write_fly_page(request.report, outcome, force=request.force)
        say(f"wrote {request.report}")
    if request.figures is not None:
        paths = write_fly_figures(request.figures, outcome, force=request.force)
        say(f"wrote {len(paths)} files to {request.figures}")
        if not can_write_png():
            say(HINT)
    text = painted(fly_text(outcome, width=terminal_width()))
    show((outcome.to_json() if request.as_json else text).rstrip())
