"""Flights of one sound vehicle, none of which may be said to have a late sensor or a torque."""

import pytest
from benchmarks.real_flights import cases, outcome

NAMES = ("cinerat 269", "cinerat 275", "cinerat 277", "cinerat 341")
"""Of which other flights of the vehicle refute what was said of them."""


@pytest.mark.flights
@pytest.mark.parametrize("name", NAMES)
def test_no_sensor_is_late_and_no_torque_steady(flight_data_dir, name):
    [case] = [case for case in cases(flight_data_dir) if case.name == name]
    found = outcome(case)
    assert found.numbers
    assert not [
        words
        for words in found.sentences
        if "follows the rotors" in words or "steady yaw torque" in words
    ]
