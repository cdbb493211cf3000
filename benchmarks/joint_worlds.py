"""Is a joint fit of three flights at least as good as the best of them alone?

    python -m benchmarks.joint_worlds --seed 71 --worlds 48 -o joint.jsonl  # goes on
    python -m benchmarks.joint_worlds --show joint.jsonl

Each world (`benchmarks.worlds`, sound hazards alone) flies three times: as drawn, with another
manoeuvre, and with another one in gusts of .02 of the weight; the accelerometer's bias differs by
.03 m/s^2. Each flight is identified alone, then the three together. Prints, number by number, how
often the joint interval holds, and its half-width over that of the narrowest alone; then where the
joint fit refuses, loses a number, or is wider by a fifth and by 2 % of the number. A flight has air
and a centre of mass of its own, so a number that one flight knows to .1 % the three know to .5 %.
"""

import argparse
import json
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from benchmarks.worlds.engine import fly
from benchmarks.worlds.hazards import HAZARDS
from benchmarks.worlds.sensing import truth, write_world
from benchmarks.worlds.study import identified
from benchmarks.worlds.world import MANOEUVRES, World, draw_world

Row = dict[str, Any]
SOUND = {one.name: one.chance for one in HAZARDS if one.kind == "sound"}
SECONDS = 25.0
SAID = ("identified", "weak")
BATCH = 16
"""Worlds that fly at once, three times each."""
WIDER = 1.2
MATTERS = 0.02
"""Of the number: under it, an interval is wider for the air, which differs between flights."""
OWN = ("accel_", "twist", "com_", "motor_", "Ixy", "Ixz", "Iyz")
"""Beginnings of the names of numbers that flights have for themselves, or that are near zero."""


def flights(seed: int, index: int) -> list[World]:
    """Draw the three flights of a world."""
    world, rng = draw_world(seed, index, SOUND, SECONDS), np.random.default_rng([seed, index, 99])
    weight = world.vehicle.mass * 9.81
    stronger = world.air.gust + 0.02 * weight * np.array([1.0, 1.0, 0.7, 0.02, 0.02, 0.02])
    found = [world]
    for number, air in ((1, world.air), (2, replace(world.air, gust=stronger))):
        manoeuvre = str(rng.choice([name for name in MANOEUVRES if name != "throw"]))
        bias = world.sensors.bias + np.concatenate([np.zeros(3), rng.normal(0.0, 0.03, 3)])
        flight = replace(world.flight, manoeuvre=manoeuvre, axis=int(rng.integers(4)))
        sensors = replace(world.sensors, bias=bias)
        other = index + number * 100_000
        found.append(replace(world, index=other, flight=flight, sensors=sensors, air=air))
    return found


def rows(seed: int, indices: Sequence[int]) -> Iterator[Row]:
    """Fly some worlds three times each, and identify their flights alone and together."""
    groups = [flights(seed, index) for index in indices]
    records = iter(fly([world for group in groups for world in group]))
    for group in groups:
        flown = [next(records) for _ in group]
        if any(record.lost for record in flown):
            continue
        known = truth(group[0])
        with tempfile.TemporaryDirectory() as folder:
            each = zip(group, flown, strict=True)
            paths = [write_world(*one, Path(folder)) for one in each]
            together = Path(folder) / "together.toml"
            together.write_text(_together(paths), encoding="utf-8")
            yield {
                "index": group[0].index,
                "hazards": sorted(group[0].hazards),
                "manoeuvres": [world.flight.manoeuvre for world in group],
                "truth": known,
                "alone": [identified(path, known) for path in paths],
                "joint": identified(together, known),
            }


def _together(paths: Sequence[Path]) -> str:
    """Return the experiment of all flights: that of the first with their tables."""
    tables = [f'"{path.with_suffix(".csv").name}"' for path in paths]
    return paths[0].read_text(encoding="utf-8").replace(tables[0], ", ".join(tables))


def given(row: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Return value and half-width of the numbers that a fit gives."""
    numbers = row.get("numbers", {})
    return {name: (v, h) for name, (v, h, verdict) in numbers.items() if verdict in SAID}


def compared(row: Row) -> Iterator[tuple[str, bool, float]]:
    """Yield of each number whether the joint interval holds, and its width over the narrowest."""
    joint, alone = given(row["joint"]), [given(one) for one in row["alone"]]
    for name in sorted(set(joint).union(*alone)):
        narrowest = min((one[name][1] for one in alone if name in one), default=np.inf)
        if name not in joint:
            yield name, True, np.inf
            continue
        value, half = joint[name]
        yield name, abs(value - row["truth"][name]) <= half, half / narrowest


def is_worse(name: str, ratio: float, row: Row) -> bool:
    """Return whether the joint fit is worse than its best flight, by what matters."""
    if ratio <= WIDER or name.startswith(OWN):
        return False
    half = given(row["joint"]).get(name, (0.0, np.inf))[1]
    return half > MATTERS * abs(row["truth"][name])


def report(study: Sequence[Row]) -> list[str]:
    """Return the tables of a study."""
    refused = [row for row in study if "numbers" not in row["joint"]]
    kept = [row for row in study if "numbers" in row["joint"]]
    found = [(row, *one) for row in kept for one in compared(row)]
    lines = [f"{len(study)} worlds of three flights, {len(refused)} refused together"]
    lines += [f"  refused: world {row['index']}: {row['joint'].get('sentence')}" for row in refused]
    lines += ["number          holds (of)   half-width over the narrowest alone: median, 90 %"]
    for name in sorted({one[1] for one in found}):
        own = [one for one in found if one[1] == name and np.isfinite(one[3])]
        if not own:
            continue
        holds, ratio = np.mean([one[2] for one in own]), np.array([one[3] for one in own])
        middle, high = np.median(ratio), np.quantile(ratio, 0.9)
        lines += [f"{name:15} {holds:.2f} ({len(own):3})  {middle:6.2f} {high:6.2f}"]
    worse = [one for one in found if is_worse(one[1], one[3], one[0])]
    count = len({one[0]["index"] for one in worse})
    lines += [f"worse than the best flight alone: {len(worse)} numbers of {count} worlds"]
    return lines + [
        f"  world {row['index']}: {name} " + (f"{ratio:.1f} times" if ratio < np.inf else "lost")
        for row, name, _, ratio in sorted(worse, key=lambda one: -one[3])
    ]


def main() -> None:
    """Fly a study, or show one."""
    print("\n".join(report(studied(__doc__, "joint.jsonl", rows))))


def studied(
    words: str | None, output: str, fly_rows: Callable[[int, Sequence[int]], Iterable[Row]]
) -> list[Row]:
    """Fly what is left of the study that the command line asks for, and return its rows.

    `words`: the program's help; `output`: where its rows go unless said otherwise; `fly_rows`: by
    seed and the numbers of some worlds.
    """
    parser = argparse.ArgumentParser(
        description=words, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=71)
    parser.add_argument("--worlds", type=int, default=48)
    parser.add_argument("-o", "--output", type=Path, default=Path(output))
    parser.add_argument("--show", type=Path)
    asked = parser.parse_args()
    path = asked.show or asked.output
    if asked.show is None:
        left = sorted(set(range(asked.worlds)) - {row["index"] for row in read_studied(path)})
        for first in range(0, len(left), BATCH):
            for row in fly_rows(asked.seed, left[first : first + BATCH]):
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
    return read_studied(path)


def read_studied(path: Path) -> list[Row]:
    """Read the rows of a study that are done."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


if __name__ == "__main__":
    main()
