"""Logs read where the platform's own integers have 32 bits, as in a browser's WebAssembly.

NumPy makes integers of that size there wherever nobody says otherwise, and counts in them: a
number beyond wraps without a word, and a 64-bit one is no index. Both are played here; on a machine
that has them (benchmarks/thirty_two_bits.sh) all of it holds.
"""

import sys
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from blackbox_encoder import record_random

from rotorfit.logs.blackbox.decode import decode


def small(value: Any) -> Any:
    """Return what the platform would make of a Python integer, or of an array without a type."""
    if isinstance(value, bool) or not isinstance(value, int):
        return value
    return np.int64(value).astype(np.int32) if abs(value) < 1 << 63 else value


def index(value: Any) -> np.ndarray:
    """Return what counts; refused where the platform cannot count so far."""
    numbers = np.asarray(value)
    if numbers.dtype == np.int64 and isinstance(value, np.ndarray):
        raise TypeError("Cannot cast array data from dtype('int64') to dtype('int32')")
    return numbers


class Small(ModuleType):
    """NumPy of a platform of 32 bits, where it differs and is used by the readers."""

    intp = int_ = np.int32

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)

    def where(self, condition, *choices):
        return np.where(condition, *map(small, choices))

    def choose(self, number, choices):
        return np.choose(index(number), choices)

    def bincount(self, numbers, *, minlength=0):
        return np.bincount(index(numbers), minlength=minlength).astype(np.int32)

    def arange(self, *ends, dtype=np.int32):
        return np.arange(*ends, dtype=dtype)

    def flatnonzero(self, values):
        return np.flatnonzero(values).astype(np.int32)

    def argsort(self, values, **how):
        return np.argsort(values, **how).astype(np.int32)


@pytest.fixture
def platform(monkeypatch):
    """Let the reader's NumPy be one of 32 bits."""
    inner = [m for name, m in sys.modules.items() if name.startswith("rotorfit.logs.blackbox.")]
    changed = [module for module in inner if getattr(module, "np", None) is np]
    assert len(changed) > 3
    for module in changed:
        monkeypatch.setattr(module, "np", Small("numpy"))


@pytest.mark.usefixtures("platform")
@pytest.mark.parametrize("version", [1, 2])
def test_every_field_is_as_recorded(version):
    recorder = record_random(3, 200, version=version)
    log = decode(recorder.data)
    assert log.main.values.tolist() == recorder.main
    assert log.gps.values.tolist() == recorder.gps
    assert (log.main.values < 0).any()
