"""From opening the page to the first parameters: clicks, keystrokes, seconds, what made one stop.

    python -m benchmarks.page_stopwatch [--only px4 csv] [--pictures FOLDER]

Drives the real page (`rotorfit app`) in a real browser (playwright and the system's Chromium) as
somebody would who sees it for the first time: drops a log of `$ROTORFIT_DATA` (or
`../shared/data`), answers what the page asks, types what the README beside the log says of size and
mass, and identifies. It sets only what the page has not filled in rightly itself. Counted are
clicks (a choice in a list is two), keystrokes, and seconds of waiting for the machine; nobody's
thinking is in them. Listed is each thing that the page asked for or said before it could go on.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from benchmarks.common import real_data_folder

from rotorfit.logs.units import STANDARD_GRAVITY

PATIENCE = 600_000
"""For what comes at last on a busy machine [ms]."""

SETTLED = 1500
"""After which the page has said what is wrong with a description [ms]."""


@dataclass(frozen=True)
class Case:
    """A log, and what its README says of the vehicle: lengths as typed [mm], mass [g].

    `answers`: to what the page asks of a table; `renamed`: its columns get names and units that
    rotorfit does not know (`strange_table`).
    """

    name: str
    log: str
    order: str
    size: tuple[str, ...]
    mass: str = ""
    answers: dict[str, str] = field(default_factory=dict[str, str])
    renamed: bool = False


CASES = (
    Case("px4", "autopilot-sitl/px4-heavy-recommended.ulg", "px4", ("420", "560"), "3200"),
    Case(
        "ardupilot", "autopilot-sitl/ap-heavy-recommended.BIN", "ardupilot", ("420", "560"), "3200"
    ),
    Case("indiflight", "tudelft-indiflight/LOG00267.BFL", "betaflight", ("91", "127"), "428"),
    Case(
        "unknown csv",
        "mujoco-worlds/w28.csv",
        "px4",
        ("306.3323", "362.3406"),
        "2907.064256",
        {"#unit-of-gyro": "rad/s", "#unit-of-motors": "rpm"},
        renamed=True,
    ),
    Case("betaflight", "betaflight/LOG00037.BFL", "betaflight", ("110",)),
    Case("crazyflie", "arplab-crazyflie/log15", "crazyflie", ("46",), "27"),
    Case(
        "csv",
        "nanobench-crazyflie/B8_star_fast_rep1.csv",
        "crazyflie",
        ("46",),
        "27",
        {"#unit-of-motors": "counts"},
    ),
)


def strange_table(log: Path, folder: Path) -> Path:
    """Write a table of rotorfit's names as somebody else would: FRD, us, g and rpm, own names."""
    columns = np.genfromtxt(log, delimiter=",", names=True)
    own = {"stamp": 1e6 * columns["time"]}
    for axis, sign in zip("xyz", (1.0, -1.0, -1.0), strict=True):
        own[f"w{axis}"] = sign * columns[f"gyro_{axis}"]
        own[f"acc{axis.upper()}"] = sign * columns[f"accel_{axis}"] / STANDARD_GRAVITY
    own |= {f"m{i}": 30.0 / np.pi * columns[f"rotor_{i}"] for i in range(1, 5)}
    path = folder / f"strange-{log.name}"
    rows = np.array([*own.values()]).T
    np.savetxt(path, rows, fmt="%.9g", delimiter=";", header=";".join(own), comments="")
    return path


@dataclass
class Person:
    """Somebody at the page, who counts."""

    page: Any
    clicks: int = 0
    keys: int = 0

    def click(self, place: str) -> None:
        """Click once."""
        self.clicks += 1
        self.page.click(place)

    def type(self, place: str, text: str) -> None:
        """Click into a field and type."""
        self.clicks += 1
        self.keys += len(text)
        self.page.fill(place, text)
        self.page.locator(place).blur()

    def choose(self, place: str, value: str) -> None:
        """Choose in a list: one click to open it, one on the line; none where it stands already."""
        if self.page.input_value(place) != value:
            self.clicks += 2
            self.page.select_option(place, value)


@dataclass(frozen=True)
class Timed:
    """What one case took."""

    clicks: int
    keys: int
    ready: float
    read: float
    identified: float
    asked: tuple[str, ...]
    found: str


def timed(page: Any, address: str, case: Case, log: Path) -> Timed:
    """Go from the address to parameters."""
    person, start = Person(page), time.monotonic()
    page.goto(address)
    page.wait_for_selector("html[data-ready]")
    ready = time.monotonic() - start
    with page.expect_file_chooser() as chooser:
        person.click("label[for=files]")
    person.clicks += 1  # the file in the dialog
    chooser.value.set_files(log)
    page.wait_for_selector(".file:not(.busy)")
    asked = [f"question: {words}" for words in texts(page, ".columns > label:has([id^=unit-of])")]
    asked = [words.partition(" choose ")[0] for words in asked]
    for place, answer in case.answers.items():
        person.choose(place, answer)
        page.wait_for_selector(place, state="detached")
    page.wait_for_selector(".file > .finding")
    read = time.monotonic() - start - ready
    asked += [f"still to do: {words}" for words in texts(page, ".todo li")]
    _describe(person, case)
    page.wait_for_selector("#identify[aria-disabled=false]")
    page.wait_for_timeout(SETTLED)
    asked += [f"said: {words}" for words in texts(page, "#identification .finding")]
    before = time.monotonic()
    person.click("#identify")
    page.wait_for_selector("#outcome tr[data-name], #refusal")
    took = time.monotonic() - before
    return Timed(person.clicks, person.keys, ready, read, took, tuple(asked), _outcome(page))


def _describe(person: Person, case: Case) -> None:
    """Type size and mass, and correct the motor order where the page has another one."""
    page = person.page
    if page.locator("#order").count():
        person.choose("#order", case.order)
        if len(case.size) == 2 and not page.is_checked("input[value=spacing]"):
            person.click("input[value=spacing]")
        if len(case.size) == 1 and not page.is_checked("input[value=arm]"):
            person.click("input[value=arm]")
        for i, text in enumerate(case.size):
            if page.input_value(f"#size-{i}") != text:
                person.type(f"#size-{i}", text)
    if case.mass:
        person.type("#mass-0", case.mass)
    else:
        person.click("#unweighed")


def _outcome(page: Any) -> str:
    """Say in a line what came out, or why nothing did."""
    if page.locator("#refusal").count():
        return f"refused: {page.inner_text('#refusal')}"
    counts = page.locator(".counts .count").all_inner_texts()
    return ", ".join(" ".join(text.split("\n")) for text in counts)


def texts(page: Any, place: str) -> list[str]:
    """Read the texts at some places, a line each."""
    return [" ".join(text.split()) for text in page.locator(place).all_inner_texts()]


@contextmanager
def served() -> Iterator[str]:
    """Run the page; yield its address."""
    command = [sys.executable, "-m", "rotorfit", "app", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        yield server.stdout.readline().strip()
        server.terminate()


def with_page(address: str, work: Callable[[Any], Timed]) -> Timed:
    """Do something with a new page of a new browser."""
    from playwright.sync_api import sync_playwright

    chromium = which("chromium") or which("chromium-browser")
    with TemporaryDirectory() as profile, sync_playwright() as playwright:
        context = playwright.chromium.launch_persistent_context(
            profile, executable_path=chromium, args=["--headless", "--no-sandbox", "--disable-gpu"]
        )
        context.set_default_timeout(PATIENCE)
        try:
            return work(context.new_page())
        finally:
            context.close()


def main() -> None:
    """Run the stopwatch."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=[case.name for case in CASES])
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="Keep the page at its end.")
    asked = parser.parse_args()
    heads = ("log", "clicks", "keys", "open [s]", "read [s]", "identify [s]", "asked", "result")
    print(f"| {' | '.join(heads)} |\n|{' --- |' * len(heads)}")
    for case in CASES:
        if asked.only and case.name not in asked.only:
            continue
        log = real_data_folder() / case.log

        def work(page: Any, case: Case = case, log: Path = log) -> Timed:
            try:
                with TemporaryDirectory() as folder:
                    file = strange_table(log, Path(folder)) if case.renamed else log
                    return timed(page, address, case, file)
            finally:
                if asked.pictures:
                    page.screenshot(path=asked.pictures / f"{case.name}.png", full_page=True)

        with served() as address:
            found = with_page(address, work)
        cells = (
            case.name, f"{found.clicks}", f"{found.keys}", f"{found.ready:.1f}",
            f"{found.read:.1f}", f"{found.identified:.0f}", "; ".join(found.asked), found.found,
        )  # fmt: skip
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
