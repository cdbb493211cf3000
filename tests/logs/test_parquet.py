"""Parquet tables: every kind of number comes through, and damage ends in a LogError."""

import datetime
import io
import random
import re
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reading_ends import ended, faults

from rotorfit.errors import LogError
from rotorfit.logs import read_log
from rotorfit.logs.table import open_parquet

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")


def parquet(columns, **options) -> bytes:
    buffer = io.BytesIO()
    pq.write_table(pa.table(columns), buffer, **options)
    return buffer.getvalue()


def written(tmp_path, content: bytes, name: str = "a.parquet"):
    path = tmp_path / name
    path.write_bytes(content)
    return path


BATTERY = {"time": [0.0, 0.1], "battery": [12.0, 11.0]}


def test_it_is_recognised_under_any_name(tmp_path):
    path = written(tmp_path, parquet(BATTERY), "flight.csv")
    assert read_log(path).channels["battery"].values.tolist() == [[12.0], [11.0]]


@pytest.mark.parametrize(
    ("column", "expected"),
    [
        (pa.array([1, None, 3], pa.int16()), [1, np.nan, 3]),
        (pa.array([1, 2, 2**63], pa.uint64()), [1, 2, 2.0**63]),
        (pa.array([0.5, None, np.nan], pa.float32()), [0.5, np.nan, np.nan]),
        (pa.array(np.array([0.5, 1, 2], np.float16)), [0.5, 1, 2]),
        (pa.nulls(3), [np.nan] * 3),
        (pa.array([1, 2, 3]).cast(pa.decimal128(30, 2)), [1, 2, 3]),
        (pa.array([0, 10, None], pa.duration("us")), [0, 1e-5, np.nan]),
        (pa.array([0, 10, 20], pa.time32("ms")), [0, 0.01, 0.02]),
        (pa.array([0, 10, 20], pa.time64("ns")), [0, 1e-8, 2e-8]),
        (pa.array([1, 2, 3], pa.timestamp("ms", tz="UTC")), [1e-3, 2e-3, 3e-3]),
        (pa.array([datetime.date(1970, 1, 2)] * 3), [86400.0] * 3),
    ],
    ids=lambda value: str(value.type) if isinstance(value, pa.Array) else "",
)
def test_every_kind_of_number_comes_through(column, expected):
    table = open_parquet(parquet({"x": column, "other": ["a", "b", "c"]}))
    assert table.names == ("x", "other")
    np.testing.assert_allclose(table.numbers(["x"])[:, 0], expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("column", "kind"),
    [
        (["a", "b"], "string"),
        ([True, False], "bool"),
        ([[1.0], [2.0]], "list<element: double>"),
        ([{"a": 1}, {"a": 2}], "struct<a: int64>"),
    ],
)
def test_what_is_no_number_is_refused(tmp_path, column, kind):
    path = written(tmp_path, parquet({"time": [0.0, 0.1], "battery": column}))
    message = f"{path}: column 'battery' holds {kind}, expected numbers: convert it first"
    with pytest.raises(LogError, match=f"^{re.escape(message)}$"):
        read_log(path)


def test_gaps_leave_no_sample(tmp_path):
    columns = {"time": pa.array([0, 10_000, 20_000], pa.duration("us")), "battery": [12, None, 11]}
    log = read_log(written(tmp_path, parquet(columns)))
    np.testing.assert_allclose(log.channels["battery"].time, [0, 0.02])
    np.testing.assert_array_equal(log.channels["battery"].values[:, 0], [12, 11])


def test_without_pyarrow_the_refusal_names_the_install_command(tmp_path, monkeypatch):
    path = written(tmp_path, parquet(BATTERY))
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(LogError, match=re.escape("pip install 'rotorfit[parquet]', or save as")):
        read_log(path)


@pytest.mark.parametrize("length", [4, 8, 100, -9, -8, -4, -1])
def test_a_file_cut_off_anywhere_is_refused(tmp_path, length):
    path = written(tmp_path, parquet(BATTERY)[:length])
    with pytest.raises(LogError, match=r"Parquet file (without its end: it was cut|\()"):
        read_log(path)


def test_a_small_file_of_very_many_rows_is_refused(tmp_path):
    rows = 10_000_000
    same = pa.DictionaryArray.from_arrays(np.zeros(rows, np.int8), [1.0])
    content = parquet({"time": same, "battery": same}, store_schema=False)
    assert len(content) < 100_000
    with pytest.raises(LogError, match=r"declares 10000000 rows, 160 MB: damaged or no flight log"):
        read_log(written(tmp_path, content))


def footer_heads(content: bytes) -> list[int]:
    """Find where lists of structures begin in the footer, in Thrift's compact form."""
    end = len(content) - 8
    begin = end - int.from_bytes(content[-8:-4], "little")
    heads = range(begin + 1, end)
    return [i for i in heads if content[i] & 15 == 12 and content[i - 1] & 15 == 9]


def test_a_list_longer_than_the_footer_takes_no_memory(tmp_path):
    """Three bytes that declare a million columns took 680 MB before the file was refused."""
    content = parquet(BATTERY)
    refused = list[str]()
    for at in footer_heads(content):
        million = b"\xfc\xbf\x84\x3d"
        length = int.from_bytes(content[-8:-4], "little") + len(million) - 1
        forged = content[:at] + million + content[at + 1 : -8]
        with pytest.raises(LogError) as caught:
            read_log(written(tmp_path, forged + length.to_bytes(4, "little") + b"PAR1"))
        refused.append(str(caught.value))
    assert sum("Exceeded size limit" in words for words in refused) >= 3  # schema, groups, columns


def test_very_many_row_groups_and_columns_are_read(tmp_path):
    """The limit on lists is above what files have."""
    table = {"time": np.arange(400) / 100, "battery": np.full(400, 12.0)}
    more = {f"c{k}": np.zeros(400) for k in range(300)}
    for columns, size in (((table | more), 400), (table, 1)):
        log = read_log(written(tmp_path, parquet(columns, row_group_size=size)))
        assert len(log.channels["battery"].time) == 400


def test_a_page_said_to_fill_the_memory_is_refused(tmp_path):
    """Pages of 80 MB of one text, packed to some kilobytes."""
    text = pa.array(["a" * 1000] * 80_000)
    content = parquet({"time": np.arange(80_000) / 1e3, "battery": np.zeros(80_000), "note": text},
                      use_dictionary=False, compression="zstd")  # fmt: skip
    content_size = len(content)
    with pytest.raises(LogError, match=f"of {content_size} bytes declares 80000 rows, 8. MB"):
        read_log(written(tmp_path, content))


def test_memory_that_is_refused_is_no_log(tmp_path, monkeypatch):
    def full(*_, **__):
        raise MemoryError("malloc of size 8589934592 failed")

    monkeypatch.setattr(pq.ParquetFile, "iter_batches", full)
    with pytest.raises(LogError, match=r"\(malloc of size 8589934592 failed\): write it again"):
        read_log(written(tmp_path, parquet(BATTERY)))


# --- damage --------------------------------------------------------------------------------------


def _samples() -> list[bytes]:
    """Small tables in every compression and in most encodings."""
    n = 60
    columns = {
        "time": np.arange(n) / 250,
        "rotor_1": np.linspace(400, 500, n, dtype=np.float32),
        "command_1": np.arange(n) % 2,
        "battery": pa.array([None if i % 7 else 12.0 for i in range(n)]),
    }
    split = {"rotor_1": "BYTE_STREAM_SPLIT", "command_1": "DELTA_BINARY_PACKED"}
    shapes = [
        {},
        {"use_dictionary": False, "column_encoding": split},
        {"data_page_version": "2.0", "row_group_size": 20, "data_page_size": 100},
    ]
    kinds = ["none", "snappy", "gzip", "zstd", "lz4", "brotli"]
    return [parquet(columns, compression=kind, **shape) for kind in kinds for shape in shapes]


SAMPLES = _samples()


def faults_of(path, content: bytes) -> list[str]:
    path.write_bytes(content)
    return faults(path, ended(path))


def mutated(content: bytes, rng: random.Random) -> bytes:
    """Change some bytes, half of them in the metadata at the end, between the two magic words."""
    data = bytearray(content)
    metadata = int.from_bytes(data[-8:-4], "little")
    for _ in range(rng.choice([1, 1, 2, 4, 16])):
        first = len(data) - 8 - metadata if rng.random() < 0.5 else 4
        at = rng.randrange(max(4, first), len(data) - 4)
        match rng.choice(["flip", "set", "cut", "insert"]):
            case "flip":
                data[at] ^= 1 << rng.randrange(8)
            case "set":
                data[at] = rng.choice([0, 1, 127, 128, 255])
            case "cut":
                del data[at : min(at + rng.randrange(1, 8), len(data) - 8)]
            case _:
                data[at:at] = rng.randbytes(rng.randrange(1, 8))
    return bytes(data)


@pytest.fixture(scope="session")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("parquet") / "a.parquet"


@settings(deadline=None)
@given(sample=st.sampled_from(SAMPLES), seed=st.integers(0, 1 << 32))
def test_a_damaged_file_ends_in_a_log_or_a_log_error(scratch, sample, seed):
    assert faults_of(scratch, mutated(sample, random.Random(seed))) == []


@pytest.mark.slow
def test_20000_damaged_files_end_in_a_log_or_a_log_error(scratch):
    rng = random.Random(0)
    for _ in range(20_000):
        assert faults_of(scratch, mutated(rng.choice(SAMPLES), rng)) == []
