"""Findings withhold numbers: those known as a ratio are still told as one."""

import dataclasses
from math import cos, pi, radians, sin
from pathlib import Path

import numpy as np
import pytest

import flown
from flown import with_findings
from made_tables import judged, made_result, tables_of
from rotorfit.findings import Finding
from rotorfit.report.text import result_text
from rotorfit.results.assemble import with_diagnosis
from rotorfit.results.result import (
    Derived,
    FlightRecord,
    IdentificationResult,
    Parameter,
    verdict_of,
)
from rotorfit.simulation import write_flight_table
from rotorfit.simulation.experiment_files import IMU_AND_COMMAND


def a_number(name, value, **more):
    return {"name": name, "configuration": None if name in ("kt", "kd") else "A", "value": value,
            "std": 0.1, "interval": (value - 0.2, value + 0.2), "unit": "", **more}  # fmt: skip


def a_result(**verdicts):
    verdicts = {"kt": "identified", "kd": "identified", "Izz": "identified", **verdicts}
    return IdentificationResult(
        name="made",
        method="banded",
        parameters=tuple(
            Parameter(**a_number(name, 1.0, verdict=verdict)) for name, verdict in verdicts.items()
        ),
        derived=tuple(Derived(**a_number(name, 2.0)) for name in ("Izz_com", "kd_over_Izz")),
        flights=(),
        covariance_names=("kt", "kd", "Izz@A"),
        covariance=np.eye(3),
        settings={},
        versions={},
    )


def a_late_gyro(*numbers, **more):
    return Finding(
        kind="late", severity="doubt", sentence="late", numbers=numbers,
        doubtful_because="the gyro is late", next_step="log it raw", **more,
    )  # fmt: skip


def test_a_number_that_a_finding_disowns_is_doubtful(assert_text):
    found = judged(with_findings(a_result(), a_late_gyro("Izz")))
    kt, kd, Izz = found.parameters
    assert (kt.verdict, kd.verdict, Izz.verdict) == ("identified", "identified", "doubtful")
    assert_text(Izz.reason)
    assert Izz.advice == "log it raw"
    assert verdict_of(found, found.derived_value("Izz_com")) == "doubtful"
    assert "doubtful" in result_text(found)


def test_what_is_not_known_anyway_is_not_called_doubtful():
    late = a_late_gyro("kt", "kd", "Izz@B")
    found = judged(with_findings(a_result(kt="given", kd="not-identified"), late))
    assert [p.verdict for p in found.parameters] == ["given", "not-identified", "identified"]


def test_a_doubt_that_intervals_cover_changes_no_verdict():
    covered = Finding(kind="late", severity="doubt", sentence="late", numbers=("kt",))
    assert judged(with_findings(a_result(), covered)).parameters == a_result().parameters


def test_the_scale_of_yaw_is_withheld_and_its_ratio_stays():
    result = a_result()
    parameters = result.parameters
    finding = Finding(
        kind="no-coupling",
        severity="doubt",
        sentence="none affects another",
        numbers=("kd", "Izz@A", "Izz_com@A"),
        next_step="take it from a pendulum",
        withheld_because="no coupling",
    )
    found = made_result(with_diagnosis(tables_of(result), [finding]))
    kt, kd, Izz = found.parameters
    assert kt == parameters[0]
    for p, partner in ((kd, "Izz"), (Izz, "kd")):
        assert (p.value, p.verdict, p.partner) == (None, "ratio-only", partner)
        assert (p.reason, p.advice) == ("no coupling", "take it from a pendulum")
    assert [d.value for d in found.derived] == [None, 2.0]
    assert found.covariance_names == ("kt",)
    assert found.warnings == ("none affects another",)


def test_a_finding_of_a_single_flight_makes_its_numbers_doubtful(assert_text):
    flight = FlightRecord(
        file="a.csv", sha256="", configuration="A", seconds_used=9.0, samples_used=900,
        used=(), cuts=(), findings=(a_late_gyro("kt"),),
    )  # fmt: skip
    found = judged(dataclasses.replace(a_result(), flights=(flight,)))
    assert [p.verdict for p in found.parameters] == ["doubtful", "identified", "identified"]
    assert_text(found.parameters[0].reason)


def test_tilted_axes_move_kd_by_as_much_as_is_said(tmp_path):
    flight = flown.simulated("hexa-tilted", "noisy", seed=3, seconds=25.0)

    def result(degrees):
        rotors = tuple(
            dataclasses.replace(rotor, axis=(sin(lean) * sin(angle), -sin(lean) * cos(angle), up))
            for number, rotor in enumerate(flight.vehicle.rotors)
            for angle, lean in [(pi / 6 + number * pi / 3, (-1) ** number * radians(degrees))]
            for up in [cos(lean)]
        )
        vehicle = dataclasses.replace(flight.vehicle, rotors=rotors)
        return flown.identified(tmp_path, [flight], vehicle=vehicle)

    declared, less = result(20.0), result(19.0)
    (words,) = [w for w in declared.settings["used"]["hangs_on"] if "declared axes" in w]
    moved = float(words.split("kd/kt by ")[1].split(" m")[0])
    thrust = float(words.split("kt by ")[-1].split(" %")[0])
    ratio = [one.derived_value("kd_over_kt").value for one in (less, declared)]
    assert ratio[0] - ratio[1] == pytest.approx(moved, rel=0.1)
    assert declared.parameter("kt").value / less.parameter("kt").value == pytest.approx(
        1.0 + 0.01 * thrust, abs=5e-4
    )


def test_a_declared_law_is_among_what_no_flight_checks(tmp_path):
    """That of another battery: kt was 44 % off, and the scale of the speeds was not listed."""
    flight = flown.simulated("A", "noisy", seed=4, seconds=20.0)
    write_flight_table(flight, tmp_path / "a.csv", channels=IMU_AND_COMMAND)
    path = flown.experiment_file(
        tmp_path / "experiment.toml",
        flight.vehicle,
        [Path("a.csv")],
        mass=flight.truth.mass,
        extra='[motors]\nspeed = "commanded"\nlaw = { linear = [0.0, 1500.0] }',
    )
    hanging = flown.quietly_identified(path).settings["used"]["hangs_on"]
    assert any("law gives (hover at " in words for words in hanging)
