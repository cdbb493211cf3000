"""Which topics of a bag belong together: one vehicle, the rawest IMU, and one clock."""

import numpy as np
import pytest
from rosbag_writers import DEFINITIONS, EPOCH, LATE, Sent, write_messages_ros2

from rotorfit.errors import LogError
from rotorfit.logs import ColumnSpec, ReadOptions, read_log
from rotorfit.logs.flight_log import other_columns

COUNT = 40
MORE = {
    "actuator_msgs/msg/Actuators": (
        "std_msgs/Header header\nfloat64[] position\nfloat64[] velocity\nfloat64[] normalized\n"
    ),
    "px4_msgs/msg/VehicleAngularVelocity": (
        "uint64 timestamp\nuint64 timestamp_sample\nfloat32[3] xyz\nfloat32[3] xyz_derivative\n"
    ),
    "px4_msgs/msg/VehicleAcceleration": (
        "uint64 timestamp\nuint64 timestamp_sample\nfloat32[3] xyz\n"
    ),
    "px4_msgs/msg/SensorGyro": (
        "uint64 timestamp\nuint64 timestamp_sample\nuint32 device_id\nfloat32 x\nfloat32 y\n"
        "float32 z\nfloat32 temperature\nuint32 error_count\nuint8[3] clip_counter\n"
        "uint8 samples\n"
    ),
    "kingfisher_msgs/msg/MotorSpeed": "std_msgs/Header header\nfloat64[] angular_velocities\n",
}


def sent(topic, kind, fields, *, step=10_000_000, stamped=True):
    """Messages of one topic, all with the same fields."""
    for k in range(COUNT):
        time = EPOCH + k * step
        yield Sent(topic, kind, time if stamped else 0, time + LATE, fields)


def imu(topic, *, rate_x=0.1, **options):
    rates = {"x": rate_x, "y": -0.2, "z": 0.3}
    fields = {"angular_velocity": rates, "linear_acceleration": {"x": 0.0, "y": 0.5, "z": 9.8}}
    return sent(topic, "sensor_msgs/msg/Imu", fields, **options)


def escs(topic, rpm=6000, **options):
    fields = {"esc_status": [{"rpm": rpm}] * 4}
    return sent(topic, "mavros_msgs/msg/ESCStatus", fields, **options)


@pytest.fixture
def read(tmp_path, monkeypatch):
    """Return a function that writes messages as a bag and reads it."""
    for name, text in MORE.items():
        monkeypatch.setitem(DEFINITIONS, name, text)

    def written(*groups, columns=None):
        path = tmp_path / f"bag{len(list(tmp_path.iterdir()))}"
        write_messages_ros2([m for group in groups for m in group], path)
        specs = {name: ColumnSpec(name=topic) for name, topic in (columns or {}).items()}
        return read_log(path, options=ReadOptions(columns=specs))

    return written


def topics_of(log):
    return {name: channel.source.split(" ")[0] for name, channel in log.channels.items()}


def swarm():
    """The IMU of the first is faster, and so are the speeds of the second."""
    return (
        *imu("/uav1/mavros/imu/data", step=5_000_000),
        *escs("/uav1/mavros/esc_status", step=10_000_000),
        *imu("/uav2/mavros/imu/data", step=10_000_000),
        *escs("/uav2/mavros/esc_status", step=5_000_000),
    )


def test_imu_and_motors_are_of_one_vehicle(read, assert_wording):
    log = read(swarm())
    assert topics_of(log)["gyro"] == "/uav1/mavros/imu/data"
    assert topics_of(log)["rotor_speed"] == "/uav1/mavros/esc_status"
    [doubt] = [one for one in log.findings if one.kind == "several-vehicles"]
    assert_wording(doubt.sentence)


def test_a_topic_that_is_named_says_the_vehicle(read):
    log = read(swarm(), columns={"gyro": "/uav2/mavros/imu/data"})
    assert topics_of(log)["rotor_speed"] == "/uav2/mavros/esc_status"
    assert [one.kind for one in log.findings] == []


def test_the_vehicle_is_the_one_whose_motors_are_recorded(read):
    one = imu("/uav1/imu", step=5_000_000), imu("/uav2/imu"), escs("/uav2/esc")
    assert topics_of(read(*one))["gyro"] == "/uav2/imu"


def test_two_imus_of_one_vehicle_are_no_swarm(read):
    log = read(imu("/mavros/imu/data"), imu("/imu", step=5_000_000), escs("/mavros/esc_status"))
    assert topics_of(log)["gyro"] == "/imu"
    assert topics_of(log)["rotor_speed"] == "/mavros/esc_status"
    assert [one.kind for one in log.findings] == []


@pytest.mark.parametrize(
    ("topics", "taken"),
    [
        ({"/mavros/imu/data": 5, "/mavros/imu/data_raw": 5}, "/mavros/imu/data_raw"),
        ({"/mavros/imu/data": 5, "/mavros/imu/data_raw": 20}, "/mavros/imu/data"),
        ({"/camera/imu": 3, "/mavros/imu/data": 5}, "/mavros/imu/data"),
    ],
)
def test_the_raw_imu_of_the_vehicle_is_taken(read, topics, taken):
    """Of a camera's IMU the axes are the camera's."""
    log = read(*(imu(name, step=step * 1_000_000) for name, step in topics.items()))
    assert topics_of(log)["gyro"] == topics_of(log)["accel"] == taken


@pytest.mark.parametrize(
    ("stamped", "kinds"), [((True, True), []), ((False, False), []), ((True, False), 1)]
)
def test_times_of_two_kinds_are_said(read, assert_wording, stamped, kinds):
    """A delay of 3 ms by the network was `identified` as that of the motors."""
    of_imu, of_motors = stamped
    log = read(imu("/imu", stamped=of_imu), escs("/esc", stamped=of_motors))
    found = [one for one in log.findings if one.kind == "unlike-clocks"]
    assert len(found) == (kinds or 0)
    if found:
        assert_wording(found[0].sentence)


def test_more_messages_of_px4_and_gazebo(read):
    xyz = {"timestamp": 5_000_000, "timestamp_sample": 5_000_000, "xyz": [0.1, 0.2, -9.0]}
    one = {"timestamp": 5_000_000, "timestamp_sample": 5_000_000, "x": 0.1, "y": 0.2, "z": 0.3}
    speeds = {"velocity": [400.0, -401.0, 402.0, -403.0]}
    split = read(
        sent("/fmu/out/vehicle_angular_velocity", "px4_msgs/msg/VehicleAngularVelocity", xyz),
        sent("/fmu/out/vehicle_acceleration", "px4_msgs/msg/VehicleAcceleration", xyz),
        sent("/motor_speed", "actuator_msgs/msg/Actuators", speeds),
    )
    np.testing.assert_allclose(split.channels["gyro"].values[0], [0.1, -0.2, 9.0], rtol=1e-6)
    np.testing.assert_allclose(split.channels["accel"].values[0], [0.1, -0.2, 9.0], rtol=1e-6)
    assert split.channels["rotor_speed"].values[0].tolist() == [400.0, 401.0, 402.0, 403.0]
    alone = read(sent("/fmu/out/sensor_gyro", "px4_msgs/msg/SensorGyro", one))
    np.testing.assert_allclose(alone.channels["gyro"].values[0], [0.1, -0.2, -0.3], rtol=1e-6)


def test_unknown_topics_are_named_where_motors_are_missing(read, assert_wording):
    speeds = {"angular_velocities": [400.0] * 4}
    log = read(imu("/imu"), sent("/kf/motor_speed", "kingfisher_msgs/msg/MotorSpeed", speeds))
    assert "/kf/motor_speed (kingfisher_msgs/MotorSpeed)" in other_columns(log)
    assert_wording(other_columns(log))


def test_a_channel_that_no_topic_gives_is_refused(read):
    with pytest.raises(LogError, match="/uav3/imu"):
        read(swarm(), columns={"gyro": "/uav3/imu"})
