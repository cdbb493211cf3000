"""What several flights of one vehicle say that none of them could know."""

from dataclasses import replace

import pytest

import flown
from rotorfit.simulation import STILL, Scenario, paper_vehicle, simulate_flight, variant

KNOWN_DELAY = "[motors]\ndelay = 0.0\n"


@pytest.fixture(scope="module")
def fly():
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "noisy")

    def flight(seed, *, air=1.0, **scenario):
        sticks = {"seconds": 12.0, "ground_seconds": 2.0, "physics_rate": 200.0, **scenario}
        thinner = replace(truth, kt=truth.kt * air)
        return simulate_flight(thinner, vehicle, Scenario(sensors=sensors, **sticks), seed=seed)

    return flight


def test_what_differs_between_flights_is_in_the_interval(tmp_path, fly):
    """Other propellers, other air: thrust differs by 4 % from flight to flight."""
    alike = flown.identified(tmp_path, [fly(k) for k in (1, 2, 3)], extra=KNOWN_DELAY)
    apart = [fly(k, air=air) for k, air in ((1, 0.96), (2, 1.0), (3, 1.04))]
    result = flown.identified(tmp_path, apart, extra=KNOWN_DELAY)
    kt = result.parameter("kt")
    assert kt.std > 2.0 * alike.parameter("kt").std
    truth = apart[1].truth.kt
    assert kt.interval[0] < truth < kt.interval[1]
    assert kt.interval[1] - kt.interval[0] > 0.04 * truth


def test_a_calm_flight_beside_a_lively_one_does_no_harm(tmp_path, fly):
    calm = fly(5, sticks=STILL)
    alone = flown.identified(tmp_path, [fly(4)], extra=KNOWN_DELAY)
    both = flown.identified(tmp_path, [fly(4), calm], extra=KNOWN_DELAY)
    rho, mean = (r.diagnostics["excitation_roll@A"] for r in (alone, both))
    assert mean == pytest.approx(0.5 * rho, rel=0.2)
    assert both.derived_value("Ixx_com").std < 1.2 * alone.derived_value("Ixx_com").std
