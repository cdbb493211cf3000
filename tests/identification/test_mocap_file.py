"""A flight's pose from a motion-capture file of its own: another clock, markers mounted turned."""

import dataclasses

import pytest
from scipy.spatial.transform import Rotation

from flown import experiment_file, quietly_identified
from rotorfit.errors import ExperimentError, FlightError
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, variant
from rotorfit.simulation import write_flight_table as write_table

MOUNTING = Rotation.from_euler("ZYX", [-75.0, 3.0, -5.0], degrees=True)
START = -812.345


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("flight")


@pytest.fixture(scope="module")
def flight(folder):
    """A flight, its log without pose, and a trajectory with position and attitude."""
    simulated, errors = variant(paper_vehicle("B"), "noisy")
    errors = dataclasses.replace(errors, position_std=3e-4, attitude_std=2e-3, pose_rate=100.0)
    flight = simulate_flight(*simulated, Scenario(seconds=60.0, sensors=errors), seed=5)
    write_table(flight, folder / "flight.csv")
    write_recording(flight, folder / "take.csv")
    return flight


def write_recording(flight, path):
    """A trajectory in TUM's form, of a body that is mounted turned, on a clock of its own."""
    rows = ["t,x,y,z,qx,qy,qz,qw"]
    attitudes = Rotation.from_quat(flight.attitude_wxyz_measured[:, [1, 2, 3, 0]]) * MOUNTING
    for time, place, q in zip(
        flight.pose_time, flight.position_measured, attitudes.as_quat(), strict=True
    ):
        rows.append(",".join(f"{value:.9f}" for value in (time + START, *place, *q)))
    path.write_text("\n".join([*rows, ""]))


def experiment(folder, flight, *, source, entry='{ file = "flight.csv", mocap = "take.csv" }'):
    path = experiment_file(
        folder / "experiment.toml",
        flight.vehicle,
        [folder / "flight.csv"],
        mass=flight.truth.mass,
        extra=f'[identification]\nsource = "{source}"',
    )
    text = path.read_text().replace(f'"{folder / "flight.csv"}"', entry)
    path.write_text(text)
    return path


def test_the_recording_identifies_the_vehicle_as_the_imu_does(folder, flight):
    truth = flight.truth
    results = [
        quietly_identified(experiment(folder, flight, source=source)) for source in ("imu", "mocap")
    ]
    for result in results:
        assert result.parameter("kt").value == pytest.approx(truth.kt, rel=0.01)
        assert result.parameter("kd").value == pytest.approx(truth.kd, rel=0.02)
        for name, value in zip(("Ixx", "Iyy", "Izz"), truth.inertia[:3], strict=True):
            assert result.parameter(name).value == pytest.approx(value, rel=0.02), name
    # Aligned to the gyro, motion capture has no delay left.
    assert abs(results[1].parameter("motor_delay").value) < 1e-3


def test_without_the_recording_there_is_no_pose(folder, flight):
    path = experiment(folder, flight, source="mocap", entry='"flight.csv"')
    with pytest.raises(Exception, match="no position from motion capture"):
        quietly_identified(path)


def test_the_recording_of_another_flight_is_refused(folder, flight):
    other = simulate_flight(*paper_vehicle("B"), Scenario(seconds=20.0), seed=9)
    write_recording(other, folder / "other.csv")
    entry = '{ file = "flight.csv", mocap = { file = "other.csv" } }'
    path = experiment(folder, flight, source="mocap", entry=entry)
    with pytest.raises(FlightError, match=r"other\.csv with flight\.csv: the rates of gyro and"):
        quietly_identified(path)


def test_paths_of_recordings_are_relative_to_the_experiment(folder, flight):
    loaded = load_experiment(experiment(folder, flight, source="mocap"))
    (entry,) = loaded.configuration[0].flights
    assert entry.mocap is not None
    assert entry.mocap.file == str(folder / "take.csv")


def test_unknown_keys_of_a_recording_are_refused(folder, flight):
    entry = '{ file = "flight.csv", mocap = { file = "take.csv", rate = 100 } }'
    with pytest.raises(ExperimentError, match="rate"):
        load_experiment(experiment(folder, flight, source="mocap", entry=entry))
