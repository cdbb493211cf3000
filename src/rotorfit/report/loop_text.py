"""What `rotorfit loop` found, on one screen."""

import math
import textwrap
from collections.abc import Sequence

from rotorfit.control_loop.loop import AxisLoop, LoopMeasures, LoopOutcome, Measure

WIDTH = 80
HALF = 0.5
"""Of a step."""
CALM, LIVELY = 2.0, 3.0
"""Peaks of the sensitivity up to which a loop is calm, and beyond which it nearly oscillates."""


def loop_text(outcome: LoopOutcome, *, width: int = WIDTH) -> str:
    """Write margins, proof and notes as plain text, lines of that width."""
    lines = [
        f"{outcome.name}: rate loops of {outcome.autopilot} ({outcome.firmware}), configuration "
        f"{outcome.configuration}",
        "",
        *_margin_table("Rate loop with attitude loop, cut at the torque command",
                       [(a.axis, a.with_attitude) for a in outcome.axes if a.axis != "yaw"]),
        "",
        *_margin_table("Rate loop alone", [(a.axis, a.rate_loop) for a in outcome.axes]),
        "",
    ]  # fmt: skip
    for one in outcome.axes:
        lines += _wrapped(verdict(one), width, "  ", "    ")
    lines += ["", "Step of the rate asked for, rate loop alone, no motor at its limit"]
    lines += [_step_line(one) for one in outcome.axes if one.axis != "yaw"]
    lines += ["", "Proof on this log"]
    for one in outcome.axes:
        for line in proof(one):
            lines += _wrapped(line, width, "  ", "    ")
    lines += ["", *_gain_table(outcome.axes)]
    lines += _wrapped(LEFT_OUT, width, "  ", "  ")
    lines += ["", "Notes"]
    for note in outcome.notes:
        lines += _wrapped(note, width, "  - ", "    ")
    return "\n".join(lines) + "\n"


LEFT_OUT = (
    "(P, I and D together times the factor; the peak that 97.5 % of the vehicles stay below that "
    "this log leaves open. Not in it: resonance of the frame, noise and heat of the motors, motors "
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
            f"{loop.axis}: {100 * (1 - found.stable):.0f} % of the vehicles that this log leaves "
            "open oscillate with these gains: lower P and D"
        )
    peak = found.sensitivity.high
    word = "calm" if peak <= CALM else "lively" if peak <= LIVELY else "close to oscillating"
    return (
        f"{loop.axis}: {word}; turns into oscillation if the loop were "
        f"{1e3 * found.delay.value:.0f} ms later (at least {1e3 * found.delay.low:.0f}) or its "
        f"gain {found.gain.value:.1f} times higher (at least {found.gain.low:.1f})"
    )


def proof(loop: AxisLoop) -> list[str]:
    """Say how replay and closed loop bear the prediction out."""
    gain, late = loop.error.half_widths
    lines = [
        f"{loop.axis}: the controller as its parameters set it gives the logged output: slope "
        f"{loop.replay.slope:.3f}, {100 * loop.replay.left:.1f} % of it left"
    ]
    if loop.axis == "yaw":
        return lines
    lines.append(
        f"{loop.axis}: measured closed loop over predicted: effectiveness {loop.error.gain:.2f} "
        f"+- {gain:.2f}, delay {1e3 * loop.error.delay:+.1f} +- {1e3 * late:.1f} ms"
    )
    if loop.proved is not None:
        low, high = loop.proved
        lines.append(f"{loop.axis}: proved from {low:.1f} to {high:.1f} Hz")
    return lines


def _step_line(loop: AxisLoop) -> str:
    """Write how soon and how far over the rate answers."""
    step = loop.step
    if not math.isfinite(step.value[0]):
        return f"  {loop.axis:<6}oscillates: lower P and D"
    unproved = "" if loop.proved is not None else "; not proved"
    low, high = (100 * side.max() for side in (step.low, step.high))
    half = step.value >= HALF
    soon = f"half after {1e3 * step.time[half.argmax()]:.0f} ms" if half.any() else "under half"
    return (
        f"  {loop.axis:<6}{soon}, at most {100 * step.value.max():.0f} % "
        f"({low:.0f}..{high:.0f}){unproved}"
    )


def _margin_table(title: str, rows: Sequence[tuple[str, LoopMeasures]]) -> list[str]:
    head = (
        f"  {'':<6}{'crossover [Hz]':>16}{'phase [deg]':>13}{'gain':>17}{'delay [ms]':>19}"
        f"{'peak':>18}"
    )
    return [
        title,
        head,
        *(
            f"  {axis:<6}{_measure(m.crossover, 1):>16}{_measure(m.phase, 0):>13}"
            f"{_measure(m.gain, 1):>17}{_measure(m.delay, 0, 1e3):>19}"
            f"{_measure(m.sensitivity, 2):>18}"
            for axis, m in rows
        ),
    ]


def _measure(measure: Measure, digits: int, factor: float = 1.0) -> str:
    """Write a number with the ends of its interval."""
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
    factors = [factor for factor, _ in shown[0].gains]
    return [
        "Peak of the sensitivity with other rate gains",
        f"  {'gains times':<12}" + "".join(f"{factor:>12g}" for factor in factors),
        *(
            f"  {one.axis:<12}"
            + "".join(
                f"{'oscillates':>12}" if math.isinf(peak) else f"{peak:>12.2f}"
                for _, peak in one.gains
            )
            for one in shown
        ),
    ]


def _wrapped(text: str, width: int, first: str, other: str) -> list[str]:
    return textwrap.wrap(text, width, initial_indent=first, subsequent_indent=other)
