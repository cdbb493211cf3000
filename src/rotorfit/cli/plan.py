"""rotorfit plan: the flights that reach an accuracy, before anybody has flown."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorfit.cli.mass import parse_mass
from rotorfit.cli.terminal import (
    AsJson,
    Force,
    Speed,
    coloured,
    counted,
    json_file,
    print_result,
    print_status,
    refuse_output_files,
    terminal_width,
)
from rotorfit.errors import ExperimentError

if TYPE_CHECKING:
    from rotorfit.fit.experiment.experiment import MotorsEntry
    from rotorfit.model.vehicle import Vehicle
    from rotorfit.results.result import IdentificationResult
    from rotorfit.tools.planning.plan import PlanRequest

SHORTEST, LONGEST = 10.0, 600.0
"""Flights that a plan considers [s]."""
SLOWEST_LOG = 20.0
"""A log with fewer samples a second shows no manoeuvre [Hz]."""


AirframeFile = Annotated[
    Path | None,
    typer.Argument(
        metavar="AIRFRAME",
        help="File with [airframe] and [motors]; with --after that of the result, if not given.",
    ),
]
Mass = Annotated[
    str | None,
    typer.Option(
        metavar="KG",
        help="Weighed as it flies, battery included [kg], or such as 428g; not needed with "
        "--after.",
    ),
]
Accuracy = Annotated[
    str,
    typer.Option(
        metavar="PERCENT|NAME=VALUE,...",
        help="Target half-width of the 95 % interval: one percentage (of kt, kd, Ixx, Iyy, Izz), "
        "or names such as kd=2,Izz=3,com_x=1 (com_x, com_y, com_z in mm).",
    ),
]
Lengths = Annotated[
    str,
    typer.Option(
        metavar="SECONDS,...",
        help="Lengths of each flight to consider, between take-off and landing [s].",
    ),
]
Payload = Annotated[
    float | None,
    typer.Option(metavar="KG", help="Mass of each of two payloads on one arm [kg]; 0: no payload."),
]
Guess = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="Your value of Ixx, Iyy, Izz, hover_speed, kd_over_kt, Jr or motor_lag (SI), in "
        "place of the guess from the geometry; repeatable.",
    ),
]
LogRate = Annotated[float, typer.Option(metavar="HZ", help="Samples per second of your log.")]
After = Annotated[
    Path | None,
    typer.Option(metavar="RESULT", help="A result of this vehicle: plan for what it still lacks."),
]
Card = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write a page for the pilot here (.html to print, .txt)."),
]
Output = Annotated[
    Path | None,
    json_file("the plan"),
]


def plan(
    airframe: AirframeFile = None,
    mass: Mass = None,
    accuracy: Accuracy = "5",
    seconds: Lengths = "20,40,75",
    speed: Speed = None,
    payload: Payload = None,
    guess: Guess = None,
    log_rate: LogRate = 200.0,
    after: After = None,
    card: Card = None,
    output: Output = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Plan a flight for a target accuracy.

    Recommends manoeuvres, how long to fly each, and whether to mount a payload.
    """
    from rotorfit.results.sound_result import load_sound
    from rotorfit.tools.planning.plan import PlanRequest
    from rotorfit.tools.planning.wanted import wanted_accuracy

    inputs = [path for path in (airframe, after) if path is not None]
    refuse_output_files({"-o": output, "--card": card}, inputs=inputs, force=force)
    if card is not None and card.suffix.lower() not in (".html", ".txt"):
        raise typer.BadParameter("a card is a .html or a .txt file", param_hint="--card")
    weighed = None if mass is None else parse_mass(mass)
    if weighed == "unknown":
        raise typer.BadParameter("a plan needs a mass, weighed or guessed", param_hint="--mass")
    result = None if after is None else load_sound(after)
    if mass is None and result is None:
        raise typer.BadParameter(
            "a plan needs --mass KG, weighed as it flies (or --after RESULT.json, which has it)"
        )
    if airframe is not None:
        name, (vehicle, motors) = airframe.name, _declared_vehicle(airframe)
    elif result is not None:
        name, (vehicle, motors) = result.name, _declared_by(result)
    else:
        raise typer.BadParameter("a plan needs an AIRFRAME file, or --after RESULT, which has it")
    speed = speed or motors.speed
    request = PlanRequest(
        name=name,
        vehicle=vehicle,
        mass=_select_mass(weighed, vehicle, result),
        speed=speed,
        timed=motors.delay is None and (speed == "measured" or motors.lag is None),
        known=_parse_guesses(guess or []),
        wanted=wanted_accuracy(accuracy),
        seconds=_parse_lengths(seconds),
        payload=_checked_payload(payload),
        log_rate=_checked_log_rate(log_rate),
        after=result,
    )
    _plan_and_write(request, output, card, force=force, as_json=as_json)


def _plan_and_write(
    request: PlanRequest, output: Path | None, card: Path | None, *, force: bool, as_json: bool
) -> None:
    from threadpoolctl import threadpool_limits

    from rotorfit.logs.files import write_whole
    from rotorfit.report.plan_card import write_card
    from rotorfit.report.plan_text import plan_text
    from rotorfit.tools.planning.plan import plan

    with (
        threadpool_limits(limits=1, user_api="blas"),
        counted("flying the manoeuvres in simulation") as report_progress,
    ):
        flights = plan(request, progress=report_progress)
    if output is not None:
        write_whole(output, flights.to_json(), force=force)
        print_status(f"wrote {output}")
    if card is not None:
        write_card(card, flights, force=force)
        print_status(f"wrote {card}")
    text = coloured(plan_text(flights, width=terminal_width()))
    print_result((flights.to_json() if as_json else text).rstrip())


def _declared_vehicle(airframe: Path) -> tuple[Vehicle, MotorsEntry]:
    """Read vehicle and motors from an airframe file, as identify will read it."""
    from rotorfit.fit.experiment.declared_vehicle import vehicle_of
    from rotorfit.fit.experiment.experiment import single_flight_experiment

    experiment = single_flight_experiment(Path("flight"), mass=1.0, airframe=airframe)
    return vehicle_of(experiment.airframe), experiment.motors


def _declared_by(result: IdentificationResult) -> tuple[Vehicle, MotorsEntry]:
    """Return vehicle and motors as a result was identified with."""
    from rotorfit.fit.experiment.declared_vehicle import vehicle_of
    from rotorfit.fit.experiment.experiment import experiment_of_settings

    experiment = experiment_of_settings(result.settings)
    return vehicle_of(experiment.airframe), experiment.motors


def _select_mass(mass: float | None, vehicle: Vehicle, after: IdentificationResult | None) -> float:
    """Select the mass, given or of an earlier result, which must be of this vehicle [kg]."""
    from rotorfit.tools.planning.after import check_same_vehicle, result_mass

    if after is None:
        return math.nan if mass is None else mass
    check_same_vehicle(after, vehicle)
    return result_mass(after, mass)[1]


def _parse_guesses(given: list[str]) -> dict[str, float]:
    guesses: dict[str, float] = {}
    for text in given:
        name, _, number = text.partition("=")
        try:
            guesses[name.strip()] = float(number)
        except ValueError:
            raise ExperimentError(
                f"--guess {text!r}, expected NAME=VALUE in SI units, such as Izz=0.029"
            ) from None
    return guesses


def _parse_lengths(text: str) -> tuple[float, ...]:
    try:
        lengths = sorted({float(part) for part in text.split(",")})
    except ValueError:
        lengths = [math.nan]
    if not all(SHORTEST <= length <= LONGEST for length in lengths):
        raise ExperimentError(
            f"--seconds {text}, expected lengths of flight between {SHORTEST:g} and {LONGEST:g} s, "
            "such as 20,40,75"
        )
    return tuple(lengths)


def _checked_payload(mass: float | None) -> float | None:
    if mass is not None and not (math.isfinite(mass) and 0.0 <= mass <= 50.0):
        raise ExperimentError(
            f"--payload is {mass:g} kg, expected the mass of each of the two in kg, or 0 for none"
        )
    return mass


def _checked_log_rate(rate: float) -> float:
    if not (math.isfinite(rate) and SLOWEST_LOG <= rate <= 1e5):
        raise ExperimentError(
            f"--log-rate is {rate:g} Hz, expected the samples per second of the log, at least "
            f"{SLOWEST_LOG:g}"
        )
    return rate
