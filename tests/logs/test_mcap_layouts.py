"""MCAP files that are not as the library rosbags writes them: without index, chunks, an end."""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rosbag_writers import write_mcap

from rotorfit.logs import read_log
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight


def records_in(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of each MCAP record."""
    place = 0
    while place + 9 <= len(data):
        kind, size = struct.unpack_from("<BQ", data, place)
        yield kind, data[place + 9 : place + 9 + size]
        place += 9 + size


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def chunk_of(records: list[bytes]) -> bytes:
    """An uncompressed chunk without a checksum."""
    stored = b"".join(records)
    return record(0x06, struct.pack("<QQQIIQ", 0, 0, len(stored), 0, 0, len(stored)) + stored)


def described_and_sent(path: Path) -> tuple[bytes, list[bytes], list[bytes]]:
    """Return header, definitions (schemas, channels) and messages of an MCAP file, as records."""
    header, definitions, sent = b"", [], []

    def take(data: bytes) -> None:
        nonlocal header
        for kind, content in records_in(data):
            if kind == 0x01:
                header = record(kind, content)
            elif kind in (0x03, 0x04):
                definitions.append(record(kind, content))
            elif kind == 0x05:
                sent.append(record(kind, content))
            elif kind == 0x06:  # behind times, size, checksum: the compression, empty here
                take(content[40:])

    take(path.read_bytes()[8:-8])
    return header, list(dict.fromkeys(definitions)), sent


@pytest.mark.parametrize("is_chunked", [False, True], ids=["no chunks", "overlapping chunks"])
def test_an_mcap_needs_neither_index_nor_chunks_in_order(tmp_path, is_chunked):
    """Every other message in a chunk of its own, with no index, no summary and no end."""
    flight = simulate_flight(*paper_vehicle("A"), Scenario(seconds=2.0), seed=3)
    write_mcap(flight, tmp_path / "usual")
    [usual] = (tmp_path / "usual").glob("*.mcap")
    header, definitions, sent = described_and_sent(usual)
    assert len(sent) > 1000
    parts = [chunk_of([*definitions, *sent[i::2]]) for i in (0, 1)]
    body = b"".join(parts if is_chunked else [*definitions, *sent])
    bare = tmp_path / "bare.mcap"
    bare.write_bytes(b"\x89MCAP0\r\n" + header + body)
    expected, found = read_log(usual), read_log(bare)
    assert found.channels.keys() == expected.channels.keys()
    for name, channel in expected.channels.items():
        np.testing.assert_array_equal(found.channels[name].time, channel.time)
        np.testing.assert_array_equal(found.channels[name].values, channel.values)
