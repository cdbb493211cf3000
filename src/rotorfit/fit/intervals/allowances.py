"""Allowances for systematic errors of a fit's numbers, as interval terms.

What no scatter within the flights shows: what the model lacks in all of them, too little motion
against the disturbances, motors that lean, the declared tolerance of the mass.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.factors import flights_of
from rotorfit.fit.intervals.interval_terms import IntervalTerm, stretch_term
from rotorfit.fit.intervals.numbers import (
    HEIGHTS,
    LEAST_EXCITATION,
    PLACES,
    SHARES_OF_IZZ,
    YAW_PRODUCTS,
    Numbers,
    attenuation_allowance,
    com_from_imu,
    com_from_rotors,
    common_share,
    drag_lever,
    inertia_bias,
    lean_allowance,
    lean_shift,
    link_allowance,
    moments_across,
    product_allowance,
    quadrature,
    relevant_size,
    scale_stretch,
    twist_shift,
)
from rotorfit.fit.joint.trims import ENOUGH_FLIGHTS
from rotorfit.model.parameters import COM, EVERY, FIRST_MOMENTS, INERTIA
from rotorfit.model.terms.registry import TERMS
from rotorfit.model.terms.term import Size

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.fit.joint.joint_problem import JointConfiguration
    from rotorfit.model.vehicle import Vehicle

SENSOR_SIZE: Final = 1e-4
"""Half-width of the place of the IMU's origin [m]. The three accelerometers of a chip, 3 mm large,
sense at points that lie some tenths of a mm apart: no centre of mass is known better from there."""


def systematic_uncertainty(
    numbers: Numbers,
    configurations: Sequence[JointConfiguration],
    mass_std: Mapping[str, float],
) -> Numbers:
    """Append the systematic errors that no scatter within the flights shows."""
    many = any(len(flights_of(c.factors)) >= ENOUGH_FLIGHTS for c in configurations)
    common = [common_share(name.partition("@")[0]) * many for name in numbers.names]
    return numbers.with_terms(
        IntervalTerm(
            name="shared by all flights",
            half_width=np.array(common) * np.abs(numbers.values),
            source="what the model lacks in all flights alike, by simulated ones",
        ),
        IntervalTerm(
            name="little motion",
            half_width=_by_number(numbers, configurations, _little_motion),
            source="motion by the rotors over motion by disturbances",
        ),
        IntervalTerm(
            name="motor lean",
            half_width=_by_number(numbers, configurations, _motor_lean),
            source="four motors that each lean by half a degree",
        ),
        IntervalTerm(
            name="IMU size",
            half_width=_by_number(numbers, configurations, _imu_size),
            source="accelerometers of one chip that do not sense at one point",
        ),
        IntervalTerm(
            name="weight",
            half_width=1.96 * _relative_mass_std(numbers, configurations, mass_std),
            source="declared tolerance of the mass",
        ),
    )


def _by_number(
    numbers: Numbers,
    configurations: Sequence[JointConfiguration],
    allowance: Callable[[Numbers, str, JointConfiguration], float],
) -> Float[np.ndarray, " q"]:
    """Compute an allowance of every number, shared ones with the first configuration."""
    by_name = {c.name: c for c in configurations}
    owners = [name.partition("@")[2] for name in numbers.names]
    return np.array(
        [
            allowance(numbers, name, by_name[owner] if owner else configurations[0])
            for name, owner in zip(numbers.names, owners, strict=True)
        ]
    )


def _little_motion(numbers: Numbers, name: str, c: JointConfiguration) -> float:
    """Compute the half-width that too little motion about its own axis adds to a number."""
    base, _, owner = name.partition("@")
    value, rho = abs(numbers.number(name)[0]), numbers.rho(name)
    parts: list[float] = []
    if rho is not None and not rho > LEAST_EXCITATION:
        size = max(value, number_scale(numbers, name, mass=c.mass, vehicle=c.vehicle))
        parts.append(attenuation_allowance(base, size, rho, with_response=False))
    if base in YAW_PRODUCTS:
        parts.append(product_allowance(value, numbers.excitation[f"yaw@{owner}"]))
    return quadrature(parts)


def _motor_lean(numbers: Numbers, name: str, c: JointConfiguration) -> float:
    """Compute the half-width that the rotors' mean lean against the frame adds to a number."""
    base, _, owner = name.partition("@")
    if base in YAW_PRODUCTS:
        return lean_allowance(*moments_across(numbers, base, owner))
    if base in PLACES:
        com, lever = com_from_imu(numbers, owner, c.vehicle), drag_lever(numbers, c.vehicle)
        return lean_shift(base, com, c.mass, lever)
    if base == "twist" and f"com_x@{owner}" in numbers.names:
        return twist_shift(com_from_rotors(numbers, owner, c.vehicle))
    return 0.0


def _imu_size(numbers: Numbers, name: str, c: JointConfiguration) -> float:
    """Compute the half-width of a place of the centre of mass, or its moment, by the IMU's size."""
    base = name.partition("@")[0]
    if base in FIRST_MOMENTS:
        return c.mass * SENSOR_SIZE
    return SENSOR_SIZE if base in COM else 0.0


def _relative_mass_std(
    numbers: Numbers, configurations: Sequence[JointConfiguration], mass_std: Mapping[str, float]
) -> Float[np.ndarray, " q"]:
    """Compute the deviation that the masses' deviations make of each number."""
    shares = {c.name: mass_std[c.name] / c.mass for c in configurations}
    std = np.zeros(len(numbers.names))
    for i, name in enumerate(numbers.names):
        base, _, owner = name.partition("@")
        if EVERY[base].mass_power:
            share = shares[owner] if owner else max(shares.values())
            std[i] = share * abs(float(numbers.values[i]))
    return std


def inertia_uncertainty(
    numbers: Numbers,
    configurations: Sequence[JointConfiguration],
    std: Float[np.ndarray, " q"],
) -> Numbers:
    """Append what an inertia that is not identifiable adds to the numbers on the scale of yaw.

    `std`: deviations of the fit, of every number.
    """
    squares = np.zeros(len(std))
    scaled = [i for i, n in enumerate(numbers.names) if numbers.on_yaw_scale(n)]
    for configuration in configurations:
        for name in ("Ixx_com", "Iyy_com"):
            own = numbers.index(f"{name}@{configuration.name}")
            rho = numbers.rho(numbers.names[own])
            if rho is None or rho > LEAST_EXCITATION or not std[own] > 0.0:
                continue
            bias = inertia_bias(float(numbers.values[own]), rho)
            # What yaw does to roll is in proportion to I_zz less I_yy: where nobody pitches, an
            # I_yy that gusts bias moves I_zz with it, as far as the two go together in the fit.
            slopes = numbers.correlation[own, scaled] * std[scaled] / std[own]
            squares[scaled] += (slopes * bias) ** 2
    return numbers.with_terms(
        IntervalTerm(
            name="inertia not flown",
            half_width=np.sqrt(squares),
            source="bias by gusts of an Ixx or Iyy that is hardly flown",
        )
    )


def air_uncertainty(
    numbers: Numbers, configurations: Sequence[JointConfiguration], std: Float[np.ndarray, " q"]
) -> Numbers:
    """Append what terms of the air leave open that have not the whole form of their effects.

    `std`: deviations of the fit, of every number.
    """
    added = configurations[0].model.layout.added
    squares = np.zeros(len(std))
    for term in TERMS:
        if not {*term.with_velocity, *term.signals} & {*added}:
            continue
        # Flights of one vehicle at speed differ in such a coefficient by more than chance.
        for name in (n for n, info in term.parameters.items() if info.form_error):
            if name not in numbers.names or not std[numbers.index(name)] > 0.0:
                continue
            own = numbers.index(name)
            # What a fit with the coefficient off by that share would give moves the other numbers
            # as far as they go together with it; in slow flights, which hardly show it, by next to
            # nothing.
            off = term.parameters[name].form_error * abs(float(numbers.values[own]))
            squares += (1.96 * numbers.correlation[own] * std / std[own] * off) ** 2
    return numbers.with_terms(
        IntervalTerm(
            name="air at speed",
            half_width=np.sqrt(squares),
            source="what flights of one vehicle at speed differ by",
        )
    )


def coupling_uncertainty(numbers: Numbers, configurations: Sequence[JointConfiguration]) -> Numbers:
    """Append what too little roll and pitch adds to the numbers on the scale of yaw."""
    weighed = any(c.payload_of is not None for c in configurations)
    linked = np.zeros(len(numbers.names))
    for i, name in enumerate(numbers.names):
        base, _, owner = name.partition("@")
        link = numbers.link(owner if base in HEIGHTS and not weighed else None)
        # A known payload gives the scale of the yaw equation as well.
        depends = base in HEIGHTS or (numbers.on_yaw_scale(name) and not weighed)
        if depends and not link > LEAST_EXCITATION:
            linked[i] = link_allowance(float(numbers.values[i]), link)
    numbers = numbers.with_terms(
        IntervalTerm(
            name="little roll and pitch",
            half_width=linked,
            source="motion by the rotors over motion by disturbances, roll and pitch",
        )
    )
    return numbers.with_terms(
        IntervalTerm(
            name="yaw scale",
            half_width=stretch_term(numbers.half_width, _stretch_factors(numbers)),
            source="the interval of the scale of yaw holds its inverse, too",
        )
    )


def _stretch_factors(numbers: Numbers) -> Float[np.ndarray, " q"]:
    """Compute the factor of each half-width that makes it hold the inverse of the scale, too."""
    half = numbers.half_width
    stretch = np.ones(len(half))
    for i, name in enumerate(numbers.names):
        base, _, owner = name.partition("@")
        if not numbers.on_yaw_scale(name) and base not in YAW_PRODUCTS:
            continue
        # J_r and the rotors' drag may be near zero; their scale is that of k_d.
        at = numbers.index(f"Izz_com@{owner}" if owner else "kd")
        scale, scale_half = abs(float(numbers.values[at])), float(half[at])
        stretch[i] = scale_stretch(scale, scale_half)
        if stretch[i] * scale_half < scale:
            continue
        # The flights do not tell the scale from zero, and it may be many times what was found; but
        # I_zz is at most I_xx + I_yy, as of every body.
        stretch[i] = np.inf
        if base in SHARES_OF_IZZ:
            Ixx, Iyy, Izz = (abs(numbers.number(f"{n}_com@{owner}")[0]) for n in INERTIA[:3])
            stretch[i] = max((Ixx + Iyy) / max(Izz, np.finfo(float).tiny), 1.0)
    return stretch


def number_scale(numbers: Numbers, name: str, *, mass: float, vehicle: Vehicle) -> float:
    """Return the size of a number below which its relative error does not matter."""
    base, _, owner = name.partition("@")
    if base == "Jr_over_Izz":
        return 1e-3
    # Shared numbers: with the speeds and the inertia of any configuration.
    own = owner or next((n for n in numbers.names if "@" in n), "").partition("@")[2]
    known = dict(zip(numbers.names, numbers.values.tolist(), strict=True))
    hover = next((v for n, v in known.items() if n.startswith("hover_speed")), np.nan)
    Ixx, Iyy, Izz = (known.get(f"{name}_com@{own}", np.nan) for name in INERTIA[:3])
    speeds = len(vehicle.rotors) * hover
    size = Size(mass=mass, arm=vehicle.arm, speeds=speeds, moments=(Ixx, Iyy, Izz))
    return relevant_size(base, size)
