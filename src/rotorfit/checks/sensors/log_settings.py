"""Check that the log has the signals and rates that the numbers need."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.verdicts.judge import WEAK
from rotorfit.findings import Finding, note
from rotorfit.fit.intervals.numbers import NO_EXCITATION
from rotorfit.flight.flight_checks import ENOUGH_RATE, LEAST_RATE
from rotorfit.logs.firmware import (
    FIRMWARE,
    NO_SPEED,
    SLOW_IMU,
    SLOW_MOTORS,
    Lack,
    Setting,
    advice_for,
)
from rotorfit.logs.flight_log import LEAVES_OUT, FlightLog
from rotorfit.model.parameters import EVERY
from rotorfit.model.terms.rotors import ROTOR_SPREAD

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rotorfit.fit.dataset.dataset import LoadedFlight
    from rotorfit.fit.fit import Fit
    from rotorfit.flight.prepare import PreparedFlight

TOO_SLOW: Final = "log-too-slow"
NO_ROTOR_SPEED: Final = "no-rotor-speed"
NOT_SIMULATED: Final = "not-simulated"
NO_INERTIA: Final = "no rotor inertia"
FAST: Final = tuple(
    name
    for name, info in EVERY.items()
    if info.motion in ("roll", "pitch", "yaw", "height", "place")
    or name.startswith("motor_")
    or name in ROTOR_SPREAD.parameters
)
"""Numbers that show in quick motion."""
USE_SPEED: Final = (
    'use the rotor speed that the log has: write speed = "measured" under [motors] '
    "(or --speed measured)"
)
SPEED_OR_LAW: Final = (
    "log the rotor speed, or measure the motors' law and lag and give them under [motors]"
)
"""What shows more where commands explain quick turns and not a pilot's: another flight does not."""
CLEAR: Final = WEAK / 1.96
"""Formal deviation of an inertia over its value, up to which quick turns follow the commands."""
BY_SPEED: Final = ("kt", "kd", "Jr", "Ixx", "Iyy", "Izz", "motor_lag", "motor_delay")


def slow_log(fit: Fit) -> Iterator[Finding]:
    """Name the settings without which no flying shows inertia: motors or IMU are too slow."""
    # Motion capture has no such settings; what it lacks in rate is said where it is read.
    by_imu = fit.dataset.source == "imu"
    for flight in fit.dataset.flights if by_imu else _commanded_flights(fit):
        step = faster_log(flight.log, flight.prepared)
        if step is not None:
            because = slow_words(flight.prepared)
            yield note(TOO_SLOW, "", numbers=FAST, next_step=step, useless_because=because)
            return


def unlogged_speed(fit: Fit) -> Iterator[Finding]:
    """Name the settings with which the log has the rotors' speed, or what stands for it."""
    # Where the firmware has no setting for it, that is asked for only if commands fail to explain
    # the turns that a pilot flies.
    hidden = SPEED_OR_LAW if _has_unexplained_turns(fit) else None
    for flight in _commanded_flights(fit):
        step = log_with_speed(flight.log, flight.prepared) or hidden
        if step is not None:
            yield note(NO_ROTOR_SPEED, "", numbers=BY_SPEED, next_step=step)
            return


def absent_in_simulator(fit: Fit) -> Iterator[Finding]:
    """Note that a simulator has no rotor inertia, which no flight in it can show."""
    simulators = {flight.log.metadata.get("Simulator", "") for flight in fit.dataset.flights}
    if any(NO_INERTIA in LEAVES_OUT.get(name, "") for name in simulators):
        because = f"the simulator has {NO_INERTIA}"
        step = "nothing to fly in this simulator"
        yield note(NOT_SIMULATED, "", numbers=("Jr",), next_step=step, useless_because=because)


def faster_log(log: FlightLog, prepared: PreparedFlight) -> str | None:
    """State how to log motors and IMU faster; None if they are fast enough for inertia."""
    if prepared.slowest_rate >= LEAST_RATE:
        return None
    slow_imu = prepared.data.sample_rate < ENOUGH_RATE
    wanted = better_log(log, SLOW_MOTORS | SLOW_IMU if slow_imu else SLOW_MOTORS)
    plain = f"log gyro, accelerometer and motors {ENOUGH_RATE:.0f} times a second or faster"
    return wanted or f"{plain}, then fly again"


def better_log(log: FlightLog, lacks: frozenset[Lack]) -> str | None:
    """Advise the settings for what a log lacks; None if the firmware has none."""
    found = advice_for(log.format, lacks, log.metadata)
    if found is None or not found.settings:
        return None
    named = [s for s in found.settings if s.name != FIRMWARE]
    lines = [_whole_line(s) for s in named if s.name.endswith(":")]
    pairs = [_setting_text(s) for s in named if not s.name.endswith(":")]
    steps = [f"flash {s.value}" for s in found.settings if s.name == FIRMWARE]
    steps += [*lines, *([f"set {', '.join(pairs)}"] if pairs else [])]
    written = any(s.new for s in found.settings)
    file = f" (as a file: rotorfit settings {log.as_argument})" if written else ""
    remarks = [remark for s in named if (remark := s.why.partition(". ")[2])]
    return ". ".join([f"{', then '.join(steps)}{file}, then fly again", *remarks])


def slow_words(prepared: PreparedFlight) -> str:
    """Explain why a slow log makes flying useless."""
    return f"a log at {prepared.slowest_rate:.0f} Hz shows no quick motion, whatever is flown"


def log_with_speed(log: FlightLog, prepared: PreparedFlight) -> str | None:
    """State how to log the rotors' speed; None if the firmware has no setting for it."""
    # A log that has it already asks for nothing but to use it; one that is slow is made faster,
    # too.
    if "rotor_speed" in log.channels:
        return USE_SPEED
    slow = prepared.slowest_rate < ENOUGH_RATE
    if better_log(log, NO_SPEED) is None:
        return None
    wanted = better_log(log, NO_SPEED | SLOW_MOTORS | SLOW_IMU if slow else NO_SPEED)
    also = ", and all of it faster" if slow else ""
    return f"log the rotor speed{also}: {wanted}"


def _commanded_flights(fit: Fit) -> list[LoadedFlight]:
    return fit.dataset.flights if fit.dataset.motors.speed == "commanded" else []


def _has_unexplained_turns(fit: Fit) -> bool:
    """Return whether the motors explain quick turns about x and y, and none in the pilot's band."""
    ratios = [
        rho
        for key, rho in fit.numbers.excitation.items()
        if key.partition("@")[0] in ("roll", "pitch")
    ]
    found = fit.estimate.estimate
    inertia = np.array([name.partition("@")[0] in ("Ixx", "Iyy") for name in found.names])
    clear = found.std[inertia] < CLEAR * np.abs(found.values[inertia])
    return max(ratios, default=np.inf) <= NO_EXCITATION and bool(clear.any())


def _setting_text(setting: Setting) -> str:
    """Write a setting and its value; bits in words where the value that has them is not known."""
    if setting.new is None and setting.value.startswith("what"):
        return f"{setting.name} to {setting.value}"
    return f"{setting.name} = {setting.new or setting.value}"


def _whole_line(setting: Setting) -> str:
    """State where a line of a file or a CLI goes."""
    if setting.name == "CLI:":
        return f"enter {setting.value!r} in the CLI"
    return f"add {setting.value} to {setting.name.strip(':')}"


CHECKS: Final = (slow_log, unlogged_speed, absent_in_simulator)
