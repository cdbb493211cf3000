"""URDF; and that of gym-pybullet-drones, with its properties, for its quadrotor in X.

Sources: ROS urdf/XML/link (inertia about the CoM, tensor elements, in the axes of <inertial>);
gym-pybullet-drones, assets/cf2x.urdf and envs/BaseAviary.py: kf and km are thrust [N] and torque
[N m] per squared RPM; the parser finds elements by their order (properties, base_link with
inertial, visual, collision); motors prop0 to prop3 are front right, rear right, rear left, front
left; yaw torque is -t0 + t1 - t2 + t3; link 4 is the centre of mass, where that torque acts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final
from xml.sax.saxutils import quoteattr

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.export.file_format import (
    elements,
    identifier,
    per_squared_rpm,
    roll_pitch_yaw,
    text,
    texts,
    with_notes,
    xml_comment,
    xml_elements,
)
from rotorfit.flight.airborne import GRAVITY
from rotorfit.model.parameters import INERTIA

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.export.vehicle import ExportedRotor, VehicleModel

GYM_SEATS = ((1.0, -1.0, 1.0), (-1.0, -1.0, -1.0), (-1.0, 1.0, 1.0), (1.0, 1.0, -1.0))
"""Seats of prop0 to prop3, FLU: sign of x, sign of y, spin."""
GYM_SPEED = 30.0
"""max_speed_kmh of the package's own cf2x.urdf; it scales velocity commands only."""


def write_urdf(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the vehicle as URDF with its whole inertia tensor, rotors in the order of the log."""
    remarks = (
        *REMARKS,
        "prop0 is rotor 1 of the log, prop1 is rotor 2, and so on",
        "PyBullet takes the principal axes for the axes of the base where there are products of "
        "inertia: getBasePositionAndOrientation(body) is then turned by "
        "getDynamicsInfo(body, -1)[4]; take the inverse of that turn off, or export to "
        "gym-pybullet-drones, without products",
    )
    return _robot_element(model, with_notes(head, *remarks), model.rotors)


def write_gym_pybullet_drones(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the URDF of gym-pybullet-drones, which flies by PyBullet's principal axes."""
    order = _gym_order(model)
    rotors = [model.rotors[i] for i in order]
    products = ", ".join(
        f"{name} = {value:.4g}"
        for name, value in zip(INERTIA[3:], elements(model.inertia_com)[3:], strict=True)
    )
    numbers = ", ".join(f"prop{i} is rotor {k + 1} of the log" for i, k in enumerate(order))
    remarks = (
        *REMARKS,
        f"products of inertia are left out ({products} kg m^2): PyBullet would turn the base to "
        "the principal axes, and the attitude that gym-pybullet-drones reads with it",
        f"{numbers}; kf and km per squared RPM, the mean of the rotors",
        "properties that are left out: drag, ground effect and downwash are off (0), "
        f"max_speed_kmh is {GYM_SPEED:g}",
    )
    # PyBullet 3.2.7 returns the attitude of the principal axes of the base, and the package flies
    # by it: with products of inertia a level vehicle would read as tilted.
    diagonal = replace(model, inertia_com=np.diag(np.diag(model.inertia_com)))
    return _robot_element(diagonal, with_notes(head, *remarks), rotors, _properties_element(model))


REMARKS: Final = (
    "inertia is about the CoM, tensor elements; a link propN_link is at each rotor, z along its "
    "thrust; the base link's origin is that of the result",
)


def _robot_element(
    model: VehicleModel, head: Sequence[str], rotors: Sequence[ExportedRotor], properties: str = ""
) -> str:
    return (
        '<?xml version="1.0"?>\n'
        + xml_comment(head)
        + f"<robot name={quoteattr(identifier(f'{model.name}_{model.configuration}'))}>\n"
        + properties
        + _base_link(model)
        + "".join(
            _fixed_link(f"prop{i}", texts(rotor.position), texts(roll_pitch_yaw(rotor.axis)))
            for i, rotor in enumerate(rotors)
        )
        + _fixed_link("center_of_mass", texts(model.com), "0 0 0")
        + "</robot>\n"
    )


def _gym_order(model: VehicleModel) -> list[int]:
    """Find which rotor is prop0, prop1 ...; OutputError where the package has no such vehicle."""
    seats = [
        (float(np.sign(x)), float(np.sign(y)), rotor.spin)
        for (x, y, _), rotor in zip(model.arms.tolist(), model.rotors, strict=True)
    ]
    if not model.vertical or sorted(seats) != sorted(GYM_SEATS):
        raise OutputError(
            "gym-pybullet-drones flies four upright rotors in X, front right and rear left ccw; "
            "these are others: export to urdf instead"
        )
    return [seats.index(seat) for seat in GYM_SEATS]


def _properties_element(model: VehicleModel) -> str:
    full = len(model.rotors) * model.kt * model.max_speed**2
    values = {
        "arm": model.mean_arm,
        "kf": per_squared_rpm(model.kt),
        "km": per_squared_rpm(model.kd),
        "thrust2weight": full / (model.mass * GRAVITY),
        "max_speed_kmh": GYM_SPEED,
        **dict.fromkeys(("gnd_eff_coeff", "prop_radius", "drag_coeff_xy", "drag_coeff_z"), 0.0),
        "dw_coeff_1": 0.0,
        "dw_coeff_2": 1.0,  # not 0: the package divides by it
        "dw_coeff_3": 0.0,
    }
    attributes = " ".join(f'{name}="{text(value)}"' for name, value in values.items())
    return f"  <properties {attributes}/>\n"


def _base_link(model: VehicleModel) -> str:
    inertia = " ".join(f'{name}="{x}"' for name, x in xml_elements(model.inertia_com).items())
    arm = model.mean_arm
    place = f'<origin xyz="{texts(model.com)}" rpy="0 0 0"/>'
    body = f'<cylinder radius="{text(arm)}" length="{text(0.3 * arm)}"/>'
    return (
        '  <link name="base_link">\n'
        f"    <inertial>\n      {place}\n"
        f'      <mass value="{text(model.mass)}"/>\n      <inertia {inertia}/>\n    </inertial>\n'
        f"    <visual>\n      {place}\n      <geometry>{body}</geometry>\n    </visual>\n"
        f"    <collision>\n      {place}\n      <geometry>{body}</geometry>\n    </collision>\n"
        "  </link>\n"
    )


def _fixed_link(name: str, xyz: str, rpy: str) -> str:
    """Write a link without mass, and the joint that holds it."""
    return (
        f'  <link name="{name}_link">\n    <inertial>\n      <origin xyz="0 0 0" rpy="0 0 0"/>\n'
        '      <mass value="0"/>\n'
        '      <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>\n'
        "    </inertial>\n  </link>\n"
        f'  <joint name="{name}_joint" type="fixed">\n'
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>\n'
        f'    <parent link="base_link"/>\n    <child link="{name}_link"/>\n  </joint>\n'
    )
