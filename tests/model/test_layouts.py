"""Named layouts: where the autopilots' own tables put each motor, and what any layout obeys."""

import numpy as np
import pytest

from rotorfit.errors import ExperimentError
from rotorfit.model.vehicle import LAYOUTS, Vehicle, layout_rotors

RIGHT, LEFT, FRONT, REAR = "right", "left", "front", "rear"
KNOWN = {
    ("quad-x", "px4"): "front right ccw, rear left ccw, front left cw, rear right cw",
    ("quad-x", "ardupilot"): "front right ccw, rear left ccw, front left cw, rear right cw",
    ("quad-x", "betaflight"): "rear right cw, front right ccw, rear left ccw, front left cw",
    ("quad-x", "crazyflie"): "front right ccw, rear right cw, rear left ccw, front left cw",
    ("quad-plus", "px4"): "right ccw, left ccw, front cw, rear cw",
    ("quad-plus", "paper"): "right ccw, left ccw, front cw, rear cw",
    ("hexa-x", "px4"): "right cw, left ccw, front left cw, rear right ccw, front right ccw, "
    "rear left cw",
    ("hexa-plus", "ardupilot"): "front cw, rear ccw, rear left cw, front right ccw, "
    "front left ccw, rear right cw",
    ("octo-x", "px4"): "front right cw, rear left cw, front right ccw, rear right ccw, "
    "front left ccw, rear left ccw, front left cw, rear right cw",
    ("octo-plus", "px4"): "front cw, rear cw, front right ccw, rear right ccw, front left ccw, "
    "rear left ccw, left cw, right cw",
    ("octo-coax-x", "ardupilot"): "front right ccw, front left cw, rear left ccw, rear right cw, "
    "front left ccw, front right cw, rear right ccw, rear left cw",
}


def seat(rotor):
    x, y, _ = rotor.position
    words = [FRONT] * (x > 1e-6) + [REAR] * (x < -1e-6)
    words += [RIGHT] * (y < -1e-6) + [LEFT] * (y > 1e-6)
    return " ".join([*words, rotor.spin])


@pytest.mark.parametrize("key", KNOWN, ids=str)
def test_motors_sit_where_the_autopilot_says(key):
    layout, order = key
    rotors = layout_rotors(layout, arm=0.25, order=order)
    assert ", ".join(seat(rotor) for rotor in rotors) == KNOWN[key]


@pytest.mark.parametrize(("layout", "order"), LAYOUTS, ids=str)
def test_any_layout_balances_and_steers(layout, order):
    vehicle = Vehicle(rotors=layout_rotors(layout, arm=0.25, order=order))
    r, s = vehicle.positions, vehicle.spins
    np.testing.assert_allclose(np.hypot(r[:, 0], r[:, 1]), 0.25, atol=1e-8)
    assert vehicle.arm == pytest.approx(0.25)
    # At equal speed: no torque about any axis.
    np.testing.assert_allclose(r.sum(axis=0), 0.0, atol=1e-8)
    assert s.sum() == 0.0
    allocation = np.stack([np.ones(len(s)), r[:, 1], -r[:, 0], -s])
    singular = np.linalg.svd(allocation / np.linalg.norm(allocation, axis=1)[:, None])[1]
    assert singular.min() > 0.5
    # Yaw is free of roll and pitch: spins balance left and right, front and rear.
    np.testing.assert_allclose(s @ r, 0.0, atol=1e-8)
    places = {(round(x, 6), round(y, 6), spin) for (x, y, _), spin in zip(r, s, strict=True)}
    assert len(places) == len(s)


def test_quadrotor_x_is_measured_along_the_arm():
    first = layout_rotors("quad-x", arm=0.2)[0]
    assert first.position == pytest.approx((0.2 / 2**0.5, -0.2 / 2**0.5, 0.0), abs=1e-9)


def test_hexa_x_has_two_arms_along_y_and_hexa_plus_one_along_x():
    assert layout_rotors("hexa-x", arm=0.3)[0].position == (0.0, -0.3, 0.0)
    assert layout_rotors("hexa-x", arm=0.3)[4].position == pytest.approx(
        (0.3 * 0.75**0.5, -0.15, 0.0)
    )
    assert layout_rotors("hexa-plus", arm=0.3)[0].position == (0.3, 0.0, 0.0)


def test_unknown_layouts_are_refused_with_the_known_ones():
    with pytest.raises(
        ExperimentError, match=r"no layout 'tri' .*; known: quad-x, .* list the rotors"
    ):
        layout_rotors("tri", arm=0.2)
    with pytest.raises(ExperimentError, match="known: octo-x in the order px4, ardupilot"):
        layout_rotors("octo-x", arm=0.2, order="betaflight")
    with pytest.raises(ExperimentError, match=r"did you mean 'quad-x'[?] known: quad-x"):
        layout_rotors("quadx", arm=0.2, order="betaflight")
