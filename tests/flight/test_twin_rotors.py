"""One column of speeds or commands that stands for two rotors."""

import numpy as np
import pytest

from hand_made_logs import channel, hover_thrust, motion_log, with_channel
from rotorfit.errors import FlightError
from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.flight.prepare import prepare


def with_speeds(rotors, twins):
    """Return a log of a hover in which each rotor turns by itself, or as the twin that it has."""
    log = motion_log(hover_thrust(20), rotors=rotors)
    speeds = log.channels["rotor_speed"]
    own = np.random.default_rng(rotors).normal(0.0, 5.0, speeds.values.shape)
    values = speeds.values + own * (speeds.values > 0.0)
    for rotor, twin in twins:
        values[:, rotor - 1] = values[:, twin - 1]
    return with_channel(log, rotor_speed=channel(speeds.time, values))


@pytest.mark.parametrize("rotors", [4, 6, 8])
def test_a_speed_of_two_rotors_is_refused(rotors, assert_text):
    with pytest.raises(FlightError) as refused:
        prepare(with_speeds(rotors, [(4, 1)]), rotor_count=rotors, arm=0.2)
    assert_text(str(refused.value))


@pytest.mark.parametrize("rotors", [4, 6])
def test_a_command_of_two_rotors_is_refused(rotors, assert_text):
    log = motion_log(hover_thrust(20), rotors=rotors, name="command")
    command = log.channels["command"]
    values = command.values[:, [0, 1, 1, *range(3, rotors)]]
    motors = MotorModel(speed="commanded")
    prepare(log, rotor_count=rotors, arm=0.2, motors=motors)
    with pytest.raises(FlightError) as refused:
        twins = with_channel(log, command=channel(command.time, values))
        prepare(twins, rotor_count=rotors, arm=0.2, motors=motors)
    assert_text(str(refused.value))


def test_coaxial_pairs_may_turn_alike():
    """As in a simulator without noise; and each by itself, of course."""
    for twins in ([(i, i - 4) for i in (5, 6, 7, 8)], []):
        assert prepare(with_speeds(8, twins), rotor_count=8, arm=0.2).data.rotor_speed.shape[1] == 8
