"""The experiment file: what was flown, with which vehicle, and what is known of it.

The file is TOML (see the README); unknown keys are refused with the nearest known one, and every
message names the place in the file. Paths of flights are relative to the file.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, TypeVar

from pydantic import BaseModel, Field, ValidationError, model_validator

from rotorfit.errors import ExperimentError, LogError
from rotorfit.fit.experiment.airframe_table import (
    LONGEST_ARM,
    AirframeEntry,
    Axes,
    ImuEntry,
    RotorEntry,
)
from rotorfit.fit.experiment.flight_entries import ColumnEntry, FlightEntry, RecordingEntry, Source
from rotorfit.fit.experiment.law_table import (
    DeclaredLaw,
    LawTable,
    PowerEntry,
    SqrtEntry,
    VoltageEntry,
)
from rotorfit.fit.experiment.strict_tables import (
    Finite,
    NotNegative,
    Positive,
    Strict,
    Terms,
    Vector,
    problem_sentences,
)
from rotorfit.fit.experiment.toml_files import (
    files_as_tables,
    read_toml,
    with_known_motors,
    with_payload_masses,
)
from rotorfit.logs.columns import NAMES
from rotorfit.logs.flight_log import LagOn
from rotorfit.logs.read import format_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

Model = TypeVar("Model", bound=BaseModel)
Speed = Literal["measured", "commanded"]


Lag = Annotated[NotNegative, Field(le=1.0)]
"""Time constant of a motor [s]: nothing hovers on motors that take a second."""


class MotorsEntry(Strict):
    """The ``[motors]`` table."""

    speed: Speed = "measured"
    law: DeclaredLaw | None = None
    lag: Lag | None = None
    lag_std: Lag = 0.0
    lag_down: Lag | None = None
    delay: Finite | None = Field(default=None, ge=-0.1, le=0.1)
    poles: int | None = Field(default=None, ge=2, le=60)
    lag_on: LagOn | None = None

    @property
    def law_is_relative(self) -> bool:
        """Whether rotor speed is in parts of its largest: no law, or one that ends at 1."""
        return self.law is None or self.law.is_relative

    @model_validator(mode="after")
    def _belongs_to_commands(self) -> MotorsEntry:
        if self.speed == "measured" and (self.law is not None or self.lag or self.lag_on):
            raise ValueError("law and lag belong to speed = 'commanded'; measured speed has both")
        if self.lag is None and (self.lag_std or self.lag_down is not None):
            raise ValueError("lag_std and lag_down belong to lag, the time constant [s]")
        if self.lag_std and self.lag_down is not None:
            raise ValueError(
                "lag_down is for a response that is known; with lag_std the flights refine it, "
                "rising and falling apart where they ask for it: leave lag_down out"
            )
        return self


LEAST_MISWEIGHED: Final = 0.002
MISWEIGHED: Final = 0.004
"""Difference between what a payload weighs and what its vehicle gained by it, that two scales may
make [kg]: at least, and as a share of the mass."""


class PayloadEntry(Strict):
    """One item of a known payload: mass [kg] and position of its centre from the origin [m]."""

    mass: Positive
    position: Vector
    mass_std: NotNegative = 0.0
    position_std: NotNegative = 0.0

    @model_validator(mode="after")
    def _is_on_the_vehicle(self) -> PayloadEntry:
        distance = math.hypot(*self.position)
        if distance > LONGEST_ARM:
            raise ValueError(
                f"the payload is {distance:.4g} m from the body origin, expected up to "
                f"{LONGEST_ARM:g} m: positions are in metres (25 cm is 0.25)"
            )
        return self


class ConfigurationEntry(Strict):
    """One ``[[configuration]]``: a mass and the flights flown with it."""

    name: str = "A"
    mass: Positive | Literal["unknown"]
    mass_std: NotNegative = 0.0
    weight: Positive = 1.0
    flights: tuple[FlightEntry, ...] = Field(min_length=1)
    validation: tuple[FlightEntry, ...] = ()
    payload: tuple[PayloadEntry, ...] = ()
    payload_of: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _plain_names(cls, data: Any) -> Any:
        return files_as_tables(data, ("flights", "validation"))

    @model_validator(mode="after")
    def _each_flight_once(self) -> ConfigurationEntry:
        for number, flight in enumerate(self.flights):
            before = self.flights[:number]
            if any(one.file == flight.file and one.overlaps(flight) for one in before):
                raise ValueError(
                    f"flight {flight.file!r} is listed twice, with the same time or a part of it; "
                    "it would count twice"
                )
        return self


class IdentificationEntry(Strict):
    """The ``[identification]`` table; what is not written has a good default."""

    source: Source = "imu"
    method: Literal["banded", "ols", "tls"] = "banded"
    preset: Literal["paper"] | None = None
    terms: Terms | None = None
    cutoff: Positive | None = None
    r_sigma: Positive | None = None

    @property
    def in_bands(self) -> bool:
        """Whether the method looks at frequency bands, not at every sample."""
        return self.preset != "paper" and self.method != "tls"


class Experiment(Strict):
    """The whole experiment, checked: a pydantic model of the experiment file, SI units.

    Attributes
    ----------
    name
        For people.
    airframe
        The rotors, the place of the IMU, the axes of every vector in the file.
    motors
        Whether rotor speed is measured, else how it comes from the command.
    identification
        Method and source of the motion; has good defaults.
    configuration
        One or several loadings of the vehicle, each with its mass and its flights.
    """

    name: str = "experiment"
    airframe: AirframeEntry
    motors: MotorsEntry = MotorsEntry()
    identification: IdentificationEntry = IdentificationEntry()
    configuration: tuple[ConfigurationEntry, ...] = Field(min_length=1)

    @model_validator(mode="before")
    @classmethod
    def _masses_with_payloads(cls, data: Any) -> Any:
        return with_payload_masses(data)

    @model_validator(mode="after")
    def _payloads_fit(self) -> Experiment:
        bodies = {entry.name: entry for entry in self.configuration}
        for entry in self.configuration:
            if bool(entry.payload) != (entry.payload_of is not None):
                raise ValueError(
                    f"configuration {entry.name!r}: payload and payload_of belong together; "
                    "payload is what it carries beyond the configuration named by payload_of"
                )
            if entry.payload_of is not None:
                _refuse_payload(entry, bodies.get(entry.payload_of))
        return self

    @model_validator(mode="after")
    def _names_differ(self) -> Experiment:
        names = [entry.name for entry in self.configuration]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two configurations are named {name!r}; give each its own name")
        return self

    @model_validator(mode="after")
    def _masses_comparable(self) -> Experiment:
        # kt is one for all: per kilogram of one body it is another number than per kilogram of the
        # next.
        unknown = [entry.name for entry in self.configuration if entry.mass == "unknown"]
        if unknown and len(self.configuration) > 1:
            raise ValueError(
                f'configuration {unknown[0]!r}: mass = "unknown" among several configurations, '
                "which share the rotors: weigh it, or identify each configuration by a file of its "
                "own; flights at the same unknown mass belong into one configuration"
            )
        return self


def _refuse_payload(entry: ConfigurationEntry, bare: ConfigurationEntry | None) -> None:
    """Raise an error if a payload does not explain the difference of two configurations."""
    if bare is None or bare is entry or bare.payload_of is not None:
        raise ValueError(
            f"configuration {entry.name!r}: payload_of = {entry.payload_of!r} must name another "
            "configuration, one without a payload of its own"
        )
    if entry.mass == "unknown" or bare.mass == "unknown":
        raise ValueError(f"configuration {entry.name!r}: a known payload needs weighed masses")
    carried = sum(item.mass for item in entry.payload)
    spread = 3.0 * (entry.mass_std + bare.mass_std + sum(i.mass_std for i in entry.payload))
    off = entry.mass - bare.mass - carried
    if abs(off) > max(LEAST_MISWEIGHED, MISWEIGHED * entry.mass) + spread:
        raise ValueError(
            f"configuration {entry.name!r} weighs {entry.mass - bare.mass:.3f} kg more than "
            f"{bare.name!r}, but its payload {carried:.3f} kg; weigh again, or list all it carries"
        )


class TableEntry(Strict):
    """The ``[table]`` of a file: how flight tables of this vehicle are read."""

    axes: Axes = "FLU"
    columns: dict[str, ColumnEntry | str]


class AirframeFile(Strict):
    """A file with ``[airframe]`` and ``[motors]``, for ``identify LOG --airframe``.

    Its ``[table]``, if any, names the columns of logs that are tables.
    """

    airframe: AirframeEntry
    motors: MotorsEntry = MotorsEntry()
    table: TableEntry | None = None


class ExperimentFile(Experiment):
    """An experiment file: its ``[table]``, if any, names the columns of flights that are tables."""

    table: TableEntry | None = None


def load_experiment(path: Path) -> Experiment:
    """Return the experiment of a TOML file, its flights' paths made absolute.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ExperimentError
        If the file is missing, not TOML, or not an experiment; every place that is wrong is named.
    """
    tables = with_known_motors(read_toml(path), path.parent)
    if "airframe" in tables and "configuration" not in tables:
        raise ExperimentError(
            f"{path}: this is an airframe file, without [[configuration]] and flights: give a log "
            f"with it (rotorfit identify LOG --mass KG --airframe {path.name}), or add "
            '[[configuration]] with mass and flights = ["LOG"]'
        )
    return experiment_of_tables(tables, source=path, place=lambda file: path.parent / file)


def experiment_of_tables(
    tables: Mapping[str, Any], *, source: Path, place: Callable[[str], Path]
) -> Experiment:
    """Check the tables of an experiment file; `place` finds the file of a flight by its name.

    The ExperimentError names the source and every place that is wrong.
    """
    read = _validate_table(ExperimentFile, tables, source)
    parts = {name: getattr(read, name) for name in Experiment.model_fields}
    parts["configuration"] = tuple(_place_flights(c, place, read.table) for c in read.configuration)
    return _by_pose(Experiment.model_construct(read.model_fields_set - {"table"}, **parts))


def airframe_of_tables(tables: Mapping[str, Any], *, source: Path) -> AirframeFile:
    """Check airframe and motors in the tables of an airframe or experiment file."""
    return _validate_table(AirframeFile, _without_flights(tables), source)


def single_flight_experiment(
    log: Path,
    *,
    mass: float | Literal["unknown"],
    airframe: Path | Mapping[str, Any],
    log_number: int | None = None,
) -> Experiment:
    """Return the experiment of one log, a mass and an airframe file.

    Parameters
    ----------
    log
        The flight.
    mass
        Weighed as it flew [kg], or ``"unknown"``: then everything is per kilogram.
    airframe
        TOML file with the tables ``[airframe]`` and ``[motors]``, or an experiment file, which has
        them too; or these tables.
    log_number
        Which log of a file with several, from 1.

    Raises
    ------
    ExperimentError
        As `load_experiment`.
    """
    source = airframe if isinstance(airframe, Path) else log
    tables = read_toml(airframe) if isinstance(airframe, Path) else airframe
    known = _validate_table(
        AirframeFile, with_known_motors(_without_flights(tables), source.parent), source
    )
    flight = with_columns(named_flight(log, log_number=log_number), known.table)
    described = {
        "name": log.stem,
        "airframe": known.airframe,
        "motors": known.motors,
        "configuration": [{"mass": mass, "flights": [flight]}],
    }
    return _by_pose(_validate_table(Experiment, described, source))


def _by_pose(experiment: Experiment) -> Experiment:
    """Take the motion from poses where no flight's columns have more, and no source is stated."""
    entry = experiment.identification
    flights = [f for c in experiment.configuration for f in (*c.flights, *c.validation)]
    if "source" in entry.model_fields_set or not all(_is_pose_alone(f.columns) for f in flights):
        return experiment
    by_pose = entry.model_copy(update={"source": "mocap"})
    return experiment.model_copy(update={"identification": by_pose})


def _is_pose_alone(columns: Mapping[str, object] | None) -> bool:
    names = set(columns or {})
    has_imu = names.issuperset((*NAMES["gyro"], *NAMES["accel"]))
    return not has_imu and names.issuperset(NAMES["position"])


def with_columns(flight: FlightEntry, table: TableEntry | None) -> FlightEntry:
    """Give a flight that is a table, or a ROS bag, the columns map of a file that is for such."""
    if table is None or flight.columns is not None:
        return flight
    names = [c if isinstance(c, str) else c.name for c in table.columns.values()]
    is_for_bags = all(name.startswith("/") and "." in name for name in names)
    form = format_of(Path(flight.file))
    is_bag = form is not None and form.name == "rosbag"
    if not (is_for_bags if is_bag else _is_unknown_table(Path(flight.file))):
        return flight
    return flight.model_copy(update={"columns": table.columns, "axes": table.axes})


def _is_unknown_table(path: Path) -> bool:
    """Decide whether a file is a table whose columns do not carry rotorfit's own names."""
    from rotorfit.logs.proposal import explains_itself  # for tables alone

    form = format_of(path)
    try:
        return form is not None and form.name == "table" and not explains_itself(path)
    except LogError:
        return True  # which is said when it is read


def _without_flights(data: Mapping[str, Any]) -> dict[str, Any]:
    """Select the tables that airframe and experiment files both have."""
    is_experiment = "configuration" in data
    other = set(Experiment.model_fields) - set(AirframeFile.model_fields) if is_experiment else ()
    return {key: value for key, value in data.items() if key not in other}


def named_flight(
    path: Path,
    *,
    log_number: int | None = None,
    start: float | None = None,
    end: float | None = None,
) -> FlightEntry:
    """Make the entry of a flight that no experiment file names, used from start to end [s]."""
    described = {"file": str(path), "log": log_number, "start": start, "end": end}
    return _validate_table(FlightEntry, described, path).placed(path)


def unseen_entry(
    path: Path,
    experiment: Experiment,
    *,
    log_number: int | None = None,
    start: float | None = None,
    end: float | None = None,
) -> FlightEntry:
    """Make the entry of another flight of a result's vehicle.

    A table is read by the columns by which the result's flights were read.
    """
    flights = [f for c in experiment.configuration for f in (*c.flights, *c.validation)]
    maps = (TableEntry(axes=f.axes, columns=dict(f.columns)) for f in flights if f.columns)
    entry = named_flight(path, log_number=log_number, start=start, end=end)
    return with_columns(entry, next(maps, None))


def experiment_of_settings(settings: Mapping[str, Any]) -> Experiment:
    """Recover the experiment that a result was made from."""
    described = {key: value for key, value in settings.items() if key != "used"}
    airframe = dict(described.get("airframe", {}))
    if "rotors" in airframe:
        airframe.pop("order", None)  # the resolved default of a key that belongs to layouts
        described["airframe"] = airframe
    return _validate_table(Experiment, described, Path("settings of the result"))


def _place_flights(
    configuration: ConfigurationEntry, place: Callable[[str], Path], table: TableEntry | None
) -> ConfigurationEntry:
    lists = {"flights": configuration.flights, "validation": configuration.validation}
    return configuration.model_copy(
        update={
            key: tuple(with_columns(_found_from(f, place), table) for f in flights)
            for key, flights in lists.items()
        }
    )


def _found_from(flight: FlightEntry, place: Callable[[str], Path]) -> FlightEntry:
    """Make the paths of a flight absolute."""
    placed = flight.placed(place(flight.file))
    if flight.mocap is None:
        return placed
    pose = {"file": str(place(flight.mocap.file).absolute())}
    return placed.model_copy(update={"mocap": flight.mocap.model_copy(update=pose)})


def _validate_table(kind: type[Model], data: Any, path: Path) -> Model:
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        known = {name for table in _TABLES for name in table.model_fields}
        problems = problem_sentences(error.errors(), sorted(known))
        sentences = "; ".join(sentence for _, sentence in problems)
        raise ExperimentError(f"{path.name}: {sentences}", problems=problems) from None


_TABLES: tuple[type[BaseModel], ...] = (
    ExperimentFile,
    AirframeEntry,
    RotorEntry,
    ImuEntry,
    MotorsEntry,
    LawTable,
    SqrtEntry,
    PowerEntry,
    VoltageEntry,
    IdentificationEntry,
    ConfigurationEntry,
    PayloadEntry,
    FlightEntry,
    RecordingEntry,
    ColumnEntry,
    TableEntry,
)
