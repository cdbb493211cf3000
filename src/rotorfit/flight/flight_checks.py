"""What makes a flight unusable, and what makes it doubtful: every message in one place."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import FlightError, FrameError, LogError
from rotorfit.findings import Finding, doubt
from rotorfit.flight.airborne import GRAVITY, Motion, fast_rows
from rotorfit.flight.interpolated import slowest_source_rate, source_rate
from rotorfit.flight.motors.coarse_speeds import coarse_speeds_sentence
from rotorfit.flight.motors.halved_speeds import halved_speed_sentence
from rotorfit.flight.signals import repeated_rows, true_runs, whole_samples
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.flight_log import AS_A_TABLE, FlightLog, other_columns

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Sequence

    from jaxtyping import Float

    from rotorfit.flight.clocks import UniformChannels
    from rotorfit.flight.flight_data import FlightData
    from rotorfit.logs.motor_law import MotorLaw

LONGEST_CONSTANT: Final = 1.0
"""A motor channel that stays the same for so long while the others move is stuck [s]."""
MOVING: Final = 0.3
"""Share of their usual deviation from which the other rotors count as moving."""
STEPS: Final = 3.0
"""Steps of a coarse channel by which the others must deviate: less is rounded away."""
NO_GRAVITY: Final = 0.5
"""A median specific force below is no weight in m/s^2, nor in units of g (1 in hover)."""
FLAT: Final = 0.01
"""Deviation over that of the others, below which a channel is noise about a constant."""


@frozen_dataclass
class FrozenChannel:
    """A rotor whose motor channel stands still.

    - `rotor`: from 1, in the log's order.
    - `value`: at which it stands, in the longest stretch.
    - `rows`: start and stop (exclusive) of the longest stretch.
    """

    rotor: int
    value: float
    share: float
    rows: tuple[int, int]


def frozen_channels(
    values: Float[np.ndarray, "n N"],
    stretches: Sequence[tuple[int, int]],
    sample_rate: float,
    *,
    may_rest: bool,
    step: float = 0.0,
) -> tuple[FrozenChannel, ...]:
    """Find motor channels that stay constant while the others move, as with a dead wire.

    `step`: smallest step of the channel, 0 if unknown. `may_rest`: as commands do at
    their ends, for as long as the pilot wants; then they count only between them.
    """
    if values.shape[1] < 3 or not stretches:
        return ()
    flown = np.concatenate([values[a:b] for a, b in stretches])
    usual = flown.std(axis=0)
    longest = whole_samples(LONGEST_CONSTANT * sample_rate)
    found: list[FrozenChannel] = []
    for i in range(values.shape[1]):
        others = np.delete(usual, i)
        least = max(MOVING * float(np.median(others)), STEPS * step)
        if usual[i] < FLAT * float(np.median(others)) and usual[i] > 0.0:
            runs = list(stretches)
        else:
            runs = _constant_runs(values, stretches, i, longest=longest, least=least)
        if may_rest:
            runs = _unsaturated_runs(runs, values, flown, i)
        if runs:
            a, b = max(runs, key=lambda run: run[1] - run[0])
            share = sum(stop - start for start, stop in runs) / len(flown)
            middle = float(np.median(values[a:b, i]))
            found.append(FrozenChannel(rotor=i + 1, value=middle, share=share, rows=(a, b)))
    return tuple(found)


def _constant_runs(
    values: Float[np.ndarray, "n N"],
    stretches: Sequence[tuple[int, int]],
    i: int,
    *,
    longest: int,
    least: float,
) -> list[tuple[int, int]]:
    """Find where one column stays constant for long while the others deviate by `least`."""
    return [
        (a, b + 1)
        for a, b in true_runs(repeated_rows(values[:, i : i + 1], stretches))
        if b - a >= longest
        and float(np.median(np.delete(values[a:b], i, axis=1).std(axis=0))) > max(least, 0.0)
    ]


def _unsaturated_runs(
    runs: list[tuple[int, int]],
    values: Float[np.ndarray, "n N"],
    flown: Float[np.ndarray, "m N"],
    i: int,
) -> list[tuple[int, int]]:
    """Select the stretches in which a command is not at the end that others reach, too."""
    low, high = np.delete(flown, i, axis=1).min(), np.delete(flown, i, axis=1).max()
    if float(np.ptp(flown[:, i])) == 0.0 and flown[0, i] <= low:
        return runs  # it never leaves the lower end: another output drives this motor
    return [(a, b) for a, b in runs if low < float(np.median(values[a:b, i])) < high]


FASTEST_TURN = 40.0
"""The gyros of multirotors end at 2000 deg/s, 35 rad/s; more is another unit [rad/s]."""

LONGEST_BLOW = 3.0
"""From first to last such turn of a crash [s]; a gyro in deg/s reads them all over the flight."""
LEAST_RATE: Final = 40.0
"""Of motors and IMU, below which all of the motion is lost that inertia and lag show in [Hz]."""
ENOUGH_RATE: Final = 150.0
"""Of commands, speeds and IMU, from which on nothing is lost that an estimate uses [Hz]."""
FEWEST_FAST = 3
"""Samples of such a turn from which it is one, and no glitch."""
UNIT_OF_GYRO = 'declare its unit (columns = { gyro_x = { name = "...", unit = "deg/s" } })'
UNIT_OF_ACCEL = 'declare the unit (columns = { accel_x = { name = "...", unit = "g" } })'
FRD_DECLARED = 'declare axes = "FRD" for this log'
TURN_AXES = "rotate its axes in a columns map before you use the log"

SLOWEST_MOTORS = 25.0
"""Slower motor data do not show what the force follows [Hz]."""
IN_STEPS: Final = 0.5
"""Share of the changes of commands in as many rows as a source has samples, from which they are
steps, and no lines were drawn."""

OTHER_MOTOR_DATA: Final = "other-motor-data"
"""Kind of the refusal of a log with commands in place of measured speeds, or the other way."""
LEAST_WHOLE = 2.0
"""Length of the longest stretch of flight without a gap, below which many gaps are refused [s]."""
MOST_TORN = 3.0
"""Gaps a second, beyond which a log is torn: sound logs have up to 0.01."""

MOST_FROZEN = 0.25
"""Share of a flight in which a motor channel may stand still, beyond which it is refused."""
LEAST_FROZEN = 0.02
"""Share from which it is said."""


def refuse_missing_channels(log: FlightLog, motor_name: str, rotor_count: int) -> None:
    """Raise an error if a channel that the model needs is not in the log, or has other rotors."""
    has = ", ".join(log.channels) or "none"
    for name, what in (("gyro", "rotation rates"), ("accel", "specific force")):
        if name not in log.channels:
            named = ", or name its columns with a columns map" if log.takes_columns else ""
            if {"position", "attitude"} <= log.channels.keys():
                named += (
                    ", or take the motion from the poses (--source mocap), together with motor data"
                )
            raise LogError(
                f"the log has no {what} (channel {name}; it has {has}); log the raw IMU{named}"
            )
    refuse_missing_motors(log, motor_name, rotor_count)


def refuse_missing_motors(log: FlightLog, motor_name: str, rotor_count: int) -> None:
    """Raise an error if the log has no motor channel, or one of other rotors."""
    if motor_name not in log.channels:
        message = _no_motors(log, motor_name, ", ".join(log.channels) or "none")
        has_other = bool({"rotor_speed", "command"} & log.channels.keys())
        raise LogError(message).about(kind=OTHER_MOTOR_DATA if has_other else LogError.kind)
    columns = log.channels[motor_name].values.shape[1]
    if columns != rotor_count:
        raise LogError(
            f"the log has {columns} motors ({log.channels[motor_name].source}) but the airframe "
            f"{rotor_count} rotors; list as many rotors as the log has motors, in its order"
        )


def _no_motors(log: FlightLog, motor_name: str, has: str) -> str:
    """Return the message for a log without the motor channel that was asked for."""
    other = "command" if motor_name == "rotor_speed" else "rotor_speed"
    if other in log.channels:
        use = "commanded" if other == "command" else "measured"
        return (
            f"the log has no {motor_name} channel but it has {other} "
            f'({log.channels[other].source}); write speed = "{use}" under [motors]'
        )
    return (
        f"{log.path.name}: no motor data (neither rotor_speed nor command; it has {has}); log ESC "
        "telemetry or motor outputs: without them only the motion is known, not what caused it"
        f"{other_columns(log)}"
    )


def takes_battery(log: FlightLog, law: MotorLaw | None) -> bool:
    """Return whether speeds take the battery's voltage; raise where they must, and none is logged.

    Raises
    ------
    LogError
        If the law needs a voltage that the log does not have.
    """
    if law is None or law.voltage is None:
        return False
    if "battery" in log.channels:
        return True
    if law.voltage.missing_std is not None:
        return False
    raise LogError(
        "the law of the motors has a voltage factor, but the log has no battery voltage "
        f"(channel battery; it has {', '.join(log.channels)}); log it, or give a law without "
        "voltage"
    )


def refuse_absurd_sensors(log: FlightLog, uniform: UniformChannels) -> None:
    """Raise an error if a sensor reads what no vehicle can do."""
    turns = np.abs(uniform.values["gyro"]).max(axis=1)
    fastest = float(np.percentile(turns, 99.8))
    fast = np.flatnonzero(turns > FASTEST_TURN)
    # All within a moment it is a blow, as in a crash.
    if fastest > FASTEST_TURN and uniform.time[fast[-1]] - uniform.time[fast[0]] >= LONGEST_BLOW:
        remedy = UNIT_OF_GYRO if log.takes_columns else AS_A_TABLE
        raise FlightError(
            f"the gyro reads up to {fastest:.0f} rad/s, faster than any multirotor turns (below "
            f"{FASTEST_TURN:.0f} was expected); it looks like deg/s: {remedy}"
        )


def refuse_blows(uniform: UniformChannels, flights: list[tuple[int, int]]) -> None:
    """Raise an error if the flight holds a crash: turns that no multirotor flies."""
    turns = np.abs(uniform.values["gyro"]).max(axis=1)
    inside = np.zeros(len(turns), dtype=bool)
    for start, stop in flights:
        inside[start:stop] = True
    fast = np.flatnonzero(inside & (turns > FASTEST_TURN))
    if len(fast) < FEWEST_FAST:
        return
    first, last = (float(uniform.time[i] - uniform.time[0]) for i in (fast[0], fast[-1]))
    raise FlightError(
        f"the gyro reads up to {float(turns[fast].max()):.0f} rad/s from {first:.1f} to "
        f"{last:.1f} s since the first sample, faster than any multirotor turns (below "
        f"{FASTEST_TURN:.0f} was expected): a "
        f"crash or a blow; set end = {max(first - 0.1, 0.0):.1f} before it, or start = "
        f"{last + 0.1:.1f} after it (--start, --end)"
    )


def refuse_empty_window(
    kept: tuple[tuple[int, int], ...], window: tuple[float | None, float | None], seconds: float
) -> None:
    """Raise if no samples lie between the start and the end that the user gives."""
    start, end = window
    if start is not None and end is not None and start >= end:
        raise FlightError(
            f"start = {start:g} s is not before end = {end:g} s: give the start of the flight "
            "first, both in seconds since the first sample of the log"
        )
    if not kept:
        first = "the first sample" if start is None else f"start = {start:g} s"
        last = "the last sample" if end is None else f"end = {end:g} s"
        raise FlightError(
            f"no usable samples between {first} and {last}: the log lasts {seconds:.1f} s from "
            "its first sample; choose a window inside it, outside its gaps"
        )


def refuse_torn_log(uniform: UniformChannels, flights: list[tuple[int, int]]) -> None:
    """Raise an error if so many rows are missing that no stretch of the flight is long enough."""
    seconds = float(uniform.time[-1] - uniform.time[0])
    gaps = len({start for start, _, _ in uniform.gaps})
    longest = max(stop - start for start, stop in flights) / uniform.sample_rate
    if longest >= LEAST_WHOLE or gaps <= MOST_TORN * seconds:
        return
    names = " and ".join(sorted({name for _, _, name in uniform.gaps}))
    raise FlightError(
        f"rows are missing all over the log: {gaps} gaps ({names}) in {seconds:.1f} s, and the "
        f"longest stretch of flight without one is {longest:.1f} s, where {LEAST_WHOLE:g} s and "
        "more are needed: the recorder dropped samples; log to a faster card, fewer fields or at a "
        "lower rate, or export the log again"
    )


def refuse_idle_motors(motion: Motion) -> None:
    """Raise if no motor turns where the flight should be."""
    if not any(motion.rotor_speed[a:b].any() for a, b in motion.stretches):
        raise FlightError(
            "the motors never turn in this log (rotor speed or command is zero throughout); "
            "give the log of a flight, or the columns that hold the motors"
        )


def refuse_coarse_speeds(
    speed: Float[np.ndarray, "n N"], flights: Sequence[tuple[int, int]], step: float
) -> None:
    """Raise an error if measured speeds come in steps that hide what the rotors do in flight."""
    words = coarse_speeds_sentence(np.concatenate([speed[a:b] for a, b in flights]), step)
    if words is not None:
        raise FlightError(words)


def refuse_interpolated_speeds(speed: Float[np.ndarray, "n N"], sample_rate: float) -> None:
    """Raise an error if lines were drawn between measured rotor speeds that came too slowly."""
    rate = slowest_source_rate(speed, sample_rate)
    # Lines pass by the peaks: at a third of the source's rate a third of the motion is missing.
    if rate is None or rate >= SLOWEST_MOTORS:
        return
    # Steps of a fixed length have a rhythm, too.
    raise FlightError(
        halved_speed_sentence(speed)
        or f"the rotor speeds come at {rate:.0f} Hz, and lines are drawn (or values repeated) "
        "between them: the peaks of quick motion are missing, and kt and inertia would come out "
        "wrong; log ESC telemetry faster (100 Hz and more are good), or take the commands instead "
        '([motors] speed = "commanded")'
    )


def refuse_interpolated_commands(
    command: Float[np.ndarray, "n N"], sample_rate: float, motor_rate: float
) -> None:
    """Raise an error if a recorder drew lines between commands; `motor_rate`: of its rows [Hz]."""
    rate = source_rate(command, sample_rate)
    # Where the rows themselves come so slowly, the lines are those of `on_one_clock`; commands in
    # steps may be what the motors were told.
    if rate is None or rate >= SLOWEST_MOTORS or motor_rate < 2.0 * rate:
        return
    if _in_steps(command, samples=rate / sample_rate):
        return
    raise FlightError(
        f"the motors' commands come at {rate:.0f} Hz, and lines are drawn between them: the peaks "
        "of quick motion are missing, and kt and inertia would come out wrong; log the motor "
        "outputs faster (100 Hz and more are good)"
    )


def _in_steps(command: Float[np.ndarray, "n N"], *, samples: float) -> bool:
    """Return whether as many rows as a source has `samples` (a share) make most of the changes."""
    changes = np.sort(np.abs(np.diff(command, axis=0)).sum(axis=1))[::-1]
    count = max(round(samples * len(changes)), 1)
    return float(changes[:count].sum()) > IN_STEPS * float(changes.sum())


def refuse_wrong_gravity(motion: Motion, *, takes_columns: bool) -> None:
    """Raise unless the thrust points along +z and has the size of the weight."""
    fast = fast_rows(motion, motion.thrust)
    force = np.median(motion.specific_force[fast], axis=0).astype(float)
    size = float(np.linalg.norm(force))
    seen = (
        f"the median specific force where the rotors push is ({force[0]:.2f}, {force[1]:.2f}, "
        f"{force[2]:.2f}) m/s^2"
    )
    if size < NO_GRAVITY:
        raise FlightError(
            f"{seen}, no weight at all: an accelerometer at rest shows gravity, which was taken "
            "out of this one; log the raw accelerometer"
        )
    if force[2] < -0.7 * size:
        raise FrameError(
            f"{seen}, but along the thrust (z up) it must be positive; these are FRD axes: "
            f"{FRD_DECLARED if takes_columns else AS_A_TABLE}"
        )
    if force[2] < 0.7 * size:
        axis = "xyz"[int(np.argmax(np.abs(force)))]
        raise FrameError(
            f"{seen}, mostly along {axis} instead of z (up along the thrust); the IMU is "
            f"mounted turned: {TURN_AXES if takes_columns else AS_A_TABLE}"
        )
    if size < 0.3 * GRAVITY:
        raise FlightError(
            f"{seen}, a tenth of gravity where about {GRAVITY:.1f} is expected: it looks like "
            f"units of g: {UNIT_OF_ACCEL if takes_columns else AS_A_TABLE}"
        )
    if size > 3.0 * GRAVITY:
        raise FlightError(
            f"{seen}, {size / GRAVITY:.0f} times gravity where about {GRAVITY:.1f} m/s^2 is "
            "expected; check the accelerometer's unit and scale"
            f"{' in the columns map' if takes_columns else f': {AS_A_TABLE}'}"
        )


def frozen_channel_doubts(
    frozen: tuple[FrozenChannel, ...], time: Float[np.ndarray, " n"], *, measured: bool
) -> tuple[Finding, ...]:
    """Find each motor channel that freezes for a moment; raise an error if one does for long."""
    if any(rotor.share > MOST_FROZEN for rotor in frozen):
        worst = max(frozen, key=lambda rotor: rotor.share)
        raise FlightError(_frozen_message(worst, time, measured=measured))
    return tuple(
        doubt("frozen-motor", _frozen_message(rotor, time, measured=measured))
        for rotor in frozen
        if rotor.share >= LEAST_FROZEN
    )


def _frozen_message(rotor: FrozenChannel, time: Float[np.ndarray, " n"], *, measured: bool) -> str:
    a, b = rotor.rows
    what, unit = ("measured speed", " rad/s") if measured else ("command", "")
    cause = "its ESC telemetry is dead or stuck" if measured else "another output drives this motor"
    remedy = "repair it" if measured else "log or name the right column"
    other = ' or take logged commands (speed = "commanded" under [motors])' if measured else ""
    part = "" if rotor.share > 0.9 else "; or leave that part out with start and end"
    return (
        f"the {what} of rotor {rotor.rotor} stays at {rotor.value:g}{unit} for "
        f"{100.0 * rotor.share:.0f} % of the flight while the others move (at the longest from "
        f"{time[a] - time[0]:.1f} to {time[b - 1] - time[0]:.1f} s): {cause}; {remedy}{other}{part}"
    )


@contextlib.contextmanager
def explained_by_slow_motors(motor_rate: float) -> Generator[None, None, None]:
    """Name slow motor data [Hz] as the reason where no flight is found in them."""
    try:
        yield
    except FlightError as error:
        if motor_rate >= SLOWEST_MOTORS:
            raise
        raise FlightError(
            f"motor data come at {motor_rate:.0f} Hz, too slow to tell flight from ground and to "
            "find inertia (100 Hz and more are good): log motors faster (PX4: bit 4 of "
            "SDLOG_PROFILE); this log can give thrust at most, and only with start and end of "
            "the flight (--start, --end)"
        ) from error


def imu_doubts(
    data: FlightData, uniform: UniformChannels, bias: tuple[float, float, float] | None
) -> Iterator[Finding]:
    """Find gyro bias, slow motor data and what `flight_doubts` finds."""
    if bias is None:
        yield doubt(
            "gyro-bias",
            "no 1 s at rest found; gyro bias not removed: leave the vehicle still on the ground "
            "for two seconds before take-off",
        )
    elif max(map(abs, bias)) > 0.1:
        yield doubt(
            "gyro-bias",
            f"the gyro reads up to {max(map(abs, bias)):.2f} rad/s at rest (taken off); "
            "calibrate it",
        )
    motor_rate, gyro_rate = uniform.rates["motor"], uniform.rates["gyro"]
    if motor_rate < min(0.4 * gyro_rate, ENOUGH_RATE):
        yield doubt(
            "slow-motor-data",
            f"motor data come at {motor_rate:.0f} Hz, the gyro at {gyro_rate:.0f} Hz: fast "
            f"motion is used only up to {0.4 * motor_rate:.0f} Hz; log motors faster",
        )
    yield from flight_doubts(data)


def flight_doubts(data: FlightData) -> Iterator[Finding]:
    """Find thrust and speed outside the model's range, whatever measured the flight."""
    rows = data.used_rows
    yield from _thrust_doubts(data.rotor_speed[rows])
    if data.velocity is not None:
        yield from _speed_doubts(data.velocity[rows])


def _thrust_doubts(rotor_speed: Float[np.ndarray, "n N"]) -> Iterator[Finding]:
    """Find thrust outside the near-hover scope of the model."""
    thrust: Float[np.ndarray, " n"] = np.einsum("nr,nr->n", rotor_speed, rotor_speed)
    hover = float(np.median(thrust))
    far = float(((thrust > 1.8 * hover) | (thrust < 0.3 * hover)).mean())
    if far > 0.1:
        yield doubt(
            "thrust-range",
            f"thrust is outside 0.3 to 1.8 times hover for {100 * far:.0f} % of the flight: fast "
            "climbs and falls change the airflow through the rotors, which the model leaves out",
        )


def _speed_doubts(velocity: Float[np.ndarray, "n 3"]) -> Iterator[Finding]:
    """Find flight so fast that drag counts."""
    speed = np.sqrt((velocity * velocity).sum(axis=1))
    known = speed[np.isfinite(speed)]
    fast = float(np.percentile(known, 95)) if len(known) else 0.0
    if fast > 5.0:
        yield doubt(
            "fast-flight",
            f"the vehicle flies at up to {fast:.1f} m/s; over 5 m/s the air changes thrust and "
            "torque, which the model has to first order only (terms drag, inflow): use a slower "
            "part of the flight, if there is one",
        )
