"""Validation: errors near zero where the numbers are right, larger where not, on unseen flights."""

import csv
import dataclasses
import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import flown
from rotorfit.cli.validate import validate as validate_command
from rotorfit.errors import ExperimentError, FlightError, LogError
from rotorfit.results.result import IdentificationResult
from rotorfit.results.validation.replay_vehicle import replay_vehicle
from rotorfit.results.validation.validate import fitted_comparisons, validate_file
from rotorfit.results.validation.wrench_comparison import COMPONENTS, SHOWN
from rotorfit.simulation.experiment_files import experiment_files
from rotorfit.simulation.experiments import plan_experiment

QUICKER = ('method = "banded"', 'method = "tls"')
"""Another method, where the method is not the point."""
PLACES = (("A1", "a/fit"), ("A2", "a/kept"), ("B1", "b/fit"), ("B2", "b/kept"))
"""The logs in folders, under equal names."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The paper's two configurations on short clean flights, also with the logs in folders."""
    target = tmp_path_factory.mktemp("validated")
    plan = plan_experiment("paper", "clean", seed=4, seconds=15.0)
    for name, text in experiment_files(plan).items():
        (target / name).write_text(text)
    text = (target / "experiment.toml").read_text()
    for log, place in PLACES:
        (target / place).parent.mkdir(exist_ok=True)
        shutil.copyfile(target / f"{log}.csv", (target / place).with_suffix(".csv"))
        text = text.replace(f'"{log}.csv"', f'"{place}.csv"')
    (target / "foldered.toml").write_text(text)
    return target


@pytest.fixture(scope="module")
def result(folder) -> IdentificationResult:
    """The result of the logs in folders."""
    return flown.quietly_identified(folder / "foldered.toml")


def changed(result, factors):
    """Return the result with some parameters multiplied."""
    parameters = tuple(
        dataclasses.replace(p, value=p.value * factors[p.name]) if p.name in factors else p
        for p in result.parameters
    )
    return dataclasses.replace(result, parameters=parameters)


def test_clean_flights_are_predicted(result):
    assert [(row["configuration"], row["flight"]) for row in result.validation] == [
        ("A", "a/kept.csv"),
        ("B", "b/kept.csv"),
    ]
    for row in result.validation:
        assert tuple(row["relative_error"]) == SHOWN
        assert max(row["relative_error"].values()) < 2e-3


def test_file_gives_the_errors_of_the_fit(folder, result):
    for row in result.validation:
        comparison = validate_file(
            result, folder / row["flight"], configuration=row["configuration"]
        )
        assert dict(comparison.relative_error) == pytest.approx(row["relative_error"])
        assert not comparison.used_in_fit


def test_errors_and_whiteness_are_those_of_the_wrenches(folder, result):
    """At 200 Hz, through 3 Hz: one sample in 67 for the autocorrelation, of up to ten."""
    comparison = validate_file(result, folder / "A2.csv", configuration="A")
    assert np.diff(comparison.time).min() == pytest.approx(0.005)
    difference = comparison.body_wrench - comparison.rotor_wrench
    for name in SHOWN:
        i = COMPONENTS.index(name)
        sizes = [
            np.sqrt((side[:, i] ** 2).mean()) for side in (difference, comparison.rotor_wrench)
        ]
        assert comparison.relative_error[name] == pytest.approx(sizes[0] / sizes[1])
        kept = difference[::67, i] - difference[::67, i].mean()
        alike = np.correlate(kept, kept, "full")[len(kept) - 1 :]
        expected = np.abs(alike[1:11]).max() / alike[0]
        assert comparison.whiteness[name] == pytest.approx(expected)


KT = ("kt", "kt_1", "kt_2", "kt_3", "kt_4")


@pytest.mark.parametrize(
    ("names", "component"),
    [(("Ixx",), "Mx"), (("Iyy",), "My"), (("Izz",), "Mz"), (("kd",), "Mz"), (KT, "Fz")],
)
def test_errors_grow_with_wrong_parameters(folder, result, names, component):
    """In proportion, up to the share that gravity has in the moment; Fz knows of kt alone."""
    errors = [
        validate_file(
            changed(result, dict.fromkeys(names, factor)), folder / "A2.csv", configuration="A"
        ).relative_error
        for factor in (1.1, 1.2)
    ]
    assert 0.06 < errors[0][component] < 0.11
    assert 1.7 < errors[1][component] / errors[0][component] < 2.05
    if component != "Fz":
        assert errors[1]["Fz"] < 2e-3


def test_rotor_of_unknown_coefficient_has_the_mean_one(folder, result):
    parameters = tuple(
        dataclasses.replace(p, value=None, interval=None) if p.name in ("kt_2", "kt_3") else p
        for p in result.parameters
    )
    partly = dataclasses.replace(result, parameters=parameters)
    comparison = validate_file(partly, folder / "A2.csv", configuration="A")
    assert max(comparison.relative_error.values()) < 5e-3


def test_unknown_parameter_leaves_its_component_out(folder, result):
    parameters = tuple(
        dataclasses.replace(p, value=None) if p.name == "kd" else p for p in result.parameters
    )
    without = dataclasses.replace(result, parameters=parameters)
    comparison = validate_file(without, folder / "A2.csv", configuration="A")
    assert tuple(comparison.relative_error) == ("Fz", "Mx", "My")


def test_unknown_places_are_those_of_the_replay(folder, result):
    """Rotors and mass over each other, as a hover has them: not no prediction at all."""
    places = {"msx", "msy"}
    parameters = tuple(
        dataclasses.replace(p, value=None) if p.name in places else p for p in result.parameters
    )
    derived = tuple(
        dataclasses.replace(d, value=None) if d.name in ("com_x", "com_y") else d
        for d in result.derived
    )
    without = dataclasses.replace(result, parameters=parameters, derived=derived)
    comparison = validate_file(without, folder / "A2.csv", configuration="A")
    assert tuple(comparison.relative_error) == SHOWN
    vehicle = replay_vehicle(without, "A")
    moved = (
        9.81
        * result.parameter("mass", "A").value
        * np.abs(vehicle.com[0] - replay_vehicle(result, "A").com[0])
    )
    residual = comparison.body_wrench - comparison.rotor_wrench
    assert np.abs(residual[:, 3:5].mean(axis=0)) == pytest.approx(moved[[1, 0]], rel=0.02)
    assert comparison.relative_error["Fz"] < 2e-3


def test_unknown_bias_is_that_of_the_fit(folder, result):
    """Beside a bias of .5 m/s^2 that the result withholds, the flight does not fall."""
    parameters = tuple(
        dataclasses.replace(p, value=None) if p.name == "accel_bias_z" else p
        for p in result.parameters
    )
    without = dataclasses.replace(result, parameters=parameters)
    fitted = {"fitted_accel_bias_z@A": 0.5}
    biased = dataclasses.replace(without, diagnostics={**without.diagnostics, **fitted})
    plain, moved = (
        validate_file(one, folder / "A2.csv", configuration="A").body_wrench[:, 2]
        for one in (without, biased)
    )
    assert plain - moved == pytest.approx(0.5 * result.parameter("mass", "A").value, rel=1e-6)


def test_removed_coefficient_leaves_its_component_out(folder, result):
    parameters = tuple(
        dataclasses.replace(p, value=None, verdict="removed") if p.name in ("kd", "Jr") else p
        for p in result.parameters
    )
    without = dataclasses.replace(result, parameters=parameters)
    comparison = validate_file(without, folder / "A2.csv", configuration="A")
    assert tuple(comparison.relative_error) == ("Fz", "Mx", "My")


def test_flight_of_the_fit_is_refused(folder, result, tmp_path):
    copy = tmp_path / "another name.csv"
    shutil.copyfile(folder / "A1.csv", copy)
    for path in (folder / "A1.csv", copy):
        with pytest.raises(ExperimentError, match="was used in the fit: it cannot validate it"):
            validate_file(result, path, configuration="A")


def test_the_rest_of_a_flight_of_the_fit_validates(folder, tmp_path):
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    experiment = tmp_path / "experiment.toml"
    text = experiment.read_text().replace('"A1.csv"', '{ file = "A1.csv", end = 10.0 }')
    experiment.write_text(text.replace(*QUICKER))
    half = flown.quietly_identified(experiment)
    rest = validate_file(half, tmp_path / "A1.csv", configuration="A", start=10.0, end=15.0)
    assert max(rest.relative_error.values()) < 5e-3
    assert 10.0 <= rest.time[0] < rest.time[-1] <= 15.0
    for window in ({}, {"start": 9.0}, {"end": 5.0}):
        with pytest.raises(ExperimentError, match=r"A1\.csv was used in the fit"):
            validate_file(half, tmp_path / "A1.csv", configuration="A", **window)


def with_absolute_files(result):
    """The result as earlier versions wrote it: each record has the path of its log."""
    entries = [flight for c in result.settings["configuration"] for flight in c["flights"]]
    records = tuple(
        dataclasses.replace(record, file=entry["file"])
        for record, entry in zip(result.flights, entries, strict=True)
    )
    return dataclasses.replace(result, flights=records)


def test_flights_are_named_as_in_the_experiment_file(result, tmp_path, monkeypatch):
    assert [record.file for record in result.flights] == ["a/fit.csv", "b/fit.csv"]
    assert [row["flight"] for row in result.validation] == ["a/kept.csv", "b/kept.csv"]
    monkeypatch.chdir(tmp_path)
    places = [Path(f["file"]) for c in result.settings["configuration"] for f in c["flights"]]
    assert all(place.is_absolute() and place.exists() for place in places)


@pytest.mark.parametrize("written", [lambda result: result, with_absolute_files])
def test_flights_of_a_result_are_found_from_anywhere(
    folder, result, tmp_path, monkeypatch, written
):
    monkeypatch.chdir(tmp_path)
    written(result).save(tmp_path / "result.json")
    loaded = IdentificationResult.load(tmp_path / "result.json")
    found = fitted_comparisons(loaded)
    assert [c.configuration for c in found] == ["A", "B"]
    logs = ((folder / f"{name}.csv").read_bytes() for name in ("A1", "B1"))
    assert [c.sha256 for c in found] == [hashlib.sha256(log).hexdigest() for log in logs]
    place = Path(loaded.settings["configuration"][1]["flights"][0]["file"])
    with pytest.raises(ExperimentError, match=r"fit\.csv was used in the fit"):
        validate_file(loaded, place, configuration="B")
    comparison = validate_file(loaded, place.with_name("kept.csv"), configuration="B")
    assert max(comparison.relative_error.values()) < 2e-3


def test_a_result_with_a_flight_cut_out_is_refused(result):
    edited = dataclasses.replace(result, flights=result.flights[:1])
    words = "made from 1 flights, but its settings name 2: it was edited"
    with pytest.raises(ExperimentError, match=words):
        fitted_comparisons(edited)


def test_a_stretch_that_ends_before_it_starts_is_refused(folder, result):
    with pytest.raises(ExperimentError, match=r"end = 3\.0 is not after start = 5\.0"):
        validate_file(result, folder / "A2.csv", configuration="A", start=5.0, end=3.0)


def test_a_flight_under_two_names_is_refused(folder, tmp_path):
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    shutil.copyfile(folder / "A1.csv", tmp_path / "B1.csv")
    with pytest.raises(ExperimentError, match=r"B1\.csv has the same content as A1\.csv"):
        flown.quietly_identified(tmp_path / "experiment.toml")


def test_a_flight_in_two_configurations_is_refused(folder, tmp_path):
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    experiment = tmp_path / "experiment.toml"
    experiment.write_text(experiment.read_text().replace('"B1.csv"', '"A1.csv"'))
    with pytest.raises(ExperimentError, match=r"A1\.csv is listed twice; it would count twice"):
        flown.quietly_identified(experiment)


def test_experiment_that_validates_on_its_fit_is_refused(folder, tmp_path):
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    shutil.copyfile(folder / "A1.csv", tmp_path / "A2.csv")
    experiment = tmp_path / "experiment.toml"
    experiment.write_text(experiment.read_text().replace(*QUICKER))
    with pytest.raises(ExperimentError, match=r"A2\.csv was used in the fit"):
        flown.quietly_identified(experiment)


@pytest.mark.parametrize("configuration", [None, "C"])
def test_configuration_must_be_one_of_the_result(folder, result, configuration):
    with pytest.raises(ExperimentError, match="the result has the configurations A, B; say"):
        validate_file(result, folder / "A2.csv", configuration=configuration)


def test_wrong_configuration_shows(folder, result):
    right = validate_file(result, folder / "A2.csv", configuration="A").relative_error
    wrong = validate_file(result, folder / "A2.csv", configuration="B").relative_error
    assert wrong["Fz"] > 100 * right["Fz"]


def test_fitted_flights_are_marked(result):
    comparisons = fitted_comparisons(result)
    assert [(c.configuration, c.used_in_fit) for c in comparisons] == [("A", True), ("B", True)]
    assert max(max(c.relative_error.values()) for c in comparisons) < 2e-3


def test_command(folder, result, tmp_path, capsys):
    saved = tmp_path / "result.json"
    result.save(saved)
    flights = [folder / "A2.csv"]
    validate_command(saved, flights, configuration="A", as_json=True)
    (row,) = json.loads(capsys.readouterr().out)
    assert row["relative_error"] == pytest.approx(result.validation[0]["relative_error"])
    validate_command(saved, flights, configuration="A", as_json=False)
    lines = capsys.readouterr().out.splitlines()
    assert lines[2].split() == ["configuration", *SHOWN]
    assert lines[3].split()[:2] == ["A2.csv", "A"]
    assert [float(word) for word in lines[3].split()[2:]] == pytest.approx([0.0] * 4, abs=0.2)


def test_a_flight_that_cannot_be_used_is_named_once(folder, result):
    with pytest.raises(FlightError) as refused:
        validate_file(result, folder / "A2.csv", configuration="A", start=0.0, end=0.02)
    assert str(refused.value).startswith("A2.csv: ")
    assert str(refused.value).count("A2.csv") == 1


def test_motor_data_of_the_other_kind_are_named_with_what_to_do(folder, result, tmp_path):
    names, *rows = csv.reader((folder / "A2.csv").read_text().splitlines())
    first = names.index("command_1")
    with (tmp_path / "other.csv").open("w", newline="") as table:
        writer = csv.writer(table)
        writer.writerow([name.replace("command_", "rotor_") for name in names])
        for row in rows:
            speeds = [1600.0 * float(cell) for cell in row[first:]]
            writer.writerow([*row[:first], *speeds])
    with pytest.raises(LogError, match="measured rotor speeds alone, and the result is of") as no:
        validate_file(result, tmp_path / "other.csv", configuration="A")
    assert "identify the first flights anew with --speed measured" in str(no.value)
    assert "[motors]" not in str(no.value)


def test_a_table_is_read_by_the_columns_of_the_result(folder, result, tmp_path):
    """Flights of the fit with names of their own: the result carries the map to other tables."""
    names = {"time": "t_ms", **{f"rotor_{i}": f"speed{i}" for i in range(1, 7)}}
    text = (folder / "A2.csv").read_text()
    head, _, rows = text.partition("\n")
    named = ",".join(names.get(name, name) for name in head.split(","))
    (tmp_path / "other.csv").write_text(f"{named}\n{rows}")
    columns = {ours: name for ours, name in names.items() if ours in head.split(",")}
    settings = json.loads(json.dumps(result.settings))
    with pytest.raises(LogError):
        validate_file(result, tmp_path / "other.csv", configuration="A")
    for configuration in settings["configuration"]:
        for entry in configuration["flights"]:
            entry["columns"] = columns
    mapped = dataclasses.replace(result, settings=settings)
    errors = validate_file(mapped, tmp_path / "other.csv", configuration="A").relative_error
    plain = validate_file(result, folder / "A2.csv", configuration="A").relative_error
    assert dict(errors) == pytest.approx(dict(plain))
