"""FlightLog to FlightData from motion capture: pose and motors, no IMU (Six et al. 2020, III-C.2).

The order matters: frames that are good, one clock, one low-pass for pose and rotor speed alike,
then splines for every derivative, then products. The body origin is the tracked point.
"""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import FlightError, FrameError
from rotorfit.findings import Finding, doubt
from rotorfit.flight.airborne import (
    GRAVITY,
    ON_THE_GROUND,
    SHORTEST_FLIGHT,
    Motion,
    airborne_rows,
    aloft,
    fast_rows,
    ground_contact,
    ground_doubts,
)
from rotorfit.flight.clocks import (
    FEWEST_SAMPLES,
    JITTER_STEPS,
    UniformChannels,
    uniform_channels,
    usable_samples,
)
from rotorfit.flight.flight_checks import (
    flight_doubts,
    frozen_channel_doubts,
    frozen_channels,
    refuse_empty_window,
    refuse_idle_motors,
    refuse_missing_motors,
    takes_battery,
)
from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.flight.kinematics import (
    BodyMotion,
    continuous_quaternions,
    motion_from_quaternions,
)
from rotorfit.flight.mocap.camera import (
    NOTED_JITTER,
    CameraClock,
    Tracked,
    camera_clock,
    tracked,
)
from rotorfit.flight.motors.motor_model import MotorModel, white_noise_std, with_motors
from rotorfit.flight.prepare import Cut, PreparedFlight, refuse_unusable_motors, with_likely_lag
from rotorfit.flight.signals import (
    hampel,
    low_pass,
    smooth,
    spline_at,
    true_runs,
    whole_samples,
)
from rotorfit.flight.used_rows import Window, phases_of, window_rows
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.motor_law import law_doubts, speed_from_command

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Bool, Float

    from rotorfit.logs.flight_log import Channel, FlightLog

HIGHEST_CUTOFF = 25.0
"""Of the low-pass on every column [Hz]; differentiated twice, a pose holds nothing above."""
CUTOFF_SHARE = 0.25
"""The same as a share of the frame rate."""
MARGIN = 2.5
"""Cut from the ends of every run, in periods of the cut-off: what the low-pass guessed."""
CALM = 4.0
"""Low-pass on the rates in the search for the flight [Hz]."""
LEAST_MENDED = 1e-3
"""Share of frames that jump and are mended, from which it is said."""
SLOWEST = 60.0
"""Frames per second below which much of the motion of a small multirotor is lost [Hz]."""


@frozen_dataclass
class _Frames:
    """Pose and motors on the clock of the cameras, low-passed.

    - `rate`, `cutoff`: frames per second, and of the low-pass [Hz].
    - `time`: the frames that are kept [s]; the steps over gaps are longer.
    - `motion`: the motion by the pose.
    - `motors`: recorded motor channel.
    - `runs`: start and stop of the runs without gaps.
    - `motor_rate`, `motor_std`: true rate of the motor channel [Hz], and its white noise.
    - `gaps`: start and end [s] of what is missing, and of which channel.
    """

    rate: float
    cutoff: float
    time: Float[np.ndarray, " n"]
    motion: BodyMotion
    motors: Float[np.ndarray, "n N"]
    runs: tuple[tuple[int, int], ...]
    motor_rate: float
    motor_std: float
    gaps: tuple[Cut, ...]


def prepare_mocap(
    log: FlightLog,
    *,
    rotor_count: int,
    arm: float,
    motors: MotorModel | None = None,
    window: Window = (None, None),
) -> PreparedFlight:
    """Prepare the airborne part of a motion-capture log, as `prepare` does of an IMU's.

    The motor channel is as recorded: by how much motion capture is later is found in the estimate.
    The window is in seconds since the log's first good frame.
    """
    motors = motors or MotorModel()
    measured = motors.speed == "measured"
    name = "rotor_speed" if measured else "command"
    seen = tracked(log)
    pose = seen.pose
    refuse_missing_motors(log, name, rotor_count)
    clock = camera_clock(pose.time)
    recorded = {"motor": _recorded_motors(log, motors)}
    refuse_unusable_motors(uniform_channels(recorded, clock="motor"), measured=measured)
    frames = _differentiate_runs(pose, clock, _motor_channel(log, motors))
    data = _collect_flight_data(
        frames, (log.channels[name].resolution or 0.0) if measured else None
    )
    data = with_motors(data, frames.motors, motors.response)
    motion = _window_signals(data, frames, arm=arm, window=window)
    refuse_idle_motors(motion)
    _refuse_wrong_attitude(motion, pose)
    flights, standing = _flown_window(motion, motors, window)
    data = dataclasses.replace(data, segments=flights)
    airborne = [(s.start, s.stop) for s in flights]
    frozen = frozen_channels(frames.motors, airborne, frames.rate, may_rest=not measured)
    frozen_doubts = frozen_channel_doubts(frozen, data.time, measured=measured)
    return PreparedFlight(
        data=data,
        phases=phases_of(data),
        motor_channel=frames.motors,
        gyro_bias=None,
        spikes={"pose": seen.mended} if seen.mended else {},
        # Bands end at 0.4 of the slowest rate: here at the low-pass.
        slowest_rate=min(frames.cutoff / 0.4, frames.motor_rate),
        motor_rate=frames.motor_rate,
        cuts=_list_cuts(data, frames, window, standing),
        findings=(
            *_find_doubts(data, frames, clock, seen=seen, standing=standing),
            *frozen_doubts,
            *_law_doubts(log, motors, data),
        ),
    )


def _flown_window(
    motion: Motion, motors: MotorModel, window: Window
) -> tuple[tuple[Segment, ...], list[tuple[int, int]]]:
    """Take the window where the user gave one, without standing, else find the airborne part."""
    flights, standing = list(motion.stretches), []
    if window == (None, None):
        flights = airborne_rows(with_likely_lag(_smooth_rates(motion), motors))
    else:
        standing = ground_contact(_smooth_rates(motion), flights)
        flights = aloft(motion, flights, standing)
    return tuple(Segment(start=a, stop=b) for a, b in flights), standing


def _recorded_motors(log: FlightLog, motors: MotorModel) -> Channel:
    """Select the motor channel as recorded, despiked where speeds were measured."""
    if motors.speed == "commanded":
        return usable_samples(log.channels["command"], "command")
    channel = usable_samples(log.channels["rotor_speed"], "rotor_speed")
    return dataclasses.replace(channel, values=hampel(channel.values)[0])


def _motor_channel(log: FlightLog, motors: MotorModel) -> Channel:
    """Convert the motor channel to speeds."""
    channel = _recorded_motors(log, motors)
    if motors.speed == "measured" or motors.law is None:
        return channel
    battery = None
    if takes_battery(log, motors.law):
        volts = usable_samples(log.channels["battery"], "battery")
        battery = np.interp(channel.time, volts.time, volts.values[:, 0])[:, None]
    speed = speed_from_command(channel.values, motors.law, battery=battery)
    return dataclasses.replace(channel, values=speed)


def _differentiate_runs(pose: Channel, clock: CameraClock, motors: Channel) -> _Frames:
    """Low-pass and differentiate pose and motors, run by run."""
    cutoff = min(HIGHEST_CUTOFF, CUTOFF_SHARE * clock.rate)
    own = uniform_channels({"motor": motors}, clock="motor")
    speed, has_motors = _on_frames(own, clock, cutoff)
    shortest = whole_samples(clock.rate * (SHORTEST_FLIGHT + 2.0 * MARGIN / cutoff))
    runs = [
        (first + a, first + b)
        for first, stop in clock.runs
        for a, b in true_runs(has_motors[first:stop])
        if b - a >= shortest
    ]
    if not runs:
        raise FlightError(
            f"motion capture ({pose.time[0]:.3f} to {pose.time[-1]:.3f} s) and motors "
            f"({motors.time[0]:.3f} to {motors.time[-1]:.3f} s) never run together for "
            f"{shortest / clock.rate:.1f} s without a lost frame (there are {len(clock.runs)} runs "
            "of frames); use one clock for both, and more cameras or markers"
        )
    q = continuous_quaternions(pose.values[:, 3:])
    parts: list[BodyMotion] = []
    for a, b in runs:
        rows = np.concatenate([pose.values[a:b, :3], q[a:b]], axis=1)
        smooth_pose = low_pass(rows, clock.rate, cutoff)
        attitude = continuous_quaternions(smooth_pose[:, 3:])
        parts.append(motion_from_quaternions(smooth_pose[:, :3], attitude, clock.rate))
    stops = np.cumsum([b - a for a, b in runs]).tolist()
    return _Frames(
        rate=clock.rate,
        cutoff=cutoff,
        time=np.concatenate([clock.time[a:b] for a, b in runs]),
        motion=_join_motion(parts),
        motors=np.concatenate([speed[a:b] for a, b in runs]),
        runs=tuple(pairwise([0, *stops])),
        motor_rate=own.rates["motor"],
        motor_std=white_noise_std(own.values["motor"], own.stretches),
        gaps=_list_gaps(clock, runs, has_motors),
    )


def _join_motion(parts: list[BodyMotion]) -> BodyMotion:
    return BodyMotion(
        specific_force=np.concatenate([p.specific_force for p in parts]),
        angular_velocity=np.concatenate([p.angular_velocity for p in parts]),
        angular_acceleration=np.concatenate([p.angular_acceleration for p in parts]),
        velocity=np.concatenate([p.velocity for p in parts]),
    )


def _on_frames(
    own: UniformChannels, clock: CameraClock, cutoff: float
) -> tuple[Float[np.ndarray, "n N"], Bool[np.ndarray, " n"]]:
    """Interpolate the motor channel at the frames, and mark where it has data."""
    motors, rate = own.values["motor"], own.sample_rate
    edge = JITTER_STEPS / rate
    values = np.zeros((len(clock.time), motors.shape[1]))
    there = np.zeros(len(clock.time), dtype=bool)
    for a, b in own.stretches:
        if b - a < FEWEST_SAMPLES:
            continue
        # Where both begin at one instant, rounding must not decide whether the frame counts.
        inside = (clock.time >= own.time[a] - edge) & (clock.time <= own.time[b - 1] + edge)
        # On its own clock, so that what is faster than the cameras does not fold back.
        smooth_speed = low_pass(motors[a:b], rate, min(cutoff, 0.45 * rate))
        values[inside] = spline_at(smooth_speed, (clock.time[inside] - own.time[a]) * rate)[0]
        there |= inside
    return values, there


def _list_gaps(
    clock: CameraClock, runs: list[tuple[int, int]], has_motors: Bool[np.ndarray, " n"]
) -> tuple[Cut, ...]:
    """List the gaps between the runs, with their reason."""
    gaps: list[Cut] = []
    for (_, stop), (start, _) in pairwise(runs):
        lost = bool(has_motors[stop:start].all())
        reason = "gap in motion capture" if lost else "gap in motor"
        gaps.append(
            Cut(start=float(clock.time[stop - 1]), end=float(clock.time[start]), reason=reason)
        )
    return tuple(gaps)


def _collect_flight_data(frames: _Frames, resolution: float | None) -> FlightData:
    """Collect all runs as FlightData, without segments and rotor columns yet."""
    motion = frames.motion
    # White noise of the same density, where the low-pass lets it through.
    thinned = np.sqrt(frames.rate / frames.motor_rate)
    # Commands, without a resolution, are free of noise.
    std = 0.0 if resolution is None else max(resolution / 12.0**0.5, frames.motor_std)
    return FlightData(
        sample_rate=frames.rate,
        time=frames.time,
        specific_force=motion.specific_force,
        angular_velocity=motion.angular_velocity,
        angular_acceleration=motion.angular_acceleration,
        rotor_speed=frames.motors,
        rotor_acceleration=frames.motors,
        # The derivatives are those of splines and belong to the instant of their sample.
        differentiation="exact",
        segments=(),
        rotor_speed_std=float(std * thinned),
        velocity=motion.velocity,
    )


def _count_margin_frames(frames: _Frames) -> int:
    """Count the frames cut from the ends of every run; see `whole_samples`."""
    return int(np.ceil(MARGIN / frames.cutoff * frames.rate - JITTER_STEPS))


def _window_signals(data: FlightData, frames: _Frames, *, arm: float, window: Window) -> Motion:
    """Collect the signals for the search of the flight: runs without their ends, in the window."""
    margin = _count_margin_frames(frames)
    first, last = window_rows(data.time, frames.rate, window)
    shortest = whole_samples(SHORTEST_FLIGHT * frames.rate)
    clipped = [(max(a + margin, first), min(b - margin, last)) for a, b in frames.runs]
    kept = tuple((a, b) for a, b in clipped if b - a >= shortest)
    refuse_empty_window(kept, window, float(data.time[-1] - data.time[0]))
    return Motion(
        sample_rate=frames.rate,
        specific_force=data.specific_force,
        angular_velocity=data.angular_velocity,
        rotor_speed=data.rotor_speed,
        arm=arm,
        stretches=kept,
    )


def _smooth_rates(motion: Motion) -> Motion:
    """Smooth the noisy rates of poses so that standing still shows, for the search of flight."""
    rates = motion.angular_velocity.copy()
    for a, b in motion.stretches:
        rates[a:b] = smooth(rates[a:b], motion.sample_rate, CALM)
    return dataclasses.replace(motion, angular_velocity=rates)


def _refuse_wrong_attitude(motion: Motion, pose: Channel) -> None:
    """Raise unless, turned by the attitude, gravity and acceleration point along the thrust."""
    fast = fast_rows(motion, motion.thrust)
    force = np.median(motion.specific_force[fast], axis=0).astype(float)
    size = float(np.linalg.norm(force))
    if force[2] >= 0.7 * size and 0.3 * GRAVITY < size < 3.0 * GRAVITY:
        return
    raise FrameError(
        f"where the rotors push, motion capture shows a median specific force of ({force[0]:.2f}, "
        f"{force[1]:.2f}, {force[2]:.2f}) m/s^2 in body axes, and it must lie along the thrust (z "
        "up, about 9.8): attitude must turn from the body (x forward, y left, z up) to a world "
        "with z up, position be in metres; many systems have y up: export with z up, or declare "
        f'axes = "FRD" for north-east-down (attitude from {pose.source})'
    )


def _list_cuts(
    data: FlightData, frames: _Frames, window: Window, standing: list[tuple[int, int]]
) -> tuple[Cut, ...]:
    """List the unused stretches in the order of time."""
    reason = "not airborne" if window == (None, None) else "outside start and end"
    used = np.zeros(len(data.time), dtype=bool)
    margin = _count_margin_frames(frames)
    for segment in data.segments:
        used[max(segment.start - margin, 0) : segment.stop + margin] = True
    t = data.time
    ground = [
        Cut(start=float(t[a]), end=float(t[b - 1]), reason=ON_THE_GROUND) for a, b in standing
    ]
    for a, b in standing:
        used[a:b] = True
    cuts = [Cut(start=float(t[a]), end=float(t[b - 1]), reason=reason) for a, b in true_runs(~used)]
    return tuple(sorted([*cuts, *ground, *frames.gaps], key=lambda cut: cut.start))


def _find_doubts(
    data: FlightData,
    frames: _Frames,
    clock: CameraClock,
    *,
    seen: Tracked,
    standing: list[tuple[int, int]],
) -> Iterator[Finding]:
    """Find mended or irregular frames, ground, slow cameras or motors, and unusual flight."""
    if seen.mended > LEAST_MENDED * len(seen.pose.time):
        yield doubt(
            "mended-frames",
            f"{seen.mended} of {len(seen.pose.time)} frames of the motion capture jumped and "
            "returned, and were put back on the line of their neighbours; see that no marker is "
            "confused",
        )
    yield from ground_doubts(data.time, standing)
    if clock.jitter > NOTED_JITTER:
        yield doubt(
            "irregular-frames",
            f"the frames' times scatter by {1e3 * clock.jitter / clock.rate:.1f} ms about a "
            f"regular {clock.rate:.2f} Hz, which was taken instead; record the cameras' own times",
        )
    if clock.rate < SLOWEST:
        yield doubt(
            "slow-cameras",
            f"motion capture comes at {clock.rate:.0f} Hz: motion is used only up to "
            f"{frames.cutoff:.0f} Hz; record at 100 Hz or more",
        )
    if frames.motor_rate < 0.4 * clock.rate:
        yield doubt(
            "slow-motor-data",
            f"motor data come at {frames.motor_rate:.0f} Hz, motion capture at {clock.rate:.0f} "
            f"Hz: motion is used only up to {0.4 * frames.motor_rate:.0f} Hz; log motors faster",
        )
    yield from flight_doubts(data)


def _law_doubts(log: FlightLog, motors: MotorModel, data: FlightData) -> Iterator[Finding]:
    """Find commands in flight that leave the motors' law."""
    if motors.law is None:
        return
    command = usable_samples(log.channels["command"], "command")
    first, last = data.time[data.segments[0].start], data.time[data.segments[-1].stop - 1]
    used = (command.time >= first) & (command.time <= last)
    yield from law_doubts(motors.law, command.values[used])
