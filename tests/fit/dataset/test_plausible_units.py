"""Units that are wrong by a factor are refused with their name; right ones never are."""

from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.errors import ExperimentError, FlightError, FrameError
from rotorfit.fit.dataset.plausible_units import (
    SLIMMEST,
    STOUTEST,
    gyration,
    gyro_in_degrees,
    hover_speed,
    implausible_size,
    refuse_rotors_too_fast,
    slow_rotor_doubts,
)
from rotorfit.fit.reduction.frequency_bands import EDGES
from rotorfit.fit.reduction.reduce import BandPlan, band_factors
from rotorfit.simulation import (
    Scenario,
    sampled_flight_data,
    simulate_flight,
    variant,
    write_flight_table,
)
from rotorfit.simulation.experiment_files import IMU_AND_COMMAND

SECONDS = 12.0
DEGREES = 180.0 / np.pi
PLAN = BandPlan(edges=EDGES, longest=5.0)


def flight_of(share):
    """Return a flight whose sticks move by a share of the usual."""
    (truth, vehicle), sensors = variant(flown.simulated_vehicle("A"), "real")
    plain = Scenario(seconds=SECONDS, sensors=sensors)
    sticks = {name: getattr(plain.sticks, name) for name in ("roll", "pitch", "yaw")}
    gentle = {name: replace(stick, rms=share * stick.rms) for name, stick in sticks.items()}
    scenario = replace(plain, sticks=replace(plain.sticks, **gentle))
    return simulate_flight(truth, vehicle, scenario, seed=1)


@pytest.fixture(scope="module")
def flight():
    return flight_of(1.0)


@pytest.fixture(scope="module")
def gentle():
    return flight_of(0.25)


def rotors(flight, change):
    return replace(flight.vehicle, rotors=tuple(change(flight.vehicle.rotors)))


def moved(factor):
    def change(listed):
        for rotor in listed:
            yield replace(rotor, position=tuple(factor * x for x in rotor.position))

    return change


def scaled(flight, name, factor):
    return replace(flight, **{name: getattr(flight, name) * np.asarray(factor)})


def swap(listed):
    return [listed[i] for i in (2, 1, 0, 3)]


def turn(listed):
    return [replace(r, spin="cw" if r.spin == "ccw" else "ccw") for r in listed]


FAULTS = {
    "swapped motors": (
        lambda f: (f, rotors(f, swap)),
        FrameError,
        "your rotors listed in the order 3, 2, 1, 4",
    ),
    "wrong spin": (lambda f: (f, rotors(f, turn)), FrameError, "every spin reversed"),
    "FRD called FLU": (
        lambda f: (scaled(scaled(f, "gyro", (1, -1, -1)), "accel", (1, -1, -1)), f.vehicle),
        FrameError,
        "these are FRD axes",
    ),
    "gyro 57 times too small": (
        lambda f: (scaled(f, "gyro", 1 / DEGREES), f.vehicle),
        FlightError,
        "the gyro reads too little (rad/s declared as deg/s?)",
    ),
    "accelerometer in g": (
        lambda f: (scaled(f, "accel", 1 / 9.80665), f.vehicle),
        FlightError,
        "units of g",
    ),
    "gravity taken out": (
        lambda f: (replace(f, accel=f.accel - [0.0, 0.0, 9.8]), f.vehicle),
        FlightError,
        "gravity, which was taken out",
    ),
    "arm twenty times": (
        lambda f: (f, rotors(f, moved(20.0))),
        FlightError,
        "the rotors' positions are too large (the arm is 4 m",
    ),
    "arm in cm": (
        lambda f: (f, rotors(f, moved(100.0))),
        ExperimentError,
        "expected 0.01 to 5 m",
    ),
    "arm a hundredth": (
        lambda f: (f, rotors(f, moved(0.01))),
        ExperimentError,
        "expected 0.01 to 5 m",
    ),
    "arm a tenth": (
        lambda f: (f, rotors(f, moved(0.1))),
        FlightError,
        "the rotors' positions are too small (the arm is 0.02 m)",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_identify_names_the_fault(flight, tmp_path, name):
    fault, error, words = FAULTS[name]
    changed, vehicle = fault(flight)
    with pytest.raises(error) as refused:
        flown.identified(tmp_path, [changed], vehicle=vehicle)
    assert words in str(refused.value)
    assert error is ExperimentError or "flight0.csv: " in str(refused.value)


def test_a_gyro_in_degrees_is_named_even_with_plausible_readings(gentle, tmp_path, assert_wording):
    changed = scaled(gentle, "gyro", DEGREES)
    assert np.percentile(np.abs(changed.gyro).max(axis=1), 99.8) < 40.0
    with pytest.raises(FlightError) as refused:
        flown.identified(tmp_path, [changed])
    words = str(refused.value)
    assert words.startswith("flight0.csv: turned")
    assert_wording(words)


@pytest.mark.parametrize("which", ["flight", "gentle"])
def test_the_right_declaration_is_identified(request, which, tmp_path):
    flight = request.getfixturevalue(which)
    result = flown.identified(tmp_path, [flight])
    assert next(p for p in result.parameters if p.name == "kt").verdict == "identified"


@pytest.mark.parametrize("name", flown.VEHICLES)
def test_the_radius_of_gyration_is_that_of_the_body(name):
    flight = flown.simulated(name, "noisy", seed=3, seconds=8.0, physics_rate=200.0)
    data, truth, vehicle = (
        sampled_flight_data(flight, signals="measured"),
        flight.truth,
        flight.vehicle,
    )
    ratio = gyration(band_factors(data, vehicle, plan=PLAN), vehicle)
    radii = [np.sqrt(truth.com_inertia[i, i] / truth.mass) / vehicle.arm for i in (0, 1)]
    assert min(abs(ratio / radius - 1.0) for radius in radii) < 0.15
    assert 0.5 * ratio > SLIMMEST and 2.0 * ratio < STOUTEST
    assert gyro_in_degrees(data) is None
    assert implausible_size(ratio, vehicle.arm) is None


RPM = 60.0 / (2.0 * np.pi)


def turning(data, factor):
    return replace(data, rotor_speed=factor * data.rotor_speed)


@pytest.mark.parametrize("name", flown.VEHICLES)
def test_rotor_speeds_in_rpm_are_refused_and_right_ones_never(name, assert_wording):
    flight = flown.simulated(name, "noisy", seed=3, seconds=8.0, physics_rate=200.0)
    data, arm = sampled_flight_data(flight, signals="measured"), flight.vehicle.arm
    refuse_rotors_too_fast({"sound": turning(data, 2.0)}, arm, law=False)
    assert slow_rotor_doubts(turning(data, 0.5), arm, law=False) == ()
    with pytest.raises(FlightError, match="look like rpm read as rad/s"):
        refuse_rotors_too_fast({"rpm": turning(data, RPM)}, arm, law=False)
    (words,) = slow_rotor_doubts(turning(data, 1.0 / RPM), arm, law=False)
    assert_wording(words)


# Mass [kg], number of rotors, their diameter [m], arm [m] of vehicles from nano to agricultural.
SIZES = {
    "65 mm whoop": (0.026, 4, 0.031, 0.0325),
    "Crazyflie": (0.027, 4, 0.045, 0.046),
    "5 inch": (0.65, 4, 0.127, 0.115),
    "450 mm": (1.3, 4, 0.254, 0.225),
    "octocopter": (8.0, 8, 0.381, 0.52),
    "agricultural": (60.0, 6, 0.965, 1.05),
}
THRUST = 0.11  # of ordinary propellers, thrust / (density n^2 diameter^4)


def usual_hover(mass, count, diameter):
    return 2.0 * np.pi * np.sqrt(mass * 9.81 / count / (THRUST * 1.2 * diameter**4))


@pytest.mark.parametrize("name", SIZES)
def test_vehicles_of_every_size_pass_and_in_rpm_do_not(flight, name, assert_wording):
    *rotor, arm = SIZES[name]
    hover = usual_hover(*rotor)
    data = sampled_flight_data(flight, signals="measured")
    data = turning(data, hover / hover_speed(data))
    assert hover_speed(data) == pytest.approx(hover)
    refuse_rotors_too_fast({name: data}, arm, law=True)
    assert slow_rotor_doubts(data, arm, law=True) == ()
    with pytest.raises(FlightError, match=r"the law of \[motors\] gives rad/s"):
        refuse_rotors_too_fast({name: turning(data, RPM)}, arm, law=True)
    (words,) = slow_rotor_doubts(turning(data, 1.0 / RPM), arm, law=True)
    assert_wording(words)


def test_identify_says_it_of_rotor_speeds(flight, tmp_path, assert_wording):
    with pytest.raises(FlightError) as refused:
        flown.identified(tmp_path, [scaled(flight, "rotor_speed_measured", RPM)])
    words = str(refused.value)
    assert words.startswith("flight0.csv: the")
    assert "at 89" in words
    assert_wording(words)
    with pytest.raises(FlightError, match=r"rotor speed has another scale \(poles\)"):
        flown.identified(tmp_path, [scaled(flight, "rotor_speed_measured", 1.0 / RPM)])


def test_a_command_without_a_law_has_no_unit(flight, tmp_path):
    log = tmp_path / "flight.csv"
    write_flight_table(flight, log, channels=IMU_AND_COMMAND)
    commanded = '[motors]\nspeed = "commanded"\n'
    path = tmp_path / "experiment.toml"
    flown.experiment_file(path, flight.vehicle, [log], mass=1.0, extra=commanded)
    result = flown.quietly_identified(path)
    assert not any("look like" in doubt for doubt in result.flights[0].warnings)
