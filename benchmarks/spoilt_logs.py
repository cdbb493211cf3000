"""What does `identify` say of real logs that were spoilt by one realistic fault each?

    python -m benchmarks.spoilt_logs [--only NAME] [--workers N] [--keep FOLDER] [-o table.md]
    python -m benchmarks.spoilt_logs --windows 600     # random windows of every log, seconds of it

Each case takes one sound real log ($ROTORFIT_DATA, ../shared/data), changes a channel of it or the
declared experiment by one fault, writes it as a flight table and runs the command line on it, so
that what is recorded is what a user sees. The unspoilt log goes the same way first, and must come
out as its own file does. A number that is given is held against what is known of the vehicle, else
against that of the unspoilt log, and the case is

- refused: no numbers;
- said: numbers lie outside their intervals, and a sentence names the cause;
- vague: they do, and what is said besides is of something else;
- SILENT: they do, and nothing is said that is not said of the unspoilt log;
- harmless: every number still holds.
"""

import argparse
import contextlib
import dataclasses
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from benchmarks import common
from benchmarks.common import (
    SOUND,
    Declared,
    airframe_text,
    read_sound,
    real_data_folder,
    table_columns,
)
from benchmarks.same_numbers import AIRFRAMES, COMMANDED, CRAZYFLIE, LOGS, TABLES

from rotorfit.cli.identify import IdentifyRequest, run
from rotorfit.errors import RotorfitError
from rotorfit.flight.log import FlightLog
from rotorfit.logs.table import write_table

VEHICLE: Final = (
    *("kt", "kd", "Jr", "kd_over_kt", "kd_over_Izz", "Jr_over_Izz"),
    *("Ixx_com", "Iyy_com", "Izz_com", "Ixx_over_kt", "Iyy_over_kt", "Izz_over_kt"),
    *("com_x", "com_y", "com_z"),
)
"""Numbers that are held against what is known."""
NUISANCES: Final = ("kt_1", "kt_2", "kt_3", "kt_4", "twist", "rotor_drag", "motor_lag_total")
"""The same of less weight: they alone make no case a silent one."""
GIVEN: Final = ("identified", "weak")
DIGITS: Final = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?")

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
    """

    name: str
    log: str
    fault: str
    cause: str
    spoil: Spoil | None = None
    declare: Callable[[Declared], Declared] | None = None
    window: str = ""
    beside: tuple[Flown, ...] = ()

    @property
    def is_unspoilt(self) -> bool:
        """Whether log and declaration are as they should be."""
        return not (self.spoil or self.declare or self.window or self.beside)


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """How the command ended, and what it said."""

    code: int
    error: str
    result: Mapping[str, Any] | None

    @property
    def sentences(self) -> list[str]:
        """Every warning of the result and of its flights."""
        if self.result is None:
            return []
        flights = [words for f in self.result["flights"] for words in f["warnings"]]
        return [*self.result["warnings"], *flights]

    def given(self) -> dict[str, dict[str, Any]]:
        """Return what is reported with a value, by name, of the first configuration."""
        if self.result is None:
            return {}
        entries = [*self.result["parameters"], *self.result["derived"]]
        return {
            e["name"]: e
            for e in reversed(entries)
            if e["value"] is not None and e.get("verdict", "weak") in GIVEN
        }


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


MASS, ARM = r"mass|kilogram|grams|weigh", r"arm|rotors' positions|place"
TILT, CLOCK = r"IMU|mounted|turned", r"time|clock|late|rate"
ROTOR, TWO = (
    r"rotor \d|telemetry|poles|kt_\d",
    r"another vehicle|same vehicle|flights (differ|disagree)",
)
PROPELLER, SENSOR = r"propeller", r"accelerometer|clipp|range|filter|limit"
LAW, CRASH = r"law|square|battery", r"crash|contact|ground|impact"
SIDES = {"x": 0.0545 / 0.0455, "y": 0.0545 / 0.0635}
SWAP = {"x": 0.0635 / 0.0455, "y": 0.0455 / 0.0635}
POLES = 14.0 / 12.0
"""Speed that a controller tells which counts 12 poles where the motor has 14."""
NEW_PROPELLER = 0.93
"""Speed at which it makes the thrust of the old one: kt is 16 % larger."""


def _mass(log: str, factor: float) -> Spoilt:
    return Spoilt(
        name=f"mass x {factor:g}, {log}",
        log=log,
        fault=f"mass declared {factor:g} times too large",
        cause=MASS,
        declare=partial(heavier, factor=factor),
    )


def _arm(log: str, x: float, y: float, words: str) -> Spoilt:
    return Spoilt(
        name=f"{words}, {log}",
        log=log,
        fault=f"rotors' places: {words}",
        cause=ARM,
        declare=partial(placed, x=x, y=y),
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
    _mass("log15", 10.0),
    _mass("log15", 1000.0),
    _mass("sih-exported", 10.0),
    _arm("LOG00267", 2.0, 2.0, "arm twice (the diagonal)"),
    _arm("LOG00267", 0.5, 0.5, "arm half"),
    _arm("log15", 2.0, 2.0, "arm twice (the diagonal)"),
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
          r"poles|rotor speed", partial(common.scaled, name=SPEED, factor=POLES)),
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
    _case("gyro filtered 20 Hz", "LOG00267", "gyro behind a low-pass of 20 Hz", r"gyro|filter",
          partial(common.filtered, name="gyro", cutoff=20.0)),
    _case("gyro filtered 5 Hz", "LOG00267", "gyro behind a low-pass of 5 Hz", r"gyro|filter",
          partial(common.filtered, name="gyro", cutoff=5.0)),
    _case("gyro filtered 20 Hz", "log15", "gyro behind a low-pass of 20 Hz", r"gyro|filter",
          partial(common.filtered, name="gyro", cutoff=20.0)),
    _case("accel filtered 5 Hz", "LOG00267", "accelerometer behind a low-pass of 5 Hz", SENSOR,
          partial(common.filtered, name="accel", cutoff=5.0)),
    _case("accel scale + 10 %", "LOG00267", "accelerometer reads 10 % too much", SENSOR,
          partial(common.scaled, name="accel", factor=1.1)),
    _case("accel bias 1.5 up", "LOG00267", "accelerometer reads 1.5 m/s^2 too much along z", SENSOR,
          partial(common.biased, name="accel", by=(0.0, 0.0, 1.5))),
    _case("accel bias 1.5 up", "sih-exported", "accelerometer reads 1.5 m/s^2 too much along z",
          SENSOR, partial(common.biased, name="accel", by=(0.0, 0.0, 1.5))),
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
    _case("rows lost", "LOG00267", "a fifth of the rows lost", CLOCK,
          partial(common.thinned, share=0.2)),
    _case("clock 10 % slow", "LOG00267", "a clock that counts 10 % too much time", CLOCK,
          partial(common.stretched, factor=1.1)),
    _case("attitude jumps", "nanobench", "single frames off by 0.07 rad, one a second",
          r"jump|frame|marker", partial(common.jumping, angle=0.07, every=1.0)),
    _case("stamps jitter 2 ms", "nanobench", "stamps late by 2 ms rms", CLOCK,
          partial(common.jittered, std=2e-3)),
)  # fmt: skip


# What a user is told.


def experiment_of(case: Spoilt, folder: Path) -> Path:
    """Write logs and experiment of a case into a folder; return the experiment."""
    sound = SOUND[case.log]
    declared = sound.declared if case.declare is None else case.declare(sound.declared)
    first = Flown(log=case.log, spoil=case.spoil, window=case.window)
    shared = [first, *(flown for flown in case.beside if flown.mass is None)]
    bodies = [(declared.mass, shared)]
    bodies += [(flown.mass, [flown]) for flown in case.beside if flown.mass is not None]
    text = airframe_text(declared)
    for i, (mass, flights) in enumerate(bodies):
        entries = ", ".join(_entry(flown, folder) for flown in flights)
        weight = json.dumps(mass)
        text += f'[[configuration]]\nname = "{"AB"[i]}"\nmass = {weight}\nflights = [{entries}]\n'
    path = folder / "experiment.toml"
    path.write_text(text, encoding="utf-8")
    return path


def _entry(flown: Flown, folder: Path) -> str:
    """Write the table of a flight; return its entry in the experiment."""
    log = read_sound(flown.log)
    table = folder / f"{flown.log}.csv"
    write_table(table, table_columns(log if flown.spoil is None else flown.spoil(log)))
    comma = ", " if flown.window else ""
    return f'{{ file = "{table.name}"{comma}{flown.window} }}'


def told(experiment: Path) -> Said:
    """Return what the command line makes of an experiment."""
    ended = subprocess.run(
        [sys.executable, "-m", "rotorfit", "identify", experiment.name, "--json"],
        cwd=experiment.parent,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    result = json.loads(ended.stdout) if ended.returncode == 0 else None
    return Said(code=ended.returncode, error=ended.stderr.strip(), result=result)


def told_of(case: Spoilt, keep: Path | None) -> Said:
    """Return what the command line makes of a case."""
    with tempfile.TemporaryDirectory() as own:
        folder = Path(own) if keep is None else keep / re.sub(r"[^\w.]+", "-", case.name)
        folder.mkdir(parents=True, exist_ok=True)
        for old in folder.glob("*.csv"):
            old.unlink()
        said = told(experiment_of(case, folder))
        (folder / "said.json").write_text(json.dumps(dataclasses.asdict(said)), encoding="utf-8")
        return said


@cache
def unspoilt(log: str) -> Said:
    """Return what is told of a sound log that goes the same way."""
    return told_of(Spoilt(name=f"sound {log}", log=log, fault="", cause=""), KEPT.get("folder"))


KEPT: Final[dict[str, Path]] = {}
"""Where the files of the cases stay, if anywhere."""


# What is to be made of it.


@dataclass(frozen=True, slots=True, kw_only=True)
class Outside:
    """A number that is given with an interval which does not hold what is known."""

    name: str
    value: float
    half_width: float
    known: float
    verdict: str

    def __str__(self) -> str:
        factor = f" = x {self.value / self.known:.2f}" if self.known else ""
        return f"{self.name} {self.value:.3g} +- {self.half_width:.2g}{factor}"


def outside(case: Spoilt, said: Said, names: Sequence[str]) -> list[Outside]:
    """Return the numbers whose intervals hold neither what is known nor what it may be off by."""
    found: list[Outside] = []
    known = SOUND[case.log].known
    sound = unspoilt(case.log).given()
    for name, entry in said.given().items():
        if name not in names or not (name in known or name in sound):
            continue
        value, allowed = known.get(name) or (sound[name]["value"], 0.0)
        low, high = entry["interval"]
        if not low - allowed <= value <= high + allowed:
            half = 0.5 * (high - low)
            verdict = entry.get("verdict", "")
            found.append(Outside(name=name, value=entry["value"], half_width=half,
                                 known=value, verdict=verdict))  # fmt: skip
    return found


def new_sentences(case: Spoilt, said: Said) -> list[str]:
    """Return the sentences that are not said of the unspoilt log, whatever their numbers."""
    if case.is_unspoilt:
        return said.sentences
    usual = {DIGITS.sub("#", words) for words in unspoilt(case.log).sentences}
    return [words for words in said.sentences if DIGITS.sub("#", words) not in usual]


def classified(case: Spoilt, said: Said) -> str:
    """Return the class of a case."""
    cause = re.compile(case.cause, re.IGNORECASE)
    if said.code != 0:
        if "internal error" in said.error or said.code != 1 or "\n" in said.error:
            return "INTERNAL ERROR"
        return "refused" if cause.search(said.error) else "refused, of something else"
    wrong, new = outside(case, said, VEHICLE), new_sentences(case, said)
    if not wrong:
        return "harmless"
    if any(cause.search(words) for words in new):
        return "said"
    return "vague" if new else "SILENT"


def row(case: Spoilt, said: Said) -> str:
    """Return a case as a row of the table."""
    words = [said.error] if said.code else new_sentences(case, said)
    wrong = "; ".join(str(o) for o in outside(case, said, VEHICLE))
    besides = "; ".join(str(o) for o in outside(case, said, NUISANCES))
    cells = (case.log, case.fault, classified(case, said), wrong, besides, " / ".join(words))
    return f"| {' | '.join(cell.replace('|', '/').replace(chr(10), ' ') for cell in cells)} |"


def table(cases: Sequence[Spoilt], workers: int) -> Iterator[str]:
    """Yield the lines of the table, as they come."""
    yield "| log | fault | class | numbers outside | nuisances outside | what is said |"
    yield "|---|---|---|---|---|---|"
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(unspoilt, sorted({case.log for case in cases})))
        said = pool.map(lambda case: told_of(case, KEPT.get("folder")), cases)
        for case, one in zip(cases, said, strict=True):
            yield row(case, one)


def path_steps(log: str) -> str:
    """Return how far the unspoilt log through its table is from its own file."""
    sound = SOUND[log]
    with tempfile.TemporaryDirectory() as own:
        path = Path(own) / "experiment.toml"
        file = json.dumps(str((real_data_folder() / sound.path).resolve()))
        entry = f"{{ file = {file}{_columns_text(sound.path)} }}"
        mass = json.dumps(sound.declared.mass)
        path.write_text(
            f"{airframe_text(sound.declared)}[[configuration]]\nmass = {mass}\n"
            f"flights = [{entry}]\n",
            encoding="utf-8",
        )
        direct = told(path)
    through, own_file = unspoilt(log).given(), direct.given()
    steps = {
        name: abs(through[name]["value"] - entry["value"]) / entry["std"]
        for name, entry in own_file.items()
        if name in through and entry["std"]
    }
    worst = max(steps, key=lambda name: steps[name]) if steps else "nothing given"
    return (
        f"{log}: {len(own_file)} numbers from its own file, {len(through)} through the table; "
        f"largest step {steps.get(worst, 0.0):.2g} of its std ({worst}) {direct.error}"
    )


def _columns_text(path: str) -> str:
    return f", columns = {{ {TABLES[path]} }}" if path in TABLES else ""


# Windows of every log.


@dataclass(frozen=True, slots=True, kw_only=True)
class Windowed:
    """One log and what goes with it on a command line."""

    log: Path
    mass: str
    airframe: Path
    seconds: float


def every_log(folder: Path) -> list[Windowed]:
    """Return every log of the real data that has motors, with airframes in a folder."""
    data = real_data_folder()
    cinerat = airframe_text(SOUND["LOG00267"].declared).partition("[identification]")[0]
    airframes = {**AIRFRAMES, "cinerat.toml": cinerat, "crazyflie.toml": CRAZYFLIE + COMMANDED}
    for name, text in airframes.items():
        (folder / name).write_text(text, encoding="utf-8")
    crazypad = {f"crazypad/{log.name}": ("0.03", "crazyflie.toml")
                for log in sorted((data / "crazypad").glob("*_log*"))}  # fmt: skip
    return [
        Windowed(log=data / log, mass=mass, airframe=folder / airframe,
                 seconds=common.read_log(data / log).seconds)
        for log, (mass, airframe) in {**LOGS, **crazypad}.items()
    ]  # fmt: skip


def random_window(seconds: float, chance: np.random.Generator) -> tuple[float, float]:
    """Return start and end of a window: the whole log, beyond it, a blink, or any."""
    kind = chance.integers(6)
    if kind == 0:
        return 0.0, seconds + float(chance.choice([0.0, 0.01, -0.01, 100.0]))
    length = float(np.exp(chance.uniform(np.log(0.05), np.log(seconds))))
    start = float(chance.uniform(0.0, seconds - 0.5 * length))
    return (0.0, length) if kind == 1 else (round(start, 2), round(start + length, 2))


def window_end(one: Windowed, window: tuple[float, float]) -> tuple[str, str]:
    """Return how the command ends on a window, "told", "refused" or "fault", and what is said."""
    request = IdentifyRequest(
        source=one.log, mass=one.mass, airframe=one.airframe, window=window, as_json=True
    )
    aside = io.StringIO()
    with (
        contextlib.redirect_stdout(aside),
        contextlib.redirect_stderr(aside),
        warnings.catch_warnings(record=True) as heard,
    ):
        warnings.simplefilter("always", RuntimeWarning)
        try:
            run(request)
        except RotorfitError as error:
            return "refused", str(error)
        except Exception as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{Path(last.filename).name}:{last.lineno} {last.name}"
            return "fault", f"{type(error).__name__}: {error} ({place})"
    loud = [w for w in heard if issubclass(w.category, RuntimeWarning)]
    if not loud:
        return "told", ""
    place = f"{Path(loud[0].filename).name}:{loud[0].lineno}"
    return "fault", f"RuntimeWarning: {loud[0].message} ({place})"


def window_faults(seconds: float, seed: int, only: str) -> Iterator[str]:
    """Yield a reproduction of every internal error met in random windows, then the counts.

    And of every fit that did not settle, which is no reason that a user can act upon.
    """
    chance, stop = np.random.default_rng(seed), time.monotonic() + seconds
    ends: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as own:
        logs = [one for one in every_log(Path(own)) if only in str(one.log)]
        while time.monotonic() < stop:
            one = logs[int(chance.integers(len(logs)))]
            start, end = random_window(one.seconds, chance)
            how, words = window_end(one, (start, end))
            ends[how] += 1
            if how == "fault" or "did not settle" in words:
                yield (
                    f"rotorfit identify {one.log} --mass {one.mass} --airframe {one.airframe.name} "
                    f"--start {start:g} --end {end:g}: {words}"
                )
    yield f"{ends.total()} windows: {dict(ends)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="cases with this in their name")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="leave experiments, tables and results here")
    parser.add_argument(
        "--path", action="store_true", help="only show that the path spoils nothing"
    )
    parser.add_argument("--windows", type=float, default=0.0, help="seconds of random windows")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    if options.keep:
        KEPT["folder"] = options.keep.resolve()
    cases = [case for case in CASES if options.only in case.name]
    lines: Iterator[str] = table(cases, options.workers)
    if options.windows:
        lines = window_faults(options.windows, options.seed, options.only)
    elif options.path:
        lines = (path_steps(log) for log in SOUND if options.only in log)
    written = []
    for line in lines:
        print(line, flush=True)
        written.append(line)
    if options.output:
        options.output.write_text("\n".join(written) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
