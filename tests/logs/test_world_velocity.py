"""A velocity along the axes of the world is known by the position, and turned into the body."""

import numpy as np
import pytest
from rosbag_writers import EPOCH, LATE, Sent, write_messages_ros2, xyz

from rotorfit.logs import read_log
from rotorfit.logs.flight_log import Channel
from rotorfit.logs.world_velocity import turn_world_velocity

TIME = np.arange(0.0, 12.0, 0.02)
YAW = 0.4 * TIME


def circle(*, turned=True, noise=0.0):
    """Channels of a vehicle that flies a circle of 5 m, nose ahead: 2 m/s along its own x.

    `turned`: whether the velocity is along the body's axes. `noise`: of the position [m].
    """
    rng = np.random.default_rng(0)
    yaw = YAW[:, None]
    place = 5.0 * np.hstack([np.sin(yaw), 1.0 - np.cos(yaw), 0.0 * yaw])
    world = 2.0 * np.hstack([np.cos(yaw), np.sin(yaw), 0.0 * yaw])
    body = np.tile([2.0, 0.0, 0.0], (len(TIME), 1))
    attitude = np.hstack([np.cos(yaw / 2.0), 0.0 * yaw, 0.0 * yaw, np.sin(yaw / 2.0)])
    values = {
        "position": place + noise * rng.standard_normal(place.shape),
        "attitude": attitude,
        "velocity": body if turned else world,
    }
    return {n: Channel(time=TIME, values=v, source="/odom") for n, v in values.items()}


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_velocity_along_the_world_is_turned(noise, assert_wording):
    channel, words = turn_world_velocity(circle(turned=False, noise=noise))
    np.testing.assert_allclose(channel.values, np.tile([2.0, 0.0, 0.0], (len(TIME), 1)), atol=1e-12)
    assert_wording(words)


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.5])
def test_one_in_the_body_stays(noise):
    assert turn_world_velocity(circle(noise=noise)) is None


def test_a_jump_of_the_estimate_is_no_velocity():
    channels = circle(turned=False)
    channels["position"].values[300:] += 30.0
    assert turn_world_velocity(channels) is not None


@pytest.mark.parametrize("left_out", ["position", "attitude", "velocity"])
def test_without_its_position_nothing_is_known(left_out):
    channels = circle(turned=False)
    del channels[left_out]
    assert turn_world_velocity(channels) is None


def test_a_vehicle_that_does_not_turn_needs_no_turning():
    still = {
        name: Channel(time=TIME, values=np.tile(values, (len(TIME), 1)), source="/odom")
        for name, values in {
            "position": [0.0, 0.0, 1.0],
            "attitude": [1.0, 0.0, 0.0, 0.0],
            "velocity": [0.0, 0.0, 0.0],
        }.items()
    }
    assert turn_world_velocity(still) is None


def odometry(channels):
    for k, time in enumerate(TIME):
        stamp = EPOCH + round(1e9 * time)
        w, x, y, z = channels["attitude"].values[k].tolist()
        pose = {
            "position": xyz(channels["position"].values[k]),
            "orientation": {"w": w, "x": x, "y": y, "z": z},
        }
        twist = {"linear": xyz(channels["velocity"].values[k])}
        fields = {"pose": {"pose": pose}, "twist": {"twist": twist}}
        yield Sent("/odom", "nav_msgs/msg/Odometry", stamp, stamp + LATE, fields)


@pytest.mark.parametrize("turned", [True, False])
def test_a_bag_and_a_table_are_turned(tmp_path, turned):
    """Drag had the wrong sign, and k_t was 1.5 % and two half-widths off, `identified`."""
    channels = circle(turned=turned)
    write_messages_ros2(odometry(channels), tmp_path / "bag")
    names = {
        "position": ("pos_x", "pos_y", "pos_z"),
        "attitude": ("quat_w", "quat_x", "quat_y", "quat_z"),
        "velocity": ("vel_x", "vel_y", "vel_z"),
    }
    header = ",".join(["time", *(one for own in names.values() for one in own)])
    cells = np.column_stack([TIME, *(channels[name].values for name in names)])
    np.savetxt(tmp_path / "a.csv", cells, delimiter=",", header=header, comments="")
    for log in (read_log(tmp_path / "bag"), read_log(tmp_path / "a.csv")):
        values = log.channels["velocity"].values
        np.testing.assert_allclose(values, np.tile([2.0, 0.0, 0.0], (len(values), 1)), atol=1e-9)
        assert sum("axes of the world" in note for note in log.notes) == (not turned)
