"""Crazyflie micro-SD logs, side by side with the decoder among the firmware's tools.

    python benchmarks/crazyflie_speed.py cfusdlog.py ../shared/data/arplab-crazyflie/log15

cfusdlog.py (GPL-3.0, no package) is in github.com/bitcraze/crazyflie-firmware, tools/usdlog: give
its path. Both decode every variable of every record in the same run, best of three, seconds of the
processor; then both read the log without its last half, and with one byte of its middle missing.
"""

import contextlib
import importlib.util
import io
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from rotorfit.errors import LogError
from rotorfit.logs.crazyflie_records import column, find_records, record_times

Decoded = Mapping[str, Mapping[str, np.ndarray]]
Decoder = Callable[[Path], Decoded]


def decoded_by_rotorfit(path: Path) -> Decoded:
    data = path.read_bytes()
    records = find_records(data)
    found: dict[str, dict[str, np.ndarray]] = {}
    for event in records.header.events:
        found[event.name] = {v.name: column(data, records, event, v) for v in event.variables}
        found[event.name]["timestamp"] = 1e3 * record_times(data, records, event)
    return found


def decoder_at(path: Path) -> Decoder:
    spec = importlib.util.spec_from_file_location("cfusdlog", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def decode(log: Path) -> Decoded:
        with contextlib.redirect_stdout(io.StringIO()):
            return module.decode(str(log))

    return decode


def best_of(repeats: int, decode: Decoder, path: Path) -> tuple[float, Decoded]:
    seconds, found = float("inf"), {}
    for _ in range(repeats):
        begin = time.process_time()
        found = decode(path)
        seconds = min(seconds, time.process_time() - begin)
    return seconds, found


def outcome(decode: Decoder, path: Path) -> str:
    """Return how many records come out, or what is raised."""
    try:
        return f"{sum(len(event['timestamp']) for event in decode(path).values())} records"
    except LogError:
        return "refused"
    except Exception as error:
        return type(error).__name__


def main(tool: str, paths: list[str]) -> None:
    readers: dict[str, Decoder] = {
        "rotorfit": decoded_by_rotorfit,
        "cfusdlog": decoder_at(Path(tool)),
    }
    for path in map(Path, paths):
        (ours, mine), (theirs, other) = (best_of(3, decode, path) for decode in readers.values())
        for event, values in other.items():
            for name, numbers in values.items():
                np.testing.assert_allclose(mine[event][name], numbers, err_msg=name)
        size = path.stat().st_size / 1e6
        print(
            f"{path.name}: {size:.1f} MB, {outcome(readers['rotorfit'], path)}; rotorfit "
            f"{size / ours:.1f} MB/s, cfusdlog {size / theirs:.1f} MB/s, ratio {theirs / ours:.0f}"
        )
        data = path.read_bytes()
        middle = len(data) // 2
        with tempfile.TemporaryDirectory() as folder:
            damaged = Path(folder) / path.name
            for what, content in (
                ("first half", data[:middle]),
                ("one byte missing", data[:middle] + data[middle + 1 :]),
            ):
                damaged.write_bytes(content)
                words = [f"{name} {outcome(decode, damaged)}" for name, decode in readers.items()]
                print(f"  {what}: {', '.join(words)}")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: python benchmarks/crazyflie_speed.py cfusdlog.py LOG...")
    main(sys.argv[1], sys.argv[2:])
