"""The command line of the study."""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import benchmarks.worlds as about
from benchmarks.worlds.hazards import HAZARDS, chances
from benchmarks.worlds.study import BATCH, Row, Study, blamed, read_rows, rows_of, run
from benchmarks.worlds.tables import report


def main() -> None:
    """Run, repeat or show."""
    asked = _parser().parse_args()
    if asked.list:
        print("\n".join(f"{h.name:18s} {h.chance:5.3f} {h.kind:9s} {h.what}" for h in HAZARDS))
    elif asked.show:
        before = read_rows(asked.against) if asked.against else []
        print("\n".join(report(read_rows(asked.show), before)))
    elif asked.only and asked.blame:
        for index in asked.only:
            _blame(_study(asked), index)
    elif asked.only:
        _again(_study(asked), asked.only)
    else:
        _run(asked)


def _study(asked: argparse.Namespace) -> Study:
    if asked.keep:
        asked.keep.mkdir(parents=True, exist_ok=True)
    return Study(
        seed=asked.seed,
        chance=chances(asked.hazards, asked.invisible),
        seconds=asked.seconds,
        keep=asked.keep,
        alone=asked.alone,
        told=asked.told,
    )


def _run(asked: argparse.Namespace) -> None:
    """Fly and identify what is not in the file yet."""
    done = {row["index"] for row in read_rows(asked.output)}
    todo = [i for i in range(asked.first, asked.first + asked.worlds) if i not in done]
    study = _study(asked)
    for row in run(
        study, todo, asked.output, workers=asked.workers, time_limit=asked.time_limit,
        batch=asked.batch, options=_options(asked),
    ):  # fmt: skip
        print(_line(row), file=sys.stderr, flush=True)
    print("\n".join(report(read_rows(asked.output))))


def _options(asked: argparse.Namespace) -> str:
    """Return the options that a world is drawn by, but for its seed and number."""
    options = "" if asked.hazards is None else " ".join([" --hazards", *asked.hazards])
    options += "" if asked.seconds is None else f" --seconds {asked.seconds:g}"
    return options + " --invisible" * asked.invisible + " --alone" * asked.alone


def _again(study: Study, indices: list[int]) -> None:
    """Fly and identify some worlds, and print all about them."""
    for index in indices:
        for row in rows_of(study, [index]):
            print(_line(row))
            for name, (value, half, verdict) in row.get("numbers", {}).items():
                true = row["truth"][name]
                mark = "!" if abs(value - true) > half else ""
                print(
                    f"  {name:14s} {value:12.5g} +- {half:10.3g}  true {true:12.5g} {verdict}{mark}"
                )
            for kind, severity, sentence in row.get("findings", ()):
                print(f"  {severity} [{kind}] {sentence}")
            print(row.get("traceback", ""), end="")


def _blame(study: Study, index: int) -> None:
    """Print what is outside in a world, then without one hazard after the other."""
    for missing, row in blamed(study, index):
        print(f"without {missing}: " if missing else _line(row) + "\n  as it is: ", end="")
        print(row.get("sentence", " ".join(_outside(row)) or "holds"), flush=True)


def _outside(row: Row) -> list[str]:
    """Return the identified numbers that do not hold, with error and half-width in percent."""
    return [
        f"{name} {100 * (value / true - 1):+.1f}+-{100 * abs(half / true):.1f}"
        if (true := row["truth"][name])
        else f"{name} {value:.2g}+-{half:.2g}"
        for name, (value, half, verdict) in row.get("numbers", {}).items()
        if verdict == "identified" and abs(value - row["truth"][name]) > half
    ]


def _line(row: Row) -> str:
    """Return one world in a line."""
    if row.get("died"):
        return f"world {row['index']}: took too long, or its process died"
    said = f"refused [{row['refused']}] {row['sentence']}" if "refused" in row else ""
    said = "out of control" if row.get("lost") else said
    said = "TRACEBACK" if "traceback" in row else said
    outside = [text.split()[0] for text in _outside(row)]
    said = said or (f"outside: {', '.join(outside)}" if outside else "holds")
    about = f"{row['layout']} {row['mass']} kg {row['manoeuvre']} {row['driven']} {row['rate']} Hz"
    return f"world {row['index']}: {about}: {' '.join(row['hazards'])}: {said}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=about.__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add: Any = parser.add_argument
    add("--worlds", type=int, default=100)
    add("--first", type=int, default=0, help="number of the first world")
    add("--seed", type=int, default=1)
    add("--workers", type=int, default=1)
    add("--batch", type=int, default=BATCH, help="worlds that fly together")
    add("--seconds", type=float, help="length of every flight, else drawn")
    add("--time-limit", type=float, default=120.0, help="of one world [s of a processor]")
    add("-o", "--output", type=Path, default=Path("worlds.jsonl"))
    add("--hazards", nargs="*", help="these alone: name, or name=chance")
    add("--alone", action="store_true", help="one hazard a world, one after the other")
    add("--told", action="store_true", help="each again with its hazards said, or without them")
    add("--invisible", action="store_true", help="draw what no log can show, too")
    add("--only", type=int, nargs="+", help="these worlds again, and all that is said of them")
    add("--blame", action="store_true", help="and without one of their hazards after the other")
    add("--keep", type=Path, help="leave tables and experiment files here")
    add("--show", type=Path, help="print the tables of a study")
    add("--against", type=Path, help="with those of an earlier one beside them")
    add("--list", action="store_true", help="list the hazards")
    return parser


if __name__ == "__main__":
    main()
