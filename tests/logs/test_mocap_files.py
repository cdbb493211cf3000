"""Motion-capture exports: written from a simulated flight, read back, damaged."""

import functools
import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mocap_writers import write_motive, write_qualisys, write_trajectory, write_vicon
from refusals import error_of
from scipy.spatial.transform import Rotation

from rotorfit.errors import LogError
from rotorfit.logs import ColumnSpec, ReadOptions, read_log
from rotorfit.logs.flight_log import CHANNELS, FlightLog
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight

WRITERS = {
    "qualisys": write_qualisys,
    "motive": write_motive,
    "trajectory": write_trajectory,
    "vicon": write_vicon,
    "nexus": functools.partial(write_vicon, block="Segments", rotation="deg"),
}


@pytest.fixture(scope="module")
def flight():
    return simulate_flight(*paper_vehicle("A"), Scenario(seconds=2.0), seed=3)


def turn_between(log, flight):
    read, true = log.channels["attitude"].values, flight.attitude_wxyz_measured
    a, b = (Rotation.from_quat(np.roll(q, -1, axis=1)) for q in (read, true))
    return (a.inv() * b).magnitude().max()


@pytest.mark.parametrize("name", WRITERS)
def test_a_flight_reads_back(tmp_path, flight, name):
    path = tmp_path / "recording"
    WRITERS[name](flight, path)
    log = read_log(path)
    assert log.format == {"nexus": "vicon"}.get(name, name)
    assert set(log.channels) == {"position", "attitude"}
    place = log.channels["position"]
    np.testing.assert_allclose(place.time, flight.pose_time, atol=1e-6)
    np.testing.assert_allclose(place.values, flight.position_measured, atol=1e-8)
    # Six decimals of a matrix, nine of a quaternion.
    assert turn_between(log, flight) < (3e-6 if name == "qualisys" else 1e-7)
    assert log.channels["attitude"].values.shape == (len(flight.pose_time), 4)


def test_units_and_versions_of_motive(tmp_path, flight):
    for number, (unit, version) in enumerate((("Millimeters", "1.25"), ("Meters", "1.21"))):
        path = tmp_path / f"take{number}.csv"
        write_motive(flight, path, unit=unit, version=version)
        log = read_log(path)
        np.testing.assert_allclose(
            log.channels["position"].values, flight.position_measured, atol=1e-8
        )
        assert log.metadata["Format Version"] == version
        assert unit.lower() in log.channels["position"].source


def test_y_up_becomes_z_up(tmp_path):
    """A body raised along Motive's y and turned about it is raised and yawed the same way."""
    half = np.sqrt(0.5)
    header = (
        "Format Version,1.23,Rotation Type,Quaternion,Length Units,Centimeters\n\n"
        ",Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body\n"
        ",Name,Q,Q,Q,Q,Q,Q,Q\n,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position\n"
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z\n"
    )
    path = tmp_path / "take.csv"
    path.write_text(header + f"0,0.0,0,0,0,1,100,200,300\n1,0.01,0,{half},0,{half},100,200,300\n")
    log = read_log(path)
    np.testing.assert_allclose(log.channels["position"].values[0], [1, -3, 2])
    np.testing.assert_allclose(log.channels["attitude"].values[1], [half, 0, 0, half])


def test_frames_that_are_lost_are_left_out(tmp_path, flight, assert_text):
    path = tmp_path / "take.tsv"
    write_qualisys(flight, path)
    lines = path.read_bytes().split(b"\r\n")
    cells = lines[20].split(b"\t")
    lines[20] = b"\t".join([*cells[:2], *[b"0.000000"] * 6, b"-1.000000", *[b"0.000000"] * 9])
    path.write_bytes(b"\r\n".join(lines))
    log = read_log(path)
    assert len(log.channels["position"].time) == len(flight.pose_time) - 1
    assert_text(log.notes)
    path = tmp_path / "take.csv"
    write_motive(flight, path)
    lines = path.read_text().split("\n")
    lines[30] = ",".join(lines[30].split(",")[:2]) + "," * 12
    path.write_text("\n".join(lines))
    log = read_log(path)
    assert len(log.channels["attitude"].time) == len(flight.pose_time) - 1


def test_frames_without_times_have_those_of_the_frequency(tmp_path, flight, assert_text):
    path = tmp_path / "take.tsv"
    write_qualisys(flight, path, timed=False)
    np.testing.assert_allclose(read_log(path).channels["position"].time, flight.pose_time)
    text = path.read_text().replace("FREQUENCY\t200", "FREQUENCY\tEXT")
    path.write_text(text)
    assert_text(error_of(path))


@pytest.mark.parametrize("write", [write_motive, write_qualisys, write_vicon])
def test_one_of_several_bodies_is_chosen_by_name(
    tmp_path, flight, write, assert_text, assert_wording
):
    path = tmp_path / "take"
    write(flight, path, names=("Wand", "Quad"))
    assert_text(error_of(path))
    chosen = ReadOptions(columns={"position": ColumnSpec(name="Quad")})
    log = read_log(path, options=chosen)
    assert "body 'Quad'" in log.channels["position"].source
    assert_text(log.notes)
    other = ReadOptions(columns={"position": ColumnSpec(name="Hexa")})
    assert_text(error_of(path, options=other))
    wrong = ReadOptions(columns={"gyro_x": ColumnSpec(name="X")})
    assert_wording(error_of(path, options=wrong))
    assert "leave out axes" in error_of(path, options=ReadOptions(axes="FRD"))
    assert "there is no log 2" in error_of(path, options=ReadOptions(log_number=2))


@pytest.mark.parametrize(
    ("write", "old", "new", "message"),
    [
        (write_motive, "Rotation Type,Quaternion", "Rotation Type,XYZ", "export again with quater"),
        (write_motive, "Length Units,Meters", "Length Units,Furlongs", "Length Units are 'Furlong"),
        (write_motive, "Space,Global", "Space,Local", "export again in global coordinates"),
        (write_motive, "Rigid Body,", "Marker,", "the file has no rigid body, only markers"),
        (write_motive, "\nFrame,Time", "\nX,Time", "no row that begins with Frame, Time"),
        (write_qualisys, "INCLUDED\t6D", "INCLUDED\t3D", "holds 3D data, expected 6D"),
        (write_qualisys, "Rot[0]", "Rot0", "the header has no row of columns with Rot[0]"),
        (write_qualisys, "\tQuad\r\n", "\tQuad\tHexa\r\n", "has 18 columns, expected 16 for each"),
        (write_qualisys, "BODY_NAMES", "NAMES", "BODY_NAMES has 0 names"),
    ],
)
def test_other_exports_are_refused(tmp_path, flight, write, old, new, message):
    path = tmp_path / "take"
    write(flight, path)
    with path.open(newline="", encoding="utf-8") as file:
        text = file.read()
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8", newline="")
    assert message in error_of(path)


def test_a_trajectory_has_names_or_none(tmp_path):
    rows = "0,1,2,3,0,0,0,1\n0.1,1,2,3,0,0,1,0\n0.2,1,2,4,0,0,-1,0\n"
    for head in (
        "",
        "t,x,y,z,qx,qy,qz,qw\n",
        "# a comment\n",
        "timestamp [s],px,py,pz,qx,qy,qz,qw\n",
    ):
        path = tmp_path / "poses.csv"
        path.write_text(head + rows)
        log = read_log(path)
        assert log.format == "trajectory"
        np.testing.assert_array_equal(log.channels["position"].values[2], [1, 2, 4])
        np.testing.assert_array_equal(log.channels["attitude"].values[1], [0, 0, 0, 1])
    turned = read_log(path, options=ReadOptions(axes="FRD"))
    np.testing.assert_array_equal(turned.channels["position"].values[2], [1, -2, -4])


@pytest.mark.parametrize(
    "lost",
    ["0 nan nan nan nan nan nan nan", "0 1 2 3 0 0 0 0", "0 0 0 0 0 0 0 0\n\n# lost"],
    ids=["nan", "zero quaternion", "comment below"],
)
def test_a_trajectory_may_begin_without_a_pose(tmp_path, lost, assert_wording):
    path = tmp_path / "poses.txt"
    path.write_text(f"# t x y z qx qy qz qw\n{lost}\n1 1 2 3 0 0 0 1\n2 1 2 4 0 0 1 0\n")
    log = read_log(path)
    assert log.format == "trajectory"
    assert log.channels["position"].time.tolist() == [1.0, 2.0]
    assert any("in 1 of 3" in note for note in log.notes)
    assert_wording(log.notes)
    gaps = tmp_path / "poses.csv"
    gaps.write_text("0,,,,,,,\n1,1,2,3,0,0,0,1\n2,1,2,4,0,0,1,0\n")
    assert read_log(gaps).channels["position"].time.tolist() == [1.0, 2.0]


def test_eight_numbers_that_are_no_pose_are_a_table(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text("0 1 2 3 4 5 6 7\n1 1 2 3 4 5 6 7\n")
    assert "no row of column names" in error_of(path)


def test_a_clock_that_runs_back_is_refused(tmp_path, assert_text):
    path = tmp_path / "poses.txt"
    path.write_text("0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 1\n0.5 1 2 3 0 0 0 1\n")
    assert_text(error_of(path))


@pytest.mark.flights
def test_a_real_recording_reads_without_a_map(flight_data_dir):
    log = read_log(flight_data_dir / "optitrack-airgarage" / "20240824_00_08_07.csv")
    assert log.format == "trajectory"
    assert log.seconds == pytest.approx(43.9, abs=0.1)
    assert len(log.channels["attitude"].time) == 2577
    np.testing.assert_allclose(np.linalg.norm(log.channels["attitude"].values, axis=1), 1)


fuzzed = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=150
)
PIECES = [b"", b",", b"\t", b"\n", b'"', b"-", b"e9999", b"1e308", b"nan", b"\x00", b"\xff", b"9"]


@pytest.fixture(scope="module")
def samples(tmp_path_factory, flight):
    folder = tmp_path_factory.mktemp("samples")
    whole: dict[str, bytes] = {}
    for name, write in WRITERS.items():
        write(flight, folder / name)
        lines = (folder / name).read_bytes().split(b"\n")
        whole[name] = b"\n".join(lines[:24])
    return whole


@fuzzed
@given(
    name=st.sampled_from(sorted(WRITERS)),
    damage=st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 40), st.sampled_from(PIECES)), max_size=5
    ),
    end=st.floats(0.01, 1),
)
def test_a_damaged_export_ends_in_a_log_or_a_log_error(tmp_path, samples, name, damage, end):
    content = samples[name]
    for place, length, inserted in damage:
        start = int(place * len(content))
        content = content[:start] + inserted + content[start + length :]
    path = tmp_path / "take"
    path.write_bytes(content[: max(int(end * len(content)), 1)])
    try:
        log = read_log(path)
    except LogError as error:
        assert re.match(re.escape(str(path)), str(error))
        assert "\n" not in str(error)
        return
    assert isinstance(log, FlightLog)
    for channel_name, channel in log.channels.items():
        assert channel.values.shape == (len(channel.time), CHANNELS[channel_name][0] or 1)
        assert np.isfinite(channel.time).all()
        assert not np.isinf(channel.values).any()
