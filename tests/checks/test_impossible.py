"""What cannot be is said: a vehicle lighter than air, motors before their command, idle flight."""

import pytest

from rotorfit.checks.sensors.clocks import early_sentence
from rotorfit.checks.vehicle_size import too_light


@pytest.mark.parametrize(("mass", "arm"), [(0.027, 0.04), (1.4, 0.25), (25.0, 1.0), (0.4, 0.5)])
def test_an_arm_in_centimetres_makes_a_vehicle_lighter_than_air(mass, arm):
    assert too_light(mass, arm) is None
    words = too_light(mass, 100.0 * arm)
    assert "would be lighter than air" in words
    assert "centimetres given as metres?" in words


def test_motors_do_not_move_before_their_command(assert_wording):
    assert early_sentence(0.04, -0.004, 0.0) is None
    assert early_sentence(0.1, -0.028, 0.02) is None
    words = early_sentence(0.1, -0.028, 0.002)
    assert "respond 28 ms" in words
    assert_wording(words)
