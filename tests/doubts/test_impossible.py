"""What cannot be is said: a vehicle lighter than air, motors before their command, idle flight."""

from dataclasses import replace

import pytest

import flown
from rotorfit.doubts.body_size import too_light
from rotorfit.doubts.early_motors import early_said
from rotorfit.doubts.ground_contact import ground_contact
from rotorfit.flight.data import Segment
from rotorfit.simulation import sampled_flight_data


@pytest.mark.parametrize(("mass", "arm"), [(0.027, 0.04), (1.4, 0.25), (25.0, 1.0), (0.4, 0.5)])
def test_an_arm_in_centimetres_makes_a_vehicle_lighter_than_air(mass, arm):
    assert too_light(mass, arm) is None
    words = too_light(mass, 100.0 * arm)
    assert "would be lighter than air" in words
    assert "centimetres given as metres?" in words


def test_motors_do_not_answer_before_their_command():
    assert early_said(0.04, -0.004, 0.0) is None
    assert early_said(0.1, -0.028, 0.02) is None
    words = early_said(0.1, -0.028, 0.002)
    assert "the motors answer 28 ms before the command" in words
    assert "the lag given is longer than the motors'" in words


def test_the_ground_in_a_window_is_found_and_flight_is_not_taken_for_it():
    flight = flown.simulated(
        "quad-x", "real", seed=4, seconds=10.0, ground_seconds=3.0, physics_rate=200.0
    )
    data = sampled_flight_data(flight, signals="measured")
    whole = replace(data, segments=(Segment(start=1, stop=len(data.time) - 1),))
    (begin, end), *_ = ground_contact(whole)
    assert begin < 0.1
    assert 2.0 < end < 3.6
    later = int(4.0 * data.sample_rate)
    landing = int(10.0 * data.sample_rate)
    aloft = replace(data, segments=(Segment(start=later, stop=landing),))
    assert ground_contact(aloft) == []
