"""Manoeuvres: what the sticks do, and that they can be flown in a hall."""

from dataclasses import replace

import numpy as np
import pytest

from rotorfit.errors import ExperimentError
from rotorfit.simulation import STILL, Scenario, Stick, paper_vehicle, simulate_flight
from rotorfit.simulation.pilot import MANOEUVRES, Course, follow_course, movement

RATE = 100.0


def moved(stick, seconds=30.0, seed=0):
    n = round(seconds * RATE)
    return movement(stick, samples=n, sample_rate=RATE, rng=np.random.default_rng(seed))


@pytest.mark.parametrize("shape", ["noise", "turns", "doublets"])
def test_every_shape_has_the_size_asked_for(shape):
    stick = Stick(band=(0.2, 1.0), rms=0.7, shape=shape)
    assert np.sqrt(np.mean(moved(stick) ** 2)) == pytest.approx(0.7)


def test_turns_go_to_each_side_for_half_a_period_and_come_back():
    turn = moved(Stick(band=(0.1, 0.6), rms=1.2, shape="turns"))
    steady = turn[np.abs(turn) > 0.95 * np.abs(turn).max()]
    assert (steady > 0).mean() == pytest.approx(0.5, abs=0.05)
    assert 1.2 < np.abs(turn).max() < 1.35
    changes = np.flatnonzero(np.diff(turn[100:-100] > 0))
    np.testing.assert_allclose(np.diff(changes) / RATE, 5.0, atol=0.05)
    assert abs(turn.sum() / RATE) < 0.5  # the heading ends where it began [rad]


def test_doublets_kick_out_and_back_and_rest():
    kick = moved(Stick(band=(0.25, 1.0), rms=0.2, shape="doublets"), seconds=40.0)
    assert abs(kick.mean()) < 1e-2 * kick.max()
    assert (kick == 0.0).mean() == pytest.approx(0.75, abs=0.03)
    assert -kick.min() == pytest.approx(kick.max(), rel=0.02)


def test_a_flight_too_short_for_a_kick_is_refused():
    stick = Stick(band=(0.001, 10.0), rms=0.2, shape="doublets")
    with pytest.raises(ExperimentError, match="too short for a stick"):
        moved(stick, seconds=1.0)


@pytest.mark.parametrize("name", MANOEUVRES)
def test_every_manoeuvre_stays_in_the_hall(name):
    truth, vehicle = paper_vehicle("A")
    scenario = Scenario(
        seconds=20.0, sticks=MANOEUVRES[name], sample_rate=100.0, physics_rate=100.0
    )
    flight = simulate_flight(replace(truth, Jr=2e-5), vehicle, scenario, seed=1)
    assert np.abs(flight.position[:, :2]).max() < 3.0
    assert np.abs(flight.position[:, 2]).max() < 2.0


def test_a_manoeuvre_of_one_axis_moves_that_axis():
    truth, vehicle = paper_vehicle("A")
    for name, axis in (("roll", 0), ("pitch", 1), ("yaw", 2)):
        assert [getattr(MANOEUVRES[name], s).rms > 0 for s in ("roll", "pitch", "yaw")] == [
            i == axis for i in range(3)
        ]
        scenario = Scenario(
            seconds=15.0, sticks=MANOEUVRES[name], sample_rate=100.0, physics_rate=100.0
        )
        spread = simulate_flight(truth, vehicle, scenario, seed=1).angular_velocity.std(axis=0)
        assert spread[axis] == spread.max()
    assert MANOEUVRES["hover"] == STILL


@pytest.mark.parametrize("route", ["to-and-fro", "circles", "eights"])
def test_a_course_is_consistent_and_begins_and_ends_at_rest(route):
    course = Course(route=route, speed=10.0, size=20.0, lean=0.3)
    rows = follow_course(course, samples=6000, sample_rate=200.0)
    place, velocity, push = rows[:, :2], rows[:, 2:4], rows[:, 4:]
    assert np.abs(place[0]).max() == np.abs(velocity[[0, -1]]).max() == 0.0
    np.testing.assert_allclose(np.gradient(place, 0.005, axis=0)[1:-1], velocity[1:-1], atol=2e-2)
    slope = np.gradient(velocity, 0.005, axis=0)[1:-1]
    np.testing.assert_allclose(push[1:-1] - 0.3 * velocity[1:-1], slope, atol=2e-2)
    speed = np.linalg.norm(velocity, axis=1)
    assert speed.max() == pytest.approx(10.0, rel=1e-3)
    inside = {"to-and-fro": (20.0, 0.0), "circles": (20.0, 40.0), "eights": (20.0, 10.0)}[route]
    np.testing.assert_allclose(np.abs(place).max(axis=0), inside, rtol=1e-3)
