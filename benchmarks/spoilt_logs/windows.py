"""Random windows of every log: `identify` tells, or refuses in words, and never breaks."""

import contextlib
import io
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from benchmarks import common
from benchmarks.common import SOUND, airframe_text, real_data_folder
from benchmarks.same_numbers import AIRFRAMES, COMMANDED, CRAZYFLIE, LOGS

from rotorfit.cli.identify import identify
from rotorfit.errors import RotorfitError


@dataclass(frozen=True, slots=True, kw_only=True)
class Windowed:
    """One log and what goes with it on a command line."""

    log: Path
    mass: str
    airframe: Path
    seconds: float


def every_log(folder: Path) -> list[Windowed]:
    """Return every log of the real data that has motors, with airframes in a folder."""
    data = real_data_folder()
    cinerat = airframe_text(SOUND["LOG00267"].declared).partition("[identification]")[0]
    airframes = {**AIRFRAMES, "cinerat.toml": cinerat, "crazyflie.toml": CRAZYFLIE + COMMANDED}
    for name, text in airframes.items():
        (folder / name).write_text(text, encoding="utf-8")
    crazypad = {f"crazypad/{log.name}": ("0.03", "crazyflie.toml")
                for log in sorted((data / "crazypad").glob("*_log*"))}  # fmt: skip
    return [
        Windowed(log=data / log, mass=mass, airframe=folder / airframe,
                 seconds=common.read_log(data / log).seconds)
        for log, (mass, airframe) in {**LOGS, **crazypad}.items()
    ]  # fmt: skip


def random_window(seconds: float, chance: np.random.Generator) -> tuple[float, float]:
    """Return start and end of a window: the whole log, beyond it, a blink, or any."""
    kind = chance.integers(6)
    if kind == 0:
        return 0.0, seconds + float(chance.choice([0.0, 0.01, -0.01, 100.0]))
    length = float(np.exp(chance.uniform(np.log(0.05), np.log(seconds))))
    start = float(chance.uniform(0.0, seconds - 0.5 * length))
    return (0.0, length) if kind == 1 else (round(start, 2), round(start + length, 2))


def window_end(one: Windowed, window: tuple[float, float]) -> tuple[str, str]:
    """Return how the command ends on a window, "told", "refused" or "fault", and what is said."""
    start, end = window
    aside = io.StringIO()
    with (
        contextlib.redirect_stdout(aside),
        contextlib.redirect_stderr(aside),
        warnings.catch_warnings(record=True) as heard,
    ):
        warnings.simplefilter("always", RuntimeWarning)
        try:
            identify(
                one.log, mass=one.mass, airframe=one.airframe, start=start, end=end, as_json=True
            )
        except RotorfitError as error:
            return "refused", str(error)
        except Exception as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{Path(last.filename).name}:{last.lineno} {last.name}"
            return "fault", f"{type(error).__name__}: {error} ({place})"
    loud = [w for w in heard if issubclass(w.category, RuntimeWarning)]
    if not loud:
        return "told", ""
    place = f"{Path(loud[0].filename).name}:{loud[0].lineno}"
    return "fault", f"RuntimeWarning: {loud[0].message} ({place})"


def window_faults(seconds: float, seed: int, only: str) -> Iterator[str]:
    """Yield a reproduction of every internal error met in random windows, then the counts.

    And of every fit that did not settle, which is no reason that a user can act upon.
    """
    chance, stop = np.random.default_rng(seed), time.monotonic() + seconds
    ends: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as own:
        logs = [one for one in every_log(Path(own)) if only in str(one.log)]
        while time.monotonic() < stop:
            one = logs[int(chance.integers(len(logs)))]
            start, end = random_window(one.seconds, chance)
            how, words = window_end(one, (start, end))
            ends[how] += 1
            if how == "fault" or "did not settle" in words:
                yield (
                    f"rotorfit identify {one.log} --mass {one.mass} --airframe {one.airframe.name} "
                    f"--start {start:g} --end {end:g}: {words}"
                )
    yield f"{ends.total()} windows: {dict(ends)}"
