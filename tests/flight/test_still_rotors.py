"""A motor channel that stands still while the others move."""

import numpy as np
import pytest

from hand_made_logs import HOVER, channel, hover_thrust, motion_log, with_channel
from rotorfit.errors import FlightError
from rotorfit.flight.flight_checks import frozen_channels
from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.flight.prepare import prepare

COMMANDED = MotorModel(speed="commanded")


def changed(log, change, *, name="rotor_speed", resolution=None):
    """The log with another motor channel."""
    motors = log.channels[name]
    values = motors.values.copy()
    change(motors.time - motors.time[0], values)
    return with_channel(log, **{name: channel(motors.time, values, resolution=resolution)})


def prepared(log, **options):
    count = next(iter({"rotor_speed", "command"} & set(log.channels)))
    rotors = log.channels[count].values.shape[1]
    return prepare(log, rotor_count=rotors, arm=0.2, **options)


def refusal(log, **options):
    with pytest.raises(FlightError) as refused:
        prepared(log, **options)
    return str(refused.value)


def stuck(rotor, value, *, start=0.0, end=np.inf):
    def change(time, values):
        values[(time >= start) & (time < end), rotor - 1] = value

    return change


@pytest.mark.parametrize("rotors", [4, 6, 8])
@pytest.mark.parametrize("value", [HOVER, 0.0])
def test_a_speed_that_never_changes_is_refused(rotors, value, assert_text):
    log = motion_log(hover_thrust(20), rotors=rotors)
    words = refusal(changed(log, stuck(3, value)))
    assert_text(words)


def test_noise_about_a_constant_is_refused(assert_wording):
    def change(time, values):
        values[:, 1] = 0.05 * np.abs(np.random.default_rng(1).normal(size=len(time)))

    words = refusal(changed(motion_log(hover_thrust(20)), change))
    assert "rotor 2 stays" in words
    assert "at 0.03" in words
    assert_wording(words)


@pytest.mark.parametrize(("end", "refused"), [(8.0, False), (12.0, True)])
def test_a_part_of_the_flight_is_said_or_refused(end, refused, assert_wording):
    log = changed(motion_log(hover_thrust(20)), stuck(1, 380.0, start=5.0, end=end))
    words = refusal(log) if refused else prepared(log).warnings[-1]
    share = round(100 * (end - 5.0) / 20.0)
    assert "rotor 1 stays" in words
    assert "at 380 rad/s" in words
    assert f"for {share} %" in words
    assert_wording(words)
    assert f"from 5.0 to {end:.1f}" in words
    left_out = prepared(log, window=(end, None))
    assert not any("stays at" in doubt for doubt in left_out.warnings)


def test_a_command_at_its_end_is_no_fault():
    """A motor at full or idle throttle stays there, and others come to the same ends."""
    log = motion_log(hover_thrust(20), name="command")
    low, high = log.channels["command"].values.min(), log.channels["command"].values.max()

    def clipped(time, values):
        values[:] = np.clip(values, low, high)
        values[(time > 4) & (time < 9), 0] = high
        values[(time > 12) & (time < 17), 2] = low

    sound = prepared(changed(log, clipped, name="command"), motors=COMMANDED)
    assert not any("stays at" in doubt for doubt in sound.warnings)


@pytest.mark.parametrize("value", [0.0, 0.4])
def test_a_command_that_never_changes_is_refused(value, assert_wording):
    log = motion_log(hover_thrust(20), name="command")
    words = refusal(changed(log, stuck(4, value), name="command"), motors=COMMANDED)
    assert "rotor 4 stays" in words
    assert f"at {value:g} for 100" in words
    assert_wording(words)


@pytest.mark.parametrize("resolution", [1.0, 10.0])
def test_a_calm_hover_in_coarse_steps_is_no_fault(resolution):
    """Of speeds that stay within a step or two, one may stay the same by chance."""
    rng = np.random.default_rng(2)
    values = 400.0 + resolution * np.round(0.4 * rng.normal(size=(4000, 4)))
    values[1000:1600, 0] = 400.0
    found = frozen_channels(values, [(0, 4000)], 200.0, may_rest=False, step=resolution)
    assert found == ()
    (said,) = frozen_channels(values, [(0, 4000)], 200.0, may_rest=False)
    assert said.rotor == 1
    assert said.rows == pytest.approx((1000, 1600), abs=10)


def test_rotors_that_all_stand_still_show_nothing():
    values = np.full((4000, 4), 400.0)
    assert frozen_channels(values, [(0, 4000)], 200.0, may_rest=False) == ()
