"""PX4's simulation in hardware: the SIH_* parameters of a quadrotor.

Source: PX4-Autopilot, src/modules/simulation/simulator_sih (sih_params, sih.cpp): thrust = T_MAX u
and torque = Q_MAX u for a motor signal u from 0 to 1 that follows its command with T_TAU; roll
moment L_ROLL T_MAX (-u0 + u1 + u2 - u3), pitch L_PITCH T_MAX (u0 - u1 + u2 - u3), yaw Q_MAX
(u0 + u1 - u2 - u3), body axes FRD: motors front right ccw, rear left ccw, front left cw, rear right
cw, even about the CoM.
"""

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.export.file_format import elements, inertia_frd, with_notes
from rotorfit.export.px4 import FLOAT, INTEGER, Parameter, hover_parameter, params_file
from rotorfit.export.targets import TARGETS
from rotorfit.export.vehicle import VehicleModel, refuse_no_lag
from rotorfit.model.terms.air import DRAG_NAMES, TURN_DAMPING

SEATS = ((1.0, -1.0, 1.0), (-1.0, 1.0, 1.0), (1.0, 1.0, -1.0), (-1.0, -1.0, -1.0))
"""Of SIH's motors, FLU: sign of x, sign of y, spin."""


def write_px4_sih(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the parameters of PX4's own quadrotor simulation."""
    refuse_no_lag(model, "SIH")
    _refuse_other_layouts(model)
    full = model.kt * model.max_speed**2
    arms = np.abs(model.arms[:, :2]).mean(axis=0)
    inertia = elements(inertia_frd(model.inertia_com))
    names = ("SIH_IXX", "SIH_IYY", "SIH_IZZ", "SIH_IXY", "SIH_IXZ", "SIH_IYZ")
    parameters: list[Parameter] = [
        ("SIH_VEHICLE_TYPE", 0.0, INTEGER),
        ("SIH_MASS", model.mass, FLOAT),
        *((name, value, FLOAT) for name, value in zip(names, inertia, strict=True)),
        ("SIH_T_MAX", full, FLOAT),
        ("SIH_Q_MAX", model.kd * model.max_speed**2, FLOAT),
        ("SIH_L_ROLL", float(arms[1]), FLOAT),
        ("SIH_L_PITCH", float(arms[0]), FLOAT),
        ("SIH_T_TAU", model.mean_lag, FLOAT),
        ("SIH_KDV", float(np.mean([model.air.get(name, 0.0) for name in DRAG_NAMES])), FLOAT),
        ("SIH_KDW", float(np.mean(_damping(model))), FLOAT),
        ("THR_MDL_FAC", 0.0, FLOAT),
        *hover_parameter(model),
    ]
    return params_file(with_notes(head, *_remarks(model)), parameters)


def _damping(model: VehicleModel) -> list[float]:
    """Collect the damping of roll, pitch and yaw [N m s], the last from the rotors in hover."""
    carried = model.hover_speed * float((model.arms[:, :2] ** 2).sum())
    return [
        *(model.air.get(name, 0.0) for name in TURN_DAMPING.names),
        model.air.get("rotor_drag", 0.0) * carried,
    ]


def _remarks(model: VehicleModel) -> list[str]:
    off = 1e3 * (np.array([r.position for r in model.rotors]).mean(axis=0) - model.com)
    return [
        "inertia about the CoM in body axes FRD: the signs of xy and xz are opposite to the above",
        "SIH_T_MAX = kt max_speed^2, SIH_Q_MAX = kd max_speed^2; thrust is proportional to the "
        "motor signal in SIH, for which THR_MDL_FAC is 0",
        "SIH puts the CoM in the middle of the rotors; here the rotors' middle is "
        f"{off[0]:.2g} mm forward and {off[1]:.2g} mm left of it, which SIH leaves out; as are Jr "
        "and differences between rotors",
        "SIH_T_TAU acts on thrust there, in steps of SIH's loop: the lag that flies is half a step "
        "shorter (2 ms at 250 Hz)",
        _air_remark(model),
    ]


def _air_remark(model: VehicleModel) -> str:
    known = [name for name in TARGETS["px4-sih"].terms if name in model.air]
    if not known:
        return "SIH_KDV and SIH_KDW (drag and damping) are 0: these flights do not show them"
    return (
        "SIH_KDV is the mean of drag along the three axes, SIH_KDW that of damping about them, "
        f"0 where these flights show none ({', '.join(known)} are shown)"
    )


def _refuse_other_layouts(model: VehicleModel) -> None:
    """Raise unless the rotors, in any order, are those of SIH's quadrotor."""
    arms = model.arms_from_middle
    seats = [
        (float(np.sign(round(x, 6))), float(np.sign(round(y, 6))), rotor.spin)
        for (x, y, _), rotor in zip(arms.tolist(), model.rotors, strict=True)
    ]
    if not model.vertical or tuple(seats) not in set(permutations(SEATS)):
        raise OutputError(
            "SIH simulates a quadrotor in X with front right and rear left ccw and upright rotors; "
            "these rotors are others: export to gazebo or mujoco instead"
        )
