"""DataFlash logs to channels: units, axes, IMUs, motors, frames, and what to log better."""

import math

import numpy as np
import pytest
from dataflash_encoder import (
    ACC,
    ARM,
    BAT,
    FMTU,
    GYR,
    KINDS,
    MSG,
    QUAD_X,
    RATE,
    UNIT,
    Kind,
    esc,
    imu,
    log,
    message,
    parameters,
    rcou,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorfit.errors import ExperimentError, LogError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.logs import ReadOptions, read_log
from rotorfit.logs.dataflash.frames import CLASSES, ROUND, TYPES, UNEVEN, ThrustCurve, frame_of
from rotorfit.logs.dataflash.motors import wiring
from rotorfit.logs.dataflash.parameters import Parameters
from rotorfit.model.vehicle import layout_rotors

REST = ((0.0, 0.0, 0.0), (0.0, 0.0, -9.81))


def settings_of(**values: float) -> Parameters:
    return Parameters(values=values, changed=())


def written(path, messages, *, kinds=KINDS, settings=QUAD_X):
    path.write_bytes(log(kinds, [*parameters(settings), *messages]))
    return path


def read(tmp_path, messages, **options):
    return read_log(written(tmp_path / "made.bin", messages, **options))


def one_second(rate=400):
    return [k / rate for k in range(rate)]


def test_gyro_and_accelerometer_are_turned_from_frd_to_flu(tmp_path):
    messages = [imu(t, (0.1, 0.2, 0.3), (1.0, 2.0, -9.81)) for t in one_second()]
    found = read(tmp_path, messages)
    gyro, accel = found.channels["gyro"], found.channels["accel"]
    np.testing.assert_allclose(gyro.values[7], [0.1, -0.2, -0.3], rtol=1e-6)
    np.testing.assert_allclose(accel.values[7], [1.0, -2.0, 9.81], rtol=1e-6)
    np.testing.assert_allclose(gyro.time, one_second(), atol=1e-6)
    assert found.format == "dataflash"


def test_old_logs_have_milliseconds_and_an_imu_each(tmp_path, assert_wording):
    kinds = [
        Kind(130 + n, name, "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
        for n, name in enumerate(("IMU", "IMU2"))
    ]
    parm = Kind(153, "PARM", "Nf", "Name,Value")
    values = {"INS_USE": 0.0, "INS_USE2": 1.0}
    messages = [message(parm, k.encode(), v) for k, v in values.items()]
    for k in range(10):
        messages += [message(kind, 20 * k, n, 0, 0, 0, 0, -9.8) for n, kind in enumerate(kinds)]
    (tmp_path / "old.bin").write_bytes(log([*kinds, parm], messages))
    found = read_log(tmp_path / "old.bin")
    assert found.channels["gyro"].values[:, 0].tolist() == [1.0] * 10
    assert found.channels["gyro"].time[-1] == pytest.approx(0.18)
    assert any("IMU 2 of 2" in note for note in found.notes)
    assert_wording(found.notes)


def test_the_imu_of_the_primary_core_is_taken(tmp_path, assert_wording):
    xkf4 = Kind(190, "XKF4", "QBB", "TimeUS,C,PI")
    messages = [message(xkf4, 0, 0, 1)] * 5
    for t in one_second(100):
        messages += [imu(t, (i, 0, 0), (0, 0, -9.8), instance=i) for i in range(3)]
    found = read(tmp_path, messages, kinds=(*KINDS, xkf4), settings={"EK3_IMU_MASK": 5.0})
    assert found.channels["gyro"].values[0, 0] == 2.0
    assert any("IMU 3 of 3" in note for note in found.notes)
    assert_wording(found.notes)


def test_a_log_without_the_imu_that_flew_is_noted(tmp_path, assert_wording):
    # mavlogdump.py of pymavlink 2.4.50 with --reduce 3 keeps the last of three IMUs alone.
    xkf4 = Kind(190, "XKF4", "QBB", "TimeUS,C,PI")
    messages = [message(xkf4, 0, 0, 0)] * 5
    messages += [imu(t, (2, 0, 0), (0, 0, -9.8), instance=2) for t in one_second(100)]
    found = read(tmp_path, messages, kinds=(*KINDS, xkf4), settings={"EK3_IMU_MASK": 3.0})
    assert found.channels["gyro"].values[0, 0] == 2.0
    (note,) = (note for note in found.notes if "flew with IMU 1" in note)
    assert_wording(note)


def test_the_mostly_primary_core_shows_the_imu(tmp_path):
    xkf4 = Kind(190, "XKF4", "QBB", "TimeUS,C,PI")
    messages = [message(xkf4, k, 0, core) for k, core in enumerate((0, 1, 1, 1, 0))]
    for t in one_second(100):
        messages += [imu(t, (i, 0, 0), (0, 0, -9.8), instance=i) for i in range(2)]
    found = read(tmp_path, messages, kinds=(*KINDS, xkf4), settings={"EK3_IMU_MASK": 3.0})
    assert found.channels["gyro"].values[0, 0] == 1.0


def test_the_first_imu_not_switched_off_is_taken(tmp_path, assert_wording):
    settings = {**QUAD_X, "INS_USE": 0.0, "INS_USE2": 0.0, "INS_USE3": 1.0}
    settings |= {f"INS_POS{n}_{axis}": 0.1 * n for n in (1, 2, 3) for axis in "XYZ"}
    messages = [
        imu(t, (i, 0, 0), (0, 0, -9.8), instance=i) for t in one_second(100) for i in range(3)
    ]
    found = read(tmp_path, messages, settings=settings)
    assert found.channels["gyro"].values[0, 0] == 2.0
    assert "position = [0.3, -0.3," in found.metadata["airframe"]
    assert "-0.3] }" in found.metadata["airframe"]
    assert_wording(found.metadata["airframe"])


def test_a_message_of_impossible_time_takes_its_values_along(tmp_path):
    times = [0.01 * k for k in range(50)]
    messages = [imu(2e7 if k == 20 else t, (k, 0, 0), (0, 0, -9.8)) for k, t in enumerate(times)]
    gyro = read(tmp_path, messages).channels["gyro"]
    np.testing.assert_allclose(gyro.time, np.delete(times, 20), atol=1e-9)
    assert gyro.values[:, 0].tolist() == [k for k in range(50) if k != 20]


def test_faster_raw_samples_are_preferred_with_their_times(tmp_path, assert_wording):
    messages = []
    for k, t in enumerate(one_second(1000)):
        us = 1_000_000 + round(t * 1e6)
        # Written 3 ms later than sampled.
        messages.append(message(GYR, us + 3000, 0, us, 0.5, 0.0, 0.0))
        messages.append(message(ACC, us + 3000, 0, us, 0.0, 0.0, -9.5))
        if k % 10 == 0:
            messages.append(imu(1.0 + t, (0.1, 0.0, 0.0), (0.0, 0.0, -9.8)))
    found = read(tmp_path, messages)
    assert len(found.channels["gyro"].time) == 1000
    assert found.channels["gyro"].time[0] == 1.0
    assert found.channels["accel"].values[0, 2] == 9.5
    assert_wording(found.notes)


@pytest.mark.parametrize(
    ("settings", "pwm", "command", "words"),
    [
        ({"MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0}, 1500, 0.5, "MOT_PWM_MIN, MOT_PWM_MAX"),
        ({"Q_M_PWM_MIN": 1100.0, "Q_M_PWM_MAX": 1900.0}, 1300, 0.25, "MOT_PWM_MIN, MOT_PWM_MAX"),
        (
            {"MOT_PWM_MIN": 0.0, "MOT_PWM_MAX": 0.0, "RC3_MIN": 1000.0, "RC3_MAX": 1900.0},
            *(1450, 0.5, "RC3_MIN, RC3_MAX"),
        ),
        (
            {"RCMAP_THROTTLE": 1.0, "RC1_MIN": 1100.0, "RC1_MAX": 1900.0, "RC3_MIN": 1000.0},
            *(1300, 0.25, "RC1_MIN, RC1_MAX"),
        ),
        ({"SERVO1_MIN": 1000.0, "SERVO1_MAX": 1800.0}, 1200, 0.25, "SERVO1_MIN, SERVO1_MAX"),
        ({}, 1200, 0.2, "assumed: the log has no MOT_PWM_MIN"),
        ({"MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0}, 0, 0.0, "MOT_PWM_MIN, MOT_PWM_MAX"),
    ],
)
def test_commands_are_the_share_of_the_pwm_range(tmp_path, settings, pwm, command, words):
    messages = [rcou(t, [pwm] * 4) for t in one_second(50)]
    found = read(tmp_path, messages, settings={"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0, **settings})
    np.testing.assert_allclose(found.channels["command"].values, command, rtol=1e-12)
    assert words in found.channels["command"].source


def test_motors_are_in_the_order_of_their_numbers(tmp_path, assert_wording):
    functions = {"SERVO1_FUNCTION": 0.0, "SERVO3_FUNCTION": 36.0, "SERVO5_FUNCTION": 33.0}
    functions |= {"SERVO7_FUNCTION": 35.0, "SERVO8_FUNCTION": 34.0}
    pwm = [1000, 1000, 1400, 1000, 1100, 1000, 1300, 1200]
    found = read(tmp_path, [rcou(t, pwm) for t in one_second(50)], settings=functions)
    np.testing.assert_allclose(found.channels["command"].values[0], [0.1, 0.2, 0.3, 0.4])
    assert "motors 1..4 =" in found.notes[0]
    assert "outputs 5, 8, 7," in found.notes[0]
    assert "3 (SERVOn_FUNCTION)" in found.notes[0]
    assert_wording(found.notes[0])


def test_of_two_outputs_of_one_motor_the_first_is_read():
    functions = {f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 5)}
    found = wiring(settings_of(**functions, SERVO7_FUNCTION=34.0), None)
    assert found.outputs == (1, 2, 3, 4)


@pytest.mark.parametrize(("count", "first"), [(8, 33), (12, 82), (14, 160)])
def test_functions_of_many_motors(count, first):
    numbers = [*range(33, 41), *range(82, 86), *range(160, 180)][:count]
    found = wiring(
        settings_of(**{f"SERVO{i + 1}_FUNCTION": float(n) for i, n in enumerate(numbers)}), None
    )
    assert found.outputs == tuple(range(1, count + 1))
    assert first in numbers


def test_missing_motors_leave_no_command(tmp_path, assert_wording):
    functions = {"SERVO1_FUNCTION": 33.0, "SERVO2_FUNCTION": 35.0}
    found = read(tmp_path, [imu(0.0, *REST), rcou(0.0, [1500] * 4)], settings=functions)
    assert "command" not in found.channels
    assert any("motors 1, 3, with" in note for note in found.notes)
    assert_wording(found.notes)


def esc_messages(speeds, *, first=0, **more):
    return [esc(0.01 * k, first + n, 1000.0 * n + k, **more) for k in range(20) for n in speeds]


def test_esc_telemetry_is_the_rotor_speed_in_motor_order(tmp_path, assert_wording):
    functions = {f"SERVO{5 - n}_FUNCTION": 32.0 + n for n in range(1, 5)}
    found = read(tmp_path, esc_messages(range(4)), settings={**functions, "SERVO_BLH_POLES": 14.0})
    speed = found.channels["rotor_speed"]
    np.testing.assert_allclose(
        speed.values[10] * 60 / (2 * math.pi), [3010.0, 2010.0, 1010.0, 10.0], rtol=1e-6
    )
    assert any("SERVO_BLH_POLES = 14" in n for n in found.notes)
    assert_wording(found.notes)


def test_raw_rpm_that_was_never_filled_in_is_not_taken(tmp_path):
    found = read(tmp_path, esc_messages(range(4), raw=0.0))
    assert found.channels["rotor_speed"].source == "ESC.RPM [rpm]"
    assert found.channels["rotor_speed"].values[5, 3] == pytest.approx(3005 * 2 * math.pi / 60)


def test_escs_of_auxiliary_outputs(tmp_path):
    functions = {f"SERVO{8 + n}_FUNCTION": 32.0 + n for n in range(1, 5)}
    found = read(tmp_path, esc_messages(range(4)), settings=functions)
    assert found.channels["rotor_speed"].values.shape == (20, 4)
    assert any("ESC n is output n + 9" in n for n in found.notes)


def test_an_esc_without_a_message_leaves_no_speed_and_is_said(tmp_path, assert_wording):
    found = read(tmp_path, [imu(0.0, *REST), *esc_messages((0, 1, 3))])
    assert "rotor_speed" not in found.channels
    assert any("from 3 ESCs (1," in note for note in found.notes)
    assert any("2, 4), the" in note for note in found.notes)
    assert any("are 4" in note for note in found.notes)
    assert_wording(found.notes)


def test_old_escs_have_a_message_each(tmp_path):
    kinds = [Kind(190 + n, f"ESC{n + 1}", "Qecc", "TimeUS,RPM,Volt,Curr") for n in range(4)]
    messages = [
        message(kind, 10_000 * k, 100 * (500 + n), 0, 0)
        for k in range(9)
        for n, kind in enumerate(kinds)
    ]
    found = read(tmp_path, messages, kinds=(*KINDS, *kinds))
    speed = found.channels["rotor_speed"].values[3] * 60 / (2 * math.pi)
    np.testing.assert_allclose(speed, [500, 501, 502, 503])


def test_escs_logged_in_turn_are_brought_to_common_times(tmp_path):
    """All at 1e5 rpm/s, the second 4 ms after the first: before its first message it is unknown."""
    late = (0.0, 0.004, 0.0, 0.0)
    turns = [(0.01 * k + delay, n) for k in range(1, 40) for n, delay in enumerate(late)]
    found = read(tmp_path, [esc(t, n, 1e5 * t) for t, n in sorted(turns)])
    speed = found.channels["rotor_speed"]
    expected = np.tile(1e5 * speed.time[:, None] * 2 * math.pi / 60, 4)
    expected[0, 1] = np.nan
    np.testing.assert_allclose(speed.values, expected, rtol=1e-5)


def test_rotor_speeds_lose_their_sign(tmp_path):
    messages = [esc(0.01 * k, n, (-1) ** n * 1000.0) for k in range(20) for n in range(4)]
    messages += [esc(0.2, n, 5.0) for n in range(4)]
    found = read(tmp_path, messages)
    rpm = found.channels["rotor_speed"].values[:20] * 60 / (2 * math.pi)
    np.testing.assert_allclose(rpm, 1000.0, rtol=1e-6)


def test_a_battery_of_0_V_is_none(tmp_path):
    flown = [imu(t, *REST) for t in one_second()]
    some = [message(BAT, k, 0, v, 0.0) for k, v in enumerate((0.0, 12.0, 0.0, 11.9))]
    none = [message(BAT, k, 0, 0.0, 0.0) for k in range(4)]
    found = read(tmp_path, [*flown, *some]).channels["battery"]
    assert found.values[:, 0] == pytest.approx([12.0, 11.9])
    assert "battery" not in read(tmp_path, [*flown, *none]).channels


def test_battery_of_new_and_old_logs(tmp_path):
    new = [message(BAT, k, i, 16.0 - i, 0.0) for k in range(3) for i in range(2)]
    assert read(tmp_path, new).channels["battery"].values[:, 0].tolist() == [16.0] * 3
    for letters in ("Ihh", "IHh"):
        curr = Kind(190, "CURR", letters, "TimeMS,Volt,Curr")
        old = read(tmp_path, [message(curr, 1, 1234, 0)], kinds=(*KINDS, curr))
        assert old.channels["battery"].values[:, 0].tolist() == [12.34]


def test_camera_poses_are_turned_to_north_west_up(tmp_path):
    visp = Kind(190, "VISP", "QQIffffff", "TimeUS,RTimeUS,CTimeMS,PX,PY,PZ,R,P,Y")
    found = read(
        tmp_path, [message(visp, 5, 0, 0, 1.0, 2.0, -3.0, 0.0, 0.0, 90.0)] * 2, kinds=(*KINDS, visp)
    )
    assert found.channels["position"].values[0].tolist() == [1.0, -2.0, 3.0]
    # Heading east is a quarter turn clockwise from above: about the up axis, -90 deg.
    half = math.sqrt(0.5)
    np.testing.assert_allclose(
        found.channels["attitude"].values[0], [half, 0, 0, -half], atol=1e-12
    )


def test_velocity_is_turned_into_the_body(tmp_path):
    labels = "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD"
    xkf1 = Kind(190, "XKF1", "QBccCfff", labels)
    # Heading east, flying east and down: forward and, in FLU, down.
    found = read(
        tmp_path, [message(xkf1, 5, 0, 0, 0, 9000, 0.0, 4.0, 1.0)] * 2, kinds=(*KINDS, xkf1)
    )
    np.testing.assert_allclose(found.channels["velocity"].values[0], [4.0, 0.0, -1.0], atol=1e-12)


@pytest.mark.parametrize(("clock", "per_degree"), [("TimeUS", 1.0), ("TimeMS", 100.0)])
def test_rates_asked_for_are_turned_to_flu(tmp_path, clock, per_degree):
    """In centidegrees, where the clock is one of milliseconds."""
    rate = Kind(190, "RATE", "Qfff" if clock == "TimeUS" else "Ifff", f"{clock},RDes,PDes,YDes")
    asked = [per_degree * x for x in (90.0, 45.0, -30.0)]
    found = read(tmp_path, [message(rate, 5, *asked)] * 2, kinds=(*KINDS, rate))
    flu = np.radians([90.0, -45.0, 30.0])
    np.testing.assert_allclose(found.channels["reference"].values[0], flu, rtol=1e-6)


def test_velocity_is_of_the_first_core_of_the_newest_estimator(tmp_path):
    labels = "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD"
    kinds = [Kind(190 + n, name, "QBccCfff", labels) for n, name in enumerate(("XKF1", "NKF1"))]
    messages = [
        message(kind, 1000 * k, core, 0, 0, 0, 1.0 + 2 * n + core, 0.0, 0.0)
        for k in range(5)
        for n, kind in enumerate(kinds)
        for core in range(2)
    ]
    found = read(tmp_path, messages, kinds=(*KINDS, *kinds))
    assert found.channels["velocity"].values[:, 0].tolist() == [1.0] * 5


@pytest.mark.parametrize(
    "layout", ["quad-x", "quad-plus", "hexa-x", "hexa-plus", "octo-x", "octo-plus", "octo-coax-x"]
)
def test_frames_are_those_of_the_named_layouts(layout):
    kind = {"quad": 1.0, "hexa": 2.0, "octo": 3.0}[layout.split("-")[0]]
    number = 4.0 if "coax" in layout else kind
    frame = frame_of(settings_of(FRAME_CLASS=number, FRAME_TYPE=float(layout.endswith("-x"))), [])
    rotors = layout_rotors(layout, arm=1.0, order="ardupilot")
    assert frame.spins == tuple(rotor.spin for rotor in rotors)
    x, y = np.array([rotor.position[:2] for rotor in rotors]).T
    # Forward motors pitch the nose up, those at the left roll to the right.
    np.testing.assert_allclose(frame.factors[:, 0], 0.5 * y / np.abs(y).max(), atol=1e-8)
    np.testing.assert_allclose(frame.factors[:, 1], 0.5 * x / np.abs(x).max(), atol=1e-8)


@pytest.mark.parametrize("key", [*ROUND, *UNEVEN])
def test_every_frame_balances_and_can_be_steered(key):
    kind = {name: number for number, name in CLASSES.items()}[key[0]]
    number = {name: number for number, name in TYPES.items()}.get(key[1], 99)
    frame = frame_of(settings_of(FRAME_CLASS=float(kind), FRAME_TYPE=float(number)), [])
    assert (frame.kind, frame.type) == key
    roll_and_pitch = frame.factors[:, :2] if key != ("OCTA", "V") else frame.factors[:, :0]
    np.testing.assert_allclose(roll_and_pitch.sum(axis=0), 0.0, atol=1e-6)
    assert frame.spins.count("ccw") == frame.spins.count("cw")
    assert np.linalg.matrix_rank(np.column_stack([frame.factors, np.ones(len(frame.factors))])) == 4


def test_old_logs_say_their_class_in_a_text():
    assert frame_of(settings_of(FRAME=1.0), ["Frame: QUAD"]).title == "QUAD X"
    assert frame_of(settings_of(FRAME=1.0), ["Frame: OCTA_QUAD"]).title == "OCTAQUAD X"
    assert frame_of(settings_of(FRAME=1.0), []) is None
    assert frame_of(settings_of(FRAME_CLASS=6.0, FRAME_TYPE=0.0), []) is None


@pytest.mark.parametrize(("kind", "number"), [(1.0, 1.0), (5.0, 10.0)])
def test_the_logged_airframe_is_refused_until_measured(tmp_path, kind, number, assert_wording):
    frame = {"FRAME_CLASS": kind, "FRAME_TYPE": number, "INS_POS1_X": 0.02, "INS_POS1_Z": 0.01}
    found = read(tmp_path, [imu(t, *REST) for t in one_second()], settings=frame)
    text = found.metadata["airframe"]
    assert "position = [0.02, 0.0," in text
    assert "-0.01] }" in text
    assert_wording(text)
    configuration = '\n[[configuration]]\nmass = 1.0\nflights = ["made.bin"]\n'
    (tmp_path / "e.toml").write_text(text + configuration, encoding="utf-8")
    with pytest.raises(ExperimentError, match=r"airframe\.(arm|rotors)"):
        load_experiment(tmp_path / "e.toml")
    done = text.replace('"measure it [m]"', "0.2")
    for number in ("60", "180"):
        turn = math.radians(float(number))
        for value in (math.cos(turn), -math.sin(turn), math.sin(turn)):
            done = done.replace(f'"{value:.6g} * arm"', f"{value:.6g}")
    done = done.replace('"-1.22465e-16 * arm"', "0.0")
    (tmp_path / "e.toml").write_text(done + configuration, encoding="utf-8")
    assert len(load_experiment(tmp_path / "e.toml").airframe.rotors or ()) in (0, 6)


def rate_log(*, frame_type=1.0, battery=True):
    """Return messages of a flight whose RATE comes at 400 Hz and RCOU at 10 Hz, and commands."""
    rng = np.random.default_rng(5)
    frame = frame_of(settings_of(FRAME_CLASS=1.0, FRAME_TYPE=frame_type), [])
    time = np.arange(8000) / 400.0
    inputs = 0.04 * np.cumsum(rng.normal(size=(len(time), 3)), axis=0)
    inputs = 0.1 * np.sin(inputs)
    throttle = 0.4 + 0.05 * np.sin(time)
    throttle[:800] = 0.0
    thrust = np.clip(inputs @ frame.factors.T + throttle[:, None], 0, 1)
    # What (1 - e) u + e u^2 = t gives, by bisection.
    low, high = np.zeros_like(thrust), np.ones_like(thrust)
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = 0.35 * middle + 0.65 * middle**2 > thrust
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    sag = 1.0 + 0.1 * time[:, None] / time[-1] if battery else 1.0
    command = 0.15 + 0.8 * low * sag
    command[:800] = 0.1  # idling: not mixed
    messages = []
    for k, t in enumerate(time.tolist()):
        r, p, y = inputs[k].tolist()
        messages.append(message(RATE, round(t * 1e6), 0, 0, r, 0, 0, p, 0, 0, y, 0, 0, throttle[k]))
        if k % 40 == 0:
            messages.append(rcou(t, (1000 + 1000 * command[k]).tolist()))
    return messages, time, command


def test_slow_outputs_are_mixed_again_from_the_controllers(tmp_path, assert_wording):
    messages, time, command = rate_log()
    found = read(tmp_path, messages)
    mixed = found.channels["command"]
    assert len(mixed.time) > 7900
    rows = np.searchsorted(time, mixed.time - 1e-6)
    np.testing.assert_allclose(mixed.values, command[rows], atol=0.002)
    assert_wording(mixed.source)
    assert any("at 10 Hz," in n for n in found.notes)
    assert any("at 400 Hz:" in n for n in found.notes)
    assert_wording(found.notes)


def test_a_mix_that_contradicts_the_outputs_is_not_used(tmp_path, assert_wording):
    messages, _, _ = rate_log(frame_type=0.0)  # flew a plus, says it is an X
    found = read(tmp_path, messages)
    assert len(found.channels["command"].time) == 200
    assert any("differs from RCOU by" in n and "RCOU is used" in n for n in found.notes)
    assert_wording(found.notes)


def test_an_unknown_frame_leaves_the_slow_outputs(tmp_path, assert_wording):
    messages, _, _ = rate_log()
    found = read(tmp_path, messages, settings={**QUAD_X, "FRAME_CLASS": 7.0})
    assert len(found.channels["command"].time) == 200
    assert_wording(found.notes)


@settings(max_examples=50, deadline=None)
@given(st.floats(-0.95, 1.0), st.floats(0.0, 1.0))
def test_the_thrust_curve_inverts(expo, thrust):
    curve = ThrustCurve(expo=expo, spin_min=0.1, spin_max=0.9)
    u = curve.share(np.array([[thrust]]))
    assert float((1 - expo) * u[0, 0] + expo * u[0, 0] ** 2) == pytest.approx(thrust, abs=1e-6)


def test_law_and_frame_are_said(tmp_path, assert_wording):
    found = read(
        tmp_path,
        [imu(t, *REST) for t in one_second()],
        settings={**QUAD_X, "MOT_BAT_VOLT_MAX": 16.8},
    )
    notes = "\n".join(found.notes)
    assert "0.35 u + 0.65" in notes
    assert "u^2 with" in notes
    assert "(command - 0.15) /" in notes
    assert "0.8" in notes
    assert_wording(notes)
    assert "at 45, -135, -45," in notes
    assert "135 deg" in notes


def test_what_to_set_is_said_with_the_number(tmp_path, assert_wording):
    found = read(tmp_path, [imu(t, *REST) for t in one_second(25)], settings=QUAD_X)
    notes = "\n".join([*found.notes, *found.warnings])
    wanted = 176126 | 1 << 18 | 1 << 19 | 1 << 0 | 1 << 10 | 1 << 9
    assert f"LOG_BITMASK = {wanted}, which" in notes
    assert "(bit 0), fast" in notes
    assert "(bit 18)" in notes
    assert_wording(notes)
    assert notes.count("LOG_BITMASK") == 1  # said once, as a warning
    assert "at 25 Hz" in notes
    assert "SERVO_BLH_BDMASK = 15 (the" in notes


def test_a_mask_that_asks_for_all_points_to_the_rate_limit(tmp_path, assert_wording):
    messages = [imu(t, *REST) for t in one_second(25)]
    found = read(tmp_path, messages, settings={**QUAD_X, "LOG_BITMASK": float(2**21 - 1)})
    assert any("LOG_FILE_RATEMAX = 0, since" in n for n in found.warnings)
    assert any("LOG_BITMASK = 2097151" in n for n in found.warnings)
    assert_wording(found.warnings)


def test_batches_are_left_out_and_said(tmp_path, assert_wording):
    isbh = Kind(190, "ISBH", "QHBBHHQf", "TimeUS,N,type,instance,mul,smp_cnt,SampleUS,smp_rate")
    messages = [imu(0.0, *REST), message(isbh, 0, 0, 0, 0, 1, 1024, 0, 1000.0)]
    notes = "\n".join(read(tmp_path, messages, kinds=(*KINDS, isbh)).notes)
    assert "1 batches" in notes
    assert_wording(notes)


def test_arming_is_reported_and_its_absence_doubted(tmp_path, assert_wording):
    flown = read(tmp_path, [imu(0.0, *REST), message(ARM, 2_500_000, 1, 0, 0, 0)])
    assert any("at 2.5 s" in note for note in flown.notes)
    assert_wording(flown.notes)
    idle = read(tmp_path, [imu(0.0, *REST), message(ARM, 2_500_000, 0, 0, 0, 0)])
    assert_wording(idle.warnings)


def test_motors_that_were_driven_were_armed_before_the_log(tmp_path, assert_wording):
    """Logs begin while arming, and may hold the disarming alone."""
    outputs = [rcou(t, 4 * [1100 + 400 * (t > 0.5)]) for t in one_second()]
    flown = read(tmp_path, [imu(t, *REST) for t in one_second()] + outputs + [
        message(ARM, 2_500_000, 0, 0, 0, 0)
    ])  # fmt: skip
    assert "command" in flown.channels
    assert any("at 2.5 s" in note for note in flown.notes)
    assert_wording(flown.notes)
    assert not any("never armed" in words for words in flown.warnings)


def test_arming_by_the_events_of_old_logs(tmp_path, assert_wording):
    event = Kind(190, "EV", "QB", "TimeUS,Id")
    events = [message(event, 1_500_000, 10), message(event, 2_500_000, 11)]
    found = read(tmp_path, [imu(0.0, *REST), *events], kinds=(*KINDS, event))
    assert any("at 1.5 s," in note for note in found.notes)
    assert any("at 2.5 s" in note for note in found.notes)
    assert_wording(found.notes)


def test_a_unit_that_is_not_the_one_assumed_is_doubted(tmp_path, assert_text):
    uses = message(FMTU, 0, 150, b"s#kkkooo", b"F-000000")
    units = [message(UNIT, 0, ord("k"), b"deg/s"), message(UNIT, 0, ord("o"), b"m/s/s")]
    found = read(tmp_path, [*units, uses, imu(0.0, *REST)])
    assert_text(found.warnings)


def test_damage_is_a_warning_of_the_result(tmp_path, assert_wording):
    messages = [imu(0.1 * k, *REST) for k in range(6)]
    found = read(tmp_path, [*messages[:3], b"\0" * 99, *messages[3:], b"\xff" * 50])
    assert len(found.channels["gyro"].time) == 6
    assert any("1 damaged places: 99" in doubt for doubt in found.warnings)
    assert any("skipped, 0 messages" in doubt for doubt in found.warnings)
    assert_wording(found.warnings)
    assert any("50 bytes" in doubt for doubt in found.warnings)


def test_changed_parameters_are_doubted(tmp_path, assert_text):
    later = parameters({"MOT_PWM_MAX": 1900.0, "ARMING_CHECK": 1.0})
    found = read(tmp_path, [imu(0.0, *REST), *later])
    assert_text(found.warnings)


def test_of_a_parameter_logged_twice_the_last_value_counts(tmp_path):
    for last in (1900.0, 1800.0):
        messages = [rcou(t, [1450] * 4) for t in one_second(50)]
        for value in (1950.0, 1700.0, last):
            messages += parameters({"MOT_PWM_MAX": value})
        found = read(tmp_path, messages)
        assert found.metadata["MOT_PWM_MAX"] == f"{last:g}"
        np.testing.assert_allclose(found.channels["command"].values, 450 / (last - 1000))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\xa3\x95\x96" + b"\0" * 99, "no message is defined in it"),
        (log(KINDS, [message(MSG, 0, b"hello")]), "none of them IMU, RCOU or ESC: set LOG_BITMASK"),
        (b"\xa3\x95", "no message is defined in it"),
    ],
)
def test_logs_without_channels_are_refused_with_what_to_do(tmp_path, content, words):
    (tmp_path / "made.bin").write_bytes(content)
    with pytest.raises(LogError, match=words):
        read_log(tmp_path / "made.bin")


def test_options_that_make_no_sense_are_refused(tmp_path):
    path = written(tmp_path / "made.bin", [imu(0.0, *REST)])
    with pytest.raises(LogError, match="leave out axes"):
        read_log(path, options=ReadOptions(axes="FRD"))
    with pytest.raises(LogError, match="there is no log 2"):
        read_log(path, options=ReadOptions(log_number=2))
    (tmp_path / "text.csv").write_text("time,gyro_x\n")
    with pytest.raises(LogError, match="begins with 74 69, expected a3 95"):
        read_log(tmp_path / "text.csv", options=ReadOptions(format="dataflash"))


@pytest.mark.parametrize("lengths", [(400, 300), (300, 400)], ids=["longer first", "longer last"])
def test_a_log_appended_to_another_is_reported(tmp_path, lengths, assert_wording):
    parts = [
        log(KINDS, [*parameters(QUAD_X), *(imu(5.0 + k / 100, *REST) for k in range(length))])
        for length in lengths
    ]
    path = tmp_path / "two.bin"
    path.write_bytes(b"".join(parts))
    [said] = [words for words in read_log(path).warnings if "begins anew" in words]
    left = 300 if lengths[0] > lengths[1] else 299  # at the same time one of two may stay
    assert f" {left} of 700 messages" in said
    assert_wording(said)
    path.write_bytes(parts[0])
    assert not any("begins anew" in words for words in read_log(path).warnings)
