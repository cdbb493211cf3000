"""PX4 parameters, as QGroundControl loads and saves them.

Sources, PX4-Autopilot: src/modules/control_allocator/module.yaml (CA_ROTORn_*: positions in body
axes FRD; KM: torque = KM thrust, positive for ccw; CT: thrust = CT u^2) and
ActuatorEffectivenessRotors.cpp (moment = ct position x axis - ct km axis, so that positions are
from the CoM, and AX, AY, AZ point along the thrust); src/lib/mixer_module/functions/
FunctionMotors.hpp (THR_MDL_FAC: thrust = f x^2 + (1 - f) x); init.d-posix/airframes/4001_gz_x500
(SIM_GZ_EC_*: the output from MIN to MAX is the rotor speed in rad/s). Types of parameters: 6
integer, 9 float (MAVLink MAV_PARAM_TYPE).
"""

from collections.abc import Sequence

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.export.file_format import frd, hash_comment, text, with_notes
from rotorfit.export.vehicle import VehicleModel
from rotorfit.logs.speed_law import PolynomialLaw, SpeedLaw
from rotorfit.preprocessing.motors.thrust_curve import ThrustCurve, speeds, thrust_curve

MOST_ROTORS = 12
"""PX4's NUM_ROTORS_MAX."""
MOST_THRUST = 100.0
"""Largest CA_ROTORn_CT that PX4 takes."""
HOVER_RANGE = (0.1, 0.8)
"""Values of MPC_THR_HOVER that PX4 takes."""
SIM_CHANNELS = 8
SIM_RANGE = 1000.0
"""Largest SIM_GZ_EC_MAXn by gz_bridge/module.yaml, which PX4 itself does not hold to."""
SAME_CURVE = 0.02
"""Factors that differ by less are the same."""
INTEGER, FLOAT = 6, 9

Parameter = tuple[str, float, int]


def write_px4(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the parameters of the vehicle's geometry, thrust curve and Gazebo outputs."""
    if len(model.rotors) > MOST_ROTORS:
        raise OutputError(
            f"{len(model.rotors)} rotors, but PX4 allocates at most {MOST_ROTORS}; export to a "
            "simulator instead"
        )
    comment = with_notes(
        head,
        "positions and axes in body FRD (x forward, y right, z down), positions from the CoM [m]; "
        "rotor n here is motor n+1 of PX4, in the order of the log's motors",
        "KM = kd/kt [m], positive for ccw seen from above",
        *_coefficient_remarks(model),
        *_thrust_remarks(model),
        *_simulation_remarks(model),
    )
    return params_file(comment, [*_geometry(model), *_thrust(model), *_simulation(model)])


def params_file(comment: Sequence[str], parameters: Sequence[Parameter]) -> str:
    """Write parameters in the format of QGroundControl, for vehicle 1, component 1."""
    lines = [f"1\t1\t{name}\t{text(value)}\t{kind}\n" for name, value, kind in parameters]
    return hash_comment([*comment, "", "Vehicle-Id Component-Id Name Value Type"]) + "".join(lines)


def _geometry(model: VehicleModel) -> list[Parameter]:
    out: list[Parameter] = [
        ("CA_AIRFRAME", 0.0, INTEGER),
        ("CA_ROTOR_COUNT", float(len(model.rotors)), INTEGER),
    ]
    for i, (rotor, arm) in enumerate(zip(model.rotors, model.arms, strict=True)):
        places = zip("XYZ", frd(arm).tolist(), strict=True)
        out += [(f"CA_ROTOR{i}_P{axis}", value, FLOAT) for axis, value in places]
        directions = zip("XYZ", frd(rotor.axis).tolist(), strict=True)
        out += [(f"CA_ROTOR{i}_A{axis}", value, FLOAT) for axis, value in directions]
        if has_coefficients(model):
            out.append((f"CA_ROTOR{i}_CT", rotor.kt * model.max_speed**2, FLOAT))
        out.append((f"CA_ROTOR{i}_KM", rotor.spin * model.kd / rotor.kt, FLOAT))
    return out


def has_coefficients(model: VehicleModel) -> bool:
    """Test whether CT can be written for all rotors: PX4 compares them with each other."""
    return max(rotor.kt for rotor in model.rotors) * model.max_speed**2 <= MOST_THRUST


def _coefficient_remarks(model: VehicleModel) -> list[str]:
    if has_coefficients(model):
        return ["CT = kt times the squared speed at full command [N]"]
    why = (
        f"a rotor gives over {MOST_THRUST:g} N, more than PX4 takes"
        if np.isfinite(model.max_speed)
        else "the speed at full command is not known (--assume max_speed=VALUE)"
    )
    return [f"CT is left out, and rotors stay as PX4 has them, equal: {why}"]


def _curve(model: VehicleModel) -> ThrustCurve | None:
    return None if model.law is None else thrust_curve(model.law)


def _thrust(model: VehicleModel) -> list[Parameter]:
    curve = _curve(model)
    if curve is None:
        return []
    return [("THR_MDL_FAC", curve.factor, FLOAT), *hover_parameter(model)]


def hover_parameter(model: VehicleModel) -> list[Parameter]:
    """Select MPC_THR_HOVER, where PX4 takes it."""
    if HOVER_RANGE[0] <= model.hover_thrust <= HOVER_RANGE[1]:
        return [("MPC_THR_HOVER", model.hover_thrust, FLOAT)]
    return []


def _thrust_remarks(model: VehicleModel) -> list[str]:
    curve = _curve(model)
    if curve is None:
        return [
            "THR_MDL_FAC and MPC_THR_HOVER are left out: no law from command to rotor speed is "
            "known (law under [motors] of the experiment)"
        ]
    remarks = [
        f"THR_MDL_FAC is fitted to the law, within {100 * curve.error:.2g} % of full thrust; "
        "MPC_THR_HOVER goes with it"
    ]
    if not hover_parameter(model):
        remarks.append(
            f"MPC_THR_HOVER would be {model.hover_thrust:.3g}, which PX4 does not take "
            f"({HOVER_RANGE[0]} to {HOVER_RANGE[1]}): left out"
        )
    return remarks


def _simulation(model: VehicleModel) -> list[Parameter]:
    """List the outputs of PX4 in Gazebo: rotor speed in rad/s at no and at full command."""
    if model.in_commands or not np.isfinite(model.max_speed) or len(model.rotors) > SIM_CHANNELS:
        return []
    idle = _idle(model)
    out: list[Parameter] = []
    for i in range(1, len(model.rotors) + 1):
        out.append((f"SIM_GZ_EC_FUNC{i}", 100.0 + i, INTEGER))
        out.append((f"SIM_GZ_EC_MIN{i}", float(round(idle)), INTEGER))
        out.append((f"SIM_GZ_EC_MAX{i}", float(round(model.max_speed)), INTEGER))
    return out


def _idle(model: VehicleModel) -> float:
    """Return the rotor speed at no command [rad/s]."""
    return 0.0 if model.law is None else float(speeds(model.law, np.zeros(1))[0])


def _simulation_remarks(model: VehicleModel) -> list[str]:
    """List what differs in Gazebo, where the rotor speed is linear in the output."""
    if len(model.rotors) > SIM_CHANNELS:
        return [f"SIM_GZ_EC_* are left out: PX4 has {SIM_CHANNELS} of them"]
    if model.in_commands or not np.isfinite(model.max_speed):
        return ["SIM_GZ_EC_* are left out: the speed at full command is not known"]
    remarks: list[str] = []
    if model.max_speed > SIM_RANGE:
        remarks.append(
            f"SIM_GZ_EC_MAX is {model.max_speed:.0f}, over the {SIM_RANGE:g} that its description "
            "in PX4 has as the largest"
        )
    slope = model.max_speed - _idle(model)
    linear = thrust_curve(SpeedLaw(curve=PolynomialLaw((_idle(model), slope))))
    curve = _curve(model)
    if curve is None or abs(curve.factor - linear.factor) > SAME_CURVE:
        escs = (
            "" if curve is None else f", while the {curve.factor:.3g} here is of the vehicle's ESCs"
        )
        remarks.append(
            "in Gazebo the speed is linear in the output (SIM_GZ_EC_MIN to MAX): set THR_MDL_FAC "
            f"to {linear.factor:.3g} there{escs}"
        )
    return remarks
