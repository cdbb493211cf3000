"""The form of the page: the tables of an experiment file as JSON, and what is wrong with them."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, cast

from rotorfit.app.files import Dropped, dropped, file_named
from rotorfit.errors import ExperimentError
from rotorfit.experiment.declared_vehicle import vehicle_of
from rotorfit.experiment.experiment import Experiment, airframe_of_tables, experiment_of_tables
from rotorfit.experiment.toml_files import (
    file_as_table,
    files_as_tables,
    read_toml,
    refuse_too_many_values,
    with_known_motors,
)
from rotorfit.experiment.toml_text import experiment_text
from rotorfit.logs.files import file_name

SOURCE: Final = Path("experiment.toml")
FLIGHTS: Final = ("flights", "validation")
Problem = tuple[str, str]
"""A place in the form and a sentence."""


def described(folder: Path, form: Mapping[str, Any]) -> dict[str, Any]:
    """Return the experiment file of a form, or what is wrong with it, and its rotors."""
    problems: list[Problem] = []
    try:
        experiment_of(folder, form)
    except ExperimentError as error:
        problems += error.problems or [("", str(error))]
    return {
        "text": None if problems else text_of(form),
        "problems": [{"place": place, "words": words} for place, words in problems],
        "rotors": _rotors(form),
    }


def text_of(form: Mapping[str, Any]) -> str:
    """Return the experiment file of a form that describes an experiment."""
    return experiment_text({**form, "configuration": [_short(c) for c in form["configuration"]]})


def _short(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration whose flights are names, where they are nothing but that."""
    short = dict(entry)
    for kind in FLIGHTS:
        flights = [flight for flight in rows(entry.get(kind)) if flight]
        if flights and all(set(flight) == {"file"} for flight in flights):
            short[kind] = [flight["file"] for flight in flights]
    return short


def experiment_of(folder: Path, form: Mapping[str, Any]) -> Experiment:
    """Return the experiment of a form, its flights being files of the page.

    Parameters
    ----------
    folder
        Of the page.
    form
        As the page sent it; anything may be in it.

    Raises
    ------
    ExperimentError
        With every place that is wrong.
    """
    refuse_too_many_values(form, SOURCE)
    files = {one.name: one for one in dropped(folder)}
    missing = _missing(form, files)
    tables = _with_known_motors(folder, form)

    def place(name: str) -> Path:
        return files[name].path if name in files else Path(name)

    try:
        experiment = experiment_of_tables(tables, source=SOURCE, place=place)
    except ExperimentError as error:
        every = [*(error.problems or [("", str(error))]), *missing]
        raise ExperimentError(str(error), problems=every) from error
    if missing:
        words = "; ".join(sentence for _, sentence in missing)
        raise ExperimentError(words, problems=missing)
    return experiment


def _missing(form: Mapping[str, Any], files: Mapping[str, Dropped]) -> list[Problem]:
    """Return the flights that are no log of the page, or one of several without its number."""
    problems: list[Problem] = []
    for place, flight in _flights(form):
        name = flight.get("file")
        told = files[name].told if isinstance(name, str) and name in files else None
        if told is None:
            problems.append((place, f"no file {name} is on the page: drop it here"))
        elif told.get("kind", "log") != "log":
            problems.append((place, f"{name} is no flight log: name one"))
        elif told.get("logs") and flight.get("log") is None:
            problems.append((place, f"{name} holds {len(told['logs'])} logs: choose one"))
        pose = flight.get("mocap")
        recording = pose if isinstance(pose, str) else table(pose).get("file")
        if recording is not None and recording not in files:
            problems.append((place, f"no file {recording} is on the page: drop it here"))
    return problems


def _flights(form: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield every flight that is well enough written to be looked up, with its place."""
    for number, entry in enumerate(rows(form.get("configuration"))):
        for kind in FLIGHTS:
            for i, flight in enumerate(rows(table(entry).get(kind))):
                one = {"file": flight} if isinstance(flight, str) else table(flight)
                if one:
                    yield f"configuration[{number}].{kind}[{i}].file", one


def rows(value: Any) -> Sequence[Any]:
    """Return a list of the form; empty where it is none."""
    return cast("list[Any]", value) if isinstance(value, list) else []


def table(value: Any) -> Mapping[str, Any]:
    """Return a table of the form; empty where it is none."""
    return cast("Mapping[str, Any]", value) if isinstance(value, Mapping) else {}


def _with_known_motors(folder: Path, form: Mapping[str, Any]) -> dict[str, Any]:
    """Return the form with law and lag from a result of the page, where it names one."""
    tables = dict(form)
    own = table(tables.get("motors"))
    if not isinstance(own.get("result"), str):
        return tables
    try:
        known = file_named(folder, file_name(own["result"]))
        tables["motors"] = {**own, "result": str(known.path)}
        return with_known_motors(tables, folder)
    except ExperimentError as error:
        raise ExperimentError(str(error), problems=[("motors.result", str(error))]) from error


def _rotors(form: Mapping[str, Any]) -> list[dict[str, Any]] | None:
    """Return the rotors of a form as soon as its airframe is whole, from the centre, FLU [m]."""
    try:
        known = airframe_of_tables({"airframe": form.get("airframe")}, source=SOURCE)
        vehicle = vehicle_of(known.airframe)
    except ExperimentError:
        return None
    return [{"position": list(r.position), "spin": r.spin} for r in vehicle.rotors]


def form_of_file(path: Path) -> dict[str, Any]:
    """Return the form that an experiment or airframe file fills, its flights by their own names.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ExperimentError
        If it is none.
    """
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
    """Return a configuration with every flight as a table, by the last part of its name."""
    whole = files_as_tables(entry, FLIGHTS)
    for kind in FLIGHTS:
        if kind in whole:
            whole[kind] = [_by_own_name(flight) for flight in whole[kind]]
    return whole


def _by_own_name(flight: dict[str, Any]) -> dict[str, Any]:
    named: dict[str, Any] = {**file_as_table(flight, "mocap")}
    named["file"] = file_name(flight["file"])
    if "mocap" in named:
        named["mocap"] = {**named["mocap"], "file": file_name(named["mocap"]["file"])}
    return named


def files_of(form: Mapping[str, Any]) -> list[str]:
    """Return the names of all files that a form wants."""
    names = [str(flight["file"]) for _, flight in _flights(form)]
    poses = [str(f["mocap"]["file"]) for _, f in _flights(form) if "mocap" in f]
    return list(dict.fromkeys([*names, *poses]))
