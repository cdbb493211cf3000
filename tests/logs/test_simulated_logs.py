"""Logs of simulators are told by their parameters, and with them the law of their motors."""

import numpy as np
import pytest
from dataflash_encoder import BAT, KINDS, QUAD_X, imu, log, message, parameters, rcou
from ulog_encoder import Parts, actuator_motors, encode, sensor_combined

from rotorfit.logs import read_log
from rotorfit.logs.flight_log import LEAVES_OUT, LoggedMotors
from rotorfit.logs.motor_law import MotorLaw, PolynomialCurve, SquareRootCurve, VoltageFactor

TIME = 100.0 + 0.004 * np.arange(200)
STILL = sensor_combined(TIME, np.zeros((200, 3)), np.tile([0.0, 0.0, 9.8], (200, 1)))
HALF = actuator_motors(TIME, np.full((200, 4), 0.5))
SIH = {"SIH_T_MAX": 5.0, "SIH_VEHICLE_TYPE": 0, "CA_ROTOR_COUNT": 4}
GAZEBO = {
    "CA_ROTOR_COUNT": 4,
    **{f"SIM_GZ_EC_FUNC{i}": 100 + i for i in range(1, 5)},
    **{f"SIM_GZ_EC_MIN{i}": 150 for i in range(1, 5)},
    **{f"SIM_GZ_EC_MAX{i}": 1000 for i in range(1, 5)},
}
ON_COMPUTER = {"ver_hw": "PX4_SITL"}


def px4(tmp_path, values, **parts):
    path = tmp_path / "log.ulg"
    path.write_bytes(encode([STILL, HALF], Parts(parameters=values, **parts), start=99.0))
    return read_log(path)


@pytest.mark.parametrize(
    ("values", "info", "simulator"),
    [
        (SIH, ON_COMPUTER, "PX4 SIH"),
        ({**SIH, "SYS_HITL": 2}, {"ver_hw": "PX4_FMU_V6C"}, "PX4 SIH"),
        (SIH, {"ver_hw": "PX4_FMU_V6C"}, ""),  # the parameters alone, which any build may have
        (GAZEBO, ON_COMPUTER, "Gazebo under PX4"),
        ({"CA_ROTOR_COUNT": 4}, ON_COMPUTER, "a simulator under PX4"),
        ({"SYS_HITL": 1}, {"ver_hw": "PX4_FMU_V6C"}, "a simulator under PX4"),
        ({"SYS_HITL": 0}, {"ver_hw": "PX4_FMU_V6C"}, ""),
    ],
)
def test_px4s_simulators_are_known_by_board_and_parameters(tmp_path, values, info, simulator):
    found = px4(tmp_path, values, info=info)
    assert found.simulator == simulator
    said = [note for note in found.notes if "a simulator: " in note]
    assert [LEAVES_OUT[simulator] in note for note in said] == ([True] if simulator else [])


def test_the_thrust_of_sih_goes_with_the_signal_and_lags(tmp_path, assert_text):
    found = px4(tmp_path, {**SIH, "THR_MDL_FAC": 0.3}, info=ON_COMPUTER)
    law = MotorLaw(curve=SquareRootCurve(1.0, 0.0), exact=True)
    words = found.motors.words
    assert found.motors == LoggedMotors(law=law, words=words, lag_on="thrust")
    assert_text(words)
    # Thrust .5 is sent as the u of .3 u^2 + .7 u, to which SIH's thrust is in proportion.
    u = found.channels["command"].values[0, 0]
    assert 0.3 * u * u + 0.7 * u == pytest.approx(0.5)


def test_gazebos_output_is_a_speed(tmp_path):
    found = px4(tmp_path, GAZEBO, info=ON_COMPUTER)
    assert found.motors is not None and found.motors.law.exact
    assert found.motors.law == MotorLaw(curve=PolynomialCurve((150.0, 850.0)), exact=True)
    assert found.motors.lag_on == "speed"


@pytest.mark.parametrize(("factor", "stated"), [(0.0, False), (0.4, True)])
def test_of_a_vehicle_only_a_curve_that_was_set_is_a_law(tmp_path, factor, stated):
    found = px4(tmp_path, {"THR_MDL_FAC": factor}, info={"ver_hw": "PX4_FMU_V6C"})
    assert (found.motors is not None) == stated
    if found.motors is not None:
        curve = found.motors.law.curve
        assert isinstance(curve, SquareRootCurve)
        assert (curve.full_speed, curve.thr_mdl_fac) == pytest.approx((1.0, factor))


def test_sihs_vehicle_is_the_one_that_flew(tmp_path):
    changes = [(100.1, "SIH_MASS", 1.4)]
    found = px4(tmp_path, {**SIH, "SIH_MASS": 1.0}, info=ON_COMPUTER, changes=changes)
    assert (found.metadata["Simulator"], found.metadata["SIH_MASS"]) == ("PX4 SIH", "1.4")


def arducopter(tmp_path, *, rate=400, battery=True, **values):
    times = [k / rate for k in range(rate)]
    rest = ((0.0, 0.0, 0.0), (0.0, 0.0, -9.81))
    messages = [m for t in times for m in (imu(t, *rest), rcou(t, [1500.0] * 4))]
    if battery:
        messages += [message(BAT, round(t * 1e6), 0, 16.0, 16.0) for t in times]
    path = tmp_path / "made.bin"
    path.write_bytes(log(KINDS, [*parameters({**QUAD_X, **values}), *messages]))
    return read_log(path)


VOLTS = {"MOT_BAT_VOLT_MAX": 12.8, "MOT_BAT_VOLT_MIN": 9.6}


@pytest.mark.parametrize(
    ("values", "battery", "voltage"),
    [
        (VOLTS, True, VoltageFactor(12.8, 1.0)),
        (VOLTS, False, None),
        ({"MOT_BAT_VOLT_MAX": 0.0, "MOT_BAT_VOLT_MIN": 0.0}, True, None),
    ],
)
def test_arducopters_law_is_that_of_its_parameters(tmp_path, values, battery, voltage):
    found = arducopter(tmp_path, battery=battery, **values)
    assert found.motors is not None
    law = found.motors.law
    assert law.curve == SquareRootCurve(1.0, 0.65, 0.15, 0.95)
    assert law.voltage == voltage
    assert ("MOT_BAT_VOLT_MAX" in found.motors.words) == (voltage is not None)


def test_arducopters_simulator_is_known_by_its_own_parameters(tmp_path):
    assert arducopter(tmp_path).simulator == ""
    found = arducopter(tmp_path, SIM_RATE_HZ=1200.0, SIM_FRM_MASS=3.0)
    assert found.simulator == found.metadata["Simulator"] == "ArduPilot SITL"
    assert found.metadata["SIM_FRM_MASS"] == "3"
    assert any("without gyroscopic terms" in note for note in found.notes)


def test_the_low_pass_of_the_gyro_is_known(tmp_path):
    assert arducopter(tmp_path).gyro_lowpass is None
    assert arducopter(tmp_path, INS_GYRO_FILTER=20.0).gyro_lowpass == 20.0


def test_a_log_too_slow_for_inertia_is_given_what_to_set(tmp_path, assert_wording):
    assert not any("whatever is flown" in w for w in arducopter(tmp_path).warnings)
    [said] = [w for w in arducopter(tmp_path, rate=25).warnings if "whatever is flown" in w]
    assert "at 25 Hz" in said
    assert_wording(said)
    assert "set LOG_BITMASK = " in said
