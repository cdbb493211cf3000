"""A wrong spin is refused with the right one, and right spins never are."""

from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.diagnostics.spins import better_spins, negative_drag
from rotorfit.errors import FrameError
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.reduction.frequency_bands import EDGES
from rotorfit.reduction.reduce import BandPlan, yaw_factors
from rotorfit.simulation import (
    PERFECT,
    STILL,
    Scenario,
    sampled_flight_data,
    simulate_flight,
    variant,
)

PLAN = BandPlan(edges=EDGES, longest=10.0)
GUSTS = {
    "disturbance_force_std": (0.5, 0.5, 0.5),
    "disturbance_torque_std": (0.03, 0.03, 0.01),
}


def judged(data, vehicle):
    return better_spins(vehicle, [yaw_factors(data, len(vehicle.rotors), plan=PLAN)])


@pytest.fixture(scope="module")
def flights():
    """Return the samples and the vehicle of one noisy flight of each."""
    found = {}
    for name in ("A", "quad-x", "hexa-x", "x8", "hexa-tilted"):
        flight = flown.simulated(name, "real", seed=4, seconds=15.0, physics_rate=200.0)
        found[name] = (sampled_flight_data(flight, signals="measured"), flight.vehicle)
    return found


def turned(vehicle, *which):
    rotors = list(vehicle.rotors)
    for i in which:
        rotors[i] = replace(rotors[i], spin="cw" if rotors[i].spin == "ccw" else "ccw")
    return replace(vehicle, rotors=tuple(rotors))


@pytest.mark.parametrize("name", ["A", "quad-x", "hexa-x", "x8", "hexa-tilted"])
def test_right_spins_are_taken(flights, name):
    assert judged(*flights[name]) is None


@pytest.mark.parametrize("name", ["A", "quad-x", "hexa-x", "x8"])
def test_one_wrong_spin_is_named(flights, name):
    data, vehicle = flights[name]
    for i in (0, len(vehicle.rotors) - 1):
        words = judged(data, turned(vehicle, i))
        assert f"with rotor {i + 1} {vehicle.rotors[i].spin} the rotors leave " in words


@pytest.mark.parametrize("sticks", ["yaw alone", "all"])
def test_reversed_spins_are_named_whatever_else_is_flown(flights, sticks):
    data, vehicle = flights["quad-x"]
    if sticks == "yaw alone":
        plain = Scenario().sticks
        calm = replace(plain, roll=STILL.roll, pitch=STILL.pitch)
        flight = flown.simulated(
            "quad-x", "noisy", seed=2, seconds=15.0, sticks=calm, physics_rate=200.0
        )
        data = sampled_flight_data(flight, signals="measured")
        assert judged(data, vehicle) is None
    words = judged(data, turned(vehicle, *range(4)))
    assert "with every spin reversed (props out instead of in)" in words


@pytest.mark.parametrize("kind", ["disturbed", "gusts", "gusts, perfect sensors"])
@pytest.mark.parametrize("name", ["A", "quad-x", "hexa-x", "x8"])
def test_a_gusty_hover_is_no_wrong_spin(name, kind):
    gusty = kind.startswith("gusts")
    (truth, vehicle), sensors = variant(flown.simulated_vehicle(name), "real" if gusty else kind)
    scenario = Scenario(
        seconds=8.0,
        sticks=STILL,
        sensors=PERFECT if "perfect" in kind else sensors,
        physics_rate=200.0,
    )
    truth = replace(truth, **GUSTS) if gusty else truth
    data = sampled_flight_data(
        simulate_flight(truth, vehicle, scenario, seed=6), signals="measured"
    )
    assert judged(data, vehicle) is None


def numbers(*, yaw=20.0, **values):
    names = tuple(f"{name}@A" for name in values)
    return Numbers(
        names=names,
        values=np.array([value for value, _ in values.values()]),
        half_width=np.array([half for _, half in values.values()]),
        correlation=np.eye(len(names)),
        excitation={"roll@A": 50.0, "pitch@A": 50.0, "yaw@A": yaw},
    )


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (numbers(kd_over_Izz=(-2e-6, 1e-6), Jr_over_Izz=(0.0, 1.0)), "kd / Izz of A"),
        (numbers(kd_over_Izz=(-1e-6, 2e-6), Jr_over_Izz=(-3.1, 1.4)), "Jr / Izz of A"),
        (numbers(kd_over_Izz=(-1e-6, 2e-6), Jr_over_Izz=(-2.0, 1.4)), None),
        (numbers(kd_over_Izz=(2e-6, 1e-6), Jr_over_Izz=(-3.1, 1.4)), None),
        # A hover in gusts: the answer to them looks like reversed rotors.
        (numbers(yaw=4.9, kd_over_Izz=(-1e-6, 2e-6), Jr_over_Izz=(-3.1, 1.4)), None),
        (numbers(yaw=4.9, kd_over_Izz=(-2e-6, 1e-6)), "kd / Izz of A"),
        (numbers(kd_over_Izz=(-2e-6, np.inf)), None),
    ],
)
def test_a_drag_below_zero_reverses_the_propellers(found, said):
    words = negative_drag(["A"], found)
    if said is None:
        assert words is None
    else:
        assert words.startswith(f"{said} comes out below zero (")
        assert "the propellers turn the other way than declared: reverse all spins" in words


def test_identify_refuses_a_wrong_spin(tmp_path):
    flight = flown.simulated("A", "noisy", seed=4, seconds=15.0, physics_rate=200.0)
    wrong = turned(flight.vehicle, 0)
    with pytest.raises(FrameError, match="with rotor 1 ccw the rotors leave"):
        flown.identified(tmp_path, [flight], vehicle=wrong, extra="[motors]\ndelay = 0.0\n")
