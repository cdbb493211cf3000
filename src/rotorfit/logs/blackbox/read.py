"""Blackbox files: their fields as channels in SI units."""

from __future__ import annotations

import hashlib
import math
import re
import struct
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.findings import doubts
from rotorfit.logs.blackbox import LOG_START
from rotorfit.logs.blackbox.decode import BlackboxLog, decode
from rotorfit.logs.blackbox.listing import choice_words, entries_of, metadata_of
from rotorfit.logs.files import read_bytes
from rotorfit.logs.flight_log import Channel, Circumstances, FlightLog
from rotorfit.logs.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from jaxtyping import Float, Int

    from rotorfit.logs.blackbox.header import Header

QUATERNION_ONE: Final = 8127
"""INDIflight's integer for 1 in the field quat."""

# The first of these that the log has is used.
GYRO_FIELDS: Final = ("gyroADC", "gyroData")
ACCEL_FIELDS: Final = ("accUnfiltered", "accADC", "accSmooth")
ROTOR_FIELDS: Final = ("omegaUnfiltered", "omega")
BATTERY_FIELDS: Final = ("vbatLatest", "vbat")
INDIFLIGHT_REFERENCE: Final = "gyroSp"
REFERENCE_FIELDS: Final = ("setpoint", "axisRate", INDIFLIGHT_REFERENCE)
"""Betaflight's, INAV's (in the gyro's axes both) and INDIflight's."""
_OTHER_FIELDS: Final = ("motor", "eRPM", "debug", "extPos", "quat", "imuQuaternion")
DEBUG_ERPM, DEBUG_FREQUENCY = 45, 46
"""debug_mode of DSHOT_RPM_TELEMETRY and RPM_FILTER in Betaflight 4.1 to 4.4."""
MAX_COLUMNS: Final = 12
"""Most rotors; INAV has as many outputs."""

FIELDS: Final = frozenset(
    name
    for base in (
        *GYRO_FIELDS,
        *ACCEL_FIELDS,
        *ROTOR_FIELDS,
        *BATTERY_FIELDS,
        *REFERENCE_FIELDS,
        *_OTHER_FIELDS,
    )
    for name in (base, *(f"{base}[{i}]" for i in range(MAX_COLUMNS)))
)
"""The fields that make the channels; the others need not be kept."""


def read_channels(
    log: BlackboxLog, poles: int | None = None
) -> tuple[dict[str, Channel], list[str]]:
    """Read the channels of a log in SI units, and what was left out."""
    readers = {
        "gyro": _read_gyro,
        "accel": _read_accel,
        "rotor_speed": partial(_rotor_speed, given_poles=poles),
        "command": _read_command,
        "battery": _read_battery,
        "position": _read_position,
        "attitude": _read_attitude,
        "reference": _read_reference,
    }
    channels: dict[str, Channel] = {}
    notes: list[str] = []
    time = seconds(log)
    for name, reader in readers.items():
        result = reader(log, time)
        if isinstance(result, Channel):
            channels[name] = result
        elif result:
            notes.append(f"no {name}: {result}")
    return channels, notes


def seconds(log: BlackboxLog) -> Float[np.ndarray, " n"]:
    """Read the clock of the main frames [s], continued where its 32 bits overflow."""
    time = log.main.column("time")
    half = 1 << 31
    step = (np.diff(time, prepend=time[:1]) + half) % (2 * half) - half
    return (time[:1] + np.cumsum(step)) * 1e-6


def _find_vector(
    log: BlackboxLog, bases: tuple[str, ...], count: int | None = None
) -> tuple[str, Int[np.ndarray, "n k"]] | None:
    """Find the first of some array fields that the log has, with its columns [0], [1], ...

    Without `count`, as many columns as there are, `MAX_COLUMNS` at most; else that many or none.
    """
    names = log.main.names
    for base in bases:
        size = 0
        while size < (count or MAX_COLUMNS) and f"{base}[{size}]" in names:
            size += 1
        if size and (count is None or size == count):
            columns = [log.main.column(f"{base}[{i}]") for i in range(size)]
            return base, np.stack(columns, axis=1)
    return None


def _scale_channel(
    time: Float[np.ndarray, " n"], raw: Int[np.ndarray, "n k"], scale: float, source: str
) -> Channel:
    """Scale integers to a channel; the scale is also its resolution."""
    return Channel(time=time, values=raw * scale, source=source, resolution=scale)


def _read_gyro(log: BlackboxLog, time: Float[np.ndarray, " n"]) -> Channel | str:
    """Read the angular velocity [rad/s]; Blackbox axes are already FLU."""
    field = _find_vector(log, GYRO_FIELDS, 3)
    if field is None:
        return f"the log has no field {GYRO_FIELDS[0]}: enable gyro logging"
    base, raw = field
    per_count = _gyro_scale(log.header)
    if per_count is None:
        return "header line gyro_scale is missing or no number"
    declared = log.header.frames["I"].names
    others = [b for b in ("gyroADCafterRpm", "gyroUnfilt") if f"{b}[0]" in declared]
    source = f"{base}[0..2], filtered as the header says, {math.degrees(per_count):.6g} deg/s"
    source += "".join(f"; the log also has {other}" for other in others)
    return _scale_channel(time, raw, per_count, source)


def _gyro_scale(header: Header) -> float | None:
    """Read the angular velocity of one count [rad/s]; None if the header does not say."""
    text = header.entries.get("gyro_scale", "")
    if not re.fullmatch(r"(0x)?[0-9a-fA-F]{1,8}", text):
        return None
    (scale,) = struct.unpack("<f", struct.pack("<I", int(text, 16)))
    if not (math.isfinite(scale) and scale > 0):
        return None
    if scale < 1e-5:  # Baseflight's unit: rad/us
        return scale * 1e6
    if header.numbers("blackbox_high_resolution") == (1,):
        scale /= 10
    return math.radians(scale)


def _read_accel(log: BlackboxLog, time: Float[np.ndarray, " n"]) -> Channel | str:
    """Read the specific force [m/s^2]; Blackbox axes are already FLU."""
    field = _find_vector(log, ACCEL_FIELDS, 3)
    if field is None:
        return f"the log has no field {' or '.join(ACCEL_FIELDS)}: enable accelerometer logging"
    base, raw = field
    one_g = (log.header.numbers("acc_1G") or (0,))[0]
    if one_g <= 0:
        return "header line acc_1G is missing or not positive"
    return _scale_channel(
        time, raw, STANDARD_GRAVITY / one_g, f"{base}[0..2], {one_g} counts per g"
    )


def _rotor_speed(
    log: BlackboxLog, time: Float[np.ndarray, " n"], *, given_poles: int | None
) -> Channel | str:
    rotors = _find_vector(log, ROTOR_FIELDS)
    if rotors is not None:
        base, raw = rotors
        # INDIflight always logs eight; the motors say how many there are.
        motors = _find_vector(log, ("motor",))
        used = (
            motors[1].shape[1]
            if motors
            else 1 + int(np.flatnonzero(raw.any(axis=0)).max(initial=0))
        )
        raw = raw[:, :used]
        return _scale_channel(time, raw, 1.0, f"{base}[0..{raw.shape[1] - 1}], rad/s")
    erpm = _find_vector(log, ("eRPM",))
    if erpm is None and log.header.entries.get("Firmware revision", "").startswith("INAV"):
        return "INAV to 9 has no bidirectional DSHOT, and escRPM of a telemetry wire is not read"
    if erpm is None:
        return _speed_in_debug(log, time, given_poles)
    raw = erpm[1]
    poles = (log.header.numbers("motor_poles") or (0,))[0]
    if poles < 2:
        return f"header line motor_poles is {poles or 'missing'}, expected 2 or more"
    source = f"eRPM[0..{raw.shape[1] - 1}], 100 electrical rpm, {poles} motor poles"
    return _scale_channel(time, raw, 100 * 2 * math.pi / 60 / (poles / 2), source)


def _speed_in_debug(
    log: BlackboxLog, time: Float[np.ndarray, " n"], given_poles: int | None
) -> Channel | str:
    """Read the rotor speeds that Betaflight 4.1 to 4.4 logs in ``debug`` where that is set."""
    lacking = "the log has neither omega nor eRPM"
    version = re.match(r"Betaflight (\d+)\.(\d+)", log.header.entries.get("Firmware revision", ""))
    mode = (log.header.numbers("debug_mode") or (0,))[0]
    fields, motors = _find_vector(log, ("debug",)), _find_vector(log, ("motor",))
    is_known = version is not None and version[1] == "4" and 1 <= int(version[2]) <= 4
    if not is_known or mode not in (DEBUG_ERPM, DEBUG_FREQUENCY) or fields is None or not motors:
        return lacking
    count = motors[1].shape[1]
    if count > fields[1].shape[1]:
        return f"debug holds the speeds of {fields[1].shape[1]} motors of {count} only"
    raw, last = fields[1][:, :count], count - 1
    if not (raw > 0).any(axis=0).all():
        return f"debug[0..{last}] holds no speeds: bidirectional DShot was off"
    if mode == DEBUG_FREQUENCY:
        source = f"debug[0..{last}], Hz (debug_mode RPM_FILTER)"
        return _scale_channel(time, raw, 2.0 * math.pi, source)
    poles = (log.header.numbers("motor_poles") or (0,))[0] or given_poles or 0
    if poles < 2:
        return (
            "debug has the electrical speed of the motors, but the header no motor_poles: count "
            "the magnets of a motor, and give poles = ... under [motors]"
        )
    source = f"debug[0..{last}], 100 electrical rpm (DSHOT_RPM_TELEMETRY), {poles} motor poles"
    return _scale_channel(time, raw, 100 * 2 * math.pi / 60 / (poles / 2), source)


def _read_command(log: BlackboxLog, time: Float[np.ndarray, " n"]) -> Channel | str:
    """Read the motor commands as a fraction of the output range."""
    motors = _find_vector(log, ("motor",))
    if motors is None:
        return "the log has no field motor[0]: enable motor logging"
    low, high, line = _motor_range(log.header)
    if high <= low:
        return f"header line {line} gives no range of motor outputs"
    raw = motors[1]
    # Below the range: stopped. Commands do not exceed 1 by definition.
    values = np.clip((raw - low) / (high - low), 0.0, 1.0)
    source = f"motor[0..{raw.shape[1] - 1}], {low}..{high} ({line}) as 0..1, clipped"
    return Channel(time=time, values=values, source=source, resolution=1 / (high - low))


def _motor_range(header: Header) -> tuple[int, int, str]:
    """Return lowest and highest motor output, and the header line that says so."""
    output = header.numbers("motorOutput") or ()
    if len(output) == 2:
        return output[0], output[1], "motorOutput"
    low, high = header.numbers("minthrottle") or (0,), header.numbers("maxthrottle") or (0,)
    return low[0], high[0], "minthrottle, maxthrottle"


def _read_battery(log: BlackboxLog, time: Float[np.ndarray, " n"]) -> Channel | str:
    base = next((name for name in BATTERY_FIELDS if name in log.main.names), None)
    if base is None:
        return "the log has no field vbatLatest"
    scale, source = _volts_per_count(log.header)
    if scale is None:
        return f"header line {source} is missing or not positive"
    return _scale_channel(time, log.main.column(base)[:, None], scale, f"{base}, {source}")


def _volts_per_count(header: Header) -> tuple[float | None, str]:
    """Read the voltage of one count [V], and how it is known."""
    revision = header.entries.get("Firmware revision", "")
    firmware = re.match(r"(Betaflight|Indiflight|INAV)\s+(\d{1,6})", revision, re.IGNORECASE)
    if firmware and (firmware[1].lower() != "betaflight" or int(firmware[2]) >= 4):
        return 0.01, "0.01 V"
    # Before: counts of a 12-bit converter at 3.3 V behind a divider, vbat_scale / 10 to one.
    divider = (header.numbers("vbat_scale") or header.numbers("vbatscale") or (0,))[0]
    if divider <= 0:
        return None, "vbat_scale"
    return 3.3 / 4095 * divider / 10, f"12-bit counts, vbat_scale {divider}"


def _is_indiflight(log: BlackboxLog) -> bool:
    return log.header.entries.get("Firmware revision", "").lower().startswith("indiflight")


def _read_position(log: BlackboxLog, time: Float[np.ndarray, " n"]) -> Channel | str:
    """Read the motion-capture position [m], north-east-down to north-west-up."""
    field = _find_vector(log, ("extPos",), 3) if _is_indiflight(log) else None
    if field is None or not field[1].any():
        return ""  # most logs have none: nothing to remark
    raw = field[1]
    # The log repeats the last fix until the next: only the frames that bring a new one count.
    is_new = np.append(True, (np.diff(raw, axis=0) != 0).any(axis=1)) & raw.any(axis=1)
    source = "extPos[0..2], 1 mm, north-east-down turned to north-west-up, new fixes only"
    return _scale_channel(time[is_new], raw[is_new] * np.array([1, -1, -1]), 1e-3, source)


def _read_attitude(log: BlackboxLog, time: Float[np.ndarray, " n"]) -> Channel | str:
    """Read the attitude of the autopilot, body FLU to world north-west-up."""
    field = _find_vector(log, ("quat", "imuQuaternion"), 4)
    if field is None:
        return ""
    if field[0] != "quat" or not _is_indiflight(log):
        return f"the axes of field {field[0]} are known for INDIflight only"
    # INDIflight's quat turns FRD into north-east-down. Half a turn about x on both sides gives (w,
    # x, -y, -z): its rates agree with the gyro, and gravity with down.
    raw = field[1] * np.array([1, 1, -1, -1])
    norm = np.linalg.norm(raw, axis=1, keepdims=True)
    values = np.where(norm > 0, raw / np.maximum(norm, 1), np.nan)
    source = "quat[0..3], FRD to north-east-down turned to FLU to north-west-up, estimate on board"
    return replace(_scale_channel(time, raw, 1 / QUATERNION_ONE, source), values=values)


def _read_reference(log: BlackboxLog, time: Float[np.ndarray, " n"]) -> Channel | str:
    """Read the angular velocity that was asked for [rad/s], as fine as the gyro is logged."""
    field = _find_vector(log, REFERENCE_FIELDS, 3)
    if field is None:
        return ""
    base, raw = field
    step = 0.1 if log.header.numbers("blackbox_high_resolution") == (1,) else 1.0
    source = f"{base}[0..2], {step:g} deg/s"
    if base == INDIFLIGHT_REFERENCE:
        raw, source = raw * np.array([1, -1, -1]), f"{source}, FRD turned to FLU"
    return _scale_channel(time, raw, math.radians(step), source)


def read_blackbox(
    path: Path, *, log_number: int | None = None, motor_poles: int | None = None
) -> FlightLog:
    """Read one log of a Blackbox file.

    `motor_poles`: magnets of a motor, where the header does not say and speeds are electrical.
    """
    data = read_bytes(path)
    if log_number is None and data.count(LOG_START) > 1:
        entries = entries_of(data)
        if len(entries) > 1:
            raise LogError(f"{path}: {choice_words(entries)}")
        log_number = entries[0].number if entries else None
    try:
        log = decode(data, log_number=log_number, fields=FIELDS)
    except LogError as error:
        raise LogError(f"{path}: {error}") from error
    if len(log.main) == 0:
        raise LogError(
            f"{path}: log {log.log_number} has no readable main frame in "
            f"{log.header.stop - log.header.data_start} bytes after its header, expected one at "
            "least: record a longer flight, or copy the log from the recorder again"
        )
    channels, missing = read_channels(log, motor_poles)
    time = seconds(log)
    return FlightLog(
        path=path,
        sha256=hashlib.sha256(data).hexdigest(),
        format="blackbox",
        channels=channels,
        log_number=log.log_number,
        logs_in_file=log.logs_in_file,
        seconds=float(time.max() - time.min()),  # its clock may run backwards
        metadata=metadata_of(log.header.entries),
        notes=(_frame_counts(log), *missing),
        findings=tuple(doubts("damaged-log", _describe_damage(log))),
        circumstances=_read_circumstances(log.header.entries),
    )


def _read_circumstances(entries: Mapping[str, str]) -> Circumstances:
    """Return the number of the processor, and when the log began."""
    hardware = entries.get("DeviceUID", "")
    try:
        began = datetime.fromisoformat(entries.get("Log start datetime", "").strip())
    except ValueError:  # none, or the year 0 of a clock that was never set
        return Circumstances(hardware=hardware)
    began = began if began.tzinfo else began.replace(tzinfo=UTC)
    return Circumstances(hardware=hardware, started=began.timestamp())


def _frame_counts(log: BlackboxLog) -> str:
    intra = int(log.is_intra.sum())
    counts = {
        "I": intra,
        "P": len(log.main) - intra,
        "S": len(log.slow),
        "G": len(log.gps),
        "H": len(log.home),
        "E": len(log.events),
    }
    return "frames read: " + ", ".join(f"{count} {letter}" for letter, count in counts.items())


def _describe_damage(log: BlackboxLog) -> list[str]:
    notes: list[str] = []
    if log.damaged_stretches:
        notes.append(
            f"{log.damaged_stretches} corrupt stretches: {log.skipped_bytes} bytes skipped"
        )
    if log.dropped_frames:
        notes.append(
            f"{log.dropped_frames} frames dropped: they follow a corrupt one or are not credible"
        )
    if log.header.damaged_bytes:
        notes.append(f"{log.header.damaged_bytes} bytes of the header skipped: no header lines")
    if not log.ended:
        notes.append(f"no end-of-log event: {log.trailing_bytes} bytes of an unfinished frame left")
    elif log.trailing_bytes:
        notes.append(f"{log.trailing_bytes} bytes after the end of the log ignored")
    return notes
