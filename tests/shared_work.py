"""Simulations and reductions that depend on their arguments alone, done once for equal ones.

A conftest that imports `shared_manoeuvres`, `shared_bandwidths` or `shared_experiments` has them
for all tests of its folder.
"""

import copy
import functools
import hashlib
import importlib
import pickle
from collections.abc import Callable, Iterator
from typing import Any

import pytest


def answer_once(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that keeps its answers by the content of its arguments, and copies them."""
    answers: dict[bytes, Any] = {}

    @functools.wraps(function)
    def answer(*arguments: Any, **options: Any) -> Any:
        key = hashlib.sha256(pickle.dumps((arguments, options))).digest()
        if key not in answers:
            answers[key] = function(*arguments, **options)
        return copy.deepcopy(answers[key])

    return answer


PLANNED = "rotorfit.tools.planning.bound"
JUDGED = "rotorfit.fit.timing.sensor_bandwidth"


@functools.cache
def kept_answers(module: str, name: str) -> Callable[..., Any]:
    """Return a function of a module as `answer_once` keeps its answers, for all tests."""
    return answer_once(getattr(importlib.import_module(module), name))


@pytest.fixture(autouse=True)
def shared_manoeuvres(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fly and reduce each manoeuvre of each vehicle once for all tests."""
    for name in ("simulate_calm_flights", "band_factors"):
        monkeypatch.setattr(f"{PLANNED}.{name}", kept_answers(PLANNED, name))


@pytest.fixture(autouse=True)
def shared_bandwidths(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look once for the low-passes of each flight at each timing of its motors."""
    monkeypatch.setattr(f"{JUDGED}.bandwidths", kept_answers(JUDGED, "bandwidths"))


@functools.cache
def experiments_flown_once() -> Callable[..., Any]:
    """Return the simulator of an experiment's flights; it keeps what it flew."""
    from rotorfit.simulation import experiment_files

    return answer_once(experiment_files.fly)


@pytest.fixture(scope="module", autouse=True)
def shared_experiments() -> Iterator[None]:
    """Fly each flight of each experiment once for all tests; `tests/simulation` flies them again.

    For fixtures of a module, too.
    """
    shared = experiments_flown_once()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rotorfit.simulation.experiment_files.fly", shared)
        yield
