"""Out and back: a flight flown from an exported file is identified, and the numbers return."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from export_material import (
    COM,
    IMU,
    INERTIA_COM,
    KD,
    KT,
    KT_EACH,
    LAG,
    MASS,
    a_result,
    elements,
    flat,
    text_of,
    vehicle,
)

pytest.importorskip("mujoco", reason="mujoco is not installed")
from exported_flight import in_mujoco, in_rotorpy, placed, truth_of, write_log

sys.path.append(str(Path(__file__).parents[1]))
import flown


def identified(tmp_path, there, mass):
    path = flown.experiment_file(tmp_path / "e.toml", there, [tmp_path / "flight.csv"], mass=mass)
    return flown.quietly_identified(path)


def misses(result, truth):
    """Return what its interval does not hold: the distance in half-widths."""
    out = {}
    for name, value in truth.items():
        try:
            found = result.parameter(name)
        except KeyError:
            found = result.derived_value(name)
        assert found.value is not None, name
        half = 0.5 * (found.interval[1] - found.interval[0])
        if abs(found.value - value) > half:
            out[name] = (found.value - value) / half
    return out


def about_com(tensor):
    return {f"{name}_com": value for name, value in elements(tensor).items()}


@pytest.fixture(scope="module")
def from_mujoco(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mujoco")
    there = placed(vehicle(), imu=IMU)
    result = a_result()
    rows = in_mujoco(
        text_of(result, "mujoco"),
        truth_of(MASS, COM, INERTIA_COM),
        there,
        kt=KT_EACH,
        seconds=40.0,
        seed=5,
    )
    write_log(folder / "flight.csv", rows, seed=6)
    return identified(folder, there, MASS)


def test_a_flight_of_the_mujoco_file_gives_its_numbers_back(from_mujoco):
    truth = {
        "kt": KT,
        "kd": KD,
        **{f"kt_{i + 1}": float(kt) for i, kt in enumerate(KT_EACH)},
        **dict(zip(("com_x", "com_y", "com_z"), COM.tolist(), strict=True)),
        **about_com(INERTIA_COM),
    }
    # Of 14 intervals of 95 % one may miss, by a little.
    found = misses(from_mujoco, truth)
    assert len(found) <= 1, found
    assert all(abs(miss) < 1.5 for miss in found.values()), found
    for name in ("kt", "kd"):
        assert from_mujoco.parameter(name).value == pytest.approx(truth[name], rel=0.03)
    for name in ("Ixx_com", "Iyy_com", "Izz_com"):
        assert from_mujoco.derived_value(name).value == pytest.approx(truth[name], rel=0.03)


def test_another_vehicle_would_stand_out(from_mujoco):
    wrong = about_com(1.2 * INERTIA_COM)
    assert {"Ixx_com", "Iyy_com", "Izz_com"} <= misses(from_mujoco, wrong).keys()


def test_what_came_back_is_exported_as_the_same_vehicle(from_mujoco):
    again = text_of(from_mujoco, "mujoco", assumed={"motor_lag": LAG, "max_speed": 1100.0})
    mass = next(line for line in again.splitlines() if "<inertial" in line)
    assert f'mass="{MASS:g}"' in mass


@pytest.mark.slow
def test_a_flight_of_rotorpys_dictionary_gives_its_numbers_back(tmp_path):
    pytest.importorskip("rotorpy.vehicles.multirotor", reason="rotorpy is not installed")
    from_com = placed(vehicle(), imu=(0.0, 0.0, 0.0), shift=-COM)
    truth = replace(truth_of(MASS, np.zeros(3), INERTIA_COM), kt=KT)
    rows = in_rotorpy(tmp_path, flat(), truth, from_com, seconds=40.0, seed=5)
    write_log(tmp_path / "flight.csv", rows, seed=6)
    result = identified(tmp_path, from_com, MASS)
    truth_values = {
        "kt": KT,
        "com_x": 0.0,
        "com_y": 0.0,
        "com_z": 0.0,
        "kd_over_Izz": KD / float(INERTIA_COM[2, 2]),
        **about_com(INERTIA_COM),
    }
    found = misses(result, truth_values)
    assert len(found) <= 1, found
    assert all(abs(miss) < 1.5 for miss in found.values()), found
