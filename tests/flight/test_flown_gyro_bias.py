"""A gyro's bias in a flight without rest: by the attitude, or by gravity."""

from dataclasses import replace

import numpy as np
import pytest

from hand_made_logs import channel, hover_thrust, motion_log, prepared, with_channel
from rotorfit.flight.kinematics import running_product, small_turns

RATE = 200.0
BIAS = (0.2, -0.1, 0.15)


def without_rest(bias, *, attitude=False, seconds=20.0):
    """Return a flight that begins in the air, with a bias on its gyro."""
    log = motion_log(hover_thrust(seconds), rate=RATE)
    gyro = log.channels["gyro"]
    if attitude:
        turned = running_product(small_turns(gyro.values / RATE))
        log = with_channel(
            log,
            attitude=channel(gyro.time, turned),
            velocity=channel(gyro.time, np.zeros((len(turned), 3))),
        )
    return with_channel(log, gyro=replace(gyro, values=gyro.values + np.array(bias)))


@pytest.mark.parametrize(("attitude", "axes"), [(True, 3), (False, 2)])
def test_a_bias_in_flight_is_taken_off_and_said(attitude, axes):
    """Gravity does not show a turn about the vertical."""
    found = prepared(without_rest(BIAS, attitude=attitude))
    assert found.gyro_bias is not None
    np.testing.assert_allclose(found.gyro_bias[:axes], BIAS[:axes], atol=0.01)
    turns = found.data.angular_velocity[:, :axes].mean(axis=0)
    np.testing.assert_allclose(turns, 0.0, atol=0.02)
    [said] = [one for one in found.findings if one.kind == "gyro-bias"]
    assert "0.20, -0.10" in said.sentence
    assert said.evidence[0].value == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("attitude", [True, False])
def test_a_small_bias_stays_and_nothing_is_said_of_it(attitude):
    found = prepared(without_rest((0.02, -0.01, 0.02), attitude=attitude))
    assert found.gyro_bias is None
    [said] = [one for one in found.findings if one.kind == "gyro-bias"]
    assert "not removed" in said.sentence


def test_a_slow_yaw_is_no_bias():
    """The vehicle turns at 0.5 rad/s all the time, and its attitude, too."""
    log = without_rest((0.0, 0.0, 0.0))
    gyro = log.channels["gyro"]
    yawing = replace(gyro, values=gyro.values + np.array([0.0, 0.0, 0.5]))
    assert prepared(with_channel(log, gyro=yawing)).gyro_bias is None
    turned = channel(gyro.time, running_product(small_turns(yawing.values / RATE)))
    still = channel(gyro.time, np.zeros((len(gyro.time), 3)))
    logged = with_channel(log, gyro=yawing, attitude=turned, velocity=still)
    assert prepared(logged).gyro_bias is None


def test_an_attitude_of_other_axes_is_no_reference():
    """It contradicts the gyro all the time, and gravity has the last word."""
    log = without_rest(BIAS, attitude=True)
    attitude = log.channels["attitude"]
    other = replace(attitude, values=attitude.values[:, [0, 3, 1, 2]] * [1.0, 5.0, -5.0, 5.0])
    found = prepared(with_channel(log, attitude=other))
    assert found.gyro_bias is not None
    np.testing.assert_allclose(found.gyro_bias[:2], BIAS[:2], atol=0.01)
