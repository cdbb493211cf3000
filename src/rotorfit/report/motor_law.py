"""The motors' law on the page: its numbers, and a picture of the curve over measured speeds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.motors.motor_law import FOUND as LAW_FOUND
from rotorfit.digits import Number, number_of
from rotorfit.errors import ExperimentError
from rotorfit.fit.experiment.experiment import experiment_of_settings
from rotorfit.flight.motors.motor_model import speeds
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.report.chart import Area, Axis, Chart, Curve, Mark, Panel, Span, chart_svg
from rotorfit.report.law_words import formula_of, law_sentences, motors_lines
from rotorfit.report.parameters import unit_words
from rotorfit.results.result import is_per_command
from rotorfit.series import Series

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.logs.motor_law import MotorLaw
    from rotorfit.results.command_law import CommandLaw, LawPoint
    from rotorfit.results.result import IdentificationResult
    from rotorfit.results.validation.wrench_comparison import WrenchComparison

    Points = Float[np.ndarray, " n"]

HEIGHT: Final = 260.0
"""Of the picture's panel."""
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


@frozen_dataclass
class LawRow:
    """One number of the law as it is shown."""

    name: str
    title: str
    number: Number | None
    unit: str


@frozen_dataclass
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
    band = Area(style="spread", at=u, low=(1.0 - spread) * speed, high=(1.0 + spread) * speed)
    top = float(max(band.high.max(), *(point.high for point in points), 1.0))
    curves, flown = [_make_curve("rotor beyond", u, speed)], ()
    if commands is not None:
        flown = (Span(start=commands[0], end=commands[1], style="seen", words=""),)
        seen = (u >= commands[0]) & (u <= commands[1])
        curves.append(_make_curve("rotor", u[seen], speed[seen]))
    panel = Panel(
        title=f"Rotor speed [{unit}]",
        height=HEIGHT,
        curves=tuple(curves),
        areas=(band,) if spread > 0.0 else (),
        marks=tuple(_mark_point(point) for point in points),
        spans=flown,
        span=(0.0, 1.04 * top),
    )
    measured = "measured, and the law" if points else "the given law"
    words = f"Rotor speed over command: {measured}"
    axis = Axis(ends=(0.0, 1.0), name="command", unit="", least=1.0)
    return chart_svg(Chart(panels=(panel,), axis=axis, words=words, style="motor-law"))


def _make_curve(style: str, commands: Points, rates: Points) -> Curve:
    series = Series(time=commands, values={style: rates}, gap=np.inf)
    return Curve(key=style, name=style, style=style, series=series)


def _mark_point(point: LawPoint) -> Mark:
    words = f"command {point.command:.2f}: {point.median:.0f} rad/s"
    return Mark(at=point.command, low=point.low, value=point.median, high=point.high, words=words)
