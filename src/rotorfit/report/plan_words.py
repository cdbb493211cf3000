"""A plan in plain words: manoeuvres as a pilot flies them, numbers as a person reads them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from rotorfit.planning.candidate import Candidate, ScheduleName
from rotorfit.planning.plan import SCHEDULES, FlightPlan
from rotorfit.planning.vehicle import payload_rotors
from rotorfit.planning.wanted import IN_MM, shown_width
from rotorfit.simulation.pilot import MANOEUVRES, Manoeuvre, Stick

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One line of a flight: how long, what it is called, and what to do."""

    seconds: float
    title: str
    words: str
    flown: bool = True


def steps_of(candidate: Candidate) -> tuple[Step, ...]:
    """Return a flight from the ground and back, each step as the pilot flies it."""
    manoeuvres = [
        Step(
            seconds=share * candidate.seconds,
            title=MANOEUVRE_TITLES[manoeuvre],
            words=_manoeuvre_words(manoeuvre),
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


def _manoeuvre_words(manoeuvre: Manoeuvre) -> str:
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
    """Return how far a stick usually goes [deg or deg/s], rounded to five."""
    match stick.shape:
        case "noise":
            peak = 2.0 * stick.rms
        case "turns":
            peak = stick.rms
        case "doublets":  # a whole sine now and then: its peak from its share of the time
            peak = stick.rms * math.sqrt(2.0 * stick.band[1] / stick.band[0])
    return 5 * round(math.degrees(peak) / 5)


def width_words(candidate: Candidate, name: str) -> str:
    """Return a predicted half-width in percent or millimetres, ``-`` where there is no number."""
    number = candidate.numbers[name]
    known = number.verdict != "not-identified"
    # Against the few millimetres that matter a wide one is lost, but where it is can be said.
    if not (known or (name in IN_MM and number.half_width < LARGEST_SHOWN)):
        return "-"
    return digits(shown_width(name, number.half_width, number.value))


def digits(value: float) -> str:
    """Return a number with two digits."""
    return f"{value:.0f}" if value >= 9.95 else f"{value:.1f}" if value >= 0.95 else f"{value:.2f}"


def unit_of(name: str) -> str:
    """Return the unit in which a half-width is shown."""
    return "mm" if name in IN_MM else "%"


def wanted_words(plan: FlightPlan) -> str:
    """Return what is wanted, names of equal accuracy together."""
    by_limit: dict[tuple[float, str], list[str]] = {}
    for name, limit in plan.request.wanted.limits.items():
        by_limit.setdefault((limit, unit_of(name)), []).append(name)
    return "; ".join(
        f"{', '.join(names)} within {limit:g} {unit}" for (limit, unit), names in by_limit.items()
    )


def payload_words(plan: FlightPlan) -> str:
    """Return what the payload is, and where."""
    first, second = payload_rotors(plan.rough.vehicle, plan.payload)
    mass = mass_words(plan.payload[0].mass)
    return f"two equal masses of {mass}, one under rotor {first} and one under rotor {second}"


def place_words(plan: FlightPlan) -> str:
    """Return how well the places of the payload have to be known."""
    return f"{1e3 * plan.payload[0].position_std:.1g} mm"


def mass_words(mass: float) -> str:
    """Return a mass in grams."""
    return f"{1e3 * mass:.3g} g" if mass < 1.0 else f"{1e3 * mass:.0f} g"


def scale_words(plan: FlightPlan) -> str:
    """Return how finely to weigh."""
    return f"{1e3 * plan.assumed.mass_step:g} g"


def flown_words(candidate: Candidate) -> str:
    """Return a candidate in a few words."""
    title = TITLES[candidate.schedule]
    if candidate.payload:
        return f"{title}, {candidate.seconds:g} s without and {candidate.seconds:g} s with payload"
    return f"{title}, {candidate.seconds:g} s"


def unmet_words(plan: FlightPlan) -> str:
    """Return what the best candidate does not reach."""
    parts: list[str] = []
    for name, limit in plan.request.wanted.limits.items():
        number = plan.best.numbers[name]
        width = shown_width(name, number.half_width, number.value)
        if width > limit:
            lost = number.verdict == "not-identified"
            shown = "unknown" if lost else f"+-{digits(width)} {unit_of(name)}"
            parts.append(f"{name} {shown}")
    return ", ".join(parts)
