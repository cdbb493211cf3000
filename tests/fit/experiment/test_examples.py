"""The examples are experiments and airframes as they stand."""

from pathlib import Path

import pytest

from rotorfit.errors import LogError
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.fit.experiment.experiment import load_experiment, single_flight_experiment
from rotorfit.identification import identify

EXAMPLES = Path(__file__).parents[3] / "examples"


def test_the_experiment_is_read_whole():
    experiment = load_experiment(EXAMPLES / "experiment.toml")
    assert [entry.name for entry in experiment.configuration] == ["A", "B"]
    assert experiment.configuration[1].payload_of == "A"
    assert len(vehicle_of(experiment.airframe).rotors) == 4
    with pytest.raises(LogError, match=r"flight1\.csv: no such file"):
        identify(experiment)


def test_the_airframe_is_read():
    experiment = single_flight_experiment(
        Path("LOG.BFL"), mass=0.428, airframe=EXAMPLES / "cinerat.toml"
    )
    assert vehicle_of(experiment.airframe).arm == pytest.approx(0.0781, abs=1e-4)
