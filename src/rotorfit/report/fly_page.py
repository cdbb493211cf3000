"""A flight by a result as a page: rates, growth of the error, and standard manoeuvres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.logs.files import file_name
from rotorfit.report.fly import (
    force_rows,
    headline,
    manoeuvre_summary,
    meaning,
    rate_rows,
    verdicts,
)
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
    FlyOutcome,
    Manoeuvre,
    liveliest,
    reported_times,
)
from rotorfit.results.validation.judgement import AXES
from rotorfit.results.validation.replay import (
    HOLD,
    IDENTIFIED,
    NORMAL_95,
    Replay,
    band_growth,
    error_growth,
    growth_time,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

    Points = Float[np.ndarray, " n"]
    Band = tuple[tuple[Points, Points, Points], ...]
    """An area between two curves, in pieces of time, low and high."""

PAGE_WIDTH: Final = 920.0
SHOWN_SECONDS: Final = 8.0
"""Of a flight in the drawing over time: its liveliest stretch of this length."""
LEFT, RIGHT, TITLE, BELOW = 52.0, 10.0, 24.0, 34.0
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
