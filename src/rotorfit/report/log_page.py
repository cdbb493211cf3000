"""What inspect says of logs as one HTML page that needs nothing else, its pictures first."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rotorfit.inspection.inspect_log import LogReport
from rotorfit.logs.files import write_whole
from rotorfit.report.log_figures import LogFigure, log_figures
from rotorfit.report.log_report import KNOW, sections, spans_words
from rotorfit.report.page_templates import fingerprint, page_style, page_template, template_text
from rotorfit.report.svg import clean


@dataclass(frozen=True, slots=True, kw_only=True)
class LogArticle:
    """One log as the page shows it."""

    report: LogReport
    title: str
    airborne: str
    trouble: tuple[str, ...]
    figures: tuple[LogFigure, ...]
    left_out: tuple[str, ...]
    lists: tuple[tuple[str, list[str]], ...]


def log_report_html(*reports: LogReport) -> str:
    """Return what was found in one log or several as one self-contained HTML page."""
    script = template_text("plot.js")
    html = page_template("log.html").render(
        articles=[_article(report) for report in reports],
        style=page_style("log"),
        script=script,
        script_hash=fingerprint(script),
    )
    return clean(html)


def _article(report: LogReport) -> LogArticle:
    lists = [*sections(report), ("What the reader says", list(report.notes))]
    return LogArticle(
        report=report,
        title=Path(report.file).name,
        airborne=spans_words(report.airborne),
        trouble=report.trouble,
        figures=log_figures(report),
        left_out=() if report.pictures is None else report.pictures.left_out,
        lists=tuple((title, words) for title, words in lists if words and title != KNOW),
    )


def write_log_page(path: Path, reports: Sequence[LogReport], *, force: bool) -> None:
    """Write reports as one page, whole or not at all.

    Raises
    ------
    OutputError
        If the file exists and `force` is false, or cannot be written.
    """
    write_whole(path, log_report_html(*reports), force=force)
