"""PX4: parameters as QGroundControl loads and saves them, its own simulation, its setpoints.

Sources, PX4-Autopilot: src/modules/control_allocator/module.yaml (CA_ROTORn_*: positions in body
axes FRD; KM: torque = KM thrust, positive for ccw; CT: thrust = CT u^2) and
ActuatorEffectivenessRotors.cpp (moment = ct position x axis - ct km axis, so that positions are
from the CoM, and AX, AY, AZ point along the thrust); src/lib/mixer_module/functions/
FunctionMotors.hpp (THR_MDL_FAC: thrust = f x^2 + (1 - f) x); init.d-posix/airframes/4001_gz_x500
(SIM_GZ_EC_*: the output from MIN to MAX is the rotor speed in rad/s). Types of parameters: 6
integer, 9 float (MAVLink MAV_PARAM_TYPE).

Newton and newton metre per unit of vehicle_thrust_setpoint and vehicle_torque_setpoint: also
ControlAllocationPseudoInverse.cpp (the pseudo-inverse of that matrix, its
columns scaled: roll and pitch together by the larger of |column| / sqrt(rotors / 2), yaw by its
largest element, thrust by its mean; elements below 1e-3 are 0); what the allocation asks
of a motor is thrust over full thrust.

Simulation in hardware, SIH_* of a quadrotor and a hexarotor: src/modules/simulation/simulator_sih
(sih_params, sih.cpp): thrust = T_MAX u and torque = Q_MAX u for a motor signal u from 0 to 1 that
follows its command with T_TAU; in body axes FRD the quadrotor has the roll moment L_ROLL T_MAX (-u0
+ u1 + u2 - u3), pitch L_PITCH T_MAX (u0 - u1 + u2 - u3), yaw Q_MAX (u0 + u1 - u2 - u3): motors
front right ccw, rear left ccw, front left cw, rear right cw, even about the CoM. The hexarotor
(SIH_VEHICLE_TYPE 4): clockwise from the front right, which is ccw, at 30, 90, 150 ... degrees.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.export.file_format import elements, frd, hash_comment, inertia_frd, text, with_notes
from rotorfit.export.targets import TARGETS
from rotorfit.export.vehicle import Spread, VehicleModel, refuse_no_lag, spread
from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.motors.motor_model import (
    ThrustCurve,
    speeds,
    thrust_curve,
)
from rotorfit.logs.motor_law import MotorLaw, PolynomialCurve
from rotorfit.model.terms.air import DRAG_NAMES, TURN_DAMPING

if TYPE_CHECKING:
    from jaxtyping import Float

MOST_ROTORS = 12
"""PX4's NUM_ROTORS_MAX."""
MOST_THRUST = 100.0
"""Largest CA_ROTORn_CT that PX4 takes."""
HOVER_RANGE = (0.1, 0.8)
"""Values of MPC_THR_HOVER that PX4 takes."""
SIM_CHANNELS = 8
SIM_RANGE = 1000.0
"""Largest SIM_GZ_EC_MAXn by gz_bridge/module.yaml, which PX4 itself does not hold to."""
INTEGER, FLOAT = 6, 9

Parameter = tuple[str, float, int]


def write_px4(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the parameters of the vehicle's geometry and thrust curve."""
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
    )
    return params_file(comment, [*_rotor_geometry(model), *_thrust_parameters(model)])


def params_file(comment: Sequence[str], parameters: Sequence[Parameter]) -> str:
    """Write parameters in the format of QGroundControl, for vehicle 1, component 1."""
    lines = [f"1\t1\t{name}\t{text(value)}\t{kind}\n" for name, value, kind in parameters]
    return hash_comment([*comment, "", "Vehicle-Id Component-Id Name Value Type"]) + "".join(lines)


def _rotor_geometry(model: VehicleModel) -> list[Parameter]:
    out: list[Parameter] = [
        ("CA_AIRFRAME", 0.0, INTEGER),
        ("CA_ROTOR_COUNT", float(len(model.rotors)), INTEGER),
    ]
    for i, (rotor, arm) in enumerate(zip(model.rotors, model.arms, strict=True)):
        places = zip("XYZ", frd(arm).tolist(), strict=True)
        out += [(f"CA_ROTOR{i}_P{a}", v, FLOAT) for a, v in places if np.isfinite(v)]
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


def _thrust_curve_of(model: VehicleModel) -> ThrustCurve | None:
    return None if model.law is None else thrust_curve(model.law)


def _thrust_parameters(model: VehicleModel) -> list[Parameter]:
    curve = _thrust_curve_of(model)
    if curve is None:
        return []
    return [("THR_MDL_FAC", curve.factor, FLOAT), *hover_parameter(model)]


def hover_parameter(model: VehicleModel) -> list[Parameter]:
    """Select MPC_THR_HOVER, where PX4 takes it."""
    if HOVER_RANGE[0] <= model.hover_thrust <= HOVER_RANGE[1]:
        return [("MPC_THR_HOVER", model.hover_thrust, FLOAT)]
    return []


def _thrust_remarks(model: VehicleModel) -> list[str]:
    curve = _thrust_curve_of(model)
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


def write_px4_gazebo(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the outputs of PX4 in Gazebo: rotor speed in rad/s at no and at full command."""
    count, idle, full = len(model.rotors), _idle_speed(model), model.max_speed
    if count > SIM_CHANNELS:
        raise OutputError(
            f"{count} rotors, but PX4 has {SIM_CHANNELS} outputs to Gazebo (SIM_GZ_EC_*); fly it "
            "in MuJoCo or another simulator instead"
        )
    # In Gazebo the speed is linear in the output, whatever the vehicle's ESCs make of theirs.
    linear = thrust_curve(MotorLaw(curve=PolynomialCurve((idle, full - idle))))
    outputs: list[Parameter] = []
    for i in range(1, count + 1):
        outputs.append((f"SIM_GZ_EC_FUNC{i}", 100.0 + i, INTEGER))
        outputs.append((f"SIM_GZ_EC_MIN{i}", float(round(idle)), INTEGER))
        outputs.append((f"SIM_GZ_EC_MAX{i}", float(round(full)), INTEGER))
    remarks = [
        "for PX4 with Gazebo only, after the parameters of  rotorfit export --to px4, with the "
        "model of  --to gazebo",
        "SIM_GZ_EC_MIN to MAX is the rotor speed [rad/s] from no to full output; THR_MDL_FAC is of "
        "that straight line: keep this file off the real vehicle",
    ]
    if full > SIM_RANGE:
        remarks.append(
            f"SIM_GZ_EC_MAX is {full:.0f}, over the {SIM_RANGE:g} that its description in PX4 has "
            "as the largest"
        )
    return params_file(
        with_notes(head, *remarks), [*outputs, ("THR_MDL_FAC", linear.factor, FLOAT)]
    )


def _idle_speed(model: VehicleModel) -> float:
    """Return the rotor speed at no command [rad/s]; a law may be of shares of full speed."""
    if model.law is None:
        return 0.0
    share = float(speeds(model.law, np.zeros(1))[0]) / model.law.full_speed
    return share * model.max_speed


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
        **{name: _number_entry(found, i, unit) for i, (name, unit) in enumerate(ROWS.items())},
        "thr_mdl_fac": 1.0 if curve is None else round(curve.factor, 6),
    }
    return json.dumps(plain, indent=1, allow_nan=False) + "\n"


def _number_entry(found: Spread, i: int, unit: str) -> dict[str, Any]:
    ends = (found.low, found.high)
    interval = [_round_digits(end[i, 0]) for end in ends if end is not None]
    return {"value": _round_digits(found.value[i, 0]), "interval": interval or None, "unit": unit}


def _round_digits(value: float) -> float:
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


HALF, TALL = 0.5, 0.5 * np.sqrt(3.0)
SIH_FRAMES: Final = {
    0: ((1.0, -1.0, 1.0), (-1.0, 1.0, 1.0), (1.0, 1.0, -1.0), (-1.0, -1.0, -1.0)),
    4: (
        *((TALL, -HALF, 1.0), (0.0, -1.0, -1.0), (-TALL, -HALF, 1.0)),
        *((-TALL, HALF, -1.0), (0.0, 1.0, 1.0), (TALL, HALF, -1.0)),
    ),
}
"""Motors of SIH_VEHICLE_TYPE, FLU: x over SIH_L_PITCH, y over SIH_L_ROLL, spin."""
CLEARLY: Final = 0.5
"""A rotor is at the seat that is nearer than so much of the way to the second nearest."""


def write_px4_sih(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the parameters of PX4's own simulation of a quadrotor or hexarotor in X."""
    refuse_no_lag(model, "SIH")
    kind = _sih_frame(model)
    full = model.kt * model.max_speed**2
    pitch, roll = _sih_arms(model, SIH_FRAMES[kind])
    inertia = elements(inertia_frd(model.inertia_com))
    names = ("SIH_IXX", "SIH_IYY", "SIH_IZZ", "SIH_IXY", "SIH_IXZ", "SIH_IYZ")
    parameters: list[Parameter] = [
        ("SIH_VEHICLE_TYPE", float(kind), INTEGER),
        ("SIH_MASS", model.mass, FLOAT),
        *((name, value, FLOAT) for name, value in zip(names, inertia, strict=True)),
        ("SIH_T_MAX", full, FLOAT),
        ("SIH_Q_MAX", model.kd * model.max_speed**2, FLOAT),
        ("SIH_L_ROLL", roll, FLOAT),
        ("SIH_L_PITCH", pitch, FLOAT),
        ("SIH_T_TAU", model.mean_lag, FLOAT),
        ("SIH_KDV", float(np.mean(_brake_coefficients(model))), FLOAT),
        ("SIH_KDW", float(np.mean(_turn_damping(model))), FLOAT),
        ("THR_MDL_FAC", 0.0, FLOAT),
        *hover_parameter(model),
    ]
    return params_file(with_notes(head, *_model_remarks(model, kind)), parameters)


Seats = Sequence[tuple[float, float, float]]


def _sih_arms(model: VehicleModel, seats: Seats) -> tuple[float, float]:
    """Compute SIH_L_PITCH and SIH_L_ROLL [m], which keep the sum of the rotors' arms."""
    own = np.abs(model.arms_from_middle[:, :2]).sum(axis=0)
    x, y = own / np.abs(np.array(seats)[:, :2]).sum(axis=0)
    return float(x), float(y)


def _sih_frame(model: VehicleModel) -> int:
    """Find the vehicle of SIH with these rotors, in any order; OutputError without one."""
    for kind, seats in SIH_FRAMES.items():
        if model.vertical and len(model.rotors) == len(seats) and _is_seated(model, seats):
            return kind
    raise OutputError(
        "SIH simulates a quadrotor in X with front right and rear left ccw, and a hexarotor in X "
        "with front right, left and rear right ccw, with upright rotors; these rotors are others: "
        "export to gazebo or mujoco instead"
    )


def _is_seated(model: VehicleModel, seats: Seats) -> bool:
    """Test whether there is one rotor at each seat, clearly at that one, with its spin."""
    table = np.array(seats)
    places = model.arms_from_middle[:, :2] / _sih_arms(model, seats)
    away = np.linalg.norm(places[:, None] - table[None, :, :2], axis=2)
    nearest, second = np.sort(away, axis=1)[:, :2].T
    taken = away.argmin(axis=1)
    spins = np.array([rotor.spin for rotor in model.rotors])
    return (
        len(set(taken.tolist())) == len(seats)
        and bool((nearest < CLEARLY * second).all())
        and bool((spins == table[taken, 2]).all())
    )


def _brake_coefficients(model: VehicleModel) -> list[float]:
    """Collect the drag along x, y, z near hover [N s/m]: of the frame, and of its rotors."""
    S = model.hover_speed * len(model.rotors)
    across, along = (model.air.get(name, 0.0) * S for name in ("rotor_drag", "inflow"))
    # Along the axes half of `inflow`, as a slow climb at u takes v_i down by u / 2 (momentum
    # theory).
    of_rotors = (across, across, 0.5 * along)
    return [model.air.get(n, 0.0) + more for n, more in zip(DRAG_NAMES, of_rotors, strict=True)]


def _turn_damping(model: VehicleModel) -> list[float]:
    """Collect the damping of roll, pitch and yaw [N m s], the last from the rotors in hover."""
    carried = model.hover_speed * float((model.arms_from_middle[:, :2] ** 2).sum())
    return [
        *(model.air.get(name, 0.0) for name in TURN_DAMPING.names),
        model.air.get("rotor_drag", 0.0) * carried,
    ]


def _model_remarks(model: VehicleModel, kind: int) -> list[str]:
    off = 1e3 * (np.array([r.position for r in model.rotors]).mean(axis=0) - model.com)
    middle = "SIH puts the CoM in the middle of the rotors"
    if np.isfinite(off[:2]).all():
        middle += (
            f"; here the rotors' middle is {off[0]:.2g} mm forward and {off[1]:.2g} mm left of it, "
            "which SIH leaves out"
        )
    return [
        f"start with  make px4_sitl sihsim_{'hex' if kind else 'quadx'}",
        "inertia about the CoM in body axes FRD: the signs of xy and xz are opposite to the above",
        "SIH_T_MAX = kt max_speed^2, SIH_Q_MAX = kd max_speed^2; thrust is proportional to the "
        "motor signal in SIH, for which THR_MDL_FAC is 0",
        f"{middle}; Jr and differences between rotors have no place there",
        "SIH_T_TAU acts on thrust there, in steps of SIH's loop: the lag that flies is half a step "
        "shorter (2 ms at 250 Hz)",
        _air_remark(model),
    ]


def _air_remark(model: VehicleModel) -> str:
    known = [name for name in TARGETS["px4-sih"].terms if name in model.air]
    if not known:
        return "SIH_KDV and SIH_KDW (drag and damping) are 0: these flights do not show them"
    return (
        "SIH_KDV is the mean of drag along the three axes, of frame and rotors in hover, SIH_KDW "
        "that of damping about them, "
        f"0 where these flights show none ({', '.join(known)} are shown)"
    )
