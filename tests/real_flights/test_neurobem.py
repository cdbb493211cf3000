"""Three flights of NeuroBEM at 2 to 14 m/s: thrust, drag and inertia, and what they cannot show.

The thrust coefficient is published (1.5625e-6), and six flights with the weight give 1.55e-6;
the rotors' drag is 4.2e-5 in regressions of the force alone (`benchmarks.fast_flight`). Single
flights are declared without the propellers, all together with them.
"""

import warnings
from itertools import combinations

import numpy as np
import pytest
from benchmarks.fast_flight import FLIGHTS, MASS, MOMENT_BAND, identify_together

from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.results.validation.validate import validate_file

pytestmark = pytest.mark.flights

KT, KT_STD = 1.55e-6, 0.02e-6
ROTOR_DRAG = 4.2e-5
ROLL_SCALE = "gyro_scale_roll"
DECLARED = """name = "neurobem"
[airframe]
layout = "quad-x"
spacing = [0.15, 0.20]
order = "betaflight"
{propeller}
[motors]
speed = "measured"
[[configuration]]
"""
OF_YAW = ("kd", "Jr", "Izz", "Izz_com", "kd_over_Izz", "Jr_over_Izz")
OF_HEIGHT = ("msz", "com_z")
EXPECTED_KINDS = {
    *("little-excitation", "origin", "term-added", "gyro-scale", "best-manoeuvre", "sensor-place"),
}
"""Findings beside checks that passed. The attitude of the logs, too, turns 3.3 % less in roll."""


@pytest.fixture(scope="module")
def identified(flight_data_dir, tmp_path_factory):
    """Return results by flight, and of all together."""
    folder = flight_data_dir / "neurobem"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")

    def result(*names, propeller=""):
        files = ", ".join(f'"{folder / name}.csv"' for name in names)
        path = tmp_path_factory.mktemp("neurobem") / "experiment.toml"
        text = DECLARED.format(propeller=propeller)
        path.write_text(f"{text}mass = {MASS}\nflights = [{files}]\n", encoding="utf-8")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return identify(load_experiment(path))

    together = result(*FLIGHTS, propeller="propeller = 0.127")
    return {**{name: result(name) for name in FLIGHTS}, "all": together}


def number(result, name):
    return next(n for n in (*result.parameters, *result.derived) if n.name == name)


@pytest.mark.parametrize("flown", [*FLIGHTS, "all"])
def test_thrust_is_right_and_known_to_five_percent(identified, flown):
    kt = number(identified[flown], "kt")
    low, high = kt.interval
    assert kt.verdict == "identified"
    assert kt.value == pytest.approx(KT, rel=0.02)
    assert low < KT + KT_STD and high > KT - KT_STD
    assert high - low < 2 * 0.05 * kt.value


@pytest.mark.parametrize("flown", [*FLIGHTS, "all"])
def test_the_drag_of_the_rotors_holds_what_forces_alone_give(identified, flown):
    low, high = number(identified[flown], "rotor_drag").interval
    assert 0.0 < low < ROTOR_DRAG < high


def test_changing_rotor_speeds_leave_the_frame_no_share(identified):
    """The slowest flight leaves that open, and says so: half of its drag may be the frame's.

    A fast one alone leaves the tracked point open by 9 mm, which is in its drag.
    """
    drag = number(identified["all"], "rotor_drag")
    low, high = drag.interval
    assert drag.verdict == "identified"
    assert high < 1.4 * low
    slowest = number(identified[FLIGHTS[0]], "rotor_drag")
    assert slowest.verdict == "weak"


@pytest.mark.parametrize("name", ["kt", "rotor_drag", "inflow", "Ixx_com", "Iyy_com"])
def test_flights_agree_with_one_another_and_with_all_together(identified, name):
    found = [number(result, name).interval for result in identified.values()]
    for one, other in combinations(found, 2):
        assert one[0] < other[1] and other[0] < one[1]


def test_all_flights_have_one_model_with_inflow_and_wakes(identified):
    """Regressions of six flights, one by one, give so much for each."""
    regressed = {
        "inflow": (0.74e-4, 1.26e-4),
        "wake_moment_x": (0.0014, 0.0016),
        "wake_moment_y": (0.0028, 0.0038),
    }
    for name, (least, most) in regressed.items():
        low, high = number(identified["all"], name).interval
        assert 0.0 < low < most
        assert high > least


@pytest.mark.parametrize("flown", [*FLIGHTS, "all"])
def test_yaw_and_the_height_of_the_com_are_said_to_be_unknown(identified, flown):
    for name in (*OF_YAW, *OF_HEIGHT):
        found = number(identified[flown], name)
        assert found.value is None
        assert found.verdict == "not-identified"
        assert found.reason


@pytest.mark.parametrize("flown", [*FLIGHTS, "all"])
def test_no_finding_calls_the_air_a_fault(identified, flown):
    """Once kt was "99 % lower than by the weight", and drag a turned IMU."""
    said = {f.kind for f in identified[flown].findings if f.severity != "passed"}
    assert said <= EXPECTED_KINDS
    scales = [f.evidence for f in identified[flown].findings if f.kind == "gyro-scale"]
    for low, high in (e.interval for found in scales for e in found if e.name == ROLL_SCALE):
        assert low < 0.033 < high


@pytest.mark.parametrize("left_out", FLIGHTS)
def test_the_moments_of_a_flight_not_fitted_balance(flight_data_dir, left_out):
    """Places that two flights do not show are predicted with the thrusts they were fitted with."""
    folder = flight_data_dir / "neurobem"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    paths = {name: folder / f"{name}.csv" for name in FLIGHTS}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = identify_together([paths[name] for name in FLIGHTS if name != left_out])
        seen = validate_file(result, paths[left_out], cutoff=MOMENT_BAND)
    off = (seen.body_wrench - seen.rotor_wrench)[:, 3:5].mean(axis=0)
    # A millimetre of the centre of mass is 7.6 mN m. With the rotors' middle under it, two of the
    # three flights are 48 and 62 mN m off, with the balance of the fit at most 17.
    assert np.abs(off).max() < 0.025
