"""DataFlash reading, side by side with pymavlink's DFReader, on one file made longer by repetition.

Processor time, since a machine that does other work makes any clock on the wall meaningless.

    python benchmarks/dataflash_speed.py ../shared/data/ardupilot-dronekit/log171.bin [MB]

Three things, each in the same run: where all messages are (both), every field of every message
(both), and `read_log`, which takes what an identification needs (rotorfit only) with its memory.
pymavlink is in the extra `test`. The counts must be equal, or the run ends with an error.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from pymavlink.DFReader import DFReader_binary

from rotorfit.logs import read_log
from rotorfit.logs.dataflash.columns import columns
from rotorfit.logs.dataflash.messages import Messages, find_messages

BLOCK = 4 << 20
DEFAULT_MB = 24


def timed(function: Callable[[], int]) -> tuple[float, int]:
    """Return the processor time [s] and what the function returns."""
    start = time.process_time()
    result = function()
    return time.process_time() - start, result


def blocks(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            yield block


def found_by_rotorfit(path: Path) -> Messages:
    return find_messages(blocks(path))


def unpacked_by_rotorfit(path: Path) -> int:
    """Unpack and scale every field of every message."""
    messages = found_by_rotorfit(path)
    for form in {messages.formats[i].name: messages.formats[i] for i in messages.rows}.values():
        columns(messages, form.name, form.labels)
    return sum(messages.counts)


def unpacked_by_pymavlink(path: Path) -> int:
    """Unpack and scale every field of every message."""
    reader, count = DFReader_binary(str(path)), 0
    while (message := reader.recv_msg()) is not None:
        message.to_dict()
        count += 1
    return count


def repeated(path: Path, megabytes: float, folder: Path) -> Path:
    """Write a log so many times after itself, its times going on."""
    data = np.frombuffer(path.read_bytes(), np.uint8).copy()
    places = time_places(data)
    times = np.lib.stride_tricks.sliding_window_view(data, 4)[places].copy().view("<u4")
    span = int(times.max() - times.min()) + 20
    made = folder / "repeated.bin"
    with made.open("wb") as file:
        for k in range(max(1, round(megabytes * 1e6 / len(data)))):
            moved = (times + np.uint32(k * span)).view(np.uint8)
            for i in range(4):
                data[places + i] = moved[:, i]
            file.write(data.tobytes())
    return made


def time_places(data: np.ndarray) -> np.ndarray:
    """Return where the field TimeMS of each message is, message by message."""
    lengths, has_time = {128: 89}, set[int]()
    places: list[int] = []
    place = 0
    while place < len(data):
        number = int(data[place + 2])
        if number == 128:
            lengths[int(data[place + 3])] = int(data[place + 4])
            if data[place + 25 : place + 31].tobytes() == b"TimeMS":
                has_time.add(int(data[place + 3]))
        elif number in has_time:
            places.append(place + 3)
        place += lengths[number]
    return np.array(places)


def memory_of_reading(path: Path) -> float:
    """Return the largest memory of a process that reads a log [MB]."""
    code = f"import sys; sys.argv = ['', '--memory', {str(path)!r}]; import runpy; "
    code += f"runpy.run_path({__file__!r}, run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(done.stdout)


def main(path: Path, megabytes: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        log = repeated(path, megabytes, Path(folder))
        size = log.stat().st_size / 1e6
        rows = {
            "where messages are": (
                timed(lambda: sum(found_by_rotorfit(log).counts)),
                timed(lambda: sum(DFReader_binary(str(log)).counts)),
            ),
            "every field": (
                timed(lambda: unpacked_by_rotorfit(log)),
                timed(lambda: unpacked_by_pymavlink(log)),
            ),
        }
        print(f"{size:.1f} MB{'rotorfit':>24}{'pymavlink':>16}{'ratio':>8}")
        for name, ((ours, count), (theirs, same)) in rows.items():
            if count != same:
                sys.exit(f"{name}: {count} messages, pymavlink finds {same}")
            speeds = f"{size / ours:>9.1f} MB/s{size / theirs:>11.2f} MB/s"
            print(f"{name:<20}{speeds}{theirs / ours:>8.0f}")
        seconds, samples = timed(lambda: len(read_log(log).channels["gyro"].time))
        print(f"read_log            {size / seconds:>9.1f} MB/s, {samples} gyro samples, ", end="")
        print(f"{memory_of_reading(log):.0f} MB at most")


def print_memory(path: Path) -> None:
    read_log(path)
    # Linux only; ru_maxrss would have the memory of the process that started this one, too.
    status = Path("/proc/self/status").read_text(encoding="ascii")
    peak = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    print(int(peak.split()[1]) / 1e3)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    if arguments[:1] == ["--memory"]:
        print_memory(Path(arguments[1]))
    elif arguments:
        main(Path(arguments[0]), float(arguments[1]) if len(arguments) > 1 else DEFAULT_MB)
    else:
        sys.exit("usage: python benchmarks/dataflash_speed.py LOG [MB]")
