#!/bin/sh
# MAVdataflash 3.0.0: two logs of ArduPilot opened in one program share their tables. `DataFlash` keeps messages and
# units in dictionaries of the class, so that the log whose message is asked for first gives it for all of
# them: `GetData` of another log returns the same table. `GetPARAM` is that of each log.
# Seen for two logs with a gyro of 1 and 2 rad/s: both open, then asked: 1 and 1, in the other order 2 and 2;
# each opened and read before the next is opened: 1 and 2. The documentation does not say so.
# It matters where flights are compared, or a fit is tried on another flight: that flight is the first again.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q mavdataflash==3.0.0 pymavlink==2.4.50
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import struct

from MAVdataflash import DataFlash

HEAD = b"\xa3\x95"


def described(number, name, length, letters, labels):
    return HEAD + b"\x80" + struct.pack(
        "<BB4s16s64s", number, length, name.encode(), letters.encode(), labels.encode()
    )


def write_log(name, rate):
    log = described(128, "FMT", 89, "BBnNZ", "Type,Length,Name,Format,Columns")
    log += described(1, "IMU", 15, "Qf", "TimeUS,GyrX")
    log += described(2, "PARM", 31, "QNf", "TimeUS,Name,Value")
    log += HEAD + struct.pack("<BQ16sf", 2, 1_000_000, b"MOT_THST_HOVER", rate / 10)
    for k in range(10):
        log += HEAD + struct.pack("<BQf", 1, 1_000_000 + 2500 * k, rate)
    with open(name, "wb") as file:
        file.write(log)


def rate(log):
    return float(log.GetData("IMU")["GyrX"].mean())


def parameter(log):
    return round(float(log.GetPARAM("MOT_THST_HOVER")), 6)


write_log("first.bin", 1.0)
write_log("second.bin", 2.0)
one_by_one = [rate(DataFlash(name)) for name in ("first.bin", "second.bin")]
first, second = DataFlash("first.bin"), DataFlash("second.bin")
together = [rate(first), rate(second)]
parameters = [parameter(first), parameter(second)]
first, second = DataFlash("first.bin"), DataFlash("second.bin")
turned = [rate(log) for log in (second, first)]
print("gyro [rad/s] of the first and the second log, one by one", one_by_one)
print("both open", together, "the second asked first", turned, "parameter", parameters)
assert one_by_one == [1.0, 2.0] and together == [1.0, 1.0] and turned == [2.0, 2.0]
assert parameters == [0.1, 0.2]
PY
