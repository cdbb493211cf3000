"""A plan as text for a terminal: what to fly, what it would give, and what was assumed."""

import textwrap
from collections.abc import Iterator

from rotorfit.planning.after import Missing
from rotorfit.planning.candidate import Candidate
from rotorfit.planning.plan import FlightPlan
from rotorfit.planning.wanted import WANTABLE
from rotorfit.report.plan_words import (
    SWEEPS,
    TITLES,
    digits,
    flown_words,
    payload_words,
    place_words,
    scale_words,
    steps_of,
    unmet_words,
    wanted_words,
    width_words,
)

WIDTH = 100
NAME_WIDTH = 31
COLUMN = 7


def plan_text(plan: FlightPlan, *, width: int = WIDTH) -> str:
    """Return a plan as text for a terminal.

    Parameters
    ----------
    plan
        From `plan`.
    width
        Of a line [characters]; tables are as wide as their numbers.
    """
    sections = [
        [line for words in _title(plan) for line in textwrap.wrap(words, width)],
        _answer(plan, width),
        _missing(plan, width),
        _steps(plan, width),
        _table(plan, width),
        _lengths(plan),
        _assumed(plan, width),
    ]
    return "\n\n".join("\n".join(lines) for lines in sections if lines) + "\n"


def _title(plan: FlightPlan) -> list[str]:
    rough, request = plan.rough, plan.request
    return [
        f"{request.name}: {rough.truth.mass:g} kg, {len(rough.vehicle.rotors)} rotors, "
        f"{rough.vehicle.arm:.3g} m from their centre, rotor speed {request.speed}",
        f"Wanted: {wanted_words(plan)} (half of the 95 % interval)",
    ]


def _answer(plan: FlightPlan, width: int) -> list[str]:
    if plan.enough:
        return _wrapped(width, "Nothing more to fly: the result reaches this already.")
    if plan.recommended is not None:
        return _wrapped(width, f"Fly: {flown_words(plan.recommended)}.", *_with_payload(plan))
    return _wrapped(
        width,
        f"No flight considered here reaches this. The closest is: {flown_words(plan.best)}; it "
        "leaves "
        f"{unmet_words(plan)}.",
        *_with_payload(plan),
        *remedy_words(plan),
    )


def remedy_words(plan: FlightPlan) -> list[str]:
    """Return what would reach what is wanted, or what is in the way."""
    words: list[str] = []
    for remedy in plan.remedies:
        flown = flown_words(remedy.candidate)
        if remedy.kind == "measured-speed":
            words.append(f"With measured rotor speed (ESC telemetry) in the log: {flown}.")
        else:
            words.append(
                "Longer (several flights of the same configuration, if the battery does not "
                f"last): {flown}."
            )
    if words:
        return words
    commanded = plan.request.speed == "commanded"
    tried = (
        "Neither flying longer nor measured rotor speed reaches it"
        if commanded
        else "Flying longer does not reach it"
    )
    return [
        f"{tried}: the remaining error comes from gusts, the timing of the motor data and the "
        "scale, not from noise. A calm hall, brisker flying, a faster log (--log-rate) or a "
        "heavier payload (--payload) may help."
    ]


def _with_payload(plan: FlightPlan) -> list[str]:
    if not plan.chosen.payload:
        return []
    return [
        f"Payload: {payload_words(plan)}; weigh each to "
        f"{scale_words(plan)}, measure their places to {place_words(plan)}."
    ]


def _missing(plan: FlightPlan, width: int) -> list[str]:
    if plan.request.after is None:
        return []
    if not plan.missing:
        return ["Still missing: nothing; every number of the result is identified."]
    lines = textwrap.wrap(
        "Still missing, and what to fly for each (as identify advises, or what works better for "
        "this vehicle):",
        width,
    )
    for missing in plan.missing:
        head = f"  {missing.name:<14} {missing.verdict:<15}"
        lines += textwrap.wrap(
            _missing_words(missing),
            width,
            initial_indent=head,
            subsequent_indent=" " * len(head),
        )
    return lines


def _missing_words(missing: Missing) -> str:
    if missing.manoeuvre is None:
        return missing.advice
    return f"{missing.advice} (then +-{digits(100.0 * missing.relative)} %, {missing.predicted})"


def _steps(plan: FlightPlan, width: int) -> list[str]:
    if plan.enough:
        return []
    lines = ["Each flight:" if plan.chosen.payload else "The flight:"]
    for step in steps_of(plan.chosen):
        head = f"  {f'{step.seconds:.3g}':>4} s  "
        lines += textwrap.wrap(
            f"{step.title}: {step.words}",
            width,
            initial_indent=head,
            subsequent_indent=" " * len(head),
        )
    return [*lines, *_wrapped(width, SWEEPS)]


def _table(plan: FlightPlan, width: int) -> list[str]:
    seconds = plan.chosen.seconds
    lines = [
        f"Predicted half of the 95 % interval, each flight {seconds:g} s",
        "(CoM in mm, others in %; - not identified; * reaches what is wanted)",
        _header(),
    ]
    rows = [c for c in plan.candidates if c.seconds == seconds]
    lines += [_row(TITLES[c.schedule], c) for c in rows if not c.payload]
    if plan.payload:
        lines += ["", *_wrapped(width, f"and again with {payload_words(plan)}")]
        lines += [_row(TITLES[c.schedule], c) for c in rows if c.payload]
    return lines


def _lengths(plan: FlightPlan) -> list[str]:
    chosen = plan.chosen
    same = [
        c for c in plan.candidates if (c.schedule, c.payload) == (chosen.schedule, chosen.payload)
    ]
    if len(same) < 2:
        return []
    payload = ", bare and with payload" if chosen.payload else ""
    title = f"{TITLES[chosen.schedule].capitalize()}{payload}: how long"
    return [title, *(_row(f"{c.seconds:g} s", c) for c in same)]


def _header() -> str:
    names = (name.replace("com_", "CoM ") for name in WANTABLE)
    return " " * (NAME_WIDTH + 2) + "".join(f"{name:>{COLUMN}}" for name in names)


def _row(title: str, candidate: Candidate) -> str:
    mark = "*" if candidate.meets else " "
    cells = "".join(f"{width_words(candidate, name):>{COLUMN}}" for name in WANTABLE)
    return f"  {title:<{NAME_WIDTH}}{cells} {mark}".rstrip()


def _assumed(plan: FlightPlan, width: int) -> list[str]:
    return [
        "Assumed",
        *(f"  {line}" for words in assumed_words(plan) for line in _wrapped(width, words)),
    ]


def assumed_words(plan: FlightPlan) -> Iterator[str]:
    """Yield what the predictions rest on."""
    a, truth = plan.assumed, plan.rough.truth
    speed = (
        f"rotor speed with noise of {100 * a.speed_noise:g} % of hover"
        if plan.request.speed == "measured"
        else f"motors within {100 * a.speed_error:g} % of their commands at hover, the law known"
    )
    yield (
        f"gyro {a.gyro_std:g} rad/s, accelerometer {a.accel_std:g} m/s^2 (a sample at 200 Hz, "
        f"vibration included), {speed}, log at {a.log_rate:g} Hz, weighed to {scale_words(plan)}"
    )
    yield (
        f"gusts of {100 * a.force:g} % of the weight, and torques of {100 * a.torque[0]:.2g}, "
        f"{100 * a.torque[1]:.2g}, {100 * a.torque[2]:.2g} % of weight times arm, below "
        f"{a.corner:g} Hz: a calm day or a hall; wind widens everything"
    )
    values = truth.parameters()
    shown = {name: values[f"{name}_com"] for name in ("Ixx", "Iyy", "Izz")}
    shown |= {name: values[name] for name in ("kt", "kd", "Jr", "motor_lag")}
    numbers = ", ".join(f"{name} {value:.2g}" for name, value in shown.items())
    if plan.rough.guessed:
        guessed = ", ".join(plan.rough.guessed)
        yield f"{numbers} (SI); guessed from geometry: {guessed} (better: --guess NAME=VALUE)"
    else:
        yield f"{numbers} (SI)"


def _wrapped(width: int, *paragraphs: str) -> list[str]:
    return [line for words in paragraphs for line in textwrap.wrap(words, width - 2)]
