"""The whole recipe, through files: it lands inside its own intervals, or says that it cannot."""

from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.simulation import STILL, Scenario, paper_vehicle, simulate_flight, variant

SEEDS, FIRST = range(1, 13), 4
BY_ROWS = '[identification]\nmethod = "ols"\n'
KNOWN_DELAY = f"[motors]\ndelay = 0.0\n{BY_ROWS}"


def truth_of(flight):
    truth = flight.truth
    I, com = truth.com_inertia, truth.center_of_mass
    return {
        "kt": truth.kt,
        "Ixx_com": I[0, 0],
        "Iyy_com": I[1, 1],
        "kd_over_Izz": truth.kd / I[2, 2],
        "Jr_over_Izz": truth.Jr / I[2, 2],
        "com_x": com[0],
        "com_y": com[1],
    }


def number(result, name):
    found = [n for n in (*result.parameters, *result.derived) if n.name == name]
    return found[0]


def recovered(result, flight):
    """Return whether the interval of each number holds the truth."""
    inside = {}
    for name, true in truth_of(flight).items():
        interval = number(result, name).interval
        inside[name] = interval is not None and interval[0] <= true <= interval[1]
    return inside


def fly_and_identify(folder, seeds):
    """Return flights and results of vehicle A as real as it gets."""
    return flown.runs(
        folder,
        "real",
        seeds=seeds,
        extra=BY_ROWS,
        seconds=25.0,
        ground_seconds=2.0,
        physics_rate=200.0,
    )


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    return fly_and_identify(tmp_path_factory.mktemp("first"), SEEDS[:FIRST])


@pytest.fixture(scope="module")
def a_dozen_runs(runs, tmp_path_factory):
    return runs + fly_and_identify(tmp_path_factory.mktemp("rest"), SEEDS[FIRST:])


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_stated(a_dozen_runs):
    inside = [recovered(result, flight) for flight, result in a_dozen_runs]
    average = {name: np.mean([run[name] for run in inside]) for name in inside[0]}
    for name in ("kt", "Ixx_com", "Iyy_com", "kd_over_Izz"):
        assert average[name] >= 0.83, average
    # The rotors' thrust spread stands in for a CoM off the centre, noise of their speed pulls J_r.
    for name in ("com_x", "com_y", "Jr_over_Izz"):
        assert average[name] >= 0.58, average
    assert 0.85 <= np.mean(list(average.values())) <= 1.0


def test_intervals_are_not_idle(runs):
    for name, widest in (("kt", 0.02), ("Ixx_com", 0.05), ("Iyy_com", 0.05), ("kd_over_Izz", 0.15)):
        half = [
            0.5 * np.ptp(number(result, name).interval) / truth_of(flight)[name]
            for flight, result in runs
        ]
        assert np.median(half) < widest


def test_verdicts_of_a_good_flight(runs):
    for _, result in runs:
        assert result.parameter("kt").verdict == "identified"
        assert result.parameter("Ixx").verdict == "identified"
        assert result.parameter("Izz").verdict == "ratio-only"
        assert result.parameter("kd").partner == "Izz"
        assert result.parameter("mass").verdict == "given"


def test_hover_alone_gives_thrust_and_refuses_inertia(tmp_path):
    flight = flown.simulated(
        "A", "disturbed", seed=1, seconds=20.0, ground_seconds=2.0, sticks=STILL
    )
    result = flown.identified(tmp_path, [flight], extra=KNOWN_DELAY)
    kt = result.parameter("kt")
    assert kt.interval[0] < flight.truth.kt < kt.interval[1]
    assert kt.verdict == "identified"
    advice = {"Ixx": "roll briskly", "Iyy": "pitch briskly", "kd": "yaw", "Jr": "yaw"}
    for name, words in advice.items():
        refused = result.parameter(name)
        assert refused.verdict == "not-identified"
        assert refused.value is None
        assert refused.interval is None
        assert refused.advice.startswith(words)
    for name in ("Ixx_com", "Iyy_com", "kd_over_Izz", "Jr_over_Izz"):
        assert result.derived_value(name).value is None


@pytest.mark.parametrize("seed", [2, 3])
def test_hover_with_noisy_rotor_speeds_identifies_only_thrust(tmp_path, seed):
    """Noise of the rotor speeds holds more than their motion does: no correction for it helps."""
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "real")
    truth = replace(truth, Jr=2e-5, disturbance_torque_std=(6e-3, 6e-3, 1.5e-3))
    sensors = replace(sensors, gyro_std=0.02, accel_std=0.4, rotor_speed_std=5.0)
    scenario = Scenario(seconds=20.0, ground_seconds=2.0, sensors=sensors, sticks=STILL)
    flight = simulate_flight(truth, vehicle, scenario, seed=seed)
    result = flown.identified(tmp_path, [flight], extra="[motors]\ndelay = 0.0\n")
    kt = result.parameter("kt")
    assert kt.verdict == "identified"
    assert kt.interval[0] < flight.truth.kt < kt.interval[1]
    for name in ("Ixx", "Iyy", "Izz", "kd", "Jr"):
        assert result.parameter(name).verdict == "not-identified"
        assert result.parameter(name).value is None


def test_one_axis_at_a_time(tmp_path):
    sticks = replace(STILL, roll=Scenario().sticks.roll)
    flight = flown.simulated(
        "A", "disturbed", seed=2, seconds=20.0, ground_seconds=2.0, sticks=sticks
    )
    result = flown.identified(tmp_path, [flight], extra=KNOWN_DELAY)
    Ixx = result.derived_value("Ixx_com")
    assert Ixx.interval[0] < flight.truth.com_inertia[0, 0] < Ixx.interval[1]
    assert result.parameter("Iyy").verdict == "not-identified"
    assert "pitch" in result.parameter("Iyy").advice


def test_an_unknown_mass_gives_the_same_numbers_per_kilogram(tmp_path):
    flight = flown.simulated("B", "noisy", seed=3, seconds=15.0, ground_seconds=2.0)
    known = flown.identified(tmp_path, [flight], extra=KNOWN_DELAY)
    unknown = flown.identified(tmp_path, [flight], mass="unknown", extra=KNOWN_DELAY)
    for name in ("kt", "msx", "Ixx", "Iyy"):
        per_kg, whole = unknown.parameter(name), known.parameter(name)
        assert per_kg.value == pytest.approx(whole.value / flight.truth.mass, rel=1e-6)
        assert per_kg.std == pytest.approx(whole.std / flight.truth.mass, rel=1e-3)
        assert per_kg.unit == f"{whole.unit} per kg"
    for name in ("kd_over_Izz", "Ixx_over_kt", "com_x", "hover_speed"):
        same = known.derived_value(name)
        assert unknown.derived_value(name).value == pytest.approx(same.value, rel=1e-6)
        assert unknown.derived_value(name).unit == same.unit
    assert unknown.parameter("mass").value is None
    assert any("per kilogram" in words for words in unknown.warnings)


def test_two_flights_are_better_than_one_in_any_order(tmp_path):
    flights = [
        flown.simulated("A", "noisy", seed=seed, seconds=15.0, ground_seconds=2.0)
        for seed in (5, 6)
    ]
    one = flown.identified(tmp_path, flights[:1], extra=KNOWN_DELAY)
    both = flown.identified(tmp_path, flights, extra=KNOWN_DELAY)
    back = flown.identified(tmp_path, flights[::-1], extra=KNOWN_DELAY)
    assert both.parameter("kt").std < 0.9 * one.parameter("kt").std
    assert len(both.flights) == 2
    for name in ("kt", "Ixx", "Iyy", "msx"):
        assert both.parameter(name).value == pytest.approx(back.parameter(name).value, rel=1e-6)
        assert both.parameter(name).std == pytest.approx(back.parameter(name).std, rel=1e-3)


@pytest.mark.parametrize("name", ["B", "quad-x", "hexa-x", "octo", "x8", "hexa-tilted"])
def test_every_layout_is_recovered(tmp_path, name):
    flight = flown.simulated(name, "noisy", seed=7, seconds=25.0, ground_seconds=2.0)
    result = flown.identified(tmp_path, [flight], extra=KNOWN_DELAY)
    for number_name, true in truth_of(flight).items():
        if number_name == "Jr_over_Izz":
            continue  # the rotors of this variant have no inertia
        if (name, number_name) == ("hexa-tilted", "kd_over_Izz"):
            # Its tilted thrust makes nearly all of the yaw torque: one row cannot tell.
            assert result.parameter("kd").verdict == "not-identified"
            continue
        found = number(result, number_name)
        half = found.interval[1] - found.value
        assert abs(found.value - true) < 1.5 * half, number_name
        assert half < 0.1 * max(abs(true), 0.2), number_name
