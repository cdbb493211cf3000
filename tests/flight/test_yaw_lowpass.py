"""A yaw gyro that alone is behind a low-pass is told by the noise of its axes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.flight.prepare import prepare
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, to_flight_log, variant


@pytest.fixture(scope="module")
def log():
    flown, sensors = variant(paper_vehicle("A"), "real")
    scenario = Scenario(seconds=12.0, ground_seconds=2.0, sensors=sensors)
    return to_flight_log(simulate_flight(*flown, scenario, seed=5))


def filtered(log, cutoff, *, axes=(2,), order=2):
    own = log.channels["gyro"]
    rate = 1.0 / float(np.median(np.diff(own.time)))
    b, a = signal.butter(order, cutoff, fs=rate)
    values = own.values.copy()
    values[:, axes] = signal.lfilter(b, a, values[:, axes], axis=0)
    return replace(log, channels={**log.channels, "gyro": replace(own, values=values)})


def said(log):
    found = prepare(log, rotor_count=4, arm=0.25, motors=MotorModel(speed="measured")).findings
    return [one for one in found if one.kind == "yaw-lowpass"]


@pytest.mark.parametrize("cutoff", [10.0, 20.0])
def test_a_low_pass_of_yaw_alone_is_said_with_its_frequency(log, cutoff):
    [found] = said(filtered(log, cutoff))
    assert found.severity == "doubt"
    assert found.evidence[0].value == pytest.approx(cutoff, rel=0.4)


def test_sound_axes_and_axes_of_one_filter_are_not_said(log):
    assert said(log) == []
    assert said(filtered(log, 12.0, axes=(0, 1, 2))) == []
    assert said(filtered(log, 12.0, axes=(0, 1))) == []
