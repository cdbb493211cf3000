"""Estimates to compare with: ordinary, and total least squares with columns scaled by noise.

Both on the paper's low-passed, decimated signals (3 Hz, 8 samples per period) and its model: k_t
and k_d shared, first moments and inertia of each configuration, no rotor inertia, no lag.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from benchmarks.accuracy.bound import flight_spectrum
from jaxtyping import Float
from scipy import signal

from rotorfit.errors import EstimationError, RotorfitError
from rotorfit.estimation.estimate import (
    Estimate,
    LinearProblem,
    equation_rows,
    problem_rows,
    scaled_singular,
)
from rotorfit.estimation.least_squares import component_weights, ordinary, total
from rotorfit.estimation.parameter_map import ParameterMap, parameter_map
from rotorfit.fit.reduction.reduce import LowPass, time_factors
from rotorfit.flight.flight_data import FlightData
from rotorfit.flight.signals import central_difference
from rotorfit.model.parameters import FIRST_MOMENTS, INERTIA
from rotorfit.model.regressor import regressor
from rotorfit.simulation import SimulatedFlight, sampled_flight_data

PAPER_FILTER = LowPass(cutoff=3.0, samples_per_period=8.0)
LEAST_NOISE = 1e-4
"""Of a column, relative to itself: one without noise would take no part in the correction."""


def rival_estimates(
    flights: Mapping[str, SimulatedFlight], *, commanded: bool
) -> dict[str, Estimate | None]:
    """Return the estimates by name; None where there is no solution.

    Parameters
    ----------
    flights
        By the names of the configurations.
    commanded
        Whether the commands stand for rotor speeds.
    """
    problem = lowpassed_problem(flights, commanded=commanded)
    # Rows weighted as the paper weights them: one pass, by the errors of ordinary least squares.
    weighted = replace(problem, weights=component_weights(problem, ordinary(problem)))
    found: dict[str, Estimate | None] = {"ols": block_covariance(weighted, ordinary(weighted))}
    noise = [lowpassed_noise(f, commanded=commanded) for f in flights.values()]
    try:
        found["tls-ns"] = noise_scaled_total(weighted, noise)
    except RotorfitError:
        found["tls-ns"] = None
    return found


def lowpassed_problem(flights: Mapping[str, SimulatedFlight], *, commanded: bool) -> LinearProblem:
    """Return the paper's equations of all configurations, one factor per second."""
    vehicle = next(iter(flights.values())).vehicle
    physics = regressor(vehicle)
    return LinearProblem(
        factors=tuple(
            time_factors(as_measured(f, commanded=commanded), vehicle, lowpass=PAPER_FILTER)
            for f in flights.values()
        ),
        tensors=(physics.tensor,) * len(flights),
        map=_paper_map(physics.names, flights),
        weights=np.ones((len(flights), 6)),
    )


def as_measured(flight: SimulatedFlight, *, commanded: bool) -> FlightData:
    """Return a flight as its log shows it, commands in place of rotor speeds if so."""
    data = sampled_flight_data(flight, signals="measured")
    if not commanded:
        return data
    speed = flight.commanded_speed
    slope = central_difference(speed, data.sample_rate)
    return replace(data, rotor_speed=speed, rotor_acceleration=slope)


def _paper_map(names: tuple[str, ...], flights: Mapping[str, SimulatedFlight]) -> ParameterMap:
    everywhere = range(len(flights))
    free = {name: {(c, name): 1.0 for c in everywhere} for name in ("kt", "kd")}
    for c, owner in enumerate(flights):
        free |= {f"{name}@{owner}": {(c, name): 1.0} for name in (*FIRST_MOMENTS, *INERTIA)}
    given = {(c, "mass"): flight.truth.mass for c, flight in enumerate(flights.values())}
    return parameter_map(names, free, given, configurations=len(flights))


def lowpassed_noise(flight: SimulatedFlight, *, commanded: bool) -> Float[np.ndarray, "z z"]:
    """Return the covariance of the sensors' noise in the low-passed signals, per sample."""
    std = 0.0 if commanded else flight.sensors.rotor_speed_std
    spectrum = flight_spectrum(flight, flight.vehicle, rotor_speed_std=std)
    sections = PAPER_FILTER.sos(flight.sample_rate)
    _, gain = signal.sosfreqz(sections, spectrum.frequency, fs=flight.sample_rate)
    share = spectrum.weight * np.abs(gain) ** 4 / len(flight.time)  # forward and backward
    return np.einsum("l,lzy->zy", share, spectrum.noise).real


def noise_scaled_total(problem: LinearProblem, noise: list[Float[np.ndarray, "z z"]]) -> Estimate:
    """Return total least squares with each column divided by the known deviation of its noise.

    One deviation a column, though its rows differ: that of the weighted rows in which it appears.
    The standard deviations are those of Six et al. 2020, eq. 19 and 20, in the scaled columns.

    Parameters
    ----------
    problem
        The weighted equations.
    noise
        Covariance of the signals' noise, of each configuration.
    """
    m = problem.map
    columns = np.concatenate([m.matrix, m.constant[:, :, None]], axis=2)
    variance, power, count = np.zeros((3, columns.shape[2]))
    for c, (factors, tensor) in enumerate(zip(problem.factors, problem.tensors, strict=True)):
        rows = np.einsum("pjz,pg,j->gjz", tensor, columns[c], problem.weights[c])
        samples = float(factors.rows.sum())
        count += samples * rows.any(axis=2).sum(axis=1)
        variance += samples * np.einsum("gjz,zy,gjy->g", rows, noise[c], rows)
        power += ((rows @ factors.total.T) ** 2).sum(axis=(1, 2))
    scale = np.sqrt(count / np.maximum(variance, LEAST_NOISE**2 * power))
    scaled = replace(m, matrix=m.matrix * scale[:-1], constant=m.constant * scale[-1])
    estimate = total(replace(problem, map=scaled))
    back = scale[:-1] / scale[-1]
    return replace(
        estimate,
        values=estimate.values * back,
        covariance=estimate.covariance * np.outer(back, back),
    )


def block_scores(
    problem: LinearProblem, phi: Float[np.ndarray, " f"]
) -> tuple[Float[np.ndarray, "b f"], Float[np.ndarray, "b f f"]]:
    """Compute each block's gradient J^T e and information J^T J at `phi`.

    Blocks of all configurations, one after the other; both weighted.
    """
    f = len(phi)
    scores: list[Float[np.ndarray, "b f"]] = []
    information: list[Float[np.ndarray, "b f f"]] = []
    for c, (factors, tensor) in enumerate(zip(problem.factors, problem.tensors, strict=True)):
        rows = equation_rows(
            factors.R,
            tensor,
            (problem.map.constant[c], problem.map.matrix[c]),
            problem.weights[c],
        )
        J = rows[:, :, :f]
        e = rows[:, :, f] + J @ phi
        scores.append(np.einsum("bmf,bm->bf", J, e))
        information.append(np.matmul(J.transpose(0, 2, 1), J))
    return np.concatenate(scores), np.concatenate(information)


def block_covariance(problem: LinearProblem, estimate: Estimate) -> Estimate:
    r"""Give an estimate a covariance that needs no independence within a block.

    The sandwich :math:`H^{-1} (\sum_b g_b g_b^T) H^{-1} b/(b-1)` over the blocks of the factors:
    errors may be coloured and correlated between equations as long as blocks are longer than
    their memory.
    """
    scores, _ = block_scores(problem, estimate.values)
    b = len(scores)
    if b < 2:
        raise EstimationError("one block has no scatter: give at least two blocks of data")
    # H^-1 from the singular values of the equations: forming H would square their condition.
    root = scaled_singular(problem_rows(problem)[:, :-1], problem.map.names).inverse_root
    spread = root @ (root.T @ scores.T)
    covariance = spread @ spread.T * (b / (b - 1))
    return replace(estimate, covariance=covariance)
