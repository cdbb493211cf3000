"""A result as one HTML page that needs nothing else, and its drawings as files of their own."""

import re
from collections.abc import Sequence
from pathlib import Path

from rotorfit.control_loop.loop import LoopOutcome
from rotorfit.logs.files import file_name, write_whole
from rotorfit.report.chart import chart_svg
from rotorfit.report.correlations import correlation_section
from rotorfit.report.loop import loop_section
from rotorfit.report.motor_law import law_picture, law_section
from rotorfit.report.pages import render_page, standalone, template_text
from rotorfit.report.paper_tables import is_paper_vehicle, paper_section
from rotorfit.report.parameters import PREDICTED_WELL, VERDICT_MEANING, parameter_tables
from rotorfit.report.summary import METHODS, provenance_of, summary_of, used_flights
from rotorfit.report.vehicle import vehicle_drawings
from rotorfit.report.wrenches import (
    TOO_SHORT,
    excitation_chart,
    excitation_figure,
    series_of,
    validation_rows,
    wrench_figures,
    wrench_svg,
)
from rotorfit.results.result import IdentificationResult, configuration_names
from rotorfit.validation.wrench_comparison import SHOWN, WrenchComparison, wrench_spectra

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
        tables=parameter_tables(result),
        vehicle=vehicle_drawings(result),
        law=law_section(result, comparisons),
        figures=wrench_figures(comparisons),
        excitation=excitation_figure(comparisons),
        too_short=TOO_SHORT,
        validation=validation_rows(result),
        components=SHOWN,
        predicted_well=PREDICTED_WELL,
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
        name = f"wrench-{number}-{_plain(comparison.configuration)}-{_plain(comparison.flight)}"
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


def _plain(name: str) -> str:
    """Make a name with nothing in it that a file system may not like."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", Path(file_name(name)).stem).strip("-")[:40] or "flight"
