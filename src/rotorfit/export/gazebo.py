"""A whole Gazebo model: SDF 1.9 with a body, one turning link per rotor, IMU and motor plugins.

The rotors' links have to have a mass and turn; mass, CoM and inertia of all links together are
those of the result. A rotor's joint turns `SLOWDOWN` times slower than the rotor: its spin inertia
is as many times larger than Jr, so that angular momentum, and with it gyroscopic torque and the
reaction to spinning up, are right. Inertia is about a link's CoM (SDF specification, <inertial>);
links and CoM are given from the origin of the model, FLU, as Gazebo's axes are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rotorfit.errors import OutputError
from rotorfit.export.gazebo_motors import NEEDS as MOTOR_NEEDS
from rotorfit.export.gazebo_motors import SLOWDOWN, motor_plugins
from rotorfit.export.header import identifier, noted, xml_comment
from rotorfit.export.units import elements, roll_pitch_yaw, text, texts
from rotorfit.export.vehicle import (
    BODY,
    ExportedRotor,
    VehicleModel,
    inertia_at_origin,
)
from rotorfit.results.physical_inertia import second_moments

NEEDS = (*BODY, *MOTOR_NEEDS)
ROTOR_MASS = 1e-3
"""Of one rotor's link, as a fraction of the vehicle's: any small one does, it is taken off the
body's."""
NO_SPIN_INERTIA = 1e-4
"""Spin inertia of a rotor's link over the vehicle's Izz where Jr is not known: too small to
matter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A link: mass [kg], CoM from the model's origin [m], inertia about it, FLU [kg m^2]."""

    mass: float
    com: Float[np.ndarray, " 3"]
    inertia: Float[np.ndarray, "3 3"]


def write_gazebo(model: VehicleModel, head: Sequence[str]) -> str:
    """Return the model as SDF."""
    rotors = [_rotor_part(rotor, model) for rotor in model.rotors]
    base = _rest(model, rotors)
    comment = noted(
        head,
        "inertia of each link is about its own CoM; base_link and rotors together have mass, CoM "
        "and inertia of the numbers above",
        f"joints turn {SLOWDOWN:g} times slower than the rotors (rotorVelocitySlowdownSim); "
        + _spin_words(model),
        "rotor discs are for show: their size is not known to rotorfit",
    )
    links = [_base_link(base, model)]
    links += [
        _rotor_link(i, rotor, part)
        for i, (rotor, part) in enumerate(zip(model.rotors, rotors, strict=True))
    ]
    name = identifier(f"{model.name}_{model.configuration}")
    return (
        '<?xml version="1.0"?>\n'
        + xml_comment(comment)
        + f'<sdf version="1.9">\n  <model name="{name}">\n'
        + "".join(links)
        + motor_plugins(model)
        + "  </model>\n</sdf>\n"
    )


def _spin_words(model: VehicleModel) -> str:
    if model.Jr:
        return f"their links' spin inertia is {SLOWDOWN:g} Jr"
    return (
        f"Gazebo wants a spin inertia of their links: {NO_SPIN_INERTIA:g} of the vehicle's Izz, "
        "too small to matter, for want of Jr"
    )


def _rotor_part(rotor: ExportedRotor, model: VehicleModel) -> Part:
    """Return a rotor as a thin disc that spins about its axis."""
    spin = SLOWDOWN * model.Jr if model.Jr else NO_SPIN_INERTIA * float(model.inertia_com[2, 2])
    n = rotor.axis
    inertia = 0.5 * spin * (np.eye(3) + np.outer(n, n))
    return Part(mass=ROTOR_MASS * model.mass, com=rotor.position, inertia=inertia)


def _rest(model: VehicleModel, rotors: Sequence[Part]) -> Part:
    """Return what is left of the vehicle without its rotors."""
    mass = model.mass - sum(part.mass for part in rotors)
    moment = model.mass * model.com - sum(part.mass * part.com for part in rotors)
    com = np.asarray(moment / mass)
    origin = inertia_at_origin(model)
    for part in rotors:
        origin = origin - part.inertia - _steiner(part.mass, part.com)
    inertia = origin - _steiner(mass, com)
    if float(np.linalg.eigvalsh(second_moments(inertia))[0]) <= 0.0:
        raise OutputError(
            "the body without its rotors would have an inertia that no body has: Jr is too large "
            "for the vehicle; check it, or pass --assume Jr=VALUE"
        )
    return Part(mass=mass, com=com, inertia=inertia)


def _steiner(mass: float, com: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    return mass * (float(com @ com) * np.eye(3) - np.outer(com, com))


def _inertial(part: Part, com: Float[np.ndarray, " 3"]) -> str:
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    inertia = "".join(
        f"          <{name}>{text(value)}</{name}>\n"
        for name, value in zip(names, elements(part.inertia), strict=True)
    )
    return (
        "      <inertial>\n"
        f"        <pose>{texts(com)} 0 0 0</pose>\n"
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
        + _inertial(base, base.com)
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
    own = Part(mass=part.mass, com=np.zeros(3), inertia=np.diag([0.5 * spin, 0.5 * spin, spin]))
    disc = "<cylinder><radius>0.05</radius><length>0.005</length></cylinder>"
    return (
        f'    <link name="rotor_{i}">\n'
        f"      <pose>{texts(rotor.position)} {roll_pitch}</pose>\n"
        + _inertial(own, own.com)
        + f'      <visual name="disc"><geometry>{disc}</geometry></visual>\n'
        + "    </link>\n"
        + f'    <joint name="rotor_{i}_joint" type="revolute">\n'
        + f"      <parent>base_link</parent>\n      <child>rotor_{i}</child>\n"
        + "      <axis>\n        <xyz>0 0 1</xyz>\n        <limit>\n"
        + "          <lower>-1e16</lower>\n          <upper>1e16</upper>\n"
        + "        </limit>\n      </axis>\n    </joint>\n"
    )
