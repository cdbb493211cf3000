"""The reduce step: the flights of a vehicle as one fit, by sums of their normal equations.

Every flight is looked at by itself, at the same numbers: its likelihood is linearised by the code
that a single identification fits with (`estimation/banded_equations.py`), and what it asks for is
added up. So one flight's factors are in memory at a time, however many there are. A few passes lead
to the joint maximum, as `rotorfit identify` finds it from all flights at once, but for three things
that were settled flight by flight: the motors' timing, which every flight keeps for itself; which
bands count, and which optional terms the model has. Each flight has a trim and air of its own,
which are eliminated where it is looked at.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
import scipy.linalg
from jaxtyping import Float

from rotorfit.errors import EstimationError
from rotorfit.estimation.banded import pseudo_inverse
from rotorfit.estimation.banded_equations import corrected_equations, evaluated
from rotorfit.estimation.banded_problem import BandedProblem
from rotorfit.estimation.estimate import Estimate, numerical_jacobian
from rotorfit.estimation.parameter_map import ParameterMap
from rotorfit.fit.intervals.joint_numbers import physical
from rotorfit.fit.joint.informative_bands import Pushes, error_correlation, pushes
from rotorfit.fit.joint.joint_fit import FittedFactors
from rotorfit.fit.joint.joint_problem import JointConfiguration, joint_problem
from rotorfit.fit.joint.trims import OWN, TRIM, UNSEEN, Scatter, scatters

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
    trims: "_Trims"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Trims:
    """What a flight has for itself (`fit/joint/trims.py`), at the vehicle's numbers."""

    values: Float[np.ndarray, " t"]
    covariance: Float[np.ndarray, "t t"]


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
    phi, differ = _first(vehicle, flights), UNSEEN
    flights = _pushed_alike(vehicle, flights, phi)
    for passes in range(1, MOST_PASSES + 1):
        H, scores = np.diag(vehicle.precision), np.zeros((len(flights), len(phi)))
        trims: list[_Trims] = []
        for i, load in enumerate(flights):
            asked = _asked(vehicle, load(), phi, differ)
            H, scores[i] = H + asked.information, asked.score
            trims.append(asked.trims)
        covariance = pseudo_inverse(H)
        step = covariance @ (scores.sum(axis=0) + vehicle.precision * (vehicle.mean - phi))
        phi = phi + step
        if (np.abs(step) <= SMALLEST_STEP * np.sqrt(np.diagonal(covariance))).all():
            if differ is not UNSEEN or len(flights) == 1:
                return _finished(vehicle, phi, covariance, scores, passes)
            differ = _scatter(vehicle, trims)
    raise EstimationError(
        f"the joint fit of {len(flights)} flights did not settle in {MOST_PASSES} passes"
    )


def _vehicle(flights: Sequence[Load]) -> _Vehicle:
    """Return the parameters that any of the flights has, but for the flights' own times."""
    terms: dict[str, None] = {}
    first: JointConfiguration | None = None
    for load in flights:
        fitted = load()
        terms |= dict.fromkeys(fitted.terms)
        first = first or replace(fitted.configurations[0], timing=None)
    assert first is not None
    problem = joint_problem([first], terms=tuple(terms))
    mean, std = problem.prior
    return _Vehicle(map=problem.map, configuration=first, mean=mean, precision=std**-2.0)


def _pushed_alike(
    vehicle: _Vehicle, flights: Sequence[Load], phi: Float[np.ndarray, " f"]
) -> list[Load]:
    """Return the flights with one common place where gusts and drag push, by all of them."""
    found: list[list[Pushes]] = []
    for load in flights:
        fitted = load()
        problem = replace(_problem(fitted, UNSEEN), error_correlation=())
        error = evaluated(problem, _own_first(vehicle, fitted, problem, phi)).residual
        found.append(pushes(fitted.configurations[0], error))
    shares = error_correlation(found, vehicle.configuration.vehicle)

    def alike(load: Load) -> FittedFactors:
        fitted = load()
        one = [replace(c, tied=shares) for c in fitted.configurations]
        return replace(fitted, configurations=tuple(one))

    return [partial(alike, load) for load in flights]


def _own_first(
    vehicle: _Vehicle, fitted: FittedFactors, problem: BandedProblem, phi: Float[np.ndarray, " f"]
) -> Float[np.ndarray, " g"]:
    """Return a flight's free parameters: the vehicle's `phi`, its own as it found them alone."""
    known = dict(zip(vehicle.names, phi.tolist(), strict=True))
    return np.array([known.get(n, fitted.values.get(n, 0.0)) for n in problem.map.names])


def _problem(fitted: FittedFactors, differ: Scatter) -> BandedProblem:
    """Return the problem of one flight, with what is known of its own times and trims alone."""
    one = [replace(c, scatter=differ) for c in fitted.configurations]
    problem = joint_problem(one, terms=fitted.terms, of_many=True)
    own = {n: s for n, s in problem.prior_std.items() if n in problem.moving or n.startswith(TRIM)}
    return replace(problem, prior_std=own)


def _scatter(vehicle: _Vehicle, trims: Sequence[_Trims]) -> Scatter:
    """Return by how much the flights differ, by their trims at the vehicle's numbers."""
    estimate = Estimate(
        names=tuple(f"{TRIM}{own}@{k}" for k in range(len(trims)) for own in OWN),
        values=np.concatenate([one.values for one in trims]),
        covariance=np.asarray(scipy.linalg.block_diag(*(one.covariance for one in trims))),
        condition_number=1.0,
        weak_directions=np.zeros((0, len(OWN) * len(trims))),
        weak_strengths=np.zeros(0),
    )
    c = vehicle.configuration
    moment = c.mass * c.vehicle.arm
    return scatters(estimate, [0] * len(trims), [moment] * len(trims))[0]


def _first(vehicle: _Vehicle, flights: Sequence[Load]) -> Float[np.ndarray, " f"]:
    """Return where the passes begin: the flights' own estimates, each with its information."""
    H, target = np.diag(vehicle.precision), vehicle.precision * vehicle.mean
    for load in flights:
        fitted = load()
        own = np.array([fitted.values.get(name, 0.0) for name in vehicle.names])
        asked = _asked(vehicle, fitted, own, UNSEEN)
        H = H + asked.information
        target = target + asked.information @ own + asked.score
    return pseudo_inverse(H) @ target


def _asked(
    vehicle: _Vehicle, fitted: FittedFactors, phi: Float[np.ndarray, " f"], differ: Scatter
) -> _Asked:
    """Return what one flight asks for at the vehicle's `phi`, where its own numbers fit best."""
    problem = _problem(fitted, differ)
    names = problem.map.names
    at = _own_first(vehicle, fitted, problem, phi)
    # Its times and trims, and what only its signals have: drag over a velocity that others log.
    own = [i for i, name in enumerate(names) if name not in vehicle.names]
    shared = [i for i in range(len(names)) if i not in own]
    for _ in range(OWN_STEPS if own else 0):
        asked = corrected_equations(problem, evaluated(problem, at))
        H = asked.information - asked.noise_information
        at[own] += pseudo_inverse(H[np.ix_(own, own)]) @ asked.score[own]
    asked = corrected_equations(problem, evaluated(problem, at))
    H = asked.information - asked.noise_information
    open_still = pseudo_inverse(H[np.ix_(own, own)])
    across = H[np.ix_(shared, own)] @ open_still
    information, score = np.zeros((len(phi), len(phi))), np.zeros(len(phi))
    places = [vehicle.names.index(names[i]) for i in shared]
    information[np.ix_(places, places)] = (
        H[np.ix_(shared, shared)] - across @ H[np.ix_(own, shared)]
    )
    score[places] = asked.score[shared] - across @ asked.score[own]
    trims = [own.index(names.index(f"{TRIM}{name}@0")) for name in OWN]
    return _Asked(
        information=information,
        score=score,
        trims=_Trims(
            values=at[[own[i] for i in trims]], covariance=open_still[np.ix_(trims, trims)]
        ),
    )


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
