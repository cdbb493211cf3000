"""A wrong spin is refused with the right one, and right spins never are."""

from dataclasses import replace

import numpy as np
import pytest

import flown
import made_fit
from rotorfit.checks.spins import negative_drag, refuse_wrong_spins
from rotorfit.errors import FrameError
from rotorfit.fit.alternatives.spin_search import RotorDrags, compare_spins
from rotorfit.fit.alternatives.yaw_residuals import with_spins
from rotorfit.fit.dataset.load import load_dataset
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.fit_flights import allow_for_settings, fit_flights
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.fit.timing.timing_fit import time_motors
from rotorfit.simulation import (
    PERFECT,
    STILL,
    Scenario,
    simulate_flight,
    variant,
    write_flight_table,
)

GUSTS = {
    "disturbance_force_std": (0.5, 0.5, 0.5),
    "disturbance_torque_std": (0.03, 0.03, 0.01),
}
PRODUCTS = 0.05
"""Products of inertia over the moments: they turn roll torque into yaw, as a wrong spin would."""


@pytest.fixture(scope="session")
def judged(tmp_path_factory):
    """Return what the check finds of a flight that is declared with other spins."""
    folder = tmp_path_factory.mktemp("spins")

    def found(flight, *wrong):
        table = folder / "flight.csv"
        table.unlink(missing_ok=True)
        write_flight_table(flight, table)
        pattern = np.ones(len(flight.vehicle.rotors))
        pattern[list(wrong)] = -1.0
        declared = with_spins(flight.vehicle, pattern)
        path = flown.experiment_file(
            folder / "experiment.toml", declared, [table], mass=flight.truth.mass
        )
        dataset = time_motors(
            TimedDataset.of(load_dataset(load_experiment(path), str)),
            lag=True,
            report=lambda words: None,
        )
        return list(
            refuse_wrong_spins(compare_spins(allow_for_settings(fit_flights(dataset, None))))
        )

    return found


@pytest.fixture(scope="module")
def flights():
    """Return one noisy flight of each."""
    return {
        name: flown.simulated(name, "real", seed=4, seconds=15.0, physics_rate=200.0)
        for name in ("A", "quad-x", "hexa-x", "x8", "hexa-tilted")
    }


@pytest.mark.parametrize("name", ["A", "quad-x", "hexa-x", "x8", "hexa-tilted"])
def test_right_spins_are_taken(judged, flights, name):
    assert [one.severity for one in judged(flights[name])] == ["passed"]


@pytest.mark.parametrize("name", ["A", "quad-x", "hexa-x"])
def test_one_wrong_spin_is_named(judged, flights, name):
    right = flights[name].vehicle.rotors[-1].spin
    last = len(flights[name].vehicle.rotors) - 1
    with pytest.raises(FrameError, match=f"with rotor {last + 1} {right} the drag torques"):
        judged(flights[name], last)


def test_a_wrong_spin_of_two_on_one_axis_is_named_as_either(judged, flights):
    with pytest.raises(FrameError, match=r"with rotor \d ccw \(or rotor \d ccw\)") as refused:
        judged(flights["x8"], 7)
    assert "rotor 8 ccw" in str(refused.value)
    assert "rotor 4 ccw" in str(refused.value)


def test_the_share_of_a_wrong_rotor_is_evidence(judged, flights):
    with pytest.raises(FrameError) as refused:
        judged(flights["quad-x"], 1)
    (drag,) = refused.value.finding.evidence
    assert drag.interval[0] < -1.0 < drag.interval[1]
    assert drag.value < drag.limit == 0.0
    (passed,) = judged(flights["quad-x"])
    (drag,) = passed.evidence
    assert drag.interval[0] < 1.0 < drag.interval[1]
    assert drag.value > 0.0


@pytest.mark.parametrize("name", ["quad-x", "hexa-x"])
def test_products_of_inertia_are_no_wrong_spin(judged, name):
    (truth, vehicle), sensors = variant(flown.simulated_vehicle(name), "real")
    xx, yy, zz = truth.inertia[:3]
    products = (0.0, PRODUCTS * (xx * zz) ** 0.5, -PRODUCTS * (yy * zz) ** 0.5)
    truth = replace(truth, inertia=(xx, yy, zz, *products))
    scenario = Scenario(seconds=12.0, sensors=sensors, physics_rate=200.0)
    flight = simulate_flight(truth, vehicle, scenario, seed=3)
    assert [one.severity for one in judged(flight)] == ["passed"]
    with pytest.raises(FrameError, match="yaw contradicts the declared spins: with rotor 2 "):
        judged(flight, 1)


@pytest.mark.parametrize(
    "kind", ["gusts", pytest.param("gusts, perfect sensors", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("name", ["A", "hexa-x"])
def test_a_gusty_hover_is_no_wrong_spin(judged, name, kind):
    (truth, vehicle), sensors = variant(flown.simulated_vehicle(name), "real")
    scenario = Scenario(
        seconds=8.0,
        sticks=STILL,
        sensors=PERFECT if "perfect" in kind else sensors,
        physics_rate=200.0,
    )
    truth = replace(truth, **GUSTS)
    found = judged(simulate_flight(truth, vehicle, scenario, seed=6))
    assert all(one.severity == "passed" for one in found)


def test_patterns_that_rotors_do_not_fly_show_nothing():
    """Six rotors, two patterns of which hardly fly: along them any drag is as good."""
    unflown = np.array([1.0, -1.0, 0.0, 1.0, -1.0, 0.0]) / 2.0
    drags = RotorDrags(
        values=np.ones(6) + 20.0 * unflown,
        covariance=100.0 * np.outer(unflown, unflown) + 1e-3 * np.eye(6),
        blocks=20.0,
    )
    assert drags.holds(np.ones(6))
    assert not replace(drags, covariance=1e-3 * np.eye(6)).holds(np.ones(6))


def numbers(**values):
    names = tuple(f"{name}@A" for name in values)
    return Numbers(
        names=names,
        values=np.array([value for value, _ in values.values()]),
        terms=made_fit.known_to(np.array([half for _, half in values.values()])),
        correlation=np.eye(len(names)),
        excitation={"roll@A": 50.0, "pitch@A": 50.0, "yaw@A": 20.0},
    )


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (numbers(kd_over_Izz=(-2e-6, 1e-6), Jr_over_Izz=(0.0, 1.0)), "kd / Izz of A"),
        # A hover in gusts: the answer to them looks like the spin-up of reversed rotors.
        (numbers(kd_over_Izz=(-1e-6, 2e-6), Jr_over_Izz=(-3.1, 1.4)), None),
        (numbers(kd_over_Izz=(2e-6, 1e-6), Jr_over_Izz=(-3.1, 1.4)), None),
        (numbers(kd_over_Izz=(-2e-6, np.inf)), None),
    ],
)
def test_a_drag_below_zero_reverses_the_propellers(found, said, assert_wording):
    words = negative_drag(["A"], found)
    if said is None:
        assert words is None
    else:
        assert words.startswith(f"{said} comes out below zero (")
        assert_wording(words)


def test_negative_drag_of_tilted_rotors_asks_for_the_tilt():
    """25 degrees declared of 20: all spins were to be reversed, and nothing else."""
    found = numbers(kd_over_Izz=(-2e-6, 1e-6))
    assert "tilted less than declared" in str(negative_drag(["A"], found, leans=True))
    assert "tilted" not in str(negative_drag(["A"], found))


def test_negative_drag_of_a_calm_flight_is_doubted():
    """No other spins are tried there, as nothing but the drag says so."""
    (found,) = refuse_wrong_spins(
        made_fit.fit(made_fit.dataset(made_fit.prepared()), numbers(kd_over_Izz=(-2e-6, 1e-6)))
    )
    assert found.severity == "doubt"
    assert found.is_about("kd_over_Izz@A")
    assert not found.is_about("kt")
    assert "below zero" in found.sentence
    assert not list(
        refuse_wrong_spins(
            made_fit.fit(made_fit.dataset(made_fit.prepared()), numbers(kd_over_Izz=(2e-6, 1e-6)))
        )
    )


def test_identify_refuses_a_wrong_spin(tmp_path):
    flight = flown.simulated("A", "noisy", seed=4, seconds=15.0, physics_rate=200.0)
    wrong = with_spins(flight.vehicle, np.array([-1.0, 1.0, 1.0, 1.0]))
    with pytest.raises(FrameError, match="with rotor 1 ccw the drag torques of all"):
        flown.identified(tmp_path, [flight], vehicle=wrong, extra="[motors]\ndelay = 0.0\n")
