"""The motors' law in words and as a picture: measured speeds over commands, and the curve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.motors.motor_law import FOUND as LAW_FOUND
from rotorfit.digits import Number, number_of
from rotorfit.errors import ExperimentError
from rotorfit.fit.experiment.experiment import experiment_of_settings
from rotorfit.fit.experiment.toml_files import experiment_text
from rotorfit.flight.motors.motor_model import speeds
from rotorfit.report.pages import drawing, label, tag, text, tick_label, ticks
from rotorfit.report.parameters import unit_words
from rotorfit.results.result import is_per_command

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from jaxtyping import Float

    from rotorfit.logs.motor_law import MotorLaw
    from rotorfit.results.command_law import CommandLaw, LawPoint
    from rotorfit.results.result import IdentificationResult
    from rotorfit.results.validation.wrench_comparison import WrenchComparison

    Points = Float[np.ndarray, " n"]

WIDTH, HEIGHT = 640.0, 320.0
LEFT, RIGHT, TOP, BOTTOM = 70.0, 16.0, 14.0, 46.0
CURVE_POINTS: Final = 101
NAMES: Final = {
    "full_speed": "speed at full command",
    "offset": "offset: motor input at command 0, as a share of full",
    "exponent": "exponent",
    "thr_mdl_fac": "factor of the square",
    "voltage_exponent": "exponent of the battery's voltage",
    "thrust_factor": "THR_MDL_FAC (PX4), MOT_THST_EXPO (ArduPilot)",
    "thrust_linear": "thrust_linear (Betaflight) over 100",
}
FORMULAS: Final = {
    "linear": "full_speed (offset + (1 - offset) u)",
    "power": "full_speed u^exponent",
    "offset power": "full_speed (offset + (1 - offset) u)^exponent",
    "sqrt": "full_speed sqrt(f u^2 + (1 - f) u), f = thr_mdl_fac",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class LawRow:
    """One number of the law as it is shown."""

    name: str
    title: str
    number: Number | None
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LawSection:
    """The law as the page shows it."""

    declared: bool
    formula: str
    rows: tuple[LawRow, ...]
    sentences: tuple[str, ...]
    motors: tuple[str, ...]
    picture: str


def law_section(
    result: IdentificationResult, comparisons: Sequence[WrenchComparison] = ()
) -> LawSection | None:
    """Describe the law for a page; None if a result neither found nor was given one."""
    law = result.command_law
    if law is None:
        return _declared_section(result, comparisons)
    return LawSection(
        declared=False,
        formula=formula_of(law),
        rows=tuple(
            LawRow(
                name=n.name,
                title=NAMES.get(n.name, n.name),
                number=number_of(n.value, n.interval),
                unit=unit_words(n.unit),
            )
            for n in law.numbers
        ),
        sentences=law_sentences(law),
        motors=motors_lines(law),
        picture=law_picture(law),
    )


def _declared_section(
    result: IdentificationResult, comparisons: Sequence[WrenchComparison]
) -> LawSection | None:
    """Describe the law of ``[motors]``, and where on it the compared flights were."""
    law = _declared_law(result)
    if law is None:
        return None
    seen = [c.speeds for c in comparisons if c.speeds is not None]
    per_command, commands = is_per_command(result.parameters), None
    sentences = [_origin_of(result)]
    if seen:
        low, high = min(s[0] for s in seen), max(s[1] for s in seen)
        grid = np.linspace(0.0, 1.0, 1001)
        reached = speeds(law, grid)
        commands = (
            float(grid[min(np.searchsorted(reached, low), 1000)]),
            float(grid[min(np.searchsorted(reached, high), 1000)]),
        )
        sentences.append(
            (
                f"speeds in flight were {low:.2f} to {high:.2f} of that at full command, "
                if per_command
                else f"speeds in flight were {low:.0f} to {high:.0f} rad/s, "
            )
            + f"at commands of about {commands[0]:.2f} to {commands[1]:.2f}: there the law must "
            "hold"
        )
    return LawSection(
        declared=True,
        formula="",
        rows=(),
        sentences=tuple(sentences),
        motors=(),
        picture=_draw_law(law, commands=commands, unit="of full" if per_command else "rad/s"),
    )


def _origin_of(result: IdentificationResult) -> str:
    """State whether the law is declared, or found in the flight."""
    if any(one.kind == LAW_FOUND for one in result.findings):
        return (
            "the law is the one that weight and changes of thrust show in hover, or the usual one "
            "where they show none: neither log nor declaration has one"
        )
    return "the law is the declared one: the log has no rotor speed to check it by"


def _declared_law(result: IdentificationResult) -> MotorLaw | None:
    """Read the motors' law from the settings; None if there is no readable one."""
    try:
        return experiment_of_settings(result.settings).motors.law
    except ExperimentError:
        return None


def formula_of(law: CommandLaw) -> str:
    """Write the law's equation, u being the command."""
    voltage = ""
    if law.nominal_voltage is not None:
        voltage = f" (V / {law.nominal_voltage:.4g} V)^voltage_exponent"
    return f"speed = {FORMULAS.get(law.form, law.form)}{voltage}"


def law_sentences(law: CommandLaw) -> tuple[str, ...]:
    """Describe how well the law holds, and where it was seen."""
    best = min(law.held_out.values(), default=float("nan"))
    others = [
        f"{name} {error / best:.2g} times"
        for name, error in sorted(law.held_out.items(), key=lambda item: item[1])
        if name != law.form
    ]
    parts = [
        f"measured speeds are within {100.0 * law.relative_error:.2g} % of it (root mean square)"
        + (f"; other forms predict worse: {', '.join(others)} the error" if others else ""),
        f"commands in flight were {law.commands[0]:.2f} to {law.commands[1]:.2f}; outside, the "
        "law is extrapolated",
    ]
    factors = [f"{i} {f:.3f}" for i, f in enumerate(law.rotor_factors, 1) if f is not None]
    if len(factors) > 1:
        parts.append(f"speed of each rotor over the mean at the same command: {', '.join(factors)}")
    return tuple(parts)


def motors_lines(law: CommandLaw) -> tuple[str, ...]:
    """Write the TOML of ``[motors]`` for flights of this vehicle without rotor speed."""
    if not law.motors:
        return ()
    return tuple(experiment_text({"motors": law.motors}).splitlines())


def law_picture(law: CommandLaw) -> str:
    """Draw the curve over the measured speeds: medians, and bars that hold 90 % of them."""
    return _draw_law(
        law.law, commands=law.commands, points=law.points, spread=2.0 * law.relative_error
    )


def _draw_law(
    law: MotorLaw,
    *,
    commands: tuple[float, float] | None,
    points: Sequence[LawPoint] = (),
    spread: float = 0.0,
    unit: str = "rad/s",
) -> str:
    """Draw a law, dashed where nobody flew, with a band of a share of it to either side."""
    u = np.linspace(0.0, 1.0, CURVE_POINTS)
    speed = speeds(law, u)
    top = float(max((1.0 + spread) * speed.max(), *(point.high for point in points), 1.0))
    values = ticks(0.0, top, 6)
    top = max(top, values[-1])
    wide, high = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def at(command: float, rate: float) -> tuple[float, float]:
        return LEFT + command * wide, TOP + (1.0 - rate / top) * high

    def path(commands: Points, rates: Points) -> str:
        return "L".join(
            "{:.1f} {:.1f}".format(*at(a, b)) for a, b in zip(commands, rates, strict=True)
        )

    parts = [
        tag("rect", {"class": "frame", "x": LEFT, "y": TOP, "width": wide, "height": high}),
        *_flown_range(commands, at),
    ]
    if spread > 0.0:
        there, back = path(u, (1.0 + spread) * speed), path(u[::-1], (1.0 - spread) * speed[::-1])
        parts.append(tag("path", {"class": "spread", "d": f"M{there}L{back}Z"}))
    for value in values:
        x, y = at(0.0, value)
        words = tick_label(value, values[1] - values[0])
        parts.append(tag("path", {"class": "grid", "d": f"M{x:.1f} {y:.1f}h{wide:.1f}"}))
        parts.append(label(words, {"class": "tick right", "x": x - 6, "y": y + 4}))
    for value in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        x, y = at(value, 0.0)
        parts.append(label(f"{value:g}", {"class": "tick middle", "x": x, "y": y + 16}))
    for point in points:
        (x, low), (_, mid), (_, up) = (
            at(point.command, rate) for rate in (point.low, point.median, point.high)
        )
        words = f"command {point.command:.2f}: {point.median:.0f} rad/s"
        title = tag("title", {}, text(words))
        parts.append(tag("path", {"class": "bar", "d": f"M{x:.1f} {low:.1f}V{up:.1f}"}))
        parts.append(tag("circle", {"class": "point", "cx": x, "cy": mid, "r": 3}, title))
    flown = (u >= commands[0]) & (u <= commands[1]) if commands else u < 0.0
    parts.append(tag("path", {"class": "curve rotor beyond", "d": f"M{path(u, speed)}"}))
    if flown.any():
        parts.append(tag("path", {"class": "curve rotor", "d": f"M{path(u[flown], speed[flown])}"}))
    middle = LEFT + 0.5 * wide
    parts.append(label("command", {"class": "axis-name middle", "x": middle, "y": HEIGHT - 8}))
    parts.append(label(unit, {"class": "axis-name", "x": 8, "y": TOP + 12}))
    measured = "measured, and the law" if points else "the given law"
    name = f"Rotor speed over command: {measured}"
    shown = {"class": "motor-law chart", "role": "img", "aria-label": name}
    return drawing(WIDTH, HEIGHT, shown, *parts)


def _flown_range(
    commands: tuple[float, float] | None, at: Callable[[float, float], tuple[float, float]]
) -> list[str]:
    """Shade the range of commands in flight."""
    if commands is None:
        return []
    (x, y), (right, _) = at(commands[0], 0.0), at(commands[1], 0.0)
    box: dict[str, str | float] = {"x": x, "y": TOP, "width": max(right - x, 1.0)}
    return [tag("rect", {"class": "seen", **box, "height": y - TOP})]
