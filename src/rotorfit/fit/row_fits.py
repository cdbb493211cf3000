r"""The estimate row by row: each group of equations solved for its own noisy signal.

Four linear regressions, for ``method = "ols"`` and as the start of the fit of all rows at once
(`joint_problem.py`), give what one flight tells:

- the force rows, solved for m alpha: k_t, the first moments, the accelerometer's bias;
- the roll and pitch rows about the CoM, solved for the angular acceleration: k_t / Ixx, k_t / Iyy,
  the place of the rotor centre over the CoM, products of inertia;
- the yaw row about the CoM, solved for its angular acceleration: k_d / Izz and J_r / Izz. The
  scale of k_d and Izz alone is not in it: both are ratio-only here.

About the CoM the specific force drops out of the moment rows (with f = sum k_t O_i^2 n_i):
:math:`I_C \dot\omega + \omega \times I_C \omega = \sum (r_i - c) \times k_t O_i^2 n_i - \dots`,
so that the place of the accelerometer cannot spoil the inertia.

Two passes. An angular acceleration that is not the one a row is solved for stands among the
regressors, and its noise would pull that coefficient (first moments, products) towards zero. The
second pass puts there what the rotors make of it by the first: free of the gyro's noise. And it
lets the rotors differ by a little, as real ones do.

Half-width^2 = (larger of 1.96 formal and t scatter)^2 + (c |value| / rho)^2 + what the geometry
leaves open. Formal: the bands' own variances; scatter: the one-step jackknife over stretches and
bands; rho: excitation of the axis, whose lack pulls every estimate of that axis to one side, by up
to c = 2.5 for roll and pitch, 1.5 for the ratios of yaw (`excitation.py` has it exactly).
"""

from __future__ import annotations

import dataclasses
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.estimation.estimate import LinearProblem, numerical_jacobian
from rotorfit.estimation.factors import Factors, flights_of
from rotorfit.estimation.parameter_map import ParameterMap, parameter_map
from rotorfit.estimation.reweighted import BandedFit, reweighted, scatter_covariance
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.intervals.numbers import (
    Numbers,
    attenuation_allowance,
    correlation_of,
    hover_speed,
    relevant_size,
    t_half_width,
)
from rotorfit.fit.reduction.frequency_bands import excited_bands, in_pilot_band, slow_bands
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import EVERY, INERTIA, inertia_about
from rotorfit.model.terms.body import ACCEL_BIAS_STD, MOUNTING_STD
from rotorfit.model.terms.term import Size

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Bool, Float, Int

    from rotorfit.model.regressor import Regressor
    from rotorfit.model.vehicle import Vehicle

ROWS = ("force", "roll", "pitch", "yaw")
EQUATIONS = {
    "force": (1.0, 1.0, 1.0, 0.0, 0.0, 0.0),
    "roll": (0.0, 0.0, 0.0, 1.0, 0.0, 0.0),
    "pitch": (0.0, 0.0, 0.0, 0.0, 1.0, 0.0),
    "yaw": (0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
}
OWN_INERTIA = {"roll": "Ixx", "pitch": "Iyy", "yaw": "Izz"}
NUISANCE_STD = {
    # The triangle inequality bounds (Izz - Iyy) / Ixx by one; products are a fraction of it.
    "difference": 1.0,
    "Ixy": 0.2,
    "Ixz": 0.2,
    "Iyz": 0.2,
    "Jr": 0.003,
}
"""Deviation of the small terms of the roll and pitch rows, relative to that row's inertia."""
ROW_SPREAD_STD = 0.015
"""Thrust coefficients of one vehicle's new propellers differ by about this share. One row by itself
cannot tell more than that from products of inertia."""


@frozen_dataclass
class RowFits:
    """The four fits, and the joint covariance of all their parameters.

    - `fits`: by the names of `ROWS`.
    - `excitation`: rho of roll, pitch and yaw: explained over residual power of the angular
      acceleration between 0.3 and 3 Hz. Disturbances beat the excitation where it is small.
    - `covariance`: of the concatenated parameters: from the scatter of the blocks; of a single one
      `formal`.
    - `formal`: the same from the bands' variances, block diagonal.
    - `segment`: phase of a flight that each block comes from.
    """

    fits: Mapping[str, BandedFit]
    excitation: Mapping[str, float]
    covariance: Float[np.ndarray, "f f"]
    formal: Float[np.ndarray, "f f"]
    segment: Int[np.ndarray, " b"]

    @property
    def values(self) -> Float[np.ndarray, " f"]:
        """All parameters, in the order of `names`."""
        return np.concatenate([self.fits[row].estimate.values for row in ROWS])

    @property
    def names(self) -> tuple[str, ...]:
        """Such as ``roll.kt``."""
        return tuple(f"{row}.{name}" for row in ROWS for name in self.fits[row].estimate.names)


def fit_rows(factors: Factors, model: Regressor, *, mass: float) -> RowFits:
    """Fit the four rows of one configuration.

    `factors`: of its flights, per stretch and frequency band. `model`: the tensor of the vehicle
    with all effects. `mass`: [kg]; 1 for an unknown mass, and every result is then per kilogram.
    """
    first = {row: _fit_row(factors, model, row, mass) for row in ROWS[1:]}
    predicted = _rotor_made(model, first)
    fits = {row: _fit_row(factors, predicted[row], row, mass, first.get(row)) for row in ROWS}
    influence = np.concatenate([fits[row].influence for row in ROWS], axis=1)
    formal = block_diagonal([fits[row].estimate.covariance for row in ROWS])
    # A flight of one block beside others is fitted with them: by itself it has no scatter.
    several = len(influence) > 1
    return RowFits(
        fits=fits,
        excitation={row: row_excitation(fits[row], factors) for row in ROWS[1:]},
        covariance=scatter_covariance(influence) if several else formal,
        formal=formal,
        segment=factors.segment,
    )


def angular_log_likelihood(
    factors: Factors, model: Regressor, *, mass: float, counted: Bool[np.ndarray, "b 3"]
) -> float:
    """Compute the log-likelihood of the three angular accelerations, to compare delays.

    `factors`, `model`, `mass`: as for `fit_rows`. `counted`: which blocks count for each of them.
    """
    return sum(
        # Of the first pass: the second changes what is small, and costs as much again.
        _fit_row(factors.select(own), model, row, mass).log_likelihood
        for row, own in zip(ROWS[1:], counted.T, strict=True)
    )


def excited_turns(factors: Factors, model: Regressor, *, mass: float) -> Bool[np.ndarray, "b 3"]:
    """Mark the blocks in which a pilot moves roll, pitch and yaw, by the first pass of the rows."""
    fits = [_fit_row(factors, model, row, mass) for row in ROWS[1:]]
    signal = np.column_stack([fit.known_power for fit in fits])
    residual = np.column_stack([fit.residual_power for fit in fits])
    return excited_bands(factors, signal, residual)


def turned_flights(factors: Factors, model: Regressor, *, mass: float) -> Bool[np.ndarray, "b 3"]:
    """Mark for roll, pitch and yaw the blocks of the flights in which a pilot moves that axis.

    Each of several flights is judged by itself, in the pilot's band; of one alone all are marked.
    """
    flights = flights_of(factors)
    if len(flights) == 1:
        return np.ones((len(factors), 3), dtype=bool)
    turned = np.zeros((len(factors), 3), dtype=bool)
    for own in flights:
        one = factors.select(own)
        with suppress(EstimationError):  # too short or too still a flight to judge by itself
            pilots = slow_bands(one) & (one.band[:, :1] > 0.0)
            turned[own] = (excited_turns(one, model, mass=mass) & pilots).any(axis=0)
    return turned


def turn_ratios(factors: Factors, model: Regressor, *, mass: float) -> Float[np.ndarray, " 3"]:
    """Compute explained over residual power of the three turns, by the first pass of the rows."""
    return explained_ratios([_fit_row(factors, model, row, mass) for row in ROWS[1:]])


def explained_ratios(fits: Sequence[BandedFit]) -> Float[np.ndarray, " r"]:
    """Compute explained over residual power of each fit, over all blocks."""
    signal = np.array([fit.known_power.sum() for fit in fits])
    residual = np.array([fit.residual_power.sum() for fit in fits])
    explained = np.maximum(signal - residual, 0.0)
    return explained / np.maximum(residual, np.finfo(float).tiny)


def _fit_row(
    factors: Factors,
    model: Regressor,
    row: str,
    mass: float,
    first: BandedFit | None = None,
) -> BandedFit:
    """Fit one row; given the first pass, rotors may differ."""
    if row == "force":
        mapped, prior = _force_map(model, mass), _force_prior(mass)
    else:
        own_rotors = _rotor_names(model) if first is not None and row != "yaw" else ()
        mapped = _moment_map(model, row, own_rotors)
        prior = dict(NUISANCE_STD) if row != "yaw" else {}
        if first is not None and own_rotors:
            spread = ROW_SPREAD_STD * abs(first.estimate.value("kt"))
            prior |= dict.fromkeys(own_rotors, spread)
    weights = np.array([EQUATIONS[row]])
    problem = LinearProblem(
        factors=(factors,),
        tensors=(model.tensor,),
        map=_without_dead(mapped, model, weights[0]),
        weights=weights,
    )
    return reweighted(problem, prior_std=prior)


def _force_map(model: Regressor, mass: float) -> ParameterMap:
    """Return the map of the force rows: m alpha known, k_t, ms and the bias free."""
    free = ("kt", "msx", "msy", "msz", "Fx_0", "Fy_0", "Fz_0")
    return parameter_map(
        model.names, {name: {(0, name): 1.0} for name in free}, {(0, "mass"): mass}
    )


def _force_prior(mass: float) -> dict[str, float]:
    return {
        "Fx_0": mass * MOUNTING_STD,
        "Fy_0": mass * MOUNTING_STD,
        "Fz_0": mass * ACCEL_BIAS_STD,
    }


def _moment_map(model: Regressor, row: str, own_rotors: tuple[str, ...] = ()) -> ParameterMap:
    """Return the map of a moment row about the CoM with its own inertia set to 1."""
    own = OWN_INERTIA[row]
    # The two other diagonal elements enter one row only by their difference.
    first = {"roll": "Iyy", "pitch": "Izz", "yaw": "Ixx"}[row]
    free = {name: {(0, name): 1.0} for name in ("kt", "kd", "Jr", "Ixy", "Ixz", "Iyz")}
    free |= {f"kt_rotor_center_{a}": {(0, f"kt_rotor_center_{a}"): 1.0} for a in "xyz"}
    free["kt_twist"] = {(0, "kt_twist"): 1.0}
    free["difference"] = {(0, first): -1.0}
    free |= {name: {(0, name): 1.0} for name in own_rotors}
    return parameter_map(model.names, free, {(0, own): 1.0})


def _without_dead(
    mapped: ParameterMap, model: Regressor, weights: Float[np.ndarray, " j"]
) -> ParameterMap:
    """Remove the parameters that these rows do not determine from the map."""
    used = np.flatnonzero(weights)
    columns = np.einsum("pjz,pf->fjz", model.tensor[:, used], mapped.matrix[0])
    flat = dict(zip(mapped.names, columns.reshape(len(columns), -1), strict=True))
    for name, column in flat.items():
        if not column.any():
            mapped = mapped.without(name)
    # With tilted rotors one parameter may stand where another one stands: drag torque along a
    # tilted axis is a thrust torque of another size, as is the torque of twisted arms. Thrust stays
    # in the roll and pitch rows, drag in the yaw row.
    weaker = "kt" if weights[5] else "kd"
    for one, other, less in (("kt", "kd", weaker), ("kd", "kt_twist", "kt_twist")):
        if {one, other} <= set(mapped.names) and _is_parallel(flat[one], flat[other]):
            mapped = mapped.without(less)
    return mapped


def _is_parallel(one: Float[np.ndarray, " n"], other: Float[np.ndarray, " n"]) -> bool:
    return bool(abs(one @ other) > (1.0 - 1e-6) * np.linalg.norm(one) * np.linalg.norm(other))


def _rotor_names(model: Regressor) -> tuple[str, ...]:
    return tuple(name for name in model.names if name.startswith("kt_") and name[3:].isdigit())


def _rotor_made(model: Regressor, first: Mapping[str, BandedFit]) -> dict[str, Regressor]:
    """Predict the other axes' angular accelerations in each row's model by the rotors."""
    names = ("dwx", "dwy", "dwz")
    columns = [model.layout.index(name) for name in names]
    B = np.array([_fitted_row(model, row, first[row]) for row in ROWS[1:]])
    # The three moment rows of the first pass, B z = 0 with unit diagonal, solved for the angular
    # accelerations.
    G = -np.linalg.solve(B[:, columns], B)
    G[:, columns] = 0.0
    made: dict[str, Regressor] = {}
    for row in ROWS:
        swap = np.eye(len(model.layout))
        for column, prediction, own in zip(columns, G, ROWS[1:], strict=True):
            if own != row:
                swap[column] = prediction
        made[row] = dataclasses.replace(model, tensor=model.tensor @ swap)
    return made


def _fitted_row(model: Regressor, row: str, fit: BandedFit) -> Float[np.ndarray, " z"]:
    """Return the equation of a moment row at its fitted parameters."""
    mapped = _moment_map(model, row)
    phi = fit.estimate.by_name
    theta = mapped.theta(np.array([phi.get(name, 0.0) for name in mapped.names]))[0]
    return np.einsum("p,pz->z", theta, model.tensor[:, 3 + ROWS.index(row) - 1])


def row_excitation(fit: BandedFit, factors: Factors) -> float:
    """Compute the explained over the residual power of a row's angular acceleration."""
    inside = in_pilot_band(factors)
    residual = float(fit.residual_power[inside].sum())
    explained = float(fit.known_power[inside].sum()) - residual
    return max(explained, 0.0) / max(residual, np.finfo(float).tiny)


def block_diagonal(blocks: list[Float[np.ndarray, "_ _"]]) -> Float[np.ndarray, "g g"]:
    """Place square matrices of the rows along a diagonal."""
    size = sum(len(block) for block in blocks)
    whole = np.zeros((size, size))
    at = 0
    for block in blocks:
        whole[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    return whole


MOST_DRAG = 0.03
"""Drag torque over thrust of any rotor is less [m]. One moment row cannot tell the torque of drag
along tilted axes from that of thrust."""


def row_numbers(fits: RowFits, vehicle: Vehicle, *, mass: float, mass_std: float) -> Numbers:
    """Compute the physical numbers of one configuration.

    `fits`: from `fit_rows`. `vehicle`: its geometry; without a known IMU position the origin is the
    IMU. `mass`, `mass_std`: [kg].
    """
    at = fits.values
    names, values = _physical_numbers(at, fits.names, vehicle, mass)
    formal = np.sqrt(np.diagonal(fits.formal))
    jacobian = numerical_jacobian(
        lambda phi: _physical_numbers(phi, fits.names, vehicle, mass)[1], at, formal
    )
    scatter, degrees = _small_sample(fits)
    formal_cov = jacobian @ fits.formal @ jacobian.T
    scatter_cov = jacobian @ scatter @ jacobian.T
    random = t_half_width(formal_cov, scatter_cov, degrees)
    numbers = Numbers(
        names=names,
        values=values,
        terms=(
            IntervalTerm(
                name="noise",
                half_width=random,
                source="the fit and the scatter of blocks, whichever is larger",
            ),
        ),
        correlation=correlation_of(formal_cov),
        excitation=fits.excitation,
    )
    return numbers.with_terms(
        *_systematic_terms(numbers, vehicle, mass=mass, mass_std=mass_std),
    )


def _physical_numbers(
    phi: Float[np.ndarray, " f"], phi_names: tuple[str, ...], vehicle: Vehicle, mass: float
) -> tuple[tuple[str, ...], Float[np.ndarray, " q"]]:
    """Compute names and values of the physical numbers at fit parameters `phi`."""
    p = dict(zip(phi_names, phi.tolist(), strict=True))
    kt = p["force.kt"]
    inertia = _inertia_about_com(p, kt)
    com, center = _com_and_rotor_center(p, vehicle, mass)
    origin = inertia_about(np.array([inertia[k] for k in INERTIA]), mass, com)
    out: dict[str, float] = {"kt": kt}
    out |= {f"accel_bias_{a}": p[f"force.F{a}_0"] / mass for a in "xyz"}
    out |= {f"com_{a}": float(c) for a, c in zip("xyz", com, strict=True)}
    out |= {f"ms{a}": mass * float(c) for a, c in zip("xyz", com, strict=True)}
    out |= center
    for name, value in zip(INERTIA, origin, strict=True):
        if name != "Izz":
            out[name] = float(value)
            out[f"{name}_com"] = inertia[name]
    out["Ixx_over_kt"] = inertia["Ixx"] / kt
    out["Iyy_over_kt"] = inertia["Iyy"] / kt
    out["kd_over_Izz"] = p["yaw.kd"]
    out["Jr_over_Izz"] = p["yaw.Jr"]
    out["hover_speed"] = float(hover_speed(np.array([kt]), mass=mass, vehicle=vehicle)[0])
    return tuple(out), np.array(list(out.values()))


def _inertia_about_com(p: dict[str, float], kt: float) -> dict[str, float]:
    """Compute the inertia about the CoM with Izz zero: the rows do not give its scale."""
    Ixx, Iyy = kt / p["roll.kt"], kt / p["pitch.kt"]
    # Both rows hold Ixy; the roll row is divided by Ixx, the pitch row by Iyy.
    Ixy = 0.5 * (p.get("roll.Ixy", 0.0) * Ixx + p.get("pitch.Ixy", 0.0) * Iyy)
    return {
        "Ixx": Ixx,
        "Iyy": Iyy,
        "Izz": 0.0,
        "Ixy": Ixy,
        "Ixz": p.get("roll.Ixz", 0.0) * Ixx,
        "Iyz": p.get("pitch.Iyz", 0.0) * Iyy,
    }


def _com_and_rotor_center(
    p: dict[str, float], vehicle: Vehicle, mass: float
) -> tuple[Float[np.ndarray, " 3"], dict[str, float]]:
    """Compute the CoM from the origin, and the rotor centre where it is not the origin."""
    over_com = (
        p.get("pitch.kt_rotor_center_x", 0.0) / p["pitch.kt"],
        p.get("roll.kt_rotor_center_y", 0.0) / p["roll.kt"],
    )
    force = np.array([p["force.msx"], p["force.msy"], p["force.msz"]]) / mass
    # The moment rows see the rotor centre over the CoM, the force rows the CoM from the
    # accelerometer. With a known IMU position both are measured from the same origin, and the
    # moment rows, which see the trim, are the sharper; else the IMU is the origin.
    if vehicle.imu_position is None:
        return force, {
            "rotor_center_x": float(force[0]) + over_com[0],
            "rotor_center_y": float(force[1]) + over_com[1],
        }
    return np.array([-over_com[0], -over_com[1], force[2]]), {}


def _small_sample(fits: RowFits) -> tuple[Float[np.ndarray, "f f"], float]:
    """Return the scatter covariance corrected for fitted parameters, and degrees of freedom."""
    blocks = len(fits.fits["force"].variance)
    counts = [len(fits.fits[row].estimate.names) for row in ROWS]
    free = [max(blocks - count, 1) for count in counts]
    factor = np.concatenate(
        [np.full(count, np.sqrt(blocks / f)) for count, f in zip(counts, free, strict=True)]
    )
    return fits.covariance * np.outer(factor, factor), float(min(free))


def _systematic_terms(
    numbers: Numbers, vehicle: Vehicle, *, mass: float, mass_std: float
) -> tuple[IntervalTerm, ...]:
    """Return the terms by systematic errors that no scatter within the flight shows."""
    weighed = 1.96 * mass_std / mass
    lean = float(np.hypot(vehicle.axes[:, 0], vehicle.axes[:, 1]).mean())
    tilt, motion, weight = np.zeros((3, len(numbers.names)))
    for i, name in enumerate(numbers.names):
        value, rho = abs(float(numbers.values[i])), numbers.rho(name)
        if lean > 0 and name == "kd_over_Izz":
            tilt[i] = 2.0 * value  # the thrust's own yaw torque is in it
        elif lean > 0 and rho is not None:
            tilt[i] = MOST_DRAG * lean / vehicle.arm * value
        if rho is not None:
            size = max(value, number_scale(numbers, name, mass=mass, arm=vehicle.arm))
            motion[i] = attenuation_allowance(name, size, rho, with_response=False)
        if EVERY[name].mass_power:
            weight[i] = weighed * value
    return (
        IntervalTerm(name="motor tilt", half_width=tilt, source="declared axes of the rotors"),
        IntervalTerm(
            name="little motion",
            half_width=motion,
            source="motion by the rotors over motion by disturbances",
        ),
        IntervalTerm(name="weight", half_width=weight, source="declared tolerance of the mass"),
    )


def number_scale(numbers: Numbers, name: str, *, mass: float, arm: float) -> float:
    """Return the size of a number below which its relative error does not matter."""
    known = dict(zip(numbers.names, numbers.values.tolist(), strict=True))
    Ixx, Iyy = (abs(known.get(f"{moment}_com", np.nan)) for moment in ("Ixx", "Iyy"))
    # The rows do not give Izz; of flat bodies it is the sum of the others.
    return relevant_size(name, Size(mass=mass, arm=arm, moments=(Ixx, Iyy, Ixx + Iyy)))
