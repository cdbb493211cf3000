"""All equations of all configurations at once: the parameter map of the default estimator.

Free parameters: kt, kd, Jr, one spread per rotor (all shared); and per configuration the first
moments, the inertia at the origin, the accelerometer's bias, and, where the IMU's place is unknown
and so is the origin itself, the centre of the rotors. The names of a configuration's parameters end
in ``@`` and its name.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rotorfit.estimation.banded import BandedEstimate, BandedProblem, banded
from rotorfit.estimation.factors import Factors
from rotorfit.estimation.parameter_map import ParameterMap, parameter_map
from rotorfit.identification.payload import MOMENTS, PointMass, added_moments, tolerances
from rotorfit.identification.rows import (
    ACCEL_BIAS_STD,
    MOUNTING_STD,
    ROTOR_SPREAD_STD,
    RowFits,
)
from rotorfit.model.regressor import Regressor
from rotorfit.model.vehicle import Vehicle

NOISY = ("ax", "ay", "az", "dwx", "dwy", "dwz")
"""The signals that carry the noise: what accelerometer and gyro measure."""
BIAS_STD = {"x": MOUNTING_STD, "y": MOUNTING_STD, "z": ACCEL_BIAS_STD}
"""Known of a calibrated accelerometer before the flight [m/s^2]; sideways, three degrees between
IMU and rotor plane look the same."""
CROSS = {"x": (("y", "z", 1.0), ("z", "y", -1.0)),
         "y": (("z", "x", 1.0), ("x", "z", -1.0)),
         "z": (("x", "y", 1.0), ("y", "x", -1.0))}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class JointConfiguration:
    """One configuration as the joint estimate sees it.

    With `payload_of`, its body is that of the named configuration plus the known `payload`: it has
    no first moments and inertia of its own to estimate.
    """

    name: str
    mass: float
    factors: Factors
    model: Regressor
    vehicle: Vehicle
    payload: tuple[PointMass, ...] = ()
    payload_of: str | None = None


def joint_estimate(
    configurations: Sequence[JointConfiguration], starts: Sequence[RowFits]
) -> BandedEstimate:
    """Return the estimate of all configurations together.

    Parameters
    ----------
    configurations
        Their factors per stretch and frequency band.
    starts
        The row fits of each, from which the iteration begins.
    """
    mapped = joint_map(configurations)
    layout = configurations[0].model.layout
    spread = [name for name in mapped.names if name.startswith("spread_")]
    prior = dict.fromkeys(spread, ROTOR_SPREAD_STD)
    for configuration in configurations:
        prior |= {f"accel_bias_{axis}@{configuration.name}": std for axis, std in BIAS_STD.items()}
        prior |= {
            f"{name}@{configuration.name}": std
            for name, std, _ in tolerances(configuration.payload)
        }
    problem = BandedProblem(
        factors=tuple(c.factors for c in configurations),
        tensors=tuple(c.model.tensor for c in configurations),
        map=mapped,
        noisy=tuple(layout.index(name) for name in NOISY),
        prior_mean={},
        prior_std=prior,
    )
    return banded(problem, joint_start(mapped, configurations, starts))


def joint_map(configurations: Sequence[JointConfiguration]) -> ParameterMap:
    """Return the map from the free parameters to theta of every configuration."""
    count = len(configurations[0].vehicle.rotors)
    everywhere = range(len(configurations))
    free: dict[str, dict[tuple[int, str], float]] = {
        name: {(c, name): 1.0 for c in everywhere} for name in ("kt", "kd", "Jr")
    }
    free |= {f"spread_{i + 1}": {} for i in range(count)}
    given: dict[tuple[int, str], float] = {}
    products: dict[tuple[int, str], list[tuple[float, str, str]]] = {}
    for c, configuration in enumerate(configurations):
        given[c, "mass"] = configuration.mass
        free |= _own_parameters(c, configuration)
        products |= _bias_torque(c, configuration) | _rotor_terms(c, configuration)
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
    for axis in "xyz":
        free[f"accel_bias_{axis}{at}"] = {(c, f"F{axis}_0"): configuration.mass}
    if configuration.vehicle.imu_position is None:
        free |= {f"rotor_center_{axis}{at}": {} for axis in "xy"}
    return free


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
    c: int, configuration: JointConfiguration
) -> dict[tuple[int, str], list[tuple[float, str, str]]]:
    """Return k_t times the spread of each rotor (spreads sum to zero) and times the centre."""
    n = len(configuration.vehicle.rotors)
    terms: dict[tuple[int, str], list[tuple[float, str, str]]] = {
        (c, f"kt_{i + 1}"): [(float(i == j) - 1.0 / n, "kt", f"spread_{j + 1}") for j in range(n)]
        for i in range(n)
    }
    if configuration.vehicle.imu_position is None:
        at = f"@{configuration.name}"
        for axis in "xy":
            terms[c, f"kt_rotor_center_{axis}"] = [(1.0, "kt", f"rotor_center_{axis}{at}")]
    return terms


def joint_start(
    mapped: ParameterMap,
    configurations: Sequence[JointConfiguration],
    starts: Sequence[RowFits],
) -> Float[np.ndarray, " f"]:
    """Return where the iteration begins: the row fits, yaw inertia as of a flat body."""
    kt = float(np.mean([s.fits["force"].estimate.value("kt") for s in starts]))
    values: dict[str, float] = {"kt": kt}
    for configuration, rows in zip(configurations, starts, strict=True):
        if configuration.payload_of is not None:
            continue
        at = f"@{configuration.name}"
        Ixx = kt / rows.fits["roll"].estimate.value("kt")
        Iyy = kt / rows.fits["pitch"].estimate.value("kt")
        yaw = rows.fits["yaw"].estimate
        values |= {f"Ixx{at}": Ixx, f"Iyy{at}": Iyy, f"Izz{at}": Ixx + Iyy}
        values["kd"] = (Ixx + Iyy) * yaw.value("kd")
        values["Jr"] = (Ixx + Iyy) * yaw.value("Jr")
    return np.array([values.get(name, 0.0) for name in mapped.names])
