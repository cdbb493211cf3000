"""Solving again from the factors of a flight, by what has changed; with pytest-benchmark.

pytest -n 0 benchmarks/bench_factors.py --benchmark-enable --jaxtyping-packages=
"""

import dataclasses

import factors_speed as speed
import numpy as np
import pytest

from rotorfit.estimation.least_squares import total
from rotorfit.fit.reduction.reduce import time_factors
from rotorfit.model.regressor import regressor


@pytest.fixture(scope="module")
def base():
    flight = speed.made_up_flight(18_000)
    factors = time_factors(flight, speed.plus_frame()).merged()
    return speed.problem(factors, regressor(speed.plus_frame()))


def test_other_weights(benchmark, base):
    weights = np.array([[1.0, 1.0, 2.0, 40.0, 50.0, 60.0]])
    estimate = benchmark(lambda: total(dataclasses.replace(base, weights=weights)))
    assert estimate.value("kt") == pytest.approx(speed.TRUTH["kt"], rel=0.01)


def test_one_parameter_less(benchmark, base):
    estimate = benchmark(lambda: total(dataclasses.replace(base, map=base.map.without("Iyz"))))
    assert len(estimate.names) == len(speed.FREE) - 1


def test_other_geometry(benchmark, base):
    def solve():
        tensor = regressor(speed.plus_frame(0.21)).tensor
        return total(dataclasses.replace(base, tensors=(tensor,)))

    assert benchmark(solve).value("kt") == pytest.approx(speed.TRUTH["kt"], rel=0.05)
