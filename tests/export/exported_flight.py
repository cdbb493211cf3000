"""Flights flown in the simulators that an export is for, from the exported file and nothing else.

Ours are the pilot and the autopilot; motion and readings are the other's. The log is written as a
table: gyro, accelerometer at the origin of the sensor, and rotor speed as it is.
"""

import runpy

import mujoco
import numpy as np
from export_material import KD, KT, LAG, saved
from scipy.spatial.transform import Rotation

from rotorfit.model.vehicle import Vehicle
from rotorfit.simulation import Gains, Sticks, Truth
from rotorfit.simulation.controller import autopilot_of, control, trimmed
from rotorfit.simulation.pilot import plan_flight
from rotorfit.simulation.truth import tensor_elements

SAMPLE_RATE = 200.0
STEPS = 10
GYRO_STD, ACCEL_STD, SPEED_STD = 0.005, 0.05, 1.0


def truth_of(mass, com, inertia_com, kt=KT):
    """The vehicle in the words of the autopilot."""
    steiner = mass * (com @ com * np.eye(3) - np.outer(com, com))
    x, y, z = (mass * com).tolist()
    return Truth(
        mass=mass,
        first_moments=(x, y, z),
        inertia=tensor_elements(inertia_com + steiner),
        kt=kt,
        kd=KD,
        motor_lag=LAG,
    )


def plan_and_pilot(truth, vehicle, *, seconds, seed):
    pilot = autopilot_of(
        truth, vehicle, thrust_to_weight=2.5, period=1.0 / SAMPLE_RATE, gains=Gains()
    )
    plan = plan_flight(
        Sticks(),
        seconds=seconds,
        ground_seconds=0.0,
        sample_rate=SAMPLE_RATE,
        rng=np.random.default_rng(seed),
    )
    return plan, pilot


def in_mujoco(text, truth, vehicle, *, kt, seconds, seed):
    """Fly the MJCF text; return rows of time, gyro, accel, rotor speeds."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = 1.0 / (SAMPLE_RATE * STEPS)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    plan, pilot = plan_and_pilot(truth, vehicle, seconds=seconds, seed=seed)
    memory, rows = trimmed(truth), []
    for i, reference in enumerate(plan):
        place = np.asarray(data.qpos[:3]) - (0.0, 0.0, 1.0)
        state = state_of(data.qvel[3:6], data.qpos[3:7], data.qvel[:3], place)
        command, memory = control(pilot, memory, state, reference, grounded=False)
        speed = np.sqrt(np.maximum(data.act, 0.0) / kt)
        data.ctrl[:] = kt * command**2
        mujoco.mj_step(model, data)
        readings = [data.sensor(name).data.copy() for name in ("gyro", "accelerometer")]
        rows.append(np.concatenate([[i / SAMPLE_RATE], *readings, speed]))
        mujoco.mj_step(model, data, STEPS - 1)
    return np.array(rows)


def in_rotorpy(tmp_path, result, truth, vehicle, *, seconds, seed):
    """Fly RotorPy's dictionary; the origin is the CoM, as its state has it."""
    from rotorpy.vehicles.multirotor import Multirotor

    params = runpy.run_path(str(saved(tmp_path, result, "rotorpy", "params.py")))["quad_params"]
    hover = float(np.sqrt(truth.mass * 9.81 / (4 * truth.kt)))
    state = {
        "x": np.zeros(3),
        "v": np.zeros(3),
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(4, hover),
    }
    quad = Multirotor(params, initial_state=state, aero=False)
    plan, pilot = plan_and_pilot(truth, vehicle, seconds=seconds, seed=seed)
    memory, rows = trimmed(truth), []
    for i, reference in enumerate(plan):
        x, y, z, w = state["q"]
        seen = state_of(state["w"], np.array([w, x, y, z]), state["v"], state["x"])
        command, memory = control(pilot, memory, seen, reference, grounded=False)
        rate = quad.statedot(state, {"cmd_motor_speeds": command}, 1.0 / SAMPLE_RATE)
        turn = Rotation.from_quat(state["q"]).as_matrix()
        force = turn.T @ (rate["vdot"] + [0.0, 0.0, 9.81])  # RotorPy's gravity
        rows.append(np.concatenate([[i / SAMPLE_RATE], state["w"], force, state["rotor_speeds"]]))
        state = quad.step(state, {"cmd_motor_speeds": command}, 1.0 / SAMPLE_RATE)
    return np.array(rows)


def state_of(rates, attitude_wxyz, velocity_world, place):
    w, x, y, z = attitude_wxyz
    velocity = Rotation.from_quat([x, y, z, w]).inv().apply(velocity_world)
    return tuple(np.concatenate([rates, attitude_wxyz, velocity, place]).tolist())


def write_log(path, rows, *, seed):
    """Write a flight table with the noise of sensors."""
    rng = np.random.default_rng(seed)
    noisy = rows.copy()
    std = [0.0, *[GYRO_STD] * 3, *[ACCEL_STD] * 3, *[SPEED_STD] * (rows.shape[1] - 7)]
    noisy += rng.standard_normal(rows.shape) * std
    names = ["time", *(f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz")]
    names += [f"rotor_{i + 1}" for i in range(rows.shape[1] - 7)]
    np.savetxt(path, noisy, fmt="%.9g", delimiter=",", header=",".join(names), comments="")


def placed(vehicle, *, imu, shift=(0.0, 0.0, 0.0)):
    """The vehicle with its IMU, its rotors moved together."""
    from dataclasses import replace

    rotors = tuple(
        replace(r, position=tuple(float(p + s) for p, s in zip(r.position, shift, strict=True)))
        for r in vehicle.rotors
    )
    return Vehicle(rotors=rotors, imu_position=tuple(float(v) for v in imu))
