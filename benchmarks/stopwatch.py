"""How long does a newcomer take from a log to first parameters, in a terminal?

    python -m benchmarks.stopwatch [--only px4 table]

Runs `rotorfit airframe LOG` and `rotorfit identify LOG` as docs/first-parameters.md gives them,
with the answers that a user types, on the logs of `$ROTORFIT_DATA` (or `../shared/data`), and
prints a row a log: answers, lines on the screen before the numbers and with them, seconds of a
processor of each command, and both by the clock. How fast somebody types is not in them.
"""

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.common import real_data_folder


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A log, the weighed mass, and what is typed at the questions."""

    log: str
    mass: str
    answers: tuple[str, ...]


CASES = {
    "px4": Case(log="autopilot-sitl/px4-hex.ulg", mass="1.7", answers=("519.6", "600")),
    "ardupilot": Case(
        log="autopilot-sitl/ap-heavy-recommended.BIN", mass="3.2", answers=("420", "560")
    ),
    "betaflight": Case(log="betaflight/LOG00037.BFL", mass="unknown", answers=("240", "240")),
    "indiflight": Case(log="tudelft-indiflight/LOG00267.BFL", mass="0.428", answers=("91", "127")),
    "crazyflie": Case(log="arplab-crazyflie/log15", mass="0.027", answers=("65", "65", "usual")),
    "table": Case(
        log="nanobench-crazyflie/B8_star_fast_rep1.csv",
        mass="0.033",
        answers=("counts", "quad-x", "crazyflie", "65", "65", "usual"),
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Ran:
    """What a command took: lines on the screen, seconds of a processor and by the clock."""

    lines: int
    processor: float
    clock: float


def ran(arguments: Sequence[str], typed: str = "") -> Ran:
    """Run a command of rotorfit to its end."""
    before, begun = _children(), time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "rotorfit", *arguments],
        input=typed, capture_output=True, text=True, check=True,
    )  # fmt: skip
    shown = [line for line in (done.stderr + done.stdout).splitlines() if "s so far)" not in line]
    return Ran(lines=len(shown), processor=_children() - before, clock=time.monotonic() - begun)


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def row(case: Case, folder: Path, data: Path) -> str:
    """Run both commands on a log, and write their row."""
    airframe, log = str(folder / "airframe.toml"), str(data / case.log)
    typed = "".join(f"{answer}\n" for answer in case.answers)
    first = ran(["airframe", log, "-o", airframe, "--force"], typed)
    second = ran(["identify", log, "--mass", case.mass, "--airframe", airframe])
    return (
        f"| {Path(case.log).name} | {len(case.answers)} | {first.lines}, {second.lines} | "
        f"{first.processor:.1f} + {second.processor:.1f} | {first.clock + second.clock:.0f} |"
    )


def main() -> None:
    """Print a row for each log."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES))
    only = parser.parse_args().only
    print("| log | answers | lines before, with | processor [s] | by the clock [s] |")
    print("| --- | --- | --- | --- | --- |")
    with TemporaryDirectory() as folder:
        for name in only:
            print(row(CASES[name], Path(folder), real_data_folder()), flush=True)


if __name__ == "__main__":
    main()
