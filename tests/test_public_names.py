"""`import rotorfit`: every public name is there, is documented, and costs nothing until used."""

import ast
import dataclasses
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import rotorfit

SOURCE = Path(rotorfit.__file__).read_text(encoding="utf-8")


def stated_names() -> dict[str, str]:
    """Return what type checkers see: each name, and the module it is imported from."""
    imports = [node for node in ast.walk(ast.parse(SOURCE)) if isinstance(node, ast.ImportFrom)]
    return {
        alias.asname: str(node.module) for node in imports for alias in node.names if alias.asname
    }


NAMES = stated_names()


def test_what_type_checkers_see_is_what_python_finds():
    assert set(dir(rotorfit)) == set(NAMES)
    for name, module in NAMES.items():
        if name != "__version__":
            found = getattr(rotorfit, name)
            found = found.__wrapped__ if inspect.isfunction(found) else found
            assert found is getattr(sys.modules[module], name)


def test_unknown_name_is_refused_in_pythons_own_words():
    with pytest.raises(AttributeError, match="module 'rotorfit' has no attribute 'indentify'"):
        rotorfit.indentify  # noqa: B018


def test_import_is_free():
    probe = "import sys, rotorfit; print('numpy' in sys.modules, 'pydantic' in sys.modules)"
    ended = subprocess.run(
        [sys.executable, "-c", probe], capture_output=True, text=True, check=True
    )
    assert ended.stdout.split() == ["False", "False"]


def functions() -> list[str]:
    return [name for name in NAMES if inspect.isfunction(getattr(rotorfit, name))]


def classes() -> list[str]:
    return [name for name in NAMES if dataclasses.is_dataclass(getattr(rotorfit, name))]


@pytest.mark.parametrize("name", sorted(NAMES.keys() - {"__version__"}))
def test_docstring(name):
    text = inspect.getdoc(getattr(rotorfit, name)) or ""
    first = text.partition("\n")[0]
    assert first.endswith((".", ":"))
    assert not text.startswith(f"{name}(")  # what dataclasses say of themselves


def described(thing: object) -> set[str]:
    """Return the words of a docstring that stand where arguments and attributes are named."""
    lines = (inspect.getdoc(thing) or "").splitlines()
    return {word for line in lines if line[:1].strip() for word in line.split(", ")}


@pytest.mark.parametrize("name", sorted(functions()))
def test_every_argument_of_a_function_is_described(name):
    function = getattr(rotorfit, name)
    assert set(inspect.signature(function).parameters) <= described(function)


@pytest.mark.parametrize("name", sorted(classes()))
def test_every_field_of_a_class_is_described(name):
    data = getattr(rotorfit, name)
    assert {field.name for field in dataclasses.fields(data)} <= described(data)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("FlightData", "[rad/s^2]"),
        ("FlightLog", "[s]"),
        ("Channel", "[s]"),
        ("MotorModel", "[s]"),
        ("PreparedFlight", "[rad/s]"),
        ("Rotor", "[m]"),
        ("Vehicle", "[m]"),
        ("WrenchComparison", "[N, N m]"),
        ("LoopMeasures", "[Hz]"),
        ("loop_margins", "SI"),
        ("PlanRequest", "[kg]"),
        ("Projected", "SI"),
        ("Parameter", "SI"),
        ("Derived", "SI"),
        ("FlightRecord", "[s]"),
        ("prepare", "[m]"),
        ("layout_rotors", "[m]"),
        ("simulate", "[s]"),
        ("validate_file", "[Hz]"),
        ("write_export", "SI"),
        ("single_flight_experiment", "[kg]"),
        ("wanted_accuracy", "mm"),
    ],
)
def test_units_are_said(name, unit):
    assert unit in (inspect.getdoc(getattr(rotorfit, name)) or "")
