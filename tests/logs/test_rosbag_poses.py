"""A ROS bag with poses and rotor speeds but no IMU, as a hall records a flight."""

import json

import pytest
from rosbag_writers import messages_of, write_messages_ros1, write_messages_ros2

import flown
from rotorfit.cli.main import main
from rotorfit.simulation import Sensors


@pytest.fixture(scope="module")
def flight():
    sensors = Sensors(position_std=3e-4, attitude_std=2e-3, pose_rate=200.0)
    return flown.simulated("quad-x", seed=1, seconds=40.0, sensors=sensors)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, flight):
    """Write the bag as a folder of ROS 2 and as a file of ROS 1, and the airframe file."""
    path = tmp_path_factory.mktemp("hall")
    told = [message for message in messages_of(flight) if message.topic != "/imu/data_raw"]
    write_messages_ros2(told, path / "bag")
    write_messages_ros1(told, path / "one.bag")
    (path / "airframe.toml").write_text(flown.airframe_table(flight.vehicle))
    return path


def said(capsys, *arguments):
    with pytest.raises(SystemExit) as ended:
        main([*map(str, arguments)])
    printed = capsys.readouterr()
    return ended.value.code, printed.out or printed.err


@pytest.mark.parametrize("name", ["bag", "one.bag"])
def test_a_bag_of_poses_is_identified_by_them(capsys, folder, flight, name, assert_wording):
    frame = ("--mass", flight.truth.mass, "--airframe", folder / "airframe.toml")
    code, words = said(capsys, "identify", folder / name, *frame)
    assert code == 1
    assert "(--source mocap)" in words
    assert_wording(words)
    code, text = said(capsys, "identify", folder / name, *frame, "--source", "mocap", "--json")
    assert code == 0
    found = {p["name"]: p["interval"] for p in json.loads(text)["parameters"]}
    for name, truth in flight.truth.parameters().items():
        if name in ("kt", "kd"):
            assert found[name][0] <= truth <= found[name][1]
    own = {d["name"]: d["interval"] for d in json.loads(text)["derived"]}
    for name in ("Ixx_com", "Iyy_com"):
        assert own[name][0] <= flight.truth.parameters()[name] <= own[name][1]


def test_the_airframe_command_ends_with_what_works(capsys, folder, tmp_path):
    answered = ("--layout", "quad-x", "--order", "px4", "--spacing", "350,350")
    out = tmp_path / "airframe.toml"
    code, text = said(capsys, "airframe", folder / "bag", "-o", out, *answered)
    assert code == 0
    assert text.rstrip().endswith(f"--airframe {out} --source mocap")


def test_inspect_says_of_poses_what_to_do_once(capsys, folder):
    for airframe in ((), ("--airframe", folder / "airframe.toml")):
        code, text = said(capsys, "inspect", folder / "bag", *airframe)
        text = " ".join(text.split())
        assert code == 0
        assert "--source mocap" in text.partition("Next step")[2]
        assert text.count("rotation rates") == 1
