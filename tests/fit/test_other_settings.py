"""Lengths that were measured with a tape: what their errors shift is in the intervals."""

import dataclasses

import numpy as np
import pytest

import flown
from rotorfit.fit.fit_flights import longer_arms, moved_imu
from rotorfit.simulation import layout_vehicle
from rotorfit.simulation.experiment_files import simulate

TRUE_IMU = (0.02, -0.01, 0.03)
ARM = 0.25


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    target = tmp_path_factory.mktemp("tape")
    simulate(target, "single", "real", seconds=15.0, seed=3)
    return target


def identified(folder, old="", new=""):
    path = folder / "changed.toml"
    text = (folder / "experiment.toml").read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return flown.quietly_identified(path)


@pytest.fixture(scope="module")
def exact(folder):
    return identified(folder)


def half_width(result, name):
    found = result.parameter(name) if name == "kt" else result.derived_value(name)
    low, high = found.interval
    return 0.5 * (high - low)


def test_longer_arms_keep_their_centre_and_height():
    vehicle = layout_vehicle("hexa-tilted").vehicle
    longer = longer_arms(vehicle, 0.01)
    assert longer.arm == pytest.approx(vehicle.arm + 0.01)
    assert longer.positions.mean(axis=0) == pytest.approx(vehicle.positions.mean(axis=0))
    assert np.array_equal(longer.positions[:, 2], vehicle.positions[:, 2])
    assert np.array_equal(longer.axes, vehicle.axes)


def test_a_moved_imu_is_moved_along_one_axis():
    vehicle = dataclasses.replace(layout_vehicle("quad-x").vehicle, imu_position=TRUE_IMU)
    assert moved_imu(vehicle, 2, 0.005).imu_position == pytest.approx((0.02, -0.01, 0.035))


def test_inertia_goes_with_the_arms_and_thrust_does_not(folder, exact):
    unsure = identified(folder, 'axes = "FLU"\n', f'axes = "FLU"\narm_std = {0.02 * ARM}\n')
    for name in ("Ixx_com", "Iyy_com"):
        value = exact.derived_value(name).value
        added = half_width(unsure, name) ** 2 - half_width(exact, name) ** 2
        assert np.sqrt(added) == pytest.approx(2 * 0.02 * value, rel=0.1)
    assert half_width(unsure, "kt") == pytest.approx(half_width(exact, "kt"), rel=0.05)
    assert unsure.derived_value("Ixx_com").value == exact.derived_value("Ixx_com").value


def test_intervals_include_a_misplaced_imu(folder, exact):
    place = f"imu = {{ position = {list(TRUE_IMU)} }}"
    off = f"imu = {{ position = {[0.022, -0.008, 0.032]}, position_std = 0.002 }}"
    unsure = identified(folder, place, off)
    added = half_width(unsure, "com_z") ** 2 - half_width(exact, "com_z") ** 2
    # By the drag of the rotors, at their height, the flight tells a part of it.
    assert np.sqrt(added) == pytest.approx(2 * 0.002, rel=0.4)
    for name in ("com_x", "com_y", "com_z", "Ixx_com", "Iyy_com"):
        shift = unsure.derived_value(name).value - exact.derived_value(name).value
        assert abs(shift) < half_width(unsure, name)
