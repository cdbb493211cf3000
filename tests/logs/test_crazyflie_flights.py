"""Real micro-SD logs: the numbers that their makers and their own signals give."""

import numpy as np
import pytest

from rotorfit.flight.motors.motor_model import first_order_lag
from rotorfit.logs import read_log

pytestmark = pytest.mark.flights

CONTROLLER = {
    # file: records
    "normal_flight__E8_log00": 2606,
    "normal_flight__E9_log00": 2596,
    "normal_flight__E9_log01": 2591,
    "add_weight_W1_near_M3__E9_log00": 2598,
    "add_weight_W1_near_M3__E9_log01": 2596,
    "add_weight_W1_near_M4__E8_log00": 2600,
}
MOTOR = {
    "normal_flight__E8_log00": 2604,
    "normal_flight__E9_log00": 2593,
    "normal_flight__E9_log01": 2591,
    "add_weight_W1_near_M3__E9_log04": 2595,
    "add_weight_W1_near_M4__E8_log00": 2601,
}
PLACES = np.array([[1, -1], [-1, -1], [-1, 1], [1, 1]])
"""Of m1 to m4: front right, rear right, rear left, front left, in arms."""


def test_the_excitation_flight_of_arplab(flight_data_dir):
    log = read_log(flight_data_dir / "arplab-crazyflie" / "log15")
    assert (log.format, log.notes, log.warnings) == ("crazyflie", (), ())
    assert list(log.channels) == ["gyro", "accel", "command"]
    gyro, accel, command = log.channels.values()
    assert log.seconds == pytest.approx(62.188119)
    assert gyro.time[[0, -1]] == pytest.approx([39.244913, 101.433032])
    steps = np.diff(gyro.time)
    assert 1 / np.median(steps) == pytest.approx(1011, abs=1)
    assert 0.006 < steps.max() <= 0.0071
    assert len(gyro.time) == 62774
    assert accel.values[:1000].mean(axis=0) == pytest.approx([-0.18, -0.16, 9.82], abs=0.06)
    assert np.abs(gyro.values[:1000]).max() < 0.02
    assert not command.values[:1000].any()
    assert command.values.max() == pytest.approx(59589 / 65535)


def test_the_motors_of_arplab_turn_the_vehicle_as_flu_axes_say(flight_data_dir):
    channels = read_log(flight_data_dir / "arplab-crazyflie" / "log15").channels
    time, gyro = channels["gyro"].time, channels["gyro"].values
    rate = 1 / np.median(np.diff(time))
    thrust = first_order_lag(channels["command"].values ** 2, rate, 0.08)
    smooth = np.stack([np.convolve(w, np.ones(20) / 20, "same") for w in gyro.T], axis=1)
    flying = (time > 55) & (time < 90)
    spin = np.array([1, -1, 1, -1])  # counter-clockwise positive; the air's torque opposes it
    for axis, torque in enumerate([PLACES[:, 1], -PLACES[:, 0], -spin]):
        turn = np.gradient(smooth[:, axis])[flying]
        correlation = np.corrcoef((thrust @ torque)[flying], turn)[0, 1]
        assert correlation > (0.3 if axis == 2 else 0.9)


@pytest.mark.parametrize("name", CONTROLLER)
def test_controller_logs_of_crazypad(flight_data_dir, name, assert_wording):
    log = read_log(flight_data_dir / "crazypad" / f"controller_data__{name}")
    assert (log.format, log.warnings) == ("crazyflie", ())
    assert list(log.channels) == ["gyro", "command", "position", "reference"]
    assert len(log.channels["gyro"].time) == CONTROLLER[name]
    assert log.seconds == pytest.approx(25.73, abs=0.04)
    assert_wording(log.notes)
    # The rates answer the mixed commands some samples later, each about its own axis.
    command, gyro = log.channels["command"].values, log.channels["gyro"].values
    flying = command.mean(axis=1) > 0.3
    flying[:300] = False
    late = np.roll(first_order_lag(command**2, 101.0, 0.03), 1, axis=0)
    for axis, torque in enumerate([PLACES[:, 1], -PLACES[:, 0]]):
        turn = np.gradient(gyro[:, axis])[flying]
        assert np.corrcoef((late @ torque)[flying], turn)[0, 1] > 0.3
    # And the rates that were asked for; those of yaw jump where its angle does.
    smooth = np.ones(20) / 20
    asked = np.clip(log.channels["reference"].values, -1.0, 1.0)
    for axis, (steps, least) in enumerate(((3, 0.5), (5, 0.5), (20, 0.2))):
        follows = [np.convolve(x[:, axis], smooth, "same") for x in (asked, gyro)]
        later = flying & np.roll(flying, -steps)
        at = np.corrcoef(follows[0][later], np.roll(follows[1], -steps)[later])[0, 1]
        assert at > least, axis


@pytest.mark.parametrize("name", MOTOR)
def test_motor_logs_of_crazypad(flight_data_dir, name):
    log = read_log(flight_data_dir / "crazypad" / f"motor_data__{name}")
    assert log.warnings == ()
    assert list(log.channels) == ["command", "battery", "position"]
    assert len(log.channels["command"].time) == MOTOR[name]
    battery = log.channels["battery"].values
    assert battery.min() > 3.0 and battery.max() < 4.2
    assert any(note.startswith("No gyro") for note in log.notes)
    assert 0.35 < log.channels["command"].values.mean() < 0.5


def centre_of_thrust(flight_data_dir, file):
    """Mean place of the thrust in hover, forward and left, in arms."""
    command = read_log(flight_data_dir / "crazypad" / file).channels["command"].values
    flying = command.mean(axis=1) > 0.3
    thrust = (command[flying] ** 2).mean(axis=0)
    return thrust @ PLACES / thrust.sum()


def test_the_thrust_moves_to_where_the_weight_hangs(flight_data_dir):
    """Mixed and recorded motor commands agree on it: the mixer is the right one."""
    for kind, log in (("controller", "log00"), ("motor", "log04")):
        plain = centre_of_thrust(flight_data_dir, f"{kind}_data__normal_flight__E9_log00")
        loaded = centre_of_thrust(flight_data_dir, f"{kind}_data__add_weight_W1_near_M3__E9_{log}")
        rear, left = (loaded - plain) * [-1, 1]
        assert rear > 0.003 and left > 0.005
        plain = centre_of_thrust(flight_data_dir, f"{kind}_data__normal_flight__E8_log00")
        loaded = centre_of_thrust(flight_data_dir, f"{kind}_data__add_weight_W1_near_M4__E8_log00")
        front, left = loaded - plain
        assert front > 0.01 and left > 0.02
