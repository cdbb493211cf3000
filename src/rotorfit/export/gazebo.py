"""Gazebo: a whole model (SDF 1.9: a body, a turning link per rotor, IMU), or its motor plugins.

The rotors' links have to have a mass and turn; mass, CoM and inertia of all links together are
those of the result. A rotor's joint turns `SLOWDOWN` times slower than the rotor: its spin inertia
is as many times larger than Jr, so that angular momentum, and with it gyroscopic torque and the
reaction to spinning up, are right. Inertia is about a link's CoM (SDF specification, <inertial>);
links and CoM are given from the origin of the model, FLU, as Gazebo's axes are.

Names, units and signs of the plugins are those of gz-sim (6 and newer), src/systems/
multicopter_motor_model/MulticopterMotorModel.cc: thrust = motorConstant w^2 along z of the rotor's
link; torque on the parent link = -turningDirection momentConstant thrust (ccw: +1); the speed
follows its command with timeConstantUp or timeConstantDown, whichever way it goes. A rotor's drag
is -|w| rotorDragCoefficient times the velocity of its link across its axis (Martin and Salaun, ICRA
2010), which is rotorfit's `rotor_drag`. rollingMomentCoefficient is a torque against that velocity,
while the torque of the wakes lifts the front: it is 0. Both have other defaults there. The place of
a rotor in the commands is motorNumber in gz-sim 6, and actuator_number in newer ones, which warn of
the former: both are written.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.checks.impossible_inertia import second_moments
from rotorfit.errors import OutputError
from rotorfit.export.file_format import (
    identifier,
    roll_pitch_yaw,
    text,
    texts,
    with_notes,
    xml_comment,
    xml_elements,
)
from rotorfit.export.vehicle import ExportedRotor, VehicleModel, inertia_at_origin
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

SLOWDOWN = 10.0
"""rotorVelocitySlowdownSim: the joint turns so many times slower than the rotor, so that its angle
does not alias."""
ROTOR_MASS = 1e-3
"""Mass of one rotor's link, as a fraction of the vehicle's; it is taken off the body's."""
NO_SPIN_INERTIA = 1e-4
"""Spin inertia of a rotor's link over the vehicle's Izz where Jr is not known: negligible."""


@frozen_dataclass
class Part:
    """A link: mass [kg], CoM from the model's origin [m], inertia about it, FLU [kg m^2]."""

    mass: float
    com: Float[np.ndarray, " 3"]
    inertia: Float[np.ndarray, "3 3"]


def write_gazebo(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the whole model as SDF."""
    rotors = [_rotor_part(rotor, model) for rotor in model.rotors]
    base = _body_part(model, rotors)
    comment = with_notes(
        head,
        "inertia of each link is about its own CoM; base_link and rotors together have mass, CoM "
        "and inertia of the numbers above",
        f"joints turn {SLOWDOWN:g} times slower than the rotors (rotorVelocitySlowdownSim); "
        + _spin_remark(model),
        "rotor discs are for show: their size is not known to rotorfit",
    )
    parts = enumerate(zip(model.rotors, rotors, strict=True))
    name = identifier(f"{model.name}_{model.configuration}")
    return (
        '<?xml version="1.0"?>\n'
        + xml_comment(comment)
        + f'<sdf version="1.9">\n  <model name="{name}">\n'
        + _base_link(base, model)
        + "".join(_rotor_link(i, rotor, part) for i, (rotor, part) in parts)
        + _motor_plugins(model)
        + "  </model>\n</sdf>\n"
    )


def write_gazebo_motors(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the plugins of all rotors, to be pasted into an SDF model."""
    comment = with_notes(
        head,
        "paste into <model>; joints rotor_N_joint and links rotor_N are numbered as the log's "
        "motors, from 0",
        "motorConstant in N s^2/rad^2, momentConstant = kd/kt in m, times in s, speed in rad/s",
    )
    return xml_comment(comment) + _motor_plugins(model)


def _spin_remark(model: VehicleModel) -> str:
    if model.Jr:
        return f"their links' spin inertia is {SLOWDOWN:g} Jr"
    return (
        f"Gazebo wants a spin inertia of their links: {NO_SPIN_INERTIA:g} of the vehicle's Izz, "
        "too small to matter, as Jr is not known"
    )


def _rotor_part(rotor: ExportedRotor, model: VehicleModel) -> Part:
    """Model a rotor as a thin disc that spins about its axis."""
    spin = SLOWDOWN * model.Jr if model.Jr else NO_SPIN_INERTIA * float(model.inertia_com[2, 2])
    n = rotor.axis
    inertia = 0.5 * spin * (np.eye(3) + np.outer(n, n))
    return Part(mass=ROTOR_MASS * model.mass, com=rotor.position, inertia=inertia)


def _body_part(model: VehicleModel, rotors: Sequence[Part]) -> Part:
    """Take the rotors off the vehicle; OutputError where no body is left."""
    mass = model.mass - sum(part.mass for part in rotors)
    moment = model.mass * model.com - sum(part.mass * part.com for part in rotors)
    com = np.asarray(moment / mass)
    origin = inertia_at_origin(model)
    for part in rotors:
        origin = origin - part.inertia - _steiner_shift(part.mass, part.com)
    inertia = origin - _steiner_shift(mass, com)
    if float(np.linalg.eigvalsh(second_moments(inertia))[0]) <= 0.0:
        raise OutputError(
            "the body without its rotors would have an inertia that no body has: Jr is too large "
            "for the vehicle; check it, or pass --assume Jr=VALUE"
        )
    return Part(mass=mass, com=com, inertia=inertia)


def _steiner_shift(mass: float, com: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    return mass * (float(com @ com) * np.eye(3) - np.outer(com, com))


def _inertial_element(part: Part) -> str:
    inertia = "".join(
        f"          <{name}>{value}</{name}>\n"
        for name, value in xml_elements(part.inertia).items()
    )
    return (
        "      <inertial>\n"
        f"        <pose>{texts(part.com)} 0 0 0</pose>\n"
        f"        <mass>{text(part.mass)}</mass>\n"
        f"        <inertia>\n{inertia}        </inertia>\n"
        "      </inertial>\n"
    )


def _base_link(base: Part, model: VehicleModel) -> str:
    arm = float(np.abs(np.array([rotor.position for rotor in model.rotors]) - model.com).max())
    box = f"<box><size>{text(arm)} {text(arm)} {text(0.3 * arm)}</size></box>"
    shape = f"<pose>{texts(base.com)} 0 0 0</pose><geometry>{box}</geometry>"
    return (
        '    <link name="base_link">\n'
        + _inertial_element(base)
        + f'      <visual name="body_visual">{shape}</visual>\n'
        + f'      <collision name="body_collision">{shape}</collision>\n'
        + '      <sensor name="imu_sensor" type="imu">\n'
        + f"        <pose>{texts(model.imu)} 0 0 0</pose>\n"
        + "        <always_on>1</always_on>\n        <update_rate>250</update_rate>\n"
        + "      </sensor>\n    </link>\n"
    )


def _rotor_link(i: int, rotor: ExportedRotor, part: Part) -> str:
    roll_pitch = texts(roll_pitch_yaw(rotor.axis))
    spin = float(rotor.axis @ part.inertia @ rotor.axis)
    disc = Part(mass=part.mass, com=np.zeros(3), inertia=np.diag([0.5 * spin, 0.5 * spin, spin]))
    shape = "<cylinder><radius>0.05</radius><length>0.005</length></cylinder>"
    return (
        f'    <link name="rotor_{i}">\n'
        f"      <pose>{texts(rotor.position)} {roll_pitch}</pose>\n"
        + _inertial_element(disc)
        + f'      <visual name="rotor_{i}_disc"><geometry>{shape}</geometry></visual>\n'
        + "    </link>\n"
        + f'    <joint name="rotor_{i}_joint" type="revolute">\n'
        + f"      <parent>base_link</parent>\n      <child>rotor_{i}</child>\n"
        + "      <axis>\n        <xyz>0 0 1</xyz>\n        <limit>\n"
        + "          <lower>-1e16</lower>\n          <upper>1e16</upper>\n"
        + "        </limit>\n      </axis>\n    </joint>\n"
    )


def _motor_plugins(model: VehicleModel) -> str:
    return "".join(_motor_plugin(i, rotor, model) for i, rotor in enumerate(model.rotors))


def _motor_plugin(i: int, rotor: ExportedRotor, model: VehicleModel) -> str:
    fields = (
        ("jointName", f"rotor_{i}_joint"),
        ("linkName", f"rotor_{i}"),
        ("turningDirection", "ccw" if rotor.spin > 0 else "cw"),
        ("timeConstantUp", text(model.lag_up)),
        ("timeConstantDown", text(model.lag_down)),
        ("maxRotVelocity", text(model.max_speed)),
        ("motorConstant", text(rotor.kt)),
        ("momentConstant", text(model.kd / rotor.kt)),
        ("commandSubTopic", "command/motor_speed"),
        ("motorNumber", str(i)),
        ("actuator_number", str(i)),
        ("rotorDragCoefficient", text(model.air.get("rotor_drag", 0.0))),
        ("rollingMomentCoefficient", "0"),
        ("rotorVelocitySlowdownSim", text(SLOWDOWN)),
        ("motorType", "velocity"),
    )
    inner = "".join(f"      <{name}>{value}</{name}>\n" for name, value in fields)
    return (
        '    <plugin filename="gz-sim-multicopter-motor-model-system"\n'
        '            name="gz::sim::systems::MulticopterMotorModel">\n'
        f"{inner}    </plugin>\n"
    )
