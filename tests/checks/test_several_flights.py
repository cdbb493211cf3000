"""What several flights of one vehicle say that none of them could know."""

from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.fit.alternatives import flights_alone
from rotorfit.simulation import (
    STILL,
    Scenario,
    paper_vehicle,
    simulate_flight,
    variant,
    write_flight_table,
)
from rotorfit.simulation.pilot import MANOEUVRES

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


@pytest.mark.slow
def test_a_calm_flight_next_to_a_lively_one_does_no_harm(tmp_path, fly):
    calm = fly(5, sticks=STILL)
    alone = flown.identified(tmp_path, [fly(4)], extra=KNOWN_DELAY)
    both = flown.identified(tmp_path, [fly(4), calm], extra=KNOWN_DELAY)
    rho, mean = (r.diagnostics["excitation_roll@A"] for r in (alone, both))
    assert mean == pytest.approx(rho, rel=0.3)  # by the weights of the fit, which leave it out
    assert both.derived_value("Ixx_com").std < 1.2 * alone.derived_value("Ixx_com").std


@pytest.mark.slow
def test_one_axis_at_a_time_gives_inertia_and_yaw_as_a_ratio(tmp_path, fly):
    """Calm in two axes of three, and with noisy rotor speeds, every flight but one says nothing."""
    flights = [
        fly(seed, seconds=20.0, sticks=MANOEUVRES[name])
        for seed, name in enumerate(("roll", "pitch", "yaw"), start=1)
    ]
    result = flown.identified(tmp_path, flights, extra=KNOWN_DELAY)
    truth = flights[0].truth
    for name, true in zip(("Ixx_com", "Iyy_com"), np.diagonal(truth.com_inertia), strict=False):
        found = result.derived_value(name)
        assert found.interval[0] < true < found.interval[1]
        assert found.std < 0.04 * true
    ratio = result.derived_value("kd_over_Izz")
    assert ratio.interval[0] < truth.kd / truth.com_inertia[2, 2] < ratio.interval[1]
    for name, partner in (("kd", "Izz"), ("Izz", "kd")):
        found = result.parameter(name)
        assert (found.verdict, found.partner, found.value) == ("ratio-only", partner, None)
        assert "yaw while rolling" in found.advice
    assert any("known only as a ratio" in words for words in result.warnings)


def test_half_a_second_next_to_a_flight_is_not_compared_with_it(tmp_path, fly, monkeypatch):
    """Its few equations have an end at any numbers at all."""
    compared = []
    judged = flights_alone.joint_estimate

    def counting(joint, *more, **known):
        compared.append(len(joint[0].factors))
        return judged(joint, *more, **known)

    monkeypatch.setattr(flights_alone, "joint_estimate", counting)
    flights = [fly(1), fly(2)]
    for number, flight in enumerate(flights):
        write_flight_table(flight, tmp_path / f"flight{number}.csv")
    windows = '{ file = "flight0.csv" }, { file = "flight1.csv", start = 6.0, end = 6.6 }'
    text = (
        f"{flown.airframe_table(flights[0].vehicle)}\n{KNOWN_DELAY}\n[[configuration]]\n"
        f"mass = {flights[0].truth.mass}\nflights = [{windows}]\n"
    )
    (tmp_path / "experiment.toml").write_text(text)
    flown.quietly_identified(tmp_path / "experiment.toml")
    assert len(compared) == 1
    assert compared[0] > 10
