"""A Dask cluster gives the same rows as one process alone; the first log of it ends a worker."""

import logging
import os
import shutil

import pytest

from rotorfit.errors import OutputError
from rotorfit.fleet.executors import by_cluster
from rotorfit.fleet.listing import FlightTask
from rotorfit.fleet.work import Desk

distributed = pytest.importorskip("distributed", reason="pip install 'rotorfit[dask]'")


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_gives_the_same_and_survives_a_log_that_hangs(small_fleet, tmp_path):
    desk = Desk(cache=tmp_path / "cache", time_limit=3.0)
    shutil.copytree(small_fleet.cache, desk.cache)
    desk.running.mkdir(exist_ok=True)
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    good = [kept.task for kept in small_fleet.fleet.kept]
    hanging = FlightTask(file=str(pipe), airframe=good[0].airframe, mass=good[0].mass)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
    ) as cluster:
        found = by_cluster([hanging, *good], desk, scheduler=cluster.scheduler_address)
        answers = {answer.task: answer for answer in found}
    assert answers.pop(hanging).failure.reason.startswith("stopped after 3 s")
    assert [answers[task].key for task in good] == [kept.key for kept in small_fleet.fleet.kept]


def test_nobody_answering_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr("rotorfit.fleet.executors.CONNECT_SECONDS", 0.2)
    with pytest.raises(OutputError, match="no Dask scheduler answers at tcp://127"):
        list(by_cluster([], Desk(cache=tmp_path), scheduler="tcp://127.0.0.1:1"))
