"""Damaged files for every reader: only a FlightLog or a LogError may come out, soon and in bounds.

    python -m benchmarks.fuzz --seconds 600            # of the processor, in all
    python -m benchmarks.fuzz --format ulog --seconds 60 --seed 7

Each format is read in a process of its own. The inputs are whole logs (one simulated flight in
every format, and the first 200 kB of real logs where they are there) that were cut, flipped,
spliced, given huge lengths or deep nesting. A file may take `SECONDS` of the processor and
`MEGABYTES` of memory over what the process had at its start; a warning counts as a fault. What
breaks this is saved in the folder `--findings`, and the run ends with exit code 1.
"""

import argparse
import contextlib
import json
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

ROOT = Path(__file__).parents[1]
SECONDS = 10.0
"""Of the processor that one file may take."""
MEGABYTES = 400.0
"""More than the process had before, that one file may take; the largest input has 1 MB."""
LARGEST = 1_000_000
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
    return data + rng.randbytes(rng.choice((1, 7, 100, 5000, 60000)))


DAMAGES = (cut, flipped, overwritten, removed, repeated, spliced, inserted, nested, with_tail)


def damaged(seeds: list[bytes], others: list[bytes], rng: random.Random) -> bytes:
    """Return a seed with one to four kinds of damage, at least one byte long."""
    data = rng.choice(seeds)
    for _ in range(rng.choice((1, 1, 2, 4))):
        other = rng.choice(seeds if rng.random() < 0.8 else others)
        data = rng.choice(DAMAGES)(data, other, rng)[:LARGEST] or b"\0"
    return data


# Seeds


def make_seeds(folder: Path) -> None:
    """Write one short flight in every format, a folder for each."""
    sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "logs")]
    from flight_writers import RECORDING_WRITERS, WRITERS, in_whole_rpm

    from flown import simulated

    flight = in_whole_rpm(simulated("quad-x", "noisy", seed=1, seconds=10.5, sample_rate=50.0))
    for name, (file, write) in {**WRITERS, **RECORDING_WRITERS}.items():
        (folder / name).mkdir()
        write(flight, folder / name / file)
    add_real_heads(folder)


def add_real_heads(folder: Path) -> None:
    data = Path(os.environ.get("ROTORFIT_DATA") or ROOT.parent / "shared" / "data")
    for name, pattern in REAL.items():
        for path in sorted(p for p in data.glob(pattern) if p.is_file())[:6]:
            with path.open("rb") as file:
                (folder / name / f"real-{path.name}").write_bytes(file.read(HEAD))


def seeds_in(folder: Path) -> list[bytes]:
    names = sorted(p for p in folder.rglob("*") if p.is_file() and p.suffix != ".yaml")
    return [path.read_bytes() for path in names]


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
    """Return the most memory that this process ever had [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def attempt(path: Path, read: Callable[[Path], object], *, seconds: float = SECONDS) -> str | None:
    """Read a file; return whether it was "read" or "refused", or the fault in words."""
    from rotorfit.errors import LogError
    from rotorfit.flight.log import FlightLog

    before = peak()
    try:
        with time_limit(seconds), warnings.catch_warnings():
            warnings.simplefilter("error")
            log = read(path)
            wrong = None if isinstance(log, FlightLog) else f"returned {type(log).__name__}"
            outcome = wrong or (uneven(log) if isinstance(log, FlightLog) else None) or "read"
    except LogError as error:
        outcome = "refused" if str(error).strip() else "a LogError without words"
    except TooSlowError as error:
        outcome = f"too slow: {error}"
    except Exception:
        outcome = traceback.format_exc()
    grown = peak() - before
    return f"{grown:.0f} MB of memory" if grown > MEGABYTES else outcome


def uneven(log: object) -> str | None:
    """Return what is wrong with the shapes of a log's channels."""
    for name, channel in log.channels.items():  # type: ignore[attr-defined]
        if channel.time.ndim != 1 or channel.values.shape[:1] != channel.time.shape:
            return f"{name}: times {channel.time.shape}, values {channel.values.shape}"
    return None


def work(name: str, *, folder: Path, findings: Path, seconds: float, seed: int) -> Tally:
    """Read damaged files of one format for so many seconds of the processor."""
    from rotorfit.logs import read_log

    limit = int((2048 + MEGABYTES) * 1e6)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    rng = random.Random(seed)
    seeds, others = seeds_in(folder / name), seeds_in(folder)
    target = folder / f"{name}-{os.getpid()}.input"
    warm_up(seeds, target)
    start, tally, known = peak(), Tally(name=name), set[str]()
    begin = time.process_time()
    while time.process_time() - begin < seconds:
        target.write_bytes(damaged(seeds, others, rng))
        at = time.process_time()
        outcome = attempt(target, read_log)
        tally.slowest = max(tally.slowest, time.process_time() - at)
        tally.executions += 1
        tally.read += outcome == "read"
        tally.refused += outcome == "refused"
        if outcome not in ("read", "refused"):
            tally.findings += 1
            save(target, findings, name, outcome, known)
    tally.seconds, tally.megabytes = time.process_time() - begin, peak() - start
    target.unlink(missing_ok=True)
    return tally


def warm_up(seeds: list[bytes], target: Path) -> None:
    """Read the seeds whole, so that what is imported does not count."""
    from rotorfit.errors import LogError
    from rotorfit.logs import read_log

    for seed in seeds:
        target.write_bytes(seed)
        with contextlib.suppress(LogError):
            read_log(target)


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
    print(f"{'format':<12}{'files':>8}{'read':>8}{'refused':>9}{'slowest':>10}{'memory':>10}")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        make_seeds(folder)
        chosen = names or sorted(path.name for path in folder.iterdir())
        each = seconds / len(chosen)
        for name in chosen:
            given = [f"--{k}={v}" for k, v in (("seconds", each), ("seed", seed))]
            paths = [f"--folder={folder}", f"--findings={findings.resolve()}"]
            tally = run_worker(name, [*given, *paths], seconds=each)
            faults += 1 if tally is None else tally.findings
            if tally is None:
                findings.mkdir(parents=True, exist_ok=True)
                for left in folder.glob(f"{name}-*.input"):
                    shutil.move(left, findings / f"{left.stem}-died.input")
                print(f"{name:<12} died; its last input is in {findings}")
                continue
            print(
                f"{name:<12}{tally.executions:>8}{tally.read:>8}{tally.refused:>9}"
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
