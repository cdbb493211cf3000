"""Section 3: body wrench against rotor wrench over time (Six et al. 2020, Fig. 3 and 4)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rotorfit.formatting.series import Series, thinned
from rotorfit.logs.files import file_name
from rotorfit.report.chart import Axis, Chart, Curve, Legend, Panel, chart_data, chart_svg
from rotorfit.report.series import is_predicted, series_of
from rotorfit.results.result import IdentificationResult
from rotorfit.validation.wrench_comparison import SHOWN, WrenchComparison

MAIN, ERROR = 104.0, 42.0
LEAST_SECONDS = 0.02
KINDS = {"body": "body", "rotor": "rotors", "error": "error"}
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
    legend: Legend
    errors: tuple[tuple[str, str, str], ...]
    seconds: float


def wrench_figures(comparisons: Sequence[WrenchComparison]) -> tuple[WrenchFigure, ...]:
    """Return the figures of all compared flights."""
    return tuple(_figure(comparison) for comparison in comparisons)


def _figure(comparison: WrenchComparison) -> WrenchFigure:
    series = thinned(series_of(comparison))
    chart = wrench_chart(comparison, series)
    return WrenchFigure(
        title=file_name(comparison.flight),
        configuration=comparison.configuration,
        used_in_fit=comparison.used_in_fit,
        sha256=comparison.sha256,
        svg=chart_svg(chart),
        data=chart_data(chart),
        legend=switches(comparison),
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


def wrench_svg(comparison: WrenchComparison, series: Series) -> str:
    """Return the four components of one flight, each with its error below, over one time axis."""
    return chart_svg(wrench_chart(comparison, series))


def wrench_chart(comparison: WrenchComparison, series: Series) -> Chart:
    """Return the panels of one flight."""
    ends = (float(series.time[0]), float(series.time[-1])) if len(series.time) else (0.0, 1.0)
    return Chart(
        panels=tuple(
            panel for name in SHOWN for panel in _component_panels(comparison, series, name)
        ),
        axis=Axis(
            ends=ends, name="time since the log's first sample [s]", unit="s", least=LEAST_SECONDS
        ),
        words=f"Body wrench against rotor wrench over time, flight {file_name(comparison.flight)}",
        style="wrench",
    )


def _component_panels(comparison: WrenchComparison, series: Series, name: str) -> tuple[Panel, ...]:
    """Return a component and its error; one that the result cannot predict is said, not drawn."""
    words, unit = COMPONENT[name]
    title = f"{words} [{unit}]"
    if not is_predicted(comparison, name):
        why = "cannot be predicted: a parameter that it needs is not known"
        return (Panel(title=title, height=0.0, missing=why),)

    def curve(kind: str) -> Curve:
        key, shown = f"{name} {kind}", KINDS[kind]
        return Curve(key=key, name=shown, style=kind, series=series)

    note = f"error {error_words(comparison, name)}"
    return (
        Panel(title=title, note=note, height=MAIN, curves=(curve("body"), curve("rotor"))),
        Panel(title="", height=ERROR, count=3, curves=(curve("error"),)),
    )


def switches(comparison: WrenchComparison) -> Legend:
    """Return what switches the curves of a flight on and off, all components together."""
    names = [name for name in SHOWN if is_predicted(comparison, name)]
    kinds = tuple(
        (words, kind, "|".join(f"{n} {kind}" for n in names)) for kind, words in KINDS.items()
    )
    return (("Curves", kinds),) if names else ()
