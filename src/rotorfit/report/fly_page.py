"""What `rotorfit fly` found, as one self-contained HTML page and as drawings."""

from pathlib import Path

from rotorfit.logs.files import file_name, write_whole
from rotorfit.report.figures import write_drawings
from rotorfit.report.fly_figures import fly_drawings, kind_of
from rotorfit.report.fly_text import force_rows, headline, manoeuvre_words, rate_rows, verdicts
from rotorfit.report.page_templates import page_style, page_template, template_text
from rotorfit.report.svg import clean, standalone
from rotorfit.validation.fly_outcome import AXES, FlyOutcome, told_times


def fly_html(outcome: FlyOutcome) -> str:
    """Return the page."""
    page = page_template("fly.html")
    html = page.render(
        outcome=outcome,
        headline=headline(outcome),
        times=told_times(outcome),
        axes=AXES,
        rates=rate_rows(outcome),
        forces=force_rows(outcome),
        verdicts=verdicts(outcome),
        legend=[(name, kind_of(outcome.labels, name)) for name in outcome.labels],
        names=[file_name(replay.flight) for replay in outcome.replays],
        manoeuvres=[(name, manoeuvre_words(outcome, name)) for name in outcome.manoeuvres],
        drawings=fly_drawings(outcome),
        style=page_style("fly"),
    )
    return clean(html)


def write_fly_page(path: Path, outcome: FlyOutcome, *, force: bool = False) -> None:
    """Write the page, whole or not at all.

    Raises
    ------
    OutputError
        If the file exists and `force` is false, or cannot be written.
    """
    write_whole(path, fly_html(outcome), force=force)


def write_fly_figures(folder: Path, outcome: FlyOutcome, *, force: bool = False) -> list[Path]:
    """Write each drawing as a file, as `rotorfit.report.figures.write_drawings` does."""
    style = template_text("figure.css") + template_text("fly.css")
    drawings = {name: standalone(svg, style) for name, svg in fly_drawings(outcome).items()}
    return write_drawings(folder, drawings, force=force)
