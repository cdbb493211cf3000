"""Are the rotors as far apart front to back, over left to right, as declared? The flight tells.

Longer arms all over look like a heavier body; longer ones along x alone do not: turns about two
axes at once, and the centre of mass beside the accelerometer, tie roll and pitch together. So the
likelihood of a flight has a best ratio of the two lever arms, and a rectangular frame declared as a
square one, or with x and y swapped, loses by it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rotorfit.dataset.dataset import Dataset
from rotorfit.errors import EstimationError, FrameError
from rotorfit.estimation.banded import BandedEstimate, banded
from rotorfit.findings import Finding, doubt_or_passed
from rotorfit.fit.fit import Fit
from rotorfit.fit.intervals.excitation import LEAST_EXCITATION
from rotorfit.model.regressor import regressor
from rotorfit.model.vehicle import Vehicle

SAID: Final = 30.0
REFUSED: Final = 50.0
"""Of the log-likelihood, per flight, that the declared ratio loses against the best one. Sound real
logs lost up to 8, simulated flights nothing; a rectangle of 91 by 127 mm declared as a square 53,
with x and y swapped 108."""
CLOSE: Final = 0.1
"""Of a parameter's deviation, at which a trial ends: its likelihood is known to a tenth or two."""
STEP: Final = 0.15
"""Of the logarithm of the ratio, in which it is tried to either side."""
FURTHEST: Final = 0.9
"""Of the same."""
ALIKE: Final = 0.12
"""Of the same, within which a ratio is that of swapped axes, or of a square."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeverRatio:
    """Which ratio of lever arms, front to back over left to right, is likeliest.

    Attributes
    ----------
    declared, best
        The ratios of the rotors' distances.
    lost
        Of the log-likelihood, by the declared one against the best.
    """

    declared: float
    best: float
    lost: float


def lever_ratio(dataset: Dataset, fit: BandedEstimate) -> LeverRatio | None:
    """Find the likeliest ratio of lever arms, with the bands of a fit.

    None where it cannot be tried. The rotors are upright, in two dimensions.
    """
    x, y = np.ptp(dataset.vehicle.positions[:, :2], axis=0).tolist()
    if min(x, y) < 0.05 * max(x, y):
        return None
    try:
        tried = _climbed({0.0: fit}, dataset)
    except EstimationError:
        return None
    heights = {place: one.log_likelihood for place, one in tried.items()}
    best = max(heights, key=lambda place: heights[place])
    return LeverRatio(
        declared=x / y,
        best=x / y * float(np.exp(best)),
        lost=heights[best] - fit.log_likelihood,
    )


def _climbed(tried: dict[float, BandedEstimate], dataset: Dataset) -> dict[float, BandedEstimate]:
    """Fit at steps of the log ratio to either side, as far as the likelihood rises."""
    tried = dict(tried)
    for step in (STEP, -STEP):
        place = 0.0
        while abs(place) < FURTHEST:
            further = round((place + step) / STEP) * STEP
            tried[further] = _at(further, place, dataset, tried[place])
            if tried[further].log_likelihood <= tried[place].log_likelihood:
                break
            place = further
    return tried


def stretched(vehicle: Vehicle, log_ratio: float) -> Vehicle:
    """Move the rotors apart along x and together along y by a log ratio."""
    factor = float(np.exp(0.5 * log_ratio))
    return replace(
        vehicle,
        rotors=tuple(
            replace(r, position=(r.position[0] * factor, r.position[1] / factor, r.position[2]))
            for r in vehicle.rotors
        ),
    )


def _at(place: float, begun: float, dataset: Dataset, fit: BandedEstimate) -> BandedEstimate:
    """Fit with other lever arms, from the end of the fit at `begun`."""
    tensor = regressor(stretched(dataset.vehicle, place), added=dataset.model.layout.added).tensor
    problem = replace(fit.problem, tensors=tuple(tensor for _ in fit.problem.tensors))
    factor = float(np.exp(0.5 * (place - begun)))
    scale = {"Ixx": 1.0 / factor, "Iyy": factor}
    start = [
        value * scale.get(name.partition("@")[0], 1.0)
        for name, value in fit.estimate.by_name.items()
    ]
    return banded(problem, np.array(start), close=CLOSE)


def lever_arms(fit: Fit) -> Iterator[Finding]:
    """Check the declared ratio of lever arms; refuse one that the flights surely contradict."""
    kind = "lever-arms"
    excited = [rho for name, rho in fit.numbers.excitation.items() if not name.startswith("yaw")]
    if min(excited) < LEAST_EXCITATION:
        return  # gusts and drag would choose the ratio
    found = lever_ratio(fit.dataset, fit.estimate)
    if found is None:
        return
    lost = found.lost / sum(len(c.flights) for c in fit.dataset.configurations)
    advice = "measure both from motor to motor"
    if lost > REFUSED:
        raise FrameError(f"{_sentence(found)}; {advice} and correct them").about(kind=kind)
    measured = {"lever_ratio_loss": found.lost, "lever_ratio": found.best}
    sentence = f"{_sentence(found)}; {advice}" if lost > SAID else None
    yield doubt_or_passed(kind, sentence, measured)


def _sentence(found: LeverRatio) -> str:
    """Explain which ratio fits better, and why."""
    cause = "the rotors' positions are wrong along one axis"
    if abs(np.log(found.best * found.declared)) < ALIKE:
        cause = "x and y of the rotors' positions are swapped"
    elif abs(np.log(found.declared)) < ALIKE:
        cause = "a rectangular frame is declared as a square one"
    return (
        f"the rotors' distances front to back over left to right are {found.declared:.2f} as "
        f"declared, but the flight fits far better with {found.best:.2f} (log-likelihood "
        f"+{found.lost:.0f}): {cause}"
    )


CHECKS: Final = (lever_arms,)
