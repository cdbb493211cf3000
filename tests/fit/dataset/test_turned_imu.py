"""A turned IMU is refused where the flight shows it, and no calm flight is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flown
import made_fit
from rotorfit.errors import FrameError
from rotorfit.fit.dataset.response_signals import CLEAR, inside_band
from rotorfit.fit.dataset.turned_imu import TURNED, refuse_turned, std_of_turn, turn_about_z
from rotorfit.fit.reduction.frequency_bands import prepared_bands
from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.model.signals import signal_layout

RATE = 100.0
SECONDS = 8.0


def calm_flight(random, seconds, *, turned=0.0, sticks=0.0):
    """Fly a hover that gusts disturb: angular accelerations and rotors of unlike strength.

    The rotors answer the rates and angles of the three axes behind a lag, and the log has them up
    to 10 ms early or late. `turned`: of the readings about z [rad]: the IMU is turned the other
    way. `sticks`: rms of the angles that a pilot asks for every .7 s [rad].
    """
    n, dt = round(seconds * RATE), 1.0 / RATE
    lag, memory = random.uniform(0.03, 0.1), random.uniform(0.03, 0.3)
    gain = random.uniform(0.3, 0.7) / lag * np.array([1.0, random.uniform(0.7, 1.3), 0.4])
    back = random.uniform(1.0, 4.0)
    strength = random.uniform(0.5, 3.0) * np.array([1.0, random.uniform(0.5, 2.0), 0.4])
    noise = random.uniform(0.002, 0.03)
    asked = np.repeat(random.normal(0.0, sticks, (n // 70 + 1, 3)), 70, axis=0)
    shocks = strength * np.sqrt(2.0 * dt / memory) * random.normal(size=(n, 3))
    gyro_noise = noise * random.normal(size=(n, 3))
    rate, angle, torque, gust = np.zeros((4, 3))
    rates, turns, torques = np.zeros((3, n, 3))
    for k in range(n):
        gust = gust * (1.0 - dt / memory) + shocks[k]
        command = gain * (back * (asked[k] - angle) - rate - gyro_noise[k])
        torque = torque + dt / lag * (command - torque)
        turns[k], torques[k] = torque + gust, torque
        rate = rate + dt * turns[k]
        angle = angle + dt * rate
        rates[k] = rate
    time = dt * np.arange(n)
    late = random.uniform(-0.01, 0.01)
    torques = np.column_stack([np.interp(time - late, time, one) for one in torques.T])
    return as_flight(time, rates + gyro_noise, turns, torques, turned)


def as_flight(time, rates, turns, torques, turned):
    """Return a flight of the rotors that make these torques, logged by a turned IMU."""
    x, y = made_fit.QUAD.positions[:, :2].T
    mixer = np.linalg.pinv(np.stack([y, -x, -0.05 * made_fit.QUAD.spins]))
    speed = 500.0 * np.sqrt(np.clip(1.0 + 3e-4 * torques @ mixer.T, 0.1, None))
    c, s = np.cos(turned), np.sin(turned)
    back = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    data = FlightData(
        sample_rate=RATE,
        time=time,
        specific_force=np.tile([0.0, 0.0, 9.80665], (len(time), 1)),
        angular_velocity=rates @ back.T,
        angular_acceleration=turns @ back.T,
        rotor_speed=speed,
        rotor_acceleration=np.gradient(speed, 1.0 / RATE, axis=0),
        differentiation="exact",
        segments=(Segment(start=0, stop=len(time)),),
    )
    return prepared_bands(made_fit.as_prepared(data, motor_rate=RATE), made_fit.QUAD, None)


def is_refused(factors):
    try:
        refuse_turned(factors, made_fit.QUAD)
    except FrameError as error:
        assert "IMU were turned by" in str(error)
        return True
    return False


@pytest.fixture(scope="module")
def calm_flights():
    random = np.random.default_rng(11)
    return [calm_flight(random, random.choice([2.5, 4.0, 8.0])) for _ in range(150)]


def test_no_calm_flight_is_refused(calm_flights):
    """Of 150, 5 or more look turned by over 12 degrees, though their motors explain the turns."""
    found = [turn_about_z(inside_band(one), made_fit.QUAD) for one in calm_flights]
    assert sum(abs(angle) > TURNED and min(shares) > CLEAR for angle, shares in found) >= 5
    assert sum(is_refused(one) for one in calm_flights) <= 1


def test_the_deviation_of_the_angle_is_that_of_calm_flights(calm_flights):
    ratios = []
    for one in calm_flights:
        angle, shares = turn_about_z(inside_band(one), made_fit.QUAD)
        if min(shares) > CLEAR:
            ratios.append(angle / std_of_turn(one, made_fit.QUAD))
    assert len(ratios) > 25
    # Of the two angles that each torque shows the lesser is taken, and so some are zero.
    assert 0.8 < np.mean(np.abs(ratios) < 1.96) < 1.0


def test_a_turned_imu_is_refused_where_somebody_steers():
    random = np.random.default_rng(12)
    flights = [calm_flight(random, 8.0, turned=np.radians(45.0), sticks=0.2) for _ in range(30)]
    angles = [turn_about_z(inside_band(one), made_fit.QUAD)[0] for one in flights]
    assert np.degrees(np.median(angles)) == pytest.approx(-45.0, abs=5.0)
    assert sum(is_refused(one) for one in flights) >= 20


def test_a_turned_hexarotor_is_told_of_its_own_layouts(tmp_path):
    flight = flown.simulated("hexa-x", "noisy", seed=2, seconds=SECONDS)
    turn = Rotation.from_euler("z", 30.0, degrees=True)
    rotors = [
        replace(rotor, position=tuple(turn.apply(rotor.position).tolist()))
        for rotor in flight.vehicle.rotors
    ]
    with pytest.raises(FrameError, match="hexa-plus instead of hexa-x"):
        flown.identified(tmp_path, [flight], vehicle=replace(flight.vehicle, rotors=tuple(rotors)))


def test_a_turn_that_one_torque_alone_shows_is_none():
    """Of an axis that nobody flies the autopilot's answer points anywhere."""
    rng, vehicle = (
        np.random.default_rng(9),
        flown.simulated("quad-x", seed=1, seconds=SECONDS).vehicle,
    )
    layout = signal_layout(vehicle)
    lever = np.cross(vehicle.positions, vehicle.axes)[:, :2]
    torque = rng.normal(size=(400, 2))
    R = np.zeros((400, len(layout)))
    columns = [layout.index(f"O2_{i + 1}") for i in range(4)]
    R[:, columns] = torque @ np.linalg.pinv(lever)
    turned = np.radians(25.0)
    back = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
    places = [layout.index("dwx"), layout.index("dwy")]
    R[:, places] = torque @ back
    angle, _ = turn_about_z(R, vehicle)
    assert abs(angle) == pytest.approx(turned)
    back[1] = [0.0, 1.0]
    R[:, places] = torque @ back
    assert turn_about_z(R, vehicle)[0] == pytest.approx(0.0, abs=1e-12)
