"""Position and attitude as the motion of a table without an IMU: unit and axes by gravity.

A multirotor accelerates to where its thrust leans, by g times the tilt, whatever it weighs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.columns import NAMES, TIME, ColumnSpec, unit_of
from rotorfit.logs.proposed_channels import Found, stacked
from rotorfit.logs.units import STANDARD_GRAVITY, UNITS, Axes, attitude_from_euler, unit_or_nan

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float

    from rotorfit.logs.column_names import Candidate
    from rotorfit.logs.proposed_channels import Numbers

WITHOUT_IMU: Final = (
    "no gyro or no accelerometer: position and attitude show the motion, as by motion capture"
)
_SPAN: Final = 0.2
"""Half of the time over which a position is differenced twice [s]."""
_LEAST_ALIKE: Final = 0.7
"""Correlation of acceleration and lean from which they say something of one another."""


@frozen_dataclass
class Lean:
    """How the acceleration by position goes with the lean of the attitude.

    - `slope`: acceleration in units of the position over the horizontal part of the body's z axis.
    - `alike`: their correlation.
    """

    slope: float
    alike: float


def pose_found(
    position: Candidate,
    attitude: Found,
    numbers: Numbers,
    *,
    clock: ColumnSpec,
    units: Mapping[str, str],
    axes: Axes | None,
) -> tuple[Found, Axes]:
    """Find the position's unit and the axes by gravity; both may be stated."""
    places = stacked(position.by_index.values(), numbers)
    lean = _compare_lean(
        places, attitude, numbers, time=numbers[clock.name] * _si_factor(TIME, clock)
    )
    clear = lean is not None and abs(lean.alike) > _LEAST_ALIKE
    named = position.unit if position.unit in UNITS["position"] else None
    seen = _unit_by_gravity(lean.slope) if lean is not None and clear else None
    unit = units.get("position") or seen or named or "m"
    columns = {
        canonical: ColumnSpec(name=position.by_index[i], unit=unit)
        for i, canonical in enumerate(NAMES["position"])
    }
    risen = float(np.nanmedian(places[:, 2]) - places[np.isfinite(places[:, 2])][0, 2])
    up: Axes = "FLU" if risen >= 0 else "FRD"
    chosen = axes or up
    if lean is None or not clear:
        words = (
            f"position in {unit}, axes {chosen}: it does not accelerate to where the attitude leans"
            f"{'' if lean is None else f' (correlation {lean.alike:.2f})'}, so neither is confirmed"
        )
        return Found(columns=columns, reasons=(WITHOUT_IMU,), doubts=(words,)), chosen
    doubts = _list_contradictions(lean, unit, named, chosen=chosen, up=up)
    words = f"position: accelerates to where the attitude leans, in {unit}, axes {chosen}"
    return Found(
        columns=columns, reasons=(WITHOUT_IMU, *(() if doubts else (words,))), doubts=doubts
    ), chosen


def _list_contradictions(
    lean: Lean, unit: str, named: str | None, *, chosen: Axes, up: Axes
) -> tuple[str, ...]:
    """State where unit and axes go against gravity, or against a name."""
    felt = abs(lean.slope) * UNITS["position"][unit]
    doubts: list[str] = []
    if not 0.5 < felt / STANDARD_GRAVITY < 2.0:
        doubts.append(f"position in {unit} makes gravity {felt:.3g} m/s^2: it is 9.81")
    elif named not in (None, unit):
        doubts.append(f"the position is named in {named}, but gravity says {unit}")
    if (lean.slope > 0) != (chosen == "FLU"):
        doubts.append(
            f"the position accelerates against the lean of the attitude in axes {chosen}: position "
            "and attitude are in different axes, or one has a wrong sign"
        )
    elif chosen != up:
        doubts.append(f"axes {chosen}, but the position says that the flight was below its start")
    return tuple(doubts)


def _unit_by_gravity(slope: float) -> str | None:
    felt = {u: abs(slope) * si / STANDARD_GRAVITY for u, si in UNITS["position"].items()}
    return next((u for u, share in felt.items() if 0.5 < share < 2.0), None)


def _compare_lean(
    places: Float[np.ndarray, "n 3"],
    attitude: Found,
    numbers: Numbers,
    *,
    time: Float[np.ndarray, " n"],
) -> Lean | None:
    """Compare the second difference of the position with the lean over the same time."""
    specs = list(attitude.columns.items())
    values = stacked((spec.name for _, spec in specs), numbers)
    if specs[0][0] == "roll":
        values = attitude_from_euler(values * _si_factor(*specs[0]))
    w, x, y, z = unit_or_nan(values).T
    leans = np.stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x)], axis=1)
    known = _rising_rows(np.column_stack([time, places[:, :2], leans]))
    step = float(np.median(np.diff(known[:, 0]))) if len(known) > 1 else 0.0
    half = round(_SPAN / step) if step > 0 else 0
    if half < 1 or len(known) < 8 * half:
        return None
    even = np.arange(known[0, 0], known[-1, 0], step)
    at = [np.asarray(np.interp(even, known[:, 0], known[:, i]), float) for i in range(1, 5)]
    accelerations = [_second_difference(one, half, step) for one in at[:2]]
    return _fit_line(
        np.concatenate(accelerations), np.concatenate([_mean_around(t, half) for t in at[2:]])
    )


def _rising_rows(rows: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "m c"]:
    """Select the rows that hold numbers, at times that rise."""
    rows = rows[np.isfinite(rows).all(axis=1)]
    return rows[np.diff(rows[:, 0], prepend=-np.inf) > 0] if len(rows) else rows


def _second_difference(
    place: Float[np.ndarray, " n"], half: int, step: float
) -> Float[np.ndarray, " m"]:
    """Compute the mean acceleration around each instant, weighted by a triangle."""
    later, earlier = place[2 * half :], place[: -2 * half]
    return (later - 2.0 * place[half:-half] + earlier) / (half * step) ** 2


def _mean_around(values: Float[np.ndarray, " n"], half: int) -> Float[np.ndarray, " m"]:
    """Compute the mean around the same instants, with the same weights."""
    triangle = 1.0 - np.abs(np.arange(1 - half, half)) / half
    return np.convolve(values, triangle / triangle.sum(), mode="valid")[1:-1]


def _fit_line(y: Float[np.ndarray, " n"], x: Float[np.ndarray, " n"]) -> Lean | None:
    if np.std(x) == 0.0 or np.std(y) == 0.0:
        return None
    slope = float(np.cov(x, y)[0, 1] / np.var(x, ddof=1))
    return Lean(slope=slope, alike=float(np.corrcoef(x, y)[0, 1]))


def _si_factor(name: str, spec: ColumnSpec) -> float:
    return UNITS["time" if name == TIME else "angle"][unit_of(name, spec)]
