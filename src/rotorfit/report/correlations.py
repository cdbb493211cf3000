"""Section 5: parameters that the flights hardly separate."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.checks.weak_directions import condition_words
from rotorfit.fit.intervals.numbers import LEAST_EXCITATION
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.report.pages import drawing, label, tag, text

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.results.result import IdentificationResult

STRONG = 0.6
CELL, LEFT, TOP = 34.0, 118.0, 10.0
MOST = 40
"""More names than this make a map that nobody reads; the strongest pairs stay."""
BLUE, ORANGE = (23, 95, 160), (190, 84, 8)


@frozen_dataclass
class Pair:
    """Two parameters that move together."""

    first: str
    second: str
    value: float
    words: str


@frozen_dataclass
class Direction:
    """A combination of parameters that carries more than its share of the uncertainty."""

    terms: tuple[str, ...]
    share: float


@frozen_dataclass
class Excitation:
    """How much livelier the motion was than what the rotors do not explain."""

    axis: str
    ratio: float
    enough: bool


@frozen_dataclass
class CorrelationSection:
    """All of the section."""

    heat_map: str | None
    pairs: tuple[Pair, ...]
    directions: tuple[Direction, ...]
    excitations: tuple[Excitation, ...]
    conditions: tuple[tuple[str, str], ...]
    least: float = LEAST_EXCITATION


def correlation_section(result: IdentificationResult) -> CorrelationSection:
    """Describe the correlations of a result by a map and by phrases."""
    names = [name.replace("@", " ") for name in result.covariance_names]
    matrix = correlation(result.covariance)
    return CorrelationSection(
        heat_map=heat_map(names, matrix) if 1 < len(names) <= MOST else None,
        pairs=_strong_pairs(names, matrix),
        directions=_weak_combinations(names, matrix),
        excitations=tuple(
            Excitation(
                axis=name.removeprefix("excitation_").replace("@", " "),
                ratio=value,
                enough=value >= LEAST_EXCITATION,
            )
            for name, value in result.diagnostics.items()
            if name.startswith("excitation_") and math.isfinite(value)
        ),
        conditions=_list_conditions(result),
    )


def correlation(covariance: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """Normalise a covariance; 0 if there is no variance to speak of."""
    with np.errstate(invalid="ignore", divide="ignore"):
        std = np.sqrt(np.diag(covariance))
        scaled = covariance / np.outer(std, std)
    scaled = np.clip(np.where(np.isfinite(scaled), scaled, 0.0), -1.0, 1.0)
    np.fill_diagonal(scaled, 1.0)
    return scaled


def _strong_pairs(names: list[str], matrix: Float[np.ndarray, "p p"]) -> tuple[Pair, ...]:
    found = [
        Pair(first=a, second=b, value=float(matrix[i, j]), words=_pair_phrase(float(matrix[i, j])))
        for i, a in enumerate(names)
        for j, b in enumerate(names[:i])
        if abs(matrix[i, j]) >= STRONG
    ]
    return tuple(sorted(found, key=lambda pair: -abs(pair.value))[:8])


def _pair_phrase(value: float) -> str:
    # Knowing one would leave sqrt(1 - r^2) of the other's uncertainty.
    left = 100 * math.sqrt(max(0.0, 1 - value**2))
    return f"{left:.0f} %"


def _weak_combinations(names: list[str], matrix: Float[np.ndarray, "p p"]) -> tuple[Direction, ...]:
    """Find combinations in which the scaled uncertainty gathers: twice their share or more."""
    if len(names) < 3:
        return ()
    values, vectors = np.linalg.eigh(matrix)
    out: list[Direction] = []
    for value, vector in zip(values[::-1].tolist(), vectors.T[::-1], strict=True):
        if value < 2.0 or len(out) == 3:
            break
        order = np.argsort(-np.abs(vector))
        main = [i for i in order.tolist() if abs(vector[i]) >= 0.35 * abs(vector[order[0]])]
        sign = 1.0 if vector[order[0]] > 0 else -1.0
        terms = tuple(f"{'+' if sign * vector[i] > 0 else '−'} {names[i]}" for i in main[:5])
        out.append(Direction(terms=terms, share=100.0 * value / len(names)))
    return tuple(out)


def _list_conditions(result: IdentificationResult) -> tuple[tuple[str, str], ...]:
    """List the condition numbers, and how good that of rotors and bodies is."""
    found: list[tuple[str, str]] = []
    for name, value in result.diagnostics.items():
        if name.startswith("condition") and math.isfinite(value):
            what = name.removeprefix("condition").strip("_").replace("@", " ")
            judged = f" ({condition_words(value)})" if what == "bodies" else ""
            words = {"": "all free parameters", "bodies": "rotors and bodies"}.get(what, what)
            found.append((words, f"{value:.3g}{judged}"))
    return tuple(found)


def heat_map(names: list[str], matrix: Float[np.ndarray, "p p"]) -> str:
    """Draw the lower triangle of the correlations as coloured squares with their numbers."""
    n = len(names)
    cells: list[str] = []
    for i in range(n):
        y = TOP + i * CELL
        words = {"class": "right", "x": LEFT - 8, "y": y + CELL / 2 + 4}
        cells.append(label(names[i], words))
        cells += [_draw_cell(names, matrix, i, j) for j in range(i)]
        x = LEFT + i * CELL
        cells.append(tag("rect", {"class": "self", "x": x, "y": y, "width": CELL, "height": CELL}))
        below = TOP + n * CELL + 8
        turned = {"transform": f"translate({x + CELL / 2 + 4:.1f} {below:.1f}) rotate(-55)"}
        cells.append(label(names[i], {"class": "right", **turned}))
    attributes = {"class": "heat-map", "role": "img", "aria-label": "Correlations of parameters"}
    return drawing(LEFT + n * CELL + 10, TOP + n * CELL + 104, attributes, *cells)


def _draw_cell(names: list[str], matrix: Float[np.ndarray, "p p"], i: int, j: int) -> str:
    value = float(matrix[i, j])
    x, y = LEFT + j * CELL, TOP + i * CELL
    square = {"x": x + 0.5, "y": y + 0.5, "width": CELL - 1, "height": CELL - 1}
    parts = [
        tag("title", {}, text(f"{names[i]} and {names[j]}: {value:+.2f}")),
        tag("rect", {"fill": _blend_colour(value), **square}),
    ]
    if abs(value) >= 0.3:
        shade = "light" if abs(value) > 0.65 else "dark"
        words = f"{value:+.2f}".replace("-", "−").replace("0.", ".")
        parts.append(
            label(words, {"class": f"middle {shade}", "x": x + CELL / 2, "y": y + CELL / 2 + 4})
        )
    return tag("g", {}, *parts)


def _blend_colour(value: float) -> str:
    """Blend white at 0 towards blue for +1 and orange for -1."""
    end = BLUE if value > 0 else ORANGE
    share = abs(value)
    r, g, b = (round(246 + (c - 246) * share) for c in end)
    return f"#{r:02x}{g:02x}{b:02x}"
