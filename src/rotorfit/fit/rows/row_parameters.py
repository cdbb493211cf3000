"""From the row fits to physical parameters: values, joint covariance, intervals.

Half-width^2 = (larger of 1.96 formal and t scatter)^2 + (c |value| / rho)^2 + what the geometry
leaves open. Formal: the bands' own variances; scatter: the one-step jackknife over stretches and
bands; rho: excitation of the axis, whose lack pulls every estimate of that axis to one side, by up
to c = 2.5 for roll and pitch, 1.5 for the ratios of yaw (`excitation.py` has it exactly).
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from rotorfit.estimation.estimate import numerical_jacobian
from rotorfit.fit.intervals.excitation import attenuation_allowance
from rotorfit.fit.intervals.numbers import (
    Numbers,
    correlation_of,
    hover_speed,
    quadrature,
    relevant_size,
    t_half_width,
)
from rotorfit.fit.rows.row_fits import ROWS, RowFits
from rotorfit.model.parameters import EVERY, INERTIA, inertia_about
from rotorfit.model.terms.term import Size
from rotorfit.model.vehicle import Vehicle

MOST_DRAG = 0.03
"""Drag torque over thrust of any rotor is less [m]. One moment row cannot tell the torque of drag
along tilted axes from that of thrust."""


def row_numbers(fits: RowFits, vehicle: Vehicle, *, mass: float, mass_std: float) -> Numbers:
    """Return the physical numbers of one configuration.

    Parameters
    ----------
    fits
        From `fit_rows`.
    vehicle
        Its geometry; without a known IMU position the origin is the IMU.
    mass, mass_std
        [kg]
    """
    at = fits.values
    names, values = _physical(at, fits.names, vehicle, mass)
    formal = np.sqrt(np.diagonal(fits.formal))
    jacobian = numerical_jacobian(
        lambda phi: _physical(phi, fits.names, vehicle, mass)[1], at, formal
    )
    scatter, degrees = _small_sample(fits)
    formal_cov = jacobian @ fits.formal @ jacobian.T
    scatter_cov = jacobian @ scatter @ jacobian.T
    random = t_half_width(formal_cov, scatter_cov, degrees)
    numbers = Numbers(
        names=names,
        values=values,
        half_width=random,
        correlation=correlation_of(formal_cov),
        excitation=fits.excitation,
    )
    systematic = _systematic(numbers, vehicle, mass=mass, mass_std=mass_std)
    return replace(numbers, half_width=np.hypot(random, systematic))


def _physical(
    phi: Float[np.ndarray, " f"], phi_names: tuple[str, ...], vehicle: Vehicle, mass: float
) -> tuple[tuple[str, ...], Float[np.ndarray, " q"]]:
    """Return names and values of the physical numbers at fit parameters `phi`."""
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
    out["hover_speed"] = hover_speed(kt, mass=mass, vehicle=vehicle)
    return tuple(out), np.array(list(out.values()))


def _inertia_about_com(p: dict[str, float], kt: float) -> dict[str, float]:
    """Return the inertia about the CoM, without Izz (zero), whose scale the rows do not give."""
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
    """Return the CoM from the origin, and the rotor centre where it is not the origin itself.

    The moment rows see the rotor centre over the CoM, the force rows the CoM from the
    accelerometer. With a known IMU position both are measured from the same origin, and the
    moment rows, which see the trim, are the sharper; else the IMU is the origin.
    """
    over_com = (
        p.get("pitch.kt_rotor_center_x", 0.0) / p["pitch.kt"],
        p.get("roll.kt_rotor_center_y", 0.0) / p["roll.kt"],
    )
    force = np.array([p["force.msx"], p["force.msy"], p["force.msz"]]) / mass
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


def _systematic(
    numbers: Numbers, vehicle: Vehicle, *, mass: float, mass_std: float
) -> Float[np.ndarray, " q"]:
    """Return the half-width of what no scatter within the flight shows."""
    weighed = 1.96 * mass_std / mass
    lean = float(np.hypot(vehicle.axes[:, 0], vehicle.axes[:, 1]).mean())
    result = np.zeros(len(numbers.names))
    for i, name in enumerate(numbers.names):
        value, rho = abs(float(numbers.values[i])), numbers.rho(name)
        parts: list[float] = []
        if lean > 0 and name == "kd_over_Izz":
            parts.append(2.0 * value)  # the thrust's own yaw torque is in it
        elif lean > 0 and rho is not None:
            parts.append(MOST_DRAG * lean / vehicle.arm * value)
        if rho is not None:
            size = max(value, number_scale(numbers, name, mass=mass, arm=vehicle.arm))
            parts.append(attenuation_allowance(name, size, rho, with_response=False))
        if EVERY[name].mass_power:
            parts.append(weighed * value)
        result[i] = quadrature(parts)
    return result


def number_scale(numbers: Numbers, name: str, *, mass: float, arm: float) -> float:
    """Return the size of a number below which its relative error does not matter."""
    known = dict(zip(numbers.names, numbers.values.tolist(), strict=True))
    Ixx, Iyy = (abs(known.get(f"{moment}_com", np.nan)) for moment in ("Ixx", "Iyy"))
    # The rows do not give Izz; of flat bodies it is the sum of the others.
    return relevant_size(name, Size(mass=mass, arm=arm, moments=(Ixx, Iyy, Ixx + Iyy)))
