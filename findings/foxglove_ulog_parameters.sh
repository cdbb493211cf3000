#!/bin/sh
# @foxglove/ulog 2.3.2 and its fork @lichtblick/ulog 1.0.0 (npm): `header.parameters` gives the
# default of a parameter in place of its value, wherever the ULog has a message of defaults (Q) for
# it. PX4 writes these after the values (P), and only for parameters that differ from their default:
# the user's own settings are all lost, and the others are right. `defaultTypes` over 0 tells that a
# value is a default; the value itself is not kept. pyulog 1.3.0 gives both.
# Seen for CA_ROTOR0_PX 0.15 with the default 0, and THR_MDL_FAC 0.3 without one: 0 and 0.3; pyulog
# 0.15 and 0.3. In four logs of PX4 all of the 54 to 106 parameters with a default, of 900 to 1116,
# were wrong.
# It matters where rotor positions, thrust curve or sensor settings of a flight are taken from its
# log: they are the firmware's, and not those that flew.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q pyulog==1.3.0
cd "$folder"
npm install --silent --no-audit --no-fund --no-update-notifier --cache "$folder/cache" --prefix "$folder" \
    @foxglove/ulog@2.3.2 @lichtblick/ulog@1.0.0
cat > read.js <<'JS'
const [maker, name] = process.argv.slice(2);
const { ULog } = require(`${maker}/ulog`);
const { FileReader } = require(`${maker}/ulog/node`);
const log = new ULog(new FileReader(name));
log.open().then(() => {
  const rows = [...log.header.parameters].map(([key, found]) => [key, found.value]);
  console.log(JSON.stringify(Object.fromEntries(rows)));
  process.exit(0);
});
JS
"$folder/venv/bin/python" - <<'PY'
import json
import struct
import subprocess

import pyulog


def message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


def setting(name, value):
    key = b"float " + name.encode()
    return bytes([len(key)]) + key + struct.pack("<f", value)


head = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message("B", b"\x01" + bytes(39))
values = message("P", setting("CA_ROTOR0_PX", 0.15)) + message("P", setting("THR_MDL_FAC", 0.3))
defaults = message("Q", b"\x01" + setting("CA_ROTOR0_PX", 0.0))  # of the whole system
topic = message("F", b"imu:uint64_t timestamp;float x;") + message("A", b"\0\0\0imu")
sample = message("D", struct.pack("<HQf", 0, 1000, 1.0))
with open("flight.ulg", "wb") as file:
    file.write(head + values + defaults + topic + sample)


def rounded(parameters):
    return {name: round(value, 6) for name, value in parameters.items()}


def by_javascript(maker):
    ran = subprocess.run(
        ["node", "read.js", maker, "flight.ulg"], capture_output=True, text=True, check=True
    )
    return rounded(json.loads(ran.stdout))


log = pyulog.ULog("flight.ulg")
by_pyulog = rounded(log.initial_parameters)
foxglove, lichtblick = by_javascript("@foxglove"), by_javascript("@lichtblick")
print("pyulog", by_pyulog, "defaults", log.get_default_parameters(0))
print("@foxglove/ulog", foxglove, "@lichtblick/ulog", lichtblick)
assert by_pyulog == {"CA_ROTOR0_PX": 0.15, "THR_MDL_FAC": 0.3}
assert foxglove == lichtblick == {"CA_ROTOR0_PX": 0.0, "THR_MDL_FAC": 0.3}
PY
