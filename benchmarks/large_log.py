"""A log of a gigabyte, read and identified: its memory over that of the channels it needs.

    python -m benchmarks.large_log --format ulog --gigabytes 1

One simulated flight is written in the format and repeated with later times up to the size, in the
folder `--scratch`; the file is deleted at the end. Processes of their own then read it, and read
and identify it. Printed is the most memory each had, less what it has with one repetition only
(Python and its libraries), over the bytes of the gyro, accelerometer and rotor speed and their
times as doubles. Linux only.
"""

import argparse
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
RATE = 1000.0
"""Samples per second of the flight that is repeated [Hz]."""
SECONDS = 20.0
CHANNELS = ("gyro", "accel", "rotor_speed")
FORMATS = ("table", "ulog", "dataflash", "crazyflie")
CRAZYFLIE_RECORD = 2 + 8 + 6 * 4 + 8 * 2


def parts(name: str, flight, path: Path) -> Iterator[bytes]:
    """Yield a log's first part, then its repetitions without end."""
    from flight_writers import WRITERS

    WRITERS[name][1](flight, path)
    data = path.read_bytes()
    path.unlink()
    if name == "table":
        yield from repeated_rows(data, len(flight.time) / RATE)
        return
    places = {"ulog": ulog_times, "dataflash": dataflash_times, "crazyflie": crazyflie_times}
    start, where = places[name](data)
    step = round(1e6 * len(flight.time) / RATE)
    yield data
    yield from shifted(data[start:], where - start, step)


def repeated_rows(data: bytes, seconds: float) -> Iterator[bytes]:
    yield data
    rows = [line.partition(b",") for line in data.splitlines()[1:]]
    times = np.array([float(time) for time, _, _ in rows])
    for turn in range(1, 1 << 40):
        now = times + turn * seconds
        joined = zip(now.tolist(), rows, strict=True)
        yield b"".join(b"%.6f,%s\n" % (t, rest) for t, (_, _, rest) in joined)


def shifted(body: bytes, places: np.ndarray, step: int) -> Iterator[bytes]:
    """Yield the body again and again, its times of 64 bits later by a step each time [us]."""
    out = np.frombuffer(body, np.uint8).copy()
    window = places[:, None] + np.arange(8)
    times = out[window].view("<u8")[:, 0]
    for turn in range(1, 1 << 40):
        moved = (times + np.uint64(turn * step)).astype("<u8")
        out[window] = moved.view(np.uint8).reshape(-1, 8)
        yield out.tobytes()


def ulog_times(data: bytes) -> tuple[int, np.ndarray]:
    """Return where the data messages begin, and where their times stand."""
    place, start, places = 16, 0, list[int]()
    while place < len(data):
        size = int.from_bytes(data[place : place + 2], "little")
        if data[place + 2 : place + 3] == b"D":
            start = start or place
            places.append(place + 5)
        place += 3 + size
    return start, np.array(places)


def dataflash_times(data: bytes) -> tuple[int, np.ndarray]:
    """Return where the messages of the flight begin, and where their times stand."""
    from dataflash_encoder import ESC, FMT, IMU, KINDS, RCOU

    lengths = {FMT: 89, **{kind.number: kind.length for kind in KINDS}}
    timed = {IMU.number, RCOU.number, ESC.number}
    place, start, places = 0, 0, list[int]()
    while place < len(data):
        number = data[place + 2]
        if number in timed:
            start = start or place
            places.append(place + 3)
        place += lengths[number]
    return start, np.array(places)


def crazyflie_times(data: bytes) -> tuple[int, np.ndarray]:
    """Return where the records begin, and where their times stand."""
    count = (len(data) - 200) // CRAZYFLIE_RECORD
    start = len(data) - round(SECONDS * RATE) * CRAZYFLIE_RECORD
    assert count >= round(SECONDS * RATE) - 10
    return start, start + 2 + CRAZYFLIE_RECORD * np.arange(round(SECONDS * RATE))


def write_log(path: Path, pieces: Iterator[bytes], size: float) -> None:
    """Write pieces until the file has the size [bytes], one at least."""
    with path.open("wb") as file:
        for piece in pieces:
            file.write(piece)
            if file.tell() >= size:
                return


def peak() -> float:
    """Return the most memory that this process had [MB]."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(next(x for x in status.splitlines() if x.startswith("VmHWM")).split()[1]) / 1e3


def work(path: Path, what: str) -> None:
    """Read, or read and identify; print the memory and the bytes of the channels [MB]."""
    from rotorfit.errors import FlightWarning
    from rotorfit.logs import read_log

    warnings.simplefilter("ignore", FlightWarning)
    begin = time.process_time()
    if what == "read":
        log = read_log(path)
        taken = (log.channels[name] for name in CHANNELS)
        needed = sum(8 * (c.values.size + c.time.size) for c in taken) / 1e6
        print(peak(), needed, time.process_time() - begin)
        return
    from rotorfit.fit.experiment.experiment import load_experiment
    from rotorfit.identification import identify

    result = identify(load_experiment(path))
    found = next(p.value for p in result.parameters if p.name == "kt")
    print(peak(), found, time.process_time() - begin)


def measured(path: Path, what: str) -> list[float]:
    command = [sys.executable, "-m", "benchmarks.large_log", "--work", what, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    if done.returncode != 0:
        sys.exit(done.stderr[-2000:])
    return [float(word) for word in done.stdout.split()]


def compare(name: str, gigabytes: float, folder: Path) -> None:
    sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "logs")]
    from flight_writers import WRITERS, in_whole_rpm

    from flown import experiment_file, simulated

    flight = in_whole_rpm(simulated("quad-x", "noisy", seed=3, seconds=SECONDS, sample_rate=RATE))
    log = folder / WRITERS[name][0]
    given = experiment_file(folder / "e.toml", flight.vehicle, [log], mass=flight.truth.mass)
    least: dict[str, float] = {}
    for size in (1.0, gigabytes * 1e9):
        write_log(log, parts(name, flight, folder / f"once-{log.name}"), size)
        megabytes = log.stat().st_size / 1e6
        reading, needed, seconds = measured(log, "read")
        whole, kt, whole_seconds = measured(given, "identify")
        if size == 1.0:
            least = {"read": reading - needed, "identify": whole - needed}
            continue
        print(
            f"{name}: {megabytes:.0f} MB, channels {needed:.0f} MB\n"
            f"  read      {reading:6.0f} MB, {(reading - least['read']) / needed:.1f} x, "
            f"{seconds:.0f} s\n"
            f"  identified {whole:5.0f} MB, {(whole - least['identify']) / needed:.1f} x, "
            f"{whole_seconds:.0f} s (kt {kt:.4g})"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--format", choices=FORMATS, default="ulog")
    parser.add_argument("--gigabytes", type=float, default=1.0)
    parser.add_argument("--scratch", type=Path)
    parser.add_argument("--work", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.work:
        work(Path(given.work[1]), given.work[0])
        return
    with tempfile.TemporaryDirectory(dir=given.scratch) as folder:
        compare(given.format, given.gigabytes, Path(folder))


if __name__ == "__main__":
    main()
