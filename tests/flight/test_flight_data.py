"""What a flight keeps of its motion, for the many timings of its motors that are tried."""

import dataclasses

import numpy as np

from rotorfit.flight.flight_data import FlightData, Segment


def made_flight():
    n = 8
    return FlightData(
        sample_rate=100.0,
        time=np.arange(n) / 100.0,
        specific_force=np.zeros((n, 3)),
        angular_velocity=np.zeros((n, 3)),
        angular_acceleration=np.zeros((n, 3)),
        rotor_speed=np.ones((n, 4)),
        rotor_acceleration=np.zeros((n, 4)),
        differentiation="exact",
        segments=(Segment(start=0, stop=n),),
    )


def test_what_motion_makes_is_made_once_for_all_rotor_speeds():
    flight, made = made_flight(), []
    for one in (flight, dataclasses.replace(flight, rotor_speed=2.0 * flight.rotor_speed)):
        one.of_motion("turn", (one.angular_velocity,), lambda: made.append("turn") or len(made))
    assert made == ["turn"]
    assert flight.of_motion("turn", (flight.angular_velocity,), lambda: -1) == 1


def test_another_motion_is_not_taken_for_the_one_before():
    flight = made_flight()
    turned = dataclasses.replace(flight, angular_velocity=flight.angular_velocity + 1.0)
    for one, expected in ((flight, 0.0), (turned, 24.0), (flight, 0.0)):
        made_of = (one.angular_velocity,)
        assert one.of_motion("sum", made_of, made_of[0].sum) == expected
