"""Whatever rosbags, or what it is built on, raises is a LogError of one line that names it."""

import struct
from types import SimpleNamespace

import apsw
import pytest
from backports import zstd
from refusals import error_of
from rosbag_writers import EPOCH, Sent, write_messages_ros1, write_messages_ros2
from rosbags.rosbag1 import ReaderError as ReaderError1
from rosbags.rosbag1.reader import Header
from rosbags.rosbag2 import ReaderError as ReaderError2
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError
from rosbags.typesys.store import Typestore

from rotorfit.errors import LogError
from rotorfit.logs import read_log
from rotorfit.logs.rosbag import contents, ros2
from rotorfit.logs.rosbag.stream import DamageError, decoded

STRAYS = [
    ReaderError1("a"),
    ReaderError2("a"),
    SerdeError("a"),
    TypesysError("a"),
    struct.error("a"),
    apsw.CorruptError("a"),
    zstd.ZstdError("a"),
    RuntimeError("a"),  # lz4
    OSError("a"),  # bz2
    EOFError("a"),
    KeyError("a"),
    IndexError("a"),
    AssertionError("a"),
    AttributeError("a"),
    TypeError("a"),
    ValueError("a"),
    OverflowError("a"),
    RecursionError("a"),
    SyntaxError("a"),
    UnicodeDecodeError("utf-8", b"a", 0, 1, "a"),
]
strays = pytest.mark.parametrize("stray", STRAYS, ids=lambda stray: type(stray).__name__)


def messages():
    for k in range(3):
        fields = {"angular_velocity": {"x": 0.1 * k}}
        stamp = EPOCH + 10_000_000 * k
        yield Sent("/imu", "sensor_msgs/msg/Imu", stamp, stamp + 1_000_000, fields)


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    write_messages_ros1(messages(), folder / "bag")
    write_messages_ros2(messages(), folder / "db3")
    write_messages_ros2(messages(), folder / "mcap", storage=StoragePlugin.MCAP)
    packed = {"storage": StoragePlugin.MCAP, "compression": "storage"}
    write_messages_ros2(messages(), folder / "zstd", **packed)
    return folder


def raising(error):
    def call(*args, **kwargs):
        raise error

    return call


def refused(path, error):
    """Return what is said where an error is raised inside of rosbags."""
    with pytest.raises(LogError) as caught:
        read_log(path)
    assert caught.value.__cause__ is error
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


def raising_later(error):
    def call(*args):
        raise error
        yield

    return call


def decompressor(error):
    return lambda: SimpleNamespace(decompress=raising(error))


def typestore(error):
    class Broken(Typestore):
        def get_msgdef(self, typename):
            made = super().get_msgdef(typename)
            object.__setattr__(made, "deserialize_cdr_le", raising(error))
            return made

    return Broken


MISFIT = "/imu (3 messages unreadable: a message does not fit its definition ({}: "
SITES = {
    "opening a database": ("db3", Sqlite3Reader, "open", raising, "damaged SQLite database ({}: "),
    "the rows of a database": (
        *("db3", Sqlite3Reader, "messages", raising_later),
        "the database is damaged from some message on (1 times)",
    ),
    "a record of ROS 1": ("bag", Header, "get_time", raising, "a message is damaged (3 times)"),
    "a record of MCAP": (
        *("mcap", ros2, "read_bytes", raising),
        "the description of a topic is damaged",
    ),
    "a chunk": ("zstd", zstd, "ZstdDecompressor", decompressor, "a chunk is damaged (1 times)"),
    "a definition": (
        *("db3", contents, "get_types_from_msg", raising),
        "/imu (3 messages unreadable: ",
    ),
    "a message": ("mcap", contents, "Typestore", typestore, MISFIT),
}
"""Bag, what of rosbags fails in it, how, and what is said."""


@strays
@pytest.mark.parametrize("site", SITES)
def test_whatever_rosbags_raises_is_named(bags, monkeypatch, site, stray, assert_wording):
    contents.built_in("cdr")
    bag, owner, name, failing, expected = SITES[site]
    monkeypatch.setattr(owner, name, failing(stray))
    message = refused(bags / bag, stray)
    assert expected.format(type(stray).__name__) in message
    if site == "opening a database":
        assert message.endswith("with sqlite3 .recover")
        assert_wording(message)


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (MemoryError(), "needs more memory than there is (MemoryError)"),
        (OSError(5, "Input/output error"), "cannot be read ([Errno 5] Input/output error): check "),
        (KeyboardInterrupt(), ""),
    ],
)
def test_what_is_no_fault_of_the_file_passes(bags, monkeypatch, error, message):
    monkeypatch.setattr(Sqlite3Reader, "open", raising(error))
    if isinstance(error, KeyboardInterrupt):
        with pytest.raises(KeyboardInterrupt):
            read_log(bags / "db3")
    else:
        assert message in error_of(bags / "db3")


def test_the_words_of_an_error_stay_one_short_line(assert_wording):
    with pytest.raises(DamageError) as caught:
        decoded(raising(ValueError("two\nlines \x00 and " + "long " * 1000)))
    assert_wording(str(caught.value))
    assert len(str(caught.value)) < 200


def test_a_path_is_no_uri(bags, tmp_path):
    path = tmp_path / "100% sure? #1.db3"
    path.write_bytes((bags / "db3" / "db3.db3").read_bytes())
    assert len(read_log(path).channels["gyro"].time) == 3
