"""Write the tables of the first page and docs/evidence.md: flights with an independent truth.

    python -m benchmarks.evidence [--workers 2] [--check]

Identifies the logs of `$ROTORFIT_DATA` (or `../shared/data`) with the default estimate: one real
quadrotor beside its bench and its source's own learner, real Crazyflies beside their thrust stands,
PX4 and ArduCopter flying vehicles of known parameters, and flights of an independent engine. What
stands between the markers `<!-- NAME -->` and `<!-- end of NAME -->` is replaced. --check writes
nothing and ends with an error where a page shows something else.
"""

import argparse
import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from benchmarks.common import real_data_folder
from benchmarks.real_flights import SHOWN, STANDS, Case, Outcome, cases, outcome

from rotorfit.digits import number_of

ROOT = Path(__file__).parents[1]
README, EVIDENCE = ROOT / "README.md", ROOT / "docs" / "evidence.md"
SHOWCASE = (267, 271, 340)
Span = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Bench:
    """A number of the 3-inch quadrotor: its words, unit, bench and learner in flight."""

    name: str
    words: str
    bench: Span
    learner: float | None = None


BENCH = (
    Bench("kt", "thrust kt [N s²]", (2.66e-7, 2.66e-7)),
    Bench("Jr", "rotor inertia Jr [kg m²]", (8.96e-7, 8.96e-7), 0.97e-3 * 8.86e-4),
    Bench("motor_lag", "motor lag [s]", (0.020, 0.025)),
    Bench("Izz_com", "yaw inertia Izz [kg m²]", (8.86e-4, 8.86e-4)),
    Bench("Iyy_com", "pitch inertia Iyy [kg m²]", (7.757e-4, 7.757e-4), 2.66e-7 * 0.0455 / 1.83e-5),
    Bench("Ixx_com", "roll inertia Ixx [kg m²]", (7.206e-4, 7.206e-4), 2.66e-7 * 0.0635 / 2.93e-5),
    Bench("kd", "drag torque kd [N m s²]", (2.66e-9, 2.66e-9), 4.4e-6 * 8.86e-4),
)
"""The learner gives ratios (roll 2.93e-5, pitch 1.83e-5, Jr/Izz .97e-3, kd/Izz 4.4e-6).

Shown is each times the bench's other number.
"""
STAND: Final = (0.187, 0.323)
"""The Crazyflie's thrust on a stand: of four rotors, times command and squared command [N]."""


def power_of_stand(command: float = 0.662) -> float:
    """Return the power of a command with which the stand's thrust grows: 0.662 hovers."""
    linear, square = STAND
    return (linear + 2 * square * command) / (linear + square * command)


SLOPE: Final = power_of_stand() / 2
"""How much less thrust grows with the command in hover than its square: the authors' fits take the
square, and inertia goes with that slope."""
LEVERS: Final = 0.0325 / 0.028
"""The maker's over the authors', with which the lower numbers of theirs are."""
CRAZYFLIE: Mapping[str, Span] = {
    "kt": (sum(STAND) / 4, sum(STAND) / 4),  # at full command
    "motor_lag": (0.070, 0.090),
    "Ixx_com": (1.6e-5 * LEVERS * SLOPE, 2.0e-5 * SLOPE),
    "Iyy_com": (1.65e-5 * LEVERS * SLOPE, 2.05e-5 * SLOPE),
}
"""From the thrust stand, and the authors' own fits with its slope at the maker's arm."""
STAND_TOLERANCE: Final[Mapping[float, float]] = {
    STANDS["brushed"]: 0.02,
    STANDS["payload"]: 0.003,
}
"""Of the k_t of a stand, as a share: another specimen of the same motor and propeller, and the
reading of the scale under the vehicle that flew (README of the logs)."""


def showcase(data: Path) -> Case:
    """Return three throws of the 3-inch quadrotor as one experiment."""
    alone = next(case for case in cases(data) if case.name == f"cinerat {SHOWCASE[0]}")
    log = str(data / "tudelft-indiflight" / f"LOG{SHOWCASE[0]:05d}.BFL")
    logs = '", "'.join(log.replace(f"{SHOWCASE[0]:05d}", f"{one:05d}") for one in SHOWCASE)
    return replace(alone, declaration=alone.declaration.replace(log, logs))


def readme_table(found: Outcome) -> str:
    """Return the table of the first page."""
    lines = [
        "| number | rotorfit, 95 % interval | its own learner in flight | bench | bench inside? |",
        "| --- | --- | --- | --- | --- |",
    ]
    for row in BENCH:
        value, half, _ = found.numbers[row.name]
        held = holds(value, half, row.bench)
        apart = abs(value - row.bench[0]) / row.bench[0]
        learner = "–" if row.learner is None else rounded(row.learner)
        verdict = (
            "yes"
            if held
            else f"no: {100 * apart:.2g} % apart, interval ± {100 * half / value:.2g} %"
        )
        lines.append(
            f"| {row.words} | {number_of(value, (value - half, value + half))} | {learner} "
            f"| {spanned(row.bench)} | {verdict} |"
        )
    return "\n".join(lines)


def holds(value: float, half: float, truth: Span) -> bool:
    """Return whether an interval and what is true of the number meet."""
    return value - half <= truth[1] and value + half >= truth[0]


def spanned(truth: Span) -> str:
    """Format a truth, or the range that its source gives."""
    low, high = (rounded(end) for end in truth)
    return low if truth[0] == truth[1] else f"{low} to {high}"


def rounded(number: float) -> str:
    """Format a number that comes without an interval, to four digits."""
    return str(number_of(float(f"{number:.4g}"), None))


def scoreboard(rows: Iterable[tuple[str, str, Mapping[str, Span], Outcome]]) -> str:
    """Return the summary and one table a vehicle."""
    rows = list(rows)
    head = [
        "| flight | truth from | numbers | inside their interval | median half-width |",
        "| --- | --- | --- | --- | --- |",
    ]
    parts: list[str] = []
    for name, source, truth, found in rows:
        shown = [key for key in truth if key in found.numbers]
        held = [holds(*found.numbers[key][:2], truth[key]) for key in shown]
        halves = sorted(
            100 * found.numbers[key][1] / abs(truth[key][0]) for key in shown if truth[key][0]
        )
        half = f"{halves[len(halves) // 2]:.2g} %" if halves else "–"
        refused = "refused" if found.refused else f"{sum(held)} of {len(held)}"
        head.append(f"| {name} | {source} | {len(shown)} | {refused} | {half} |")
        parts += ["", f"### {name}", "", *vehicle_table(truth, found)]
    return "\n".join([*head, *parts])


def vehicle_table(truth: Mapping[str, Span], found: Outcome) -> list[str]:
    """Return every number that has a truth, and what became of it."""
    lines = ["| number | truth | rotorfit, 95 % interval | verdict | inside |"]
    lines.append("| --- | --- | --- | --- | --- |")
    for name, true in truth.items():
        if name not in found.numbers:
            lines.append(f"| `{name}` | {spanned(true)} | – | not given | – |")
            continue
        value, half, verdict = found.numbers[name]
        shown = number_of(value, (value - half, value + half))
        inside = "yes" if holds(value, half, true) else "**no**"
        lines.append(f"| `{name}` | {spanned(true)} | {shown} | {verdict or 'ratio'} | {inside} |")
    return lines


def replaced(text: str, name: str, block: str) -> str:
    """Return a page with the block between its markers replaced."""
    found = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end of {name} -->)", re.S)
    if len(found.findall(text)) != 1:
        sys.exit(f"the page lacks the markers of {name}")
    return found.sub(lambda match: f"{match[1]}\n{block}\n\n{match[2]}", text)


def board(data: Path) -> list[tuple[str, str, Mapping[str, Span], Case]]:
    """Return what is on the scoreboard: name, source of the truth, truth, case."""
    bench = {row.name: row.bench for row in BENCH}
    rows = [("3-inch quadrotor, three throws", "bench and pendulum", bench, showcase(data))]
    for case in cases(data):
        truth = {name: (true, true) for name, true in case.truth.items() if name in SHOWN}
        if case.group == "autopilots":
            rows.append((case.name, "the simulator's parameters", truth, case))
        elif case.group == "worlds":
            rows.append((f"world {case.name}", "MuJoCo, random vehicle", truth, case))
        elif case.group == "crazyflie":
            rows.append(("Crazyflie 2.1, commands alone", "thrust stand, authors", CRAZYFLIE, case))
        elif case.group == "imrc":
            rows.append((_crazyflie_title(case.name), "thrust stand", _stand_spans(case), case))
    return rows


def _crazyflie_title(name: str) -> str:
    """Return the row of a flight of a weighed Crazyflie."""
    vehicle = "brushless, cable payload" if "payload" in name else "brushed"
    return f"Crazyflie {vehicle}, {name.removeprefix('imrc ').removeprefix('payload_')}"


def _stand_spans(case: Case) -> dict[str, Span]:
    """Return what a stand measured, with its tolerance."""
    return {
        name: (true * (1.0 - STAND_TOLERANCE[true]), true * (1.0 + STAND_TOLERANCE[true]))
        for name, true in case.truth.items()
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the tables, or compare them with what the pages show."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--check", action="store_true")
    asked = parser.parse_args(arguments)
    rows = board(real_data_folder())
    with ProcessPoolExecutor(asked.workers) as pool:
        outcomes = list(pool.map(outcome, (case for *_, case in rows)))
    found = [(*row[:3], one) for row, one in zip(rows, outcomes, strict=True)]
    for path, name, block in (
        (README, "real flight", readme_table(outcomes[0])),
        (EVIDENCE, "scoreboard", scoreboard(found)),
    ):
        old = path.read_text(encoding="utf-8")
        new = replaced(old, name, block)
        if asked.check and new != old:
            sys.exit(f"{path.name} shows another {name}: run  python -m benchmarks.evidence")
        if not asked.check:
            path.write_text(new, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
