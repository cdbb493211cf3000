"""Parameters that the flights do not separate, axes that hardly moved, the place of the IMU.

The information of the fit about rotors and bodies (biases and differences between rotors removed)
with every parameter scaled to unit information: its eigenvectors are combinations of parameters,
and the root of largest over smallest eigenvalue is the condition number of column-scaled equations.
10 and less is good; 255 is one axis flown at a time.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.checks.verdicts.judge import ADVICE, motion_for
from rotorfit.checks.verdicts.parameters import joint_parameters
from rotorfit.findings import Evidence, Finding, doubt_or_passed, note
from rotorfit.fit.experiment.payload import MOMENTS
from rotorfit.fit.intervals.numbers import LEAST_EXCITATION, Numbers
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.sheet import listed

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence, Set

    from jaxtyping import Float

    from rotorfit.estimation.estimate import Estimate
    from rotorfit.fit.fit import Fit
    from rotorfit.model.vehicle import Vehicle

ROTORS = ("kt", "kd", "Jr")
GOOD, FAIR, ONE_AXIS = 10.0, 30.0, 255.0
"""Condition numbers: nothing to wish for; usable; what one axis flown at a time gives."""
SHARE = 0.3
"""Parameters with less of a direction than this share of its largest are not named in it."""
ORIGIN_IS_IMU = (
    "no IMU position is given: the origin is the IMU, CoM and rotor centre are measured from it, "
    "and com_z is the height of the CoM over it; inertia about the CoM does not depend on that "
    "choice"
)
SAME = 0.2
"""Relative changes that differ by less are one factor: only the ratio is known."""


@frozen_dataclass
class WeakDirection:
    """A combination of parameters.

    - `strength`: its information, relative to the best known combination.
    - `parts`: its parameters, the largest first, and by what share of its value each changes.
    """

    strength: float
    parts: dict[str, float]

    @property
    def is_ratio(self) -> bool:
        """Whether all parts change by one factor, so that their ratios are known all the same."""
        changes = np.array(list(self.parts.values()))
        return len(changes) > 1 and bool(np.ptp(changes) < SAME * np.abs(changes).max())


def weak_directions(fit: Fit) -> Iterator[Finding]:
    """Check whether the flights separate the parameters of rotors and bodies."""
    directions = body_directions(fit.estimate.estimate)
    parameters = joint_parameters(fit)
    # What a step has withheld has its own words, and no flying would show it.
    doubtful = {
        p.full_name for p in parameters if p.verdict not in ("identified", "given")
    } - fit.withheld
    sentence = weak_sentence(
        directions,
        doubtful,
        lost={p.full_name for p in parameters if p.verdict == "not-identified"},
        several=len(fit.dataset.configurations) > 1,
    )
    yield doubt_or_passed(
        "weak-direction",
        sentence,
        {"condition_bodies": condition_number(directions)},
        numbers=tuple(directions[0].parts),
        next_step=ADVICE[motion_for(next(iter(directions[0].parts)).partition("@")[0])],
    )


def body_directions(estimate: Estimate) -> tuple[WeakDirection, ...]:
    """List all combinations of rotor and body parameters, the weakest first."""
    places = [i for i, n in enumerate(estimate.names) if n.partition("@")[0] in ROTORS + MOMENTS]
    information = _invert_scaled(estimate.covariance[np.ix_(places, places)])
    length = np.sqrt(np.diagonal(information))
    values, vectors = np.linalg.eigh(information / np.outer(length, length))
    root = np.sqrt(np.maximum(values, 0.0))
    known = estimate.values[places]
    size = np.where(known == 0.0, 1.0, known)
    return tuple(
        _weak_direction(strength, v, v / length / size, [estimate.names[i] for i in places])
        for strength, v in zip((root / root[-1]).tolist(), vectors.T, strict=True)
    )


def _invert_scaled(covariance: Float[np.ndarray, "q q"]) -> Float[np.ndarray, "q q"]:
    """Return the inverse of a covariance, scaled on the way: its units are far apart."""
    std = np.sqrt(np.diagonal(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(std, std))
    # Below rounding of the largest, an eigenvalue is not known: what it stands for is known best.
    values = np.maximum(values, np.finfo(float).eps * values[-1])
    return (vectors / values) @ vectors.T / np.outer(std, std)


def _weak_direction(
    strength: float,
    v: Float[np.ndarray, " q"],
    change: Float[np.ndarray, " q"],
    names: Sequence[str],
) -> WeakDirection:
    order = [int(i) for i in np.argsort(-np.abs(v)) if abs(v[i]) > SHARE * np.abs(v).max()]
    return WeakDirection(strength=strength, parts={names[i]: float(change[i]) for i in order})


def condition_number(directions: Sequence[WeakDirection]) -> float:
    """Compute the best known combination over the worst, limited by rounding."""
    return 1.0 / max(directions[0].strength, np.finfo(float).eps)


def condition_words(condition: float) -> str:
    """Describe a condition number in words."""
    if condition <= GOOD:
        return "good"
    if condition <= FAIR:
        return "fair"
    return "poor" if condition < ONE_AXIS else "as poor as one axis flown at a time"


def weak_sentence(
    directions: Sequence[WeakDirection],
    doubtful: Collection[str],
    *,
    lost: Set[str] = frozenset(),
    several: bool = True,
) -> str | None:
    """Explain which parameters the flights do not separate; None if they separate all.

    `directions`: of the estimate, the weakest first. `doubtful`: full names of parameters whose
    verdict is not ``identified``: a weak combination that harms no verdict needs no words. `lost`:
    full names of parameters without a number: of fewer than two others nothing is to be said.
    `several`: whether the vehicle has several configurations, of which one is to be named.
    """
    weakest, condition = directions[0], condition_number(directions)
    if condition <= FAIR or not doubtful & weakest.parts.keys():
        return None
    if len(weakest.parts.keys() - lost) < 2:
        return None
    owner = r" of \1" if several else ""
    names = [re.sub("@(.*)", owner, name) for name in weakest.parts]
    what = "are known only as a ratio" if weakest.is_ratio else "are known only together"
    return (
        f"{listed(names)} {what} (condition number {condition:.0f}: {condition_words(condition)}; "
        f"{GOOD:.0f} and less is good)"
    )


def little_excitation(fit: Fit) -> Iterator[Finding]:
    """Note the axes that a pilot moved little."""
    several = len(fit.configurations) > 1
    return excitation_findings(fit.numbers, several=several)


def excitation_findings(numbers: Numbers, *, several: bool = False) -> Iterator[Finding]:
    """Note the axes with little excitation; of `several` configurations they are named."""
    for key, rho in numbers.judged.excitation.items():
        axis, _, owner = key.partition("@")
        if LEAST_EXCITATION <= rho < 2.0 * LEAST_EXCITATION:
            where = f" in configuration {owner}" if several else ""
            yield note(
                "little-excitation",
                f"{axis}{where}: signal-to-noise only {rho:.1f}, where {2 * LEAST_EXCITATION:.0f} "
                "is good; the intervals allow for it",
                evidence=(
                    Evidence(name=f"excitation_{key}", value=rho, limit=2.0 * LEAST_EXCITATION),
                ),
                next_step=ADVICE[axis],
            )


def unknown_origin(fit: Fit) -> Iterator[Finding]:
    """Note that the IMU is the origin, where its position is unknown."""
    return origin_findings(fit.dataset.vehicle)


def origin_findings(vehicle: Vehicle) -> Iterator[Finding]:
    """Note that the IMU is the origin, where its position is unknown."""
    if vehicle.imu_position is None:
        yield note("origin", ORIGIN_IS_IMU)
