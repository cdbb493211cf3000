"""MuJoCo: an MJCF model of a free body, with a site and an actuator for each rotor.

Sources: MuJoCo's XML reference (body/inertial: pos and fullinertia, M(1,1) M(2,2) M(3,3) M(1,2)
M(1,3) M(2,3), about the CoM in the body's axes; actuator/general: site, gear of three forces and
three torques in the site's frame; dyntype filterexact, dynprm the time constant). The control of a
rotor is its thrust [N], kt times its commanded speed squared; its torque is the fixed fraction
-s kd/kt.

`fly_manoeuvre` flies hover and steps of attitude with that text; what steers it is the autopilot of
the simulated flights (`simulation.controller`), tuned to the mass and inertia that it believes in:
those of the file, or others, to see what wrong ones do.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.export.file_format import (
    elements,
    identifier,
    quaternion_wxyz,
    text,
    texts,
    with_notes,
    xml_comment,
)
from rotorfit.export.vehicle import ExportedRotor, VehicleModel, inertia_at_origin
from rotorfit.flight.airborne import GRAVITY
from rotorfit.model.vehicle import Rotor, Vehicle
from rotorfit.results.validation.fly_outcome import BEFORE, STEP, Manoeuvre, ModelFlight
from rotorfit.simulation.controller import Autopilot, Gains, Memory, autopilot_of, control
from rotorfit.simulation.pilot import Reference
from rotorfit.simulation.rotors import allocation
from rotorfit.simulation.truth import Truth, tensor_elements

if TYPE_CHECKING:
    from collections.abc import Sequence

TIMESTEP = 0.002


def write_mujoco(model: VehicleModel, head: Sequence[str]) -> str:
    """Write the model as MJCF."""
    name = identifier(f"{model.name}_{model.configuration}")
    rotors = list(enumerate(model.rotors, start=1))
    return (
        xml_comment(with_notes(head, *_model_remarks(model)))
        + f'<mujoco model="{name}">\n'
        + '  <compiler angle="radian" autolimits="true" inertiafromgeom="false"/>\n'
        + f'  <option timestep="{TIMESTEP:g}" gravity="0 0 {-GRAVITY:g}"/>\n'
        + "  <worldbody>\n"
        + '    <light pos="0 0 5" directional="true"/>\n'
        + '    <geom name="floor" type="plane" size="20 20 0.1"/>\n'
        + '    <body name="vehicle" pos="0 0 1">\n      <freejoint name="free"/>\n'
        + f'      <inertial pos="{texts(model.com)}" mass="{text(model.mass)}"\n'
        + f'                fullinertia="{texts(elements(model.inertia_com))}"/>\n'
        + _collision_hull(model)
        + f'      <site name="imu" pos="{texts(model.imu)}"/>\n'
        + "".join(_rotor_site(i, rotor, model) for i, rotor in rotors)
        + "    </body>\n  </worldbody>\n  <actuator>\n"
        + "".join(_rotor_actuator(i, rotor, model) for i, rotor in rotors)
        + "  </actuator>\n"
        + '  <sensor>\n    <gyro name="gyro" site="imu"/>\n'
        + '    <accelerometer name="accelerometer" site="imu"/>\n  </sensor>\n'
        + _hover_keyframe(model)
        + "</mujoco>\n"
    )


def _model_remarks(model: VehicleModel) -> list[str]:
    remarks = [
        "control rotor_N is the thrust of rotor N of the log [N], kt times its speed squared; its "
        "torque about z is -kd/kt of it for ccw, and +kd/kt for cw",
        "key hover: all rotors at the one speed that carries the weight; with the CoM off the "
        "rotors' middle that is no trim",
        "thrust follows with the motors' time constant (the speed does, in truth: the same for "
        "small changes); gyroscopic torque and the reaction to spinning up (Jr) are left out",
    ]
    if model.mean_lag > 0.0:
        remarks.append(
            "filterexact is exact with the integrators Euler (as here) and implicitfast, not RK4"
        )
    remarks += [
        "gyro and accelerometer are of the state before the last mj_step, until mj_forward",
        "geom hull, a cylinder as wide as the mean arm, touches the floor; it is no measured shape",
    ]
    if model.lag_up != model.lag_down:
        remarks.append("MuJoCo has one time constant: the mean of up and down")
    return remarks


def _collision_hull(model: VehicleModel) -> str:
    """Write the body that touches the floor: a flat cylinder about the CoM, without mass."""
    arm = model.mean_arm
    return (
        f'      <geom name="hull" type="cylinder" size="{text(arm)} {text(0.15 * arm)}" '
        f'pos="{texts(model.com)}"\n            group="3" rgba="0.3 0.3 0.3 0.2"/>\n'
    )


def _rotor_site(i: int, rotor: ExportedRotor, model: VehicleModel) -> str:
    quat = texts(quaternion_wxyz(rotor.axis))
    arm = text(0.35 * float(np.linalg.norm(rotor.position - model.com)) + 1e-3)
    return (
        f'      <site name="rotor_{i}" pos="{texts(rotor.position)}" quat="{quat}"/>\n'
        f'      <geom name="disc_{i}" type="cylinder" size="{arm} 0.002" '
        f'pos="{texts(rotor.position)}" quat="{quat}"\n'
        '            contype="0" conaffinity="0" rgba="0.3 0.3 0.3 0.4"/>\n'
    )


def _rotor_actuator(i: int, rotor: ExportedRotor, model: VehicleModel) -> str:
    lag = model.mean_lag
    dynamics = f' dyntype="filterexact" dynprm="{text(lag)}"' if lag > 0 else ""
    return (
        f'    <general name="rotor_{i}" site="rotor_{i}"{dynamics} '
        f'ctrlrange="0 {text(rotor.kt * model.max_speed**2)}"\n'
        f'             gear="0 0 1 0 0 {text(-rotor.spin * model.kd / rotor.kt)}"/>\n'
    )


def _hover_keyframe(model: VehicleModel) -> str:
    thrusts = texts(tuple(rotor.kt * model.hover_speed**2 for rotor in model.rotors))
    act = f' act="{thrusts}"' if model.mean_lag > 0 else ""
    return (
        f'  <keyframe>\n    <key name="hover" qpos="0 0 1 1 0 0 0" ctrl="{thrusts}"{act}/>\n'
        "  </keyframe>\n"
    )


STEPS_PER_COMMAND: Final = 2
"""Of the 2 ms that the file has: 250 commands a second."""
HOVER_SECONDS: Final = 8.0
STEP_SECONDS: Final = 2.0
STOCK_LAG: Final = 0.03
"""Lag of motors for which it is not known, as measured rotor speed does not show it [s]."""
STOCK_THRUST: Final = 2.5
"""Largest thrust over weight where no law from command to speed gives it."""
FREE: Final = Gains(position=0.0, velocity=0.0)
"""Steps are of attitude: nothing holds the place."""


def flyable(model: VehicleModel) -> tuple[VehicleModel, tuple[str, ...]]:
    """Give the vehicle stock motors if its own are unknown, with notes on the substitution."""
    notes: list[str] = []
    if not (np.isfinite(model.lag_up) and np.isfinite(model.lag_down)):
        model = replace(model, lag_up=STOCK_LAG, lag_down=STOCK_LAG)
        notes.append(
            f"the motors' lag is not known (measured speed does not show it): {STOCK_LAG:g} s is "
            "taken for hover and steps; --assume motor_lag=VALUE for yours"
        )
    if not np.isfinite(model.max_speed):
        model = replace(model, max_speed=STOCK_THRUST**0.5 * model.hover_speed)
        notes.append(
            f"the largest rotor speed is not known: {STOCK_THRUST:g} times the weight is taken as "
            "the largest thrust; --assume max_speed=VALUE for yours"
        )
    return model, tuple(notes)


def fly_manoeuvre(
    model: VehicleModel,
    manoeuvre: Manoeuvre,
    *,
    believed: VehicleModel | None = None,
) -> ModelFlight:
    """Fly one manoeuvre in MuJoCo; OutputError where that is not installed or refuses the file.

    The motors of `model` are known (`flyable`). The autopilot takes the vehicle for `believed`, by
    default for what it is; its stock gains hold the place in hover alone.
    """
    mujoco = require_mujoco()
    world = _load_model(mujoco, model)
    data = mujoco.MjData(world)
    mujoco.mj_resetDataKeyframe(world, data, 0)
    belief, vehicle = _simulated_vehicle(believed or model)
    period = STEPS_PER_COMMAND * float(world.opt.timestep)
    pilot = autopilot_of(
        belief,
        vehicle,
        thrust_to_weight=float((model.max_speed / model.hover_speed) ** 2),
        period=period,
        gains=Gains() if manoeuvre == "hover" else FREE,
    )
    memory, rows = _trim_autopilot(model, pilot), list[list[float]]()
    kt = np.array([rotor.kt for rotor in model.rotors])
    for k in range(round((HOVER_SECONDS if manoeuvre == "hover" else STEP_SECONDS) / period)):
        state = _autopilot_state(mujoco, data)
        reference, target = _pilot_reference(manoeuvre, k * period)
        speeds, memory = control(pilot, memory, state, reference, grounded=False)
        rows.append([k * period, target, *_observed_response(manoeuvre, state)])
        data.ctrl[:] = kt * speeds**2
        mujoco.mj_step(world, data, STEPS_PER_COMMAND)
    time, asked, flown, tilt = np.array(rows).T
    return ModelFlight(manoeuvre=manoeuvre, time=time, asked=asked, flown=flown, tilt=tilt)


def has_mujoco() -> bool:
    """Test whether manoeuvres can be flown here."""
    try:
        require_mujoco()
    except OutputError:
        return False
    return True


def require_mujoco() -> Any:
    """Import the module; OutputError with the command that installs it where it is absent."""
    try:
        return import_module("mujoco")
    except ModuleNotFoundError as error:
        raise OutputError(
            'flying the model needs MuJoCo: pip install "rotorfit[mujoco]"'
        ) from error
    except ImportError as error:  # installed, but in pieces; its own text names the repair
        raise OutputError(f"MuJoCo is installed, but cannot be imported: {error}") from error


def _load_model(mujoco: Any, model: VehicleModel) -> Any:
    try:
        return mujoco.MjModel.from_xml_string(write_mujoco(model, ()))
    except ValueError as error:
        raise OutputError(
            f"MuJoCo does not take the model ({error}); look at what  rotorfit export --to mujoco  "
            "writes, and at the doubts of the result"
        ) from error


def _simulated_vehicle(model: VehicleModel) -> tuple[Truth, Vehicle]:
    """Describe the vehicle as the simulated flights do."""
    x, y, z = (model.mass * model.com).tolist()
    kt = model.kt
    truth = Truth(
        mass=model.mass,
        first_moments=(x, y, z),
        inertia=tensor_elements(inertia_at_origin(model)),
        kt=kt,
        kd=model.kd,
        kt_spread=tuple(rotor.kt / kt for rotor in model.rotors),
    )
    return truth, Vehicle(rotors=tuple(map(_simulated_rotor, model.rotors)))


def _trim_autopilot(model: VehicleModel, pilot: Autopilot) -> Memory:
    """Set the autopilot's integrators to the trim of hover."""
    _, vehicle = _simulated_vehicle(model)
    kt = np.array([rotor.kt for rotor in model.rotors])
    # The mixer, made for equal rotors, is asked for what makes the rotors as they are give the
    # weight, and its torque about the origin.
    given = allocation(vehicle, kt=kt, kd=model.kd)[2:] @ pilot.mixer
    weight = model.mass * GRAVITY
    needed = np.array([weight, weight * model.com[1], -weight * model.com[0], 0.0])
    _, x, y, z = np.linalg.solve(given, needed).tolist()
    return Memory(0.0, (x, y, z), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def _simulated_rotor(rotor: ExportedRotor) -> Rotor:
    (px, py, pz), (nx, ny, nz) = rotor.position.tolist(), rotor.axis.tolist()
    spin = "ccw" if rotor.spin > 0 else "cw"
    return Rotor(position=(px, py, pz), axis=(nx, ny, nz), spin=spin)


def _autopilot_state(mujoco: Any, data: Any) -> tuple[float, ...]:
    """Collect what the autopilot sees: rates, attitude, velocity in body axes, place."""
    turned, velocity = np.empty(4), np.empty(3)
    mujoco.mju_negQuat(turned, data.qpos[3:7])
    mujoco.mju_rotVecQuat(velocity, data.qvel[:3], turned)
    place = np.asarray(data.qpos[:3]) - (0.0, 0.0, 1.0)  # where the key hover puts it
    return tuple(np.concatenate([data.qvel[3:6], data.qpos[3:7], velocity, place]).tolist())


def _pilot_reference(manoeuvre: Manoeuvre, time: float) -> tuple[Reference, float]:
    """Build the pilot's request, with the one number of it that is looked at."""
    size = float(STEP.get(manoeuvre, 0.0)) if time >= BEFORE else 0.0
    reference = Reference(
        roll=size if manoeuvre == "roll" else 0.0,
        pitch=size if manoeuvre == "pitch" else 0.0,
        yaw_rate=size if manoeuvre == "yaw rate" else 0.0,
        climb=0.0,
        height=0.0,
        height_rate=0.0,
        throttle=1.0,
        landing=0.0,
    )
    return reference, size


def _observed_response(manoeuvre: Manoeuvre, state: tuple[float, ...]) -> tuple[float, float]:
    """Compute the number that is looked at, and the tilt [rad]."""
    w, x, y, z = state[3:7]
    tilt = float(np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0)))
    match manoeuvre:
        case "hover":
            return state[12], tilt
        case "roll":
            return float(np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))), tilt
        case "pitch":
            return float(np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))), tilt
        case "yaw rate":
            return state[2], tilt
