"""The result of an identification: frozen, complete, saves and loads itself."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar, cast

import numpy as np

from rotorfit.checks.verdicts.judge import Derived as Derived
from rotorfit.checks.verdicts.judge import Parameter as Parameter
from rotorfit.checks.verdicts.judge import Verdict as Verdict
from rotorfit.checks.verdicts.judge import body_verdict, twin_of
from rotorfit.digits import with_interval
from rotorfit.errors import EstimationError, OutputError
from rotorfit.findings import Finding, doubt, finding_from_plain, finding_to_plain, sentences
from rotorfit.fit.intervals.interval_terms import NumberTerm
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import write_whole
from rotorfit.logs.read import kind_of
from rotorfit.model.parameters import (
    COM,
    DERIVED,
    EFFECTIVE_UNITS,
    INERTIA_COM,
    PARAMETERS,
    PER_MASS,
)
from rotorfit.results.command_law import CommandLaw, law_from_plain, law_to_plain
from rotorfit.results.samples import Estimated, Samples, draw_vehicles
from rotorfit.sheet import DataFrame, Sheet, frame, sheet_html, sheet_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from jaxtyping import Float


SCHEMA = 2
"""Of a saved result; 2 has the interval terms of every number."""
OLDER = (1,)
"""Schemas that are read as well."""
RESULT_FILE = "a result of rotorfit identify"


Entry = TypeVar("Entry", Parameter, Derived)


@frozen_dataclass
class FlightRecord:
    """A flight, and the part of it that was used.

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
    findings
        Doubts about this flight.
    """

    file: str
    sha256: str
    configuration: str
    seconds_used: float
    samples_used: int
    used: tuple[tuple[float, float], ...]
    cuts: tuple[tuple[float, float, str], ...]
    findings: tuple[Finding, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Doubts about this flight, one sentence each: those of the findings."""
        return sentences(self.findings)


@frozen_dataclass
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
    findings
        What every check found, those that passed included.
    axes
        Of every vector.
    diagnostics
        The numbers behind the findings.
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
    findings: tuple[Finding, ...] = ()
    axes: str = "FLU"
    diagnostics: Mapping[str, float] = field(default_factory=dict[str, float])
    command_law: CommandLaw | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to doubt and to know, one sentence each: those of the findings."""
        return sentences(self.findings)

    @property
    def every_finding(self) -> tuple[Finding, ...]:
        """The findings, and those of the single flights."""
        return (*self.findings, *(one for flight in self.flights for one in flight.findings))

    def parameter(self, name: str, configuration: str | None = None) -> Parameter:
        """Return a parameter; the configuration may be omitted if there is only one.

        Raises
        ------
        KeyError
            If there is none of that name, or one in each of several configurations.
        """
        return _single_entry(self.parameters, name, configuration, what="parameter")

    def derived_value(self, name: str, configuration: str | None = None) -> Derived:
        """Return a derived number; the configuration may be omitted if there is only one.

        Raises
        ------
        KeyError
            If there is none of that name, or one in each of several configurations.
        """
        return _single_entry(self.derived, name, configuration, what="derived number")

    def to_json(self) -> str:
        """Return the result as JSON text."""
        return json.dumps(_plain_result(self), indent=1, allow_nan=False) + "\n"

    def save(self, path: Path | str, *, force: bool = False) -> None:
        """Write the result as JSON, whole or not at all.

        Raises
        ------
        OutputError
            If the file exists and `force` is false, or cannot be written.
        """
        write_whole(Path(path), self.to_json(), force=force)

    @staticmethod
    def load(path: Path | str) -> IdentificationResult:
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
            raise OutputError(_no_result(path, str(error))) from error
        return _from_plain(data, path)

    def samples(self, n: int, seed: int = 0, *, configuration: str | None = None) -> Samples:
        """Return vehicles that can exist, drawn from what the flights leave open.

        Parameters
        ----------
        n
            How many.
        seed
            The same seed gives the same vehicles.
        configuration
            Whose body; may be left out where there is one.

        Returns
        -------
        Samples
            Bodies and rotors by the names of parameters and derived numbers, SI; the share of the
            draws that was rejected, because no vehicle can be so, is said.

        Raises
        ------
        EstimationError
            If the mass is unknown, or hardly a draw can exist.
        KeyError
            If there is no such configuration, or several and none is named.
        """
        if n < 1:
            raise ValueError(f"{n} samples; expected 1 or more")
        mass = self.parameter("mass", configuration)
        if mass.value is None:
            raise EstimationError(
                "the mass is unknown, and all is per kilogram: identify again with --mass KG (or "
                "mass = KG in the experiment file) to draw vehicles"
            )
        own = [p for p in self.parameters if p.configuration in (None, mass.configuration)]
        places = {name: i for i, name in enumerate(self.covariance_names)}
        return draw_vehicles(
            {
                p.name: Estimated(
                    value=value, std=p.std or 0.0, unit=p.unit, column=places.get(p.full_name)
                )
                for p in own
                if (value := 0.0 if p.verdict == "removed" else p.value) is not None
            },
            self.covariance,
            n,
            seed=seed,
            configuration=str(mass.configuration),
            missing=tuple(p.name for p in own if p.value is None and p.verdict != "removed"),
        )

    def to_frame(self) -> DataFrame:
        """Return every parameter and derived number as a pandas DataFrame, one row each.

        Raises
        ------
        OutputError
            If pandas is not installed.
        """
        return frame(
            {
                "name": [e.name for e in self._all_entries],
                "configuration": [e.configuration for e in self._all_entries],
                "value": [e.value for e in self._all_entries],
                "std": [e.std for e in self._all_entries],
                "low": [None if e.interval is None else e.interval[0] for e in self._all_entries],
                "high": [None if e.interval is None else e.interval[1] for e in self._all_entries],
                "unit": [e.unit for e in self._all_entries],
                "verdict": [verdict_of(self, e) or None for e in self._all_entries],
                **{
                    what: [getattr(e, what, None) for e in self._all_entries]
                    for what in ("partner", "reason", "advice")
                },
            }
        )

    @property
    def _all_entries(self) -> tuple[Parameter | Derived, ...]:
        return (*self.parameters, *self.derived)

    def __str__(self) -> str:
        return sheet_text(_result_sheet(self))

    def _repr_html_(self) -> str:
        return sheet_html(_result_sheet(self))


MAIN: Final = (
    *("kt", "kd", "Jr", "motor_lag", "motor_lag_up", "motor_lag_down", "mass"),
    *COM,
    *INERTIA_COM[:3],
)
"""What most readers look for first."""


def _result_sheet(result: IdentificationResult) -> Sheet:
    """Collect the main numbers of a result, and count the others."""
    shown = [e for e in result._all_entries if e.name in MAIN]  # pyright: ignore[reportPrivateUsage]
    several = len({e.configuration for e in shown} - {None}) > 1
    shown.sort(key=lambda e: (e.configuration or "", MAIN.index(e.name)))
    identified = sum(p.verdict == "identified" for p in result.parameters)
    doubts = len(result.warnings) + sum(len(flight.warnings) for flight in result.flights)
    return Sheet(
        heading=f"{result.name}: {identified} of {len(result.parameters)} parameters identified; "
        "+- is half of the 95 % interval",
        columns=("", "value", "unit", "verdict"),
        rows=[
            (
                f"{e.name} {e.configuration}" if several and e.configuration else e.name,
                with_interval(e.value, e.interval),
                "" if e.unit == "1" else e.unit,
                verdict_of(result, e),
            )
            for e in shown
        ],
        hints=[(PARAMETERS | DERIVED)[e.name].meaning for e in shown],
        more=f"{doubts} doubt{'' if doubts == 1 else 's'}; all numbers, doubts and advice: "
        "print(rotorfit.result_text(result))",
    )


def verdict_of(result: IdentificationResult, entry: Parameter | Derived) -> str:
    """Return the verdict on a number, about the CoM as the report has it."""
    if entry.verdict is not None:
        return entry.verdict
    if entry.name not in (*COM, *INERTIA_COM):
        return ""
    own = [p for p in result.parameters if p.configuration == entry.configuration]
    twin = next((p for p in own if p.name == twin_of(entry.name)), None)
    kin = {d.name: d for d in result.derived if d.configuration == entry.configuration}
    return body_verdict(entry, twin, kin)


def configuration_names(result: IdentificationResult) -> list[str]:
    """Return the names of a result's configurations in their order."""
    return owners_of(result.parameters)


def owners_of(parameters: Sequence[Parameter]) -> list[str]:
    """Return the names of the configurations that parameters belong to, in their order."""
    return list(dict.fromkeys(p.configuration for p in parameters if p.configuration))


def meant_configuration(names: Sequence[str], said: str | None) -> str | None:
    """Choose the configuration that a user means; None if it is not among the names.

    `said` may be None where there is one.
    """
    if said is None and len(names) == 1:
        return names[0]
    return said if said in names else None


def owner_of(result: IdentificationResult, configuration: str | None) -> str:
    """Select the configuration that is meant; OutputError where that is not clear."""
    names = configuration_names(result)
    if not names:
        raise OutputError("the result has no configuration; identify again")
    owner = meant_configuration(names, configuration)
    if owner is not None:
        return owner
    raise OutputError(
        f"the result has the configurations {', '.join(names)}; say which is meant "
        "(--configuration NAME)"
    )


def _single_entry(
    entries: Sequence[Entry], name: str, configuration: str | None, *, what: str
) -> Entry:
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


def _plain_result(result: IdentificationResult) -> dict[str, Any]:
    """Return the result in the words of the file format."""
    parameters = [_rename_key(dataclasses.asdict(p), "partner", "with") for p in result.parameters]
    plain: dict[str, Any] = {
        "schema": SCHEMA,
        "name": result.name,
        "method": result.method,
        "axes": result.axes,
        "parameters": parameters,
        "derived": [dataclasses.asdict(d) for d in result.derived],
        "validation": [dict(v) for v in result.validation],
        "flights": [
            {**dataclasses.asdict(f), "warnings": list(f.warnings)} for f in result.flights
        ],
        "covariance": {
            "names": list(result.covariance_names),
            "matrix": result.covariance.tolist(),
        },
        "settings": dict(result.settings),
        "versions": dict(result.versions),
        "warnings": list(result.warnings),
        "findings": [finding_to_plain(one) for one in result.findings],
        "diagnostics": dict(result.diagnostics),
        "command_law": law_to_plain(result.command_law),
    }
    return cast("dict[str, Any]", _without_nan(plain))


def _rename_key(entry: dict[str, Any], old: str, new: str) -> dict[str, Any]:
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
        if data["schema"] not in (SCHEMA, *OLDER):
            reads = " and ".join(str(one) for one in (*OLDER, SCHEMA))
            raise OutputError(
                f"{path} has schema {data['schema']}, this rotorfit reads {reads}; "
                "identify again, or use the version that wrote it"
            )
        names = tuple(data["covariance"]["names"])
        matrix = np.array(data["covariance"]["matrix"], dtype=float)
        return IdentificationResult(
            name=data["name"],
            method=data["method"],
            axes=data["axes"],
            parameters=tuple(
                Parameter(**_tuple_interval(_rename_key(p, "with", "partner")))
                for p in data["parameters"]
            ),
            derived=tuple(Derived(**_tuple_interval(d)) for d in data["derived"]),
            validation=tuple(data["validation"]),
            flights=tuple(_flight_record(f) for f in data["flights"]),
            covariance_names=names,
            covariance=matrix.reshape(len(names), len(names)),
            settings=data["settings"],
            versions=data["versions"],
            findings=_read_findings(data),
            diagnostics=data.get("diagnostics", {}),
            command_law=law_from_plain(data.get("command_law")),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise OutputError(_no_result(path, f"at {error}")) from error


def _read_findings(data: Mapping[str, Any]) -> tuple[Finding, ...]:
    """Return the findings; an older result has their sentences alone."""
    if "findings" not in data:
        return tuple(doubt("warning", str(sentence)) for sentence in data["warnings"])
    return tuple(finding_from_plain(one) for one in data["findings"])


def _no_result(path: Path, why: str) -> str:
    """State what a file is in place of a result, and which would be right."""
    if not path.exists():
        return f"no file {path}; rotorfit identify LOG ... -o {path.name}  writes a result"
    kind = kind_of(path)
    known = kind is not None and kind != RESULT_FILE
    what = f": this is {kind}, no result" if known else f" is not a rotorfit result ({why})"
    return f"{path}{what}; give the JSON file that rotorfit identify -o wrote"


def _tuple_interval(entry: dict[str, Any]) -> dict[str, Any]:
    interval = entry["interval"]
    return {
        **entry,
        "interval": None if interval is None else tuple(interval),
        "interval_terms": tuple(NumberTerm(**term) for term in entry.get("interval_terms", ())),
    }


def _flight_record(entry: dict[str, Any]) -> FlightRecord:
    fields: dict[str, Any] = dict(entry)
    fields["used"] = tuple((a, b) for a, b in entry["used"])
    fields["cuts"] = tuple((a, b, why) for a, b, why in entry["cuts"])
    del fields["warnings"]
    fields["findings"] = _read_findings(entry)
    return FlightRecord(**fields)


def is_per_command(parameters: Iterable[Parameter]) -> bool:
    """Return whether the coefficients of a result are per squared command, not per rad/s."""
    kt = next(p for p in parameters if p.name == "kt")
    return kt.unit.removesuffix(PER_MASS) == EFFECTIVE_UNITS["kt"]
