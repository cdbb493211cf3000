"""The form of the page: the tables of an experiment file as JSON, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, cast

from rotorfit.app.files import Dropped, dropped, file_named
from rotorfit.errors import ExperimentError
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.fit.experiment.experiment import Experiment, airframe_of_tables, experiment_of_tables
from rotorfit.fit.experiment.toml_files import (
    experiment_text,
    file_as_table,
    files_as_tables,
    read_toml,
    refuse_too_many_values,
    with_known_motors,
)
from rotorfit.logs.files import file_name

SOURCE: Final = Path("experiment.toml")
FLIGHTS: Final = ("flights", "validation")
Problem = tuple[str, str]
"""A place in the form and a sentence."""


def described(folder: Path, form: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a form: its experiment file, or what is wrong with it, and its rotors."""
    problems: list[Problem] = []
    try:
        experiment_of(folder, form)
    except ExperimentError as error:
        problems += error.problems or [("", str(error))]
    return {
        "text": None if problems else text_of(form),
        "problems": [{"place": place, "words": words} for place, words in problems],
        "rotors": _list_rotors(form),
    }


def text_of(form: Mapping[str, Any]) -> str:
    """Write the experiment file of a form that describes an experiment."""
    return experiment_text(
        {**form, "configuration": [_shorten_flights(c) for c in form["configuration"]]}
    )


def _shorten_flights(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Replace flights of a configuration by their names, where they are nothing but that."""
    short = dict(entry)
    for kind in FLIGHTS:
        flights = [flight for flight in rows(entry.get(kind)) if flight]
        if flights and all(set(flight) == {"file"} for flight in flights):
            short[kind] = [flight["file"] for flight in flights]
    return short


def experiment_of(folder: Path, form: Mapping[str, Any]) -> Experiment:
    """Check a form from the page, which may hold anything; its flights are files of the page."""
    refuse_too_many_values(form, SOURCE)
    files = {one.name: one for one in dropped(folder)}
    missing = _list_missing_flights(form, files)
    tables = _with_known_motors(folder, form)

    def place(name: str) -> Path:
        return files[name].path if name in files else Path(name)

    try:
        experiment = experiment_of_tables(tables, source=SOURCE, place=place)
    except ExperimentError as error:
        every = [*(error.problems or [("", str(error))]), *missing]
        raise ExperimentError(str(error), problems=every) from error
    if missing:
        message = "; ".join(sentence for _, sentence in missing)
        raise ExperimentError(message, problems=missing)
    return experiment


def _list_missing_flights(form: Mapping[str, Any], files: Mapping[str, Dropped]) -> list[Problem]:
    """List the flights that are no log of the page, or one of several without its number."""
    problems: list[Problem] = []
    for place, flight in _named_flights(form):
        name = flight.get("file")
        file = files.get(name) if isinstance(name, str) else None
        description: Mapping[str, Any] = {} if file is None else file.description
        if file is None:
            problems.append((place, f"no file {name} is on the page: drop it here"))
        elif description.get("kind", "log") != "log":
            problems.append((place, f"{name} is no flight log: name one"))
        elif description.get("logs") and flight.get("log") is None:
            count = len(description["logs"])
            problems.append((place, f"{name} holds {count} logs: choose one"))
        pose = flight.get("mocap")
        recording = pose if isinstance(pose, str) else table(pose).get("file")
        if recording is not None and recording not in files:
            problems.append((place, f"no file {recording} is on the page: drop it here"))
    return problems


def _named_flights(form: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield every flight that is well enough written to be looked up, with its place."""
    for number, entry in enumerate(rows(form.get("configuration"))):
        for kind in FLIGHTS:
            for i, flight in enumerate(rows(table(entry).get(kind))):
                one = {"file": flight} if isinstance(flight, str) else table(flight)
                if one:
                    yield f"configuration[{number}].{kind}[{i}].file", one


def rows(value: Any) -> Sequence[Any]:
    """Return a list of the form; empty if it is not one."""
    return cast("list[Any]", value) if isinstance(value, list) else []


def table(value: Any) -> Mapping[str, Any]:
    """Return a table of the form; empty if it is not one."""
    return cast("Mapping[str, Any]", value) if isinstance(value, Mapping) else {}


def _with_known_motors(folder: Path, form: Mapping[str, Any]) -> dict[str, Any]:
    """Add law and lag from a result of the page to a form, where it names one."""
    tables = dict(form)
    motors = table(tables.get("motors"))
    if not isinstance(motors.get("result"), str):
        return tables
    try:
        result = file_named(folder, file_name(motors["result"]))
        tables["motors"] = {**motors, "result": str(result.path)}
        return with_known_motors(tables, folder)
    except ExperimentError as error:
        raise ExperimentError(str(error), problems=[("motors.result", str(error))]) from error


def _list_rotors(form: Mapping[str, Any]) -> list[dict[str, Any]] | None:
    """List the rotors of a form as soon as its airframe is whole, from the centre, FLU [m]."""
    try:
        known = airframe_of_tables({"airframe": form.get("airframe")}, source=SOURCE)
        vehicle = vehicle_of(known.airframe)
    except ExperimentError:
        return None
    return [{"position": list(r.position), "spin": r.spin} for r in vehicle.rotors]


def form_of_file(path: Path) -> dict[str, Any]:
    """Read the form from an experiment or airframe file, its flights by the last part of names."""
    tables = read_toml(path)
    bare = dict(tables)
    if isinstance(tables.get("motors"), dict):
        bare["motors"] = {k: v for k, v in tables["motors"].items() if k != "result"}
    if "configuration" not in tables:
        airframe_of_tables(bare, source=path)
        return tables
    experiment_of_tables(bare, source=path, place=Path)
    return {**tables, "configuration": [_written_out(entry) for entry in tables["configuration"]]}


def _written_out(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Write every flight of a configuration as a table, by the last part of its name."""
    whole = files_as_tables(entry, FLIGHTS)
    for kind in FLIGHTS:
        if kind in whole:
            whole[kind] = [_by_file_name(flight) for flight in whole[kind]]
    return whole


def _by_file_name(flight: dict[str, Any]) -> dict[str, Any]:
    named: dict[str, Any] = {**file_as_table(flight, "mocap")}
    named["file"] = file_name(flight["file"])
    if "mocap" in named:
        named["mocap"] = {**named["mocap"], "file": file_name(named["mocap"]["file"])}
    return named


def files_of(form: Mapping[str, Any]) -> list[str]:
    """List the names of all files that a form wants."""
    names = [str(flight["file"]) for _, flight in _named_flights(form)]
    poses = [str(f["mocap"]["file"]) for _, f in _named_flights(form) if "mocap" in f]
    return list(dict.fromkeys([*names, *poses]))
