"""Damaged files for every reader: only a FlightLog or a LogError may come out, soon and in bounds.

    python -m benchmarks.fuzz --seconds 600            # of the processor, for each format
    python -m benchmarks.fuzz --format ulog --seconds 60 --seed 7

Each format is read in a process of its own, and hypothesis makes every choice. The inputs are
whole logs (a simulated flight in every format, short ones with absurd clocks and values, and the
first 200 kB of real logs where they are there) that were forged (`fuzz_forgeries.py`), cut,
flipped, spliced, given huge lengths or deep nesting. A file may take `SECONDS` of the processor
and `MEGABYTES` of memory over what the process had before; a warning counts as a fault, and so
does a refusal of more than `LONGEST` letters. What breaks this is saved in the folder
`--findings`, and the run ends with exit code 1. Beside the logs, the experiment file is read.
"""

import argparse
import contextlib
import itertools
import json
import math
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.common import real_data_folder
from benchmarks.fuzz_forgeries import FORGERIES, TEXT, Forgery
from benchmarks.fuzz_made import strange

ROOT = Path(__file__).parents[1]
SECONDS = 10.0
"""Of the processor that one file may take."""
MEGABYTES = 400.0
"""More than the process had before, that one file may take; the largest input has 1 MB."""
LARGEST = 1_000_000
LONGEST = 2000
"""Letters of a refusal: it is one line for a person."""
STRANGE = 25
"""Flights with absurd clocks or values, for each format."""
ROUND = 300
"""Files that one search of hypothesis tries; it remembers them all."""
HEAD = 200_000
REAL = {
    "ulog": "px4-ulog/*.ulg",
    "dataflash": "ardupilot-dronekit/*.bin",
    "crazyflie": "nanobench-crazyflie/*",
    "blackbox": "*/*.BFL",
    "table": "*/*.csv",
}
WORDS = [
    *(bytes([b]) * n for b in (0, 0x7F, 0x80, 0xFF) for n in (1, 2, 4, 8)),
    *(value.to_bytes(4, "little") for value in (1 << 16, 1 << 24, 1 << 31, 0x7FFFFFFF)),
    *(value.to_bytes(8, "little") for value in (1 << 32, 1 << 40, 1 << 62, (1 << 63) - 1)),
    (0x7FFFFFFF).to_bytes(4, "big"),
    bytes.fromhex("0000c07f"),  # NaN
    bytes.fromhex("0000807f"),  # infinity
    *(b"9" * 30, b"1e999", b"nan", b"-", b'"', b"\n", b",", b"\t", b"[", b"65535", b"0x", b"e+"),
]
NESTS = [
    b"[" * 4000,
    b'{"a":' * 3000,
    b"(" * 5000,
    b"uint8_t[65535] a;" * 300,
    b"a/A[1000] a\n===\nMSG: a/A\n" * 200,
    b"float[4294967295] x;",
    b"\x12" * 8000,
    b"\x03" * 8000,
]


@dataclass(kw_only=True)
class Tally:
    """What a worker did."""

    name: str
    executions: int = 0
    read: int = 0
    refused: int = 0
    seconds: float = 0.0
    slowest: float = 0.0
    megabytes: float = 0.0
    findings: int = 0


class TooSlowError(BaseException):
    """No reader may catch it."""


class EnoughError(BaseException):
    """The time is over; hypothesis may not catch it."""


# Damage


def cut(data: bytes, other: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def flipped(data: bytes, other: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 16, 64))):
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def overwritten(data: bytes, other: bytes, rng: random.Random) -> bytes:
    """Put words that are bad lengths, numbers or separators, most of them near the beginning."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4))):
        word = rng.choice(WORDS)
        place = int(len(out) * rng.random() ** rng.choice((1, 4)))
        out[place : place + len(word)] = word
    return bytes(out)


def removed(data: bytes, other: bytes, rng: random.Random) -> bytes:
    a = rng.randrange(len(data))
    return data[:a] + data[a + rng.choice((1, 2, 4, 60, 1000, 20000)) :]


def repeated(data: bytes, other: bytes, rng: random.Random) -> bytes:
    a = rng.randrange(len(data))
    piece = data[a : a + rng.choice((1, 4, 60, 1000))]
    return data[:a] + piece * rng.choice((2, 10, 300)) + data[a:]


def spliced(data: bytes, other: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data))] + other[rng.randrange(len(other)) :]


def inserted(data: bytes, other: bytes, rng: random.Random) -> bytes:
    a, b = rng.randrange(len(data)), rng.randrange(len(other))
    return data[:a] + other[b : b + rng.choice((8, 100, 5000))] + data[a:]


def nested(data: bytes, other: bytes, rng: random.Random) -> bytes:
    place = int(len(data) * rng.random() ** 3)
    return data[:place] + rng.choice(NESTS) + data[place:]


def with_tail(data: bytes, other: bytes, rng: random.Random) -> bytes:
    tail = random.Random(rng.getrandbits(32))  # one choice of the search, not thousands
    return data + tail.randbytes(rng.choice((1, 7, 100, 5000, 60000)))


DAMAGES = (cut, flipped, overwritten, removed, repeated, spliced, inserted, nested, with_tail)


def damaged(
    seeds: list[bytes],
    others: list[bytes],
    rng: random.Random,
    forgeries: tuple[Forgery, ...] = (),
) -> bytes:
    """Return a seed that was forged, or has one to four kinds of damage; at least one byte long."""
    data = rng.choice(seeds)
    is_forged = bool(forgeries) and rng.random() < 0.6
    for _ in range(rng.choice((1, 1, 2)) if is_forged else 0):
        data = rng.choice(forgeries)(data, rng)[:LARGEST] or b"\0"
    for _ in range(rng.choice((0, 0, 0, 1)) if is_forged else rng.choice((1, 1, 2, 4))):
        other = rng.choice(seeds if rng.random() < 0.8 else others)
        data = rng.choice(DAMAGES)(data, other, rng)[:LARGEST] or b"\0"
    return data


# Seeds


def make_seeds(folder: Path, seed: int, names: list[str] | None = None) -> None:
    """Write a short flight in every format, a folder for each; strange ones of those named."""
    sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "logs")]
    from flight_writers import RECORDING_WRITERS, WRITERS, in_whole_rpm

    from flown import simulated

    flight = in_whole_rpm(simulated("quad-x", "noisy", seed=1, seconds=10.5, sample_rate=50.0))
    for name, (file, write) in {**WRITERS, **RECORDING_WRITERS}.items():
        (folder / name).mkdir()
        write(flight, folder / name / file)
        if names is None or name in names:
            add_strange(flight, folder / name, file, write, random.Random(f"{name} {seed}"))
    add_real_heads(folder)
    add_experiments(folder / "experiment")


def add_strange(
    flight: Any, folder: Path, file: str, write: Callable[[Any, Path], None], rng: random.Random
) -> None:
    """Write flights that no vehicle makes, where the format can hold them."""
    import numpy as np

    for k in range(STRANGE):
        path = folder / f"strange-{k}-{file}"
        # A writer may well fail where it must not: it is no part of what is tested.
        with contextlib.suppress(Exception), warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            write(strange(flight, rng), path)


def add_experiments(folder: Path) -> None:
    """Copy the experiment and airframe files of the examples."""
    folder.mkdir()
    found = sorted((ROOT / "examples").rglob("*.toml"))
    for k, path in enumerate(found):
        shutil.copy(path, folder / f"{k}-{path.name}")


def add_real_heads(folder: Path) -> None:
    data = real_data_folder()
    for name, pattern in REAL.items():
        for path in sorted(p for p in data.glob(pattern) if p.is_file())[:6]:
            with path.open("rb") as file:
                (folder / name / f"real-{path.name}").write_bytes(file.read(HEAD))


def seeds_in(folder: Path) -> list[bytes]:
    names = sorted(p for p in folder.rglob("*") if p.is_file() and p.suffix != ".yaml")
    return [data for data in (path.read_bytes() for path in names) if data]


# Reading


@contextlib.contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise TooSlowError after so many seconds of the processor."""

    def stop(number: int, frame: object) -> None:
        raise TooSlowError(f"more than {seconds:g} s of the processor")

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def peak() -> float:
    """Return the most memory that this process had since `forget_peak` [MB]."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def forget_peak() -> None:
    """Begin the peak anew where the system can: else a big file hides all that are smaller."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def attempt(path: Path, read: Callable[[Path], object], *, seconds: float = SECONDS) -> str | None:
    """Read a file; return whether it was "read" or "refused", or the fault in words."""
    from rotorfit.errors import ExperimentError, LogError

    forget_peak()
    before = peak()
    try:
        with time_limit(seconds), warnings.catch_warnings():
            warnings.simplefilter("error")
            outcome = wrong_with(read(path)) or "read"
    except (LogError, ExperimentError) as error:
        outcome = wrong_words(str(error)) or "refused"
    except TooSlowError as error:
        outcome = f"too slow: {error}"
    except Exception:
        outcome = traceback.format_exc()
    grown = peak() - before
    return f"{grown:.0f} MB of memory" if grown > MEGABYTES else outcome


def wrong_words(words: str) -> str | None:
    """Return what is wrong with a refusal."""
    if not words.strip():
        return "a LogError without words"
    return f"a refusal of {len(words)} letters" if len(words) > LONGEST else None


def wrong_with(found: object) -> str | None:
    """Return what is wrong with what a reader gave."""
    from rotorfit.fit.experiment.experiment import Experiment
    from rotorfit.logs.flight_log import CHANNELS, FlightLog

    if isinstance(found, Experiment):
        return None
    if not isinstance(found, FlightLog):
        return f"returned {type(found).__name__}"
    if not (math.isfinite(found.seconds) and found.seconds >= 0.0):
        return f"a log of {found.seconds} s"
    for name, channel in found.channels.items():
        shape, columns = channel.values.shape, CHANNELS[name][0]
        if channel.time.ndim != 1 or len(shape) != 2 or shape[0] != len(channel.time):
            return f"{name}: times {channel.time.shape}, values {shape}"
        if columns not in (None, shape[1]) or {channel.time.dtype, channel.values.dtype} != {
            channel.time.dtype
        }:
            return f"{name}: {shape[1]} columns of {channel.values.dtype}"
    return None


def reader_of(name: str) -> Callable[[Path], object]:
    if name == "experiment":
        from rotorfit.fit.experiment.experiment import load_experiment

        return load_experiment
    from rotorfit.logs import read_log

    return read_log


def work(name: str, *, folder: Path, findings: Path, seconds: float, seed: int) -> Tally:
    """Read damaged files of one format for so many seconds of the processor."""
    import hypothesis
    from hypothesis import strategies as st

    read = reader_of(name)
    limit = int((2048 + MEGABYTES) * 1e6)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    seeds, others = seeds_in(folder / name), seeds_in(folder)
    target = folder / f"{name}-{os.getpid()}.input"
    tally, known = Tally(name=name), set[str]()

    def examine(data: bytes) -> None:
        target.write_bytes(data)
        forget_peak()
        at, before = time.process_time(), peak()
        outcome = attempt(target, read)
        tally.slowest = max(tally.slowest, time.process_time() - at)
        tally.megabytes = max(tally.megabytes, peak() - before)
        tally.executions += 1
        tally.read += outcome == "read"
        tally.refused += outcome == "refused"
        if outcome not in ("read", "refused"):
            tally.findings += 1
            save(target, findings, name, outcome, known)

    examine(max(seeds, key=len))  # so that what is imported does not count
    begin, tally.slowest, tally.megabytes = time.process_time(), 0.0, 0.0
    for data in seeds:
        examine(data)

    @hypothesis.settings(
        max_examples=ROUND,
        database=None,
        deadline=None,
        phases=[hypothesis.Phase.generate],
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    @hypothesis.given(st.randoms(use_true_random=False))
    def search(rng: random.Random) -> None:
        data = damaged(seeds, others, rng, FORGERIES.get(name, TEXT))
        if time.process_time() - begin > seconds:  # not before: a choice may not hang on time
            raise EnoughError
        examine(data)

    with contextlib.suppress(EnoughError):
        for part in itertools.count():
            hypothesis.seed(f"{name} {seed} {part}")(search)()
    tally.seconds = time.process_time() - begin
    target.unlink(missing_ok=True)
    return tally


def save(target: Path, findings: Path, name: str, outcome: str, known: set[str]) -> None:
    """Keep an input and what came of it, once for every place that it came from."""
    place = "\n".join(outcome.strip().splitlines()[-4:])
    if place in known:
        return
    known.add(place)
    findings.mkdir(parents=True, exist_ok=True)
    stem = f"{name}-{len(known)}-{os.getpid()}"
    shutil.copy(target, findings / f"{stem}.input")
    (findings / f"{stem}.txt").write_text(outcome, encoding="utf-8")


# All formats


def run_worker(name: str, arguments: list[str], *, seconds: float) -> Tally | None:
    """Run a worker in a process of its own; None if it died or hangs."""
    command = [sys.executable, "-m", "benchmarks.fuzz", "--worker", name, *arguments]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, cwd=ROOT, timeout=300 + 20 * seconds
        )
    except subprocess.TimeoutExpired:
        return None
    if done.returncode != 0:
        print(done.stderr[-2000:], file=sys.stderr)
        return None
    return Tally(**json.loads(done.stdout))


def fuzz(names: list[str] | None, *, seconds: float, seed: int, findings: Path) -> int:
    """Fuzz the formats one after the other; return the number of faults."""
    faults = 0
    print(
        f"{'format':<12}{'seconds':>9}{'files':>9}{'read':>8}{'refused':>9}{'slowest':>10}{'memory':>10}"
    )
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        make_seeds(folder, seed, names)
        formats = sorted(path.name for path in folder.iterdir())
        chosen = names or formats
        if unknown := set(chosen) - set(formats):
            sys.exit(f"no format {', '.join(sorted(unknown))}: one of {', '.join(formats)}")
        for name in chosen:
            given = [f"--{k}={v}" for k, v in (("seconds", seconds), ("seed", seed))]
            paths = [f"--folder={folder}", f"--findings={findings.resolve()}"]
            tally = run_worker(name, [*given, *paths], seconds=seconds)
            faults += 1 if tally is None else tally.findings
            if tally is None:
                findings.mkdir(parents=True, exist_ok=True)
                for left in folder.glob(f"{name}-*.input"):
                    shutil.move(left, findings / f"{left.stem}-died.input")
                print(f"{name:<12} died; its last input is in {findings}")
                continue
            print(
                f"{name:<12}{tally.seconds:>9.0f}{tally.executions:>9}{tally.read:>8}{tally.refused:>9}"
                f"{tally.slowest:>8.2f} s{tally.megabytes:>7.0f} MB"
                + (f"  {tally.findings} FAULTS" if tally.findings else ""),
                flush=True,
            )
    return faults


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--format", nargs="+")
    parser.add_argument("--findings", type=Path, default=Path("fuzz-findings"))
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        tally = work(
            given.worker,
            folder=given.folder,
            findings=given.findings,
            seconds=given.seconds,
            seed=given.seed,
        )
        print(json.dumps(asdict(tally)))
        return 0
    faults = fuzz(given.format, seconds=given.seconds, seed=given.seed, findings=given.findings)
    if faults:
        print(f"{faults} faults: see {given.findings}", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
