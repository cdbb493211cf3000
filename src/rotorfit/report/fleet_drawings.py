"""The drawings of a fleet's page: a number over a vehicle's flights, and over all vehicles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.report.pages import decimal, drawing, label, tag, text, tick_label, ticks
from rotorfit.tools.fleet.changes import NORMAL_95
from rotorfit.tools.fleet.compared import IN_METRES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.tools.fleet.statistics import NumberStatistics

MOST_POINTS: Final = 60
"""Most points of a drawing; more flights are put together, neighbours in time."""
MOST_DOTS: Final = 150
"""Vehicles of a strip that are drawn one by one; more are counted in bars."""
BARS: Final = 48
ROOM: Final = 0.06
"""Room of a scale beyond its ends."""


@frozen_dataclass
class Scale:
    """The scale of a drawing: percent of the type's mean, or millimetres from it; ends in units."""

    zero: float
    per_unit: float
    unit: str
    low: float
    high: float

    def of(self, values: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k"]:
        """Convert values to units."""
        return (values - self.zero) / self.per_unit


@frozen_dataclass
class _Points:
    """Estimates over a vehicle's flights, averaged where there are many."""

    flight: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    std: Float[np.ndarray, " n"]


@frozen_dataclass
class _Plot:
    """Where a drawing's axes are."""

    left: float
    top: float
    width: float
    height: float
    flights: int
    scale: Scale

    def x(self, flight: float) -> float:
        """Return the abscissa of a flight, from 1."""
        return self.left + self.width * (flight - 0.5) / max(self.flights, 1)

    def y(self, units: float) -> float:
        """Return the ordinate of a value in units; never outside by more than a little."""
        share = (units - self.scale.low) / (self.scale.high - self.scale.low)
        return self.top + self.height * (1.0 - min(max(share, -0.02), 1.02))


def scale_of(number: NumberStatistics, places: Sequence[int] | None = None) -> Scale:
    """Return a scale that holds a number of some vehicles, or of all: flights with their levels."""
    zero = number.mean if np.isfinite(number.mean) else float(np.median(number.values))
    metres = number.name in IN_METRES
    per_unit = 1e-3 if metres else 0.01 * (abs(zero) or 1.0)
    chosen = np.isin(number.vehicle_of_row, list(places)) if places is not None else ...
    values = (number.values[chosen] - zero) / per_unit
    deviations = number.std[chosen] / per_unit
    spread = NORMAL_95 * float(np.median(deviations))
    low, high = float(values.min()) - spread, float(values.max()) + spread
    room = ROOM * (high - low) or 1.0
    unit = "mm" if metres else "%"
    return Scale(zero=zero, per_unit=per_unit, unit=unit, low=low - room, high=high + room)


def small_svg(number: NumberStatistics, place: int, scale: Scale, name: str) -> str:
    """Draw a number over a vehicle's flights, small, as one of many."""
    plot = _Plot(
        left=2.0,
        top=2.0,
        width=196.0,
        height=66.0,
        flights=_count_flights(number, place),
        scale=scale,
    )
    changed = " changed" if number.changes[place] else ""
    kind = f"series small{changed}{' apart' if number.outlying[place] else ''}"
    title = f"{number.name} of {name} over its flights"
    frame = tag(
        "rect", {"class": "frame", "x": 2, "y": 2, "width": plot.width, "height": plot.height}
    )
    inside = [_type_band(number, plot), frame, *_draw_series(number, place, plot)]
    return drawing(200.0, 70.0, {"class": kind, "role": "img", "aria-label": title}, *inside)


def mark_class(number: NumberStatistics, place: int) -> str:
    """Choose how a vehicle is marked: an outlier, changed, or like the others."""
    return "apart" if number.outlying[place] else "changed" if number.changes[place] else "like"


def large_svg(number: NumberStatistics, place: int, name: str, dates: Sequence[str]) -> str:
    """Draw a number over a vehicle's flights with its axes.

    `dates` are those of its first and last flight; empty if they are not known.
    """
    scale = scale_of(number, [place])
    low, high = min(scale.low, 0.0), max(scale.high, 0.0)
    plot = _Plot(
        left=44.0,
        top=8.0,
        width=348.0,
        height=150.0,
        flights=_count_flights(number, place),
        scale=Scale(zero=scale.zero, per_unit=scale.per_unit, unit=scale.unit, low=low, high=high),
    )
    title = f"{number.name} of {name} over its flights, {scale.unit} from the type's mean"
    inside = [
        _type_band(number, plot),
        *_draw_grid(plot),
        tag("rect", {"class": "frame", "x": 44, "y": 8, "width": 348, "height": 150}),
        *_draw_series(number, place, plot),
        *_flight_axis(plot, dates),
    ]
    attributes = {"class": "series large", "role": "img", "aria-label": title}
    return drawing(400.0, 196.0, attributes, *inside)


def strip_svg(number: NumberStatistics, names: Sequence[str]) -> str:
    """Draw where the vehicles are about the type's mean: dots, or bars where there are many."""
    low, high = _strip_ends(number)
    width, middle = 360.0, 20.0

    def x(value: float) -> float:
        return 8.0 + (width - 16.0) * min(max((value - low) / (high - low), 0.0), 1.0)

    inside: list[str] = []
    if np.isfinite(number.between):
        a, b = (x(number.mean + s * NORMAL_95 * number.between) for s in (-1.0, 1.0))
        inside.append(tag("rect", {"class": "type", "x": a, "y": 6, "width": b - a, "height": 28}))
    inside.append(tag("path", {"class": "mean", "d": f"M{decimal(x(number.mean))} 3V37"}))
    known = np.flatnonzero(np.isfinite(number.now))
    if len(known) > MOST_DOTS:
        inside += _draw_bars(number.now[known], low, high, width)
        known = np.array([i for i in known.tolist() if mark_class(number, i) != "like"], dtype=int)
    for place in known.tolist():
        value, half = float(number.now[place]), NORMAL_95 * float(number.now_std[place])
        kind = mark_class(number, place)
        if kind != "like":
            ends = f"M{decimal(x(value - half))} {middle}H{decimal(x(value + half))}"
            inside.append(tag("path", {"class": f"interval {kind}", "d": ends}))
        dot = {"class": f"dot {kind}", "cx": x(value), "cy": middle, "r": 3.2}
        inside.append(tag("circle", dot, tag("title", {}, text(names[number.vehicles[place]]))))
    for end, value in (("", low), (" right", high)):
        place = {"class": f"tick{end}", "x": 8 if not end else width - 8, "y": 47}
        inside.append(label(_from_mean(number, value), place))
    title = f"{number.name} of each vehicle about the type's mean"
    return drawing(width, 50.0, {"class": "strip", "role": "img", "aria-label": title}, *inside)


def _from_mean(number: NumberStatistics, value: float) -> str:
    """Format how far a value is from the type's mean."""
    scale = 1e3 if number.name in IN_METRES else 100.0 / (abs(number.mean) or 1.0)
    unit = "mm" if number.name in IN_METRES else "%"
    return f"{scale * (value - number.mean):+.2g} {unit}".replace("-", "\u2212")


def _strip_ends(number: NumberStatistics) -> tuple[float, float]:
    known = np.isfinite(number.now)
    now, half = number.now[known], NORMAL_95 * number.now_std[known]
    reach = 2.4 * number.between if np.isfinite(number.between) else 0.0
    low = float(min([*(now - half), number.mean - reach]))
    high = float(max([*(now + half), number.mean + reach]))
    return (low, high) if high > low else (low - 1.0, high + 1.0)


def _draw_bars(values: Float[np.ndarray, " v"], low: float, high: float, width: float) -> list[str]:
    counts, _ = np.histogram(np.clip(values, low, high), bins=BARS, range=(low, high))
    step = (width - 16.0) / BARS
    out: list[str] = []
    for i, count in enumerate(counts.tolist()):
        if count:
            tall = 30.0 * count / int(counts.max())
            place = {"x": 8.0 + i * step, "y": 35.0 - tall, "width": step - 0.6, "height": tall}
            out.append(tag("rect", {"class": "bar", **place}))
    return out


def _count_flights(number: NumberStatistics, place: int) -> int:
    return int((number.vehicle_of_row == place).sum())


def _points_of_vehicle(number: NumberStatistics, place: int) -> _Points:
    """Return a vehicle's estimates, neighbours averaged by their weights where there are many."""
    mine = number.vehicle_of_row == place
    scatter = number.within if np.isfinite(number.within) else 0.0
    y, v = number.values[mine], number.std[mine] ** 2 + scatter**2
    flight = np.arange(1.0, len(y) + 1.0)
    if len(y) <= MOST_POINTS:
        return _Points(flight=flight, value=y, std=number.std[mine])
    edges = np.linspace(0, len(y), MOST_POINTS + 1).astype(int)[:-1]
    w = 1.0 / np.maximum(v, np.finfo(float).tiny)
    total = np.add.reduceat(w, edges)
    return _Points(
        flight=np.add.reduceat(w * flight, edges) / total,
        value=np.add.reduceat(w * y, edges) / total,
        std=1.0 / np.sqrt(total),
    )


def _draw_series(number: NumberStatistics, place: int, plot: _Plot) -> list[str]:
    points = _points_of_vehicle(number, place)
    y = plot.scale.of(points.value)
    half = NORMAL_95 * points.std / plot.scale.per_unit
    bars = "".join(
        f"M{decimal(plot.x(f))} {decimal(plot.y(a))}V{decimal(plot.y(b))}"
        for f, a, b in zip(points.flight, y - half, y + half, strict=True)
    )
    dots = "".join(
        f"M{decimal(plot.x(f))} {decimal(plot.y(v))}h0"
        for f, v in zip(points.flight, y, strict=True)
    )
    out = [tag("path", {"class": "bars", "d": bars}), tag("path", {"class": "dots", "d": dots})]
    level = _level_of_flights(number, place)
    if np.isfinite(level).all() and len(level) > 1:
        out.append(tag("path", {"class": "level", "d": _level_path(plot, level)}))
    for change in number.changes[place]:
        x = decimal(plot.x(change.first + 0.5))
        mark = f"M{x} {decimal(plot.top)}v{decimal(plot.height)}"
        out.append(tag("path", {"class": "change", "d": mark}))
    return out


def _level_of_flights(number: NumberStatistics, place: int) -> Float[np.ndarray, " n"]:
    """Return the level about which a vehicle's flights scatter, changes included."""
    n = _count_flights(number, place)
    level = np.full(n, number.level[place])
    for change in number.changes[place]:
        level += change.size * change.shape
    return level


def _level_path(plot: _Plot, level: Float[np.ndarray, " n"]) -> str:
    """Draw a path through the level at each flight, without points on straight lines."""
    units = plot.scale.of(level)
    bend = np.abs(np.diff(units, 2)) > 1e-9
    kept = np.flatnonzero(np.concatenate([[True], bend, [True]]))
    pairs = [f"{decimal(plot.x(i + 1.0))} {decimal(plot.y(units[i]))}" for i in kept.tolist()]
    return "M" + "L".join(pairs)


def _type_band(number: NumberStatistics, plot: _Plot) -> str:
    """Draw where 95 % of all vehicles are, and the type's mean."""
    zero = decimal(plot.y(0.0))
    mean = tag("path", {"class": "mean", "d": f"M{decimal(plot.left)} {zero}h{plot.width:g}"})
    if not np.isfinite(number.between):
        return mean
    reach = NORMAL_95 * number.between / plot.scale.per_unit
    top, bottom = plot.y(reach), plot.y(-reach)
    place = {"x": plot.left, "y": top, "width": plot.width, "height": bottom - top}
    return tag("rect", {"class": "type", **place}) + mean


def _draw_grid(plot: _Plot) -> list[str]:
    marks = ticks(plot.scale.low, plot.scale.high, 5)
    step = marks[1] - marks[0] if len(marks) > 1 else 1.0
    out: list[str] = []
    for mark in marks:
        y = plot.y(mark)
        line = f"M{decimal(plot.left)} {decimal(y)}h{plot.width:g}"
        out.append(tag("path", {"class": "grid", "d": line}))
        tick = f"{tick_label(mark, step)} {plot.scale.unit}"
        out.append(label(tick, {"class": "tick right", "x": plot.left - 5, "y": y + 4}))
    return out


def _flight_axis(plot: _Plot, dates: Sequence[str]) -> list[str]:
    """Draw numbers of flights below a drawing, and the first and last day."""
    bottom = plot.top + plot.height
    out: list[str] = []
    for mark in ticks(1.0, float(max(plot.flights, 2)), 5):
        if mark == round(mark) and 1 <= mark <= plot.flights:
            place = {"class": "tick middle", "x": plot.x(mark), "y": bottom + 14}
            out.append(label(f"{mark:.0f}", place))
    first, last = dates
    below = bottom + 30
    out.append(label(first, {"class": "tick", "x": plot.left, "y": below}))
    middle = plot.left + plot.width / 2
    out.append(label("flight", {"class": "axis-name middle", "x": middle, "y": below}))
    end = {"class": "tick right", "x": plot.left + plot.width, "y": below}
    return [*out, label(last, end)]
