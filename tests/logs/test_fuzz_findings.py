"""What benchmarks/fuzz.py found, one test each."""

import re
import struct

import blackbox_encoder as encoder
import numpy as np
import pytest
from dataflash_encoder import ESC, MSG, esc, log, message

from rotorfit.errors import ExperimentError, LogError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.logs import read_log


def test_a_blackbox_clock_running_back_has_no_negative_length(tmp_path):
    recorder = encoder.Recorder(i_interval=1)
    names = [f"gyroADC[{axis}]" for axis in range(3)]
    recorder.main_fields = [*encoder.MAIN_FIELDS[:2], *[(name, 1, 0, 0, 0, 0) for name in names]]
    times = [*range(5_000_000, 7_000_000, 100_000), *range(1_000_000, 4_000_000, 100_000)]
    for k, time in enumerate(times):
        recorder.record([k, time, k, -k, 7], is_intra=True)
    recorder.end()
    path = tmp_path / "back.bbl"
    path.write_bytes(bytes(recorder.data))
    assert read_log(path).seconds == pytest.approx(5.9)


@pytest.mark.parametrize("content", ["name = " + "9" * 5000, "name = " + "[" * 20_000])
def test_a_toml_that_python_cannot_read_is_no_toml(tmp_path, content):
    path = tmp_path / "experiment.toml"
    path.write_text(content)
    with pytest.raises(ExperimentError, match=r"experiment\.toml is not valid TOML"):
        load_experiment(path)


def test_a_refusal_stays_short_where_names_are_long(tmp_path, assert_wording):
    path = tmp_path / "flight.csv"
    path.write_text("(" * 9000 + "time,gyro_x\n1,2\n")
    with pytest.raises(LogError) as caught:
        read_log(path)
    message = str(caught.value)
    assert 1500 < len(message) < 2000
    assert message.startswith(f"{path}: no")
    # How many brackets are left on each side of the cut depends on the length of the folder's name.
    assert_wording(re.sub(r"\(+", "(", message))
    assert message.endswith(f"airframe {path}")
    assert message.count(" [...] ") == 1


def refusal(path, content: str) -> str:
    path.write_text(content)
    with pytest.raises(LogError) as caught:
        read_log(path)
    return str(caught.value).removeprefix(f"{path}: ")


def test_a_number_sign_in_every_row_of_a_table_is_no_comment(tmp_path, assert_text):
    rows = "".join(f"{k},1#,2,3\n" for k in range(5))
    said = refusal(tmp_path / "flight.csv", "time,gyro_x,gyro_y,gyro_z\n" + rows)
    assert_text(said)


MOTIVE = "Format Version,1.23,Length Units,Meters\n"


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        # The row of types is the last: none is below it.
        (",Name,a\n,ID,b\nFrame,Time,Rigid Body\n0,0,1\n1,1,1\n", "no rigid body"),
        (",Name,a\n,ID,b\n,,c\nFrame\n0\n1\n", "no row that begins with Frame, Time"),
    ],
)
def test_a_motive_header_that_is_cut_short(tmp_path, rows, words):
    assert words in refusal(tmp_path / "take.csv", MOTIVE + rows)


@pytest.mark.parametrize("line", ["DATA_INCLUDED", "DATA_INCLUDED\t"])
def test_a_qualisys_header_without_the_kind_of_its_data(tmp_path, line, assert_wording):
    said = refusal(tmp_path / "take.tsv", f"NO_OF_FRAMES\t9\nNO_OF_CAMERAS\t8\n{line}\n1\t2\n")
    assert "expected 6D" in said
    assert_wording(said)


def test_a_qualisys_header_without_a_frequency(tmp_path, assert_wording):
    columns = "\t".join(["Quad X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual"])
    columns += "".join(f"\tRot[{k}]" for k in range(9))
    row = "\t".join(["1"] * 16) + "\n"
    head = "NO_OF_FRAMES\t2\nNO_OF_CAMERAS\t8\nFREQUENCY\nDATA_INCLUDED\t6D\nBODY_NAMES\tQuad\n"
    said = refusal(tmp_path / "take.tsv", f"{head}{columns}\n{row}{row}")
    assert_wording(said)


def test_signalling_nans_of_esc_telemetry_are_no_speeds(tmp_path):
    """Warnings are errors here. The sixth message of the first rotor has one for its speed."""
    place = ESC.packing.index("f")  # after "<QB": RPM, then RawRPM
    at = 3 + struct.calcsize(ESC.packing[:place])
    messages = [bytearray(esc(0.01 * k, k % 4, 5000.0)) for k in range(40)]
    for number in (at, at + 4):
        messages[20][number : number + 4] = bytes.fromhex("0100807f")
    path = tmp_path / "flight.bin"
    path.write_bytes(log((ESC, MSG), [message(MSG, 0, b"Frame: QUAD/X"), *map(bytes, messages)]))
    speed = read_log(path).channels["rotor_speed"].values
    assert [*zip(*np.nonzero(np.isnan(speed)), strict=True)] == [(0, 1), (0, 2), (0, 3), (5, 0)]
    assert speed[np.isfinite(speed)] == pytest.approx(5000.0 * np.pi / 30.0)


def test_a_quaternion_too_long_for_any_number_is_no_pose(tmp_path):
    rows = "# timestamp tx ty tz qx qy qz qw\n{0} 0 0 0 {1}\n{2} 0 0 0 {1}\n"
    path = tmp_path / "poses.txt"
    said = refusal(path, rows.format(0, "1e308 1e308 1e308 1e308", 1))
    assert said.startswith("no column 'time'")  # read as any table
    path.write_text(rows.format(0, "0.5 0.5 0.5 0.5", 1))
    assert read_log(path).seconds == 1.0


def test_a_rotor_out_of_this_world_is_refused(tmp_path):
    path = tmp_path / "experiment.toml"
    rotors = "[[1e308, 0, 0], [-1e308, 1, 0], [0, -1e308, 0]]"
    entries = ", ".join(
        f'{{ position = {place}], spin = "cw" }}' for place in rotors[1:-2].split("], ")
    )
    path.write_text(f'airframe = {{ rotors = [{entries}] }}\n[[configuration]]\nflights = ["a"]\n')
    with pytest.raises(ExperimentError, match=r"m from the centre, expected 0\.01 to 5 m"):
        load_experiment(path)


def test_an_experiment_of_endless_numbers_is_refused_at_once(tmp_path):
    path = tmp_path / "experiment.toml"
    path.write_text("[airframe]\nrotors = [" + "1," * 250_000 + "]\n")
    with pytest.raises(ExperimentError, match="holds 250002 values, expected at most 20000"):
        load_experiment(path)
