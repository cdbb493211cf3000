"""Name the numbers that rest on a channel of which the reader or the preparation complains.

The rooms below the model know channels but no parameters. Here each kind of their findings, and of
the checks' findings that name no number themselves, gets the numbers that it touches; those that
the channel makes wrong become doubtful.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.findings import Finding, doubt
from rotorfit.flight.flight_checks import MOVING, STEPS, FrozenChannel, frozen_channels
from rotorfit.flight.motors.rotor_telemetry import (
    RotorTelemetry,
    State,
    Telemetry,
    describe_spiky_commands,
    describe_stray_commands,
    late_speed_sentence,
    telemetry,
)
from rotorfit.flight.motors.telemetry_pair import (
    FEWEST,
    mark_stray_commands,
    mend_stray_commands,
    pair_channels,
)
from rotorfit.flight.signals import true_runs
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import (
    COM,
    FIRST_MOMENTS,
    INERTIA,
    INERTIA_COM,
    NUISANCE,
    PARAMETERS,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from rotorfit.errors import FlightError
    from rotorfit.logs.flight_log import FlightLog

BY_ROTORS: Final = tuple(name for name in PARAMETERS if name not in (*NUISANCE, "mass"))
"""Numbers that rest on what the rotors do: all but the declared mass and the sensors' biases."""
BY_TURNS: Final = ("kd", "Jr", *INERTIA, *INERTIA_COM, *COM, "motor_lag", "motor_delay")
"""Numbers that rest on quick turns."""
BY_CLOCK: Final = (
    *BY_TURNS,
    *("kd_over_kt", "kd_over_Izz", "Jr_over_Izz"),
    *("Ixx_over_kt", "Iyy_over_kt", "Izz_over_kt"),
)
"""Numbers that rest on the seconds of the log."""
BY_YAW: Final = (
    *("Jr", "kd", "Izz", "Izz_com"),
    *("kd_over_kt", "kd_over_Izz", "Jr_over_Izz", "Izz_over_kt"),
)
"""Numbers that rest on the turn about z."""
BY_PLACE: Final = (*COM, *FIRST_MOMENTS, *INERTIA, *INERTIA_COM)
"""Numbers that rest on the direction of the specific force."""
BY_THRUST: Final = ("kt", "hover_speed", "max_thrust", "thrust_to_weight")
"""Numbers that rest on the size of the thrust."""
BY_PROPELLERS: Final = tuple(
    dict.fromkeys((*BY_ROTORS, *BY_CLOCK, *BY_YAW, *BY_THRUST, "motor_imbalance"))
)
"""Numbers that are wrong where a propeller changes in flight."""
BY_COMMANDS: Final = (
    "max_speed",
    "max_thrust",
    "thrust_to_weight",
    "hover_throttle",
    "motor_lag",
    "command_delay",
)
"""Numbers of motors whose speed is measured that rest on their commands."""

SPIKY: Final = "command-spikes"
"""Kind of the finding that commands jump for single samples."""
STUCK: Final = "stuck-speed"
"""Kind of the finding that a measured speed is lost now and then."""
LATE: Final = "late-speed"
"""Kind of the finding that one rotor's speed comes later than the others'."""
FROZEN: Final = "frozen-motor"
"""Kind of the finding that a motor channel stands still."""
FROZEN_COMMAND: Final = "frozen-command"
"""Kind of the finding that a command stands still beside a measured speed that moves."""
LOST: Final = "a motor channel does not show what its rotor does"
LONGEST_STRAY: Final = 0.025
"""Step of commands below which one of a single sample moves no rotor [s]: motors lag by 20 to 90
ms. Where commands come more slowly, one that jumps may have been flown."""
MEND: Final = "repair the motor channel that stands still, or leave that part out (--start, --end)"


@frozen_dataclass
class RestsOn:
    """What rests on the channel that a kind of finding is about.

    - `numbers`: names of the numbers.
    - `doubtful_because`: why they may be outside their intervals; None where the intervals hold.
    - `next_step`: what to do before more flying; None where the sentence says enough.
    """

    numbers: tuple[str, ...]
    doubtful_because: str | None = None
    next_step: str | None = None


RESTS_ON: Final[Mapping[str, RestsOn]] = {
    FROZEN: RestsOn(numbers=BY_ROTORS, doubtful_because=LOST, next_step=MEND),
    SPIKY: RestsOn(numbers=BY_COMMANDS),
    FROZEN_COMMAND: RestsOn(
        numbers=BY_COMMANDS,
        doubtful_because="a command stands still while its rotor's speed moves",
    ),
    STUCK: RestsOn(numbers=BY_ROTORS, doubtful_because=LOST, next_step=MEND),
    LATE: RestsOn(
        numbers=BY_TURNS, doubtful_because="one rotor's speed is recorded at another time"
    ),
    "many-gaps": RestsOn(numbers=BY_ROTORS),
    "replaced-samples": RestsOn(numbers=BY_ROTORS),
    "interpolated-imu": RestsOn(
        numbers=BY_ROTORS,
        doubtful_because="the IMU was recorded more slowly than it is written",
    ),
    "rows-written-twice": RestsOn(
        numbers=BY_CLOCK,
        doubtful_because="repeated rows stretch the clock of the log",
    ),
    "arrival-times": RestsOn(
        numbers=("motor_delay", "command_delay"),
        doubtful_because="samples have the times of their arrival",
    ),
    "accelerometer-axes": RestsOn(
        numbers=BY_PLACE, doubtful_because="the accelerometer's x and y contradict the drag"
    ),
    "yaw-lowpass": RestsOn(numbers=BY_YAW, doubtful_because="the yaw gyro alone is filtered"),
    "gyro-bias": RestsOn(numbers=BY_TURNS),
    "slow-motor-data": RestsOn(numbers=BY_TURNS),
    "slow-cameras": RestsOn(numbers=BY_TURNS),
    "irregular-frames": RestsOn(numbers=BY_TURNS),
    "mended-frames": RestsOn(numbers=BY_ROTORS),
    "poor-alignment": RestsOn(numbers=BY_ROTORS),
    "thrust-range": RestsOn(numbers=BY_THRUST),
    "fast-flight": RestsOn(numbers=BY_ROTORS),
    "on-the-ground": RestsOn(numbers=BY_ROTORS),
    "slow-rotors": RestsOn(numbers=BY_ROTORS),
    "beyond-law": RestsOn(numbers=BY_ROTORS),
    "falling-law": RestsOn(numbers=BY_ROTORS),
    "speed-asked-for": RestsOn(
        numbers=(*BY_CLOCK, *BY_THRUST),
        doubtful_because="the speeds are those asked for, which the motors reach later or never",
        next_step="record the measured rotor speeds",
    ),
    "several-vehicles": RestsOn(numbers=BY_ROTORS),
    "unlike-clocks": RestsOn(
        numbers=("motor_delay", "command_delay"),
        doubtful_because="gyro and motors have times of two kinds",
    ),
    "unclear-outputs": RestsOn(numbers=BY_ROTORS),
    "other-units": RestsOn(numbers=BY_ROTORS),
    "slow-log": RestsOn(numbers=BY_TURNS),
    "sensor-saturated": RestsOn(numbers=BY_PROPELLERS),
    "sensor-response": RestsOn(numbers=BY_ROTORS),
    "accelerometer-against-gravity": RestsOn(numbers=BY_ROTORS),
    "gyro-scale": RestsOn(numbers=BY_TURNS),
    "residual-peak": RestsOn(numbers=BY_TURNS),
    "rotor-changed": RestsOn(numbers=BY_PROPELLERS),
    "hovers-differ": RestsOn(numbers=BY_THRUST),
    # What rests on thrust has the change between halves of a flight in its intervals.
    "thrust-jumps": RestsOn(
        numbers=BY_YAW, doubtful_because="the scale of the rotor speeds may change in flight"
    ),
    "thrust-sags": RestsOn(numbers=(*BY_THRUST, "accel_bias_z")),
    "force-by-height": RestsOn(numbers=BY_THRUST),
}
"""Every kind of finding about a channel whose maker names no numbers; a test over all of the source
compares the two."""

CONTRADICTED: Final[tuple[State, ...]] = (
    "dead",
    "swapped",
    "apart",
    "unlike",
    "stuck",
    "coarse",
)
"""States of a measured speed that explain why a flight makes no sense."""


def name_resting_numbers(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings with the numbers that rest on their channels; those that name some stay."""
    return tuple(_with_numbers(one) for one in findings)


def _with_numbers(finding: Finding) -> Finding:
    rests = RESTS_ON.get(finding.kind)
    if rests is None or finding.numbers:
        return finding
    return dataclasses.replace(
        finding,
        numbers=rests.numbers,
        doubtful_because=finding.doubtful_because or rests.doubtful_because,
        next_step=finding.next_step or rests.next_step,
    )


def find_motor_faults(
    log: FlightLog, flown: Sequence[tuple[float, float]], known: Iterable[Finding]
) -> Iterator[Finding]:
    """Yield doubts about lost speeds, and about commands that jump, in the part that is used.

    Of commands alone, those that are mended. `flown`: from, to of the used stretches, on the clock
    of the log [s]. `known`: findings of the flight; where they name a frozen channel the same is
    not reported twice.
    """
    flown_log = _log_between(log, flown) if flown else None
    if flown_log is not None and "rotor_speed" not in flown_log.channels:
        strays = mark_stray_commands(flown_log.channels["command"])
        yield from (doubt(SPIKY, one) for one in describe_stray_commands(strays))
        return
    if flown_log is not None and "command" in flown_log.channels:
        spiky = describe_spiky_commands(flown_log.channels["command"])
        yield from (doubt(SPIKY, one) for one in spiky)
        yield from (doubt(FROZEN_COMMAND, one) for one in frozen_command_sentences(flown_log))
    seen = None if flown_log is None else telemetry(flown_log)
    if seen is None or any(one.kind == FROZEN for one in known):
        return
    for rotor in seen.rotors:
        if rotor.state == "stuck":
            yield doubt(
                STUCK,
                lost_speed_sentence(rotor),
                next_step=f"repair the ESC telemetry of rotor {rotor.rotor}",
                doubtful_because=f"the measured speed of rotor {rotor.rotor} is lost now and then",
            )
        elif rotor.state == "late":
            yield doubt(LATE, late_speed_sentence(rotor))


def frozen_command_sentences(log: FlightLog) -> list[str]:
    """Explain which commands stand still while the measured speeds of their rotors move."""
    if "rotor_speed" not in log.channels:
        return []
    pair = pair_channels(mend_stray_commands(log.channels["command"]), log.channels["rotor_speed"])
    if pair is None or pair.command.shape != pair.speed.shape or not pair.used.any():
        return []
    steady = np.round(pair.command, 9)  # means of a constant differ by rounding
    # Where a command rests at its end, the speed of its rotor does, too: no end is left out here.
    found = frozen_channels(steady, true_runs(pair.used), pair.rate, may_rest=False)
    usual = pair.speed[pair.used].std(axis=0)
    return [
        frozen_command_sentence(one)
        for one in found
        for speed in [pair.speed[slice(*one.rows), one.rotor - 1]]
        if speed.std() > MOVING * usual[one.rotor - 1] and speed.std() > STEPS * pair.speed_step
    ]


def frozen_command_sentence(frozen: FrozenChannel) -> str:
    """Say for how much of the flight a command stands still beside a moving speed."""
    return (
        f"the command of rotor {frozen.rotor} stays at {frozen.value:.3g} for "
        f"{100.0 * frozen.share:.0f} % of the flight while the measured speed of that rotor moves: "
        "thrust at full command and the motors' lag rest on it; log all commands again"
    )


def has_quick_commands(log: FlightLog) -> bool:
    """Return whether no rotor could follow a command of the log for a single sample."""
    command = log.channels.get("command")
    if command is None or len(command.time) < FEWEST:
        return False
    return float(np.median(np.diff(command.time))) < LONGEST_STRAY


def with_mended_commands(log: FlightLog) -> FlightLog:
    """Return the log without stray values in its commands."""
    mended = mend_stray_commands(log.channels["command"])
    return dataclasses.replace(log, channels={**log.channels, "command": mended})


def motor_channels_of(log: FlightLog, *, measured: bool) -> FlightLog:
    """Return the log with its commands alone, or with the `measured` speeds beside them."""
    names = ("command", "rotor_speed") if measured else ("command",)
    kept = {name: channel for name, channel in log.channels.items() if name in names}
    return dataclasses.replace(log, channels=kept)


def _log_between(log: FlightLog, flown: Sequence[tuple[float, float]]) -> FlightLog:
    """Return the log with the motors' channels between the first and the last used moment."""
    begin, end = min(a for a, _ in flown), max(b for _, b in flown)
    cut = {
        name: dataclasses.replace(c, time=c.time[inside], values=c.values[inside])
        for name, c in log.channels.items()
        for inside in [(c.time >= begin) & (c.time <= end)]
    }
    return dataclasses.replace(log, channels=cut)


def lost_speed_sentence(rotor: RotorTelemetry) -> str:
    """Say for how much of the time a measured speed is lost, and what to do."""
    return (
        f"the measured speed of rotor {rotor.rotor} is stuck or zero for "
        f"{100.0 * rotor.stuck:.0f} % of the time while the rotor turns: repair its ESC telemetry, "
        'or take the commands (speed = "commanded" under [motors])'
    )


def blame_telemetry(error: FlightError, seen: Telemetry | None) -> FlightError:
    """Return the error with the lost or wrong speeds as its cause, where the telemetry has some."""
    # A rotor that reads zero in the air looks like a vehicle whose acceleration does not follow its
    # rotors.
    if seen is None or not any(one.state in CONTRADICTED for one in seen.rotors):
        return error
    sentences = "; ".join(seen.doubts)
    return type(error)(f"{sentences}; therefore the flight cannot be used")
