"""Unknown tables: whatever the columns are called and scaled, the proposal reads the flight."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rotorfit.errors import LogError
from rotorfit.logs.column_names import parts_of
from rotorfit.logs.proposal import explains_itself, propose_columns
from rotorfit.logs.table import format_table, read_table

G = 9.80665
ROWS, STEP = 600, 0.004
NAMES = {
    "time": (("t", 1.0), ("timestamp_us", 1e6), ("Time [ms]", 1e3), ("clock", 1e6), ("t", 1e9)),
    "gyro": (
        (("gyro_x", "gyro_y", "gyro_z"), "rad/s"),
        (("IMU.gyroX [deg/s]", "IMU.gyroY [deg/s]", "IMU.gyroZ [deg/s]"), "deg/s"),
        (("gyroADC[0]", "gyroADC[1]", "gyroADC[2]"), "deg/s"),
        (("wx", "wy", "wz"), "rad/s"),
        (("roll_rate_dps", "pitch_rate_dps", "yaw_rate_dps"), "deg/s"),
        (("angular_velocity.x", "angular_velocity.y", "angular_velocity.z"), "rad/s"),
    ),
    "accel": (
        (("accX", "accY", "accZ"), 1.0),
        (("ax_g", "ay_g", "az_g"), 1 / G),
        (("linear_acceleration.x", "linear_acceleration.y", "linear_acceleration.z"), 1.0),
        (("accSmooth[0]", "accSmooth[1]", "accSmooth[2]"), 2048 / G),
    ),
    "rotor": (
        ("ESC{} RPM", 0, 30 / math.pi),
        ("rpm_{}", 1, 30 / math.pi),
        ("w_rotor{}_hz", 1, 0.5 / math.pi),
    ),
    "attitude": (
        ("qw", "qx", "qy", "qz"),
        ("q0", "q1", "q2", "q3"),
        ("orientation.w", "orientation.x", "orientation.y", "orientation.z"),
        (),
    ),
}
OTHERS = ("Unnamed", "baro_alt", "mag_x", "gyro_temp", "acc_bias_x", "state", "cpu load [%]")


def flown() -> dict[str, np.ndarray]:
    """A flight in FLU axes and SI units, by the names of rotorfit."""
    time = 5.0 + STEP * np.arange(ROWS)
    angles = np.stack([0.3 * np.sin((5 + i) * time + i) for i in range(3)], axis=1)
    angles[:, 2] += 0.5
    attitude = Rotation.from_euler("ZYX", angles[:, ::-1])
    gyro = np.gradient(attitude.as_quat(scalar_first=True), time, axis=0)
    turn = [
        2.0 * (Rotation.from_quat(q, scalar_first=True).inv().as_matrix() @ _axis(q, dq))
        for q, dq in zip(attitude.as_quat(scalar_first=True), gyro, strict=True)
    ]
    rng = np.random.default_rng(1)
    accel = np.array([0.0, 0.0, G]) + 0.3 * rng.standard_normal((ROWS, 3))
    return {
        "time": time,
        **{f"gyro_{a}": column for a, column in zip("xyz", np.array(turn).T, strict=True)},
        **{f"accel_{a}": column for a, column in zip("xyz", accel.T, strict=True)},
        **{f"rotor_{i}": 800 + 50 * np.sin(3 * time + i) for i in (1, 2, 3, 4)},
        **dict(
            zip((f"quat_{a}" for a in "wxyz"), attitude.as_quat(scalar_first=True).T, strict=True)
        ),
    }


def _axis(q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """World rate over 2: the vector part of dq conj(q)."""
    return q[0] * dq[1:] - dq[0] * q[1:] - np.cross(dq[1:], q[1:])


FLIGHT = flown()


def written(path, columns: dict[str, np.ndarray], *, delimiter=","):
    rows = [delimiter.join(columns)]
    rows += [
        delimiter.join(repr(v) for v in row) for row in np.array([*columns.values()]).T.tolist()
    ]
    path.write_text("\n".join(rows) + "\n")
    return path


def renamed(draw) -> dict[str, np.ndarray]:
    """The flight as somebody else logs it."""
    frd = draw(st.booleans())
    turned = np.array([1.0, -1.0, -1.0]) if frd else np.ones(3)
    clock, ticks = draw(st.sampled_from(NAMES["time"]))
    found = {clock: ticks * FLIGHT["time"]}
    gyro, unit = draw(st.sampled_from(NAMES["gyro"]))
    accel, scale = draw(st.sampled_from(NAMES["accel"]))
    stem, first, speed = draw(st.sampled_from(NAMES["rotor"]))
    attitude = draw(st.sampled_from(NAMES["attitude"]))
    factor = 1.0 if unit == "rad/s" else 180 / np.pi
    for i, axis in enumerate("xyz"):
        found[gyro[i]] = factor * turned[i] * FLIGHT[f"gyro_{axis}"]
        found[accel[i]] = scale * turned[i] * FLIGHT[f"accel_{axis}"]
    for i in range(4):
        found[stem.format(i + first)] = speed * FLIGHT[f"rotor_{i + 1}"]
    for i, name in enumerate(attitude):
        found[name] = FLIGHT[f"quat_{'wxyz'[i]}"] * (1.0, *turned)[i]
    for name in draw(st.lists(st.sampled_from(OTHERS), unique=True)):
        found[name] = np.sin(FLIGHT["time"])
    names = draw(st.permutations(list(found)))
    return {name: found[name] for name in names}


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.data())
def test_a_renamed_and_rescaled_flight_reads_the_same(tmp_path, data):
    table = renamed(data.draw)
    delimiter = data.draw(st.sampled_from([",", ";", "\t"]))
    path = written(tmp_path / "own.csv", table, delimiter=delimiter)
    # What names and attitude leave open is asked.
    first = propose_columns(path)
    truth = {"gyro": "deg/s" if "gyroADC[0]" in table else "rad/s", "motors": "rpm"}
    units = {question.channel: truth[question.channel] for question in first.questions}
    proposal = propose_columns(path, units=units)
    assert not proposal.questions
    log = read_table(path, columns=proposal.columns, axes=proposal.axes)
    for channel, stem in (("gyro", "gyro"), ("accel", "accel")):
        expected = np.stack([FLIGHT[f"{stem}_{a}"] for a in "xyz"], axis=1)
        np.testing.assert_allclose(log.channels[channel].values, expected, rtol=1e-6, atol=1e-9)
    expected = np.stack([FLIGHT[f"rotor_{i}"] for i in (1, 2, 3, 4)], axis=1)
    np.testing.assert_allclose(log.channels["rotor_speed"].values, expected, rtol=1e-9)
    assert log.seconds == pytest.approx(STEP * (ROWS - 1))
    if any(name in table for name in ("qw", "q0", "orientation.w")):
        expected = np.stack([FLIGHT[f"quat_{a}"] for a in "wxyz"], axis=1)
        np.testing.assert_allclose(log.channels["attitude"].values, expected, atol=1e-9)


def test_a_gyro_in_other_axes_than_the_attitude_is_seen(tmp_path, assert_wording):
    table = dict(FLIGHT)
    path = written(tmp_path / "own.csv", table | {"gyro_y": -table["gyro_y"]})
    assert_wording(" ".join(propose_columns(path).doubts))
    mixed = table | {f"quat_{a}": -table[f"quat_{a}"] for a in "yz"}
    proposal = propose_columns(written(tmp_path / "mixed.csv", mixed))
    assert [proposal.columns[f"quat_{a}"].scale for a in "wxyz"] == [1, 1, -1, -1]


def test_a_name_that_gravity_or_attitude_contradict_is_doubted(tmp_path):
    names = {f"accel_{a}": f"acc_{a} [g]" for a in "xyz"} | {
        f"gyro_{a}": f"gyro{a}_dps" for a in "xyz"
    }
    table = {names.get(name, name): column for name, column in FLIGHT.items()}
    proposal = propose_columns(written(tmp_path / "own.csv", table))
    assert proposal.columns["accel_x"].unit == "m/s^2"
    assert proposal.columns["gyro_x"].unit == "rad/s"
    assert len(proposal.doubts) == 2


def test_a_unit_is_asked_where_nothing_shows_it(tmp_path):
    table = {n.replace("rotor_", "m"): c for n, c in FLIGHT.items() if "quat" not in n}
    path = written(tmp_path / "own.csv", table)
    proposal = propose_columns(path)
    assert [question.channel for question in proposal.questions] == ["gyro", "motors"]
    stated = propose_columns(path, units={"gyro": "deg/s", "motors": "Hz"})
    assert (stated.columns["gyro_z"].unit, stated.columns["rotor_4"].unit) == ("deg/s", "Hz")


def test_columns_without_known_names_are_named_by_hand(tmp_path):
    given_names = {name: f"ch{i}" for i, name in enumerate(FLIGHT) if "quat" not in name}
    path = written(tmp_path / "own.csv", {given_names.get(n, n): c for n, c in FLIGHT.items()})
    with pytest.raises(LogError, match="as --column gyro_x=NAME"):
        propose_columns(path)
    named = {canonical: column for canonical, column in given_names.items()}
    proposal = propose_columns(path, named=named, units={"motors": "rad/s"})
    assert {n: s.name for n, s in proposal.columns.items() if n in named} == named
    log = read_table(path, columns=proposal.columns, axes=proposal.axes)
    assert log.channels["gyro"].values[5, 1] == FLIGHT["gyro_y"][5]


def test_a_clock_that_may_be_slow_is_doubted(tmp_path):
    """One row a second or a millisecond: whole steps of a clock without a unit do not tell."""
    table = {**FLIGHT, "time": np.arange(ROWS, dtype=float)}
    proposal = propose_columns(written(tmp_path / "own.csv", table))
    assert any("too slow for a flight" in doubt for doubt in proposal.doubts)
    known = propose_columns(written(tmp_path / "known.csv", FLIGHT))
    assert not any("too slow for a flight" in doubt for doubt in known.doubts)


def test_the_clock_of_a_slower_message_is_not_that_of_the_rows(tmp_path):
    """Rows of a recorder repeat the last position with the time at which that was measured."""
    stamp = np.floor(FLIGHT["time"] / 0.02) * 20_000
    table = {"position_stamp_us": stamp, "elapsed_s": FLIGHT["time"]}
    table |= {name: values for name, values in FLIGHT.items() if name != "time"}
    proposal = propose_columns(written(tmp_path / "own.csv", table))
    assert proposal.columns["time"].name == "elapsed_s"
    assert not proposal.questions[1:]  # the unit of the rotor speeds alone is asked


def test_a_clock_is_found_by_its_unit_where_none_is_named(tmp_path):
    table = {"loop_index": np.arange(ROWS), "last_step_ns": np.round(1e9 * FLIGHT["time"])}
    table |= {name: values for name, values in FLIGHT.items() if name != "time"}
    clock = propose_columns(written(tmp_path / "own.csv", table)).columns["time"]
    assert (clock.name, clock.unit) == ("last_step_ns", "ns")


def test_whole_numbers_from_1000_to_2000_are_pulse_widths_first(tmp_path):
    """Enter at the question takes the first."""
    motors = {f"m{i}": np.round(1000 + 0.8 * FLIGHT[f"rotor_{i}"]) for i in (1, 2, 3, 4)}
    table = {name: values for name, values in FLIGHT.items() if "rotor" not in name}
    question = propose_columns(written(tmp_path / "own.csv", table | motors)).questions[-1]
    assert (question.channel, question.choices[0]) == ("motors", "us")
    speeds = {name: values + 0.25 for name, values in motors.items()}
    question = propose_columns(written(tmp_path / "fast.csv", table | speeds)).questions[-1]
    assert question.choices[0] == "rad/s"


def test_what_a_controller_asks_for_by_axes_is_no_motor(tmp_path):
    asked = {f"u_{axis}": 0.1 * FLIGHT[f"gyro_{axis}"] for axis in "xyz"}
    sent = {f"mot_{i}": 1e-3 * FLIGHT[f"rotor_{i}"] for i in (1, 2, 3, 4)}
    table = asked | {name: values for name, values in FLIGHT.items() if "rotor" not in name} | sent
    columns = propose_columns(written(tmp_path / "own.csv", table)).columns
    assert [columns[f"command_{i}"].name for i in (1, 2, 3, 4)] == list(sent)


def test_channels_of_the_sticks_are_no_attitude(tmp_path):
    sticks = {f"channels_{axis}": np.full(ROWS, 1500.0) for axis in ("roll", "pitch", "yaw")}
    angles = Rotation.from_quat(
        np.stack([FLIGHT[f"quat_{a}"] for a in "wxyz"], axis=1), scalar_first=True
    ).as_euler("ZYX")
    drone = dict(zip(("drone_yaw", "drone_pitch", "drone_roll"), angles.T, strict=True))
    flight = {name: values for name, values in FLIGHT.items() if "quat" not in name}
    proposal = propose_columns(written(tmp_path / "own.csv", flight | sticks | drone))
    assert proposal.columns["roll"].name == "drone_roll"
    assert not proposal.doubts


def test_what_is_sent_to_the_motors_precedes_their_thrust(tmp_path):
    thrust = {f"motor_thrust_{i}": 1e-6 * FLIGHT[f"rotor_{i}"] ** 2 for i in (1, 2, 3, 4)}
    sent = {f"actuator_{i}": 1e-3 * FLIGHT[f"rotor_{i}"] for i in (1, 2, 3, 4)}
    path = written(tmp_path / "own.csv", FLIGHT | thrust | sent)
    assert propose_columns(path).columns["command_1"].name == "actuator_1"
    alone = propose_columns(written(tmp_path / "alone.csv", FLIGHT | thrust))
    assert alone.columns["command_1"].name == "motor_thrust_1"


def test_a_motor_that_is_missing_between_others_is_named(tmp_path):
    table = {name: values for name, values in FLIGHT.items() if name != "rotor_3"}
    reasons = " ".join(propose_columns(written(tmp_path / "own.csv", table)).reasons)
    assert "number 3 is missing" in reasons
    whole = propose_columns(written(tmp_path / "whole.csv", FLIGHT)).reasons
    assert "missing" not in " ".join(whole)


def test_a_column_without_a_name_is_called_so(tmp_path):
    table = {"": FLIGHT["time"], "a": FLIGHT["gyro_x"], "b": FLIGHT["gyro_y"]}
    with pytest.raises(LogError, match=r"the table has \(a column without a name\), a, b: name"):
        propose_columns(written(tmp_path / "own.csv", table))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.pop("time"), "no time: no column is named like a clock"),
        (
            lambda t: t.update(time=1.6e9 + np.round(t["time"], -1)),
            "no time: time stands still (2 different in",
        ),
        (lambda t: t.update(time=t["time"][::-1]), "no time: time does not rise from row to row"),
        (lambda t: t.update(time=1e12 * np.arange(ROWS)), "in no unit several rows a second"),
        (lambda t: t.pop("gyro_z"), "no whole gyro: of gyro_x, gyro_y some hold"),
        (lambda t: t.update(accel_y=np.full(ROWS, np.nan)), "no whole accelerometer"),
        (lambda t: [t.pop(f"rotor_{i}") for i in (1, 2, 3, 4)], "no column for motor speeds or"),
        (lambda t: t.update(accel_z=0.4 * t["accel_z"]), "gravity in no unit"),
        (
            lambda t: t.update(accel_x=t["accel_z"], accel_z=t["accel_x"]),
            "gravity lies along accel_x",
        ),
    ],
)
def test_a_table_that_is_no_flight_is_refused(tmp_path, change, words):
    table = dict(FLIGHT)
    change(table)
    with pytest.raises(LogError) as caught:
        propose_columns(written(tmp_path / "own.csv", table))
    assert words in str(caught.value)
    assert str(caught.value).startswith(f"{tmp_path / 'own.csv'}: ")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("t,gyro_x\n", "no rows below the column names"),
        ("t,gyro_x\n0,1\n", "1 row only"),
        ("1,2\n3,4\n", "no row of column names"),
        ("t~gyro_x\n0~1\n0.1~2\n", "cells are separated by comma"),
        ("time,gyro_x\n" + "noon,1\n" * 20, "time holds text"),
    ],
)
def test_a_file_that_is_no_table_is_refused(tmp_path, text, words):
    path = tmp_path / "own.csv"
    path.write_text(text)
    with pytest.raises(LogError) as caught:
        propose_columns(path)
    assert words in str(caught.value)


def test_a_channel_is_left_out_by_an_empty_name(tmp_path):
    path = written(tmp_path / "own.csv", FLIGHT)
    assert "quat_w" in propose_columns(path, units={"motors": "rad/s"}).columns
    proposal = propose_columns(path, named={"quat_w": ""}, units={"motors": "rad/s"})
    assert not {"quat_w", "quat_z"} & set(proposal.columns)
    assert "quat_z" in proposal.unused


def test_units_of_speeds_and_commands_are_stated_separately(tmp_path):
    commands = {f"pwm_{i}": 1500 + 0.1 * FLIGHT[f"rotor_{i}"] for i in (1, 2, 3, 4)}
    path = written(tmp_path / "own.csv", {**FLIGHT, **commands})
    proposal = propose_columns(path, units={"motors": "rad/s", "rotor": "Hz"})
    assert proposal.columns["rotor_1"].unit == "Hz"
    assert proposal.columns["command_1"].unit == "us"
    stated = propose_columns(path, units={"motors": "rad/s", "command": "counts"})
    assert (stated.columns["rotor_1"].unit, stated.columns["command_1"].unit) == ("rad/s", "counts")
    assert stated.columns["command_1"].range == (0.0, 2047.0)


def test_text_next_to_the_numbers_is_left_out(tmp_path, assert_wording):
    path = written(tmp_path / "own.csv", FLIGHT)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([f"{lines[0]},motor_5", *(f"{line},idle" for line in lines[1:])]))
    proposal = propose_columns(path)
    assert any("motor_5: holds" in doubt for doubt in proposal.doubts)
    assert_wording(proposal.doubts)
    assert "rotor_5" not in proposal.columns


@pytest.mark.parametrize("stem", ["{}speed", "{}_rate", "{}Rate"])
def test_rates_are_named_by_their_angles(tmp_path, stem):
    angles = dict(zip("xyz", ("roll", "pitch", "yaw"), strict=True))
    names = {f"gyro_{axis}": stem.format(angle) for axis, angle in angles.items()}
    table = {names.get(name, name): values for name, values in FLIGHT.items()}
    columns = propose_columns(written(tmp_path / "own.csv", table)).columns
    assert [columns[f"gyro_{axis}"].name for axis in "xyz"] == [*names.values()]


def test_a_percent_sign_is_a_unit():
    assert parts_of("Motor 2 (%)") == (("motor",), 2, "%")


@pytest.mark.parametrize(("whole", "part"), [("sec", "nsec"), ("stamp.secs", "stamp.nanosecs")])
def test_a_time_in_two_columns_is_asked_for_in_one(tmp_path, whole, part):
    time = 10.0 * FLIGHT["time"] / FLIGHT["time"][-1]
    table = {whole: np.floor(time), part: np.round(1e9 * (time % 1.0))}
    table |= {name: values for name, values in FLIGHT.items() if name != "time"}
    with pytest.raises(LogError, match=rf"{whole} \+ 1e-9 {part} as one column"):
        propose_columns(written(tmp_path / "own.csv", table))


@pytest.mark.parametrize("name", ["RPM M1", "M1 RPM", "rpm_m1", "M1 [rpm]"])
def test_a_unit_in_front_of_a_name_counts(name):
    _, index, unit = parts_of(name)
    assert (index, unit) == (1, "rpm")


def test_own_names_need_no_proposal(tmp_path):
    path = tmp_path / "own.csv"
    path.write_text(format_table(FLIGHT))
    assert explains_itself(path)
    proposal = propose_columns(path, units={"motors": "rad/s"})
    bare = {name: replace(spec, unit=None) for name, spec in proposal.columns.items()}
    assert all(spec.name == name for name, spec in bare.items())


def posed(*, unit=1.0, axes="FLU", attitude_axes=None) -> dict[str, np.ndarray]:
    """The flight as a camera sees it: it accelerates by g where it leans, after it has climbed."""
    time = FLIGHT["time"]
    attitude = np.stack([FLIGHT[f"quat_{a}"] for a in "wxyz"], axis=1)
    w, x, y, z = attitude.T
    lean = G * np.stack([2 * (x * z + w * y), 2 * (y * z - w * x)], axis=1)
    places = STEP**2 * np.cumsum(np.cumsum(lean, axis=0), axis=0)
    height = 1.0 - np.exp(-(time - time[0]))
    turned = {"FLU": np.ones(3), "FRD": np.array([1.0, -1.0, -1.0])}
    places = unit * turned[axes] * np.column_stack([places, height])
    attitude = attitude * np.concatenate([[1.0], turned[attitude_axes or axes]])
    return {
        "t": time,
        **dict(zip(("px", "py", "pz"), places.T, strict=True)),
        **dict(zip(("qw", "qx", "qy", "qz"), attitude.T, strict=True)),
        **{f"m{i}_rpm": 30 / np.pi * FLIGHT[f"rotor_{i}"] for i in (1, 2, 3, 4)},
    }


@pytest.mark.parametrize(("name", "unit"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
@pytest.mark.parametrize("axes", ["FLU", "FRD"])
def test_a_pose_and_motors_are_a_flight(tmp_path, name, unit, axes):
    """Gravity tells the unit of the position and the axes: no IMU is needed for that."""
    path = written(tmp_path / "own.csv", posed(unit=unit, axes=axes))
    proposal = propose_columns(path)
    assert (proposal.questions, proposal.doubts) == ((), ())
    assert (proposal.columns["pos_x"].unit, proposal.axes) == (name, axes)
    assert f"leans, in {name}, axes {axes}" in " ".join(proposal.reasons)
    log = read_table(path, columns=proposal.columns, axes=proposal.axes)
    for channel, stem, letters in (("attitude", "q", "wxyz"), ("position", "p", "xyz")):
        expected = np.stack([posed()[f"{stem}{a}"] for a in letters], axis=1)
        np.testing.assert_allclose(log.channels[channel].values, expected, atol=1e-9)


def test_half_an_imu_beside_a_pose_is_left_out(tmp_path, assert_wording):
    table = posed() | {f"gyro_{a}": FLIGHT[f"gyro_{a}"] for a in "xyz"}
    proposal = propose_columns(written(tmp_path / "own.csv", table))
    assert "gyro_x" in proposal.unused
    assert_wording(proposal.reasons)


def test_poses_that_gravity_contradicts_are_doubted(tmp_path, assert_wording):
    mixed = propose_columns(written(tmp_path / "mixed.csv", posed(attitude_axes="FRD")))
    assert_wording(" ".join(mixed.doubts))
    path = written(tmp_path / "own.csv", posed())
    stated = propose_columns(path, units={"position": "mm"}, axes="FRD")
    assert "gravity 0.00" in stated.doubts[0]
    assert_wording(stated.doubts[0])
    assert_wording(stated.doubts[1])
    upside = posed() | {"pz": -posed()["pz"]}
    below = propose_columns(written(tmp_path / "below.csv", upside), axes="FLU")
    assert_wording(" ".join(below.doubts))


def test_a_slower_attitude_tells_the_unit_of_the_gyro(tmp_path):
    """Tables joined by time have empty cells where a slower message has no sample."""
    rows = np.arange(ROWS) % 3 == 0
    columns = {
        name: np.where(rows, values, np.nan) if name.startswith("quat") else values
        for name, values in FLIGHT.items()
    }
    for axis in "xyz":
        columns[f"ang_vel_{axis}"] = np.rad2deg(columns.pop(f"gyro_{axis}"))
    path = written(tmp_path / "joined.csv", columns)
    path.write_text(path.read_text().replace("nan", ""))
    proposal = propose_columns(path, units={"motors": "rad/s"})
    assert proposal.columns["gyro_x"].unit == "deg/s"
    assert proposal.questions == ()
    assert proposal.doubts == ()
