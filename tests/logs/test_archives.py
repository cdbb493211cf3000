"""Logs in zip and gzip archives, read as they are."""

import gzip
import io
import tarfile
import zipfile

import numpy as np
import pytest

from rotorfit.errors import LogError
from rotorfit.logs import archives
from rotorfit.logs.files import sha256_of
from rotorfit.logs.read import format_of, read_log

TABLE = b"time,gyro_x,gyro_y,gyro_z\n0,1,2,3\n0.01,4,5,6\n"
ULOG = b"ULog\x01\x12\x35\x01" + bytes(64)


def zipped(path, files: dict[str, bytes]):
    """Write a zip archive."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


@pytest.fixture
def plain(tmp_path):
    path = tmp_path / "flight.csv"
    path.write_bytes(TABLE)
    return path


@pytest.mark.parametrize("kind", ["zip", "zip with a folder and what macOS adds", "gz"])
def test_the_log_in_an_archive_is_the_log(tmp_path, plain, kind):
    packed = tmp_path / f"flight.{kind[:3].strip()}"
    if kind == "gz":
        packed.write_bytes(gzip.compress(TABLE))
    elif kind == "zip":
        zipped(packed, {"flight.csv": TABLE})
    else:
        zipped(packed, {"a/flight.csv": TABLE, "__MACOSX/a": b"x", "a/.D": b"y"})
    log, expected = read_log(packed), read_log(plain)
    np.testing.assert_array_equal(log.channels["gyro"].values, expected.channels["gyro"].values)
    assert (log.sha256, sha256_of(packed)) == (sha256_of(plain),) * 2


def test_a_log_among_other_files_is_found(tmp_path):
    packed = zipped(tmp_path / "post.zip", {"dump.txt": b"# dump\nset a = 1\n", "a.ulg": ULOG})
    form = format_of(packed)
    assert form is not None
    assert form.name == "ulog"


def test_another_archive_of_the_same_name_is_read_anew(tmp_path):
    packed = tmp_path / "flight.gz"
    packed.write_bytes(gzip.compress(TABLE))
    assert read_log(packed).channels["gyro"].values[1, 0] == 4
    packed.write_bytes(gzip.compress(TABLE.replace(b"4,5,6", b"40,5,6")))
    assert read_log(packed).channels["gyro"].values[1, 0] == 40


def tarred() -> bytes:
    data = io.BytesIO()
    with tarfile.open(fileobj=data, mode="w:gz") as archive:
        archive.addfile(tarfile.TarInfo("flight.csv"))
    return data.getvalue()


def zipped_bytes(**files: bytes) -> bytes:
    data = io.BytesIO()
    zipped(data, files)
    return data.getvalue()


NO_LOG = {
    "two logs": (
        lambda: zipped_bytes(a=ULOG, b=ULOG),
        "archive of 2 files (a, b), and not of one log",
    ),
    "no log among several": (
        lambda: zipped_bytes(a=b"x\n1", b=b"y\n2", c=b"", d=b""),
        "4 files (a, b, c, ...), and not of one",
    ),
    "zip cut off": (
        lambda: zipped_bytes(a=TABLE)[:-30],
        "a damaged archive (File is not a zip file): copy it again",
    ),
    "gzip cut off": (lambda: gzip.compress(TABLE)[:-9], "a damaged archive"),
    "gzip changed": (
        lambda: gzip.compress(TABLE)[:-8] + bytes(8),
        "a damaged archive (CRC check failed",
    ),
    "tar": (tarred, "an archive of several files (tar): unpack it"),
}


@pytest.mark.parametrize("kind", NO_LOG)
def test_an_archive_that_is_no_log_is_refused(tmp_path, kind):
    make, words = NO_LOG[kind]
    path = tmp_path / "post.zip"
    path.write_bytes(make())
    with pytest.raises(LogError) as refused:
        read_log(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert words in str(refused.value)


@pytest.mark.parametrize("pack", [lambda x: zipped_bytes(a=x), gzip.compress], ids=["zip", "gzip"])
def test_a_log_that_unpacks_too_large_is_refused(tmp_path, monkeypatch, pack):
    monkeypatch.setattr(archives, "LARGEST", len(TABLE) - 1)
    path = tmp_path / "post.zip"
    path.write_bytes(pack(TABLE))
    with pytest.raises(LogError, match="unpacks to more than"):
        read_log(path)
