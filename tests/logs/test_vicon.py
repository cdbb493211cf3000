"""Vicon's CSV exports: rotations of each kind, blocks, frames that were not seen."""

import numpy as np
import pytest
from mocap_writers import write_vicon
from refusals import error_of
from scipy.spatial.transform import Rotation

from rotorfit.fit.experiment.declared_vehicle import recording_options_of
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.logs import ColumnSpec, ReadOptions, read_log
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight

HELICAL = ReadOptions(columns={"attitude": ColumnSpec(name="helical")})


@pytest.fixture(scope="module")
def flight():
    return simulate_flight(*paper_vehicle("A"), Scenario(seconds=2.0), seed=3)


def edited(path, *changes):
    with path.open(newline="", encoding="utf-8") as file:
        text = file.read()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8", newline="")


@pytest.mark.parametrize("block", ["Segments", "Objects"])
@pytest.mark.parametrize("rotation", ["quaternion", "deg", "rad"])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_each_way_to_write_a_rotation(tmp_path, flight, block, rotation, delimiter):
    path = tmp_path / "take.csv"
    write_vicon(flight, path, block=block, rotation=rotation, delimiter=delimiter)
    log = read_log(path, options=HELICAL)
    np.testing.assert_allclose(log.channels["position"].values, flight.position_measured, atol=1e-8)
    read, true = (
        Rotation.from_quat(np.roll(q, -1, axis=1))
        for q in (log.channels["attitude"].values, flight.attitude_wxyz_measured)
    )
    assert (read.inv() * true).magnitude().max() < 1e-7
    assert {"Segments": "Nexus", "Objects": "Tracker"}[block] in log.channels["position"].source
    assert log.metadata["frame rate"] == "200"


def written_by_hand(path, rows, *, above="", head="Segments\n100\n,,Quad:Quad,,,,,\n"):
    columns = "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ\n,,deg,deg,deg,mm,mm,mm\n"
    path.write_text(above + head + columns + rows, encoding="utf-8")
    return path


def test_a_rotation_vector_is_the_axis_times_the_angle(tmp_path):
    """90 degrees about x, then 120 about (1, 1, 1), which takes x to y to z; two turns are none."""
    third = 120.0 / 3.0**0.5
    rows = f"5,0,90,0,0,1000,-2000,3000\n6,0,{third},{third},{third},0,0,1\n9,0,0,720,0,0,0,2\n"
    log = read_log(written_by_hand(tmp_path / "take.csv", rows))
    np.testing.assert_allclose(log.channels["position"].time, [0.0, 0.01, 0.04])
    np.testing.assert_allclose(log.channels["position"].values[0], [1.0, -2.0, 3.0])
    half = 0.5**0.5
    expected = [[half, half, 0, 0], [0.5, 0.5, 0.5, 0.5], [1, 0, 0, 0]]
    attitude = log.channels["attitude"].values
    np.testing.assert_allclose(attitude * np.sign(attitude[:, :1]), expected, atol=1e-12)


def test_three_angles_of_tracker_must_be_declared(tmp_path, flight, assert_wording):
    path = tmp_path / "take.csv"
    write_vicon(flight, path, rotation="rad")
    assert_wording(error_of(path))
    other = ReadOptions(columns={"attitude": ColumnSpec(name="euler")})
    assert_wording(error_of(path, options=other))
    both = ReadOptions(
        columns={"attitude": ColumnSpec(name="helical"), "position": ColumnSpec(name="Quad")}
    )
    assert read_log(path, options=both).format == "vicon"


def test_other_blocks_are_passed_over(tmp_path, assert_text):
    above = "Devices\n1000\n,,Pad\nFrame,Sub Frame,V\n,,V\n1,0,2\n1,1,3\n,,\n\n"
    rows = "1,0,0,0,0,1,2,3\n2,0,0,0,0,1,2,3.5\n\nTrajectories\n100\n,,Quad:M1\n"
    log = read_log(written_by_hand(tmp_path / "take.csv", rows, above=above))
    np.testing.assert_allclose(log.channels["position"].values[:, 2], [3e-3, 3.5e-3])
    written_by_hand(tmp_path / "take.csv", "1,0,0,0,0,1,2,3\n2,0,0,0,0,1,2,x\n", above=above)
    assert_text(error_of(tmp_path / "take.csv"))


def test_frames_that_are_not_seen(tmp_path, assert_text):
    """Cells that are empty, and frames that end behind their number."""
    rows = "1,0,0,0,0,1,2,3\n2,0,,,,,,\n3,0\n4,0,0,0,0,1,2,4\n5,0,,,,1,2,4\n"
    log = read_log(written_by_hand(tmp_path / "take.csv", rows))
    np.testing.assert_allclose(log.channels["attitude"].time, [0.0, 0.03])
    assert_text(log.notes)
    rows = "1,0,0,0,0,1,2,3,\n2,0,0,0,0,1,2,4,\n"
    assert (
        len(read_log(written_by_hand(tmp_path / "take.csv", rows)).channels["position"].time) == 2
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([("Objects", "Devices")], "the file has no block Segments or Objects, but 'devices', 't"),
        ([("Global Angle Quad:Quad", "")], "the file has no rigid body, only markers"),
        ([("TX,TY,TZ", "X,Y,Z")], "the rigid body 'Quad' has no TX, TY, TZ: export rotation and"),
        (
            [("mm,mm,mm\r\n1,0", "in,in,in\r\n1,0")],
            "column 7 has the unit 'in', expected mm, cm, m",
        ),
        ([("Frame,Sub", "Nr,Sub")], "line 4 begins with 'Nr,Sub Frame,RX,RY,R', expected Frame,"),
        ([(",,,,,,mm,mm,mm\r\n1,0", "1,0")], "expected Frame, Sub Frame and a row of units"),
        ([("Objects\r\n200", "Objects\r\n0")], "'0' frames per second in the second line"),
        ([("\r\n7,0,", "\r\n7,1,")], "frames have parts (Sub Frame is not 0)"),
        ([("\r\n7,0,", "\r\n3,0,")], "time goes back after frame 6, from 0.025 to 0.01 s"),
        ([("\r\n7,0,", "\r\n7,0,0,")], "line 12 has 10 cells, the header has 9"),
    ],
)
def test_other_exports_are_refused(tmp_path, flight, changes, message):
    path = tmp_path / "take.csv"
    write_vicon(flight, path)
    edited(path, *changes)
    assert message in error_of(path)


def test_two_bodies_of_one_name_are_refused(tmp_path, flight, assert_text):
    path = tmp_path / "take.csv"
    write_vicon(flight, path, names=("Quad", "Quad"))
    assert_text(error_of(path))


def test_a_block_without_frames_is_refused(tmp_path, assert_text):
    path = tmp_path / "take.csv"
    path.write_text("Objects\n100\n,,Global Angle Quad:Quad\n", encoding="utf-8")
    assert_text(error_of(path))


def test_a_c3d_file_is_reported(tmp_path, assert_text):
    path = tmp_path / "take.c3d"
    path.write_bytes(b"\x02\x50" + bytes(510))
    assert_text(error_of(path))


def test_an_experiment_file_says_body_and_kind_of_rotation(tmp_path, flight, assert_wording):
    write_vicon(flight, tmp_path / "take.csv", rotation="deg", names=("Wand", "Quad"))
    (tmp_path / "experiment.toml").write_text(
        '[airframe]\nlayout = "quad-x"\narm = 0.2\norder = "px4"\n[[configuration]]\nmass = 1.3\n'
        'flights = [{ file = "imu.csv", mocap = { file = "take.csv", '
        'columns = { position = "Quad", attitude = "helical" } } }]\n',
        encoding="utf-8",
    )
    experiment = load_experiment(tmp_path / "experiment.toml")
    recording = experiment.configuration[0].flights[0].mocap
    log = read_log(tmp_path / "take.csv", options=recording_options_of(recording))
    assert_wording(log.channels["position"].source)
