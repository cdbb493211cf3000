"""What was asked for in a simulated flight: the response it tells, and what a result says of it."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import flown
import made_fit
from rotorfit.checks.reference_test import (
    RESPONSES,
    Instrumented,
    axis_responses,
    reference_lines,
    response_findings,
)
from rotorfit.findings import diagnostics_of, sentences
from rotorfit.fit.experiment.experiment import load_experiment
from rotorfit.identification import identify_flights
from rotorfit.simulation import write_flight_table
from rotorfit.simulation.experiment_files import to_flight_log

AXES = ("roll", "pitch", "yaw")


@pytest.fixture(scope="module")
def flight():
    return flown.simulated("A", "disturbed", seed=5, seconds=16.0)


@pytest.fixture(scope="module")
def seen(flight, tmp_path_factory):
    """Identify the flight; return the result and the fit."""
    folder = tmp_path_factory.mktemp("pilot")
    write_flight_table(
        flight, folder / "f.csv", channels=("gyro", "accel", "rotor_speed", "reference")
    )
    path = flown.experiment_file(
        folder / "e.toml", flight.vehicle, [folder / "f.csv"], mass=flight.truth.mass
    )

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = identify_flights(load_experiment(path))
    return found.result, found.fit


def test_the_reference_shows_the_response_of_every_axis(seen):
    result, _ = seen
    said = result.diagnostics
    assert said["reference_axes@A"] == 3.0
    for axis in AXES:
        ratio, half = (said[f"reference_{axis}{end}@A"] for end in ("", "_half_width"))
        assert abs(ratio - 1.0) < half < 0.05, axis
    doubts = [found.kind for found in result.findings if found.severity == "doubt"]
    assert "reference-response" not in doubts


def test_a_fit_with_too_little_thrust_shows_in_the_responses(seen):
    _, fit = seen
    at = fit.estimate.estimate
    values = at.values.copy()
    values[at.names.index("kt")] *= 0.8
    weaker = replace(fit, estimate=replace(fit.estimate, estimate=replace(at, values=values)))
    ((_, lines),) = reference_lines(weaker)
    found = axis_responses(lines)
    for axis in ("roll", "pitch"):
        assert found[axis].ratio == pytest.approx(1.25, abs=0.03), axis
        # Of 16 s some three blocks tell it: not by odds of a thousand.
        assert found[axis].contradicts(0.05)
    assert found["yaw"].ratio == pytest.approx(1.0, abs=0.03)


def test_rates_asked_for_are_those_of_the_autopilot(flight):
    """The vehicle follows them with some delay: 0.1 s later it turns as it was asked to."""
    asked = to_flight_log(flight, channels=("reference",)).channels["reference"].values
    later = np.roll(flight.angular_velocity, -20, axis=0)
    for k in range(2):
        assert np.corrcoef(asked[:-20, k], later[:-20, k])[0, 1] > 0.8


def compared(**axes):
    """Return the warnings and diagnostics of made-up ratios beside numbers known to 4 %."""
    names = tuple(f"{name}@A" for name in RESPONSES.values())
    numbers = made_fit.no_numbers(*names, values=np.ones(3), half_width=np.full(3, 0.04))
    found = list(response_findings("A", axes, numbers))
    return sentences(found), diagnostics_of(found)


SURE = Instrumented(ratio=1.10, plain=1.09, std=0.01, difference_std=0.008)


def test_a_contradiction_is_said_with_what_to_do(assert_text):
    (words,), _ = compared(pitch=SURE)
    assert_text(words)


@pytest.mark.parametrize(
    "silent",
    [
        replace(SURE, ratio=1.015, std=0.001, difference_std=0.001),  # well inside the interval
        replace(SURE, difference_std=0.05),  # chance
        replace(SURE, ratio=1.5, std=0.11),  # too weak to tell
    ],
)
def test_what_matters_little_or_may_be_chance_is_a_number_only(silent):
    warnings, diagnostics = compared(yaw=silent)
    assert warnings == ()
    assert diagnostics["reference_yaw@A"] == silent.ratio
    assert diagnostics["reference_yaw_half_width@A"] == silent.half_width
    assert diagnostics["reference_axes@A"] == (1.0 if silent.half_width < 0.2 else 0.0)


def test_without_a_reference_that_is_a_number_only():
    assert compared() == ((), {"reference_axes@A": 0.0})
