"""Time until `rotorfit --help` has answered, above what Python itself takes to start.

    python benchmarks/startup.py

Best of 20 each, taken in turns. The aim is less than 0.2 s.
"""

import subprocess
import sys
import time

REPEATS = 20
COMMANDS = {
    "python -c pass": ("-c", "pass"),
    "rotorfit --version": ("-m", "rotorfit", "--version"),
    "rotorfit --help": ("-m", "rotorfit", "--help"),
    "rotorfit identify --help": ("-m", "rotorfit", "identify", "--help"),
}


def seconds(arguments: tuple[str, ...]) -> float:
    """Return the time that one run takes [s]."""
    start = time.perf_counter()
    subprocess.run([sys.executable, *arguments], capture_output=True, check=True)
    return time.perf_counter() - start


def main() -> None:
    best = dict.fromkeys(COMMANDS, float("inf"))
    for _ in range(REPEATS):
        for name, arguments in COMMANDS.items():
            best[name] = min(best[name], seconds(arguments))
    bare = best["python -c pass"]
    for name, taken in best.items():
        print(f"{name:<26} {1e3 * taken:7.1f} ms   {1e3 * (taken - bare):+7.1f} ms")


if __name__ == "__main__":
    main()
