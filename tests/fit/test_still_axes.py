"""An axis of the accelerometer that repeats one value: no errors there, and no exact knowledge."""

from dataclasses import replace

import numpy as np
from benchmarks.common import scales, true_values
from hypothesis import given
from hypothesis import strategies as st

import flown
import made_fit
from rotorfit.fit.reduction.still_axes import still_axes
from rotorfit.flight.flight_data import Segment
from rotorfit.simulation.experiment_files import flight_table
from rotorfit.simulation.pilot import STILL, Stick
from rotorfit.simulation.sensors import Sensors

PHASES = (Segment(start=0, stop=800), Segment(start=900, stop=1700))
BRISK = Stick(band=(0.3, 2.0), rms=0.25)


@given(seed=st.integers(0, 2**32 - 1), axis=st.integers(0, 2), noise=st.floats(0.01, 1.0))
def test_axis_that_stands_on_a_step_is_still(seed, axis, noise):
    rng = np.random.default_rng(seed)
    force = rng.normal(0.0, 3.0, (2000, 3))
    force[:800] = rng.normal(0.0, noise, (800, 3))
    force[:800, axis] = -0.15 + 1e-4 * rng.standard_normal(800)
    found = still_axes(made_fit.prepared(force=force, segments=PHASES))
    expected = np.zeros((2, 3), dtype=bool)
    expected[0, axis] = True
    np.testing.assert_array_equal(found, expected)


def one_axis_after_the_other(folder):
    """Write a log of rolls, then pitches, whose accelerometer has coarser steps than noise."""
    sensors = Sensors(
        accel_std=0.003, accel_resolution=0.15, accel_bias=(0.05, -0.06, 0.0), gyro_std=0.002
    )
    rolls, pitches = (
        flown.simulated("quad-x", seed=5, seconds=20.0, sensors=sensors, sticks=sticks)
        for sticks in (replace(STILL, roll=BRISK), replace(STILL, pitch=BRISK))
    )
    names, *rows = flight_table(rolls).splitlines()
    begin = float(rolls.time[-1]) + 0.5 - float(pitches.time[0])
    for row in flight_table(pitches).splitlines()[1:]:
        time, _, rest = row.partition(",")
        rows.append(f"{float(time) + begin:.9g},{rest}")
    (folder / "flight.csv").write_text("\n".join([names, *rows]) + "\n", encoding="utf-8")
    return rolls


def test_single_rotors_and_balance_hold_beside_a_still_axis(tmp_path):
    flight = one_axis_after_the_other(tmp_path)
    path = flown.experiment_file(
        tmp_path / "experiment.toml",
        flight.vehicle,
        [tmp_path / "flight.csv"],
        mass=flight.truth.mass,
    )
    result = flown.quietly_identified(path)
    numbers = {one.name.partition("@")[0]: one for one in (*result.parameters, *result.derived)}
    true = true_values(flight)
    for name in ("kt", "kt_1", "kt_2", "kt_3", "kt_4", "com_x", "com_y", "Ixx_com", "Iyy_com"):
        low, high = numbers[name].interval
        assert low < true[name] < high, name
        assert high - low < 0.1 * scales(flight)[name], name
    for axis, bias in zip("xy", flight.sensors.accel_bias, strict=False):
        low, high = numbers[f"accel_bias_{axis}"].interval
        assert low < bias < high
