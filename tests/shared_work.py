"""Simulations that depend on their arguments alone, done once for equal ones.

A conftest that imports `shared_manoeuvres` has them for all tests of its folder.
"""

import copy
import functools
import hashlib
import pickle
from collections.abc import Callable
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


@functools.cache
def manoeuvres_flown_once() -> Callable[..., Any]:
    """Return the simulator of calm flights that a plan uses; it keeps what it flew."""
    from rotorfit.tools.planning import bound  # only where something is planned

    return answer_once(bound.simulate_calm_flights)


@pytest.fixture(autouse=True)
def shared_manoeuvres(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fly each manoeuvre of each vehicle once for all tests."""
    shared = manoeuvres_flown_once()
    monkeypatch.setattr("rotorfit.tools.planning.bound.simulate_calm_flights", shared)
