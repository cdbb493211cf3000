"""A result as one HTML page that needs nothing else: no network, no font, no library."""

from collections.abc import Sequence
from pathlib import Path

from rotorfit.logs.files import write_whole
from rotorfit.report.correlations import correlation_section
from rotorfit.report.excitation import TOO_SHORT, excitation_figure
from rotorfit.report.motor_law import law_section
from rotorfit.report.number_words import PREDICTED_WELL, VERDICT_MEANING
from rotorfit.report.page_templates import fingerprint, page_style, page_template, template_text
from rotorfit.report.paper_tables import is_paper_vehicle, paper_section
from rotorfit.report.parameters import parameter_tables
from rotorfit.report.provenance import method_words, provenance_of
from rotorfit.report.summary import summary_of
from rotorfit.report.svg import clean
from rotorfit.report.used_flights import used_flights
from rotorfit.report.vehicle import vehicle_drawings
from rotorfit.report.wrenches import validation_rows, wrench_figures
from rotorfit.results.result import IdentificationResult, configuration_names
from rotorfit.validation.wrench_comparison import SHOWN, WrenchComparison


def report_html(
    result: IdentificationResult,
    *,
    comparisons: Sequence[WrenchComparison] = (),
    paper: bool | None = None,
) -> str:
    """Return a result as one self-contained HTML page.

    Parameters
    ----------
    result
        What was identified.
    comparisons
        Body wrench against rotor wrench on flights, for the figures over time.
    paper
        Whether the tables of Six et al. 2020 stand beside ours; None: where the preset ``paper``
        was used on a vehicle with the names and masses of theirs.
    """
    with_paper = is_paper_vehicle(result) if paper is None else paper
    script = template_text("plot.js")
    page = page_template("page.html")
    html = page.render(
        result=result,
        method=method_words(result.method),
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
        provenance=provenance_of(result, tuple(comparisons)),
        style=page_style(),
        script=script,
        script_hash=fingerprint(script),
    )
    return clean(html)


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
    result, comparisons, paper
        As for `report_html`.
    force
        Replace a file that is there.

    Raises
    ------
    OutputError
        If the file exists and `force` is false, or cannot be written.
    """
    html = report_html(result, comparisons=comparisons, paper=paper)
    write_whole(path, html, force=force)
