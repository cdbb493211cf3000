"""Predict the intervals of flights that are only planned.

Each manoeuvre is flown once in simulation, exactly; the default estimate's equations, linearised
at the truth, and the assumed noise give its information per second. Informations add: a schedule
is a sum of manoeuvres, a longer flight more of the same. To the bound come what `identify` adds to
its intervals: half a sample of the motors' timing, lack of excitation, and the scale.
"""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import ExperimentError
from rotorfit.estimation.bound import Linearised, information, linearised, score
from rotorfit.estimation.factors import Factors
from rotorfit.fit.experiment.payload import MOMENTS, PointMass, tolerances
from rotorfit.fit.intervals.allowances import coupling_uncertainty, number_scale
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.intervals.joint_numbers import physical, slopes_of_numbers
from rotorfit.fit.intervals.numbers import AXES, Numbers, attenuation_allowance
from rotorfit.fit.joint.joint_map import joint_map
from rotorfit.fit.joint.joint_problem import NOISY, JointConfiguration, joint_prior
from rotorfit.fit.reduction.frequency_bands import EDGES, STRETCH, in_pilot_band
from rotorfit.fit.reduction.reduce import BandPlan, band_factors
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import EVERY, NO_NUMBERS, SHARED
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.term import Size
from rotorfit.simulation import Scenario, Truth, exact_flight_data
from rotorfit.simulation.calm_flights import simulate_calm_flights
from rotorfit.simulation.pilot import MANOEUVRES, Manoeuvre
from rotorfit.tools.planning.vehicle import (
    REFERENCE_RATE,
    Assumptions,
    RoughVehicle,
    disturbance_std,
    hover_speed,
    loaded,
    row_variances,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.estimation.parameter_map import ParameterMap
    from rotorfit.flight.flight_data import FlightData

SECONDS: Final = 30.0
SAMPLE_RATE: Final = 100.0
SEED: Final = 1
PIECE: Final = 2.0
"""Length of the pieces that are flown at once [s]. The half-widths of roll, pitch, yaw and mixed
sticks change by 1 to 5 % against a flight in one piece, and it takes 600 steps in place of 3000."""
BARE: Final = "A"
LOADED: Final = "B"
FARTHEST: Final = 100.0
"""A simulated vehicle further away than this has been lost [m]."""
DELAY_STEP: Final = 1e-4
"""Step of the derivative by the motors' delay [s]."""
VAGUE: Final = 10.0
"""Nothing is known beforehand: a deviation of this many times a parameter's size."""
UNSURE_DELAY = 2e-4
"""Deviation of the motors' delay that a flight leaves open [s]: .16 ms in simulated gusts."""
TRIALS: Final = 3
"""Settings that `identify` tries for its intervals; two of them shift the timing."""


@frozen_dataclass
class Problem:
    """The identification problem of a plan: the bare vehicle, and the vehicle with a payload.

    - `bodies`: of the bare and the loaded vehicle.
    - `configurations`: as the joint estimate sees them, without flights.
    - `mapped`, `phi`: free parameters, and their values.
    - `scale`: a size of each free parameter.
    - `assumed`: noise and disturbance.
    - `commanded`, `timed`: whether rotor speeds come from commands; whether their timing is free.
    - `physical`, `jacobian`: the shared numbers and the bare vehicle's, and their slopes by phi.
    """

    bodies: Mapping[str, Truth]
    configurations: tuple[JointConfiguration, ...]
    mapped: ParameterMap
    phi: Float[np.ndarray, " f"]
    scale: Float[np.ndarray, " f"]
    assumed: Assumptions
    commanded: bool
    timed: bool
    physical: Mapping[str, float]
    jacobian: Float[np.ndarray, "q f"]


@frozen_dataclass
class Evidence:
    """The information of flights: of one manoeuvre a second, or of any sum.

    - `information`: about the free parameters.
    - `timing`: J^T e / v for motor data that are late by a second, to first order.
    - `explained`, `residual`: power of the angular accelerations in the pilot's band, by
      ``roll@A``.
    """

    information: Float[np.ndarray, "f f"]
    timing: Float[np.ndarray, " f"]
    explained: Mapping[str, float]
    residual: Mapping[str, float]


def planned_problem(
    rough: RoughVehicle,
    payload: tuple[PointMass, ...],
    *,
    assumed: Assumptions,
    commanded: bool,
    timed: bool,
) -> Problem:
    """Return the problem of a vehicle, flown bare and with a payload."""
    bodies = {BARE: rough.truth, LOADED: loaded(rough.truth, payload)}
    model = regressor(rough.vehicle)
    nothing = _nothing_flown(len(model.layout))
    configurations = tuple(
        JointConfiguration(
            name=name,
            mass=body.mass,
            factors=nothing,
            model=model,
            vehicle=rough.vehicle,
            payload=payload if name == LOADED else (),
            payload_of=BARE if name == LOADED else None,
        )
        for name, body in bodies.items()
    )
    mapped = joint_map(configurations)
    values = _free_values(rough.truth)
    phi = np.array([values.get(name, 0.0) for name in mapped.names])
    scale = _parameter_scales(mapped, rough, payload)

    everything = physical(phi, mapped, configurations)
    numbers = {name: v for name, v in everything.items() if not name.endswith(f"@{LOADED}")}
    return Problem(
        bodies=bodies,
        configurations=configurations,
        mapped=mapped,
        phi=phi,
        scale=scale,
        assumed=assumed,
        commanded=commanded,
        timed=timed,
        physical=numbers,
        jacobian=slopes_of_numbers(list(numbers), phi, scale, mapped, configurations),
    )


def fly(
    problem: Problem, manoeuvres: Sequence[Manoeuvre], configuration: str
) -> dict[Manoeuvre, FlightData]:
    """Simulate manoeuvres of the bare or loaded vehicle, exact.

    Raises `ExperimentError` if the simulated autopilot loses this vehicle.
    """
    vehicle = problem.configurations[0].vehicle
    # Samples satisfy the equations of motion exactly, however coarse the steps between them.
    with np.errstate(all="ignore"):  # a vehicle that is lost is found below
        flights = simulate_calm_flights(
            problem.bodies[configuration],
            vehicle,
            Scenario(seconds=SECONDS, sample_rate=SAMPLE_RATE),
            sticks=[MANOEUVRES[manoeuvre] for manoeuvre in manoeuvres],
            seed=SEED,
            piece=PIECE,
        )
    if not all(np.abs(flight.position).max() < FARTHEST for flight in flights):
        raise ExperimentError(
            "the simulated autopilot cannot fly this vehicle; check mass, arm and what was set "
            "with --guess, most of all the inertia and the motor lag"
        )
    return {
        manoeuvre: exact_flight_data(flight, vehicle, specific_force_at="imu")
        for manoeuvre, flight in zip(manoeuvres, flights, strict=True)
    }


def evidence(problem: Problem, data: FlightData, configuration: str) -> Evidence:
    """Compute the mean information of a second of an exact flight."""
    c = [own.name for own in problem.configurations].index(configuration)
    own = problem.configurations[c]
    noisy = tuple(own.model.layout.index(name) for name in NOISY)
    model = linearised(own.model.tensor, problem.mapped, problem.phi, configuration=c, noisy=noisy)
    data = replace(data, rotor_speed_std=_speed_noise(problem, configuration))
    factors = _bound_factors(problem, data)
    variance = _assumed_variances(problem, model, factors)
    late = _bound_factors(problem, _delay_motors(data))
    seconds = data.seconds_used
    explained, residual = _turning_power(factors, variance, noisy)
    return Evidence(
        information=information(model, factors, variance) / seconds,
        timing=score(model, late, variance) / (DELAY_STEP * seconds),
        explained={f"{axis}@{configuration}": p / seconds for axis, p in explained.items()},
        residual={f"{axis}@{configuration}": p / seconds for axis, p in residual.items()},
    )


def combined(parts: Sequence[tuple[Evidence, float]]) -> Evidence:
    """Return the evidence of several manoeuvres, each flown for some seconds."""
    return reduce(_add_evidence, [_scale_evidence(part, seconds) for part, seconds in parts])


def predicted(
    problem: Problem, flown: Evidence, known: Float[np.ndarray, "f f"] | None = None
) -> Numbers:
    """Compute the numbers with the half-widths that `identify` would state.

    `flown`: what would be flown; `known`: information from earlier flights.
    """
    covariance, jacobian = _bound_covariance(problem, flown, known), problem.jacobian
    shift = jacobian @ covariance @ flown.timing * UNSURE_DELAY
    timing = 2.0 * np.abs(shift) * np.sqrt((TRIALS - 1) / TRIALS) * float(problem.timed)
    std = np.sqrt(np.maximum(np.einsum("if,fg,ig->i", jacobian, covariance, jacobian), 0.0))
    numbers = Numbers(
        names=tuple(problem.physical),
        values=np.array(list(problem.physical.values())),
        terms=(
            IntervalTerm(name="noise", half_width=1.96 * std, source="prediction"),
            IntervalTerm(name="motor lag", half_width=timing, source="prediction"),
        ),
        correlation=np.eye(len(jacobian)),
        excitation={key: value / flown.residual[key] for key, value in flown.explained.items()},
    )
    numbers = numbers.with_terms(*_systematic_terms(problem, numbers))
    return coupling_uncertainty(numbers, problem.configurations)


def bound(
    problem: Problem, flown: Evidence, known: Float[np.ndarray, "f f"] | None = None
) -> dict[str, float]:
    """Compute the Cramér-Rao standard deviation of every physical number."""
    covariance, jacobian = _bound_covariance(problem, flown, known), problem.jacobian
    variance = np.einsum("if,fg,ig->i", jacobian, covariance, jacobian)
    std = np.sqrt(np.maximum(variance, 0.0)).tolist()
    return dict(zip(problem.physical, std, strict=True))


def _bound_covariance(
    problem: Problem, flown: Evidence, known: Float[np.ndarray, "f f"] | None
) -> Float[np.ndarray, "f f"]:
    """Compute the inverse of all information, in units of each parameter's size."""
    total = flown.information + np.diag(prior_std(problem) ** -2.0)
    if known is not None:
        total = total + known
    s = np.sqrt(np.diagonal(total))
    return np.linalg.inv(total / np.outer(s, s)) / np.outer(s, s)


def prior_std(problem: Problem) -> Float[np.ndarray, " f"]:
    """Collect the prior deviations of the default estimate, vague where it has none."""
    sizes = dict(zip(problem.mapped.names, problem.scale.tolist(), strict=True))
    # With nothing flown yet, the prior of what all share is that of the guessed vehicle.
    known = {name: sizes[name] for name in SHARED if name in sizes and EVERY[name].prior}
    known |= joint_prior(problem.configurations)
    return np.array([known.get(name, VAGUE * size) for name, size in sizes.items()])


def _systematic_terms(problem: Problem, numbers: Numbers) -> tuple[IntervalTerm, IntervalTerm]:
    """Return the terms for too little motion, and for the step of the scale."""
    bare = problem.configurations[0]
    motion, weight = np.zeros(len(numbers.names)), np.zeros(len(numbers.names))
    for i, (name, value) in enumerate(zip(numbers.names, numbers.values.tolist(), strict=True)):
        base = name.partition("@")[0]
        rho = numbers.rho(name)
        if rho is not None:
            size = max(
                abs(value), number_scale(numbers, name, mass=bare.mass, vehicle=bare.vehicle)
            )
            motion[i] = attenuation_allowance(base, size, rho, with_response=True)
        if EVERY[base].mass_power:
            weighed = 0.5 * problem.assumed.mass_step / bare.mass
            weight[i] = abs(weighed * value)
    return (
        IntervalTerm(name="little motion", half_width=motion, source="prediction"),
        IntervalTerm(name="weight", half_width=weight, source="step of the scale"),
    )


def _bound_factors(problem: Problem, data: FlightData) -> Factors:
    plan = BandPlan(edges=EDGES, longest=STRETCH)
    return band_factors(data, problem.configurations[0].vehicle, plan=plan)


def _speed_noise(problem: Problem, configuration: str) -> float:
    """Return the noise of measured rotor speeds in samples of the simulated flights [rad/s]."""
    if problem.commanded:
        return 0.0
    hover = hover_speed(problem.bodies[configuration], problem.configurations[0].vehicle)
    return float(problem.assumed.speed_noise * hover * np.sqrt(SAMPLE_RATE / REFERENCE_RATE))


def _assumed_variances(
    problem: Problem, model: Linearised, factors: Factors
) -> Float[np.ndarray, "b 6"]:
    disturbance = disturbance_std(
        problem.assumed,
        problem.bodies[BARE],
        problem.configurations[0].vehicle,
        commanded=problem.commanded,
    )
    return row_variances(
        problem.assumed, model, factors, disturbance=disturbance, sample_rate=SAMPLE_RATE
    )


def _turning_power(
    factors: Factors, variance: Float[np.ndarray, "b 6"], noisy: tuple[int, ...]
) -> tuple[dict[str, float], dict[str, float]]:
    """Compute explained and residual power of the angular accelerations where a pilot flies."""
    chosen = in_pilot_band(factors)
    R = factors.R[chosen][:, :, list(noisy[3:])]
    explained = np.einsum("bmk,bmk->k", R, R)
    residual = factors.rows[chosen] @ variance[chosen, 3:]
    return (
        dict(zip(AXES, explained.tolist(), strict=True)),
        dict(zip(AXES, residual.tolist(), strict=True)),
    )


def _delay_motors(data: FlightData) -> FlightData:
    """Shift a flight's motor data by `DELAY_STEP`, so that the motion shows them late."""
    slope = np.gradient(data.rotor_acceleration, data.time, axis=0)
    return replace(
        data,
        rotor_speed=data.rotor_speed + DELAY_STEP * data.rotor_acceleration,
        rotor_acceleration=data.rotor_acceleration + DELAY_STEP * slope,
    )


def _scale_evidence(part: Evidence, seconds: float) -> Evidence:
    return Evidence(
        information=part.information * seconds,
        timing=part.timing * seconds,
        explained={key: value * seconds for key, value in part.explained.items()},
        residual={key: value * seconds for key, value in part.residual.items()},
    )


def _add_evidence(one: Evidence, other: Evidence) -> Evidence:
    return Evidence(
        information=one.information + other.information,
        timing=one.timing + other.timing,
        explained=_sum_tables(one.explained, other.explained),
        residual=_sum_tables(one.residual, other.residual),
    )


def _sum_tables(one: Mapping[str, float], other: Mapping[str, float]) -> dict[str, float]:
    return {key: one.get(key, 0.0) + other.get(key, 0.0) for key in {**one, **other}}


def _free_values(truth: Truth) -> dict[str, float]:
    values = truth.parameters()
    shared = {name: values[name] for name in ("kt", "kd", "Jr")}
    return shared | {f"{name}@{BARE}": values[name] for name in MOMENTS}


def _parameter_scales(
    mapped: ParameterMap, rough: RoughVehicle, payload: tuple[PointMass, ...]
) -> Float[np.ndarray, " f"]:
    """Return a size of each free parameter, over which nothing bends."""
    truth, arm = rough.truth, rough.vehicle.arm
    values, speed = _free_values(truth), hover_speed(truth, rough.vehicle)
    steps = {f"{name}@{LOADED}": std for name, std, _ in tolerances(payload)}
    I = truth.inertia
    own = {"Ixy": I[0], "Ixz": I[0], "Iyz": I[1]}
    guessed = Size(mass=truth.mass, arm=arm, speeds=len(rough.vehicle.rotors) * speed)
    sizes: list[float] = []
    for name in mapped.names:
        base = name.partition("@")[0]
        info = EVERY.get(base) or NO_NUMBERS.get(base)
        step = None if info is None else info.step
        if step is not None:
            sizes.append(step(guessed))
        elif base in own:
            sizes.append(own[base])
        elif base.startswith("spread"):
            sizes.append(1.0)
        else:
            sizes.append(steps.get(name) or abs(values[name]))
    return np.array(sizes)


def _nothing_flown(signals: int) -> Factors:
    return Factors(
        R=np.zeros((0, signals, signals)),
        rows=np.zeros(0, dtype=np.int64),
        segment=np.zeros(0, dtype=np.int64),
        band=np.zeros((0, 2)),
    )
