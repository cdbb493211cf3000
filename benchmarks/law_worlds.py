"""Do intervals hold of a flight by commands alone, with the motors' law of another flight?

    python -m benchmarks.law_worlds --seed 71 --worlds 48 -o laws.jsonl  # goes on
    python -m benchmarks.law_worlds --show laws.jsonl

Each world (`benchmarks.worlds`, sound hazards alone, in half of them a battery that sags) flies
twice, from a battery that is charged to 89 to 100 % of its full voltage each time, with another
manoeuvre the second time. The first log has commands and rotor speeds, the second commands alone,
and takes the law by ``result = ...``. In turn both logs have the battery's voltage, the first, the
second, or neither. Prints by that, number by number, how often intervals of the second flight hold,
their half-width and the rms error.
"""

import os
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from benchmarks.joint_worlds import SECONDS, SOUND, given, studied
from benchmarks.worlds.engine import fly
from benchmarks.worlds.sensing import truth, write_world
from benchmarks.worlds.study import identified
from benchmarks.worlds.world import MANOEUVRES, World, draw_world

from rotorfit.errors import RotorfitError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify

Row = dict[str, Any]
SAGS = 0.5
CHARGED = (0.89, 1.0)
"""Voltage at the begin of a flight, as a share of the full one."""
LOGGED = ("both", "first", "second", "neither")
SHOWN = ("kt", "kd", "Jr", "Ixx_com", "Iyy_com", "Izz_com", "motor_lag")


def flights(seed: int, index: int) -> tuple[World, World]:
    """Draw the two flights of a world."""
    rng = np.random.default_rng([seed, index, 98])
    world = draw_world(seed, index, SOUND | {"sag": SAGS}, SECONDS)
    logged = LOGGED[index % len(LOGGED)]
    manoeuvre = str(rng.choice([name for name in MANOEUVRES if name != "throw"]))
    second = replace(world.flight, manoeuvre=manoeuvre, axis=int(rng.integers(4)))
    return (
        _one(world, ("rotor", "command"), logged in ("both", "first"), rng),
        replace(
            _one(world, ("command",), logged in ("both", "second"), rng),
            index=index + 100_000,
            flight=second,
        ),
    )


def _one(world: World, has: tuple[str, ...], voltage: bool, rng: np.random.Generator) -> World:
    """Return a world with a battery as charged as chance has it, and other channels."""
    has = ("gyro", "accel", *has, *("battery",) * voltage)
    log = replace(world.log, driven="measured" if "rotor" in has else "commanded", has=has)
    motors = replace(world.motors, charge=float(rng.uniform(*CHARGED)))
    return replace(world, motors=motors, log=replace(log, law="none"))


def rows(seed: int, indices: Sequence[int]) -> Iterator[Row]:
    """Fly some worlds twice, and identify the second flight by the law of the first."""
    pairs = [flights(seed, index) for index in indices]
    records = fly([world for pair in pairs for world in pair])
    for pair, one, other in zip(pairs, records[::2], records[1::2], strict=True):
        row: Row = {"index": pair[0].index, "voltage": LOGGED[pair[0].index % len(LOGGED)]}
        row["hazards"] = sorted(pair[0].hazards)
        row["charge"] = [world.motors.charge for world in pair]
        if any(record.lost or not record.airborne.any() for record in (one, other)):
            yield row | {"without": "lost"}
            continue
        row["truth"] = truth(pair[1]) | truth(pair[0])
        with tempfile.TemporaryDirectory() as folder:
            first, second = (
                write_world(*x, Path(folder)) for x in ((pair[0], one), (pair[1], other))
            )
            try:
                result = identify(load_experiment(first))
            except RotorfitError as error:
                yield row | {"without": str(error)}
                continue
            law = result.command_law
            if law is None or not law.motors:
                yield row | {"without": "no law"}
                continue
            result.save(first.with_suffix(".json"))
            named = f'speed = "commanded"\nresult = "{first.with_suffix(".json").name}"'
            text = second.read_text(encoding="utf-8").replace('speed = "commanded"', named)
            second.write_text(text, encoding="utf-8")
            row["motors"] = dict(law.motors)
            yield row | {"second": identified(second, row["truth"])}


def report(study: Sequence[Row]) -> list[str]:
    """Return the tables of a study."""
    lines: list[str] = []
    for logged in (*LOGGED, "all"):
        own = [row for row in study if logged in (row["voltage"], "all") and "second" in row]
        refused = [row for row in own if "numbers" not in row["second"]]
        lines += [f"voltage in {logged}: {len(own)} pairs, {len(refused)} refused"]
        lines += [f"  world {row['index']}: {row['second'].get('sentence')}" for row in refused]
        lines += ["  number       holds (of)   half-width: median, rms error [%]"]
        for name in SHOWN:
            found = [
                (*given(row["second"])[name], row["truth"][name])
                for row in own
                if name in given(row["second"]) and row["truth"].get(name)
            ]
            if not found:
                continue
            value, half, true = np.array(found).T
            holds = float((np.abs(value - true) <= half).mean())
            wide, off = 100.0 * half / true, 100.0 * (value / true - 1.0)
            rms = float(np.sqrt(np.mean(off**2)))
            lines += [
                f"  {name:11} {holds:.2f} ({len(found):3})  {np.median(wide):8.1f} {rms:8.1f}"
            ]
    return lines


def main() -> None:
    """Fly a study, or show one."""
    print("\n".join(report(studied(__doc__, "laws.jsonl", rows))))


if __name__ == "__main__":
    main()
