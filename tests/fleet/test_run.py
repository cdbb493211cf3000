"""A fleet is the same whoever works; what is done is kept; a log at fault costs that log alone."""

import multiprocessing
import os
import re
import shutil
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from rotorfit.errors import ExperimentError, OutputError
from rotorfit.fleet import run, work
from rotorfit.fleet.entries import path_of, read_entry, write_entry
from rotorfit.fleet.executors import by_processes
from rotorfit.fleet.listing import Defaults, FlightTask, listed_logs
from rotorfit.fleet.run import Workers, claim, failures_file, fleet_files, read_fleet, types_of
from rotorfit.fleet.work import Desk, worked


def files(fleet, cache):
    return fleet_files(fleet, types_of(fleet), cache, Workers(count=0), name="small")


def test_every_log_has_a_row_or_a_reason(small_fleet):
    fleet = small_fleet.fleet
    assert [(r.file, r.vehicle, r.configuration) for r in fleet.records] == [
        ("one/flight1.csv", "one", "A"),
        ("one/flight2.csv", "one", "A"),
        ("two/flight1.csv", "two", "A"),
        ("two/flight2.csv", "two", "A"),
    ]
    told = {f.file: (f.reason, f.what_to_do) for f in fleet.failures}
    assert set(told) == {"two/empty.bfl", "two/flight9.csv", "two/notes.csv"}
    assert "is empty (0 bytes)" in told["two/empty.bfl"][0]
    assert told["two/flight9.csv"][0].startswith("has the same content as one/flight1.csv")
    assert all(advice for _, advice in told.values())


def test_what_is_kept_is_not_worked_on_again(small_fleet):
    told = []
    again = read_fleet(small_fleet.logs, small_fleet.cache, Workers(count=0), tell=told.append)
    assert (told[-1].done, told[-1].total) == (7, 7)
    # An empty file is looked at every time: there is nothing to know it by.
    assert told[-1].fresh == 1
    assert files(again, small_fleet.cache) == files(small_fleet.fleet, small_fleet.cache)


def test_an_entry_that_was_spoilt_is_made_anew(small_fleet, tmp_path):
    cache = tmp_path / "cache"
    shutil.copytree(small_fleet.cache, cache)
    kept = small_fleet.fleet.kept[0]
    path = path_of(cache, kept.key)
    whole = path.read_bytes()
    for spoilt in (whole[: len(whole) // 2], b"", whole[:60] + b"\0" * 200 + whole[260:]):
        path.write_bytes(spoilt)
        assert read_entry(cache, kept.key) is None
    assert worked(kept.task, Desk(cache=cache)).fresh
    assert read_entry(cache, kept.key).record.values.tobytes() == (
        small_fleet.fleet.records[0].values.tobytes()
    )


def test_an_entry_comes_back_as_it_was(small_fleet, tmp_path):
    entry = read_entry(small_fleet.cache, small_fleet.fleet.kept[0].key, factors=True)
    write_entry(tmp_path, "ab", entry)
    again = read_entry(tmp_path, "ab", factors=True)
    assert set(again.factors) == set(entry.factors)
    for name, array in entry.factors.items():
        assert again.factors[name].tobytes() == array.tobytes()
    assert repr(again.record) == repr(entry.record)


def test_other_options_are_another_entry(small_fleet):
    task = small_fleet.fleet.kept[0].task
    heavier = FlightTask(file=task.file, airframe=task.airframe, mass=task.mass * 1.01)
    keys = [worked(t, Desk(cache=small_fleet.cache)).key for t in (task, heavier)]
    assert keys[0] != keys[1]


def test_processes_give_the_same_bytes_with_a_worker_killed_and_the_run_broken_off(
    small_fleet, tmp_path
):
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

    def stop(told):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        read_fleet(logs, cache, Workers(count=1), tell=stop)
    while multiprocessing.active_children():  # one has ended once the pool's own thread says so
        time.sleep(0.01)
    assert len(list(cache.glob("*/*.npz"))) == 1

    killed, done = [], threading.Event()
    mark = work._mark(logs[1].task, Desk(cache=cache))
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
    told = []
    fleet = read_fleet(logs, cache, Workers(count=1), tell=told.append)
    done.set()
    killer.join()
    assert killed
    assert [t.fresh for t in told] == [0, 1]
    assert not fleet.failures
    expected = read_fleet(logs, small_fleet.cache, Workers(count=0))
    assert files(fleet, cache) == files(expected, small_fleet.cache)


def test_a_log_that_hangs_costs_that_log(small_fleet, tmp_path):
    """A pipe that nobody writes into is a log that never ends."""
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    desk = Desk(cache=tmp_path / "cache", time_limit=2.0)
    desk.running.mkdir(parents=True)
    good = small_fleet.fleet.kept[0].task
    hanging = FlightTask(file=str(pipe), airframe=good.airframe, mass=good.mass)
    shutil.copytree(small_fleet.cache, desk.cache, dirs_exist_ok=True)
    answers = {a.task: a for a in by_processes([hanging, good], desk, workers=1)}
    assert answers[good].key == small_fleet.fleet.kept[0].key
    failure = answers[hanging].failure
    assert failure.reason == "stopped after 2 s, the time limit of a log"
    assert "--time-limit" in failure.what_to_do
    assert not list(desk.running.iterdir())


def test_a_log_that_ends_its_process_twice_is_left_out(small_fleet, tmp_path):
    desk = Desk(cache=tmp_path, time_limit=60.0)
    desk.running.mkdir()
    task = small_fleet.fleet.kept[0].task
    work._mark(task, desk).write_text("began\nbegan\n", encoding="utf-8")
    answer = worked(task, desk)
    assert answer.failure.reason == "the process that worked on it died, 2 times"
    assert "--workers" in answer.failure.what_to_do


def test_a_file_of_several_logs_is_a_row_each(tmp_path, monkeypatch):
    seen = []

    def answer(task, desk):
        seen.append(task.log_number)
        if task.log_number is None:
            return work.Answer(task=task, numbers=(1, 2, 3))
        return work.Answer(task=task, failure=work.failure_of(f"log {task.log_number}: no"))

    monkeypatch.setattr(run, "worked", answer)
    monkeypatch.setattr(run, "_refuse_airframes", lambda logs: None)
    table = tmp_path / "t.csv"
    table.write_text("file\nflight.bfl\n", encoding="utf-8")
    logs = listed_logs(table, Defaults(mass=1.0, airframe=tmp_path / "a.toml"))
    fleet = read_fleet(logs, tmp_path / "cache", Workers(count=0))
    assert seen == [None, 1, 2, 3]
    assert [f.log_number for f in fleet.failures] == [1, 2, 3]
    assert failures_file(fleet).decode().splitlines()[1] == "flight.bfl,1,,log 1,no"


def test_a_wrong_airframe_is_refused_before_any_log_is_read(small_fleet, tmp_path):
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
