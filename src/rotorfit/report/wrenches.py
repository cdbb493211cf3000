"""Section 3: body against rotor wrench, over time (Six et al. 2020, Fig. 3, 4) and frequency."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.digits import short
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import file_name
from rotorfit.report.chart import (
    Axis,
    Chart,
    Curve,
    Legend,
    Panel,
    chart_data,
    chart_svg,
    logarithms,
    time_axis,
)
from rotorfit.results.validation.wrench_comparison import (
    SHOWN,
    WINDOW_SECONDS,
    WrenchComparison,
    WrenchSpectra,
    wrench_spectra,
)
from rotorfit.series import Series, thinned

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.results.result import IdentificationResult

NAMES: Final = {"Fz": "thrust", "Mx": "roll", "My": "pitch", "Mz": "yaw"}
HEIGHT: Final = 150.0
COHERENT: Final = 0.8
CHANCE: Final = "by chance"
EQUAL: Final = "as large"
LEAST_OCTAVE: Final = 0.1
"""What zooming ends at, in powers of ten."""
TOO_SHORT: Final = (
    "no picture by frequency: the flights compared have too few stretches of "
    f"{WINDOW_SECONDS:.0f} s; fly longer without breaks"
)


MAIN, ERROR = 104.0, 42.0
KINDS = {"body": "body", "rotor": "rotors", "error": "error"}
COMPONENT = {
    "Fz": ("Thrust Fz", "N"),
    "Mx": ("Roll moment Mx", "N m"),
    "My": ("Pitch moment My", "N m"),
    "Mz": ("Yaw moment Mz", "N m"),
}


@frozen_dataclass
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
    """Draw all compared flights."""
    return tuple(_make_figure(comparison) for comparison in comparisons)


def _make_figure(comparison: WrenchComparison) -> WrenchFigure:
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
            (COMPONENT[n][0], error_percent(comparison, n), whiteness_text(comparison, n))
            for n in SHOWN
        ),
        seconds=float(series.time[-1] - series.time[0]) if len(series.time) else 0.0,
    )


def error_percent(comparison: WrenchComparison, component: str) -> str:
    """Write the relative error norm of a component in percent, a dash where there is none."""
    return _percent_text(comparison.relative_error.get(component))


def whiteness_text(comparison: WrenchComparison, component: str) -> str:
    """Write the share of the motion left in the difference; a dash if unknown."""
    value = comparison.whiteness.get(component)
    return f"{value:.2f}" if value is not None and math.isfinite(value) else "–"


def validation_rows(
    result: IdentificationResult,
) -> tuple[tuple[str, str, tuple[str, ...]], ...]:
    """Tabulate the error norms that the result itself holds, for pages without figures."""
    return tuple(
        (
            file_name(str(row.get("flight", ""))),
            str(row.get("configuration", "")),
            tuple(_percent_text(row.get("relative_error", {}).get(name)) for name in SHOWN),
        )
        for row in result.validation
    )


def _percent_text(value: float | None) -> str:
    return f"{short(100 * value)} %" if value is not None and math.isfinite(value) else "–"


def wrench_svg(comparison: WrenchComparison, series: Series) -> str:
    """Draw the four components of one flight, each with its error below, over one time axis."""
    return chart_svg(wrench_chart(comparison, series))


def wrench_chart(comparison: WrenchComparison, series: Series) -> Chart:
    """Lay out the panels of one flight."""
    ends = (float(series.time[0]), float(series.time[-1])) if len(series.time) else (0.0, 1.0)
    return Chart(
        panels=tuple(
            panel for name in SHOWN for panel in _component_panels(comparison, series, name)
        ),
        axis=time_axis(*ends),
        words=f"Body wrench against rotor wrench over time, flight {file_name(comparison.flight)}",
        style="wrench",
    )


def _component_panels(comparison: WrenchComparison, series: Series, name: str) -> tuple[Panel, ...]:
    """Lay out a component and its error; one that cannot be predicted is said, not drawn."""
    words, unit = COMPONENT[name]
    title = f"{words} [{unit}]"
    if not is_predicted(comparison, name):
        why = "cannot be predicted: a parameter that it needs is not known"
        return (Panel(title=title, height=0.0, missing=why),)

    def curve(kind: str) -> Curve:
        key, shown = f"{name} {kind}", KINDS[kind]
        return Curve(key=key, name=shown, style=kind, series=series)

    note = f"error {error_percent(comparison, name)}"
    return (
        Panel(title=title, note=note, height=MAIN, curves=(curve("body"), curve("rotor"))),
        Panel(title="", height=ERROR, count=3, curves=(curve("error"),)),
    )


def switches(comparison: WrenchComparison) -> Legend:
    """Switch the curves of a flight on and off, all components together."""
    names = [name for name in SHOWN if is_predicted(comparison, name)]
    kinds = tuple(
        (words, kind, "|".join(f"{n} {kind}" for n in names)) for kind, words in KINDS.items()
    )
    return (("Curves", kinds),) if names else ()


def series_of(comparison: WrenchComparison) -> Series:
    """Select the finite samples of a comparison's figure, of the components that are predicted."""
    index = [("Fx", "Fy", "Fz", "Mx", "My", "Mz").index(name) for name in SHOWN]
    body, rotor = comparison.body_wrench[:, index], comparison.rotor_wrench[:, index]
    usable = np.isfinite(np.column_stack([comparison.time, body, rotor])).all(axis=1)
    time, body, rotor = comparison.time[usable], body[usable], rotor[usable]
    steps = np.diff(time)
    values: dict[str, Float[np.ndarray, " n"]] = {}
    for i, name in enumerate(SHOWN):
        if not is_predicted(comparison, name):
            continue
        values[f"{name} body"] = body[:, i]
        values[f"{name} rotor"] = rotor[:, i]
        values[f"{name} error"] = body[:, i] - rotor[:, i]
    return Series(
        time=time, values=values, gap=3.0 * float(np.median(steps)) if len(steps) else 1.0
    )


def is_predicted(comparison: WrenchComparison, component: str) -> bool:
    """Test whether the result knows enough to say what the rotors do in a component."""
    error = comparison.relative_error.get(component)
    return error is not None and math.isfinite(error)


@frozen_dataclass
class ExcitationFigure:
    """Drawing, data for zooming, and what is to be seen, one sentence each."""

    svg: str
    data: dict[str, object]
    legend: Legend
    words: tuple[str, ...]
    seconds: float


def excitation_figure(comparisons: Sequence[WrenchComparison]) -> ExcitationFigure | None:
    """Draw all compared flights together; None if they are too short."""
    found = wrench_spectra(comparisons)
    if found is None:
        return None
    chart = excitation_chart(found)
    switches = tuple(
        (NAMES[name], f"part-{name}", f"{name} coherence|{name} ratio") for name in found.coherence
    )
    return ExcitationFigure(
        svg=chart_svg(chart),
        data=chart_data(chart),
        legend=(("Curves", switches),),
        words=tuple(excitation_sentences(found)),
        seconds=found.seconds,
    )


def excitation_chart(found: WrenchSpectra) -> Chart:
    """Lay out two panels over a logarithmic frequency."""
    time = np.log10(found.frequency)
    level = np.full(len(time), 1.0)
    coherence = {f"{n} coherence": v for n, v in found.coherence.items()} | {
        CHANCE: found.random_level * level
    }
    ratio = {f"{n} ratio": v for n, v in found.ratio.items()} | {EQUAL: level}
    gap = 2.0 * float(np.diff(time).max())

    def curves(series: Series, constant: str) -> tuple[Curve, ...]:
        parts = [key for key in series.values if key != constant]
        shown = [
            Curve(key=key, name=NAMES[key[:2]], style=f"part-{key[:2]}", series=series)
            for key in parts
        ]
        name = constant if constant == CHANCE else ""
        return (Curve(key=constant, name=name, style="level", series=series), *shown)

    return Chart(
        panels=(
            Panel(
                title="Coherence of motion and rotors",
                height=HEIGHT,
                count=5,
                span=(0.0, 1.04),
                curves=curves(Series(time=time, values=coherence, gap=gap), CHANCE),
            ),
            Panel(
                title="Rotors over what is left",
                height=HEIGHT,
                log=True,
                curves=curves(logarithms(Series(time=time, values=ratio, gap=gap)), EQUAL),
            ),
        ),
        axis=Axis(
            ends=(float(time[0]), float(time[-1])),
            name="frequency [Hz]",
            unit="Hz",
            least=LEAST_OCTAVE,
            log=True,
        ),
        words=" ".join(["What the flights excite, by frequency.", *excitation_sentences(found)]),
        style="excitation",
    )


def excitation_sentences(found: WrenchSpectra) -> list[str]:
    """Describe where each component is excited."""
    return [_component_sentence(found, name) for name in found.coherence]


def _component_sentence(found: WrenchSpectra, name: str) -> str:
    coherence, ratio = found.coherence[name], found.ratio[name]
    axis, best = NAMES[name].capitalize(), int(np.argmax(ratio))
    rotors = (
        f"the rotors give up to {short(float(ratio[best]))} times what is left, at "
        f"{found.frequency[best]:.2g} Hz"
    )
    good = (coherence >= max(COHERENT, found.random_level)) & (ratio > 1.0)
    if not good.any():
        return (
            f"{axis}: nowhere excited well; the coherence is up to {coherence.max():.2f}, and "
            f"{rotors}."
        )
    at = found.frequency[good]
    return (
        f"{axis}: excited well (coherence over {COHERENT:g}) in {100 * good.mean():.0f} % of the "
        f"band, between {at[0]:.2g} and {at[-1]:.2g} Hz; {rotors}."
    )
