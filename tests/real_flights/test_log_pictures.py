"""Pictures of real logs of every kind: what is there is drawn, what is not is said."""

import re

import pytest

from rotorfit.logs import read_log
from rotorfit.report.log_page import log_report_html
from rotorfit.tools.inspection.inspect_log import inspect_log

ALL = {"gyro", "accel", "command"}
LOGS = {
    "optitrack-airgarage/20240824_00_08_07.csv": ({"position"}, {"gyro", "accel"}),
    "crazypad/controller_data__normal_flight__E8_log00": ({"gyro", "command"}, {"accel"}),
    "crazypad/motor_data__normal_flight__E8_log00": ({"command"}, {"gyro", "accel"}),
    "px4-ulog/sample_appended_multiple.ulg": (ALL, set()),
    "px4-ulog/quadrotor_local.ulg": (ALL, set()),
    "autopilot-sitl/arducopter-default-logging.BIN": (ALL, set()),
}
"""Curves that are drawn, and spectra that are left out."""


@pytest.mark.flights
@pytest.mark.parametrize("name", LOGS)
def test_what_is_there_is_drawn_and_what_is_not_is_said(flight_data_dir, name):
    path = flight_data_dir / name
    if not path.exists():
        pytest.skip(f"no {path}")
    drawn, missing = LOGS[name]
    html = log_report_html(inspect_log(read_log(path)))
    keys = re.findall(r'data-key="(?!spectrum)([a-z_]+) ', html)
    assert set(keys) == drawn
    assert set(re.findall(r"no spectrum of (\w+)", html)) == missing
    spectra = set(re.findall(r'data-key="spectrum (\w+)', html))
    assert spectra == {"gyro", "accel"} - missing
    bare = re.sub(r'"(data|time)": "[^"]*"', "", html.split("</main>")[0])
    assert not re.search(r"\b(nan|NaN|inf|Infinity)\b", bare)
