"""From a result to the vehicle of a replay, and to draws of it within its intervals."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import ExperimentError
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.fit.experiment.experiment import experiment_of_settings
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import COM, INERTIA_COM, PARAMETERS
from rotorfit.model.terms.registry import TERMS
from rotorfit.results.hover_balance import fitted_balance, fitted_thrusts
from rotorfit.results.samples import about_com, normal_draws, tensors

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Bool, Float

    from rotorfit.model.vehicle import Vehicle
    from rotorfit.results.result import IdentificationResult
    from rotorfit.results.samples import Values

NEEDED: Final = ("kt", "kd", *COM, *INERTIA_COM)
ROTOR_CENTER: Final = ("rotor_center_x", "rotor_center_y")
SPARE: Final = 4
"""Draws made for each one wanted: where an interval is wide, some are no body."""
AIR_NAMES: Final = tuple(
    name
    for term in TERMS
    if term.needs == "velocity" or term.with_velocity
    for name in term.parameters
)
"""Parameters of forces over the velocity."""
ROTOR_KT: Final = re.compile(r"kt_[0-9]+")
"""Names of the thrust coefficients of single rotors."""


@frozen_dataclass
class ReplayVehicle:
    """D vehicles of one geometry, the nominal one first, body axes FLU.

    - `mass`: [kg]
    - `com`: from the origin [m].
    - `inertia`: about the CoM [kg m^2].
    - `thrust`: force of each rotor per squared speed [N s^2/rad^2].
    - `torque`: torque of each rotor about the CoM per squared speed [N m s^2/rad^2].
    - `speed_torque`: torque of each rotor per speed [N m s/rad].
    - `spin`: angular momentum of each rotor per speed [kg m^2].
    - `damping`: torque of each rotor against a turn about z, per rate and speed [N m s^2/rad^2].
    - `air`: coefficients of `AIR_NAMES`, zero where the model does not have them.
    - `offset`: torque that does not change [N m].
    - `accel_bias`: [m/s^2]
    - `imu`: place of the accelerometer from the origin [m].
    """

    mass: Float[np.ndarray, " D"]
    com: Float[np.ndarray, "D 3"]
    inertia: Float[np.ndarray, "D 3 3"]
    thrust: Float[np.ndarray, "D N 3"]
    torque: Float[np.ndarray, "D N 3"]
    speed_torque: Float[np.ndarray, "D N 3"]
    spin: Float[np.ndarray, "D N 3"]
    damping: Float[np.ndarray, "D N"]
    air: Float[np.ndarray, "D P"]
    offset: Float[np.ndarray, "D 3"]
    accel_bias: Float[np.ndarray, "D 3"]
    imu: Float[np.ndarray, " 3"]


def unknown_body(
    result: IdentificationResult, owner: str, assumed: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Supply what a replay can do without: places of a hover, and no products of inertia [SI]."""
    removed = {p.name for p in result.parameters if p.verdict == "removed"}
    products = {
        # As of a symmetric frame.
        d.name: 0.0
        for d in result.derived
        if d.configuration == owner and d.name in INERTIA_COM[3:] and d.value is None
        if not {d.name, d.name.removesuffix("_com")} & (removed | set(assumed or {}))
    }
    return hover_centre(result, owner, assumed) | products


def hover_centre(
    result: IdentificationResult, owner: str, assumed: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Place centre of mass and rotors to each other along x and y where one is not known [m].

    A hover holds the two together, though it may tell neither from the IMU: as the fit had them
    with each rotor's thrust, or, where the result does not keep that, over each other. Where both
    are unknown, the rotors stand as declared. Empty where both are known.
    """
    given = _known_places(result, owner) | dict(assumed or {})
    listed = {p.name for p in result.parameters if p.configuration == owner}
    unknown = {"com_x", "com_y", *listed.intersection(ROTOR_CENTER)} - given.keys()
    if not unknown:
        return {}
    experiment = experiment_of_settings(result.settings)
    vehicle = vehicle_of(experiment.airframe, experiment.identification.source)
    places = dict(given)
    for axis, middle in zip("xy", vehicle.positions.mean(axis=0)[:2].tolist(), strict=True):
        com, center = f"com_{axis}", f"rotor_center_{axis}"
        fitted = fitted_balance(result, owner, axis)
        balance = middle if fitted is None else fitted
        offset = places.get(com, balance) - balance if center in listed else 0.0
        places.setdefault(com, balance + places.setdefault(center, offset))
    return {name: places[name] for name in sorted(unknown)}


def places_of(result: IdentificationResult, owner: str) -> dict[str, float]:
    """Collect where centre of mass and rotors are: as found, else as in a hover [m]."""
    return _known_places(result, owner) | hover_centre(result, owner)


def _known_places(result: IdentificationResult, owner: str) -> dict[str, float]:
    """Collect where centre of mass and rotor centre are known to be [m]."""
    own = [one for one in (*result.parameters, *result.derived) if one.configuration == owner]
    values = {one.name: one.value for one in own if one.value is not None}
    values |= {p.name: 0.0 for p in result.parameters if p in own and p.verdict == "removed"}
    mass = values.get("mass") or 1.0
    moments = {f"com_{a}": values[f"ms{a}"] / mass for a in "xy" if f"ms{a}" in values}
    places = {n: v for n, v in values.items() if n in (*ROTOR_CENTER, "com_x", "com_y")}
    return moments | places


def replay_vehicle(
    result: IdentificationResult,
    owner: str,
    *,
    assumed: Mapping[str, float] | None = None,
    draws: int = 0,
) -> ReplayVehicle:
    """Build the vehicle of a configuration, and draws of it from the result's covariance.

    `assumed` numbers by name, SI, replace the result's: inertia and CoM as ``Ixx_com``, ``com_x``,
    or at the origin as ``Ixx``; a ``kt`` is that of all rotors. Draws that are no body (inertia
    that is not positive, thrust that pulls down) are left out. Raises `ExperimentError` where a
    needed number is neither known nor assumed, or no body has such inertia. What it can do
    without is that of `unknown_body`.
    """
    given = unknown_body(result, owner, assumed) | dict(assumed or {})
    experiment = experiment_of_settings(result.settings)
    vehicle = vehicle_of(experiment.airframe, experiment.identification.source)
    values = about_com(
        _insert_given(_draw_numbers(result, owner, SPARE * draws), given, result, owner)
    )
    # About the CoM the result may know what at the origin it does not: then without draws.
    scale = given.get("mass", 1.0) if result.parameter("mass", owner).value is None else 1.0
    for d in result.derived:
        if d.configuration == owner and d.name in (*COM, *INERTIA_COM) and d.value is not None:
            factor = scale if d.name in INERTIA_COM else 1.0
            values.setdefault(d.name, np.full_like(values["mass"], factor * d.value))
    values |= {name: np.full_like(values["mass"], given[name]) for name in given}
    listed = [p.name for p in result.parameters if p.configuration == owner]
    needed = (*NEEDED, *(name for name in ROTOR_CENTER if name in listed))
    missing = [name for name in needed if name not in values]
    if missing:
        raise ExperimentError(
            f"{', '.join(missing)} of configuration {owner}: not known from these flights, and "
            "the model cannot fly without; give your own (--assume NAME=VALUE)"
        )
    stack = _stack_values(values, vehicle)
    good = _can_fly(stack)
    if not good[0]:
        raise ExperimentError(
            "no body has the inertia about the CoM that these numbers give (or thrust is not "
            "positive): identify again, or put your own in its place (--assume Ixx_com=VALUE)"
        )
    rows = np.flatnonzero(good)[: draws + 1]
    stacked = (field.name for field in fields(ReplayVehicle) if field.name != "imu")
    return replace(stack, **{name: getattr(stack, name)[rows] for name in stacked})


def _draw_numbers(result: IdentificationResult, owner: str, draws: int) -> Values:
    """Draw the known parameters of a configuration, the nominal ones first."""
    shift = np.zeros((1 + draws, len(result.covariance_names)))
    if draws and result.covariance_names:
        shift[1:] = normal_draws(result.covariance, draws, np.random.default_rng(0))
    columns = {name: i for i, name in enumerate(result.covariance_names)}
    values: Values = {"mass": np.ones(1 + draws)}
    for p in result.parameters:
        if p.configuration not in (None, owner):
            continue
        if p.verdict == "removed":
            values[p.name] = np.zeros(1 + draws)
        elif p.value is not None:
            moved = shift[:, columns[p.full_name]] if p.full_name in columns else 0.0
            values[p.name] = p.value + moved + np.zeros(1 + draws)
    return values | fitted_thrusts(result, values)


def _insert_given(
    values: Values, given: Mapping[str, float], result: IdentificationResult, owner: str
) -> Values:
    """Insert assumed numbers; an assumed mass makes what is per kilogram absolute.

    An assumed kt replaces each rotor's own coefficient.
    """
    unknown = result.parameter("mass", owner).value is None
    out = dict(values)
    if unknown and "mass" in given:
        for name in values:
            if PARAMETERS[name].mass_power:
                out[name] = values[name] * given["mass"]
    if "kt" in given:
        out = {name: value for name, value in out.items() if not ROTOR_KT.fullmatch(name)}
    return out | {name: np.full_like(out["mass"], given[name]) for name in given if name in out}


def _stack_values(values: Values, vehicle: Vehicle) -> ReplayVehicle:
    """Stack the values as arrays for a step of the motion."""
    zero = np.zeros_like(values["mass"])

    def columns(*names: str) -> Float[np.ndarray, "D k"]:
        return np.stack([values.get(name, zero) for name in names], axis=1)

    n, s = vehicle.axes, vehicle.spins
    com = columns(*COM)
    kt = np.stack([values.get(f"kt_{i + 1}", values["kt"]) for i in range(len(n))], axis=1)
    arms = vehicle.positions - com[:, None]
    if vehicle.imu_position is None:  # rotors are declared about their centre, which was found
        arms = arms + columns(*ROTOR_CENTER, "rotor_center_z")[:, None]
    thrust = kt[:, :, None] * n
    spin = s[:, None] * n
    added = {
        "torque": np.cross(arms, thrust) - values["kd"][:, None, None] * spin,
        "speed_torque": np.zeros(thrust.shape),
        "damping": np.zeros((len(zero), len(n))),
        "offset": np.zeros((len(zero), 3)),
    }
    every = {name: zero for term in TERMS for name in term.parameters} | values
    for replayed in (term.replayed for term in TERMS if term.replayed is not None):
        for field, more in replayed(every, vehicle).items():
            added[field] = added[field] + more
    return ReplayVehicle(
        mass=values["mass"],
        com=com,
        inertia=tensors({name: values.get(name, zero) for name in INERTIA_COM}),
        thrust=thrust,
        spin=values.get("Jr", zero)[:, None, None] * spin,
        air=columns(*AIR_NAMES),
        accel_bias=columns("accel_bias_x", "accel_bias_y", "accel_bias_z"),
        imu=np.array(vehicle.imu_position or (0.0, 0.0, 0.0)),
        **added,
    )


def _can_fly(stack: ReplayVehicle) -> Bool[np.ndarray, " D"]:
    """Select the vehicles that can fly: finite, inertia positive, thrust upwards."""
    whole = np.concatenate([stack.inertia, stack.torque, stack.thrust], axis=1)
    finite: Bool[np.ndarray, " D"] = np.all(np.isfinite(whole), axis=(1, 2))
    least = np.full(finite.shape, -1.0)
    least[finite] = np.linalg.eigvalsh(stack.inertia[finite])[:, 0]
    return finite & (least > 0.0) & (stack.thrust[:, :, 2] > 0.0).all(axis=1)
