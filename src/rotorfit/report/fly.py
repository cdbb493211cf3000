"""What `rotorfit fly` found, on one screen: replay, growing errors, manoeuvres."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rotorfit.digits import short
from rotorfit.logs.files import file_name
from rotorfit.results.validation.fly_outcome import (
    STEADY,
    STEP,
    STEPS,
    FlyOutcome,
    Manoeuvre,
    ModelFlight,
    band,
    departure,
    is_lost,
    manoeuvre_of,
    overshoot,
    rate_errors,
    ratio_to,
    reported_times,
    settling_time,
    steady_share,
)
from rotorfit.results.validation.judgement import AXES, GOOD_SHARE, error_sentences, horizon
from rotorfit.results.validation.replay import (
    HOLD,
    force_errors,
)
from rotorfit.sheet import listed, table_lines, wrapped

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from jaxtyping import Float

    Points = Float[np.ndarray, " n"]
    Band = tuple[tuple[Points, Points, Points], ...]
    """An area between two curves, in pieces of time, low and high."""

WIDTH = 80
BAND = "95 % interval"
EVEN = 0.05
"""Errors that differ by less count as equal."""
FORCE_HELD = "constant force"


def fly_text(outcome: FlyOutcome, *, width: int = WIDTH) -> str:
    """Write replay, manoeuvres and notes as plain text, lines of that width."""
    column = max(len(label) for label in (*outcome.labels, BAND, FORCE_HELD))
    lines = [
        *wrapped(headline(outcome), width),
        *wrapped(outcome.judgement.sentence, width),
        "",
        *wrapped(RATES_TITLE, width),
        *table_lines(_rate_cells(outcome, column), width),
        "",
    ]
    for line in verdicts(outcome):
        lines += wrapped(line, width, "  ", "    ")
    lines += ["", "What it means"]
    for line in meaning(outcome):
        lines += wrapped(line, width, "  - ")
    lines += [
        "",
        *wrapped("Replay: rms error of the specific force, means over 0.05 s [m/s^2]", width),
    ]
    lines.append(f"  {'':<{column}}" + "".join(f"{axis:>10}" for axis in "xyz"))
    lines += [f"  {label:<{column}}" + _number_cells(row) for label, row in force_rows(outcome)]
    lines += _manoeuvre_lines(outcome)
    if outcome.notes:
        lines += ["", "To know"]
        for note in outcome.notes:
            lines += wrapped(note, width, "  - ")
    return "\n".join(lines)


RATES_TITLE: Final = "Replay: rms error of the rates [rad/s], this long after the start of a window"


def _rate_cells(outcome: FlyOutcome, column: int) -> list[list[str]]:
    """Tabulate the errors of the rates: a cell for each time, which holds the three axes."""
    times = reported_times(outcome)
    axes = "".join(f"{axis:>10}" for axis in AXES)
    rows = [("", [f"{f'after {t:.3g} s':>30}" for t in times]), ("", [axes] * len(times))]
    for name, values in rate_rows(outcome):
        groups = [values[i : i + len(AXES)] for i in range(0, len(values), len(AXES))]
        rows.append((name, [_number_cells(group) for group in groups]))
    # A space before each cell comes with the columns.
    return [[f"  {name:<{column}}", *(cell[1:] for cell in cells)] for name, cells in rows]


def _manoeuvre_lines(outcome: FlyOutcome) -> list[str]:
    """Tabulate a line a manoeuvre, a column a set of parameters."""
    if not outcome.manoeuvres:
        return []
    rows = [("", list(outcome.labels))]
    rows.append(("hover", [hover_summary(outcome, label) for label in outcome.labels]))
    rows += [
        (step_name(n), [step_summary(manoeuvre_of(outcome, label, n)) for label in outcome.labels])
        for n in STEPS
    ]
    width = max(len(name) for name, _ in rows)
    return [
        "",
        "In MuJoCo: the identified model, its autopilot tuned to these parameters",
        *(f"  {n:<{width}}" + "".join(f"  {c:<20}" for c in cells).rstrip() for n, cells in rows),
    ]


def headline(outcome: FlyOutcome) -> str:
    """Summarise what was flown, in one sentence."""
    flights = ", ".join(file_name(replay.flight) for replay in outcome.replays)
    return (
        f"{outcome.name}, configuration {outcome.configuration}: {outcome.windows} windows of "
        f"{outcome.seconds:g} s of {flights}"
    )


def rate_rows(outcome: FlyOutcome) -> list[tuple[str, list[float]]]:
    """Tabulate the errors of the rates: each label, then constant rates, then the band."""
    times = reported_times(outcome)
    rows = [
        (label, [x for t in times for x in rate_errors(outcome, label, t).tolist()])
        for label in (*outcome.labels, HOLD)
    ]
    if outcome.draws:
        rows.append((BAND, [x for t in times for x in band(outcome, t).tolist()]))
    return rows


def force_rows(outcome: FlyOutcome) -> list[tuple[str, list[float]]]:
    """Tabulate the errors of the specific force: each label, then that of a constant force."""
    rows = [(label, force_errors(outcome.replays, label).tolist()) for label in outcome.labels]
    return [*rows, (FORCE_HELD, force_errors(outcome.replays, HOLD).tolist())]


def verdicts(outcome: FlyOutcome) -> list[str]:
    """Compare the identified parameters with the others at the end of a window."""
    end = reported_times(outcome)[-1]
    return [
        f"against {label}, after {end:.3g} s: "
        + ", ".join(
            _standing_words(axis, ratio)
            for axis, ratio in zip(AXES, ratio_to(outcome, label, end).tolist(), strict=True)
        )
        for label in (*outcome.labels[1:], HOLD)
    ]


def meaning(outcome: FlyOutcome) -> list[str]:
    """Explain what the errors mean for who uses the model."""
    end = reported_times(outcome)[-1]
    seconds, steady = horizon(outcome.replays, GOOD_SHARE).tolist(), steady_share(outcome).tolist()
    held = ratio_to(outcome, HOLD, end).tolist()
    good = [f"{axis} {t:.2g} s" for axis, t in zip(AXES, seconds, strict=True)]
    words = [
        f"open loop (planning, MPC) the rates stay within {100 * GOOD_SHARE:.0f} % of what was "
        f"flown for: {', '.join(good)}" + (f" (the window ends at {end:.2g} s)")
    ]
    worse = [axis for axis, ratio in zip(AXES, held, strict=True) if ratio >= 1.0 + EVEN]
    if worse:
        words.append(
            f"{listed(worse)}: after {end:.2g} s without feedback the model is worse than "
            "constant rates: correct it by the gyro within the time above, as an autopilot does"
        )
    words += error_sentences(outcome.replays)
    trim = [axis for axis, share in zip(AXES, steady, strict=True) if share > STEADY]
    if trim:
        words.append(
            f"{listed(trim)}: most of the error is steady, which is trim (centre of mass, "
            "wind, unequal rotors); a controller with integral action removes it, a prediction "
            "does not"
        )
    turns = [one for one in outcome.judgement.axes if one.axis in AXES]
    if all(one.level in ("good", "with-feedback") for one in turns):
        words.append(
            "closed loop, for tuning and simulation, errors of this size do not add up: the "
            "controller corrects them from sample to sample"
        )
    return words


def _standing_words(axis: str, ratio: float) -> str:
    if not math.isfinite(ratio):
        return f"{axis} -"
    word = "even" if abs(ratio - 1.0) < EVEN else "better" if ratio < 1.0 else "WORSE"
    return f"{axis} {word} (error x {short(ratio)})"


def manoeuvre_summary(outcome: FlyOutcome, label: str) -> str:
    """Summarise how hover and steps went, in one line."""
    parts = [f"hover {hover_summary(outcome, label)}"]
    parts += [f"{step_name(n)} {step_summary(manoeuvre_of(outcome, label, n))}" for n in STEPS]
    return "; ".join(parts)


def hover_summary(outcome: FlyOutcome, label: str) -> str:
    """Summarise how well the height was held."""
    hover = manoeuvre_of(outcome, label, "hover")
    return "lost" if is_lost(hover) else f"to {short(departure(hover))} m"


def step_name(name: Manoeuvre) -> str:
    """Name a step with its size."""
    return f"{name} {STEP[name]:g} {'rad/s' if name == 'yaw rate' else 'rad'}"


def step_summary(flight: ModelFlight) -> str:
    """Summarise a step: when it stays within a tenth, and how far it went beyond."""
    if is_lost(flight):
        return "lost"
    settled = settling_time(flight)
    ended = "not settled" if settled is None else f"in {settled:.2f} s"
    return f"{ended}, {100 * overshoot(flight):.0f} % over"


def _number_cells(values: Sequence[float]) -> str:
    return "".join(f"{short(value):>10}" for value in values)
