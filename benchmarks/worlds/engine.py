"""The engine: rigid bodies, motors, sensors and autopilots of many worlds, 1 ms a step.

Arrays have the worlds last: vectors (3, W), rotors (8, W) where a missing rotor has no thrust. A
step is the midpoint rule: the rotors' speeds are exact at its middle and end (a lag of first order
under a held command), forces and torques are those of the middle. A row of the record holds what
is read at the beginning of a step; the specific force in it is that of the middle of the step
before, and `sensing.py` averages two of them for the instant between.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from benchmarks.worlds.pilot import STEP, plan
from benchmarks.worlds.world import GRAVITY, World
from jaxtyping import Float

ROTORS: Final = 8
LONGEST: Final = 16
"""Steps that a command may take to a motor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """What happened in one world, a row a step.

    Attributes
    ----------
    gyro, accel
        At the IMU (accel: half a step old), with all errors of the sensor but turn, scale and
        steps; body axes [rad/s, m/s^2].
    filtered
        The gyro as the rate loop hears it.
    speed, wanted, voltage
        Of the rotors and what the autopilot asks for [rad/s]; share of the full voltage.
    velocity
        Of the centre of mass, body axes [m/s].
    rates, height, up
        True body rates [rad/s], height [m], share of the body's z-axis along up.
    airborne
        Whether it flies.
    """

    gyro: Float[np.ndarray, "n 3"]
    accel: Float[np.ndarray, "n 3"]
    filtered: Float[np.ndarray, "n 3"]
    speed: Float[np.ndarray, "n N"]
    wanted: Float[np.ndarray, "n N"]
    voltage: Float[np.ndarray, " n"]
    velocity: Float[np.ndarray, "n 3"]
    rates: Float[np.ndarray, "n 3"]
    height: Float[np.ndarray, " n"]
    up: Float[np.ndarray, " n"]
    airborne: Float[np.ndarray, " n"]

    @property
    def lost(self) -> bool:
        """Whether the vehicle got out of control, which no study is about."""
        late = self.up[self.airborne > 0][1500:]
        return not np.isfinite(self.gyro).all() or bool(len(late) and late.min() < 0.3)


class Biquads:
    """One filter of second order for each world, over k channels of it."""

    def __init__(self, coefficients: Float[np.ndarray, "5 W"], k: int) -> None:
        self.b0, self.b1, self.b2, self.a1, self.a2 = coefficients
        self.x = np.zeros((k, coefficients.shape[1]))
        self.y = np.zeros_like(self.x)

    def __call__(self, u: np.ndarray) -> np.ndarray:
        out = self.b0 * u + self.x
        self.x = self.b1 * u - self.a1 * out + self.y
        self.y = self.b2 * u - self.a2 * out
        return out


def low_pass(frequency: float, order: int) -> np.ndarray:
    """Return b0, b1, b2, a1, a2 of a low-pass [Hz]; of 0 Hz: nothing is filtered."""
    if frequency <= 0.0:
        return np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    if order == 1:
        keep = np.exp(-2.0 * np.pi * frequency * STEP)
        return np.array([1.0 - keep, 0.0, 0.0, -keep, 0.0])
    k = np.tan(np.pi * frequency * STEP)
    norm = 1.0 + np.sqrt(2.0) * k + k * k
    b = k * k / norm
    return np.array([b, 2 * b, b, 2 * (k * k - 1) / norm, (1 - np.sqrt(2.0) * k + k * k) / norm])


def notch(frequency: float) -> np.ndarray:
    """Return b0, b1, b2, a1, a2 of a notch [Hz] of quality 2; of 0 Hz: nothing is filtered."""
    if not 0.0 < frequency < 0.45 / STEP:
        return low_pass(0.0, 1)
    w = 2.0 * np.pi * frequency * STEP
    alpha = np.sin(w) / 4.0
    b = np.array([1.0, -2.0 * np.cos(w), 1.0]) / (1.0 + alpha)
    return np.array([*b, b[1], (1.0 - alpha) / (1.0 + alpha)])


def spring(frequency: float, damping: float) -> np.ndarray:
    """Return b0, b1, b2, a1, a2 of what a mass on a damped spring feels of its base [Hz]."""
    if frequency <= 0.0:
        return low_pass(0.0, 1)
    k = np.tan(np.pi * frequency * STEP)
    norm = 1.0 + 2.0 * damping * k + k * k
    rise = 2.0 * damping * k
    b = np.array([rise + k * k, 2.0 * k * k, k * k - rise]) / norm
    return np.array([*b, 2.0 * (k * k - 1.0) / norm, (1.0 - rise + k * k) / norm])


def limit(values: np.ndarray, low: np.ndarray | float, high: np.ndarray | float) -> np.ndarray:
    """Return values between two limits; for a few numbers, quicker than NumPy's own."""
    return np.minimum(np.maximum(values, low), high)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a x b of vectors in rows 0, 1, 2."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def fly(worlds: Sequence[World]) -> list[Record]:
    """Fly some worlds, all at once."""
    return Batch(worlds).flown()


def _stacked(rows: Sequence[Any]) -> np.ndarray:
    """Stack the arrays or numbers of all worlds, the worlds last."""
    return np.stack([np.asarray(row, dtype=float) for row in rows], axis=-1)


def _padded(rows: np.ndarray) -> np.ndarray:
    return np.concatenate([rows, np.zeros((ROTORS - len(rows), *rows.shape[1:]))])


class Batch:
    """Constants and state of worlds that fly together."""

    def __init__(self, worlds: Sequence[World]) -> None:
        self.worlds, self.plans = worlds, [plan(world) for world in worlds]
        self.steps = max(len(p.sticks) for p in self.plans)
        self.own_steps = np.array([len(p.sticks) for p in self.plans])
        self._body()
        self._drive()
        self._control()
        self._sense()
        self._surround()
        self._begin()

    # Constants.

    def _body(self) -> None:
        vehicles = [w.vehicle for w in self.worlds]
        self.mass = _stacked([v.mass for v in vehicles])
        self.inertia = _stacked([v.inertia for v in vehicles])
        self.inverse = _stacked([np.linalg.inv(v.inertia) for v in vehicles])
        self.reach = _stacked([_padded(v.places - v.com) for v in vehicles])  # (8, 3, W)
        self.axes = _stacked([_padded(v.axes) for v in vehicles])
        self.kt = _stacked([_padded(v.kt) for v in vehicles])
        thrust = [np.hstack([v.axes, np.cross(v.places - v.com, v.axes)]) for v in vehicles]
        self.thrust = _stacked([_padded(a) for a in thrust])  # (8, 6, W): wrench of 1 N
        spun = [v.spins[:, None] * v.axes for v in vehicles]
        self.spun = _stacked([_padded(v.Jr * s) for v, s in zip(vehicles, spun, strict=True)])
        dragged = [v.kd[:, None] * s for v, s in zip(vehicles, spun, strict=True)]
        self.dragged = _stacked([_padded(-a) for a in dragged])
        self.lever = _stacked([w.sensors.imu - w.vehicle.com for w in self.worlds])

    def _drive(self) -> None:
        motors = [w.motors for w in self.worlds]
        half = -0.5 * STEP
        self.keep_up = _stacked([np.exp(half / m.lag_up) for m in motors])
        self.keep_down = _stacked([np.exp(half / m.lag_down) for m in motors])
        self.power = _stacked([2.0 if m.on_thrust else 1.0 for m in motors])
        self.full = _stacked([m.full for m in motors])
        self.idle = _stacked([m.idle for m in motors])
        self.sag = _stacked([m.sag for m in motors])
        self.sag_load = _stacked([m.sag_load for m in motors])
        self.charge = _stacked([m.charge for m in motors])
        self.delay = np.array([m.delay_ms for m in motors])
        self.hover = _stacked([w.vehicle.hover_speed for w in self.worlds])

    def _control(self) -> None:
        pilots = [w.autopilot for w in self.worlds]
        self.rate = _stacked([(a.rate, a.rate, a.yaw) for a in pilots])
        for name in ("integral", "attitude", "climb", "height", "accel"):
            setattr(self, name, _stacked([getattr(a, name) for a in pilots]))
        self.airmode = np.array([a.airmode for a in pilots])
        self.indi = _stacked([float(a.indi) for a in pilots])
        believed = [np.diag(w.vehicle.inertia) * w.autopilot.believed for w in self.worlds]
        self.believed = _stacked(believed)
        self.mean_kt = _stacked([w.vehicle.kt.mean() for w in self.worlds])
        self.mixing, self.unmixing = (
            _stacked(x) for x in zip(*map(_mixer, self.worlds), strict=True)
        )
        self.real = self.kt > 0.0
        self.trim = _stacked([_trim(w) for w in self.worlds])
        smooth = [low_pass(a.lowpass, a.order) for a in pilots]
        self.smooth = Biquads(_stacked(smooth), 6)
        self.smooth_torque = Biquads(_stacked(smooth), 3)
        self.cut = Biquads(_stacked([notch(a.notch) for a in pilots]), 3)

    def _sense(self) -> None:
        sensors = [w.sensors for w in self.worlds]
        springs = [spring(s.spring, s.spring_damping) for s in sensors]
        self.mount = Biquads(_stacked(springs), 6)
        shaken = [np.concatenate([_padded(one) for one in s.shaken]) for s in sensors]
        self.shaken = _stacked(shaken)  # (16, 6, W)
        self.shakes = bool(np.any(self.shaken))
        self.noise = self._series([p.noise for p in self.plans])
        self.heard = self._series([p.heard for p in self.plans])
        self.sticks = self._series([p.sticks for p in self.plans])

    def _surround(self) -> None:
        air = [w.air for w in self.worlds]
        self.gusts = self._series([p.gusts for p in self.plans])
        for name in ("drag", "drag_place", "inflow", "ground", "wall", "tether"):
            setattr(self, name, _stacked([getattr(a, name) for a in air]))
        self.drag_reach = self.drag_place - _stacked([w.vehicle.com for w in self.worlds])
        below = [np.array([0.0, 0.0, -0.3 * w.vehicle.arm]) for w in self.worlds]
        self.tether_reach = _stacked(below) - _stacked([w.vehicle.com for w in self.worlds])

    def _series(self, rows: Sequence[np.ndarray]) -> np.ndarray:
        """Stack series (n, k) of unlike length as (steps, k, W)."""
        out = np.zeros((self.steps, rows[0].shape[1], len(rows)), dtype=np.float32)
        for i, row in enumerate(rows):
            out[: len(row), :, i] = row
            out[len(row) :, :, i] = row[-1]
        return out

    # State.

    def _begin(self) -> None:
        W = len(self.worlds)
        rng = [w.chance(5) for w in self.worlds]
        self.thrown = np.array([w.flight.manoeuvre == "throw" for w in self.worlds])
        self.released = np.array([p.released for p in self.plans])
        self.landing = np.array([p.landing for p in self.plans])
        self.speed = np.where(self.released == 0, self.hover, 0.0) * self.real
        self.queue = np.tile(self.speed, (LONGEST, 1, 1))
        self.R = np.repeat(np.eye(3)[:, :, None], W, axis=2)
        self.w, self.v, self.turn_rate = (np.zeros((3, W)) for _ in range(3))
        self.z = np.where(self.thrown, 1.5, np.where(self.released == 0, 2.0, 0.0))
        self.thrown_at = _stacked([np.r_[r.normal(0, 2.5, 3), r.uniform(2.5, 4.5)] for r in rng])
        self.airborne = self.released == 0
        self.landed = np.zeros(W, dtype=bool)
        self.wanted_z = self.z.copy()
        self.error, self.sum_climb = np.zeros((3, W)), np.zeros(W)
        self.sums, self.before = np.zeros((3, W)), np.zeros((3, W))
        self.force = np.zeros((3, W))
        self.force[2] = GRAVITY
        self.phase = np.zeros((ROTORS, W))
        self.voltage = np.ones(W)

    def flown(self) -> list[Record]:
        """Fly every step."""
        n, W = self.steps, len(self.worlds)
        widths = {"gyro": 3, "accel": 3, "filtered": 3, "speed": ROTORS, "wanted": ROTORS,
                  "velocity": 3, "rates": 3, "rest": 4}  # fmt: skip
        kept = {name: np.empty((n, k, W), dtype=np.float32) for name, k in widths.items()}
        with np.errstate(all="ignore"):
            for k in range(n):
                row = self.step(k)
                for name, value in row.items():
                    kept[name][k] = value
        return [self._record(kept, i) for i in range(W)]

    def _record(self, kept: dict[str, np.ndarray], i: int) -> Record:
        n, rotors = len(self.plans[i].sticks), len(self.worlds[i].vehicle.spins)
        own = {name: series[:n, :, i].astype(float) for name, series in kept.items()}
        voltage, height, up, airborne = own.pop("rest").T
        for name in ("speed", "wanted"):
            own[name] = own[name][:, :rotors]
        return Record(**own, voltage=voltage, height=height, up=up, airborne=airborne)

    # A step.

    def step(self, k: int) -> dict[str, np.ndarray]:
        """Advance by a step; return what the record of it holds."""
        gyro, accel, filtered, accel_z = self._read(k)
        wanted = self._fly(k, filtered, accel_z, gyro)
        truth = {
            "speed": self.speed,
            "rates": self.w,
            "velocity": np.einsum("ijw,iw->jw", self.R, self.v),
            "rest": np.array([self.voltage, self.z, self.R[2, 2], self.airborne]),
        }
        self._move(k, wanted)
        return {"gyro": gyro, "filtered": filtered, "wanted": wanted, "accel": accel, **truth}

    def _read(self, k: int) -> tuple[np.ndarray, ...]:
        """Return gyro, accelerometer and filtered gyro at the beginning of a step."""
        felt = self.mount(np.concatenate([self.w, self.force]))
        self.added = self.noise[k]
        if self.shakes:
            share = (self.speed / self.hover) ** 2
            waves = np.concatenate([np.sin(self.phase), np.sin(2.0 * self.phase + 1.0)])
            waves[:ROTORS] *= share
            waves[ROTORS:] *= share
            self.added = self.added + np.einsum("rw,rkw->kw", waves, self.shaken)
        heard = felt + self.added
        smoothed = self.smooth(heard)
        return heard[:3], heard[3:], self.cut(smoothed[:3]), smoothed[5]

    def _fly(self, k: int, gyro: np.ndarray, accel_z: np.ndarray, raw: np.ndarray) -> np.ndarray:
        """Return the rotor speeds that the autopilots ask for."""
        sticks, heard, R = self.sticks[k], self.heard[k], self.R
        # The estimated attitude drifts by what the gyro says too much, and is pulled back.
        self.error += STEP * (raw - self.w - self.error / 3.0)
        ahead = R[:2, 0] / np.sqrt(R[0, 0] ** 2 + R[1, 0] ** 2 + 1e-9)
        pull = limit(-0.06 * self.v[:2], -0.3, 0.3)
        up = np.array(
            [
                ahead[0] * sticks[0] - ahead[1] * sticks[1] + pull[0],
                ahead[1] * sticks[0] + ahead[0] * sticks[1] + pull[1],
                np.ones(len(self.mass)),
            ]
        )
        up /= np.sqrt((up * up).sum(axis=0))
        lean = np.einsum("ijw,iw->jw", R, up)
        wanted = np.array(
            [
                self.attitude * (-lean[1] - self.error[0] - heard[0]),
                self.attitude * (lean[0] - self.error[1] - heard[1]),
                sticks[2],
            ]
        )
        wanted[:2] = limit(wanted[:2], -6.0, 6.0)
        return self._mixed(k, self._thrust(k, accel_z), self._torque(wanted - gyro, gyro))

    def _thrust(self, k: int, accel_z: np.ndarray) -> np.ndarray:
        """Return the thrust for height and climb [N]."""
        sinking = k >= self.landing
        climb = np.where(sinking, -0.6, self.sticks[k, 3])
        flying = self.airborne & ~sinking
        self.wanted_z = self.wanted_z + STEP * np.where(flying, self.sticks[k, 3], 0.0)
        rise = (k > self.released + 300) & ~self.airborne & ~self.landed & ~self.thrown
        target = np.where(rise, 1.5, self.wanted_z)
        self.wanted_z = np.where(rise, 1.5, self.wanted_z)
        slope = limit(self.height * (target - self.z - self.heard[k, 2]), -1.5, 1.5)
        miss = np.where(sinking, 0.0, slope) + climb - self.v[2] - self.heard[k, 3]
        self.sum_climb = limit(self.sum_climb + STEP * miss * self.airborne, -2.0, 2.0)
        lift = GRAVITY + limit(self.climb * (miss + 0.4 * self.sum_climb), -6.0, 6.0)
        share = lift / np.maximum(self.R[2, 2], 0.5)
        return self.mass * (share + self.accel * (share - accel_z) * self.airborne)

    def _torque(self, miss: np.ndarray, gyro: np.ndarray) -> np.ndarray:
        """Return the torques that the rate loops ask for [N m]."""
        self.sums = limit(self.sums + STEP * miss * self.airborne, -3.0, 3.0)
        fast = self.rate * miss
        applied = self.smooth_torque(
            np.einsum("rkw,rw->kw", self.mixing[:, 1:], self.mean_kt * self.speed**2)
        )
        change = (gyro - self.before) / STEP
        self.before = gyro
        by_pid = fast + self.rate * self.integral * self.sums + self.trim / self.believed
        by_steps = applied / self.believed + fast - change
        by_steps[2] = by_pid[2]  # a rotor's inertia turns the body at once: not a step of its drag
        return self.believed * np.where(self.indi > 0.0, by_steps, by_pid) * self.airborne

    def _mixed(self, k: int, thrust: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Return rotor speeds for a thrust and torques, within the motors' limits."""
        share = np.einsum("rkw,kw->rw", self.unmixing, np.concatenate([thrust[None], torque]))
        low, high = self.mean_kt * self.idle**2, self.mean_kt * self.full**2
        least = np.where(self.real, share, np.inf).min(axis=0)
        most = np.where(self.real, share, -np.inf).max(axis=0)
        share = share + self.airmode * np.maximum(low - least, 0.0)
        share = share - self.airmode * np.maximum(most - high, 0.0)
        speed = np.sqrt(limit(share, low, high) / self.mean_kt)
        stopped = (k < self.released - 700) | self.landed | (self.thrown & (k < self.released))
        waits = k < self.released + 350 * self.thrown
        speed = np.where(waits, self.idle, speed)
        return np.where(stopped, 0.0, speed) * self.real

    def _move(self, k: int, wanted: np.ndarray) -> None:
        """Advance motors and bodies by a step."""
        self._let_go(k)
        middle, after = self._speeds(k, wanted)
        w = self.w + 0.5 * STEP * self.turn_rate
        force, torque = self._wrench(k, middle, w)
        spin = np.einsum("rkw,rw->kw", self.spun, middle)
        spun_up = np.einsum("rkw,rw->kw", self.spun, (after - self.speed) / STEP)
        momentum = np.einsum("ijw,jw->iw", self.inertia, w) + spin
        turn_rate = np.einsum("ijw,jw->iw", self.inverse, torque - spun_up - cross(w, momentum))
        self._land(k, force)
        flying = self.airborne
        rest = self.R[2] * GRAVITY
        self.turn_rate = turn_rate * flying
        self.force = np.where(flying, force / self.mass, rest)
        self.w = (self.w + STEP * self.turn_rate) * flying
        K = STEP * self._skew(w * flying)
        half = self.R + 0.5 * np.einsum("ijw,jkw->ikw", self.R, K)
        pull = np.einsum("ijw,jw->iw", half, self.force)
        pull[2] -= GRAVITY
        v = (self.v + STEP * pull) * flying
        self.z = self.z + 0.5 * STEP * (self.v[2] + v[2])
        self.v = v
        self.R = self.R + np.einsum("ijw,jkw->ikw", half, K)
        if k % 64 == 0:
            square = np.einsum("jiw,jkw->ikw", self.R, self.R)
            self.R = 1.5 * self.R - 0.5 * np.einsum("ijw,jkw->ikw", self.R, square)
        self.speed = after
        if self.shakes:
            self.phase = (self.phase + STEP * middle) % (2.0 * np.pi)
        lever = cross(self.turn_rate, self.lever) + cross(w, cross(w, self.lever)) * flying
        self.force = self.force + lever

    def _speeds(self, k: int, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rotor speeds in the middle and at the end of a step [rad/s]."""
        self.queue[k % LONGEST] = wanted
        told = self.queue[(k - self.delay) % LONGEST, :, np.arange(len(self.delay))].T
        load = (self.speed**2).sum(axis=0) / (self.real.sum(axis=0) * self.hover**2)
        sagged = self.sag * k / self.own_steps + self.sag_load * np.minimum(load, 4.0)
        self.voltage = self.charge - sagged
        target = (told * self.voltage) ** self.power
        now = self.speed**self.power
        keep = np.where(target > now, self.keep_up, self.keep_down)
        halfway = target + keep * (now - target)
        end = target + keep * (halfway - target)
        return halfway ** (1.0 / self.power), end ** (1.0 / self.power)

    def _wrench(self, k: int, speed: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return force and torque about the centre of mass, body axes [N, N m]."""
        v = np.einsum("ijw,iw->jw", self.R, self.v)
        square = speed * speed
        along = v[2] + w[0] * self.reach[:, 1] - w[1] * self.reach[:, 0]
        near = 1.0 + self.ground * (0.5 - 0.5 * np.tanh((k - 0.5 * self.own_steps) * 1e-3))
        lift = self.kt * square * near - self.inflow * speed * along
        wrench = np.einsum("rkw,rw->kw", self.thrust, lift)
        air = -self.drag * (v + cross(w, self.drag_reach))
        close = (k > 0.4 * self.own_steps) * (k < 0.7 * self.own_steps)
        hangs = -self.R[2] * self.tether * np.maximum(self.z, 0.0)
        force = wrench[:3] + air + self.gusts[k, :3] + self.wall[:3] * close + hangs
        torque = wrench[3:] + np.einsum("rkw,rw->kw", self.dragged, square)
        torque = torque + cross(self.drag_reach, air) + cross(self.tether_reach, hangs)
        return force, torque + self.gusts[k, 3:] + self.wall[3:] * close

    def _let_go(self, k: int) -> None:
        """Throw what is thrown now."""
        now = self.thrown & (k == self.released)
        if now.any():
            self.w = np.where(now, self.thrown_at[:3], self.w)
            self.v = np.where(now, 0.0, self.v)
            self.v[2] = np.where(now, self.thrown_at[3], self.v[2])
            self.airborne = self.airborne | now
            self.wanted_z = np.where(now, 2.0, self.wanted_z)

    def _land(self, k: int, force: np.ndarray) -> None:
        """See which worlds leave the ground or come back to it."""
        lifts = (force[2] > self.mass * GRAVITY) & (k >= self.released) & ~self.landed
        self.airborne = self.airborne | (lifts & ~self.thrown)
        down = self.airborne & (k >= self.landing) & (self.z <= 0.02)
        self.landed = self.landed | down
        self.airborne = self.airborne & ~self.landed

    @staticmethod
    def _skew(w: np.ndarray) -> np.ndarray:
        zero = np.zeros_like(w[0])
        return np.array(
            [
                np.array([zero, -w[2], w[1]]),
                np.array([w[2], zero, -w[0]]),
                np.array([-w[1], w[0], zero]),
            ]
        )


def _trim(world: World) -> np.ndarray:
    """Return the torque that the vehicle needs in hover, nearly as earlier flights have shown."""
    v = world.vehicle
    square = v.hover_speed**2
    torque = np.cross(v.places - v.com, v.axes) * v.kt[:, None]
    torque -= (v.spins * v.kd)[:, None] * v.axes
    return -square * torque.sum(axis=0) * world.chance(7).uniform(0.8, 1.2)


def _mixer(world: World) -> tuple[np.ndarray, np.ndarray]:
    """Return what the autopilot believes: wrench of each rotor's thrust (8, 4), its inverse."""
    v = world.vehicle
    arm = float(v.kd.mean() / v.kt.mean())
    wrench = np.column_stack(
        [np.ones(len(v.spins)), v.places[:, 1], -v.places[:, 0], -arm * v.spins]
    )
    return _padded(wrench), _padded(np.linalg.pinv(wrench.T))
