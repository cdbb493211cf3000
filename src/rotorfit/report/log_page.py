"""The page of inspected logs: channels over time, spectra with the filters."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import write_whole
from rotorfit.report.chart import (
    LEAST_SECONDS,
    Axis,
    Chart,
    Curve,
    Legend,
    Line,
    Panel,
    Span,
    chart_data,
    chart_svg,
    legend_of,
    logarithms,
    time_axis,
)
from rotorfit.report.log_report import KNOW, airborne_phrase, sections
from rotorfit.report.pages import render_page
from rotorfit.report.parameters import unit_words
from rotorfit.series import Series
from rotorfit.tools.inspection.pictures import (
    LEVELS,
    THRUST_LEVELS,
    TURN_LEVELS,
    Activity,
    LogPictures,
    Mark,
    TimePicture,
    Trace,
)
from rotorfit.tools.inspection.spectra import RotorBand, Spectrum, ordinal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.logs.firmware import Filter
    from rotorfit.tools.inspection.inspect_log import LogReport

TITLES: Final = {
    "gyro": "Gyro",
    "accel": "Accelerometer",
    "rotor_speed": "Rotor speed",
    "command": "Motor commands",
    "position": "Position",
}
HEIGHTS: Final = {"gyro": 124.0, "accel": 124.0, "rotor_speed": 110.0, "command": 92.0}
SPECTRUM_HEIGHT: Final = 210.0
ROW_HEIGHT: Final = 20.0
STYLES: Final = {"x": "axis-x", "y": "axis-y", "z": "axis-z"}
COLORS: Final = 8
"""Colours of rotors; the ninth has the first one's."""
MOST_LISTED: Final = 4
MARK_STYLES: Final = {
    "flown": "airborne",
    "cut": "not used",
    "gap": "gap",
    "limit": "at its limit",
}
ROOM: Final = 0.15
"""Room above a spectrum for its labels, as a share of its height."""


@frozen_dataclass
class LogFigure:
    """One figure as the page shows it: drawing, data for zooming, and what it says in words."""

    title: str
    svg: str
    data: dict[str, object]
    legend: Legend
    shades: tuple[tuple[str, str], ...]
    words: tuple[str, ...]


@frozen_dataclass
class LogArticle:
    """One log as the page shows it."""

    report: LogReport
    title: str
    airborne: str
    trouble: tuple[str, ...]
    figures: tuple[LogFigure, ...]
    left_out: tuple[str, ...]
    lists: tuple[tuple[str, list[str]], ...]


def log_report_html(*reports: LogReport) -> str:
    """Write the findings in logs as one self-contained HTML page."""
    return render_page(
        "log",
        *("page", "figure", "log", "dark"),
        script="plot.js",
        articles=[_make_article(report) for report in reports],
    )


def _make_article(report: LogReport) -> LogArticle:
    lists = [*sections(report), ("What the reader says", list(report.notes))]
    return LogArticle(
        report=report,
        title=Path(report.file).name,
        airborne=airborne_phrase(report),
        trouble=report.trouble,
        figures=log_figures(report),
        left_out=() if report.pictures is None else report.pictures.left_out,
        lists=tuple((title, words) for title, words in lists if words and title != KNOW),
    )


def write_log_page(path: Path, reports: Sequence[LogReport], *, force: bool) -> None:
    """Write reports as one page into a file, whole or not at all."""
    write_whole(path, log_report_html(*reports), force=force)


def log_figures(report: LogReport) -> tuple[LogFigure, ...]:
    """Draw the figures that a log allows."""
    pictures = report.pictures
    if pictures is None:
        return ()
    found: list[LogFigure] = []
    if pictures.time is not None:
        found.append(_time_figure(pictures.time, report.airborne))
    if pictures.spectra:
        found.append(_spectrum_figure(pictures))
    return tuple(found)


def _make_figure(
    title: str, chart: Chart, shades: Sequence[tuple[str, str]], words: Sequence[str]
) -> LogFigure:
    return LogFigure(
        title=title,
        svg=chart_svg(chart),
        data=chart_data(chart),
        legend=legend_of(chart.panels),
        shades=tuple(shades),
        words=tuple(words),
    )


def _time_figure(picture: TimePicture, airborne: Sequence[tuple[float, float]]) -> LogFigure:
    """Draw the channels over time, and below them which axis moved when."""
    used = [Span(start=a, end=b, style="flown", words="", row=0) for a, b in airborne]
    panels = [_trace_panel(trace, picture) for trace in picture.traces]
    if used:
        lane = Panel(title="", height=11.0, rows=("airborne",), spans=tuple(used))
        panels = [lane, *panels]
    if picture.activity:
        panels.append(_activity_panel(picture))
    words = time_sentences(picture, airborne)
    chart = Chart(
        panels=tuple(panels),
        axis=time_axis(picture.start, max(picture.end, picture.start + LEAST_SECONDS)),
        words=" ".join(["What the log recorded over time.", *words]),
        style="signals",
    )
    kinds = [*(["flown"] if used else []), *dict.fromkeys(mark.kind for mark in picture.marks)]
    shades = [(kind, MARK_STYLES[kind]) for kind in kinds]
    if picture.activity:
        shades += [(f"level-{i}", name) for i, name in enumerate(LEVELS)]
    return _make_figure("In flight", chart, shades, words)


def _trace_panel(trace: Trace, picture: TimePicture) -> Panel:
    """Lay out a channel with its marks; what is not used is shaded in all of them."""
    curves: list[Curve] = []
    for part in trace.curves:
        named = {f"{trace.channel} {name}": values for name, values in part.values.items()}
        series = Series(time=part.time, values=named, gap=part.gap)
        curves += [
            Curve(
                key=f"{trace.channel} {name}",
                name=name,
                style=STYLES.get(name) or f"rotor-{(int(name) - 1) % COLORS + 1}",
                series=series,
            )
            for name in part.values
        ]
    curves.sort(key=lambda curve: (len(curve.name), curve.name))
    unit = "0 to 1" if trace.unit == "1" else unit_words(trace.unit)
    return Panel(
        title=f"{TITLES[trace.channel]} [{unit}]",
        height=HEIGHTS.get(trace.channel, 110.0),
        curves=tuple(curves),
        count=5,
        spans=tuple(
            Span(
                start=m.start,
                end=m.end,
                style=m.kind,
                words=f"{m.words}, {m.start:.2f} to {m.end:.2f} s",
            )
            for m in picture.marks
            if m.channel in (None, trace.channel)
        ),
    )


def _activity_panel(picture: TimePicture) -> Panel:
    """Lay out a strip for each axis, darker where it moved more; read in numbers."""
    spans = [span for row, axis in enumerate(picture.activity) for span in _level_spans(axis, row)]
    return Panel(
        title="Which axis moved",
        height=ROW_HEIGHT * len(picture.activity),
        rows=tuple(axis.axis for axis in picture.activity),
        curves=tuple(_moved_curve(axis) for axis in picture.activity),
        spans=tuple(spans),
    )


def _moved_curve(axis: Activity) -> Curve:
    there = np.isfinite(axis.size)
    middles = axis.start + axis.step * (np.arange(len(axis.size)) + 0.5)
    key = f"{axis.axis} moved"
    series = Series(time=middles[there], values={key: axis.size[there]}, gap=axis.step)
    return Curve(key=key, name=axis.axis, style="moved", series=series)


def _level_spans(axis: Activity, row: int) -> list[Span]:
    """Join the neighbouring windows of one level."""
    level: list[int] = axis.level.tolist()
    edges = [0, *(np.flatnonzero(np.diff(level)) + 1).tolist(), len(level)]
    spans: list[Span] = []
    for a, b in pairwise(edges):
        if level[a] < 0:
            continue
        start, end = axis.start + a * axis.step, axis.start + b * axis.step
        name = LEVELS[level[a]]
        words = f"{axis.axis} {name}, {start:.1f} to {end:.1f} s"
        spans.append(Span(start=start, end=end, style=f"level-{level[a]}", words=words, row=row))
    return spans


def time_sentences(picture: TimePicture, airborne: Sequence[tuple[float, float]]) -> list[str]:
    """Describe the pictures over time."""
    words = _mark_sentences([mark for mark in picture.marks if mark.kind != "cut"])
    if picture.activity:
        where = "In the air" if airborne else "In all of the log"
        parts = [f"{a.axis} for {a.seconds(2, airborne):.0f} s" for a in picture.activity]
        words.append(
            f"{where}, lively or harder: {', '.join(parts)}. Gentle begins at a rate of "
            f"{TURN_LEVELS[0]:.0f} deg/s (rms), lively at {TURN_LEVELS[1]:.0f}, hard at "
            f"{TURN_LEVELS[2]:.0f}; for thrust, at changes of {THRUST_LEVELS[0]:g}, "
            f"{THRUST_LEVELS[1]:g} and {THRUST_LEVELS[2]:g} g."
        )
    return words


def _mark_sentences(marks: Sequence[Mark]) -> list[str]:
    """Describe the places of the marks, one sentence for marks at the same places."""
    at: dict[str, list[tuple[float, float]]] = {}
    for mark in marks:
        at.setdefault(mark.words, []).append((mark.start, mark.end))
    together: dict[str, list[str]] = {}
    for name, spans in at.items():
        places = ", ".join(f"{a:.2f} to {b:.2f} s" for a, b in spans[:MOST_LISTED])
        more = len(spans) - MOST_LISTED
        total = sum(b - a for a, b in spans)
        rest = f" and {more} more, {total:.2g} s in all" if more > 0 else ""
        together.setdefault(f"{places}{rest}", []).append(name)
    return [_as_sentence(f"{', '.join(names)}: {places}") for places, names in together.items()]


def _spectrum_figure(pictures: LogPictures) -> LogFigure:
    """Draw the spectra over one frequency axis, with the filters and named peaks."""
    top = max(float(s.frequency[-1]) for s in pictures.spectra)
    panels = tuple(_spectrum_panel(s, pictures, top) for s in pictures.spectra)
    words = spectrum_sentences(pictures)
    chart = Chart(
        panels=panels,
        axis=Axis(ends=(0.0, top), name="frequency [Hz]", unit="Hz", least=top / 100.0),
        words=" ".join(["Spectra of the sensors.", *words]),
        style="spectra",
    )
    used = {span.style for panel in panels for span in panel.spans}
    used |= {line.style for panel in panels for line in panel.lines}
    names = {
        "harmonic": "where the rotors turn",
        "low-pass": "low-pass",
        "notch": "notch",
        "moving": "filter that moves within",
        "elsewhere": "filter that these samples did not pass",
        "peak": "peak",
    }
    shades = [(style, name) for style, name in names.items() if style in used]
    return _make_figure("Vibration", chart, shades, words)


def _spectrum_panel(found: Spectrum, pictures: LogPictures, top: float) -> Panel:
    series = logarithms(
        Series(
            time=found.frequency,
            values={f"spectrum {found.channel} {k}": v for k, v in found.density.items()},
            gap=2.0 * float(found.frequency[1] - found.frequency[0]),
        )
    )
    filters = [f for f in pictures.filters if f.channel == found.channel]
    lines = [Line(at=p.frequency, style="peak", label=p.words) for p in found.peaks]
    spans = [_band_span(band) for band in pictures.bands]
    for one in filters:
        more_lines, more_spans = _filter_marks(one, pictures.bands)
        lines += more_lines
        spans += more_spans
    values = list(series.values.values())
    low, high = min(float(v.min()) for v in values), max(float(v.max()) for v in values)
    return Panel(
        title=f"{TITLES[found.channel]} [{unit_words(found.unit)} per √Hz]",
        height=SPECTRUM_HEIGHT,
        log=True,
        curves=tuple(
            Curve(key=key, name=axis, style=STYLES[axis], series=series)
            for key, axis in zip(series.values, found.density, strict=True)
        ),
        spans=tuple(span for span in spans if span.start < top),
        lines=tuple(line for line in lines if line.at < top),
        span=(low - 0.05 * (high - low), high + max(ROOM * (high - low), 0.3)),
    )


def _band_span(band: RotorBand) -> Span:
    name = f"{ordinal(band.harmonic)} rotor harmonic"
    words = f"{name}, {band.low:.0f} to {band.high:.0f} Hz"
    return Span(start=band.low, end=band.high, style="harmonic", words=words, label=name)


def _filter_marks(one: Filter, bands: Sequence[RotorBand]) -> tuple[list[Line], list[Span]]:
    """Mark a filter: a line where it is fixed, a stretch where it moves."""
    style = one.kind if one.passed else "elsewhere"
    if one.harmonics:
        spans = [
            Span(
                start=max(band.low, one.low),
                end=band.high,
                style=style,
                words=one.words,
                label=one.short,
            )
            for band in bands
            if band.harmonic in one.harmonics and band.high > one.low
        ]
        return [], spans
    if one.low == one.high:
        return [Line(at=one.low, style=style, label=one.short)], []
    if one.middle is not None:
        span = Span(start=one.low, end=one.high, style=style, words=one.words)
        return [Line(at=one.middle, style=style, label=one.short)], [span]
    style = "moving" if one.passed else style
    return [], [Span(start=one.low, end=one.high, style=style, words=one.words, label=one.short)]


def spectrum_sentences(pictures: LogPictures) -> list[str]:
    """Describe the pictures of the spectra."""
    words = [_peak_sentence(found) for found in pictures.spectra]
    first = pictures.spectra[0]
    if pictures.bands:
        band = pictures.bands[0]
        sentence = f"The rotors turn at {band.low:.0f} to {band.high:.0f} Hz"
        if band.high > 0.5 * first.sample_rate:
            sentence += (
                f", over half of the log's {first.sample_rate:.0f} Hz: their vibration appears at "
                "lower, false frequencies (aliasing); log at "
                f"{_faster_rate(2.2 * band.high)} Hz or more to see it where it is"
            )
        words.append(f"{sentence}.")
    elif any(found.peaks for found in pictures.spectra):
        words.append("The peaks cannot be matched to the rotors: log their speed (ESC telemetry).")
    if not first.airborne:
        words.append("The spectra are of the whole log: which part was airborne is not known.")
    return [*words, *(_as_sentence(one.words) for one in pictures.filters)]


def _as_sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}."


def _faster_rate(rate: float) -> int:
    """Choose a log rate that people set: 500, 1000, 2000 and so on."""
    return next((r for r in (250, 500, 1000, 2000, 4000) if r >= rate), 8000)


def _peak_sentence(found: Spectrum) -> str:
    name = TITLES[found.channel]
    if not found.peaks:
        return f"{name}: no clear peak over {found.seconds:.0f} s."
    parts = "; ".join(peak.words for peak in found.peaks)
    return f"{name}, {found.seconds:.0f} s: peaks at {parts}."
