"""A fleet is the same whoever works; what is done is kept; a log at fault costs that log alone."""

import multiprocessing
import os
import re
import shutil
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "logs"))
from blackbox_encoder import record_random

from rotorfit.errors import ExperimentError, OutputError
from rotorfit.report.fleet_files import fleet_files
from rotorfit.tools.fleet.executors import Workspace, by_processes, process_log
from rotorfit.tools.fleet.listing import Defaults, FlightTask, listed_logs
from rotorfit.tools.fleet.records import path_of, read_entry, write_entry
from rotorfit.tools.fleet.run import Workers, claim, read_fleet, refusals_file, types_of


def files(fleet, cache):
    return fleet_files(fleet, types_of(fleet), cache, Workers(count=0), name="small")


def test_every_log_has_a_row_or_a_reason(small_fleet, assert_wording):
    fleet = small_fleet.fleet
    assert [(r.file, r.vehicle, r.configuration) for r in fleet.records] == [
        ("one/flight1.csv", "one", "A"),
        ("one/flight2.csv", "one", "A"),
        ("two/flight1.csv", "two", "A"),
        ("two/flight2.csv", "two", "A"),
    ]
    found = {r.file: (r.refusal.sentence, r.refusal.next_step) for r in fleet.refused}
    assert set(found) == {"two/empty.bfl", "two/flight9.csv", "two/notes.csv"}
    assert "is empty (0 bytes)" in found["two/empty.bfl"][0]
    assert "as one/flight1.csv" in found["two/flight9.csv"][0]
    assert_wording(found["two/flight9.csv"][0])
    assert all(advice for _, advice in found.values())


def test_what_is_kept_is_not_worked_on_again(small_fleet):
    said = []
    again = read_fleet(small_fleet.logs, small_fleet.cache, Workers(count=0), progress=said.append)
    assert (said[-1].done, said[-1].total) == (7, 7)
    # An empty file is looked at every time: there is nothing to know it by.
    assert said[-1].fresh == 1
    assert files(again, small_fleet.cache) == files(small_fleet.fleet, small_fleet.cache)


def test_an_entry_that_was_spoilt_is_made_anew(small_fleet, tmp_path):
    cache = tmp_path / "cache"
    shutil.copytree(small_fleet.cache, cache)
    flight = small_fleet.fleet.cached[0]
    path = path_of(cache, flight.key)
    whole = path.read_bytes()
    for spoilt in (whole[: len(whole) // 2], b"", whole[:60] + b"\0" * 200 + whole[260:]):
        path.write_bytes(spoilt)
        assert read_entry(cache, flight.key) is None
    assert process_log(flight.task, Workspace(cache=cache)).fresh
    assert read_entry(cache, flight.key).record.values.tobytes() == (
        small_fleet.fleet.records[0].values.tobytes()
    )


def test_an_entry_comes_back_as_it_was(small_fleet, tmp_path):
    entry = read_entry(small_fleet.cache, small_fleet.fleet.cached[0].key, factors=True)
    write_entry(tmp_path, "ab", entry)
    again = read_entry(tmp_path, "ab", factors=True)
    assert set(again.factors) == set(entry.factors)
    for name, array in entry.factors.items():
        assert again.factors[name].tobytes() == array.tobytes()
    assert repr(again.record) == repr(entry.record)


def test_other_options_are_another_entry(small_fleet):
    task = small_fleet.fleet.cached[0].task
    heavier = FlightTask(file=task.file, airframe=task.airframe, mass=task.mass * 1.01)
    keys = [process_log(t, Workspace(cache=small_fleet.cache)).key for t in (task, heavier)]
    assert keys[0] != keys[1]


def test_interrupted_processes_give_the_same_bytes(small_fleet, tmp_path):
    """Stopped after the first answer; then gone on, and a worker killed in the middle of it.

    Meanwhile the second log is a pipe: whoever reads it waits, however fast it works.
    """
    folder = tmp_path / "one"
    shutil.copytree(small_fleet.folder / "one", folder)
    first, second = (folder / f"flight{number}.csv" for number in (1, 2))
    ready = second.rename(tmp_path / "ready.csv")
    os.mkfifo(second)
    logs = [log for log in small_fleet.logs if "two" not in log.name]
    logs = [
        replace(log, task=replace(log.task, file=str(folder / Path(log.name).name))) for log in logs
    ]
    assert [log.task.file for log in logs] == [str(first), str(second)]
    cache = tmp_path / "cache"

    def stop(said):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        read_fleet(logs, cache, Workers(count=1), progress=stop)
    while multiprocessing.active_children():  # one has ended once the pool's own thread says so
        time.sleep(0.01)
    assert len(list(cache.glob("*/*.npz"))) == 1

    killed, done = [], threading.Event()
    mark = Workspace(cache=cache).mark_of(logs[1].task)
    mark.unlink(missing_ok=True)  # whoever was broken off may have left it

    def kill_one():
        while not (mark.exists() and mark.stat().st_size) and not done.is_set():
            time.sleep(0.001)
        ready.rename(second)
        killed.extend(multiprocessing.active_children())
        for process in killed:
            process.kill()

    killer = threading.Thread(target=kill_one)
    killer.start()
    said = []
    fleet = read_fleet(logs, cache, Workers(count=1), progress=said.append)
    done.set()
    killer.join()
    assert killed
    assert [t.fresh for t in said] == [0, 1]
    assert not fleet.refused
    expected = read_fleet(logs, small_fleet.cache, Workers(count=0))
    assert files(fleet, cache) == files(expected, small_fleet.cache)


@pytest.mark.slow
def test_a_log_that_hangs_costs_that_log(small_fleet, tmp_path):
    """A pipe that nobody writes into is a log that never ends."""
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    space = Workspace(cache=tmp_path / "cache", time_limit=2.0)
    space.running.mkdir(parents=True)
    good = small_fleet.fleet.cached[0].task
    hanging = FlightTask(file=str(pipe), airframe=good.airframe, mass=good.mass)
    shutil.copytree(small_fleet.cache, space.cache, dirs_exist_ok=True)
    outcomes = {o.task: o for o in by_processes([hanging, good], space, workers=1)}
    assert outcomes[good].key == small_fleet.fleet.cached[0].key
    refusal = outcomes[hanging].refusal
    assert refusal.sentence.startswith("stopped after 2 s,")
    assert "--time-limit" in refusal.next_step
    assert not list(space.running.iterdir())


def test_a_log_that_ends_its_process_twice_is_refused(small_fleet, tmp_path, assert_text):
    space = Workspace(cache=tmp_path, time_limit=60.0)
    space.running.mkdir()
    task = small_fleet.fleet.cached[0].task
    space.mark_of(task).write_text("began\nbegan\n", encoding="utf-8")
    refusal = process_log(task, space).refusal
    assert_text(refusal.sentence)
    assert "--workers" in refusal.next_step


def test_a_file_of_several_logs_is_a_row_each(small_fleet, tmp_path):
    recorders = [record_random(seed, 20) for seed in (1, 2, 3)]
    for recorder in recorders:
        recorder.end()
    (tmp_path / "flight.bfl").write_bytes(b"".join(recorder.data for recorder in recorders))
    steps = []
    fleet = read_fleet(
        listed_logs(tmp_path, small_fleet.defaults),
        tmp_path / "cache",
        Workers(count=0),
        progress=steps.append,
    )
    assert [(step.done, step.total) for step in steps] == [(0, 3), (1, 3), (2, 3), (3, 3)]
    assert [log.log_number for log in fleet.refused] == [1, 2, 3]
    rows = refusals_file(fleet).decode().splitlines()[1:]
    assert [row.split(",")[:3] for row in rows] == [["flight.bfl", n, ""] for n in "123"]


def test_a_wrong_airframe_is_refused_before_reading_logs(small_fleet, tmp_path):
    logs = listed_logs(small_fleet.folder, Defaults(mass=1.0, airframe=tmp_path / "nowhere.toml"))
    with pytest.raises(ExperimentError, match=re.escape("nowhere.toml")):
        read_fleet(logs, tmp_path / "cache", Workers(count=0))
    assert not (tmp_path / "cache").exists()


def test_a_folder_of_something_else_is_not_touched(tmp_path):
    out = tmp_path / "out"
    claim(out, Path("logs"), force=False)
    claim(out, Path("logs"), force=False)
    with pytest.raises(OutputError, match="already holds the fleet of another source"):
        claim(out, Path("others"), force=False)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    with pytest.raises(OutputError, match=r"already holds thesis\.tex; name another folder"):
        claim(tmp_path / "mine", Path("logs"), force=False)
    claim(tmp_path / "mine", Path("logs"), force=True)
    assert (tmp_path / "mine" / "thesis.tex").exists()
