"""The picture of what the flights excite: coherence and signal over noise of each component."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rotorfit.formatting.series import Series
from rotorfit.report.chart import (
    Axis,
    Chart,
    Curve,
    Legend,
    Panel,
    chart_data,
    chart_svg,
    logarithms,
)
from rotorfit.validation.wrench_comparison import WrenchComparison
from rotorfit.validation.wrench_spectra import WINDOW_SECONDS, WrenchSpectra, wrench_spectra

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


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationFigure:
    """Drawing, data for zooming, and what is to be seen, one sentence each."""

    svg: str
    data: dict[str, object]
    legend: Legend
    words: tuple[str, ...]
    seconds: float


def excitation_figure(comparisons: Sequence[WrenchComparison]) -> ExcitationFigure | None:
    """Return the figure of all compared flights together; None where they are too short."""
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
        words=tuple(excitation_words(found)),
        seconds=found.seconds,
    )


def excitation_chart(found: WrenchSpectra) -> Chart:
    """Return two panels over a logarithmic frequency."""
    time = np.log10(found.frequency)
    level = np.full(len(time), 1.0)
    coherence = {f"{n} coherence": v for n, v in found.coherence.items()} | {
        CHANCE: found.by_chance * level
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
        words=" ".join(["What the flights excite, by frequency.", *excitation_words(found)]),
        style="excitation",
    )


def excitation_words(found: WrenchSpectra) -> list[str]:
    """Return where each component is excited, one sentence each."""
    return [_component_words(found, name) for name in found.coherence]


def _component_words(found: WrenchSpectra, name: str) -> str:
    coherence, ratio = found.coherence[name], found.ratio[name]
    axis, best = NAMES[name].capitalize(), int(np.argmax(ratio))
    rotors = (
        f"the rotors give up to {ratio[best]:.2g} times what is left, at "
        f"{found.frequency[best]:.2g} Hz"
    )
    good = (coherence >= max(COHERENT, found.by_chance)) & (ratio > 1.0)
    if not good.any():
        return (
            f"{axis}: nowhere excited well; the coherence is up to {coherence.max():.2f}, and "
            f"{rotors}: fly more of it."
        )
    at = found.frequency[good]
    return (
        f"{axis}: excited well (coherence over {COHERENT:g}) in {100 * good.mean():.0f} % of the "
        f"band, between {at[0]:.2g} and {at[-1]:.2g} Hz; {rotors}."
    )
