"""ULog reading, side by side with pyulog in the same run: time, memory, damage, hostile files.

    python -m benchmarks.ulog_speed ../shared/data/*/*.ulg

Both read the topics that rotorfit uses (pyulog by its topic filter) with all their fields where
messages are compared, and with those that become channels where time and memory are. Seconds are of
the processor, memory is what a process of its own has at most beyond its beginning (Linux only).
Four tables: whole logs; the largest of them repeated up to `--megabytes`; logs damaged in one
place (`--damaged` of each kind; a message counts as kept if all its bytes are as in the log);
logs whose second half is fill, and files of benchmarks/fuzz.py, `--hostile` of them, each for at
most LIMIT seconds and 4 GB. The same arguments give the same files. pyulog is in the extra `test`.
"""

import argparse
import contextlib
import io
import itertools
import multiprocessing
import random
import resource
import struct
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.fuzz import HEAD, TooSlowError, damaged, forget_peak, peak, time_limit
from benchmarks.fuzz_forgeries import FORGERIES
from benchmarks.large_log import shifted, ulog_times, write_log
from pyulog import ULog

from rotorfit.errors import LogError
from rotorfit.logs.flight_log import in_order
from rotorfit.logs.ulog.read import WANTED
from rotorfit.logs.ulog.scan import Wanted, scan_file

LIMIT = 20.0
ADDRESSES = 4 << 30
LARGEST_DAMAGED = 10_000_000
"""Larger logs take too long to be damaged hundreds of times [bytes]."""
READERS = ("rotorfit", "pyulog")
Rows = Mapping[tuple[str, int], np.ndarray]


def rows_of(reader: str, path: Path, wanted: Wanted) -> Rows:
    """Return the messages of the wanted topics, by topic and instance, in order of time."""
    if reader == "rotorfit":
        topics = scan_file(path, wanted).topics
        return {(n, topic.instance): topic.rows for n, found in topics.items() for topic in found}
    with contextlib.redirect_stdout(io.StringIO()):  # it prints what it meets
        found = ULog(str(path), list(wanted), disable_str_exceptions=True).data_list
    rows: dict[tuple[str, int], np.ndarray] = {}
    for data in found:  # appended data come as topics of their own
        part = data.data["timestamp"].base  # the whole messages, of which it gives one field each
        known = rows.get((data.name, data.multi_id), part[:0])
        rows[data.name, data.multi_id] = (
            np.concatenate([known, part])
            if known.dtype == part.dtype
            else max(known, part, key=len)
        )
    return {key: kept[in_order(kept["timestamp"])] for key, kept in rows.items()}


def alone(function: Callable[..., Any], *given: Any) -> Any:
    """Call a function in a process of its own."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as pool:
        return pool.submit(function, *given).result()


def cost(reader: str, path: Path) -> tuple[float, float, str]:
    """Return seconds, memory [MB] and what came of it."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    forget_peak()
    before, begin = peak(), time.process_time()
    try:
        with time_limit(LIMIT):
            if reader == "rotorfit":
                found = scan_file(path, WANTED).topics.values()
                outcome = str(sum(len(topic.rows) for topics in found for topic in topics))
            else:
                with contextlib.redirect_stdout(io.StringIO()):
                    listed = ULog(str(path), list(WANTED), disable_str_exceptions=True).data_list
                outcome = str(sum(len(data.data["timestamp"]) for data in listed))
    except LogError:
        outcome = "refused"
    except (TooSlowError, MemoryError) as error:
        outcome = "too slow" if isinstance(error, TooSlowError) else "out of memory"
    except Exception as error:
        outcome = type(error).__name__
    return time.process_time() - begin, peak() - before, outcome


def best(reader: str, path: Path, repeats: int = 3) -> tuple[float, float, str]:
    return min(alone(cost, reader, path) for _ in range(repeats))


# Whole logs


def counted(rows: np.ndarray) -> Counter[bytes]:
    """Return how often each message is there."""
    packed = np.ascontiguousarray(rows)
    return Counter(packed.view(f"V{rows.dtype.itemsize}").tolist())


def counts_of(reader: str, path: Path) -> dict[tuple[str, int], Counter[bytes]]:
    return {
        key: counted(rows) for key, rows in rows_of(reader, path, dict.fromkeys(WANTED)).items()
    }


def print_whole(paths: list[Path], repeats: int) -> None:
    """Print time and memory; leave where one number of the two differs."""
    for path in paths:
        if repeats > 1 and counts_of("rotorfit", path) != counts_of("pyulog", path):
            raise SystemExit(f"{path}: the readers differ")
        ours, theirs = (best(reader, path, repeats) for reader in READERS)
        print(
            f"{path.name:<30}{path.stat().st_size / 1e6:>7.1f}{ours[2]:>10}"
            f"{ours[0]:>8.2f} s{ours[1]:>6.0f} MB{theirs[0]:>8.2f} s{theirs[1]:>6.0f} MB"
            f"{theirs[0] / ours[0]:>7.1f}{theirs[1] / ours[1]:>6.1f}",
            flush=True,
        )


def repeated(path: Path, megabytes: float, folder: Path) -> Path:
    """Write a real log with its data again and again, their times going on."""
    data, made = path.read_bytes(), folder / f"repeated-{path.name}"
    start, places = ulog_times(data)
    times = np.frombuffer(data, np.uint8)[places[:, None] + np.arange(8)].view("<u8")
    step = int(times.max()) - int(np.median(times[: len(times) // 100])) + 10_000
    write_log(
        made, itertools.chain([data], shifted(data[start:], places - start, step)), megabytes * 1e6
    )
    return made


# Damage in one place


def cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data))]


def flipped(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(20):
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def lost(data: bytes, rng: random.Random) -> bytes:
    size = rng.choice((1, 7, 64, 512, 4096))
    begin = rng.randrange(len(data) - size)
    return data[:begin] + data[begin + size :]


def sector(data: bytes, rng: random.Random, content: Callable[[int], bytes]) -> bytes:
    """Put something else into one sector or eight of the card."""
    size = rng.choice((512, 4096))
    begin = rng.randrange(len(data) - size) // 512 * 512
    return data[:begin] + content(size) + data[begin + size :]


def stale(data: bytes, rng: random.Random) -> bytes:
    begin = rng.randrange(len(data) - 4096) // 512 * 512
    return sector(data, rng, lambda size: data[begin : begin + size])


KINDS: Mapping[str, Callable[[bytes, random.Random], bytes]] = {
    "cut off": cut,
    "20 bits flipped": flipped,
    "bytes lost": lost,
    "sectors of zeros": lambda data, rng: sector(data, rng, bytes),
    "sectors of noise": lambda data, rng: sector(data, rng, rng.randbytes),
    "stale sectors": stale,
}


def share_lost(reader: str, path: Path, whole: Mapping[tuple[str, int], Counter[bytes]]) -> float:
    """Return the share of a log's messages that a reader does not give back."""
    try:
        found = counts_of(reader, path)
    except Exception:  # whatever pyulog raises, nothing was read
        found = {}
    kept = sum((found.get(key, Counter()) & rows).total() for key, rows in whole.items())
    return 1.0 - kept / sum(rows.total() for rows in whole.values())


def losses(path: Path, kind: str, count: int, folder: Path) -> dict[str, list[float]]:
    data, target = path.read_bytes(), folder / "damaged.ulg"
    whole = counts_of("rotorfit", path)
    shares: dict[str, list[float]] = {reader: [] for reader in READERS}
    rng = random.Random(f"{path.name} {kind}")
    for _ in range(count):
        target.write_bytes(KINDS[kind](data, rng))
        for reader in READERS:
            shares[reader].append(share_lost(reader, target, whole))
    return shares


def print_damaged(paths: list[Path], count: int, folder: Path) -> None:
    for path in (p for p in paths if p.stat().st_size < LARGEST_DAMAGED):
        for kind in KINDS:
            found = {r: np.array(s) for r, s in losses(path, kind, count, folder).items()}
            words = "".join(
                f"{100 * s.mean():>10.2f} %{100 * np.median(s):>7.2f} %{np.sum(s > 0.1):>5}"
                for s in found.values()
            )
            ours, theirs = found.values()
            more = f"{np.sum(ours < theirs - 1e-9):>9}{np.sum(theirs < ours - 1e-9):>6}"
            print(f"{path.name:<30}{kind:<18}{count:>4}{words}{more}", flush=True)


# Fill, and files that were made to do harm


def print_filled(paths: list[Path], folder: Path) -> None:
    for path in paths:
        data = path.read_bytes()
        for name, byte in (("zeros", b"\0"), ("erased flash (0xFF)", b"\xff")):
            made = folder / "filled.ulg"
            size = min(len(data) // 2, 2_000_000)
            made.write_bytes(data[: len(data) // 2] + byte * size)
            print_pair(f"{path.name}, half, then {size / 1e6:.2f} MB of {name}", made)
    bomb = folder / "nested.ulg"
    bomb.write_bytes(nested_formats(paths[0].read_bytes()[:16]))
    print_pair(f"{bomb.stat().st_size} bytes that declare a large format", bomb)


def nested_formats(head: bytes) -> bytes:
    texts = (b"Fa:uint8_t[60000] x;", b"Fb:a[300] y;", b"Fc:b[60000] y;", b"A\0\0\0c")
    return head + b"".join(struct.pack("<H", len(text) - 1) + text for text in texts)


def print_pair(name: str, path: Path) -> None:
    costs = [alone(cost, reader, path) for reader in READERS]
    words = "".join(f"{s:>9.2f} s{mb:>7.0f} MB {what:>13}" for s, mb, what in costs)
    print(f"{name:<72}{words}", flush=True)


def print_hostile(paths: list[Path], count: int, folder: Path) -> None:
    """Print how often and how long the readers are busy with files that were damaged on purpose."""
    made = alone(hostile_costs, paths, count, folder)
    for reader, found in made.items():
        seconds, memory = (np.array([c[k] for c in found]) for k in (0, 1))
        words = Counter(what for _, _, what in found if not what.isdigit())
        over = ", ".join(f"{np.sum(seconds > s)} over {s} s" for s in (1, 5, 10))
        print(
            f"{reader:<10}{len(found):>6} files: slowest {seconds.max():.2f} s, {over}; "
            f"{memory.max():.0f} MB; {dict(words)}"
        )


def hostile_costs(paths: list[Path], count: int, folder: Path) -> dict[str, list[Any]]:
    seeds = [path.read_bytes()[:HEAD] for path in paths]
    rng, target = random.Random(1), folder / "hostile.ulg"
    costs: dict[str, list[Any]] = {reader: [] for reader in READERS}
    for _ in range(count):
        target.write_bytes(damaged(seeds, seeds, rng, FORGERIES["ulog"]))
        for reader in READERS:
            costs[reader].append(cost(reader, target))
    return costs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--megabytes", type=float, default=500.0)
    parser.add_argument("--damaged", type=int, default=40)
    parser.add_argument("--hostile", type=int, default=500)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        print(f"{'log':<30}{'MB':>7}{'messages':>10}{'rotorfit':>19}{'pyulog':>19}{'ratios':>13}")
        print_whole(given.logs, 3)
        if given.megabytes:
            largest = max(given.logs, key=lambda path: path.stat().st_size)
            print_whole([repeated(largest, given.megabytes, folder)], 1)
        if given.damaged:
            print(
                "\nmessages lost: mean, median, files that lose more than a tenth; who keeps more"
            )
            print(f"{'log':<30}{'damage':<18}{'':>4}{'rotorfit':>26}{'pyulog':>26}")
            print_damaged(given.logs, given.damaged, folder)
        print()
        print_filled(given.logs, folder)
        if given.hostile:
            print()
            print_hostile(given.logs, given.hostile, folder)


if __name__ == "__main__":
    main()
