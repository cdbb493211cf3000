"""ROS bags: written by the library rosbags from a simulated flight, read back; topics, clocks."""

import sqlite3
import subprocess
import sys

import numpy as np
import pytest
from refusals import error_of
from rosbag_writers import (
    EPOCH,
    LATE,
    Sent,
    messages_of,
    write_mcap,
    write_messages_ros1,
    write_messages_ros2,
    write_ros1,
    write_ros2,
)
from rosbags.rosbag2 import StoragePlugin

from rotorfit.logs import ColumnSpec, ReadOptions, read_log
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, variant

WRITERS = {"flight.bag": write_ros1, "bag": write_ros2, "mcap": write_mcap}
COUNT = 40


@pytest.fixture(scope="module")
def flight():
    return simulate_flight(*paper_vehicle("A"), Scenario(seconds=2.0), seed=3)


def sent(topic, kind, fields, *, count=COUNT, step=10_000_000, stamp=None, late=LATE):
    """Messages of one topic; fields and stamps are made from the number of the message."""
    for k in range(count):
        time = EPOCH + k * step
        own = time if stamp is None else stamp(k)
        yield Sent(topic, kind, own, time + late, fields(k))


def imu(topic="/imu/data", *, step=10_000_000, **options):
    def fields(k):
        rates = {"x": 0.1 * k, "y": -0.2, "z": 0.3}
        return {"angular_velocity": rates, "linear_acceleration": {"x": 0.0, "y": 0.5, "z": 9.8}}

    return sent(topic, "sensor_msgs/msg/Imu", fields, step=step, **options)


def read(tmp_path, *messages, options=None):
    path = tmp_path / "bag"
    write_messages_ros2([m for group in messages for m in group], path)
    return read_log(path, options=options)


def differences(log, flight):
    """List what of a bag is not as in the flight written: format, channels, times, warnings."""
    expected = {
        "gyro": flight.gyro,
        "accel": flight.accel,
        "rotor_speed": flight.rotor_speed_measured,
        "position": flight.position_measured,
        "attitude": flight.attitude_wxyz_measured,
    }
    found = [*({log.format} ^ {"rosbag"}), *(set(log.channels) ^ set(expected)), *log.warnings]
    for name in set(log.channels) & set(expected):
        channel = log.channels[name]
        rounded = 1e-15 if name == "attitude" else 0.0
        if not np.allclose(channel.values, expected[name], rtol=0.0, atol=rounded):
            found.append(name)
        if not np.allclose(channel.time - channel.time[0], flight.time, rtol=1e-7, atol=1e-9):
            found.append(f"time of {name}")
    return found


@pytest.mark.parametrize("name", WRITERS)
def test_a_flight_reads_back(tmp_path, flight, name, assert_wording):
    WRITERS[name](flight, tmp_path / name)
    log = read_log(tmp_path / name)
    assert differences(log, flight) == []
    # Received 3 ms later than stamped, and counted from the first message received.
    assert log.channels["gyro"].time[0] == pytest.approx(-0.003, abs=1e-9)
    assert log.metadata["started"] == "2023-11-14T22:13:20.003+00:00"
    assert "received 3.0 ms" in log.notes[0]
    assert_wording(log.notes[0])


@pytest.mark.parametrize("ending", ["db3", "mcap"])
def test_the_file_in_a_folder_is_read_too(tmp_path, flight, ending):
    (write_ros2 if ending == "db3" else write_mcap)(flight, tmp_path / "bag")
    assert differences(read_log(tmp_path / "bag" / f"bag.{ending}"), flight) == []


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_compressed_ros1_bags(tmp_path, flight, compression):
    path = tmp_path / "flight.bag"
    write_messages_ros1(messages_of(flight), path, compression=compression)
    assert differences(read_log(path), flight) == []


@pytest.mark.parametrize(
    ("compression", "storage"),
    [
        ("message", StoragePlugin.SQLITE3),
        ("message", StoragePlugin.MCAP),
        ("storage", StoragePlugin.MCAP),
    ],
)
def test_compressed_ros2_bags(tmp_path, flight, compression, storage):
    path = tmp_path / "bag"
    write_messages_ros2(messages_of(flight), path, storage=storage, compression=compression)
    assert differences(read_log(path), flight) == []


def test_a_bag_compressed_as_a_whole_is_to_be_unpacked(tmp_path, assert_text):
    path = tmp_path / "bag"
    write_messages_ros2(imu(), path, compression="file")
    assert_text(error_of(path))
    words = error_of(path / "bag.db3.zstd")
    assert "looks like a zstd archive" in words and "unpack it first" in words


def told_by(code, *arguments):
    """What a new process prints."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


READ = """
import sys
from pathlib import Path
from rotorfit.errors import LogError
from rotorfit.logs import read_log
for name in sys.argv[1:]:
    try:
        print(sorted(read_log(Path(name)).channels))
    except LogError as error:
        print(str(error).removeprefix(f"{name}: "), type(error.__cause__).__name__)
"""


def test_without_rosbags_the_command_to_install_it_is_said(tmp_path, flight):
    for name, write in WRITERS.items():
        write(flight, tmp_path / name)
    without = "import sys; sys.modules['rosbags'] = None\n"
    said = told_by(without + READ, *(tmp_path / name for name in WRITERS)).splitlines()
    needed = "reading ROS bags needs rosbags: pip install 'rotorfit[ros]' ModuleNotFoundError"
    assert said == 3 * [needed]


def test_rosbags_is_imported_for_bags_only(tmp_path):
    path = tmp_path / "flight.csv"
    path.write_text("time,battery\n0,15\n0.1,15\n0.2,14\n")
    code = READ + "print([name for name in sys.modules if name.startswith('rosbags')])"
    assert told_by(code, path) == "['battery']\n[]\n"
    for arguments in (["-c", "import rotorfit"], ["-m", "rotorfit", "--help"]):
        command = [sys.executable, "-X", "importtime", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert " rotorfit\n" in done.stderr
        assert "rosbags" not in done.stderr


def test_a_bag_in_several_files_is_one_log(tmp_path):
    whole = list(imu(count=40))
    for number, part in ((0, whole[:10]), (2, whole[10:20]), (10, whole[20:])):
        write_messages_ros2(part, tmp_path / f"bag_{number}")
        folder = tmp_path / "all"
        folder.mkdir(exist_ok=True)
        (tmp_path / f"bag_{number}" / f"bag_{number}.db3").rename(folder / f"bag_{number}.db3")
    log = read_log(tmp_path / "all")
    np.testing.assert_allclose(log.channels["gyro"].values[:, 0], 0.1 * np.arange(40))


def test_a_folder_without_a_bag_stays_a_folder(tmp_path, assert_wording):
    assert_wording(error_of(tmp_path))


@pytest.mark.parametrize("name", ["flight.bag", "mcap"])
def test_a_recording_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path, flight, name):
    WRITERS[name](flight, tmp_path / name)
    path = tmp_path / name if name.endswith("bag") else tmp_path / name / f"{name}.mcap"
    data = path.read_bytes()
    cut = tmp_path / "cut"
    cut.write_bytes(data[: int(0.4 * len(data))])
    log = read_log(cut)
    samples = len(log.channels["gyro"].time)
    assert 20 < samples < 400
    np.testing.assert_array_equal(log.channels["gyro"].values, flight.gyro[:samples])
    assert any("cut off" in warning for warning in log.warnings)


# Messages


def px4(tmp_path, *, defined):
    """A PX4 recording: FRD, times since power-on in microseconds."""

    def sensors(k):
        return {
            "timestamp": 5_000_000 + 10_000 * k,
            "gyro_rad": [0.1 * k, 0.2, 0.3],
            "accelerometer_m_s2": [0.0, 0.5, -9.8],
        }

    def motors(k):
        control = [0.5, 0.25, 0.01 * k, float("nan"), *[float("nan")] * 8]
        time = 5_000_000 + 10_000 * k
        return {"timestamp": time + 400, "timestamp_sample": time, "control": control}

    def escs(k):
        esc = [{"esc_rpm": sign * (6000 + k)} for sign in (1, 1, -1, -1)]
        return {"timestamp": 5_000_000 + 10_000 * k, "esc_count": 4, "esc": esc}

    def odometry(k):
        pose = {"position": [1.0, 2.0, -3.0 - k], "q": [0.8, 0.0, 0.0, 0.6]}
        return {"timestamp": 0, "timestamp_sample": 5_000_000 + 10_000 * k, **pose}

    path = tmp_path / "bag"
    messages = [
        *sent("/fmu/out/sensor_combined", "px4_msgs/msg/SensorCombined", sensors),
        *sent("/fmu/out/actuator_motors", "px4_msgs/msg/ActuatorMotors", motors, late=2 * LATE),
        *sent("/fmu/out/esc_status", "px4_msgs/msg/EscStatus", escs),
        *sent("/fmu/out/vehicle_odometry", "px4_msgs/msg/VehicleOdometry", odometry),
    ]
    write_messages_ros2(messages, path)
    if not defined:
        with sqlite3.connect(path / "bag.db3") as database:
            database.execute("DROP TABLE message_definitions")
    return read_log(path)


@pytest.mark.parametrize("defined", [True, False])
def test_messages_of_px4_are_turned_to_flu(tmp_path, defined, assert_wording):
    log = px4(tmp_path, defined=defined)
    gyro = log.channels["gyro"]
    np.testing.assert_allclose(gyro.values[3], [0.3, -0.2, -0.3], rtol=1e-6)
    np.testing.assert_allclose(log.channels["accel"].values[0], [0, -0.5, 9.8], rtol=1e-6)
    np.testing.assert_allclose(log.channels["command"].values[10], [0.5, 0.25, 0.1], rtol=1e-6)
    speed = log.channels["rotor_speed"].values
    np.testing.assert_allclose(speed[5], 4 * [6005 * 2 * np.pi / 60])
    np.testing.assert_allclose(log.channels["position"].values[2], [1, -2, 5])
    np.testing.assert_allclose(log.channels["attitude"].values[0], [0.8, 0, 0, -0.6], rtol=1e-6)
    # All four are on the autopilot's clock, moved by the delay of the fastest.
    for name in ("gyro", "command", "rotor_speed", "position"):
        np.testing.assert_allclose(log.channels[name].time, 0.01 * np.arange(40), atol=1e-6)
    assert_wording(" ".join(log.notes))
    assert log.warnings == ()


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE message_definitions SET encoding = 'unknown', encoded_message_definition = ''",
        f"UPDATE topics SET offered_qos_profiles = '{'[' * 300_000}'",
        "UPDATE topics SET offered_qos_profiles = '- history: 3'",
        "DROP TABLE schema",
    ],
)
def test_what_rosbags_fails_on_in_a_database_is_not_needed(tmp_path, change):
    write_messages_ros2(imu(), tmp_path / "bag")
    with sqlite3.connect(tmp_path / "bag" / "bag.db3") as database:
        database.execute(change)
    gyro = read_log(tmp_path / "bag").channels["gyro"]
    np.testing.assert_array_equal(gyro.values[:, 0], 0.1 * np.arange(COUNT))


def test_messages_of_mavros(tmp_path, assert_wording):
    def pulses(k):
        return {"channels": [1000 + 10 * k, 1500, 1900 - k, 1100 + k, 1200 + k, 0, 0, 0]}

    def rpm(k):
        return {"esc_status": [{"rpm": 6000 + k}, {"rpm": 6100}, {"rpm": -6200}, {"rpm": 6300}]}

    log = read(
        tmp_path,
        imu("/mavros/imu/data_raw"),
        sent("/mavros/rc/out", "mavros_msgs/msg/RCOut", pulses),
        sent("/mavros/esc_status", "mavros_msgs/msg/ESCStatus", rpm),
        sent("/mavros/actuator", "mavros_msgs/msg/ActuatorControl", lambda k: {}),
        sent("/mavros/battery", "sensor_msgs/msg/BatteryState", lambda k: {"voltage": 15.5}),
    )
    command = log.channels["command"]
    np.testing.assert_allclose(command.values[10], [0.1, 0.89, 0.11, 0.21])
    assert "outputs 1, 3, 4," in command.source
    assert "5, pulse" in command.source
    assert "from 1000 to 2000" in command.source
    assert_wording(command.source)
    np.testing.assert_allclose(
        log.channels["rotor_speed"].values[1], np.array([6001, 6100, 6200, 6300]) * 2 * np.pi / 60
    )
    np.testing.assert_allclose(log.channels["battery"].values, 15.5)
    assert any("before the mixer" in note and "/mavros/actuator" in note for note in log.notes)


def test_set_points_are_taken_last_and_said(tmp_path, assert_wording):
    speeds = {"angular_velocities": [400.0, 401.0, 402.0, 403.0]}
    kind = "mav_msgs/msg/Actuators"
    aim = sent("/quad/command/motor_speed", kind, lambda k: speeds, step=1_000_000)
    log = read(tmp_path, imu(), aim)
    assert_wording(log.warnings[0])
    (tmp_path / "other").mkdir()
    aim = sent("/quad/command/motor_speed", kind, lambda k: speeds, step=1_000_000)
    measured = sent("/quad/motor_speed", kind, lambda k: speeds)
    log = read(tmp_path / "other", imu(), aim, measured)
    assert log.channels["rotor_speed"].source.startswith("/quad/motor_speed ")
    assert log.warnings == ()


def test_a_set_point_is_no_measured_pose(tmp_path):
    kind = "geometry_msgs/msg/PoseStamped"
    aim = sent(
        "/mavros/setpoint_raw/target_attitude",
        kind,
        lambda k: {"pose": {"position": {"z": 1.0}, "orientation": {"w": 1.0}}},
    )
    log = read(tmp_path, imu(), aim)
    assert set(log.channels) == {"gyro", "accel"}
    [note] = [words for words in log.notes if words.startswith("no attitude")]
    assert "/mavros/setpoint_raw/target_attitude is a set-point" in note
    asked = ReadOptions(
        columns={"attitude": ColumnSpec(name="/mavros/setpoint_raw/target_attitude")}
    )
    assert "attitude" in read_log(tmp_path / "bag", options=asked).channels


def test_an_imu_without_orientation_gives_none(tmp_path):
    assert set(read(tmp_path, imu()).channels) == {"gyro", "accel"}


def test_messages_of_the_recorder_are_frd_where_it_is_declared(tmp_path):
    log = read(tmp_path, imu(), options=ReadOptions(axes="FRD"))
    np.testing.assert_allclose(log.channels["accel"].values[0], [0, -0.5, -9.8])


# Which topic, which clock


def test_the_fastest_imu_is_taken_and_the_others_are_named(tmp_path, assert_text):
    log = read(tmp_path, imu("/slow", step=20_000_000), imu("/fast", step=5_000_000))
    assert log.channels["gyro"].source.startswith("/fast (sensor_msgs/Imu)")
    assert log.channels["accel"].source == log.channels["gyro"].source
    assert_text(log.notes[0])
    chosen = ReadOptions(columns={"gyro": ColumnSpec(name="/slow")})
    log = read_log(tmp_path / "bag", options=chosen)
    for name in ("gyro", "accel"):
        assert log.channels[name].source.startswith("/slow")
    other = ReadOptions(columns={"gyro": ColumnSpec(name="/imu")})
    assert_text(error_of(tmp_path / "bag", options=other))


def test_cameras_come_before_estimates(tmp_path):
    def pose(z):
        return lambda k: {"pose": {"position": {"z": z}, "orientation": {"w": 1.0}}}

    kind = "geometry_msgs/msg/PoseStamped"
    log = read(
        tmp_path,
        imu(),
        sent("/mavros/setpoint_position/local", kind, pose(1.0), step=1_000_000),
        sent("/mavros/local_position/pose", kind, pose(2.0), step=2_000_000),
        sent("/vrpn_client_node/quad/pose", kind, pose(3.0)),
    )
    np.testing.assert_array_equal(log.channels["position"].values[:, 2], 3.0)
    assert log.channels["attitude"].source.startswith("/vrpn_client_node")


@pytest.mark.parametrize(
    ("stamp", "why"),
    [
        (lambda k: 0, "its stamps are zero"),
        (lambda k: EPOCH + (k % 5) * 10_000_000, "its stamps go back"),
        (lambda k: EPOCH + (k // 10) * 10_000_000, "its stamps repeat"),
        (lambda k: EPOCH + 10**12 + k * 200_000_000, "its stamps belong to no steady clock"),
    ],
)
def test_unbelievable_stamps_give_way_to_times_of_receipt(tmp_path, stamp, why):
    log = read(tmp_path, imu(stamp=stamp))
    np.testing.assert_allclose(log.channels["gyro"].time, 0.01 * np.arange(40), atol=1e-9)
    assert f"times of receipt: {why}." in log.notes[0]


def test_jitter_of_receipt_does_not_reach_the_clock(tmp_path):
    rng = np.random.default_rng(1)
    messages = [
        Sent(m.topic, m.kind, m.stamp, m.stamp + int(4e6 * rng.exponential()), m.fields)
        for m in imu()
    ]
    log = read(tmp_path, messages)
    np.testing.assert_allclose(np.diff(log.channels["gyro"].time), 0.01, atol=1e-9)


# The columns map


def test_numbers_of_other_messages_are_named_by_topic_and_path(tmp_path):
    def numbers(k):
        return {"data": np.array([60.0 * k, 600.0, 1.5], dtype=np.float32)}

    columns = {
        f"rotor_{i + 1}": ColumnSpec(name=f"/motors.data[{i}]", unit="rpm") for i in range(2)
    }
    columns["battery"] = ColumnSpec(name="/motors.data[2]", scale=10.0)
    log = read(
        tmp_path,
        imu(),
        sent("/motors", "std_msgs/msg/Float32MultiArray", numbers),
        options=ReadOptions(columns=columns),
    )
    speed = log.channels["rotor_speed"]
    np.testing.assert_allclose(speed.values[3], [3 * 2 * np.pi, 20 * np.pi])
    assert speed.source == "/motors.data[0], /motors.data[1] (columns map)"
    np.testing.assert_allclose(log.channels["battery"].values, 15.0)
    assert set(log.channels) == {"gyro", "accel", "rotor_speed", "battery"}
    unread = read_log(tmp_path / "bag")
    assert any("numbers without names" in note for note in unread.notes)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"rotor_1": "/imu/data.nothing"}, "no topic has all of '/imu/data.nothing'"),
        ({"rotor_1": "/none.data"}, "no topic has all of '/none.data', which the columns map"),
        ({"speed": "/imu/data.x"}, "the columns map names 'speed'; for a ROS recording it names"),
        (
            {"gyro_x": "/imu/data.angular_velocity.x"},
            "column 'gyro_y' is missing next to gyro_x",
        ),
    ],
)
def test_a_wrong_map_is_refused(tmp_path, columns, message):
    write_messages_ros2(imu(), tmp_path / "bag")
    specs = {name: ColumnSpec(name=path) for name, path in columns.items()}
    assert message in error_of(tmp_path / "bag", options=ReadOptions(columns=specs))


# Refusals


def test_a_bag_without_known_messages_lists_its_topics(tmp_path, assert_text):
    path = tmp_path / "bag"
    write_messages_ros2(sent("/rosout", "std_msgs/msg/String", lambda k: {"data": "a"}), path)
    assert_text(error_of(path))


def test_another_database_is_no_bag(tmp_path, assert_text):
    path = tmp_path / "other.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE topics (id INTEGER)")
    assert_text(error_of(path))


def test_a_view_in_place_of_messages_is_refused(tmp_path, assert_wording):
    """A view may compute for ever."""
    path = tmp_path / "other.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE topics (id, name, type, serialization_format)")
        database.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(i) AS "
            "(SELECT 1 UNION ALL SELECT i + 1 FROM n) "
            "SELECT i AS topic_id, i AS timestamp, x'00' AS data FROM n"
        )
    assert_wording(error_of(path))


def test_an_old_bag_is_refused(tmp_path, assert_text):
    path = tmp_path / "old.bag"
    path.write_bytes(b"#ROSBAG V1.2\n" + bytes(40))
    assert_text(error_of(path))


def test_an_output_that_the_vehicle_does_not_follow_is_left_out(tmp_path, assert_wording):
    """The airframe's map names the motors where that is wrong."""
    flown = simulate_flight(
        *variant(paper_vehicle("A"), "clean")[0], Scenario(seconds=12.0), seed=5
    )
    count = len(flown.time)

    def pulses(k):
        servo = 1500 + 300 * np.sin(1.9 * flown.time[k])
        return {"channels": [*(1000 + 1000 * flown.command[k]).round().astype(int), int(servo)]}

    def moving(k):
        gyro, accel = flown.gyro[k], flown.accel[k]
        return {
            "angular_velocity": dict(zip("xyz", gyro.tolist(), strict=True)),
            "linear_acceleration": dict(zip("xyz", accel.tolist(), strict=True)),
        }

    step = round(1e9 * float(flown.time[1] - flown.time[0]))
    log = read(
        tmp_path,
        sent("/imu", "sensor_msgs/msg/Imu", moving, count=count, step=step),
        sent("/mavros/rc/out", "mavros_msgs/msg/RCOut", pulses, count=count, step=step),
    )
    assert log.channels["command"].values.shape[1] == 4
    assert "outputs 1, 2, 3, 4," in log.channels["command"].source
    [note] = [note for note in log.notes if "Output 5" in note]
    assert '{ command_1 = "/mavros/rc/out.channels[0]"' in note
    assert_wording(note)
