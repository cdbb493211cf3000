"""What a fleet costs, and whether it is the same whoever works: one run, side by side.

    python -m benchmarks.fleet [--seconds S] [--flights N] [--most N] [--joined N] [--no-dask]

Simulated flights of vehicle A, as flight tables at 200 Hz with measured speeds.

Pace: processor seconds of reading a log alone, and of all that the fleet does with it.
Memory: the most that a process had with so many flights' rows and statistics' input, from repeated
entries; and with so many flights of one vehicle fitted together, from repeated factors.
Sameness: SHA-256 of the tables and the page by one process alone, by two processes, by a Dask
LocalCluster, with a worker killed in the middle, and with the whole run killed and begun again.
"""

import argparse
import dataclasses
import hashlib
import json
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from rotorfit.errors import RotorfitWarning
from rotorfit.fit.dataset.load import load_flight
from rotorfit.report.fleet_files import PAGE, fleet_files
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, variant
from rotorfit.simulation.experiment_files import write_flight_table
from rotorfit.tools.fleet.executors import Workspace, process_log
from rotorfit.tools.fleet.joined import joined
from rotorfit.tools.fleet.listing import Defaults, FlightTask, listed_logs
from rotorfit.tools.fleet.one_flight import entry_of, experiment_of, fitted_factors
from rotorfit.tools.fleet.records import read_entry
from rotorfit.tools.fleet.run import Workers, read_fleet, types_of
from rotorfit.tools.fleet.tables import ROWS, flight_columns, numbers_of, table_file

VEHICLES = 2


def made_fleet(folder: Path, flights: int, seconds: float) -> Defaults:
    """Write flights of two vehicles into a folder, and what is declared of them."""
    vehicle, sensors = variant(paper_vehicle("A"), "real")
    for number in range(flights):
        flight = simulate_flight(
            *vehicle, Scenario(sensors=sensors, seconds=seconds), seed=number + 1
        )
        own = folder / f"vehicle{number % VEHICLES}"
        own.mkdir(parents=True, exist_ok=True)
        write_flight_table(flight, own / f"flight{number:03d}.csv")
    rotors = ", ".join(
        f'{{ position = {list(r.position)}, spin = "{r.spin}" }}' for r in flight.vehicle.rotors
    )
    airframe = folder / "airframe.toml"
    airframe.write_text(f'[airframe]\nrotors = [{rotors}]\n[motors]\nspeed = "measured"\n')
    return Defaults(mass=flight.truth.mass, airframe=airframe)


def pace(tasks: list[FlightTask]) -> tuple[float, float]:
    """Return processor seconds a flight: of reading and preparing, and of the whole map step."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RotorfitWarning)
        entry_of(experiment_of(tasks[0]))  # imports
        start = time.process_time()
        for task in tasks:
            experiment = experiment_of(task)
            load_flight(experiment.configuration[0].flights[0], experiment)
        read = time.process_time() - start
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        for task in tasks:
            process_log(task, Workspace(cache=Path(folder)))
        whole = time.process_time() - start
    return read / len(tasks), whole / len(tasks)


def peak() -> float:
    """Return the most memory that this process had [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def rows_memory(cache: Path, keys: list[str], count: int) -> float:
    """Return the peak with so many flights' records and their table, from repeated entries."""
    records = []
    for i in range(count):
        entry = read_entry(cache, keys[i % len(keys)])
        assert entry is not None
        assert entry.record is not None
        records.append(
            dataclasses.replace(
                entry.record, file=f"{i}", sha256=f"{i:064x}", vehicle=f"{i // 25}", checks={}
            )
        )
    numbers = numbers_of(records)
    parts = (flight_columns(records[i : i + ROWS], numbers) for i in range(0, count, ROWS))
    table_file("flights", parts)
    return peak()


def joined_memory(cache: Path, keys: list[str], task: FlightTask, count: int) -> float:
    """Return the peak with so many flights fitted together, from repeated factors."""
    experiment = experiment_of(task)

    def load(key: str):
        entry = read_entry(cache, key, factors=True)
        assert entry is not None
        return fitted_factors(entry.factors, experiment)

    joined([partial(load, keys[i % len(keys)]) for i in range(count)])
    return peak()


def in_a_process(function, *arguments):
    """Return what a function returns in a fresh process: its peak is its own."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        return pool.submit(function, *arguments).result()


def digest(logs, cache: Path, workers: Workers) -> str:
    """Return the fingerprint of everything that a fleet leaves."""
    fleet = read_fleet(logs, cache, workers)
    return fingerprint(fleet_files(fleet, types_of(fleet), cache, workers, name="logs"))


def fingerprint(files: dict[str, bytes]) -> str:
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    assert PAGE in hashes
    return hashlib.sha256(json.dumps(hashes, sort_keys=True).encode()).hexdigest()[:16]


def killed_worker(logs, cache: Path, workers: Workers) -> str:
    """Return the same with one worker killed while it works."""

    def kill() -> None:
        while True:
            marks = list((cache / "running").glob("*"))
            if marks and marks[0].stat().st_size:
                os.kill(multiprocessing.active_children()[0].pid or 0, signal.SIGKILL)
                return
            time.sleep(0.01)

    killer = threading.Thread(target=kill)
    killer.start()
    found = digest(logs, cache, workers)
    killer.join()
    return found


def killed_run(folder: Path, defaults: Defaults, out: Path) -> tuple[str, int]:
    """Return the same of the command, killed when a log was done, and begun again; logs kept."""
    command = [
        *(sys.executable, "-m", "rotorfit", "fleet", str(folder), "-o", str(out)),
        *("--airframe", str(defaults.airframe), "--mass", str(defaults.mass), "--workers", "2"),
    ]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(command, **quiet)
    while not list(out.glob("cache/*/*.npz")) and process.poll() is None:
        time.sleep(0.02)
    process.kill()
    process.wait()
    kept = len(list(out.glob("cache/*/*.npz")))
    subprocess.run(command, check=True, **quiet)
    files = {
        p.name: p.read_bytes() for p in out.iterdir() if p.is_file() and p.name != "fleet.json"
    }
    return fingerprint(files), kept


def by_dask(logs, cache: Path) -> str:
    """Return the same from a cluster of two worker processes on this machine."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        return digest(logs, cache, Workers(scheduler=cluster.scheduler_address))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--flights", type=int, default=8)
    parser.add_argument("--most", type=int, default=10_000)
    parser.add_argument("--joined", type=int, default=1000)
    parser.add_argument("--no-dask", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        defaults = made_fleet(folder / "logs", given.flights, given.seconds)
        logs = listed_logs(folder / "logs", defaults)
        tasks = [log.task for log in logs]
        read, whole = pace(tasks)
        print(f"reading alone       {1 / read:6.2f} flights a second and core ({read:.2f} s each)")
        print(
            f"the whole map step  {1 / whole:6.2f} flights a second and core ({whole:.2f} s each)"
        )
        print(f"the whole over reading {whole / read:.1f}")
        alone = digest(logs, folder / "alone", Workers(count=0))
        keys = [
            flight.key for flight in read_fleet(logs, folder / "alone", Workers(count=0)).cached
        ]
        sizes = [path.stat().st_size for path in (folder / "alone").glob("*/*.npz")]
        print(f"kept of a flight    {sum(sizes) / len(sizes) / 1000:.0f} kB")
        for count in sorted({100, 1000, given.most}):
            found = in_a_process(rows_memory, folder / "alone", keys, count)
            print(f"rows of {count:6d} flights, peak {found:.0f} MB")
        for count in sorted({10, 100, given.joined}):
            found = in_a_process(joined_memory, folder / "alone", keys, tasks[0], count)
            print(f"{count:6d} flights fitted together, peak {found:.0f} MB")
        print(f"alone               {alone}")
        print(f"two processes       {digest(logs, folder / 'two', Workers(count=2))}")
        print(f"a worker killed     {killed_worker(logs, folder / 'worker', Workers(count=2))}")
        if not given.no_dask:
            print(f"Dask, two workers   {by_dask(logs, folder / 'dask')}")
        found, kept = killed_run(folder / "logs", defaults, folder / "run")
        print(f"run killed with {kept} of {len(logs)} logs done, and begun again {found}")


if __name__ == "__main__":
    main()
