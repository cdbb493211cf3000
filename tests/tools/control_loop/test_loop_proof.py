"""The flown loop proves a right prediction, and planted errors fail the proof."""

import copy
import dataclasses
import json
import os
import warnings
from pathlib import Path

import numpy as np
import pytest

import rotorfit
from rotorfit.cli.main import main
from rotorfit.errors import LogError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify
from rotorfit.logs import read_log
from rotorfit.logs.controller_log import ControllerLog, read_with_controller
from rotorfit.report.loop import loop_html, loop_text, verdict
from rotorfit.report.result_page import report_html
from rotorfit.tools.control_loop.controllers import rate_controller
from rotorfit.tools.control_loop.loop import judge_flight, loop_margins, loop_to_json
from rotorfit.tools.control_loop.plant import GyroFilter
from rotorfit.tools.control_loop.proof import Band, LoopError, replay_mixer, too_little
from rotorfit.tools.control_loop.vehicle import Flown

DATA = Path(os.environ.get("ROTORFIT_DATA") or Path(__file__).parents[4] / "shared" / "data")
LOG = DATA / "autopilot-sitl" / "px4-heavy-recommended.ulg"
DECLARED = f"""[airframe]
rotors = [
  {{ position = [0.21, -0.28, 0.0], spin = "ccw" }},
  {{ position = [-0.21, 0.28, 0.0], spin = "ccw" }},
  {{ position = [0.21, 0.28, 0.0], spin = "cw" }},
  {{ position = [-0.21, -0.28, 0.0], spin = "cw" }},
]
[motors]
speed = "commanded"
[[configuration]]
name = "A"
mass = 3.2
flights = ["{LOG.as_posix()}"]
"""
DRAWS = 60


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    if not LOG.exists():
        pytest.skip(f"no real logs: {LOG} is absent")
    path = tmp_path_factory.mktemp("loop") / "heavy.toml"
    path.write_text(DECLARED, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return identify(load_experiment(path))


def changed(result, **factors):
    """Return the result with numbers times factors, or moved by an amount: (factor, amount)."""

    def moved(number):
        if number.name not in factors or number.value is None:
            return number
        factor, amount = factors[number.name]
        interval = tuple(factor * end + amount for end in number.interval)
        return dataclasses.replace(number, value=factor * number.value + amount, interval=interval)

    return dataclasses.replace(
        result,
        parameters=tuple(map(moved, result.parameters)),
        derived=tuple(map(moved, result.derived)),
    )


def test_the_flown_loop_is_proved_past_its_crossover(result, assert_wording):
    outcome = loop_margins(result, LOG, "A", draws=DRAWS)
    for loop in outcome.axes[:2]:
        assert loop.doubts == ()
        low, high = loop.proved
        assert low < 0.5
        assert high > loop.rate_loop.crossover.value
        assert loop.error.gain == pytest.approx(1.0, abs=0.05)
        assert abs(loop.error.delay) < 1.5e-3
        step = loop.step
        assert (step.low <= step.high).all()
        assert np.abs(step.value[step.time < loop.error.delay + 0.005]).max() < 0.02
        assert 0.8 < step.value[-1] < 1.2
        wide = loop.rate_loop.bandwidth
        assert wide.low < wide.value < wide.high
        assert wide.value > loop.rate_loop.crossover.value > loop.with_attitude.bandwidth.value
    assert outcome.axes[2].proved is None
    text = loop_text(outcome)
    assert_wording(text)
    assert json.loads(loop_to_json(outcome))["axes"][0]["proved"][1] > 5.0


@pytest.mark.parametrize(
    "planted",
    [
        {"motor_delay": (1.0, 4e-3)},
        {"Ixx_over_kt": (1.15, 0.0), "Iyy_over_kt": (1.15, 0.0)},
        {"Ixx_over_kt": (0.85, 0.0), "Iyy_over_kt": (0.85, 0.0)},
        {"Ixx_over_kt": (2.0, 0.0), "Iyy_over_kt": (1.6, 0.0), "motor_lag": (1.5, 0.0)},
    ],
    ids=["4 ms", "15 % less", "15 % more", "another vehicle"],
)
def test_a_planted_error_of_the_vehicle_fails_the_proof(result, planted, assert_wording):
    outcome = loop_margins(changed(result, **planted), LOG, "A", draws=DRAWS)
    for loop in outcome.axes[:2]:
        assert loop.proved is None
        assert_wording(loop.doubts[0])
    assert_wording(loop_text(outcome))


def test_a_result_that_is_wrong_in_roll_proves_no_pitch(result, assert_text, assert_wording):
    planted = changed(result, Ixx_over_kt=(2.0, 0.0))
    roll, pitch, _ = loop_margins(planted, LOG, "A", draws=DRAWS).axes
    assert_wording(roll.doubts[0])
    assert_text(pitch.doubts)


def test_a_wrong_spin_range_fails_the_proof(result):
    settings = copy.deepcopy(dict(result.settings))
    settings["motors"]["law"]["sqrt"]["start"] = 0.2
    wrong = dataclasses.replace(result, settings=settings)
    for loop in loop_margins(wrong, LOG, "A", draws=DRAWS).axes[:2]:
        assert loop.error.gain == pytest.approx(0.82, abs=0.04)
        assert "times the predicted effectiveness" in loop.doubts[0]


def test_the_command_writes_a_page(result, tmp_path, capsys):
    result.save(tmp_path / "result.json")
    page = tmp_path / "loop.html"
    with pytest.raises(SystemExit) as ended:
        main(["loop", str(tmp_path / "result.json"), str(LOG), "--report", str(page)])
    assert ended.value.code in (None, 0)
    assert "Proof on this log" in capsys.readouterr().out
    text = page.read_text(encoding="utf-8")
    assert "is it tuned well?" in text
    assert text.count('class="chart still"') == 4  # roll and pitch, by frequency and over time
    assert text.count("area body") > 12  # the measured bands
    assert "<td>1.47" in text or "<td>1.46" in text or "<td>1.48" in text  # roll's peak
    assert "http:" not in text and "https:" not in text


def test_the_report_of_a_result_shows_its_loop(result):
    outcome = loop_margins(result, LOG, draws=20)
    text = report_html(result, loop=outcome)
    assert 'href="#tune"' in text
    assert text.count('class="chart still"') == 4
    assert loop_text(outcome).split("roll: ")[1][:20] in text
    assert 'id="tune"' not in report_html(result)


def test_a_loop_that_d_dominates_is_not_called_calm(result, assert_text):
    outcome = loop_margins(result, LOG, draws=20)
    roll = outcome.axes[0]
    assert roll.derivative_share == pytest.approx(0.63, abs=0.03)
    assert verdict(roll).startswith("roll: calm; turns into")
    noisy = dataclasses.replace(roll, derivative_share=1.4)
    assert_text(verdict(noisy))


def test_why_a_flight_shows_too_little_is_said(assert_text):
    band = Band(low=0.3, high=0.45, ratio=1.0, degrees=0.0, uncertainty=0.1, by_gain=1, by_delay=0)
    near = dataclasses.replace(band, low=4.0, high=6.0)
    sharp = LoopError(gain=1.0, delay=0.0, covariance=np.diag([0.02, 1e-3]) ** 2)
    late = dataclasses.replace(sharp, covariance=np.diag([0.02, 4e-3]) ** 2)
    weak = dataclasses.replace(sharp, covariance=np.diag([0.2, 1e-3]) ** 2)
    assert too_little(5.0, [band, near], sharp) == []
    assert_text(too_little(5.0, [band], sharp)[0])
    assert "and is seen to 14 degrees" in too_little(5.0, [band, near], late)[0]
    assert_text(too_little(5.0, [band, near], weak)[0])


def test_unproven_yaw_says_what_lacks_and_what_to_fly(result, assert_wording):
    words = verdict(loop_margins(result, LOG, draws=20).axes[2])
    assert_wording(words)
    assert "fly 20 s" in words


def test_a_page_of_what_is_not_proved_says_so(result):
    wrong = changed(result, Ixx_over_kt=(0.1, 0.0), Iyy_over_kt=(0.1, 0.0))
    outcome = loop_margins(wrong, LOG, draws=20)
    assert "No axis is proved" in loop_html(outcome)
    assert "lower P and D" not in loop_html(outcome) + loop_text(outcome)


@pytest.mark.parametrize("name", [LOG.name, "arducopter-exported.BIN"])
def test_flight_and_controller_come_of_one_pass(name, monkeypatch):
    path = LOG.with_name(name)
    if not path.exists():
        pytest.skip(f"no real logs: {path} is absent")
    opened, plain_open = [], Path.open

    def noted(self, *given, **named):
        opened.append(self)
        return plain_open(self, *given, **named)

    monkeypatch.setattr(Path, "open", noted)
    flight, _ = read_with_controller(path)
    with_controller = len(opened)
    alone = read_log(path)
    assert with_controller == len(opened) - with_controller
    assert flight.channels.keys() == alone.channels.keys()
    for channel, other in zip(flight.channels.values(), alone.channels.values(), strict=True):
        assert np.array_equal(channel.values, other.values, equal_nan=True)
    assert flight.notes == alone.notes


def test_a_configuration_that_is_not_there_is_refused(result):
    with pytest.raises(rotorfit.OutputError, match="has the configurations A; say which"):
        rotorfit.loop_margins(result, LOG, "B")


def test_what_is_known_of_other_loops_is_said(result, tmp_path, assert_wording):
    log = tmp_path / "LOG.BFL"
    log.write_bytes(HEADER + b"H Firmware revision:Betaflight 4.5.1 (77d01ba3b) STM32F405\n")
    with pytest.raises(rotorfit.LogError) as caught:
        rotorfit.loop_margins(result, log)
    assert "TPA" in str(caught.value)
    assert "Ixx 309.9 +- 3.3" in str(caught.value)
    assert "1/(m s^2) per" in str(caught.value)
    assert_wording(str(caught.value))
    assert "motor_lag 33.1 +- 1.8 ms" in str(caught.value)


HEADER = b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n"


@pytest.mark.parametrize(
    ("firmware", "words"),
    [
        (b"Betaflight 4.5.1", "D falls to its minimum"),
        (b"INAV 7.1.2", "D is boosted"),
        (b"Indiflight 5.0.0", "inverts the vehicle"),
        (b"Something 1.0", "rotorfit knows those of PX4"),
    ],
)
def test_why_a_loop_is_not_judged_goes_by_firmware(tmp_path, firmware, words):
    log = tmp_path / "LOG.BFL"
    log.write_bytes(HEADER + b"H Firmware revision:" + firmware + b" (0) STM32\n")
    with pytest.raises(LogError, match=words):
        read_with_controller(log)


def test_the_mixer_shows_a_wrong_curve_and_spin_range():
    right = mixed_by(0.2, MOT_THST_EXPO=0.65, MOT_SPIN_MIN=0.15, MOT_SPIN_MAX=0.95)
    assert right.factor == pytest.approx(0.65, abs=1e-6)
    assert right.slope == pytest.approx(1.0, abs=1e-6)
    wrong = mixed_by(0.2, MOT_THST_EXPO=0.65, MOT_SPIN_MIN=0.0, MOT_SPIN_MAX=1.0)
    assert not wrong.is_right
    straight = mixed_by(0.2, MOT_THST_EXPO=0.0, MOT_SPIN_MIN=0.15, MOT_SPIN_MAX=0.95)
    assert straight.factor == pytest.approx(0.65, abs=1e-6)
    assert not straight.is_right


def test_the_curve_does_no_harm_at_half_of_the_command():
    middle = 0.65 * 0.25 + 0.35 * 0.5
    straight = mixed_by(middle, MOT_THST_EXPO=0.0, MOT_SPIN_MIN=0.15, MOT_SPIN_MAX=0.95)
    assert straight.factor == pytest.approx(0.65, abs=1e-6)
    assert straight.is_right


def mixed_by(throttle, **parameters):
    """Replay a mixer with these parameters; the log's own are .65, .15 and .95."""
    count = 4000
    output = 0.05 * np.random.default_rng(1).standard_normal((count, 3))
    factors = np.array([[-0.5, 0.5, 0.5, -0.5], [0.5, -0.5, 0.5, -0.5], [0.5, 0.5, -0.5, -0.5]])
    thrust = throttle + output @ factors
    share = (-0.35 + np.sqrt(0.35**2 + 4 * 0.65 * thrust)) / (2 * 0.65)
    log = ControllerLog(
        autopilot="ArduCopter", firmware="made", parameters=parameters, changed=(),
        time=np.arange(count) / 400.0, set_point=output, rate=output, output=output,
    )  # fmt: skip
    flight = Flown(
        log=log, commands=0.15 + 0.8 * share, squares=thrust, free=np.ones(count, bool), held=0.0025
    )
    return replay_mixer(flight, 0)


def test_a_gain_read_wrongly_withholds_the_margins(result, assert_wording):
    flight, log = read_with_controller(LOG)
    parameters = {**log.parameters, "MC_ROLLRATE_P": 1.15 * log.parameters["MC_ROLLRATE_P"]}
    wrong = dataclasses.replace(log, parameters=parameters)
    roll, pitch, _ = judge_flight(result, "A", flight, wrong, draws=DRAWS).axes
    assert_wording(roll.doubts[0])
    assert pitch.doubts == ()


def test_a_forgotten_filter_of_d_withholds_the_margins(result):
    flight, log = read_with_controller(LOG)
    wrong = dataclasses.replace(log, parameters={**log.parameters, "IMU_DGYRO_CUTOFF": 0.0})
    for loop in judge_flight(result, "A", flight, wrong, draws=DRAWS).axes[:2]:
        assert not loop.replay.is_right
        assert loop.replay.slope == pytest.approx(1.0, abs=0.03)
        assert "the rate's derivative" in loop.doubts[0]


def test_a_forgotten_gyro_filter_is_measured_instead(result):
    flight, log = read_with_controller(LOG)
    wrong = dataclasses.replace(log, parameters={**log.parameters, "IMU_GYRO_CUTOFF": 0.0})
    known, forgot = (
        judge_flight(result, "A", flight, one, draws=DRAWS).axes[0] for one in (log, wrong)
    )
    assert forgot.controller.gyro_filters == ()
    phases = [loop.with_attitude.phase.value for loop in (known, forgot)]
    assert phases[1] == pytest.approx(phases[0], abs=1.0)


def test_an_unknown_notch_is_in_the_loop_by_its_delay(result, assert_wording):
    flight, log = read_with_controller(LOG)
    notch = GyroFilter(frequency=80.0, order=0, width=40.0, floor=0.01)
    hertz = np.maximum(np.fft.rfftfreq(len(log.rate), log.period), 1e-6)
    spectrum = np.fft.rfft(log.rate, axis=0) * notch.response(hertz)[:, None]
    through = np.fft.irfft(spectrum, n=len(log.rate), axis=0)
    moved = dataclasses.replace(
        log, rate=through, parameters={**log.parameters, "IMU_GYRO_DNF_EN": 1.0}
    )

    def exact(log, axis):
        one = rate_controller(log, axis)
        return dataclasses.replace(one, gyro_filters=(*one.gyro_filters, notch))

    plain = judge_flight(result, "A", flight, log, draws=20).axes[0].with_attitude
    found = judge_flight(result, "A", flight, moved, draws=20)
    known = judge_flight(result, "A", flight, moved, read=exact, draws=20).axes[0].with_attitude
    loop = found.axes[0].with_attitude
    assert any("(IMU_GYRO_DNF_EN 1)" in n for n in found.notes)
    assert_wording(found.notes)
    assert loop.phase.value == pytest.approx(known.phase.value, abs=0.3)
    assert loop.sensitivity.value == pytest.approx(known.sensitivity.value, rel=0.01)
    assert plain.sensitivity.value < known.sensitivity.value - 0.03


def test_other_gains_leave_the_feed_forward_alone(result):
    flight, log = read_with_controller(LOG)
    forward = dataclasses.replace(log, parameters={**log.parameters, "MC_ROLLRATE_FF": 0.1})
    with_it, without = (
        judge_flight(result, "A", flight, one, draws=DRAWS).axes[0] for one in (forward, log)
    )
    assert with_it.controller.scaled(1.5).FF == 0.1
    assert with_it.gains[1][1] == pytest.approx(with_it.with_attitude.sensitivity.high, rel=0.02)
    assert with_it.gains[3][1] != pytest.approx(without.gains[3][1], rel=1e-3)


def test_times_go_with_the_inertia_in_the_result(result):
    names = list(result.covariance_names)
    std = np.sqrt(np.diag(result.covariance))
    for name in ("motor_lag", "motor_delay"):
        assert std[names.index(name)] == pytest.approx(result.parameter(name).std)
    lag, delay, inertia = (names.index(n) for n in ("motor_lag", "motor_delay", "Ixx@A"))
    total = next(d for d in result.derived if d.name == "motor_lag_total")
    of_sum = result.covariance[np.ix_([lag, delay], [lag, delay])].sum() ** 0.5
    assert of_sum == pytest.approx(total.std)
    assert result.covariance[lag, inertia] / std[lag] / std[inertia] < -0.4
    drawn = result.samples(4000).values
    assert np.corrcoef(drawn["motor_lag"], drawn["Ixx_com"])[0, 1] < -0.4
