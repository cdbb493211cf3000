"""A centre of mass that moves in flight: either part alone was `identified`, nothing was said."""

import dataclasses

import numpy as np
import pytest

import flown
from rotorfit.checks.motors.changed_thrust import PARTS
from rotorfit.checks.moved_balance import surest_move
from rotorfit.simulation import Scenario, SimulatedVehicle, simulate_flight, variant

KIND = "balance-moves"


def fly_part(seed, moved):
    """Fly 25 s from hover to hover with the centre of mass moved along x [m]."""
    (truth, vehicle), sensors = variant(flown.simulated_vehicle("quad-x"), "disturbed")
    x, y, z = truth.first_moments
    truth = dataclasses.replace(truth, first_moments=(x + moved * truth.mass, y, z))
    scenario = Scenario(seconds=25.0, sensors=sensors)
    return simulate_flight(*SimulatedVehicle(truth, vehicle), scenario, seed=seed)


def identify_with_move(folder, seed, moved):
    """Identify a flight in which the centre of mass moves after half of the time."""
    first, second = fly_part(seed, 0.0), fly_part(seed + 50, moved)
    joined = {
        name: np.concatenate([getattr(first, name), getattr(second, name)])
        for name in ("gyro", "accel", "rotor_speed_measured")
    }
    time = np.arange(len(joined["gyro"])) / first.sample_rate
    table = np.column_stack([time, *joined.values()])
    names = ["time", *(f"{n}_{axis}" for n in ("gyro", "accel") for axis in "xyz")]
    header = ",".join([*names, *(f"rotor_{n}" for n in (1, 2, 3, 4))])
    np.savetxt(folder / "flight.csv", table, delimiter=",", header=header, comments="")
    path = flown.experiment_file(
        folder / "experiment.toml", first.vehicle, ["flight.csv"], mass=first.truth.mass
    )
    return flown.quietly_identified(path)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_battery_that_slips_makes_the_centre_doubtful(tmp_path, seed):
    """By 12 mm: one half's was `identified` to 0.8 mm."""
    result = identify_with_move(tmp_path, seed, 0.012)
    [said] = [one for one in result.findings if one.kind == KIND]
    assert "front" in said.sentence
    assert result.parameter("msx").verdict == "doubtful"
    assert result.parameter("msy").verdict == "identified"


@pytest.mark.parametrize("seed", [1, 2])
def test_a_centre_that_stays_is_not_doubted(tmp_path, seed):
    result = identify_with_move(tmp_path, seed, 0.0)
    assert [one for one in result.findings if one.kind == KIND] == []
    assert result.parameter("msx").verdict == "identified"


@pytest.mark.parametrize("at", [4, 6, 8])
def test_the_moment_and_the_size_are_found(at):
    rng = np.random.default_rng(at)
    place = 2e-4 * rng.standard_normal(PARTS) + np.where(np.arange(PARTS) > at, -0.006, 0.0)
    found = surest_move(place)
    assert found.size == pytest.approx(-0.006, abs=5e-4)
    assert found.moment == pytest.approx((at + 1) / PARTS, abs=0.6 / PARTS)


def test_scatter_and_a_steady_drift_are_no_move():
    for seed in range(200):
        place = np.random.default_rng(seed).standard_normal(PARTS)
        assert surest_move(place) is None
    assert surest_move(np.linspace(0.0, 1.0, PARTS)) is None
