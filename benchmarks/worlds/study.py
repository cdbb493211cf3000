"""Fly, identify, write down: worlds in batches, each batch in a process that may die."""

import faulthandler
import json
import math
import multiprocessing
import os
import resource
import threading
import time
import traceback
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any, Final

from benchmarks.worlds.engine import Record, fly
from benchmarks.worlds.sensing import truth, write_world
from benchmarks.worlds.told import tell
from benchmarks.worlds.world import World, draw_world

from rotorfit.errors import RotorfitError
from rotorfit.findings import Evidence
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.results.result import IdentificationResult, configuration_names, verdict_of

BATCH: Final = 50
"""Worlds that advance together: more cost little more, but 9 MB each."""
FLYING: Final = 5.0
"""That one world of a batch may fly [s of a processor]."""
TURNS: Final = ("roll", "pitch", "yaw")
Row = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """Which worlds: their seed, the chance of each hazard, the length of a flight if not drawn.

    `alone`: each world has one of those hazards and no other, in turn; `told`: each is identified
    again with each of its hazards said, or flown without it.
    """

    seed: int
    chance: Mapping[str, float]
    seconds: float | None = None
    keep: Path | None = None
    alone: bool = False
    told: bool = False

    def world(self, index: int) -> World:
        """Draw a world."""
        chance = self.chance
        if self.alone:
            chance = {list(chance)[index % len(chance)]: 1.0}
        return draw_world(self.seed, index, chance, self.seconds)


def rows_of(study: Study, indices: Sequence[int]) -> Iterator[Row]:
    """Fly some worlds together and identify them, one after the other."""
    worlds = [study.world(index) for index in indices]
    begin = time.process_time()
    without = [_without(study, world) if study.told else {} for world in worlds]
    records = fly(worlds + [other for each in without for other in each.values()])
    flown = (time.process_time() - begin) / len(records)
    others = iter(records[len(worlds) :])
    for world, record, each in zip(worlds, records, without, strict=False):
        row = row_of(world, record, study.keep) | {"flown_seconds": round(flown, 2)}
        flights = {hazard: (other, next(others)) for hazard, other in each.items()}
        yield row | ({"told": _told(world, record, flights, row)} if study.told else {})


def _without(study: Study, world: World) -> dict[str, World]:
    """Draw a world without each of its hazards that nothing can be said of."""
    kept = {one: dict.fromkeys(world.hazards - {one}, 1.0) for one in sorted(world.hazards)}
    return {
        hazard: draw_world(study.seed, world.index, chance, study.seconds)
        for hazard, chance in kept.items()
        if tell(world, hazard) is None
    }


def _told(
    world: World, record: Record, flights: Mapping[str, tuple[World, Record]], row: Row
) -> dict[str, tuple[str, Row]]:
    """Return the reference of each hazard of a world, and the numbers of that one."""
    found: dict[str, tuple[str, Row]] = {}
    for hazard in sorted(world.hazards) if "numbers" in row else ():
        said = tell(world, hazard)
        words = "flown without" if said is None else said[0]
        other, flown = flights[hazard] if said is None else (said[1], record)
        found[hazard] = (words, row_of(other, flown).get("numbers", {}))
    return found


def blamed(study: Study, index: int) -> Iterator[tuple[str, Row]]:
    """Yield a world as it is, then without one hazard after the other, by the hazard's name."""
    whole = study.world(index)
    missing = ["", *sorted(whole.hazards)]
    worlds = [
        draw_world(study.seed, index, dict.fromkeys(whole.hazards - {one}, 1.0), study.seconds)
        for one in missing
    ]
    for one, world, record in zip(missing, worlds, fly(worlds), strict=True):
        yield one, row_of(world, record)


def row_of(world: World, record: Record, keep: Path | None = None) -> Row:
    """Identify one world; return its line of the study."""
    begin = time.process_time()
    with TemporaryDirectory() as temporary:
        folder = Path(temporary) if keep is None else keep
        known = truth(world)
        row = _described(world) | {"truth": known}
        if record.lost:
            return row | {"lost": True}
        path = write_world(world, record, folder)
        row |= identified(path, known)
    return row | {"seconds": round(time.process_time() - begin, 2)}


def _described(world: World) -> Row:
    return {
        "seed": world.seed,
        "index": world.index,
        "hazards": sorted(world.hazards),
        "layout": world.vehicle.layout,
        "mass": float(f"{world.vehicle.mass:.4g}"),
        "manoeuvre": world.flight.manoeuvre,
        "driven": world.log.driven,
        "rate": world.log.rate,
        "has": list(world.log.has),
    }


def identified(path: Path, known: Mapping[str, float]) -> Row:
    """Return what the library says of an experiment: a refusal, or numbers and findings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            result = identify(load_experiment(path))
        except RotorfitError as error:
            return {"refused": error.finding.kind, "sentence": str(error)}
        except Exception:
            return {"traceback": traceback.format_exc(limit=-8)}
    return {
        "numbers": _numbers(result, known),
        "sides": next((e.interval for e in _evidence(result, "lever_ratio")), None),
        "gyro": [e.interval for a in TURNS for e in _evidence(result, f"gyro_scale_{a}")],
        "findings": [
            (one.kind, one.severity, one.sentence)
            for one in result.findings
            if one.severity != "passed"
        ],
    }


def _evidence(result: IdentificationResult, name: str) -> Iterator[Evidence]:
    """Yield what a check measured, with its interval."""
    every = (one for finding in result.findings for one in finding.evidence)
    return (one for one in every if one.name == name and one.interval is not None)


def _numbers(result: IdentificationResult, known: Mapping[str, float]) -> Row:
    """Return value, half-width and verdict of each number whose truth is known.

    Of several configurations those of the first, which is that of the world.
    """
    own = (None, configuration_names(result)[0])
    return {
        one.name: (
            one.value,
            0.5 * (one.interval[1] - one.interval[0]),
            verdict_of(result, one) or "identified",
        )
        for one in (*result.parameters, *result.derived)
        if one.name in known
        and one.configuration in own
        and one.value is not None
        and one.interval is not None
    }


def run(
    study: Study,
    indices: Iterable[int],
    output: Path,
    *,
    workers: int,
    time_limit: float,
    batch: int = BATCH,
    options: str = "",
) -> Iterator[Row]:
    """Append each world's line to a file, as they come; yield them.

    Where a world takes longer than the limit [s of a processor], or the batch's process dies, the
    world is written down as that, and the rest is done by another.
    `options` of the command line go into every line.
    """
    waiting = list(indices)
    context = multiprocessing.get_context("spawn")
    at_work: list[_Worker] = []
    with TemporaryDirectory() as folder:
        made = 0
        while waiting or at_work:
            while waiting and len(at_work) < workers:
                chosen, waiting = waiting[:batch], waiting[batch:]
                at_work.append(
                    _Worker(context, study, chosen, Path(folder) / str(made), time_limit)
                )
                made += 1
            for worker in list(at_work):
                ended = worker.ended()
                rows, left = worker.rows(ended)
                rows = [row | {"options": options} for row in rows]
                with output.open("a", encoding="utf-8") as file:
                    file.write("\n" * _torn(output))
                    file.writelines(json.dumps(row) + "\n" for row in rows)
                yield from rows
                if ended:
                    at_work.remove(worker)
                    waiting = left + waiting
            time.sleep(0.3)


def _torn(path: Path) -> bool:
    """Say whether the last line of a file was broken off."""
    return path.stat().st_size > 0 and not path.read_bytes().endswith(b"\n")


class _Worker:
    """A process that works on a batch, and what it has told so far."""

    def __init__(
        self, context: Any, study: Study, indices: list[int], folder: Path, limit: float
    ) -> None:
        folder.mkdir()
        self.indices, self.folder, self.told = indices, folder, 0
        self.process = context.Process(
            target=_work, args=(study, indices, folder, limit), daemon=True
        )
        self.process.start()

    def ended(self) -> bool:
        return not self.process.is_alive()

    def rows(self, ended: bool) -> tuple[list[Row], list[int]]:
        """Return lines that were not told before; if it has ended, what is left to do."""
        path = self.folder / "rows"
        lines = path.read_text(encoding="utf-8").split("\n")[:-1] if path.exists() else []
        fresh = [json.loads(line) for line in lines[self.told :]]
        self.told = len(lines)
        left = self.indices[self.told :] if ended else []
        if left:
            fresh.append({"index": left[0], "died": True, "hazards": []})
            left = left[1:]
        return fresh, left


def _work(study: Study, indices: list[int], folder: Path, limit: float) -> None:
    """Work on a batch in a process of its own, ended from C where a world takes too long."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with (folder / "why").open("w", encoding="utf-8") as why:
        _allow(limit + FLYING * len(indices), why)
        for row in rows_of(study, indices):
            with (folder / "rows").open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            _allow(limit, why)
        faulthandler.cancel_dump_traceback_later()


def _allow(seconds: float, why: IO[str]) -> None:
    """Let this process use so much more of a processor, and twenty times as long by the clock."""
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + seconds), most))
    faulthandler.dump_traceback_later(20.0 * seconds, exit=True, file=why)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def read_rows(path: Path) -> list[Row]:
    """Read the lines of a study, one a world; a line that was not finished is left out."""
    if not path.exists():
        return []
    rows: dict[int, Row] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        rows[row["index"]] = row
    return [rows[index] for index in sorted(rows)]
