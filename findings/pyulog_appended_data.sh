#!/bin/sh
# pyulog 1.3.0: data appended to a ULog (incompatible flag bit 0, an offset in the flag message),
# as PX4 does after a crash, are lost where they belong to a topic of the first section.
# Seen: 5 of 9 samples (first section 1000 to 5000 us), with the warning "no subscription found for
# message id 0. Continuing, but file is most likely corrupt". The same bytes without flag and offset
# give all 9.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pyulog==1.3.0
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import struct

import pyulog


def message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


def samples(numbers):
    rows = (struct.pack("<HQf", 0, 1000 * number, 1.0) for number in numbers)
    return b"".join(message("D", row) for row in rows)


def file_of(appended):
    head = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    topic = message("F", b"imu:uint64_t timestamp;float x;") + message("A", b"\0\0\0imu")
    first = samples(range(1, 6))
    offset = len(head) + 43 + len(topic) + len(first) if appended else 0
    flags = bytes(8) + bytes([int(appended)]) + bytes(7) + struct.pack("<3Q", offset, 0, 0)
    return head + message("B", flags) + topic + first + samples(range(6, 10))


def times(appended):
    name = f"{appended}.ulg"
    with open(name, "wb") as file:
        file.write(file_of(appended))
    return pyulog.ULog(name).data_list[0].data["timestamp"].tolist()


print("plain", times(False), "appended", times(True))
assert times(False) == [1000 * k for k in range(1, 10)]
assert times(True) == [1000 * k for k in range(1, 6)]
PY
