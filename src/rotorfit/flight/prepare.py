"""FlightLog to FlightData, top to bottom: one clock, despiked, airborne, differentiated."""

from __future__ import annotations

import dataclasses
from dataclasses import field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import ExperimentError, FlightError
from rotorfit.findings import Finding, sentences
from rotorfit.flight.airborne import (
    ON_THE_GROUND,
    Motion,
    airborne_rows,
    aloft,
    ground_contact,
    ground_doubts,
    misfit,
    rest_rows,
)
from rotorfit.flight.arrivals import arrival_doubts
from rotorfit.flight.clocks import (
    UniformChannels,
    uniform_channels,
    usable_samples,
)
from rotorfit.flight.drag_direction import accelerometer_axes
from rotorfit.flight.flight_checks import (
    explained_by_slow_motors,
    frozen_channel_doubts,
    frozen_channels,
    refuse_absurd_sensors,
    refuse_blows,
    refuse_coarse_speeds,
    refuse_idle_motors,
    refuse_interpolated_commands,
    refuse_interpolated_speeds,
    refuse_missing_channels,
    refuse_torn_log,
    refuse_wrong_gravity,
    takes_battery,
)
from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.flight.flown_gyro_bias import doubts_of_imu, flown_gyro_bias
from rotorfit.flight.frozen_imu import cut_frozen_imu, interpolated_imu, refuse_dead_axes
from rotorfit.flight.kinematics import climb_velocity
from rotorfit.flight.many_gaps import many_gaps
from rotorfit.flight.mocap.carried_velocity import carried_velocity
from rotorfit.flight.mocap.pose_velocity import horizontal_axes, known_velocity
from rotorfit.flight.motors.coarse_speeds import speed_step
from rotorfit.flight.motors.motor_model import (
    MotorModel,
    MotorResponse,
    clock_jumps,
    first_order_lag,
    following_rotors,
    speed_from_command,
    white_noise_std,
    with_motors,
)
from rotorfit.flight.motors.twin_rotors import refuse_twin_rotors
from rotorfit.flight.on_board import applied_filters, passed_through, with_filters
from rotorfit.flight.other_hovers import OtherHover, other_hovers
from rotorfit.flight.replaced_samples import replaced_samples
from rotorfit.flight.signals import SLOW_STEP, central_difference, hampel, true_runs
from rotorfit.flight.used_rows import Window, drop_unsettled, inner_segments, phases_of, window_runs
from rotorfit.flight.written_twice import written_twice
from rotorfit.flight.yaw_lowpass import yaw_lowpass
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.motor_law import law_doubts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from jaxtyping import Bool, Float, Int

    from rotorfit.logs.firmware import Filter
    from rotorfit.logs.flight_log import Channel, FlightLog

OPTIONAL = ("velocity", "carried", "world_axes", "reference")
"""Channels that a flight may lack, here and there or wholly."""
LAGS_TRIED = (0.0, 0.025, 0.05, 0.1)
"""Of motors whose commands are all that is known, for the search of the flight only [s]."""


@frozen_dataclass
class Cut:
    """A stretch of the log that is not used [s], and why."""

    start: float
    end: float
    reason: str


@frozen_dataclass
class PreparedFlight:
    """A flight ready for the model, and what was done to it.

    Attributes
    ----------
    data
        The flight; its segments are the airborne stretches.
    phases
        The same stretches, cut where the flight's character changes.
    motor_channel
        Speed before lag and delay, on the uniform clock, from which both can be tried again.
    gyro_bias
        Taken off the rates [rad/s]; None if no rest was found and it was small in flight.
    spikes
        Samples replaced, by channel.
    slowest_rate, motor_rate
        Of the channels used, and of the motor channel [Hz].
    cuts
        What is not used, in the order of time; seconds of the log's own clock.
    findings
        Doubts of the flight.
    other_hovers
        Hovers on another thrust, which are not used.
    last_retimed
        The flight at the motor timing that was asked for last, by that timing: most steps of a fit
        ask for the same one.
    """

    data: FlightData
    phases: tuple[Segment, ...]
    motor_channel: Float[np.ndarray, "n N"]
    gyro_bias: tuple[float, float, float] | None
    spikes: dict[str, int]
    slowest_rate: float
    motor_rate: float
    cuts: tuple[Cut, ...]
    findings: tuple[Finding, ...]
    other_hovers: tuple[OtherHover, ...] = ()
    last_retimed: dict[MotorResponse, FlightData] = field(
        init=False, repr=False, compare=False, default_factory=dict[MotorResponse, FlightData]
    )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Doubts of the flight, one sentence each: those of the findings."""
        return sentences(self.findings)


@frozen_dataclass
class OneClock:
    """The part of a log that `prepare` needs, so that the log need not stay in memory.

    - `uniform`: gyro, accelerometer, motors and what else is used, despiked.
    - `spikes`: samples replaced, by channel.
    - `speed_step`: smallest step of measured rotor speed [rad/s]; 0 if unknown.
    - `takes_columns`: whether units and axes of the log can be declared.
    - `said`: kinds of what the log's reader doubts already.
    - `filters`: on board, that its samples passed.
    - `clock_findings`: what is said of the channels' own clocks.
    """

    uniform: UniformChannels
    spikes: dict[str, int]
    speed_step: float
    takes_columns: bool = True
    said: frozenset[str] = frozenset()
    filters: tuple[Filter, ...] = ()
    clock_findings: tuple[Finding, ...] = ()

    def not_said(self, findings: Iterable[Finding]) -> Iterator[Finding]:
        """Leave out what the log's reader doubts already."""
        return (one for one in findings if one.kind not in self.said)


def prepare(
    log: FlightLog,
    *,
    rotor_count: int,
    arm: float,
    motors: MotorModel | None = None,
    window: Window = (None, None),
) -> PreparedFlight:
    """Return the airborne part of a log on one clock, in SI units and FLU body axes.

    Parameters
    ----------
    log
        As its reader gave it.
    rotor_count
        How many motor columns the airframe expects.
    arm
        Distance of the rotors from their centre [m]; only a scale to separate flight from ground.
    motors
        How the motor channel becomes rotor speed; measured, without delay, by default.
    window
        Start and end of the flight in seconds since the log's first sample. Either one replaces
        the search for the airborne part.

    Raises
    ------
    ExperimentError
        If the arm is no length.
    LogError
        If a channel is missing or has the wrong number of columns.
    FlightError
        If no usable flight is in it.
    FrameError
        If gravity contradicts the axes.
    """
    if not 0.0 < arm < np.inf:
        raise ExperimentError(f"arm is {arm:g}, expected a length of more than 0 m")
    motors = motors or MotorModel()
    recorded = on_one_clock(log, rotor_count=rotor_count, motors=motors)
    return prepared_from(recorded, arm=arm, motors=motors, window=window)


def on_one_clock(log: FlightLog, *, rotor_count: int, motors: MotorModel) -> OneClock:
    """Resample the needed channels to the gyro's clock: the first half of `prepare`.

    A long log can be released before the second half, to save memory.
    """
    uniform, spikes = _make_uniform(log, rotor_count, motors)
    refuse_dead_axes(log, uniform)
    refuse_absurd_sensors(log, uniform)
    measured = log.channels["rotor_speed"] if motors.speed == "measured" else None
    unused = {"command"} if measured is not None else {"rotor_speed"}
    used = {name: channel for name, channel in log.channels.items() if name not in unused}
    step = 0.0 if measured is None else max(measured.resolution or 0.0, speed_step(measured.values))
    return OneClock(
        uniform=uniform,
        spikes=spikes,
        speed_step=step,
        takes_columns=log.takes_columns,
        said=frozenset(one.kind for one in log.findings),
        filters=applied_filters(log),
        clock_findings=tuple(arrival_doubts(used)),
    )


def prepared_from(
    recorded: OneClock, *, arm: float, motors: MotorModel, window: Window = (None, None)
) -> PreparedFlight:
    """Prepare the airborne part from `on_one_clock`: the second half of `prepare`."""
    uniform = recorded.uniform
    speed = uniform.values["motor"]
    refuse_unusable_motors(uniform, measured=motors.speed == "measured")
    if motors.speed == "commanded" and motors.law is not None:
        speed = speed_from_command(speed, motors.law, battery=uniform.values.get("battery"))
    jumps = clock_jumps(uniform.time, uniform.sample_rate)
    recorded_speed = speed
    speed = passed_through(speed, uniform.sample_rate, recorded.filters, jumps=jumps)
    turning = _turn_rotors(uniform, speed, motors, jumps)
    motion = _collect_motion(uniform, turning, arm=arm, window=window)
    refuse_idle_motors(motion)
    refuse_wrong_gravity(motion, takes_columns=recorded.takes_columns)
    flights, standing = _find_flights(motion, uniform, motors, window)
    hovers = other_hovers(motion, flights, uniform.time) if window == (None, None) else ()
    measured = motors.speed == "measured"
    refuse_torn_log(uniform, flights)
    refuse_blows(uniform, flights)
    flights, hung = cut_frozen_imu(uniform, flights)
    motor, step = uniform.values["motor"], recorded.speed_step
    refuse_coarse_speeds(motor, flights, step)
    found = frozen_channels(motor, flights, uniform.sample_rate, may_rest=not measured, step=step)
    frozen = frozen_channel_doubts(found, uniform.time, measured=measured)
    rest = rest_rows(dataclasses.replace(motion, stretches=uniform.stretches), flights)
    at_rest = _gyro_bias(uniform, rest)
    flown = flown_gyro_bias(uniform, flights) if at_rest is None else None
    bias = at_rest if flown is None else _three(flown.value)
    del motion, rest
    # Rounding errors are uniform over a step: a deviation of step / sqrt(12).
    speed_std = max(step / 12.0**0.5, white_noise_std(recorded_speed, flights)) if measured else 0.0
    collected = _collect_flight_data(uniform, speed, bias)
    collected = with_filters(collected, recorded.filters, jumps=jumps)
    collected = dataclasses.replace(collected, lag_on=motors.lag_on)
    data = dataclasses.replace(
        with_motors(collected, speed, motors.response),
        segments=inner_segments(flights if measured else drop_unsettled(flights, uniform), uniform),
        rotor_speed_std=speed_std,
    )
    data = dataclasses.replace(data, climb=climb_velocity(data))
    return PreparedFlight(
        data=data,
        phases=phases_of(data),
        motor_channel=speed,
        gyro_bias=bias,
        spikes=recorded.spikes,
        slowest_rate=min(uniform.rates[name] for name in ("gyro", "accel", "motor")),
        motor_rate=uniform.rates["motor"],
        cuts=_list_cuts(data, uniform, window, standing),
        findings=(
            *recorded.clock_findings,
            *ground_doubts(uniform.time, standing),
            *recorded.not_said(doubts_of_imu(data, uniform, at_rest, flown)),
            *frozen,
            *hung,
            *_sample_faults(recorded, flights, data),
            *(() if motors.law is None else law_doubts(motors.law, motor[data.used_rows])),
        ),
        other_hovers=hovers,
    )


def _sample_faults(
    recorded: OneClock, flights: Sequence[tuple[int, int]], data: FlightData
) -> Iterator[Finding]:
    """Find what is wrong with the samples over the whole flight, those of the IMU above all."""
    uniform = recorded.uniform
    yield from many_gaps(uniform, flights)
    yield from replaced_samples(recorded.spikes, uniform)
    yield from interpolated_imu(uniform)
    yield from written_twice(uniform, flights)
    yield from yaw_lowpass(uniform, flights)
    yield from accelerometer_axes(data)


def _find_flights(
    motion: Motion, uniform: UniformChannels, motors: MotorModel, window: Window
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Find the airborne rows, and those on the ground in the window that the user gives."""
    if window == (None, None):
        with explained_by_slow_motors(uniform.rates["motor"]):
            return airborne_rows(with_likely_lag(motion, motors)), []
    given = list(motion.stretches)
    standing = ground_contact(motion, given, stretches=uniform.stretches)
    return aloft(motion, given, standing), standing


def _gyro_bias(
    uniform: UniformChannels, rest: Bool[np.ndarray, " n"]
) -> tuple[float, float, float] | None:
    """Average the gyro at rest [rad/s]; None if the rest is shorter than half a second."""
    if rest.sum() < 0.5 * uniform.sample_rate:
        return None
    return _three(uniform.values["gyro"][rest].mean(axis=0))


def _three(values: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    """Return a vector as a tuple."""
    x, y, z = values.tolist()
    return x, y, z


def refuse_unusable_motors(uniform: UniformChannels, *, measured: bool) -> None:
    """Refuse motor data made by interpolation from slower ones, or of one rotor for two."""
    # In gaps the lines are this module's own.
    a, b = max(uniform.stretches, key=lambda whole: whole[1] - whole[0])
    motor = uniform.values["motor"][a:b]
    refuse_twin_rotors(motor, measured=measured)
    if measured:
        refuse_interpolated_speeds(motor, uniform.sample_rate)
    else:
        refuse_interpolated_commands(motor, uniform.sample_rate, uniform.rates["motor"])


def _turn_rotors(
    uniform: UniformChannels,
    speed: Float[np.ndarray, "n N"],
    motors: MotorModel,
    jumps: Int[np.ndarray, " j"],
) -> Float[np.ndarray, "n N"]:
    """Compute the rotor speed by the motor model as declared; `jumps` of the clock."""
    return following_rotors(
        speed,
        uniform.sample_rate,
        jumps=jumps,
        response=motors.response,
        lag_on=motors.lag_on,
    )


def _make_uniform(
    log: FlightLog, rotor_count: int, motors: MotorModel
) -> tuple[UniformChannels, dict[str, int]]:
    """Despike and resample the needed channels; count the replaced samples of each."""
    motor_name = "rotor_speed" if motors.speed == "measured" else "command"
    refuse_missing_channels(log, motor_name, rotor_count)
    names = {"gyro": "gyro", "accel": "accel", "motor": motor_name}
    if takes_battery(log, motors.law):
        names["battery"] = "battery"
    # A command that jumps is a command; a measured speed that jumps and returns is a glitch.
    noisy = ("gyro", "accel", "motor") if motors.speed == "measured" else ("gyro", "accel")
    counts: dict[str, int] = {}

    def usable(key: str) -> Channel:
        channel = usable_samples(log.channels[names[key]], names[key])
        if key not in noisy:
            return channel
        # Despiked as recorded: between slow samples a glitch is drawn out, and no longer a spike.
        is_slow = float(np.median(np.diff(channel.time))) > SLOW_STEP
        values, spikes = hampel(channel.values, is_slow=is_slow)
        counts[key] = int(spikes.sum())
        return dataclasses.replace(channel, values=values)

    makers: dict[str, Channel | Callable[[], Channel]] = {
        key: partial(usable, key) for key in names
    }
    velocity = known_velocity(log)
    if velocity is not None:
        makers["velocity"] = velocity
        axes = horizontal_axes(log)
        if axes is not None:
            makers["world_axes"] = axes
    carried = carried_velocity(log)
    if carried is not None:
        makers["carried"] = carried
    reference = _usable_reference(log)
    if reference is not None:
        makers["reference"] = reference
    held = ("motor",) if motors.speed == "commanded" else ()
    return uniform_channels(makers, clock="gyro", optional=OPTIONAL, held=held), counts


def _usable_reference(log: FlightLog) -> Channel | None:
    """Return the reference rates if usable: their lack is no reason to refuse a flight."""
    if "reference" not in log.channels:
        return None
    try:
        return usable_samples(log.channels["reference"], "reference")
    except FlightError:
        return None


def _collect_flight_data(
    uniform: UniformChannels,
    speed: Float[np.ndarray, "n N"],
    bias: tuple[float, float, float] | None,
) -> FlightData:
    """Collect the whole log as FlightData, without segments yet."""
    gyro = uniform.values["gyro"]
    return FlightData(
        sample_rate=uniform.sample_rate,
        time=uniform.time,
        specific_force=uniform.values["accel"],
        angular_velocity=gyro if bias is None else gyro - np.array(bias),
        angular_acceleration=central_difference(gyro, uniform.sample_rate),
        rotor_speed=speed,
        rotor_acceleration=speed,
        differentiation="central",
        segments=(),
        velocity=uniform.values.get("velocity"),
        carried=uniform.values.get("carried"),
        world_axes=uniform.values.get("world_axes"),
        reference=uniform.values.get("reference"),
    )


def _collect_motion(
    uniform: UniformChannels,
    rotor_speed: Float[np.ndarray, "n N"],
    *,
    arm: float,
    window: Window,
) -> Motion:
    """Collect the signals for the search of the flight, within the window."""
    return Motion(
        sample_rate=uniform.sample_rate,
        specific_force=uniform.values["accel"],
        angular_velocity=uniform.values["gyro"],
        rotor_speed=rotor_speed,
        arm=arm,
        stretches=window_runs(uniform, window),
    )


def with_likely_lag(motion: Motion, motors: MotorModel) -> Motion:
    """Lag commands as the force suggests, where no lag was given; for the search of flight only."""
    if motors.speed == "measured" or motors.lag > 0:
        # A command that leads the force by 80 ms looks like contact in every flip.
        return motion
    tried = [
        dataclasses.replace(
            motion, rotor_speed=first_order_lag(motion.rotor_speed, motion.sample_rate, lag)
        )
        for lag in LAGS_TRIED
    ]
    return min(tried, key=misfit)


def _list_cuts(
    data: FlightData, uniform: UniformChannels, window: Window, standing: list[tuple[int, int]]
) -> tuple[Cut, ...]:
    """List the unused stretches, with the reason."""
    reason = "not airborne" if window == (None, None) else "outside start and end"
    t = data.time
    cuts = [Cut(start=a, end=b, reason=f"gap in {name}") for a, b, name in uniform.gaps]
    used = np.zeros(len(t), dtype=bool)
    for a, b in standing:
        cuts.append(Cut(start=float(t[a]), end=float(t[b - 1]), reason=ON_THE_GROUND))
        used[a:b] = True
    for segment in data.segments:
        used[max(segment.start - 1, 0) : segment.stop + 1] = True
    for a, b in true_runs(~used):
        cuts.append(Cut(start=float(t[a]), end=float(t[b - 1]), reason=reason))
    return tuple(sorted(cuts, key=lambda cut: cut.start))
