#!/bin/sh
# pymavlink 2.4.50, mavlogdump.py: `--reduce N` and `--reduce-rate HZ` thin a log of ArduPilot by the name of a
# message, not by its instance. The IMUs of a loop follow each other as messages of one name, so that
# --reduce 3 keeps one of three IMUs, the last, whole, and nothing of the others; --reduce-rate keeps the
# first alone. ESCs, which --reduce leaves as they are, share the rate and get unequal parts of it.
# Its help says "reduce streaming messages" and "reduce messages to maximum rate in Hz".
# Seen, 400 loops in 1 s with 3 IMUs and 4 ESCs: --reduce 3: IMUs 0, 0, 400, ESCs 400 each. --reduce-rate
# 100: IMUs 95, 0, 0, ESCs 10, 33, 33, 23. Of a log of ArduCopter with two IMUs of 50270 samples each
# --reduce 2 kept the second whole, and nothing of the first, with which it had flown.
# It matters where a log is made smaller to be sent: the IMU that the vehicle flew with, or the speed of
# some motors, may be all gone.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pymavlink==2.4.50
cd "$folder"
PATH="$folder/venv/bin:$PATH" "$folder/venv/bin/python" - <<'PY'
import collections
import struct
import subprocess

from pymavlink import mavutil

HEAD = b"\xa3\x95"
SAMPLE = struct.Struct("<2sBQBf")


def described(number, name, length, letters, labels):
    return HEAD + b"\x80" + struct.pack(
        "<BB4s16s64s", number, length, name.encode(), letters.encode(), labels.encode()
    )


def sample(number, time, instance, value):
    return SAMPLE.pack(HEAD, number, time, instance, value)


log = described(128, "FMT", 89, "BBnNZ", "Type,Length,Name,Format,Columns")
log += described(1, "IMU", SAMPLE.size, "QBf", "TimeUS,I,GyrX")
log += described(2, "ESC", SAMPLE.size, "QBf", "TimeUS,Instance,RPM")
for loop in range(400):
    time = 1_000_000 + 2500 * loop  # us
    log += b"".join(sample(1, time, i, 0.1) for i in range(3))
    log += b"".join(sample(2, time + 10 * i, i, 5000.0) for i in range(4))
with open("flight.bin", "wb") as file:
    file.write(log)


def kept(*options):
    """Return how many samples of each IMU and each ESC are in the reduced log."""
    subprocess.run(
        ["mavlogdump.py", "flight.bin", "-q", "-o", "reduced.bin", *options], check=True
    )
    reader = mavutil.mavlink_connection("reduced.bin")
    counts = collections.Counter()
    while (message := reader.recv_match(type=["IMU", "ESC"])) is not None:
        name = message.get_type()
        counts[name, message.I if name == "IMU" else message.Instance] += 1
    return [counts["IMU", i] for i in range(3)], [counts["ESC", i] for i in range(4)]


whole, third, rate = kept(), kept("--reduce", "3"), kept("--reduce-rate", "100")
print("samples of each IMU and each ESC", whole, "--reduce 3", third, "--reduce-rate 100", rate)
assert whole == ([400] * 3, [400] * 4)
assert third == ([0, 0, 400], [400] * 4)
assert 80 <= rate[0][0] <= 101 and rate[0][1:] == [0, 0]
assert 80 <= sum(rate[1]) <= 101
PY
