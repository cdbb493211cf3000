"""Settings of ArduPilot: which to change for a better log, and the filters that they set.

Sources: ArduPilot "Complete Parameter List", ArduCopter/defines.h (bits of LOG_BITMASK),
AP_InertialSensor_Backend.cpp (raw IMU), "ESC Telemetry" and "Managing Gyro Noise" (INS_HNTCH_*).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from rotorfit.logs.dataflash.columns import rate_of
from rotorfit.logs.dataflash.motors import MOTOR_FUNCTIONS, OUTPUTS, Wiring
from rotorfit.logs.firmware import (
    FIRMWARE,
    NO_BATTERY,
    NO_SPEED,
    SLOW_IMU,
    SLOW_MOTORS,
    Advice,
    Filter,
    Lack,
    asked_for,
    bits_set,
    fixed_notch,
    is_before,
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
    from collections.abc import Iterator, Mapping, Set

    from rotorfit.logs.dataflash.messages import Messages
    from rotorfit.logs.dataflash.parameters import Parameters
    from rotorfit.logs.flight_log import Channel, FlightLog

BATTERY: Final = {9: "battery"}
FAST: Final = {0: "fast attitude", 10: "RC output", 18: "fast IMU"}
RAW_IMU: Final = {19: "raw IMU"}
"""Bits of ArduCopter's LOG_BITMASK; the last is every sample of every IMU: for a fast card."""
ENOUGH_RATE: Final = 150.0
"""Rate below which the fast motion that shows inertia is lost [Hz]."""
TOO_SLOW: Final = 40.0
"""Rate below which all of it is lost [Hz]."""
ROTOR_MODES: Final = (2, 3, 5)
"""INS_HNTCH_MODE of notches that follow measured rotor speeds."""
SETTINGS: Final = settings_of(
    (
        "LOG_BITMASK",
        "bits 0, 9, 10 and 18",
        "attitude and IMU at the loop's rate, motor outputs, battery",
        SLOW_IMU | SLOW_MOTORS | NO_BATTERY,
    ),
    ("INS_RAW_LOG_OPT", "0", "raw IMU, where it is logged, before the filters", SLOW_IMU),
    ("INS_LOG_BAT_MASK", "0", "batch logging records gyro and accelerometer in turns", SLOW_IMU),
    (
        "SERVO_BLH_BDMASK",
        "2^(output - 1) of each motor's output, added up (15: outputs 1 to 4)",
        "rotor speed by bidirectional DShot",
        NO_SPEED,
    ),
    ("SERVO_BLH_POLES", "magnets of a motor", "without it the rotor speed is wrong", NO_SPEED),
    ("BATT_MONITOR", "the kind of your power module", "logs the battery", NO_BATTERY),
)
NEWER: Final = settings_of(
    (
        FIRMWARE,
        "ArduCopter 4.1 or later",
        "earlier ones have no bidirectional DShot",
        NO_SPEED,
    )
)
"""Before the other settings, where the log is of an older firmware."""
LOGS_SPEED: Final = (4, 1)
"""First version of ArduCopter with bidirectional DShot."""
NO_LIMIT: Final = settings_of(
    (
        "LOG_FILE_RATEMAX",
        "0",
        "LOG_BITMASK asks for all of it already, so something limits the rate of the messages",
        SLOW_IMU | SLOW_MOTORS,
    )
)
"""Settings in place of LOG_BITMASK, where no bit is missing."""


def advice(lacks: Set[Lack], metadata: Mapping[str, str]) -> Advice:
    """Advise settings of ArduPilot; LOG_BITMASK gets the missing bits beside those that are set."""
    found = asked_for(SETTINGS, lacks)
    if found and found[0].name == "LOG_BITMASK":
        limited = asked_for(NO_LIMIT, lacks)
        current = logged_integer(metadata, "LOG_BITMASK")
        value = log_bitmask(current, slow=bool(limited), raw=bool(SLOW_IMU & lacks))
        first = limited if value is None else with_value(found[0], value)
        found = (*first, *found[1:])
    mask = _motor_outputs(metadata)
    if mask:
        words = f"{mask}, the motors' outputs"
        found = tuple(
            one
            for s in found
            for one in (with_value(s, words) if s.name == "SERVO_BLH_BDMASK" else (s,))
        )
    newer = asked_for(NEWER, lacks) if is_before("Copter V", LOGS_SPEED, metadata) else ()
    return Advice(settings=(*newer, *needing_change(found, metadata)), file="ardupilot.parm")


def _motor_outputs(metadata: Mapping[str, str]) -> int:
    """Return the bits of the outputs that are motors by SERVOn_FUNCTION; 0 if none is known."""
    outputs = [
        output
        for output in range(1, OUTPUTS + 1)
        if logged_integer(metadata, f"SERVO{output}_FUNCTION") in MOTOR_FUNCTIONS
    ]
    return sum(1 << (output - 1) for output in outputs)


def filters(log: FlightLog) -> list[Filter]:
    """Find ArduPilot's filters; raw samples (INS_RAW_LOG_OPT) are from before them."""
    logged, sources = log.metadata, sensor_sources(log)
    gyro, accel = (sources[name].startswith("IMU") for name in ("gyro", "accel"))
    found = low_pass(logged, "gyro", "INS_GYRO_FILTER", passed=gyro)
    for name in ("INS_HNTCH", "INS_HNTC2"):
        if not logged_number(logged, f"{name}_ENABLE") > 0:
            continue
        mode = int(logged_number(logged, f"{name}_MODE"))
        bits = int(logged_number(logged, f"{name}_HMNCS")) or 1
        harmonics = tuple(i + 1 for i in range(16) if bits >> i & 1)
        if mode in ROTOR_MODES:
            least = logged_number(logged, f"{name}_FREQ")
            found.append(rotor_notch(harmonics, least, f"{name}_FREQ", gyro))
        else:
            found += _harmonic_notches(logged, name, harmonics, passed=gyro)
    return found + low_pass(logged, "accel", "INS_ACCEL_FILTER", passed=accel)


def _harmonic_notches(
    logged: Mapping[str, str], name: str, harmonics: tuple[int, ...], *, passed: bool
) -> Iterator[Filter]:
    """Yield the notches at a frequency and its multiples, as many octaves above as below."""
    for first in fixed_notch(logged, f"{name}_FREQ", f"{name}_BW", passed=passed):
        assert first.middle is not None
        for times in harmonics:
            middle, low = times * first.middle, times * first.low
            if low > 0.0:
                # As many octaves above as below: AP_HarmonicNotch,
                # `NotchFilter::calculate_A_and_Q`.
                yield replace(first, middle=middle, low=low, high=middle**2 / low)


def lack_notes(
    messages: Messages,
    parameters: Parameters,
    channels: Mapping[str, Channel],
    *,
    wired: Wiring | None,
) -> list[str]:
    """Describe what the log lacks and which setting adds it, one sentence each."""
    slow, raw = _slow_records(channels)
    current = parameters.integer("LOG_BITMASK")
    value = log_bitmask(current, slow=bool(slow), raw=raw)
    to_set = f"LOG_BITMASK = {value}"
    notes: list[str] = []
    # A simulator has no wires to ESCs (`wired` is None), and measures no rotor speed.
    if wired is not None and "rotor_speed" not in channels:
        notes.append(_esc_advice(wired))
    if slow and not too_slow(parameters, channels):  # which is a warning, with the same cure
        notes.append(f"{'; '.join(slow)}: set {to_set if value else _no_limit(current)}")
    if raw and value is not None and "raw IMU" in value:
        notes.append(
            "raw IMU logs every sample of every IMU; on a slow card leave it out (400 Hz remain)"
        )
    if "battery" not in channels:
        also = f", and {to_set}" if value and not slow else ""
        notes.append(f"there is no battery voltage: set BATT_MONITOR to your power module{also}")
    return notes + _batch_note(messages)


def too_slow(parameters: Parameters, channels: Mapping[str, Channel]) -> list[str]:
    """Warn where no flying would show inertia, the log being too slow, and what to set."""
    slow, raw = _slow_records(channels)
    rates = [rate_of(channels[name].time) for name in ("gyro", "command") if name in channels]
    if not rates or not 0.0 < min(rates) < TOO_SLOW or "rotor_speed" in channels:
        return []
    current = parameters.integer("LOG_BITMASK")
    value = log_bitmask(current, slow=True, raw=raw)
    cure = f"LOG_BITMASK = {value}" if value else _no_limit(current)
    words = f"{' and '.join(slow)}: too slow for inertia and motor lag, whatever is flown"
    return [f"{words}; set {cure}"]


def _slow_records(channels: Mapping[str, Channel]) -> tuple[list[str], bool]:
    """Name the missing or slow records; the second is whether the IMU is one."""
    slow: list[str] = []
    gyro, command = channels.get("gyro"), channels.get("command")
    if gyro is None or "accel" not in channels:
        slow.append("there is no IMU message")
    elif (rate := rate_of(gyro.time)) < ENOUGH_RATE:
        slow.append(f"the IMU comes at {rate:.0f} Hz only")
    raw = bool(slow)
    if command is None:
        slow.append("there are no motor outputs")
    elif "rotor_speed" not in channels and (rate := rate_of(command.time)) < ENOUGH_RATE:
        slow.append(
            f"commands come at {rate:.0f} Hz only (from firmware 3.5 on, fast attitude logs "
            "the controller's outputs, from which rotorfit computes quicker ones)"
        )
    return slow, raw


def log_bitmask(current: int | None, *, slow: bool, raw: bool) -> str | None:
    """Return the value that LOG_BITMASK needs; None if it has it already.

    The battery is always asked for, IMU and motors where they are `slow`, raw IMU where `raw`.
    """
    return bits_set(current, BATTERY | (FAST if slow else {}) | (RAW_IMU if raw else {}))


def _no_limit(current: int | None) -> str:
    return f"LOG_FILE_RATEMAX = 0, since LOG_BITMASK = {current} asks for all of it already"


def _esc_advice(wired: Wiring) -> str:
    mask = sum(1 << (output - 1) for output in wired.outputs)
    which = f" = {mask} (the motors' outputs)" if mask else " to the motors' outputs"
    return (
        "no ESC telemetry, so no measured rotor speed: with DShot ESCs set SERVO_BLH_BDMASK"
        f"{which} and SERVO_BLH_POLES to the magnets of a motor (SERVO_DSHOT_ESC to the ESCs' "
        f"firmware); with a telemetry wire SERVO_BLH_MASK{which} and SERVO_BLH_TRATE = 100"
    )


def _batch_note(messages: Messages) -> list[str]:
    count = messages.count("ISBH")
    if count == 0:
        return []
    return [
        f"{count} batches of IMU samples (ISBH, ISBD) are left out: batch sampling records the "
        "accelerometer and the gyro in turns, never both at once; set INS_LOG_BAT_MASK = 0, and "
        "log raw IMU instead (LOG_BITMASK bit 19, INS_RAW_LOG_OPT = 0)"
    ]
