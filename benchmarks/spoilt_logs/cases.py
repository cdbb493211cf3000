"""The cases: one realistic fault of a real log, or of what is declared of it, each."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from benchmarks import common
from benchmarks.common import Declared

from rotorfit.logs.flight_log import FlightLog

Spoil = Callable[[FlightLog], FlightLog]


@dataclass(frozen=True, slots=True, kw_only=True)
class Flown:
    """One flight of an experiment; with a mass [kg] of its own it is its own configuration."""

    log: str
    spoil: Spoil | None = None
    mass: float | None = None
    window: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spoilt:
    """One fault on one sound log.

    Attributes
    ----------
    name
        Of the case.
    log
        One of `SOUND`.
    fault
        In words.
    cause
        A pattern, one match of which in a sentence names the cause.
    spoil
        What happened to the log.
    declare
        What happened to the declaration.
    window
        Keys ``start`` and ``end`` of the flight.
    beside
        Further flights.
    hangs_on
        Of a fault that no flight can tell, a pattern: what the result names as that on which its
        numbers hang. Empty of all others.
    """

    name: str
    log: str
    fault: str
    cause: str
    spoil: Spoil | None = None
    declare: Callable[[Declared], Declared] | None = None
    window: str = ""
    beside: tuple[Flown, ...] = ()
    hangs_on: str = ""

    @property
    def is_unspoilt(self) -> bool:
        """Whether log and declaration are as they should be."""
        return not (self.spoil or self.declare or self.window or self.beside)


def heavier(declared: Declared, *, factor: float) -> Declared:
    """Return a declaration with the mass in another unit, or mistyped."""
    assert declared.mass != "unknown"
    return dataclasses.replace(declared, mass=declared.mass * factor)


def placed(declared: Declared, *, x: float, y: float) -> Declared:
    """Return a declaration with the rotors' places times factors along x and y."""
    rotors = tuple((px * x, py * y, spin) for px, py, spin in declared.rotors)
    return dataclasses.replace(declared, rotors=rotors)


def by_law(declared: Declared, *, law: str) -> Declared:
    """Return a declaration with another law from command to speed."""
    motors = declared.motors.partition("\n")[0]
    return dataclasses.replace(declared, motors=f"{motors}\nlaw = {law}")


MASS, ARM = r"mass|kilogram|grams|weigh", r"rotors' (distances|positions)"
TILT, CLOCK = r"IMU is mounted|IMU were (mounted|turned)", r"clock|stamped|irregular times"
ROTOR, TWO = (
    r"rotor \d|telemetry|poles|kt_\d",
    r"its vehicle, load, propellers|two different vehicles",
)
PROPELLER, SENSOR = r"propeller", r"accelerometer"
RESPONSE: Final = r"soft mount|low-pass"
GROUND: Final = r"ground effect"
GYRO, LOST = r"gyro .*(later|filter)", r"rows are missing"
LAW, CRASH = r"\blaw\b", r"crash|on the ground|impact"
SIDES = {"x": 0.0545 / 0.0455, "y": 0.0545 / 0.0635}
SWAP = {"x": 0.0635 / 0.0455, "y": 0.0455 / 0.0635}
POLES = 14.0 / 12.0
"""Speed that a controller tells which counts 12 poles where the motor has 14."""
NEW_PROPELLER = 0.93
"""Speed at which it makes the thrust of the old one: kt is 16 % larger."""


def _mass(log: str, factor: float, **more: Any) -> Spoilt:
    return Spoilt(
        name=f"mass x {factor:g}, {log}",
        log=log,
        fault=f"mass declared {factor:g} times too large",
        cause=MASS,
        declare=partial(heavier, factor=factor),
        **more,
    )


def _arm(log: str, x: float, y: float, words: str, **more: Any) -> Spoilt:
    return Spoilt(
        name=f"{words}, {log}",
        log=log,
        fault=f"rotors' places: {words}",
        cause=ARM,
        declare=partial(placed, x=x, y=y),
        **more,
    )


def _turned(log: str, axis: str, degrees: float) -> Spoilt:
    return Spoilt(
        name=f"IMU turned {degrees:g} about {axis}, {log}",
        log=log,
        fault=f"IMU turned by {degrees:g} degrees about {axis} in its mounting",
        cause=TILT,
        spoil=partial(common.turned, axis=axis, degrees=degrees),
    )


def _case(name: str, log: str, fault: str, cause: str, spoil: Spoil | None, **more: Any) -> Spoilt:
    return Spoilt(name=f"{name}, {log}", log=log, fault=fault, cause=cause, spoil=spoil, **more)


SPEED = "rotor_speed"
CASES: Final[tuple[Spoilt, ...]] = (
    *(_mass("LOG00267", factor) for factor in (1000.0, 100.0, 10.0)),
    _mass("LOG00267", 1.1, hangs_on="mass"),
    _mass("log15", 10.0),
    _mass("log15", 1000.0),
    _mass("sih-exported", 10.0),
    _arm("LOG00267", 2.0, 2.0, "arm twice (the diagonal)"),
    _arm("LOG00267", 0.5, 0.5, "arm half"),
    _arm("log15", 2.0, 2.0, "arm twice (the diagonal)", hangs_on="distances"),
    _arm("sih-exported", 2.0, 2.0, "arm twice (the diagonal)"),
    _arm("sih-exported", 0.5, 0.5, "arm half"),
    _arm("LOG00267", SIDES["x"], SIDES["y"], "a rectangle taken as a square"),
    _arm("LOG00267", SWAP["x"], SWAP["y"], "x and y of a rectangle swapped"),
    _turned("LOG00267", "y", 10.0),
    _turned("LOG00340", "y", 10.0),
    _turned("sih-exported", "y", 10.0),
    _turned("LOG00267", "z", 20.0),
    _turned("LOG00267", "z", 45.0),
    _case("one motor's poles", "LOG00267", "rotor 2 counted with 12 poles for 14", ROTOR,
          partial(common.scaled, name=SPEED, factor=POLES, columns=(1,))),
    _case("one motor's poles", "LOG00340", "rotor 2 counted with 12 poles for 14", ROTOR,
          partial(common.scaled, name=SPEED, factor=POLES, columns=(1,))),
    _case("all motors' poles", "LOG00267", "every rotor counted with 12 poles for 14",
          r"poles|scale", partial(common.scaled, name=SPEED, factor=POLES),
          hangs_on="rotor speed"),
    _case("one speed unrelated", "LOG00267", "rotor 2's speed is that of 5 s before", ROTOR,
          partial(common.unrelated, column=1, seconds=5.0)),
    _case("speed late 30 ms", "LOG00267", "all rotor speeds stamped 30 ms late", CLOCK,
          partial(common.late, name=SPEED, seconds=0.03)),
    _case("speed late 30 ms", "LOG00340", "all rotor speeds stamped 30 ms late", CLOCK,
          partial(common.late, name=SPEED, seconds=0.03)),
    _case("speed late 150 ms", "LOG00267", "all rotor speeds stamped 150 ms late", CLOCK,
          partial(common.late, name=SPEED, seconds=0.15)),
    _case("accel late 30 ms", "LOG00267", "accelerometer stamped 30 ms late", CLOCK,
          partial(common.late, name="accel", seconds=0.03)),
    _case("rotors in another order", "LOG00267", "motors logged as 2, 3, 4, 1", r"order",
          partial(common.reordered, order=(1, 2, 3, 0))),
    _case("two rotors swapped", "log15", "motors logged as 2, 1, 3, 4", r"order",
          partial(common.reordered, order=(1, 0, 2, 3))),
    _case("accel clipped 2 g", "LOG00267", "accelerometer of 2 g", SENSOR,
          partial(common.clipped, name="accel", limit=19.6)),
    _case("accel clipped 1.1 g", "LOG00340", "accelerometer that ends at 1.1 g", SENSOR,
          partial(common.clipped, name="accel", limit=10.8)),
    _case("gyro clipped 250 deg/s", "LOG00267", "gyro of 250 deg/s", r"gyro",
          partial(common.clipped, name="gyro", limit=4.36)),
    _case("gyro filtered 20 Hz", "LOG00267", "gyro behind a low-pass of 20 Hz", GYRO,
          partial(common.filtered, name="gyro", cutoff=20.0)),
    _case("gyro filtered 5 Hz", "LOG00267", "gyro behind a low-pass of 5 Hz", GYRO,
          partial(common.filtered, name="gyro", cutoff=5.0)),
    _case("gyro filtered 20 Hz", "log15", "gyro behind a low-pass of 20 Hz", GYRO,
          partial(common.filtered, name="gyro", cutoff=20.0)),
    _case("accel filtered 5 Hz", "LOG00267", "accelerometer behind a low-pass of 5 Hz", SENSOR,
          partial(common.filtered, name="accel", cutoff=5.0)),
    _case("accel scale + 10 %", "LOG00267", "accelerometer reads 10 % too much", SENSOR,
          partial(common.scaled, name="accel", factor=1.1)),
    _case("accel bias 1.5 up", "LOG00267", "accelerometer reads 1.5 m/s^2 too much along z", SENSOR,
          partial(common.biased, name="accel", by=(0.0, 0.0, 1.5))),
    _case("accel bias 1.5 up", "sih-exported", "accelerometer reads 1.5 m/s^2 too much along z",
          SENSOR, partial(common.biased, name="accel", by=(0.0, 0.0, 1.5))),
    _case("speeds from 10 Hz", "LOG00267", "rotor speeds drawn as lines between samples at 10 Hz",
          r"lines are drawn", partial(common.interpolated, rate=10.0)),
    _case("speeds from 10 Hz", "LOG00340", "rotor speeds drawn as lines between samples at 10 Hz",
          r"lines are drawn", partial(common.interpolated, rate=10.0)),
    _case("commands from 10 Hz", "log15", "commands drawn as lines between samples at 10 Hz",
          r"lines are drawn", partial(common.interpolated, rate=10.0, name="command")),
    _case("speeds filtered 15 Hz", "LOG00267", "rotor speeds behind a low-pass of 15 Hz",
          RESPONSE, partial(common.filtered, name=SPEED, cutoff=15.0)),
    _case("speeds filtered 15 Hz", "LOG00271", "rotor speeds behind a low-pass of 15 Hz",
          RESPONSE, partial(common.filtered, name=SPEED, cutoff=15.0)),
    _case("soft mount 15 Hz", "LOG00267", "IMU on a mount that swings at 15 Hz", RESPONSE,
          partial(common.soft_mounted, frequency=15.0)),
    _case("soft mount 15 Hz", "LOG00271", "IMU on a mount that swings at 15 Hz", RESPONSE,
          partial(common.soft_mounted, frequency=15.0)),
    _case("gyro scale + 5 %", "LOG00267", "gyro reads 5 % too much", GYRO,
          partial(common.scaled, name="gyro", factor=1.05), hangs_on="gyro's scale"),
    _case("ground effect in half", "LOG00267", "the ground adds 6 % of thrust from 16 s on", GROUND,
          partial(common.scaled, name=SPEED, factor=0.97, after=16.0)),
    _case("ground effect in half", "LOG00340", "the ground adds 10 % of thrust from 9 s on", GROUND,
          partial(common.scaled, name=SPEED, factor=0.95, after=9.0)),
    _case("propeller broken in flight", "LOG00267", "rotor 3 makes 25 % less thrust from 16 s on",
          PROPELLER, partial(common.scaled, name=SPEED, factor=1.15, columns=(2,), after=16.0)),
    _case("propellers changed", "LOG00267", "four new propellers before the second flight",
          PROPELLER, None, beside=(Flown(log="LOG00340", spoil=partial(
              common.scaled, name=SPEED, factor=NEW_PROPELLER)),)),
    _case("one propeller changed", "LOG00267", "another propeller 3 in the second flight",
          PROPELLER, None, beside=(Flown(log="LOG00271", spoil=partial(
              common.scaled, name=SPEED, factor=NEW_PROPELLER, columns=(2,))),)),
    _case("crash at the end", "LOG00267", "a crash at 25 s", CRASH,
          partial(common.crashed, at=25.0)),
    _case("crash at the end", "log15", "a crash at 50 s", CRASH, partial(common.crashed, at=50.0)),
    _case("crash in the window", "LOG00267", "a crash at 25 s, and start and end given", CRASH,
          partial(common.crashed, at=25.0), window="start = 1.0, end = 26.0"),
    _case("two vehicles", "sih-stock", "another vehicle's flight beside", TWO, None,
          beside=(Flown(log="sih-exported"),)),
    _case("two vehicles, own masses", "sih-stock", "another vehicle as second configuration", TWO,
          None, beside=(Flown(log="sih-exported", mass=1.4),)),
    _case("two vehicles", "LOG00267", "LOG00271 of a vehicle 40 % heavier in roll and pitch", TWO,
          None, beside=(Flown(log="LOG00271", spoil=partial(
              common.scaled, name="gyro", factor=0.7)),)),
    _case("ground in the window", "log15", "start and end hold the ground", CRASH,
          None, window="start = 0.0, end = 62.0"),
    _case("ground in the window", "LOG00037", "start and end hold the whole log", CRASH,
          None, window="start = 0.0, end = 17.0"),
    _case("ground in the window", "LOG00267", "start and end hold the whole log", CRASH,
          None, window="start = 0.0, end = 32.9"),
    _case("wrong law", "sih-exported", "law linear where thrust goes with the command", LAW,
          None, declare=partial(by_law, law="{ linear = [0, 1450] }")),
    _case("drag not told apart", "sih-stock", "nothing but the frame's large drag", r"weight",
          None),
    _case("samples repeated", "LOG00267", "IMU at 101 Hz written at 504 Hz", CLOCK,
          partial(common.held, names=("gyro", "accel"), times=5)),
    _case("stamps jitter 1 ms", "LOG00267", "stamps late by 1 ms rms", CLOCK,
          partial(common.jittered, std=1e-3)),
    _case("rows lost", "LOG00267", "a fifth of the rows lost", LOST,
          partial(common.thinned, share=0.2)),
    *(_case("rows twice", log, "a tenth of the rows written twice, rows counted as time",
            r"wrote them twice", partial(common.written_twice, share=0.1))
      for log in ("LOG00267", "log15")),
    _case("clock 10 % slow", "LOG00267", "a clock that counts 10 % too much time", CLOCK,
          partial(common.stretched, factor=1.1), hangs_on="clock"),
    _case("attitude jumps", "nanobench", "single frames off by 0.07 rad, one a second",
          r"jump|frame|marker", partial(common.jumping, angle=0.07, every=1.0)),
    _case("stamps jitter 2 ms", "nanobench", "stamps late by 2 ms rms", CLOCK,
          partial(common.jittered, std=2e-3)),
)  # fmt: skip
