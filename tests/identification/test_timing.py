"""Lag and delay of commanded motors are found from the flight, without being told."""

import warnings

import pytest

from rotorfit.errors import FlightWarning
from rotorfit.identification.experiment import load_experiment
from rotorfit.identification.identify import identify
from rotorfit.identification.validate import validate_file
from rotorfit.simulation.experiment_files import experiment_files
from rotorfit.simulation.experiments import plan_experiment


@pytest.fixture(scope="module")
def flown_on_commands(tmp_path_factory):
    """Return the folder of a flight on commands, and what is identified from it."""
    folder = tmp_path_factory.mktemp("commands")
    plan = plan_experiment("single", "noisy", seed=4, seconds=30.0)
    for name, text in experiment_files(plan).items():
        (folder / name).write_text(text, newline="\n")
    assert "lag =" not in (folder / "experiment.toml").read_text()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FlightWarning)
        return folder, identify(load_experiment(folder / "experiment.toml"))


def test_lag_plus_delay_is_sharp(flown_on_commands):
    _, result = flown_on_commands
    total = result.derived_value("motor_lag_total")
    assert total.value == pytest.approx(0.050, abs=1e-3)
    low, high = total.interval
    assert low < 0.050 < high


def test_the_split_is_found_too(flown_on_commands):
    _, result = flown_on_commands
    assert result.parameter("motor_lag").value == pytest.approx(0.040, abs=0.004)
    assert result.parameter("motor_delay").value == pytest.approx(0.010, abs=0.004)


def test_validation_uses_the_lag_that_was_found(flown_on_commands):
    folder, result = flown_on_commands
    comparison = validate_file(result, folder / "A2.csv")
    # Without the lag these are a third of the wrench and more.
    assert comparison.relative_error["Mx"] < 0.05
    assert comparison.relative_error["My"] < 0.05
