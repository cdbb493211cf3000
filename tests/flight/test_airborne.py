from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from hand_made_logs import (
    COMMANDED,
    HOVER,
    G,
    channel,
    flight_log,
    hover_thrust,
    motion_log,
    prepared,
    spans,
)
from rotorfit.errors import FlightError
from rotorfit.flight.airborne import phase_edges
from rotorfit.flight.motors.motor_model import MotorModel
from rotorfit.flight.prepare import prepare
from rotorfit.flight.signals import smooth
from rotorfit.logs.read import read_log
from rotorfit.simulation import (
    STILL,
    Scenario,
    layout_vehicle,
    paper_vehicle,
    simulate_flight,
    to_flight_log,
    variant,
)


def airborne(log, **options):
    return spans(prepared(log, **options))


# Simulated flights from the ground


@pytest.fixture(scope="module", params=[("paper", 0), ("paper", 1), ("paper", 2), ("hexa-x", 3)])
def ground_flight(request):
    layout, seed = request.param
    vehicle = paper_vehicle("B") if layout == "paper" else layout_vehicle(layout)
    vehicle, sensors = variant(vehicle, "real")
    sensors = replace(sensors, gyro_bias=(0.01, -0.02, 0.03))
    scenario = Scenario(seconds=8.0, ground_seconds=2.0, sensors=sensors)
    return simulate_flight(*vehicle, scenario, seed=seed)


@pytest.mark.parametrize("motors", [MotorModel(), COMMANDED], ids=["measured", "commanded"])
def test_take_off_and_landing_are_found_and_no_ground_is_used(ground_flight, motors):
    flight = ground_flight
    rotors = flight.rotor_speed.shape[1]
    result = prepared(to_flight_log(flight), rotors=rotors, motors=motors)
    ((start, end),) = spans(result)
    first, last = flight.time[flight.airborne][[0, -1]]
    assert first <= start < first + 0.3
    assert last - 0.3 < end <= last
    used = np.zeros(len(flight.time), dtype=bool)
    for segment in result.data.segments:
        used[segment.start : segment.stop] = True
    assert not (used & ~flight.airborne).any()
    assert [cut.reason for cut in result.cuts] == ["not airborne", "not airborne"]


def test_the_bias_of_the_gyro_at_rest_is_taken_off(ground_flight):
    result = prepared(to_flight_log(ground_flight), rotors=ground_flight.rotor_speed.shape[1])
    assert result.gyro_bias == pytest.approx((0.01, -0.02, 0.03), abs=4 * 0.02 / np.sqrt(250))
    row = len(result.data.time) // 2
    difference = ground_flight.gyro[row] - result.data.angular_velocity[row]
    assert difference == pytest.approx(result.gyro_bias)
    assert not any("rest" in doubt for doubt in result.warnings)


def test_a_log_that_begins_and_ends_in_the_air_is_used_whole():
    vehicle, sensors = variant(paper_vehicle("A"), "noisy")
    flight = simulate_flight(*vehicle, Scenario(seconds=8.0, sensors=sensors), seed=4)
    result = prepared(to_flight_log(flight))
    assert spans(result) == [(pytest.approx(0.005), pytest.approx(7.99))]
    assert result.gyro_bias is None
    assert "gyro bias not removed" in result.warnings[0]
    assert result.cuts == ()


# Hand-made motion: thrust over weight, and the force where something else pushes, too


def test_a_throw_keeps_its_free_fall_and_its_pulses():
    rate, rng = 500.0, np.random.default_rng(0)
    t = np.arange(int(8 * rate)) / rate
    idle = 0.01
    thrust = np.select([t < 1.5, t < 1.8, t < 2.3, t < 2.7], [idle, idle, idle, 1.8], 1.0)
    thrust = thrust + np.where(t > 2.7, 0.1 * np.sin(5 * t), 0.0)
    speed = HOVER * np.sqrt(thrust)[:, None] * (1 + 0.03 * np.sin(np.outer(t, (3, 4, 5, 6))))
    for motor in range(4):  # one motor after the other, 0.1 s each
        on = (t > 1.85 + 0.11 * motor) & (t < 1.95 + 0.11 * motor)
        speed[on, motor] = 1.2 * HOVER
    force = np.zeros((t.size, 3))
    force[:, 2] = G * (speed**2).sum(axis=1) / (4 * HOVER**2)
    held, thrown = t < 1.35, (t >= 1.35) & (t < 1.6)
    force[held] = (0.0, 0.0, G)
    force[thrown] = (3.0, 1.0, 25.0)
    force += 0.3 * rng.normal(size=force.shape)
    turning = np.where((t > 1.6) & (t < 3.0), 8.0, 0.3)[:, None]
    rates = turning * np.sin(np.outer(t, (9.0, 11.0, 6.0)))
    log = flight_log(
        gyro=channel(t, rates + 0.01 * rng.normal(size=rates.shape)),
        accel=channel(t, force),
        rotor_speed=channel(t, speed),
    )
    result = prepared(log)
    ((start, end),) = spans(result)
    assert 1.6 <= start < 1.72
    assert end > 7.99
    edges = [result.data.time[phase.start] for phase in result.phases]
    assert len(edges) >= 2
    assert any(2.7 < edge < 3.7 for edge in edges)  # the lively part is a phase of its own


def test_a_hard_bump_in_mid_flight_is_cut():
    thrust = hover_thrust(12)
    t = np.arange(len(thrust)) / 200
    force = np.zeros((len(t), 3))
    force[:, 2] = G * thrust
    force[(t > 6.0) & (t < 6.1)] += (60.0, 20.0, 40.0)
    before, after = airborne(motion_log(thrust, force=force))
    assert before[0] < 0.01 and 5.8 < before[1] < 6.0
    assert 6.1 < after[0] < 6.3 and after[1] > 11.98


def test_a_soft_gust_is_bridged():
    thrust = hover_thrust(12)
    t = np.arange(len(thrust)) / 200
    force = np.zeros((len(t), 3))
    force[:, 2] = G * thrust
    force[(t > 6.0) & (t < 6.08)] += (0.0, 9.0, 0.0)
    assert len(airborne(motion_log(thrust, force=force))) == 1


def test_fast_flight_with_drag_is_not_contact():
    """At 8 m/s the drag is 3 m/s^2, and the inflow takes a tenth of the thrust or adds to it."""
    thrust = hover_thrust(20, swing=0.3)
    t = np.arange(len(thrust)) / 200
    force = np.zeros((len(t), 3))
    force[:, 0] = -3.0 * np.sin(0.8 * t)
    force[:, 1] = 2.0 * np.cos(0.5 * t)
    force[:, 2] = G * thrust * (1 + 0.1 * np.sin(0.4 * t))
    assert len(airborne(motion_log(thrust, force=force))) == 1


def test_pull_ups_of_3_g_and_flips_of_10_rad_s_are_no_contact():
    t = np.arange(20 * 200) / 200
    thrust = 1 + np.where(t % 5 > 4, 2.0 * np.sin(np.pi * (t % 5 - 4)), 0.0)
    thrust = np.where((t % 5 > 2) & (t % 5 < 2.6), 0.15, thrust)
    rates = 0.3 * np.sin(np.outer(t, (5, 6, 3)))
    rates[(t % 5 > 2) & (t % 5 < 2.6), 0] += 10.0
    lever = 0.02 * (rates**2).sum(axis=1)
    force = np.stack([-lever, 0.5 * lever, G * thrust * (1 - 0.1 * (thrust > 2))], axis=1)
    assert len(airborne(motion_log(thrust, force=force, rates=rates))) == 1


def test_commands_that_lead_the_force_by_80_ms_are_not_contact():
    from rotorfit.flight.motors.motor_model import first_order_lag

    rng = np.random.default_rng(5)
    asked = np.repeat(rng.uniform(0.3, 2.2, 100), 60)
    t = np.arange(len(asked)) / 200
    thrust = first_order_lag(np.sqrt(asked)[:, None], 200.0, 0.08)[:, 0] ** 2
    force = np.zeros((len(t), 3))
    force[:, 2] = G * thrust
    log = motion_log(asked, force=force, name="command")
    assert len(airborne(log, motors=COMMANDED)) == 1


@pytest.mark.parametrize("swing", [0.0, 0.6])
def test_a_short_flight_after_minutes_on_the_ground_is_found(swing):
    """Motors idle, or are blipped, for three minutes; then ten seconds of flight."""
    t = np.arange(200 * 200) / 200
    blips = np.where(t % 20 < 1, swing, 0.0)
    thrust = np.where((t > 185) & (t < 195), 1 + 0.1 * np.sin(5 * t), 0.06 + blips)
    force = np.zeros((len(t), 3))
    flying = (t > 185) & (t < 195)
    force[:, 2] = np.where(flying, G * thrust, G)
    rates = np.where(flying[:, None], 0.3 * np.sin(np.outer(t, (4, 5, 3))), 0.0)
    ((start, end),) = airborne(motion_log(thrust, force=force, rates=rates))
    assert 185 <= start < 185.3
    assert 194.7 < end <= 195


def test_standing_with_motors_near_the_weight_is_not_flight():
    t = np.arange(20 * 200) / 200
    thrust = np.where(t < 2, 0.1, np.where(t < 10, 0.85, 1 + 0.1 * np.sin(5 * t)))
    force = np.zeros((len(t), 3))
    force[:, 2] = np.where(t < 10, G, G * thrust)
    rates = np.where(t[:, None] < 10, 0.0, 0.3 * np.sin(np.outer(t, (4, 5, 3))))
    ((start, end),) = airborne(motion_log(thrust, force=force, rates=rates))
    assert 10 <= start < 10.3
    assert end > 19.98


# What is no flight


def test_motors_that_never_turn_are_refused(assert_text):
    with pytest.raises(FlightError) as refused:
        prepared(
            motion_log(np.zeros(2000), force=np.tile([0.0, 0.0, G], (2000, 1)), name="command"),
            motors=COMMANDED,
        )
    assert_text(str(refused.value))


@pytest.mark.parametrize("noise", [0.0, 2.0, 5.0])
def test_motors_that_idle_on_the_ground_only_are_refused(noise, assert_text):
    rng = np.random.default_rng(0)
    t = np.arange(4000) / 200
    log = flight_log(
        gyro=channel(t, 0.01 * rng.normal(size=(4000, 3))),
        accel=channel(t, (0, 0, G) + 0.3 * rng.normal(size=(4000, 3))),
        rotor_speed=channel(t, 200 + noise * rng.normal(size=(4000, 4))),
    )
    with pytest.raises(FlightError) as refused:
        prepared(log)
    why = (
        "it does not turn at all, and its thrust stays the same"
        if noise > 4
        else "the motors run at one speed throughout, as on the ground or in a hand"
    )
    assert why in str(refused.value)
    assert_text(str(refused.value))


def test_motors_blipped_on_the_ground_are_refused():
    t = np.arange(6000) / 200
    thrust = 0.1 + 0.3 * (t % 4 < 2)
    force = np.tile([0.0, 0.0, G], (6000, 1))
    with pytest.raises(FlightError, match=r"never flies|no airborne part"):
        prepared(motion_log(thrust, force=force, rates=np.zeros((6000, 3))))


def test_a_vehicle_roped_down_at_full_weight_is_refused():
    t = np.arange(6000) / 200
    log = motion_log(1 + 0.15 * np.sin(3 * t), force=np.tile([0.0, 0.0, G], (6000, 1)))
    with pytest.raises(FlightError, match="its acceleration does not follow the rotors"):
        prepared(log)


@pytest.mark.parametrize("drift", [0.3, 0.0])
def test_commands_that_grow_as_the_battery_sags_are_flight(drift):
    """The thrust of a still hover stays the same while its commands grow."""
    t = np.arange(6000) / 200
    rng = np.random.default_rng(2)
    wanted = 1.0 + 0.03 * np.sin(np.outer(t, (5.0, 7.0)))[:, 0]
    force = np.tile([0.0, 0.0, G], (6000, 1)) + 0.1 * rng.normal(size=(6000, 3))
    force[:, 2] += G * (wanted - 1.0)
    log = motion_log(
        wanted * (1.0 + drift * t / t[-1]),
        force=force,
        rates=0.03 * np.sin(np.outer(t, (5.0, 7.0, 3.0))),
    )
    assert prepared(log).data.seconds_used > 25.0


@pytest.mark.parametrize("level", [0.03, 0.0])
def test_a_vehicle_carried_by_hand_is_refused(level):
    t = np.arange(6000) / 200
    tilt = 0.2 * np.sin(np.outer(t, (2.0, 3.0)))
    force = G * np.stack([tilt[:, 0], tilt[:, 1], np.ones(6000)], axis=1)
    force[:, 2] += np.sin(12 * t)  # steps
    rates = 0.5 * np.cos(np.outer(t, (2.0, 3.0, 1.0)))
    rng = np.random.default_rng(1)
    log = flight_log(
        gyro=channel(t, rates),
        accel=channel(t, force + 0.2 * rng.normal(size=force.shape)),
        command=channel(t, np.full((6000, 4), level)),
    )
    with pytest.raises(FlightError, match=r"never flies|never turn"):
        prepared(log, motors=COMMANDED)


def test_a_log_too_short_to_hold_a_flight_is_refused(assert_text):
    with pytest.raises(FlightError) as refused:
        prepared(motion_log(hover_thrust(0.1)))
    assert_text(str(refused.value))


# Phases


def test_phases_part_calm_from_lively_motion():
    rng = np.random.default_rng(2)
    t = np.arange(20 * 200) / 200
    lively = (t > 8) & (t < 11)
    rates = np.where(lively[:, None], 4.0, 0.1) * np.sin(np.outer(t, (20.0, 22.0, 15.0)))
    edges = phase_edges(rates + 0.005 * rng.normal(size=rates.shape), 200.0)
    starts = [a / 200 for a, _ in edges]
    assert min(abs(start - 8) for start in starts) < 0.3
    assert min(abs(start - 11) for start in starts) < 0.3
    assert len(edges) <= 5
    assert edges[0][0] == 0 and edges[-1][1] == len(t)
    assert all(a[1] == b[0] for a, b in pairwise(edges))
    assert min(b - a for a, b in edges) >= 0.6 * 200


def test_no_phase_ends_within_a_throw():
    rng = np.random.default_rng(4)
    t = np.arange(12 * 250) / 250
    pulses = sum(
        size * np.exp(-(((t - at) / 0.04) ** 2))
        for at, size in ((1.0, 3), (1.1, -2), (1.2, 3), (1.3, -3), (1.5, 2), (1.7, -1.5))
    )
    rates = np.outer(pulses, (5.0, 3.0, 1.0)) + 0.01 * rng.normal(size=(len(t), 3))
    starts = [a / 250 for a, _ in phase_edges(rates, 250.0)[1:]]
    assert not any(0.95 < start < 1.75 for start in starts)
    assert any(0.6 < start < 0.95 for start in starts)
    assert any(1.75 < start < 2.2 for start in starts)


def test_vibration_begins_a_phase_whatever_the_motion():
    rng = np.random.default_rng(5)
    t = np.arange(20 * 250) / 250
    noise = np.where(t > 9.0, 0.06, 0.01)[:, None] * rng.normal(size=(len(t), 3))
    shaken = noise - smooth(noise, 250.0, 40.0)
    rates = np.sin(np.outer(t, (20.0, 22.0, 15.0))) + shaken
    ((start, _),) = phase_edges(rates, 250.0)[1:]
    assert start / 250 == pytest.approx(9.0, abs=0.3)


def test_steady_motion_is_one_phase():
    rates = np.random.default_rng(3).normal(size=(6000, 3))
    assert phase_edges(rates, 200.0) == [(0, 6000)]
    assert phase_edges(rates[:100], 200.0) == [(0, 100)]


# Real throws


REAL = {
    "LOG00267": [(0.89, 24.4), (24.55, 32.48)],
    "LOG00271": [(0.86, 8.26)],
    "LOG00340": [(0.85, 18.09)],
}


@pytest.mark.flights
@pytest.mark.parametrize("name", REAL)
def test_real_throws_are_kept_from_hand_to_ground(flight_data_dir, name):
    log = read_log(flight_data_dir / "tudelft-indiflight" / f"{name}.BFL")
    result = prepare(log, rotor_count=4, arm=0.078)
    found = spans(result)
    assert len(found) == len(REAL[name])
    for (start, end), (first, last) in zip(found, REAL[name], strict=True):
        assert start == pytest.approx(first, abs=0.1)
        assert end == pytest.approx(last, abs=0.2)
    # The rule of the data's README: mean rotor speed and height. It drops fall and pulses.
    data = result.data
    time, position = log.channels["position"].time, log.channels["position"].values
    height = np.interp(data.time, time, position[:, 2])
    rule = (data.rotor_speed.mean(axis=1) > 900) & (height > 0.3)
    used = np.zeros(len(data.time), dtype=bool)
    for segment in data.segments:
        used[segment.start : segment.stop] = True
    assert used[rule].mean() > 0.98
    first = np.flatnonzero(used)[0]
    dropped = used & ~rule & (np.arange(used.size) < first + int(2 * data.sample_rate))
    assert dropped.sum() / data.sample_rate > 0.3  # seconds of fall and pulses that are kept
    assert result.phases[0].start == first
    assert (result.phases[1].start - first) / data.sample_rate < 2.5
    assert max(result.spikes.values()) < 0.005 * len(data.time)


@pytest.mark.parametrize("kind", ["clean", "noisy", "real"])
def test_a_motionless_hover_is_flight_after_a_take_off(kind):
    vehicle, sensors = variant(paper_vehicle("A"), kind)
    scenario = Scenario(seconds=20.0, ground_seconds=2.0, sticks=STILL, sensors=sensors)
    flight = simulate_flight(*vehicle, scenario, seed=3)
    result = prepared(to_flight_log(flight))
    assert result.data.seconds_used > 20.0
    used = np.zeros(len(flight.time), dtype=bool)
    for segment in result.data.segments:
        used[segment.start : segment.stop] = True
    assert not (used & ~flight.airborne).any()


@pytest.mark.parametrize("sample_rate", [1.0, 0.05])
def test_phases_at_the_slowest_rates(sample_rate):
    rates = np.random.default_rng(1).normal(size=(40, 3))
    edges = phase_edges(rates, sample_rate)
    assert edges[0][0] == 0 and edges[-1][1] == 40
    assert [a for a, _ in edges[1:]] == [b for _, b in edges[:-1]]
