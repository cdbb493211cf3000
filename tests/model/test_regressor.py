"""The tensor against Newton-Euler written by vectors, and what is known of its structure."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import newton_euler as ne
from rotorfit.errors import FlightError
from rotorfit.model.regressor import regressor
from rotorfit.model.signals import signal_layout, signal_matrix
from rotorfit.model.terms.registry import added_signals
from rotorfit.model.vehicle import Vehicle

SEEDS = st.integers(0, 2**32 - 1)
ROTORS = st.integers(3, 8)
SAMPLES = 5
OF_VELOCITY = added_signals(["drag", "inflow"])
OF_CLIMB = added_signals(["climb_drag"])


def residual_of(vehicle, theta, motion):
    """Return the regressor's residual wrench and the size of its largest terms."""
    flight = ne.flight_of(*motion)
    Z = signal_matrix(flight, vehicle, 0, len(flight.time))
    return residual_and_size(regressor(vehicle), Z, theta)


def residual_and_size(A, Z, theta):
    values = np.array([theta.get(name, 0.0) for name in A.names])
    size = np.abs(Z) @ np.einsum("p,pjz->jz", np.abs(values), np.abs(A.tensor)).T
    return A.residual(Z, theta), size


def drawn(rng, rotors, *, tilted, has_imu):
    """Return a vehicle, and what its accelerometer measures of a motion."""
    imu = rng.normal(size=3) * 0.05 if has_imu else None
    vehicle = ne.random_vehicle(rng, rotors, tilted=tilted, imu=imu)
    return vehicle, lambda a, w, dw: a if imu is None else ne.at_point(a, w, dw, imu)


def assert_wrench(actual, expected, size):
    """Compare to 1e-12 of the terms that the wrench is the sum of."""
    np.testing.assert_array_less(np.abs(actual - expected), 1e-12 * size + 1e-300)


@settings(max_examples=150, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilted=st.booleans(), has_imu=st.booleans())
def test_regressor_times_parameters_is_newton_euler(seed, rotors, tilted, has_imu):
    rng = np.random.default_rng(seed)
    vehicle, at_imu = drawn(rng, rotors, tilted=tilted, has_imu=has_imu)
    body = replace(ne.random_body(rng, rotors), constant=rng.normal(size=6))
    alpha, w, dw, O, dO = ne.random_motion(rng, SAMPLES, rotors)
    expected = ne.body_wrench(body, alpha, w, dw) - body.constant
    expected -= ne.rotor_wrench(body, vehicle, w, O, dO)
    measured = at_imu(alpha, w, dw)
    actual, size = residual_of(vehicle, ne.theta_of(body, 3e-6), (measured, w, dw, O, dO))
    assert_wrench(actual, expected, size)


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilted=st.booleans(), has_imu=st.booleans())
def test_drag_is_newton_eulers_where_the_velocity_is_known(seed, rotors, tilted, has_imu):
    rng = np.random.default_rng(seed)
    vehicle, at_imu = drawn(rng, rotors, tilted=tilted, has_imu=has_imu)
    body = replace(
        ne.random_body(rng, rotors, equal_kt=True),
        drag=rng.normal(size=3),
        drag_position=rng.normal(size=3) * 0.1,
        twist=0.01,
    )
    alpha, w, dw, O, dO = ne.random_motion(rng, SAMPLES, rotors)
    v = rng.normal(size=(SAMPLES, 3)) * 3.0
    expected = ne.body_wrench(body, alpha, w, dw) - ne.drag_wrench(body, v, w)
    expected -= ne.rotor_wrench(body, vehicle, w, O, dO)
    measured = at_imu(alpha, w, dw)
    flight = ne.flight_of(measured, w, dw, O, dO, velocity=v)
    Z = signal_matrix(flight, vehicle, 0, SAMPLES, added=OF_VELOCITY)
    A = regressor(vehicle, added=OF_VELOCITY)
    actual, size = residual_and_size(A, Z, ne.theta_of(body, 3e-6))
    assert_wrench(actual, expected, size)


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilted=st.booleans(), has_imu=st.booleans())
def test_damping_inflow_and_lift_are_newton_eulers(seed, rotors, tilted, has_imu):
    rng = np.random.default_rng(seed)
    vehicle, at_imu = drawn(rng, rotors, tilted=tilted, has_imu=has_imu)
    body = replace(
        ne.random_body(rng, rotors),
        turn_damping=tuple(rng.uniform(0.0, 0.1, 2)),
        inflow=rng.uniform(0.0, 1e-3),
        translational_lift=rng.normal(),
    )
    alpha, w, dw, O, dO = ne.random_motion(rng, SAMPLES, rotors)
    v = rng.normal(size=(SAMPLES, 3)) * 3.0
    expected = ne.body_wrench(body, alpha, w, dw) - ne.air_wrench(body, vehicle, v, w, O)
    expected -= ne.rotor_wrench(body, vehicle, w, O, dO)
    flight = ne.flight_of(at_imu(alpha, w, dw), w, dw, O, dO, velocity=v)
    Z = signal_matrix(flight, vehicle, 0, SAMPLES, added=OF_VELOCITY)
    A = regressor(vehicle, added=OF_VELOCITY)
    actual, size = residual_and_size(A, Z, ne.theta_of(body, 3e-6))
    assert_wrench(actual, expected, size)


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilted=st.booleans(), has_imu=st.booleans())
def test_felt_climb_is_held_back_wherever_that_acts(seed, rotors, tilted, has_imu):
    rng = np.random.default_rng(seed)
    vehicle, at_imu = drawn(rng, rotors, tilted=tilted, has_imu=has_imu)
    body, d, (x, y) = ne.random_body(rng, rotors), rng.uniform(0.0, 1.0), rng.normal(size=2)
    alpha, w, dw, O, dO = ne.random_motion(rng, SAMPLES, rotors)
    climb = rng.normal(size=SAMPLES)
    expected = ne.body_wrench(body, alpha, w, dw) - ne.rotor_wrench(body, vehicle, w, O, dO)
    expected += climb[:, None] * np.array([0.0, 0.0, d, y * d, -x * d, 0.0])
    flight = replace(ne.flight_of(at_imu(alpha, w, dw), w, dw, O, dO), climb=climb)
    Z = signal_matrix(flight, vehicle, 0, SAMPLES, added=OF_CLIMB)
    A = regressor(vehicle, added=OF_CLIMB)
    assert "drag_z" not in A.names and "climb_drag" not in regressor(vehicle).names
    held = {"climb_drag": d, "climb_moment_x": y * d, "climb_moment_y": -x * d}
    actual, size = residual_and_size(A, Z, {**ne.theta_of(body, 3e-6), **held})
    assert_wrench(actual, expected, size)


def test_a_turn_is_damped_without_a_velocity():
    names = regressor(ne.paper_vehicle()).names
    assert {"turn_damping_x", "turn_damping_y"} <= set(names)
    assert not {"inflow", "translational_lift", "drag_x"} & set(names)


def test_velocity_is_a_signal_only_where_it_is_asked_for():
    vehicle = ne.paper_vehicle()
    assert "vx" not in signal_layout(vehicle) and "drag_x" not in regressor(vehicle).names
    with_it, without = signal_layout(vehicle, OF_VELOCITY), signal_layout(vehicle)
    assert len(with_it) == len(without) + 4 + 3  # velocity, its square, and inflow along z
    flight = ne.flight_of(*ne.random_motion(np.random.default_rng(2), SAMPLES, 4))
    Z = signal_matrix(flight, vehicle, 0, SAMPLES, added=OF_VELOCITY)
    assert not Z[:, [with_it.index(name) for name in ("vx", "vy", "vz", "vxy2")]].any()
    with pytest.raises(FlightError, match="was not made of accelerometer and gyro"):
        signal_matrix(flight, vehicle, 0, SAMPLES, added=OF_CLIMB)


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilted=st.booleans())
def test_rotor_center_is_a_common_shift_of_all_rotors(seed, rotors, tilted):
    rng = np.random.default_rng(seed)
    vehicle = ne.random_vehicle(rng, rotors, tilted=tilted)
    shift = rng.normal(size=3) * 0.03
    body = replace(ne.random_body(rng, rotors, equal_kt=True), rotor_shift=shift)
    motion = ne.random_motion(rng, SAMPLES, rotors)
    expected = ne.body_wrench(body, *motion[:3]) - ne.rotor_wrench(
        body, vehicle, motion[1], *motion[3:]
    )
    actual, size = residual_of(vehicle, ne.theta_of(body, body.kt[0]), motion)
    assert_wrench(actual, expected, size)


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilt=st.floats(-0.5, 0.5))
def test_twist_is_the_yaw_torque_of_rotors_tilted_about_arms(seed, rotors, tilt):
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(rotors, 2))
    places *= 0.3 / np.linalg.norm(places, axis=1, keepdims=True)
    upright = ne.random_vehicle(rng, rotors)
    tilted = Vehicle(
        rotors=tuple(
            replace(
                rotor,
                position=(float(x), float(y), 0.0),
                axis=(-np.sin(tilt) * y / 0.3, np.sin(tilt) * x / 0.3, float(np.cos(tilt))),
            )
            for rotor, (x, y) in zip(upright.rotors, places, strict=True)
        )
    )
    motion = ne.random_motion(rng, SAMPLES, rotors)
    body = replace(ne.random_body(rng, rotors, equal_kt=True), kd=0.0, Jr=0.0)
    wrench = ne.rotor_wrench(body, tilted, *(motion[i] for i in (1, 3, 4)))
    theta = {"kt_twist": body.kt[0] * 0.3 * np.sin(tilt)}
    residual, _ = residual_of(upright, theta, motion)
    np.testing.assert_allclose(residual[:, 5], -wrench[:, 5], rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(residual[:, :5], 0.0)


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilted=st.booleans())
def test_rotor_drag_is_the_yaw_torque_of_forces_against_the_turn(seed, rotors, tilted):
    rng = np.random.default_rng(seed)
    vehicle = ne.random_vehicle(rng, rotors, tilted=tilted)
    body = replace(ne.random_body(rng, rotors), rotor_drag=rng.uniform(0.0, 1e-3))
    alpha, w, dw, O, dO = motion = ne.random_motion(rng, SAMPLES, rotors)
    expected = ne.body_wrench(body, alpha, w, dw) - ne.rotor_wrench(body, vehicle, w, O, dO)
    actual, size = residual_of(vehicle, ne.theta_of(body), motion)
    assert_wrench(actual, expected, size)


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilted=st.booleans())
def test_rotors_that_the_body_carries_are_dragged_as_well(seed, rotors, tilted):
    rng = np.random.default_rng(seed)
    vehicle = ne.random_vehicle(rng, rotors, tilted=tilted)
    drag = rng.uniform(0.0, 1e-3)
    body = replace(ne.random_body(rng, rotors), rotor_drag=drag)
    alpha, w, dw, O, dO = ne.random_motion(rng, SAMPLES, rotors)
    v = rng.normal(size=(SAMPLES, 3))
    expected = ne.body_wrench(body, alpha, w, dw) - ne.rotor_wrench(body, vehicle, w, O, dO)
    for i, place in enumerate(vehicle.positions):
        expected[:, 5] -= np.cross(place, -drag * O[:, i, None] * v)[:, 2]
        expected[:, 5] += np.cross(place, -drag * O[:, i, None] * v * [0.0, 0.0, 1.0])[:, 2]
    added = added_signals(["rotor_drag"], carried=True)
    flight = ne.flight_of(alpha, w, dw, O, dO)
    A = regressor(vehicle, added=added)
    Z = signal_matrix(replace(flight, carried=v), vehicle, 0, SAMPLES, added=added)
    actual, size = residual_and_size(A, Z, ne.theta_of(body))
    assert_wrench(actual, expected, size)
    unknown = signal_matrix(flight, vehicle, 0, SAMPLES, added=added)
    assert not unknown[:, A.layout.index("Ov_Mz")].any()
    assert added_signals(["rotor_drag"]) == added_signals(["twist"], carried=True) == ()


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilted=st.booleans())
def test_a_torque_in_proportion_to_speed_is_newton_eulers(seed, rotors, tilted):
    rng = np.random.default_rng(seed)
    vehicle = ne.random_vehicle(rng, rotors, tilted=tilted)
    body = replace(ne.random_body(rng, rotors), kd_linear=rng.uniform(0.0, 1e-3))
    alpha, w, dw, O, dO = ne.random_motion(rng, SAMPLES, rotors)
    expected = ne.body_wrench(body, alpha, w, dw) - ne.rotor_wrench(body, vehicle, w, O, dO)
    added = added_signals(["linear_drag_torque"])
    Z = signal_matrix(ne.flight_of(alpha, w, dw, O, dO), vehicle, 0, SAMPLES, added=added)
    A = regressor(vehicle, added=added)
    actual, size = residual_and_size(A, Z, ne.theta_of(body))
    assert_wrench(actual, expected, size)
    assert "kd_linear" not in regressor(vehicle).names


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilted=st.booleans())
def test_an_exact_motion_leaves_no_residual(seed, rotors, tilted):
    rng = np.random.default_rng(seed)
    vehicle = ne.random_vehicle(rng, rotors, tilted=tilted)
    body = ne.random_body(rng, rotors)
    _, w, _, O, dO = ne.random_motion(rng, SAMPLES, rotors)
    alpha, dw = ne.balanced_motion(body, vehicle, w, O, dO)
    actual, size = residual_of(vehicle, ne.theta_of(body), (alpha, w, dw, O, dO))
    # Solving for the accelerations costs the condition number of the 6 x 6 mass matrix.
    assert np.abs(actual).max() <= 1e-12 * size.max()


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilted=st.booleans())
def test_the_common_thrust_column_is_the_sum_of_rotor_columns(seed, rotors, tilted):
    vehicle = ne.random_vehicle(np.random.default_rng(seed), rotors, tilted=tilted)
    A = regressor(vehicle)
    own = [A.tensor[A.names.index(f"kt_{i + 1}")] for i in range(rotors)]
    np.testing.assert_array_equal(A.tensor[A.names.index("kt")], np.sum(own, axis=0))


def test_body_matrix_row_by_row():
    """The 6 x 9 matrix D of Six et al. 2020, eq. 10, as derived by hand."""
    rng = np.random.default_rng(1)
    vehicle = ne.paper_vehicle()
    motion = ne.random_motion(rng, SAMPLES, 4)
    alpha, (x, y, z), (dx, dy, dz) = motion[0].T, motion[1].T, motion[2].T
    ax, ay, az = alpha
    o = np.zeros(SAMPLES)
    D = [
        [-(y**2 + z**2), x * y - dz, x * z + dy, o, o, o, o, o, o],
        [x * y + dz, -(x**2 + z**2), y * z - dx, o, o, o, o, o, o],
        [x * z - dy, y * z + dx, -(x**2 + y**2), o, o, o, o, o, o],
        [o, az, -ay, dx, -y * z, y * z, dy - x * z, dz + x * y, y**2 - z**2],
        [-az, o, ax, x * z, dy, -x * z, dx + y * z, z**2 - x**2, dz - x * y],
        [ay, -ax, o, -x * y, x * y, dz, x**2 - y**2, dx - y * z, dy + x * z],
    ]
    Z = signal_matrix(ne.flight_of(*motion), vehicle, 0, SAMPLES)
    rows = regressor(vehicle).rows(Z, ne.CHI)
    np.testing.assert_allclose(rows, np.array(D).transpose(2, 0, 1), rtol=1e-14, atol=1e-13)
    mass = regressor(vehicle).rows(Z, ["mass"])[..., 0]
    np.testing.assert_array_equal(mass, np.concatenate([motion[0], np.zeros((5, 3))], axis=1))


def test_propeller_matrix_of_the_papers_plus_frame():
    """Six et al. 2020, eq. 9: tau = (d(-O1+O2), d(-O3+O4)) k_t and -sign(O) k_d, squares of O."""
    vehicle, d = ne.paper_vehicle(0.31), 0.31
    motion = ne.random_motion(np.random.default_rng(2), SAMPLES, 4)
    s1, s2, s3, s4 = motion[3].T ** 2
    o = np.zeros(SAMPLES)
    kt = [o, o, s1 + s2 + s3 + s4, d * (s2 - s1), d * (s4 - s3), o]
    kd = [o, o, o, o, o, -s1 - s2 + s3 + s4]
    Z = signal_matrix(ne.flight_of(*motion), vehicle, 0, SAMPLES)
    rows = -regressor(vehicle).rows(Z, ["kt", "kd"])
    expected = np.stack([np.transpose(kt), np.transpose(kd)], axis=2)
    np.testing.assert_allclose(rows, expected, rtol=1e-14, atol=1e-9)


def test_rotor_inertia_column_of_an_aligned_frame():
    """THEORY 1.1: [0, 0, 0, -w_y h, +w_x h, -sum s dO] on the rotor side, h = sum s O."""
    vehicle = ne.paper_vehicle()
    _, w, _, O, dO = motion = ne.random_motion(np.random.default_rng(3), SAMPLES, 4)
    s = np.array([1.0, 1.0, -1.0, -1.0])
    o = np.zeros(SAMPLES)
    expected = np.array([o, o, o, -w[:, 1] * (O @ s), w[:, 0] * (O @ s), -dO @ s]).T
    Z = signal_matrix(ne.flight_of(*motion), vehicle, 0, SAMPLES)
    rows = -regressor(vehicle).rows(Z, ["Jr"])[..., 0]
    np.testing.assert_allclose(rows, expected, rtol=1e-13, atol=1e-11)


def test_of_the_papers_72_entries_40_are_not_zero():
    vehicle = ne.paper_vehicle()
    motion = ne.random_motion(np.random.default_rng(4), SAMPLES, 4)
    Z = signal_matrix(ne.flight_of(*motion), vehicle, 0, SAMPLES)
    rows = regressor(vehicle).rows(Z, ["kt", "kd", *ne.CHI, "mass"])
    assert (np.count_nonzero(rows, axis=(1, 2)) == 40).all()


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, rotors=ROTORS)
def test_reversing_all_spins_flips_drag_torque_and_rotor_inertia(seed, rotors):
    rng = np.random.default_rng(seed)
    vehicle = ne.random_vehicle(rng, rotors, tilted=bool(seed % 2))
    other = {"ccw": "cw", "cw": "ccw"}
    reversed_ = Vehicle(rotors=tuple(replace(r, spin=other[r.spin]) for r in vehicle.rotors))
    motion = ne.random_motion(rng, SAMPLES, rotors)
    theta = ne.theta_of(ne.random_body(rng, rotors))
    expected, size = residual_of(vehicle, theta, motion)
    flipped = theta | {"kd": -theta["kd"], "Jr": -theta["Jr"]}
    assert_wrench(residual_of(reversed_, flipped, motion)[0], expected, size)
    assert np.abs(residual_of(reversed_, theta, motion)[0] - expected).max() > 1e-6


QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
MIRROR = np.diag([1.0, -1.0, 1.0])


def seen_from(Q, vehicle, body, motion):
    """Return vehicle, body and motion in axes turned (or mirrored) by Q; torques are axial."""
    alpha, w, dw, O, dO = motion
    sign = np.linalg.det(Q)
    other = {"ccw": "cw", "cw": "ccw"} if sign < 0 else {"ccw": "ccw", "cw": "cw"}
    rotors = tuple(
        replace(r, position=tuple(Q @ r.position), axis=tuple(Q @ r.axis), spin=other[r.spin])
        for r in vehicle.rotors
    )
    turned = replace(body, com=Q @ body.com, inertia_com=Q @ body.inertia_com @ Q.T)
    axial = sign * Q.T
    return Vehicle(rotors=rotors), turned, (alpha @ Q.T, w @ axial, dw @ axial, O, dO)


@pytest.mark.parametrize("Q", [QUARTER_TURN, MIRROR], ids=["quarter turn", "mirror"])
@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilted=st.booleans())
def test_turning_or_mirroring_the_axes_turns_the_wrench(Q, seed, rotors, tilted):
    rng = np.random.default_rng(seed)
    vehicle = ne.random_vehicle(rng, rotors, tilted=tilted)
    body = ne.random_body(rng, rotors)
    motion = ne.random_motion(rng, SAMPLES, rotors)
    before, size = residual_of(vehicle, ne.theta_of(body), motion)
    vehicle_q, body_q, motion_q = seen_from(Q, vehicle, body, motion)
    after, _ = residual_of(vehicle_q, ne.theta_of(body_q), motion_q)
    turn = np.zeros((6, 6))
    turn[:3, :3], turn[3:, 3:] = Q, np.linalg.det(Q) * Q
    assert_wrench(after, before @ turn.T, size @ np.abs(turn).T)


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, rotors=ROTORS, tilted=st.booleans())
def test_moving_the_origin_follows_the_parallel_axis_theorem(seed, rotors, tilted):
    rng = np.random.default_rng(seed)
    vehicle = ne.random_vehicle(rng, rotors, tilted=tilted)
    body = ne.random_body(rng, rotors)
    alpha, w, dw, O, dO = motion = ne.random_motion(rng, SAMPLES, rotors)
    before, size = residual_of(vehicle, ne.theta_of(body), motion)
    s = rng.normal(size=3) * 0.05
    moved = Vehicle(
        rotors=tuple(replace(r, position=tuple(r.position - s)) for r in vehicle.rotors)
    )
    theta = ne.theta_of(replace(body, com=body.com - s))
    there, there_size = residual_of(moved, theta, (ne.at_point(alpha, w, dw, s), w, dw, O, dO))
    expected = before.copy()
    expected[:, 3:] -= np.cross(s, before[:, :3])
    both = size + there_size
    both[:, 3:] += np.abs(s).max() * size[:, :3].sum(axis=1, keepdims=True)
    assert_wrench(there, expected, both)


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, rotors=ROTORS)
def test_aligned_and_tilted_layouts_agree_where_all_axes_are_z(seed, rotors):
    rng = np.random.default_rng(seed)
    aligned = ne.random_vehicle(rng, rotors)
    first = replace(aligned.rotors[0], axis=(1e-300, 0.0, 1.0))
    tilted = Vehicle(rotors=(first, *aligned.rotors[1:]))
    assert len(signal_layout(tilted)) == len(signal_layout(aligned)) + 3
    motion = ne.random_motion(rng, SAMPLES, rotors)
    theta = ne.theta_of(ne.random_body(rng, rotors))
    few, size = residual_of(aligned, theta, motion)
    assert_wrench(residual_of(tilted, theta, motion)[0], few, size)


def test_four_rotors_make_24_signals():
    full = regressor(ne.paper_vehicle())
    assert full.tensor.shape == (len(full.names), 6, 24)


def test_rows_and_residual_are_the_same_equations():
    rng = np.random.default_rng(5)
    vehicle = ne.random_vehicle(rng, 6, tilted=True, imu=[0.01, -0.02, 0.03])
    Z = signal_matrix(ne.flight_of(*ne.random_motion(rng, 40, 6)), vehicle, 0, 40)
    A = regressor(vehicle)
    theta = {n: v for n, v in ne.theta_of(ne.random_body(rng, 6)).items() if n in A.names}
    rows = A.rows(Z, list(theta))
    np.testing.assert_allclose(rows @ list(theta.values()), A.residual(Z, theta), atol=1e-10)
