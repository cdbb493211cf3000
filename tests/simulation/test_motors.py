from dataclasses import replace

import numpy as np
import pytest

from rotorfit.errors import ExperimentError
from rotorfit.model.vehicle import Rotor, Vehicle
from rotorfit.simulation.experiments import layout_vehicle, paper_vehicle
from rotorfit.simulation.rotors import (
    allocation,
    decay_over,
    lagged,
    rotors_of,
    speed_slopes,
    wrenches,
)


def test_lag_in_many_steps_is_the_analytic_step_response():
    up, down, dt, n = 0.04, 0.07, 0.005, 60
    speed, command = np.array([300.0, 700.0]), np.array([900.0, 500.0])
    truth = replace(paper_vehicle("A")[0], motor_lag=up, motor_lag_down=down)
    decay = decay_over(truth, np.array([dt]))
    stepped = [speed]
    for _ in range(n):
        stepped.append(lagged(stepped[-1], command, decay)[-1])
    t = dt * np.arange(n + 1)[:, None]
    lags = np.array([up, down])
    np.testing.assert_allclose(stepped, command + (speed - command) * np.exp(-t / lags), rtol=1e-12)


def test_slope_is_the_derivative_of_the_lagged_speed():
    truth, vehicle = paper_vehicle("A")
    truth = replace(truth, motor_lag_down=0.07)
    rotors = rotors_of(truth, vehicle)
    speed, command = np.full(4, 800.0), np.array([900.0, 700.0, 850.0, 1000.0])
    h = 1e-6
    around = lagged(speed, command, decay_over(truth, np.array([0.01, 0.01 + h])))
    slopes = speed_slopes(rotors, around, command)
    np.testing.assert_allclose(slopes.mean(axis=0), (around[1] - around[0]) / h, rtol=1e-6)


def test_a_motor_without_lag_is_at_its_command_at_once():
    truth, vehicle = paper_vehicle("A")
    truth = replace(truth, motor_lag=0.0)
    rotors = rotors_of(truth, vehicle)
    speeds = lagged(np.full(4, 800.0), np.full(4, 900.0), decay_over(truth, np.array([0.0, 0.1])))
    np.testing.assert_array_equal(speeds, 900.0)
    np.testing.assert_array_equal(speed_slopes(rotors, speeds, np.full(4, 900.0)), 0.0)


def test_allocation_of_the_paper_is_its_equation_9():
    truth, vehicle = paper_vehicle("A")
    O1, O2, O3, O4 = squares = np.array([7e5, 8e5, 9e5, 1e6])
    kt, kd, d = truth.kt, truth.kd, 0.2
    wrench = allocation(vehicle, kt=truth.rotor_kt(4), kd=kd) @ squares
    np.testing.assert_allclose(
        wrench,
        [
            *(0, 0, kt * squares.sum()),
            *(kt * d * (O2 - O1), kt * d * (O4 - O3), kd * (O3 + O4 - O1 - O2)),
        ],
        atol=1e-15,
    )


def test_tilted_rotor_pushes_and_turns_along_its_axis():
    rotor = Rotor(position=(0.3, 0.0, 0.1), spin="cw", axis=(0.6, 0.0, 0.8))
    wrench = allocation(Vehicle(rotors=(rotor,)), kt=np.array([2.0]), kd=0.5)[:, 0]
    # (0.3, 0, 0.1) x (1.2, 0, 1.6) = (0, 0.12 - 0.48, 0); clockwise: the torque is along +axis
    np.testing.assert_allclose(wrench, [1.2, 0.0, 1.6, 0.3, -0.36, 0.4], atol=1e-15)


@pytest.mark.parametrize("layout", ["quad-x", "hexa-x", "octo", "x8", "hexa-tilted"])
def test_layouts_hover_without_torque_or_spin(layout):
    truth, vehicle = layout_vehicle(layout)
    rotors = rotors_of(replace(truth, Jr=2e-5), vehicle)
    N = len(vehicle.rotors)
    (wrench,) = wrenches(rotors, np.full((1, N), 800.0), np.zeros((1, N)))
    np.testing.assert_allclose(wrench[:2], 0, atol=1e-13)
    np.testing.assert_allclose(wrench[3:9], 0, atol=1e-13)
    assert wrench[2] > 0


def test_coaxial_rotors_turn_against_each_other():
    _, vehicle = layout_vehicle("x8")
    np.testing.assert_array_equal(vehicle.positions[:4, :2], vehicle.positions[4:, :2])
    np.testing.assert_array_equal(vehicle.spins[:4], -vehicle.spins[4:])


def test_rotor_that_speeds_up_turns_the_body_against_its_spin():
    truth, vehicle = paper_vehicle("A")
    rotors = rotors_of(replace(truth, Jr=2e-5, kd=0.0), vehicle)
    speeds, slopes = np.array([[500.0, 500.0, 100.0, 100.0]]), np.array([[10.0, 0.0, 0.0, 5.0]])
    (wrench,) = wrenches(rotors, speeds, slopes)
    np.testing.assert_allclose(wrench[5], -2e-5 * (10 - 5), rtol=1e-12)
    np.testing.assert_allclose(wrench[6:9], [0, 0, 2e-5 * 800], rtol=1e-12)


def test_drag_torque_linear_in_speed_is_against_the_spin():
    truth, vehicle = paper_vehicle("A")
    rotors = rotors_of(replace(truth, kd_linear=1e-5, kd=0.0), vehicle)
    (wrench,) = wrenches(rotors, np.array([[500.0, 500.0, 100.0, 100.0]]), np.zeros((1, 4)))
    np.testing.assert_allclose(wrench[5], -1e-5 * (500 + 500 - 100 - 100), rtol=1e-12)


def test_spread_scales_each_rotor():
    truth, vehicle = paper_vehicle("A")
    spread = replace(truth, kt_spread=(1.02, 0.98, 1.01, 0.99))
    np.testing.assert_allclose(
        rotors_of(spread, vehicle).wrench_per_square[2], truth.kt * np.array(spread.kt_spread)
    )
    with pytest.raises(ExperimentError, match="2 factors for 4 rotors"):
        replace(truth, kt_spread=(1.0, 1.0)).rotor_kt(4)
