"""Section 3: body wrench against rotor wrench over time (Six et al. 2020, Fig. 3 and 4)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rotorfit.display.series import Series, thinned
from rotorfit.logs.files import file_name
from rotorfit.report.series import encoded, encoded_time, is_predicted, path_of, series_of
from rotorfit.report.svg import drawing, label, tag, tick_label, ticks
from rotorfit.results.result import IdentificationResult
from rotorfit.validation.wrench_comparison import SHOWN, WrenchComparison

WIDTH, LEFT, RIGHT = 920.0, 58.0, 10.0
TITLE, MAIN, GAP, ERROR, BELOW = 24.0, 104.0, 6.0, 42.0, 12.0
BLOCK = TITLE + MAIN + GAP + ERROR + BELOW
AXIS = 36.0
LINE = TITLE + 30.0
COMPONENT = {
    "Fz": ("Thrust Fz", "N"),
    "Mx": ("Roll moment Mx", "N m"),
    "My": ("Pitch moment My", "N m"),
    "Mz": ("Yaw moment Mz", "N m"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class WrenchFigure:
    """One flight: its drawing, and its data for zooming."""

    title: str
    configuration: str
    used_in_fit: bool
    sha256: str
    svg: str
    data: dict[str, object]
    errors: tuple[tuple[str, str, str], ...]
    seconds: float


def wrench_figures(comparisons: Sequence[WrenchComparison]) -> tuple[WrenchFigure, ...]:
    """Return the figures of all compared flights."""
    return tuple(_figure(comparison) for comparison in comparisons)


def _figure(comparison: WrenchComparison) -> WrenchFigure:
    series = thinned(series_of(comparison))
    return WrenchFigure(
        title=file_name(comparison.flight),
        configuration=comparison.configuration,
        used_in_fit=comparison.used_in_fit,
        sha256=comparison.sha256,
        svg=wrench_svg(comparison, series),
        data=_data(series),
        errors=tuple(
            (COMPONENT[n][0], error_words(comparison, n), whiteness_words(comparison, n))
            for n in SHOWN
        ),
        seconds=float(series.time[-1] - series.time[0]) if len(series.time) else 0.0,
    )


def error_words(comparison: WrenchComparison, component: str) -> str:
    """Return the relative error norm of a component in percent, a dash where there is none."""
    return _percent(comparison.relative_error.get(component))


def whiteness_words(comparison: WrenchComparison, component: str) -> str:
    """Return what is left of the motion in the difference, a dash where that is not known."""
    value = comparison.whiteness.get(component)
    return f"{value:.2f}" if value is not None and math.isfinite(value) else "–"


def validation_rows(
    result: IdentificationResult,
) -> tuple[tuple[str, str, tuple[str, ...]], ...]:
    """Return the error norms that the result itself holds, for pages without figures."""
    return tuple(
        (
            file_name(str(row.get("flight", ""))),
            str(row.get("configuration", "")),
            tuple(_percent(row.get("relative_error", {}).get(name)) for name in SHOWN),
        )
        for row in result.validation
    )


def _percent(value: float | None) -> str:
    return f"{100 * value:.2f} %" if value is not None and math.isfinite(value) else "–"


def _data(series: Series) -> dict[str, object]:
    return {
        "time": encoded_time(series.time),
        "gap": series.gap,
        "series": {key: encoded(values) for key, values in series.values.items()},
    }


def wrench_svg(comparison: WrenchComparison, series: Series) -> str:
    """Return the four components of one flight, each with its error below, over one time axis."""
    heights = [BLOCK if is_predicted(comparison, name) else LINE for name in SHOWN]
    height = sum(heights) + AXIS
    blocks = [
        _component(comparison, series, name, sum(heights[:i], 0.0)) for i, name in enumerate(SHOWN)
    ]
    attributes: dict[str, str | float] = {
        "class": "wrench",
        "data-left": LEFT,
        "data-right": RIGHT,
        "role": "img",
        "aria-label": f"Body wrench against rotor wrench over time, flight "
        f"{file_name(comparison.flight)}",
    }
    return drawing(WIDTH, height, attributes, *blocks, _time_axis(series, height))


def _component(comparison: WrenchComparison, series: Series, name: str, top: float) -> str:
    title, unit = COMPONENT[name]
    error = error_words(comparison, name)
    main = top + TITLE
    if not is_predicted(comparison, name):
        return _unpredicted(f"{title} [{unit}]", top)
    return tag(
        "g",
        {"class": "component"},
        label(f"{title} [{unit}]", {"class": "panel-title", "x": LEFT, "y": top + 16}),
        label(
            f"error {error}",
            {"class": "panel-error right", "x": WIDTH - RIGHT, "y": top + 16},
        ),
        _panel(series, (f"{name} body", f"{name} rotor"), top=main, height=MAIN, count=5),
        _panel(series, (f"{name} error",), top=main + MAIN + GAP, height=ERROR, count=3),
    )


def _unpredicted(title: str, top: float) -> str:
    """Return a component that the result cannot predict: said, and not drawn."""
    why = "cannot be predicted: a parameter that it needs is not known"
    return tag(
        "g",
        {"class": "component"},
        label(title, {"class": "panel-title", "x": LEFT, "y": top + 16}),
        label(why, {"class": "panel-missing", "x": LEFT, "y": top + TITLE + 18}),
    )


def _panel(series: Series, keys: tuple[str, ...], *, top: float, height: float, count: int) -> str:
    """Return one pair of axes with its curves, in a clipping frame of its own."""
    width = WIDTH - LEFT - RIGHT
    span = _span(series, keys)
    curves = [
        tag(
            "path",
            {
                "class": f"curve {key.split()[1]}",
                "data-key": key,
                "d": path_of(series, key, size=(width, height), span=span),
            },
        )
        for key in keys
    ]
    frame: dict[str, str | float] = {"x": LEFT, "y": top, "width": width, "height": height}
    attributes: dict[str, str | float] = {
        "class": "panel",
        "data-top": top,
        "data-height": height,
        "data-count": count,
    }
    return tag(
        "g",
        attributes,
        tag("g", {"class": "y-ticks"}, *_y_ticks(span, top=top, height=height, count=count)),
        tag("svg", {"class": "clip", **frame}, *curves),
        tag("rect", {"class": "frame", **frame}),
    )


def _span(series: Series, keys: tuple[str, ...]) -> tuple[float, float]:
    """Return the ends of a panel's axis: the values, with a little room."""
    if not len(series.time):
        return 0.0, 1.0
    low = min(float(series.values[key].min()) for key in keys)
    high = max(float(series.values[key].max()) for key in keys)
    room = 0.06 * (high - low) or 0.5
    return low - room, high + room


def _y_ticks(span: tuple[float, float], *, top: float, height: float, count: int) -> list[str]:
    values = ticks(*span, count)
    step = values[1] - values[0] if len(values) > 1 else 1.0
    parts: list[str] = []
    for value in values:
        y = top + (span[1] - value) / (span[1] - span[0]) * height
        parts.append(tag("path", {"class": "grid", "d": f"M{LEFT} {y:.2f}H{WIDTH - RIGHT}"}))
        parts.append(
            label(tick_label(value, step), {"class": "tick right", "x": LEFT - 7, "y": y + 4})
        )
    return parts


def _time_axis(series: Series, height: float) -> str:
    t0, t1 = (float(series.time[0]), float(series.time[-1])) if len(series.time) else (0.0, 1.0)
    values = ticks(t0, t1, 8)
    step = values[1] - values[0] if len(values) > 1 else 1.0
    top = height - AXIS + 4
    places = [LEFT + (v - t0) / max(t1 - t0, 1e-9) * (WIDTH - LEFT - RIGHT) for v in values]
    marks = [
        label(tick_label(v, step), {"class": "tick middle", "x": x, "y": top})
        for v, x in zip(values, places, strict=True)
    ]
    name = label(
        "time since the log's first sample [s]",
        {"class": "axis-name middle", "x": (WIDTH + LEFT - RIGHT) / 2, "y": top + 20},
    )
    return tag(
        "g", {"class": "x-axis", "data-top": top}, tag("g", {"class": "x-ticks"}, *marks), name
    )
