"""Logs of the real PX4 (SIH) and ArduCopter (SITL), flying vehicles of known parameters.

What a simulator leaves out is no error of a number, but the result must say it.
"""

import functools
from pathlib import Path

import numpy as np
import pytest

import flown
from rotorfit.logs import read_log
from rotorfit.tools.inspection.inspect_log import inspect_log

pytestmark = pytest.mark.flights

SQRT = "law = {{ sqrt = {{ full_speed = {:g}, thr_mdl_fac = {:g} }} }}\n"
LOGS = {
    "px4-sih-stock.ulg": (1.0, 0.2 * 2**0.5, "px4", SQRT.format(1000, 0)),
    "px4-sih-exported.ulg": (1.4, 0.25, "px4", SQRT.format(1450, 0)),
    "arducopter-stock.BIN": (3.0, 0.35, "ardupilot", ""),
    "arducopter-exported.BIN": (1.4, 0.25, "ardupilot", SQRT.format(1450, 0.669016)),
    "arducopter-default-logging.BIN": (3.0, 0.35, "ardupilot", ""),
}
"""Mass, arm, order, and what the user says of the motors."""
FULL = 18.86 * (12.8 / 12.6) ** 2
"""Thrust of a rotor of the stock copter at full command and MOT_BAT_VOLT_MAX [N]."""
EULER = 0.004
"""Step of SIH's loop [s]: its motors move on by EULER / SIH_T_TAU in each."""
BODY = {"com_x": 0.0, "com_y": 0.0, "com_z": 0.0}
STRAIGHT = {"Ixy_com": 0.0, "Ixz_com": 0.0, "Iyz_com": 0.0}
TRUTH = {
    "px4-sih-stock.ulg": {
        "kt": 5e-6, "kd": 1e-7, "Jr": 0.0, "kd_over_kt": 0.02, **BODY, **STRAIGHT,
        "Ixx_com": 0.025, "Iyy_com": 0.025, "Izz_com": 0.030,
        "motor_lag": -EULER / np.log(1.0 - EULER / 0.05),
        "drag_x": 1.0, "drag_y": 1.0, "drag_z": 1.0,
        "turn_damping_x": 0.025, "turn_damping_y": 0.025,
    },
    "px4-sih-exported.ulg": {
        "kt": 3.99563e-6, "kd": 6.00608e-8, "Jr": 0.0, **BODY,
        "Ixx_com": 0.0237586, "Iyy_com": 0.0276918, "Izz_com": 0.0438987,
        "Ixy_com": 1.12487e-4, "Ixz_com": -4.70561e-4, "Iyz_com": 3.33e-4,
        "motor_lag": -EULER / np.log(1.0 - EULER / 0.0397728),
    },
    "arducopter-stock.BIN": {
        "kt": FULL, **BODY, **STRAIGHT, "Ixx_com": 0.02297, "Iyy_com": 0.02297,
    },
    "arducopter-exported.BIN": {
        "kt": 3.99563e-6, **BODY, **STRAIGHT, "Ixx_com": 0.0237586, "Iyy_com": 0.0276918,
        "rotor_center_x": -0.00854717, "rotor_center_y": 0.00569488,
    },
    "arducopter-default-logging.BIN": {"kt": FULL},
}  # fmt: skip
WITHHELD = {".ulg": {"drag_y"}, ".BIN": {"drag_y", "Ixz_com", "Iyz_com"}}
SIMULATOR = {"ulg": "PX4 SIH", "BIN": "ArduPilot SITL"}


@pytest.fixture(scope="module")
def result_of(flight_data_dir, tmp_path_factory):
    """Identify a log once."""

    @functools.cache
    def result(name):
        log = flight_data_dir / "autopilot-sitl" / name
        if not log.is_file():
            pytest.skip(f"no {log}")
        mass, arm, order, law = LOGS[name]
        path = tmp_path_factory.mktemp("autopilots") / "experiment.toml"
        path.write_text(
            f'[airframe]\nlayout = "quad-x"\narm = {arm!r}\norder = "{order}"\n'
            f'[motors]\nspeed = "commanded"\n{law}'
            f'[[configuration]]\nmass = {mass}\nflights = ["{log}"]\n',
            encoding="utf-8",
        )
        return flown.quietly_identified(path)

    return result


def numbers(result):
    return {n.name: n for n in (*result.derived, *result.parameters)}


# (-3.6 +- 2.4)e-5 kg m^2 and .15 +- .06 mm for 0: one in twenty intervals may miss, and some
# seventy are asked here. Why the height is off since the gyro's filter is applied is open.
MISSED = {
    ("arducopter-exported.BIN", "Ixy_com"): 5e-5,
    ("arducopter-exported.BIN", "com_z"): 2e-4,
}
"""Known misses, with the largest distance from the truth."""


@pytest.mark.parametrize("name", LOGS)
def test_every_interval_holds_the_truth(result_of, name):
    found = numbers(result_of(name))
    for what, truth in TRUTH[name].items():
        # Of drag over a velocity of .5 m/s that is off by .4 no log tells. Products with z go by
        # the scale of yaw, which flights in a simulator without coupling do not show.
        if found[what].interval is None and what in WITHHELD[Path(name).suffix]:
            continue
        low, high = found[what].interval
        if (name, what) in MISSED:
            assert abs(found[what].value - truth) < MISSED[name, what]
            continue
        assert low <= truth <= high, what


@pytest.mark.parametrize("name", LOGS)
def test_the_result_warns_which_simulator_flew(result_of, name):
    simulator = SIMULATOR[name.rpartition(".")[2]]
    assert any(f"flown in {simulator}, a simulator" in w for w in result_of(name).warnings)


def test_px4_stock_is_found_within_a_few_percent(result_of):
    found = numbers(result_of("px4-sih-stock.ulg"))
    for names, within in (("kt", 0.02), ("kd", 0.04), ("Ixx_com Iyy_com", 0.03), ("Izz_com", 0.06)):
        for name in names.split():
            truth = TRUTH["px4-sih-stock.ulg"][name]
            assert found[name].value == pytest.approx(truth, rel=within), name
    assert found["motor_lag"].value == pytest.approx(0.05, abs=0.005)
    assert "motor_lag_up" not in found  # of thrust, it is one lag


@pytest.mark.parametrize("name", ["arducopter-stock.BIN", "arducopter-exported.BIN"])
def test_arducopter_without_gyroscopic_terms_has_no_yaw_scale(result_of, name, assert_wording):
    result = result_of(name)
    found = numbers(result)
    for unknown in ("kd", "Izz"):
        assert (found[unknown].value, found[unknown].verdict) == (None, "ratio-only"), unknown
    assert found["Jr"].value is None
    for unknown in ("kd", "Izz"):
        assert "no gyroscopic coupling" in found[unknown].reason
        assert "pendulum" in found[unknown].advice
    assert "no rotor inertia" in found["Jr"].reason  # no flight in this simulator shows it
    assert found["Izz_com"].value is None
    assert_wording(result.warnings)
    assert found["kt"].value == pytest.approx(TRUTH[name]["kt"], rel=0.02)
    for moment in ("Ixx_com", "Iyy_com"):
        assert found[moment].value == pytest.approx(TRUTH[name][moment], rel=0.05)


def test_arducopter_yaw_torque_is_found_not_to_be_quadratic(result_of):
    """Torque .05 diagonal yaw c T with T = .331 c + .669 c^2: the exported kd holds in hover."""
    result = result_of("arducopter-exported.BIN")
    [said] = [w for w in result.warnings if w.startswith("its yaw torque changes")]
    more = float(said.split()[4])
    hover = 6.00608e-8 / 0.0438987
    assert numbers(result)["kd_over_Izz"].value / more == pytest.approx(hover, rel=0.03)


def test_arducopters_law_and_battery_come_from_its_parameters(result_of):
    result = result_of("arducopter-stock.BIN")
    law = result.settings["motors"]["law"]
    assert law["sqrt"] == {"full_speed": 1.0, "thr_mdl_fac": 0.65, "start": 0.15, "end": 0.95}
    assert law["voltage"] == {"nominal": 12.8, "exponent": 1.0, "exponent_std": 0.0}
    assert result.parameter("kt").unit == "N per squared command"
    assert any("MOT_THST_EXPO" in w for w in result.warnings)
    doubts = [found.kind for found in result.findings if found.severity == "doubt"]
    assert "thrust-sags" not in doubts
    # The simulator's motors have no lag: the gyro's filter, which the log names, is not in it.
    assert result.parameter("motor_lag").interval[0] == 0.0


def test_default_logging_of_arducopter_is_found_to_be_too_slow(result_of, assert_wording):
    result = result_of("arducopter-default-logging.BIN")
    found = numbers(result)
    assert found["Ixx"].value is found["kd"].value is None
    said = result.flights[0].warnings
    assert_wording(said)


def test_px4s_parameters_are_those_with_which_it_flew(flight_data_dir, assert_wording):
    """Loaded after the log began: the log's first values are SIH's defaults."""
    log = flight_data_dir / "autopilot-sitl" / "px4-sih-exported.ulg"
    if not log.is_file():
        pytest.skip(f"no {log}")
    report = inspect_log(read_log(log))
    told = report.metadata
    assert told["Simulator"] == "PX4 SIH"
    assert float(told["SIH_MASS"]) == pytest.approx(1.4)
    assert float(told["SIH_T_MAX"]) == pytest.approx(8.4008, rel=1e-4)
    assert any("in PX4 SIH," in note for note in report.notes)
    assert_wording(report.notes)
    assert not any("give its law" in w for w in report.trouble)
