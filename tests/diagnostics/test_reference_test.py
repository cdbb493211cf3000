"""What was asked for in a simulated flight: the response it tells, and what a result says of it."""

from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.diagnostics.instruments import reference_test as pilot
from rotorfit.diagnostics.instruments.instrument import Instrumented
from rotorfit.diagnostics.instruments.reference_lines import reference_lines
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.results.parameter_tables import Tables
from rotorfit.simulation import write_flight_table
from rotorfit.simulation.views import to_flight_log

AXES = ("roll", "pitch", "yaw")


@pytest.fixture(scope="module")
def flight():
    return flown.simulated("A", "disturbed", seed=5, seconds=16.0)


@pytest.fixture(scope="module")
def seen(flight, tmp_path_factory):
    """Identify the flight; return the result, and what the pilot was asked about."""
    folder, asked = tmp_path_factory.mktemp("pilot"), []
    write_flight_table(
        flight, folder / "f.csv", channels=("gyro", "accel", "rotor_speed", "reference")
    )
    path = flown.experiment_file(
        folder / "e.toml", flight.vehicle, [folder / "f.csv"], mass=flight.truth.mass
    )

    def looked_on(*about):
        asked.append(about)
        return reference_lines(*about)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pilot, "reference_lines", looked_on)
        return flown.quietly_identified(path), asked[0]


def test_the_reference_tells_the_response_of_every_axis(seen):
    result, _ = seen
    told = result.diagnostics
    assert told["reference_axes@A"] == 3.0
    for axis in AXES:
        ratio, half = (told[f"reference_{axis}{end}@A"] for end in ("", "_half_width"))
        assert abs(ratio - 1.0) < half < 0.05, axis
    assert not any("by what was asked for" in words for words in result.warnings)


def test_a_fit_with_too_little_thrust_is_told_so(seen):
    _, (what, fit, joint) = seen
    values = fit.estimate.values.copy()
    values[fit.estimate.names.index("kt")] *= 0.8
    weaker = replace(fit, estimate=replace(fit.estimate, values=values))
    ((_, lines),) = reference_lines(what, weaker, joint)
    found = pilot._axes(lines)
    for axis in ("roll", "pitch"):
        assert found[axis].ratio == pytest.approx(1.25, abs=0.03), axis
        assert found[axis].contradicts(1e-3)
    assert found["yaw"].ratio == pytest.approx(1.0, abs=0.03)


def test_rates_asked_for_are_those_of_the_autopilot(flight):
    """The vehicle follows them with some delay: 0.1 s later it turns as it was asked to."""
    asked = to_flight_log(flight, channels=("reference",)).channels["reference"].values
    later = np.roll(flight.angular_velocity, -20, axis=0)
    for k in range(2):
        assert np.corrcoef(asked[:-20, k], later[:-20, k])[0, 1] > 0.8


def said(monkeypatch, about, **axes):
    """Return the warnings and diagnostics of made-up ratios beside numbers known to 4 %."""
    names = tuple(f"{name}@A" for name in pilot.RESPONSES.values())
    numbers = Numbers(
        names=names,
        values=np.ones(3),
        half_width=np.full(3, 0.04),
        correlation=np.eye(3),
        excitation={},
    )
    monkeypatch.setattr(pilot, "reference_lines", lambda *_: [("A", axes or None)])
    monkeypatch.setattr(pilot, "_axes", lambda lines: lines)
    empty = Tables(
        parameters=(), derived=(), covariance_names=(), covariance=np.zeros((0, 0)), settings={}
    )
    what, fit, joint = about
    tables = pilot.compare_with_reference(empty, what, numbers, fit=fit, joint=joint)
    return tables.warnings, tables.diagnostics


SURE = Instrumented(ratio=1.10, plain=1.09, std=0.01, apart_std=0.008)


def test_a_contradiction_is_said_with_what_to_do(monkeypatch, seen):
    (words,), _ = said(monkeypatch, seen[1], pitch=SURE)
    assert words == (
        "A: by what was asked for the response in pitch (kt / Iyy) is 1.100 +- 0.020 times that of "
        "the fit: the autopilot responded to gusts differently than assumed, or what was asked "
        "for is "
        "not what moved the vehicle; fly again in calm air with larger, quicker sticks"
    )


@pytest.mark.parametrize(
    "silent",
    [
        replace(SURE, ratio=1.015, std=0.001, apart_std=0.001),  # well inside the interval
        replace(SURE, apart_std=0.05),  # chance
        replace(SURE, ratio=1.5, std=0.11),  # too weak to tell
    ],
)
def test_what_matters_little_or_may_be_chance_is_a_number_only(monkeypatch, seen, silent):
    warnings, diagnostics = said(monkeypatch, seen[1], yaw=silent)
    assert warnings == ()
    assert diagnostics["reference_yaw@A"] == silent.ratio
    assert diagnostics["reference_yaw_half_width@A"] == silent.half_width
    assert diagnostics["reference_axes@A"] == (1.0 if silent.half_width < 0.2 else 0.0)


def test_without_a_reference_that_is_a_number_only(monkeypatch, seen):
    assert said(monkeypatch, seen[1]) == ((), {"reference_axes@A": 0.0})
