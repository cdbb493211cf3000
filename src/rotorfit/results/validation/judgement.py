"""Judge whether the model flies as the vehicle did, by wrenches and replay of the same flights.

The wrenches say how much of force and moments below 3 Hz the rotors do not explain; the replay, for
how long rates are right where nothing corrects them. `validate` and `fly` say the same of a flight.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from rotorfit.digits import short
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.results.validation.replay import (
    HOLD,
    IDENTIFIED,
    Replay,
    band_growth,
    error_growth,
    growth_time,
)
from rotorfit.results.validation.validate import NEEDS, TRIMS
from rotorfit.results.validation.wrench_comparison import COMPONENTS, WrenchComparison

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.results.result import IdentificationResult

AXES: Final = ("roll", "pitch", "yaw")
GOOD_SHARE: Final = 0.2
"""Share of the flown rates, within which a prediction is called good."""
Level = Literal["good", "with-feedback", "rough", "nothing", "unknown"]
LEVELS: Final[tuple[Level, ...]] = ("good", "with-feedback", "rough", "unknown", "nothing")
"""Levels from the best to the worst."""
COMPONENT_OF: Final = {"thrust": "Fz", "roll": "Mx", "pitch": "My", "yaw": "Mz"}
GOOD_ERROR: Final = {"thrust": 0.05, "roll": 0.3, "pitch": 0.3, "yaw": 0.3}
"""Shares of the rotors' force or moment that may be left: the weight is in the thrust, and of a
moment .3 leaves a tenth of its power."""
NARROW_BAND: Final = 3.0
"""Error over the 95 % band of the parameters, from which on the band does not explain it."""
HEADS: Final[Mapping[Level, str]] = {
    "good": "Yes",
    "with-feedback": "Yes, with a controller",
    "rough": "Roughly",
    "nothing": "No",
    "unknown": "Only partly known",
}
WORDS: Final[Mapping[Level, str]] = {
    "good": "good",
    "with-feedback": "good with a controller",
    "rough": "rough",
    "nothing": "nothing predicted",
    "unknown": "not known from this result",
}


@frozen_dataclass
class AxisJudgement:
    """The judgement of thrust or one axis of a model.

    - `axis`: ``thrust``, ``roll``, ``pitch`` or ``yaw``.
    - `level`: ``good``; ``with-feedback``: slow moments are right, rates without feedback are soon
      worse than constant ones; ``rough``; ``nothing``: the error is as large as what is predicted.
    - `wrench_error`: force or moment below 3 Hz that the rotors leave, over theirs; None: unknown.
    - `over_held`: error of the rates at the end of a window over that of constant rates; None
      without a replay.
    - `right_for`: how long the rates stay within `GOOD_SHARE` of what was flown [s].
    """

    axis: str
    level: Level
    wrench_error: float | None
    over_held: float | None = None
    right_for: float | None = None

    @property
    def deciding(self) -> str:
        """The number that decides the level."""
        if self.level == "with-feedback":
            return f"without one off by a fifth after {self.right_for or 0.0:.2g} s"
        if self.wrench_error is not None:
            return f"error {short(100.0 * self.wrench_error)} %"
        held = self.over_held
        return "" if held is None else f"error {held:.2g} times that of a constant rate"


@frozen_dataclass
class Judgement:
    """The judgement of a model on some flights; `doubtful` are numbers that it rests on."""

    axes: tuple[AxisJudgement, ...]
    doubtful: tuple[str, ...] = ()

    @property
    def level(self) -> Level:
        """Of the worst axis."""
        return LEVELS[max(LEVELS.index(one.level) for one in self.axes)]

    @property
    def sentence(self) -> str:
        """The answer with the number that decides, then the axes that are better."""
        rests = f" It rests on doubtful numbers: {', '.join(self.doubtful)}."
        why = _explain_level(self.level, self._worst_axis)
        return (
            f"Does it fly as flown? {HEADS[self.level]}: {why}."
            f"{self._better_axes}{rests if self.doubtful else ''}"
        )

    @property
    def _worst_axis(self) -> AxisJudgement:
        """The axis that decides the level, by the number that decides it."""
        level, of_level = self.level, [one for one in self.axes if one.level == self.level]
        if level == "with-feedback":
            return min(of_level, key=lambda one: one.right_for or 0.0)
        return max(of_level, key=lambda one: (one.wrench_error or 0.0) / GOOD_ERROR[one.axis])

    @property
    def _better_axes(self) -> str:
        """The axes that do not decide, by their level."""
        parts = [
            f"{WORDS[level]}: {', '.join(map(_with_number, found))}"
            for level in LEVELS
            if (
                found := [
                    one for one in self.axes if one.level == level and one != self._worst_axis
                ]
            )
        ]
        return f" {'; '.join(parts).capitalize()}." if parts else ""

    def to_plain(self) -> dict[str, Any]:
        """Return the judgement as JSON holds it."""
        return {
            "level": self.level,
            "sentence": self.sentence,
            "axes": [asdict(one) for one in self.axes],
            "doubtful": list(self.doubtful),
        }


def _explain_level(level: Level, worst: AxisJudgement) -> str:
    """Explain a level by the axis and the number that decide it."""
    what = "thrust" if worst.axis == "thrust" else f"{worst.axis} moment"
    good = f"up to {short(100.0 * GOOD_ERROR[worst.axis])} % is good"
    if level == "with-feedback":
        return (
            f"thrust and moments are right, but with nothing to correct it the {worst.axis} rate "
            f"is off by a fifth after {worst.right_for or 0.0:.2g} s, as small errors add up"
        )
    if level == "unknown":
        return f"the result does not know the {what}"
    if worst.wrench_error is None:
        return (
            f"the {worst.axis} rate decides, with an error {worst.over_held or 0.0:.2g} times that "
            "of a constant rate"
        )
    return f"the {what} decides, with an error of {short(100.0 * worst.wrench_error)} %; {good}"


def _with_number(one: AxisJudgement) -> str:
    return f"{one.axis} ({one.deciding})" if one.deciding else one.axis


def judgement(
    replays: Sequence[Replay],
    *,
    comparisons: Sequence[WrenchComparison] = (),
    doubtful: tuple[str, ...] = (),
) -> Judgement:
    """Judge a model on flights, by their replays and the comparisons of their wrenches.

    `comparisons` are those of flights that were not replayed.
    """
    compared = [*comparisons, *(r.comparison for r in replays if r.comparison is not None)]
    of_rates: dict[str, tuple[float, float]] = {}
    if replays:
        held, right = identified_over_held(replays).tolist(), horizon(replays, GOOD_SHARE).tolist()
        of_rates = dict(zip(AXES, zip(held, right, strict=True), strict=True))
    return Judgement(
        axes=tuple(
            _judged_axis(
                axis, _relative_error(compared, component), *of_rates.get(axis, (None, None))
            )
            for axis, component in COMPONENT_OF.items()
        ),
        doubtful=doubtful,
    )


def doubtful_numbers(result: IdentificationResult, owner: str) -> tuple[str, ...]:
    """List the doubtful numbers of a configuration that wrenches and replay rest on."""
    needed = {n for c in COMPONENT_OF.values() for n in (*NEEDS[c], *TRIMS.get(c, ()))}
    return tuple(
        p.name
        for p in result.parameters
        if p.verdict == "doubtful" and p.configuration in (None, owner) and p.name in needed
    )


def _judged_axis(
    axis: str, error: float | None, held: float | None, right: float | None
) -> AxisJudgement:
    level: Level = "good"
    if error is None and held is None:
        level = "unknown"
    elif error is not None and error > GOOD_ERROR[axis]:
        beats_rates_held = held is not None and held < 1.0
        level = "rough" if error < 1.0 or beats_rates_held else "nothing"
    elif held is not None and held > 1.0:
        level = "with-feedback"
    return AxisJudgement(
        axis=axis, level=level, wrench_error=error, over_held=held, right_for=right
    )


def _relative_error(comparisons: Sequence[WrenchComparison], component: str) -> float | None:
    """Compute what the rotors leave of a component over theirs, of all flights that have it."""
    known = [c for c in comparisons if component in c.relative_error]
    if not known:
        return None
    if len(known) == 1:
        return known[0].relative_error[component]
    i = COMPONENTS.index(component)
    left = sum(float(((c.body_wrench - c.rotor_wrench)[:, i] ** 2).sum()) for c in known)
    rotors = sum(float((c.rotor_wrench[:, i] ** 2).sum()) for c in known)
    return float(np.sqrt(left / max(rotors, np.finfo(float).tiny)))


def error_sentences(replays: Sequence[Replay]) -> list[str]:
    """Explain errors far beyond the band of the parameters, and moments that are not good."""
    words = _beyond_band(replays)
    compared = [r.comparison for r in replays if r.comparison is not None]
    others = [axis for axis in AXES if axis not in words]
    return [*words.values(), *moment_sentences(compared, axes=others)]


def _beyond_band(replays: Sequence[Replay]) -> dict[str, str]:
    """Explain, axis by axis, errors far beyond the band: it is the band, or the model."""
    words: dict[str, str] = {}
    ratios, parts = over_band(replays).tolist(), error_parts(replays)
    for axis, ratio, (steady, moved) in zip(AXES, ratios, parts, strict=True):
        if not np.isfinite(ratio) or ratio <= NARROW_BAND:
            continue
        words[axis] = (
            f"{axis}: the error is {ratio:.1f} times what the parameters' intervals allow. "
            f"{_explain_cause(steady, moved, of='the error')}"
        )
    return words


def _explain_cause(steady: float, moved: float, *, of: str) -> str:
    """Explain an error by the shares of its power: steady, with the motion, and the rest."""
    rest = 1.0 - steady - moved
    if rest >= max(steady, moved):
        return (
            f"{100 * rest:.0f} % of {of} looks like gusts or propeller wash, which the model "
            "leaves out"
        )
    if steady >= moved:
        return (
            f"{100 * steady:.0f} % of {of} is a steady offset: the load, the balance or the wind "
            "changed since the fit"
        )
    return (
        f"{100 * moved:.0f} % of {of} grows with the motion: inertia, thrust or torque of this "
        "flight differ from the result"
    )


@frozen_dataclass
class MomentSplit:
    """The power of a moment that the motion needs, below 3 Hz, by its causes.

    - `by_rotors`: share that the rotors make; below zero where they leave more than there is.
    - `steady`, `with_motion`: shares of what they leave: its mean, and what goes with their moment.
    """

    axis: str
    by_rotors: float
    steady: float
    with_motion: float

    def to_plain(self) -> dict[str, Any]:
        """Return the split as JSON holds it, the share that is neither with it."""
        return {**asdict(self), "neither": 1.0 - self.steady - self.with_motion}


def moment_splits(comparisons: Sequence[WrenchComparison]) -> list[MomentSplit]:
    """Split each moment that the result knows, over all of some flights."""
    splits: list[MomentSplit] = []
    for axis in AXES:
        i = COMPONENTS.index(COMPONENT_OF[axis])
        known = [c for c in comparisons if COMPONENT_OF[axis] in c.relative_error]
        if not known:
            continue
        body = np.concatenate([c.body_wrench[:, i] for c in known])
        rotors = np.concatenate([c.rotor_wrench[:, i] for c in known])
        left = body - rotors
        made = 1.0 - float(left @ left) / max(float(body @ body), np.finfo(float).tiny)
        [(steady, moved)] = _error_parts(left[:, None], rotors[:, None])
        splits.append(MomentSplit(axis=axis, by_rotors=made, steady=steady, with_motion=moved))
    return splits


def moment_sentences(
    comparisons: Sequence[WrenchComparison], *, axes: Sequence[str] = AXES
) -> list[str]:
    """Explain badly predicted moments: the rotors' share, and what the rest looks like."""
    words: list[str] = []
    for split in moment_splits(comparisons):
        error = _relative_error(comparisons, COMPONENT_OF[split.axis])
        if split.axis not in axes or error is None or error <= GOOD_ERROR[split.axis]:
            continue
        share = f"{100 * split.by_rotors:.0f} %" if split.by_rotors > 0.0 else "nothing"
        words.append(
            f"{split.axis}: the rotors explain {share} of the moment in this flight. "
            f"{_explain_cause(split.steady, split.with_motion, of='the rest')}"
        )
    return words


def horizon(replays: Sequence[Replay], share: float) -> Float[np.ndarray, " 3"]:
    """Compute how long the rates stay within a share of what was flown, per axis [s]."""
    flown = np.concatenate([replay.rates.reshape(-1, 3) for replay in replays])
    limit = share * np.sqrt((flown**2).mean(axis=0))
    time = growth_time(replays)
    late = error_growth(replays, IDENTIFIED) > limit
    first = np.where(late.any(axis=0), late.argmax(axis=0), len(time) - 1)
    return time[np.where(late.any(axis=0), np.maximum(first - 1, 0), first)]


def identified_over_held(replays: Sequence[Replay]) -> Float[np.ndarray, " 3"]:
    """Compute the error of the rates after a window over that of constant rates, per axis."""
    held = np.maximum(error_growth(replays, HOLD)[-1], np.finfo(float).tiny)
    return error_growth(replays, IDENTIFIED)[-1] / held


def over_band(replays: Sequence[Replay]) -> Float[np.ndarray, " 3"]:
    """Compute the error of the rates at the end of a window over the 95 % band, per axis.

    Infinite without draws.
    """
    with np.errstate(divide="ignore"):
        ratio: Float[np.ndarray, " 3"] = (
            error_growth(replays, IDENTIFIED)[-1] / band_growth(replays, IDENTIFIED)[-1]
        )
    return ratio


def error_parts(replays: Sequence[Replay]) -> list[tuple[float, float]]:
    """Compute the shares of the errors' power at the end of windows, steady and with the motion.

    Per axis; with the motion: in proportion to the change that was predicted.
    """
    end = np.concatenate([r.predicted[0].rates[:, -1] for r in replays])
    error = end - np.concatenate([r.rates[:, -1] for r in replays])
    change = end - np.concatenate([r.rates[:, 0] for r in replays])
    return _error_parts(error, change)


def _error_parts(
    error: Float[np.ndarray, "n a"], change: Float[np.ndarray, "n a"]
) -> list[tuple[float, float]]:
    """Compute the shares of the errors' power, steady and in proportion to a change."""
    tiny = np.finfo(float).tiny
    power, mean = np.maximum((error**2).mean(axis=0), tiny), error.mean(axis=0)
    moved = change - change.mean(axis=0)
    along = (error * moved).mean(axis=0) ** 2 / np.maximum((moved**2).mean(axis=0), tiny)
    return list(zip((mean**2 / power).tolist(), (along / power).tolist(), strict=True))
