"""Fly several manoeuvres of one vehicle at once, in still air and from hover to hover.

`flight.simulate_flight` flies one manoeuvre with everything that the simulator has, in plain
Python. This module advances one array with a row for each manoeuvre. It leaves out gusts, drag,
the ground, delays and sensor noise; tests hold it against `simulate_flight`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import ExperimentError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.simulation.controller import Autopilot, autopilot_of, mix, trimmed
from rotorfit.simulation.flight import Recording, Scenario, assemble_flight
from rotorfit.simulation.pilot import Sticks, plan_rows
from rotorfit.simulation.rotors import Rotors, rotors_of
from rotorfit.simulation.truth import GRAVITY, Truth

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

    from rotorfit.model.vehicle import Vehicle
    from rotorfit.simulation.sensors import SimulatedFlight

CALM: Final = frozenset(
    {"mass", "first_moments", "inertia", "kt", "kd", "Jr", "kt_spread", "motor_lag"}
    | {"disturbance_bandwidth"}
)
"""Fields of `Truth` that a calm flight may have; all others must be as they are by default."""
SETTLING: Final = 4.0
"""Time in which a piece that begins in hover comes to fly as the whole does [s].

The slowest loop, that of the place, has forgotten four fifths by then.
"""


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


@frozen_dataclass
class _Loop:
    """Vehicle and autopilot as arrays; the gains times inertia and sample period.

    - `motion`: from force, torque and products of rates to the accelerations.
    - `half_decay`: what is left of a rotor's deviation from its command after half a sample.
    - `fall`: velocity that gravity takes in a sample [m/s].
    """

    autopilot: Autopilot
    rotors: Rotors
    motion: Float[np.ndarray, "24 6"]
    mixer: Float[np.ndarray, "4 N"]
    squares: tuple[float, float]
    attitude: Float[np.ndarray, " 3"]
    rate: Float[np.ndarray, " 3"]
    damping: Float[np.ndarray, " 3"]
    integral: Float[np.ndarray, " 3"]
    half_decay: float
    fall: Float[np.ndarray, " 3"]


def simulate_calm_flights(
    truth: Truth,
    vehicle: Vehicle,
    scenario: Scenario,
    *,
    sticks: Sequence[Sticks],
    seed: int,
    piece: float | None = None,
) -> list[SimulatedFlight]:
    """Fly a vehicle through one scenario with each of several pilots' sticks.

    The flights are those of `simulate_flight` with the same seed but for the integration: one
    second-order step from sample to sample instead of Runge-Kutta steps. Their samples satisfy the
    equations of motion exactly.

    `piece`: fly pieces of this length [s] at once, each from a hover `SETTLING` seconds before it,
    and put them together: the motion jumps a little from one to the next.

    Raises `ExperimentError` where the vehicle or the scenario has what a calm flight leaves out.
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
    if piece is None:
        recorded = _fly_together(truth, vehicle, scenario, plan)
    else:
        recorded = _fly_pieces(truth, vehicle, scenario, plan, round(piece * scenario.sample_rate))
    return [assemble_flight(truth, vehicle, scenario, one) for one in recorded]


def _check_calm(truth: Truth, scenario: Scenario) -> None:
    """Raise an error if a vehicle or a scenario has what a calm flight leaves out."""
    for field in fields(Truth):
        if field.name not in CALM and getattr(truth, field.name) != field.default:
            raise ExperimentError(f"a calm flight is simulated without {field.name}")
    if truth.motor_lag <= 0:
        raise ExperimentError("a calm flight is simulated with a motor lag > 0 only")
    if scenario.ground_seconds > 0 or scenario.gyro_noise_in_loop:
        raise ExperimentError("a calm flight is simulated without ground and without gyro noise")


def _fly_pieces(
    truth: Truth,
    vehicle: Vehicle,
    scenario: Scenario,
    plan: Float[np.ndarray, "n m 8"],
    length: int,
) -> list[Recording]:
    """Fly pieces of all manoeuvres at once, and join what each flew after it had settled."""
    n, m, _ = plan.shape
    before = round(SETTLING * scenario.sample_rate)
    count = -(-n // length)
    hover = plan[:1] * 0.0
    wide = np.concatenate([hover.repeat(before, 0), plan, hover.repeat(count * length - n, 0)])
    pieces = np.stack([wide[k * length :][: before + length] for k in range(count)], axis=1)
    flown = _fly_together(truth, vehicle, scenario, pieces.reshape(before + length, count * m, 8))
    return [_join_pieces(flown[i::m], before, n) for i in range(m)]


def _join_pieces(pieces: Sequence[Recording], before: int, count: int) -> Recording:
    """Join the samples after the first ones of every piece, as many as are wanted."""
    whole = {
        field.name: np.concatenate([getattr(one, field.name)[before:] for one in pieces])[:count]
        for field in fields(Recording)
        if field.name != "max_speed"
    }
    return Recording(**whole, max_speed=pieces[0].max_speed)


def _fly_together(
    truth: Truth, vehicle: Vehicle, scenario: Scenario, plan: Float[np.ndarray, "n m 8"]
) -> list[Recording]:
    """Advance all manoeuvres together, and record every sample of each."""
    n, m, _ = plan.shape
    loop = _make_loop(truth, vehicle, scenario)
    fly = _hovering_flights(truth, loop.autopilot, m)
    half_yaw = 0.5 * np.cumsum(plan[:, :, 2], axis=0) / scenario.sample_rate
    turned = np.stack([np.cos(half_yaw), np.sin(half_yaw)], axis=2)[:, :, None, None, :]
    N = len(vehicle.rotors)
    w, q, v, p = (np.empty((n, m, k)) for k in (3, 4, 3, 3))
    speeds, commands, asked = np.empty((n, m, N)), np.empty((n, m, N)), np.empty((n, m, 3))
    for k in range(n):
        w[k], q[k], v[k], p[k], speeds[k] = fly.w, fly.q, fly.v, fly.p, fly.speeds
        commands[k], asked[k] = _command_rotors(loop, fly, plan[k], turned[k])
        _advance_step(loop, fly, commands[k])
    R = _rotation_matrices(q)
    flying = np.zeros(n, dtype=np.bool_)
    body_v = np.einsum("nmab,nma->nmb", R, v)
    state = np.concatenate([w, q, body_v, p], axis=2)
    return [
        Recording(
            state=state[:, i],
            speeds=speeds[:, i],
            commands=commands[:, i],
            acting=commands[:, i],
            asked=asked[:, i],
            grounded=flying,
            disturbance=np.zeros((n, 6)),
            max_speed=loop.autopilot.speed_limits[1],
        )
        for i in range(m)
    ]


def _make_loop(truth: Truth, vehicle: Vehicle, scenario: Scenario) -> _Loop:
    """Collect what stays constant during the flights."""
    period, gains = 1.0 / scenario.sample_rate, scenario.gains
    autopilot = autopilot_of(
        truth,
        vehicle,
        thrust_to_weight=scenario.thrust_to_weight,
        period=period,
        gains=gains,
    )
    lowest, highest = autopilot.speed_limits
    inertia = np.array(autopilot.inertia)
    return _Loop(
        autopilot=autopilot,
        rotors=rotors_of(truth, vehicle),
        motion=_motion_matrix(truth),
        mixer=np.array(autopilot.mixer).T,
        squares=(lowest**2, highest**2),
        attitude=np.array(gains.attitude),
        rate=inertia * gains.rate,
        damping=inertia * gains.damping / period,
        integral=inertia * gains.integral * period,
        half_decay=float(np.exp(-0.5 * period / truth.motor_lag)),
        fall=np.array([0.0, 0.0, period * GRAVITY]),
    )


def _hovering_flights(truth: Truth, autopilot: Autopilot, count: int) -> _Flights:
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


def _command_rotors(
    loop: _Loop,
    fly: _Flights,
    reference: Float[np.ndarray, "m 8"],
    turned: Float[np.ndarray, "m 1 1 2"],
) -> tuple[Float[np.ndarray, "m N"], Float[np.ndarray, "m 3"]]:
    """Compute commanded rotor speeds and the body rates asked for, as `controller.control` does."""
    gains, p, v, R = loop.autopilot.gains, fly.p, fly.v, fly.R
    wanted = -gains.position * p - gains.velocity * v
    ahead, aside = R[:, 0, 0], R[:, 1, 0]
    along = GRAVITY * np.sqrt(ahead * ahead + aside * aside)
    angles = np.empty((len(p), 2))
    angles[:, 0] = (aside * wanted[:, 0] - ahead * wanted[:, 1]) / along
    angles[:, 1] = (ahead * wanted[:, 0] + aside * wanted[:, 1]) / along
    np.minimum(np.maximum(angles, -gains.hold_tilt, out=angles), gains.hold_tilt, out=angles)
    angles += reference[:, :2]
    angles *= 0.5
    parts = np.cos(angles)[:, :, None].repeat(2, axis=2)
    np.sin(angles, out=parts[:, :, 1])
    products = parts[:, 0, :, None, None] * parts[:, 1, None, :, None] * turned
    attitude = products.reshape(-1, 8) @ EULER
    error = (fly.q[:, :, None] * attitude[:, None, :]).reshape(-1, 16) @ ERROR
    shorter = 2.0 * np.copysign(1.0, error[:, :1])
    asked = loop.attitude * (shorter * error[:, 1:]) + R[:, 2] * reference[:, 2:3]
    off = asked - fly.w
    fly.trim = fly.trim + loop.integral * off
    effort = np.empty((len(p), 4))
    effort[:, 1:] = fly.trim + loop.rate * off - loop.damping * (fly.w - fly.last_w)
    rise = gains.height * (reference[:, 4] - p[:, 2]) + gains.climb * (reference[:, 5] - v[:, 2])
    rise += reference[:, 3] + GRAVITY
    effort[:, 0] = loop.autopilot.mass * rise / np.maximum(R[:, 2, 2], 0.5)
    fly.last_w = fly.w
    lowest, highest = loop.squares
    squares = effort @ loop.mixer
    return np.sqrt(np.minimum(np.maximum(squares, lowest), highest)), asked


def _advance_step(loop: _Loop, fly: _Flights, command: Float[np.ndarray, "m N"]) -> None:
    """Take one step by the midpoint rule; the rotors' speeds are exact at its middle and end."""
    h = loop.autopilot.period
    away = fly.speeds - command
    middle_away = loop.half_decay * away
    middle = command + middle_away
    slopes = middle_away * (-1.0 / loop.rotors.lag)
    wrench = np.concatenate([middle * middle, middle, slopes], axis=1) @ loop.rotors.wrench_matrix
    w = fly.w + (0.5 * h) * fly.turn
    turning = np.concatenate([w, wrench[:, 6:9]], axis=1)
    products = (w[:, :, None] * turning[:, None, :]).reshape(-1, 18)
    motions = np.concatenate([wrench[:, :6], products], axis=1) @ loop.motion
    fly.turn = motions[:, 3:]
    new_w = fly.w + h * fly.turn
    change = np.empty((len(w), 4))
    change[:, 1:] = angle = (0.25 * h) * (fly.w + new_w)
    change[:, 0] = 1.0 - 0.5 * np.einsum("ma,ma->m", angle, angle)
    q = (fly.q[:, :, None] * change[:, None, :]).reshape(-1, 16) @ PRODUCT
    fly.q = q / np.sqrt(np.einsum("ma,ma->m", q, q))[:, None]
    R = _rotation_matrices(fly.q)
    v = fly.v + ((fly.R + R) @ motions[:, :3, None])[:, :, 0] * (0.5 * h) - loop.fall
    fly.p = fly.p + (0.5 * h) * (fly.v + v)
    fly.w, fly.R, fly.v = new_w, R, v
    fly.speeds = command + loop.half_decay * middle_away


def _rotation_matrices(q: Float[np.ndarray, "*any 4"]) -> Float[np.ndarray, "*any 3 3"]:
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
