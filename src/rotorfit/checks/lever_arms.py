"""Judge the declared sides of the frame by the sides that the flights show.

The step `allow_for_sides` estimates s, by which the rotors are further apart along x and nearer
along y, and widens the intervals by it. Where mistaken sides are five times as likely as before
the flight, a finding says so. Where sides by a ruler are all but excluded, and both axes were
flown, the declaration is refused.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import FrameError
from rotorfit.findings import Evidence, Finding
from rotorfit.fit.frame_sides import FARTHEST, FrameSides, touched_numbers
from rotorfit.fit.intervals.numbers import LEAST_EXCITATION

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rotorfit.fit.fit import Fit

KIND: Final = "lever-arms"
REFUSED: Final = 1e-4
"""Chance that it was measured after all, below which the declaration is refused."""
DOUBTED: Final = 0.91
"""The same, below which it is doubted: a mistake is five times as likely as before the flight. Of
489 random worlds with right sides 2 come to that; what is less likely the intervals hold."""
ALIKE: Final = 0.12
"""Of the logarithm of the ratio, within which it is that of swapped axes, or of a square."""


def frame_sides_shown(fit: Fit) -> Iterator[Finding]:
    """Judge the declared sides of the frame, where a step of the fit has estimated them."""
    sides = fit.record_of(FrameSides)
    if sides is not None and np.isfinite(sides.std):
        yield judge_sides(fit, sides)


def refuse_wrong_sides(fit: Fit) -> Iterator[Finding]:
    """Refuse declared sides of the frame that the flights surely contradict."""
    for one in frame_sides_shown(fit):
        if one.severity == "refusal":
            raise FrameError(one.sentence).about(
                kind=KIND, numbers=one.numbers, evidence=one.evidence
            )
    yield from ()


def judge_sides(fit: Fit, sides: FrameSides) -> Finding:
    """Judge the declared sides of the frame."""
    evidence = Evidence(
        name="lever_ratio",
        value=sides.ratio(sides.value),
        interval=sides.interval,
        limit=sides.declared,
    )
    numbers = touched_numbers(fit)
    found = Finding(kind=KIND, severity="passed", numbers=numbers, evidence=(evidence,))
    if abs(sides.value) > FARTHEST:
        return found
    flown = [rho for name, rho in fit.numbers.excitation.items() if not name.startswith("yaw")]
    if sides.measured < REFUSED and min(flown, default=0.0) > LEAST_EXCITATION:
        return replace(
            found, severity="refusal", sentence=f"{_explain_sides(sides)} and correct them"
        )
    if sides.measured < DOUBTED:
        return replace(
            found,
            severity="doubt",
            sentence=f"{_explain_sides(sides)}; until then do not trust inertia, kd and Jr",
            doubtful_because="the flight shows other distances between the rotors",
            next_step="measure the rotors' distances, front to back and left to right, from motor "
            "to motor, and correct their positions under [airframe]",
        )
    return found


def _explain_sides(sides: FrameSides) -> str:
    """Explain which ratio the flight shows, and why."""
    best, (low, high) = sides.ratio(sides.value), sides.interval
    cause = "the rotors' positions are wrong along one axis"
    if low < 1.0 / sides.declared < high and abs(np.log(sides.declared)) > ALIKE:
        cause = "x and y of the rotors' positions are swapped"
    elif abs(np.log(sides.declared)) < ALIKE:
        cause = "a rectangular frame is declared as a square one"
    return (
        f"the rotors' distances front to back over left to right are {sides.declared:.2f} as "
        f"declared, but the flight shows {best:.2f} ({low:.2f} to {high:.2f}): {cause}; measure "
        "both from motor to motor"
    )


CHECKS: Final = (frame_sides_shown,)
REFUSALS: Final = (refuse_wrong_sides,)
"""These wait: other refusals look for the cause of wrong sides before."""
