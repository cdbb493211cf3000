import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rotorfit.simulation.body import (
    cross,
    quaternion_from_euler,
    rotation,
    rotation_vector_between,
    times,
    yaw_of,
)

number = st.floats(-10.0, 10.0)
vector = st.tuples(number, number, number)
angles = st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))


@given(vector, vector, vector)
def test_products_are_those_of_numpy(a, b, c):
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=1e-12)
    np.testing.assert_allclose(times((a, b, c), b), np.array([a, b, c]) @ b, atol=1e-12)


@given(angles)
def test_euler_angles_turn_roll_first_and_yaw_last(euler):
    roll, pitch, yaw = euler
    R = rotation(quaternion_from_euler(roll, pitch, yaw))
    expected = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    np.testing.assert_allclose(R, expected, atol=1e-14)
    np.testing.assert_allclose(yaw_of(R), yaw, atol=1e-12)


@given(angles, angles, st.sampled_from([1.0, -1.0]))
def test_rotation_between_goes_the_shorter_way_in_start_axes(one, other, sign):
    start, end = quaternion_from_euler(*one), quaternion_from_euler(*other)
    flipped = (sign * end[0], sign * end[1], sign * end[2], sign * end[3])
    found = np.array(rotation_vector_between(start, flipped))
    relative = np.transpose(rotation(start)) @ np.array(rotation(end))
    full = Rotation.from_matrix(relative).as_rotvec()
    angle = float(np.linalg.norm(full))
    expected = full * (2 * np.sin(angle / 2) / angle) if angle > 1e-9 else full
    if angle < 3.14:  # at half a turn both ways are as short
        np.testing.assert_allclose(found, expected, atol=1e-7)
