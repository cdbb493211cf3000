"""A result as one HTML page that needs nothing else, and its drawings as files of their own.

Section 4: Tables I, II and III of Six, Briot, Erskine and Chriette, ICRA 2020, alongside ours.

Identification of the Propeller Coefficients and Dynamic Parameters of a Hovering Quadrotor from
Flight Data. Their numbers are in `paper_tables.toml`.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

from rotorfit.digits import known, short
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import file_name, write_whole
from rotorfit.model.parameters import title_of
from rotorfit.report.budget import budget_rows
from rotorfit.report.chart import chart_svg
from rotorfit.report.correlations import correlation_section
from rotorfit.report.loop import loop_section
from rotorfit.report.motor_law import law_picture, law_section
from rotorfit.report.pages import render_page, standalone, template_text
from rotorfit.report.parameters import (
    PREDICTED_WELL,
    VERDICT_MEANING,
    parameter_tables,
    unit_words,
)
from rotorfit.report.summary import summary_of
from rotorfit.report.text import assumptions_of
from rotorfit.report.used_flights import used_flights
from rotorfit.report.vehicle import vehicle_drawings
from rotorfit.report.wrenches import (
    TOO_SHORT,
    error_percent,
    excitation_chart,
    excitation_figure,
    series_of,
    validation_rows,
    wrench_figures,
    wrench_svg,
)
from rotorfit.results.result import IdentificationResult, Parameter, configuration_names
from rotorfit.results.validation.judgement import moment_sentences
from rotorfit.results.validation.wrench_comparison import SHOWN, WrenchComparison, wrench_spectra

if TYPE_CHECKING:
    from rotorfit.tools.control_loop.loop import LoopOutcome

Entry = list[float]
"""Value, and %sigma where the table has it."""

MASSES: Final = {"A": 1.285, "B": 1.452}
"""Weighed [kg]."""

_TEXT: Final = Path(__file__).with_name("paper_tables.toml").read_text(encoding="utf-8")
_PAPER: Final[Mapping[str, Mapping[str, Mapping[str, Any]]]] = tomllib.loads(_TEXT)
"""Their tables: kind, configuration, name."""
ILLEGIBLE: Final = {
    "Table I": (
        "For A the paper dropped kd, Izz and the products of inertia as unessential (III-B)."
    ),
    "Table II": (
        "The paper's standard deviations for motion capture, and some of its values, are not "
        "legible in our copy; they are left out here, and so is what the table does not list (–)."
    ),
    "Table III": "The last row (A and B together, on B) is not legible in our copy.",
}
"""What is missing, and why."""


ORDER = ("msx", "msy", "msz", "Ixx", "Iyy", "Izz", "kt", "kd")


@frozen_dataclass
class PaperRow:
    """The paper's number beside ours, all in words."""

    name: str
    title: str
    unit: str
    paper: str
    paper_sigma: str
    mocap: str
    ours: str
    our_sigma: str
    difference: str


@frozen_dataclass
class PaperTable:
    """One of the paper's tables of parameters, for one configuration."""

    name: str
    configuration: str
    rows: tuple[PaperRow, ...]
    note: str
    has_mocap: bool


@frozen_dataclass
class PaperSection:
    """Tables I or II, and III."""

    tables: tuple[PaperTable, ...]
    errors: tuple[tuple[str, str, tuple[str, ...]], ...]
    error_note: str
    components: tuple[str, ...] = SHOWN


def is_paper_vehicle(result: IdentificationResult) -> bool:
    """Test whether the paper's preset was used on configurations named and weighed as its own."""
    settings = cast("Mapping[str, Any]", result.settings.get("identification") or {})
    names = configuration_names(result)
    if settings.get("preset") != "paper" or not names:
        return False
    return all(name in MASSES and _weighs_about(result, name, MASSES[name]) for name in names)


def _weighs_about(result: IdentificationResult, configuration: str, mass: float) -> bool:
    found = [
        known(p.value)
        for p in result.parameters
        if p.name == "mass" and p.configuration == configuration
    ]
    return any(value is not None and abs(value - mass) < 0.01 * mass for value in found)


def paper_section(
    result: IdentificationResult, comparisons: Sequence[WrenchComparison]
) -> PaperSection:
    """Tabulate the paper's numbers alongside ours: I for one configuration, II for two."""
    names = [name for name in configuration_names(result) if name in MASSES]
    both = len(names) > 1
    kind, name = ("together", "Table II") if both else ("alone", "Table I")
    return PaperSection(
        tables=tuple(
            PaperTable(
                name=name,
                configuration=configuration,
                rows=_paper_rows(
                    result, configuration, _PAPER[kind][configuration], with_mocap=both
                ),
                note=ILLEGIBLE[name],
                has_mocap=both,
            )
            for configuration in names
        ),
        errors=_tabulate_errors(comparisons),
        error_note=ILLEGIBLE["Table III"],
    )


def _paper_rows(
    result: IdentificationResult,
    configuration: str,
    paper: Mapping[str, Entry],
    *,
    with_mocap: bool,
) -> tuple[PaperRow, ...]:
    ours = {p.name: p for p in result.parameters if p.configuration in (None, configuration)}
    mocap: Mapping[str, Any] = _PAPER["mocap"][configuration] if with_mocap else {}
    return tuple(
        _paper_row(name, ours.get(name), paper.get(name), mocap.get(name))
        for name in ORDER
        if name in paper or name in ours
    )


def _paper_row(
    name: str, ours: Parameter | None, paper: Entry | None, mocap: Entry | None
) -> PaperRow:
    value = None if ours is None else known(ours.value)
    std = None if ours is None else known(ours.std)
    sigma = 100 * std / abs(value) if std is not None and value else None
    difference = 100 * (value - paper[0]) / abs(paper[0]) if value is not None and paper else None
    return PaperRow(
        name=name,
        title=title_of(name),
        unit="" if ours is None else unit_words(ours.unit),
        paper="–" if paper is None else _scientific_text(paper[0]),
        paper_sigma=_two_decimals(None if paper is None else paper[1]),
        mocap=_scientific_text(None if mocap is None else mocap[0]),
        ours=_scientific_text(value) if ours is None or value is not None else ours.verdict,
        our_sigma="" if sigma is None else short(sigma),
        difference="" if difference is None else f"{difference:+.1f} %".replace("-", "−"),
    )


def _scientific_text(value: float | None) -> str:
    """Write a number as the paper prints it: three digits and a power of ten."""
    if value is None:
        return ""
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    powers = str(exponent).translate(str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻"))
    return f"{value / 10.0**exponent:.2f}·10{powers}".replace("-", "−")


def _two_decimals(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _tabulate_errors(
    comparisons: Sequence[WrenchComparison],
) -> tuple[tuple[str, str, tuple[str, ...]], ...]:
    """Tabulate the paper's rows of Table III, then ours."""
    rows = [
        ("paper", where, tuple(f"{e[n]:.2f} %" if n in e else "–" for n in SHOWN))
        for where, e in _PAPER["errors"].items()
    ]
    rows += [
        (
            "rotorfit",
            f"{file_name(c.flight)} ({c.configuration})",
            tuple(error_percent(c, n) for n in SHOWN),
        )
        for c in comparisons
    ]
    return tuple(rows)


ALWAYS = ("vehicle-top.svg", "vehicle-side.svg", "correlations.svg")
"""Files that nearly every report writes: where one is there, so is an earlier report."""


def report_html(
    result: IdentificationResult,
    *,
    comparisons: Sequence[WrenchComparison] = (),
    paper: bool | None = None,
    loop: LoopOutcome | None = None,
) -> str:
    """Write a result as one self-contained HTML page; see `write_report`.

    `loop`: of one of its flights, if its log has the controller.
    """
    with_paper = is_paper_vehicle(result) if paper is None else paper
    return render_page(
        "page",
        *("page", "figure", "fly", "dark"),
        script="plot.js",
        result=result,
        loop=None if loop is None else loop_section(loop),
        method=METHODS.get(result.method, result.method),
        seconds=sum(flight.seconds_used for flight in result.flights),
        configurations=configuration_names(result),
        meanings=VERDICT_MEANING,
        summary=summary_of(result),
        assumptions=assumptions_of(result),
        tables=parameter_tables(result),
        budgets=budget_rows(result),
        vehicle=vehicle_drawings(result),
        law=law_section(result, comparisons),
        figures=wrench_figures(comparisons),
        excitation=excitation_figure(comparisons),
        too_short=TOO_SHORT,
        validation=validation_rows(result),
        components=SHOWN,
        predicted_well=PREDICTED_WELL,
        moments=moment_sentences(comparisons),
        paper=paper_section(result, comparisons) if with_paper else None,
        correlations=correlation_section(result),
        flights=used_flights(result),
        provenance=provenance_of(result, comparisons),
    )


def write_report(
    path: Path,
    result: IdentificationResult,
    *,
    comparisons: Sequence[WrenchComparison] = (),
    paper: bool | None = None,
    force: bool = False,
) -> None:
    """Write a result as one HTML page that needs nothing else, whole or not at all.

    Parameters
    ----------
    path
        The file.
    result
        What was identified.
    comparisons
        Body wrench against rotor wrench on flights, for the figures over time.
    paper
        Whether the tables of Six et al. 2020 stand beside ours; None: where the preset ``paper``
        was used on a vehicle with the names and masses of theirs.
    force
        Replace a file that is there.

    Raises
    ------
    OutputError
        If the file exists and `force` is false, or cannot be written.
    """
    html = report_html(result, comparisons=comparisons, paper=paper)
    write_whole(path, html, force=force)


def figure_texts(
    result: IdentificationResult, comparisons: Sequence[WrenchComparison] = ()
) -> dict[str, str]:
    """Draw everything as SVG documents, by names that any file system takes.

    Parameters
    ----------
    result
        What was identified.
    comparisons
        Body wrench against rotor wrench on flights, each of which is drawn over time.
    """
    style = template_text("figure.css")
    out: dict[str, str] = {}
    vehicle = vehicle_drawings(result)
    if vehicle is not None:
        out = {name: standalone(svg, style) for name, _, svg in vehicle.views}
    for number, comparison in enumerate(comparisons, 1):
        owner, flight = _safe_name(comparison.configuration), _safe_name(comparison.flight)
        name = f"wrench-{number}-{owner}-{flight}"
        out[name] = standalone(wrench_svg(comparison, series_of(comparison)), style)
    spectra = wrench_spectra(comparisons)
    if spectra is not None:
        out["excitation"] = standalone(chart_svg(excitation_chart(spectra)), style)
    if result.command_law is not None:
        out["motor-law"] = standalone(law_picture(result.command_law), style)
    heat_map = correlation_section(result).heat_map
    if heat_map is not None:
        out["correlations"] = standalone(heat_map, style)
    return out


def _safe_name(name: str) -> str:
    """Make a name with nothing in it that a file system may not like."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", Path(file_name(name)).stem).strip("-")[:40] or "flight"


METHODS = {
    "ols": "equation by equation, weighted by frequency band",
    "tls": "total least squares of all equations (Six et al. 2020), intervals by their formula",
    "banded": "all equations and configurations at once, weighted by frequency band",
}


@frozen_dataclass
class Provenance:
    """Everything needed to do it again."""

    settings: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]
    hashes: tuple[tuple[str, str, str], ...]


def provenance_of(
    result: IdentificationResult, comparisons: Sequence[WrenchComparison]
) -> Provenance:
    """Collect settings as key and value, versions, and hashes of every flight shown."""
    hashes = [(file_name(f.file), f.sha256, "fitted") for f in result.flights]
    fitted = {f.sha256 for f in result.flights}
    hashes += [
        (file_name(c.flight), c.sha256, "validated") for c in comparisons if c.sha256 not in fitted
    ]
    return Provenance(
        settings=tuple(_flatten_leaves(_shown_settings(result.settings), "")),
        versions=tuple((name, str(version)) for name, version in result.versions.items()),
        hashes=tuple(hashes),
    )


def _shown_settings(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Omit what the page shows elsewhere, and the motor order if rotors are listed."""
    out = dict(settings)
    if "used" in out:
        out["used"] = {k: v for k, v in out["used"].items() if k != "hangs_on"}
    if out.get("airframe", {}).get("rotors"):
        out["airframe"] = {k: v for k, v in out["airframe"].items() if k != "order"}
    return out


def _flatten_leaves(value: Any, path: str) -> list[tuple[str, str]]:
    """Flatten nested tables to lines; a list of small tables has one line for each."""
    if isinstance(value, Mapping):
        table = cast("Mapping[str, Any]", value)
        if path and not any(isinstance(v, Mapping | list | tuple) for v in table.values()):
            shown = {key: _shorten_path(key, v) for key, v in table.items()}
            return [(path, ", ".join(f"{key} = {_setting_text(v)}" for key, v in shown.items()))]
        return [
            line
            for key, v in table.items()
            for line in _flatten_leaves(_shorten_path(key, v), f"{path}.{key}".lstrip("."))
        ]
    if isinstance(value, list | tuple) and any(
        isinstance(v, Mapping) for v in cast("list[Any]", value)
    ):
        items = cast("list[Any]", value)
        return [
            line
            for i, v in enumerate(items, 1)
            for line in _flatten_leaves(_flatten_lists(v), f"{path} {i}")
        ]
    return [(path, _setting_text(value))]


def _flatten_lists(value: Any) -> Any:
    """Write the short lists of a table as text, so that a rotor takes one line."""
    if not isinstance(value, Mapping):
        return value
    table = cast("Mapping[str, Any]", value)
    return {k: _json_text(v) if _is_vector(v) else v for k, v in table.items()}


def _is_vector(value: Any) -> bool:
    return isinstance(value, list | tuple) and all(
        isinstance(v, int | float) for v in cast("list[Any]", value)
    )


def _setting_text(value: Any) -> str:
    return value if isinstance(value, str) else _json_text(value)


def _shorten_path(key: str, value: Any) -> Any:
    """Strip a file's folders: they are nobody else's business."""
    return file_name(value) if key == "file" and isinstance(value, str) else value


def _json_text(value: Any) -> str:
    return json.dumps(value, default=str, ensure_ascii=False)
