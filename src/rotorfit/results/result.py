"""What rotorfit knows after a flight: frozen, complete, saves and loads itself."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

import numpy as np
from jaxtyping import Float

from rotorfit.errors import OutputError
from rotorfit.logs.files import write_whole
from rotorfit.results.command_law import CommandLaw, law_from_plain, law_to_plain

Verdict = Literal["identified", "weak", "ratio-only", "not-identified", "given", "removed"]
SCHEMA = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One parameter of the model, with what this experiment says of it.

    Attributes
    ----------
    name, configuration, unit
        `configuration` is None for what all configurations share.
    value, std, interval
        SI; None where the flight does not give them. The interval is 95 %.
    verdict
        ``identified``, ``weak`` (interval wide), ``ratio-only`` (only together with the parameter
        `partner`), ``not-identified``, ``given``, ``removed`` (an unessential parameter).
    partner
        Named under ``with`` in the file.
    reason, advice
        Why the verdict is not better, and what to fly or measure next.
    """

    name: str
    configuration: str | None
    value: float | None
    std: float | None
    interval: tuple[float, float] | None
    unit: str
    verdict: Verdict
    partner: str | None = None
    reason: str | None = None
    advice: str | None = None

    @property
    def full_name(self) -> str:
        """Its name among those of all configurations, such as ``Ixx@A``."""
        return f"{self.name}@{self.configuration}" if self.configuration else self.name


@dataclass(frozen=True, slots=True, kw_only=True)
class Derived:
    """A number computed from the parameters.

    Attributes
    ----------
    name, configuration, unit
        `configuration` is None for what all configurations share.
    value, std, interval
        SI; None where the parameters do not give it. The interval is 95 %.
    """

    name: str
    configuration: str | None
    value: float | None
    std: float | None
    interval: tuple[float, float] | None
    unit: str


Entry = TypeVar("Entry", Parameter, Derived)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRecord:
    """A flight that was used, and what was used of it.

    Attributes
    ----------
    file, sha256
        The log as the experiment file or the command line names it, and its fingerprint; where it
        was found, the settings of the result say.
    configuration
        In which it was flown.
    seconds_used, samples_used
        In the air and without gaps [s].
    used
        Start and end of each stretch, since the first sample [s].
    cuts
        Start and end of what was left out [s], and why.
    warnings
        Doubts about this flight, one sentence each.
    """

    file: str
    sha256: str
    configuration: str
    seconds_used: float
    samples_used: int
    used: tuple[tuple[float, float], ...]
    cuts: tuple[tuple[float, float, str], ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationResult:
    """Parameters with intervals and verdicts, and everything needed to judge them.

    Attributes
    ----------
    name, method
        Of the experiment; the estimator that was used.
    parameters, derived
        The numbers, SI.
    validation
        Relative errors on flights kept apart, one entry a flight.
    flights
        What was used of each.
    covariance_names, covariance
        Of the parameters that have a value and are not given, as ``name`` or
        ``name@configuration``.
    settings
        The whole resolved experiment.
    versions
        Of rotorfit and the libraries that did the arithmetic.
    warnings
        What to doubt, one sentence each.
    axes
        Of every vector.
    diagnostics
        The numbers behind the warnings.
    command_law
        The motors' law from command to speed, where a log has both; None elsewhere.
    """

    name: str
    method: str
    parameters: tuple[Parameter, ...]
    derived: tuple[Derived, ...]
    validation: tuple[Mapping[str, Any], ...] = ()
    flights: tuple[FlightRecord, ...]
    covariance_names: tuple[str, ...]
    covariance: Float[np.ndarray, "p p"]
    settings: Mapping[str, Any]
    versions: Mapping[str, str]
    warnings: tuple[str, ...] = ()
    axes: str = "FLU"
    diagnostics: Mapping[str, float] = field(default_factory=dict[str, float])
    command_law: CommandLaw | None = None

    def parameter(self, name: str, configuration: str | None = None) -> Parameter:
        """Return one parameter; the configuration may be left out where there is one.

        Raises
        ------
        KeyError
            If there is none of that name, or one in each of several configurations.
        """
        return _one(self.parameters, name, configuration, what="parameter")

    def derived_value(self, name: str, configuration: str | None = None) -> Derived:
        """Return one derived number; the configuration may be left out where there is one.

        Raises
        ------
        KeyError
            If there is none of that name, or one in each of several configurations.
        """
        return _one(self.derived, name, configuration, what="derived number")

    def to_json(self) -> str:
        """Return the result as JSON text."""
        return json.dumps(_plain(self), indent=1, allow_nan=False) + "\n"

    def save(self, path: Path | str, *, force: bool = False) -> None:
        """Write the result as JSON, whole or not at all.

        Raises
        ------
        OutputError
            If the file exists and `force` is false, or cannot be written.
        """
        write_whole(Path(path), self.to_json(), force=force)

    @staticmethod
    def load(path: Path | str) -> "IdentificationResult":
        """Read a saved result.

        Raises
        ------
        OutputError
            If the file is not a rotorfit result of a version that this one reads.
        """
        path = Path(path)
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, ValueError) as error:
            raise OutputError(
                f"{path} is not a rotorfit result ({error}); give the JSON file that "
                "rotorfit identify -o wrote"
            ) from error
        return _from_plain(data, path)

    def __str__(self) -> str:
        known = sum(p.verdict == "identified" for p in self.parameters)
        return f"{self.name}: {known} of {len(self.parameters)} parameters identified"


def _one(entries: Sequence[Entry], name: str, configuration: str | None, *, what: str) -> Entry:
    """Return the entry of a name and, where that is not None, of a configuration."""
    named = [entry for entry in entries if entry.name == name]
    if not named:
        known = ", ".join(dict.fromkeys(entry.name for entry in entries))
        raise KeyError(f"no {what} {name!r} in this result; it has {known}")
    found = [entry for entry in named if configuration in (None, entry.configuration)]
    owners = ", ".join(str(entry.configuration) for entry in named)
    if not found:
        shared = [entry.configuration for entry in named] == [None]
        of = "all configurations together: leave the configuration out" if shared else owners
        raise KeyError(f"no {what} {name!r} of {configuration!r} in this result; it is of {of}")
    if len(found) > 1:
        raise KeyError(
            f"{what} {name!r} is of several configurations ({owners}): name one, "
            f"as in ({name!r}, {found[0].configuration!r})"
        )
    return found[0]


def _plain(result: IdentificationResult) -> dict[str, Any]:
    """Return the result in the words of the file format."""
    parameters = [_renamed(dataclasses.asdict(p), "partner", "with") for p in result.parameters]
    plain: dict[str, Any] = {
        "schema": SCHEMA,
        "name": result.name,
        "method": result.method,
        "axes": result.axes,
        "parameters": parameters,
        "derived": [dataclasses.asdict(d) for d in result.derived],
        "validation": [dict(v) for v in result.validation],
        "flights": [dataclasses.asdict(f) for f in result.flights],
        "covariance": {
            "names": list(result.covariance_names),
            "matrix": result.covariance.tolist(),
        },
        "settings": dict(result.settings),
        "versions": dict(result.versions),
        "warnings": list(result.warnings),
        "diagnostics": dict(result.diagnostics),
        "command_law": law_to_plain(result.command_law),
    }
    return cast("dict[str, Any]", _without_nan(plain))


def _renamed(entry: dict[str, Any], old: str, new: str) -> dict[str, Any]:
    return {new if key == old else key: value for key, value in entry.items()}


def _without_nan(value: Any) -> Any:
    """Return the value with every number that JSON cannot hold replaced by null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {k: _without_nan(v) for k, v in cast("dict[str, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [_without_nan(v) for v in cast("list[Any]", value)]
    return value


def _from_plain(data: Any, path: Path) -> IdentificationResult:
    try:
        if data["schema"] != SCHEMA:
            raise OutputError(
                f"{path} has schema {data['schema']}, this rotorfit reads {SCHEMA}; "
                "identify again, or use the version that wrote it"
            )
        names = tuple(data["covariance"]["names"])
        matrix = np.array(data["covariance"]["matrix"], dtype=float)
        return IdentificationResult(
            name=data["name"],
            method=data["method"],
            axes=data["axes"],
            parameters=tuple(
                Parameter(**_tupled(_renamed(p, "with", "partner"))) for p in data["parameters"]
            ),
            derived=tuple(Derived(**_tupled(d)) for d in data["derived"]),
            validation=tuple(data["validation"]),
            flights=tuple(_flight_record(f) for f in data["flights"]),
            covariance_names=names,
            covariance=matrix.reshape(len(names), len(names)),
            settings=data["settings"],
            versions=data["versions"],
            warnings=tuple(data["warnings"]),
            diagnostics=data.get("diagnostics", {}),
            command_law=law_from_plain(data.get("command_law")),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise OutputError(
            f"{path} is not a rotorfit result (at {error}); give the JSON file that "
            "rotorfit identify -o wrote"
        ) from error


def _tupled(entry: dict[str, Any]) -> dict[str, Any]:
    interval = entry["interval"]
    return {**entry, "interval": None if interval is None else tuple(interval)}


def _flight_record(entry: dict[str, Any]) -> FlightRecord:
    fields: dict[str, Any] = dict(entry)
    fields["used"] = tuple((a, b) for a, b in entry["used"])
    fields["cuts"] = tuple((a, b, why) for a, b, why in entry["cuts"])
    fields["warnings"] = tuple(entry["warnings"])
    return FlightRecord(**fields)
