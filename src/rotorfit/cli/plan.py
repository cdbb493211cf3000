"""rotorfit plan: parse, call, print."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import typer
from threadpoolctl import threadpool_limits

from rotorfit.cli.outputs import refuse_output_file
from rotorfit.cli.progress import counted
from rotorfit.cli.terminal import painted, say, show, terminal_width
from rotorfit.errors import ExperimentError
from rotorfit.experiment.declared_vehicle import vehicle_of
from rotorfit.experiment.experiment import single_flight_experiment
from rotorfit.logs.files import write_whole
from rotorfit.planning.after import check_same_vehicle, result_mass
from rotorfit.planning.plan import FlightPlan, PlanRequest, plan
from rotorfit.planning.wanted import wanted_accuracy
from rotorfit.report.plan_card import write_card
from rotorfit.report.plan_text import plan_text
from rotorfit.results.result import IdentificationResult
from rotorfit.results.sound_result import load_sound

SHORTEST, LONGEST = 10.0, 600.0
"""Flights that a plan considers [s]."""
SLOWEST_LOG = 20.0
"""A log with fewer samples a second shows no manoeuvre [Hz]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOptions:
    """What the user asked for, as the command line gave it."""

    airframe: Path
    mass: float | None = None
    accuracy: str = "5"
    seconds: str = "20,40,75"
    speed: Literal["measured", "commanded"] | None = None
    payload: float | None = None
    guess: tuple[str, ...] = ()
    log_rate: float = 200.0
    after: Path | None = None
    output: Path | None = None
    card: Path | None = None
    force: bool = False
    as_json: bool = False


def run(options: PlanOptions) -> None:
    """Plan, print the plan, and write it where asked."""
    _refuse_outputs(options)
    request = _request(options)
    with (
        threadpool_limits(limits=1, user_api="blas"),
        counted("flying the manoeuvres in simulation") as progress,
    ):
        answer = plan(request, progress=progress)
    _write(answer, options)
    text = painted(plan_text(answer, width=terminal_width()))
    show((answer.to_json() if options.as_json else text).rstrip())


def _refuse_outputs(options: PlanOptions) -> None:
    inputs = [options.airframe, *([options.after] if options.after else [])]
    for path in (options.output, options.card):
        if path is not None:
            refuse_output_file(path, inputs=inputs, force=options.force)
    if options.card is not None and options.card.suffix.lower() not in (".html", ".txt"):
        raise typer.BadParameter("a card is a .html or a .txt file", param_hint="--card")
    if options.output is not None and options.output == options.card:
        raise typer.BadParameter("-o and --card name the same file")


def _write(answer: FlightPlan, options: PlanOptions) -> None:
    if options.output is not None:
        write_whole(options.output, answer.to_json(), force=options.force)
        say(f"wrote {options.output}")
    if options.card is not None:
        write_card(options.card, answer, force=options.force)
        say(f"wrote {options.card}")


def _request(options: PlanOptions) -> PlanRequest:
    after = None if options.after is None else load_sound(options.after)
    if options.mass is None and after is None:
        raise typer.BadParameter(
            "a plan needs --mass KG, weighed as it flies (or --after RESULT.json, which has it)"
        )
    # The file as it will be read when a flight is identified with it.
    described = single_flight_experiment(Path("flight"), mass=1.0, airframe=options.airframe)
    vehicle = vehicle_of(described.airframe)
    motors = described.motors
    speed = options.speed or motors.speed
    if after is not None:
        check_same_vehicle(after, vehicle)
    return PlanRequest(
        name=options.airframe.name,
        vehicle=vehicle,
        mass=_mass(after, options.mass),
        speed=speed,
        timed=motors.delay is None and (speed == "measured" or motors.lag is None),
        known=_guesses(options.guess),
        wanted=wanted_accuracy(options.accuracy),
        seconds=_lengths(options.seconds),
        payload=_payload(options.payload),
        log_rate=_log_rate(options.log_rate),
        after=after,
    )


def _mass(after: IdentificationResult | None, mass: float | None) -> float:
    if after is None:
        return math.nan if mass is None else mass
    return result_mass(after, mass)[1]


def _guesses(given: tuple[str, ...]) -> dict[str, float]:
    known: dict[str, float] = {}
    for words in given:
        name, _, number = words.partition("=")
        try:
            known[name.strip()] = float(number)
        except ValueError:
            raise ExperimentError(
                f"--guess {words!r}, expected NAME=VALUE in SI units, such as Izz=0.029"
            ) from None
    return known


def _lengths(text: str) -> tuple[float, ...]:
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


def _payload(mass: float | None) -> float | None:
    if mass is not None and not (math.isfinite(mass) and 0.0 <= mass <= 50.0):
        raise ExperimentError(
            f"--payload is {mass:g} kg, expected the mass of each of the two in kg, or 0 for none"
        )
    return mass


def _log_rate(rate: float) -> float:
    if not (math.isfinite(rate) and SLOWEST_LOG <= rate <= 1e5):
        raise ExperimentError(
            f"--log-rate is {rate:g} Hz, expected the samples per second of the log, at least "
            f"{SLOWEST_LOG:g}"
        )
    return rate
