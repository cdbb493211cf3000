"""Does the log have what the numbers need? Where it is too slow, no flying helps: log it anew."""

from collections.abc import Iterator
from typing import Final

from rotorfit.dataset.dataset import LoadedFlight
from rotorfit.findings import Finding, note
from rotorfit.fit.fit import Fit
from rotorfit.logs.firmware import NO_SPEED, SLOW_IMU, SLOW_MOTORS, Lack, Setting, advice_for
from rotorfit.model.parameters import EVERY

TOO_SLOW: Final = "log-too-slow"
NO_ROTOR_SPEED: Final = "no-rotor-speed"
LEAST_RATE: Final = 40.0
"""Of commands and IMU, below which all of the motion is lost that inertia shows in [Hz]."""
WANTED_RATE: Final = 150.0
"""From which on nothing is lost [Hz]."""
FAST: Final = tuple(
    name
    for name, info in EVERY.items()
    if info.motion in ("roll", "pitch", "yaw", "height") or name.startswith("motor_")
)
"""Numbers that show in quick motion."""
BY_SPEED: Final = ("kt", "kd", "Jr", "Ixx", "Iyy", "Izz", "motor_lag", "motor_delay")


def slow_log(fit: Fit) -> Iterator[Finding]:
    """Name the settings without which no flying shows inertia: commands or IMU are too slow."""
    for flight in _commanded(fit):
        rate = flight.prepared.slowest_rate
        if rate < LEAST_RATE:
            slow_imu = flight.prepared.data.sample_rate < WANTED_RATE
            lacks = SLOW_MOTORS | SLOW_IMU if slow_imu else SLOW_MOTORS
            wanted = _settings(flight, lacks) or (
                f"log gyro, accelerometer and motors {WANTED_RATE:.0f} times a second or faster"
            )
            yield note(
                TOO_SLOW,
                "",
                numbers=FAST,
                next_step=f"{wanted}, then fly again",
                useless_because=f"{rate:.0f} Hz show no quick motion, whatever is flown",
            )
            return


def unlogged_speed(fit: Fit) -> Iterator[Finding]:
    """Name the settings with which the log has the rotors' speed, where the firmware has any."""
    for flight in _commanded(fit):
        wanted = _settings(flight, NO_SPEED)
        if wanted:
            step = f"log the rotor speed: {wanted}, then fly again"
            yield note(NO_ROTOR_SPEED, "", numbers=BY_SPEED, next_step=step)
            return


def _commanded(fit: Fit) -> list[LoadedFlight]:
    if fit.dataset.motors.speed != "commanded":
        return []
    return [flight for c in fit.dataset.configurations for flight in c.flights]


def _settings(flight: LoadedFlight, lacks: frozenset[Lack]) -> str:
    """List the settings that the log's firmware asks for, empty where it has none."""
    found = advice_for(flight.log.format, lacks, flight.log.metadata)
    if found is None or not found.settings:
        return ""
    file = " (rotorfit settings LOG writes the file)" if any(s.new for s in found.settings) else ""
    return f"set {', '.join(map(_phrase, found.settings))}{file}"


def _phrase(setting: Setting) -> str:
    head = f"{setting.name} " if setting.name.endswith(":") else f"{setting.name} = "
    return f"{head}{setting.new or setting.value}"


CHECKS: Final = (slow_log, unlogged_speed)
