"""The clock of an unknown table: which column, in what unit, and which of several."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.column_names import Candidate
from rotorfit.logs.columns import TIME, ColumnSpec
from rotorfit.logs.proposed_channels import Found, Question
from rotorfit.logs.units import UNITS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.logs.proposed_channels import Numbers
    from rotorfit.logs.table import Source

_SHORTEST_STEP: Final = 1e-5
_LONGEST_STEP: Final = 0.5
_SLOWEST_CLOCK: Final = 60.0
"""Steps of a clock [s]: beyond the first two no flight log, under the last perhaps a slow one."""


CLOCK: Final = "clock"
"""Channel of the question which of two clocks is right; its answer is the name of a column."""
_CLOCKS_DIFFER: Final = 0.05
"""Share of the duration by which two clocks of one table may differ."""

_FEWEST_TIMES: Final = 0.1
"""Share of different times among the rows: bursts of a link have more."""
_USUALLY: Final = 0.5
"""Share of the rows at which the best clock rises, below which another is of something slower."""
_RATES_DIFFER: Final = 0.005
"""Share by which two clocks may run differently: ten times what oscillators without a crystal do
after their trim, and less than the usual interval of an inertia."""


@frozen_dataclass
class _Clock:
    """A column that only rises: how it steps, and how far it gets, as recorded.

    `rising`: the share of rows at which it rises.
    """

    name: str
    unit: str | None
    step: float
    duration: float
    rising: float

    @property
    def is_counter(self) -> bool:
        """Whether it counts the ticks of a processor, whose rate no table says."""
        return re.search(r"tick|cycle", self.name.lower()) is not None


def clock_found(
    source: Source,
    candidates: Sequence[Candidate],
    numbers: Numbers,
    units: Mapping[str, str],
) -> Found:
    """Find the clock: a column that is named so and only rises; unit and name may be stated."""
    named = [one for one in candidates if one.kind == "time"]
    fallback = Candidate(kind="time", stem="", by_index={0: source.names[0]}, unit=None)
    found = [
        clock
        for one in [*named, *([] if named else [fallback])]
        if (clock := _rising_clock(one, numbers, is_named=bool(named))) is not None
    ]
    if not found:
        raise LogError(_no_clock_words(named, numbers, source.names))
    stated = units.get(CLOCK)
    by_hand = [one for one in found if one.name == stated] or found[:1] * (
        named[0].stem == "" if named else 0
    )
    # One whose name says its unit comes first, a counter last, and before it what stands at most
    # rows where others rise: the time of a slower message that the row repeats.
    often = _USUALLY * max(one.rising for one in found)
    ranked = sorted(
        found, key=lambda one: (one.is_counter, one.rising < often, _unit_by_name(one) is None)
    )
    chosen = (by_hand or ranked)[0]
    clock = _choose_clock_unit(chosen.name, chosen.unit, chosen.step, units.get(TIME))
    if by_hand or chosen.is_counter:
        return clock
    seconds = chosen.duration * UNITS["time"][str(clock.columns[TIME].unit)]
    others = [one for one in ranked[1:] if not one.is_counter]
    far = [one for one in others if not _may_last(one, seconds)]
    if far:
        return replace(clock, questions=_ask_clock(chosen, seconds, far))
    doubts = [words for one in others if (words := _compare_rates(chosen, one, numbers))]
    return replace(clock, doubts=(*clock.doubts, *doubts))


def _rising_clock(one: Candidate, numbers: Numbers, *, is_named: bool) -> _Clock | None:
    """Return a column as a clock; None if it does not rise from row to row."""
    name = one.by_index[0]
    if name not in numbers:
        return None
    values = numbers[name][np.isfinite(numbers[name])]
    steps = np.diff(values)
    # A column of 0, 1, 2, ... counts the rows.
    counts = not is_named and bool((steps == 1.0).all())
    if not len(steps) or counts or (steps < 0).any() or _is_rounded(values):
        return None
    return _Clock(
        name=name,
        unit=one.unit,
        step=float(np.median(steps[steps > 0])),
        duration=float(values[-1] - values[0]),
        rising=float((steps > 0).mean()),
    )


def _is_rounded(values: Float[np.ndarray, " n"]) -> bool:
    """Return whether a clock stands most of the time, as it does where its digits were cut."""
    return len(np.unique(values)) < _FEWEST_TIMES * len(values)


def _unit_by_name(clock: _Clock) -> str | None:
    """Return the unit in a clock's name, where rows are then as close as those of a log."""
    seconds = UNITS["time"].get(clock.unit or "")
    fits = seconds is not None and _SHORTEST_STEP <= seconds * clock.step <= _LONGEST_STEP
    return clock.unit if fits else None


def _may_last(clock: _Clock, seconds: float) -> bool:
    """Return whether a clock runs for so long in any unit."""
    return any(
        abs(clock.duration * si - seconds) <= _CLOCKS_DIFFER * seconds + 2.0 * clock.step * si
        for si in UNITS["time"].values()
    )


def _compare_rates(chosen: _Clock, other: _Clock, numbers: Numbers) -> str | None:
    """Doubt two clocks of which one runs faster than crystals do; None if they agree.

    By the slope over the later half of the rows, as the first ones often come in a bunch.
    """
    pair = np.stack([numbers[chosen.name], numbers[other.name]], axis=1)
    pair = pair[np.isfinite(pair).all(axis=1)]
    pair = pair[len(pair) // 2 :]
    x, y = (pair - pair.mean(axis=0)).T
    if not x.any() or not y.any():
        return None
    slope = float((x * y).sum() / (x * x).sum())
    ratio = min((slope * 10.0**power for power in range(-9, 10, 3)), key=lambda r: abs(np.log(r)))
    if abs(ratio - 1.0) < _RATES_DIFFER:
        return None
    way = "faster" if ratio > 1.0 else "slower"
    return (
        f"{other.name} runs {100.0 * abs(ratio - 1.0):.2g} % {way} than {chosen.name}, and inertia "
        f"goes with the clock: if it is the right one, give --column time={other.name}"
    )


def _ask_clock(chosen: _Clock, seconds: float, others: Sequence[_Clock]) -> tuple[Question, ...]:
    """Ask which of some clocks that contradict each other is right."""
    names = [chosen.name, *(one.name for one in others)]
    words = (
        f"Two clocks disagree: {chosen.name} runs for {seconds:.3g} s, and {others[0].name} "
        f"({others[0].duration:.6g} from the first row to the last) for as long in no unit. "
        "Which is the time"
    )
    return (Question(channel=CLOCK, words=words, choices=tuple(names)),)


def _no_clock_words(named: Sequence[Candidate], numbers: Numbers, names: Sequence[str]) -> str:
    fraction = next((name for name in names if re.search(r"nano?s|nsec", name.lower())), None)
    whole = [name for name in names if re.search(r"secs?$", name.lower()) and name != fraction]
    if fraction is not None and whole:
        return (
            f"no time: {whole[0]} and {fraction} are one time in two columns: write {whole[0]} + "
            f"1e-9 {fraction} as one column, in seconds"
        )
    rounded = [
        (one.by_index[0], numbers[one.by_index[0]])
        for one in named
        if one.by_index[0] in numbers and _is_rounded(numbers[one.by_index[0]])
    ]
    if rounded:
        name, values = rounded[0]
        return (
            f"no time: {name} stands still ({len(np.unique(values))} different in {len(values)} "
            "rows): export it with more digits, such as seconds from the first row"
        )
    seen = ", ".join(one.by_index[0] for one in named)
    texts = [one.by_index[0] for one in named if one.by_index[0] not in numbers]
    what = f"{seen} does not rise from row to row" if seen else "no column is named like a clock"
    if texts:
        return (
            f"no time: {texts[0]} holds text, no numbers of s, ms or us: write it as seconds from "
            "the first row, or name another column as --column time=NAME"
        )
    return f"no time: {what}; record one, or name it as --column time=NAME"


def _choose_clock_unit(name: str, unit: str | None, step: float, stated: str | None) -> Found:
    """Choose the unit of a clock: as stated, else by its name where rows are then close enough."""
    if stated is not None:
        return _set_clock(name, stated, step)
    fits = {
        u: s * step for u, s in UNITS["time"].items() if _SHORTEST_STEP <= s * step <= _LONGEST_STEP
    }
    if not fits:
        raise LogError(
            f"rows are {step:.4g} apart in {name!r}: in no unit several rows a second, no flight"
        )
    best = min(fits, key=lambda u: abs(np.log(fits[u] / 4e-3)))
    chosen = unit if unit in fits else best
    why = "by its name" if unit in fits else "as rows come"
    words = f"time: {name} in {chosen} {why}, {fits[chosen] * 1e3:.4g} ms a row"
    doubts: tuple[str, ...] = ()
    if unit in UNITS["time"] and unit not in fits:
        doubts = (f"{name} is named as {unit}, but rows would be {step:g} {unit} apart",)
    elif unit is None and _LONGEST_STEP <= step <= _SLOWEST_CLOCK:
        doubts = (
            f"{name} has no unit in its name and rises by {step:g} a row: if that is seconds, and "
            f"not {chosen}, the log is too slow for a flight",
        )
    return Found(
        columns={TIME: ColumnSpec(name=name, unit=chosen)}, reasons=(words,), doubts=doubts
    )


def _set_clock(name: str, unit: str, step: float) -> Found:
    """Take the unit of a clock as stated; doubt it where no flight has such rows."""
    seconds = UNITS["time"][unit] * step
    fits = _SHORTEST_STEP <= seconds <= _LONGEST_STEP
    doubt = f"{name} in {unit}, as stated, makes rows {seconds:.4g} s apart: no flight log"
    return Found(
        columns={TIME: ColumnSpec(name=name, unit=unit)},
        reasons=(f"time: {name} in {unit} as stated, {1e3 * seconds:.4g} ms a row",)
        if fits
        else (),
        doubts=() if fits else (doubt,),
    )
