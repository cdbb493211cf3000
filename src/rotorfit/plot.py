"""Plots for notebooks and papers, with matplotlib: each draws on axes and returns them.

Needs ``pip install matplotlib`` (the extra ``plot``). The pages of ``--report`` need none of it.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rotorfit.digits import finite_interval, known
from rotorfit.errors import OutputError
from rotorfit.report.correlations import correlation
from rotorfit.report.parameters import unit_words
from rotorfit.report.wrenches import COMPONENT, series_of
from rotorfit.results.result import Derived, IdentificationResult, Parameter, owner_of, verdict_of
from rotorfit.results.validation.judgement import AXES
from rotorfit.results.validation.replay import HOLD, IDENTIFIED, Replay
from rotorfit.results.validation.replay_vehicle import replay_vehicle
from rotorfit.results.validation.replayed_flights import Timed, replay_flights
from rotorfit.results.validation.validate import fitted_response
from rotorfit.results.validation.wrench_comparison import SHOWN, WrenchComparison

if TYPE_CHECKING:
    from collections.abc import Sequence

Axes = Any
"""Axes of matplotlib, which need not be installed."""
MAIN: Final = ("kt", "kd", "com_x", "com_y", "com_z", "Ixx_com", "Iyy_com", "Izz_com", "motor_lag")
COLOURS: Final = {"weak": "#b36200", "doubtful": "#a3242b", "given": "#777777"}
BLUE, ORANGE, GREY = "#175fa0", "#be5408", "#999999"
SIDES: Final = {"body": "needed by the motion", "rotor": "produced by the rotors"}


def intervals(
    results: IdentificationResult | Sequence[IdentificationResult],
    names: Sequence[str] = MAIN,
    *,
    axes: Sequence[Axes] | None = None,
) -> list[Axes]:
    """Draw values with 95 % intervals: one axes per number, results side by side.

    - `results`: one, or several to compare.
    - `names`: of parameters or derived numbers; what no result knows is left out.
    - `axes`: to draw on, one for each number that is known; made if None.
    """
    several = [results] if isinstance(results, IdentificationResult) else list(results)
    shown = {name: _find_entries(several, name) for name in names}
    shown = {name: entries for name, entries in shown.items() if entries}
    if not shown:
        raise OutputError(f"none of {', '.join(names)} has a value in what is to be drawn")
    made = _make_axes(len(shown), axes, size=(7.0, sum(0.7 + 0.3 * len(e) for e in shown.values())))
    for axis, (name, entries) in zip(made, shown.items(), strict=False):
        for place, (label, entry, whose) in enumerate(entries):
            low, high = finite_interval(entry.interval) or (float(entry.value or 0.0),) * 2
            colour = COLOURS.get(verdict_of(whose, entry), BLUE)
            axis.plot([low, high], [place, place], color=colour, linewidth=4, alpha=0.45)
            axis.plot([entry.value], [place], "o", color=colour, label=label)
        axis.set_yticks(range(len(entries)), [label for label, _, _ in entries])
        axis.set_ylim(len(entries) - 0.5, -0.5)
        unit = unit_words(entries[0][1].unit)
        axis.set_title(f"{name} [{unit}]" if unit else name, loc="left", fontsize="medium")
    return made


def wrenches(comparison: WrenchComparison, *, axes: Sequence[Axes] | None = None) -> list[Axes]:
    """Draw the wrench that the motion needs and the wrench that the rotors produce over time.

    - `comparison`: from `validate_file`, `validation_comparisons` or `fitted_comparisons`.
    - `axes`: four to draw on; made if None.
    """
    series = series_of(comparison)
    components = [name for name in SHOWN if f"{name} body" in series.values]
    made = _make_axes(len(components), axes, size=(9.0, 2.0 * len(components)))
    breaks = np.flatnonzero(np.diff(series.time) > series.gap) + 1
    time = np.insert(series.time, breaks, np.nan)
    for axis, name in zip(made, components, strict=False):
        title, unit = COMPONENT[name]
        for side, colour in (("body", BLUE), ("rotor", ORANGE)):
            values = np.insert(series.values[f"{name} {side}"], breaks, np.nan)
            axis.plot(time, values, color=colour, linewidth=0.9, label=SIDES[side])
        error = comparison.relative_error.get(name)
        axis.set_title("" if error is None else f"differs by {100 * error:.1f} %", loc="right")
        axis.set_ylabel(f"{title} [{unit}]")
    _legend_above(made[0])
    made[-1].set_xlabel("time since the log's first sample [s]")
    return made


def correlations(result: IdentificationResult, *, axes: Axes | None = None) -> Axes:
    """Draw how the errors of the parameters go together: -1 to 1.

    - `result`: with a covariance.
    - `axes`: to draw on; made if None.
    """
    names = [name.replace("@", " ") for name in result.covariance_names]
    size = 1.5 + 0.27 * len(names)
    axis = _make_axes(1, None if axes is None else [axes], size=(size + 0.6, size))[0]
    image = axis.imshow(correlation(result.covariance), cmap="RdBu", vmin=-1.0, vmax=1.0)
    axis.set_xticks(range(len(names)), names, rotation=90)
    axis.set_yticks(range(len(names)), names)
    figure: Any = axis.figure
    figure.colorbar(image, ax=axis, label="correlation", fraction=0.046, pad=0.04)
    return axis


def replay(
    result: IdentificationResult,
    *,
    configuration: str | None = None,
    flight: Path | None = None,
    seconds: tuple[float, float] | None = None,
    axes: Sequence[Axes] | None = None,
) -> list[Axes]:
    """Draw the rates of a flight as flown and as predicted from the start of each half second.

    - `result`: whose model flies; its logs are read again.
    - `configuration`: which of its configurations; not needed if there is only one.
    - `flight`: another log of the vehicle; the first flight of the result if None.
    - `seconds`: from and to, since the log's first sample [s]; all of it if None.
    - `axes`: three to draw on; made if None.
    """
    owner = owner_of(result, configuration)
    timed = Timed(vehicle=replay_vehicle(result, owner), response=fitted_response(result))
    others = () if flight is None else (Path(flight),)
    replays = replay_flights(result, owner, {IDENTIFIED: timed}, others=others)
    return replay_axes(replays[0], seconds=seconds, axes=axes)


def replay_axes(
    flown: Replay,
    *,
    seconds: tuple[float, float] | None = None,
    axes: Sequence[Axes] | None = None,
) -> list[Axes]:
    """Draw a replay that was made already; `replay` makes one and says what the arguments are."""
    made = _make_axes(len(AXES), axes, size=(9.0, 5.5))
    low, high = seconds or (-np.inf, np.inf)
    inside = (flown.time[:, 0] >= low) & (flown.time[:, -1] <= high)
    gap = np.full((int(inside.sum()), 1), np.nan)

    def broken(values: np.ndarray) -> np.ndarray:
        return np.hstack([values[inside], gap]).ravel()

    time = broken(flown.time)
    for i, (axis, name) in enumerate(zip(made, AXES, strict=False)):
        axis.plot(time, broken(flown.rates[:, :, i]), color="black", linewidth=1.0, label="flown")
        for colour, side in zip((BLUE, ORANGE, GREY), flown.predicted, strict=False):
            if side.label != HOLD:
                rates = broken(side.rates[:, :, i])
                axis.plot(time, rates, color=colour, linewidth=1.0, label=side.label)
        axis.set_ylabel(f"{name} rate [rad/s]")
    _legend_above(made[0])
    made[-1].set_xlabel("time since the log's first sample [s]")
    return made


def _find_entries(
    results: Sequence[IdentificationResult], name: str
) -> list[tuple[str, Parameter | Derived, IdentificationResult]]:
    """Return every result's entries of a name that have a value, each with a label."""
    out: list[tuple[str, Parameter | Derived, IdentificationResult]] = []
    for result in results:
        for entry in (*result.parameters, *result.derived):
            if entry.name == name and known(entry.value) is not None:
                words = [result.name] if len(results) > 1 else []
                words += [entry.configuration] if entry.configuration else []
                out.append((" ".join(words), entry, result))
    return out


def _legend_above(axis: Axes) -> None:
    """Put the legend where it hides no curve."""
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False)


def _make_axes(count: int, axes: Sequence[Axes] | None, *, size: tuple[float, float]) -> list[Axes]:
    """Return the axes that were given, or new ones below each other."""
    if axes is not None:
        if len(axes) < count:
            raise OutputError(f"{len(axes)} axes were given for {count} plots: give {count}")
        return list(axes)
    try:
        pyplot: Any = import_module("matplotlib.pyplot")
    except ImportError as error:
        raise OutputError(
            f"rotorfit.plot needs matplotlib ({error}): pip install matplotlib"
        ) from error
    _, made = pyplot.subplots(count, 1, figsize=size, squeeze=False, layout="constrained")
    return list(made[:, 0])
