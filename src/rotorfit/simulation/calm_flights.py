"""Fly several manoeuvres of one vehicle at once, in still air and from hover to hover.

`flight.simulate_flight` flies one manoeuvre with everything that the simulator has, in plain Python.
This module advances one array with a row for each manoeuvre, which is twenty times as fast. It
leaves out gusts, drag, the ground, delays and sensor noise; tests hold it against `simulate_flight`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.errors import ExperimentError
from rotorfit.model.vehicle import Vehicle
from rotorfit.simulation.body import Rotors, rotors_of
from rotorfit.simulation.controller import Autopilot, autopilot_of, mix, trimmed
from rotorfit.simulation.flight import Recording, Scenario, assemble_flight
from rotorfit.simulation.pilot import Sticks, plan_rows
from rotorfit.simulation.sensors import SimulatedFlight
from rotorfit.simulation.truth import GRAVITY, Truth

CALM: Final = frozenset(
    {"mass", "first_moments", "inertia", "kt", "kd", "Jr", "kt_spread", "motor_lag"}
    | {"disturbance_bandwidth"}
)
"""Fields of `Truth` that a calm flight may have; all others must be as they are by default."""


def _product_matrix() -> Float[np.ndarray, "4 4 4"]:
    """Return the structure constants of the quaternion product: (p q)_k = sum p_i q_j C_ijk."""
    C = np.zeros((4, 4, 4))
    C[0, np.arange(4), np.arange(4)] = 1.0
    C[np.arange(4), 0, np.arange(4)] = 1.0
    C[[1, 2, 3], [1, 2, 3], 0] = -1.0
    C[[1, 2, 3], [2, 3, 1], [3, 1, 2]] = 1.0
    C[[2, 3, 1], [1, 2, 3], [3, 1, 2]] = -1.0
    return C


def _rotation_matrix() -> Float[np.ndarray, "16 9"]:
    """Return the matrix that converts the products q_i q_j of a unit quaternion to its rotation."""
    C = _product_matrix()
    conjugate = np.diag([1.0, -1.0, -1.0, -1.0])
    # (q (0, v) q*)_a for v along b, as a quadratic form of q.
    form = np.einsum("ibm,jl,mla->ijab", C[:, 1:, :], conjugate, C[:, :, 1:])
    return form.reshape(16, 9)


def _error_matrix() -> Float[np.ndarray, "16 4"]:
    """Return the matrix that converts the products q_i r_j of two quaternions to q* r."""
    return np.einsum("im,mja->ija", np.diag([1.0, -1.0, -1.0, -1.0]), _product_matrix()).reshape(
        16, 4
    )


PRODUCT: Final = _product_matrix().reshape(16, 4)
ROTATION: Final = _rotation_matrix()
ERROR: Final = _error_matrix()
EULER: Final = np.array(
    [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, -1.0],
        [1.0, 0.0, 0.0, 0.0],
    ]
)
"""The quaternion of Rz(yaw) Ry(pitch) Rx(roll) by the products of the half angles' cosines (c) and
sines (s) of roll, pitch and yaw: ccc, ccs, csc, css, scc, scs, ssc, sss."""


@dataclass(slots=True)
class _Flights:
    """Everything that the loop changes from sample to sample; a row for each manoeuvre.

    - `w`, `last_w`, `turn`: angular velocity, that of the sample before, its slope; body axes.
    - `q`, `R`: attitude as quaternion and as matrix, body to world.
    - `v`, `p`: velocity and position of the origin, world axes.
    - `speeds`: of the rotors [rad/s].
    - `trim`: integrated torque [N m].
    """

    w: Float[np.ndarray, "m 3"]
    last_w: Float[np.ndarray, "m 3"]
    turn: Float[np.ndarray, "m 3"]
    q: Float[np.ndarray, "m 4"]
    R: Float[np.ndarray, "m 3 3"]
    v: Float[np.ndarray, "m 3"]
    p: Float[np.ndarray, "m 3"]
    speeds: Float[np.ndarray, "m N"]
    trim: Float[np.ndarray, "m 3"]


def simulate_calm_flights(
    truth: Truth,
    vehicle: Vehicle,
    scenario: Scenario,
    *,
    sticks: Sequence[Sticks],
    seed: int,
) -> list[SimulatedFlight]:
    """Fly a vehicle through one scenario with each of several pilots' sticks.

    The flights are those of `simulate_flight` with the same seed but for the integration: one
    second-order step from sample to sample instead of Runge-Kutta steps. Their samples satisfy the
    equations of motion exactly. Raises `ExperimentError` where the vehicle or the scenario has
    what a calm flight leaves out.
    """
    _check_calm(truth, scenario)
    plan = np.stack(
        [
            plan_rows(
                stick,
                seconds=scenario.seconds,
                ground_seconds=0.0,
                sample_rate=scenario.sample_rate,
                # As in `simulate_flight`; a generator remembers in its seed what it has spawned.
                rng=np.random.default_rng(np.random.SeedSequence(seed).spawn(3)[0]),
            )
            for stick in sticks
        ],
        axis=1,
    )
    recorded = _fly_together(truth, vehicle, scenario, plan)
    return [assemble_flight(truth, vehicle, scenario, one) for one in recorded]


def _check_calm(truth: Truth, scenario: Scenario) -> None:
    """Raise where a vehicle or a scenario has what a calm flight leaves out."""
    for field in fields(Truth):
        if field.name not in CALM and getattr(truth, field.name) != field.default:
            raise ExperimentError(f"a calm flight is simulated without {field.name}")
    if truth.motor_lag <= 0:
        raise ExperimentError("a calm flight is simulated with a motor lag > 0 only")
    if scenario.ground_seconds > 0 or scenario.gyro_noise_in_loop:
        raise ExperimentError("a calm flight is simulated without ground and without gyro noise")


def _fly_together(
    truth: Truth, vehicle: Vehicle, scenario: Scenario, plan: Float[np.ndarray, "n m 8"]
) -> list[Recording]:
    """Advance all manoeuvres together, and record every sample of each."""
    n, m, _ = plan.shape
    period = 1.0 / scenario.sample_rate
    autopilot = autopilot_of(
        truth,
        vehicle,
        thrust_to_weight=scenario.thrust_to_weight,
        period=period,
        gains=scenario.gains,
    )
    rotors, motion = rotors_of(truth, vehicle), _motion_matrix(truth)
    fly = _hovering(truth, autopilot, m)
    half_yaw = 0.5 * period * np.cumsum(plan[:, :, 2], axis=0)
    turned = np.stack([np.cos(half_yaw), np.sin(half_yaw)], axis=2)
    N = len(vehicle.rotors)
    w, q, v, p = (np.empty((n, m, k)) for k in (3, 4, 3, 3))
    speeds, commands, asked = np.empty((n, m, N)), np.empty((n, m, N)), np.empty((n, m, 3))
    for k in range(n):
        w[k], q[k], v[k], p[k], speeds[k] = fly.w, fly.q, fly.v, fly.p, fly.speeds
        commands[k], asked[k] = _command(autopilot, fly, plan[k], turned[k])
        _advance(fly, rotors, motion, commands[k], period)
    R = _rotations(q)
    body_v = np.einsum("nmab,nma->nmb", R, v)
    state = np.concatenate([w, q, body_v, p], axis=2)
    return [
        Recording(
            state=state[:, i],
            speeds=speeds[:, i],
            commands=commands[:, i],
            acting=commands[:, i],
            asked=asked[:, i],
            grounded=np.zeros(n, dtype=bool),
            disturbance=np.zeros((n, 6)),
            max_speed=autopilot.speed_limits[1],
        )
        for i in range(m)
    ]


def _hovering(truth: Truth, autopilot: Autopilot, count: int) -> _Flights:
    """Return `count` vehicles that hover, trimmed."""
    trim = trimmed(truth).trim
    speeds = mix(autopilot, truth.mass * GRAVITY, trim)
    zeros = np.zeros((count, 3))
    return _Flights(
        w=zeros,
        last_w=zeros,
        turn=zeros,
        q=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        R=np.tile(np.eye(3), (count, 1, 1)),
        v=zeros,
        p=zeros,
        speeds=np.tile(speeds, (count, 1)),
        trim=np.tile(trim, (count, 1)),
    )


def _command(
    autopilot: Autopilot,
    fly: _Flights,
    reference: Float[np.ndarray, "m 8"],
    turned: Float[np.ndarray, "m 2"],
) -> tuple[Float[np.ndarray, "m N"], Float[np.ndarray, "m 3"]]:
    """Compute commanded rotor speeds and the body rates asked for, as `controller.control` does."""
    gains, period, R = autopilot.gains, autopilot.period, fly.R
    inertia = np.array(autopilot.inertia)
    wanted = -gains.position * fly.p[:, :2] - gains.velocity * fly.v[:, :2]
    heading = R[:, :2, 0]
    along = np.hypot(heading[:, 0], heading[:, 1])
    forward = (heading * wanted).sum(axis=1) / along
    left = (heading[:, 0] * wanted[:, 1] - heading[:, 1] * wanted[:, 0]) / along
    hold = np.clip(np.stack([-left, forward], axis=1) / GRAVITY, -gains.hold_tilt, gains.hold_tilt)
    halves = 0.5 * (reference[:, :2] + hold)
    rise = gains.height * (reference[:, 4] - fly.p[:, 2])
    rise += gains.climb * (reference[:, 5] - fly.v[:, 2]) + reference[:, 3] + GRAVITY
    lift = autopilot.mass * rise / np.maximum(R[:, 2, 2], 0.5)
    trig = np.stack([np.cos(halves), np.sin(halves)], axis=2)
    parts = trig[:, 0, :, None, None] * trig[:, 1, None, :, None] * turned[:, None, None, :]
    attitude = parts.reshape(-1, 8) @ EULER
    error = (fly.q[:, :, None] * attitude[:, None, :]).reshape(-1, 16) @ ERROR
    shorter = np.where(error[:, :1] >= 0.0, 2.0, -2.0)
    asked = gains.attitude * (shorter * error[:, 1:]) + R[:, 2] * reference[:, 2:3]
    off = asked - fly.w
    fly.trim = fly.trim + (inertia * gains.integral * period) * off
    damped = np.array(gains.damping) / period * (fly.w - fly.last_w)
    torque = fly.trim + inertia * (gains.rate * off - damped)
    fly.last_w = fly.w
    lowest, highest = autopilot.speed_limits
    squares = np.concatenate([lift[:, None], torque], axis=1) @ np.array(autopilot.mixer).T
    return np.sqrt(np.clip(squares, lowest**2, highest**2)), asked


def _advance(
    fly: _Flights,
    rotors: Rotors,
    motion: Float[np.ndarray, "24 6"],
    command: Float[np.ndarray, "m N"],
    h: float,
) -> None:
    """Take one step by the midpoint rule; the rotors' speeds are exact at its middle and end."""
    away = fly.speeds - command
    middle = command + np.exp(-0.5 * h / rotors.lag) * away
    slopes = (command - middle) / rotors.lag
    wrench = np.concatenate([middle * middle, middle, slopes], axis=1) @ rotors.wrench_matrix
    w = fly.w + 0.5 * h * fly.turn
    turning = np.concatenate([w, wrench[:, 6:9]], axis=1)
    products = (w[:, :, None] * turning[:, None, :]).reshape(len(w), 18)
    motions = np.concatenate([wrench[:, :6], products], axis=1) @ motion
    fly.turn = motions[:, 3:]
    new_w = fly.w + h * fly.turn
    angle = 0.25 * h * (fly.w + new_w)
    scalar = 1.0 - 0.5 * (angle * angle).sum(axis=1, keepdims=True)
    change = np.concatenate([scalar, angle], axis=1)
    q = (fly.q[:, :, None] * change[:, None, :]).reshape(-1, 16) @ PRODUCT
    fly.q = q / np.sqrt((q * q).sum(axis=1, keepdims=True))
    R = _rotations(fly.q)
    v = fly.v + (0.5 * h) * ((fly.R + R) @ motions[:, :3, None])[:, :, 0]
    v[:, 2] -= h * GRAVITY
    fly.p = fly.p + (0.5 * h) * (fly.v + v)
    fly.w, fly.R, fly.v, fly.speeds = new_w, R, v, command + np.exp(-h / rotors.lag) * away


def _rotations(q: Float[np.ndarray, "*any 4"]) -> Float[np.ndarray, "*any 3 3"]:
    """Convert unit quaternions to rotation matrices."""
    products = (q[..., :, None] * q[..., None, :]).reshape(*q.shape[:-1], 16)
    return (products @ ROTATION).reshape(*q.shape[:-1], 3, 3)


def _motion_matrix(truth: Truth) -> Float[np.ndarray, "24 6"]:
    """Return the matrix from force, torque and products of rates to a and dw (Newton-Euler).

        m a + dw x ms = f - w x (w x ms)
        I dw + ms x a = tau - w x (I w + h)

    The products are w_i (w, h)_j, h the rotors' angular momentum relative to the body.
    """
    ms, I, axes = np.array(truth.first_moments), truth.inertia_tensor, np.eye(3)
    crossed = np.cross(axes, ms).T  # of dw x ms by dw
    left = np.block([[truth.mass * axes, crossed], [-crossed, I]])
    right = np.zeros((24, 6))
    right[:6] = np.eye(6)
    for i, along in enumerate(axes):
        for j, other in enumerate(axes):
            row = 6 + 6 * i + j
            right[row, :3] = -np.cross(along, np.cross(other, ms))
            right[row, 3:] = -np.cross(along, I @ other)
            right[row + 3, 3:] = -np.cross(along, other)
    return right @ np.linalg.inv(left).T
