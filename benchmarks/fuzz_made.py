"""Tables and flights made absurd before they are written, so that their files are whole."""

import dataclasses
import random
from collections.abc import Callable
from typing import Any

import numpy as np

NAMES = ("time", "Time", "rotor_0", "rotor_99999999", "command_1", "pos_x", "", "x" * 70000)

# Parquet

MOST_GROUPS = 50
"""Groups of rows in a Parquet file."""


def parquet_forged(data: bytes, rng: random.Random) -> bytes:
    """Write a table of any columns and types, or change columns of the one given."""
    import pyarrow as pa
    from pyarrow import parquet

    rows, many = rng.choice((0, 1, 2, 50, 2000)), np.random.default_rng(rng.getrandbits(32))
    names, arrays = [], []
    step = rng.choice((0.01, 0.01, 0.01, 0.0, -0.01, 1e300, 1e-12, float("nan")))
    with np.errstate(all="ignore"):
        known = {"time": pa.array(np.arange(rows) * step)}
    for name in ("time", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z", "rotor_1"):
        if rng.random() < 0.9:
            names.append(name if rng.random() < 0.97 else rng.choice(NAMES))
            plain = known.get(name, pa.array(many.normal(size=rows)))
            arrays.append(plain if rng.random() < 0.85 else odd_column(pa, plain, many, rng))
    sink = pa.BufferOutputStream()
    try:
        table = pa.Table.from_arrays(arrays, names=names)
        packing = rng.choice(("none", "snappy", "gzip", "zstd"))
        # In 2000 groups of one row the footer has 140 MB, and writing it takes four times as much.
        size = max(rng.choice((1, 100, 4000)), rows // MOST_GROUPS)
        parquet.write_table(table, sink, compression=packing, row_group_size=size)
    except (pa.ArrowException, ValueError, OverflowError):
        return data
    return sink.getvalue().to_pybytes()


def parquet_long_list(data: bytes, rng: random.Random) -> bytes:
    """Let a list in the footer, in Thrift's compact form, declare very many elements."""
    length = int.from_bytes(data[-8:-4], "little")
    begin, end = len(data) - 8 - length, len(data) - 8
    heads = [i for i in range(max(begin, 1), end) if data[i] & 15 == 12 and data[i - 1] & 15 == 9]
    if not heads or data[-4:] != b"PAR1":
        return data
    at, count = rng.choice(heads), rng.choice((b"\xff\x7f", b"\xbf\x84\x3d", b"\xff" * 4 + b"\x07"))
    grown = (length + len(count)).to_bytes(4, "little")
    return data[:at] + b"\xfc" + count + data[at + 1 : end] + grown + b"PAR1"


def odd_column(pa: Any, plain: Any, many: np.random.Generator, rng: random.Random) -> Any:
    """Return a column of a type or of values that no log has."""
    rows = len(plain)
    whole = many.integers(-(2**62), 2**62, rows)
    nest: list[Any] = [1.0]
    for _ in range(rng.choice((1, 3, 60))):
        nest = [nest]
    makers: tuple[Callable[[], Any], ...] = (
        lambda: pa.array([None] * rows, pa.float64()),
        lambda: pa.array([None] * rows),
        lambda: pa.array(np.full(rows, rng.choice((np.nan, np.inf, -np.inf, 1e308)))),
        lambda: pa.array(whole),
        lambda: pa.array(whole).cast(pa.uint64(), safe=False),
        lambda: pa.array(whole).cast(pa.timestamp(rng.choice(("s", "ms", "us", "ns")))),
        lambda: pa.array(whole).cast(pa.duration("us")),
        lambda: pa.array(whole % 86_400_000_000).cast(pa.time64("us")),
        lambda: pa.array(whole % 40_000).cast(pa.int32()).cast(pa.date32()),
        lambda: pa.array([str(v) for v in whole]),
        lambda: pa.array([b"\xff\0"] * rows),
        lambda: pa.array([nest] * rows),
        lambda: pa.array([{"a": 1, "b": [2]}] * rows),
        lambda: pa.array([True] * rows),
        lambda: pa.array(["a"] * rows).dictionary_encode(),
        lambda: pa.array(many.normal(size=rows)).dictionary_encode(),
        lambda: pa.array([k if k % 3 else None for k in range(rows)], pa.int64()),
        lambda: pa.array(many.normal(size=rows).astype(np.float16)),
        lambda: pa.array([1] * rows).cast(pa.decimal128(38, 10)),
    )
    return rng.choice(makers)()


# Flights that no vehicle makes, for the writers of every format

ARRAYS = ("gyro", "accel", "rotor_speed_measured", "commanded_speed", "position_measured")
TIMES = ("time", "pose_time")


def strange(flight: Any, rng: random.Random) -> Any:
    """Return a short simulated flight whose clock or values are absurd."""
    rows = rng.choice((0, 1, 2, 3, 30, 120, 400))
    part = {
        field.name: getattr(flight, field.name)[:rows].copy()
        for field in dataclasses.fields(flight)
        if isinstance(getattr(flight, field.name), np.ndarray)
    }
    many = np.random.default_rng(rng.getrandbits(32))
    for _ in range(rng.choice((1, 1, 2, 3))):
        if rng.random() < 0.5:
            name = rng.choice(TIMES)
            part[name] = odd_times(part[name], many, rng)
        else:
            name = rng.choice((*ARRAYS, "attitude_wxyz_measured"))
            part[name] = odd_values(part[name], many, rng)
    return dataclasses.replace(flight, **part)


def odd_times(t: np.ndarray, many: np.random.Generator, rng: random.Random) -> np.ndarray:
    back = t[::-1].copy()
    jump = t + np.where(np.arange(len(t)) > len(t) // 2, rng.choice((-1e3, 1e4, 1e9, -0.05)), 0.0)
    choices = (
        back,
        jump,
        many.permutation(t),
        0.0 * t,
        1e-6 * t,
        1e5 * t,
        np.round(t),
        t + 1e6,
        t // 0.1,
    )
    return rng.choice(choices)


def odd_values(x: np.ndarray, many: np.random.Generator, rng: random.Random) -> np.ndarray:
    out, value = x.copy(), rng.choice((np.nan, np.inf, -np.inf, 0.0, 1e30, -1e30, 1e308, 1e-300))
    share = rng.choice((1.0, 1.0, 0.5, 0.02))
    column = slice(None) if rng.random() < 0.5 else slice(0, 1)
    out[many.random(len(out)) < share, column] = value
    return out
