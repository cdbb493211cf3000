"""A flight by a result as a page: rates, growth of the error, and standard manoeuvres."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.logs.files import file_name
from rotorfit.report.chart import Area, Axis, Chart, Curve, Panel, chart_svg
from rotorfit.report.fly import (
    force_rows,
    headline,
    manoeuvre_summary,
    meaning,
    rate_rows,
    verdicts,
)
from rotorfit.report.pages import render_page, standalone, template_text
from rotorfit.results.validation.fly_outcome import (
    MANOEUVRES,
    STEPS,
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
from rotorfit.series import Series

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

    Pieces = Float[np.ndarray, "k n"]
    """A curve in pieces: one row each."""

SHOWN_SECONDS: Final = 8.0
"""Of a flight in the drawing over time: its liveliest stretch of this length."""
HEIGHT: Final = 130.0
"""Height of a panel."""
FAR: Final = 4.0
"""Range of a curve over the usual one, beyond which it does not flatten all others."""
BAND_POINTS: Final = 60
"""Points of a band in a window: more are not seen."""
KINDS: Final = ("own", "other-0", "other-1", "other-2")
TITLES: Final[Mapping[Manoeuvre, str]] = {
    "hover": "Height in hover [m]",
    "roll": "Roll angle [rad]",
    "pitch": "Pitch angle [rad]",
    "yaw rate": "Yaw rate [rad/s]",
}


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
    if outcome.manoeuvres:
        out["hover"] = manoeuvre_svg(outcome, ("hover",), "Hover of the model in MuJoCo")
        out["manoeuvres"] = manoeuvre_svg(outcome, STEPS, "Steps of the model in MuJoCo")
    return out


def kind_of(labels: Sequence[str], name: str) -> str:
    """Select the style of a label's curves."""
    return KINDS[min(labels.index(name), len(KINDS) - 1)]


def replay_svg(replay: Replay, labels: Sequence[str]) -> str:
    """Draw the rates of the liveliest stretch of a flight, flown and predicted in windows."""
    chosen = liveliest(replay, SHOWN_SECONDS)
    time = replay.time[chosen]
    predicted = {p.label: p.rates[chosen] for p in replay.predicted}
    std = replay.predicted[0].rates_std[chosen]
    panels: list[Panel] = []
    for i, axis in enumerate(AXES):
        rates = [(kind_of(labels, name), predicted[name][:, :, i]) for name in reversed(labels)]
        half = NORMAL_95 * std[:, :, i]
        band = (predicted[replay.predicted[0].label][:, :, i], half) if half.any() else None
        curves = [("flown", replay.rates[chosen, :, i]), *rates]
        panels.append(_draw_panel(f"{axis.capitalize()} rate [rad/s]", time, curves, band))
    words = f"Rates flown and predicted, {file_name(replay.flight)}"
    return _draw_chart(panels, "time since the log's first sample [s]", time, words)


def growth_svg(outcome: FlyOutcome) -> str:
    """Draw how the error of the rates grows after the start of a window."""
    time = growth_time(outcome.replays)[None]
    names = [("hold", HOLD), *((kind_of(outcome.labels, n), n) for n in reversed(outcome.labels))]
    errors = [(kind, error_growth(outcome.replays, name)) for kind, name in names]
    half = 0.5 * band_growth(outcome.replays, IDENTIFIED)
    panels = [
        _draw_panel(
            f"{axis.capitalize()}: rms error [rad/s]",
            time,
            [(kind, error[None, :, i]) for kind, error in errors],
            (half[None, :, i], half[None, :, i]) if outcome.draws else None,
        )
        for i, axis in enumerate(AXES)
    ]
    words = "Growth of the error of the rates in a window"
    return _draw_chart(panels, "time since a window's start [s]", time, words)


def manoeuvre_svg(outcome: FlyOutcome, names: Sequence[Manoeuvre], words: str) -> str:
    """Draw manoeuvres of the model that take the same time, asked and flown."""
    panels: list[Panel] = []
    time = np.zeros((1, 0))
    for name in names:
        i = MANOEUVRES.index(name)
        flights = {label: flown[i] for label, flown in outcome.manoeuvres.items()}
        first = flights[outcome.labels[0]]
        time = first.time[None]
        curves = [("asked", first.asked[None])]
        curves += [
            (kind_of(outcome.labels, n), f.flown[None]) for n, f in reversed(flights.items())
        ]
        panels.append(_draw_panel(TITLES[name], time, curves))
    return _draw_chart(panels, "time [s]", time, words)


def _draw_panel(
    title: str,
    time: Pieces,
    curves: Sequence[tuple[str, Pieces]],
    band: tuple[Pieces, Pieces] | None = None,
) -> Panel:
    """Lay out curves by their style, each in pieces, and a band: its middle and its half."""
    drawn = [
        Curve(key=kind, name=kind, style=kind, series=_make_series(kind, t, v))
        for kind, values in curves
        for t, v in zip(time, values, strict=True)
    ]
    areas: list[Area] = []
    thin = slice(None, None, max(time.shape[1] // BAND_POINTS, 1))
    for at, middle, half in zip(time, *band, strict=True) if band is not None else ():
        low, high = (middle - half)[thin], (middle + half)[thin]
        areas.append(Area(style="own", at=at[thin], low=low, high=high))
    span = _choose_span([values for _, values in curves])
    return Panel(title=title, height=HEIGHT, curves=tuple(drawn), areas=tuple(areas), span=span)


def _make_series(
    key: str, time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"]
) -> Series:
    """Make a series of the finite values: a model that is lost has none any more."""
    good = np.isfinite(values)
    return Series(time=time[good], values={key: values[good]}, gap=np.inf)


def _choose_span(curves: Sequence[Pieces]) -> tuple[float, float]:
    """Choose the ends of an axis; a curve far out does not flatten all others."""
    finite = [y[np.isfinite(y)] for y in curves]
    sizes = [float(np.ptp(y)) for y in finite if len(y)]
    most = FAR * float(np.median(sizes)) + 1e-9 if sizes else 0.0
    y = np.concatenate([y for y in finite if len(y) and float(np.ptp(y)) <= most] or [np.zeros(1)])
    room = 0.06 * float(np.ptp(y)) or 0.5
    return float(y.min()) - room, float(y.max()) + room


def _draw_chart(
    panels: Sequence[Panel], name: str, time: Float[np.ndarray, "*n"], words: str
) -> str:
    ends = float(time.min()), float(time.max())
    axis = Axis(ends=ends, name=name, unit="s", least=ends[1] - ends[0])
    return chart_svg(Chart(panels=tuple(panels), axis=axis, words=words, style="still"))
