"""The reduce step: the flights of a vehicle as one fit, by sums of their normal equations.

Every flight is looked at by itself, at the same numbers: its likelihood is linearised by the code
that a single identification fits with (`estimation/banded_equations.py`), and what it asks for is
added up. So one flight's factors are in memory at a time, however many there are. A few passes lead
to the joint maximum, as `rotorfit identify` finds it from all flights at once, but for three things
that were settled flight by flight: the motors' timing, which every flight keeps for itself; which
bands count, and which optional terms the model has.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.errors import EstimationError
from rotorfit.estimation.banded import resting_inverse
from rotorfit.estimation.banded_equations import corrected_equations, evaluated
from rotorfit.estimation.banded_problem import BandedProblem
from rotorfit.estimation.parameter_map import ParameterMap
from rotorfit.estimation.propagate import numerical_jacobian
from rotorfit.experiment.model_terms import Term
from rotorfit.fit.joint_equations import JointConfiguration, joint_problem
from rotorfit.fit.joint_fit import FittedFactors
from rotorfit.fit.joint_numbers import physical

MOST_PASSES: Final = 20
SMALLEST_STEP: Final = 1e-2
"""The passes end when no number moves by more than this share of its deviation."""
OWN_STEPS: Final = 2
"""Of a flight's own times, at given numbers of the vehicle."""
FEWEST_FLIGHTS: Final = 3
"""Whose scatter tells anything."""
Load = Callable[[], FittedFactors]


@dataclass(frozen=True, slots=True, kw_only=True)
class Joined:
    """What the flights of a vehicle say together.

    Attributes
    ----------
    names, values
        Physical numbers, SI; ``kt``, ``Ixx_com`` and so on.
    std
        By chance: the larger of what the fit says and what the flights scatter. What settings and
        assumptions shift in every flight alike is not in it: the flights' own intervals have that.
    flights
        How many there are.
    passes
        It took.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " q"]
    std: Float[np.ndarray, " q"]
    flights: int
    passes: int

    def number(self, name: str) -> tuple[float, float] | None:
        """Return value and standard deviation of a number; None where it is not told."""
        if name not in self.names:
            return None
        i = self.names.index(name)
        return float(self.values[i]), float(self.std[i])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asked:
    """What a flight asks of the vehicle's free parameters, its own times eliminated."""

    information: Float[np.ndarray, "f f"]
    score: Float[np.ndarray, " f"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Vehicle:
    """The free parameters of a vehicle, and what is known of them before the flights."""

    map: ParameterMap
    configuration: JointConfiguration
    mean: Float[np.ndarray, " f"]
    precision: Float[np.ndarray, " f"]

    @property
    def names(self) -> tuple[str, ...]:
        return self.map.names


def joined(flights: Sequence[Load]) -> Joined:
    """Return the joint fit of a vehicle's flights in one configuration.

    Parameters
    ----------
    flights
        Each loads the factors of one flight when it is called, and is called some times.

    Raises
    ------
    EstimationError
        If the passes do not settle.
    """
    vehicle = _vehicle(flights)
    phi = _first(vehicle, flights)
    for passes in range(1, MOST_PASSES + 1):
        H, scores = np.diag(vehicle.precision), np.zeros((len(flights), len(phi)))
        for i, load in enumerate(flights):
            asked = _asked(vehicle, load(), phi)
            H, scores[i] = H + asked.information, asked.score
        covariance = resting_inverse(H)
        step = covariance @ (scores.sum(axis=0) + vehicle.precision * (vehicle.mean - phi))
        phi = phi + step
        if (np.abs(step) <= SMALLEST_STEP * np.sqrt(np.diagonal(covariance))).all():
            return _finished(vehicle, phi, covariance, scores, passes)
    raise EstimationError(
        f"the joint fit of {len(flights)} flights did not settle in {MOST_PASSES} passes"
    )


def _vehicle(flights: Sequence[Load]) -> _Vehicle:
    """Return the parameters that any of the flights has, but for the flights' own times."""
    terms: dict[Term, None] = {}
    first: JointConfiguration | None = None
    for load in flights:
        fitted = load()
        terms |= dict.fromkeys(fitted.terms)
        first = first or replace(fitted.configurations[0], timing=None)
    assert first is not None
    problem = joint_problem([first], terms=tuple(terms))
    mean, std = problem.prior
    return _Vehicle(map=problem.map, configuration=first, mean=mean, precision=std**-2.0)


def _problem(fitted: FittedFactors) -> BandedProblem:
    """Return the problem of one flight, with what is known of its own times alone."""
    problem = joint_problem(fitted.configurations, terms=fitted.terms)
    own = {name: problem.prior_std[name] for name in problem.moving if name in problem.prior_std}
    return replace(problem, prior_std=own)


def _first(vehicle: _Vehicle, flights: Sequence[Load]) -> Float[np.ndarray, " f"]:
    """Return where the passes begin: the flights' own estimates, each with its information."""
    H, target = np.diag(vehicle.precision), vehicle.precision * vehicle.mean
    for load in flights:
        fitted = load()
        own = np.array([fitted.values.get(name, 0.0) for name in vehicle.names])
        asked = _asked(vehicle, fitted, own)
        H = H + asked.information
        target = target + asked.information @ own + asked.score
    return resting_inverse(H) @ target


def _asked(vehicle: _Vehicle, fitted: FittedFactors, phi: Float[np.ndarray, " f"]) -> _Asked:
    """Return what one flight asks for at the vehicle's `phi`, where its own times fit best."""
    problem = _problem(fitted)
    names = problem.map.names
    known = dict(zip(vehicle.names, phi.tolist(), strict=True))
    at = np.array([known.get(n, fitted.values.get(n, 0.0)) for n in names])
    # Its times, and what only its signals have: drag over a velocity that others log.
    own = [i for i, name in enumerate(names) if name not in known]
    shared = [i for i in range(len(names)) if i not in own]
    for _ in range(OWN_STEPS if own else 0):
        asked = corrected_equations(problem, evaluated(problem, at))
        H = asked.plain - asked.taken
        at[own] += resting_inverse(H[np.ix_(own, own)]) @ asked.score[own]
    asked = corrected_equations(problem, evaluated(problem, at))
    H = asked.plain - asked.taken
    across = H[np.ix_(shared, own)] @ resting_inverse(H[np.ix_(own, own)])
    information, score = np.zeros((len(phi), len(phi))), np.zeros(len(phi))
    places = [vehicle.names.index(names[i]) for i in shared]
    information[np.ix_(places, places)] = (
        H[np.ix_(shared, shared)] - across @ H[np.ix_(own, shared)]
    )
    score[places] = asked.score[shared] - across @ asked.score[own]
    return _Asked(information=information, score=score)


def _finished(
    vehicle: _Vehicle,
    phi: Float[np.ndarray, " f"],
    covariance: Float[np.ndarray, "f f"],
    scores: Float[np.ndarray, "m f"],
    passes: int,
) -> Joined:
    """Return the physical numbers at the maximum, with their deviations."""

    def numbers(at: Float[np.ndarray, " f"]) -> dict[str, float]:
        return physical(at, vehicle.map, [vehicle.configuration])

    found = numbers(phi)
    jacobian = numerical_jacobian(
        lambda at: np.array(list(numbers(at).values())), phi, np.sqrt(np.diagonal(covariance))
    )
    formal = np.einsum("qf,fg,qg->q", jacobian, covariance, jacobian)
    m = len(scores)
    scatter = np.zeros(len(formal))
    if m >= FEWEST_FLIGHTS:
        pulls = scores @ covariance @ jacobian.T
        scatter = m / (m - 1.0) * ((pulls - pulls.mean(axis=0)) ** 2).sum(axis=0)
    return Joined(
        names=tuple(name.partition("@")[0] for name in found),
        values=np.array(list(found.values())),
        std=np.sqrt(np.maximum(formal, scatter)),
        flights=m,
        passes=passes,
    )
