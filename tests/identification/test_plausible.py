"""Units that are wrong by a factor are refused with their name; right ones never are."""

from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.errors import ExperimentError, FlightError, FrameError
from rotorfit.identification.bands import EDGES
from rotorfit.identification.plausible import (
    SLIMMEST,
    STOUTEST,
    gyration,
    gyro_in_degrees,
    implausible_size,
)
from rotorfit.model.reduce import BandPlan, band_factors
from rotorfit.simulation import Scenario, sampled_flight_data, simulate_flight, variant

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


def test_a_gyro_in_degrees_is_named_where_no_reading_is_impossible(gentle, tmp_path):
    changed = scaled(gentle, "gyro", DEGREES)
    assert np.percentile(np.abs(changed.gyro).max(axis=1), 99.8) < 40.0
    with pytest.raises(FlightError) as refused:
        flown.identified(tmp_path, [changed])
    words = str(refused.value)
    assert words.startswith("flight0.csv: turned by the gyro, the specific force averages to ")
    assert "the gyro is in deg/s but taken for rad/s; declare its unit (columns = { gyro" in words


@pytest.mark.parametrize("which", ["flight", "gentle"])
def test_the_right_declaration_is_identified(request, which, tmp_path):
    flight = request.getfixturevalue(which)
    result = flown.identified(tmp_path, [flight])
    assert next(p for p in result.parameters if p.name == "kt").verdict == "identified"


@pytest.mark.parametrize("name", flown.VEHICLES)
def test_the_radius_of_gyration_is_that_of_the_body(name):
    flight = flown.simulated(name, "noisy", seed=3, seconds=8.0)
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
