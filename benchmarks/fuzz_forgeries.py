"""Files that are whole on the outside and lie inside: forged fields, records, columns, flights.

Damage to any byte seldom gets past the first check of a reader. Here the lengths around a lie are
right: a table keeps its cells, a bag its records, a database its pages. A forgery takes the bytes
of a log and a source of choices, and returns the bytes of another.
"""

import random
import re
import sqlite3
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.fuzz_made import parquet_forged, parquet_long_list

Forgery = Callable[[bytes, random.Random], bytes]

CELLS = (
    *("nan", "NaN", "inf", "-inf", "1e308", "-1e308", "1e999", "1e-320", "-0", "", " ", "0x1p3"),
    *("1_000", "1,5", '"1"', '"', "'", "#", "9" * 400, "9" * 5000, "-1", "18446744073709551616"),
    *("1e18", "\u0661\u0662", "true", "None", "65536", "2147483648", "\x00", "\u2028", "0", "1e-9"),
)
NAMES = (
    *(
        "time",
        "Time",
        "TIME",
        "gyro_x",
        "gyro_y",
        "accel_z",
        "rotor_1",
        "rotor_0",
        "rotor_99999999",
    ),
    *("command_1", "command_999999999999999999999", "battery", "pos_x", "quat_w", "roll", "", " "),
    *("rotor_-1", "rotor_\u0661", "time [ms]", "x" * 70000, "Quad X", "Rigid Body", "Position"),
)
DEFINITIONS = (
    *("float[4294967295] x", "float[99999999999999999999] x", "float[-1] x", "float[0] x", "a a"),
    *(
        "uint8_t[65535] a;" * 40,
        "",
        ";" * 500,
        ":",
        "a:",
        ":uint64_t timestamp",
        "timestamp",
        "\x00",
    ),
    *("float64[] x\n" * 500, "string[] s\nImu[] i\n", "a/A[1000] a\n===\nMSG: a/A\na/A[1000] a\n"),
    *("a/A x\n===\nMSG: a/A\nb/B x\n===\nMSG: b/B\na/A x\n", "float64[4294967295] x\n"),
    *(
        "esc_status:uint64_t timestamp;esc_status[8] esc",
        "uint8[<=99999999999] x\n",
        "int32 X=1e999",
    ),
)
WORDS = (
    *(bytes([b]) * n for b in (0, 0x7F, 0x80, 0xFF) for n in (1, 2, 4, 8)),
    *(struct.pack(f"<{k}", v) for k in "fd" for v in (float("nan"), float("inf"), -1e30, 1e-38)),
    *(struct.pack("<Q", v) for v in (1, 1 << 31, 1 << 32, 1 << 53, (1 << 63) - 1, 1 << 63)),
    *(struct.pack("<I", v) for v in (1, 1 << 16, 1 << 20, 1 << 30, (1 << 31) - 1, 1 << 31)),
    *(struct.pack("<H", v) for v in (0, 1, 255, 256, 32767, 65535)),
)


def bulk(rng: random.Random) -> random.Random:
    """Return a source for many small choices, which are one choice of the search."""
    return random.Random(rng.getrandbits(32))


# Any file


def at_every(data: bytes, rng: random.Random) -> bytes:
    """Put the same lie at the same place after every occurrence of three bytes: into a field."""
    start = rng.randrange(max(len(data) - 3, 1))
    mark, shift = data[start : start + rng.choice((1, 2, 3))], rng.randrange(-8, 64)
    word, share, many = rng.choice(WORDS), rng.choice((1.0, 1.0, 0.5, 0.01)), bulk(rng)
    out, place = bytearray(data), -1
    for _ in range(20_000):
        place = data.find(mark, place + 1)
        if place < 0:
            break
        at = place + shift
        if 0 <= at <= len(out) - len(word) and many.random() < share:
            out[at : at + len(word)] = word
    return bytes(out)


# Text


def text_lines(data: bytes) -> tuple[list[str], str]:
    text = data.decode("utf-8", "replace")
    end = "\r\n" if "\r\n" in text else "\n"
    return text.split(end), end


def cells_forged(data: bytes, rng: random.Random) -> bytes:
    """Change cells: one, a whole column, or a row; in the header as in the numbers."""
    lines, end = text_lines(data)
    separator = max(",\t; ", key=lambda mark: sum(line.count(mark) for line in lines[:20]))
    words = CELLS if rng.random() < 0.7 else NAMES
    many, column = bulk(rng), rng.randrange(40)
    first = rng.choice((0, 0, 1, 12, rng.randrange(max(len(lines), 1))))
    reach = rng.choice((1, 1, 1, 30, len(lines)))
    word, share = rng.choice(words), rng.choice((1.0, 0.3))
    for k in range(first, min(first + reach, len(lines))):
        cells = lines[k].split(separator)
        if many.random() < share and column < len(cells):
            cells[column] = word
        elif reach == 1:
            cells = [word if many.random() < 0.5 else cell for cell in cells]
        lines[k] = separator.join(cells)
    return end.join(lines).encode("utf-8", "replace")


def lines_forged(data: bytes, rng: random.Random) -> bytes:
    """Reverse, shuffle, repeat, drop lines; leave the header alone, or a few rows."""
    lines, end = text_lines(data)
    head = rng.choice((0, 1, 2, 7, 11))
    top, rows = lines[:head], lines[head:]
    how = rng.randrange(8)
    if how == 0:
        rows.reverse()
    elif how == 1:
        bulk(rng).shuffle(rows)
    elif how == 2:
        rows = [row for row in rows for _ in range(rng.choice((2, 3)))]
    elif how == 3:
        rows = rows[: rng.choice((0, 1, 2, 3, 4, 10))]
    elif how == 4:
        top = [line for line in top for _ in range(2)]
    elif how == 5:
        rows.insert(rng.randrange(len(rows) + 1), ",".join(["1"] * rng.choice((1, 1000, 100_000))))
    elif how == 6:
        rows = [*rows, *rows]
    else:
        mark = rng.choice(",\t; ")
        top = [mark.join([line] * rng.choice((2, 50, 300))) for line in top]
    return end.join([*top, *rows]).encode("utf-8", "replace")


def encoded_otherwise(data: bytes, rng: random.Random) -> bytes:
    """Write the text with other line ends, marks or encodings, or none."""
    text = data.decode("utf-8", "replace")
    how = rng.randrange(7)
    if how == 0:
        many = bulk(rng)
        return "".join(
            line + many.choice(("\n", "\r\n", "\r", "\n\n", "\v", "\u2028", " \n"))
            for line in text.splitlines()
        ).encode()
    if how == 1:
        return text.replace("\n", rng.choice(("\r", " ", "\x00\n", ""))).encode()
    codec = ("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "cp037")[how - 2]
    coded = text.encode(codec, "replace")
    return coded[: len(coded) - rng.choice((0, 0, 1))]


def numbers_forged(data: bytes, rng: random.Random) -> bytes:
    """Change some of the numbers in the first lines or anywhere, whatever is around them."""
    many, word = bulk(rng), rng.choice(CELLS).encode()
    share, reach = rng.choice((0.02, 0.2)), rng.choice((500, 3000, len(data)))
    head = re.sub(rb"\d+", lambda m: word if many.random() < share else m[0], data[:reach])
    return head + data[reach:]


# Records


def mutated_field(body: bytes, rng: random.Random) -> bytes:
    """Change one field of a record, its size, or all of it."""
    how = rng.randrange(6)
    if how == 0:
        return body[: rng.randrange(len(body) + 1)]
    if how == 1:
        return body + rng.choice((b"\0", b"\xff" * 8, b"\0" * 3000))
    if how == 2:
        return rng.choice(DEFINITIONS).encode()
    if how == 3:
        head = rng.choice((0, 2, 4, 8, 20))
        return body[:head] + rng.choice((*DEFINITIONS, *NAMES)).encode()
    word = rng.choice(WORDS)
    at = rng.choice((0, 1, 2, 4, 8, 12, 16, rng.randrange(len(body) + 1)))
    return body[:at] + word + body[at + len(word) :]


def records_forged(records: list[Any], rng: random.Random, kind: Callable[[Any], object]) -> None:
    """Change, repeat, drop or move records of one kind, in place; the body comes last."""
    if not records:
        return
    wanted = kind(records[rng.randrange(len(records))])
    if rng.random() < 0.5:  # rare kinds, too: definitions
        wanted = rng.choice(sorted({kind(one) for one in records}, key=repr))
    these = [k for k, one in enumerate(records) if kind(one) == wanted]
    how, k = rng.randrange(6), these[rng.randrange(len(these))]
    if how == 0:
        records.insert(rng.randrange(len(records) + 1), records[k])
    elif how == 1:
        records[:] = [one for i, one in enumerate(records) if i not in set(these)]
    elif how == 2:
        these = [k]
    if how >= 2:
        seed, many = rng.getrandbits(32), bulk(rng)
        for i in these[:2000]:
            same = random.Random(seed if how < 5 else many.getrandbits(32))
            *front, body = records[i]
            records[i] = (*front, mutated_field(body, same))


def ulog_forged(data: bytes, rng: random.Random) -> bytes:
    records, at = [], 16
    while at + 3 <= len(data):
        size, kind = struct.unpack_from("<HB", data, at)
        records.append((kind, data[at + 3 : at + 3 + size]))
        at += 3 + size
    records_forged(records, rng, lambda one: (one[0], one[1][:2] if one[0] == 68 else b""))
    return data[:16] + b"".join(
        struct.pack("<HB", len(body[:65535]), kind) + body[:65535] for kind, body in records
    )


def dataflash_forged(data: bytes, rng: random.Random) -> bytes:
    sizes, records, at = {128: 89}, [], 0
    while at + 3 <= len(data) and data[at : at + 2] == b"\xa3\x95":
        kind = data[at + 2]
        body = data[at + 3 : at + sizes.get(kind, 3)]
        if kind == 128 and len(body) == 86:
            sizes[body[0]] = max(body[1], 3)
        records.append((kind, body))
        at += 3 + len(body)
    if rng.random() < 0.5:
        definitions = [k for k, (kind, _) in enumerate(records) if kind == 128]
        for _ in range(rng.choice((1, 3))) if definitions else ():
            k = definitions[rng.randrange(len(definitions))]
            records[k] = (128, definition_forged(records[k][1], rng))
    else:
        records_forged(records, rng, lambda one: one[0])
    return b"".join(b"\xa3\x95" + bytes([kind]) + body for kind, body in records) + data[at:]


def definition_forged(body: bytes, rng: random.Random) -> bytes:
    """Change the number, length, name, letters or labels of a DataFlash FMT message."""
    out = bytearray(body.ljust(86, b"\0"))
    how = rng.randrange(5)
    if how < 2:
        out[how] = rng.choice((0, 1, 2, 3, 128, 255, out[how] ^ 1))
    elif how == 2:
        out[2:6] = rng.choice(
            (b"IMU\0", b"FMT\0", b"PARM", b"\xff\xff\xff\xff", b"\0\0\0\0", b"ESC\0")
        )
    elif how == 3:
        letters = bytes(rng.choice(b"aBbhHiIfdnNZcCeELMqQ?\0") for _ in range(rng.randrange(17)))
        out[6:22] = letters.ljust(16, b"\0")
    else:
        labels = rng.choice((b"TimeUS," * 9, b",,,,", b"", b"I,I,I,I,I,I,I,I", b"\xff" * 64))
        out[22:86] = labels[:64].ljust(64, b"\0")
    return bytes(out)


def crazyflie_forged(data: bytes, rng: random.Random) -> bytes:
    """Change a name, a type or a count of the header of a micro-SD log."""
    end = data.rfind(b")\0", 0, 20_000) + 2
    parts = data[5:end].split(b"\0")
    k = rng.randrange(len(parts))
    words = (b"gyro.x(f)", b"acc.z(?)", b"motor.m1(Q)", b"rpm.m99999999999(H)", b"", b"(", b"a(ff)")
    parts[k] = rng.choice((*words, parts[k][:2] + b"(d)", parts[k] + parts[k], b"x" * 70000))
    if rng.random() < 0.3:
        parts.insert(k, parts[rng.randrange(len(parts))])
    front = data[:5] if rng.random() < 0.7 else data[:1] + rng.choice(WORDS).ljust(4, b"\0")[:4]
    return front + b"\0".join(parts) + data[end:]


def blackbox_forged(data: bytes, rng: random.Random) -> bytes:
    """Change lines of the header: values, numbers of fields, repeated and missing lines."""
    lines = data.split(b"\n")
    heads = [k for k, line in enumerate(lines) if line.startswith(b"H ")]
    for _ in range(rng.choice((1, 1, 3)) if heads else 0):
        k = heads[rng.randrange(len(heads))]
        key, _, value = lines[k].partition(b":")
        cells = value.split(b",")
        cell = rng.choice(CELLS).encode()[:1000]
        cells[rng.randrange(len(cells))] = cell
        changed = (key + b":" + b",".join(cells), b"", lines[k] + b"\n" + lines[k])
        lines[k] = rng.choice((changed[0], changed[0], *changed, key + b":" + cell, key))
        if rng.random() < 0.1:
            lines[k] = key + b":" + b",".join([value[:3000]] * 300)
    return b"\n".join(lines)


def mcap_forged(data: bytes, rng: random.Random) -> bytes:
    return data[:8] + mcap_records_forged(data[8:], rng)


def mcap_records_forged(data: bytes, rng: random.Random) -> bytes:
    """Change records at the top or inside of an uncompressed chunk, with lengths that are right."""
    records, at = [], 0
    while at + 9 <= len(data):
        kind, size = struct.unpack_from("<BQ", data, at)
        if size > len(data):
            break
        records.append((kind, data[at + 9 : at + 9 + size]))
        at += 9 + size
    chunks = [k for k, one in enumerate(records) if one[0] == 6 and len(one[1]) > 40]
    if chunks and rng.random() < 0.6:
        k = chunks[rng.randrange(len(chunks))]
        body = records[k][1]
        front = 32 + int.from_bytes(body[28:32], "little")
        inner = mcap_records_forged(body[front + 8 :], rng)
        sizes = (len(inner), 0, 1 << 40)
        size = sizes[0] if rng.random() < 0.9 else rng.choice(sizes)
        head = body[:16] + struct.pack("<QI", size, 0) + body[28:front]
        records[k] = (6, head + struct.pack("<Q", len(inner)) + inner)
    else:
        records_forged(records, rng, lambda one: one[0])
    return (
        b"".join(struct.pack("<BQ", kind, len(body)) + body for kind, body in records) + data[at:]
    )


def ros1_forged(data: bytes, rng: random.Random) -> bytes:
    line = data.find(b"\n") + 1
    return data[:line] + ros1_records_forged(data[line:], rng)


def ros1_records_forged(data: bytes, rng: random.Random) -> bytes:
    """Change header fields and data of records, in chunks, too, with lengths that are right."""
    records, at = [], 0
    while at + 8 <= len(data):
        size = int.from_bytes(data[at : at + 4], "little")
        more = int.from_bytes(data[at + 4 + size : at + 8 + size], "little")
        if size + more > len(data):
            break
        records.append((data[at + 4 : at + 4 + size], data[at + 8 + size : at + 8 + size + more]))
        at += 8 + size + more
    chunks = [k for k, (head, _) in enumerate(records) if b"op=\x05" in head]
    if chunks and rng.random() < 0.6:
        k = chunks[rng.randrange(len(chunks))]
        records[k] = (records[k][0], ros1_records_forged(records[k][1], rng))
    elif records and rng.random() < 0.5:
        k = rng.randrange(len(records))
        records[k] = (ros1_header_forged(records[k][0], rng), records[k][1])
    else:
        records_forged(records, rng, lambda one: one[0][-12:])
    parts = [
        struct.pack("<I", len(head)) + head + struct.pack("<I", len(body)) + body
        for head, body in records
    ]
    return b"".join(parts) + data[at:]


def ros1_header_forged(head: bytes, rng: random.Random) -> bytes:
    fields, at = [], 0
    while at + 4 <= len(head):
        size = int.from_bytes(head[at : at + 4], "little")
        fields.append(head[at + 4 : at + 4 + size])
        at += 4 + size
    k = rng.randrange(len(fields)) if fields else 0
    for name, _, _ in [field.partition(b"=") for field in fields[k : k + 1]]:
        word = rng.choice((*WORDS, b"", *(d.encode() for d in DEFINITIONS)))
        fields[k] = rng.choice((name + b"=" + word, name + b"=" + word, name, b"=" + word, b""))
    return b"".join(struct.pack("<I", len(field)) + field for field in fields)


# Databases

VALUES = (
    *("NULL", "''", "x''", "x'00010000'", "'text'", "0", "-1", "1e300", "9223372036854775807"),
    *("-9223372036854775808", "zeroblob(70000)", "randomblob(60)", "zeroblob(900000)"),
)
ENDLESS = (
    "DROP TABLE messages",
    "CREATE VIEW messages(id, topic_id, timestamp, data) AS WITH RECURSIVE c(x) AS (SELECT 1 "
    "UNION ALL SELECT x + 1 FROM c) SELECT x, 1, x, zeroblob(100) FROM c",
)


LONGEST_MADE = 4_000_000


def sqlite_forged(data: bytes, rng: random.Random) -> bytes:
    """Change a ROS 2 bag by SQL, so that its pages stay whole."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.db3"
        path.write_bytes(data)
        try:
            with sqlite3.connect(path) as base:
                base.execute("PRAGMA journal_mode = OFF")
                for statement in statements(rng):
                    base.execute(statement)
            base.close()
        except (sqlite3.Error, OverflowError, UnicodeDecodeError):
            return data[: rng.randrange(len(data)) + 1]
        with path.open("rb") as made:
            return made.read(LONGEST_MADE)  # SQL makes gigabytes of a few words


def statements(rng: random.Random) -> list[str]:
    """Return what makes a database lie."""
    value, part = rng.choice(VALUES), rng.choice(("1", "1", "id % 2", "id = 7", "id % 50 = 3"))
    text = rng.choice((*DEFINITIONS, *NAMES[:12], *CELLS[:6])).replace("'", "''").replace("\0", "")
    data = rng.choice(
        (value, "substr(data, 1, 20)", "data || data", "substr(data, 5)", "CAST(data AS TEXT)")
    )
    time = rng.choice(
        (value, "-timestamp", "timestamp * 1e9", "0", "random()", "timestamp / 1000000000")
    )
    plans = (
        [f"UPDATE messages SET data = {data} WHERE {part}"],
        [f"UPDATE messages SET timestamp = {time} WHERE {part}"],
        [f"UPDATE messages SET topic_id = {value} WHERE {part}"],
        [f"UPDATE topics SET {rng.choice(('name', 'type', 'serialization_format'))} = '{text}'"],
        [f"UPDATE topics SET {rng.choice(('name', 'type', 'id'))} = {value} WHERE {part}"],
        [f"UPDATE message_definitions SET encoded_message_definition = '{text}' WHERE {part}"],
        [f"UPDATE message_definitions SET encoded_message_definition = {value}"],
        [f"DELETE FROM {rng.choice(('messages', 'topics', 'message_definitions'))} WHERE {part}"],
        [f"DROP TABLE {rng.choice(('messages', 'topics', 'message_definitions', 'schema'))}"],
        ["ALTER TABLE messages RENAME COLUMN data TO datum"],
        list(ENDLESS),
    )
    return [line for _ in range(rng.choice((1, 1, 2))) for line in rng.choice(plans)]


TEXT = (cells_forged, cells_forged, lines_forged, encoded_otherwise, numbers_forged)
FORGERIES: dict[str, tuple[Forgery, ...]] = {
    "table": TEXT,
    "motive": TEXT,
    "qualisys": TEXT,
    "trajectory": TEXT,
    "experiment": (*TEXT, numbers_forged),
    "parquet": (parquet_forged, parquet_forged, parquet_forged, parquet_long_list, at_every),
    "ulog": (ulog_forged, ulog_forged, at_every),
    "dataflash": (dataflash_forged, dataflash_forged, at_every),
    "blackbox": (blackbox_forged, blackbox_forged, at_every, numbers_forged),
    "crazyflie": (crazyflie_forged, at_every),
    "ros1": (ros1_forged, ros1_forged, at_every),
    "ros2": (sqlite_forged, sqlite_forged, at_every),
    "mcap": (mcap_forged, mcap_forged, at_every),
}
"""By the format whose files they forge."""
