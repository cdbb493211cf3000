"""Check the declared spins by yaw, where a pilot flies it.

Before the fit `declared_rotors` looks at one flight with the timing that was declared, and at all
axes together: one wrong spin changes little there. After it `spin_search` has fitted the flights
with other spins. Before the declared ones are refused, the others must hold in that fit, and be
likelier than the declared ones, and the flights must be far likelier with it, spin-up and products
of inertia included. And what drags a rotor can only turn the body against it: k_d is positive. J_r
is, too, but an autopilot's answer to gusts looks like a negative one, which `impossible_inertia`
doubts.

Also refused are declared rotors that do not explain the motion at the lag that the fit finds.
Before the fit the lag of commanded motors is open, and a declaration that one of several lags
allows is fitted. Of a wrong order that is often the longest, at which no rotors explain much.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.digits import with_half
from rotorfit.errors import FrameError
from rotorfit.findings import Evidence, Finding, doubt
from rotorfit.fit.additional_parameters import log_likelihood_loss
from rotorfit.fit.alternatives.spin_search import REFUSED, SUSPECTED, SpinEvidence
from rotorfit.fit.alternatives.yaw_residuals import with_spins
from rotorfit.fit.dataset.declared_rotors import check_flight
from rotorfit.fit.intervals.numbers import SCALED, Numbers

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rotorfit.fit.alternatives.spin_search import LikelierSpins, RotorDrags
    from rotorfit.fit.alternatives.yaw_residuals import Pattern
    from rotorfit.fit.fit import Fit
    from rotorfit.flight.motors.motor_model import MotorResponse
    from rotorfit.model.vehicle import Vehicle

REVERSED: Final = "reverse all spins (props out instead of in, or in instead of out)"

UPRIGHT: Final = 0.99999
"""Part of an upright rotor's axis along z, from which it is no tilt: a quarter of a degree."""
KIND: Final = "wrong-spin"
BY_SPINS: Final = (*SCALED, "kd_over_Izz", "Jr_over_Izz")
"""Numbers that other spins change."""


def refuse_wrong_spins(fit: Fit) -> Iterator[Finding]:
    """Refuse declared spins that yaw contradicts, or doubt them."""
    seen = fit.record_of(SpinEvidence)
    leans = bool((fit.dataset.vehicle.axes[:, 2] < UPRIGHT).any())
    sentence = negative_drag([c.name for c in fit.configurations], fit.numbers, leans=leans)
    if seen is None:
        # Of a calm flight yaw alone says so, and no other spins were tried.
        if sentence is not None:
            yield _doubt_spins(fit, sentence, because="drag comes out negative, which none is")
        return
    found = _contradict_spins(fit, seen)
    if found.severity == "refusal":
        raise FrameError(found.sentence).about(kind=found.kind, evidence=found.evidence)
    if sentence is not None:
        raise FrameError(sentence).about(kind=KIND)
    yield found


def _contradict_spins(fit: Fit, seen: SpinEvidence) -> Finding:
    """Compare the declared spins with others, and with the drag torques of single rotors."""
    declared = np.ones(len(fit.dataset.vehicle.rotors))
    drags = () if seen.drags is None else _drag_evidence(seen.drags, declared)
    passed = Finding(kind=KIND, severity="passed", evidence=drags)
    other = seen.likelier
    if other is None:
        return passed
    gain = log_likelihood_loss(2.0 * other.gain, other.drags.blocks) - float(np.log(len(declared)))
    if gain < SUSPECTED:
        return passed
    sentence = _explain_spins(fit.dataset.vehicle, other)
    evidence = _drag_evidence(other.drags, other.pattern)
    if gain > REFUSED:
        return Finding(kind=KIND, severity="refusal", sentence=sentence, evidence=evidence)
    found = _doubt_spins(fit, sentence, because="the flights fit other spins better")
    return dataclasses.replace(found, evidence=evidence)


def _doubt_spins(fit: Fit, sentence: str, *, because: str) -> Finding:
    return doubt(
        KIND,
        sentence,
        numbers=tuple(n for n in fit.numbers.names if n.partition("@")[0] in BY_SPINS),
        doubtful_because=because,
        next_step="look which way each rotor turns, seen from above, and correct the spins",
    )


def _explain_spins(declared: Vehicle, other: LikelierSpins) -> str:
    """Explain which spins yaw shows, by the drag of those that are declared wrong."""
    wrong = other.pattern < 0.0
    if wrong.all():
        return (
            "yaw contradicts the declared spins: with every spin reversed (props out instead of "
            "in) every rotor's drag turns the body against it, as it must; correct the spin"
        )
    words = _reversed_words(declared, other.pattern)
    as_well = "".join(f" (or {_reversed_words(declared, twin)})" for twin in other.twins)
    share, std = other.drags.share(wrong)
    return (
        f"yaw contradicts the declared spins: with {words}{as_well} the drag torques of all rotors "
        f"are alike; as declared, {'theirs' if wrong.sum() > 1 else 'its own'} would be "
        f"{with_half(-share, 1.96 * std)} times that of the others; correct the spin"
    )


def _reversed_words(declared: Vehicle, pattern: Pattern) -> str:
    """List the rotors that a pattern reverses, with the spin that they then have."""
    right = with_spins(declared, pattern)
    wrong = np.flatnonzero(pattern < 0.0)
    return " and ".join(f"rotor {i + 1} {right.rotors[i].spin}" for i in wrong)


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


def negative_drag(
    configurations: Sequence[str], numbers: Numbers, *, leans: bool = False
) -> str | None:
    """Explain that the propellers turn the other way, where drag is negative; None elsewhere.

    `leans`: whether rotors are declared with a tilted axis, whose thrust turns about z, too.
    """
    tilt = ", or the rotors' axes are tilted less than declared" if leans else ""
    for name in configurations:
        low, high = numbers.interval(f"kd_over_Izz@{name}")
        if high < 0.0:
            return (
                f"kd / Izz of {name} comes out below zero ({low:.3g} to {high:.3g}), which no "
                f"rotor has: the propellers turn the other way than declared: {REVERSED}{tilt}"
            )
    return None


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
