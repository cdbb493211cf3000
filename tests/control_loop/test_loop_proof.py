"""The flown loop proves a right prediction, and planted errors fail the proof."""

import dataclasses
import json
import os
import warnings
from pathlib import Path

import pytest

from rotorfit.control_loop.loop import judge_flight, judge_loop
from rotorfit.control_loop.plain import loop_to_json
from rotorfit.experiment.experiment import load_experiment
from rotorfit.identification.identify import identify
from rotorfit.logs import read_log
from rotorfit.logs.controller_log import read_controller_log
from rotorfit.report.loop_text import loop_text

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
    outcome = judge_loop(result, "A", LOG, draws=DRAWS)
    for loop in outcome.axes[:2]:
        assert loop.doubts == ()
        low, high = loop.proved
        assert low < 0.5
        assert high > loop.rate_loop.crossover.value
        assert loop.error.gain == pytest.approx(1.0, abs=0.05)
        assert abs(loop.error.delay) < 1.5e-3
    assert outcome.axes[2].proved is None
    text = loop_text(outcome)
    assert "roll: calm; turns into oscillation if the loop were" in text
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
    outcome = judge_loop(changed(result, **planted), "A", LOG, draws=DRAWS)
    for loop in outcome.axes[:2]:
        assert loop.proved is None
        assert "the vehicle, its delay or a filter is another" in loop.doubts[0]
    assert "not proved, so no margin is called good" in loop_text(outcome)


def test_a_gain_read_wrongly_withholds_the_margins(result):
    log = read_controller_log(LOG)
    parameters = {**log.parameters, "MC_ROLLRATE_P": 1.15 * log.parameters["MC_ROLLRATE_P"]}
    wrong = dataclasses.replace(log, parameters=parameters)
    roll, pitch, _ = judge_flight(result, "A", read_log(LOG), wrong, draws=DRAWS).axes
    assert "times that of the controller as its parameters set it" in roll.doubts[0]
    assert pitch.doubts == ()
