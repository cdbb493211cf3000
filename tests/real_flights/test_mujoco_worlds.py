"""Flights of an independent engine, with their truth."""

import json
import shutil

import pytest

import flown

pytestmark = pytest.mark.flights


def test_drag_of_a_climb_shows_no_centre_of_mass(flight_data_dir, tmp_path):
    """Drag acts at the centre of mass there, which is 3 mm in front of the IMU."""
    folder = flight_data_dir / "mujoco-worlds"
    for name in ("w46.toml", "w46.csv"):
        shutil.copy(folder / name, tmp_path / name)
    truth = json.loads((folder / "w46.truth.json").read_text())
    result = flown.quietly_identified(tmp_path / "w46.toml")
    for name in ("com_x", "com_y"):
        found = result.derived_value(name, "A")
        assert found.interval is None or found.interval[0] < truth[name] < found.interval[1]
