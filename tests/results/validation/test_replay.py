"""The replay moves as the simulated body does, and tells a wrong model from a right one."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rotorfit.errors import ExperimentError, FlightError
from rotorfit.flight.flight_data import Segment
from rotorfit.model.air_force import air_wrenches
from rotorfit.model.regressor import regressor
from rotorfit.model.terms.registry import added_signals
from rotorfit.model.vehicle import Vehicle
from rotorfit.results.validation.replay import (
    HOLD,
    MOST_WINDOWS,
    Entrant,
    band_growth,
    error_growth,
    force_errors,
    growth_time,
    replay,
    window_starts,
)
from rotorfit.results.validation.replay_vehicle import (
    AIR_NAMES,
    hover_centre,
    replay_vehicle,
    unknown_body,
)
from rotorfit.simulation import Scenario, Truth, exact_flight_data, simulate_flight

sys.path.append(str(Path(__file__).parents[2] / "export"))
from export_material import (
    COM,
    IMU,
    INERTIA_COM,
    JR,
    KD,
    KT,
    LAG,
    MASS,
    ROTORS,
    YAW_LOST,
    a_result,
    changed,
    elements,
    parameter,
    steiner,
    vehicle,
)

INERTIA = elements(INERTIA_COM + steiner(MASS, COM))


PLACES = Vehicle(rotors=vehicle().rotors, imu_position=tuple(float(v) for v in IMU))
SHORT = Scenario(seconds=12.0)


def true_vehicle():
    return Truth(
        mass=MASS,
        first_moments=tuple(float(c) for c in MASS * COM),
        inertia=tuple(float(v) for v in INERTIA.values()),
        kt=KT,
        kd=KD,
        Jr=JR,
        kt_spread=(1.02, 0.98, 1.01, 0.99),
        motor_lag=LAG,
    )


@pytest.fixture(scope="module")
def data():
    flight = simulate_flight(true_vehicle(), PLACES, SHORT, seed=3)
    return exact_flight_data(flight, PLACES, specific_force_at="imu")


def entrant(data, result=None, **options):
    flies = replay_vehicle(a_result() if result is None else result, "A", **options)
    return Entrant(vehicle=flies, rotor_speed=data.rotor_speed)


def air_as_flown(data):
    """Return the wrench of a unit of each coefficient of the air, at the flown velocity."""
    terms = ("rotor_drag", "inflow", "yaw_damping")
    layout = regressor(PLACES, added=added_signals(terms)).layout
    found = {name: wrench for _, name, wrench in air_wrenches(data, PLACES, layout)}
    nothing = np.zeros((len(data.time), 6))
    return np.stack([found.get(name, nothing) for name in AIR_NAMES], axis=1)


def replayed(data, **entrants):
    return replay(data, entrants, flight="simulated")


def end_error(data, **assumed):
    """The rms error of the rates after a window, with numbers put in place of the true ones."""
    found = replayed(data, own=entrant(data, assumed=assumed))
    return error_growth([found], "own")[-1]


def test_the_true_vehicle_moves_as_it_was_flown(data):
    found = replayed(data, own=entrant(data))
    moved = error_growth([found], HOLD)[-1]
    assert (moved > 0.1).all()
    # The flown rates are smoothed at 30 Hz, and the rotor speed goes straight between samples.
    assert (error_growth([found], "own")[-1] < 0.02 * moved).all()
    assert (force_errors([found], "own") < 0.02).all()
    assert force_errors([found], HOLD)[2] > 0.5


@pytest.mark.parametrize(("name", "axis"), [("Ixx_com", 0), ("Iyy_com", 1), ("Izz_com", 2)])
def test_wrong_inertia_flies_visibly_worse(data, name, axis):
    right = end_error(data)
    true = INERTIA_COM[axis, axis]
    for factor in (0.8, 1.25):
        wrong = end_error(data, **{name: float(factor * true)})
        assert wrong[axis] > 8.0 * right[axis], factor


@pytest.mark.parametrize(
    ("name", "value", "axis"), [("Jr", 0.0, 2), ("com_x", 0.006, 1), ("kd", 0.8 * KD, 2)]
)
def test_every_number_counts(data, name, value, axis):
    assert end_error(data, **{name: value})[axis] > 2.0 * end_error(data)[axis]


def test_the_lever_of_the_imu_counts(data):
    right = force_errors([replayed(data, own=entrant(data))], "own")
    place = entrant(data)
    moved = replace(place, vehicle=replace(place.vehicle, imu=np.array([0.3, 0.0, 0.0])))
    wrong = force_errors([replayed(data, own=moved)], "own")
    assert (wrong > 3.0 * right).any()


def test_the_bias_of_the_accelerometer_is_in_it(data):
    offset = parameter("accel_bias_x", 0.5, "A")
    result = a_result()
    biased = replace(result, parameters=(*result.parameters, offset))
    found = replayed(data, own=entrant(data, biased))
    assert force_errors([found], "own")[0] == pytest.approx(0.5, abs=0.02)


def test_a_torque_that_does_not_change_is_in_it(data):
    torque = replace(parameter("Ixx", 2e-4, "A"), name="torque_offset_z", unit="N m")
    result = replace(a_result(), parameters=(*a_result().parameters, torque))
    found = replayed(data, own=entrant(data, result), without=entrant(data))
    one, other = (p.rates[:, -1, 2] for p in found.predicted)
    assert np.mean(one - other) == pytest.approx(0.5 * 2e-4 / INERTIA_COM[2, 2], rel=0.05)


def test_rotors_that_a_turn_drags_are_in_it():
    c = 2e-4
    flight = simulate_flight(replace(true_vehicle(), rotor_drag=c), PLACES, SHORT, seed=3)
    damped = exact_flight_data(flight, PLACES, specific_force_at="imu")
    result = replace(a_result(), parameters=(*a_result().parameters, parameter("rotor_drag", c)))
    own = replace(entrant(damped, result), air=air_as_flown(damped))
    found = replayed(damped, own=own, without=entrant(damped))
    moved = error_growth([found], HOLD)[-1]
    assert (error_growth([found], "own")[-1] < 0.02 * moved).all()
    assert error_growth([found], "without")[-1, 2] > 0.1 * moved[2]


def test_damping_of_yaw_is_in_it_where_the_velocity_is_known_too():
    """Of a vehicle that only turns it is the rotors' drag, but for its force off the CoM."""
    c = 2e-4
    flight = simulate_flight(true_vehicle(), PLACES, SHORT, seed=3)
    data = exact_flight_data(flight, PLACES, specific_force_at="imu")
    still = replace(data, velocity=np.zeros_like(data.velocity))
    own = {
        name: replace(
            entrant(still, replace(a_result(), parameters=(*a_result().parameters, added))),
            air=air_as_flown(still),
        )
        for name in ("rotor_drag", "yaw_damping")
        for added in (parameter(name, c),)
    }
    by_drag, by_damping, without = (
        one.rates[:, -1, 2] for one in replayed(still, **own, none=entrant(still)).predicted
    )
    damped = np.abs(by_damping - without).max()
    assert damped > 0.01
    assert np.abs(by_damping - by_drag).max() < 0.05 * damped


def test_the_band_is_of_the_covariance(data):
    kd_std = 0.02 * KD
    result = replace(a_result(), covariance_names=("kd",), covariance=np.array([[kd_std**2]]))
    found = replayed(data, own=entrant(data, result, draws=200))
    band = band_growth([found], "own")[-1]
    apart = end_error(data, kd=KD + kd_std) - end_error(data)
    assert band[2] > 10.0 * band[0]  # products of inertia carry a twentieth of it to roll
    # One standard deviation of kd, times 1.96, moves the yaw rate about as far.
    more = replayed(data, own=entrant(data, assumed={"kd": KD + kd_std}), none=entrant(data))
    one, other = (p.rates[:, -1, 2] for p in more.predicted)
    assert band[2] == pytest.approx(1.96 * np.sqrt(np.mean((one - other) ** 2)), rel=0.15)
    assert apart[2] > 0.0
    assert not replayed(data, own=entrant(data)).predicted[0].rates_std.any()


def test_draws_that_are_no_body_are_left_out(data):
    std = 1.5 * INERTIA["Ixx"]
    result = replace(a_result(), covariance_names=("Ixx@A",), covariance=np.array([[std**2]]))
    stack = replay_vehicle(result, "A", draws=30)
    assert len(stack.mass) == 31
    assert (np.linalg.eigvalsh(stack.inertia)[:, 0] > 0).all()
    assert np.ptp(stack.inertia[:, 0, 0]) > 0.0


def test_the_same_seed_draws_the_same_vehicles():
    result = replace(
        a_result(), covariance_names=("kd",), covariance=np.array([[(0.02 * KD) ** 2]])
    )
    one, other = (replay_vehicle(result, "A", draws=5).torque for _ in range(2))
    assert (one == other).all()


def test_windows_stay_within_segments(data):
    cut = replace(data, segments=(Segment(start=100, stop=450), Segment(start=900, stop=1210)))
    starts = window_starts(cut, 100)
    assert starts.tolist() == [100, 200, 300, 900, 1000, 1100]
    long = replace(data, segments=(Segment(start=0, stop=2400),))
    assert len(window_starts(long, 3)) == MOST_WINDOWS


def test_a_flight_too_short_is_refused(data):
    short = replace(data, segments=(Segment(start=100, stop=150),))
    with pytest.raises(FlightError, match="no airborne stretch is as long as a window"):
        replayed(short, own=entrant(data))


def test_flights_logged_at_different_rates_are_pooled(data):
    every = slice(None, None, 2)
    slow = replace(
        data,
        sample_rate=data.sample_rate / 2,
        time=data.time[every],
        specific_force=data.specific_force[every],
        angular_velocity=data.angular_velocity[every],
        angular_acceleration=data.angular_acceleration[every],
        rotor_speed=data.rotor_speed[every],
        rotor_acceleration=data.rotor_acceleration[every],
        velocity=None,
        segments=(Segment(start=10, stop=1100),),
    )
    both = [replayed(d, own=entrant(d)) for d in (data, slow)]
    assert error_growth(both, "own").shape == (51, 3)
    assert growth_time(both)[[0, -1]].tolist() == pytest.approx([0.0, 0.5])


def test_what_is_not_known_is_not_flown():
    with pytest.raises(ExperimentError, match="kd, Izz_com of configuration A"):
        replay_vehicle(changed(a_result(), **YAW_LOST), "A")
    # The height of a CoM that is not known is not that of the origin.
    with pytest.raises(ExperimentError, match="com_z of configuration A: not known"):
        replay_vehicle(changed(a_result(), msz={"value": None}, com_z={"value": None}), "A")
    light = changed(a_result(), Ixx={"value": 1e-6}, Ixx_com={"value": 1e-6})
    with pytest.raises(ExperimentError, match="no body has the inertia"):
        replay_vehicle(light, "A")


def test_per_kilogram_becomes_absolute_with_an_assumed_mass():
    whole = replay_vehicle(a_result(), "A")
    heavy = {"kt", "kd", "Jr", "msx", "msy", "msz", *INERTIA, *(f"kt_{i}" for i in range(1, 5))}
    light = a_result()
    light = replace(
        light,
        parameters=tuple(
            replace(p, value=None, verdict="not-identified")
            if p.name == "mass"
            else replace(p, value=p.value / MASS)
            if p.name in heavy
            else p
            for p in light.parameters
        ),
    )
    again = replay_vehicle(light, "A", assumed={"mass": MASS})
    for field in ("com", "inertia", "torque", "thrust"):
        np.testing.assert_allclose(getattr(again, field), getattr(whole, field), rtol=1e-9)


def test_an_unknown_product_is_that_of_a_symmetric_frame():
    lost = changed(a_result(), Ixy={"value": None}, Ixy_com={"value": None})
    assert unknown_body(a_result(), "A") == {}
    assert unknown_body(lost, "A") == {"Ixy_com": 0.0}
    assert unknown_body(lost, "A", {"Ixy_com": 1e-4}) == {}
    assert replay_vehicle(lost, "A").inertia[0, 0, 1] == 0.0


def test_an_unknown_centre_is_that_of_the_rotors():
    """A hover of like rotors holds the CoM in their middle, wherever the IMU is."""
    middle = np.mean([place for place, _ in ROTORS], axis=0)
    lost = changed(a_result(), msx={"value": None}, com_x={"value": None})
    assert hover_centre(a_result(), "A") == {}
    assert hover_centre(lost, "A") == {"com_x": pytest.approx(middle[0])}
    assert hover_centre(lost, "A", {"com_x": 0.02}) == {}
    assert replay_vehicle(lost, "A").com[0].tolist() == pytest.approx([middle[0], *COM[1:]])
    centers = (parameter("rotor_center_x", 0.02, "A"), parameter("rotor_center_y", 0.0, "A"))
    own = a_result(imu=None)
    own = replace(own, parameters=(*own.parameters, *centers))
    without_y = changed(own, rotor_center_y={"value": None})
    assert hover_centre(without_y, "A") == {"rotor_center_y": pytest.approx(COM[1] - middle[1])}
    without_com = changed(own, msx={"value": None}, com_x={"value": None})
    assert hover_centre(without_com, "A") == {"com_x": pytest.approx(middle[0] + 0.02)}
    neither = changed(
        own, msx={"value": None}, com_x={"value": None}, rotor_center_x={"value": None}
    )
    assert hover_centre(neither, "A") == {"com_x": pytest.approx(middle[0]), "rotor_center_x": 0.0}


def test_the_air_pushes_and_turns_about_the_centre_of_mass(data):
    """A wrench about the origin: its torque about the CoM is that of a constant torque offset."""
    torque, force, unit = np.array([2e-3, -1e-3, 5e-4]), np.array([0.3, -0.2, 0.1]), 4e-5
    own = entrant(data)
    coefficients = np.zeros_like(own.vehicle.air)
    coefficients[:, AIR_NAMES.index("rotor_drag")] = unit
    wrench = np.zeros((len(data.time), len(AIR_NAMES), 6))
    whole = np.concatenate([force, torque + np.cross(COM, force)])
    wrench[:, AIR_NAMES.index("rotor_drag")] = whole / unit
    blown = replace(own, vehicle=replace(own.vehicle, air=coefficients), air=wrench)
    offset = replace(own, vehicle=replace(own.vehicle, offset=own.vehicle.offset + torque))
    found = replayed(data, own=own, blown=blown, offset=offset).predicted
    still, moved, turned = found
    np.testing.assert_allclose(moved.rates, turned.rates, rtol=1e-9, atol=1e-12)
    assert np.abs(moved.rates - still.rates).max() > 0.01
    felt = turned.force + force / MASS
    np.testing.assert_allclose(moved.force, felt, rtol=1e-9, atol=1e-12)


def test_the_wrench_of_the_air_replaces_the_drag_of_turns(data):
    """The drag of rotors that a turn carries is in that wrench already."""
    own = entrant(data)
    damped = replace(own.vehicle, damping=np.full_like(own.vehicle.damping, 1e-4))
    calm = np.zeros((len(data.time), len(AIR_NAMES), 6))
    found = replayed(data, own=own, calm=replace(own, vehicle=damped, air=calm)).predicted
    np.testing.assert_array_equal(found[1].rates, found[0].rates)
