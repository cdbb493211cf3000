"""The type every log reader returns: channels on their own clocks, in SI units and FLU axes."""

from __future__ import annotations

import shlex
from dataclasses import field
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.errors import LogError
from rotorfit.findings import Finding, sentences
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.formats import BY_NAME
from rotorfit.sheet import DataFrame, Sheet, frame, pandas, sheet_html, sheet_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from jaxtyping import Bool, Float, Shaped

    from rotorfit.logs.motor_law import MotorLaw

CHANNELS: Final[dict[str, tuple[int | None, str]]] = {
    "gyro": (3, "rad/s"),
    "accel": (3, "m/s^2"),
    "rotor_speed": (None, "rad/s"),
    "command": (None, "1"),
    "battery": (1, "V"),
    "velocity": (3, "m/s"),
    "reference": (3, "rad/s"),
    "position": (3, "m"),
    "attitude": (4, "1"),
}
"""Name of each channel: number of columns (None: one per rotor) and unit.

``gyro``
    Angular velocity of the body relative to the world, body axes FLU.
``accel``
    Specific force (acceleration minus gravity: +9.81 along z at rest), body axes FLU.
``rotor_speed``
    Measured, magnitude without sign, in the log's motor order.
``command``
    Commanded motor output, 0 (stopped) to 1 (full), in the log's motor order.
``velocity``
    Of the body relative to the air or ground, body axes FLU.
``reference``
    Angular velocity that the pilot or the mission asked for, body axes FLU.
``position``
    Of the body origin, world axes with z up.
``attitude``
    Rotation of body (FLU) to world (z up) as a unit quaternion w, x, y, z.
"""


COMPONENTS: Final = {3: ("x", "y", "z"), 4: ("w", "x", "y", "z")}
"""Components of vectors and quaternions; rotors are counted from 1."""
AS_A_TABLE: Final = (
    "logs of this format carry their own units and axes, and take no columns map: correct them "
    "where the log is made, or export the log as a CSV table (docs/logs.md) and declare them there"
)


LONG: Final = 32_768
"""Rows that are worked on at a time: a longer log would fill the memory with what is between."""


def grid_step(values: Float[np.ndarray, " n"], *, fewest: int, rounding: float) -> float | None:
    """Return the step of the grid on which finite values lie; None if they lie on none.

    `fewest`: levels that show a grid. `rounding`: share of the largest value by which two values
    of one level may differ.
    """
    levels = np.unique(values)
    if len(levels) < fewest:
        return None
    with np.errstate(over="ignore"):
        steps = levels[1:] - levels[:-1]
        steps = steps[steps > rounding * float(np.max(np.abs(levels)))]
        if len(steps) < fewest - 1:
            return None
        multiples = steps / np.min(steps)
    if not np.isfinite(multiples).all():
        return None
    # To a tenth of a step, since converters round.
    on_grid = np.abs(multiples - np.rint(multiples)) < 0.1
    return float(np.min(steps)) if np.mean(on_grid) > 0.95 else None


def pieces(count: int, *, longest: int = LONG) -> list[slice]:
    """Return rows 0 to `count` in pieces no longer than `longest`."""
    return [slice(a, min(a + longest, count)) for a in range(0, count, longest)]


def in_order(stamps: Shaped[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Select the samples to keep, so that time never goes back."""
    early = stamps < np.maximum.accumulate(stamps)
    if not early.any():
        return ~early
    late = stamps > np.minimum.accumulate(stamps[::-1])[::-1]
    # A wrong time is either too early or too late: left out are those earlier than one before, or
    # those later than one after, whichever are fewer.
    return ~early if np.count_nonzero(early) <= np.count_nonzero(late) else ~late


@frozen_dataclass
class Channel:
    """One recorded quantity on its own clock.

    Attributes
    ----------
    time
        Clock of this channel as recorded, not repaired [s].
    values
        One row per sample, one column per component, in the SI unit and axes of `CHANNELS`.
        Samples the log does not have are NaN.
    source
        Where it came from, in the log's own words: field names, units, scale.
    resolution
        Smallest step the log can express, in the channel's unit; None if unknown.
    """

    time: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n k"]
    source: str
    resolution: float | None = None


LagOn = Literal["speed", "thrust"]
"""What of a motor follows its command with a first-order lag."""


@frozen_dataclass
class LoggedMotors:
    """What the autopilot's parameters say of the motors; `words` names the parameters.

    `lag_on`: None where they say nothing of it.
    """

    law: MotorLaw
    words: str
    lag_on: LagOn | None = None


AIR_CONSTANT: Final = 287.05
"""Gas constant of dry air [J/(kg K)]."""


@frozen_dataclass
class Circumstances:
    """Vehicle, start time and air of a log; None for what the log does not have.

    - `hardware`: the autopilot's own number; empty where the log has none.
    - `started`: when the log began, seconds since 1970 (UTC).
    - `air_pressure`, `air_temperature`: medians over the log [Pa], [K], as the barometer's chip has
      them: in its housing it is some degrees warmer than the air.
    """

    hardware: str = ""
    started: float | None = None
    air_pressure: float | None = None
    air_temperature: float | None = None

    @property
    def air_density(self) -> float | None:
        """Of dry air [kg/m^3]."""
        if self.air_pressure is None or self.air_temperature is None:
            return None
        return self.air_pressure / (AIR_CONSTANT * self.air_temperature)


def in_air(
    pressure: Float[np.ndarray, " n"], temperature: Float[np.ndarray, " n"]
) -> tuple[float | None, float | None]:
    """Compute the medians of pressure [Pa] and temperature [K] where they can be those of air."""
    good = (pressure > 2e4) & (pressure < 1.2e5) & (temperature > 220.0) & (temperature < 350.0)
    if not good.any():
        return None, None
    return float(np.median(pressure[good])), float(np.median(temperature[good]))


def seconds_of(channels: Iterable[Channel]) -> float:
    """Compute the time from the first to the last sample of any channel [s]; 0 without samples."""
    times = [channel.time for channel in channels if len(channel.time)]
    return float(max(t[-1] for t in times) - min(t[0] for t in times)) if times else 0.0


@frozen_dataclass
class FlightLog:
    """One log of one flight, as a reader found it.

    Attributes
    ----------
    path
        The file.
    sha256
        Of the whole file, hexadecimal.
    format
        Name of the reader, such as ``"blackbox"`` or ``"table"``.
    channels
        By the names of `CHANNELS`; only those that the log has.
    log_number, logs_in_file
        Which log of the file this is (from 1), and how many there are.
    seconds
        Time between the first and the last sample of the log [s].
    metadata
        What the log says of vehicle, firmware and settings; for people to read.
    notes
        What the reader met and did, one sentence each (fields taken or left out).
    findings
        What was damaged and passed over, or is doubtful; part of every result.
    simulator
        Which simulator flew, of `LEAVES_OUT`; empty for a vehicle, or where unknown.
    motors
        What its parameters say of the motors; None if they say nothing that can be relied on.
    gyro_lowpass
        Cut-off of the low-pass on board that the samples of the gyro went through [Hz]; None if
        there is none, or it is not known.
    circumstances
        Whose log it is, when it began, in what air.
    """

    path: Path
    sha256: str
    format: str
    channels: Mapping[str, Channel]
    log_number: int = 1
    logs_in_file: int = 1
    seconds: float
    metadata: Mapping[str, str] = field(default_factory=dict[str, str])
    notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    simulator: str = ""
    motors: LoggedMotors | None = None
    gyro_lowpass: float | None = None
    circumstances: Circumstances = Circumstances()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to doubt of the log, one sentence each: those of the findings."""
        return sentences(self.findings)

    @property
    def as_argument(self) -> str:
        """The log as a command takes it: its file, and which log of several."""
        several = f" --log {self.log_number}" if self.logs_in_file > 1 else ""
        return f"{shlex.quote(str(self.path))}{several}"

    @property
    def takes_columns(self) -> bool:
        """Whether a columns map names its columns and declares their units."""
        form = BY_NAME.get(self.format)
        return form is None or not form.names_fields

    def to_frame(self, channel: str | None = None) -> DataFrame:
        """Return channels as a pandas DataFrame, indexed by time [s].

        Parameters
        ----------
        channel
            One of `channels`; all of them if None. Each has its own clock: a row stands for every
            instant of any of them, NaN if a channel has no sample there.

        Raises
        ------
        LogError
            If the log does not have the channel.
        OutputError
            If pandas is not installed.
        """
        if channel is not None and channel not in self.channels:
            raise LogError(
                f"no channel {channel!r} in {self.path.name}; it has {', '.join(self.channels)}"
            )
        wanted = self.channels if channel is None else {channel: self.channels[channel]}
        frames = [
            frame(dict(zip(_column_names(name, c), c.values.T.tolist(), strict=True)))
            .assign(time=c.time)
            .groupby("time")
            .first()
            for name, c in wanted.items()
        ]
        return pandas().concat(frames, axis=1).sort_index()

    def __str__(self) -> str:
        return sheet_text(_tabulate_log(self))

    def _repr_html_(self) -> str:
        return sheet_html(_tabulate_log(self))


def _column_names(name: str, channel: Channel) -> list[str]:
    count = channel.values.shape[1]
    if count == 1:
        return [name]
    ends = COMPONENTS[count] if CHANNELS[name][0] else [str(i + 1) for i in range(count)]
    return [f"{name}_{end}" for end in ends]


def _tabulate_log(log: FlightLog) -> Sheet:
    """Tabulate a log: its channels and how often each was sampled."""
    which = f", log {log.log_number} of {log.logs_in_file}" if log.logs_in_file > 1 else ""
    return Sheet(
        heading=f"{log.path.name}{which}: {log.format}, {log.seconds:.1f} s",
        columns=("channel", "samples", "rate", "unit", "from"),
        rows=[
            (name, str(len(c.time)), _rate_words(c), CHANNELS[name][1].removeprefix("1"), c.source)
            for name, c in log.channels.items()
        ],
        remarks=log.warnings[:5],
        more=f"{len(log.warnings)} warnings; what this log can show:  rotorfit inspect "
        f"{log.path.name}",
    )


def _rate_words(channel: Channel) -> str:
    """Return the samples per second in words, from the middle step."""
    steps = np.diff(channel.time[np.isfinite(channel.time)])
    middle = float(np.median(steps)) if len(steps) else 0.0
    return f"{1.0 / middle:.4g} Hz" if middle > 0 else "-"


SIH: Final = "PX4 SIH"
GAZEBO: Final = "Gazebo under PX4"
PX4_OTHER: Final = "a simulator under PX4"
SITL: Final = "ArduPilot SITL"

LEAVES_OUT: Final[dict[str, str]] = {
    SIH: "the motors' lag acts in steps of its loop: it is SIH_T_TAU less half a step (2 ms at 250 "
    "Hz); no rotor inertia, no voltage, the CoM in the middle of the rotors, no air at the rotors "
    "(no inflow, and rotor_drag is its damping of yaw)",
    GAZEBO: "the motors' plugin has its own constants: rising and falling time, thrust, moment, "
    "rotor drag; no battery in the thrust",
    PX4_OTHER: "what it leaves out is not known here",
    SITL: "its own frames (not Gazebo and others behind it) turn by torque over inertia, axis by "
    "axis, without gyroscopic terms and products of inertia; no motor lag, no rotor inertia, "
    "and rotor_drag is its damping of yaw; yaw torque is proportional to command times thrust",
}
"""Effects that a simulator leaves out, by its name."""
DRAGLESS_ROTORS: Final = (SIH, SITL)
"""Simulators that damp a turn by another coefficient than they hold back the vehicle with: one drag
of the rotors for both would be none of theirs. Nor have they an induced velocity."""
AIRLESS_ROTORS: Final = (SIH,)
"""Simulators whose rotors feel no air: only a drag of the frame, and damping of turns."""


def simulated_sentence(simulator: str) -> str:
    """State that a flight is simulated, and what its simulator leaves out."""
    return f"flown in {simulator}, a simulator: {LEAVES_OUT[simulator]}"


def other_columns(log: FlightLog) -> str:
    """Advise on numbers that a table or recording may have under names that rotorfit lacks."""
    unknown = log.metadata.get("other topics")
    if log.format == "rosbag" and unknown:
        return (
            f". Where it is among the topics that rotorfit does not know ({unknown}), name it with "
            'a columns map, as rotor_1 = { name = "/TOPIC.path[0]", unit = "rad/s" }'
        )
    if log.format != "table":
        return ""
    proposed = f"rotorfit airframe {log.as_argument}"
    return f". If the table has other names for it, {proposed} proposes which is which"
