#!/bin/sh
# betaflight-chirp-core 0.4.1: the delays of Betaflight's filters depend on how often the blackbox was written.
# `filter_model` works them out at the rate of the log in place of the rate of the loop, and takes a filter
# at or above half of it for none: it is listed with 0 ms and has no part in the predicted attenuation.
# Seen for the filters of Betaflight's defaults, PT1 at 250 to 500 Hz and at 500 Hz (0.74 ms, as the sum of their
# time constants): 0.72 ms of a log at 4000 Hz, 0.37 ms at 1000 Hz, 0 at 500 Hz; D term 2.04, 1.72, 1.23 ms.
# The delay is meant for the band up to 100 Hz, which each of these logs holds. The documentation names the
# rate `loop/log rate`, as if both were one.
# It matters where the delay of a loop is split into filters, motors and the rest, or logs of unlike rates are
# compared: the delay that a filter lacks there counts as the motors'.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q betaflight-chirp-core==0.4.1
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
import math

from betaflight_chirp_core.analysis.filter_model import build_filter_model
from betaflight_chirp_core.config import parse_header_config

HEADER = b"""H Product:Blackbox flight data recorder by Nicholas Sherlock
H rollPID:45,80,30
H gyro_lpf1_type:0
H gyro_lpf1_static_hz:250
H gyro_lpf1_dyn_hz:250,500
H gyro_lpf2_type:0
H gyro_lpf2_static_hz:500
H dterm_lpf1_type:0
H dterm_lpf1_static_hz:75
H dterm_lpf1_dyn_hz:75,150
H dterm_lpf2_type:0
H dterm_lpf2_static_hz:150
"""


def delays_ms(log_rate):
    """Return the delay of the gyro's two filters, their sum and that of the D term."""
    found = build_filter_model(parse_header_config(HEADER), float(log_rate))
    stages = [stage["delay_ms"] for stage in found["gyro"]["stages"]]
    return [*stages, found["gyro"]["total_delay_ms"], found["dterm"]["total_delay_ms"]]


constants = [1e3 / (2 * math.pi * cutoff) for cutoff in (375, 500)]
print("time constants of the gyro's filters [ms]", [round(x, 2) for x in constants])
found = {rate: delays_ms(rate) for rate in (4000, 1000, 500)}
print("log rate [Hz]: delays of LPF1, LPF2, gyro, D term [ms]", found)
assert found[4000] == [0.41, 0.31, 0.72, 2.04]
assert found[1000] == [0.37, 0.0, 0.37, 1.72]
assert found[500] == [0.0, 0.0, 0.0, 1.23]
PY
