"""What a wrong scale of one rotor's speed leaves open: how likely it is, and what it moves."""

from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.fit.rotor_scales import posterior_half_widths, weigh_scales

KNOWN = np.eye(4) * 0.003**2


def odds(*differences, known=KNOWN, speeds=None):
    off = np.array(differences) - np.mean(differences)
    return weigh_scales(off, known, None if speeds is None else np.array(speeds))


def numbers_of(result):
    return {one.name: one for one in (*result.parameters, *result.derived)}


def wrong(found):
    return 1.0 - found.chance_of(-1)


def test_rotors_that_differ_as_propellers_do_have_no_wrong_scale():
    assert wrong(odds(0.0, 0.0, 0.0, 0.0)) < 0.01
    assert wrong(odds(0.02, -0.03, 0.01, 0.0)) < 0.05
    assert wrong(odds(0.05, -0.06, 0.04, -0.03)) < 0.05


@pytest.mark.parametrize("excess", [-0.1, 0.1])
def test_one_rotor_unlike_three_equal_ones_leaves_k_t_open(excess):
    found = odds(0.0, excess, 0.001, -0.001)
    assert wrong(found) > 0.3
    assert found.chance_of(1) == pytest.approx(wrong(found), abs=0.03)
    assert found.excess_of(1) == pytest.approx(excess, rel=0.15)
    # k_t is the mean of four.
    half = posterior_half_widths(found, np.full((4, 1), 0.25))
    assert half[0] == pytest.approx(0.25 * abs(excess), rel=0.3)


def test_speed_at_the_same_command_tells_scale_from_propeller():
    unlike = 0.01, -0.1, 0.01, -0.01
    by_thrust = wrong(odds(*unlike))
    alike, faster = (wrong(odds(*unlike, speeds=(0.0, own, 0.0, 0.0))) for own in (0.0, 0.05))
    assert alike < 0.5 * by_thrust
    assert faster > 2.0 * by_thrust > 0.1


def test_what_the_prior_alone_says_of_the_rotors_is_not_weighed():
    assert odds(0.0, -0.1, 0.0, 0.0, known=np.eye(4) * 0.035**2) is None
    # What a prior of .04 has drawn in is taken as it was flown.
    shrunk = odds(0.0, -0.1, 0.0, 0.0, known=np.eye(4) * 0.02**2)
    assert shrunk.excess_of(1) < -0.08


def test_the_half_width_grows_with_the_excess_without_a_jump():
    far = [odds(0.0, -excess, 0.0, 0.0) for excess in np.linspace(0.0, 0.2, 41)]
    half = np.array([posterior_half_widths(one, np.full((4, 1), 0.25))[0] for one in far])
    assert half[0] == 0.0
    assert half[-1] == pytest.approx(0.05, rel=0.2)
    assert np.diff(half).max() < 0.015


def test_a_speed_5_percent_off_is_covered_where_rotors_are_alike(tmp_path):
    flight = flown.simulated("quad-x", "noisy", seed=5, seconds=25.0)
    sound = numbers_of(flown.identified(tmp_path, [flight]))
    speeds = flight.rotor_speed_measured * np.array([1.0, 1.05, 1.0, 1.0])
    spoilt = replace(flight, rotor_speed_measured=speeds)
    found = numbers_of(flown.identified(tmp_path, [spoilt]))
    assert found["kt"].value == pytest.approx(0.977 * sound["kt"].value, rel=0.005)
    for name in ("kt", "kt_2", "kt_3", "kd_over_Izz", "hover_speed", "twist"):
        low, high = found[name].interval
        assert low < sound[name].value < high
