"""Check the declared spins by yaw, where a pilot flies it.

Before the fit `declared_rotors` looks at one flight with the timing that was declared, and at all
axes together: one wrong spin changes little there. After it each rotor gets a drag torque of its
own beside the fit, whose model knows what else turns the body about z: products of inertia, a
centre of mass that is off the centre, rotors with unlike thrust, the motors' timing, the
autopilot's response to gusts. Where all are as declared, these are alike; one that turns the other
way has the other sign. Which patterns of them are identifiable, their covariance says: a
hexarotor's rotors fly four of the six.

A fit with a wrong spin lacks the spin-up of that rotor, too, and may show nothing. So before the
declared spins are refused, the flights are fitted with others: in that fit the others must hold,
and be likelier than the declared ones, and the flights must be far likelier with it, spin-up
and products of inertia included. And what drags a rotor can only turn the body
against it: k_d is positive, and J_r is, unless k_d as found says so.

Also refused are declared rotors that do not explain the motion at the lag that the fit finds.
Before the fit the lag of commanded motors is open, and a declaration that one of several lags
allows is fitted. Of a wrong order that is often the longest, at which no rotors explain much.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.yaw_residuals import (
    plausible_patterns,
    smaller_yaw_residuals,
    with_spins,
)
from rotorfit.digits import with_half
from rotorfit.errors import EstimationError, FrameError
from rotorfit.findings import Evidence, Finding, doubt
from rotorfit.fit.additional_parameters import (
    Added,
    Additional,
    estimate_additional,
    gained,
    inside,
    log_likelihood_loss,
)
from rotorfit.fit.coupling import without_coupling
from rotorfit.fit.dataset.declared_rotors import check_flight
from rotorfit.fit.intervals.excitation import excitation
from rotorfit.fit.intervals.numbers import LEAST_EXCITATION, SCALED, Numbers
from rotorfit.fit.joint.joint_fit import joint_fit
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.rotors import rotor_torque

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from jaxtyping import Bool, Float

    from rotorfit.checks.yaw_residuals import Pattern
    from rotorfit.estimation.banded import BandedEstimate
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.joint.joint_problem import JointConfiguration
    from rotorfit.fit.timing.timed_dataset import TimedDataset
    from rotorfit.flight.motors.motor_model import MotorResponse
    from rotorfit.model.vehicle import Vehicle

    Judged = tuple[float, Pattern, "RotorDrags"]
    """What other spins gain over the declared ones, and the drag torques with them."""

UNLIKE: Final = 0.15
"""Deviation of the drag torques of one vehicle's rotors, as a share of them: k_t differs by up
to a tenth, and the drag of a worn propeller by more."""
DRAG_STD: Final = 0.3
"""Prior deviation of k_d over k_t and the arm; vehicles have 0.03 to 0.2."""
SUSPECTED: Final = float(np.log(100.0))
REFUSED: Final = float(np.log(1e4))
"""Log of how many times likelier other spins must be than the declared ones, over the number of
rotors. One declaration in a hundred is wrong, in any of the rotors: from the first on it is more
likely wrong than right."""
CLEARLY: Final = 1.0
"""The same by which drag alone must prefer them: the rest may come from the rotors' spin-up."""
FEW: Final = 4
"""Patterns that are tried because single drags do not speak against them."""
CERTAIN: Final = 2.0
"""Half-widths by which J_r must be below zero: it may be about zero, and follows the timing."""
REVERSED: Final = "reverse all spins (props out instead of in, or in instead of out)"
MOST_OF_A_GAIN: Final = 1.5
"""Largest share of a gain of log-likelihood that counts, of at least two effective blocks."""
ROUNDS: Final = 10
"""Rounds of the search for the mean drag torque of a pattern."""

KIND: Final = "wrong-spin"


@dataclass(frozen=True, slots=True, kw_only=True)
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
        allowed = self.covariance + (UNLIKE * mean) ** 2 * np.eye(len(self.values))
        weighed = np.linalg.solve(allowed, both)
        covariance = np.linalg.inv(both.T @ weighed)
        one, other = (covariance @ (weighed.T @ self.values)).tolist()
        slopes = np.array([-other / one, 1.0]) / one
        return other / one, float(np.sqrt(slopes @ covariance @ slopes))


def refuse_wrong_spins(fit: Fit) -> Iterator[Finding]:
    """Refuse declared spins that yaw contradicts, or doubt them."""
    if not fit.dataset.timing_identifiable:
        return  # nobody flies: what yaw does is the autopilot's response to gusts and noise
    found = _contradict_spins(fit)
    if found.severity == "refusal":
        raise FrameError(found.sentence).about(kind=found.kind, evidence=found.evidence)
    sentence = negative_drag([c.name for c in fit.configurations], fit.numbers)
    if sentence is not None:
        raise FrameError(sentence).about(kind=KIND)
    yield found


def _contradict_spins(fit: Fit) -> Finding:
    """Compare the declared spins with the drag torques of single rotors."""
    declared = np.ones(len(fit.dataset.vehicle.rotors))
    drags = _drags_or_none(fit.estimate, fit.configurations)
    seen = () if drags is None else _drag_evidence(drags, declared)
    passed = Finding(kind=KIND, severity="passed", evidence=seen)
    if drags is not None and _declared_surely_right(drags, declared):
        return passed
    found = _find_likeliest_pattern(fit, _suspected_patterns(fit, drags))
    if found is None:
        return passed
    (gain, pattern, again), twins = found
    gain = log_likelihood_loss(2.0 * gain, again.blocks) - float(np.log(len(declared)))
    if gain < SUSPECTED:
        return passed
    sentence = _explain_spins(fit.dataset.vehicle, pattern, again, twins)
    evidence = _drag_evidence(again, pattern)
    if gain > REFUSED:
        return Finding(kind=KIND, severity="refusal", sentence=sentence, evidence=evidence)
    numbers = tuple(n for n in fit.numbers.names if n.partition("@")[0] in SCALED)
    return doubt(
        KIND,
        sentence,
        numbers=numbers,
        evidence=evidence,
        doubtful_because="the flights fit other spins better",
        next_step="look which way each rotor turns, seen from above, and correct the spins",
    )


def _find_likeliest_pattern(
    fit: Fit, suspects: Sequence[Pattern]
) -> tuple[Judged, list[Pattern]] | None:
    """Find the suspected spins that gain most over the declared ones, and hold; None if no such.

    With them all others of as many rotors that gain as much: of two on one axis at one speed no
    flight shows which it is.
    """
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
            twins = [
                other
                for least, other, _ in likelier
                if least > gain - SUSPECTED
                and other.sum() == pattern.sum()
                and other is not pattern
            ]
            return (gain, pattern, drags), twins
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
    """List patterns that may be the right one, each once, the likeliest first.

    Those that leave less of yaw by itself, and those that single drags do not speak against; every
    one of one or two rotors where the declared spins do not hold.
    """
    vehicle = fit.dataset.vehicle
    bands = fit.dataset.yaw_bands()
    suspects, others = smaller_yaw_residuals(vehicle, bands)[::-1], []
    if drags is not None:
        others = sorted(other_patterns(len(vehicle.rotors)), key=drags.against)
        declared = np.ones(len(vehicle.rotors))
        if drags.holds(declared):
            least = drags.against(declared) + SUSPECTED
            others = [p for p in others[:FEW] if drags.against(p) < least]
        others = plausible_patterns(vehicle, bands, others)
    return list({tuple(pattern.tolist()): pattern for pattern in (*suspects, *others)}.values())


@dataclass(frozen=True, slots=True, kw_only=True)
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


def _explain_spins(
    declared: Vehicle, pattern: Pattern, again: RotorDrags, twins: Sequence[Pattern]
) -> str:
    """Explain which spins yaw shows, by the drag of those that are declared wrong."""
    wrong = pattern < 0.0
    if wrong.all():
        return (
            "yaw contradicts the declared spins: with every spin reversed (props out instead of "
            "in) every rotor's drag turns the body against it, as it must; correct the spin"
        )
    words = _reversed_words(declared, pattern)
    as_well = "".join(f" (or {_reversed_words(declared, twin)})" for twin in twins)
    share, std = again.share(wrong)
    return (
        f"yaw contradicts the declared spins: with {words}{as_well} the drag torques of all rotors "
        f"are alike; as declared, {'theirs' if wrong.sum() > 1 else 'its own'} would be "
        f"{with_half(-share, 1.96 * std)} times that of the others; correct the spin"
    )


def _reversed_words(declared: Vehicle, pattern: Pattern) -> str:
    """List the rotors that a pattern reverses, with the spin that they then have."""
    other = with_spins(declared, pattern)
    wrong = np.flatnonzero(pattern < 0.0)
    return " and ".join(f"rotor {i + 1} {other.rotors[i].spin}" for i in wrong)


def _drag_evidence(drags: RotorDrags, pattern: Pattern) -> tuple[Evidence, ...]:
    """Return the drag over that of the others of the rotor that contradicts its spin most.

    `pattern`: of the declared spins, as the drags see them.
    """
    wrong = pattern < 0.0
    if wrong.all():
        return ()
    groups = [wrong] if wrong.any() else [one < 0.0 for one in np.eye(len(pattern)) * -1.0]
    shares = [drags.share(group) for group in groups]
    value, std = min(shares, key=lambda one: one[0] / one[1])
    value = -value if wrong.any() else value
    interval = (value - 1.96 * std, value + 1.96 * std)
    return (Evidence(name="least_rotor_drag", value=value, interval=interval, limit=0.0),)


def negative_drag(configurations: Sequence[str], numbers: Numbers) -> str | None:
    """Explain that the propellers turn the other way, where drag is negative; None elsewhere."""
    for name in configurations:
        low, high = numbers.interval(f"kd_over_Izz@{name}")
        if high < 0.0:
            return _reversed_sentence("kd / Izz", name, low, high)
        # Where nobody yaws, an autopilot's response to gusts looks like reversed rotors' spin-up.
        if low + high > 0.0 or not (numbers.rho(f"Jr_over_Izz@{name}") or 0.0) > LEAST_EXCITATION:
            continue
        low, high = numbers.interval(f"Jr_over_Izz@{name}")
        if high + 0.5 * (CERTAIN - 1.0) * (high - low) < 0.0:
            return _reversed_sentence("Jr / Izz", name, low, high)
    return None


def _reversed_sentence(name: str, configuration: str, low: float, high: float) -> str:
    return (
        f"{name} of {configuration} comes out below zero ({low:.3g} to {high:.3g}), which no rotor "
        f"has: the propellers turn the other way than declared: {REVERSED}"
    )


REFUSALS: Final = (refuse_wrong_spins,)


def refuse_at_found_lag(fit: Fit) -> Iterable[Finding]:
    """Refuse rotors that a flight contradicts at every lag in the estimated interval."""
    tried = found_lags(fit)
    if tried and fit.dataset.timing_identifiable:
        for configuration in fit.dataset.configurations:
            for flight in configuration.flights:
                check_flight(flight, fit.dataset.vehicle, tried)
    return ()


def found_lags(fit: Fit) -> list[MotorResponse]:
    """Return the responses of commanded motors with the found lag and the ends of its interval."""
    timing = fit.dataset.motor_timing
    if timing is None or timing.lag_std is None or fit.dataset.motors.speed == "measured":
        return []
    lag, half = timing.response.mean_lag, 1.96 * timing.lag_std
    return [
        dataclasses.replace(timing.response, lag=max(one, 0.0), lag_down=None)
        for one in (lag, lag - half, lag + half)
    ]


ORDER_REFUSALS: Final = (refuse_at_found_lag,)
