"""What a DataFlash log lacks for an identification, and the parameters to set before the next."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from rotorfit.flight.log import Channel
from rotorfit.logs.dataflash.messages import Messages
from rotorfit.logs.dataflash.motors import Wiring
from rotorfit.logs.dataflash.parameters import Parameters

FAST_ATTITUDE, RC_OUTPUT, BATTERY, FAST_IMU, RAW_IMU = 0, 10, 9, 18, 19
"""Bits of ArduCopter's LOG_BITMASK."""
ENOUGH_RATE: Final = 150.0
"""Below this the fast motion that inertia shows in is lost [Hz]."""
_BIT_NAMES: Final = {
    FAST_ATTITUDE: "fast attitude",
    RC_OUTPUT: "RC output",
    BATTERY: "battery",
    FAST_IMU: "fast IMU",
    RAW_IMU: "raw IMU",
}


def advice(
    messages: Messages,
    parameters: Parameters,
    channels: Mapping[str, Channel],
    *,
    wired: Wiring,
) -> list[str]:
    """Return what the log lacks and what to set for a better one, one sentence each."""
    lacks, bits = _lacks(channels)
    notes = [_esc_advice(wired)] if "rotor_speed" not in channels else []
    if lacks:
        notes.append(f"{'; '.join(lacks)}: set {bitmask(parameters, bits)}")
    if RAW_IMU in bits:
        notes.append("raw IMU logs every sample; on a slow card leave it out (400 Hz remain)")
    return notes + _batch_note(messages)


def _lacks(channels: Mapping[str, Channel]) -> tuple[list[str], list[int]]:
    """Return what is missing or too slow, and the bits of LOG_BITMASK that help."""
    lacks: list[str] = []
    bits: list[int] = []
    gyro, command = channels.get("gyro"), channels.get("command")
    if gyro is None or "accel" not in channels:
        lacks.append("there is no IMU message")
        bits += [FAST_IMU, RAW_IMU]
    elif (rate := rate_of(gyro)) < ENOUGH_RATE:
        lacks.append(f"the IMU comes at {rate:.0f} Hz only")
        bits += [FAST_IMU, RAW_IMU]
    if command is None:
        lacks.append("there are no motor outputs")
        bits += [FAST_ATTITUDE, RC_OUTPUT]
    elif "rotor_speed" not in channels and (rate := rate_of(command)) < ENOUGH_RATE:
        lacks.append(
            f"commands come at {rate:.0f} Hz only (from firmware 3.5 on they are mixed again from "
            "fast attitude's messages RATE)"
        )
        bits.append(FAST_ATTITUDE)
    if "battery" not in channels:
        lacks.append("there is no battery voltage (BATT_MONITOR)")
        bits.append(BATTERY)
    return lacks, bits


def rate_of(channel: Channel) -> float:
    """Return samples per second, by the median step [Hz]; 0 for fewer than two."""
    step = float(np.median(np.diff(channel.time))) if len(channel.time) > 1 else 0.0
    return 1.0 / step if step > 0 else 0.0


def bitmask(parameters: Parameters, bits: list[int]) -> str:
    """Return the setting of LOG_BITMASK that adds some bits to what the log has."""
    current = parameters.integer("LOG_BITMASK")
    known = current is not None and current >= 0
    wanted = current or 0
    for bit in bits:
        wanted |= 1 << bit
    added = [bit for bit in sorted(bits) if not known or not (current or 0) & (1 << bit)]
    names = ", ".join(f"{_BIT_NAMES[bit]} (bit {bit})" for bit in added)
    if not known:
        return f"in LOG_BITMASK {names}"
    if not added:
        return f"LOG_FILE_RATEMAX = 0, since LOG_BITMASK = {wanted} asks for all of it already"
    return f"LOG_BITMASK = {wanted}, which adds {names}"


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
