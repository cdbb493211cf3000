"""A result that a hand or a disk has changed is refused by name, wherever it would be used."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rotorfit.errors import OutputError
from rotorfit.results.sound_result import load_sound, refuse_unsound

sys.path.append(str(Path(__file__).parents[1] / "export"))
from export_material import a_result, changed


@pytest.fixture
def saved(tmp_path):
    """Return a function that saves a changed result, and its path."""

    def write(change):
        data = json.loads(a_result().to_json())
        change(data)
        path = tmp_path / "changed.json"
        path.write_text(json.dumps(data), encoding="utf-8")
        return path

    return write


def entry(data, name, table="parameters"):
    return next(e for e in data[table] if e["name"] == name)


def test_what_identify_wrote_is_sound(saved):
    assert load_sound(saved(lambda data: None)).name == "export me"
    per_command = {"unit": "N per squared command"}
    refuse_unsound(changed(a_result(), kt=per_command, Ixx={"unit": "kg m^2 per kg"}))


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("kt", float("nan"), "kt is nan, not a number"),
        ("kt", float("inf"), "kt is inf, not a number"),
        ("kt", 1e-300, "kt is 1e-300, which nothing that flies has"),
        ("mass", -1e300, r"mass is -1e\+300, which nothing that flies has"),
    ],
)
def test_a_value_that_is_no_number(saved, name, value, words):
    with pytest.raises(OutputError, match=f"changed.json: .*{words}"):
        load_sound(saved(lambda data: entry(data, name).update(value=value)))


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("interval", [2.0, 1.0], "the interval of kt is"),
        ("interval", [float("nan"), 1.0], "the interval of kt is"),
        ("unit", "kg", "kt is in 'kg'"),
        ("name", "ktt", "there is no number 'ktt'"),
    ],
)
def test_a_field_that_is_something_else(saved, field, value, words):
    with pytest.raises(OutputError, match=words):
        load_sound(saved(lambda data: entry(data, "kt").update({field: value})))


OTHER_TYPES = [
    (("kd", "value", True), "kd is True, not a number"),
    (("Jr", "value", "much"), "Jr is 'much', not a number"),
    (("motor_lag", "value", [1]), "motor_lag is [1], not a number"),
    (("kt", "interval", [1.0]), "the interval of kt is [1.0]"),
    (("kt", "unit", 3), "unit of kt is 3, not text"),
    (("kt", "verdict", "certain"), "kt has the verdict 'certain'"),
    (("kt", "verdict", []), "kt has the verdict []"),
    (("kt", "reason", []), "reason of kt is []"),
    (("kt", "name", None), "there is no number None"),
    (("kt", "name", {}), "there is no number {}"),
    ((None, "settings", None), "settings is not a table"),
    ((None, "versions", "new"), "versions is not a table"),
    ((None, "parameters", "abc"), "is not a rotorfit result"),
    ((None, "covariance", {"names": [1], "matrix": [[1.0]]}), "names that are not text"),
]
PLAIN = """
import json, sys
from pathlib import Path
from rotorfit.errors import OutputError
from rotorfit.results.sound_result import load_sound
for path in sys.argv[1:]:
    try:
        load_sound(Path(path))
        print("taken")
    except OutputError as error:
        print(str(error).replace(chr(10), " "))
"""


def test_a_field_of_another_type(tmp_path):
    """In a process of its own: within the tests, types are checked before."""
    for i, ((name, field, value), _) in enumerate(OTHER_TYPES):
        data = json.loads(a_result().to_json())
        (data if name is None else entry(data, name))[field] = value
        (tmp_path / f"{i:02}.json").write_text(json.dumps(data), encoding="utf-8")
    paths = sorted(map(str, tmp_path.iterdir()))
    ended = subprocess.run(
        [sys.executable, "-c", PLAIN, *paths], capture_output=True, text=True, check=True
    )
    said = ended.stdout.splitlines()
    for (_, words), line in zip(OTHER_TYPES, said, strict=True):
        assert words in line


def test_a_derived_number_is_looked_at_as_well(saved):
    with pytest.raises(OutputError, match="com_x is 1e"):
        load_sound(saved(lambda data: entry(data, "com_x", "derived").update(value=1e300)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.update(axes="FRD"), "axes are 'FRD'"),
        (lambda d: d["parameters"].append(entry(d, "kt")), "kt is listed twice"),
        (lambda d: d["derived"].append(entry(d, "com_x", "derived")), "com_x is listed twice"),
        (
            lambda d: d.update(covariance={"names": ["kt"], "matrix": [[float("nan")]]}),
            "the covariance holds something that is not a number",
        ),
    ],
)
def test_a_table_that_is_something_else(saved, change, words):
    with pytest.raises(OutputError, match=words):
        load_sound(saved(change))


def test_a_file_without_end(tmp_path):
    path = tmp_path / "deep.json"
    path.write_text("[" * 100_000, encoding="utf-8")
    with pytest.raises(OutputError, match="is not a rotorfit result"):
        load_sound(path)


def test_python_warns_the_same():
    broken = replace(a_result(), covariance_names=("kt",), covariance=np.full((1, 1), np.inf))
    with pytest.raises(OutputError, match="identify again"):
        refuse_unsound(broken)


def test_a_missing_file_is_named_with_what_writes_it(tmp_path):
    with pytest.raises(
        OutputError, match=r"no file .*none.json; rotorfit identify LOG .* none.json"
    ):
        load_sound(tmp_path / "none.json")
