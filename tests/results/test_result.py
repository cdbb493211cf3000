"""Verdicts, and the result as it is saved and read back."""

import dataclasses
import json

import numpy as np
import pytest

import flown
from rotorfit.checks.verdicts.judge import ADVICE, judge, motion_for
from rotorfit.errors import OutputError
from rotorfit.findings import doubt
from rotorfit.results.result import IdentificationResult

KEYS = {
    *("schema", "name", "method", "axes", "parameters", "derived", "validation", "flights"),
    *("covariance", "settings", "versions", "warnings"),
}
PARAMETER_KEYS = {
    *("name", "configuration", "value", "std", "interval", "unit", "verdict", "with"),
    *("reason", "advice", "asks", "interval_terms"),
}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    flight = flown.simulated("A", "disturbed", seed=2, seconds=20.0, ground_seconds=2.0)
    extra = '[motors]\ndelay = 0.0\n[identification]\nmethod = "ols"\n'
    return flown.identified(tmp_path_factory.mktemp("result"), [flight], extra=extra)


@pytest.mark.parametrize(
    ("value", "half", "verdict"),
    [
        (1.0, 0.25, "identified"),
        (-1.0, 0.2501, "weak"),
        (1.0, 1.0, "weak"),
        (1.0, 1.01, "not-identified"),
        (0.0, 0.1, "weak"),
        (0.0, 0.04, "identified"),
        (1.0, np.nan, "not-identified"),
        (1.0, np.inf, "not-identified"),
    ],
)
def test_verdicts_follow_the_width_of_the_interval(value, half, verdict):
    found = judge(value, half, scale=0.2, axis="roll", excitation=50.0)
    assert found.verdict == verdict
    assert (found.advice == ADVICE["roll"]) == (verdict != "identified")


@pytest.mark.parametrize(("half", "verdict"), [(0.6, "weak"), (1.1, "not-identified")])
def test_too_little_excitation_is_the_reason_that_is_named(half, verdict, assert_wording):
    found = judge(1.0, half, scale=0.0, axis="pitch", excitation=4.9)
    assert found.verdict == verdict
    assert "(signal-to-noise 4.9, need 5)" in found.reason
    assert_wording(found.reason)
    assert "+-60 %" in judge(1.0, 0.6, scale=0.0, axis="pitch", excitation=5.0).reason
    assert "+-60 %" in judge(1.0, 0.6, scale=0.0, axis="force").reason


def test_a_percentage_says_of_what_it_is(assert_text):
    assert judge(0.8, 0.6, scale=0.2, axis="force").reason == "known only to +-75 %"
    small = judge(0.1, 0.12, scale=0.2, axis="force").reason
    assert_text(small)
    nearly = judge(0.1, 0.0502, scale=0.2, axis="force").reason
    assert_text(nearly)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("com_z", "wiggle roll and pitch quickly"),
        ("msz", "wiggle roll and pitch quickly"),
        ("com_x", "alternating turns"),
        ("kt", "climb and sink"),
        ("accel_bias_z", "climb and sink"),
        ("Ixx", "roll briskly"),
        ("drag_x", "to and fro"),
    ],
)
def test_the_advice_is_what_the_plan_finds_by_the_bound(name, words):
    found = judge(0.0, 0.1, scale=0.2, axis=motion_for(name))
    assert (found.verdict, words in found.advice) == ("weak", True)


@pytest.mark.parametrize(("excitation", "verdict"), [(4.9, "not-identified"), (5.0, "weak")])
def test_yaw_is_refused_when_disturbances_match_the_rotors(excitation, verdict):
    assert judge(1.0, 0.6, scale=0.0, axis="yaw", excitation=excitation).verdict == verdict
    assert judge(1.0, 0.6, scale=0.0, axis="roll", excitation=excitation).verdict == "weak"
    assert judge(1.0, 0.49, scale=0.0, axis="yaw", excitation=excitation).verdict == "weak"


def test_saved_and_read_back_it_is_the_same(tmp_path, result):
    path = tmp_path / "result.json"
    result.save(path)
    again = IdentificationResult.load(path)
    np.testing.assert_array_equal(again.covariance, result.covariance)
    for field in dataclasses.fields(IdentificationResult):
        if field.name != "covariance":
            assert getattr(again, field.name) == getattr(result, field.name), field.name
    assert again.to_json() == result.to_json()


def test_a_flights_doubts_are_findings_and_sentences(result):
    finding = doubt("gyro-bias", "no 1 s at rest found")
    flights = (dataclasses.replace(result.flights[0], findings=(finding,)),)
    plain = json.loads(dataclasses.replace(result, flights=flights).to_json())["flights"][0]
    assert plain["warnings"] == ["no 1 s at rest found"]
    assert plain["findings"][0]["kind"] == "gyro-bias"


def test_older_results_have_sentences_alone(tmp_path, result):
    path, plain = tmp_path / "old.json", json.loads(result.to_json())
    del plain["flights"][0]["findings"]
    plain["flights"][0]["warnings"] = ["the gyro drifts"]
    path.write_text(json.dumps(plain))
    again = IdentificationResult.load(path).flights[0]
    assert again.warnings == ("the gyro drifts",)
    assert [one.kind for one in again.findings] == ["warning"]


def test_the_file_has_every_key_of_the_format(result):
    plain = json.loads(result.to_json(), parse_constant=lambda word: pytest.fail(word))
    assert plain.keys() >= KEYS
    assert plain["schema"] == 2
    for parameter in plain["parameters"]:
        assert parameter.keys() == PARAMETER_KEYS
        value, interval = parameter["value"], parameter["interval"]
        assert interval is None or interval[0] <= value <= interval[1]
        assert value is not None or parameter["std"] is None
        if parameter["verdict"] in ("not-identified", "ratio-only"):
            assert value is None
            assert parameter["reason"]
            assert parameter["advice"]
        if parameter["verdict"] == "ratio-only":
            assert parameter["with"] in ("Izz", "kd")
    for derived in plain["derived"]:
        assert derived.keys() == {
            *["name", "configuration", "value", "std", "interval", "unit"],
            "verdict",
            "reason",
            "interval_terms",
        }
    for flight in plain["flights"]:
        assert flight.keys() >= {"file", "sha256", "seconds_used", "samples_used", "warnings"}
        assert len(flight["sha256"]) == 64
    names, matrix = plain["covariance"]["names"], plain["covariance"]["matrix"]
    assert np.shape(matrix) == (len(names), len(names))
    assert plain["versions"].keys() >= {"rotorfit", "numpy", "scipy"}
    assert plain["settings"]["configuration"][0]["mass"] == 1.285


def test_the_covariance_belongs_to_the_standard_deviations(result):
    for i, name in enumerate(result.covariance_names):
        parameter = result.parameter(name.split("@")[0])
        assert result.covariance[i, i] ** 0.5 == pytest.approx(parameter.std)
    assert (
        np.linalg.eigvalsh(
            result.covariance / np.outer(*[np.sqrt(np.diagonal(result.covariance))] * 2)
        ).min()
        > -1e-9
    )


def test_numbers_that_json_cannot_hold_become_null(result):
    broken = dataclasses.replace(result, diagnostics={"condition": float("inf"), "x": float("nan")})
    assert json.loads(broken.to_json())["diagnostics"] == {"condition": None, "x": None}


def test_no_file_is_overwritten_unasked(tmp_path, result):
    path = tmp_path / "result.json"
    path.write_text("mine")
    with pytest.raises(OutputError, match=r"result\.json"):
        result.save(path)
    assert path.read_text() == "mine"
    result.save(path, force=True)
    assert IdentificationResult.load(path).name == result.name


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no file .*other.json; rotorfit identify LOG ... -o other.json  writes"),
        ("{", "is not a rotorfit result"),
        ("[]", "is not a rotorfit result"),
        ("{}", "is not a rotorfit result .at 'schema'"),
        ('{"schema": 3}', "has schema 3, this rotorfit reads 1 and 2"),
        ('{"schema": 1, "covariance": {"names": [], "matrix": []}}', "is not a rotorfit result"),
    ],
)
def test_other_files_are_refused(tmp_path, content, words):
    path = tmp_path / "other.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(OutputError, match=words):
        IdentificationResult.load(path)


def test_unknown_names_are_key_errors_that_list_what_there_is(result):
    with pytest.raises(KeyError, match=r"no parameter 'kq' in this result; it has kt, .*, Ixx"):
        result.parameter("kq")
    with pytest.raises(KeyError, match="no derived number 'kq' in this result; it has com_x"):
        result.derived_value("kq")


def test_of_several_configurations_one_must_be_named(result):
    own = [p for p in result.parameters if p.configuration is not None]
    shared = tuple(p for p in result.parameters if p.configuration is None)
    named = {name: [dataclasses.replace(p, configuration=name) for p in own] for name in "AB"}
    two = dataclasses.replace(result, parameters=(*shared, *named["A"], *named["B"]), derived=())
    assert two.parameter("Ixx", "B").configuration == "B"
    assert two.parameter("kt").configuration is None
    words = r"parameter 'Ixx' is of several configurations \(A, B\): name one, as in \('Ixx', 'A'\)"
    with pytest.raises(KeyError, match=words):
        two.parameter("Ixx")
    with pytest.raises(KeyError, match="no parameter 'Ixx' of 'C' in this result; it is of A, B"):
        two.parameter("Ixx", "C")
    with pytest.raises(KeyError, match="of all configurations together: leave the configuration"):
        two.parameter("kt", "A")


def test_paths_may_be_text(tmp_path, result):
    result.save(str(tmp_path / "result.json"))
    assert IdentificationResult.load(str(tmp_path / "result.json")).name == result.name
