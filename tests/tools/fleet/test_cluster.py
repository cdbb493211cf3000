"""A Dask cluster gives the same rows as one process alone; the first log of it ends a worker."""

import logging
import os
import shutil

import pytest

from rotorfit.errors import OutputError
from rotorfit.tools.fleet.executors import Workspace, by_cluster
from rotorfit.tools.fleet.listing import FlightTask

distributed = pytest.importorskip("distributed", reason="pip install 'rotorfit[dask]'")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.slow
def test_a_cluster_gives_the_same_and_survives_a_hanging_log(small_fleet, tmp_path):
    space = Workspace(cache=tmp_path / "cache", time_limit=3.0)
    shutil.copytree(small_fleet.cache, space.cache)
    space.running.mkdir(exist_ok=True)
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    good = [flight.task for flight in small_fleet.fleet.cached]
    hanging = FlightTask(file=str(pipe), airframe=good[0].airframe, mass=good[0].mass)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
    ) as cluster:
        found = by_cluster([hanging, *good], space, scheduler=cluster.scheduler_address)
        outcomes = {outcome.task: outcome for outcome in found}
    assert outcomes.pop(hanging).refusal.sentence.startswith("stopped after 3 s")
    assert [outcomes[task].key for task in good] == [
        flight.key for flight in small_fleet.fleet.cached
    ]


def test_a_scheduler_that_does_not_answer_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("rotorfit.tools.fleet.executors.CONNECT_SECONDS", 0.2)
    with pytest.raises(OutputError, match="no Dask scheduler answers at tcp://127"):
        list(by_cluster([], Workspace(cache=tmp_path), scheduler="tcp://127.0.0.1:1"))
