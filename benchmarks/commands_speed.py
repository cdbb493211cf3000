"""Processor time and memory of whole commands, this version against another one.

    python -m benchmarks.commands_speed --against REV [--only WORDS ...] [--repeats 5] [--readme]

REV is a revision, which is built in a worktree and an environment of its own; or the interpreter
of an environment that has it already. This version runs in that environment, too, so that the
dependencies are the same. Every command runs on both in turns, from the start of the process to
its end. Printed are medians of user and system time, and of the most memory that the process had.
Real logs are those of $ROTORFIT_DATA or ../shared/data; simulated flights are written for the run.
The seconds of reading are those of all logs of the command, once their reader is imported.
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final

from benchmarks.speed_cases import (
    CASES,
    FLOWN,
    RESULTS,
    ROOT,
    Case,
    write_declarations,
    write_simulated,
)

HEAD: Final = (
    "| command | CPU s, before | now | before / now | reading s | MB, before | now | now / before |"
)
GROWTH: Final = (("600 s at 200 Hz", 8.5), ("20 flights of 75 s", 20.0))
"""Cases that are 8 and 20 times 75 s at 200 Hz, and the ratio of times that they may have."""
UNREAD: Final = ("refusal: no --mass",)
"""Cases that name a log and need not read it."""
READING: Final = """
import json, sys, time, warnings
from pathlib import Path
warnings.simplefilter("ignore")
from rotorfit.fit.experiment.declared_vehicle import read_options_of
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.logs import ReadOptions, read_log
logs = []
for path in map(Path, sys.argv[1:]):
    if path.suffix == ".toml":
        experiment = load_experiment(path)
        logs += [(Path(f.file), read_options_of(f, experiment.motors))
                 for c in experiment.configuration for f in c.flights]
    else:
        logs.append((path, ReadOptions()))
read_log(logs[0][0], options=logs[0][1])
start = time.process_time()
for path, options in logs:
    read_log(path, options=options)
print(json.dumps(time.process_time() - start))
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """A version of rotorfit: an interpreter, and the source folder where it is not installed."""

    python: Path
    source: Path | None = None

    @property
    def environment(self) -> dict[str, str]:
        """Return the environment of its processes: one thread, and nobody's options."""
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "PYTEST"))}
        threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        return {**kept, **threads, **({"PYTHONPATH": str(self.source)} if self.source else {})}


@dataclass(frozen=True, slots=True, kw_only=True)
class Spent:
    """What a process took: processor seconds, most memory [MB], and how it ended."""

    seconds: float
    megabytes: float
    code: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """The medians of a command in this version and the other, and of reading its logs [s]."""

    case: Case
    now: Spent
    before: Spent
    reading: float | None

    @property
    def text(self) -> str:
        """Return the row of the table."""
        now, before = self.now, self.before
        reading = "" if self.reading is None else f"{self.reading:.2f}"
        codes = "" if now.code == before.code else f" (exit {before.code}, now {now.code})"
        cells = (
            f"{self.case.name}{codes}",
            *(f"{before.seconds:.2f}", f"{now.seconds:.2f}"),
            *(f"{before.seconds / now.seconds:.1f}", reading),
            *(f"{before.megabytes:.0f}", f"{now.megabytes:.0f}"),
            f"{now.megabytes / before.megabytes:.2f}",
        )
        return f"| {' | '.join(cells)} |"


@contextlib.contextmanager
def built(revision: str) -> Generator[Build]:
    """Build a revision in a worktree and an environment of its own."""
    if Path(revision).is_file():
        yield Build(python=Path(revision))
        return
    with tempfile.TemporaryDirectory() as name:
        tree, environment = Path(name) / "tree", Path(name) / "environment"
        git = ("git", "-C", str(ROOT), "worktree")
        subprocess.run([*git, "add", "--detach", str(tree), revision], check=True)
        try:
            python = _installed(tree, environment)
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)
        yield Build(python=python)


def _installed(tree: Path, environment: Path) -> Path:
    """Install a tree into a new environment, with the dependencies of this one."""
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    python = environment / "bin" / "python"
    frozen = subprocess.run(
        [sys.executable, "-m", "pip", "freeze", "--exclude-editable", "--exclude", "rotorfit"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    constraints = environment / "constraints.txt"
    # Only what an index has: a package from a folder or an address is no constraint.
    pinned = [line for line in frozen.splitlines() if "==" in line and "@" not in line]
    constraints.write_text("\n".join(pinned), encoding="utf-8")
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "-c", str(constraints), str(tree)], check=True)
    return python


def spent(build: Build, arguments: Sequence[str], *, typed: str = "", folder: Path) -> Spent:
    """Run a command of rotorfit to its end, in a folder of its own, and return what it took."""
    with tempfile.TemporaryFile() as answers, tempfile.TemporaryFile() as said:
        answers.write(typed.encode())
        answers.seek(0)
        process = subprocess.Popen(
            [str(build.python), "-m", "rotorfit", *arguments],
            stdin=answers,
            stdout=said,
            stderr=said,
            env=build.environment,
            cwd=folder,
        )
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    return Spent(
        seconds=usage.ru_utime + usage.ru_stime,
        megabytes=usage.ru_maxrss / 1024,
        code=process.returncode,
    )


def seconds_of_reading(build: Build, logs: Sequence[str]) -> float:
    """Return the processor time of reading logs, or the logs of experiment files [s]."""
    done = subprocess.run(
        [str(build.python), "-c", READING, *logs],
        capture_output=True,
        text=True,
        env=build.environment,
        check=True,
    )
    return float(json.loads(done.stdout))


def runs_in_turns(builds: Sequence[Build], case: Case, places: Mapping[str, Path]) -> list[Spent]:
    """Run a case once in every build."""
    found: list[Spent] = []
    for build in builds:
        with tempfile.TemporaryDirectory() as out:
            filled = [a.format(**places, out=out) for a in case.arguments]
            found.append(spent(build, filled, typed=case.typed, folder=Path(out)))
    return found


def median_of(runs: Sequence[Spent]) -> Spent:
    """Return the medians of several runs of one command; all must end the same way."""
    codes = {one.code for one in runs}
    if len(codes) > 1:
        raise RuntimeError(f"runs of one command ended differently: exit codes {sorted(codes)}")
    return Spent(
        seconds=median(one.seconds for one in runs),
        megabytes=median(one.megabytes for one in runs),
        code=codes.pop(),
    )


def measured_row(
    now: Build, before: Build, case: Case, places: Mapping[str, Path], *, repeats: int
) -> Row:
    """Measure a case in both builds in turns."""
    runs = [runs_in_turns((now, before), case, places) for _ in range(repeats)]
    logs = [one.format(**places) for one in case.logs_read if case.name not in UNREAD]
    return Row(
        case=case,
        now=median_of([one for one, _ in runs]),
        before=median_of([other for _, other in runs]),
        reading=seconds_of_reading(now, logs) if logs else None,
    )


def chosen_cases(only: Sequence[str], data: Path) -> list[Case]:
    """Select the cases with one of these words in their name, whose logs are there."""
    return [
        case
        for case in CASES
        if (not only or any(words in case.name for words in only))
        and all(Path(one.format(data=data)).exists() for one in case.needed)
    ]


def write_needed(cases: Sequence[Case], places: Mapping[str, Path], build: Build) -> None:
    """Write what these cases need: declarations, simulated flights, results of a build."""
    made = places["made"]
    write_declarations(made, places["data"])
    named = {argument for case in cases for argument in case.arguments}
    for flown in FLOWN:
        for commanded in (False, True):
            folder = f"{flown.name}, {'commanded' if commanded else 'measured'}"
            if f"{{made}}/{folder}/experiment.toml" in named:
                write_simulated(flown, made / folder, commanded=commanded)
    by_name = {case.name: case for case in CASES}
    for result in named & RESULTS.keys():
        case = by_name[RESULTS[result]]
        filled = [one.format(**places) for one in (*case.arguments, "-o", result)]
        spent(build, filled, folder=made)
        if not Path(result.format(**places)).exists():
            sys.exit(f"no result of {case.name}")


def growth_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield how much more long flights and many flights cost than 75 s."""
    seconds = {row.case.name: (row.before.seconds, row.now.seconds) for row in rows}
    for kind in ("measured", "commanded"):
        one = seconds.get(f"identify 75 s at 200 Hz, {kind}")
        for name, most in GROWTH:
            many = seconds.get(f"identify {name}, {kind}")
            if one is not None and many is not None:
                before, now = (many[i] / one[i] for i in range(2))
                yield (
                    f"{name} cost {now:.1f} times as much as 75 s, {kind} (before {before:.1f}; "
                    f"at most {most:g})"
                )


def fleet_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield how many logs a core identifies in a minute."""
    for row in rows:
        if row.case.logs:
            before, now = (60.0 * row.case.logs / s.seconds for s in (row.before, row.now))
            yield (
                f"{row.case.name}: {now:.1f} logs per minute and core (before {before:.1f}, "
                f"{now / before:.1f} times)"
            )


def table(rows: Sequence[Row]) -> str:
    """Return the table with what follows from it, as Markdown."""
    lines = [HEAD, "|---" * HEAD.count(" | ") + "|---|", *(row.text for row in rows)]
    more = [*growth_lines(rows), *fleet_lines(rows)]
    return "\n".join([*lines, *(["", *(f"- {line}" for line in more)] if more else [])])


def main() -> None:
    """Measure, and print a row for each case as it is done."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--against", required=True, help="a revision, or an interpreter with it")
    parser.add_argument("--only", nargs="+", default=[], help="cases with these in their names")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--readme", action="store_true", help="write benchmarks/README.md")
    given = parser.parse_args()
    data = Path(os.environ.get("ROTORFIT_DATA") or ROOT.parent / "shared" / "data").resolve()
    cases = chosen_cases(given.only, data)
    with tempfile.TemporaryDirectory() as name, built(given.against) as before:
        now = Build(python=before.python, source=ROOT / "src")
        places = {"data": data, "made": Path(name)}
        write_needed(cases, places, before)
        print(HEAD, flush=True)
        rows: list[Row] = []
        for case in cases:
            rows.append(measured_row(now, before, case, places, repeats=given.repeats))
            print(rows[-1].text, flush=True)
    for line in (*growth_lines(rows), *fleet_lines(rows)):
        print(line)
    if given.readme:
        write_readme(table(rows))


def write_readme(text: str) -> None:
    """Put the table between its markers in benchmarks/README.md."""
    # Imported last: it brings SciPy, and processes inherit the memory mark of their parent.
    from benchmarks.evidence import replaced

    path = ROOT / "benchmarks" / "README.md"
    page = path.read_text(encoding="utf-8")
    path.write_text(replaced(page, "commands_speed", text), encoding="utf-8")


if __name__ == "__main__":
    main()
