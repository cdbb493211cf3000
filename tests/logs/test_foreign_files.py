"""Files that people keep beside their logs are named, with the file to give in their place."""

import io
import re
import zipfile

import numpy as np
import pytest

from rotorfit.errors import LogError
from rotorfit.logs.foreign import FOREIGN
from rotorfit.logs.formats import is_table
from rotorfit.logs.proposal import propose_columns
from rotorfit.logs.read import read_log
from rotorfit.logs.table import open_table


def archive(name):
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as file:
        file.writestr(name, b"content")
    return data.getvalue()


def npz():
    data = io.BytesIO()
    np.savez(data, time=np.arange(3))
    return data.getvalue()


TLOG = (1_700_000_000_000_000).to_bytes(8, "big") + b"\xfd\x09\0\0\0\x01\x01\0\0\0" + bytes(30)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (npz(), r"NumPy archive \(\.npz\)"),
        (archive("[Content_Types].xml"), "a spreadsheet"),
        (archive("mimetype"), "a zip archive"),
        (b"PK\x05\x06" + bytes(18), "a zip archive without files"),
        (b"MATLAB 7.3 MAT-file, Platform: PCWIN64", "a MATLAB file"),
        (b"\x89HDF\r\n\x1a\n" + bytes(50), "an HDF5 file"),
        (b"\x93NUMPY\x01\x00v\x00", r"a NumPy array \(\.npy\)"),
        (b"\x80\x04\x95\x10\0\0", "a Python pickle"),
        (TLOG, r"telemetry log .*\(\.tlog\).*\.bin of ArduPilot"),
        (bytes(16) + b"BUILD 2017" + bytes(9), "a DJI flight record"),
        (b"2019-05-01 10:00:00.12: IMU {TimeUS : 12, GyrX : 0.1}\n", "printed by mavlogdump"),
        (b"MOT_THST_EXPO,0.65\nFRAME_CLASS,1\nSERVO1_FUNCTION,33\n", "parameters of an autopilot"),
        (b"# Onboard parameters for Vehicle 1\n1\t1\tCA_X\t1\t9\n", "parameters of an autopilot"),
        (b"# version\n# Betaflight / STM32F7X2 4.4.0\nset gyro = 1\n", "Betaflight or INAV"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:ab\nsize 12\n", "Git LFS"),
        (b"QGC WPL 110\n0\t1\t0\t16\t0\t0\n", "a mission"),
        (
            b"Dear pilot,\nthe battery is charged, and the log is on the card.\n",
            "text without rows",
        ),
        (
            b"Notes, taken on the field at the house:\nit flew seven times in a row, 28 min, 3\n",
            "text without rows",
        ),
        (b"\x89PNG\r\n\x1a\n", "an image, which rotorfit does not read: give a flight log$"),
    ],
)
def test_a_file_is_named_with_what_to_give(tmp_path, content, words):
    path = tmp_path / "flight.bin"
    path.write_bytes(content)
    with pytest.raises(LogError, match=words):
        read_log(path)


@pytest.mark.parametrize(
    "text",
    [
        b"time,gyro_x\n0,1\n0.1,2\n",
        b"time,gyro_x,gyro_y\n",
        b"Date,Time,mode,flag,gyro_x\n2024-01-01,12:00:01,ACRO,ARM,0.5\n",
        b"time;accel_x\n0;\n;\n;1\n",
        b"t\n1\n2\n",
        b"# by hand\ntime gyro_x\n1 2\n",
    ],
)
def test_tables_stay_tables(text):
    assert is_table(text)
    assert not any(recognises(text) for _, recognises in FOREIGN)


def test_settings_of_blackbox_explorer_are_skipped(tmp_path):
    settings = '"Product","Blackbox flight data recorder"\n"minthrottle","1070"\n"gyro_scale","1"\n'
    names = [
        *("loopIteration", "time", "gyroADC[0]", "gyroADC[1]", "gyroADC[2]", "accSmooth[0]"),
        *("accSmooth[1]", "accSmooth[2]", "motor[0]", "motor[1]", "motor[2]", "motor[3]"),
    ]
    rows = [[8 * i, 5_000_000 + 1000 * i, 1, 2, i, 3, 4, 2048, *([300 + i] * 4)] for i in range(60)]
    table = "\n".join([",".join(f'"{n}"' for n in names), *(",".join(map(str, r)) for r in rows)])
    path = tmp_path / "explorer.csv"
    path.write_text(settings + table)
    source = open_table(path)
    assert source.names == tuple(names)
    assert source.place(0) == "line 5"
    np.testing.assert_array_equal(source.numbers(["gyroADC[2]"])[:, 0], np.arange(60))
    columns = propose_columns(path).columns
    assert (columns["time"].unit, columns["command_1"].range) == ("us", (48.0, 2047.0))


def test_every_kind_says_what_it_is_once():
    titles = [re.split(":", words)[0] for words, _ in FOREIGN]
    assert len(set(titles)) == len(titles)
