"""One simulated flight, written in every format, gives the same parameters from each.

Rotor speeds are whole rpm, as telemetry counts them; the Blackbox log counts finer than a flight
controller does (`flight_writers`). What is left is single precision, six decimals and microseconds.
"""

import dataclasses

import numpy as np
import pytest
from flight_writers import RECORDING_WRITERS, WRITERS, in_whole_rpm

from flown import airframe_table, quietly_identified, simulated_vehicle
from rotorfit.simulation import Scenario, simulate_flight, variant, write_flight_table

ALIKE = 1e-3
"""Of each other, as a share of the value, or of the parameter's scale where its value is small."""
SEARCH = 0.02
"""Of its own standard deviation, within which the search for the motors' delay ends."""
KNOWN = ("kt", "kd", "msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
DRAG = ("ulog",)
"""Formats whose log of this flight has a velocity; the parameters of drag are then found too."""
COMMANDED = ("ulog", "dataflash", "crazyflie", "blackbox")
"""Formats whose log has commands beside speeds; the motors' law is then found too."""
LAW = {"motor_lag", "command_delay", "max_speed"}
ESTIMATED = ("accel_bias_z", "inflow")
"""What hangs on how sure a velocity or pose is: an autopilot's log has its own estimate, a table
what was measured."""
POSED = ("ros1", "ulog")
"""The clock of the ULog begins at 12.5 s, which changes the cameras' rate in its last digit."""
IMU = ("gyro", "accel", "rotor_speed")


def flown(seconds: float):
    """Return a flight with noise and cameras at half the rate of the log."""
    truth, sensors = variant(simulated_vehicle("quad-x"), "noisy")
    cameras = dataclasses.replace(sensors, position_std=3e-4, attitude_std=2e-3, pose_rate=100.0)
    scenario = Scenario(sensors=cameras, seconds=seconds)
    return in_whole_rpm(simulate_flight(*truth, scenario, seed=1))


@pytest.fixture(scope="module", params=[12.0, pytest.param(60.0, marks=pytest.mark.slow)])
def flight(request):
    return flown(request.param)


@pytest.fixture(scope="module")
def folder(flight, tmp_path_factory):
    """Tables to compare with: of the IMU, with velocity, with poses, and of poses alone."""
    made = tmp_path_factory.mktemp("flight")
    pose = ("position", "attitude")
    for name, channels in {
        "imu": IMU,
        "imu_velocity": (*IMU, "velocity"),
        "posed": (*IMU, *pose),
        "poses": pose,
    }.items():
        write_flight_table(flight, made / f"{name}.csv", channels=channels)
    return made


@pytest.fixture(scope="module")
def identify_once(folder, flight):
    """Identify from an entry of an experiment file; each entry once."""
    found = {}

    def identify(entry, source="imu"):
        key = (entry, source)
        if key not in found:
            path = folder / f"experiment{len(found)}.toml"
            path.write_text(
                f'{airframe_table(flight.vehicle)}\n[identification]\nsource = "{source}"\n'
                f"[[configuration]]\nmass = {flight.truth.mass!r}\nflights = [{entry}]\n",
                encoding="utf-8",
            )
            found[key] = {p.name: p for p in quietly_identified(path).parameters}
        return found[key]

    return identify


def scale_of(name, parameters, flight):
    """Return how large a parameter would be that matters; its own size for most."""
    arm, mass = flight.vehicle.arm, flight.truth.mass
    lengths = {"msx": 1, "msy": 1, "msz": 1}
    if name in lengths:
        return mass * arm / 50
    if name in ("Ixy", "Ixz", "Iyz"):
        a, b = name[1], name[2]
        return (parameters[f"I{a}{a}"].value * parameters[f"I{b}{b}"].value) ** 0.5 / 20
    return {
        "Jr": parameters["Izz"].value / 1000,
        "motor_delay": 1.0 / flight.sample_rate,
        "twist": parameters["kd"].value / parameters["kt"].value / arm,
        "accel_bias_x": 0.05,
        "accel_bias_y": 0.05,
        "accel_bias_z": 0.05,
    }.get(name, 0.0)


def unlike(mine, other, flight, *, beside=frozenset(), but=()):
    """List the parameters that differ between two results of one flight.

    `beside`: those that only the first has. `but`: those that are less certain in it.
    """
    found = sorted(mine.keys() ^ (other.keys() | beside))
    found += [name for name in KNOWN if name not in mine or mine[name].value is None]
    return found + [
        name
        # What the rotors' drag leaves of the damping of yaw is a difference near zero.
        for name in (other.keys() & mine.keys()) - {"yaw_damping"}
        if not (
            less_certain(mine[name], other[name])
            if name in but
            else alike(mine[name], other[name], tolerance_of(name, other, flight))
        )
    ]


def less_certain(one, other):
    if one.value is None:
        return True
    return one.std > other.std and abs(one.value - other.value) <= 0.1 * other.std


def alike(one, other, tolerance):
    if one.value is None or other.value is None:
        return (one.verdict, one.value) == (other.verdict, other.value)
    return one.verdict == other.verdict and abs(one.value - other.value) <= tolerance


def tolerance_of(name, other, flight):
    parameter = other[name]
    if parameter.value is None:
        return 0.0
    tolerance = ALIKE * max(abs(parameter.value), scale_of(name, other, flight))
    # Poses are in single precision; the velocity that they give is in the rotors' drag.
    # An accelerometer's bias and the IMU's turn share what is felt sideways.
    if name in (
        "motor_delay",
        "rotor_drag",
        "yaw_damping",
        "inflow",
        "accel_bias_x",
        "accel_bias_y",
    ):
        return max(tolerance, SEARCH * parameter.std)
    return tolerance


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "table"])
def test_every_format_gives_the_parameters_of_the_table(name, flight, folder, identify_once):
    file, write = WRITERS[name]
    write(flight, folder / file)
    table = "imu_velocity.csv" if name in DRAG else "imu.csv"
    law = LAW if name in COMMANDED else set()
    mine, other = identify_once(f'"{file}"'), identify_once(f'"{table}"')
    assert unlike(mine, other, flight, beside=law, but=ESTIMATED if name in DRAG else ()) == []


@pytest.mark.parametrize("name", POSED)
def test_poses_in_a_log_give_the_parameters_of_the_table(name, flight, folder, identify_once):
    file, write = WRITERS[name]
    if not (folder / file).exists():
        write(flight, folder / file)
    mine, table = identify_once(f'"{file}"', "mocap"), identify_once('"posed.csv"', "mocap")
    law, but = (LAW, ESTIMATED) if name in COMMANDED else (set(), ())
    assert unlike(mine, table, flight, beside=law, but=but) == []


@pytest.mark.parametrize("start", [0.003, 1000.0])
@pytest.mark.parametrize("name", RECORDING_WRITERS)
def test_every_recording_gives_parameters_of_a_table_of_poses(
    name, start, flight, folder, identify_once
):
    """Wherever the recording's clock begins; by 3 ms the frames fall between the log's rows."""
    file, write = RECORDING_WRITERS[name]
    write(flight, folder / f"{start}-{file}", start=start)
    recording = f'{{ file = "imu.csv", mocap = {{ file = "{start}-{file}" }} }}'
    poses = '{ file = "imu.csv", mocap = { file = "poses.csv" } }'
    assert unlike(identify_once(recording, "mocap"), identify_once(poses, "mocap"), flight) == []


def test_a_flight_is_not_compared_with_itself(flight, identify_once, folder):
    """Another flight's parameters are told from these: the comparison can fail."""
    other = dataclasses.replace(flight, accel=flight.accel * np.array([1.0, 1.0, 1.004]))
    write_flight_table(other, folder / "other.csv")
    assert "kt" in unlike(identify_once('"other.csv"'), identify_once('"imu.csv"'), flight)
