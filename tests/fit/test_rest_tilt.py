"""The accelerometer at rest decides between a turned IMU and a lean of the thrust."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.fit.rest_tilt import angle_between, rest_denies_tilt, rest_sentence, tilts_at_rest
from rotorfit.flight.flight_data import Segment
from rotorfit.flight.imu_tilt import ImuTilt

G = 9.80665


def read(tilt):
    """Return what a level accelerometer reads that is mounted so."""
    return G * tilt.rotation_imu_to_body[2]


def degrees(roll, pitch):
    return ImuTilt(roll=np.radians(roll), pitch=np.radians(pitch))


def flight(before=None, after=None, *, noise=0.05, seconds=3.0):
    """Return a flight of 20 s with a rest before and after, each in the IMU's axes."""
    n, rest = 2000, round(seconds * 100)
    force = np.tile([0.0, 0.0, G], (n, 1))
    speed = np.full((n, 4), 500.0)
    for tilt, rows in ((before, slice(0, rest)), (after, slice(n - rest, n))):
        if tilt is not None:
            force[rows], speed[rows] = read(tilt), 0.0
    force += noise * np.random.default_rng(3).normal(size=force.shape)
    segments = (Segment(start=400, stop=1600),)
    made = made_fit.prepared(force=force, segments=segments).data
    return replace(made, rotor_speed=speed)


def test_both_rests_are_read():
    before, after = tilts_at_rest(flight(degrees(5.0, -12.0), degrees(-3.0, 2.0)))
    assert np.degrees([before.roll, before.pitch]) == pytest.approx([5.0, -12.0], abs=0.2)
    assert np.degrees([after.roll, after.pitch]) == pytest.approx([-3.0, 2.0], abs=0.2)


def test_the_angle_is_between_the_two_axes():
    assert np.degrees(angle_between(degrees(4.0, 0.0), degrees(-3.0, 0.0))) == pytest.approx(7.0)
    assert np.degrees(angle_between(degrees(0.0, 10.0), degrees(0.0, 10.0))) == pytest.approx(0.0)


def test_a_vehicle_on_its_back_or_a_moment_of_rest_says_nothing():
    assert not list(tilts_at_rest(flight(degrees(170.0, 0.0))))
    assert not list(tilts_at_rest(flight(degrees(0.0, 5.0), seconds=0.7)))
    assert not list(tilts_at_rest(flight()))
    assert rest_denies_tilt([flight()], degrees(0.0, -15.0)) is None


@pytest.mark.parametrize(("at_rest", "is_denied"), [(-5.9, True), (1.6, True), (-14.0, False)])
def test_a_lean_of_fast_flight_is_no_mounting(at_rest, is_denied):
    """15.3 degrees nose down in flight, as in a log whose vehicle stands within 6 degrees."""
    flown = degrees(0.0, -15.3)
    found = rest_denies_tilt([flight(degrees(0.0, at_rest))], flown)
    assert (found is not None) is is_denied
    if found is not None:
        assert np.degrees(found.pitch) == pytest.approx(at_rest, abs=0.2)
        assert "15.3 degrees nose down" in rest_sentence(flown, found)


def test_the_rest_that_confirms_a_tilt_counts():
    """Before on a slope, after on the level: one of them is as the mounting says."""
    flown = degrees(0.0, -12.0)
    assert rest_denies_tilt([flight(degrees(0.0, 0.5), degrees(0.0, -11.0))], flown) is None


def test_random_mountings_are_told_from_random_leans():
    """Ground and feet lean a vehicle by 2 degrees rms: of 400 at most one in a hundred is wrong."""
    random, wrong = np.random.default_rng(6), 0
    for turned in (True, False) * 200:
        size, way = np.radians(random.uniform(9.0, 20.0)), random.uniform(-np.pi, np.pi)
        flown = ImuTilt(roll=size * np.sin(way), pitch=size * np.cos(way))
        ground = np.radians(random.normal(0.0, 2.0, 2)) / 2**0.5
        base = flown if turned else ImuTilt()
        stands = ImuTilt(roll=base.roll + ground[0], pitch=base.pitch + ground[1])
        data = flight(stands, seconds=2.0)
        wrong += (rest_denies_tilt([data], flown) is None) is not turned
    assert wrong <= 4
