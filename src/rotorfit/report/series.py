"""Series as a page holds them: paths of a drawing, and a compact encoding for zooming."""

import base64
import math

import numpy as np
from jaxtyping import Float

from rotorfit.formatting.series import Series, column_starts, extremes, middles
from rotorfit.validation.wrench_comparison import SHOWN, WrenchComparison


def series_of(comparison: WrenchComparison) -> Series:
    """Return the series of a comparison's figure, without samples that are not numbers.

    A component that the result cannot predict has no error norm, and no series.
    """
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
    """Whether the result knows enough to say what the rotors do in a component."""
    error = comparison.relative_error.get(component)
    return error is not None and math.isfinite(error)


def path_of(
    series: Series,
    key: str,
    *,
    size: tuple[float, float],
    span: tuple[float, float],
    ends: tuple[float, float] | None = None,
    columns: int = 720,
) -> str:
    """Return a series as the data of an SVG path, broken at cuts.

    Parameters
    ----------
    series, key
        Which series.
    size
        Width and height of its panel [px].
    span
        Least and greatest value of the panel.
    ends
        Of its time axis; those of the series if None.
    columns
        Of the reduction.
    """
    if not len(series.time):
        return ""
    starts = column_starts(series, columns)
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
    """Return values as 16-bit integers in base64: value = low + (integer + 32768) step."""
    low = float(values.min()) if len(values) else 0.0
    step = (float(values.max()) - low) / 65535.0 if len(values) else 0.0
    integers = np.zeros(len(values)) if step <= 0 else np.rint((values - low) / step)
    data = (integers - 32768).astype("<i2").tobytes()
    return {"low": low, "step": step, "data": base64.b64encode(data).decode()}


def encoded_time(time: Float[np.ndarray, " n"]) -> str:
    """Return times as 32-bit floats in base64."""
    return base64.b64encode(time.astype("<f4").tobytes()).decode()
