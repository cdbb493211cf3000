"""From the joint estimate to physical numbers with intervals.

The first interval terms of a fit, all in quadrature (`interval_terms.py`):

- noise: the largest of the formal deviation and the scatter over stretches and bands, of the number
  and of all together (`dispersion`), over phases, and over flights;
- prior: what was known of the parameters before the flights, and its own uncertainty;
- autopilot response: how far the estimate depends on what is assumed of the autopilot
  (`banded.response_sensitivity`);
- motor lag: faults of the motors' times; gusts and drag: where they push
  (`error_correlation_shifts`);
- allowances and declared tolerances, number by number (`allowances.py`).

The steps of the recipe append what a change of settings shifts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.banded import (
    BandedEstimate,
    covariance_with_noise_uncertainty,
    information_of_parts,
    response_sensitivity,
    square_root,
    steps_without,
)
from rotorfit.estimation.dispersion import dispersions, pooled
from rotorfit.estimation.distributions import student_quantile
from rotorfit.estimation.effective_blocks import free_blocks, own_scatter
from rotorfit.estimation.error_correlation import error_correlation_shifts
from rotorfit.estimation.estimate import jacobian_of_rows
from rotorfit.fit.experiment.payload import MOMENTS, added_moments
from rotorfit.fit.intervals.allowances import (
    air_uncertainty,
    coupling_uncertainty,
    inertia_uncertainty,
    systematic_uncertainty,
)
from rotorfit.fit.intervals.excitation import (
    enough_by_weight,
    excitation,
    weighed_excitation,
)
from rotorfit.fit.intervals.frame_drag import frame_drag_shifts, wake_shifts
from rotorfit.fit.intervals.interval_terms import IntervalTerm, combined_half_width
from rotorfit.fit.intervals.numbers import FEWEST_PHASES, Numbers, correlation_of, hover_speed
from rotorfit.fit.joint.joint_map import spread_names
from rotorfit.fit.joint.joint_problem import JointConfiguration, theta_jacobian, theta_of
from rotorfit.fit.joint.trims import ENOUGH_FLIGHTS
from rotorfit.model.parameters import (
    FIRST_MOMENTS,
    INERTIA,
    INERTIA_PLACES,
    inertia_about,
    inertia_matrix,
    names_of,
)
from rotorfit.model.terms.registry import TERMS
from rotorfit.model.terms.rotors import IMU_MOUNTING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Bool, Float

    from rotorfit.estimation.parameter_map import ParameterMap
    from rotorfit.fit.reduction.motor_timing import FreeTiming

MOST_LEVERAGE = 4.0
"""Leverage of a phase that has three quarters of the information."""
FEWEST_FLIGHTS = 3
"""Flights of a configuration, from which their scatter is informative: its own size from
`ENOUGH_FLIGHTS` on, of fewer it can only be a lower limit."""
IN_OTHERS = ("kt", "kd", "Jr", *IMU_MOUNTING.names)
"""Parameters that are a part of derived numbers by themselves; others are by the moments."""
OWN_NUMBERS = tuple(name for name in names_of("configuration") if name != "mass")
SHARED_FREE = names_of("shared")
SHARED_NUMBERS = (*SHARED_FREE, "kd_over_kt", "motor_lag_total")


def joint_numbers(
    fit: BandedEstimate,
    configurations: Sequence[JointConfiguration],
    mass_std: Mapping[str, float],
) -> Numbers:
    """Compute the physical numbers of a joint estimate, with their intervals."""
    estimate = fit.estimate
    mapped = fit.problem.map
    at_estimate = physical(estimate.values, mapped, configurations)
    names, values = tuple(at_estimate), np.array(list(at_estimate.values()))
    jacobian = slopes_of_numbers(names, estimate.values, estimate.std, mapped, configurations)
    formal = formal_covariance(fit, jacobian)
    response_shifts = response_sensitivity(fit) @ jacobian.T
    timings = np.reshape(timing_shifts(fit, configurations[0].timing), (-1, len(estimate.names)))
    late = timings @ jacobian.T
    # What shifts all numbers at once makes them go together, as chance does.
    shared = response_shifts.T @ response_shifts / 1.96**2 + late.T @ late
    numbers = Numbers(
        names=names,
        values=values,
        terms=(
            *random_terms(fit, jacobian, formal),
            *assumption_terms(response_shifts, late, error_correlation_shifts(fit) @ jacobian.T),
        ),
        correlation=correlation_of(formal + shared),
        excitation=excitation(fit, configurations),
        by_velocity=_shown_by_forces(configurations),
    )
    widened = replace(
        numbers,
        excitation=enough_by_weight(numbers.excitation, weighed_excitation(fit, configurations)),
    )
    weighed = widened.excitation
    widened = systematic_uncertainty(widened, configurations, mass_std)
    std = np.sqrt(np.diagonal(formal + shared))
    widened = inertia_uncertainty(widened, configurations, std)
    widened = air_uncertainty(widened, configurations, std)
    widened = widened.with_terms(*_terms_left_out(fit, configurations, jacobian))
    widened = coupling_uncertainty(widened, configurations)
    return replace(widened, excitation=numbers.excitation, weighed=weighed)


def _terms_left_out(
    fit: BandedEstimate,
    configurations: Sequence[JointConfiguration],
    jacobian: Float[np.ndarray, "q f"],
) -> tuple[IntervalTerm, IntervalTerm]:
    """Return the terms by what the model lacks of the air."""
    drag, wakes = (
        1.96 * np.linalg.norm(shifts(fit, configurations) @ jacobian.T, axis=0)
        for shifts in (frame_drag_shifts, wake_shifts)
    )
    return (
        IntervalTerm(
            name="drag of the frame",
            half_width=drag,
            source="drag of the frame that stands in the drag of the rotors",
        ),
        IntervalTerm(
            name="moments of the wakes",
            half_width=wakes,
            source="moments of the rotors' wakes that the model lacks",
        ),
    )


def _shown_by_forces(configurations: Sequence[JointConfiguration]) -> frozenset[str]:
    """Return the numbers of yaw that forces show, too: of terms with signals of the velocity."""
    added = configurations[0].model.layout.added
    return frozenset(
        name for term in TERMS if {*term.with_velocity} & {*added} for name in term.names
    )


def formal_covariance(
    fit: BandedEstimate, jacobian: Float[np.ndarray, "q f"]
) -> Float[np.ndarray, "q q"]:
    """Propagate the formal covariance of a fit to numbers with these slopes by its parameters."""
    spread = jacobian @ square_root(covariance_with_noise_uncertainty(fit))
    formal: Float[np.ndarray, "q q"] = spread @ spread.T
    return formal


def random_half_width(
    fit: BandedEstimate, jacobian: Float[np.ndarray, "q f"], formal: Float[np.ndarray, "q q"]
) -> Float[np.ndarray, " q"]:
    """Compute the half-width by chance, and by what was known before: see `random_terms`."""
    return combined_half_width(random_terms(fit, jacobian, formal), len(jacobian))


def random_terms(
    fit: BandedEstimate, jacobian: Float[np.ndarray, "q f"], formal: Float[np.ndarray, "q q"]
) -> tuple[IntervalTerm, IntervalTerm]:
    """Return the terms by chance, and by what was known before.

    `fit`: of all flights. `jacobian`: of the numbers by the free parameters. `formal`:
    `formal_covariance` of the numbers.
    """
    blocks, free = len(fit.influence), free_blocks(fit)
    before = prior_variance(fit, jacobian, formal)
    by_flights = np.diagonal(formal) - before
    # The four estimate one and the same error: the largest counts.
    shown = (
        float(student_quantile(0.975, free)) * np.sqrt(by_flights * blocks / free),
        half_width_between_blocks(fit, jacobian, by_flights),
        half_width_between_phases(fit, jacobian),
        _between_flights(fit, jacobian),
    )
    return (
        IntervalTerm(
            name="noise",
            half_width=np.maximum.reduce(shown),
            source="the fit and the scatter of blocks, phases and flights, whichever is largest",
        ),
        IntervalTerm(
            name="prior",
            half_width=1.96 * np.sqrt(before),
            source="what is usual of vehicles, where the flights show little",
        ),
    )


def assumption_terms(
    response: Float[np.ndarray, "r q"],
    late: Float[np.ndarray, "l q"],
    pushed: Float[np.ndarray, "p q"],
) -> tuple[IntervalTerm, ...]:
    """Return the terms by what the likelihood assumes, from the shifts of the numbers.

    `response`: by the ends of what the autopilot's response may be, which act together and add.
    `late`, `pushed`: by a deviation of each fault of the motors' times, and of each place where
    gusts and drag may push; they are independent.
    """
    return (
        IntervalTerm(
            name="autopilot response",
            # Linearly: one autopilot stands behind the response to every error.
            half_width=np.abs(response).sum(axis=0),
            source="range of the autopilot's response to gusts",
        ),
        IntervalTerm(
            name="motor lag",
            half_width=1.96 * np.linalg.norm(late, axis=0),
            source="faults of the motors' times",
        ),
        IntervalTerm(
            name="gusts and drag",
            half_width=1.96 * np.linalg.norm(pushed, axis=0),
            source="where gusts and drag may push",
        ),
    )


def prior_variance(
    fit: BandedEstimate, jacobian: Float[np.ndarray, "q f"], formal: Float[np.ndarray, "q q"]
) -> Float[np.ndarray, " q"]:
    """Compute what the parameters' prior deviations add to each number's `formal` variance."""
    by_prior = jacobian @ fit.estimate.covariance / fit.problem.prior[1]
    # Both are estimates by linear slopes: rounding must not leave less than nothing to the flights.
    return np.minimum((by_prior**2).sum(axis=1), np.diagonal(formal))


def half_width_between_blocks(
    fit: BandedEstimate, jacobian: Float[np.ndarray, "q f"], by_flights: Float[np.ndarray, " q"]
) -> Float[np.ndarray, " q"]:
    """Compute the half-width by the scatter of the blocks: of each number, and pooled.

    `by_flights`: formal variance of each number, without what was known before.
    """
    own, own_blocks = own_scatter(fit, jacobian)
    phases, flights = _mark_parts(fit, "segment"), _mark_parts(fit, "recording")
    parts = phases if len(phases) >= FEWEST_PHASES else list(np.eye(len(fit.influence), dtype=bool))
    shares = _shares_of_variance(fit, jacobian, flights)
    variance, degrees = pooled(
        dispersions(fit, parts, flights), by_flights * shares, own, own_blocks
    )
    found: Float[np.ndarray, " q"] = student_quantile(0.975, degrees) * np.sqrt(variance)
    return found


def _shares_of_variance(
    fit: BandedEstimate,
    jacobian: Float[np.ndarray, "q f"],
    groups: Sequence[Bool[np.ndarray, " b"]],
) -> Float[np.ndarray, "g q"]:
    """Compute the share of each group of blocks in the numbers' variance; equal where none has."""
    moved = jacobian @ fit.estimate.covariance
    known = np.einsum("qi,gij,qj->gq", moved, information_of_parts(fit, groups), moved)
    known = np.maximum(known, 0.0)
    total, even = known.sum(axis=0), np.full(known.shape, 1.0 / len(groups))
    return np.divide(known, total, out=even, where=total > 0.0)


def _between_flights(
    fit: BandedEstimate, jacobian: Float[np.ndarray, "q f"]
) -> Float[np.ndarray, " q"]:
    """Compute the half-width by the influence of whole flights; zeros for one or two flights."""
    variance, degrees = np.zeros(len(jacobian)), np.inf
    first = 0
    for factors in fit.problem.factors:
        source = factors.recording
        own = fit.influence[first : first + len(source)]
        first += len(source)
        # Real flights differ by more than any one of them can know. As the jackknife over blocks,
        # with a flight for a block (the cluster-robust variance, and its few degrees of freedom).
        influences = (
            np.array([own[source == k].sum(axis=0) for k in np.unique(source)]) @ jacobian.T
        )
        m = len(influences)
        if m < FEWEST_FLIGHTS:
            continue
        # The unbiased variance of a sum of m independent influences.
        variance += m / (m - 1.0) * ((influences - influences.mean(axis=0)) ** 2).sum(axis=0)
        if m >= ENOUGH_FLIGHTS:
            # Of three flights Student's factor would be 4.3: the scatter counts as a lower
            # limit only.
            degrees = min(degrees, m - 1)
    return float(student_quantile(0.975, degrees)) * np.sqrt(variance)


def timing_shifts(fit: BandedEstimate, timing: FreeTiming | None) -> list[Float[np.ndarray, " f"]]:
    """Compute the shifts of the parameters where the motors' times are off by their faults."""
    if timing is None:
        return []
    names, covariance = fit.estimate.names, fit.estimate.covariance
    shifts: list[Float[np.ndarray, " f"]] = []
    for fault in timing.faults():
        at = [names.index(name) for name in fault]
        # The most likely values of all parameters where those times are held off by their fault:
        # the regression of the rest on them.
        held = np.linalg.solve(covariance[np.ix_(at, at)], np.array(list(fault.values())))
        shifts.append(covariance[:, at] @ held)
    return shifts


def half_width_between_phases(
    fit: BandedEstimate, jacobian: Float[np.ndarray, "q f"]
) -> Float[np.ndarray, " q"]:
    """Compute the half-width by the scatter of the flights' phases, their bands together."""
    parts = _mark_parts(fit, "segment")
    if len(parts) < FEWEST_PHASES:
        return np.zeros(len(jacobian))
    influences = np.array([fit.influence[own].sum(axis=0) for own in parts]) @ jacobian.T
    moves = steps_without(fit, parts) @ jacobian.T
    with np.errstate(divide="ignore", invalid="ignore"):
        # What a phase has to itself (the wind in its propellers, say) is common to its bands, so
        # that their scatter does not show it. Each phase moves the estimate by p, and without it
        # the estimate moves by d; p is too small where a phase has most of the information, and d
        # too large: the variance is the sum of p d (the jackknife's and the sandwich's geometric
        # mean, HC2), d being no more than a few times p: without the one informative phase nothing
        # is identifiable.
        leverage = np.clip(np.nan_to_num(np.abs(moves / influences), nan=1.0), 1.0, MOST_LEVERAGE)
    return 1.96 * np.sqrt((leverage * influences**2).sum(axis=0))


def _mark_parts(fit: BandedEstimate, kind: str) -> list[Bool[np.ndarray, " b"]]:
    """Mark the blocks of each phase ("segment") or flight ("recording") of each configuration."""
    factors = fit.problem.factors
    configuration = np.repeat(np.arange(len(factors)), [len(f) for f in factors])
    labels = np.column_stack([configuration, np.concatenate([getattr(f, kind) for f in factors])])
    return [(labels == label).all(axis=1) for label in np.unique(labels, axis=0)]


def physical(
    phi: Float[np.ndarray, " f"],
    mapped: ParameterMap,
    configurations: Sequence[JointConfiguration],
) -> dict[str, float]:
    """Compute every physical number at the free parameters `phi`."""
    rows = physical_rows(phi[None], mapped, configurations)
    return {name: float(values[0]) for name, values in rows.items()}


def physical_rows(
    phis: Float[np.ndarray, "b f"],
    mapped: ParameterMap,
    configurations: Sequence[JointConfiguration],
) -> dict[str, Float[np.ndarray, " b"]]:
    """Compute every physical number at each row of free parameters."""
    p = dict(zip(mapped.names, phis.T, strict=True))
    out = {name: p[name] for name in SHARED_FREE if name in p}
    out["kd_over_kt"] = p["kd"] / p["kt"]
    theta = np.array([theta_of(mapped, phi, configurations) for phi in phis])
    index = configurations[0].model.names.index
    spread = spread_names(configurations[0].vehicle)
    for i in range(len(spread) if set(spread) <= set(p) else 0):
        out[f"kt_{i + 1}"] = p["kt"] + theta[:, 0, index(f"kt_{i + 1}")]
    is_turned = not set(IMU_MOUNTING.names).isdisjoint(p)
    unturned = np.zeros(len(phis))
    turn = rotation_by_vector(
        np.stack([p.get(name, unturned) for name in IMU_MOUNTING.names], axis=-1)
    )
    for c, configuration in enumerate(configurations):
        own = {
            name.removesuffix(f"@{configuration.name}"): values
            for name, values in p.items()
            if name.endswith(f"@{configuration.name}")
        }
        # From theta, not phi: a body with a known payload has no free moments of its own.
        place = configuration.model.names.index
        moments = {name: theta[:, c, place(name)] for name in MOMENTS}
        if is_turned:
            moments = turned_moments(moments, turn, configuration)
        numbers = _own_numbers({**own, **out, **moments}, configuration)
        out |= {f"{name}@{configuration.name}": values for name, values in numbers.items()}
    return out


def slopes_of_numbers(
    names: Sequence[str],
    phi: Float[np.ndarray, " f"],
    scale: Float[np.ndarray, " f"],
    mapped: ParameterMap,
    configurations: Sequence[JointConfiguration],
) -> Float[np.ndarray, "q f"]:
    """Differentiate the physical numbers of those names by the free parameters, at `phi`.

    Most parameters are numbers themselves, and no part of others: only the rest are moved.
    `scale`: as for `jacobian_of_rows`, such as the parameters' deviations.
    """
    jacobian = np.array([[float(name == free) for free in mapped.names] for name in names])
    bent = _bend_numbers(mapped, phi, configurations)

    def numbers_at(moved: Float[np.ndarray, "m b"]) -> Float[np.ndarray, "m q"]:
        every = np.tile(phi, (len(moved), 1))
        every[:, bent] = moved
        found = physical_rows(every, mapped, configurations)
        return np.stack([found[name] for name in names], axis=-1)

    jacobian[:, bent] = jacobian_of_rows(numbers_at, phi[bent], scale[bent])
    return jacobian


def _bend_numbers(
    mapped: ParameterMap,
    phi: Float[np.ndarray, " f"],
    configurations: Sequence[JointConfiguration],
) -> Bool[np.ndarray, " f"]:
    """Return which free parameters are a part of numbers other than themselves."""
    place = configurations[0].model.names.index
    rotors = range(1, len(configurations[0].vehicle.rotors) + 1)
    entries = [place(name) for name in (*MOMENTS, *(f"kt_{i}" for i in rotors))]
    slopes = theta_jacobian(mapped, phi, configurations)[:, entries]
    return np.isin(mapped.names, IN_OTHERS) | (slopes != 0.0).any(axis=(0, 1))


def rotation_by_vector(vector: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3 3"]:
    """Compute the matrix of a turn about a vector by its length [rad] (Rodrigues)."""
    K = np.zeros((*vector.shape, 3))
    K[..., [2, 0, 1], [1, 2, 0]] = vector
    K[..., [1, 2, 0], [2, 0, 1]] = -vector
    angle = np.sqrt((vector * vector).sum(axis=-1))[..., None, None]
    # sin(a) / a and (1 - cos(a)) / a^2, which hold at zero as well.
    return np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * K @ K


def turned_moments(
    moments: Mapping[str, Float[np.ndarray, " b"]],
    R: Float[np.ndarray, "b 3 3"],
    configuration: JointConfiguration,
) -> dict[str, Float[np.ndarray, " b"]]:
    """Turn a body's moments about the IMU from its axes into those of the rotors."""
    payload = configuration.payload if configuration.payload_of is not None else ()
    # A known payload stands in the axes of the rotors already.
    added = added_moments(payload)
    body = {name: values - added.get(name, 0.0) for name, values in moments.items()}
    mass = configuration.mass - sum(item.mass for item in payload)
    com = np.stack([body[name] for name in FIRST_MOMENTS], axis=-1) / mass
    # A turn about the centre of mass leaves it in its place: there the tensor turns alone (Steiner
    # back and forth).
    about_com = inertia_about(np.stack([body[name] for name in INERTIA], axis=-1), -mass, com)
    back = np.swapaxes(R, -1, -2)
    tensor = back @ inertia_matrix(about_com) @ R
    imu = np.array(configuration.vehicle.imu_position or (0.0, 0.0, 0.0))
    com = imu + (back @ (com - imu)[..., None])[..., 0]
    rows, columns = zip(*INERTIA_PLACES, strict=True)
    elements = inertia_about(tensor[..., rows, columns], mass, com)
    turned = np.moveaxis(np.concatenate([mass * com, elements], axis=-1), -1, 0)
    return {
        name: values + added.get(name, 0.0)
        for name, values in zip((*FIRST_MOMENTS, *INERTIA), turned, strict=True)
    }


def _own_numbers(
    p: Mapping[str, Float[np.ndarray, " b"]], configuration: JointConfiguration
) -> dict[str, Float[np.ndarray, " b"]]:
    """Compute the numbers of one configuration: its own parameters, and those derived from them."""
    mass = configuration.mass
    com = np.stack([p[name] for name in FIRST_MOMENTS], axis=-1) / mass
    about_com = inertia_about(np.stack([p[name] for name in INERTIA], axis=-1), -mass, com)
    out = {name: p[name] for name in OWN_NUMBERS if name in p}
    out |= {f"com_{axis}": com[:, i] for i, axis in enumerate("xyz")}
    out |= {f"{name}_com": about_com[:, i] for i, name in enumerate(INERTIA)}
    for i, name in enumerate(("Ixx", "Iyy", "Izz")):
        out[f"{name}_over_kt"] = about_com[:, i] / p["kt"]
    out["kd_over_Izz"] = p["kd"] / about_com[:, 2]
    if "Jr" in p:
        out["Jr_over_Izz"] = p["Jr"] / about_com[:, 2]
    out["hover_speed"] = hover_speed(p["kt"], mass=mass, vehicle=configuration.vehicle)
    return out
