"""Optional terms of the model: drag and twist that are there are found, others stay out."""

from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.errors import ExperimentError
from rotorfit.identification.choice import LEAST_GAIN
from rotorfit.identification.validate import validate_file
from rotorfit.simulation import Scenario, simulate_flight, variant, write_flight_table
from rotorfit.simulation.tables import IMU_AND_SPEED

LOGGED = (*IMU_AND_SPEED, "velocity")
SHORT = {"seconds": 30.0, "ground_seconds": 2.0, "physics_rate": 200.0}
DELAY = "[motors]\ndelay = 0.0\n"


def flight_of(drag, *, kind="noisy", seed=1, rotor_drag=0.0):
    (truth, vehicle), sensors = variant(flown.simulated_vehicle("A"), kind)
    scenario = Scenario(sensors=sensors, **SHORT)
    return simulate_flight(
        replace(truth, drag=drag, rotor_drag=rotor_drag), vehicle, scenario, seed=seed
    )


def identified(folder, flight, *, terms=None, channels=LOGGED):
    """Identify a flight from a table in `folder`, which may be there already."""
    table = folder / "flight.csv"
    table.unlink(missing_ok=True)
    write_flight_table(flight, table, channels=channels)
    asked = "" if terms is None else f"[identification]\nterms = {list(terms)!r}\n"
    path = flown.experiment_file(
        folder / "experiment.toml",
        flight.vehicle,
        [table],
        mass=flight.truth.mass,
        extra=DELAY + asked,
    )
    return flown.quietly_identified(path)


@pytest.fixture(scope="module")
def draggy():
    """Return a flight with strong drag, that of a big frame sideways and less along z."""
    return flight_of((0.6, 0.5, 0.3))


def inside(parameter, true):
    low, high = parameter.interval
    return low < true < high


def test_drag_enters_by_itself_where_the_velocity_is_known(draggy, tmp_path):
    result = identified(tmp_path, draggy)
    used = result.settings["used"]
    assert used["terms"][-1] == "drag"
    assert used["terms_gain"]["drag"] > used["terms_least_gain"] == LEAST_GAIN
    (words,) = [w for w in result.warnings if "air drag of the frame" in w]
    assert "the log-likelihood rises by" in words
    assert "(drag)" in words
    for axis, true in zip("xyz", draggy.truth.drag, strict=True):
        found = result.parameter(f"drag_{axis}", "A")
        assert inside(found, true)
        assert found.unit == "N s/m"
    assert result.parameter("drag_x", "A").value == pytest.approx(0.6, rel=0.1)
    assert inside(result.parameter("kt"), draggy.truth.kt)


def test_drag_is_in_the_predicted_wrench_of_flights_kept_apart(draggy, tmp_path):
    other = tmp_path / "other.csv"
    write_flight_table(flight_of(draggy.truth.drag, seed=2), other, channels=LOGGED)
    with_it = identified(tmp_path, draggy)
    without = identified(tmp_path, draggy, terms=["rotor_inertia", "accel_bias", "twist"])
    after, before = (validate_file(result, other) for result in (with_it, without))
    leaves = [
        np.linalg.norm((c.body_wrench - c.rotor_wrench)[:, :2]) for c in (after, before)
    ]  # sideways forces, where nothing else acts
    assert leaves[0] < 0.5 * leaves[1]


def test_terms_of_the_file_are_the_model_and_others_are_absent(draggy, tmp_path):
    result = identified(tmp_path, draggy, terms=["torque_offset"])
    names = {p.name for p in result.parameters}
    absent = {"Jr", "kt_1", "accel_bias_x", "twist", "rotor_drag", "drag_x"}
    assert not names & absent
    assert {"kt", "kd", "Izz", "torque_offset_z"} <= names
    assert result.settings["used"]["terms"] == ["torque_offset"]
    assert result.settings["used"]["terms_chosen"] == "by the experiment file"
    assert identified(tmp_path, draggy, terms=[]).settings["used"]["terms"] == []


def test_rotors_that_a_turn_drags_do_not_bend_the_drag_torque(tmp_path):
    c = 0.3 * 1.285 / 3730.0  # 0.3 of the mass per second, four rotors in hover
    flight = flight_of((0.0, 0.0, 0.0), rotor_drag=c, seed=3)
    result, true = identified(tmp_path, flight), flight.truth.parameters()
    for name in ("kd", "rotor_drag"):
        assert inside(result.parameter(name), true[name]), name
        assert result.parameter(name).verdict == "identified"
    assert result.parameter("rotor_drag").unit == "N s^2/(m rad)"
    assert result.parameter("rotor_drag").value == pytest.approx(c, rel=0.1)
    terms = ["rotor_inertia", "rotor_spread", "accel_bias", "twist"]
    without = identified(tmp_path, flight, terms=terms)
    ratio = true["kd"] / true["Izz_com"]
    found, bent = (r.derived_value("kd_over_Izz", "A") for r in (result, without))
    assert inside(found, ratio)
    assert found.value == pytest.approx(ratio, rel=0.015)
    assert not inside(bent, ratio)
    assert 0.03 < 1.0 - bent.value / ratio < 0.06
    assert without.parameter("kd").value < 0.97 * true["kd"]


def test_drag_without_velocity_is_refused_with_what_to_log(draggy, tmp_path):
    with pytest.raises(ExperimentError, match=r"flight.csv has no velocity .* vel_x, vel_y, vel_z"):
        identified(tmp_path, draggy, terms=["drag"], channels=IMU_AND_SPEED)


@pytest.mark.parametrize("kind", ["clean", "disturbed"])
def test_terms_that_are_not_there_stay_out(tmp_path, kind):
    result = identified(tmp_path, flight_of((0.0, 0.0, 0.0), kind=kind, seed=4))
    assert result.settings["used"]["terms"] == list(
        ("rotor_inertia", "rotor_spread", "accel_bias", "twist", "rotor_drag")
    )
    assert set(result.settings["used"]["terms_gain"]) == {"drag", "torque_offset"}
    assert not any("the flights ask for" in words for words in result.warnings)
