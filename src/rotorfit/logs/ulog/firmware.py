"""Settings of PX4: which to change for a better log, and the filters that they set.

Sources: PX4 "Parameter Reference", "DShot ESCs" (to 1.17, and from 1.18 on), logger/
logged_topics.cpp (bits of SDLOG_PROFILE) and sensors/vehicle_angular_velocity.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from rotorfit.logs.firmware import (
    NO_SPEED,
    SLOW_IMU,
    SLOW_MOTORS,
    Advice,
    Filter,
    Lack,
    asked_for,
    bits_set,
    fixed_notch,
    logged_integer,
    logged_number,
    low_pass,
    needing_change,
    rotor_notch,
    sensor_sources,
    settings_of,
    with_value,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Set

    from rotorfit.logs.flight_log import FlightLog

MOTOR_OUTPUTS: Final = "motor outputs"
PWM: Final = "PWM"
"""The metadata's word for motors on outputs that do not speak DShot."""
DSHOT_FIRST: Final = (
    "1, where the ESCs can DShot and it is chosen for the motors' outputs in the actuator "
    "configuration (they are PWM now)"
)
PROFILE_BITS: Final = {0: "default set", 4: "high rate"}
"""Bits of SDLOG_PROFILE."""
SETTINGS: Final = settings_of(
    (
        "SDLOG_PROFILE",
        "bits 0 and 4",
        "logs motors and ESCs fast; the IMU comes at its full rate with the default set",
        SLOW_IMU | SLOW_MOTORS,
    ),
    (
        "DSHOT_BIDIR_EN",
        "1 (PX4 1.16 and 1.17; from 1.18 on choose BDShot for the motors' outputs in the actuator "
        "configuration)",
        "rotor speed over the signal wire (DShot ESCs)",
        NO_SPEED,
    ),
    (
        "DSHOT_TEL_CFG",
        "the port of the telemetry wire",
        "otherwise, rotor speed by wire",
        NO_SPEED,
    ),
    (
        "UAVCAN_ENABLE",
        "3 (sensors and actuators)",
        "otherwise, rotor speed of DroneCAN ESCs",
        NO_SPEED,
    ),
    (
        "MOT_POLE_COUNT",
        "magnets of a motor (PX4 to 1.17; from 1.18 on DSHOT_MOT_POL1 to DSHOT_MOT_POL12)",
        "without it the rotor speed of DShot ESCs is wrong",
        NO_SPEED,
    ),
)


def log_faster(current: float | None) -> str:
    """State how to log motors and sensors fast, from the SDLOG_PROFILE that a log has."""
    if current is None:
        return (
            "set bits 0 and 4 of SDLOG_PROFILE (default set and high rate; 17, if no other is set)"
        )
    value = bits_set(int(current), PROFILE_BITS)
    if value is not None:
        return f"set SDLOG_PROFILE = {value}"
    return (
        f"SDLOG_PROFILE = {current:g} asks for it already: take etc/logging/logger_topics.txt, "
        "which replaces it, off the card, or use a faster card"
    )


def advice(lacks: Set[Lack], metadata: Mapping[str, str]) -> Advice:
    """Advise settings of PX4; SDLOG_PROFILE gets the missing bits beside those that are set."""
    found = asked_for(SETTINGS, lacks)
    if found and found[0].name == "SDLOG_PROFILE":
        profile = bits_set(logged_integer(metadata, "SDLOG_PROFILE"), PROFILE_BITS)
        found = (*with_value(found[0], profile), *found[1:])
    if metadata.get(MOTOR_OUTPUTS) == PWM:
        found = tuple(
            replace(s, value=DSHOT_FIRST) if s.name == "DSHOT_BIDIR_EN" else s for s in found
        )
    elif "DSHOT_BIDIR_EN" in metadata:  # by name: PX4 1.18 has none
        found = tuple(
            replace(s, value="1", new="1") if s.name == "DSHOT_BIDIR_EN" else s for s in found
        )
    return Advice(settings=needing_change(found, metadata), file="px4.params")


def filters(log: FlightLog) -> list[Filter]:
    """Find PX4's filters, which the sensors' own topics did not go through."""
    logged, sources = log.metadata, sensor_sources(log)
    gyro = sources["gyro"].startswith("vehicle_angular_velocity")
    accel = sources["accel"].startswith("vehicle_acceleration")
    found = low_pass(logged, "gyro", "IMU_GYRO_CUTOFF", passed=gyro)
    for name in ("IMU_GYRO_NF0", "IMU_GYRO_NF1"):
        found += fixed_notch(logged, f"{name}_FRQ", f"{name}_BW", passed=gyro)
    if int(logged_number(logged, "IMU_GYRO_DNF_EN")) & 1:
        count = int(min(max(logged_number(logged, "IMU_GYRO_DNF_HMC"), 1.0), 10.0))
        least = logged_number(logged, "IMU_GYRO_DNF_MIN")
        found.append(rotor_notch(tuple(range(1, count + 1)), least, "IMU_GYRO_DNF_EN", gyro))
    return found + low_pass(logged, "accel", "IMU_ACCEL_CUTOFF", passed=accel)
