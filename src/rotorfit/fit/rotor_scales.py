r"""Widen intervals where one rotor's speed may have another scale than the others'.

A speed that reads :math:`1 + x` times the true one makes its rotor's thrust coefficient look
:math:`(1 + x)^{-2}` times as large, and an unlike propeller does the same: no flight tells the two
apart. k_t is the mean over all rotors, right for the propeller and wrong for the speed; so are k_d,
J_r and the twist.

What the flights say is weighed against how vehicles are. Their rotors differ by a few percent, by
how much the others of the vehicle tell; one log in fifty has a speed on another scale. Where the
log has commands beside measured speeds, a speed on another scale is also another speed at the same
command, but for how motors differ. With these explanations as the prior, what holds 95 % of the
posterior of each number about its value goes into its interval: nothing where the wrong scale is
unlikely, the whole shift where it is not.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.distributions import normal_density
from rotorfit.fit.dataset.dataset import with_prepared
from rotorfit.fit.fit import shift_of
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.terms.rotors import ROTOR_SPREAD_STD

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Int

    from rotorfit.fit.dataset.dataset import Dataset
    from rotorfit.fit.fit import Fit
    from rotorfit.flight.prepare import PreparedFlight

MISTAKES: Final = 0.02
"""Share of logs with one speed on another scale: as of mistaken frames (`frame_sides`)."""
SCALE_STD: Final = 0.08
"""Deviation of such a scale from 1: calibrations, divisors, another number of poles (.17)."""
SPREADS: Final = np.geomspace(0.003, 0.06, 6)
"""Deviations of rotors' thrust coefficients from their mean, one of which a vehicle has: eleven
flights of a 3-inch quadrotor agree that one of its rotors makes 10 % less, at a right speed."""
MOTOR_STD: Final = 0.02
"""Deviation of motors' speeds at the same command: 1.2 % on a 3-inch quadrotor, .7 to 3 % on two
Crazyflies."""
INFORMATIVE: Final = 0.5
"""Share of the prior variance of a difference between rotors, under which the flights show it."""
UNLIKELY: Final = 0.05
"""Chance of a wrong scale up to which 95 % of the posterior are the numbers as they are."""
NEGLIGIBLE: Final = 0.005
"""Chance of a wrong scale of one rotor that is left out."""
HELD_TO: Final = 1e-4
"""Share of itself to which k_t is held in a fit with another scale."""
_STEPS: Final = np.linspace(-3.0, 3.0, 25)


@frozen_dataclass
class ScaleOdds:
    """Explanations of how the rotors differ, each with its chance.

    - `chance`: of each explanation; they add up to 1.
    - `rotor`: whose speed has another scale, from 0; -1 for none.
    - `mean`, `std`: of the share by which that makes its thrust coefficient look larger.
    """

    chance: Float[np.ndarray, " h"]
    rotor: Int[np.ndarray, " h"]
    mean: Float[np.ndarray, " h"]
    std: Float[np.ndarray, " h"]

    def chance_of(self, rotor: int) -> float:
        """Return the chance that this rotor's speed has another scale; -1: that none has."""
        return float(self.chance[self.rotor == rotor].sum())

    def excess_of(self, rotor: int) -> float:
        """Return the mean share by which that makes its thrust coefficient look larger."""
        own = self.rotor == rotor
        return float(np.average(self.mean[own], weights=self.chance[own]))


def allow_for_rotor_scale(fit: Fit) -> Fit:
    """Append what a wrong scale of one rotor's speed leaves open of every number."""
    odds = scale_odds(fit)
    if odds is None or odds.chance_of(-1) >= 1.0 - UNLIKELY:
        return fit
    count = len(fit.dataset.vehicle.rotors)
    likely = [i for i in range(count) if odds.chance_of(i) > NEGLIGIBLE]
    slopes = np.zeros((count, len(fit.numbers.names)))
    for rotor in likely:
        slopes[rotor] = _slopes_by_scale(fit, rotor, odds.excess_of(rotor))
    term = IntervalTerm(
        name="rotor speed scale",
        half_width=posterior_half_widths(odds, slopes),
        source="each rotor's thrust at its speed against the others'",
    )
    return fit.with_terms(term)


def scale_odds(fit: Fit) -> ScaleOdds | None:
    """Weigh how the rotors of a fit differ; None where the flights do not show it."""
    numbers, rotors = fit.numbers, fit.dataset.vehicle.rotors
    names = [f"kt_{i + 1}" for i in range(len(rotors))]
    if not set(names) <= set(numbers.names) or any(r.group is not None for r in rotors):
        return None
    kt = np.array([numbers.number(name)[0] for name in names])
    mean = float(kt.mean())
    if not mean > 0.0:
        return None
    covariance = numbers.covariance(names) / mean**2
    return weigh_scales(kt / mean - 1.0, covariance, speeds_at_command(fit.dataset))


def weigh_scales(
    differences: Float[np.ndarray, " N"],
    covariance: Float[np.ndarray, "N N"],
    speeds: Float[np.ndarray, " N"] | None,
) -> ScaleOdds | None:
    """Compute the chance of every explanation; None where nothing shows the rotors' differences.

    - `differences`, `covariance`: of the rotors' thrust coefficients, by the fit with its prior.
    - `speeds`: share by which each measured speed is above the others' at the same command.
    """
    rows, seen, variance = _seen_differences(differences, covariance)
    if not len(seen):
        return None
    by_command = np.zeros(0)
    if speeds is not None:
        contrasts = _contrasts(len(speeds))
        # Thrust goes with the square of the speed: an excess of a comes from a speed of -a / 2.
        rows = np.vstack([rows, -0.5 * contrasts])
        seen = np.concatenate([seen, contrasts @ speeds])
        by_command = np.full(len(contrasts), MOTOR_STD**2)
    found: list[tuple[float, int, float, float]] = []
    for spread in SPREADS:
        known = np.diag(np.concatenate([variance + spread**2, by_command]))
        for rotor in range(-1, len(differences)):
            row = np.zeros(len(seen)) if rotor < 0 else rows[:, rotor]
            share = 1.0 - MISTAKES if rotor < 0 else MISTAKES / len(differences)
            log, mean, std = _explain(seen, known, row)
            found.append((np.log(share) + log, rotor, mean, std))
    log, rotor, mean, std = (np.array(column) for column in zip(*found, strict=True))
    chance = np.exp(log - log.max())
    return ScaleOdds(chance=chance / chance.sum(), rotor=rotor, mean=mean, std=std)


def _explain(
    seen: Float[np.ndarray, " c"], known: Float[np.ndarray, "c c"], row: Float[np.ndarray, " c"]
) -> tuple[float, float, float]:
    """Return the log-likelihood of one explanation, and mean and deviation of the excess in it."""
    before = 2.0 * SCALE_STD
    whole = known + before**2 * np.outer(row, row)
    solved = np.linalg.solve(whole, np.column_stack([seen, row]))
    log = -0.5 * float(seen @ solved[:, 0] + np.linalg.slogdet(whole)[1])
    left = 1.0 - before**2 * float(row @ solved[:, 1])
    return log, before**2 * float(row @ solved[:, 0]), before * float(np.sqrt(max(left, 0.0)))


def _seen_differences(
    differences: Float[np.ndarray, " N"], covariance: Float[np.ndarray, "N N"]
) -> tuple[Float[np.ndarray, "k N"], Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return the independent differences that the flights show, without the prior of the fit.

    Each as a row over the rotors, with its value and its variance.
    """
    contrasts = _contrasts(len(differences))
    variance, axes = np.linalg.eigh(contrasts @ covariance @ contrasts.T)
    rows = axes.T @ contrasts
    shown: Bool[np.ndarray, " k"] = variance < INFORMATIVE * ROTOR_SPREAD_STD**2
    rows, variance = rows[shown], np.maximum(variance[shown], np.finfo(float).tiny)
    alone = 1.0 / (1.0 / variance - ROTOR_SPREAD_STD**-2)
    return rows, (rows @ differences) * alone / variance, alone


def _contrasts(count: int) -> Float[np.ndarray, "k N"]:
    """Return orthonormal differences between rotors: what all have in common is none."""
    return np.linalg.svd(np.eye(count) - 1.0 / count)[2][: count - 1]


def speeds_at_command(dataset: Dataset) -> Float[np.ndarray, " N"] | None:
    """Return the share by which each measured speed is above the mean at the same command."""
    if dataset.motors.speed != "measured":
        return None
    found: list[list[float]] = []
    for flight in dataset.flights:
        rotors = () if flight.telemetry is None else flight.telemetry.rotors
        ratios = [one.ratio for one in rotors if one.ratio is not None]
        if len(ratios) == len(dataset.vehicle.rotors):
            found.append(ratios)
    if not found:
        return None
    mean = np.mean(found, axis=0)
    return mean / mean.mean() - 1.0


def posterior_half_widths(
    odds: ScaleOdds, slopes: Float[np.ndarray, "N q"]
) -> Float[np.ndarray, " q"]:
    """Return half-widths about the numbers that hold 95 % of their posterior.

    `slopes`: of the numbers by the excess of each rotor.
    """
    none = odds.rotor < 0
    steps = normal_density(_STEPS)
    weights = np.outer(odds.chance[~none], steps / steps.sum()).ravel()
    excess = np.abs(odds.mean[~none, None] + odds.std[~none, None] * _STEPS)
    rotor = odds.rotor[~none]
    out = np.zeros(slopes.shape[1])
    for i, slope in enumerate(np.abs(slopes.T)):
        off = (slope[rotor, None] * excess).ravel()
        order = np.argsort(off, kind="stable")
        within = odds.chance[none].sum() + np.cumsum(weights[order])
        out[i] = off[order][min(int(np.searchsorted(within, 0.95)), len(off) - 1)]
    return out


def _slopes_by_scale(fit: Fit, rotor: int, excess: float) -> Float[np.ndarray, " q"]:
    """Compute the slopes of the numbers by a rotor's excess, by a fit with its speed corrected."""
    count = len(fit.dataset.vehicle.rotors)
    factor: Float[np.ndarray, " N"] = np.ones(count)
    factor[rotor] += np.sqrt(1.0 + excess) - 1.0
    dataset = with_prepared(fit.dataset, lambda prepared: _scale_speeds(prepared, factor))
    kt, own = (fit.numbers.number(name)[0] for name in ("kt", f"kt_{rotor + 1}"))
    # The flights show each rotor's thrust: with larger squares its coefficient is smaller.
    moved = kt + own * (1.0 / (1.0 + excess) - 1.0) / count
    known = dict(fit.known)
    if "kt" in known:
        known["kt"] = (moved, HELD_TO * moved)
    begin = {**fit.estimate.estimate.by_name, "kt": moved}
    return shift_of(fit, dataset, begin=begin, known=known) / excess


def _scale_speeds(prepared: PreparedFlight, factor: Float[np.ndarray, " N"]) -> PreparedFlight:
    data = prepared.data
    scaled = replace(
        data,
        rotor_speed=data.rotor_speed * factor,
        rotor_acceleration=data.rotor_acceleration * factor,
    )
    return replace(prepared, data=scaled, motor_channel=prepared.motor_channel * factor)
