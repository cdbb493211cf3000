"""Of a log at 1 kHz a fit needs a quarter of the samples, and the result tells of them all."""

import numpy as np
import pytest

import rotorfit.fit.dataset.load
from flown import airframe_table
from rotorfit.fit.dataset.load import load_flight
from rotorfit.fit.experiment.experiment import single_flight_experiment
from rotorfit.identification import identify
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, variant
from rotorfit.simulation.experiment_files import IMU_AND_COMMAND, IMU_AND_SPEED, write_flight_table


@pytest.fixture(scope="module")
def experiments(tmp_path_factory):
    """The same flight as a log of measured speeds, and as one of commands."""
    folder = tmp_path_factory.mktemp("fast")
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(seconds=14.0, sample_rate=1000.0, sensors=sensors)
    flight = simulate_flight(truth, vehicle, scenario, seed=3)
    motors = {
        "measured": 'speed = "measured"\n',
        "commanded": f'speed = "commanded"\nlaw = {{ linear = [0.0, {flight.max_speed!r}] }}\n',
    }
    airframe = f"{airframe_table(vehicle)}[motors]\n"
    made = {}
    for name, channels in (("measured", IMU_AND_SPEED), ("commanded", IMU_AND_COMMAND)):
        (folder / f"{name}.toml").write_text(airframe + motors[name], encoding="utf-8")
        write_flight_table(flight, folder / f"{name}.csv", channels=channels)
        made[name] = single_flight_experiment(
            folder / f"{name}.csv", mass=truth.mass, airframe=folder / f"{name}.toml"
        )
    return made


@pytest.mark.filterwarnings("ignore:.*gyro bias not removed")
@pytest.mark.parametrize("speed", ["measured", "commanded"])
def test_fewer_samples_give_the_same_numbers(experiments, speed, monkeypatch):
    found = identify(experiments[speed])
    monkeypatch.setattr(
        rotorfit.fit.dataset.load, "decimated", lambda prepared, motors, *, top: prepared
    )
    wanted = identify(experiments[speed])
    assert found.flights == wanted.flights
    assert [p.verdict for p in found.parameters] == [p.verdict for p in wanted.parameters]
    pairs = [
        (new, old)
        for new, old in zip(found.parameters, wanted.parameters, strict=True)
        if old.value is not None and old.std
    ]
    moved = {new.full_name: abs(new.value - old.value) / old.std for new, old in pairs}
    assert len(moved) > 12
    assert max(moved.values()) < 0.05, moved
    assert np.array([new.std / old.std for new, old in pairs]) == pytest.approx(1.0, abs=0.03)


def test_fits_in_bands_decimate_by_four_and_paper_fits_do_not(experiments):
    experiment = experiments["commanded"]
    entry = experiment.configuration[0].flights[0]
    fewer = load_flight(entry, experiment)
    own = experiment.identification.model_copy(update={"preset": "paper"})
    every = load_flight(entry, experiment.model_copy(update={"identification": own}))
    assert fewer.recorded == every.recorded
    assert every.prepared.data.sample_rate == pytest.approx(1000.0)
    assert every.recorded.samples == every.prepared.data.samples_used
    assert fewer.prepared.data.sample_rate == pytest.approx(250.0)
    assert fewer.prepared.data.samples_used == pytest.approx(every.recorded.samples / 4, abs=1.0)
    assert fewer.prepared.motor_rate == every.prepared.motor_rate
    assert np.isfinite(fewer.prepared.data.rotor_speed).all()
