"""Results side by side: differences, overlaps, what is missing."""

import dataclasses
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from rotorfit.cli.compare import comparison_text
from rotorfit.cli.main import app
from rotorfit.errors import ExperimentError
from rotorfit.results.compare import compare_results
from rotorfit.results.result import Derived, IdentificationResult, Parameter


def parameter(name, value, half=None, *, configuration=None, unit="kg m^2"):
    known = value is not None and half is not None
    return Parameter(
        name=name,
        configuration=configuration,
        value=value,
        std=half / 1.96 if known else None,
        interval=(value - half, value + half) if known else None,
        unit=unit,
        verdict="identified" if value is not None else "not-identified",
    )


def result(*parameters, derived=()):
    return IdentificationResult(
        name="x",
        method="banded",
        parameters=parameters,
        derived=tuple(derived),
        flights=(),
        covariance_names=(),
        covariance=np.zeros((0, 0)),
        settings={},
        versions={},
    )


# Six et al. 2020, Table II, IMU and motion capture.
IMU = result(
    parameter("kt", 3.63e-6, 0.002e-6, unit="N s^2/rad^2"),
    parameter("Ixx", 1.82e-2, 0.07e-2, configuration="A"),
    parameter("Iyy", 3.57e-2, 0.07e-2, configuration="B"),
    parameter("Izz", None, configuration="A"),
    parameter("Ixy", 1e-5, 3e-5, configuration="A"),
)
MOCAP = result(
    parameter("kt", 3.68e-6, 0.002e-6, unit="N s^2/rad^2"),
    parameter("Ixx", 1.88e-2, 0.13e-2, configuration="A"),
    parameter("Iyy", 3.84e-2, 0.07e-2, configuration="B"),
    parameter("Ixy", -3e-5, 3e-5, configuration="A"),
)


def test_differences_and_overlaps_of_table_two():
    numbers = {n.name: n for n in compare_results([IMU, MOCAP], ["imu", "mocap"]).numbers}
    assert list(numbers) == ["kt", "Ixx", "Iyy", "Ixy"]  # no result gives Izz
    assert numbers["kt"].entries[1].difference == pytest.approx(0.05 / 3.63)
    assert numbers["kt"].entries[1].overlap is False
    assert numbers["Ixx"].entries[1].difference == pytest.approx(0.06 / 1.82)
    assert numbers["Ixx"].entries[1].overlap is True
    assert numbers["Iyy"].configuration == "B"
    assert numbers["Iyy"].entries[0].difference is None
    assert numbers["Ixy"].entries[1].difference == pytest.approx(-4.0)


def test_text_names_differences_and_no_percentage_of_zero(assert_text):
    text = comparison_text(compare_results([IMU, MOCAP], ["imu", "mocap"]))
    lines = {line.split("  ")[0]: line for line in text.splitlines()}
    assert "+1.38 %*" in lines["kt"]
    assert lines["Ixx A"].rstrip().endswith("+3.30 %  kg m^2")
    assert "%" not in lines["Ixy A"]
    assert_text(" ".join(text.split()))
    assert max(map(len, text.splitlines())) <= 80
    far = result(parameter("kt", 5.787, 0.1))
    assert " +479 %* " in comparison_text(
        compare_results([result(parameter("kt", 1.0, 0.1)), far], ["a", "b"])
    )


def test_a_number_that_one_result_lacks():
    bare = dataclasses.replace(MOCAP, parameters=MOCAP.parameters[:1])
    entry = compare_results([bare, IMU], ["a", "b"]).numbers[1]
    assert entry.name == "Ixx"
    assert entry.entries[0].value is None
    assert entry.entries[1].difference is None
    assert entry.entries[1].overlap is None


def test_single_configurations_meet_whatever_their_names():
    a = result(parameter("Ixx", 1.0, 0.1, configuration="A"))
    b = result(parameter("Ixx", 1.1, 0.1, configuration="indoor"))
    (number,) = compare_results([a, b], ["a", "b"]).numbers
    assert number.configuration == "A"
    assert number.entries[1].difference == pytest.approx(0.1)


def test_derived_numbers_come_last():
    derived = Derived(
        name="com_x", configuration="A", value=1e-3, std=None, interval=None, unit="m"
    )
    one = dataclasses.replace(IMU, derived=(derived,))
    names = [n.name for n in compare_results([one, MOCAP], ["a", "b"]).numbers]
    assert names == ["kt", "Ixx", "Iyy", "Ixy", "com_x"]


def test_refusals():
    with pytest.raises(ExperimentError, match="one result cannot be compared"):
        compare_results([IMU], ["a"])
    per_kilogram = result(parameter("Ixx", 1.0, 0.1, configuration="A", unit="kg m^2 per kg"))
    with pytest.raises(ExperimentError, match=r"kg m\^2 per kg in b: results per"):
        compare_results([IMU, per_kilogram], ["imu", "b"])


def test_command(tmp_path):
    files = [str(tmp_path / name) for name in ("imu.json", "mocap.json")]
    for file, saved in zip(files, (IMU, MOCAP), strict=True):
        saved.save(type(tmp_path)(file))
    run = CliRunner().invoke(app, ["compare", *files])
    assert run.exit_code == 0, run.output
    assert run.stdout.splitlines()[0].split() == ["imu", "mocap", "differs"]
    data = json.loads(CliRunner().invoke(app, ["compare", "--json", *files]).stdout)
    assert data["labels"] == ["imu", "mocap"]
    assert data["numbers"][0]["entries"][1]["overlap"] is False
    assert CliRunner().invoke(app, ["compare"]).exit_code == 2


def test_a_comparison_prints_as_a_table():
    text = str(compare_results([IMU, MOCAP], ["imu", "mocap"]))
    head, *rows = text.splitlines()
    assert head.split() == ["imu", "mocap"]
    assert len(rows) == len(compare_results([IMU, MOCAP], ["imu", "mocap"]).numbers)
    lines = {line.split("  ")[0]: line for line in rows}
    assert "(+1.4 %*)" in lines["kt"] and "(+3.3 %)" in lines["Ixx A"]
    assert "%" not in lines["Ixy A"]  # zero is inside the first interval


def test_two_charges_are_no_contradiction():
    """Full speed goes with the voltage to the power of .8 +- .4, thrust with its square."""

    def at(voltage, ratio):
        half = 0.02 * ratio
        weight = Derived(
            name="thrust_to_weight",
            configuration="A",
            value=ratio,
            std=half / 1.96,
            interval=(ratio - half, ratio + half),
            unit="1",
        )
        charge = {} if voltage is None else {"full_command_voltage": voltage}
        return dataclasses.replace(result(derived=[weight]), diagnostics=charge)

    def meets(first, second):
        [number] = compare_results([at(*first), at(*second)], ["a", "b"]).numbers
        return number.entries[1].overlap

    assert meets((3.6, 2.0), (3.2, 2.0 * (3.2 / 3.6) ** 1.6))
    assert meets((3.2, 2.0 * (3.2 / 3.6) ** 1.6), (3.6, 2.0))
    assert not meets((3.6, 2.0), (3.6, 1.6))
    assert not meets((3.6, 2.0), (3.2, 1.2))
    assert not meets((None, 2.0), (3.2, 1.65))
