"""How long does a newcomer take from a log to first parameters, in a terminal?

    python -m benchmarks.stopwatch [--only px4 table]

Runs `rotorfit airframe LOG` and `rotorfit identify LOG` as docs/first-parameters.md gives them,
with the answers that a user types, on the logs of `$ROTORFIT_DATA` (or `../shared/data`), and
prints a row a log: answers, lines on the screen before the numbers and with them, seconds of a
processor of each command, both by the clock, and the longest time of the processor in which nothing
moved on the screen. How fast somebody types is not in them.
"""

import argparse
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from os import openpty
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.common import real_data_folder


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A log, the weighed mass, and what is typed at the questions."""

    log: str
    mass: str
    answers: tuple[str, ...]


ERASED = "\x1b[2K"
"""What a terminal is sent before a line of progress is drawn again."""
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
    "rosbag": Case(
        log="public-faults/fail-rcout-moving-servo.mcap", mass="1.5", answers=("250", "250")
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Ran:
    """What a command took: lines on the screen, seconds of a processor and by the clock.

    - `silence`: longest time of the processor in which nothing moved on the screen [s].
    """

    lines: int
    processor: float
    clock: float
    silence: float


def ran(arguments: Sequence[str], typed: str = "") -> Ran:
    """Run a command of rotorfit to its end: by itself, then with the screen of a terminal.

    A screen on a busy machine takes time of the processor for its progress, as long as it runs.
    """
    command = [sys.executable, "-m", "rotorfit", *arguments]
    before = _children()
    subprocess.run(command, input=typed, text=True, capture_output=True, check=True)
    processor, begun = _children() - before, time.monotonic()
    screen, terminal = openpty()
    running = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=terminal, stderr=terminal, text=True
    )
    os.close(terminal)
    assert running.stdin is not None
    running.stdin.write(typed)
    running.stdin.close()
    shown, silence = watch_screen(running.pid, screen)
    os.close(screen)
    if running.wait():
        raise SystemExit(shown)
    return Ran(
        lines=sum(bool(line.split(ERASED)[-1].strip()) for line in shown.split("\n")),
        processor=processor,
        clock=time.monotonic() - begun,
        silence=silence,
    )


def watch_screen(process: int, screen: int) -> tuple[str, float]:
    """Read a process' screen to its end; return it, and the longest silence [processor s]."""
    shown, silence, last = bytearray(), 0.0, 0.0
    while True:
        try:
            shown += os.read(screen, 65536)
        except OSError:  # Linux says so that the terminal has no more writers
            return shown.decode(errors="replace"), silence
        used = _processor_of(process, last)
        silence, last = max(silence, used - last), used


def _processor_of(process: int, ended: float) -> float:
    """Read how long a process has had a processor [s]; `ended` where it is gone."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ended
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


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
        f"{first.processor:.1f} + {second.processor:.1f} | {first.clock + second.clock:.0f} | "
        f"{max(first.silence, second.silence):.1f} |"
    )


def main() -> None:
    """Print a row for each log."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES))
    only = parser.parse_args().only
    print("| log | answers | lines before, with | processor [s] | by the clock [s] | silence [s] |")
    print("| --- | --- | --- | --- | --- | --- |")
    with TemporaryDirectory() as folder:
        for name in only:
            print(row(CASES[name], Path(folder), real_data_folder()), flush=True)


if __name__ == "__main__":
    main()
