"""The parameter map of the default estimator, from the free parameters to every configuration's.

Shared are kt, kd, Jr and one spread per rotor or group of rotors; all else each configuration has
for itself, under names that end in ``@`` and its name.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.estimation.factors import Factors
from rotorfit.estimation.parameter_map import ParameterMap, parameter_map
from rotorfit.experiment.model_terms import DEFAULT_TERMS, Term
from rotorfit.experiment.payload import MOMENTS, PointMass, added_moments, tolerances
from rotorfit.fit.joint.closed_loop import NOMINAL_RESPONSE, ClosedLoopResponse
from rotorfit.fit.joint.trims import UNSEEN, Scatter
from rotorfit.model.parameters import DRAG, DRAG_MOMENTS, ROTORS_AIR, TURN_DAMPING
from rotorfit.model.regressor import Regressor
from rotorfit.model.vehicle import Vehicle
from rotorfit.reduction.motor_timing import FreeTiming

CROSS = {"x": (("y", "z", 1.0), ("z", "y", -1.0)),
         "y": (("z", "x", 1.0), ("x", "z", -1.0)),
         "z": (("x", "y", 1.0), ("y", "x", -1.0))}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class JointConfiguration:
    """One configuration as the joint estimate sees it.

    With `payload_of`, its body is that of the named configuration plus the known `payload`: it has
    no first moments and inertia of its own to estimate. `counted` and `answered` are those of
    `steering.py`: which errors of each block count, and which of those of the turns the autopilot
    answers; `answer` how far; `tied` (also from there) how much of the errors of the turns comes
    with those of the forces. `timing` is what a fit may move of the motors' timing. `scatter`:
    by how much its flights differ.
    """

    name: str
    mass: float
    factors: Factors
    model: Regressor
    vehicle: Vehicle
    payload: tuple[PointMass, ...] = ()
    payload_of: str | None = None
    counted: Bool[np.ndarray, "b 6"] | None = None
    answered: Bool[np.ndarray, "b e"] | None = None
    tied: Float[np.ndarray, "6 6"] | None = None
    timing: FreeTiming | None = None
    answer: ClosedLoopResponse = NOMINAL_RESPONSE
    scatter: Scatter = UNSEEN


def joint_map(
    configurations: Sequence[JointConfiguration], *, terms: Collection[Term] = DEFAULT_TERMS
) -> ParameterMap:
    """Return the map from the free parameters to theta of every configuration."""
    spread = spread_names(configurations[0].vehicle) if "rotor_spread" in terms else ()
    everywhere = range(len(configurations))
    shared = ("kt", "kd", "Jr") if "rotor_inertia" in terms else ("kt", "kd")
    shared = (*shared, *(name for name in ("rotor_drag", *ROTORS_AIR) if name in terms))
    free: dict[str, dict[tuple[int, str], float]] = {
        name: {(c, name): 1.0 for c in everywhere} for name in shared
    }
    free |= {name: {} for name in dict.fromkeys(spread)}
    timing = configurations[0].timing
    free |= {name: {} for name in (() if timing is None else timing.names)}
    given: dict[tuple[int, str], float] = {}
    products: dict[tuple[int, str], list[tuple[float, str, str]]] = {}
    for c, configuration in enumerate(configurations):
        given[c, "mass"] = configuration.mass
        free |= _own_parameters(c, configuration) | _own_terms(c, configuration, terms)
        products |= _rotor_terms(c, configuration, spread)
        if "accel_bias" in terms:
            products |= _bias_torque(c, configuration)
        if "twist" in terms:
            products[c, "kt_twist"] = [(1.0, "kt", f"twist@{configuration.name}")]
    for c, configuration in enumerate(configurations):
        if configuration.payload_of is not None:
            added = added_moments(configuration.payload)
            given |= {(c, name): value for name, value in added.items()}
            _link_payload(c, configuration, added, free)
    return parameter_map(
        configurations[0].model.names,
        free,
        given,
        configurations=len(configurations),
        products=products,
    )


def _own_parameters(
    c: int, configuration: JointConfiguration
) -> dict[str, dict[tuple[int, str], float]]:
    """Return the linear parameters of one configuration."""
    at = f"@{configuration.name}"
    free: dict[str, dict[tuple[int, str], float]] = {}
    if configuration.payload_of is None:
        free |= {f"{name}{at}": {(c, name): 1.0} for name in MOMENTS}
    for name, _, effect in tolerances(configuration.payload):
        free[f"{name}{at}"] = {(c, moment): factor for moment, factor in effect.items()}
    if configuration.vehicle.imu_position is None:
        free |= {f"rotor_center_{axis}{at}": {} for axis in "xy"}
    return free


def _own_terms(
    c: int, configuration: JointConfiguration, terms: Collection[Term]
) -> dict[str, dict[tuple[int, str], float]]:
    """Return the parameters of the optional terms that each configuration has for itself."""
    at = f"@{configuration.name}"
    free: dict[str, dict[tuple[int, str], float]] = {}
    if "accel_bias" in terms:
        mass = configuration.mass
        free |= {f"accel_bias_{axis}{at}": {(c, f"F{axis}_0"): mass} for axis in "xyz"}
    if "twist" in terms:
        free[f"twist{at}"] = {}
    if "climb_drag" in terms and "climb" in configuration.model.layout:
        free[f"climb_drag{at}"] = {(c, "climb_drag"): 1.0}
    if "drag" in terms:
        free |= {f"{name}{at}": {(c, name): 1.0} for name in (*DRAG, *DRAG_MOMENTS)}
    if "turn_damping" in terms:
        free |= {f"{name}{at}": {(c, name): 1.0} for name in TURN_DAMPING}
    if "torque_offset" in terms:
        free |= {f"torque_offset_{axis}{at}": {(c, f"M{axis}_0"): 1.0} for axis in "xyz"}
    return free


def spread_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the spread of each rotor: its own, or that of the first rotor of its group.

    None where all rotors are of one group, which has nothing to differ from.
    """
    groups = [rotor.group for rotor in vehicle.rotors]
    first = [i if group is None else groups.index(group) for i, group in enumerate(groups)]
    return () if len(set(first)) == 1 else tuple(f"spread_{i + 1}" for i in first)


def _link_payload(
    c: int,
    configuration: JointConfiguration,
    added: Mapping[str, float],
    free: dict[str, dict[tuple[int, str], float]],
) -> None:
    """Let the body's parameters move a second configuration too, which is it plus a payload."""
    for name in MOMENTS:
        free[f"{name}@{configuration.payload_of}"][c, name] = 1.0
    # ms x b with ms = ms of the bare body + what the payload adds: the second part is linear.
    for axis, pairs in CROSS.items():
        for first, second, sign in pairs:
            bias = f"accel_bias_{second}@{configuration.name}"
            if bias in free:
                free[bias][c, f"M{axis}_0"] = sign * added[f"ms{first}"]


def _bias_torque(
    c: int, configuration: JointConfiguration
) -> dict[tuple[int, str], list[tuple[float, str, str]]]:
    """Return ms x b: what the bias does in the moment rows, ms x (alpha - b)."""
    at = f"@{configuration.name}"
    body = f"@{configuration.payload_of or configuration.name}"
    return {
        (c, f"M{axis}_0"): [
            (sign, f"ms{first}{body}", f"accel_bias_{second}{at}") for first, second, sign in pairs
        ]
        for axis, pairs in CROSS.items()
    }


def _rotor_terms(
    c: int, configuration: JointConfiguration, spread: Sequence[str]
) -> dict[tuple[int, str], list[tuple[float, str, str]]]:
    """Return k_t times the spread of each rotor (over all rotors zero) and times the centre."""
    mean = {name: spread.count(name) / len(spread) for name in spread}
    terms: dict[tuple[int, str], list[tuple[float, str, str]]] = {
        (c, f"kt_{i}"): [(float(name == own) - share, "kt", name) for name, share in mean.items()]
        for i, own in enumerate(spread, start=1)
    }
    if configuration.vehicle.imu_position is None:
        at = f"@{configuration.name}"
        for axis in "xy":
            terms[c, f"kt_rotor_center_{axis}"] = [(1.0, "kt", f"rotor_center_{axis}{at}")]
    return terms
