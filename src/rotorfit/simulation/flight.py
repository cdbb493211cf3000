"""Fly a vehicle of known truth through a scenario."""

from __future__ import annotations

from dataclasses import field
from math import ceil
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rotorfit.errors import ExperimentError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.simulation.body import (
    RigidBody,
    State,
    Vector,
    accelerations,
    no_type_check,
    rigid_body,
    rotation,
    step,
    through_air,
    times,
    with_drag,
    with_rotor_air,
)
from rotorfit.simulation.controller import (
    Autopilot,
    Gains,
    Memory,
    autopilot_of,
    control,
    mix,
    trimmed,
)
from rotorfit.simulation.pilot import Course, Reference, Sticks, plan_flight
from rotorfit.simulation.rotors import Rotors, decay_over, lagged, rotors_of, speed_slopes, wrenches
from rotorfit.simulation.sensors import (
    PERFECT,
    Sensors,
    SimulatedFlight,
    gauss_markov,
    gyro_noise,
    measure,
)
from rotorfit.simulation.truth import GRAVITY, Truth

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float

    from rotorfit.model.vehicle import Vehicle
    from rotorfit.simulation.rotors import Decay


@frozen_dataclass
class Scenario:
    """How the vehicle is flown and what measures it.

    - `seconds`: duration of the flight between take-off and landing [s].
    - `ground_seconds`: rest before take-off and after landing [s]; 0: from hover to hover.
    - `sticks`: what the pilot does.
    - `course`: what fast course is flown at the same time; None: the vehicle stays.
    - `sensors`: errors of what is logged.
    - `sample_rate`: of the autopilot and of the log [Hz].
    - `physics_rate`: least number of Runge-Kutta steps per second [Hz].
    - `thrust_to_weight`: full thrust over weight.
    - `gains`: of the autopilot.
    - `gyro_noise_in_loop`: whether the autopilot acts on the noise of its gyro, as real ones do, or
      on the true rates.
    """

    seconds: float = 75.0
    ground_seconds: float = 0.0
    sticks: Sticks = field(default_factory=Sticks)
    course: Course | None = None
    sensors: Sensors = PERFECT
    sample_rate: float = 200.0
    physics_rate: float = 400.0
    thrust_to_weight: float = 2.5
    gains: Gains = field(default_factory=Gains)
    gyro_noise_in_loop: bool = False

    def __post_init__(self) -> None:
        if self.seconds * self.sample_rate < 3 or self.ground_seconds < 0:
            raise ExperimentError("a simulated flight needs three samples, and rest of >= 0 s")


class _Stretch(NamedTuple):
    """A part of the time between two samples in which the command that acts is constant.

    - `samples_ago`: how old that command is.
    - `h`: length of a Runge-Kutta step [s].
    - `fractions`: beginning, middle, end, middle, end ... of the steps, over the sample period.
    - `decay`: exp(-t/lag) at the same instants, t from the beginning of the stretch.
    """

    samples_ago: int
    h: float
    fractions: Float[np.ndarray, " k"]
    decay: Decay


@frozen_dataclass
class _Machine:
    """The vehicle and its autopilot, in the form that the inner loop reads."""

    body: RigidBody
    rotors: Rotors
    autopilot: Autopilot
    stretches: tuple[_Stretch, ...]


class _Moment(NamedTuple):
    """What is recorded of a sample; `acting` is the command that reaches the motors from now on."""

    state: State
    speeds: Float[np.ndarray, " N"]
    command: Float[np.ndarray, " N"]
    acting: Float[np.ndarray, " N"]
    asked: Vector
    grounded: bool


@frozen_dataclass
class Recording:
    """What a simulation records of a flight, a row for each sample.

    - `state`: as `body.State`.
    - `speeds`, `commands`, `acting`: rotor speeds, those commanded, and the command that reaches
      the motors from each sample on [rad/s].
    - `asked`: body rates that the attitude loop asked for [rad/s].
    - `grounded`: whether the vehicle stands.
    - `disturbance`: force and torque of gusts [N, N m].
    - `max_speed`: the largest command [rad/s].
    """

    state: Float[np.ndarray, "n 13"]
    speeds: Float[np.ndarray, "n N"]
    commands: Float[np.ndarray, "n N"]
    acting: Float[np.ndarray, "n N"]
    asked: Float[np.ndarray, "n 3"]
    grounded: Bool[np.ndarray, " n"]
    disturbance: Float[np.ndarray, "n 6"]
    max_speed: float


def simulate_flight(
    truth: Truth, vehicle: Vehicle, scenario: Scenario, *, seed: int
) -> SimulatedFlight:
    """Fly a vehicle through a scenario, and measure the flight; one seed gives one flight."""
    pilot, air, sensing = np.random.SeedSequence(seed).spawn(3)
    plan = plan_flight(
        scenario.sticks,
        course=scenario.course,
        seconds=scenario.seconds,
        ground_seconds=scenario.ground_seconds,
        sample_rate=scenario.sample_rate,
        rng=np.random.default_rng(pilot),
    )
    disturbance = gauss_markov(
        np.array(truth.disturbance_force_std + truth.disturbance_torque_std),
        bandwidth=truth.disturbance_bandwidth,
        samples=len(plan) + 1,
        sample_rate=scenario.sample_rate,
        rng=np.random.default_rng(air),
    )
    machine = _make_machine(truth, vehicle, scenario)
    sensor_seed = int(sensing.generate_state(1)[0])
    rate_noise = (
        gyro_noise(scenario.sensors, len(plan), seed=sensor_seed) * scenario.gyro_noise_in_loop
    )
    moments = _fly_samples(
        machine,
        plan,
        (disturbance, rate_noise),
        trim=trimmed(truth),
        grounded=scenario.ground_seconds > 0,
    )
    recorded = _collect_record(moments, disturbance[:-1], machine.autopilot.speed_limits[1])
    flight = assemble_flight(truth, vehicle, scenario, recorded)
    return measure(flight, scenario.sensors, seed=sensor_seed)


def _make_machine(truth: Truth, vehicle: Vehicle, scenario: Scenario) -> _Machine:
    """Collect everything that stays constant during a flight."""
    period = 1 / scenario.sample_rate
    return _Machine(
        body=rigid_body(truth, vehicle),
        rotors=rotors_of(truth, vehicle),
        autopilot=autopilot_of(
            truth,
            vehicle,
            thrust_to_weight=scenario.thrust_to_weight,
            period=period,
            gains=scenario.gains,
        ),
        stretches=_cut_stretches(truth, period=period, physics_rate=scenario.physics_rate),
    )


def _cut_stretches(truth: Truth, *, period: float, physics_rate: float) -> tuple[_Stretch, ...]:
    """Cut the time between two samples where the delayed command arrives."""
    whole, arrival = divmod(round(truth.motor_delay / period, 9), 1)
    stretches: list[_Stretch] = []
    # A step of the integration must not run across that instant: the rotor acceleration jumps.
    for begin, end, age in ((0.0, arrival, int(whole) + 1), (arrival, 1.0, int(whole))):
        if end > begin:
            steps = ceil((end - begin) * period * physics_rate - 1e-9)
            fractions = np.linspace(begin, end, 2 * steps + 1)
            decay = decay_over(truth, (fractions - begin) * period)
            stretches.append(_Stretch(age, (end - begin) * period / steps, fractions, decay))
    return tuple(stretches)


def _fly_samples(
    machine: _Machine,
    plan: Sequence[Reference],
    errors: tuple[Float[np.ndarray, "n_and_1 6"], Float[np.ndarray, "n 3"]],
    *,
    trim: Memory,
    grounded: bool,
) -> list[_Moment]:
    """Simulate every sample under a disturbing wrench and a noise of the rates."""
    disturbance, rate_noise = errors
    state: State = (*(0.0,) * 3, 1.0, *(0.0,) * 9)
    speeds = mix(machine.autopilot, machine.body.mass * GRAVITY, trim.trim) * (not grounded)
    commands = [speeds] * (machine.stretches[0].samples_ago + 1)  # the latest first
    memory, moments = trim, list[_Moment]()
    arrives = machine.stretches[0].samples_ago
    gusts = zip(
        *[_interpolate_disturbance(disturbance, s.fractions) for s in machine.stretches],
        strict=True,
    )
    for reference, gust, noise in zip(plan, gusts, rate_noise.tolist(), strict=True):
        grounded = _is_standing(machine, state, speeds, reference, grounded)
        if grounded:
            state = (*(0.0,) * 3, *state[3:7], *(0.0,) * 3, *state[10:])
        seen = (state[0] + noise[0], state[1] + noise[1], state[2] + noise[2], *state[3:])
        command, memory = control(machine.autopilot, memory, seen, reference, grounded=grounded)
        commands = [command, *commands[:-1]]
        moments.append(_Moment(state, speeds, command, commands[arrives], memory.asked, grounded))
        state, speeds = _advance_to_sample(machine, state, speeds, commands, gust, grounded)
    return moments


def _interpolate_disturbance(
    disturbance: Float[np.ndarray, "n_and_1 6"], fractions: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "n k 9"]:
    """Interpolate the disturbance linearly between each sample and the next, as wrenches."""
    before, after = disturbance[:-1, None], disturbance[1:, None]
    return np.pad(before + fractions[:, None] * (after - before), ((0, 0), (0, 0), (0, 3)))


@no_type_check
def _is_standing(
    machine: _Machine,
    state: State,
    speeds: Float[np.ndarray, " N"],
    reference: Reference,
    grounded: bool,
) -> bool:
    """State whether the vehicle stands: until thrust exceeds weight, and after touching down."""
    # A vehicle in flight falls through the ground; only one that lands meets it.
    if not grounded:
        return reference.landing > 0 and state[12] <= 0
    up = rotation((state[3], state[4], state[5], state[6]))[2]
    lift = float(np.array(up) @ machine.rotors.wrench_per_square[:3] @ speeds**2)
    return reference.landing > 0 or lift <= machine.body.mass * GRAVITY


@no_type_check
def _advance_to_sample(
    machine: _Machine,
    state: State,
    speeds: Float[np.ndarray, " N"],
    commands: list[Float[np.ndarray, " N"]],
    gust: tuple[Float[np.ndarray, "k 9"], ...],
    grounded: bool,
) -> tuple[State, Float[np.ndarray, " N"]]:
    """Integrate state and rotor speeds to the next sample, with the disturbance of each stretch."""
    for (samples_ago, h, _, decay), external in zip(machine.stretches, gust, strict=True):
        command = commands[samples_ago]
        nodes = lagged(speeds, command, decay)
        speeds = nodes[-1]
        if not grounded:
            slopes = speed_slopes(machine.rotors, nodes, command)
            wrench = wrenches(machine.rotors, nodes, slopes) + external
            if machine.body.rotors is not None:
                wrench = np.concatenate([wrench, nodes], axis=1)
            acting = wrench.tolist()
            for first in range(0, len(acting) - 1, 2):
                state = step(machine.body, acting[first : first + 3], state, h)
    return state, speeds


def _compute_motions(
    body: RigidBody, recorded: Recording, of_rotors: Float[np.ndarray, "n 9"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 6"]]:
    """Compute a and dw at the samples, and the wrench that acts beside that of the rotors.

    `of_rotors`: at rest in the air.
    """
    wx, wy, wz, qw, qx, qy, qz, vx, vy, vz, _, _, _ = recorded.state.T
    w, R = (wx, wy, wz), rotation((qw, qx, qy, qz))
    moving = through_air(body.wind, R, (vx, vy, vz))
    gust = np.pad(recorded.disturbance, ((0, 0), (0, 3)))
    external = np.column_stack(with_drag(body, list(gust.T), moving, w))
    if body.rotors is not None:
        still = [*of_rotors.T, *recorded.speeds.T]
        of_rotors = np.column_stack(with_rotor_air(body.rotors, still, moving, w))[:, :9]
    a, dw = map(np.column_stack, accelerations(body, list((of_rotors + external).T), w))
    rest = GRAVITY * np.column_stack(R[2])
    needed = np.hstack([body.mass * rest, np.cross(body.first_moments, rest)])
    # The ground holds a body at rest: its wrench makes up for the weight and for the rotors.
    held = needed - of_rotors[:, :6]
    stands = recorded.grounded[:, None]
    return (
        np.where(stands, rest, a),
        np.where(stands, 0.0, dw),
        np.where(stands, held, external[:, :6]),
    )


def _collect_record(
    moments: list[_Moment], disturbance: Float[np.ndarray, "n 6"], max_speed: float
) -> Recording:
    """Collect the samples of a flight as arrays."""
    return Recording(
        state=np.array([moment.state for moment in moments]),
        speeds=np.array([moment.speeds for moment in moments]),
        commands=np.array([moment.command for moment in moments]),
        acting=np.array([moment.acting for moment in moments]),
        asked=np.array([moment.asked for moment in moments]),
        grounded=np.array([moment.grounded for moment in moments]),
        disturbance=disturbance,
        max_speed=max_speed,
    )


def assemble_flight(
    truth: Truth, vehicle: Vehicle, scenario: Scenario, recorded: Recording
) -> SimulatedFlight:
    """Collect the flight as arrays, measured without errors."""
    state, rotor_speed, grounded = recorded.state, recorded.speeds, recorded.grounded
    attitude = state[:, 3:7]
    rotors = rotors_of(truth, vehicle)
    slopes = speed_slopes(rotors, rotor_speed, recorded.acting)
    of_rotors = wrenches(rotors, rotor_speed, slopes)
    force, turn, external = _compute_motions(rigid_body(truth, vehicle), recorded, of_rotors)
    time = np.arange(len(state)) / scenario.sample_rate
    return SimulatedFlight(
        truth=truth,
        vehicle=vehicle,
        sensors=PERFECT,
        sample_rate=scenario.sample_rate,
        time=time,
        attitude_wxyz=attitude,
        position=state[:, 10:],
        velocity=np.column_stack(times(rotation(tuple(attitude.T)), tuple(state[:, 7:10].T))),
        velocity_measured=state[:, 7:10],
        specific_force=force,
        specific_force_imu=force,
        angular_velocity=state[:, :3],
        angular_acceleration=turn,
        rotor_speed=rotor_speed,
        rotor_acceleration=slopes,
        commanded_speed=recorded.commands,
        reference=recorded.asked,
        max_speed=recorded.max_speed,
        external_wrench=external,
        airborne=~grounded,
        gyro=state[:, :3],
        accel=force,
        rotor_speed_measured=rotor_speed,
        pose_time=time,
        position_measured=state[:, 10:],
        attitude_wxyz_measured=attitude,
    )
