"""What a result doubts about itself: silent on sound flights, and it names what was made wrong."""

from dataclasses import replace

import numpy as np
import pytest

import flown
import made_fit
from rotorfit.checks.hover_thrust import doubt_unreached, hovers_differ, thrust_sags
from rotorfit.fit.dataset.weight_balance import Held, held_up, pooled, turning
from rotorfit.fit.weight.hover_thrusts import HoverThrust, thrust_over_weight
from rotorfit.flight.airborne import GRAVITY
from rotorfit.simulation import (
    Scenario,
    paper_vehicle,
    sampled_flight_data,
    simulate_flight,
    variant,
    write_flight_table,
)

PAYLOAD = """payload_of = "A"
payload = [
  { mass = 0.125, position = [%g, 0.0, -0.028], mass_std = 0.0005, position_std = 0.002 },
  { mass = 0.042, position = [0.0, -0.40, -0.028], mass_std = 0.0005, position_std = 0.002 },
]
"""
SHORT = {"seconds": 30.0, "ground_seconds": 2.0, "physics_rate": 200.0}


@pytest.fixture(scope="module")
def flights():
    """Return one flight of A and one of B, with gusts, unequal rotors, drag and a biased IMU."""
    return {
        name: flown.simulated(name, "real", seed=seed, **SHORT)
        for name, seed in (("A", 21), ("B", 22))
    }


@pytest.fixture
def doubts(tmp_path):
    """Return a function that identifies flights of A and B, and returns result and warnings."""

    def identified(flights, *, mass=1.285, arm=1.0, payload=""):
        vehicle = next(iter(flights.values())).vehicle
        rotors = tuple(
            replace(r, position=tuple(arm * x for x in r.position)) for r in vehicle.rotors
        )
        text = flown.airframe_table(replace(vehicle, rotors=rotors)) + "[motors]\ndelay = 0.0\n"
        for name, flight in flights.items():
            write_flight_table(flight, tmp_path / f"{name}.csv")
            text += f'[[configuration]]\nname = "{name}"\nflights = ["{name}.csv"]\n'
            text += f"mass = {mass if name == 'A' else 1.452}\n"
        path = tmp_path / "experiment.toml"
        path.write_text(text + payload)
        return flown.quietly_identified(path)

    return identified


def test_sound_flights_raise_no_doubt(flights, doubts):
    result = doubts(flights, payload=PAYLOAD % 0.372)
    assert result.warnings == ()
    said = result.diagnostics
    assert said["thrust_over_weight"] == pytest.approx(1.0, abs=0.01)
    # The variant's accelerometer is biased by 0.1 m/s^2.
    for name in ("A", "B"):
        bias = said[f"accelerometer_over_gravity@{name}"]
        assert bias == pytest.approx(1.0 + 0.1 / GRAVITY, abs=0.004)
        assert abs(said[f"yaw_trim@{name}"]) < 0.01
        assert 0.02 < said[f"smallest_second_moment@{name}"] < 0.5
    assert said["payload_probability@B"] > 1e-3
    half = said["arm_factor_half_width@B"]
    assert abs(said["arm_factor@B"] - 1.0) < 1.5 * half
    assert half < 0.03
    assert 5.0 < said["condition_bodies"] < 30.0


def test_a_misplaced_payload_is_reported_with_moment_and_amount(flights, doubts, assert_wording):
    (words,) = doubts(flights, payload=PAYLOAD % 0.33).warnings
    assert_wording(words)
    assert "msx of A, the flights" in words or "Iyy of A, the" in words
    assert "flights say 0.04" in words or "Iyy of A, the" in words


def test_a_known_payload_shows_a_wrong_arm(flights, doubts, assert_wording):
    result = doubts(flights, arm=0.94, payload=PAYLOAD % 0.372)
    assert result.diagnostics["arm_factor@B"] == pytest.approx(0.94, abs=0.02)
    (words,) = result.warnings
    assert_wording(words)
    percent = float(words.split(" %")[0].split()[-1])
    assert percent == pytest.approx(6.0, abs=2.0)


def test_a_wrong_accelerometer_scale_shows_in_the_weight(flights, doubts):
    """By 8 %: kt is nearer to the weight's, which is right, and its interval reaches both."""
    wrong = {name: replace(f, accel=0.92 * f.accel) for name, f in flights.items()}
    result = doubts(wrong)
    assert result.diagnostics["thrust_over_weight"] == pytest.approx(0.92, abs=0.015)
    assert any(" by the weight" in words for words in result.warnings)
    low, high = result.parameter("kt").interval
    true = flights["A"].truth.kt
    assert low < 0.93 * true < true < high
    assert low + high == pytest.approx(2.0 * true, rel=0.04)
    assert high - low < 0.18 * true


def test_accelerometer_bias_is_distinguished_from_a_wrong_scale(flights, doubts, assert_wording):
    biased = {
        name: replace(f, accel=f.accel + np.array([0, 0, 0.3])) for name, f in flights.items()
    }
    result = doubts(biased)
    (words,) = result.warnings
    assert "reads 10.1" in words
    assert_wording(words)
    assert "where gravity is 9.81" in words
    assert result.diagnostics["thrust_over_weight"] == pytest.approx(1.0, abs=0.01)


def test_a_wrong_mass_of_one_configuration_is_seen_in_hover(flights, doubts, assert_wording):
    (words,) = (one for one in doubts(flights, mass=1.05 * 1.285).warnings if "hovers on" in one)
    assert words.startswith("B (B.csv) hovers on ")
    assert float(words.split("hovers on ")[1].split(" +-")[0]) == pytest.approx(5.0, abs=1.0)
    assert_wording(words)


def test_a_vibration_is_named_with_its_frequency(flights, doubts, assert_wording):
    shake = 0.03 * np.sin(2 * np.pi * 12.3 * flights["A"].time)[:, None] * [1.0, 0.0, 0.0]
    shaken = replace(flights["A"], gyro=flights["A"].gyro + shake)
    (words,) = doubts({"A": shaken}).warnings
    assert "roll moves at 12." in words
    assert_wording(words)


def test_tilted_motors_are_found_from_the_steady_yaw_torque(doubts, assert_wording):
    (truth, vehicle), sensors = variant(paper_vehicle("A"), "real")
    tilt = np.radians(1.0)
    rotors = tuple(
        replace(r, axis=(-np.sin(tilt) * np.sign(y), np.sin(tilt) * np.sign(x), np.cos(tilt)))
        for r in vehicle.rotors
        for x, y, _ in [r.position]
    )
    twisted = replace(vehicle, rotors=rotors)
    flight = simulate_flight(truth, twisted, Scenario(sensors=sensors, **SHORT), seed=5)
    result = doubts({"A": replace(flight, vehicle=vehicle)})
    # Their steady torque kt O^2 d sin(tilt) is held by k_d times the difference.
    expected = 0.2 * np.sin(tilt) * truth.kt / truth.kd
    assert result.diagnostics["yaw_trim@A"] == pytest.approx(expected, rel=0.05)
    twist = result.parameter("twist", "A")
    assert twist.std < 0.07 * twist.value
    assert twist.interval[0] < 0.2 * np.sin(tilt) < twist.interval[1]
    assert any("by 1.0" in words for words in result.warnings)
    assert_wording(result.warnings)
    # Without the term, k_d is lost: 0.2 degrees took a quarter of it.
    low, high = result.parameter("kd").interval
    assert low < truth.kd < high
    assert result.parameter("kd").value == pytest.approx(truth.kd, rel=0.1)


def test_the_mean_force_in_axes_that_do_not_turn_is_gravity():
    flight = flown.simulated("A", "clean", seed=3, **SHORT)
    data = sampled_flight_data(flight)
    held = held_up(turning(data), data.specific_force)
    (segment,) = data.segments
    rise = flight.velocity[segment.stop - 1, 2] - flight.velocity[segment.start, 2]
    expected = 1.0 + rise / (len(segment) / data.sample_rate) / GRAVITY
    assert held.ratio == pytest.approx(expected, abs=5e-4)
    # Without turning, the tilt would be missing.
    rows = slice(segment.start, segment.stop)
    assert data.specific_force[rows, 2].mean() / GRAVITY > held.ratio + 0.005
    # A gyro's bias of half a degree a second does no harm, in whatever direction.
    bias = np.array([0.008, -0.008, 0.008])
    drifting = replace(data, angular_velocity=data.angular_velocity + bias)
    assert held_up(turning(drifting), data.specific_force).ratio == pytest.approx(
        held.ratio, abs=1e-3
    )
    assert held_up(turning(replace(data, segments=())), data.specific_force) is None


def thrust(name, ratio, *, std=0.002, sag=0.0):
    held = Held(ratio=ratio, std=std, seconds=60.0)
    return HoverThrust(
        configuration=name, flight=f"x/{name}1.csv", thrust=held, sag=sag, sag_std=0.004
    )


@pytest.mark.parametrize("gained", [5.0, -5.0])
def test_a_throw_hovers_on_its_weight(gained):
    """5 m/s braked in the first of 8 s, or fallen in it: 6.4 % of the weight on average."""
    force = np.tile([0.0, 0.0, GRAVITY], (800, 1))
    force[:100, 2] += gained
    prepared = made_fit.prepared(seconds=8.0, force=force)
    [configured] = made_fit.dataset(prepared).configurations
    [flight] = configured.flights
    found = thrust_over_weight(flight, prepared.data, force, "imu")
    plain = held_up(flight.turning, force)
    assert abs(plain.ratio - 1.0) == pytest.approx(5.0 / 8.0 / GRAVITY, rel=0.01)
    assert abs(plain.ratio - 1.0) > 3.0 * plain.std
    assert found.ratio == pytest.approx(1.0, abs=0.01)
    assert abs(found.ratio - 1.0) < 1.96 * found.std < 0.05


@pytest.mark.parametrize(("reach", "doubtful"), [(0.05, True), (0.15, False)])
def test_a_hover_that_kt_does_not_reach_makes_it_doubtful(reach, doubtful):
    """Each of two payloads declared as heavy as both: kt 11 % off, identified to 6 %."""
    found = [thrust("A", 1.12), thrust("B", 0.99)]
    said = doubt_unreached(hovers_differ(found, by_battery=False), found, reach=reach)
    assert (said.doubtful_because is not None) is doubtful
    assert said.is_about("Ixx@B") is doubtful
    alike = [thrust("A", 1.12), thrust("B", 1.12)]
    passed = doubt_unreached(hovers_differ(alike, by_battery=False), alike, reach=reach)
    assert passed.doubtful_because is None


def test_flights_that_hover_alike_raise_no_doubt(assert_wording):
    alike = hovers_differ(
        [thrust("A", 1.0), thrust("A", 1.008), thrust("B", 0.999)], by_battery=True
    )
    assert (alike.severity, alike.sentence) == ("passed", "")
    assert alike.diagnostics["largest_hover_ratio"] == pytest.approx(1.008 / 0.999)
    unlike = [thrust("A", 1.0), thrust("A", 1.06)]
    words = hovers_differ(unlike, by_battery=True).sentence
    assert "A1.csv hovers on 6.0" in words
    assert_wording(words)
    assert "battery" in words
    assert "battery" not in hovers_differ(unlike, by_battery=False).sentence
    both = pooled([Held(ratio=1.0, std=0.1, seconds=5.0), Held(ratio=2.0, std=0.2, seconds=7.0)])
    assert both.ratio == pytest.approx(1.2)
    assert both.std == pytest.approx(0.1 * 0.8**0.5)
    assert both.seconds == 12.0


def test_a_sagging_battery_is_said(assert_wording):
    assert thrust_sags([thrust("A", 1.0, sag=0.01)], by_battery=True).severity == "passed"
    both = [thrust("A", 1.0, sag=0.01), thrust("B", 1.0, sag=0.08)]
    measured = thrust_sags(both, by_battery=False).sentence
    assert_wording(measured)
    sag = thrust_sags(both, by_battery=True)
    words = sag.sentence
    assert sag.diagnostics["thrust_change"] == pytest.approx(0.16)
    assert words.startswith("B (B1.csv): the")
    assert "give 16 %" in words
    assert_wording(words)
    assert "log rotor speed" in words
    risen = thrust_sags([thrust("A", 1.0, sag=-0.08)], by_battery=True).sentence
    assert "battery" not in risen
    # The voltage that the log has was to be logged.
    has_it = thrust_sags(both, by_battery=True, has_voltage=True).sentence
    assert "and log that" in words
    assert "which is in the log" in has_it
