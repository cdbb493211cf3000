"""FlightLog to FlightData, top to bottom: one clock, despiked, airborne, differentiated."""

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from rotorfit.errors import FlightError, FrameError, LogError
from rotorfit.flight.airborne import (
    GRAVITY,
    SHORTEST_FLIGHT,
    Motion,
    airborne_rows,
    phase_edges,
    rest_rows,
)
from rotorfit.flight.clocks import UniformChannels, uniform_channels
from rotorfit.flight.data import FlightData, Segment
from rotorfit.flight.log import FlightLog
from rotorfit.flight.motors import first_order_lag, shift_time, speed_from_command
from rotorfit.flight.signals import central_difference, hampel

FASTEST_TURN = 60.0
"""No gyro of a multirotor reads more [rad/s]: a larger number is in another unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorModel:
    """How the log's motor channel becomes rotor speed.

    Attributes
    ----------
    speed
        ``"measured"``: the log's rotor speed. ``"commanded"``: its command, through `law`, `lag`
        and `delay`.
    law
        Coefficients of speed over command, lowest power first [rad/s]; None where unknown: then
        the command itself stands for the speed, and coefficients are per squared command.
    lag
        First-order time constant [s].
    delay
        How much later than the rest of the log the motor channel takes effect [s]; negative where
        it was recorded late. None: found from the data where speed is measured, else zero.
    """

    speed: Literal["measured", "commanded"] = "measured"
    law: tuple[float, ...] | None = None
    lag: float = 0.0
    delay: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """A stretch of the log that is not used, and why."""

    start: float
    end: float
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparedFlight:
    """A flight ready for the model, and what was done to it.

    Attributes
    ----------
    data
        The flight; its segments are the airborne stretches.
    phases
        The same stretches, cut where the flight's character changes.
    motor_channel
        Speed before lag and delay, on the uniform clock, from which both can be tried anew.
    gyro_bias
        Taken off the rates [rad/s]; None where no rest was found and it was left in.
    spikes
        Samples replaced, by channel.
    slowest_rate
        Of the channels used [Hz].
    cuts
        What is not used, in the order of time; seconds of the log's own clock.
    warnings
        Doubts, one sentence each.
    """

    data: FlightData
    phases: tuple[Segment, ...]
    motor_channel: Float[np.ndarray, "n N"]
    gyro_bias: tuple[float, float, float] | None
    spikes: dict[str, int]
    slowest_rate: float
    cuts: tuple[Cut, ...]
    warnings: tuple[str, ...]


def prepare(
    log: FlightLog,
    *,
    rotor_count: int,
    arm: float,
    motors: MotorModel | None = None,
    window: tuple[float | None, float | None] = (None, None),
) -> PreparedFlight:
    """Return the airborne part of a log on one clock, in SI units and FLU body axes.

    Parameters
    ----------
    log
        As its reader gave it.
    rotor_count
        How many motor columns the airframe expects.
    arm
        Distance of the rotors from their centre [m]; only a scale for telling flight from ground.
    motors
        How the motor channel becomes rotor speed; measured, without delay, by default.
    window
        Start and end of the flight in seconds since the log's first sample. Either one replaces
        the search for the airborne part.

    Raises
    ------
    LogError
        If a channel is missing or has the wrong number of columns.
    FlightError
        If no usable flight is in it.
    FrameError
        If gravity contradicts the axes.
    """
    motors = motors or MotorModel()
    uniform = _uniform(log, rotor_count, motors)
    _refuse_dead_channels(log, uniform)
    spikes, clean = _despiked(uniform, motors)
    speed = clean["motor"]
    if motors.speed == "commanded" and motors.law is not None:
        speed = speed_from_command(speed, motors.law)
    data = _differentiated(uniform, clean, speed, log)
    data = with_motors(data, speed, lag=motors.lag, delay=motors.delay or 0.0)
    motion = Motion(
        sample_rate=data.sample_rate,
        specific_force=data.specific_force,
        angular_velocity=data.angular_velocity,
        thrust=np.einsum("nr,nr->n", data.rotor_speed, data.rotor_speed),
        arm=arm,
    )
    flights = _flights(motion, uniform, window)
    _refuse_wrong_gravity(data, flights)
    rest = rest_rows(motion, flights)
    bias = _gyro_bias(data, rest)
    if bias is not None:
        data = dataclasses.replace(data, angular_velocity=data.angular_velocity - bias)
    segments = _inner_segments(flights, uniform)
    data = dataclasses.replace(data, segments=segments)
    return PreparedFlight(
        data=data,
        phases=_phases(data),
        motor_channel=speed,
        gyro_bias=None if bias is None else (float(bias[0]), float(bias[1]), float(bias[2])),
        spikes=spikes,
        slowest_rate=min(uniform.rates.values()),
        cuts=_cuts(data, uniform, window),
        warnings=_warnings(data, uniform, bias),
    )


def with_motors(
    data: FlightData, speed: Float[np.ndarray, "n N"], *, lag: float, delay: float
) -> FlightData:
    """Return the flight with its rotor columns made anew from the motor channel.

    Lag and delay change nothing else: a trial of either costs only these columns.
    """
    settled = shift_time(speed, data.sample_rate, delay)
    turned = first_order_lag(settled, data.sample_rate, lag)
    return dataclasses.replace(
        data,
        rotor_speed=turned,
        rotor_acceleration=central_difference(turned, data.sample_rate),
    )


def _uniform(log: FlightLog, rotor_count: int, motors: MotorModel) -> UniformChannels:
    """Return the channels that are needed, on the gyro's clock made uniform."""
    motor_name = "rotor_speed" if motors.speed == "measured" else "command"
    _refuse_missing(log, motor_name)
    columns = log.channels[motor_name].values.shape[1]
    if columns != rotor_count:
        raise LogError(
            f"the log has {columns} motors ({log.channels[motor_name].source}) but the airframe "
            f"{rotor_count} rotors; list as many rotors as the log has motors, in its order"
        )
    wanted = {"gyro": "gyro", "accel": "accel", "motor": motor_name}
    if "velocity" in log.channels:
        wanted["velocity"] = "velocity"
    return uniform_channels({k: log.channels[name] for k, name in wanted.items()}, clock="gyro")


def _refuse_missing(log: FlightLog, motor_name: str) -> None:
    """Raise where a channel that the model needs is not in the log."""
    has = ", ".join(log.channels) or "none"
    for name, what in (("gyro", "rotation rates"), ("accel", "specific force")):
        if name not in log.channels:
            raise LogError(
                f"the log has no {what} (channel {name}; it has {has}); log the raw IMU, "
                "or name its columns with a columns map"
            )
    if motor_name in log.channels:
        return
    other = "command" if motor_name == "rotor_speed" else "rotor_speed"
    if other in log.channels:
        use = "commanded" if other == "command" else "measured"
        raise LogError(
            f"the log has no {motor_name} channel but it has {other} "
            f'({log.channels[other].source}); write speed = "{use}" under [motors]'
        )
    raise LogError(
        f"the log has no motor data (neither rotor_speed nor command; it has {has}); log ESC "
        "telemetry or motor outputs: without them only the motion is known, not what caused it"
    )


def _refuse_dead_channels(log: FlightLog, uniform: UniformChannels) -> None:
    """Raise where a sensor never moves or reads what no vehicle can do."""
    for name in ("gyro", "accel"):
        values = uniform.values[name]
        if float(np.ptp(values, axis=0).max()) == 0.0:
            first = ", ".join(f"{v:g}" for v in values[0])
            raise FlightError(
                f"the {name} channel is constant ({first}) over the whole log; "
                f"check its source: {log.channels[name].source}"
            )
    fastest = float(np.percentile(np.abs(uniform.values["gyro"]), 99))
    if fastest > FASTEST_TURN:
        raise FlightError(
            f"the gyro reads up to {fastest:.0f} rad/s, which no vehicle turns; it looks like "
            'deg/s: declare its unit (columns = { gyro_x = { name = "...", unit = "deg/s" } })'
        )


def _despiked(
    uniform: UniformChannels, motors: MotorModel
) -> tuple[dict[str, int], dict[str, Float[np.ndarray, "n k"]]]:
    """Return how many samples were replaced in each channel, and the clean channels."""
    counts: dict[str, int] = {}
    clean: dict[str, Float[np.ndarray, "n k"]] = dict(uniform.values)
    # A command that jumps is a command; a measured speed that jumps and returns is a glitch.
    noisy = ("gyro", "accel", "motor") if motors.speed == "measured" else ("gyro", "accel")
    for name in noisy:
        clean[name], spikes = hampel(uniform.values[name])
        counts[name] = int(spikes.sum())
    return counts, clean


def _differentiated(
    uniform: UniformChannels,
    clean: dict[str, Float[np.ndarray, "n k"]],
    speed: Float[np.ndarray, "n N"],
    log: FlightLog,
) -> FlightData:
    """Return the whole log as FlightData, without segments yet."""
    source = log.channels.get("rotor_speed")
    step = source.resolution if source is not None and source.resolution else 0.0
    return FlightData(
        sample_rate=uniform.sample_rate,
        time=uniform.time,
        specific_force=clean["accel"],
        angular_velocity=clean["gyro"],
        angular_acceleration=central_difference(clean["gyro"], uniform.sample_rate),
        rotor_speed=speed,
        rotor_acceleration=speed,
        differentiation="central",
        segments=(),
        rotor_speed_std=step / np.sqrt(12.0),
        velocity=clean.get("velocity"),
    )


def _flights(
    motion: Motion, uniform: UniformChannels, window: tuple[float | None, float | None]
) -> list[tuple[int, int]]:
    """Return the airborne stretches: as the user says, else as the data say."""
    if window == (None, None):
        return airborne_rows(motion, uniform.stretches)
    since_start = uniform.time - uniform.time[0]
    start = -np.inf if window[0] is None else window[0]
    end = np.inf if window[1] is None else window[1]
    first, last = np.searchsorted(since_start, [start, end])
    shortest = int(SHORTEST_FLIGHT * motion.sample_rate)
    clipped = [(max(a, int(first)), min(b, int(last))) for a, b in uniform.stretches]
    kept = [(a, b) for a, b in clipped if b - a >= shortest]
    if not kept:
        raise FlightError(
            f"no samples between start = {window[0]} and end = {window[1]} s: the log lasts "
            f"{since_start[-1]:.1f} s from its first sample; choose a window inside it"
        )
    return kept


def _refuse_wrong_gravity(data: FlightData, flights: list[tuple[int, int]]) -> None:
    """Raise unless the thrust points along +z and is of the size of the weight."""
    force = np.median(
        np.concatenate([data.specific_force[a:b] for a, b in flights]), axis=0
    ).astype(float)
    size = float(np.linalg.norm(force))
    seen = (
        f"the median specific force in flight is ({force[0]:.2f}, {force[1]:.2f}, {force[2]:.2f})"
    )
    if force[2] < -0.7 * size:
        raise FrameError(
            f"{seen} m/s^2, but along the thrust (z up) it must be positive; these are FRD axes: "
            'declare axes = "FRD" for this log'
        )
    if force[2] < 0.7 * size:
        axis = "xyz"[int(np.argmax(np.abs(force)))]
        raise FrameError(
            f"{seen} m/s^2, mostly along {axis} instead of z (up along the thrust); the IMU is "
            "mounted turned: rotate its axes in a columns map before you use the log"
        )
    if size < 0.3 * GRAVITY:
        raise FlightError(
            f"{seen} m/s^2, a tenth of gravity: it looks like units of g; declare the unit "
            '(columns = { accel_x = { name = "...", unit = "g" } })'
        )
    if size > 3.0 * GRAVITY:
        raise FlightError(
            f"{seen} m/s^2, {size / GRAVITY:.0f} times gravity; check the accelerometer's unit"
        )


def _gyro_bias(data: FlightData, rest: np.ndarray) -> Float[np.ndarray, " 3"] | None:
    """Return the mean rate at rest, where at least half a second of rest was found."""
    if rest.sum() < 0.5 * data.sample_rate:
        return None
    return np.median(data.angular_velocity[rest], axis=0)


def _inner_segments(
    flights: list[tuple[int, int]], uniform: UniformChannels
) -> tuple[Segment, ...]:
    """Return the flights without the two end samples that a central difference cannot serve."""
    starts = {start for start, _ in uniform.stretches}
    stops = {stop for _, stop in uniform.stretches}
    return tuple(Segment(start=a + (a in starts), stop=b - (b in stops)) for a, b in flights)


def _phases(data: FlightData) -> tuple[Segment, ...]:
    """Return the segments cut where the flight's character changes."""
    phases: list[Segment] = []
    for segment in data.segments:
        rates = data.angular_velocity[segment.start : segment.stop]
        for a, b in phase_edges(rates, data.sample_rate):
            phases.append(Segment(start=segment.start + a, stop=segment.start + b))
    return tuple(phases)


def _cuts(
    data: FlightData, uniform: UniformChannels, window: tuple[float | None, float | None]
) -> tuple[Cut, ...]:
    """Return the stretches that are not used, with the reason."""
    reason = "not airborne" if window == (None, None) else "outside start and end"
    t = data.time
    cuts = [Cut(start=a, end=b, reason=f"gap in {name}") for a, b, name in uniform.gaps]
    used = np.zeros(len(t), dtype=bool)
    for segment in data.segments:
        used[max(segment.start - 1, 0) : segment.stop + 1] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[True], used, [True]]).astype(np.int8)))
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        cuts.append(Cut(start=float(t[a]), end=float(t[b - 1]), reason=reason))
    return tuple(sorted(cuts, key=lambda cut: cut.start))


def _warnings(
    data: FlightData, uniform: UniformChannels, bias: Float[np.ndarray, " 3"] | None
) -> tuple[str, ...]:
    """Return the doubts about a prepared flight."""
    doubts: list[str] = []
    if bias is None:
        doubts.append(
            "no second of rest was found: the gyro's bias is left in; leave the vehicle still on "
            "the ground for two seconds before take-off"
        )
    elif float(np.abs(bias).max()) > 0.1:
        doubts.append(
            f"the gyro reads up to {float(np.abs(bias).max()):.2f} rad/s at rest (taken off); "
            "calibrate it"
        )
    motor_rate, gyro_rate = uniform.rates["motor"], uniform.rates["gyro"]
    if motor_rate < 0.4 * gyro_rate:
        doubts.append(
            f"motor data come at {motor_rate:.0f} Hz, the gyro at {gyro_rate:.0f} Hz: fast "
            f"motion is used only up to {0.4 * motor_rate:.0f} Hz; log motors faster"
        )
    doubts += _scope_warnings(data)
    return tuple(doubts)


def _scope_warnings(data: FlightData) -> list[str]:
    """Return a warning where the flight leaves the near-hover scope of the model."""
    doubts: list[str] = []
    rows = np.concatenate([np.arange(s.start, s.stop) for s in data.segments])
    thrust = np.einsum("nr,nr->n", data.rotor_speed[rows], data.rotor_speed[rows])
    relative = thrust / np.median(thrust)
    far = float(((relative > 1.8) | (relative < 0.3)).mean())
    if far > 0.1:
        doubts.append(
            f"thrust is outside 0.3 to 1.8 times hover for {100 * far:.0f} % of the flight: fast "
            "climbs and falls change the airflow through the rotors, which the model leaves out"
        )
    if data.velocity is not None:
        velocity = data.velocity[rows]
        speed = np.sqrt((velocity * velocity).sum(axis=1))
        fast = float(np.percentile(speed, 95))
        if fast > 5.0:
            doubts.append(
                f"the vehicle flies at up to {fast:.1f} m/s; over 5 m/s the air drag of the frame "
                "counts, which the model leaves out: use a slower part of the flight"
            )
    return doubts
