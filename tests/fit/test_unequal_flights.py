"""A good flight beside weak ones: what it needs stays in the model, what it tells stays known."""

from dataclasses import replace

import pytest

import flown
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify_flights
from rotorfit.simulation import Scenario, layout_vehicle, simulate_flight, variant
from rotorfit.simulation.experiment_files import write_flight_table
from rotorfit.simulation.pilot import Sticks

IMU = ("gyro", "accel", "rotor_speed")
AXES = ("roll", "pitch", "yaw", "climb")


def sticks(share):
    usual = Sticks()
    each = {axis: getattr(usual, axis) for axis in AXES}
    return replace(usual, **{a: replace(s, rms=share * s.rms) for a, s in each.items()})


@pytest.fixture(scope="module")
def joint_and_alone(tmp_path_factory):
    """Return three flights together and the first alone; it is lively, and knows its velocity."""
    folder = tmp_path_factory.mktemp("unequal")
    (truth, vehicle), sensors = variant(layout_vehicle("quad-x"), "real")
    truth = replace(truth, drag=(0.5, 0.5, 0.3))
    files = []
    for k, (share, seconds) in enumerate(((1.3, 25.0), (0.35, 8.0), (0.35, 8.0))):
        scenario = Scenario(
            seconds=seconds,
            ground_seconds=1.0,
            sensors=sensors,
            sticks=sticks(share),
            physics_rate=200.0,
        )
        flight = simulate_flight(truth, vehicle, scenario, seed=10 + k)
        files.append(folder / f"{k}.csv")
        write_flight_table(flight, files[-1], channels=IMU if k else (*IMU, "velocity"))
    paths = [
        flown.experiment_file(folder / f"{len(own)}.toml", vehicle, own, mass=truth.mass)
        for own in (files, files[:1])
    ]
    joint, alone = (identify_flights(load_experiment(path)) for path in paths)
    return joint, alone, truth


def test_drag_stays_next_to_flights_without_velocity(joint_and_alone):
    joint, alone, truth = joint_and_alone
    assert "drag" in alone.fit.terms
    assert {"drag", "climb_drag"} <= set(joint.fit.terms)
    value, half = joint.fit.numbers.number("drag_x@A")
    assert abs(value - truth.drag[0]) < half < 0.3


OF_THE_AIR = {"kt", "hover_speed@A", "Ixx_over_kt@A", "Iyy_over_kt@A", "Izz_over_kt@A"}
"""Alone a flight tells them of its own air, several together of the mean."""
MAIN = {"kd", "Jr", "Ixx_com@A", "Iyy_com@A", "Izz_com@A", "kd_over_Izz@A", "com_z@A", "drag_z@A"}


def test_weak_flights_do_not_widen_what_a_good_one_shows(joint_and_alone):
    joint, alone = (one.fit.numbers for one in joint_and_alone[:2])
    said = {
        name
        for name, value, half in zip(alone.names, alone.values, alone.half_width, strict=True)
        if half < 0.5 * abs(value)
    }
    assert said > MAIN | OF_THE_AIR
    ratio = {name: joint.number(name)[1] / alone.number(name)[1] for name in said}
    # Its frame alone is dragged, by four deviations of what is known of that before the flight.
    assert max(ratio[name] for name in MAIN - {"Iyy_com@A"}) < 1.08
    # The bias along z is that of each flight: of several it is their mean.
    assert max(ratio[name] for name in said - {"accel_bias_z@A"}) < 1.16


def test_a_climb_is_felt_only_where_no_velocity_is_known(joint_and_alone):
    climbs = [f.prepared.data.climb for f in joint_and_alone[0].dataset.configurations[0].flights]
    assert [bool(climb.any()) for climb in climbs] == [False, True, True]
