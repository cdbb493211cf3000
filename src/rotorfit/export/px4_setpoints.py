"""PX4: newton and newton metre per unit of vehicle_thrust_setpoint and vehicle_torque_setpoint.

Source, PX4-Autopilot: ActuatorEffectivenessRotors.cpp (moment = ct position x axis - ct km axis,
force = ct axis), ControlAllocationPseudoInverse.cpp (the pseudo-inverse of that matrix, its
columns scaled: roll and pitch together by the larger of |column| / sqrt(rotors / 2), yaw by its
largest element, thrust by its mean; elements below 1e-3 are 0) and FunctionMotors.hpp
(THR_MDL_FAC: what the allocation asks of a motor is thrust over full thrust).
"""

import json
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from rotorfit.export.effectiveness import Spread, spread
from rotorfit.export.file_format import frd, with_notes
from rotorfit.export.px4 import has_coefficients
from rotorfit.export.vehicle import VehicleModel
from rotorfit.preprocessing.airborne import GRAVITY
from rotorfit.preprocessing.motors.thrust_curve import thrust_curve

ROLL, PITCH, YAW, FORWARD, RIGHT, DOWN = range(6)
ROWS: Final = {
    **dict.fromkeys(("roll", "pitch", "yaw"), "N m per unit"),
    "thrust": "N per unit",
    "hover_thrust_setpoint": "1, upwards",
}
SMALL: Final = 1e-3
"""Elements of the mix below this count as zero in PX4."""


def write_px4_setpoints(
    model: VehicleModel, head: Sequence[str], drawn: Sequence[VehicleModel] = ()
) -> str:
    """Write as JSON what a unit of each setpoint is, with intervals."""
    found = spread(_per_unit, model, drawn)
    curve = None if model.law is None else thrust_curve(model.law)
    about = with_notes(
        head,
        "for PX4 with the CA_ROTOR parameters of rotorfit export --to px4; body axes FRD",
        "vehicle_thrust_setpoint.xyz[2] = -F / thrust (F: newton upwards); "
        "vehicle_torque_setpoint.xyz = torque / (roll, pitch, yaw); until a motor is at 0 or 1",
        "THR_MDL_FAC has to be as here: a motor's thrust is proportional to what is asked of it"
        + (
            "; no law is known, rotor speed is taken as proportional to the command"
            if curve is None
            else f", within {100 * curve.error:.2g} % of full thrust"
        ),
    )
    plain: dict[str, Any] = {
        "about": about,
        **{name: _entry(found, i, unit) for i, (name, unit) in enumerate(ROWS.items())},
        "thr_mdl_fac": 1.0 if curve is None else round(curve.factor, 6),
    }
    return json.dumps(plain, indent=1, allow_nan=False) + "\n"


def _entry(found: Spread, i: int, unit: str) -> dict[str, Any]:
    ends = (found.low, found.high)
    interval = [_digits(end[i, 0]) for end in ends if end is not None]
    return {"value": _digits(found.value[i, 0]), "interval": interval or None, "unit": unit}


def _digits(value: float) -> float:
    return float(f"{value:.6g}")


def newton_per_unit(model: VehicleModel) -> Float[np.ndarray, " 4"]:
    """Compute torque about x, y, z [N m] and thrust [N] of one unit of their setpoints."""
    full = np.array([rotor.kt for rotor in model.rotors]) * model.max_speed**2
    per_newton = _wrench_per_newton(model)
    # PX4 knows the rotors by CT, in newtons, or takes them for equal.
    coefficients = full if has_coefficients(model) else np.ones_like(full)
    mix = scaled_mix(per_newton * coefficients)
    unit = np.diag(per_newton * full @ mix)
    return np.array([unit[ROLL], unit[PITCH], unit[YAW], unit[DOWN]])


def _per_unit(model: VehicleModel) -> Float[np.ndarray, "5 1"]:
    units = newton_per_unit(model)
    return np.array([*units, model.mass * GRAVITY / units[3]])[:, None]


def _wrench_per_newton(model: VehicleModel) -> Float[np.ndarray, "6 N"]:
    """Compute torque and force of each rotor per newton of its thrust, FRD."""
    axes = frd(np.array([rotor.axis for rotor in model.rotors]))
    ratios = np.array([rotor.spin * model.kd / rotor.kt for rotor in model.rotors])[:, None]
    return np.hstack([np.cross(frd(model.arms), axes) - ratios * axes, axes]).T


def scaled_mix(effect: Float[np.ndarray, "6 N"]) -> Float[np.ndarray, "N 6"]:
    """Compute PX4's mix of a matrix of effectiveness: what each motor is asked per unit."""
    mix = np.linalg.pinv(effect, rcond=1e-6)
    counts = [max(int((np.abs(mix[:, i]) > SMALL).sum()), 1) for i in (ROLL, PITCH)]
    norms = [
        float(np.linalg.norm(mix[:, i]) / np.sqrt(count / 2.0))
        for i, count in zip((ROLL, PITCH), counts, strict=True)
    ]
    scale = np.ones(6)
    scale[[ROLL, PITCH]] = max(norms)
    scale[YAW] = mix[:, YAW].max()
    for i in (DOWN, RIGHT, FORWARD):
        used = np.abs(mix[:, i]) > np.finfo(np.float32).eps
        scale[i] = np.abs(mix[:, i]).sum() / used.sum() if used.any() else scale[DOWN]
    mix = mix / np.where(scale > np.finfo(np.float32).eps, scale, 1.0)
    return np.where(np.abs(mix) < SMALL, 0.0, mix)
