"""ULog reading, side by side with pyulog in the same run.

    python benchmarks/ulog_speed.py ../shared/data/*/*.ulg

Three ways: all topics by both, and rotorfit's whole reader, which keeps what becomes channels.
Each best of five; pyulog is in the extra `test`.
"""

import contextlib
import io
import sys
import time
from collections.abc import Callable
from pathlib import Path

from pyulog import ULog

from rotorfit.logs import read_log
from rotorfit.logs.ulog.scan import Wanted, scan_file


def best_of(repeats: int, function: Callable[[], int]) -> tuple[float, int]:
    """Return the shortest time of the processor [s] and what the function returns."""
    seconds, result = float("inf"), 0
    for _ in range(repeats):
        start = time.process_time()
        result = function()
        seconds = min(seconds, time.process_time() - start)
    return seconds, result


def messages_of_pyulog(path: Path) -> int:
    with contextlib.redirect_stdout(io.StringIO()):
        return sum(len(data.data["timestamp"]) for data in ULog(str(path)).data_list)


def messages_of_rotorfit(path: Path, names: Wanted) -> int:
    topics = scan_file(path, names).topics
    return sum(len(topic.rows) for found in topics.values() for topic in found)


def main(paths: list[str]) -> None:
    if not paths:
        sys.exit("usage: python benchmarks/ulog_speed.py LOG...")
    print(f"{'file':<30}{'MB':>6}{'messages':>10}{'pyulog':>12}{'all topics':>12}{'read_log':>12}")
    for path in map(Path, paths):
        size = path.stat().st_size / 1e6
        names = dict.fromkeys(scan_file(path, {}).counts)
        theirs, count = best_of(5, lambda path=path: messages_of_pyulog(path))
        ours, same = best_of(5, lambda path=path, names=names: messages_of_rotorfit(path, names))
        whole, _ = best_of(5, lambda path=path: len(read_log(path).channels))
        if count != same:
            sys.exit(f"{path}: {same} messages, pyulog reads {count}")
        speeds = "".join(f"{size / s:>7.0f} MB/s" for s in (theirs, ours, whole))
        print(f"{path.name:<30}{size:>6.1f}{count:>10}{speeds}")


if __name__ == "__main__":
    main(sys.argv[1:])
