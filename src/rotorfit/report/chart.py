"""Panels of curves over one axis: an SVG that is complete without a script, and data to zoom it.

`templates/plot.js` redraws the same elements for a part of the axis: curves by ``data-key``, spans
by ``data-from`` and ``data-to``, lines by ``data-at``, all in the axis' own numbers.
"""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.report.pages import (
    drawing,
    label,
    labelled_ticks,
    nice_step,
    tag,
    text,
    tick_label,
    ticks,
)
from rotorfit.series import Series, column_starts, extremes, middles

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float

WIDTH: Final = 920.0
LEFT: Final = 58.0
RIGHT: Final = 10.0
TITLE: Final = 24.0
GAP: Final = 6.0
BELOW: Final = 12.0
AXIS: Final = 36.0
MISSING: Final = 30.0
"""Height of a panel that says why it is empty."""
PLOT: Final = WIDTH - LEFT - RIGHT
LETTER: Final = 6.0
"""Mean width of a letter of a label; a browser measures it."""
ROW: Final = 14.0
MOST_DECADES: Final = 6
COLUMNS: Final = 720
"""Pairs of extremes along a curve."""
LINE: Final = "line"
LEAST_SECONDS: Final = 0.02

Switch = tuple[str, str, str]
"""Name, style, and the keys of the curves that it turns on and off, parted by |."""
Legend = tuple[tuple[str, tuple[Switch, ...]], ...]
"""The switches of each panel."""


@frozen_dataclass
class Curve:
    """One curve; its `key` in `series` and the page is unique in a chart, `style` a CSS class."""

    key: str
    name: str
    style: str
    series: Series


@frozen_dataclass
class Span:
    """A shaded stretch of a panel; `row` of its strips, the whole height where None."""

    start: float
    end: float
    style: str
    words: str
    label: str = ""
    row: int | None = None


@frozen_dataclass
class Area:
    """A shaded area between two curves; zooming does not redraw it."""

    style: str
    at: Float[np.ndarray, " n"]
    low: Float[np.ndarray, " n"]
    high: Float[np.ndarray, " n"]


@frozen_dataclass
class Line:
    """A vertical line with its words."""

    at: float
    style: str
    label: str


@frozen_dataclass
class Mark:
    """A point, the interval that it stands for, and its words."""

    at: float
    low: float
    value: float
    high: float
    words: str


@frozen_dataclass
class Panel:
    """One pair of axes; without a title it stands close to the one above.

    With `log` the values are powers of ten; with `rows`, names of strips in place of a vertical
    axis, curves are only read at the pointer; `missing` says why there is nothing to draw.
    """

    title: str
    height: float
    curves: tuple[Curve, ...] = ()
    areas: tuple[Area, ...] = ()
    marks: tuple[Mark, ...] = ()
    count: int = 5
    note: str = ""
    log: bool = False
    spans: tuple[Span, ...] = ()
    lines: tuple[Line, ...] = ()
    rows: tuple[str, ...] = ()
    missing: str = ""
    span: tuple[float, float] | None = None

    @property
    def above(self) -> float:
        """Room for the title, or what parts it from the panel above."""
        return TITLE if self.title else GAP


@frozen_dataclass
class Axis:
    """The common axis: its ends (powers of ten where `log`), and `least`, at which zooming ends."""

    ends: tuple[float, float]
    name: str
    unit: str
    least: float
    log: bool = False


@frozen_dataclass
class Chart:
    """Panels over one axis; `words` say what is seen to whom does not see it."""

    panels: tuple[Panel, ...]
    axis: Axis
    words: str
    style: str = ""

    @property
    def curves(self) -> Iterator[Curve]:
        """Of all panels."""
        for panel in self.panels:
            yield from panel.curves


def time_axis(start: float, end: float) -> Axis:
    """Lay out an axis of time since the log's first sample [s]."""
    name = "time since the log's first sample [s]"
    return Axis(ends=(start, end), name=name, unit="s", least=LEAST_SECONDS)


def chart_data(chart: Chart) -> dict[str, object]:
    """Encode what a page needs to redraw a chart: clocks, and 16-bit values by curve."""
    clocks: dict[int, Series] = {id(curve.series.time): curve.series for curve in chart.curves}
    index = {key: i for i, key in enumerate(clocks)}
    axis = chart.axis
    return {
        "axis": {"ends": axis.ends, "unit": axis.unit, "least": axis.least, "log": axis.log},
        "clocks": [{"time": encoded_time(s.time), "gap": s.gap} for s in clocks.values()],
        "series": {
            curve.key: {
                "clock": index[id(curve.series.time)],
                "name": curve.name,
                "style": curve.style,
                **encoded(curve.series.values[curve.key]),
            }
            for curve in chart.curves
        },
    }


def chart_svg(chart: Chart) -> str:
    """Draw the panels above their common axis."""
    parts: list[str] = []
    top = 0.0
    for i, panel in enumerate(chart.panels):
        parts.append(_draw_panel(panel, chart.axis, top))
        top += panel.above + (MISSING if panel.missing else panel.height)
        last = i + 1 == len(chart.panels)
        top += BELOW if last or chart.panels[i + 1].title else 0.0
    height = top + AXIS
    attributes: dict[str, str | float] = {
        "class": f"chart {chart.style}".strip(),
        "data-left": LEFT,
        "data-right": RIGHT,
        "role": "img",
        "aria-label": chart.words,
    }
    return drawing(WIDTH, height, attributes, *parts, _x_axis(chart.axis, height))


def _draw_panel(panel: Panel, axis: Axis, top: float) -> str:
    """Draw one pair of axes with its curves, in a clipping frame of its own."""
    head = [label(panel.title, {"class": "panel-title", "x": LEFT, "y": top + 16})]
    if panel.note:
        place: dict[str, str | float] = {"x": WIDTH - RIGHT, "y": top + 16}
        head.append(label(panel.note, {"class": "panel-error right", **place}))
    start = top + panel.above
    if panel.missing:
        words = label(panel.missing, {"class": "panel-missing", "x": LEFT, "y": start + 18})
        return tag("g", {"class": "component"}, *head, words)
    frame: dict[str, str | float] = {"x": LEFT, "y": start, "width": PLOT, "height": panel.height}
    inside = [
        *(_draw_span(span, panel, axis) for span in panel.spans),
        *(_draw_area(area, panel, axis) for area in panel.areas),
        *(_draw_curve(curve, panel, axis) for curve in panel.curves if not panel.rows),
        *(_draw_mark(mark, panel, axis) for mark in panel.marks),
        *_draw_lines(panel, axis),
    ]
    attributes: dict[str, str | float] = {
        "class": "panel",
        "data-top": start,
        "data-height": panel.height,
        "data-count": panel.count,
        "data-scale": "strips" if panel.rows else "log" if panel.log else "linear",
        "data-values": "|".join(curve.key for curve in panel.curves),
    }
    if panel.span is not None:
        attributes |= {"data-low": panel.span[0], "data-high": panel.span[1]}
    return tag(
        "g",
        attributes,
        *(head if panel.title else ()),
        tag("g", {"class": "y-ticks"}, *_y_ticks(panel, start)),
        tag("svg", {"class": "clip", **frame}, *inside),
        tag("rect", {"class": "frame", **frame}),
    )


def span_of(panel: Panel) -> tuple[float, float]:
    """Choose the ends of a panel's axis: the values, with a little room."""
    if panel.span is not None:
        return panel.span
    values = [curve.series.values[curve.key] for curve in panel.curves]
    values = [v for v in values if len(v)]
    if not values:
        return 0.0, 1.0
    low = min(float(v.min()) for v in values)
    high = max(float(v.max()) for v in values)
    room = 0.06 * (high - low) or 0.5
    return low - room, high + room


def _x_of(value: float, axis: Axis) -> float:
    low, high = axis.ends
    return (value - low) / max(high - low, 1e-9) * PLOT


def _draw_curve(curve: Curve, panel: Panel, axis: Axis) -> str:
    size = (PLOT, panel.height)
    d = path_of(curve.series, curve.key, size=size, span=span_of(panel), ends=axis.ends)
    return tag("path", {"class": f"curve {curve.style}", "data-key": curve.key, "d": d})


def _draw_area(area: Area, panel: Panel, axis: Axis) -> str:
    low, high = span_of(panel)

    def place(at: float, value: float) -> str:
        y = (high - min(max(value, low), high)) / max(high - low, 1e-12) * panel.height
        return f"{_x_of(at, axis):.1f} {y:.1f}"

    there = [place(*point) for point in zip(area.at.tolist(), area.high.tolist(), strict=True)]
    back = [place(*point) for point in zip(area.at.tolist(), area.low.tolist(), strict=True)]
    d = f"M{'L'.join([*there, *reversed(back)])}Z"
    return tag("path", {"class": f"area {area.style}", "d": d})


def _draw_mark(mark: Mark, panel: Panel, axis: Axis) -> str:
    low, high = span_of(panel)
    x = _x_of(mark.at, axis)
    bottom, middle, top = (
        (high - value) / (high - low) * panel.height for value in (mark.low, mark.value, mark.high)
    )
    bar = tag("path", {"class": "bar", "d": f"M{x:.1f} {bottom:.1f}V{top:.1f}"})
    title = tag("title", {}, text(mark.words))
    return bar + tag("circle", {"class": "point", "cx": x, "cy": middle, "r": 3}, title)


def _draw_span(span: Span, panel: Panel, axis: Axis) -> str:
    x = _x_of(span.start, axis)
    width = max(_x_of(span.end, axis) - x, 1.5)
    rows = max(len(panel.rows), 1)
    height = panel.height / rows if span.row is not None else panel.height
    y = (span.row or 0) * height
    inset = 1.5 if span.row is not None else 0.0
    box = tag(
        "rect",
        {"x": x, "y": y + inset, "width": width, "height": height - 2 * inset},
        *([tag("title", {}, text(span.words))] if span.words else ()),
    )
    place = {"class": f"span {span.style}", "data-from": f"{span.start:.6g}"}
    return tag("g", {**place, "data-to": f"{span.end:.6g}"}, box)


def _draw_lines(panel: Panel, axis: Axis) -> list[str]:
    """Draw lines, and the labels of lines and spans in rows that do not overlap."""
    named = [Line(at=s.start, style=s.style, label=s.label) for s in panel.spans if s.label]
    parts: list[str] = []
    free: list[float] = []
    for line in sorted([*panel.lines, *named], key=lambda one: one.at):
        x = _x_of(line.at, axis)
        wide = LETTER * len(line.label) + 10.0
        left = min(x, PLOT - wide)
        row = next((i for i, end in enumerate(free) if end <= left), len(free))
        free[row : row + 1] = [left + wide]
        inside: list[str] = []
        if line in panel.lines:
            inside.append(tag("path", {"d": f"M{x:.1f} 0V{panel.height:.1f}"}))
        words = {"class": "halo", "x": left + 4, "y": 13 + ROW * row}
        inside.append(label(line.label, words))
        place = {"class": f"{LINE} {line.style}", "data-at": f"{line.at:.6g}"}
        parts.append(tag("g", place, *inside))
    return parts


def _y_ticks(panel: Panel, top: float) -> list[str]:
    if panel.rows:
        height = panel.height / len(panel.rows)
        return [
            label(name, {"class": "tick right", "x": LEFT - 7, "y": top + (i + 0.5) * height + 4})
            for i, name in enumerate(panel.rows)
        ]
    span = span_of(panel)
    few = np.floor(span[1]) - np.ceil(span[0]) < 1
    marks = (
        _choose_decades(span, (1, 2, 5) if few else (1,))
        if panel.log
        else labelled_ticks(*span, panel.count)
    )
    parts: list[str] = []
    for value, words in marks:
        y = top + (span[1] - value) / (span[1] - span[0]) * panel.height
        parts.append(tag("path", {"class": "grid", "d": f"M{LEFT} {y:.2f}H{WIDTH - RIGHT}"}))
        parts.append(label(words, {"class": "tick right", "x": LEFT - 7, "y": y + 4}))
    return parts


def _choose_decades(ends: tuple[float, float], factors: Sequence[int]) -> list[tuple[float, str]]:
    """Choose multiples of the powers of ten between two ends, which are logarithms."""
    marks = [
        (power + float(np.log10(factor)), power_label(factor, power))
        for power in range(int(np.floor(ends[0])), int(np.ceil(ends[1])) + 1)
        for factor in factors
    ]
    return [(value, words) for value, words in marks if ends[0] <= value <= ends[1]]


def power_label(factor: int, power: int) -> str:
    """Write a number of a logarithmic axis: plain where short, else a power of ten."""
    if -3 <= power <= 3:
        return f"{factor * 10.0**power:g}"
    digits = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{digits}" if factor == 1 else f"{factor}·10{digits}"


def _x_axis(axis: Axis, height: float) -> str:
    low, high = axis.ends
    if axis.log:
        marks = _choose_decades(axis.ends, (1, 2, 5))
    else:
        step = nice_step(high - low, 8)
        marks = [(v, tick_label(v, step)) for v in ticks(low, high, 8)]
    top = height - AXIS + 4
    words = [
        label(w, {"class": "tick middle", "x": LEFT + _x_of(v, axis), "y": top}) for v, w in marks
    ]
    name = label(
        axis.name,
        {"class": "axis-name middle", "x": (WIDTH + LEFT - RIGHT) / 2, "y": top + 20},
    )
    return tag(
        "g", {"class": "x-axis", "data-top": top}, tag("g", {"class": "x-ticks"}, *words), name
    )


def logarithms(series: Series) -> Series:
    """Convert values to powers of ten, what is far below the largest one cut off."""
    values: dict[str, np.ndarray] = {}
    for key, v in series.values.items():
        largest = max(float(v.max(initial=0.0)), 1e-30)
        values[key] = np.log10(np.maximum(v, largest * 10.0**-MOST_DECADES))
    return Series(time=series.time, values=values, gap=series.gap)


def legend_of(panels: Sequence[Panel]) -> Legend:
    """Collect the switches of all curves, panel by panel."""
    return tuple(
        (panel.title.split(" [")[0], tuple((c.name, c.style, c.key) for c in panel.curves))
        for panel in panels
        if panel.curves and not panel.rows
    )


def path_of(
    series: Series,
    key: str,
    *,
    size: tuple[float, float],
    span: tuple[float, float],
    ends: tuple[float, float] | None = None,
) -> str:
    """Draw a series as SVG path data, broken at cuts; `ends` of its axis."""
    if not len(series.time):
        return ""
    starts = column_starts(series, COLUMNS)
    t0, t1 = ends or (float(series.time[0]), float(series.time[-1]))
    # The second extreme stands half a column on: a smooth curve must not become a staircase.
    places = series.time[np.stack([starts, middles(starts, len(series.time))], 1)]
    x = (places - t0) / max(t1 - t0, 1e-9) * size[0]
    pairs = extremes(series.values[key], starts)
    y = (span[1] - pairs) / max(span[1] - span[0], 1e-12) * size[1]
    broken = np.concatenate(
        [[True], series.time[starts[1:]] - series.time[starts[1:] - 1] > series.gap]
    )
    parts: list[str] = []
    for (x0, x1), (y0, y1), new in zip(x.tolist(), y.tolist(), broken.tolist(), strict=True):
        parts.append(f"{'M' if new else 'L'}{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}")
    return "".join(parts)


def encoded(values: Float[np.ndarray, " n"]) -> dict[str, float | str]:
    """Encode values as 16-bit integers in base64: value = low + (integer + 32768) step."""
    low = float(values.min()) if len(values) else 0.0
    step = (float(values.max()) - low) / 65535.0 if len(values) else 0.0
    integers = np.zeros(len(values)) if step <= 0 else np.rint((values - low) / step)
    data = (integers - 32768).astype("<i2").tobytes()
    return {"low": low, "step": step, "data": base64.b64encode(data).decode()}


def encoded_time(time: Float[np.ndarray, " n"]) -> str:
    """Encode times as 32-bit floats in base64."""
    return base64.b64encode(time.astype("<f4").tobytes()).decode()
