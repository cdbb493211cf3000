"""Tables with the column names of programs that export flight logs."""

import numpy as np
import pytest

from rotorfit.errors import LogError
from rotorfit.logs.exporters import EXPORTERS, exporter_of
from rotorfit.logs.proposal import Proposal, propose_columns
from rotorfit.logs.table import read_table

G = 9.80665
ROWS = 400
TIME = 0.005 * np.arange(ROWS)
RNG = np.random.default_rng(3)
GYRO = RNG.normal(0.0, 0.6, (ROWS, 3))
ACCEL = np.array([0.0, 0.0, G]) + RNG.normal(0.0, 0.3, (ROWS, 3))
SHARE = 0.4 + 0.1 * np.sin(3.0 * TIME[:, None] + np.arange(4))
DOWN = np.array([1.0, -1.0, -1.0])


def written(path, columns):
    """Write columns as a table, with empty cells for NaN."""
    rows = np.column_stack(list(columns.values())).tolist()
    lines = [",".join("" if np.isnan(v) else repr(v) for v in row) for row in rows]
    path.write_text("\n".join([",".join(columns), *lines]))
    return path


def named(names, values):
    return dict(zip(names, np.asarray(values).T, strict=True))


def blackbox_columns(motors):
    return {
        "loopIteration": np.arange(ROWS) * 8.0,
        "time (us)": 4e8 + 1e6 * TIME,
        **named([f"rcCommand[{i}]" for i in range(4)], 100 * RNG.standard_normal((ROWS, 4))),
        **named([f"gyroADC[{i}]" for i in range(3)], np.rad2deg(GYRO)),
        **named([f"accSmooth[{i}]" for i in range(3)], 2048 / G * ACCEL),
        **named([f"motor[{i}]" for i in range(4)], motors),
        **named([f"eRPM[{i}]" for i in range(4)], 1000 * SHARE),
    }


def read_by(proposal: Proposal, path, poles=None):
    return read_table(path, columns=proposal.columns, axes=proposal.axes, motor_poles=poles)


@pytest.mark.parametrize(
    ("motors", "command"), [(48 + 1999 * SHARE, SHARE), (1000 + 1000 * SHARE, SHARE)]
)
def test_blackbox_decode_names_commands_and_electrical_speeds(tmp_path, motors, command):
    path = written(tmp_path / "decoded.csv", blackbox_columns(motors))
    proposal = propose_columns(path)
    assert proposal.questions == ()
    log = read_by(proposal, path, poles=14)
    np.testing.assert_allclose(log.channels["command"].values, command, atol=1e-9)
    speed = 1000 * SHARE * 100 / 7 * 2 * np.pi / 60
    np.testing.assert_allclose(log.channels["rotor_speed"].values, speed, rtol=1e-9)
    np.testing.assert_allclose(log.channels["gyro"].values, GYRO, rtol=1e-9)


def test_plotjuggler_keeps_the_motors_that_carry_numbers(tmp_path):
    controls = np.hstack([SHARE, np.full((ROWS, 8), np.nan)])
    columns = {
        "__time": TIME,
        **named([f"/sensor_combined/gyro_rad.{i:02}" for i in range(3)], GYRO * DOWN),
        **named([f"/sensor_combined/accelerometer_m_s2.{i:02}" for i in range(3)], ACCEL * DOWN),
        **named([f"/actuator_controls_0/control.{i:02}" for i in range(4)], SHARE - 0.4),
        **named([f"/actuator_motors/control.{i:02}" for i in range(12)], controls),
    }
    path = written(tmp_path / "juggled.csv", columns)
    proposal = propose_columns(path)
    log = read_by(proposal, path)
    np.testing.assert_allclose(log.channels["command"].values, SHARE, rtol=1e-9)
    np.testing.assert_allclose(log.channels["gyro"].values, GYRO, rtol=1e-9)
    assert any("give the log itself (.ulg" in reason for reason in proposal.reasons)


@pytest.mark.parametrize("offset", [0.0, 0.0007, 0.0025])
def test_rows_that_a_join_filled_forward_are_no_samples(tmp_path, offset):
    """Every message of another clock adds a row with the last sample of the IMU."""
    motors = np.sort(np.concatenate([TIME[::3] + offset, TIME[1:-1:4] + 0.0031]))
    time = np.sort(np.concatenate([TIME, motors]))
    last = np.searchsorted(TIME, time + 1e-9, side="right") - 1
    if not offset:  # rows of one time come as their messages did: the IMU's last
        same = np.flatnonzero(np.diff(time) < 1e-9)
        last[same] = np.maximum(last[same] - 1, 0)
    turn = np.cumsum(GYRO, axis=0) * 0.005
    columns = {
        "__time": time,
        **named([f"/sensor_combined/gyro_rad.{i:02}" for i in range(3)], GYRO[last] * DOWN),
        **named(
            [f"/sensor_combined/accelerometer_m_s2.{i:02}" for i in range(3)], ACCEL[last] * DOWN
        ),
        **named(["roll_rad", "pitch_rad", "yaw_rad"], turn[last] * DOWN),
        **named([f"/actuator_motors/control.{i:02}" for i in range(4)], SHARE[last]),
    }
    path = written(tmp_path / "filled.csv", columns)
    proposal = propose_columns(path)
    log = read_by(proposal, path)
    for name, values in (("gyro", GYRO), ("accel", ACCEL)):
        np.testing.assert_allclose(log.channels[name].time, TIME, atol=1e-9)
        np.testing.assert_allclose(log.channels[name].values, values, rtol=1e-9)
    assert len(log.channels["command"].time) == len(time)
    assert any("rows of gyro" in note for note in log.notes)
    assert not any("does not follow" in doubt for doubt in proposal.doubts)


def test_topics_of_px4_joined_to_one_table_are_a_flight(tmp_path):
    """Torques have the same name (actuator_controls_0), but change their sign."""
    sensors = {
        "timestamp": np.round(1e6 * TIME),
        **named([f"gyro_rad[{i}]" for i in range(3)], GYRO * DOWN),
        **named([f"accelerometer_m_s2[{i}]" for i in range(3)], ACCEL * DOWN),
    }
    controls = np.hstack([SHARE, np.full((ROWS, 8), np.nan)])
    motors = named([f"control[{i}]" for i in range(12)], controls)
    path = written(tmp_path / "joined.csv", {**sensors, **motors})
    proposal = propose_columns(path)
    np.testing.assert_allclose(read_by(proposal, path).channels["command"].values, SHARE)
    assert any("joined to one table" in reason for reason in proposal.reasons)
    torques = named([f"control[{i}]" for i in range(4)], np.hstack([GYRO, SHARE[:, :1]]))
    with pytest.raises(LogError, match="joined to one table"):
        propose_columns(written(tmp_path / "torques.csv", {**sensors, **torques}))


def test_motors_that_are_logged_fast_come_before_slow_ones(tmp_path):
    """PX4 logs actuator_outputs at 10 Hz, and actuator_motors with the gyro."""
    slow = np.full((ROWS, 4), np.nan)
    slow[::20] = 1000.0 + 1000.0 * SHARE[::20]
    columns = {
        "__time": TIME,
        **named([f"/sensor_combined/gyro_rad.{i:02}" for i in range(3)], GYRO * DOWN),
        **named([f"/sensor_combined/accelerometer_m_s2.{i:02}" for i in range(3)], ACCEL * DOWN),
        **named([f"/actuator_outputs/output.{i:02}" for i in range(4)], slow),
        **named([f"/actuator_motors/control.{i:02}" for i in range(4)], SHARE),
    }
    path = written(tmp_path / "both.csv", columns)
    command = read_by(propose_columns(path), path).channels["command"]
    np.testing.assert_allclose(command.values, SHARE, rtol=1e-9)


def test_repeated_samples_of_an_even_clock_are_left(tmp_path):
    held = np.arange(ROWS) // 2 * 2
    sensors = {
        **named(["gyro_x", "gyro_y", "gyro_z"], GYRO[held]),
        **named(["accel_x", "accel_y", "accel_z"], ACCEL[held]),
    }
    path = written(tmp_path / "held.csv", {"time": TIME, **sensors})
    assert len(read_table(path).channels["gyro"].time) == ROWS


def test_plotjuggler_has_the_speeds_of_a_topic_named_status(tmp_path):
    columns = {
        "__time": TIME,
        **named([f"/sensor_combined/gyro_rad.{i:02}" for i in range(3)], GYRO * DOWN),
        **named([f"/sensor_combined/accelerometer_m_s2.{i:02}" for i in range(3)], ACCEL * DOWN),
        **named([f"/esc_status/esc.{i:02}/esc_rpm" for i in range(4)], 20000 * SHARE),
        **named([f"/esc_status/esc.{i:02}/esc_current" for i in range(4)], 9 * SHARE),
        **named([f"/actuator_motors/control.{i:02}" for i in range(4)], SHARE),
    }
    path = written(tmp_path / "juggled.csv", columns)
    log = read_by(propose_columns(path), path)
    speed = 20000 * SHARE * 2 * np.pi / 60
    np.testing.assert_allclose(log.channels["rotor_speed"].values, speed, rtol=1e-9)
    np.testing.assert_allclose(log.channels["command"].values, SHARE, rtol=1e-9)


def test_cfclient_logs_commands_of_16_bits(tmp_path):
    columns = {
        "Timestamp": 12345.0 + 1e3 * TIME,
        **named([f"gyro.{a}" for a in "xyz"], np.rad2deg(GYRO)),
        **named([f"acc.{a}" for a in "xyz"], ACCEL / G),
        **named([f"motor.m{i}" for i in range(1, 5)], 65535 * SHARE),
    }
    path = written(tmp_path / "client.csv", columns)
    proposal = propose_columns(path)
    log = read_by(proposal, path)
    assert proposal.questions == ()
    np.testing.assert_allclose(log.channels["command"].values, SHARE, rtol=1e-9)
    np.testing.assert_allclose(log.channels["gyro"].values, GYRO, rtol=1e-9)
    assert any("micro-SD" in reason for reason in proposal.reasons)


@pytest.mark.parametrize(("accel", "asked"), [(1000.0 / G, True), (1.0 / G, False)])
def test_a_gyro_beside_thousandths_of_g_is_asked_about(tmp_path, accel, asked):
    """MAVLink's SCALED_IMU has mrad/s beside mg; 150 deg/s would pass for 2600."""
    columns = {
        "time_boot_ms": 1e3 * TIME,
        **named([f"{a}gyro" for a in "xyz"], 1000.0 * GYRO),
        **named([f"{a}acc" for a in "xyz"], accel * ACCEL),
        **named([f"servo{i}_raw" for i in range(1, 5)], 1100 + 800 * SHARE),
    }
    proposal = propose_columns(written(tmp_path / "scaled.csv", columns))
    assert [q.choices for q in proposal.questions] == [("mrad/s", "deg/s")] * asked
    assert proposal.columns["gyro_x"].unit == ("mrad/s" if asked else "deg/s")


def datcon_columns(clock):
    corners = ("RFront", "LFront", "LBack", "RBack")
    return {
        "Clock:Tick#": 45e6 * TIME,
        **clock,
        **named([f"IMU_ATTI(0):accel{a}" for a in "XYZ"], ACCEL * DOWN / G),
        **named([f"IMU_ATTI(0):gyro{a}" for a in "XYZ"], np.rad2deg(GYRO * DOWN)),
        **named([f"Motor:Speed:{corner}" for corner in corners], 20000 * SHARE),
        **named([f"Motor:PWM:{corner}" for corner in corners], 100 * SHARE),
        "Battery(0):totalVolts": np.full(ROWS, 24.1),
    }


def test_datcon_ticks_are_no_time_and_corners_are_numbered(tmp_path):
    path = written(tmp_path / "dji.csv", datcon_columns({"Clock:offsetTime": 319.7 + TIME}))
    proposal = propose_columns(path)
    assert proposal.questions == ()
    log = read_by(proposal, path)
    assert log.seconds == pytest.approx(TIME[-1])
    # PX4's order: front right, rear left, front left, rear right.
    speed = 20000 * SHARE[:, [0, 2, 1, 3]] * 2 * np.pi / 60
    np.testing.assert_allclose(log.channels["rotor_speed"].values, speed, rtol=1e-9)
    np.testing.assert_allclose(log.channels["command"].values, SHARE[:, [0, 2, 1, 3]], rtol=1e-9)
    assert log.channels["battery"].values[0, 0] == 24.1


def test_two_clocks_that_disagree_are_asked_about(tmp_path):
    clocks = {"time": TIME, "sample_time": 2.7 * TIME}
    columns = {**clocks, **named(("gx", "gy", "gz"), GYRO), **named(("ax", "ay", "az"), ACCEL)}
    columns |= named([f"rpm_{i}" for i in range(1, 5)], 5000 * SHARE)
    path = written(tmp_path / "two.csv", columns)
    asked = [q for q in propose_columns(path).questions if q.channel == "clock"]
    assert [q.choices for q in asked] == [("time", "sample_time")]
    answered = propose_columns(path, units={"clock": "sample_time"})
    assert answered.columns["time"].name == "sample_time"
    assert not [q for q in answered.questions if q.channel == "clock"]
    by_name = propose_columns(path, named={"time": "time"})
    assert by_name.columns["time"].name == "time"
    assert not [q for q in by_name.questions if q.channel == "clock"]
    # One clock in two units is no contradiction.
    columns["sample_time"] = 1e6 * TIME
    same = propose_columns(written(tmp_path / "same.csv", columns))
    assert not [q for q in same.questions if q.channel == "clock"]


@pytest.mark.parametrize("scale", [1.0, 1e6])
@pytest.mark.parametrize(("rate", "doubted"), [(1.03, True), (0.98, True), (1.001, False)])
def test_a_clock_that_runs_faster_is_doubted(tmp_path, rate, doubted, scale):
    """Its first rows come in a bunch, as those of a log that begins late."""
    other = scale * (5.0 + rate * TIME + 0.05 * np.minimum(TIME, 0.1))
    columns = {"t_board_s": TIME, "t_pc_us" if scale > 1 else "t_pc_s": other}
    columns |= {**named(("gx", "gy", "gz"), GYRO), **named(("ax", "ay", "az"), ACCEL)}
    columns |= named([f"rpm_{i}" for i in range(1, 5)], 5000 * SHARE)
    proposal = propose_columns(written(tmp_path / "two.csv", columns))
    assert proposal.columns["time"].name == "t_board_s"
    assert len(proposal.doubts) == doubted


@pytest.mark.parametrize(("factor", "doubted"), [(1.0, False), (180.0 / np.pi, True)])
def test_a_gyro_named_in_a_unit_too_large_is_doubted(tmp_path, factor, doubted):
    columns = {"time": TIME, **named([f"gyro_{a} [rad/s]" for a in "xyz"], factor * GYRO)}
    columns |= named(("ax", "ay", "az"), ACCEL)
    columns |= named([f"rpm_{i}" for i in range(1, 5)], 5000 * SHARE)
    proposal = propose_columns(written(tmp_path / "named.csv", columns))
    assert len(proposal.doubts) == doubted


def test_an_accelerometer_without_gravity_is_refused(tmp_path):
    columns = {"time": TIME, **named(("gx", "gy", "gz"), GYRO)}
    columns |= named(("lin_acc_x", "lin_acc_y", "lin_acc_z"), 2.0 * (ACCEL - [0.0, 0.0, G]))
    columns |= named([f"rpm_{i}" for i in range(1, 5)], 5000 * SHARE)
    with pytest.raises(LogError, match="record the accelerometer with gravity in it"):
        propose_columns(written(tmp_path / "linear.csv", columns))


@pytest.mark.parametrize(
    ("gyro", "accel", "motors", "order"),
    [
        (
            ("rate_p", "rate_q", "rate_r"),
            ("body_ax", "body_ay", "body_az"),
            ("n_fr", "n_rl", "n_fl", "n_rr"),
            [0, 1, 2, 3],
        ),
        (
            ("p", "q", "r"),
            ("acc_x", "acc_y", "acc_z"),
            ("rpm_front_left", "rpm_front_right", "rpm_rear_left", "rpm_rear_right"),
            [1, 2, 0, 3],
        ),
        (
            tuple(f"w_RS_S_{a} [rad s^-1]" for a in "xyz"),
            tuple(f"a_RS_S_{a} [m s^-2]" for a in "xyz"),
            tuple(f"motor_speed_{i}" for i in range(4)),
            [0, 1, 2, 3],
        ),
        (
            tuple(f"field.angular_velocity.{a}" for a in "xyz"),
            tuple(f"field.linear_acceleration.{a}" for a in "xyz"),
            tuple(f"field.angular_velocities{i}" for i in range(4)),
            [0, 1, 2, 3],
        ),
        (
            tuple(f"IMU.Gyr{a}" for a in "XYZ"),
            tuple(f"IMU.Acc{a}" for a in "XYZ"),
            tuple(f"RCOU.C{i}" for i in range(1, 5)),
            [0, 1, 2, 3],
        ),
        (
            tuple(f"{a}gyro" for a in "xyz"),
            tuple(f"{a}acc" for a in "xyz"),
            tuple(f"servo{i}_raw" for i in range(1, 5)),
            [0, 1, 2, 3],
        ),
        (
            tuple(f"omega_{a}" for a in "xyz"),
            ("ax", "ay", "az"),
            tuple(f"omega_{i}" for i in range(1, 5)),
            [0, 1, 2, 3],
        ),
        (("gx", "gy", "gz"), ("ax", "ay", "az"), ("w0", "w1", "w2", "w3"), [0, 1, 2, 3]),
    ],
)
def test_names_of_the_field_are_understood(tmp_path, gyro, accel, motors, order):
    columns = {"time": TIME, **named(gyro, GYRO), **named(accel, ACCEL)}
    columns |= named(motors, 1100 + 800 * SHARE)
    proposal = propose_columns(written(tmp_path / "own.csv", columns))
    stem = "rotor" if "rotor_1" in proposal.columns else "command"
    found = [proposal.columns[f"{stem}_{i}"].name for i in range(1, 5)]
    assert found == [motors[i] for i in order]
    assert [proposal.columns[f"gyro_{a}"].name for a in "xyz"] == list(gyro)
    assert [proposal.columns[f"accel_{a}"].name for a in "xyz"] == list(accel)


RADIO = "Date,Time,1RSS(dB),RxBt(V),GSpd(kmh),Rud,Ele,Thr,Ail"
AIRDATA = "time(millisecond),datetime(utc),latitude,longitude,pitch(degrees)"
QGC = "Timestamp,roll,pitch,rollRate,groundSpeed"


@pytest.mark.parametrize(
    ("header", "words"),
    [(RADIO, "EdgeTX"), (AIRDATA, "AirData"), (QGC, "QGroundControl")],
)
def test_tables_without_a_flight_of_use_are_named(tmp_path, header, words):
    path = tmp_path / "telemetry.csv"
    row = ",".join(["2024-05-01", "12:00:01.5", *["1"] * (header.count(",") - 1)])
    path.write_text("\n".join([header, *[row] * 20]))
    for read in (propose_columns, read_table):
        with pytest.raises(LogError, match=words):
            read(path)


@pytest.mark.parametrize(
    ("header", "original"),
    [
        ("timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],accelerometer_m_s2[0]", r"\.ulg itself"),
        (
            "Time,header.seq,header.stamp.secs,angular_velocity.x,angular_velocity.y",
            r"\.bag itself",
        ),
        ("timestamp,IMU.TimeUS,IMU.GyrX,IMU.GyrY,IMU.GyrZ", r"\.bin itself"),
        ("time (us),GPS_fixType,GPS_numSat,GPS_coord[0],GPS_altitude", "Blackbox file itself"),
    ],
)
def test_a_single_topic_says_which_file_to_take(tmp_path, header, original):
    rows = [",".join(f"{0.01 * i + 0.001 * j}" for j in range(5)) for i in range(30)]
    path = tmp_path / "topic.csv"
    path.write_text("\n".join([header, *rows]))
    with pytest.raises(LogError, match=original):
        propose_columns(path)


def test_every_exporter_has_marks_of_its_own():
    for exporter in EXPORTERS:
        for marks in exporter.marks:
            names = [mark.replace("*", "a") for mark in marks]
            assert exporter_of(names) is exporter
    assert exporter_of(["time", "gyro_x", "accel_x", "rotor_1"]) is None


@pytest.mark.parametrize("clock", ["__time", "timestamp"])
@pytest.mark.parametrize("prefix", ["/vehicle_angular_velocity/", "vehicle_angular_velocity."])
def test_rates_of_px4_by_topic_are_in_radians(tmp_path, clock, prefix):
    """Their names have no unit, and slow flights do not show it; the topic is always in rad/s."""
    accel = prefix.replace("angular_velocity", "acceleration")
    motors = prefix.replace("vehicle_angular_velocity", "actuator_motors")
    path = written(
        tmp_path / "joined.csv",
        {
            clock: TIME if clock == "__time" else np.round(1e6 * TIME),
            **named([f"{prefix}xyz[{i}]" for i in range(3)], GYRO * DOWN),
            **named([f"{accel}xyz[{i}]" for i in range(3)], ACCEL * DOWN),
            **named([f"{motors}control[{i}]" for i in range(4)], SHARE),
        },
    )
    proposal = propose_columns(path)
    assert not proposal.questions
    assert any("PX4" in reason for reason in proposal.reasons)
    np.testing.assert_allclose(read_by(proposal, path).channels["gyro"].values, GYRO, atol=1e-6)


def test_rates_of_a_crazyflie_beside_rotor_speeds_are_in_degrees(tmp_path):
    """Its names have no units, and rpm.m1 is in its tables as often as motor.m1."""
    path = written(
        tmp_path / "cfclient.csv",
        {
            "Timestamp": np.round(1e3 * TIME),
            **named([f"gyro.{axis}" for axis in "xyz"], np.degrees(GYRO)),
            **named([f"acc.{axis}" for axis in "xyz"], ACCEL / 9.80665),
            **named([f"rpm.m{i}" for i in range(1, 5)], np.round(20000.0 * np.sqrt(SHARE))),
        },
    )
    proposal = propose_columns(path)
    assert not [one for one in proposal.questions if one.channel == "gyro"]
    assert proposal.columns["gyro_x"].unit == "deg/s"
    assert proposal.columns["rotor_1"].unit == "rpm"
