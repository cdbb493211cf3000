"""Processor time of identifying over that of reading, and how both grow with what was flown.

    python -m benchmarks.identify_speed [--against FOLDER] [--only WORDS]

Simulated flights of known vehicles, written as flight tables with measured speeds or with commands
alone: 75 s at 200 Hz, eight times as long, ten minutes at 1 kHz, two configurations, twenty
flights; and a real log with commands beside measured speeds, where the real data are there
($ROTORFIT_DATA, ../shared/data). Each case runs in a process of its own. Printed are the processor
seconds of reading (which is reading and preparing all flights), those of everything after it, their
ratio, and the most memory that the process had. With --against, the `src` folder of another version
does the same beside it, and the last columns are its time after reading, how many times more that
is, and its memory.
"""

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, variant
from rotorfit.simulation.experiment_files import IMU_AND_COMMAND, IMU_AND_SPEED, write_flight_table

SOURCE = Path(__file__).parents[1] / "src"
WORKER = """
import json, resource, sys, time, warnings
from pathlib import Path
warnings.simplefilter("ignore")
from rotorfit.experiment.experiment import load_experiment
try:
    from rotorfit.dataset.load import load_flight
except ModuleNotFoundError:  # a version before the rooms of today
    from rotorfit.fit.flights import load_flight
from rotorfit.identification.identify import identify
experiment = load_experiment(Path(sys.argv[1]))
# Once before the clock runs: the reader is imported when the first log is read.
load_flight(experiment.configuration[0].flights[0], experiment)
start = time.process_time()
for configuration in experiment.configuration:
    for flight in configuration.flights:
        load_flight(flight, experiment)
read = time.process_time() - start
start = time.process_time()
identify(experiment)
whole = time.process_time() - start
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps({"read": read, "after": whole - read, "memory": memory}))
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """What is flown: `flights` of each vehicle of the paper's, so long and so fast."""

    name: str
    vehicles: str = "A"
    flights: int = 1
    seconds: float = 75.0
    rate: float = 200.0


CASES = (
    Case(name="75 s at 200 Hz"),
    Case(name="600 s at 200 Hz", seconds=600.0),
    Case(name="600 s at 1 kHz", seconds=600.0, rate=1000.0),
    Case(name="two configurations", vehicles="AB"),
    Case(name="20 flights of 75 s", flights=20),
)


REAL = "tudelft-indiflight/LOG00267.BFL"


def written_real(folder: Path) -> Path | None:
    """Write the experiment file of the real log; None where that is not there."""
    # As in `common`, whose imports would count in the memory of every process.
    beside = SOURCE.parents[1] / "shared" / "data"
    log = Path(os.environ.get("ROTORFIT_DATA") or beside) / REAL
    if not log.exists():
        return None
    vehicle = (SOURCE.parent / "examples/cinerat.toml").read_text(encoding="utf-8")
    path = folder / "experiment.toml"
    path.write_text(
        f'{vehicle}\n[[configuration]]\nname = "A"\nmass = 0.428\nflights = ["{log.resolve()}"]\n',
        encoding="utf-8",
    )
    return path


def written(case: Case, folder: Path, *, commanded: bool) -> Path:
    """Fly a case, and write its tables and experiment file."""
    channels = IMU_AND_COMMAND if commanded else IMU_AND_SPEED
    parts: list[str] = []
    full = 0.0
    for name in case.vehicles:
        (truth, vehicle), sensors = variant(paper_vehicle(name), "real")
        scenario = Scenario(sensors=sensors, seconds=case.seconds, sample_rate=case.rate)
        files: list[str] = []
        for seed in range(1, case.flights + 1):
            flight = simulate_flight(truth, vehicle, scenario, seed=seed)
            files.append(f"{name}{seed}.csv")
            write_flight_table(flight, folder / files[-1], channels=channels)
            full = full or flight.max_speed
        parts.append(
            f'[[configuration]]\nname = "{name}"\nmass = {truth.mass!r}\nflights = {files}'
        )
    rotors = ", ".join(
        f'{{ position = {list(r.position)}, spin = "{r.spin}" }}' for r in vehicle.rotors
    )
    motors = '[motors]\nspeed = "measured"'
    if commanded:
        motors = f'[motors]\nspeed = "commanded"\nlaw = {{ linear = [0.0, {full!r}] }}'
    airframe = f"[airframe]\nrotors = [{rotors}]\nimu = {{ position = [0.0, 0.0, 0.0] }}"
    path = folder / "experiment.toml"
    path.write_text("\n\n".join([airframe, motors, *parts]) + "\n", encoding="utf-8")
    return path


def written_apart(case: Case, folder: Path, *, commanded: bool) -> Path:
    """Do the same in a process of its own: a process inherits the memory mark of its parent."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        return pool.submit(partial(written, commanded=commanded), case, folder).result()


def spent(experiment: Path, source: Path) -> dict[str, float]:
    """Return seconds of reading and after it [s], and memory [MB], of one version."""
    environment = {**os.environ, "PYTHONPATH": str(source), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", WORKER, str(experiment)],
        capture_output=True,
        text=True,
        env=environment,
        check=True,
    )
    return json.loads(done.stdout)


def lines(cases: Sequence[Case], against: Path | None) -> Iterator[str]:
    """Yield a line for each case, commanded and measured."""
    yield f"{'':32s} {'read s':>8s} {'after s':>8s} {'ratio':>6s} {'MB':>6s}" + (
        f" {'other s':>8s} {'times':>6s} {'MB':>6s}" if against else ""
    )
    for case in cases:
        for commanded in (False, True):
            with tempfile.TemporaryDirectory() as name:
                experiment = written_apart(case, Path(name), commanded=commanded)
                kind = "commanded" if commanded else "measured"
                yield _line(f"{case.name}, {kind}", experiment, against)


def real_lines(against: Path | None) -> Iterator[str]:
    """Yield the line of the real log, where it is there."""
    with tempfile.TemporaryDirectory() as name:
        experiment = written_real(Path(name))
        if experiment is not None:
            yield _line(Path(REAL).stem, experiment, against)


def _line(name: str, experiment: Path, against: Path | None) -> str:
    own = spent(experiment, SOURCE)
    line = (
        f"{name:32s} {own['read']:8.2f} {own['after']:8.2f} "
        f"{own['after'] / own['read']:6.1f} {own['memory']:6.0f}"
    )
    if against is None:
        return line
    other = spent(experiment, against)
    return (
        f"{line} {other['after']:8.2f} {other['after'] / own['after']:6.1f} {other['memory']:6.0f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--against", type=Path, help="the src folder of another version")
    parser.add_argument("--only", default="", help="cases with these words in their name")
    given = parser.parse_args()
    for line in lines([c for c in CASES if given.only in c.name], given.against):
        print(line, flush=True)
    if given.only in REAL:
        for line in real_lines(given.against):
            print(line, flush=True)


if __name__ == "__main__":
    main()
