"""Standing in a window that the user gives: found, cut, said; and nothing else taken for it."""

from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.errors import FlightError
from rotorfit.flight.airborne import GRAVITY, Motion, aloft, ground_contact
from rotorfit.flight.prepare import prepare
from rotorfit.logs import read_log
from rotorfit.simulation import write_flight_table

RATE = 100.0


def motion(*, thrust=1.0, still=1.0, carried=1.0, turning=0.0, noise=0.0):
    """Return 20 s: the first 8 s with so much thrust, rates, force and turning; then a flight.

    The rates change every tenth of a second, but for the gyro's noise.
    """
    rng = np.random.default_rng(0)
    rates = 0.5 * rng.normal(size=(2000, 3))
    rates[:800] = turning + 0.02 * still * np.repeat(rng.normal(size=(80, 3)), 10, axis=0)
    rates[:800] += noise * rng.normal(size=(800, 3))
    force = np.tile([0.0, 0.0, GRAVITY], (2000, 1))
    force[:800] *= carried
    speed = np.full((2000, 4), 500.0)
    speed[:800] *= np.sqrt(thrust)
    return Motion(
        sample_rate=RATE,
        specific_force=force,
        angular_velocity=rates,
        rotor_speed=speed,
        arm=0.2,
        stretches=((0, 2000),),
    )


WHOLE = [(0, 2000)]


def test_calm_at_little_thrust_and_carried_is_the_ground():
    assert ground_contact(motion(thrust=0.2), WHOLE) == [(0, 800)]


@pytest.mark.parametrize(
    "change",
    [{"thrust": 0.5}, {"still": 5.0}, {"carried": 0.7}, {"carried": 1.3}, {"turning": 0.15}],
    ids=["a glide", "in motion", "falling", "braking", "turning"],
)
def test_flight_at_little_thrust_is_not(change):
    assert ground_contact(motion(**{"thrust": 0.2, **change}), WHOLE) == []


def test_a_gyros_noise_is_no_motion():
    assert ground_contact(motion(thrust=0.2, noise=0.07), WHOLE) == [(0, 800)]


@pytest.mark.parametrize(("thrust", "found"), [(0.2, [(0, 800)]), (0.5, [])])
def test_a_window_of_ground_alone_is_seen_by_the_rest_of_the_log(thrust, found):
    """By what the rotors lift in the rest of the log; idling, they are all the window has."""
    log = motion(thrust=thrust)
    assert ground_contact(log, [(0, 800)], stretches=log.stretches) == found
    assert ground_contact(replace(log, stretches=((0, 800),)), [(0, 800)]) == []


def test_half_a_second_is_not_enough():
    assert ground_contact(motion(thrust=0.2), [(0, 90), (800, 2000)]) == []


def test_half_a_second_next_to_the_ground_goes_with_it():
    standing = motion(thrust=0.2)
    assert aloft(standing, WHOLE, [(0, 800)]) == [(850, 2000)]
    assert aloft(standing, [(100, 1400), (1500, 2000)], [(600, 800)]) == [
        *((100, 550), (850, 1400)),
        (1500, 2000),
    ]


def test_a_window_without_flight_is_refused():
    with pytest.raises(FlightError, match="stands on the ground between start and end"):
        aloft(motion(thrust=0.2), [(0, 840)], [(0, 800)])


def test_a_window_that_holds_the_ground_is_flight_alone(tmp_path, assert_wording):
    flight = flown.simulated(
        "quad-x", "real", seed=4, seconds=10.0, ground_seconds=3.0, physics_rate=200.0
    )
    write_flight_table(flight, tmp_path / "flight.csv")
    log = read_log(tmp_path / "flight.csv")
    prepared = prepare(log, rotor_count=4, arm=0.25, window=(0.0, 9.0))
    (segment,) = prepared.data.segments
    first = float(prepared.data.time[segment.start] - prepared.data.time[0])
    assert 3.0 < first < 4.1
    (cut,) = [cut for cut in prepared.cuts if cut.reason == "stands on the ground"]
    assert cut.start - prepared.data.time[0] < 0.1
    assert cut.end - prepared.data.time[0] == pytest.approx(first - 0.5, abs=0.1)
    assert any("at 0.0 to" in words for words in prepared.warnings)
    assert_wording(prepared.warnings)
    aloft_alone = prepare(log, rotor_count=4, arm=0.25, window=(4.0, 9.0))
    assert not any("ground" in words for words in aloft_alone.warnings)
