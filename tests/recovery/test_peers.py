"""The comparison with others compares what it says, and says which of them is absent."""

from dataclasses import replace

import mujoco_flight
import numpy as np
import pytest
from benchmarks import peers

from rotorfit.simulation import SimulatedVehicle, paper_vehicle


@pytest.fixture(scope="module")
def still_air(tmp_path_factory):
    """Return the folder of a short flight in still air, and what flew."""
    folder, flown = tmp_path_factory.mktemp("still"), peers.flights()["still air"]
    peers.write_flight(flown, folder, seed=1, seconds=12.0)
    return folder, flown


def test_the_motors_of_the_peer_are_those_that_flew():
    truth, vehicle = paper_vehicle("A")
    flight = mujoco_flight.fly(truth, vehicle, seed=1, seconds=6.0)
    squares = peers.squared_speeds(flight.command, truth.motor_lag)
    speed = mujoco_flight.FULL_SPEED * np.sqrt(squares)
    # From the middle of a row to the next one, the speeds that flew go on as the commands say.
    half = np.exp(-0.5 / (mujoco_flight.SAMPLE_RATE * truth.motor_lag))
    asked = mujoco_flight.FULL_SPEED * flight.command
    np.testing.assert_allclose(
        (asked + (speed - asked) * half)[:-1], flight.rotor_speed[1:], rtol=1e-9, atol=1e-6
    )


def test_windows_hold_the_flight_alone_and_start_from_its_state(still_air):
    folder, _ = still_air
    exact, measured = (peers.windows(folder, exact=exact) for exact in (True, False))
    assert len(exact.starts) >= 8
    assert exact.state[exact.starts, 2].min() > mujoco_flight.FEET + 0.3
    away = measured.state[exact.starts] - exact.state[exact.starts]
    assert (away[:, :10] == 0.0).all()
    assert 1e-3 < away[:, 10:].std() < 1e-2  # less than the noise of a gyro sample


def test_rotorfit_s_numbers_are_compared_about_the_body_origin(still_air):
    folder, flown = still_air
    said = peers.by_rotorfit(folder, flown, peers.SETTINGS["paper"])
    true, unit = peers.truths(flown.truth), peers.units(flown.truth)
    assert {"kt", "Ixx", "com_x"} <= set(said) <= set(true)
    assert abs(said["com_x"][0] - true["com_x"]) < 1e-3
    assert abs(said["Ixx"][0] - true["Ixx"]) < 10 * unit["Ixx"]


def test_the_table_marks_what_does_not_hold(still_air):
    _, (truth, vehicle) = still_air
    drag = SimulatedVehicle(replace(truth, drag=(0.1, 0.1, 0.0)), vehicle).truth
    assert set(peers.truths(drag)) - set(peers.truths(truth)) == {"drag_x", "drag_y"}
    run = {"told": {"kt": (1.02 * truth.kt, 0.01 * truth.kt)}, "seconds": 3.0, "memory": 70.0}
    lines = peers.table(truth, {"peer": run})
    assert next(line for line in lines if line.startswith("kt ")).endswith("+2.00 / 1.00!")
    assert next(line for line in lines if line.startswith("kd ")).endswith(" -")
    assert [line.split()[-1] for line in lines[-2:]] == ["3.0", "70"]
    assert lines[-3].endswith("0 of 1 ")


def test_an_absent_peer_is_said_to_be_left_out(monkeypatch, capsys):
    monkeypatch.setattr(peers, "sysid_is_there", lambda: False)
    assert peers.methods("") == list(peers.SETTINGS)
    assert 'pip install "mujoco[sysid]"' in capsys.readouterr().out


@pytest.mark.skipif(not peers.sysid_is_there(), reason="needs mujoco[sysid]")
def test_the_peer_given_the_truth_leaves_the_noise_alone(still_air):
    folder, flown = still_air
    truth, vehicle = flown
    spec = peers.sysid_spec(truth, vehicle)
    start = peers.sysid_parameters(spec, truth, vehicle, with_drag=False)
    true = peers.truths(truth)
    assert peers.sysid_numbers(spec, start) == pytest.approx(true | {"motor_lag_total": 0.04})
    residual = peers.sysid_residual(peers.windows(folder, exact=True), spec)
    left, _, _ = residual(start.as_vector(), start)
    assert np.mean(np.square(left)) == pytest.approx(1.0, abs=0.1)
