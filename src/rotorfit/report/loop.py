"""The outcome of `rotorfit loop`, on one screen and as a page."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rotorfit.digits import with_half
from rotorfit.report.chart import Area, Axis, Chart, Curve, Line, Panel, chart_svg
from rotorfit.report.pages import render_page
from rotorfit.series import Series
from rotorfit.sheet import table_lines, wrapped
from rotorfit.tools.control_loop.margins import open_phase
from rotorfit.tools.control_loop.measures import SIDES, LoopMeasures, Measure, StepResponse

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float

    from rotorfit.tools.control_loop.loop import AxisLoop, LoopOutcome

    Row = Float[np.ndarray, " f"]

WIDTH = 80
HEADS: Final = ("crossover [Hz]", "phase [deg]", "gain", "delay [ms]", "peak")
HALF = 0.5
"""Half of a step."""
CALM, LIVELY = 2.0, 3.0
"""Peaks of the sensitivity up to which a loop is calm, and beyond which it nearly oscillates."""


def loop_text(outcome: LoopOutcome, *, width: int = WIDTH) -> str:
    """Write margins, proof and notes as plain text, lines of that width."""
    title = (
        f"{outcome.name}: rate loops of {outcome.autopilot} ({outcome.firmware}), configuration "
    )
    lines = [
        *wrapped(f"{title}{outcome.configuration}", width),
        "",
        *_margin_table("Rate loop with attitude loop, cut at the torque command",
                       [(a.axis, a.with_attitude) for a in outcome.axes if a.axis != "yaw"],
                       width),
        "",
        *_margin_table(
            "Rate loop alone", [(_mark_unproven(a.axis), a.rate_loop) for a in outcome.axes], width
        ),
        "",
    ]  # fmt: skip
    for one in outcome.axes:
        lines += wrapped(verdict(one), width, "  ", "    ")
    asked = "Step of the rate asked for, rate loop alone, no motor at its limit"
    lines += ["", *wrapped(asked, width)]
    for one in outcome.axes:
        if one.axis != "yaw":
            lines += wrapped(f"{one.axis:<6}{step_words(one)}", width, "  ", " " * 8)
    lines += ["", "Proof on this log"]
    for one in outcome.axes:
        for line in proof(one):
            lines += wrapped(line, width, "  ", "    ")
    gains = _gain_table(outcome.axes)
    lines += ["", *gains, *wrapped(LEFT_OUT, width, "  ", "  ")] if gains else []
    lines += ["", "Notes"]
    for note in outcome.notes:
        lines += wrapped(note, width, "  - ", "    ")
    return "\n".join(lines) + "\n"


def _mark_unproven(axis: str) -> str:
    """Mark an axis whose numbers no log proves."""
    return axis if axis != "yaw" else "yaw (unproven)"


GAINS_TITLE: Final = "Upper end of the peak of the sensitivity, with other rate gains"
LEFT_OUT = (
    "(P, I and D together times the factor; of the vehicles that fit this log 97.5 % stay below "
    "this peak. Not in it: resonance of the frame, noise and heat of the motors, motors "
    "at their limits, other throttle.)"
)


def verdict(loop: AxisLoop) -> str:
    """Say in one sentence how far an axis is from oscillating, or why nobody knows."""
    found = loop.with_attitude
    if loop.axis == "yaw":
        return f"yaw: {loop.doubts[0]}"
    if loop.doubts:
        return f"{loop.axis}: not proved, so no margin is called good: {loop.doubts[0]}"
    if found.stable < 1.0:
        return (
            f"{loop.axis}: {100 * (1 - found.stable):.0f} % of the vehicles that fit this log "
            "oscillate with these gains: lower P and D"
        )
    peak = found.sensitivity.high
    word = "calm" if peak <= CALM else "lively" if peak <= LIVELY else "close to oscillating"
    share = loop.derivative_share
    if share > 1.0:
        rests = f"D is {share:.1f} times P and I at the crossover, so its filter and noise decide"
        word = f"close to oscillating ({rests})" if peak > LIVELY else f"not called calm: {rests}"
    return f"{loop.axis}: {word}; {limit_words(found)}"


def limit_words(found: LoopMeasures) -> str:
    """State which changes of a stable loop make it oscillate: delay, higher and lower gain."""
    delay, gain, lower = found.delay, found.gain, found.lower_gain
    limits: list[str] = []
    if math.isfinite(delay.value):
        later = f"the loop were {1e3 * delay.value:.0f} ms later (at least {1e3 * delay.low:.0f})"
        limits.append(later)
    if math.isfinite(gain.value):
        limits.append(f"its gain {gain.value:.1f} times higher (at least {gain.low:.1f})")
    # A lower gain is named where it does so after a smaller change than a higher one.
    if lower.value * (gain.value if math.isfinite(gain.value) else math.inf) > 1.0:
        limits.append(f"its gain fell to {lower.value:.2f} times (at most {lower.high:.2f})")
    if not limits:
        return "neither delay nor gain makes it oscillate within the frequencies of the loop"
    return f"turns into oscillation if {' or '.join(limits)}"


def proof(loop: AxisLoop) -> list[str]:
    """State how replay and closed loop bear the prediction out."""
    gain, late = loop.error.half_widths
    delay = with_half(1e3 * loop.error.delay, 1e3 * late)
    lines = [
        f"{loop.axis}: the controller as its parameters set it gives the logged output: slope "
        f"{loop.replay.slope:.3f}, {100 * loop.replay.left:.1f} % of it left"
    ]
    if loop.axis == "yaw":
        return lines
    if loop.mixer is not None:
        lines.append(
            f"{loop.axis}: the mixer as its parameters set it gives the motors' commands: slope "
            f"{with_half(loop.mixer.slope, loop.mixer.half_width)}, {loop.mixer.name} measured as "
            f"{loop.mixer.factor:.2f}"
        )
    lines.append(
        f"{loop.axis}: measured closed loop over predicted: effectiveness "
        f"{with_half(loop.error.gain, gain)}, delay {delay} ms"
    )
    if loop.proved is not None:
        low, high = loop.proved
        lines.append(f"{loop.axis}: proved from {low:.1f} to {high:.1f} Hz")
    return lines


def step_words(loop: AxisLoop) -> str:
    """Describe how soon and how far over the rate responds."""
    step = loop.step
    if not math.isfinite(step.value[0]):
        return (
            "oscillates as predicted, which is not proved"
            if loop.doubts
            else ("oscillates: lower P and D")
        )
    unproved = "" if loop.proved is not None else "; not proved"
    low, high = (100 * side.max() for side in (step.low, step.high))
    slow, fast = loop.with_attitude.bandwidth, loop.rate_loop.bandwidth
    return (
        f"{_half_words(step)}, at most {100 * step.value.max():.0f} % ({low:.0f}..{high:.0f}); "
        f"bandwidth {_with_ends(fast, 1)} Hz, of the attitude {_with_ends(slow, 1)} Hz{unproved}"
    )


def _half_words(step: StepResponse) -> str:
    """State when half of a step is reached, with the times of the band."""
    reached = [_time_of_half(step.time, side) for side in (step.value, step.high, step.low)]
    if not all(map(math.isfinite, reached)):
        return "under half"
    return f"half after {reached[0]:.0f} ms ({reached[1]:.0f}..{reached[2]:.0f})"


def _time_of_half(time: Row, response: Row) -> float:
    """Find when a response first reaches half of a step [ms]; NaN if it never does."""
    k = int((response >= HALF).argmax())
    if k == 0:
        return math.nan
    return 1e3 * float(np.interp(HALF, response[k - 1 : k + 1], time[k - 1 : k + 1]))


def measure_words(m: LoopMeasures) -> tuple[str, ...]:
    """Write the numbers of a loop in the order of the tables, with the ends of their intervals."""
    return (
        _with_ends(m.crossover, 1),
        _with_ends(m.phase, 0),
        _with_ends(m.gain, 1),
        _with_ends(m.delay, 0, 1e3),
        _with_ends(m.sensitivity, 2),
    )


def _margin_table(title: str, rows: Sequence[tuple[str, LoopMeasures]], width: int) -> list[str]:
    table = [("", *HEADS), *((axis, *measure_words(m)) for axis, m in rows)]
    wide = [max(map(len, column)) for column in zip(*table, strict=True)]
    cells = [
        [f"  {row[0]:<{wide[0]}}", *(f"{c:>{w}}" for c, w in zip(row[1:], wide[1:], strict=True))]
        for row in table
    ]
    return [title, *table_lines(cells, width)]


def _with_ends(measure: Measure, digits: int, factor: float = 1.0) -> str:
    if not math.isfinite(measure.value):
        return "none"
    value, low, high = (
        f"{factor * x:.{digits}f}" for x in (measure.value, measure.low, measure.high)
    )
    return f"{value} ({low}..{high})"


def _gain_table(loops: Sequence[AxisLoop]) -> list[str]:
    """Write the peak of the sensitivity over a factor of the gains."""
    shown = [one for one in loops if one.proved is not None]
    if not shown:
        return []
    return [
        GAINS_TITLE,
        f"  {'gains times':<12}" + "".join(f"{f:>12g}" for f, _ in shown[0].gains),
        *(
            f"  {one.axis:<12}" + "".join(f"{peak_words(peak):>12}" for _, peak in one.gains)
            for one in shown
        ),
    ]


def peak_words(peak: float) -> str:
    """Write a peak of the sensitivity; infinite if vehicles oscillate."""
    return "oscillates" if math.isinf(peak) else f"{peak:.2f}"


HEIGHT: Final = 130.0
"""Height of a panel."""
LOW_SIZE, HIGH_SIZE = 0.03, 30.0
"""Sizes of the open loop, as drawn."""
LOWEST, HIGHEST = 0.1, 60.0
"""Frequencies as drawn [Hz]."""
SHOWN: Final = 0.5
"""Uncertainty of a band of the measured closed loop, from which on it is not drawn."""


def loop_section(outcome: LoopOutcome) -> dict[str, Any]:
    """Collect the page's section: verdicts, and pictures of roll and pitch."""
    shown = [one for one in outcome.axes if one.axis != "yaw"]
    return {
        "outcome": outcome,
        "verdicts": [verdict(one) for one in outcome.axes],
        "pictures": [
            (one.axis, step_words(one), chart_svg(bode_chart(one)), chart_svg(step_chart(one)))
            for one in shown
        ],
    }


def loop_html(outcome: LoopOutcome) -> str:
    """Write the page."""
    shown = [one for one in outcome.axes if one.axis != "yaw"]
    return render_page(
        "loop",
        *("page", "figure", "fly", "dark"),
        **loop_section(outcome),
        heads=HEADS,
        with_attitude=[(one.axis, measure_words(one.with_attitude)) for one in shown],
        alone=[(_mark_unproven(one.axis), measure_words(one.rate_loop)) for one in outcome.axes],
        proofs=[line for one in outcome.axes for line in proof(one)],
        gains_title=GAINS_TITLE,
        gains=[
            (one.axis, [(factor, peak_words(peak)) for factor, peak in one.gains])
            for one in outcome.axes
            if one.proved is not None
        ],
        left_out=LEFT_OUT.strip("()"),
    )


def bode_chart(loop: AxisLoop) -> Chart:
    """Lay out size and phase of the open loop, and of the closed one as predicted and measured."""
    seen = (loop.frequency >= LOWEST) & (loop.frequency <= HIGHEST)
    at = np.log10(loop.frequency[seen])
    shown = np.r_[True, loop.stable[1:]]
    size = np.log10(np.abs(loop.open_loop[shown][:, seen]))
    phase = np.degrees(open_phase(loop.open_loop[shown])[:, seen])
    closed = loop.closed_loop[shown][:, seen]
    closed_size = np.abs(closed)
    closed_phase = np.degrees(np.unwrap(np.angle(closed), axis=1))
    measured = list(_measured_bands(loop, at, closed_size[0], closed_phase[0]))
    of_size = [(low, high, value, off) for low, high, value, _, off, _ in measured]
    of_phase = [(low, high, value, off) for low, high, _, value, _, off in measured]
    top = max(1.5, 1.1 * float(closed_size[0].max(initial=0.0)))
    crossover = _crossover_line(loop)
    panels = (
        _loop_panel("Open loop with attitude loop: size", at, size, 0.0, log=True, lines=crossover,
               span=(math.log10(LOW_SIZE), math.log10(HIGH_SIZE))),
        _loop_panel("its phase [deg]", at, phase, -180.0, span=(-360.0, 0.0), lines=crossover),
        _loop_panel("Rate over the rate asked for: size", at, closed_size, 1.0, of_size,
               span=(0.0, top)),
        _loop_panel("its phase [deg]", at, closed_phase, -180.0, of_phase, span=(-360.0, 45.0)),
    )  # fmt: skip
    ends = float(at[0]), float(at[-1])
    words = f"Open and closed loop of {loop.axis} by frequency: {verdict(loop)}"
    axis = Axis(ends=ends, name="frequency [Hz]", unit="Hz", least=0.1, log=True)
    return Chart(panels=panels, axis=axis, words=words, style="still")


def step_chart(loop: AxisLoop) -> Chart:
    """Lay out the response to a step of the rate reference."""
    step = loop.step
    axis = Axis(
        ends=(0.0, float(step.time[-1])), name="time since the step [s]", unit="s", least=0.1
    )
    words = f"Step of the {loop.axis} rate: {step_words(loop)}"
    title = "Step of the rate asked for: rate over it"
    return Chart(panels=(_step_panel(title, step),), axis=axis, words=words, style="still")


def _step_panel(title: str, step: StepResponse) -> Panel:
    if not math.isfinite(step.value[0]):
        return Panel(title=title, height=HEIGHT, missing="it oscillates")
    rows = np.stack([step.value, step.low, step.high])
    top = max(1.2, 1.05 * float(step.high.max()))
    return _loop_panel(title, step.time, rows, 1.0, span=(min(-0.1, float(step.low.min())), top))


def _loop_panel(
    title: str,
    at: Row,
    rows: Float[np.ndarray, "D f"],
    level: float,
    measured: Sequence[tuple[float, float, float, float]] = (),
    *,
    span: tuple[float, float],
    log: bool = False,
    lines: tuple[Line, ...] = (),
) -> Panel:
    """Draw the nominal curve with its band, a level, and what was measured: from, to, value, +-."""
    low, high = np.quantile(rows, SIDES, axis=0)
    areas = [Area(style="rotor", at=at, low=low, high=high)]
    curves = [
        _make_curve("level", "level", at[[0, -1]], np.full(2, level)),
        _make_curve("predicted", "rotor", at, np.clip(rows[0], *span)),
    ]
    for i, (start, end, value, off) in enumerate(measured):
        ends, flat = np.array([start, end]), np.full(2, value)
        areas.append(Area(style="body", at=ends, low=flat - off, high=flat + off))
        curves.append(_make_curve(f"measured {i}", "body", ends, np.clip(flat, *span)))
    return Panel(
        title=title, height=HEIGHT, curves=tuple(curves), areas=tuple(areas), span=span, log=log,
        lines=lines,
    )  # fmt: skip


def _make_curve(key: str, style: str, at: Row, values: Row) -> Curve:
    series = Series(time=at, values={key: values}, gap=np.inf)
    return Curve(key=key, name=key, style=style, series=series)


def _measured_bands(
    loop: AxisLoop, at: Row, size: Row, phase: Row
) -> Iterator[tuple[float, float, float, float, float, float]]:
    """Yield the ends of each band (logarithms), size and phase, and half of their intervals."""
    for band in loop.bands:
        if loop.axis == "yaw" or band.uncertainty > SHOWN or band.high > HIGHEST:
            continue
        low, high = math.log10(band.low), math.log10(band.high)
        middle = 0.5 * (low + high)
        model = float(np.interp(middle, at, size))
        turn = float(np.interp(middle, at, phase)) + band.degrees
        off = math.degrees(math.asin(min(1.0, band.uncertainty / max(band.ratio, 1e-9))))
        yield low, high, model * band.ratio, turn, model * band.uncertainty, off


def _crossover_line(loop: AxisLoop) -> tuple[Line, ...]:
    at = loop.with_attitude.crossover.value
    if not math.isfinite(at):
        return ()
    return (Line(at=math.log10(at), style="crossover", label=f"crossover {at:.1f} Hz"),)
