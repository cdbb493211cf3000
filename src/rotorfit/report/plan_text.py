"""A plan as text: manoeuvres as a pilot flies them, what they would give, what was assumed."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING, Final

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.sheet import wrapped
from rotorfit.simulation.pilot import MANOEUVRES, Manoeuvre, Stick
from rotorfit.tools.planning.next_step import best_manoeuvre, next_step
from rotorfit.tools.planning.plan import SCHEDULES, FlightPlan
from rotorfit.tools.planning.vehicle import payload_rotors
from rotorfit.tools.planning.wanted import IN_MM, WANTABLE, Candidate, ScheduleName, shown_width

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rotorfit.tools.planning.advised_step import NextStep

WIDTH = 100
NAME_WIDTH = 31
COLUMN = 7


TITLES: Final[Mapping[ScheduleName, str]] = {
    "hover": "hover only",
    "axes": "one axis at a time",
    "sticks": "all sticks at once",
    "doublets": "kicks out and back",
    "wiggles": "quick wiggles in slow turns",
    "turns": "steady turns while rolling",
    "mixed": "half turns, half wiggles",
}
MANOEUVRE_TITLES: Final[Mapping[Manoeuvre, str]] = {
    "hover": "hover",
    "roll": "roll only",
    "pitch": "nod only",
    "yaw": "yaw only",
    "climb": "climb and sink only",
    "sticks": TITLES["sticks"],
    "doublets": TITLES["doublets"],
    "wiggles": TITLES["wiggles"],
    "turns": TITLES["turns"],
}
SWEEPS: Final = (
    "An autopilot that flies frequency sweeps (ArduPilot's SystemID mode, Betaflight's chirp) may "
    "add them to the flight: roll, pitch and yaw one by one, 0.5 to 10 Hz, 20 s each; what they "
    "give is not in the table."
)
GROUND_SECONDS: Final = 2.0
SETTLE_SECONDS: Final = 5.0
LARGEST_SHOWN: Final = 0.05
"""A CoM known to less than this is not known [m]."""
LAND_SECONDS: Final = 5.0


@frozen_dataclass
class Step:
    """One line of a flight: how long, what it is called, and what to do."""

    seconds: float
    title: str
    words: str
    flown: bool = True


def plan_text(plan: FlightPlan, *, width: int = WIDTH) -> str:
    """Format a plan as text for a terminal.

    Parameters
    ----------
    plan
        From `plan`.
    width
        Of a line [characters]; tables are as wide as their numbers.
    """
    sections = [
        [line for words in _plan_title(plan) for line in textwrap.wrap(words, width)],
        _first_advice(plan, width),
        _plan_conclusion(plan, width),
        _missing_lines(plan, width),
        _step_lines(plan, width),
        _candidate_table(plan, width),
        _length_lines(plan),
        [
            "Assumed",
            *(
                f"  {line}"
                for words in assumption_sentences(plan)
                for line in _wrap_paragraphs(width, words)
            ),
        ],
    ]
    return "\n\n".join("\n".join(lines) for lines in sections if lines) + "\n"


def _plan_title(plan: FlightPlan) -> list[str]:
    rough, request = plan.rough, plan.request
    return [
        f"{request.name}: {rough.truth.mass:g} kg, {len(rough.vehicle.rotors)} rotors, "
        f"{rough.vehicle.arm:.3g} m from their centre, rotor speed {request.speed}",
        f"Wanted: {wanted_phrase(plan)} (half of the 95 % interval)",
    ]


def _first_advice(plan: FlightPlan, width: int) -> list[str]:
    """State what the earlier result asks for first, in its own words."""
    step = step_after(plan)
    if step is None:
        return []
    head = "Next step" if step.kind in ("fly", "done") else "Before any flight of this plan"
    return _wrap_paragraphs(width, f"{head}: {step.sentence}.")


def step_after(plan: FlightPlan) -> NextStep | None:
    """Choose the next step after the earlier result of a plan; None without one."""
    after = plan.request.after
    return None if after is None else next_step(after, predicted=best_manoeuvre(plan.missing))


def _plan_conclusion(plan: FlightPlan, width: int) -> list[str]:
    if plan.enough:
        return _wrap_paragraphs(
            width, "Nothing to fly for this target: the result reaches it already."
        )
    if plan.recommended is not None:
        return _wrap_paragraphs(
            width, f"Fly: {flight_phrase(plan.recommended)}.", *_with_payload(plan)
        )
    return _wrap_paragraphs(
        width,
        "No flight considered here reaches the target. The closest is: "
        f"{flight_phrase(plan.best)}; it leaves {unmet_phrase(plan)}.",
        *_with_payload(plan),
        *remedy_sentences(plan),
    )


def remedy_sentences(plan: FlightPlan) -> list[str]:
    """Describe how to reach the wanted accuracy, or what prevents it."""
    words: list[str] = []
    for remedy in plan.remedies:
        flown = flight_phrase(remedy.candidate)
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
        f"Payload: {payload_phrase(plan)}; weigh each to "
        f"{scale_accuracy(plan)}, measure their places to {place_accuracy(plan)}."
    ]


def _missing_lines(plan: FlightPlan, width: int) -> list[str]:
    if plan.request.after is None:
        return []
    if not plan.missing:
        return ["Still missing: nothing; every number of the result is identified."]
    lines = textwrap.wrap(
        "Still missing, and what to fly for each (as identify advises, this vehicle):",
        width,
    )
    before = ""
    for missing in plan.missing:
        head = f"  {missing.name:<14} {missing.verdict:<15}"
        then = "" if missing.manoeuvre is None else f" ({missing.gain}, {missing.predicted})"
        lines += textwrap.wrap(
            f"{'the same' if missing.advice == before else missing.advice}{then}",
            width,
            initial_indent=head,
            subsequent_indent=" " * len(head),
        )
        before = missing.advice
    return lines


def _step_lines(plan: FlightPlan, width: int) -> list[str]:
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
    return [*lines, *_wrap_paragraphs(width, SWEEPS)]


def _candidate_table(plan: FlightPlan, width: int) -> list[str]:
    seconds = plan.chosen.seconds
    lines = [
        f"Predicted half of the 95 % interval, each flight {seconds:g} s",
        "(CoM in mm, others in %; - not identified; * reaches what is wanted)",
        " " * (NAME_WIDTH + 2)
        + "".join(f"{name.replace('com_', 'CoM '):>{COLUMN}}" for name in WANTABLE),
    ]
    rows = [c for c in plan.candidates if c.seconds == seconds]
    lines += [_candidate_row(TITLES[c.schedule], c) for c in rows if not c.payload]
    if plan.payload:
        lines += ["", *_wrap_paragraphs(width, f"and again with {payload_phrase(plan)}")]
        lines += [_candidate_row(TITLES[c.schedule], c) for c in rows if c.payload]
    return lines


def _length_lines(plan: FlightPlan) -> list[str]:
    chosen = plan.chosen
    same = [
        c for c in plan.candidates if (c.schedule, c.payload) == (chosen.schedule, chosen.payload)
    ]
    if len(same) < 2:
        return []
    payload = ", bare and with payload" if chosen.payload else ""
    title = f"{TITLES[chosen.schedule].capitalize()}{payload}: how long"
    return [title, *(_candidate_row(f"{c.seconds:g} s", c) for c in same)]


def _candidate_row(title: str, candidate: Candidate) -> str:
    mark = "*" if candidate.meets else " "
    cells = "".join(f"{width_text(candidate, name):>{COLUMN}}" for name in WANTABLE)
    return f"  {title:<{NAME_WIDTH}}{cells} {mark}".rstrip()


def assumption_sentences(plan: FlightPlan) -> Iterator[str]:
    """Describe what the predictions assume."""
    a, truth = plan.assumed, plan.rough.truth
    speed = (
        f"rotor speed with noise of {100 * a.speed_noise:g} % of hover"
        if plan.request.speed == "measured"
        else f"motors within {100 * a.speed_error:g} % of their commands at hover, the law known"
    )
    yield (
        f"gyro {a.gyro_std:g} rad/s, accelerometer {a.accel_std:g} m/s^2 (a sample at 200 Hz, "
        f"vibration included), {speed}, log at {a.log_rate:g} Hz, weighed to {scale_accuracy(plan)}"
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


def _wrap_paragraphs(width: int, *paragraphs: str) -> list[str]:
    return [line for words in paragraphs for line in wrapped(words, width - 2)]


def steps_of(candidate: Candidate) -> tuple[Step, ...]:
    """Lay out a flight from the ground and back, each step as the pilot flies it."""
    manoeuvres = [
        Step(
            seconds=share * candidate.seconds,
            title=MANOEUVRE_TITLES[manoeuvre],
            words=_manoeuvre_instruction(manoeuvre),
        )
        for manoeuvre, share in SCHEDULES[candidate.schedule].items()
    ]
    rest = "Log running, motors off, hands off."
    return (
        Step(seconds=GROUND_SECONDS, title="on the ground", words=rest, flown=False),
        Step(
            seconds=SETTLE_SECONDS,
            title="take off",
            words="Climb to 1 to 2 m and hover calmly, well away from walls and ground.",
            flown=False,
        ),
        *manoeuvres,
        Step(seconds=LAND_SECONDS, title="land", words="Hover, then set down.", flown=False),
        Step(seconds=GROUND_SECONDS, title="on the ground", words=rest, flown=False),
    )


def _manoeuvre_instruction(manoeuvre: Manoeuvre) -> str:
    sticks = MANOEUVRES[manoeuvre]
    roll, pitch, yaw = peak_deg(sticks.roll), peak_deg(sticks.pitch), peak_deg(sticks.yaw)
    side = f"{0.5 / sticks.yaw.band[0]:.0f} s"
    words: dict[Manoeuvre, str] = {
        "hover": "Hover, hands off.",
        "roll": f"Roll left and right, up to {roll} deg, about once a second. Nothing else.",
        "pitch": f"Nod forward and back, up to {pitch} deg, about once a second. Nothing else.",
        "yaw": f"Yaw left and right, up to {yaw} deg/s, at will. Nothing else.",
        "climb": "Short throttle steps up and down, one or two seconds each. Nothing else.",
        "sticks": (
            f"Move everything at once, at will: roll up to {roll} deg and nod up to {pitch} deg, "
            f"about once a second, yaw up to {yaw} deg/s, throttle a little up and down."
        ),
        "doublets": (
            f"Kick and counter-kick within a second, then pause for one: roll {roll} deg left and "
            f"right; nod {pitch} deg forward and back; yaw {yaw} deg/s left and right. Repeat, now "
            "and then with a short throttle step."
        ),
        "wiggles": (
            f"Turn slowly, {yaw} deg/s: {side} to the left, {side} to the right, and so on. All "
            f"the while wiggle roll and pitch quickly, up to {min(roll, pitch)} deg, once or twice "
            "a second, and move the throttle a little up and down."
        ),
        "turns": (
            f"Turn at a steady {yaw} deg/s: {side} to the left, {side} to the right, and so on. "
            f"All the while roll up to {roll} deg and nod up to {pitch} deg, about once a second, "
            "at will, and move the throttle a little up and down."
        ),
    }
    return words[manoeuvre]


def peak_deg(stick: Stick) -> int:
    """Compute how far a stick usually goes [deg or deg/s], rounded to five."""
    match stick.shape:
        case "noise":
            peak = 2.0 * stick.rms
        case "turns":
            peak = stick.rms
        case "doublets":  # a whole sine now and then: its peak from its share of the time
            peak = stick.rms * math.sqrt(2.0 * stick.band[1] / stick.band[0])
    return 5 * round(math.degrees(peak) / 5)


def width_text(candidate: Candidate, name: str) -> str:
    """Write a predicted half-width in percent or millimetres, ``-`` where there is no number."""
    number = candidate.numbers[name]
    known = number.verdict != "not-identified"
    # Against the few millimetres that matter a wide one is lost, but where it is can be said.
    if not (known or (name in IN_MM and number.half_width < LARGEST_SHOWN)):
        return "-"
    return digits(shown_width(name, number.half_width, number.value))


def digits(value: float) -> str:
    """Write a number with two digits."""
    return f"{value:.0f}" if value >= 9.95 else f"{value:.1f}" if value >= 0.95 else f"{value:.2f}"


def unit_of(name: str) -> str:
    """Select the unit in which a half-width is shown."""
    return "mm" if name in IN_MM else "%"


def wanted_phrase(plan: FlightPlan) -> str:
    """Describe what is wanted, names of equal accuracy together."""
    by_limit: dict[tuple[float, str], list[str]] = {}
    for name, limit in plan.request.wanted.limits.items():
        by_limit.setdefault((limit, unit_of(name)), []).append(name)
    return "; ".join(
        f"{', '.join(names)} within {limit:g} {unit}" for (limit, unit), names in by_limit.items()
    )


def payload_phrase(plan: FlightPlan) -> str:
    """Describe the payload, and its place."""
    first, second = payload_rotors(plan.rough.vehicle, plan.payload)
    mass = mass_text(plan.payload[0].mass)
    return f"two equal masses of {mass}, one under rotor {first} and one under rotor {second}"


def place_accuracy(plan: FlightPlan) -> str:
    """Write how well the places of the payload have to be known."""
    return f"{1e3 * plan.payload[0].position_std:.1g} mm"


def mass_text(mass: float) -> str:
    """Write a mass in grams."""
    return f"{1e3 * mass:.3g} g" if mass < 1.0 else f"{1e3 * mass:.0f} g"


def scale_accuracy(plan: FlightPlan) -> str:
    """Write how finely to weigh."""
    return f"{1e3 * plan.assumed.mass_step:g} g"


def flight_phrase(candidate: Candidate) -> str:
    """Describe a candidate in a few words."""
    title = TITLES[candidate.schedule]
    if candidate.payload:
        return f"{title}, {candidate.seconds:g} s without and {candidate.seconds:g} s with payload"
    return f"{title}, {candidate.seconds:g} s"


def unmet_phrase(plan: FlightPlan) -> str:
    """List what the best candidate does not reach."""
    parts: list[str] = []
    for name, limit in plan.request.wanted.limits.items():
        number = plan.best.numbers[name]
        width = shown_width(name, number.half_width, number.value)
        if width > limit:
            lost = number.verdict == "not-identified"
            shown = "unknown" if lost else f"+-{digits(width)} {unit_of(name)}"
            largest = number.largest_term
            by = "" if lost or largest == "noise" else f" (most of it {largest})"
            parts.append(f"{name} {shown}{by}")
    return ", ".join(parts)
