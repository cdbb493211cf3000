"""CrazyPAD: weights near M3 (rear left) and M4 (front left) move the centre of mass there."""

import numpy as np
import pytest

from rotorfit.errors import LogError
from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.flight.prepare import prepare
from rotorfit.logs import read_log
from rotorfit.model.vehicle import Vehicle, layout_rotors

CRAZYFLIE = Vehicle(rotors=layout_rotors("quad-x", arm=0.046, order="crazyflie"))
LOGS = {
    ("E8", "normal"): "controller_data__normal_flight__E8_log00",
    ("E8", "near M4"): "controller_data__add_weight_W1_near_M4__E8_log00",
    ("E9", "normal"): "controller_data__normal_flight__E9_log00",
    ("E9", "near M3"): "controller_data__add_weight_W1_near_M3__E9_log01",
}


def thrust_center(motors, vehicle):
    """Return the mean centre of thrust x, y [m] in flight: in hover it lies over the CoM.

    Rotors are taken as equal, so that differences between flights of one vehicle are sharper than
    the place itself. Samples under half of the usual thrust count as ground.
    """
    thrust = motors * motors
    total = thrust.sum(axis=1)
    mean = thrust[total > 0.5 * np.percentile(total, 75)].mean(axis=0)
    return mean @ vehicle.positions[:, :2] / mean.sum()


def center_of(folder, specimen, condition):
    log = read_log(folder / "crazypad" / LOGS[specimen, condition])
    return 1e3 * thrust_center(log.channels["command"].values, CRAZYFLIE)


@pytest.mark.flights
@pytest.mark.parametrize(
    ("specimen", "condition", "signs"), [("E8", "near M4", (1, 1)), ("E9", "near M3", (-1, 1))]
)
def test_the_centre_of_mass_moves_to_the_weight(flight_data_dir, specimen, condition, signs):
    shift = center_of(flight_data_dir, specimen, condition) - center_of(
        flight_data_dir, specimen, "normal"
    )
    assert (shift * signs > 0.3).all(), shift  # [mm]


@pytest.mark.flights
def test_without_an_accelerometer_nothing_more_is_said(flight_data_dir):
    log = read_log(flight_data_dir / "crazypad" / LOGS["E8", "normal"])
    with pytest.raises(LogError, match="no specific force"):
        prepare(log, rotor_count=4, arm=0.046, motors=MotorModel(speed="commanded"))


def test_even_thrust_is_centred_and_uneven_thrust_is_not():
    even = np.full((100, 4), 0.5)
    np.testing.assert_allclose(thrust_center(even, CRAZYFLIE), [0.0, 0.0], atol=1e-12)
    front_right = even * [1.1, 1.0, 1.0, 1.0]
    x, y = thrust_center(front_right, CRAZYFLIE)
    assert x > 1e-3
    assert y < -1e-3
    ground = np.vstack([np.full((100, 4), [0.2, 0.0, 0.0, 0.0]), even])
    np.testing.assert_allclose(thrust_center(ground, CRAZYFLIE), [0.0, 0.0], atol=1e-12)
