"""Flights as a whole: the laws they obey, what they excite, and that they can be repeated."""

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson
from scipy.linalg import lstsq

from rotorfit.errors import ExperimentError
from rotorfit.model.regressor import regressor
from rotorfit.model.signals import signal_matrix
from rotorfit.model.terms.air import hover_inflow, thrust_over_weight
from rotorfit.model.terms.registry import added_signals
from rotorfit.simulation import (
    GRAVITY,
    STILL,
    TYPICAL,
    Course,
    Scenario,
    Sensors,
    SimulatedFlight,
    Stick,
    Sticks,
    exact_flight_data,
    layout_vehicle,
    paper_vehicle,
    sampled_flight_data,
    simulate_flight,
)
from rotorfit.simulation.controller import Gains, Memory, autopilot_of, control
from rotorfit.simulation.pilot import Reference
from rotorfit.simulation.rotors import allocation


def rms(values):
    return np.sqrt(np.mean(values**2, axis=0))


def newton_euler_residual(flight: SimulatedFlight) -> np.ndarray:
    """Return inertial minus applied wrench, written out apart from the simulation."""
    truth, vehicle = flight.truth, flight.vehicle
    m, ms, I = truth.mass, np.array(truth.first_moments), truth.inertia_tensor
    a, w, dw = flight.specific_force, flight.angular_velocity, flight.angular_acceleration
    force = m * a + np.cross(dw, ms) + np.cross(w, np.cross(w, ms))
    torque = dw @ I + np.cross(w, w @ I) + np.cross(ms, a)
    spread = truth.kt_spread or (1.0,) * len(vehicle.rotors)
    for i, rotor in enumerate(vehicle.rotors):
        n, p = np.array(rotor.axis), np.array(rotor.position)
        s = 1 if rotor.spin == "ccw" else -1
        O, dO = flight.rotor_speed[:, i, None], flight.rotor_acceleration[:, i, None]
        thrust = truth.kt * spread[i] * O**2 * n
        force = force - thrust
        torque = torque - np.cross(p, thrust) + s * truth.kd * O**2 * n
        torque = torque + s * truth.Jr * (dO * n + np.cross(w, O * n))
        moving = flight.velocity_body + np.cross(w, p)
        held = truth.rotor_drag * O * (moving - (moving @ n)[:, None] * n)
        force, torque = force + held, torque + np.cross(p, held)
    return np.hstack([force, torque]) - flight.external_wrench


@pytest.mark.parametrize("name", ["paper_flight", "rough_flight", "ground_flight"])
def test_exact_data_satisfy_newton_euler_to_rounding(name, request):
    residual = newton_euler_residual(request.getfixturevalue(name))
    assert np.abs(residual).max() < 5e-14


def explained(flight: SimulatedFlight, names=(), *, velocity=True) -> np.ndarray:
    """Return what the model with these terms leaves of an exact flight at its true parameters."""
    truth, vehicle = flight.truth, flight.vehicle
    added = added_signals([*names, "drag"] * velocity)
    data = exact_flight_data(flight, vehicle, specific_force_at="imu")
    # The model has thrust over weight by the mean specific force, which inflow and drag are in.
    load = truth.kt * (data.rotor_speed**2).sum(axis=1) / (truth.mass * GRAVITY)
    known = float(np.mean(load / thrust_over_weight(data, slice(0, len(load)))))
    assert known == pytest.approx(1.0, abs=0.1)
    hover = hover_inflow(truth.mass, vehicle) * known**0.5
    data = replace(data, hover_inflow=hover)
    model = regressor(vehicle, added=added)
    theta = {name: value for name, value in truth.parameters().items() if name in model.names}
    Z = signal_matrix(data, vehicle, 0, len(data.time), added=added)
    return model.residual(Z, theta)


@pytest.mark.parametrize("rotor_drag", [0.0, 2e-4])
def test_the_model_explains_an_exact_flight_to_rounding(rotor_drag):
    truth, vehicle = paper_vehicle("B")
    truth = replace(truth, Jr=2e-5, rotor_drag=rotor_drag)
    flight = simulate_flight(truth, vehicle, Scenario(seconds=10.0), seed=3)
    assert np.abs(explained(flight, ["rotor_drag"])).max() < 5e-14
    if rotor_drag:
        none = replace(flight, truth=replace(truth, rotor_drag=0.0))
        missed = explained(none, ["rotor_drag"])
        np.testing.assert_array_less([0.1, 0.1, 1e-3], np.abs(missed[:, [0, 1, 5]]).max(axis=0))
        np.testing.assert_allclose(missed[:, 2], 0.0, atol=5e-14)


def test_without_velocity_the_model_has_the_drag_of_a_turn():
    truth, vehicle = paper_vehicle("A")
    truth = replace(truth, first_moments=(0.0, 0.0, 0.0), rotor_drag=2e-4)
    yaw = replace(STILL, yaw=Stick(band=(0.1, 0.6), rms=1.0))
    flight = simulate_flight(truth, vehicle, Scenario(seconds=6.0, sticks=yaw), seed=3)
    left = explained(flight, velocity=False)[:, 5]
    none = explained(replace(flight, truth=replace(truth, rotor_drag=0.0)), velocity=False)[:, 5]
    assert rms(left) < 1e-2 * rms(none)
    assert rms(none) > 1e-2


def fast_flight(**air) -> SimulatedFlight:
    truth, vehicle = layout_vehicle("quad-x")
    vehicle = replace(vehicle, propeller=0.25)
    course = Course(route="eights", speed=12.0, size=30.0, lean=0.5 if "rotor_drag" in air else 0.0)
    scenario = Scenario(seconds=12.0, course=course, physics_rate=200.0)
    return simulate_flight(replace(truth, propeller=0.25, **air), vehicle, scenario, seed=5)


@pytest.mark.parametrize(
    ("term", "rows", "air"),
    [
        ("inflow", [2, 3, 4], {"inflow": 2.4e-4}),
        ("wake_moment", [3, 4], {"wake_moment": (3e-3, 2e-3)}),
    ],
)
def test_the_model_explains_what_the_air_does_at_speed(term, rows, air):
    flight = fast_flight(**air)
    assert 9.0 < np.linalg.norm(flight.velocity, axis=1).max() < 16.0
    none = replace(flight, truth=replace(flight.truth, inflow=0.0, wake_moment=(0.0, 0.0)))
    left, there = (rms(explained(one, [term])) for one in (flight, none))
    assert (left[rows] < 1e-6 * there[rows]).all()
    assert (there[rows] > 1e-2).all()
    np.testing.assert_allclose(left[[0, 1, 5]], 0.0, atol=1e-12)


def test_a_course_is_flown_at_its_speed_and_a_wind_moves_the_air():
    calm = fast_flight(rotor_drag=2e-4)
    windy = fast_flight(rotor_drag=2e-4, wind=(4.0, 0.0, 0.0))
    assert np.linalg.norm(calm.velocity, axis=1).max() == pytest.approx(12.0, rel=0.2)
    assert np.abs(newton_euler_residual(calm)).max() < 5e-14
    through = windy.velocity - [4.0, 0.0, 0.0]
    assert np.abs(newton_euler_residual(windy)).max() > 0.1
    assert np.abs(newton_euler_residual(replace(windy, velocity=through))).max() < 5e-14


@pytest.mark.parametrize(
    ("name", "error"),
    [("paper_flight", 1e-3), ("rough_flight", 2e-2)],  # between samples slopes bend or jump
)
def test_states_are_the_integrals_of_their_derivatives(name, error, request):
    flight = request.getfixturevalue(name)
    dt = 1 / flight.sample_rate
    R = flight.rotation_body_to_world
    for state, slope in (
        (flight.angular_velocity, flight.angular_acceleration),
        (flight.velocity, R.apply(flight.specific_force) - [0, 0, GRAVITY]),
        (flight.position, flight.velocity),
    ):
        found = cumulative_simpson(slope, dx=dt, axis=0, initial=0)[:1000]
        np.testing.assert_allclose(found, state[:1000] - state[0], atol=error * rms(state).max())
    turned = (R[:-1].inv() * R[1:]).as_rotvec() / dt
    mean = (flight.angular_velocity[:-1] + flight.angular_velocity[1:]) / 2
    np.testing.assert_allclose(turned, mean, atol=1e-3)


def test_excitation_is_the_documented_one_within_the_hall(paper_flight):
    assert rms(paper_flight.angular_velocity) == pytest.approx([0.76, 0.54, 0.29], rel=0.2)
    assert rms(paper_flight.angular_acceleration) == pytest.approx([4.8, 2.8, 0.7], rel=0.2)
    assert np.all(np.ptp(paper_flight.position, axis=0) < [6, 4, 4])
    assert paper_flight.time.size == 15_000
    assert paper_flight.commanded_speed.max() < paper_flight.max_speed  # no saturation


def averaged(values):
    return (values[:-2] + 4 * values[1:-1] + values[2:]) / 6


def recovered(flight: SimulatedFlight) -> dict[str, float]:
    """Return the least-squares estimate from central differences of sampled signals."""
    data, truth, d = sampled_flight_data(flight), flight.truth, 0.2
    (ax, ay, az), (x, y, z) = data.specific_force.T, data.angular_velocity.T
    dx, dy, dz = data.angular_acceleration[1:-1].T
    O = (data.rotor_speed**2).T
    o = np.zeros(len(ax) - 2)
    c = {  # every column that is not a derivative sees the filter of the difference
        name: averaged(value)
        for name, value in {
            "ax": ax, "ay": ay, "az": az, "xx": x * x, "yy": y * y, "zz": z * z,
            "xy": x * y, "xz": x * z, "yz": y * z, "lift": O.sum(axis=0),
            "roll": d * (O[1] - O[0]), "pitch": d * (O[3] - O[2]),
            "yaw": O[2] + O[3] - O[0] - O[1],
        }.items()
    }  # fmt: skip
    xx, yy, zz, xy, xz, yz = (c[name] for name in ("xx", "yy", "zz", "xy", "xz", "yz"))
    rows = [  # THEORY: msx msy msz Ixx Iyy Izz Ixy Ixz Iyz, then kt and kd
        [-(yy + zz), xy - dz, xz + dy, o, o, o, o, o, o, o, o],
        [xy + dz, -(xx + zz), yz - dx, o, o, o, o, o, o, o, o],
        [xz - dy, yz + dx, -(xx + yy), o, o, o, o, o, o, -c["lift"], o],
        [o, c["az"], -c["ay"], dx, -yz, yz, dy - xz, dz + xy, yy - zz, -c["roll"], o],
        [-c["az"], o, c["ax"], xz, dy, -xz, dx + yz, zz - xx, dz - xy, -c["pitch"], o],
        [c["ay"], -c["ax"], o, -xy, xy, dz, xx - yy, dx - yz, dy + xz, o, -c["yaw"]],
    ]
    W = np.vstack([np.column_stack(row) for row in rows])
    target = -truth.mass * np.concatenate([c["ax"], c["ay"], c["az"], o, o, o])
    size = np.linalg.norm(W, axis=0)
    names = ["msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz", "kt", "kd"]
    return dict(zip(names, lstsq(W / size, target)[0] / size, strict=True))


@pytest.mark.parametrize("configuration", ["A", "B"])
def test_central_differences_recover_the_truth(configuration, paper_flight):
    flight = paper_flight
    if configuration == "A":
        flight = simulate_flight(*paper_vehicle("A"), Scenario(), seed=4)
    found, true = recovered(flight), flight.truth.parameters()
    limits = {"kt": 1e-6, "Ixx": 3e-4, "Iyy": 3e-4, "Izz": 1e-3, "kd": 1e-3}
    for name, limit in limits.items():
        assert found[name] == pytest.approx(true[name], rel=limit), name
    for name in ("Ixy", "Ixz", "Iyz"):
        assert found[name] == pytest.approx(true[name], abs=2e-6), name
    for name in ("msx", "msy", "msz"):
        assert found[name] == pytest.approx(true[name], abs=2e-5), name


def test_integration_has_converged():
    truth, vehicle = paper_vehicle("B")
    truth = replace(truth, Jr=2e-5, motor_delay=0.0073)
    coarse = simulate_flight(truth, vehicle, Scenario(seconds=10.0), seed=5)
    fine = simulate_flight(truth, vehicle, Scenario(seconds=10.0, physics_rate=3200.0), seed=5)
    for name, limit in (("angular_velocity", 1e-7), ("position", 1e-7), ("rotor_speed", 1e-5)):
        difference = getattr(coarse, name) - getattr(fine, name)
        assert np.abs(difference).max() < limit, name


def test_hands_off_a_balanced_vehicle_hangs_still():
    truth, vehicle = paper_vehicle("A")
    truth = replace(truth, first_moments=(0.0, 0.0, -8e-3), Jr=2e-5)
    flight = simulate_flight(truth, vehicle, Scenario(seconds=5.0, sticks=STILL), seed=1)
    np.testing.assert_allclose(flight.position, 0, atol=1e-12)
    np.testing.assert_allclose(flight.angular_velocity, 0, atol=1e-12)
    hover = np.sqrt(truth.mass * GRAVITY / 4 / truth.kt)
    np.testing.assert_allclose(flight.rotor_speed, hover, rtol=1e-12)


def test_the_autopilot_alone_holds_an_unbalanced_vehicle():
    truth, vehicle = paper_vehicle("B")
    truth = replace(
        truth,
        kt_spread=(1.03, 0.97, 1.02, 0.98),
        disturbance_force_std=(0.1, 0.1, 0.1),
        disturbance_torque_std=(6e-3, 6e-3, 1.5e-3),
    )
    flight = simulate_flight(truth, vehicle, Scenario(seconds=30.0, sticks=STILL), seed=1)
    assert np.abs(flight.position).max() < 1.0
    assert rms(flight.external_wrench) == pytest.approx(
        [*truth.disturbance_force_std, *truth.disturbance_torque_std], rel=0.15
    )


def test_torque_asked_is_that_of_each_axis_own_gains():
    truth, vehicle = paper_vehicle("B")
    truth = replace(truth, inertia=(0.011, 0.017, 0.023, 0.0, 0.0, 0.0), first_moments=(0.0,) * 3)
    gains = Gains(rate=(5.0, 6.0, 0.7), damping=(0.1, 0.2, 0.3), integral=(4.0, 3.0, 0.2))
    pilot = autopilot_of(truth, vehicle, thrust_to_weight=2.5, period=0.005, gains=gains)
    w, last, trim = np.array([0.02, -0.03, 0.05]), np.array([0.01, -0.04, 0.06]), np.full(3, 1e-3)
    state = (*w.tolist(), 1.0, *(0.0,) * 9)
    speeds, after = control(
        pilot,
        Memory(0.0, tuple(trim), tuple(last), (0.0,) * 3),
        state,
        Reference(*(0.0,) * 6, 1.0, 0.0),
        grounded=False,
    )
    I, error, nominal = np.array(truth.inertia[:3]), after.asked - w, np.full(4, truth.kt)
    grown = trim + I * gains.integral * error * 0.005
    torque = grown + I * (gains.rate * error - gains.damping * (w - last) / 0.005)
    np.testing.assert_allclose(after.trim, grown, rtol=1e-12)
    given = allocation(vehicle, kt=nominal, kd=truth.kd) @ speeds**2
    np.testing.assert_allclose(given[2:], [truth.mass * GRAVITY, *torque], rtol=1e-9)


def test_disturbance_changes_linearly_between_samples():
    truth, vehicle = paper_vehicle("A")
    truth = replace(truth, disturbance_force_std=(1.0, 1.0, 1.0))
    flight = simulate_flight(truth, vehicle, Scenario(seconds=5.0, sticks=STILL), seed=1)
    R = flight.rotation_body_to_world
    acceleration = R.apply(flight.specific_force) - [0, 0, GRAVITY]
    mean = (acceleration[:-1] + acceleration[1:]) / 2
    np.testing.assert_allclose(np.diff(flight.velocity, axis=0) * 200, mean, atol=2e-3)
    assert np.abs(np.diff(acceleration, axis=0)).max() > 0.2


@pytest.mark.parametrize("delay", [0.0, 0.005, 0.0123])
def test_rotor_speed_is_the_lagged_and_delayed_command(delay):
    truth, vehicle = paper_vehicle("A")
    truth = replace(truth, motor_delay=delay)
    flight = simulate_flight(truth, vehicle, Scenario(seconds=2.0), seed=1)
    lag, dt, start = truth.motor_lag, 1 / flight.sample_rate, 100
    for n in (150, 300):
        speed = flight.rotor_speed[start]
        for t in np.arange(start * dt, n * dt - 1e-12, dt / 50):  # dt/50 divides each delay
            sample = int(np.floor((t - delay) / dt + 1e-6))
            command = flight.commanded_speed[sample]
            speed = command + (speed - command) * np.exp(-dt / 50 / lag)
        np.testing.assert_allclose(flight.rotor_speed[n], speed, rtol=1e-10)


def test_rotor_acceleration_is_the_limit_under_the_new_command():
    flight = simulate_flight(*paper_vehicle("A"), Scenario(seconds=2.0), seed=1)
    slope = (flight.commanded_speed - flight.rotor_speed) / flight.truth.motor_lag
    np.testing.assert_allclose(flight.rotor_acceleration, slope, rtol=1e-12)


@pytest.mark.parametrize("layout", ["quad-x", "hexa-x", "octo", "x8", "hexa-tilted"])
def test_every_layout_stays_in_the_hall_and_moves(layout):
    flight = simulate_flight(*layout_vehicle(layout), Scenario(seconds=10.0), seed=1)
    assert np.all(np.ptp(flight.position, axis=0) < [6, 4, 4])
    assert np.all(rms(flight.angular_velocity) > [0.5, 0.3, 0.15])


def test_a_seed_determines_the_flight():
    scenario = Scenario(seconds=6.0, sensors=Sensors(gyro_std=0.02, accel_std=0.4))
    one, same, other = (
        simulate_flight(*paper_vehicle("A"), scenario, seed=seed) for seed in (1, 1, 2)
    )
    for field in fields(SimulatedFlight):
        if isinstance(value := getattr(one, field.name), np.ndarray):
            np.testing.assert_array_equal(value, getattr(same, field.name))
    assert np.abs(one.angular_velocity - other.angular_velocity).max() > 0.1
    noises = [flight.gyro - flight.angular_velocity for flight in (one, other)]
    assert np.abs(noises[0] - noises[1]).max() > 0.05


def test_sticks_move_only_their_own_axis():
    sticks = replace(STILL, yaw=Stick(band=(0.2, 0.6), rms=0.3))
    flight = simulate_flight(*paper_vehicle("A"), Scenario(seconds=10.0, sticks=sticks), seed=1)
    w = rms(flight.angular_velocity)
    assert w[2] > 0.2
    assert w[:2].max() < 0.02


def test_flight_from_the_ground_rests_takes_off_and_lands(ground_flight):
    flight = ground_flight
    up, down = np.flatnonzero(np.diff(flight.airborne.astype(int))) + 1
    assert 3.0 < flight.time[up] < 5.0
    assert flight.time[-1] - flight.time[down] > 3.0
    before, after = slice(0, up), slice(down, None)
    for rest in (before, after):
        np.testing.assert_array_equal(flight.angular_velocity[rest], 0.0)
        np.testing.assert_array_equal(flight.velocity[rest], 0.0)
        np.testing.assert_allclose(flight.specific_force[rest, 2], GRAVITY, rtol=1e-3)
    np.testing.assert_array_equal(flight.rotor_speed[:600], 0.0)
    assert flight.rotor_speed[-1].max() < 1e-6
    lift = flight.truth.kt * (flight.rotor_speed**2).sum(axis=1)
    assert lift[up - 1] <= flight.truth.mass * GRAVITY < lift[up]
    assert np.median(flight.position[up + 1000 : down - 500, 2]) == pytest.approx(1.0, abs=0.2)
    assert abs(flight.position[down, 2]) < 0.02


def test_a_stick_slower_than_the_flight_is_refused():
    sticks = Sticks(yaw=Stick(band=(0.1, 0.2), rms=0.3))
    with pytest.raises(ExperimentError, match=r"2 s is too short for a stick between 0\.1 and"):
        simulate_flight(*paper_vehicle("A"), Scenario(seconds=2.0, sticks=sticks), seed=1)
    with pytest.raises(ExperimentError, match="three samples"):
        Scenario(seconds=0.0)


def test_an_autopilot_that_hears_its_gyro_responds_to_its_noise():
    """The command of a sample goes with the noise of its gyro, and only if it is told so."""
    shares = {}
    for hears in (False, True):
        scenario = Scenario(seconds=10.0, sensors=TYPICAL, gyro_noise_in_loop=hears)
        flight = simulate_flight(*paper_vehicle("A"), scenario, seed=6)
        noise = (flight.gyro - flight.angular_velocity)[:, 0]
        assert noise.std() == pytest.approx(TYPICAL.gyro_std, rel=0.1)
        roll = flight.commanded_speed[:, 1] - flight.commanded_speed[:, 0]
        shares[hears] = np.corrcoef(np.diff(roll), np.diff(noise))[0, 1]
    assert abs(shares[False]) < 0.1
    assert shares[True] < -0.5
