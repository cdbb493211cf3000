"""A plan on one page to print and take along: checklist, flights, manoeuvres."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import write_whole
from rotorfit.report.pages import drawing, label, render_page, tag
from rotorfit.report.plan_text import (
    Step,
    flight_phrase,
    mass_text,
    payload_phrase,
    place_accuracy,
    scale_accuracy,
    steps_of,
    unit_of,
    unmet_phrase,
    wanted_phrase,
    width_text,
)
from rotorfit.sheet import wrapped
from rotorfit.tools.planning.wanted import WANTABLE

if TYPE_CHECKING:
    from pathlib import Path

    from rotorfit.tools.planning.plan import FlightPlan

WIDTH: Final = 78
PLAIN_NAMES: Final = {
    "kt": "thrust",
    "kd": "drag torque",
    "Jr": "rotor inertia",
    "Ixx": "roll inertia",
    "Iyy": "pitch inertia",
    "Izz": "yaw inertia",
    "com_x": "CoM forward",
    "com_y": "CoM left",
    "com_z": "CoM up",
}


@frozen_dataclass
class CardFlight:
    """One flight of the card: its name, how the vehicle is loaded, and its steps."""

    name: str
    load: str
    steps: tuple[Step, ...]

    @property
    def seconds(self) -> float:
        """From switching on to off [s]."""
        return sum(step.seconds for step in self.steps)


def card_html(plan: FlightPlan) -> str:
    """Write the card as one self-contained HTML page of A4 size."""
    return render_page(
        "card",
        "card",
        plan=plan,
        headline=headline(plan),
        promise=promise(plan).replace("+-", "\u00b1"),
        checklist=checklist(plan),
        flights=card_flights(plan),
        expected=expected(plan),
        command=command_after(plan),
        payload=payload_phrase(plan) if plan.chosen.payload else "",
        view=_top_view(plan),
        mass=mass_text(plan.rough.truth.mass),
    )


def card_text(plan: FlightPlan) -> str:
    """Write the card as plain text."""
    lines = [
        f"PILOT CARD  {plan.request.name}",
        *wrapped(headline(plan), WIDTH),
        *wrapped(promise(plan), WIDTH),
        "",
        "BEFORE",
    ]
    for item in checklist(plan):
        lines += wrapped(item, WIDTH, "  [ ] ")
    for flight in card_flights(plan):
        lines += ["", f"{flight.name.upper()}  ({flight.load}, {flight.seconds:.0f} s in all)"]
        for step in flight.steps:
            seconds = f"{step.seconds:.3g} s"
            lines += wrapped(f"{step.title}: {step.words}", WIDTH, f"  [ ] {seconds:>5}  ")
    lines += ["", "AFTER", *wrapped(command_after(plan), WIDTH, "  ")]
    expectations = ", ".join(f"{name} +-{width}" for name, width in expected(plan))
    lines += ["", *wrapped(f"Expected: {expectations}", WIDTH)]
    lines += ["", "Date __________  Place ______________  Pilot ______________", ""]
    return "\n".join(lines)


def write_card(path: Path, plan: FlightPlan, *, force: bool = False) -> None:
    """Write the card, as text where the file's name ends in ``.txt``, else as HTML.

    Parameters
    ----------
    path
        The file.
    plan
        From `plan`.
    force
        Replace a file that is there.

    Raises
    ------
    OutputError
        If the file exists and `force` is false, or cannot be written.
    """
    text = path.suffix.lower() == ".txt"
    write_whole(path, card_text(plan) if text else card_html(plan), force=force)


def headline(plan: FlightPlan) -> str:
    """Summarise the flight in one sentence."""
    return flight_phrase(plan.chosen).capitalize()


def promise(plan: FlightPlan) -> str:
    """Describe the wanted accuracy, and whether the plan gives it."""
    wanted = f"Wanted: {wanted_phrase(plan)}."
    if plan.enough:
        return f"{wanted} The earlier result reaches that already: this would only repeat it."
    if plan.recommended is None:
        return f"{wanted} Not quite reached: this leaves {unmet_phrase(plan)}."
    return wanted


def checklist(plan: FlightPlan) -> tuple[str, ...]:
    """List what to do before take-off."""
    motors = (
        "rotor speed of every motor (ESC telemetry, bidirectional DShot)"
        if plan.request.speed == "measured"
        else "command of every motor"
    )
    items = [
        f"Weighed as it flies, battery and propellers included, to {scale_accuracy(plan)}: "
        "__________ g",
        f"Log set: gyro and accelerometer hardly filtered, {motors}; "
        f"{plan.assumed.log_rate:g} samples a second or more",
        "Logging starts before arming and stops after disarming",
        "Propellers sound and balanced, arms and IMU tight, nothing dangles",
        "A calm place; 6 x 6 m free, 2 m above and below",
    ]
    if plan.chosen.payload:
        items.insert(
            1,
            f"For the second flight: {payload_phrase(plan)}. "
            f"Each weighed to {scale_accuracy(plan)}: ______ g, ______ g. "
            f"Place of each from the centre to {place_accuracy(plan)}: "
            "____ ____ ____, ____ ____ ____ mm",
        )
    return tuple(items)


def card_flights(plan: FlightPlan) -> tuple[CardFlight, ...]:
    """List the flights in their order."""
    steps = steps_of(plan.chosen)
    bare = "as it flies, no payload"
    if not plan.chosen.payload:
        return (CardFlight(name="The flight", load=bare, steps=steps),)
    return (
        CardFlight(name="Flight 1", load=bare, steps=steps),
        CardFlight(name="Flight 2", load="with the payload", steps=steps),
    )


def expected(plan: FlightPlan) -> tuple[tuple[str, str], ...]:
    """Tabulate the expected half-widths of the 95 % intervals by plain names."""
    rows: list[tuple[str, str]] = []
    for name in WANTABLE:
        width = width_text(plan.chosen, name)
        shown = "no number" if width == "-" else f"{width} {unit_of(name)}"
        rows.append((f"{PLAIN_NAMES[name]} ({name})", shown))
    return tuple(rows)


def command_after(plan: FlightPlan) -> str:
    """Write the command for the log."""
    if plan.chosen.payload:
        return (
            "rotorfit identify EXPERIMENT.toml with both flights, the second with payload = [...] "
            "and payload_of (see docs/experiment.md)"
        )
    mass = f"{plan.rough.truth.mass:g}"
    name = plan.request.name
    airframe = name if name.endswith(".toml") else "AIRFRAME.toml"  # a plan after a result
    return f"rotorfit identify LOG --mass {mass} --airframe {airframe} -o result.json"


def _top_view(plan: FlightPlan) -> str:
    """Draw the vehicle from above, forward up, with its payload."""
    vehicle = plan.rough.vehicle
    size, reach = 200.0, float(np.abs(vehicle.positions[:, :2]).max())
    spacing = _smallest_spacing(vehicle.positions[:, :2])
    scale = 0.47 * size / (reach + 0.4 * spacing)
    middle = size / 2.0

    def place(x: float, y: float) -> tuple[float, float]:
        return middle - scale * y, middle - scale * x

    radius = 0.38 * scale * spacing
    parts: list[str] = []
    for rotor in vehicle.rotors:
        px, py = place(rotor.position[0], rotor.position[1])
        ends = {"x1": middle, "y1": middle, "x2": px, "y2": py}
        parts.append(tag("line", {**ends, "class": "arm"}))
    loads = {item.position for item in plan.payload} if plan.chosen.payload else set[object]()
    for number, rotor in enumerate(vehicle.rotors, start=1):
        px, py = place(rotor.position[0], rotor.position[1])
        loaded = rotor.position in loads
        parts.append(tag("circle", {"cx": px, "cy": py, "r": radius, "class": "rotor"}))
        if loaded:
            parts.append(tag("circle", {"cx": px, "cy": py, "r": 11, "class": "load"}))
        kind = "number loaded" if loaded else "number"
        parts.append(label(str(number), {"x": px, "y": py + 4.5, "class": kind}))
    parts.append(tag("path", {"d": f"M{middle} 4 l7 12 h-14 z", "class": "front"}))
    words = "The vehicle from above, its rotors numbered, forward up"
    return drawing(size, size, {"class": "view", "role": "img", "aria-label": words}, *parts)


def _smallest_spacing(places: np.ndarray) -> float:
    """Compute the smallest distance between two rotors [m]."""
    distances = np.hypot(
        places[:, None, 0] - places[None, :, 0], places[:, None, 1] - places[None, :, 1]
    )
    return float(distances[~np.eye(len(places), dtype=bool)].min())
