"""Tables with columns that are named like a sensor or a motor, and are neither."""

from __future__ import annotations

import numpy as np
import pytest

from rotorfit.errors import LogError
from rotorfit.logs.proposal import propose_columns
from rotorfit.logs.table import read_table

G = 9.80665
ROWS = 400
TIME = 0.005 * np.arange(ROWS)
RNG = np.random.default_rng(5)
GYRO = RNG.normal(0.0, 0.6, (ROWS, 3))
ACCEL = np.array([0.0, 0.0, G]) + RNG.normal(0.0, 0.3, (ROWS, 3))
SHARE = 0.4 + 0.1 * np.sin(3.0 * TIME[:, None] + np.arange(4))
ASKED = np.roll(GYRO, 8, axis=0)
SPEED = 900.0 * np.sqrt(SHARE)


def block(names, values):
    """Name the columns of a block of values."""
    return dict(zip(names.split(), np.asarray(values).T, strict=True))


SENSORS = block("t_s gyr_x_rads gyr_y_rads gyr_z_rads", np.column_stack([TIME, GYRO])) | block(
    "acc_x acc_y acc_z", ACCEL
)
MOTORS = block("omega_1 omega_2 omega_3 omega_4", SPEED)


def proposed(tmp_path, columns, **stated):
    """Write columns as a table, propose which is which, and read it so."""
    path = tmp_path / "table.csv"
    rows = np.column_stack(list(columns.values())).tolist()
    path.write_text("\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]))
    proposal = propose_columns(path, **stated)
    return proposal, read_table(path, columns=proposal.columns, axes=proposal.axes).channels


def assert_flight(channels):
    np.testing.assert_allclose(channels["gyro"].values, GYRO, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(channels["accel"].values, ACCEL, rtol=1e-6, atol=1e-9)


def test_inav_axis_rates_are_the_set_point_not_the_gyro(tmp_path):
    names = [f"{name}[{i}]" for name in ("axisRate", "gyroADC", "accSmooth") for i in range(3)]
    columns = {
        "loopIteration": np.arange(ROWS) * 2.0,
        "time (us)": 4e8 + 1e6 * TIME,
        **block(" ".join(names), np.hstack([*np.rad2deg([ASKED, GYRO]), 512 / G * ACCEL])),
        **block("motor[0] motor[1] motor[2] motor[3]", 1000 + 1000 * SHARE),
        **block("navPos[0] navPos[1] navPos[2]", 100.0 * ASKED),
    }
    proposal, channels = proposed(tmp_path, columns)
    assert_flight(channels)
    np.testing.assert_allclose(channels["reference"].values, ASKED, rtol=1e-6, atol=1e-9)
    assert proposal.questions == ()
    assert "position" not in channels


@pytest.mark.parametrize(
    "names",
    [
        "controller.rollRate controller.pitchRate controller.yawRate",
        "cmd_rate_x cmd_rate_y cmd_rate_z",
        "commanded_omega_x commanded_omega_y commanded_omega_z",
    ],
)
def test_rates_that_a_controller_asks_for_are_no_gyro(tmp_path, names):
    alone = {"t_s": TIME, **block(names, ASKED), **block("acc_x acc_y acc_z", ACCEL), **MOTORS}
    proposal, channels = proposed(
        tmp_path, {"t_s": TIME, **block(names, ASKED), **SENSORS, **MOTORS}, units={"motors": "Hz"}
    )
    assert_flight(channels)
    assert not set(names.split()) & {proposal.columns[f"gyro_{a}"].name for a in "xyz"}
    with pytest.raises(LogError, match="gyro"):
        proposed(tmp_path, alone)


@pytest.mark.parametrize(
    "names",
    [
        "stateEstimate.ax stateEstimate.ay stateEstimate.az",
        "ang_acc_b_x ang_acc_b_y ang_acc_b_z",
        "lin_acc_x lin_acc_y lin_acc_z",
        "a1 a2 a3",
    ],
)
def test_accelerations_without_gravity_are_passed_over(tmp_path, names):
    columns = {"t_s": TIME, **block(names, 2.0 * ASKED), **SENSORS, **MOTORS}
    _, channels = proposed(tmp_path, columns)
    assert_flight(channels)


def test_a_world_acceleration_of_a_crazyflie_is_no_sensor(tmp_path):
    """The firmware adds gravity to the z of its compressed state, in world axes."""
    names = "stateEstimateZ.ax stateEstimateZ.ay stateEstimateZ.az"
    columns = {**SENSORS, **block(names, 1e3 * ACCEL), **MOTORS}
    with pytest.raises(LogError, match="no column for accelerometer"):
        proposed(tmp_path, {k: v for k, v in columns.items() if not k.startswith("acc_")})
    proposal, channels = proposed(tmp_path, columns)
    assert_flight(channels)
    assert proposal.columns["accel_x"].name == "acc_x"


def test_compressed_rates_of_a_crazyflie_turn_about_y_reversed(tmp_path):
    names = "stateEstimateZ.rateRoll stateEstimateZ.ratePitch stateEstimateZ.rateYaw"
    columns = {
        "Timestamp": 1e3 * TIME,
        **block(names, 1e3 * GYRO * [1.0, -1.0, 1.0]),
        **block("acc.x acc.y acc.z", ACCEL / G),
        **block("motor.m1 motor.m2 motor.m3 motor.m4", 65535 * SHARE),
    }
    proposal, channels = proposed(tmp_path, columns)
    assert_flight(channels)
    assert proposal.questions == ()


@pytest.mark.parametrize(
    ("gyro", "turns", "accel", "gravity"),
    [
        ("gyr_x_mdps gyr_y_mdps gyr_z_mdps", 1e3 * 180 / np.pi, "ax_mg ay_mg az_mg", 1e3 / G),
        ("gx_mrads gy_mrads gz_mrads", 1e3, "acc_x_cms2 acc_y_cms2 acc_z_cms2", 100.0),
        ("wx_mdeg_s wy_mdeg_s wz_mdeg_s", 1e3 * 180 / np.pi, "ax_mm_s2 ay_mm_s2 az_mm_s2", 1e3),
        ("gx_rads gy_rads gz_rads", 1.0, "acc_x acc_y acc_z", 1e3),
    ],
)
def test_thousandths_and_hundredths_are_known_by_name(tmp_path, gyro, turns, accel, gravity):
    columns = {
        "t_s": TIME,
        **block(gyro, turns * GYRO),
        **block(accel, gravity * ACCEL),
        **block("rpm1 rpm2 rpm3 rpm4", SPEED),
    }
    proposal, channels = proposed(tmp_path, columns)
    assert_flight(channels)
    assert proposal.questions == ()
    assert proposal.doubts == ()


def test_thrust_and_torques_are_no_motors(tmp_path):
    """U1 to U4 in most textbooks are the thrust and the torques about x, y and z."""
    wrench = np.column_stack([12.0 + ASKED[:, 0], 0.02 * ASKED])
    columns = {**SENSORS, **block("U1 U2 U3 U4", wrench)}
    with pytest.raises(LogError, match="U2 and U3 change their sign"):
        proposed(tmp_path, columns)
    _, channels = proposed(tmp_path, columns | MOTORS, units={"motors": "rad/s"})
    np.testing.assert_allclose(channels["rotor_speed"].values, SPEED, rtol=1e-9)


def test_speeds_with_the_sign_of_their_spin_are_motors(tmp_path):
    rest = np.arange(ROWS) < 80
    speeds = np.where(rest[:, None], RNG.normal(0.0, 2.0, (ROWS, 4)), SPEED)
    columns = {**SENSORS, **block("w1 w2 w3 w4", speeds * [1, -1, 1, -1])}
    _, channels = proposed(tmp_path, columns, units={"motors": "rad/s"})
    np.testing.assert_allclose(channels["rotor_speed"].values, speeds, rtol=1e-9)


@pytest.mark.parametrize("name", ["omega_cmd", "rotor_command"])
def test_measured_speeds_come_before_those_asked_for(tmp_path, name):
    names = " ".join(f"{name}_{i}" for i in range(1, 5))
    columns = {**SENSORS, **block(names, np.roll(SPEED, -5, axis=0)), **MOTORS}
    proposal, channels = proposed(tmp_path, columns, units={"motors": "rad/s"})
    np.testing.assert_allclose(channels["rotor_speed"].values, SPEED, rtol=1e-9)
    assert_flight(channels)
    assert proposal.columns["rotor_1"].name == "omega_1"


@pytest.mark.parametrize("full", [255.0, 1023.0, 4095.0, 65535.0])
def test_counts_are_of_the_least_bits_that_hold_them(tmp_path, full):
    """ESP32 and Arduino set motors by 8 to 12 bits; of 16 they would be a thousandth of full."""
    columns = {**SENSORS, **block("pwm_1 pwm_2 pwm_3 pwm_4", np.round(full * (SHARE + 0.1)))}
    proposal, channels = proposed(tmp_path, columns, units={"motors": "counts"})
    np.testing.assert_allclose(channels["command"].values, SHARE + 0.1, atol=0.5 / full)
    assert proposal.columns["command_1"].range == (0.0, full)


def test_a_position_asked_for_is_not_the_motion(tmp_path):
    attitude = np.column_stack([np.ones(ROWS), np.zeros((ROWS, 3))])
    columns = {
        "t_s": TIME,
        **block("goal_pos_x goal_pos_y goal_pos_z", ASKED),
        **block("goal_q_w goal_q_x goal_q_y goal_q_z", attitude),
        **block("pos_x pos_y pos_z", GYRO),
        **block("q_w q_x q_y q_z", attitude),
        **MOTORS,
    }
    proposal, _ = proposed(tmp_path, columns, units={"motors": "rad/s"})
    assert proposal.columns["pos_x"].name == "pos_x"
    assert proposal.columns["quat_w"].name == "q_w"
