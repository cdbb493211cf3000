"""What `rotorfit fly` found, on one screen and as a page: replay, growing errors, manoeuvres."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.digits import short
from rotorfit.logs.files import file_name
from rotorfit.report.pages import (
    drawing,
    label,
    labelled_ticks,
    render_page,
    standalone,
    tag,
    template_text,
)
from rotorfit.results.validation.fly_outcome import (
    MANOEUVRES,
    STEADY,
    STEP,
    STEPS,
    FlyOutcome,
    Manoeuvre,
    ModelFlight,
    band,
    departure,
    is_lost,
    liveliest,
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
    IDENTIFIED,
    NORMAL_95,
    Replay,
    band_growth,
    error_growth,
    force_errors,
    growth_time,
)
from rotorfit.sheet import listed, table_lines, wrapped

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

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


PAGE_WIDTH: Final = 920.0
LEFT, RIGHT, TITLE, BELOW = 52.0, 10.0, 24.0, 34.0
SHOWN_SECONDS: Final = 8.0
"""Of a flight in the drawing over time: its liveliest stretch of this length."""
KINDS: Final = ("own", "other-0", "other-1", "other-2")
TITLES: Final[Mapping[Manoeuvre, str]] = {
    "hover": "Height in hover [m]",
    "roll": "Roll angle [rad]",
    "pitch": "Pitch angle [rad]",
    "yaw rate": "Yaw rate [rad/s]",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """A curve of one or several pieces: NaN in its values breaks it."""

    kind: str
    x: Points
    y: Points


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One pair of axes."""

    title: str
    x_name: str
    curves: tuple[Curve, ...]
    band: Band = ()


def fly_html(outcome: FlyOutcome) -> str:
    """Write the page."""
    return render_page(
        "fly",
        *("page", "figure", "fly", "dark"),
        outcome=outcome,
        headline=headline(outcome),
        judgement=outcome.judgement.sentence,
        meaning=meaning(outcome),
        times=reported_times(outcome),
        axes=AXES,
        rates=rate_rows(outcome),
        forces=force_rows(outcome),
        verdicts=verdicts(outcome),
        legend=[(name, kind_of(outcome.labels, name)) for name in outcome.labels],
        names=[file_name(replay.flight) for replay in outcome.replays],
        manoeuvres=[(name, manoeuvre_summary(outcome, name)) for name in outcome.manoeuvres],
        drawings=fly_drawings(outcome),
    )


def fly_figures(outcome: FlyOutcome) -> dict[str, str]:
    """Draw everything as SVG documents, by name."""
    style = template_text("figure.css") + template_text("fly.css")
    return {name: standalone(svg, style) for name, svg in fly_drawings(outcome).items()}


def fly_drawings(outcome: FlyOutcome) -> dict[str, str]:
    """Draw everything as inline SVG, by name."""
    out = {
        f"replay-{i}": replay_svg(replay, outcome.labels)
        for i, replay in enumerate(outcome.replays, 1)
    }
    out["replay-errors"] = growth_svg(outcome)
    return out | {"manoeuvres": manoeuvre_svg(outcome)} if outcome.manoeuvres else out


def kind_of(labels: Sequence[str], name: str) -> str:
    """Select the style of a label's curves."""
    return KINDS[min(labels.index(name), len(KINDS) - 1)]


def replay_svg(replay: Replay, labels: Sequence[str]) -> str:
    """Draw the rates of the liveliest stretch of a flight, flown and predicted in windows."""
    chosen = liveliest(replay, SHOWN_SECONDS)
    panels = [
        Panel(
            title=f"{axis.capitalize()} rate [rad/s]",
            x_name="time since the log's first sample [s]",
            curves=_rate_curves(replay, labels, chosen, i),
            band=_rate_band(replay, chosen, i),
        )
        for i, axis in enumerate(AXES)
    ]
    return _draw_figure(panels, 1, 120.0, f"Rates flown and predicted, {file_name(replay.flight)}")


def growth_svg(outcome: FlyOutcome) -> str:
    """Draw how the error of the rates grows after the start of a window."""
    t = growth_time(outcome.replays)
    errors = {name: error_growth(outcome.replays, name) for name in (*outcome.labels, HOLD)}
    band = band_growth(outcome.replays, IDENTIFIED)
    panels = [
        Panel(
            title=f"{axis.capitalize()}: rms error [rad/s]",
            x_name="time since a window's start [s]",
            curves=(
                Curve(kind="hold", x=t, y=errors[HOLD][:, i]),
                *(
                    Curve(kind=kind_of(outcome.labels, name), x=t, y=errors[name][:, i])
                    for name in reversed(outcome.labels)
                ),
            ),
            band=((t, np.zeros_like(t), band[:, i]),) if outcome.draws else (),
        )
        for i, axis in enumerate(AXES)
    ]
    return _draw_figure(panels, 3, 170.0, "Growth of the error of the rates in a window")


def manoeuvre_svg(outcome: FlyOutcome) -> str:
    """Draw hover and steps of the model, asked and flown."""
    panels: list[Panel] = []
    for i, name in enumerate(MANOEUVRES):
        flights = {label: flown[i] for label, flown in outcome.manoeuvres.items()}
        first = flights[outcome.labels[0]]
        curves = [Curve(kind="asked", x=first.time, y=first.asked)]
        curves += [
            Curve(kind=kind_of(outcome.labels, key), x=f.time, y=f.flown)
            for key, f in reversed(flights.items())
        ]
        panels.append(Panel(title=TITLES[name], x_name="time [s]", curves=tuple(curves)))
    return _draw_figure(panels, 2, 150.0, "Hover and steps of the model in MuJoCo")


def _rate_curves(
    replay: Replay, labels: Sequence[str], windows: Sequence[int], axis: int
) -> tuple[Curve, ...]:
    x = _join_with_gaps(replay.time[windows])
    predicted = {p.label: p for p in replay.predicted}
    curves = [
        Curve(
            kind=kind_of(labels, name),
            x=x,
            y=_join_with_gaps(predicted[name].rates[windows, :, axis]),
        )
        for name in reversed(labels)
    ]
    return (Curve(kind="flown", x=x, y=_join_with_gaps(replay.rates[windows, :, axis])), *curves)


def _rate_band(replay: Replay, windows: Sequence[int], axis: int) -> Band:
    own = replay.predicted[0]
    half = NORMAL_95 * own.rates_std[windows, :, axis]
    if not half.any():
        return ()
    middle = own.rates[windows, :, axis]
    return tuple(zip(replay.time[windows], middle - half, middle + half, strict=True))


def _join_with_gaps(values: Float[np.ndarray, "k n"]) -> Float[np.ndarray, " m"]:
    """Join rows one after the other, with a NaN between them."""
    gap = np.full((len(values), 1), np.nan)
    return np.concatenate([values, gap], axis=1).ravel()


def _draw_figure(panels: Sequence[Panel], columns: int, height: float, words: str) -> str:
    width = PAGE_WIDTH / columns
    block = TITLE + height + BELOW
    parts = [
        _draw_panel(panel, (i % columns * width, i // columns * block), (width, height))
        for i, panel in enumerate(panels)
    ]
    total = -(-len(panels) // columns) * block
    return drawing(PAGE_WIDTH, total, {"class": "fly", "role": "img", "aria-label": words}, *parts)


def _draw_panel(panel: Panel, corner: tuple[float, float], size: tuple[float, float]) -> str:
    left, top = corner[0] + LEFT, corner[1] + TITLE
    width, height = size[0] - LEFT - RIGHT, size[1]
    spans = _choose_spans(panel)
    frame = {"x": left, "y": top, "width": width, "height": height}
    place = _Place(left=left, top=top, width=width, height=height, spans=spans)
    middle = {"class": "axis-name middle", "x": left + width / 2, "y": top + height + 29}
    return tag(
        "g",
        {"class": "panel"},
        label(panel.title, {"class": "panel-title", "x": left, "y": corner[1] + 16}),
        *_draw_ticks(place),
        *(tag("path", {"class": "band", "d": _area_path(piece, place)}) for piece in panel.band),
        *(
            tag("path", {"class": f"curve {curve.kind}", "d": _curve_path(curve, place)})
            for curve in panel.curves
        ),
        tag("rect", {"class": "frame", **frame}),
        label(panel.x_name, middle),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Place:
    left: float
    top: float
    width: float
    height: float
    spans: tuple[tuple[float, float], tuple[float, float]]

    def x(self, values: Points) -> Points:
        low, high = self.spans[0]
        return self.left + (values - low) / (high - low) * self.width

    def y(self, values: Points) -> Points:
        low, high = self.spans[1]
        inside = np.clip(values, low, high)
        return self.top + (high - inside) / (high - low) * self.height


def _choose_spans(panel: Panel) -> tuple[tuple[float, float], tuple[float, float]]:
    """Choose the ends of both axes; a curve far out does not flatten all others."""
    x = np.concatenate([curve.x for curve in panel.curves])
    sizes = [curve.y[np.isfinite(curve.y)] for curve in panel.curves]
    reach = [float(np.ptp(y)) for y in sizes if len(y)]
    kept = [y for y in sizes if len(y) and float(np.ptp(y)) <= 4.0 * float(np.median(reach)) + 1e-9]
    y = np.concatenate(kept or [np.zeros(1)])
    room = 0.06 * float(np.ptp(y)) or 0.5
    x = x[np.isfinite(x)]
    ends = float(x.min()), float(x.max())
    return (ends if ends[1] > ends[0] else (ends[0], ends[0] + 1.0)), (
        float(y.min()) - room,
        float(y.max()) + room,
    )


def _draw_ticks(place: _Place) -> list[str]:
    parts: list[str] = []
    right, bottom = place.left + place.width, place.top + place.height
    for value, words in labelled_ticks(*place.spans[1], 5):
        y = float(place.y(np.array(value)))
        parts.append(tag("path", {"class": "grid", "d": f"M{place.left:.1f} {y:.1f}H{right:.1f}"}))
        parts.append(label(words, {"class": "tick right", "x": place.left - 6, "y": y + 4}))
    for value, words in labelled_ticks(*place.spans[0], max(round(place.width / 100), 3)):
        x = float(place.x(np.array(value)))
        parts.append(label(words, {"class": "tick middle", "x": x, "y": bottom + 14}))
    return parts


def _curve_path(curve: Curve, place: _Place) -> str:
    """Draw a curve as path data, broken at NaN, thinned to what can be seen."""
    every = max(len(curve.x) // 4000, 1)
    good = np.isfinite(curve.y)
    keep = (np.arange(len(curve.x)) % every == 0) | ~good
    parts: list[str] = []
    pen = "M"
    for x, y in zip(place.x(curve.x[keep]).tolist(), place.y(curve.y[keep]).tolist(), strict=True):
        if not (np.isfinite(x) and np.isfinite(y)):
            pen = "M"
            continue
        parts.append(f"{pen}{x:.1f} {y:.1f}")
        pen = "L"
    return "".join(parts)


def _area_path(piece: tuple[Points, Points, Points], place: _Place) -> str:
    t, low, high = piece
    every = slice(None, None, max(len(t) // 60, 1))
    x = place.x(t[every]).tolist()
    up, down = place.y(high[every]).tolist(), place.y(low[every]).tolist()
    there = "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, up, strict=True))
    back = "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(reversed(x), reversed(down), strict=True))
    return f"M{there}L{back}Z"
