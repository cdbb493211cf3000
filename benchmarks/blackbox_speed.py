"""Blackbox decoding, side by side with orangebox, all fields of all main frames.

    python benchmarks/blackbox_speed.py ../shared/data/*/*.BFL

Both read each file in the same run, best of three, seconds of the processor; orangebox is in the
extra `test`.
"""

import contextlib
import io
import sys
import time
from collections.abc import Callable
from pathlib import Path

import orangebox

from rotorfit.logs.blackbox.decode import decode


def best_of(repeats: int, function: Callable[[], int]) -> tuple[float, int]:
    """Return the shortest time of the processor [s] and what the function returns."""
    seconds, result = float("inf"), 0
    for _ in range(repeats):
        start = time.process_time()
        result = function()
        seconds = min(seconds, time.process_time() - start)
    return seconds, result


def frames_of_orangebox(path: Path) -> int:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return sum(1 for _ in orangebox.Parser.load(str(path)).frames())


def main(paths: list[str]) -> None:
    if not paths:
        sys.exit("usage: python benchmarks/blackbox_speed.py LOG...")
    print(f"{'file':<16}{'MB':>6}{'frames':>9}{'rotorfit':>12}{'orangebox':>12}{'ratio':>8}")
    for path in map(Path, paths):
        size = path.stat().st_size / 1e6
        ours, frames = best_of(3, lambda path=path: len(decode(path.read_bytes()).main))
        theirs, same = best_of(3, lambda path=path: frames_of_orangebox(path))
        if frames != same:
            sys.exit(f"{path}: {frames} main frames, orangebox reads {same}")
        speeds = f"{size / ours:>7.1f} MB/s{size / theirs:>7.1f} MB/s"
        print(f"{path.name:<16}{size:>6.1f}{frames:>9}{speeds}{theirs / ours:>7.1f}x")


if __name__ == "__main__":
    main(sys.argv[1:])
