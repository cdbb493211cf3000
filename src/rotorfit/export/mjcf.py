"""MuJoCo: an MJCF model of a free body, with a site and an actuator for each rotor.

Sources: MuJoCo's XML reference (body/inertial: pos and fullinertia, M(1,1) M(2,2) M(3,3) M(1,2)
M(1,3) M(2,3), about the CoM in the body's axes; actuator/general: site, gear of three forces and
three torques in the site's frame; dyntype filterexact, dynprm the time constant). The control of a
rotor is its thrust [N], kt times its commanded speed squared; its torque is the fixed fraction
-s kd/kt.
"""

from collections.abc import Sequence

import numpy as np

from rotorfit.export.file_format import (
    elements,
    identifier,
    quaternion_wxyz,
    text,
    texts,
    with_notes,
    xml_comment,
)
from rotorfit.export.vehicle import ExportedRotor, VehicleModel
from rotorfit.preprocessing.airborne import GRAVITY

TIMESTEP = 0.002


def write_mujoco(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the model as MJCF."""
    name = identifier(f"{model.name}_{model.configuration}")
    rotors = list(enumerate(model.rotors, start=1))
    return (
        xml_comment(with_notes(head, *_remarks(model)))
        + f'<mujoco model="{name}">\n'
        + '  <compiler angle="radian" autolimits="true" inertiafromgeom="false"/>\n'
        + f'  <option timestep="{TIMESTEP:g}" gravity="0 0 {-GRAVITY:g}"/>\n'
        + "  <worldbody>\n"
        + '    <light pos="0 0 5" directional="true"/>\n'
        + '    <geom name="floor" type="plane" size="20 20 0.1" contype="0" conaffinity="0"/>\n'
        + '    <body name="vehicle" pos="0 0 1">\n      <freejoint name="free"/>\n'
        + f'      <inertial pos="{texts(model.com)}" mass="{text(model.mass)}"\n'
        + f'                fullinertia="{texts(elements(model.inertia_com))}"/>\n'
        + f'      <site name="imu" pos="{texts(model.imu)}"/>\n'
        + "".join(_site(i, rotor, model) for i, rotor in rotors)
        + "    </body>\n  </worldbody>\n  <actuator>\n"
        + "".join(_actuator(i, rotor, model) for i, rotor in rotors)
        + "  </actuator>\n"
        + '  <sensor>\n    <gyro name="gyro" site="imu"/>\n'
        + '    <accelerometer name="accelerometer" site="imu"/>\n  </sensor>\n'
        + _hover(model)
        + "</mujoco>\n"
    )


def _remarks(model: VehicleModel) -> list[str]:
    remarks = [
        "control rotor_N is the thrust of rotor N of the log [N], kt times its speed squared; its "
        "torque about z is -kd/kt of it for ccw, and +kd/kt for cw",
        "key hover: all rotors at the one speed that carries the weight; with the CoM off the "
        "rotors' middle that is no trim",
        "thrust follows with the motors' time constant (the speed does, in truth: the same for "
        "small changes); gyroscopic torque and the reaction to spinning up (Jr) are left out",
    ]
    if model.lag_up != model.lag_down:
        remarks.append("MuJoCo has one time constant: the mean of up and down")
    return remarks


def _site(i: int, rotor: ExportedRotor, model: VehicleModel) -> str:
    quat = texts(quaternion_wxyz(rotor.axis))
    arm = text(0.35 * float(np.linalg.norm(rotor.position - model.com)) + 1e-3)
    return (
        f'      <site name="rotor_{i}" pos="{texts(rotor.position)}" quat="{quat}"/>\n'
        f'      <geom name="disc_{i}" type="cylinder" size="{arm} 0.002" '
        f'pos="{texts(rotor.position)}" quat="{quat}"\n'
        '            contype="0" conaffinity="0" rgba="0.3 0.3 0.3 0.4"/>\n'
    )


def _actuator(i: int, rotor: ExportedRotor, model: VehicleModel) -> str:
    lag = model.mean_lag
    dynamics = f' dyntype="filterexact" dynprm="{text(lag)}"' if lag > 0 else ""
    return (
        f'    <general name="rotor_{i}" site="rotor_{i}"{dynamics} '
        f'ctrlrange="0 {text(rotor.kt * model.max_speed**2)}"\n'
        f'             gear="0 0 1 0 0 {text(-rotor.spin * model.kd / rotor.kt)}"/>\n'
    )


def _hover(model: VehicleModel) -> str:
    thrusts = texts(tuple(rotor.kt * model.hover_speed**2 for rotor in model.rotors))
    act = f' act="{thrusts}"' if model.mean_lag > 0 else ""
    return (
        f'  <keyframe>\n    <key name="hover" qpos="0 0 1 1 0 0 0" ctrl="{thrusts}"{act}/>\n'
        "  </keyframe>\n"
    )
