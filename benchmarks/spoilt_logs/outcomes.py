"""What the command line makes of a case, and what is to be made of that."""

import dataclasses
import json
import os
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from benchmarks.common import (
    SOUND,
    airframe_text,
    read_sound,
    real_data_folder,
    table_columns,
    without_progress,
)
from benchmarks.same_numbers import TABLES
from benchmarks.spoilt_logs.cases import Flown, Spoilt

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
HEAD: Final = (
    "| log | fault | class | numbers outside | nuisances outside | what is said |\n"
    "|---|---|---|---|---|---|"
)
MOST_SHOWN: Final = 3
"""Numbers outside on the page of the documentation."""
DIGITS: Final = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?")


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

    @property
    def hangs_on(self) -> list[str]:
        """What stands under a result as not to be told by any flight."""
        return [] if self.result is None else self.result["settings"]["used"]["hangs_on"]

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
    return Said(code=ended.returncode, error=without_progress(ended.stderr).strip(), result=result)


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
    if case.hangs_on and _naming(case.hangs_on, said.hangs_on):
        return "hangs on"
    return "vague" if new else "SILENT"


def _naming(pattern: str, sentences: Sequence[str]) -> list[str]:
    """Return the sentences that name a cause."""
    return [words for words in sentences if re.search(pattern, words, re.IGNORECASE)]


def telling(case: Spoilt, said: Said) -> str:
    """Return the one sentence that tells a user most: the refusal, the cause, or what hangs on."""
    if said.code:
        return said.error.removeprefix("rotorfit: ")
    new = new_sentences(case, said)
    hanging = _naming(case.hangs_on, said.hangs_on) if case.hangs_on else []
    return next(iter([*_naming(case.cause, new), *hanging, *new]), "")


def row(case: Spoilt, said: Said) -> str:
    """Return a case as a row of the table."""
    words = [said.error] if said.code else new_sentences(case, said)
    wrong = "; ".join(str(o) for o in outside(case, said, VEHICLE))
    besides = "; ".join(str(o) for o in outside(case, said, NUISANCES))
    cells = (case.log, case.fault, classified(case, said), wrong, besides, " / ".join(words))
    return f"| {' | '.join(cell.replace('|', '/').replace(chr(10), ' ') for cell in cells)} |"


def page_row(case: Spoilt, said: Said) -> str:
    """Return a case as a row of the page of the documentation."""
    wrong = "; ".join(str(o) for o in outside(case, said, VEHICLE)[:MOST_SHOWN])
    cells = (case.log, case.fault, classified(case, said), wrong, telling(case, said))
    return f"| {' | '.join(cell.replace('|', '/').replace(chr(10), ' ') for cell in cells)} |"


def page_table(told: Sequence[tuple[Spoilt, Said]]) -> str:
    """Return the table of the page, and how many cases end in which way."""
    ends = Counter(classified(case, said) for case, said in told)
    counted = ", ".join(f"{n} {name}" for name, n in ends.most_common())
    head = "| log | fault | outcome | numbers outside | what is said |\n|---|---|---|---|---|"
    rows = "\n".join(page_row(case, said) for case, said in told)
    return f"{len(told)} cases: {counted}.\n\n{head}\n{rows}"


def all_told(cases: Sequence[Spoilt], workers: int) -> Iterator[tuple[Spoilt, Said]]:
    """Yield the cases and what is told of them, as they come."""
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(unspoilt, sorted({case.log for case in cases})))
        said = pool.map(lambda case: told_of(case, KEPT.get("folder")), cases)
        yield from zip(cases, said, strict=True)


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
