"""Which settings of an autopilot make its next log a better one: one table each.

Sources: PX4 "Parameter Reference" (SDLOG_PROFILE, IMU_GYRO_CUTOFF, IMU_ACCEL_CUTOFF,
DSHOT_TEL_CFG, DSHOT_BIDIR_EN, UAVCAN_ENABLE); ArduPilot "Complete Parameter List" and
ArduCopter/defines.h (bits of LOG_BITMASK), "ESC Telemetry"; Betaflight 4.5 "CLI Command Line
Reference"; Bitcraze "Micro SD card deck".
"""

from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import Final

from rotorfit.flight.doctor import Lack


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """One setting, what it is for, and what in a log asks for it."""

    name: str
    value: str
    why: str
    asked_by: frozenset[Lack]


SLOW_IMU: Final[frozenset[Lack]] = frozenset({"no gyro", "slow gyro", "no accel", "slow accel"})
NO_SPEED: Final[frozenset[Lack]] = frozenset({"no rotor speed"})
SLOW_MOTORS: Final[frozenset[Lack]] = frozenset({"no motors", "slow motors"})
NO_BATTERY: Final[frozenset[Lack]] = frozenset({"no battery"})
NO_ACCEL: Final[frozenset[Lack]] = frozenset({"no accel"})


def _setting(name: str, value: str, why: str, asked_by: frozenset[Lack]) -> Setting:
    return Setting(name=name, value=value, why=why, asked_by=asked_by)


PX4: Final = (
    _setting(
        "SDLOG_PROFILE",
        "17",
        "logs motors, ESCs and IMU fast (bits 0 and 4)",
        SLOW_IMU | SLOW_MOTORS,
    ),
    _setting("IMU_ACCEL_CUTOFF", "100", "the accelerometer's low-pass, as the gyro's", SLOW_IMU),
    _setting("IMU_GYRO_CUTOFF", "100", "the gyro's low-pass; watch motor temperatures", SLOW_IMU),
    _setting("DSHOT_BIDIR_EN", "1", "rotor speed over the signal wire (DShot ESCs)", NO_SPEED),
    _setting(
        "DSHOT_TEL_CFG", "the port of the telemetry wire", "else: rotor speed by wire", NO_SPEED
    ),
    _setting("UAVCAN_ENABLE", "3", "else: rotor speed of DroneCAN ESCs", NO_SPEED),
)
ARDUPILOT: Final = (
    _setting(
        "LOG_BITMASK",
        "its value + 262145 (bits 0 and 18)",
        "attitude and IMU at the loop's rate",
        SLOW_IMU | SLOW_MOTORS,
    ),
    _setting(
        "LOG_BITMASK",
        "+ 524288 (bit 19), INS_RAW_LOG_OPT = 0",
        "every IMU sample; needs a fast card",
        SLOW_IMU,
    ),
    _setting(
        "INS_LOG_BAT_MASK", "0", "batch logging records gyro and accelerometer in turns", SLOW_IMU
    ),
    _setting(
        "SERVO_BLH_BDMASK",
        "15 (the motors' outputs)",
        "rotor speed by bidirectional DShot",
        NO_SPEED,
    ),
    _setting(
        "SERVO_BLH_POLES", "magnets of a motor", "without it the rotor speed is wrong", NO_SPEED
    ),
)
BETAFLIGHT: Final = (
    _setting(
        "acc_lpf_hz",
        "100",
        "the accelerometer is logged after its low-pass",
        frozenset({"filtered accel"}),
    ),
    _setting(
        "blackbox_sample_rate", "1/2", "gyro and motors at 1 kHz or more", SLOW_IMU | SLOW_MOTORS
    ),
    _setting(
        "blackbox_disable_acc", "OFF", "logs the accelerometer (it is on by default)", NO_ACCEL
    ),
    _setting("blackbox_disable_motors", "OFF", "logs the motor commands", SLOW_MOTORS),
    _setting("dshot_bidir", "ON", "rotor speed (ESCs with bidirectional DShot)", NO_SPEED),
    _setting(
        "blackbox_disable_rpm", "OFF", "logs the rotor speed (Betaflight 4.5 and later)", NO_SPEED
    ),
    _setting("motor_poles", "magnets of a motor", "without it the rotor speed is wrong", NO_SPEED),
)
CRAZYFLIE: Final = (
    _setting("config.txt:", "acc.x acc.y acc.z", "the accelerometer", NO_ACCEL),
    _setting("config.txt:", "gyro.x gyro.y gyro.z", "the gyro", frozenset({"no gyro"})),
    _setting(
        "config.txt:", "on:fixedFrequency, 500", "500 samples a second", SLOW_IMU | SLOW_MOTORS
    ),
    _setting(
        "config.txt:", "motor.m1 motor.m2 motor.m3 motor.m4", "the motors", frozenset({"no motors"})
    ),
    _setting("config.txt:", "pm.vbatMV", "the battery, which brushed motors follow", NO_BATTERY),
    _setting(
        "config.txt:", "rpm.m1 rpm.m2 rpm.m3 rpm.m4", "rotor speed, with an RPM deck", NO_SPEED
    ),
)
TABLES: Final[Mapping[str, tuple[Setting, ...]]] = {
    "ulog": PX4,
    "dataflash": ARDUPILOT,
    "blackbox": BETAFLIGHT,
    "crazyflie": CRAZYFLIE,
}
"""By the name of the log's reader."""
FILES: Final[Mapping[str, str]] = {
    "ulog": "px4.params",
    "dataflash": "ardupilot.parm",
    "blackbox": "betaflight.txt",
    "crazyflie": "config.txt",
}
"""In examples/settings, ready to load."""


def settings_for(log_format: str, lacks: Set[Lack]) -> tuple[Setting, ...]:
    """Return the settings to change before the next flight, by what the log lacks."""
    return tuple(s for s in TABLES.get(log_format, ()) if s.asked_by & lacks)
