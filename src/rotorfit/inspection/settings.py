"""Which settings of an autopilot make its next log a better one: one table for each firmware.

Sources: PX4 "Parameter Reference", "DShot ESCs" (to 1.17, and from 1.18 on) and logger/
logged_topics.cpp (bits of SDLOG_PROFILE); ArduPilot "Complete Parameter List", ArduCopter/
defines.h (bits of LOG_BITMASK) and AP_InertialSensor_Backend.cpp (raw IMU), "ESC Telemetry";
Betaflight 4.5 "CLI Command Line Reference"; INAV "Settings" and blackbox.c (7 to 9); Bitcraze
"Micro SD card deck".
"""

from collections.abc import Mapping, Set
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

from rotorfit.inspection.recording import Lack
from rotorfit.logs.bitmask import bits_set
from rotorfit.logs.dataflash.advice import log_bitmask


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


PROFILE_BITS: Final = {0: "default set", 4: "high rate"}
"""Bits of PX4's SDLOG_PROFILE."""
PX4: Final = (
    _setting(
        "SDLOG_PROFILE",
        "bits 0 and 4",
        "logs motors and ESCs fast; the IMU comes at its full rate with the default set",
        SLOW_IMU | SLOW_MOTORS,
    ),
    _setting(
        "DSHOT_BIDIR_EN",
        "1 (PX4 1.16 and 1.17; from 1.18 on choose BDShot for the motors' outputs in the actuator "
        "configuration)",
        "rotor speed over the signal wire (DShot ESCs)",
        NO_SPEED,
    ),
    _setting(
        "DSHOT_TEL_CFG",
        "the port of the telemetry wire",
        "otherwise, rotor speed by wire",
        NO_SPEED,
    ),
    _setting("UAVCAN_ENABLE", "3", "otherwise, rotor speed of DroneCAN ESCs", NO_SPEED),
    _setting(
        "MOT_POLE_COUNT",
        "magnets of a motor (PX4 to 1.17; from 1.18 on DSHOT_MOT_POL1 to DSHOT_MOT_POL12)",
        "without it the rotor speed of DShot ESCs is wrong",
        NO_SPEED,
    ),
)
ARDUPILOT: Final = (
    _setting(
        "LOG_BITMASK",
        "bits 0, 9, 10 and 18",
        "attitude and IMU at the loop's rate, motor outputs, battery",
        SLOW_IMU | SLOW_MOTORS | NO_BATTERY,
    ),
    _setting("INS_RAW_LOG_OPT", "0", "raw IMU, where it is logged, before the filters", SLOW_IMU),
    _setting(
        "INS_LOG_BAT_MASK", "0", "batch logging records gyro and accelerometer in turns", SLOW_IMU
    ),
    _setting(
        "SERVO_BLH_BDMASK",
        "2^(output - 1) of each motor's output, added up (15: outputs 1 to 4)",
        "rotor speed by bidirectional DShot",
        NO_SPEED,
    ),
    _setting(
        "SERVO_BLH_POLES", "magnets of a motor", "without it the rotor speed is wrong", NO_SPEED
    ),
    _setting("BATT_MONITOR", "the kind of your power module", "logs the battery", NO_BATTERY),
)
NO_LIMIT: Final = _setting(
    "LOG_FILE_RATEMAX",
    "0",
    "LOG_BITMASK asks for all of it already, so something limits the rate of the messages",
    SLOW_IMU | SLOW_MOTORS,
)
"""In place of LOG_BITMASK, where no bit is missing."""
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
INAV: Final = (
    _setting(
        "acc_lpf_hz",
        "100",
        "the accelerometer is logged after its low-pass, and navigation sees it so, too",
        frozenset({"filtered accel"}),
    ),
    _setting(
        "blackbox_rate_denom",
        "2 (with blackbox_rate_num = 1)",
        "every second loop is logged; 500 Hz and more are good",
        SLOW_IMU | SLOW_MOTORS,
    ),
    _setting("CLI:", "blackbox ACC", "logs the accelerometer", NO_ACCEL),
    _setting("CLI:", "blackbox MOTORS", "logs the motor commands", frozenset({"no motors"})),
)
"""No rotor speed: INAV to 9 has no bidirectional DShot."""
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
    "inav": INAV,
    "crazyflie": CRAZYFLIE,
}
"""By the name of the log's reader, and INAV, whose logs are Blackbox, too."""
FILES: Final[Mapping[str, str]] = {
    "ulog": "px4.params",
    "dataflash": "ardupilot.parm",
    "blackbox": "betaflight.txt",
    "inav": "inav.txt",
    "crazyflie": "config.txt",
}
"""In the folder of `settings_file`, ready to load."""
UNKNOWN: Final[Mapping[str, str]] = MappingProxyType({})


def settings_for(
    log_format: str, lacks: Set[Lack], metadata: Mapping[str, str] = UNKNOWN
) -> tuple[Setting, ...]:
    """Return the settings to change before the next flight, by what the log lacks.

    Parameters
    ----------
    log_format
        Name of the log's reader.
    lacks
        What the log lacks.
    metadata
        Of the log: which firmware it is of, and what its parameters are now.
    """
    asked = [s for s in TABLES.get(_table(log_format, metadata), ()) if s.asked_by & lacks]
    made = [_beside_what_is_set(setting, lacks, metadata) for setting in asked]
    return tuple(setting for setting in made if setting is not None)


def settings_file(log_format: str, metadata: Mapping[str, str] = UNKNOWN) -> Path | None:
    """Return the file that holds the settings of a log's firmware; None where there is none."""
    name = FILES.get(_table(log_format, metadata))
    return None if name is None else Path(__file__).parent / "settings_files" / name


def _table(log_format: str, metadata: Mapping[str, str]) -> str:
    """Return the key of the tables: the reader, or INAV."""
    inav = metadata.get("Firmware revision", "").lower().startswith("inav")
    return "inav" if inav and log_format == "blackbox" else log_format


def _beside_what_is_set(
    setting: Setting, lacks: Set[Lack], metadata: Mapping[str, str]
) -> Setting | None:
    """Return a setting with its number for this log; None where the log has it already.

    Parameters of bits get those that are missing, and keep those that are set.
    """
    if setting.name not in ("LOG_BITMASK", "SDLOG_PROFILE"):
        return setting
    text = metadata.get(setting.name, "")
    current = int(text) if text.removeprefix("-").isdecimal() else None
    if setting.name == "LOG_BITMASK":
        slow, raw = bool(NO_LIMIT.asked_by & lacks), bool(SLOW_IMU & lacks)
        value = log_bitmask(current, slow=slow, raw=raw)
    else:
        value = bits_set(current, PROFILE_BITS)
    if value is not None:
        return replace(setting, value=value)
    return NO_LIMIT if setting.name == "LOG_BITMASK" and NO_LIMIT.asked_by & lacks else None
