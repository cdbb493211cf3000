"""Writes DataFlash logs as ArduPilot's AP_Logger does, for tests."""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rotorfit.simulation import SimulatedFlight

HEAD = b"\xa3\x95"
FMT = 128
STRUCT = {
    "a": "64s",
    **{letter: letter for letter in "bBhHiIfdqQ"},
    "g": "e",
    "n": "4s",
    "N": "16s",
    "Z": "64s",
    "M": "b",
    "c": "h",
    "C": "H",
    "e": "i",
    "E": "I",
    "L": "i",
}
"""What the fields of each letter are packed as; scaled ones are given as the integers they are."""
FRD = np.array([1.0, -1.0, -1.0])
PWM = (1000.0, 2000.0)


@dataclass(frozen=True)
class Kind:
    """A type of message."""

    number: int
    name: str
    letters: str
    labels: str

    @property
    def packing(self) -> str:
        return "<" + "".join(STRUCT[letter] for letter in self.letters)

    @property
    def length(self) -> int:
        return 3 + struct.calcsize(self.packing)


IMU = Kind(
    150, "IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
)
RCOU = Kind(151, "RCOU", "QHHHHHHHHHHHHHH", "TimeUS," + ",".join(f"C{n}" for n in range(1, 15)))
ESC = Kind(152, "ESC", "QBffffcfcf", "TimeUS,Instance,RPM,RawRPM,Volt,Curr,Temp,CTot,MotTemp,Err")
PARM = Kind(153, "PARM", "QNff", "TimeUS,Name,Value,Default")
MSG = Kind(154, "MSG", "QZ", "TimeUS,Message")
BAT = Kind(155, "BAT", "QBff", "TimeUS,Inst,Volt,VoltR")
RATE = Kind(
    156,
    "RATE",
    "Qffffffffffff",
    "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut",
)
ARM = Kind(157, "ARM", "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method")
FMTU = Kind(158, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
UNIT = Kind(159, "UNIT", "QbZ", "TimeUS,Id,Label")
GYR = Kind(160, "GYR", "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ")
ACC = Kind(161, "ACC", "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ")
KINDS = (IMU, RCOU, ESC, PARM, MSG, BAT, RATE, ARM, FMTU, UNIT, GYR, ACC)

QUAD_X = {
    "FRAME_CLASS": 1.0,
    "FRAME_TYPE": 1.0,
    "MOT_PWM_MIN": PWM[0],
    "MOT_PWM_MAX": PWM[1],
    "MOT_SPIN_MIN": 0.15,
    "MOT_SPIN_MAX": 0.95,
    "MOT_THST_EXPO": 0.65,
    "LOG_BITMASK": 176126.0,
    **{f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 5)},
}


def definition(kind: Kind, *, length: int | None = None) -> bytes:
    """Return the FMT message of a kind."""
    size = kind.length if length is None else length
    texts = (kind.name.encode(), kind.letters.encode(), kind.labels.encode())
    return HEAD + bytes([FMT]) + struct.pack("<BB4s16s64s", kind.number, size, *texts)


FMT_OF_FMT = definition(Kind(FMT, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"))


def message(kind: Kind, *values: float | bytes) -> bytes:
    """Return one message."""
    return HEAD + bytes([kind.number]) + struct.pack(kind.packing, *values)


def log(kinds: Iterable[Kind], messages: Iterable[bytes]) -> bytes:
    """Return a whole log: the FMT of FMT, all definitions, and the messages."""
    return FMT_OF_FMT + b"".join(map(definition, kinds)) + b"".join(messages)


def parameters(values: dict[str, float]) -> list[bytes]:
    return [message(PARM, 0, name.encode(), value, value) for name, value in values.items()]


def imu(time: float, gyro: Sequence[float], accel: Sequence[float], *, instance: int = 0) -> bytes:
    """Return an IMU message of values in FRD axes [s, rad/s, m/s^2]."""
    us = round(time * 1e6)
    return message(IMU, us, instance, *gyro, *accel, 0, 0, 20.0, 1, 1, 1000, 1000)


def rcou(time: float, pwm: Sequence[float]) -> bytes:
    filled = [round(x) for x in pwm] + [0] * (14 - len(pwm))
    return message(RCOU, round(time * 1e6), *filled)


def esc(time: float, instance: int, rpm: float, *, raw: float | None = None) -> bytes:
    shown = rpm if raw is None else raw
    return message(ESC, round(time * 1e6), instance, rpm, shown, 16.0, 1.0, 2500, 0.0, 2500, 0.0)


@dataclass(frozen=True)
class Logging:
    """What an autopilot was set to log of a flight.

    `command_every`: RCOU once in so many samples. `with_esc`: ESC telemetry of every motor.
    """

    command_every: int = 1
    with_esc: bool = True
    settings: dict[str, float] = field(default_factory=lambda: QUAD_X)


def dataflash(flight: SimulatedFlight, logging: Logging | None = None) -> bytes:
    """Return a simulated flight as a log: FRD axes, PWM in whole microseconds, rpm."""
    chosen = logging or Logging()
    parts = [
        message(MSG, 0, b"ArduCopter V4.5.7 (simulated)"),
        message(MSG, 0, b"Frame: QUAD/X"),
        *parameters(chosen.settings),
        message(ARM, 0, 1, 0, 0, 0),
    ]
    rpm = flight.rotor_speed_measured * 60.0 / (2.0 * np.pi)
    pwm = PWM[0] + flight.command * (PWM[1] - PWM[0])
    for i, time in enumerate(flight.time.tolist()):
        parts.append(imu(time, flight.gyro[i] * FRD, flight.accel[i] * FRD))
        if i % chosen.command_every == 0:
            parts.append(rcou(time, pwm[i].tolist()))
        if chosen.with_esc:
            parts += [esc(time, n, value) for n, value in enumerate(rpm[i].tolist())]
    return log(KINDS, parts)


def write_dataflash(flight: SimulatedFlight, path: Path, *, logging: Logging | None = None) -> Path:
    """Write a simulated flight as a DataFlash log."""
    path.write_bytes(dataflash(flight, logging))
    return path
