"""Micro-SD logs of the Crazyflie; its body axes are FLU."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.findings import doubts
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.crazyflie_records import (
    MAGIC,
    Event,
    Records,
    Variable,
    find_records,
    record_times,
    variables_at,
)
from rotorfit.logs.files import Content, open_mapped, sha256_of
from rotorfit.logs.firmware import (
    NO_ACCEL,
    NO_BATTERY,
    NO_MOTORS,
    NO_SPEED,
    SLOW_IMU,
    SLOW_MOTORS,
    Advice,
    Lack,
    asked_for,
    settings_of,
)
from rotorfit.logs.flight_log import Channel, Circumstances, FlightLog, in_air, in_order
from rotorfit.logs.formats import LogEntry
from rotorfit.logs.units import STANDARD_GRAVITY, attitude_from_euler

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence, Set
    from pathlib import Path

    from jaxtyping import Float, Int

FIXED_FREQUENCY: Final = "fixedFrequency"
FULL_COMMAND: Final = 65535.0
_DEGREE: Final = np.pi / 180.0
_RPM: Final = 2.0 * np.pi / 60.0
_LISTED: Final = 40

_GYRO: Final = ("gyro.x", "gyro.y", "gyro.z")
_CONTROLLER_GYRO: Final = ("controller.r_roll", "controller.r_pitch", "controller.r_yaw")
_ACCEL: Final = ("acc.x", "acc.y", "acc.z")
_MOTOR: Final = ("motor.m1", "motor.m2", "motor.m3", "motor.m4")
_PWM: Final = ("pwm.m1_pwm", "pwm.m2_pwm", "pwm.m3_pwm", "pwm.m4_pwm")
_MIXER_INPUTS: Final = (
    "controller.cmd_thrust",
    "controller.cmd_roll",
    "controller.cmd_pitch",
    "controller.cmd_yaw",
)
_ROTOR_SPEEDS: Final = (
    ("rpm.m1", "rpm.m2", "rpm.m3", "rpm.m4"),
    ("motor.m1_rpm", "motor.m2_rpm", "motor.m3_rpm", "motor.m4_rpm"),
)
_POSITION: Final = ("stateEstimate.x", "stateEstimate.y", "stateEstimate.z")
_ATTITUDE: Final = (
    "stateEstimate.qw",
    "stateEstimate.qx",
    "stateEstimate.qy",
    "stateEstimate.qz",
)
_VELOCITY: Final = ("stateEstimate.vx", "stateEstimate.vy", "stateEstimate.vz")
_REFERENCE: Final = ("controller.rollRate", "controller.pitchRate", "controller.yawRate")
_EULER: Final = ("stateEstimate.roll", "stateEstimate.pitch", "stateEstimate.yaw")
_AIR: Final = ("baro.pressure", "baro.temp")
_ACCEL_Z: Final = "controller.accelz"


@frozen_dataclass
class _Scaled:
    """Variables that make a channel by a factor to SI; `unit`: as recorded, for its source."""

    names: tuple[str, ...]
    unit: str
    scale: float = 1.0
    signs: tuple[float, ...] = (1.0, 1.0, 1.0)
    resolution: float | None = None


# The controller's pitch is positive nose up: the firmware writes r_pitch = -gyro.y.
_NOSE_UP: Final = (1.0, -1.0, 1.0)
_GYROS: Final = (
    _Scaled(names=_GYRO, unit="[deg/s]", scale=_DEGREE),
    _Scaled(names=_CONTROLLER_GYRO, unit="[rad/s]", signs=_NOSE_UP),
)
_ACCELS: Final = (_Scaled(names=_ACCEL, unit="[g]", scale=STANDARD_GRAVITY),)
_BATTERIES: Final = (
    _Scaled(names=("pm.vbat",), unit="[V]", signs=(1.0,)),
    _Scaled(names=("pm.vbatMV",), unit="[mV]", scale=1e-3, signs=(1.0,), resolution=1e-3),
)
_POSITIONS: Final = (_Scaled(names=_POSITION, unit="[m], the vehicle's own estimate"),)
_REFERENCES: Final = (_Scaled(names=_REFERENCE, unit="[deg/s]", scale=_DEGREE, signs=_NOSE_UP),)

LEGACY_MIXER: Final = np.array(
    [[1.0, -0.5, 0.5, 1.0], [1.0, -0.5, -0.5, -1.0], [1.0, 0.5, -0.5, 1.0], [1.0, 0.5, 0.5, -1.0]]
)
"""m1 to m4 over cmd_thrust, cmd_roll, cmd_pitch, cmd_yaw (power_distribution, legacy mode)."""
SETTINGS: Final = settings_of(
    ("config.txt:", " ".join(_ACCEL), "the accelerometer", NO_ACCEL),
    ("config.txt:", " ".join(_GYRO), "the gyro", frozenset({"no gyro"})),
    ("config.txt:", f"on:{FIXED_FREQUENCY}, 500", "500 samples a second", SLOW_IMU | SLOW_MOTORS),
    ("config.txt:", " ".join(_MOTOR), "the motors", NO_MOTORS),
    ("config.txt:", "pm.vbatMV", "the battery, which brushed motors follow", NO_BATTERY),
    (
        "config.txt:",
        " ".join(_ROTOR_SPEEDS[0]),
        "the rotor speed. It takes an RPM deck; without one give the law of a thrust stand under "
        "[motors]",
        NO_SPEED,
    ),
)
"""Lines of config.txt on the card. Source: Bitcraze "Micro SD card deck"."""


@frozen_dataclass
class _Recording:
    """The records of one event in order of time: where each begins, and the variables by name."""

    data: Content
    starts: Int[np.ndarray, " n"]
    time: Float[np.ndarray, " n"]
    variables: dict[str, Variable]

    def has(self, *names: str) -> bool:
        return all(name in self.variables for name in names)

    def stack(self, names: tuple[str, ...]) -> Float[np.ndarray, "n k"]:
        return variables_at(self.data, self.starts, [self.variables[name] for name in names])


_IMU: Final = frozenset(f"{name}.{axis}" for name in ("gyro", "acc") for axis in "xyz")
"""Variables by which an event is recognised as the one with the flight."""


@frozen_dataclass
class _Found:
    """A channel, the variables it was made of, with notes on it."""

    channel: Channel
    used: tuple[str, ...]
    note: str = ""


def is_crazyflie(head: bytes) -> bool:
    """Return whether bytes from the beginning of a file are a Crazyflie micro-SD log."""
    # The version is a uint16 after the magic byte; none above 255 will ever be.
    return head[:1] == bytes([MAGIC]) and head[2:3] == b"\0"


def read_crazyflie(
    path: Path, *, event: str | None = None, log_number: int | None = None
) -> FlightLog:
    """Read a micro-SD log of a Crazyflie.

    `event`, `log_number`: which event to read where several were recorded, by its name or as
    `list_events` numbers it.
    """
    data = open_mapped(path)
    if not is_crazyflie(data[:3]):
        raise LogError(
            f"{path}: begins with {data[:3].hex(' ')}, expected bc and the version of a "
            "Crazyflie log"
        )
    try:
        records = find_records(data)
        chosen = _chosen_event(records, event, log_number)
        recording, unordered = _order_recording(data, records, chosen)
        found = _make_channels(recording)
        if not found:
            raise LogError(_no_channels(recording, chosen))
    except LogError as error:
        raise LogError(f"{path}: {error}") from error
    return FlightLog(
        path=path,
        sha256=sha256_of(path),
        format="crazyflie",
        channels={name: one.channel for name, one in found.items()},
        seconds=float(recording.time[-1] - recording.time[0]),
        metadata={
            "log version": str(records.header.version),
            "event": ascii(chosen.name)[1:-1],
            "events recorded": _event_counts(records),
        },
        notes=_list_notes(recording, found),
        findings=tuple(doubts("damaged-log", _describe_damage(records, unordered))),
        circumstances=_read_circumstances(recording),
    )


def advice(lacks: Set[Lack], metadata: Mapping[str, str]) -> Advice:
    """Advise what the card's config.txt is to log."""
    return Advice(settings=asked_for(SETTINGS, lacks), file="config.txt")


def list_events(path: Path) -> tuple[LogEntry, ...]:
    """List the recorded events if the user must choose one; empty if the choice is clear."""
    data = open_mapped(path)
    try:
        records = find_records(data)
    except LogError:
        return ()  # which is said when it is read
    if _usual_event(records) is not None:
        return ()
    return tuple(
        LogEntry(
            number=number,
            start=0,
            stop=len(data),
            description=f"event {event.name!a}, {len(records.starts[event.number])} records",
        )
        for number, event in enumerate(_recorded_events(records), start=1)
    )


def _recorded_events(records: Records) -> list[Event]:
    return [e for e in records.header.events if len(records.starts[e.number]) > 1]


def _usual_event(records: Records) -> Event | None:
    """Return the event to read unless another one is asked for; None if that is open."""
    recorded = _recorded_events(records)
    fixed = [event for event in recorded if event.name == FIXED_FREQUENCY]
    with_imu = [e for e in recorded if {v.name for v in e.variables}.issuperset(_IMU)]
    return next((found[-1] for found in (fixed, recorded, with_imu) if len(found) == 1), None)


def _chosen_event(records: Records, name: str | None, number: int | None) -> Event:
    recorded = _recorded_events(records)
    usual = _usual_event(records)
    named = [event for event in recorded if event.name == name]
    if number is not None and name is None:
        if usual is not None and number > 1:
            raise LogError(f"a Crazyflie file is one log, there is no log {number}")
        numbered = recorded if usual is None else [usual]
        if number > len(numbered):
            raise LogError(f"no log {number}: the file has {_numbered_events(numbered)}")
        return numbered[number - 1]
    if name is None and usual is not None:
        return usual
    if named:
        return named[0]
    counts = _event_counts(records)
    if not recorded:
        raise LogError(f"no flight was recorded: {counts}; expected records of {FIXED_FREQUENCY}")
    if name is None:
        raise LogError(
            f"several events were recorded ({counts}): choose one with --log N, of "
            f"{_numbered_events(recorded)}"
        )
    raise LogError(f"no records of the event {name!r}: the log has {counts}")


def _numbered_events(events: Sequence[Event]) -> str:
    return ", ".join(f"{n}: {event.name!a}" for n, event in enumerate(events[:_LISTED], start=1))


def _event_counts(records: Records) -> str:
    events = records.header.events
    shown = [f"{e.name!a} {len(records.starts[e.number])} records" for e in events[:_LISTED]]
    return ", ".join(shown) or "no event is declared"


def _order_recording(data: Content, records: Records, event: Event) -> tuple[_Recording, int]:
    """Order the records of an event by time; also count those left out for that."""
    time, starts = record_times(data, records, event), records.starts[event.number]
    kept = in_order(time)
    if not kept.all():
        time, starts = time[kept], starts[kept]
    variables = {v.name: v for v in event.variables}
    recording = _Recording(data=data, starts=starts, time=time, variables=variables)
    return recording, int(np.count_nonzero(~kept))


def _make_channels(recording: _Recording) -> dict[str, _Found]:
    makers: dict[str, Callable[[_Recording], _Found | None]] = {
        "gyro": lambda given: _first_scaled(given, _GYROS),
        "accel": lambda given: _first_scaled(given, _ACCELS),
        "rotor_speed": _rotor_speed,
        "command": _read_command,
        "battery": lambda given: _first_scaled(given, _BATTERIES),
        "position": lambda given: _first_scaled(given, _POSITIONS),
        "attitude": _read_attitude,
        "velocity": _read_velocity,
        "reference": lambda given: _first_scaled(given, _REFERENCES),
    }
    made = {name: maker(recording) for name, maker in makers.items()}
    return {
        name: one
        for name, one in made.items()
        if one is not None and np.isfinite(one.channel.values).any()
    }


def _found_channel(
    recording: _Recording,
    names: tuple[str, ...],
    values: Float[np.ndarray, "n k"],
    source: str,
    *,
    resolution: float | None = None,
    note: str = "",
) -> _Found:
    channel = Channel(time=recording.time, values=values, source=source, resolution=resolution)
    return _Found(channel=channel, used=names, note=note)


def _first_scaled(recording: _Recording, options: Sequence[_Scaled]) -> _Found | None:
    """Read the first of some vectors that was recorded, in SI."""
    for one in options:
        if recording.has(*one.names):
            values = recording.stack(one.names)
            values *= np.array(one.signs)
            values *= one.scale
            signed = zip(one.signs, one.names, strict=True)
            names = ", ".join(name if sign > 0.0 else f"-{name}" for sign, name in signed)
            return _found_channel(
                recording, one.names, values, f"{names} {one.unit}", resolution=one.resolution
            )
    return None


def _rotor_speed(recording: _Recording) -> _Found | None:
    for names in _ROTOR_SPEEDS:
        if recording.has(*names):
            values = recording.stack(names)
            np.abs(values, out=values)
            values *= _RPM
            source = f"{', '.join(names)} [rpm]"
            return _found_channel(recording, names, values, source, resolution=_RPM)
    return None


def _read_command(recording: _Recording) -> _Found | None:
    """Read the motor commands: as demanded, else as put out, else from the mixer's inputs."""
    for names in (_MOTOR, _PWM):
        if recording.has(*names):
            values = recording.stack(names)
            values /= FULL_COMMAND
            return _count_commands(recording, names, values, f"{', '.join(names)} / 65535")
    if not recording.has(*_MIXER_INPUTS):
        return None
    inputs = recording.stack(_MIXER_INPUTS)
    # Without thrust the firmware stops all motors; with it each is limited by itself.
    mixed = np.where(inputs[:, :1] <= 0, 0.0, inputs @ LEGACY_MIXER.T)
    values = np.clip(mixed, 0.0, FULL_COMMAND) / FULL_COMMAND
    source = f"{', '.join(_MIXER_INPUTS)} mixed as the firmware's legacy mixer does, / 65535"
    note = (
        "The log has no motor commands: they were mixed anew from the controller's outputs by "
        "the legacy mixer (m1 = T - R/2 + P/2 + Y and so on), limited to 0 and 65535."
    )
    return _found_channel(recording, _MIXER_INPUTS, values, source, note=note)


def _count_commands(
    recording: _Recording, names: tuple[str, ...], values: Float[np.ndarray, "n k"], source: str
) -> _Found:
    """Return commands of 16 bits; what is no such number becomes NaN."""
    wrong = (values < 0.0) | (values > 1.0)
    note = ""
    if wrong.any():
        note = f"{int(wrong.any(axis=1).sum())} motor commands are outside 0 to 65535: set to NaN."
        values[wrong] = np.nan
    return _found_channel(
        recording, names, values, source, resolution=1.0 / FULL_COMMAND, note=note
    )


def _read_attitude(recording: _Recording) -> _Found | None:
    if not recording.has(*_ATTITUDE):
        return None
    quaternion = recording.stack(_ATTITUDE)
    length = np.sqrt((quaternion * quaternion).sum(axis=1, keepdims=True))
    good = np.abs(length - 1.0) < 0.05
    values = quaternion / np.where(good, length, np.nan)
    source = f"{', '.join(_ATTITUDE)}, the vehicle's own estimate"
    return _found_channel(recording, _ATTITUDE, values, source)


def _read_velocity(recording: _Recording) -> _Found | None:
    """Read the estimated velocity, turned from the world into the body's axes."""
    if not recording.has(*_VELOCITY):
        return None
    turned = _turned_attitude(recording)
    if turned is None:
        return None
    from scipy.spatial.transform import Rotation  # slow to import

    names, attitude = turned
    known = np.isfinite(attitude).all(axis=1)
    values = np.full((len(attitude), 3), np.nan)
    body_to_world = Rotation.from_quat(attitude[known][:, [1, 2, 3, 0]])
    values[known] = body_to_world.apply(recording.stack(_VELOCITY)[known], inverse=True)
    source = f"{', '.join(_VELOCITY)} [m/s] turned by {names[0]} and so on, the vehicle's estimate"
    return _found_channel(recording, (*_VELOCITY, *names), values, source)


def _turned_attitude(
    recording: _Recording,
) -> tuple[tuple[str, ...], Float[np.ndarray, "n 4"]] | None:
    """Read the estimated attitude w, x, y, z, and the variables that it is of."""
    found = _read_attitude(recording)
    if found is not None:
        return found.used, found.channel.values
    if not recording.has(*_EULER):
        return None
    # The firmware writes pitch positive nose up, against its own axes.
    angles = recording.stack(_EULER) * np.array([1.0, -1.0, 1.0]) * _DEGREE
    return _EULER, attitude_from_euler(angles)


def _no_channels(recording: _Recording, event: Event) -> str:
    return (
        f"none of the {len(recording.variables)} variables of {event.name!a} is known "
        f"({_list_names(list(recording.variables))}): log {', '.join((*_ACCEL, *_GYRO, *_MOTOR))}"
    )


def _list_names(names: list[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more


def _read_circumstances(recording: _Recording) -> Circumstances:
    """Read the air by the barometer [mbar, degC]; the vehicle has neither number nor clock."""
    if not recording.has(*_AIR):
        return Circumstances()
    values = recording.stack(_AIR)
    pressure, temperature = in_air(100.0 * values[:, 0], values[:, 1] + 273.15)
    return Circumstances(air_pressure=pressure, air_temperature=temperature)


def _list_notes(recording: _Recording, found: dict[str, _Found]) -> tuple[str, ...]:
    """List the variables that were used, missing and left out."""
    notes = [one.note for one in found.values() if one.note]
    if "accel" not in found:
        half = f" ({_ACCEL_Z} alone is no specific force)" if recording.has(_ACCEL_Z) else ""
        notes.append(
            f"No accel{half}: without all of {', '.join(_ACCEL)} the flight gives no mass, thrust "
            "or centre of mass; add them to config.txt on the card."
        )
    if "gyro" not in found:
        notes.append(f"No gyro: add {', '.join(_GYRO)} to config.txt on the card.")
    used = {name for one in found.values() for name in one.used}
    left = [name for name in recording.variables if name not in used]
    if left:
        notes.append(f"Left out: {_list_names(left)}.")
    return tuple(notes)


def _describe_damage(records: Records, unordered: int) -> tuple[str, ...]:
    damage: list[str] = []
    if not records.checksum:
        damage.append(
            "the checksum at the end is missing or wrong: the log was cut off, or some of its "
            "bytes are others than were written"
        )
    if records.damaged_places:
        damage.append(
            f"{records.damaged_places} damaged places: {records.skipped_bytes} bytes skipped, "
            f"{records.dropped_records} records before them dropped"
        )
    # A file whose CRC alone is wrong ends in four bytes that are no record.
    if records.trailing_bytes and (records.checksum or records.trailing_bytes > 4):
        damage.append(f"{records.trailing_bytes} bytes at the end are no whole record")
    if unordered:
        damage.append(f"{unordered} records left out: their times are out of order")
    return tuple(damage)
