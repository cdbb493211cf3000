"""What a ULog becomes: channels, notes, metadata."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ulog_encoder import (
    BOOT,
    FLIP,
    Logged,
    Parts,
    actuator_motors,
    actuator_outputs,
    armed,
    encode,
    esc_status,
    geometry,
    landed,
    mocap,
    sensor_combined,
    write_ulog,
)

from flown import experiment_file, quietly_identified, simulated, simulated_vehicle
from rotorfit.errors import LogError
from rotorfit.logs import ColumnSpec, ReadOptions, read_log
from rotorfit.logs.ulog import is_ulog
from rotorfit.logs.ulog.read import read_ulog
from rotorfit.simulation import write_flight_table

N = 200
TIME = 100.0 + 0.004 * np.arange(N)
RNG = np.random.default_rng(1)
GYRO = RNG.normal(size=(N, 3))
ACCEL = RNG.normal(size=(N, 3)) + np.array([0.0, 0.0, 9.8])
IMU = sensor_combined(TIME, GYRO, ACCEL)
QUAD = {
    "CA_ROTOR_COUNT": 4,
    **{
        f"CA_ROTOR{i}_{key}": value
        for i, (x, y, km) in enumerate(
            [(0.15, 0.2, 0.05), (-0.15, -0.2, 0.05), (0.15, -0.2, -0.05), (-0.15, 0.2, -0.05)]
        )
        for key, value in (("PX", x), ("PY", y), ("PZ", 0.0), ("KM", km))
    },
}
VECTORS = "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;"
VEHICLE_IMU = (
    "uint64_t timestamp;uint64_t timestamp_sample;uint32_t accel_device_id;uint32_t gyro_device_id;"
    "float[3] delta_angle;float[3] delta_velocity;uint32_t delta_angle_dt;"
    "uint32_t delta_velocity_dt;"
)
FIFO = (
    "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float dt;float scale;"
    "uint8_t samples;int16_t[32] x;int16_t[32] y;int16_t[32] z;"
)


def read(tmp_path, *topics, **parts):
    path = tmp_path / "log.ulg"
    path.write_bytes(encode([*topics], Parts(**parts), start=99.0))
    return read_log(path)


def noted(log, words):
    return [note for note in (*log.notes, *log.warnings) if words in note]


# A whole flight


def test_a_simulated_flight_comes_back(tmp_path):
    flight = simulated("hexa-x", "noisy", seed=3, seconds=4.0)
    write_ulog(flight, tmp_path / "log.ulg")
    log = read_log(tmp_path / "log.ulg")
    assert (log.format, log.warnings) == ("ulog", ())
    assert log.seconds == pytest.approx(flight.time[-1])
    expected = {
        "gyro": flight.gyro,
        "accel": flight.accel,
        "rotor_speed": flight.rotor_speed_measured,
        "command": flight.command,
        "velocity": flight.velocity_body,
        "position": flight.position_measured,
        "attitude": flight.attitude_wxyz_measured,
    }
    step = 2 * np.pi / 60
    for name, values in expected.items():
        channel = log.channels[name]
        atol = 0.51 * step if name == "rotor_speed" else 2e-6
        np.testing.assert_allclose(channel.values, values, rtol=3e-6, atol=atol, err_msg=name)
        clock = flight.pose_time if name in ("position", "attitude") else flight.time
        np.testing.assert_allclose(channel.time, BOOT + clock, rtol=0, atol=0.6e-6)
    assert log.channels["battery"].values[0] == pytest.approx(15.8)
    assert log.channels["rotor_speed"].resolution == pytest.approx(step)


def test_the_geometry_comes_back(tmp_path):
    for name in ("quad-x", "hexa-tilted"):
        vehicle = simulated_vehicle(name).vehicle
        log = read(tmp_path, IMU, parameters={**geometry(vehicle), "SYS_AUTOSTART": 4050})
        assert log.metadata["airframe is"] == "set"
        numbers = [float(v) for v in re.findall(r"-?\d+\.\d+(?:e-\d+)?", log.metadata["airframe"])]
        spins = re.findall(r'spin = "(c?cw)"', log.metadata["airframe"])
        assert spins == [rotor.spin for rotor in vehicle.rotors]
        tilted = name == "hexa-tilted"
        parts = [v for r in vehicle.rotors for v in (r.position + r.axis * tilted)]
        np.testing.assert_allclose(numbers, parts, atol=1e-7)
        assert noted(log, "Rotor geometry by CA_ROTOR*")


def test_geometry_is_ready_for_an_experiment_file(tmp_path, assert_text):
    log = read(tmp_path, IMU, parameters={**QUAD, "SYS_AUTOSTART": 4050})
    assert_text(log.metadata["airframe"])


def test_a_rotor_below_the_origin_is_below_it(tmp_path):
    log = read(tmp_path, IMU, parameters={**QUAD, "CA_ROTOR0_PZ": 0.05, "CA_ROTOR1_PZ": -0.03})
    places = re.findall(r"position = \[(.*?)\]", log.metadata["airframe"])
    heights = [float(place.split(", ")[2]) for place in places]
    assert heights == pytest.approx([-0.05, 0.03, 0.0, 0.0])


@pytest.mark.parametrize(
    ("parts", "template"),
    [
        ({"parameters": {**QUAD, "SYS_AUTOSTART": 4001}}, False),  # the log tells no defaults
        ({"parameters": {**QUAD, "SYS_AUTOSTART": 4001}, "system_defaults": {"X": 1}}, True),
        (
            {
                "parameters": {**QUAD, "SYS_AUTOSTART": 4001},
                "airframe_defaults": {"CA_ROTOR0_PX": 1.0},
            },
            False,
        ),
        ({"parameters": {**QUAD, "SYS_AUTOSTART": 4052}, "system_defaults": {"X": 1}}, False),
        (
            {
                "parameters": {
                    k: float(np.sign(v)) if k[-2:] in ("PX", "PY") else v for k, v in QUAD.items()
                }
            },
            True,
        ),
        # Directions on a circle of 1.
        (
            {"parameters": {k: 4.0 * v if k[-2:] in ("PX", "PY") else v for k, v in QUAD.items()}},
            True,
        ),
    ],
)
def test_default_geometry_is_said(tmp_path, parts, template):
    log = read(tmp_path, IMU, **parts)
    assert log.metadata["airframe is"] == ("default" if template else "set")
    assert bool(noted(log, "default geometry")) == template
    assert bool(noted(log, "measure your arms")) == template


def test_a_log_without_geometry_asks_for_it(tmp_path, assert_wording):
    for parameters in ({}, {"CA_ROTOR_COUNT": 4}, {**QUAD, "CA_ROTOR3_PX": float("nan")}):
        log = read(tmp_path, IMU, parameters=parameters)
        assert "airframe" not in log.metadata
        assert noted(log, "no rotor geometry")
        assert_wording((*log.notes, *log.warnings))


def test_versions_and_settings(tmp_path):
    info = {"ver_sw_release": 0x010F03FF, "ver_hw": "PX4_FMU_V6C", "ver_sw": "abc"}
    log = read(tmp_path, IMU, info=info, parameters={"SYS_AUTOSTART": 4001, "MOT_POLE_COUNT": 14})
    assert log.metadata["Firmware revision"] == "PX4 1.15.3"
    assert (log.metadata["Board"], log.metadata["SYS_AUTOSTART"]) == ("PX4_FMU_V6C", "4001")
    log = read(tmp_path, IMU, info={"ver_sw_release": 0x01100080})
    assert log.metadata["Firmware revision"] == "PX4 1.16.0 beta"


@pytest.mark.parametrize(("timer", "pwm"), [(400, True), (-1, True), (-4, False), (None, False)])
def test_motors_on_pwm_outputs_are_told(tmp_path, timer, pwm):
    wired = {f"PWM_MAIN_FUNC{i}": 100 + i for i in range(1, 5)}
    timers = {} if timer is None else {"PWM_MAIN_TIM0": timer, "PWM_AUX_TIM0": 400}
    log = read(tmp_path, IMU, parameters=wired | timers)
    assert (log.metadata.get("motor outputs") == "PWM") is pwm


# Sensors


def test_acceleration_has_a_time_of_its_own(tmp_path):
    relative = np.where(np.arange(N) % 10 == 3, 0x7FFFFFFF, -1500)
    log = read(tmp_path, sensor_combined(TIME, GYRO, ACCEL, relative=relative))
    accel, there = log.channels["accel"], np.arange(N) % 10 != 3
    np.testing.assert_allclose(accel.time, TIME[there] - 0.0015, atol=1e-6)
    np.testing.assert_allclose(accel.values, ACCEL[there], rtol=1e-6)
    assert len(log.channels["gyro"].time) == N


def vehicle_imu(instance=0, *, device=7, rate=250.0, gyro=GYRO):
    time = TIME[0] + np.arange(N) / rate
    fields = {
        "timestamp_sample": np.round(1e6 * (time - 0.001)),
        "gyro_device_id": device,
        "delta_angle": gyro * FLIP * 0.004,
        "delta_velocity": ACCEL * FLIP * 0.005,
        "delta_angle_dt": 4000,
        "delta_velocity_dt": 5000,
    }
    return Logged(
        name="vehicle_imu", time=time, fields=fields, instance=instance, format=VEHICLE_IMU
    )


def controller_signals(rate):
    time = TIME[0] + np.arange(N) / rate
    sampled = np.round(1e6 * (time - 0.002))
    return [
        Logged(
            name=name,
            time=time,
            fields={"timestamp_sample": sampled, "xyz": values * FLIP},
            format=VECTORS,
        )
        for name, values in (("vehicle_angular_velocity", GYRO), ("vehicle_acceleration", ACCEL))
    ]


def test_mean_rates_where_there_is_no_sensor_combined(tmp_path):
    log = read(tmp_path, vehicle_imu())
    gyro, accel = log.channels["gyro"], log.channels["accel"]
    np.testing.assert_allclose(gyro.values, GYRO, rtol=1e-6)
    np.testing.assert_allclose(accel.values, ACCEL, rtol=1e-6)
    np.testing.assert_allclose(gyro.time, TIME - 0.001, atol=1e-6)
    assert "delta_angle over delta_angle_dt" in gyro.source
    assert noted(log, "means from vehicle_imu")


def test_each_mean_is_over_its_own_time(tmp_path):
    spans, topic = np.where(np.arange(N) % 7 == 0, 8000, 4000), vehicle_imu()
    angles = GYRO * FLIP * 1e-6 * spans[:, None]
    fields = {**topic.fields, "delta_angle": angles, "delta_angle_dt": spans}
    gyro = read(tmp_path, replace(topic, fields=fields)).channels["gyro"]
    np.testing.assert_allclose(gyro.values, GYRO, rtol=1e-6)


def test_the_sensor_that_flew_is_taken(tmp_path):
    chosen = Logged(
        name="sensor_selection",
        time=TIME[:1],
        fields={"gyro_device_id": 9},
        format="uint64_t timestamp;uint32_t gyro_device_id;",
    )
    two = [vehicle_imu(0, device=7, gyro=0 * GYRO), vehicle_imu(1, device=9)]
    log = read(tmp_path, *two, chosen)
    np.testing.assert_allclose(log.channels["gyro"].values, GYRO, rtol=1e-6)
    assert log.channels["gyro"].source.startswith("vehicle_imu[1].")
    assert read(tmp_path, *two).channels["gyro"].source.startswith("vehicle_imu.delta")


def test_of_several_selections_the_last_counts(tmp_path):
    chosen = Logged(
        name="sensor_selection",
        time=TIME[:3],
        fields={"gyro_device_id": [7, 7, 9]},
        format="uint64_t timestamp;uint32_t gyro_device_id;",
    )
    two = [vehicle_imu(0, device=7, gyro=0 * GYRO), vehicle_imu(1, device=9)]
    assert read(tmp_path, *two, chosen).channels["gyro"].source.startswith("vehicle_imu[1].")


def test_with_a_sample_time_missing_all_are_of_publication(tmp_path):
    topic = vehicle_imu()
    sampled = np.where(np.arange(N) == 3, 0, topic.fields["timestamp_sample"])
    topic = replace(topic, fields={**topic.fields, "timestamp_sample": sampled})
    np.testing.assert_allclose(read(tmp_path, topic).channels["gyro"].time, TIME, atol=1e-6)


def test_filtered_signals_are_named_with_their_filters(tmp_path, assert_wording):
    parameters = {"IMU_GYRO_CUTOFF": 40.0}
    log = read(tmp_path, *controller_signals(250.0), parameters=parameters)
    np.testing.assert_allclose(log.channels["accel"].values, ACCEL, rtol=1e-6)
    np.testing.assert_allclose(log.channels["accel"].time, TIME - 0.002, atol=1e-6)
    (note,) = noted(log, "low-passed on board")
    assert "IMU_GYRO_CUTOFF = 40 Hz," in note
    assert_wording(note)
    assert "bits 0 and 4" in note


def test_the_fastest_source_is_taken_where_none_is_fast(tmp_path):
    log = read(tmp_path, vehicle_imu(rate=2.0), *controller_signals(50.0))
    assert log.channels["gyro"].source.startswith("vehicle_angular_velocity.xyz")
    log = read(tmp_path, IMU, *controller_signals(1000.0))
    assert log.channels["gyro"].source.startswith("sensor_combined.gyro_rad")


def fifo(kind, values, *, hole=False, samples=8):
    """Transfers of samples 0.5 ms apart, on a ramp about each value."""
    time = TIME[0] + 0.004 * np.arange(N)
    kept = np.arange(N) % 3 != 0 if hole else np.ones(N, dtype=bool)
    ramp = np.arange(samples) - (samples - 1) / 2
    counts = np.round(values * FLIP / 1e-3)
    fields = {
        "timestamp_sample": np.round(1e6 * time[kept]),
        "dt": 500.0,
        "scale": 1e-3,
        "samples": samples,
        **{axis: counts[kept, k, None] + 2 * ramp for k, axis in enumerate("xyz")},
    }
    return Logged(name=f"sensor_{kind}_fifo", time=time[kept], fields=fields, format=FIFO)


def test_raw_samples_as_means_of_their_transfers(tmp_path):
    slow = controller_signals(50.0)
    log = read(tmp_path, *slow, fifo("gyro", GYRO), fifo("accel", ACCEL))
    gyro, accel = log.channels["gyro"], log.channels["accel"]
    np.testing.assert_allclose(gyro.values, GYRO, atol=2e-3)
    np.testing.assert_allclose(accel.values, ACCEL, atol=2e-3)
    np.testing.assert_allclose(gyro.time, TIME - 3.5 * 0.0005, atol=1e-6)
    assert noted(log, "without the autopilot's calibration")
    holed = read(tmp_path, *slow, fifo("gyro", GYRO, hole=True), fifo("accel", ACCEL, hole=True))
    assert holed.channels["gyro"].source.startswith("vehicle_angular_velocity")
    turned = {"SENS_BOARD_ROT": 2}
    log = read(tmp_path, *slow, fifo("gyro", GYRO), fifo("accel", ACCEL), parameters=turned)
    assert log.channels["gyro"].source.startswith("vehicle_angular_velocity")


# Pose, velocity, battery


def test_a_pose_by_vision_in_the_older_message(tmp_path):
    kinds = "uint64_t timestamp;uint64_t timestamp_sample;uint8_t local_frame;float x;float y;"
    position, q = RNG.normal(size=(N, 3)), RNG.normal(size=(N, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    fields = {
        "timestamp_sample": np.round(1e6 * TIME),
        "local_frame": 1,
        "q": q * np.concatenate([[1], FLIP]),
        **dict(zip("xyz", (position * FLIP).T, strict=True)),
    }
    vision = Logged(
        name="vehicle_visual_odometry",
        time=TIME + 0.01,
        fields=fields,
        format=kinds + "float z;float[4] q;",
    )
    log = read(tmp_path, IMU, vision)
    np.testing.assert_allclose(log.channels["position"].values, position, rtol=1e-6)
    np.testing.assert_allclose(log.channels["attitude"].values, q, atol=1e-6)
    np.testing.assert_allclose(log.channels["position"].time, TIME, atol=1e-6)
    assert "forward-right-down" in log.channels["position"].source


def test_a_pose_in_an_unknown_frame_is_left_out(tmp_path, assert_wording):
    position, q = np.zeros((N, 3)), np.tile([1.0, 0, 0, 0], (N, 1))
    log = read(tmp_path, IMU, mocap(TIME, position, q, frame=0))
    assert "position" not in log.channels
    assert noted(log, "neither NED nor FRD")
    assert_wording((*log.notes, *log.warnings))


def test_a_frame_that_is_logged_late_counts(tmp_path):
    position, q = RNG.normal(size=(N, 3)), np.tile([1.0, 0, 0, 0], (N, 1))
    frame = np.where(np.arange(N) < 5, 0, 1)
    log = read(tmp_path, IMU, mocap(TIME, position, q, frame=frame))
    np.testing.assert_allclose(log.channels["position"].values, position, rtol=1e-6)


def test_of_two_batteries_the_first_that_has_a_voltage_is_read(tmp_path):
    def battery(instance, volts):
        fields = {"voltage_v": volts}
        return Logged(name="battery_status", time=TIME, fields=fields, instance=instance)

    log = read(tmp_path, IMU, battery(0, 0.0), battery(1, 16.0), battery(2, 12.0))
    assert log.channels["battery"].values[:, 0].tolist() == [16.0] * N
    assert log.channels["battery"].source == "battery_status[1].voltage_v [V]"


def test_an_attitude_that_is_none_is_nan(tmp_path):
    q = np.tile([1.0, 0, 0, 0], (N, 1))
    q[3], q[5] = np.nan, 0.0
    attitude = read(tmp_path, IMU, mocap(TIME, np.zeros((N, 3)), q)).channels["attitude"].values
    assert np.flatnonzero(np.isnan(attitude[:, 0])).tolist() == [3, 5]


def test_rates_asked_for_are_turned_to_flu(tmp_path):
    asked = Logged(
        name="vehicle_rates_setpoint", time=TIME, fields={"roll": 0.5, "pitch": 0.25, "yaw": -1.0}
    )
    values = read(tmp_path, IMU, asked).channels["reference"].values
    np.testing.assert_allclose(values, np.tile([0.5, -0.25, 1.0], (N, 1)), rtol=1e-6)


def test_velocity_that_the_autopilot_does_not_know_is_nan(tmp_path):
    valid = np.arange(N) >= 50
    place = Logged(
        name="vehicle_local_position",
        time=TIME,
        fields={"vx": 1.0, "vy": 0.0, "vz": -2.0, "v_xy_valid": valid, "v_z_valid": True},
    )
    # Nose to the east: north is on the left.
    east = np.array([np.cos(np.pi / 4), 0, 0, np.sin(np.pi / 4)])
    turned = Logged(name="vehicle_attitude", time=TIME, fields={"q": np.tile(east, (N, 1))})
    values = read(tmp_path, IMU, place, turned).channels["velocity"].values
    assert np.isnan(values[:50]).all()
    np.testing.assert_allclose(values[50:], np.tile([0, 1, 2], (N - 50, 1)), atol=1e-6)


@pytest.mark.parametrize("name", ["v_xy_valid", "v_z_valid"])
def test_velocity_is_known_where_both_its_parts_are(tmp_path, name):
    valid = {"v_xy_valid": True, "v_z_valid": True, name: np.arange(N) >= 50}
    place = Logged(name="vehicle_local_position", time=TIME, fields={"vx": 1.0, **valid})
    level = np.tile([1.0, 0, 0, 0], (N, 1))
    turned = Logged(name="vehicle_attitude", time=TIME, fields={"q": level})
    values = read(tmp_path, IMU, place, turned).channels["velocity"].values
    assert np.isnan(values[:50]).all()
    assert np.isfinite(values[50:]).all()


def test_velocity_is_turned_by_the_attitude_of_its_time(tmp_path):
    """The nose turns to the east at 0.5 rad/s; attitudes come every 0.2 s, one before each."""
    place = Logged(
        name="vehicle_local_position",
        time=TIME[30:],
        fields={"vx": 1.0, "v_xy_valid": True, "v_z_valid": True},
    )
    slow = TIME[::50]
    half = 0.25 * (slow - TIME[0])
    q = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
    turned = Logged(name="vehicle_attitude", time=slow, fields={"q": q})
    values = read(tmp_path, IMU, place, turned).channels["velocity"].values
    yaw = 0.5 * (np.minimum(TIME[30:], slow[-1]) - TIME[0])
    expected = np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], axis=1)
    np.testing.assert_allclose(values, expected, atol=1e-3)


# Armed, landed, changes, what does not belong


@pytest.mark.parametrize(
    "parameters", [{"SYS_AUTOSTART": 13000}, {"MAV_TYPE": 22}, {"CA_AIRFRAME": 2}]
)
def test_a_vtol_is_named_and_its_servos_are_no_motors(tmp_path, parameters, assert_wording):
    outputs = actuator_outputs(TIME, np.full((N, 8), 1500.0))
    log = read(tmp_path, IMU, outputs, parameters=parameters)
    assert_wording(log.warnings[0])
    assert "command" not in log.channels
    assert noted(log, "motors and which servos")
    assert_wording((*log.notes, *log.warnings))
    quad = read(tmp_path, IMU, outputs, parameters={"SYS_AUTOSTART": 4001})
    assert quad.warnings == ()
    assert quad.channels["command"].values.shape[1] == 4


def test_a_log_never_armed_is_said(tmp_path, assert_wording):
    (doubt,) = read(tmp_path, IMU, armed(TIME[::50], False)).findings
    assert doubt.kind == "never-armed"
    assert_wording(doubt.sentence)
    status = Logged(
        name="vehicle_status",
        time=TIME[::50],
        fields={"arming_state": 1},
        format="uint64_t timestamp;uint8_t arming_state;",
    )
    assert noted(read(tmp_path, IMU, status), "never armed")
    log = read(tmp_path, IMU, armed(TIME[::50], True), landed(TIME[::50], True))
    assert noted(log, "leave the ground")
    assert_wording((*log.notes, *log.warnings))


def test_when_it_flew_is_noted(tmp_path, assert_wording):
    state, air = np.array([0, 1, 1, 0], bool), np.array([1, 1, 0, 1], bool)
    log = read(tmp_path, IMU, armed(TIME[::50], state), landed(TIME[::50], air))
    assert log.warnings == ()
    assert "Armed 0.2 to 0.6 s." in log.notes
    assert any("ground 0.4 to 0.6" in note for note in log.notes)
    assert_wording(log.notes)


def test_changed_parameters_are_noted(tmp_path, assert_wording):
    changes = [(100.1, "MPC_X", 3.0), (100.2, "IMU_GYRO_CUTOFF", 80.0), (100.3, "MPC_X", 3.0)]
    log = read(tmp_path, IMU, parameters={"MPC_X": 2.0, "IMU_GYRO_CUTOFF": 40.0}, changes=changes)
    assert noted(log, "IMU_GYRO_CUTOFF 40 to 80,")
    assert noted(log, "MPC_X 2 to 3.")
    assert_wording((*log.notes, *log.warnings))


def logged_twice(first, last):
    """Return a log whose declarations have THR_MDL_FAC twice."""
    content = encode([IMU, actuator_motors(TIME, HALF)], Parts(parameters={"THR_MDL_FAC": first}))
    again = encode([IMU], Parts(parameters={"THR_MDL_FAC": last}))
    name = b"float THR_MDL_FAC"
    begin, place = again.index(name) - 4, content.index(name) + len(name) + 4
    return content[:place] + again[begin : begin + 8 + len(name)] + content[place:]


HALF = np.full((N, 4), 0.5)


def test_of_a_parameter_declared_twice_the_last_value_counts(tmp_path):
    path = tmp_path / "log.ulg"
    for first, last in ((0.3, 1.0), (1.0, 0.3)):
        path.write_bytes(logged_twice(first, last))
        log = read_log(path)
        assert log.metadata["THR_MDL_FAC"] == f"{last:g}"
        # 0.5 is last u^2 + (1 - last) u.
        share = log.channels["command"].values
        np.testing.assert_allclose(last * share**2 + (1 - last) * share, 0.5, rtol=1e-6)
        assert not noted(log, "Parameters changed")


def test_a_changed_parameter_keeps_its_first_value(tmp_path, assert_wording):
    changes = [(100.1, "THR_MDL_FAC", 0.5), (100.2, "THR_MDL_FAC", 1.0)]
    topic = actuator_motors(TIME, HALF)
    log = read(tmp_path, topic, parameters={"THR_MDL_FAC": 0.0}, changes=changes)
    assert log.metadata["THR_MDL_FAC"] == "0"
    np.testing.assert_allclose(log.channels["command"].values, 0.5)
    assert noted(log, "THR_MDL_FAC 0 to 0.5,")
    assert noted(log, "THR_MDL_FAC 0.5 to 1.")
    assert_wording((*log.notes, *log.warnings))


def test_dropouts_are_said_and_not_bridged(tmp_path, assert_wording):
    kept = np.r_[0:80, 120:N]
    part = sensor_combined(TIME[kept], GYRO[kept], ACCEL[kept])
    log = read(tmp_path, part, dropouts=[(100.4, 160), (100.5, 20)])
    assert noted(log, "messages 2 times, 0.18 s")
    assert noted(log, "160 ms at most")
    assert_wording((*log.notes, *log.warnings))
    assert np.diff(log.channels["gyro"].time).max() == pytest.approx(0.164, abs=1e-3)


def test_a_log_without_any_known_topic_is_refused(tmp_path):
    other = Logged(
        name="cpuload", time=TIME, fields={"load": 0.5}, format="uint64_t timestamp;float load;"
    )
    with pytest.raises(LogError, match=r"\(topics: cpuload\); set bits 0 and 4 of SDLOG_PROFILE"):
        read(tmp_path, other)


def test_what_is_missing_is_asked_for(tmp_path, assert_text):
    log = read(tmp_path, esc_status(TIME, np.full((N, 4), 500.0)))
    assert noted(log, "No gyro: set bits 0")
    assert noted(log, "No accel: set bits 0")
    assert noted(log, "No motor commands")
    assert_text((*log.notes, *log.warnings))
    log = read(tmp_path, IMU, actuator_motors(TIME, np.full((N, 4), 0.5)))
    assert noted(log, "set DSHOT_BIDIR_EN = 1")
    assert noted(log, "from 1.18 on")
    assert_text((*log.notes, *log.warnings))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (ReadOptions(axes="FRD"), "names its own topics and axes: leave out axes"),
        (ReadOptions(columns={"time": ColumnSpec(name="t")}), "leave out a columns map"),
        (ReadOptions(log_number=2), "a ULog is one log, there is no log 2"),
    ],
)
def test_options_for_other_formats_are_refused(tmp_path, options, words):
    path = tmp_path / "log.ulg"
    path.write_bytes(encode([IMU]))
    with pytest.raises(LogError, match=words):
        read_log(path, options=options)


def test_it_is_known_from_the_content(tmp_path):
    assert is_ulog(encode([IMU])[:20])
    assert not is_ulog(b"ULo")
    path = tmp_path / "flight.csv"
    path.write_bytes(b"time,gyro_x\n0,1\n")
    with pytest.raises(LogError, match="expected the mark of a ULog"):
        read_ulog(path)


def test_outputs_are_left_where_motors_are_known(tmp_path):
    motors = actuator_motors(TIME, np.full((N, 4), 0.5))
    outputs = actuator_outputs(TIME, np.full((N, 4), 1900.0))
    log = read(tmp_path, IMU, motors, outputs, parameters=QUAD)
    assert log.channels["command"].source == "actuator_motors.control[0..3]"


@pytest.mark.slow
def test_a_ulog_and_a_table_of_one_flight_agree(tmp_path):
    flight = simulated("quad-x", "noisy", seed=2, seconds=40.0)
    write_ulog(flight, tmp_path / "log.ulg")
    write_flight_table(flight, tmp_path / "log.csv")
    ulog, table = (
        quietly_identified(
            experiment_file(
                tmp_path / f"{suffix}.toml",
                flight.vehicle,
                [Path(f"log.{suffix}")],
                mass=flight.truth.mass,
            )
        )
        for suffix in ("ulg", "csv")
    )
    for mine, other in zip(ulog.parameters, table.parameters, strict=True):
        assert (mine.name, mine.verdict) == (other.name, other.verdict)
        if other.std:
            # Whole rpm and single precision are all that differs.
            assert mine.value == pytest.approx(other.value, rel=1e-3, abs=0.02 * other.std)
