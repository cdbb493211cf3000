"""A world: all that is drawn, before anything flies."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from benchmarks.worlds.hazards import HAZARDS
from jaxtyping import Float
from scipy.spatial.transform import Rotation

GRAVITY: Final = 9.80665
AIR: Final = 1.2
LAYOUTS: Final = {
    "square": 0.28, "rectangle": 0.22, "plus": 0.1, "hexa": 0.22, "octo": 0.09, "coaxial": 0.09,
}  # fmt: skip
MANOEUVRES: Final = {
    "throw": 0.12, "hover": 0.12, "calm": 0.25, "lively": 0.3, "sweep": 0.13, "one-axis": 0.08,
}  # fmt: skip
RATES: Final = {100: 0.15, 125: 0.1, 200: 0.25, 250: 0.2, 500: 0.2, 1000: 0.1}


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """Body axes FLU, from the middle of the rotors, SI; `inertia` is about the centre of mass."""

    layout: str
    mass: float
    places: Float[np.ndarray, "N 3"]
    axes: Float[np.ndarray, "N 3"]
    spins: Float[np.ndarray, " N"]
    radius: float
    com: Float[np.ndarray, " 3"]
    inertia: Float[np.ndarray, "3 3"]
    kt: Float[np.ndarray, " N"]
    kd: Float[np.ndarray, " N"]
    Jr: float

    @property
    def arm(self) -> float:
        """Mean distance of the rotors from their middle [m]."""
        return float(np.hypot(self.places[:, 0], self.places[:, 1]).mean())

    @property
    def hover_speed(self) -> float:
        """[rad/s]."""
        return float(np.sqrt(self.mass * GRAVITY / self.kt.sum()))


@dataclass(frozen=True, slots=True, kw_only=True)
class Motors:
    """Lags [s], delay [ms], speeds [rad/s]; speed = full (offset + (1 - offset) u)^exponent.

    `charge`: voltage at the beginning of the flight, as a share of the full one.
    """

    lag_up: float
    lag_down: float
    on_thrust: bool
    delay_ms: int
    full: float
    idle: float
    offset: float
    exponent: float
    sag: float
    sag_load: float
    charge: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Autopilot:
    """Loops [1/s], filters [Hz] (0: none), and what they hear."""

    rate: float
    yaw: float
    integral: float
    attitude: float
    climb: float
    height: float
    accel: float
    lowpass: float
    order: int
    notch: float
    airmode: bool
    indi: bool
    believed: Float[np.ndarray, " 3"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensors:
    """Six-vectors are gyro [rad/s], then accelerometer [m/s^2]."""

    imu: Float[np.ndarray, " 3"]
    white: Float[np.ndarray, " 6"]
    coloured: Float[np.ndarray, " 6"]
    colour: float
    bias: Float[np.ndarray, " 6"]
    scale: Float[np.ndarray, " 6"]
    turn: Float[np.ndarray, "3 3"]
    shaken: Float[np.ndarray, "2 N 6"]
    spring: float
    spring_damping: float
    velocity_std: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Air:
    """Gusts as wrench [N, N m] about the centre of mass, drag [N s/m] at `drag_place`."""

    gust: Float[np.ndarray, " 6"]
    gust_seconds: float
    drag: Float[np.ndarray, " 3"]
    drag_place: Float[np.ndarray, " 3"]
    inflow: float
    ground: float
    wall: Float[np.ndarray, " 6"]
    tether: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """What is flown, for how long [s], from the ground (or in the air) and back (or not)."""

    manoeuvre: str
    axis: int
    seconds: float
    ground_start: bool
    lands: bool
    vigour: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Log:
    """What is recorded and how, and how it is declared; steps of gyro, accel, speed, command.

    `axes_declared`, `lag_declared`, `delay_declared` [s] and `tilt_declared` [degrees] are what the
    experiment file says besides, where the estimator is told of a hazard.
    """

    rate: int
    has: tuple[str, ...]
    driven: str
    law: str
    late_ms: float
    filtered_gyro: bool
    accel_lowpass: float
    steps: tuple[float, float, float, float]
    speed_noise: float
    lost: float
    telemetry: str
    imu_declared: bool
    mass_scale: float
    arm_scale: float
    clock_scale: float
    mislaid: tuple[str, ...]
    law_error: float
    axes_declared: bool = False
    lag_declared: bool = False
    delay_declared: float | None = None
    tilt_declared: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """One world, by its seed and number, with the hazards that it has."""

    seed: int
    index: int
    hazards: frozenset[str]
    vehicle: Vehicle
    motors: Motors
    autopilot: Autopilot
    sensors: Sensors
    air: Air
    flight: Flight
    log: Log

    def chance(self, purpose: int) -> np.random.Generator:
        """Return the random numbers of one purpose: the same in any batch."""
        return np.random.default_rng([self.seed, self.index, purpose])


@dataclass(frozen=True, slots=True)
class Draws:
    """Random numbers; what belongs to a hazard is drawn in any case, and kept if it is there."""

    rng: np.random.Generator
    hazards: frozenset[str]

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def log_between(self, low: float, high: float) -> float:
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def either(self, low: float, high: float, size: int | tuple[int, ...]) -> np.ndarray:
        """Return numbers of this size with either sign."""
        return self.rng.uniform(low, high, size) * self.rng.choice([-1.0, 1.0], size)

    def one_of(self, shares: Mapping[Any, float]) -> Any:
        total = sum(shares.values())
        return list(shares)[
            int(self.rng.choice(len(shares), p=[p / total for p in shares.values()]))
        ]

    def chance(self, p: float) -> bool:
        return bool(self.rng.random() < p)

    def has(self, hazard: str) -> bool:
        return hazard in self.hazards

    def under(self, hazard: str, value: Any, otherwise: Any) -> Any:
        return value if hazard in self.hazards else otherwise


def draw_world(
    seed: int, index: int, chance: Mapping[str, float], seconds: float | None = None
) -> World:
    """Draw a world; `seconds` overrides the length of its flight."""
    streams = iter(np.random.default_rng([seed, index]).spawn(8))
    lots = next(streams).random(len(HAZARDS))
    hazards = frozenset(
        h.name for h, lot in zip(HAZARDS, lots, strict=True) if lot < chance.get(h.name, 0.0)
    )
    d: Iterator[Draws] = (Draws(stream, hazards) for stream in streams)
    vehicle = _vehicle(next(d))
    motors = _motors(next(d), vehicle)
    autopilot = _autopilot(next(d), vehicle, motors)
    return World(
        seed=seed,
        index=index,
        hazards=hazards,
        vehicle=vehicle,
        motors=motors,
        autopilot=autopilot,
        sensors=(sensors := _sensors(next(d), vehicle)),
        air=_air(next(d), vehicle),
        flight=_flight(next(d), vehicle.mass, seconds),
        log=_log(next(d), vehicle, motors, sensors),
    )


def _frame(d: Draws, layout: str, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Return places and spins of rotors whose neighbours are `size` apart [m]."""
    ratio = d.log_between(0.7, 1.4)
    if layout in ("square", "rectangle", "plus", "coaxial"):
        x, y = (1.0, 1.0) if layout != "rectangle" else (ratio**0.5, ratio**-0.5)
        places = 0.5 * size * np.array([[x, -y, 0], [-x, -y, 0], [-x, y, 0], [x, y, 0]])
        spins = np.array([1.0, -1.0, 1.0, -1.0])
        if layout == "plus":
            places = Rotation.from_euler("z", 45, degrees=True).apply(places)
        if layout == "coaxial":
            apart = np.array([0.0, 0.0, 0.1 * size])
            places, spins = np.vstack([places + apart, places - apart]), np.r_[spins, -spins]
    else:
        n = 6 if layout == "hexa" else 8
        start = d.one_of({0.0: 1.0, 0.5: 1.0})
        angles = 2.0 * np.pi / n * (np.arange(n) + start)
        reach = size / (2.0 * np.sin(np.pi / n))
        places = reach * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n)])
        spins = np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    return places, spins * (1.0 if d.chance(0.5) else -1.0)


def _vehicle(d: Draws) -> Vehicle:
    layout = d.one_of(LAYOUTS)
    mass = d.log_between(0.03, 25.0)
    size = 0.235 * mass**0.4 * d.between(0.85, 1.2)
    if layout in ("hexa", "octo", "coaxial"):
        size *= 0.85
    places, spins = _frame(d, layout, size)
    n = len(spins)
    apart = np.linalg.norm(places[:, None, :2] - places[None, :, :2], axis=2)
    radius = 0.5 * float(apart[apart > 1e-6].min()) * d.between(0.78, 0.95)
    thrust = d.between(0.010, 0.016)
    kt = thrust * AIR * np.pi * radius**4
    merit = d.between(0.42, 0.56)
    kd = thrust**1.5 / (np.sqrt(2.0) * merit) * AIR * np.pi * radius**5
    arm = float(np.hypot(places[:, 0], places[:, 1]).mean())
    axes = _tilted(d, n)
    com = arm * d.either(0.003, 0.02, 3)
    com = com + d.under("off_centre", arm * d.either(0.03, 0.10, 3) * [0.7, 0.7, 1.0], 0.0)
    inertia = _inertia(d, mass, arm)
    apart_kt, apart_kd = d.rng.normal(size=(2, n)) * d.between(0.01, 0.03)
    worn = np.ones(n)
    worn[d.rng.integers(n)] = 1.0 - d.between(0.10, 0.25)
    even = np.ones(n)
    kts = kt * d.under("unlike_rotors", 1.0 + apart_kt, even)
    kts = kts * d.under("changed_rotor", worn, even)
    Jr = float(inertia[2, 2]) * d.log_between(3e-4, 2e-3)
    return Vehicle(
        layout=layout, mass=mass, places=places, axes=axes, spins=spins, radius=radius, com=com,
        inertia=inertia, kt=kts, kd=kd * d.under("unlike_rotors", 1.0 + apart_kd, even),
        Jr=Jr if d.chance(0.7) else 0.0,
    )  # fmt: skip


def _tilted(d: Draws, n: int) -> np.ndarray:
    lean = np.radians(d.between(0.3, 1.5)) * d.rng.normal(size=(n, 2))
    upright = np.tile([0.0, 0.0, 1.0], (n, 1))
    axes = upright + np.column_stack([lean, np.zeros(n)])
    axes = axes / np.linalg.norm(axes, axis=1)[:, None]
    return d.under("tilted_motors", axes, upright)


def _inertia(d: Draws, mass: float, arm: float) -> np.ndarray:
    """Return an inertia of usual size about the centre of mass [kg m^2]."""
    xx = mass * arm**2 * d.between(0.17, 0.30)
    yy = xx * d.log_between(0.75, 1.35)
    zz = (xx + yy) * d.between(0.75, 0.95)
    small = d.rng.normal(size=3) * np.radians(1.0)
    large = np.radians(d.either(3.0, 8.0, 3))
    turn = Rotation.from_rotvec(small + d.under("products", large, np.zeros(3))).as_matrix()
    return turn @ np.diag([xx, yy, zz]) @ turn.T


def _motors(d: Draws, vehicle: Vehicle) -> Motors:
    lag = 0.03 * (vehicle.radius / 0.1) ** 0.4 * d.log_between(0.6, 1.6)
    ratio = d.between(1.2, 2.0)
    power = d.between(1.9, 4.0)
    weak = d.between(1.25, 1.5)
    hover = vehicle.hover_speed
    motors = Motors(
        lag_up=lag,
        lag_down=lag * d.under("lag_unlike", ratio, 1.0),
        on_thrust=d.has("lag_on_thrust"),
        delay_ms=d.under("command_delay", int(d.rng.integers(2, 13)), 0),
        full=hover * d.under("weak_motors", weak, power) ** 0.5,
        idle=hover * d.under("weak_motors", 0.7, 0.25),
        offset=d.one_of({0.0: 0.6, d.between(0.02, 0.1): 0.4}),
        exponent=d.one_of({1.0: 0.4, 0.5: 0.2, d.between(0.55, 0.95): 0.4}),
        sag=d.under("sag", d.between(0.05, 0.15), 0.0),
        sag_load=d.under("sag", d.between(0.0, 0.06), 0.0),
    )
    # No command asks for less than its speed at nothing.
    least = motors.full * motors.offset**motors.exponent if motors.offset else 0.0
    return replace(motors, idle=max(motors.idle, least))


def _autopilot(d: Draws, vehicle: Vehicle, motors: Motors) -> Autopilot:
    order = d.one_of({1: 0.5, 2: 0.5})
    lowpass = d.log_between(45.0, 150.0)
    slow = d.between(20.0, 40.0)
    lowpass, order = d.under("slow_filter", (slow, 2), (lowpass, order))
    spring = 15.0  # of the slowest mount
    late = (
        0.5 * (motors.lag_up + motors.lag_down)
        + 1e-3 * motors.delay_ms
        + order * 0.7 / (2 * np.pi * lowpass)
        + d.under("soft_mount", 0.5 / spring, 0.0)
    )
    share = d.log_between(0.2, 0.8)  # gains over a factor of four
    rate = share / late
    if d.has("limit_cycle"):
        rate = d.between(1.8, 2.4) / late
    rate = rate * d.under("indi", 0.8, 1.0)
    # A rotor that speeds up turns the body by its inertia, sooner and more than by its drag.
    sooner = vehicle.Jr / (2.0 * vehicle.kd.mean() * vehicle.hover_speed * motors.lag_up)
    yaw = rate * d.between(0.25, 0.6) / (1.0 + 0.5 * sooner)
    return Autopilot(
        rate=rate,
        yaw=yaw,
        integral=rate * d.between(0.1, 0.25),
        attitude=min(rate, 0.8 / late) * d.between(0.2, 0.35),
        climb=d.between(1.2, 3.0),
        height=d.between(0.5, 1.0),
        accel=d.under("accel_hold", d.between(0.2, 0.7), 0.0),
        lowpass=lowpass,
        order=order,
        notch=d.under("notch", vehicle.hover_speed / (2.0 * np.pi), 0.0),
        airmode=d.has("airmode"),
        indi=d.has("indi"),
        believed=d.rng.uniform(0.8, 1.25, 3),
    )


def _sensors(d: Draws, vehicle: Vehicle) -> Sensors:
    n, arm = len(vehicle.spins), vehicle.arm
    imu = arm * d.rng.uniform(-0.2, 0.2, 3) * [1.0, 1.0, 0.7]
    imu = imu if d.chance(0.6) else np.zeros(3)
    quiet = np.r_[[d.log_between(0.002, 0.01)] * 3, [d.log_between(0.03, 0.15)] * 3]
    louder = d.between(3.0, 8.0)
    coloured = quiet * d.between(1.0, 4.0)
    bias = np.r_[d.rng.uniform(-0.05, 0.05, 3), d.either(0.05, 0.4, 3)]
    kept = [d.has("gyro_bias")] * 3 + [d.has("accel_bias")] * 3
    scale = np.r_[d.either(0.02, 0.05, 3), np.full(3, d.either(0.003, 0.015, 1)[0])]
    scaled = [d.has("gyro_scale")] * 3 + [d.has("accel_scale")] * 3
    mounted = np.radians(d.either(0.3, 1.2, 3))
    lean = np.radians(d.either(5.0, 12.0, 1)[0]) * np.eye(3)[d.rng.integers(2)]
    turned = np.radians(d.either(10.0, 30.0, 1)[0]) * np.eye(3)[2]
    vector = np.zeros(3)
    for hazard, turn in (("misaligned", mounted), ("tilted_imu", lean), ("turned_imu", turned)):
        vector = vector + d.under(hazard, turn, 0.0)
    size = np.r_[[d.log_between(0.01, 0.15)] * 3, [d.log_between(0.3, 4.0)] * 3]
    shaken = size * d.rng.normal(size=(2, n, 6)) * np.array([1.0, 0.3])[:, None, None] / n**0.5
    return Sensors(
        imu=imu,
        white=quiet * d.under("noise", louder, 1.0),
        coloured=d.under("coloured_noise", coloured, np.zeros(6)),
        colour=d.log_between(2.0, 15.0),
        bias=np.where(kept, bias, 0.0),
        scale=1.0 + np.where(scaled, scale, 0.0),
        turn=Rotation.from_rotvec(vector).as_matrix(),
        shaken=d.under("vibration", shaken, np.zeros((2, n, 6))),
        spring=d.under("soft_mount", d.log_between(15.0, 60.0), 0.0),
        spring_damping=d.between(0.2, 0.5),
        velocity_std=d.between(0.02, 0.1),
    )


def _air(d: Draws, vehicle: Vehicle) -> Air:
    weight, arm = vehicle.mass * GRAVITY, vehicle.arm
    force = weight * d.log_between(0.004, 0.03)
    torque = weight * arm * d.log_between(0.001, 0.008)
    gust = np.r_[force, force, force, torque, torque, 0.3 * torque]
    drag = vehicle.mass * d.between(0.05, 0.4) * d.rng.uniform(0.7, 1.3, 3)
    place = arm * d.rng.uniform(-0.15, 0.15, 3)
    hover = weight / len(vehicle.spins)
    inflow = d.between(0.02, 0.06) * hover / vehicle.hover_speed
    push = np.r_[d.either(0.0, 0.02, 3) * weight, d.either(0.0, 0.01, 3) * weight * arm]
    return Air(
        gust=d.under("gusts", gust, np.zeros(6)),
        gust_seconds=d.log_between(0.1, 1.0),
        drag=d.under("drag", drag, np.zeros(3)),
        drag_place=d.under("drag", place, np.zeros(3)),
        inflow=d.under("inflow", inflow, 0.0),
        ground=d.under("ground_effect", d.between(0.03, 0.10), 0.0),
        wall=d.under("wall", push, np.zeros(6)),
        tether=d.under("tether", weight * d.between(0.01, 0.04), 0.0),
    )


def _flight(d: Draws, mass: float, seconds: float | None) -> Flight:
    manoeuvre = d.one_of(MANOEUVRES)
    if manoeuvre == "throw" and mass > 2.0:
        manoeuvre = "lively"
    return Flight(
        manoeuvre=manoeuvre,
        axis=int(d.rng.integers(4)),
        seconds=seconds if seconds is not None else d.between(25.0, 40.0),
        ground_start=d.chance(0.85) or manoeuvre == "throw",
        lands=d.chance(0.6),
        vigour=d.between(0.7, 1.3),
    )


def _log(d: Draws, vehicle: Vehicle, motors: Motors, sensors: Sensors) -> Log:
    driven = d.one_of({"measured": 0.6, "commanded": 0.4})
    has = ["gyro", "accel", "rotor" if driven == "measured" else "command"]
    if driven == "measured" and d.chance(0.4):
        has.append("command")
    for channel, share in (("vel", 0.35), ("battery", 0.5)):
        if d.chance(share):
            has.append(channel)
    rate = d.one_of(RATES)
    late = d.either(2.0, 15.0, 1)[0]
    coarse = (0.004, 0.05, 0.01 * vehicle.hover_speed, 0.004)
    fine = (0.001, 0.005, d.one_of({1e-3: 0.5, 1.0: 0.5}), 1e-4)
    telemetry = [t for t in ("10hz", "lowpass") if d.has(f"telemetry_{t}")]
    wrong = ("wrong_spins", "wrong_order", "wrong_sides")
    return Log(
        rate=d.under("low_rate", 50, rate),
        has=tuple(has),
        driven=driven,
        law="none" if d.has("no_law") else "given",
        late_ms=d.under("imu_clock", float(late), 0.0),
        filtered_gyro=d.has("filtered_gyro"),
        accel_lowpass=d.under("filtered_accel", d.log_between(10.0, 40.0), 0.0),
        steps=d.under("quantised", coarse, fine),
        speed_noise=vehicle.hover_speed * d.log_between(3e-4, 5e-3),
        lost=d.under("dropouts", d.log_between(0.002, 0.02), 0.0),
        telemetry=telemetry[0] if telemetry else "",
        imu_declared=d.chance(0.85) or bool(np.any(sensors.imu) and d.chance(0.5)),
        mass_scale=d.under("mass_scale", 1.0 + d.either(0.03, 0.10, 1)[0], 1.0),
        arm_scale=d.under("arm_scale", 1.0 + d.either(0.02, 0.05, 1)[0], 1.0),
        clock_scale=d.under("clock_scale", 1.0 + d.either(0.01, 0.05, 1)[0], 1.0),
        mislaid=tuple(name for name in wrong if d.has(name)),
        law_error=d.under("law_wrong", _law_error(d.between(0.15, 0.25), motors), 0.0),
    )


def _law_error(size: float, motors: Motors) -> float:
    """Return by how much a law's exponent is declared wrong; it stays between nought and one."""
    return -size if motors.exponent > 0.7 else size
