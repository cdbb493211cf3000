"""The page and the figures of a result, for ``rotorfit identify --report --figures``."""

import warnings
from pathlib import Path

from rotorfit.cli.progress import steps
from rotorfit.cli.terminal import say
from rotorfit.errors import RotorfitWarning
from rotorfit.experiment.experiment import Experiment
from rotorfit.results.result import IdentificationResult
from rotorfit.validation.wrench_comparison import WrenchComparison


def write_pictures(
    result: IdentificationResult,
    experiment: Experiment,
    *,
    report: Path | None,
    figures: Path | None,
    force: bool,
) -> None:
    """Write the page and the figures that were asked for, and say so."""
    # jinja2 is not worth its time to those who want numbers only.
    from rotorfit.report.pages import HINT, can_write_png
    from rotorfit.report.result_page import write_figures, write_report

    comparisons = _comparisons(result, experiment)
    if report is not None:
        write_report(report, result, comparisons=comparisons, force=force)
        say(f"wrote {report}")
    if figures is not None:
        paths = write_figures(figures, result, comparisons, force=force)
        say(f"wrote {len(paths)} files to {figures}")
        if not can_write_png():
            say(HINT)


def figure_names() -> tuple[str, ...]:
    """Return the files by which an earlier report's figures are known."""
    from rotorfit.report.result_page import ALWAYS

    return ALWAYS


def _comparisons(result: IdentificationResult, experiment: Experiment) -> list[WrenchComparison]:
    from rotorfit.validation.validate import drawn_comparisons

    with warnings.catch_warnings(), steps() as tell:
        warnings.simplefilter("ignore", RotorfitWarning)
        tell("drawing")
        return drawn_comparisons(result, experiment)
