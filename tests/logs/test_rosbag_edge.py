"""Whatever rosbags, or what it is built on, raises is a LogError of one line that names it."""

import struct

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

from rotorfit.errors import LogError
from rotorfit.logs import read_log
from rotorfit.logs.rosbag import definitions, mcap, unfold
from rotorfit.logs.rosbag.edge import DamageError, decoded

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
    zstd = {"storage": StoragePlugin.MCAP, "compression": "storage"}
    write_messages_ros2(messages(), folder / "zstd", **zstd)
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


@strays
def test_a_database_that_cannot_be_opened(bags, monkeypatch, stray):
    monkeypatch.setattr(Sqlite3Reader, "open", raising(stray))
    said = refused(bags / "db3", stray)
    assert f"damaged SQLite database ({type(stray).__name__}: " in said
    assert said.endswith("copy it again, or repair it with sqlite3 .recover")


@strays
def test_a_database_that_ends_early(bags, monkeypatch, stray):
    def broken(*args):
        raise stray
        yield

    monkeypatch.setattr(Sqlite3Reader, "messages", broken)
    assert "the database is damaged from some message on (1 times)" in refused(bags / "db3", stray)


@strays
def test_a_record_of_a_ros1_bag(bags, monkeypatch, stray):
    monkeypatch.setattr(Header, "get_time", raising(stray))
    assert "a message is damaged (3 times)" in refused(bags / "bag", stray)


@strays
def test_a_record_of_an_mcap_file(bags, monkeypatch, stray):
    monkeypatch.setattr(mcap, "read_bytes", raising(stray))
    said = refused(bags / "mcap", stray)
    assert "the description of a topic is damaged" in said


@strays
def test_a_chunk_that_does_not_unfold(bags, monkeypatch, stray):
    class Broken:
        decompress = staticmethod(raising(stray))

    monkeypatch.setattr(unfold, "_decompressor", lambda compression: Broken())
    assert "a chunk is damaged (1 times)" in refused(bags / "zstd", stray)


@strays
def test_a_definition_that_cannot_be_read(bags, monkeypatch, stray):
    definitions._built_in("cdr")
    monkeypatch.setattr(definitions, "get_types_from_msg", raising(stray))
    said = refused(bags / "db3", stray)
    assert "/imu (3 messages unreadable: " in said


@strays
def test_a_message_that_cannot_be_read(bags, monkeypatch, stray):
    class Broken(definitions.Typestore):
        def get_msgdef(self, typename):
            made = super().get_msgdef(typename)
            object.__setattr__(made, "deserialize_cdr_le", raising(stray))
            return made

    monkeypatch.setattr(definitions, "Typestore", Broken)
    said = refused(bags / "mcap", stray)
    why = f"a message does not fit its definition ({type(stray).__name__}: "
    assert f"/imu (3 messages unreadable: {why}" in said


def test_what_is_no_fault_of_the_file_passes(bags, monkeypatch):
    monkeypatch.setattr(Sqlite3Reader, "open", raising(MemoryError()))
    assert "needs more memory than there is (MemoryError)" in error_of(bags / "db3")
    monkeypatch.setattr(Sqlite3Reader, "open", raising(OSError(5, "Input/output error")))
    assert "cannot be read ([Errno 5] Input/output error): check the" in error_of(bags / "db3")
    monkeypatch.setattr(Sqlite3Reader, "open", raising(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        read_log(bags / "db3")


def test_the_words_of_an_error_stay_one_short_line():
    with pytest.raises(DamageError) as caught:
        decoded(raising(ValueError("two\nlines \x00 and " + "long " * 1000)))
    assert str(caught.value).startswith("ValueError: two lines \ufffd and long long")
    assert len(str(caught.value)) < 200


def test_a_path_is_no_uri(bags, tmp_path):
    path = tmp_path / "100% sure? #1.db3"
    path.write_bytes((bags / "db3" / "db3.db3").read_bytes())
    assert len(read_log(path).channels["gyro"].time) == 3
