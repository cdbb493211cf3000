"""The reduce step: the flights of a vehicle as one fit, by sums of their normal equations.

Every flight is linearised by itself, at the same numbers, by the code that a single identification
fits with (`estimation/banded_equations.py`), and its equations are added. So one flight's factors
are in memory at a time. A few passes lead to the joint maximum, as `rotorfit identify` finds it
from all flights at once, but for three things that were settled flight by flight: the motors'
timing, which bands count, and which optional terms the model has. The trim and the air of each
flight are eliminated from its equations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np
from threadpoolctl import threadpool_limits

from rotorfit.errors import EstimationError
from rotorfit.estimation.banded import pseudo_inverse
from rotorfit.estimation.banded_equations import corrected_equations, evaluated
from rotorfit.estimation.estimate import Estimate
from rotorfit.fit.intervals.joint_numbers import physical, slopes_of_numbers
from rotorfit.fit.joint.informative_bands import Pushes, error_correlation, pushes
from rotorfit.fit.joint.joint_fit import FittedFactors
from rotorfit.fit.joint.joint_problem import JointConfiguration, joint_problem
from rotorfit.fit.joint.trims import OWN, TRIM, UNSEEN, Scatter, scatters
from rotorfit.fit.row_fits import block_diagonal
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.tools.fleet.one_flight import experiment_of, fitted_factors
from rotorfit.tools.fleet.records import FlightRecord, read_entry

if TYPE_CHECKING:
    from pathlib import Path

    from jaxtyping import Float

    from rotorfit.estimation.banded_problem import BandedProblem
    from rotorfit.estimation.parameter_map import ParameterMap
    from rotorfit.fit.experiment.experiment import Experiment
    from rotorfit.tools.fleet.listing import FlightTask

MOST_PASSES: Final = 20
SMALLEST_STEP: Final = 1e-2
"""The passes end when no number moves by more than this share of its deviation."""
LEAST_KT_STD: Final = 1e-3
"""Deviation to which k_t is held at the mean of the flights', at least, as a share of it: what an
accelerometer's bias at rest leaves open is the same in all of them."""
FLIGHT_STEPS: Final = 2
"""Steps of a flight's own times, at given numbers of the vehicle."""
FEWEST_FOR_SCATTER: Final = 3
"""Flights from which their scatter is taken into the deviations."""
Load = Callable[[], FittedFactors]
LoadedVehicle = tuple[str, str, float | None]
"""Vehicle, configuration and mass: what one row of the table of vehicles is of."""


@frozen_dataclass
class Joined:
    """What the flights of a vehicle say together.

    - `names`, `values`: physical numbers, SI; ``kt``, ``Ixx_com`` and so on.
    - `std`: random: the larger of what the fit says and what the flights scatter. What settings and
      assumptions shift in every flight alike is not in it: the flights' own intervals have that.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " q"]
    std: Float[np.ndarray, " q"]
    flights: int

    def number(self, name: str) -> tuple[float, float] | None:
        """Return value and standard deviation of a number; None if it is not estimated."""
        if name not in self.names:
            return None
        i = self.names.index(name)
        return float(self.values[i]), float(self.std[i])


@frozen_dataclass
class CachedFlight:
    """Where the factors of a flight are, and what they were made with."""

    key: str
    task: FlightTask


@frozen_dataclass
class JoinTask:
    """The flights of one vehicle as it was loaded, to be fitted together."""

    cache: Path
    flights: tuple[CachedFlight, ...]


@frozen_dataclass
class _Trims:
    """The trims of one flight (`fit/joint/trims.py`), at the vehicle's numbers."""

    values: Float[np.ndarray, " t"]
    covariance: Float[np.ndarray, "t t"]


@frozen_dataclass
class _FlightEquations:
    """One flight's normal equations of the vehicle's free parameters, its own times eliminated."""

    information: Float[np.ndarray, "f f"]
    score: Float[np.ndarray, " f"]
    trims: _Trims


@frozen_dataclass
class _Vehicle:
    """The free parameters of a vehicle, and what is known of them before the flights."""

    map: ParameterMap
    configuration: JointConfiguration
    mean: Float[np.ndarray, " f"]
    precision: Float[np.ndarray, " f"]

    @property
    def names(self) -> tuple[str, ...]:
        return self.map.names


def loaded_vehicle(record: FlightRecord) -> LoadedVehicle:
    """Return the row of the table of vehicles to which a flight belongs."""
    return record.vehicle, record.configuration, record.mass


def join_tasks(
    records: Sequence[FlightRecord], cached: Sequence[CachedFlight], cache: Path
) -> dict[LoadedVehicle, JoinTask]:
    """Select the vehicles of one type with several identified flights, each as it was loaded."""
    groups: dict[LoadedVehicle, list[CachedFlight]] = {}
    for record, flight in zip(records, cached, strict=True):
        if not record.refused:
            groups.setdefault(loaded_vehicle(record), []).append(flight)
    return {
        vehicle: JoinTask(cache=cache, flights=tuple(flights))
        for vehicle, flights in groups.items()
        if len(flights) > 1
    }


def joined_vehicle(task: JoinTask) -> Joined | None:
    """Fit the flights of a vehicle together; None if the passes do not settle."""
    experiment = experiment_of(task.flights[0].task)
    loads = [partial(_load_factors, task.cache, flight.key, experiment) for flight in task.flights]
    with threadpool_limits(limits=1, user_api="blas"):
        try:
            return joined(loads)
        except (EstimationError, np.linalg.LinAlgError):
            return None


def _load_factors(cache: Path, key: str, experiment: Experiment) -> FittedFactors:
    entry = read_entry(cache, key, factors=True)
    if entry is None:
        raise EstimationError("what was kept of a flight was spoilt meanwhile: run again")
    return fitted_factors(entry.factors, experiment)


def joined(flights: Sequence[Load]) -> Joined:
    """Fit a vehicle's flights in one configuration; each `Load` is called some times.

    Raises `EstimationError` where the passes do not settle.
    """
    vehicle = _collect_vehicle(flights)
    phi, differ = _initial_estimate(vehicle, flights), UNSEEN
    flights = _with_common_correlation(vehicle, flights, phi)
    for _ in range(MOST_PASSES):
        H, scores = np.diag(vehicle.precision), np.zeros((len(flights), len(phi)))
        trims: list[_Trims] = []
        for i, load in enumerate(flights):
            equations = _flight_equations(vehicle, load(), phi, differ)
            H, scores[i] = H + equations.information, equations.score
            trims.append(equations.trims)
        covariance = pseudo_inverse(H)
        step = covariance @ (scores.sum(axis=0) + vehicle.precision * (vehicle.mean - phi))
        phi = phi + step
        if (np.abs(step) <= SMALLEST_STEP * np.sqrt(np.diagonal(covariance))).all():
            if differ is not UNSEEN or len(flights) == 1:
                return _finish_joined(vehicle, phi, covariance, scores)
            differ = _trim_scatter(vehicle, trims)
    raise EstimationError(
        f"the joint fit of {len(flights)} flights did not settle in {MOST_PASSES} passes"
    )


def _collect_vehicle(flights: Sequence[Load]) -> _Vehicle:
    """Collect the parameters that any of the flights has, but for the flights' own times."""
    terms: dict[str, None] = {}
    first: JointConfiguration | None = None
    own_kt: list[float] = []
    for load in flights:
        fitted = load()
        own_kt.append(fitted.values["kt"])
        terms |= dict.fromkeys(fitted.terms)
        first = first or replace(fitted.configurations[0], timing=None)
    assert first is not None
    problem = joint_problem([first], terms=tuple(terms))
    mean, std = (values.copy() for values in problem.prior)
    # Each flight's k_t carries its weight, too, of which the equations that are added know nothing.
    at = problem.map.names.index("kt")
    mean[at] = np.mean(own_kt)
    std[at] = max(float(np.std(own_kt)) / len(own_kt) ** 0.5, LEAST_KT_STD * mean[at])
    return _Vehicle(map=problem.map, configuration=first, mean=mean, precision=std**-2.0)


def _with_common_correlation(
    vehicle: _Vehicle, flights: Sequence[Load], phi: Float[np.ndarray, " f"]
) -> list[Load]:
    """Give all flights one correlation of force and torque errors, estimated from all of them."""
    found: list[list[Pushes]] = []
    for load in flights:
        fitted = load()
        problem = replace(_flight_problem(fitted, UNSEEN), error_correlation=())
        error = evaluated(problem, _flight_start(vehicle, fitted, problem, phi)).residual
        found.append(pushes(fitted.configurations[0], error))
    shares = error_correlation(found, vehicle.configuration.vehicle)

    def with_shares(load: Load) -> FittedFactors:
        fitted = load()
        one = [replace(c, error_correlation=shares) for c in fitted.configurations]
        return replace(fitted, configurations=tuple(one))

    return [partial(with_shares, load) for load in flights]


def _flight_start(
    vehicle: _Vehicle, fitted: FittedFactors, problem: BandedProblem, phi: Float[np.ndarray, " f"]
) -> Float[np.ndarray, " g"]:
    """Return a flight's free parameters: the vehicle's `phi`, else the flight's own estimates."""
    known = dict(zip(vehicle.names, phi.tolist(), strict=True))
    return np.array([known.get(n, fitted.values.get(n, 0.0)) for n in problem.map.names])


def _flight_problem(fitted: FittedFactors, differ: Scatter) -> BandedProblem:
    """Set up the problem of one flight, with priors on its own times and trims alone."""
    one = [replace(c, scatter=differ) for c in fitted.configurations]
    problem = joint_problem(one, terms=fitted.terms, of_many=True)
    own = {n: s for n, s in problem.prior_std.items() if n in problem.moving or n.startswith(TRIM)}
    return replace(problem, prior_std=own)


def _trim_scatter(vehicle: _Vehicle, trims: Sequence[_Trims]) -> Scatter:
    """Estimate how much the flights differ from their trims at the vehicle's numbers."""
    estimate = Estimate(
        names=tuple(f"{TRIM}{own}@{k}" for k in range(len(trims)) for own in OWN),
        values=np.concatenate([one.values for one in trims]),
        covariance=block_diagonal([one.covariance for one in trims]),
        condition_number=1.0,
    )
    c = vehicle.configuration
    moment = c.mass * c.vehicle.arm
    return scatters(estimate, [0] * len(trims), [moment] * len(trims))[0]


def _initial_estimate(vehicle: _Vehicle, flights: Sequence[Load]) -> Float[np.ndarray, " f"]:
    """Combine the flights' own estimates, each with its information, as start of the passes."""
    H, target = np.diag(vehicle.precision), vehicle.precision * vehicle.mean
    for load in flights:
        fitted = load()
        own = np.array([fitted.values.get(name, 0.0) for name in vehicle.names])
        equations = _flight_equations(vehicle, fitted, own, UNSEEN)
        H = H + equations.information
        target = target + equations.information @ own + equations.score
    return pseudo_inverse(H) @ target


def _flight_equations(
    vehicle: _Vehicle, fitted: FittedFactors, phi: Float[np.ndarray, " f"], differ: Scatter
) -> _FlightEquations:
    """Linearise one flight at the vehicle's `phi`, where the flight's own numbers fit best."""
    problem = _flight_problem(fitted, differ)
    names = problem.map.names
    at = _flight_start(vehicle, fitted, problem, phi)
    # Its times and trims, and what only its signals have: drag over a velocity that others log.
    own = [i for i, name in enumerate(names) if name not in vehicle.names]
    shared = [i for i in range(len(names)) if i not in own]
    for _ in range(FLIGHT_STEPS if own else 0):
        equations = corrected_equations(problem, evaluated(problem, at))
        H = equations.information - equations.noise_information
        at[own] += pseudo_inverse(H[np.ix_(own, own)]) @ equations.score[own]
    equations = corrected_equations(problem, evaluated(problem, at))
    H = equations.information - equations.noise_information
    own_covariance = pseudo_inverse(H[np.ix_(own, own)])
    across = H[np.ix_(shared, own)] @ own_covariance
    information, score = np.zeros((len(phi), len(phi))), np.zeros(len(phi))
    places = [vehicle.names.index(names[i]) for i in shared]
    information[np.ix_(places, places)] = (
        H[np.ix_(shared, shared)] - across @ H[np.ix_(own, shared)]
    )
    score[places] = equations.score[shared] - across @ equations.score[own]
    trims = [own.index(names.index(f"{TRIM}{name}@0")) for name in OWN]
    return _FlightEquations(
        information=information,
        score=score,
        trims=_Trims(
            values=at[[own[i] for i in trims]], covariance=own_covariance[np.ix_(trims, trims)]
        ),
    )


def _finish_joined(
    vehicle: _Vehicle,
    phi: Float[np.ndarray, " f"],
    covariance: Float[np.ndarray, "f f"],
    scores: Float[np.ndarray, "m f"],
) -> Joined:
    """Convert the maximum to physical numbers with their deviations."""
    configurations = [vehicle.configuration]
    found = physical(phi, vehicle.map, configurations)
    std = np.sqrt(np.diagonal(covariance))
    jacobian = slopes_of_numbers(list(found), phi, std, vehicle.map, configurations)
    formal = np.einsum("qf,fg,qg->q", jacobian, covariance, jacobian)
    m = len(scores)
    scatter = np.zeros(len(formal))
    if m >= FEWEST_FOR_SCATTER:
        influence = scores @ covariance @ jacobian.T
        scatter = m / (m - 1.0) * ((influence - influence.mean(axis=0)) ** 2).sum(axis=0)
    return Joined(
        names=tuple(name.partition("@")[0] for name in found),
        values=np.array(list(found.values())),
        std=np.sqrt(np.maximum(formal, scatter)),
        flights=m,
    )
