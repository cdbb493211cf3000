"""Fit the flights with other spins than the declared ones, and find what drags each rotor.

Each rotor gets a drag torque of its own beside the fit, whose model knows what else turns the body
about z: products of inertia, a centre of mass that is off the centre, rotors with unlike thrust,
the motors' timing, the autopilot's response to gusts. Where all are as declared, these are alike;
one that turns the other way has the other sign. Which patterns of them are identifiable, their
covariance says: a hexarotor's rotors fly four of the six.

A fit with a wrong spin lacks the spin-up of that rotor, too, and may show nothing. So the flights
are fitted with the spins that are suspected.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.fit.additional_parameters import (
    Added,
    Additional,
    estimate_additional,
    gained,
    inside,
    log_likelihood_loss,
)
from rotorfit.fit.alternatives.yaw_residuals import (
    plausible_patterns,
    smaller_yaw_residuals,
    with_spins,
)
from rotorfit.fit.coupling import without_coupling
from rotorfit.fit.intervals.excitation import excitation
from rotorfit.fit.intervals.numbers import LEAST_EXCITATION
from rotorfit.fit.joint.joint_fit import joint_fit
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.rotors import rotor_torque

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float

    from rotorfit.estimation.banded import BandedEstimate
    from rotorfit.fit.alternatives.yaw_residuals import Pattern
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.joint.joint_problem import JointConfiguration
    from rotorfit.fit.timing.timed_dataset import TimedDataset

UNLIKE: Final = 0.15
"""Deviation of the drag torques of one vehicle's rotors, as a share of them: k_t differs by up
to a tenth, and the drag of a worn propeller by more."""
DRAG_STD: Final = 0.3
"""Prior deviation of k_d over k_t and the arm; vehicles have 0.03 to 0.2."""
SUSPECTED: Final = float(np.log(100.0))
"""Log of how many times likelier other spins must be than the declared ones, over the number of
rotors. One declaration in a hundred is wrong, in any of the rotors: from the first on it is more
likely wrong than right."""
REFUSED: Final = float(np.log(1e4))
"""The same from which the declared ones are refused."""
CLEARLY: Final = 1.0
"""The same by which drag alone must prefer them: the rest may come from the rotors' spin-up."""
FEW: Final = 4
"""Patterns that are tried because single drags do not speak against them."""
MOST_OF_A_GAIN: Final = 1.5
"""Largest share of a gain of log-likelihood that counts, of at least two effective blocks."""
ROUNDS: Final = 10
"""Rounds of the search for the mean drag torque of a pattern."""


@frozen_dataclass
class RotorDrags:
    """The drag torque of each rotor over its squared speed, positive where it spins as declared.

    - `values`, `covariance`: [N m s^2/rad^2]
    - `blocks`: the effective number of independent ones.
    """

    values: Float[np.ndarray, " N"]
    covariance: Float[np.ndarray, "N N"]
    blocks: float

    def distance(self, pattern: Pattern) -> tuple[float, float]:
        """Return the squared distance from rotors alike that spin so, and their mean drag."""
        strength, Q = np.linalg.eigh(self.covariance)
        p, k = Q.T @ pattern, Q.T @ self.values
        least = 1e-3 * float(np.abs(self.values).mean())
        mean = max(float(pattern @ self.values) / len(pattern), least)
        weight = np.ones(len(pattern))
        for _ in range(ROUNDS):
            weight = 1.0 / (np.maximum(strength, 0.0) + (UNLIKE * mean) ** 2)
            mean = max(float((p * weight) @ k / ((p * weight) @ p)), least)
        return float(weight @ (k - mean * p) ** 2), mean

    def against(self, pattern: Pattern) -> float:
        """Compute the log of how much less likely a pattern is than one that fits exactly."""
        return log_likelihood_loss(self.distance(pattern)[0], self.blocks, len(self.values))

    def holds(self, pattern: Pattern) -> bool:
        """Return whether rotors alike that spin so are as near as chance brings them."""
        return inside(self.distance(pattern)[0], self.blocks, len(self.values))

    def speaks_for(self, pattern: Pattern, other: Pattern) -> bool:
        """Return whether one pattern holds, and is likelier than another."""
        return self.holds(pattern) and self.against(other) > self.against(pattern) + CLEARLY

    def share(self, reversed_ones: Bool[np.ndarray, " N"]) -> tuple[float, float]:
        """Return the mean drag of some rotors over that of the others, and its deviation."""
        both = np.column_stack([~reversed_ones, reversed_ones]).astype(float)
        mean = self.distance(np.ones(len(self.values)))[1]
        # Rotors of one vehicle differ: a drag is no better known of a group than they are alike.
        allowed = self.covariance + (UNLIKE * mean) ** 2 * np.eye(len(self.values))
        weighed = np.linalg.solve(allowed, both)
        covariance = np.linalg.inv(both.T @ weighed)
        one, other = (covariance @ (weighed.T @ self.values)).tolist()
        # d (other / one) by one and by other.
        slopes = np.array([-other / one, 1.0]) / one
        return other / one, float(np.sqrt(slopes @ covariance @ slopes))


@frozen_dataclass
class LikelierSpins:
    """Other spins that gain over the declared ones.

    - `gain`: of log-likelihood.
    - `drags`: of the rotors in the fit with them.
    - `twins`: others of as many rotors that gain as much.
    """

    gain: float
    pattern: Pattern
    drags: RotorDrags
    twins: tuple[Pattern, ...]


@frozen_dataclass
class SpinEvidence:
    """What yaw says of the declared spins.

    - `drags`: of the rotors with them; None where the flights do not determine those.
    - `likelier`: the likeliest others that hold; None if no such, or the declared ones are sure.
    """

    drags: RotorDrags | None
    likelier: LikelierSpins | None


def compare_spins(fit: Fit) -> Fit:
    """Record what the flights say of other spins than the declared ones."""
    if not fit.dataset.timing_identifiable:
        return fit  # nobody flies: what yaw does is the autopilot's response to gusts and noise
    declared = np.ones(len(fit.dataset.vehicle.rotors))
    drags = _drags_or_none(fit.estimate, fit.configurations)
    likelier = None
    if drags is None or not _declared_surely_right(drags, declared):
        likelier = _find_likeliest_spins(fit, _suspected_patterns(fit, drags))
    return fit.with_record(SpinEvidence(drags=drags, likelier=likelier))


def _find_likeliest_spins(fit: Fit, suspects: Sequence[Pattern]) -> LikelierSpins | None:
    """Find the suspected spins that gain most over the declared ones, and hold; None if no such."""
    declared = np.ones(len(fit.dataset.vehicle.rotors))
    # Fitted the same way: every fit selects its bands anew.
    as_declared = _fitted_with(fit, declared) if suspects else None
    if as_declared is None:
        return None
    likelier: list[tuple[float, Pattern, SpinFit]] = []
    for pattern in suspects:
        found = _fitted_with(fit, pattern)
        if found is None:
            continue
        gain = min(
            gained(fit.estimate, found.estimate), gained(as_declared.estimate, found.estimate)
        )
        if MOST_OF_A_GAIN * gain > SUSPECTED:  # less can decide nothing: no drags are needed
            likelier.append((gain, pattern, found))
    for gain, pattern, found in sorted(likelier, key=lambda one: -one[0]):
        drags = _drags_or_none(found.estimate, found.configurations)
        if drags is not None and drags.speaks_for(declared, pattern):
            # Of two rotors on one axis at one speed no flight shows which it is: all others of as
            # many rotors that gain as much are named, too.
            twins = tuple(
                other
                for least, other, _ in likelier
                if least > gain - SUSPECTED
                and other.sum() == pattern.sum()
                and other is not pattern
            )
            return LikelierSpins(gain=gain, pattern=pattern, drags=drags, twins=twins)
    return None


def rotor_drags(fit: BandedEstimate, configurations: Sequence[JointConfiguration]) -> RotorDrags:
    """Estimate a drag torque of each rotor, additional to the yaw of a fit.

    Raises `EstimationError` if the flights do not determine them.
    """
    vehicle, layout = configurations[0].vehicle, configurations[0].model.layout
    at = fit.estimate.by_name
    whole = rotor_torque(vehicle, layout)["kd"]
    added: list[Added] = []
    for i in range(len(vehicle.rotors)):
        own = np.zeros_like(whole)
        column = layout.index(f"O2_{i + 1}")
        own[:, column] = whole[:, column]
        prior = DRAG_STD * abs(at["kt"]) * vehicle.arm
        added.append(
            Added(name=f"kd_{i + 1}", entries=own, times=None, prior=prior, begin=at["kd"])
        )
    found: Additional = estimate_additional(fit, configurations, added, instead_of=("kd",))
    if not np.isfinite(found.covariance).all():
        raise EstimationError("the flights do not determine a drag torque of each rotor")
    return RotorDrags(values=found.values, covariance=found.covariance, blocks=found.blocks)


def _drags_or_none(
    fit: BandedEstimate, configurations: Sequence[JointConfiguration]
) -> RotorDrags | None:
    try:
        return rotor_drags(fit, configurations)
    except EstimationError:
        return None


def _declared_surely_right(drags: RotorDrags, declared: Pattern) -> bool:
    """Test whether equal rotors that spin as declared are far likelier than any other pattern."""
    own = drags.against(declared)
    others = (drags.against(p) for p in other_patterns(len(declared)))
    return drags.holds(declared) and min(others) - own > REFUSED


def other_patterns(rotors: int) -> list[Pattern]:
    """List the patterns with one or two rotors reversed, their reverses, and all reversed."""
    patterns = [-np.ones(rotors)]
    for count in (1, 2):
        for which in combinations(range(rotors), count):
            pattern = np.ones(rotors)
            pattern[list(which)] = -1.0
            patterns += [pattern, -pattern]
    return patterns


def _suspected_patterns(fit: Fit, drags: RotorDrags | None) -> list[Pattern]:
    """List patterns that may be the right one, each once, the likeliest first."""
    vehicle = fit.dataset.vehicle
    bands = fit.dataset.yaw_bands()
    suspects, others = smaller_yaw_residuals(vehicle, bands)[::-1], []
    if drags is not None:
        others = sorted(other_patterns(len(vehicle.rotors)), key=drags.against)
        declared = np.ones(len(vehicle.rotors))
        if drags.holds(declared):
            # Where the declared spins hold, only patterns that single drags do not speak against;
            # else every one of one or two rotors.
            least = drags.against(declared) + SUSPECTED
            others = [p for p in others[:FEW] if drags.against(p) < least]
        others = plausible_patterns(vehicle, bands, others)
    return list({tuple(pattern.tolist()): pattern for pattern in (*suspects, *others)}.values())


@frozen_dataclass
class SpinFit:
    """A fit of the flights with other spins."""

    estimate: BandedEstimate
    configurations: Sequence[JointConfiguration]


def _fitted_with(fit: Fit, pattern: Pattern) -> SpinFit | None:
    """Fit the flights with other spins; None if that comes to no end."""
    dataset = fit.dataset
    vehicle = with_spins(dataset.vehicle, pattern)
    model = regressor(vehicle, added=dataset.model.layout.added)
    if not fit.coupled:
        model = without_coupling(model)
    other: TimedDataset = replace(dataset, vehicle=vehicle, model=model)
    try:
        guess = fit.estimate.estimate.by_name  # near, but for yaw: half the steps of row fits
        estimate, joint = joint_fit(other, terms=fit.terms, known=fit.known, guess=guess)
    except EstimationError:
        return None
    sound = (pattern > 0.0).all() or _yaw_is_flown(estimate, joint)
    return SpinFit(estimate=estimate, configurations=joint) if sound else None


def _yaw_is_flown(fit: BandedEstimate, configurations: Sequence[JointConfiguration]) -> bool:
    """Test whether a pilot turns about z: else yaw is the autopilot's response to gusts."""
    rho = excitation(fit, configurations)
    return any(rho[f"yaw@{c.name}"] > LEAST_EXCITATION for c in configurations)
