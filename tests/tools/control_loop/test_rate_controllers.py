"""A controller's response is that of its replay, and replay gives what autopilots logged."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest

from rotorfit.errors import LogError
from rotorfit.logs.controller_log import ControllerLog, read_with_controller
from rotorfit.tools.control_loop.controllers import RateController, moving_filters, rate_controller

DATA = Path(os.environ.get("ROTORFIT_DATA") or Path(__file__).parents[4] / "shared" / "data")
LOGS = DATA / "autopilot-sitl"
GAINS = ("P", "I", "D", "FF", "FLTT", "FLTE", "FLTD")
PX4_LIKE = RateController(
    P=0.15, I=0.2, D=0.003, FF=0.02, angle=4.0, period=0.004, slope_of="rate", slope_lowpass=20.0,
    set_point_age=1,
)  # fmt: skip
ARDUCOPTER_LIKE = RateController(
    P=0.135, I=0.13, D=0.0036, FF=0.01, angle=4.5, period=0.0025, set_point_lowpass=20.0,
    error_lowpass=60.0, slope_lowpass=30.0, set_point_age=1,
)  # fmt: skip


@pytest.mark.parametrize("controller", [PX4_LIKE, ARDUCOPTER_LIKE])
@pytest.mark.parametrize("hertz", [1.0, 7.0, 25.0])
def test_a_sine_is_followed_as_the_response_says(controller, hertz):
    cycles = round(40 * hertz)
    count = round(cycles / hertz / controller.period)
    time = controller.period * np.arange(count)
    sine, nothing = 0.01 * np.exp(2j * np.pi * hertz * time), np.zeros(count)
    frequency = np.array([hertz])

    def answered(set_point, rate):
        out = controller.replayed(set_point.real, rate.real) + 1j * controller.replayed(
            set_point.imag, rate.imag
        )
        half = slice(count // 2, None)
        own = np.exp(2j * np.pi * hertz * time[half])
        columns = np.column_stack([own, np.ones(len(own))])
        return np.linalg.lstsq(columns, out[half], rcond=None)[0][0] / 0.01

    expected = controller.from_set_point(frequency)[0]
    assert answered(sine, nothing) == pytest.approx(expected, rel=2e-3)
    expected = -controller.from_rate(frequency)[0]
    assert answered(nothing, sine) == pytest.approx(expected, rel=2e-3)


def test_gains_are_scaled_together():
    double = PX4_LIKE.scaled(2.0)
    frequency = np.array([1.0, 10.0])
    assert np.allclose(double.from_rate(frequency), 2.0 * PX4_LIKE.from_rate(frequency))


@pytest.mark.parametrize(
    ("name", "slope", "left"),
    [
        ("arducopter-stock.BIN", 0.001, 0.01),
        ("ap-heavy-recommended.BIN", 0.001, 0.01),
        ("px4-sih-exported.ulg", 0.03, 0.17),
        ("px4-heavy-recommended.ulg", 0.03, 0.17),
    ],
)
def test_the_logged_output_is_replayed(name, slope, left):
    path = LOGS / name
    if not path.exists():
        pytest.skip(f"no real logs: {path} is absent")
    log = read_with_controller(path)[1]
    middle = slice(len(log.time) // 4, 3 * len(log.time) // 4)
    for axis in range(3):
        made = rate_controller(log, axis).replayed(
            log.set_point[:, axis],
            log.rate[:, axis],
            None if log.slope is None else log.slope[:, axis],
        )
        columns = np.column_stack([made[middle], np.ones(len(made[middle]))])
        out = log.output[middle, axis]
        found = np.linalg.lstsq(columns, out, rcond=None)[0]
        assert found[0] == pytest.approx(1.0, abs=slope)
        assert np.std(out - columns @ found) < left * np.std(out)


def test_a_gain_read_wrongly_does_not_replay():
    path = LOGS / "arducopter-stock.BIN"
    if not path.exists():
        pytest.skip(f"no real logs: {path} is absent")
    log = read_with_controller(path)[1]
    wrong = {**log.parameters, "ATC_RAT_RLL_P": 1.15 * log.parameters["ATC_RAT_RLL_P"]}
    controller = rate_controller(dataclasses.replace(log, parameters=wrong), 0)
    made = controller.replayed(log.set_point[:, 0], log.rate[:, 0])
    middle = slice(len(made) // 4, 3 * len(made) // 4)
    assert abs(np.polyfit(made[middle], log.output[middle, 0], 1)[0] - 1.0) > 0.03


@pytest.mark.parametrize(("mode", "middle"), [(0, 80.0), (1, 160.0)])
def test_notches_of_arducopter_are_read(mode, middle):
    log = ControllerLog(
        autopilot="ArduCopter",
        firmware="made",
        parameters={
            **dict.fromkeys((f"ATC_RAT_RLL_{n}" for n in GAINS), 0.1),
            "ATC_ANG_RLL_P": 4.5, "INS_GYRO_FILTER": 20.0, "INS_HNTCH_ENABLE": 1.0,
            "INS_HNTCH_MODE": mode, "INS_HNTCH_FREQ": 80.0, "INS_HNTCH_BW": 40.0,
            "INS_HNTCH_ATT": 40.0, "INS_HNTCH_HMNCS": 5.0, "INS_HNTCH_REF": 0.1,
            "MOT_THST_HOVER": 0.4,
        },
        changed=(), time=np.arange(3) / 400.0, set_point=np.zeros((3, 3)),
        rate=np.zeros((3, 3)), output=np.zeros((3, 3)),
    )  # fmt: skip
    assert moving_filters(log) == ()
    low, first, third = rate_controller(log, 0).gyro_filters
    assert (low.frequency, low.order) == (20.0, 2)
    assert [first.frequency, third.frequency] == [middle, 3.0 * middle]
    assert abs(first.response(np.array([middle]))[0]) == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("set_to", "named"),
    [
        ({"INS_HNTCH_ENABLE": 1.0, "INS_HNTCH_MODE": 3.0}, ("INS_HNTCH_MODE 3",)),
        ({"INS_HNTCH_ENABLE": 0.0, "INS_HNTCH_MODE": 3.0}, ()),
        (
            {"INS_HNTC2_ENABLE": 1.0, "INS_HNTC2_MODE": 4.0, "INS_HNTC2_OPTS": 17.0},
            ("INS_HNTC2_MODE 4", "INS_HNTC2_OPTS 17"),
        ),
        ({"INS_HNTCH_ENABLE": 1.0, "INS_HNTCH_MODE": 1.0, "INS_HNTCH_OPTS": 6.0}, ()),
        ({"IMU_GYRO_DNF_EN": 3.0}, ("IMU_GYRO_DNF_EN 3",)),
    ],
)
def test_notches_that_follow_the_rotors_are_named(set_to, named):
    log = ControllerLog(
        autopilot="ArduCopter", firmware="made", parameters=set_to, changed=(),
        time=np.arange(3) / 400.0, set_point=np.zeros((3, 3)), rate=np.zeros((3, 3)),
        output=np.zeros((3, 3)),
    )  # fmt: skip
    assert moving_filters(log) == named


def test_a_missing_gain_is_named():
    path = LOGS / "px4-hex.ulg"
    if not path.exists():
        pytest.skip(f"no real logs: {path} is absent")
    log = read_with_controller(path)[1]
    short = {k: v for k, v in log.parameters.items() if k != "MC_ROLLRATE_P"}
    with pytest.raises(LogError, match="no parameter MC_ROLLRATE_P"):
        rate_controller(dataclasses.replace(log, parameters=short), 0)


def test_a_firmware_without_a_known_controller_is_refused():
    path = DATA / "tudelft-indiflight" / "LOG00267.BFL"
    if not path.exists():
        pytest.skip(f"no real logs: {path} is absent")
    with pytest.raises(LogError, match="INDIflight has no PID"):
        read_with_controller(path)[1]
