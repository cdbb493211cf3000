"""ESC telemetry and motor outputs of a ULog, by versions of PX4."""

from dataclasses import replace

import numpy as np
import pytest
from ulog_encoder import (
    Parts,
    actuator_motors,
    actuator_outputs,
    encode,
    esc_status,
    sensor_combined,
)

from rotorfit.logs import read_log

N = 200
TIME = 100.0 + 0.005 * np.arange(N)
RNG = np.random.default_rng(5)
SHARE = RNG.uniform(0.1, 0.9, size=(N, 4))
SPEED = np.round(RNG.uniform(3000, 9000, size=(N, 4))) * 2 * np.pi / 60


def read(tmp_path, *topics, **parts):
    path = tmp_path / "log.ulg"
    path.write_bytes(encode([*topics], Parts(**parts), start=99.0))
    return read_log(path)


def noted(log, words):
    return [note for note in (*log.notes, *log.warnings) if words in note]


# Measured speed


def test_escs_are_ordered_by_motor_and_lose_their_sign(tmp_path, assert_text):
    topic = esc_status(TIME, SPEED, functions=[103, 101, 104, 102], signs=[1, -1, 1, -1])
    channel = read(tmp_path, topic).channels["rotor_speed"]
    np.testing.assert_allclose(channel.values, SPEED[:, [1, 3, 0, 2]], rtol=1e-9)
    assert_text(channel.source)


def test_functions_that_are_logged_late_count(tmp_path):
    topic = esc_status(TIME, SPEED, functions=[103, 101, 104, 102])
    motors = np.where(np.arange(N)[:, None] < 10, 0, [[103, 101, 104, 102, 0, 0, 0, 0]])
    late = replace(topic, fields={**topic.fields, "esc.actuator_function": motors})
    channel = read(tmp_path, late).channels["rotor_speed"]
    np.testing.assert_allclose(channel.values, SPEED[:, [1, 3, 0, 2]], rtol=1e-9)


def test_a_speed_that_no_rotor_has_is_damage(tmp_path):
    speed = SPEED.copy()
    speed[7, 2] = 300_001 * 2 * np.pi / 60
    values = read(tmp_path, esc_status(TIME, speed)).channels["rotor_speed"].values
    assert np.argwhere(np.isnan(values)).tolist() == [[7, 2]]


def test_without_functions_parameters_or_the_count_say_how_many(tmp_path):
    eight = np.hstack([SPEED, SPEED * 0])
    topic = esc_status(TIME, eight, functions=[0] * 8)
    for parameters in ({"CA_ROTOR_COUNT": 4}, {"SYS_AUTOSTART": 4001}):
        speed = read(tmp_path, topic, parameters=parameters).channels["rotor_speed"].values
        np.testing.assert_allclose(speed, SPEED)
    topic = esc_status(TIME, SPEED, functions=[0] * 4)  # esc_count is 4
    assert read(tmp_path, topic).channels["rotor_speed"].values.shape == (N, 4)


def test_a_motor_that_stands_counts_and_a_silent_one_is_said(tmp_path, assert_wording):
    speed = SPEED.copy()
    speed[:50] = 0
    speed[:, 2] = 0
    log = read(tmp_path, esc_status(TIME, speed))
    np.testing.assert_allclose(log.channels["rotor_speed"].values, speed)
    assert noted(log, "Motor 3: 0 rpm")
    assert_wording((*log.notes, *log.warnings))


def test_telemetry_that_never_comes_is_no_rotor_speed(tmp_path, assert_wording):
    motors = actuator_motors(TIME, SHARE)
    log = read(tmp_path, motors, esc_status(TIME, 0 * SPEED))
    assert "rotor_speed" not in log.channels
    assert noted(log, "says 0 rpm throughout")
    assert_wording((*log.notes, *log.warnings))


def test_the_step_of_the_telemetry_is_found(tmp_path):
    steps = np.round(SPEED * 60 / (2 * np.pi) / 14) * 14 * 2 * np.pi / 60
    channel = read(tmp_path, esc_status(TIME, steps)).channels["rotor_speed"]
    assert channel.resolution == pytest.approx(14 * 2 * np.pi / 60)


def ramps(time):
    return 400 + 100 * np.sin(3 * time[:, None] + np.arange(4))


def test_escs_that_report_in_turn_are_brought_to_common_times(tmp_path, assert_wording):
    late = np.array([0.001, 0.006, 0.011, 0.016])
    time = 100.0 + 0.02 * np.arange(N)
    reports = time[:, None] - late
    speed = 400 + 100 * np.sin(3 * reports + np.arange(4))
    twice = np.repeat(time, 2) + np.tile([0.0, 0.004], N)  # every second message has nothing new
    topic = esc_status(twice, np.repeat(speed, 2, axis=0), reported=np.repeat(reports, 2, axis=0))
    log = read(tmp_path, topic)
    channel = log.channels["rotor_speed"]
    np.testing.assert_allclose(channel.time, time, atol=1e-6)
    inside = slice(1, -1)
    np.testing.assert_allclose(channel.values[inside], ramps(time)[inside], atol=0.15)
    assert np.abs(speed - ramps(time)).max() > 4  # as published they are off
    assert noted(log, "50 new messages")
    assert_wording((*log.notes, *log.warnings))


def test_reports_are_not_joined_over_a_hole(tmp_path):
    time = 100.0 + 0.02 * np.arange(N)
    reports = np.repeat(time[:, None] - 0.01, 4, axis=1)
    reports[50:60, 1] = reports[49, 1]  # this ESC is silent for a while
    topic = esc_status(time, ramps(time), reported=reports)
    values = read(tmp_path, topic).channels["rotor_speed"].values
    assert np.isnan(values[51:59, 1]).all()
    assert np.isfinite(values[1:-1, 0]).all()


# Commands


def test_thrusts_become_the_outputs_sent(tmp_path, assert_text, assert_wording):
    factor = 0.3
    thrust = factor * SHARE**2 + (1 - factor) * SHARE
    log = read(tmp_path, actuator_motors(TIME, thrust), parameters={"THR_MDL_FAC": factor})
    command = log.channels["command"]
    np.testing.assert_allclose(command.values, SHARE, atol=1e-6)
    assert command.source.endswith("(THR_MDL_FAC 0.3)")
    assert_wording(command.source)
    assert noted(log, "0.3 u^2 + 0.7 u")
    assert noted(log, "(THR_MDL_FAC = 0.3)")
    assert_wording((*log.notes, *log.warnings))
    assert_text(log.metadata["motors"])


@pytest.mark.parametrize("factor", [0.0, -0.5, 1.5])
def test_without_a_factor_the_thrust_is_the_output(tmp_path, factor):
    log = read(tmp_path, actuator_motors(TIME, SHARE), parameters={"THR_MDL_FAC": factor})
    np.testing.assert_allclose(log.channels["command"].values, SHARE, atol=1e-7)


def test_stopped_motors_are_nan_in_the_log_and_stand_here(tmp_path, assert_wording):
    thrust = SHARE.copy()
    thrust[:30] = np.nan
    thrust[40, 2] = -0.5
    log = read(tmp_path, actuator_motors(TIME, thrust))
    command = log.channels["command"].values
    assert command.shape == (N, 4)
    assert not command[:30].any()
    assert np.argwhere(np.isnan(command)).tolist() == [[40, 2]]
    assert noted(log, "1 commands are outside")
    assert_wording((*log.notes, *log.warnings))


def pwm(share, low, high):
    return np.round(low + share * (high - low), 3)


OLD = {"SYS_AUTOSTART": 4001, "PWM_MIN": 1075, "PWM_MAX": 1950}


def test_outputs_of_older_versions(tmp_path, assert_wording):
    output = np.hstack([pwm(SHARE, 1075, 1950), np.full((N, 4), 1500.0)])
    output[:20, :4] = 900
    still = actuator_outputs(TIME, np.full((N, 4), 1500.0), instance=0)
    log = read(tmp_path, still, actuator_outputs(TIME, output, instance=1), parameters=OLD)
    command = log.channels["command"]
    assert not command.values[:20].any()
    np.testing.assert_allclose(command.values[20:], SHARE[20:], atol=1e-5)
    assert command.source.startswith("actuator_outputs[1].output[0, 1, 2, 3],")
    assert "1075..1950" in command.source
    assert_wording(command.source)
    assert command.resolution == pytest.approx(1 / 875)


def test_ranges_of_single_outputs(tmp_path):
    parameters = {**OLD, "PWM_MAIN_MIN2": 1100, "PWM_MAIN_MAX2": 1900, "PWM_MAIN_MIN3": -1}
    output = pwm(SHARE, np.array([1075, 1100, 1075, 1075]), np.array([1950, 1900, 1950, 1950]))
    log = read(tmp_path, actuator_outputs(TIME, output), parameters=parameters)
    np.testing.assert_allclose(log.channels["command"].values, SHARE, atol=1e-5)


def test_dshot_of_older_versions(tmp_path):
    parameters = {**OLD, "DSHOT_CONFIG": 600, "DSHOT_MIN": 0.055}
    low = 1999 * 0.055
    log = read(tmp_path, actuator_outputs(TIME, pwm(SHARE, low, 1999)), parameters=parameters)
    np.testing.assert_allclose(log.channels["command"].values, SHARE, atol=1e-5)
    assert "DSHOT_CONFIG" in log.channels["command"].source


def test_auxiliary_outputs_switched_together_are_no_motors(tmp_path, assert_wording):
    """SYS_USE_IO = 1: motors on the IO processor, instance 0; DSHOT_CONFIG is of the others."""
    parameters = {**OLD, "DSHOT_CONFIG": 600, "SYS_USE_IO": 1}
    output = pwm(SHARE, 1075, 1950)
    output[-5:] = 900.0
    aux = np.where(np.arange(N)[:, None] < N - 5, 1054.0, 0.0) * np.ones((1, 4))
    topics = (actuator_outputs(TIME, output), actuator_outputs(TIME, aux, instance=1))
    command = read(tmp_path, *topics, parameters=parameters).channels["command"]
    assert command.source.startswith("actuator_outputs.output[0, 1, 2, 3],")
    assert "1075..1950 (PWM_MIN" in command.source
    assert_wording(command.source)
    np.testing.assert_allclose(command.values[:-5], SHARE[:-5], atol=1e-5)


@pytest.mark.parametrize("gimbal", [0, 1])
def test_a_gimbal_that_moves_further_is_no_motor(tmp_path, gimbal):
    """The vehicle follows the outputs of one instance; a gimbal's servos move by themselves."""
    time = np.arange(600) * 0.05
    share = 0.5 + 0.1 * random_walks(time, 4)
    servos = np.round(1500.0 + 400.0 * np.sin(np.outer(time, 1.0 + 0.3 * np.arange(4))), 3)
    fine = np.arange(0.0, 30.0, 0.004)
    mixed = share @ np.array([[-1.0, -1, 1, 1], [1, -1, -1, 1], [1, -1, 1, -1]]).T
    torque = np.stack([np.interp(fine, time, mixed[:, i]) for i in range(3)], axis=1)
    gyro = np.cumsum(torque, axis=0) * 0.004
    accel = np.zeros_like(gyro)
    accel[:, 2] = -19.6 * np.interp(fine, time, share.mean(axis=1))
    log = read(
        tmp_path,
        sensor_combined(fine, gyro, accel),
        actuator_outputs(time, servos, instance=gimbal),
        actuator_outputs(time, pwm(share, 1075, 1950), instance=1 - gimbal),
        parameters=OLD,
    )
    np.testing.assert_allclose(log.channels["command"].values, share, atol=1e-5)


def random_walks(time, count):
    """Return series of frequencies of .3 to 3 Hz, and of deviation 1."""
    rng = np.random.default_rng(3)
    waves = rng.uniform(0.3, 3.0, (8, count)), rng.uniform(0.0, 6.0, (8, count))
    return np.sin(2.0 * np.pi * time[:, None, None] * waves[0] + waves[1]).mean(axis=1) * 4.0


@pytest.mark.parametrize(
    ("prefix", "low", "high", "extra"),
    [
        ("PWM_MAIN", 1100.0, 1900.0, {}),
        ("PWM_AUX", 1100.0, 1900.0, {"PWM_MAIN_FUNC1": 201}),
        ("SIM_GZ_EC", 150.0, 1000.0, {}),
        ("PWM_AUX", 1999 * 0.055, 1999.0, {"PWM_AUX_TIM0": -3, "DSHOT_MIN": 0.055}),
    ],
)
def test_outputs_by_their_functions(tmp_path, prefix, low, high, extra):
    """Motors 1 to 4 on outputs 3, 4, 1 and 2 of one driver; another driver publishes servos."""
    places = [2, 3, 0, 1]
    parameters = {"CA_ROTOR_COUNT": 4, **extra}
    for motor, place in enumerate(places):
        parameters[f"{prefix}_FUNC{place + 1}"] = 101 + motor
        if "TIM0" not in str(extra):
            parameters[f"{prefix}_MIN{place + 1}"] = int(low)
            parameters[f"{prefix}_MAX{place + 1}"] = int(high)
    output = np.zeros((N, 8))
    output[:, places] = pwm(SHARE, low, high)
    servos = actuator_outputs(TIME, np.full((N, 8), 1500.0), instance=0)
    log = read(tmp_path, servos, actuator_outputs(TIME, output, instance=1), parameters=parameters)
    np.testing.assert_allclose(log.channels["command"].values, SHARE, atol=1e-5)
    assert f"{prefix}_FUNC" in log.channels["command"].source


def test_the_simulators_command_is_a_speed(tmp_path, assert_text):
    parameters = {"CA_ROTOR_COUNT": 4, "THR_MDL_FAC": 0.0}
    for i in range(1, 5):
        parameters |= {f"SIM_GZ_EC_{key}{i}": v for key, v in (("MIN", 150), ("MAX", 1000))}
        parameters[f"SIM_GZ_EC_FUNC{i}"] = 100 + i
    log = read(tmp_path, actuator_motors(TIME, SHARE), parameters=parameters)
    assert_text(log.metadata["motors"])


def test_outputs_beyond_their_range_are_left_out(tmp_path, assert_wording):
    log = read(tmp_path, esc_status(TIME, SPEED), actuator_outputs(TIME, 8191 * SHARE))
    assert "command" not in log.channels
    assert noted(log, "range 1000 to 2000")
    assert_wording((*log.notes, *log.warnings))


def test_slow_motor_data_are_doubted(tmp_path, assert_wording):
    slow = 100.0 + 0.1 * np.arange(N)
    log = read(tmp_path, actuator_motors(slow, SHARE), esc_status(slow, SPEED))
    for name in ("rotor_speed", "command"):
        (doubt,) = noted(log, f"the {name} channel comes at 10 Hz, too slow for inertia")
        assert "bits 0 and 4" in doubt
        assert "rate; 17, if" in doubt
        assert_wording(doubt)
        assert doubt in log.warnings


def test_standing_motors_have_command_zero_with_full_factor(tmp_path):
    """With THR_MDL_FAC = 1 the command is the root of the thrust, 0 / 0 in the stable form."""
    thrust = np.tile([[0.0, 0.25, 1.0, 0.5]], (N, 1))
    log = read(tmp_path, actuator_motors(TIME, thrust), parameters={"THR_MDL_FAC": 1.0})
    command = log.channels["command"].values
    np.testing.assert_allclose(command, np.tile([[0.0, 0.5, 1.0, 0.5**0.5]], (N, 1)), atol=1e-12)
