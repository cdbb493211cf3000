"""The flown loop proves a right prediction, and planted errors fail the proof."""

import dataclasses
import json
import os
import warnings
from pathlib import Path

import numpy as np
import pytest

from rotorfit.control_loop.loop import judge_flight, loop_margins
from rotorfit.control_loop.plain import loop_to_json
from rotorfit.experiment.experiment import load_experiment
from rotorfit.identification.identify import identify
from rotorfit.logs import read_log
from rotorfit.logs.controller_log import read_controller_log
from rotorfit.report.loop import loop_text

DATA = Path(os.environ.get("ROTORFIT_DATA") or Path(__file__).parents[3] / "shared" / "data")
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


def test_the_flown_loop_is_proved_past_its_crossover(result):
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
    assert outcome.axes[2].proved is None
    text = loop_text(outcome)
    assert "roll: calm; turns into oscillation if the loop were" in text
    assert "Step of the rate asked for" in text
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
def test_a_planted_error_of_the_vehicle_fails_the_proof(result, planted):
    outcome = loop_margins(changed(result, **planted), LOG, "A", draws=DRAWS)
    for loop in outcome.axes[:2]:
        assert loop.proved is None
        assert "the vehicle, its delay or a filter is another" in loop.doubts[0]
    assert "not proved, so no margin is called good" in loop_text(outcome)


def test_a_gain_read_wrongly_withholds_the_margins(result):
    log = read_controller_log(LOG)
    parameters = {**log.parameters, "MC_ROLLRATE_P": 1.15 * log.parameters["MC_ROLLRATE_P"]}
    wrong = dataclasses.replace(log, parameters=parameters)
    roll, pitch, _ = judge_flight(result, "A", read_log(LOG), wrong, draws=DRAWS).axes
    assert "of the controller as its parameters set it" in roll.doubts[0]
    assert pitch.doubts == ()


def test_a_forgotten_filter_of_d_withholds_the_margins(result):
    log = read_controller_log(LOG)
    wrong = dataclasses.replace(log, parameters={**log.parameters, "IMU_DGYRO_CUTOFF": 0.0})
    for loop in judge_flight(result, "A", read_log(LOG), wrong, draws=DRAWS).axes[:2]:
        assert not loop.replay.is_right
        assert loop.replay.slope == pytest.approx(1.0, abs=0.03)
        assert "the rate's derivative" in loop.doubts[0]


def test_a_forgotten_gyro_filter_is_measured_instead(result):
    log, flight = read_controller_log(LOG), read_log(LOG)
    wrong = dataclasses.replace(log, parameters={**log.parameters, "IMU_GYRO_CUTOFF": 0.0})
    known, forgot = (
        judge_flight(result, "A", flight, one, draws=DRAWS).axes[0] for one in (log, wrong)
    )
    assert forgot.controller.gyro_filters == ()
    phases = [loop.with_attitude.phase.value for loop in (known, forgot)]
    assert phases[1] == pytest.approx(phases[0], abs=1.0)


def test_other_gains_leave_the_feed_forward_alone(result):
    log = read_controller_log(LOG)
    forward = dataclasses.replace(log, parameters={**log.parameters, "MC_ROLLRATE_FF": 0.1})
    with_it, without = (
        judge_flight(result, "A", read_log(LOG), one, draws=DRAWS).axes[0] for one in (forward, log)
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
