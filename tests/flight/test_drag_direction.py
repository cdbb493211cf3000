"""Axes of an accelerometer that contradict the direction of the drag."""

from dataclasses import replace

import numpy as np
import pytest

from rotorfit.flight.drag_direction import DragDirection, drag_direction
from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.flight.prepare import prepare
from rotorfit.simulation import Scenario, paper_vehicle, simulate_flight, to_flight_log, variant

DRAG = 0.3
"""Over the mass [1/s]."""


@pytest.fixture(scope="module")
def log():
    return log_with_drag(DRAG)


def log_with_drag(drag):
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "noisy")
    truth = replace(truth, drag=(drag * truth.mass,) * 3)
    scenario = Scenario(seconds=30.0, ground_seconds=2.0, sensors=sensors, physics_rate=200.0)
    return to_flight_log(simulate_flight(truth, vehicle, scenario, seed=5))


def with_axes(log, matrix):
    own = log.channels["accel"]
    turned = replace(own, values=own.values @ np.array(matrix, dtype=float).T)
    return replace(log, channels={**log.channels, "accel": turned})


def prepared(log):
    return prepare(log, rotor_count=4, arm=0.25, motors=MotorModel(speed="measured"))


def said(log):
    return [one for one in prepared(log).findings if one.kind == "accelerometer-axes"]


def test_drag_against_the_velocity_is_found_and_not_said(log):
    found = drag_direction(prepared(log).data)
    assert found.along.real == pytest.approx(DRAG, abs=3.0 * found.std)
    assert abs(found.mirrored) < 3.0 * found.std
    assert said(log) == []


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ([[-1, 0, 0], [0, -1, 0], [0, 0, 1]], "both reversed"),
        ([[0, 1, 0], [1, 0, 0], [0, 0, 1]], "swapped"),
        ([[-1, 0, 0], [0, 1, 0], [0, 0, 1]], "mirrored (one of them reversed)"),
        ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], "turned by 90 degrees"),
    ],
)
def test_axes_that_are_not_those_of_the_gyro_are_said(log, matrix, words):
    [found] = said(with_axes(log, matrix))
    assert found.severity == "doubt"
    assert f"accelerometer are {words} against the gyro's" in found.sentence


def test_a_flight_without_drag_tells_nothing():
    still = log_with_drag(0.0)
    assert said(with_axes(still, np.diag([-1, -1, 1]))) == []


def test_a_direction_that_is_not_sure_or_not_pure_is_not_said():
    assert DragDirection(-0.3 + 0j, 0.05j, 0.03).wrong_axes == "both reversed"
    assert DragDirection(-0.3 + 0j, 0.05j, 0.06).wrong_axes is None
    assert DragDirection(-0.3 + 0j, 0.2j, 0.03).wrong_axes is None
    assert DragDirection(0.3 + 0j, -0.1 + 0j, 0.001).wrong_axes is None
