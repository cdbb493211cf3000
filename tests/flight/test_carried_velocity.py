"""What carries the rotors sideways: rare positions, and the accelerometer between them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_made_logs import channel, flight_log
from rotorfit.flight.mocap.carried_velocity import carried_velocity

TIME = 3.0 + np.arange(4000) / 400.0
GRAVITY = np.array([0.0, 0.0, 9.80665])


def motion(time):
    """Return place, velocity and acceleration in the world, and attitude, of one that tumbles."""
    s = time - 3.0
    place = np.stack([2.0 * np.sin(2.0 * s), 1.5 * np.cos(3.0 * s), 0.2 * s**2], axis=1)
    velocity = np.stack([4.0 * np.cos(2.0 * s), -4.5 * np.sin(3.0 * s), 0.4 * s], axis=1)
    pulled = np.stack([-8.0 * np.sin(2.0 * s), -13.5 * np.cos(3.0 * s), 0.4 + 0.0 * s], axis=1)
    turned = Rotation.from_euler("ZYX", np.stack([1.5 * s, np.sin(2.0 * s), 0.8 * s], axis=1))
    return place, velocity, pulled, turned


def log_of(*, bias=0.0, seen_turned=0.0, without=(), keep=None):
    """Return a log with positions at 20 Hz, 5 mm off and up to 5 ms late."""
    rng = np.random.default_rng(1)
    fixes = TIME[::20] if keep is None else TIME[::20][keep(TIME[::20] - 3.0)]
    place = motion(fixes)[0] + 0.005 * rng.normal(size=(len(fixes), 3))
    _, _, pulled, turned = motion(TIME)
    seen = Rotation.from_euler("y", seen_turned) * turned
    channels = {
        "position": channel(fixes + 0.005 * rng.random(len(fixes)), place),
        "attitude": channel(TIME, seen.as_quat(scalar_first=True)),
        "accel": channel(TIME, turned.apply(pulled + GRAVITY, inverse=True) + bias),
    }
    return flight_log(**{k: v for k, v in channels.items() if k not in without})


def errors(found):
    _, velocity, _, turned = motion(found.time)
    return found.values - turned.apply(velocity, inverse=True)


@pytest.mark.parametrize("bias", [0.0, 0.2])
def test_velocity_holds_between_rare_positions_and_over_a_gap(bias):
    """Of 4 m/s, with a biased accelerometer, and none of the cameras' for .4 s."""
    found = carried_velocity(log_of(bias=bias, keep=lambda s: (s < 5.0) | (s > 5.4)))
    assert len(found.time) > 3950
    assert np.sqrt((errors(found) ** 2).mean()) < 0.1


def test_no_velocity_far_from_any_position():
    found = carried_velocity(log_of(keep=lambda s: (s < 4.0) | (s > 7.0)))
    said = found.time - 3.0
    assert not ((said > 4.52) & (said < 6.48)).any()
    assert ((said > 4.0) & (said < 4.4)).any()


@pytest.mark.parametrize("without", ["position", "attitude", "accel"])
def test_none_without_all_three(without):
    assert carried_velocity(log_of(without=(without,))) is None


def test_none_where_attitude_and_force_contradict_positions():
    assert carried_velocity(log_of()) is not None
    assert carried_velocity(log_of(seen_turned=1.0)) is None
