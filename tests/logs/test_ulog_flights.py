"""Two real logs of PX4: read as pyulog reads them, and told truly."""

import contextlib
import io
import json

import numpy as np
import pytest
from pyulog import ULog

from rotorfit.cli.main import main
from rotorfit.errors import FlightError
from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.flight.prepare import prepare
from rotorfit.logs import read_log
from rotorfit.logs.ulog.scan import scan_file

pytestmark = pytest.mark.flights

HOVER, DISARMED = "quadrotor_local.ulg", "sample_appended_multiple.ulg"
AIRFRAME = """
[airframe]
layout = "quad-x"
arm = 0.25
[motors]
speed = "commanded"
"""


@pytest.fixture
def folder(flight_data_dir):
    return flight_data_dir / "px4-ulog"


def same_as_pyulog(topic, data):
    for name, values in data.items():
        mine = topic.rows
        for part in name.split("."):  # such as esc[0].timestamp
            base, _, index = part.partition("[")
            mine = mine[base] if not index else mine[base][:, int(index[:-1])]
        np.testing.assert_array_equal(mine, values, err_msg=f"{topic.label}.{name}")


@pytest.mark.parametrize("file", [HOVER, DISARMED])
def test_every_message_is_as_pyulog_has_it(folder, file):
    with contextlib.redirect_stdout(io.StringIO()):
        theirs = ULog(str(folder / file))
    names = frozenset(data.name for data in theirs.data_list)
    ours = scan_file(folder / file, dict.fromkeys(names))
    assert ours.damage == ()
    for data in theirs.data_list:
        (topic,) = [t for t in ours.all(data.name) if t.instance == data.multi_id]
        same_as_pyulog(topic, data.data)
    assert set(ours.parameters) == set(theirs.initial_parameters)
    for name, value in theirs.initial_parameters.items():
        assert ours.parameters[name] == pytest.approx(value, rel=1e-6)
    for kind, defaults in ((0, ours.system_defaults), (1, ours.airframe_defaults)):
        assert set(defaults) == set(theirs.get_default_parameters(kind))


def test_the_hover_is_read(folder):
    log = read_log(folder / HOVER)
    sizes = {name: channel.values.shape for name, channel in log.channels.items()}
    assert sizes == {
        "gyro": (20236, 3),
        "accel": (20236, 3),
        "command": (926, 4),
        "battery": (464, 1),
        "reference": (4625, 3),
    }
    assert log.seconds == pytest.approx(92.4755, abs=1e-3)
    flying = (log.channels["accel"].time > 112) & (log.channels["accel"].time < 194)
    hover = log.channels["accel"].values[flying].mean(axis=0)
    assert hover == pytest.approx([0.15, 0.27, 9.8], abs=0.15)
    # What was sent, 1100 to 1900 us, is the command.
    sent = scan_file(folder / HOVER, {"actuator_outputs": None}).all("actuator_outputs")[0]
    pulses = sent.column("output")[:, :4]
    share = np.clip((pulses - 1100) / 800, 0, 1)
    # Half of the messages are of the same cycle of the controller; the others are close.
    command = log.channels["command"]
    off = np.abs(share - command.values)
    same = np.abs(sent.time - command.time) < 0.0005
    assert same.sum() > 400
    assert off[same].max() <= 0.5001 / 800
    assert off.max() < 0.02
    assert log.metadata["Firmware revision"] == "PX4 1.16.1 release candidate"
    assert (log.metadata["Board"], log.metadata["SYS_AUTOSTART"]) == ("PX4_FMU_V6C", "4001")


def test_the_hover_is_read_truly(folder, assert_wording):
    log = read_log(folder / HOVER)
    (doubt,) = log.warnings
    assert "at 10 Hz," in doubt
    assert_wording(doubt)
    assert "set SDLOG_PROFILE = 17" in doubt
    assert log.metadata["airframe is"] == "default"
    assert any("of 1.41 m)" in note for note in log.notes)
    assert_wording(log.notes)
    assert "position = [1.0, -1.0," in log.metadata["airframe"]
    assert "0.0], spin" in log.metadata["airframe"]
    assert_wording(log.metadata["airframe"])
    assert "Armed 0.0 to 91.5 s." in log.notes
    assert any("ground 5.1 to 90.7" in note for note in log.notes)


def test_the_disarmed_log_is_read_truly(folder, assert_wording):
    log = read_log(folder / DISARMED)
    assert not log.channels["command"].values.any()
    assert log.channels["command"].source.endswith("1075..1950 (PWM_MIN, PWM_MAX)")
    assert_wording(log.warnings[0])
    assert any("3 stretches" in note for note in log.notes)
    assert_wording(log.notes)
    assert log.channels["accel"].values.mean(axis=0)[2] == pytest.approx(9.9, abs=0.1)


def test_a_disarmed_log_is_not_taken_for_a_flight(folder):
    motors = MotorModel(speed="commanded")
    with pytest.raises(FlightError, match="the motors never turn in this log"):
        prepare(read_log(folder / DISARMED), rotor_count=4, arm=0.25, motors=motors)


def test_a_slow_hover_is_distinguished_from_the_ground(folder):
    """Its commands grow by a tenth as the battery sags; their quick part lifts the vehicle."""
    motors = MotorModel(speed="commanded")
    flight = prepare(read_log(folder / HOVER), rotor_count=4, arm=0.25, motors=motors)
    assert len(flight.data.used_rows) / flight.data.sample_rate > 70.0


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in arguments])
    return ended.value.code, capsys.readouterr()


def test_identify_gives_no_inertia_of_the_hover(folder, tmp_path, capsys):
    airframe = tmp_path / "quad.toml"
    airframe.write_text(AIRFRAME)
    request = ["identify", folder / HOVER, "--mass", "2", "--airframe", airframe, "--json"]
    code, output = run(capsys, *request)
    assert code in (0, None)
    result = json.loads(output.out)
    verdicts = {p["name"]: p["verdict"] for p in result["parameters"]}
    for name in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz", "kd", "Jr"):
        assert verdicts[name] != "identified"
    said = " ".join(result["warnings"] + [w for f in result["flights"] for w in f["warnings"]])
    assert "set SDLOG_PROFILE = 17" in said
