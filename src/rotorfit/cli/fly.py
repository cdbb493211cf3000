"""rotorfit fly: whether the identified model flies, and predicts the flights it was made from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorfit.cli.terminal import (
    AsJson,
    Assume,
    Figures,
    Force,
    LogNumber,
    Page,
    ResultFile,
    coloured,
    json_file,
    print_result,
    print_status,
    quiet_steps,
    refuse_output_files,
    refuse_output_folder,
    terminal_width,
    write_pictures,
)
from rotorfit.errors import MissingNumbersError, OutputError, RotorfitError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from rotorfit.export.vehicle import VehicleModel
    from rotorfit.results.result import IdentificationResult
    from rotorfit.results.validation.fly_outcome import FlyOutcome, ModelFlight
    from rotorfit.results.validation.replayed_flights import Timed

DRAWS = 40
BENCH = "bench"
WITHOUT_MUJOCO = (
    "hover and steps skipped: MuJoCo not installed; pip install '.[mujoco]' in the clone adds them"
)
FIGURES = ("replay-1.svg", "replay-errors.svg", "hover.svg", "manoeuvres.svg")
PER_SPEED = ("kt", "kd", "Jr")
Configuration = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Which to fly; not needed if the result has only one."),
]
ReplayedFlights = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="LOG", help="Replay this log instead of the result's own flights; repeatable."
    ),
]
Against = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="RESULT", help="Another result of the vehicle to compare with; repeatable."
    ),
]
Bench = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="A number from your bench to compare with, SI; others as identified; repeatable.",
    ),
]
Output = Annotated[
    Path | None,
    json_file("the numbers"),
]


@frozen_dataclass
class _Side:
    """One set of parameters, for the tuning of MuJoCo's autopilot and for the replay."""

    model: VehicleModel
    timed: Timed


def fly(
    result: ResultFile,
    configuration: Configuration = None,
    assume: Assume = None,
    flight: ReplayedFlights = None,
    log: LogNumber = None,
    against: Against = None,
    bench: Bench = None,
    output: Output = None,
    report: Page = None,
    figures: Figures = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Check whether the identified vehicle flies as flown.

    The measured rotor speeds drive the model for half a second from many measured starts; predicted
    rates and accelerations are compared with the flown ones, and with those of a bench or another
    result. Then hover and steps in MuJoCo, if installed.
    """
    from threadpoolctl import threadpool_limits

    from rotorfit.logs.files import write_whole
    from rotorfit.report.fly import fly_text
    from rotorfit.report.fly_page import fly_figures, fly_html
    from rotorfit.results.result import owner_of
    from rotorfit.results.sound_result import load_sound

    assumed = _parse_numbers(assume or [], "--assume")
    bench_numbers = _parse_numbers(bench or [], "--bench")
    inputs = [result, *(against or []), *(flight or [])]
    refuse_output_files({"-o": output, "--report": report}, inputs=inputs, force=force)
    if figures is not None:
        refuse_output_folder(figures, FIGURES, force=force)
    if log is not None and not flight:
        raise typer.BadParameter("--log needs a --flight, which names the file")
    loaded = load_sound(result)
    with threadpool_limits(limits=1, user_api="blas"):
        owner = owner_of(loaded, configuration)
        try:
            sides = _collect_sides(loaded, owner, assumed, bench_numbers, against or [])
        except MissingNumbersError as error:
            # Files and JSON have rates; a bench or another result is compared by them.
            if as_json or output or report or figures or against or bench_numbers:
                raise
            _print_thrust(loaded, owner, flight or [], log, error)
            return
        outcome = _replay_sides(loaded, owner, sides, bench_numbers, flight or [], log)
    if output is not None:
        write_whole(output, outcome.to_json(), force=force)
        print_status(f"wrote {output}")
    write_pictures(
        report,
        figures,
        page=lambda: fly_html(outcome),
        drawings=lambda: fly_figures(outcome),
        force=force,
    )
    text = coloured(fly_text(outcome, width=terminal_width()))
    print_result((outcome.to_json() if as_json else text).rstrip())


def _print_thrust(
    result: IdentificationResult,
    owner: str,
    flights: list[Path],
    log_number: int | None,
    error: MissingNumbersError,
) -> None:
    """Compare the thrust, and what moments are known, where numbers for the rates are missing."""
    from rotorfit.cli.validate import validation_text
    from rotorfit.results.validation.judgement import doubtful_numbers, judgement
    from rotorfit.results.validation.replayed_flights import compared_flights

    with quiet_steps() as report_progress:
        compared = compared_flights(
            result, owner, others=flights, log_number=log_number, report=report_progress
        )
    if not any("Fz" in one.relative_error for one in compared):
        raise error
    doubtful = doubtful_numbers(result, owner)
    judged = [judgement((), comparisons=(one,), doubtful=doubtful) for one in compared]
    print_status(f"rotorfit: the turns cannot be replayed: {error}")
    print_result(validation_text(compared, judged))


def _parse_numbers(texts: list[str], option: str) -> dict[str, float]:
    from rotorfit.export.result_numbers import parse_assumptions

    try:
        return parse_assumptions(texts)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint=option) from error


def _collect_sides(
    result: IdentificationResult,
    owner: str,
    assumed: Mapping[str, float],
    bench: Mapping[str, float],
    against: list[Path],
) -> dict[str, _Side]:
    """Collect the sets of parameters to compare, by label; raise if they are of other vehicles."""
    from rotorfit.results.validation.replay import IDENTIFIED

    sides = {IDENTIFIED: _collect_side(result, owner, assumed, draws=DRAWS)}
    if bench:
        sides[BENCH] = _collect_side(result, owner, {**assumed, **bench})
    for path in against:
        label = path.stem if path.stem not in sides else f"{path.stem} ({len(sides)})"
        sides[label] = _side_of_file(path, owner, assumed)
    for label, side in sides.items():
        _refuse_other_vehicle(sides[IDENTIFIED].model, side.model, label)
    return sides


def _replay_sides(
    result: IdentificationResult,
    owner: str,
    sides: Mapping[str, _Side],
    bench: Mapping[str, float],
    flights: list[Path],
    log_number: int | None,
) -> FlyOutcome:
    """Replay the flights with every side, and fly the model in MuJoCo where it is installed."""
    from rotorfit.export.mujoco import has_mujoco
    from rotorfit.results.validation.fly_outcome import FlyOutcome
    from rotorfit.results.validation.judgement import doubtful_numbers
    from rotorfit.results.validation.replay import IDENTIFIED, WINDOW
    from rotorfit.results.validation.replayed_flights import replay_flights

    identified = sides[IDENTIFIED]
    with quiet_steps() as report_progress:
        replays = replay_flights(
            result,
            owner,
            {label: side.timed for label, side in sides.items()},
            others=flights,
            log_number=log_number,
            report=report_progress,
        )
        manoeuvres: dict[str, tuple[ModelFlight, ...]] = {}
        notes = [WITHOUT_MUJOCO]
        if has_mujoco():
            report_progress("flying the model")
            manoeuvres, notes = _fly_manoeuvres(sides)
    return FlyOutcome(
        name=result.name,
        configuration=owner,
        seconds=WINDOW,
        draws=len(identified.timed.vehicle.mass) - 1,
        labels=tuple(sides),
        replays=tuple(replays),
        manoeuvres=manoeuvres,
        notes=(*replay_notes(result, identified.model, bench), *notes),
        doubtful=doubtful_numbers(result, owner),
    )


def _fly_manoeuvres(
    sides: Mapping[str, _Side],
) -> tuple[dict[str, tuple[ModelFlight, ...]], list[str]]:
    """Fly the identified model by autopilots tuned to each side; note the numbers supplied."""
    from rotorfit.export.mujoco import fly_manoeuvre, flyable
    from rotorfit.results.validation.fly_outcome import MANOEUVRES
    from rotorfit.results.validation.replay import IDENTIFIED

    model, notes = flyable(sides[IDENTIFIED].model)
    flown = {
        label: tuple(
            fly_manoeuvre(model, name, believed=flyable(side.model)[0]) for name in MANOEUVRES
        )
        for label, side in sides.items()
    }
    return flown, list(notes)


def _collect_side(
    result: IdentificationResult, owner: str, assumed: Mapping[str, float], *, draws: int = 0
) -> _Side:
    """Collect a set of parameters, refused as an export would be."""
    from rotorfit.export.targets import BODY, ROTORS
    from rotorfit.export.vehicle_model import vehicle_model
    from rotorfit.results.validation.replay_vehicle import replay_vehicle, unknown_body
    from rotorfit.results.validation.replayed_flights import Timed
    from rotorfit.results.validation.validate import fitted_response

    _refuse_units(result, assumed)
    model = vehicle_model(
        result,
        configuration=owner,
        needs=(*BODY, *ROTORS),
        assumed=unknown_body(result, owner, assumed) | dict(assumed),
        speed="full-command",
    )
    # What was assumed, and what followed from it by a ratio, is not drawn.
    derived = {n.name: n.value for n in model.numbers if n.origin in ("assumed", "from-ratio")}
    fixed = {**_without_motors(assumed), **_without_motors(derived)}
    vehicle = replay_vehicle(result, owner, assumed=fixed, draws=draws)
    return _Side(model=model, timed=Timed(vehicle=vehicle, response=fitted_response(result)))


def _without_motors(numbers: Mapping[str, float]) -> dict[str, float]:
    """Select the numbers of body and rotors, without motor lag and largest speed."""
    return {n: v for n, v in numbers.items() if not n.startswith("motor_") and n != "max_speed"}


def _refuse_units(result: IdentificationResult, assumed: Mapping[str, float]) -> None:
    """Raise if numbers per rad/s are given for a result per command."""
    from rotorfit.results.result import is_per_command

    if not is_per_command(result.parameters):
        return
    wrong = [n for n in assumed if n.split("_")[0] in PER_SPEED or n == "max_speed"]
    if wrong:
        raise OutputError(
            f"{', '.join(wrong)} is per rad/s, and this result per command (no law from command to "
            "rotor speed): leave it out (Izz_com=VALUE gives kd by its ratio), or give law under "
            "[motors] and identify again"
        )


def _side_of_file(path: Path, owner: str, assumed: Mapping[str, float]) -> _Side:
    """Load another result's parameters, of the same configuration or of its only one."""
    from rotorfit.results.result import owner_of
    from rotorfit.results.sound_result import load_sound

    other = load_sound(path)
    names = {p.configuration for p in other.parameters}
    try:
        configuration = owner_of(other, owner if owner in names else None)
        try:
            return _collect_side(other, configuration, {})
        except OutputError:
            # The assumed numbers are used only where the other result lacks some.
            return _collect_side(other, configuration, assumed)
    except RotorfitError as error:
        raise OutputError(f"{path.name}: {error}") from error


def _refuse_other_vehicle(identified: VehicleModel, other: VehicleModel, label: str) -> None:
    if len(identified.rotors) != len(other.rotors):
        raise OutputError(
            f"{label} has {len(other.rotors)} rotors, the result {len(identified.rotors)}: give a "
            "result of the same vehicle"
        )
    if identified.in_commands != other.in_commands:
        raise OutputError(
            f"{label} and the result differ in what stands for the rotor speed (rad/s, or commands "
            "without a law): give a result made from the same motor data"
        )


def _centred_places(result: IdentificationResult, model: VehicleModel) -> dict[str, float]:
    """Select the places that neither the result nor the user gave, with the values they have."""
    from rotorfit.results.validation.replay_vehicle import hover_centre

    open_places = hover_centre(result, model.configuration)
    return {
        n.name: n.value
        for n in model.numbers
        if n.origin == "assumed" and open_places.get(n.name) == n.value
    }


def replay_notes(
    result: IdentificationResult, model: VehicleModel, bench: Mapping[str, float]
) -> list[str]:
    """List what to know of a replay: weak and assumed numbers, the bench, terms left out."""
    from rotorfit.export.result_numbers import number_warnings
    from rotorfit.export.vehicle_model import terms_left_out

    centred = _centred_places(result, model)
    notes = number_warnings(n for n in model.numbers if n.name not in centred)
    if centred:
        places = ", ".join(f"{name} = {1e3 * value:.2g} mm" for name, value in centred.items())
        notes.append(
            f"{places}: not known from these flights, and taken so that their hover balances; "
            "what that is wrong by is not in the band"
        )
    if bench:
        given = ", ".join(f"{name}={value:g}" for name, value in bench.items())
        notes.append(f"bench: {given}; all else as identified, which favours it")
    notes += model.notes
    drag = [p.name for p in result.parameters if p.name.startswith("drag_") and p.value]
    terms = [t for t in terms_left_out(result, model.configuration) if t.split()[0] not in drag]
    if terms:
        notes.append(f"used in the replay only: {', '.join(terms)}")
    known = [p.value is not None for p in result.parameters if p.name.startswith("kt_")]
    if any(known) and not all(known):
        notes.append(
            "only some rotors have a kt of their own: hover is out of trim, which the CoM and all "
            "rotors make together; identify again with terms that leave rotor_spread out"
        )
    if drag:
        notes.append("the result knows the frame's drag; replay and MuJoCo leave it out")
    return notes
