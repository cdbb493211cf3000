"""Flights whose motion and IMU readings are MuJoCo's, an engine that shares no line with us.

Ours are the autopilot, the pilot and the noise that is added to MuJoCo's gyro and accelerometer;
the first-order lag of the motors is written out here. Everything else is in the model that `mjcf`
writes: a free body with an explicit inertial, on feet that touch a floor; rotors that spin on
hinges, driven by motors on the frame, so that reaction and gyroscopic torque come by themselves;
thrust and the air's torque act on the rotors; drag on the frame.

Timing. Physics at 2 kHz, autopilot and log at 200 Hz. A row of the log holds the IMU at the sample
instant and the command given at that instant, which acts at once and is held until the next row.
The hold is not counted as delay: lag plus delay of a log is the motors' time constant plus
`Truth.motor_delay`, nothing else. Each thrust is that of the middle of its physics step; the
accelerometer reads the mean of the first step after the sample instant.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from rotorfit.model.vehicle import Vehicle
from rotorfit.simulation.controller import (
    Autopilot,
    Gains,
    Memory,
    autopilot_of,
    control,
    trimmed,
)
from rotorfit.simulation.pilot import Reference, Sticks, plan_flight
from rotorfit.simulation.sensors import PERFECT, Sensors, gauss_markov, measured
from rotorfit.simulation.truth import GRAVITY, Truth

Axes = Literal["FLU", "FRD"]
SAMPLE_RATE: Final = 200.0
STEPS: Final = 10
"""Physics steps per sample."""
STEP: Final = 1.0 / (SAMPLE_RATE * STEPS)
GROUND_SECONDS: Final = 2.0
FEET: Final = 0.1
"""Of the body origin above the floor [m]."""
MIDDLES: Final = (np.arange(STEPS)[:, None] + 0.5) / STEPS
"""Of the physics steps, as shares of a sample."""
ROTOR_MASS: Final = 0.005
FULL_SPEED: Final = 1600.0
"""That a full command asks for; no flight here gets there [rad/s]."""
LAW: Final = f"law = {{ linear = [0.0, {FULL_SPEED}] }}"
"""The same as an experiment file has it."""
TO_SITE: Final = {"FLU": "1 0 0 0", "FRD": "0 1 0 0"}
"""Quaternion wxyz of the IMU in the frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MujocoFlight:
    """One flight as logged, and what flew.

    Attributes
    ----------
    truth, vehicle
        What flew, body axes FLU.
    axes
        Of gyro and accel.
    time
        [s]
    gyro, accel
        As logged, at the IMU [rad/s, m/s^2].
    rotor_speed
        As logged [rad/s].
    command
        Set at this row, 0 to 1 of `FULL_SPEED`.
    height
        Of the body origin above the start, exact [m].
    state
        Of the frame at each row, exact: MuJoCo's position [m] and quaternion (wxyz), then its
        velocity in world axes [m/s] and its rates in body axes [rad/s].
    """

    truth: Truth
    vehicle: Vehicle
    axes: Axes
    time: Float[np.ndarray, " n"]
    gyro: Float[np.ndarray, "n 3"]
    accel: Float[np.ndarray, "n 3"]
    rotor_speed: Float[np.ndarray, "n N"]
    command: Float[np.ndarray, "n N"]
    height: Float[np.ndarray, " n"]
    state: Float[np.ndarray, "n 13"]


def fly(
    truth: Truth,
    vehicle: Vehicle,
    *,
    seed: int,
    seconds: float = 75.0,
    sticks: Sticks | None = None,
    sensors: Sensors = PERFECT,
    axes: Axes = "FLU",
) -> MujocoFlight:
    """Fly from the floor and back; the same seed gives the same sticks, gusts and noise."""
    sticks = Sticks() if sticks is None else sticks
    pilot, air, sensing = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3))
    plan = plan_flight(
        sticks,
        seconds=seconds,
        ground_seconds=GROUND_SECONDS,
        sample_rate=SAMPLE_RATE,
        rng=pilot,
    )
    gusts = gauss_markov(
        np.array(truth.disturbance_force_std + truth.disturbance_torque_std),
        bandwidth=truth.disturbance_bandwidth,
        samples=len(plan) + 1,
        sample_rate=SAMPLE_RATE,
        rng=air,
    )
    rows = _flown(_machine(truth, vehicle, axes), plan, gusts)
    return _logged(rows, truth, vehicle, sensors=sensors, axes=axes, rng=sensing)


class Row(NamedTuple):
    """What is read at one sample."""

    imu: Float[np.ndarray, " 6"]
    speed: Float[np.ndarray, " N"]
    command: Float[np.ndarray, " N"]
    height: float
    state: Float[np.ndarray, " 13"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Machine:
    """MuJoCo's model and its state, and what drives it."""

    model: mujoco.MjModel
    data: mujoco.MjData
    autopilot: Autopilot
    memory: Memory
    truth: Truth
    kt: Float[np.ndarray, " N"]
    spins: Float[np.ndarray, " N"]


def _machine(truth: Truth, vehicle: Vehicle, axes: Axes) -> _Machine:
    model = mujoco.MjModel.from_xml_string(mjcf(truth, vehicle, axes=axes))
    data = mujoco.MjData(model)
    data.qpos[2] = FEET
    return _Machine(
        model=model,
        data=data,
        autopilot=_autopilot(truth, vehicle),
        memory=trimmed(truth),
        truth=truth,
        kt=truth.rotor_kt(len(vehicle.rotors)),
        spins=vehicle.spins,
    )


def _autopilot(truth: Truth, vehicle: Vehicle) -> Autopilot:
    return autopilot_of(
        truth, vehicle, thrust_to_weight=2.5, period=1.0 / SAMPLE_RATE, gains=Gains()
    )


def _flown(
    machine: _Machine, plan: list[Reference], gusts: Float[np.ndarray, "n_and_1 6"]
) -> list[Row]:
    """Return what is read at every sample of a plan."""
    old, cut = divmod(round(machine.truth.motor_delay / STEP), STEPS)
    speed = np.zeros(len(machine.kt))
    commands = [speed] * (old + 2)  # the latest first
    memory, grounded, rows = machine.memory, True, list[Row]()
    for reference, before, after in zip(plan, gusts[:-1], gusts[1:], strict=True):
        grounded = _stands(machine, speed, reference, grounded)
        command, memory = control(
            machine.autopilot, memory, _state(machine.data), reference, grounded=grounded
        )
        commands = [command, *commands[:-1]]
        nodes = _speeds(machine, speed, commands[old + 1], commands[old], cut)
        gust = (before + MIDDLES * (after - before)) * (not grounded)
        state = np.concatenate([machine.data.qpos[:7], machine.data.qvel[:6]])
        imu = _advance(machine, nodes, gust)
        rows.append(Row(imu, speed, command, float(machine.data.qpos[2]) - FEET, state))
        speed = nodes[-1]
    return rows


def _stands(
    machine: _Machine, speed: Float[np.ndarray, " N"], reference: Reference, grounded: bool
) -> bool:
    """Say whether the vehicle stands; in flight it passes through the floor."""
    if grounded:
        lift = float(machine.kt @ speed**2)
        stands = reference.landing > 0 or lift <= machine.truth.mass * GRAVITY
    else:
        stands = reference.landing > 0 and machine.data.ncon > 0
    flag = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    if stands or reference.landing > 0:
        machine.model.opt.disableflags &= ~flag
    else:
        machine.model.opt.disableflags |= flag
    return stands


def _state(data: mujoco.MjData) -> tuple[float, ...]:
    """Return what the autopilot sees: rates, attitude, velocity in body axes, position."""
    turned, velocity = np.empty(4), np.empty(3)
    mujoco.mju_negQuat(turned, data.qpos[3:7])
    mujoco.mju_rotVecQuat(velocity, data.qvel[:3], turned)
    place = data.qpos[:3] - (0.0, 0.0, FEET)
    return tuple(np.concatenate([data.qvel[3:6], data.qpos[3:7], velocity, place]).tolist())


def _speeds(
    machine: _Machine,
    speed: Float[np.ndarray, " N"],
    old: Float[np.ndarray, " N"],
    new: Float[np.ndarray, " N"],
    cut: int,
) -> Float[np.ndarray, "k N"]:
    """Return the rotor speeds of one sample at beginning, middle, end ... of its steps."""
    left = np.exp(-np.arange(2 * STEPS + 1)[:, None] * (STEP / 2 / machine.truth.motor_lag))
    split = 2 * cut
    first = old + left[: split + 1] * (speed - old)
    then = new + left[: 2 * STEPS + 1 - split] * (first[-1] - new)
    return np.concatenate([first, then[1:]])


def _advance(
    machine: _Machine, nodes: Float[np.ndarray, "k N"], gust: Float[np.ndarray, "steps 6"]
) -> Float[np.ndarray, " 6"]:
    """Let MuJoCo take the steps of one sample; return the IMU at their beginning."""
    model, data, n = machine.model, machine.data, len(machine.kt)
    squares = nodes[1::2] ** 2
    control = np.hstack([gust, machine.kt * squares])
    imu = np.empty(6)
    for i, row in enumerate(control):
        data.ctrl[: n + 6] = row
        if machine.truth.Jr > 0:
            rate = (nodes[2 * i + 2] - machine.spins * data.qvel[6:]) / STEP
            torque = machine.truth.Jr * rate + machine.truth.kd * squares[i]
            data.ctrl[n + 6 :] = machine.spins * torque
        mujoco.mj_step(model, data)
        if i == 0:
            imu[:] = data.sensordata
    return imu


def _logged(
    rows: list[Row],
    truth: Truth,
    vehicle: Vehicle,
    *,
    sensors: Sensors,
    axes: Axes,
    rng: np.random.Generator,
) -> MujocoFlight:
    """Return the rows as arrays, with the errors of the sensors (biases in the log's axes)."""
    imu = np.array([row.imu for row in rows])
    speed = np.array([row.speed for row in rows])
    s = sensors
    return MujocoFlight(
        truth=truth,
        vehicle=vehicle,
        axes=axes,
        time=np.arange(len(rows)) / SAMPLE_RATE,
        gyro=measured(imu[:, :3], std=s.gyro_std, rng=rng, bias=s.gyro_bias),
        accel=measured(imu[:, 3:], std=s.accel_std, rng=rng, bias=s.accel_bias),
        rotor_speed=np.abs(measured(speed, std=s.rotor_speed_std, rng=rng)),
        command=np.array([row.command for row in rows]) / FULL_SPEED,
        height=np.array([row.height for row in rows]),
        state=np.array([row.state for row in rows]),
    )


def mjcf(truth: Truth, vehicle: Vehicle, *, axes: Axes = "FLU") -> str:
    """Return the vehicle as a MuJoCo model, its IMU in the axes asked for.

    Actuators, in this order: force (drag included) and torque at the origin, thrust of each rotor
    with its share of air torque, and the motors, if the rotors have inertia.
    """
    imu = _text(vehicle.imu_position or (0.0, 0.0, 0.0))
    rotors = "\n".join(_rotor(i, truth, vehicle) for i in range(len(vehicle.rotors)))
    return f"""
<mujoco>
  <compiler inertiafromgeom="false" angle="radian"/>
  <option timestep="{STEP!r}" gravity="0 0 {-GRAVITY!r}" integrator="Euler"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" friction="1 0.1 0.1"/>
    <body name="frame">
      <freejoint/>
      {_frame_inertial(truth, vehicle)}
      {_feet()}
      <site name="origin"/>
      <site name="imu" pos="{imu}" quat="{TO_SITE[axes]}"/>
      {rotors}
    </body>
  </worldbody>
  <actuator>{_actuators(truth, vehicle)}</actuator>
  <sensor><gyro site="imu"/><accelerometer site="imu"/></sensor>
</mujoco>"""


def _frame_inertial(truth: Truth, vehicle: Vehicle) -> str:
    """Return what is left of mass and inertia without the rotors, which are bodies of their own."""
    mass, moments = truth.mass, np.array(truth.first_moments)
    xx, yy, zz, xy, xz, yz = truth.inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if truth.Jr > 0:
        for rotor in vehicle.rotors:
            P, n = np.array(rotor.position), np.array(rotor.axis)
            mass -= ROTOR_MASS
            moments = moments - ROTOR_MASS * P
            tensor = tensor - ROTOR_MASS * _point(P) - truth.Jr / 2 * (np.eye(3) + np.outer(n, n))
    center = moments / mass
    I = tensor - mass * _point(center)
    elements = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    return f'<inertial pos="{_text(center)}" mass="{mass!r}" fullinertia="{_text(elements)}"/>'


def _point(place: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Return the inertia of a unit mass at a place [m^2]."""
    return place @ place * np.eye(3) - np.outer(place, place)


def _feet() -> str:
    return "".join(
        f'<geom type="sphere" size="0.02" pos="{x} {y} {0.02 - FEET}" friction="1 0.1 0.1"/>'
        for x in (-0.15, 0.15)
        for y in (-0.15, 0.15)
    )


def _rotor(i: int, truth: Truth, vehicle: Vehicle) -> str:
    """Return a rotor: a body on a hinge, or without inertia only the place where thrust acts."""
    rotor = vehicle.rotors[i]
    place = f'pos="{_text(rotor.position)}" zaxis="{_text(rotor.axis)}"'
    if truth.Jr == 0:
        return f'<site name="rotor{i}" {place}/>'
    disc = _text([truth.Jr / 2, truth.Jr / 2, truth.Jr])
    return (
        f'<body {place}><joint name="rotor{i}" axis="0 0 1"/><site name="rotor{i}"/>'
        f'<inertial pos="0 0 0" mass="{ROTOR_MASS}" diaginertia="{disc}"/></body>'
    )


def _actuators(truth: Truth, vehicle: Vehicle) -> str:
    lines: list[str] = []
    for k, drag in enumerate((*truth.drag, 0.0, 0.0, 0.0)):
        gear = _text(np.eye(6)[k])
        bias = f'biastype="affine" biasprm="0 0 {-drag!r}"'  # force per velocity of the site
        lines.append(f'<general site="origin" gear="{gear}" {bias}/>')
    numbers = range(len(vehicle.rotors))
    for i, kt, spin in zip(
        numbers, truth.rotor_kt(len(numbers)), vehicle.spins.tolist(), strict=True
    ):
        lines.append(
            f'<general site="rotor{i}" gear="0 0 1 0 0 {float(-spin * truth.kd / kt)!r}"/>'
        )
    if truth.Jr > 0:
        lines += [f'<motor joint="rotor{i}"/>' for i in numbers]
    return "\n".join(lines)


def _text(numbers: object) -> str:
    return " ".join(repr(float(x)) for x in np.asarray(numbers, dtype=float))


def write_table(
    flight: MujocoFlight, path: Path, *, motors: Literal["command", "rotor"] = "rotor"
) -> None:
    """Write a flight table (CSV) with commands or with measured rotor speeds."""
    columns = ["time"] + [f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"]
    driven = flight.command if motors == "command" else flight.rotor_speed
    columns += [f"{motors}_{i + 1}" for i in range(driven.shape[1])]
    table = np.column_stack([flight.time, flight.gyro, flight.accel, driven])
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")


def experiment_text(
    vehicle: Vehicle, configurations: str, *, motors: str, axes: Axes = "FLU", extra: str = ""
) -> str:
    """Return an experiment file on flights of a vehicle, its airframe in the axes asked for."""
    turn = (1.0, 1.0, 1.0) if axes == "FLU" else (1.0, -1.0, -1.0)

    def turned(vector: tuple[float, ...]) -> list[float]:
        return [t * x for t, x in zip(turn, vector, strict=True)]

    rotors = ", ".join(
        f'{{ position = {turned(r.position)}, spin = "{r.spin}", axis = {turned(r.axis)} }}'
        for r in vehicle.rotors
    )
    place = turned(vehicle.imu_position or (0.0, 0.0, 0.0))
    return (
        f'[airframe]\naxes = "{axes}"\nrotors = [{rotors}]\nimu = {{ position = {place} }}\n'
        f"[motors]\n{motors}\n{extra}\n{configurations}"
    )
