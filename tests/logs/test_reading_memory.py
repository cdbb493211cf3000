"""A long log is read and prepared within three times the memory of the channels it needs.

Between a log of some repetitions and one of more, so that what does not grow with the log is
left out. By tracemalloc, which counts the arrays, not what the allocator keeps of them.
"""

import tracemalloc
from itertools import islice

import pytest
from benchmarks.large_log import CHANNELS, FORMATS, RATE, SECONDS, parts
from flight_writers import WRITERS, in_whole_rpm

from flown import experiment_file, simulated
from rotorfit.fit.dataset.load import load_flight
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.fit.reduction.frequency_bands import flight_bands
from rotorfit.flight.motors.motor_model import MotorResponse
from rotorfit.logs import read_log

LIMIT = 3.0
REPETITIONS = (2, 6)


@pytest.fixture(scope="module")
def flight():
    return in_whole_rpm(simulated("quad-x", "noisy", seed=3, seconds=SECONDS, sample_rate=RATE))


def written(name, flight, folder):
    """Return a log of the flight repeated twice, and one of six times."""
    made = []
    for count in REPETITIONS:
        path = folder / f"{count}" / WRITERS[name][0]
        path.parent.mkdir()
        path.write_bytes(b"".join(islice(parts(name, flight, folder / "once"), count)))
        made.append(path)
    return made


def needed(path):
    taken = [read_log(path).channels[name] for name in CHANNELS]
    return sum(8 * (channel.values.size + channel.time.size) for channel in taken)


def peak_of(work):
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def growth(logs, work):
    """Return the memory that the longer log takes more, over that of the channels it has more."""
    channels = needed(logs[1]) - needed(logs[0])
    assert channels > 0.9 * (REPETITIONS[1] - REPETITIONS[0]) * SECONDS * RATE * 13 * 8
    return (peak_of(lambda: work(logs[1])) - peak_of(lambda: work(logs[0]))) / channels


@pytest.mark.parametrize(
    "name",
    [name if name == "table" else pytest.param(name, marks=pytest.mark.slow) for name in FORMATS],
)
def test_a_long_log_is_read_within_three_times_its_channels(name, flight, tmp_path):
    assert growth(written(name, flight, tmp_path), read_log) < LIMIT


def test_a_long_flight_fits_into_three_times_its_channels(flight, tmp_path):
    def work(path):
        experiment = load_experiment(
            experiment_file(
                path.with_suffix(".toml"), flight.vehicle, [path], mass=flight.truth.mass
            )
        )
        vehicle = vehicle_of(experiment.airframe, "imu")
        (entry,) = experiment.configuration[0].flights
        used = load_flight(entry, experiment)
        assert used.log.channels == {}
        assert len(flight_bands([used.prepared], vehicle, MotorResponse(lag=0.02, delay=0.003))) > 0

    assert growth(written("table", flight, tmp_path), work) < LIMIT
