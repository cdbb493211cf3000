"""The identification of a form, and its outcome as the page shows it."""

import dataclasses
import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rotorfit.app.files import Progress, in_its_name, in_their_names
from rotorfit.app.form import experiment_of, text_of
from rotorfit.errors import RotorfitWarning
from rotorfit.formatting.digits import finite_interval, known
from rotorfit.identification.identify import identify
from rotorfit.logs.files import write_whole
from rotorfit.logs.progress import watched
from rotorfit.report.number_words import PREDICTED_WELL
from rotorfit.report.parameters import ParameterTable, Row, parameter_tables
from rotorfit.report.result_page import report_html
from rotorfit.report.summary import summary_of
from rotorfit.report.text import advice_of, assumptions_of, result_text, warnings_of
from rotorfit.results.result import IdentificationResult, configuration_names
from rotorfit.validation.validate import drawn_comparisons


def identified(folder: Path, form: Mapping[str, Any], *, progress: Progress) -> dict[str, Any]:
    """Identify what a form describes, keep result, report and experiment file, return the outcome.

    Parameters
    ----------
    folder
        Of the page.
    form
        As the page sent it.
    progress
        Told what is being done.

    Raises
    ------
    RotorfitError
        If the form, a log or a flight cannot be used.
    """
    experiment = experiment_of(folder, form)

    def tell(words: str) -> None:
        progress(in_its_name(folder, words), None)

    def tell_reading(path: Path, share: float) -> None:
        progress(in_its_name(folder, f"reading {path.name}"), share)

    with warnings.catch_warnings(), watched(tell_reading):
        warnings.simplefilter("ignore", RotorfitWarning)
        result = identify(experiment, progress=tell)
        tell("drawing")
        comparisons = drawn_comparisons(result, experiment)
    result = _in_their_names(folder, result)
    html = in_its_name(folder, report_html(result, comparisons=comparisons))
    outcome = outcome_of(result)
    text = text_of(form)
    kept = {
        "experiment.toml": text,
        "result.json": result.to_json(),
        "report.html": html,
        "outcome.json": json.dumps({**outcome, "experiment": text}, allow_nan=False),
    }
    for name, content in kept.items():
        write_whole(folder / name, content, force=True)
    return json.loads(kept["outcome.json"])


def _in_their_names(folder: Path, result: IdentificationResult) -> IdentificationResult:
    """Return a result whose words name files as the user does."""
    flights = tuple(
        dataclasses.replace(
            flight, warnings=tuple(in_its_name(folder, words) for words in flight.warnings)
        )
        for flight in result.flights
    )
    return dataclasses.replace(
        result,
        flights=flights,
        settings=in_their_names(folder, result.settings),
        findings=tuple(
            dataclasses.replace(
                one,
                sentence=in_its_name(folder, one.sentence),
                flights=tuple(in_its_name(folder, file) for file in one.flights),
            )
            for one in result.findings
        ),
    )


def outcome_of(result: IdentificationResult) -> dict[str, Any]:
    """Return what the page shows of a result; JSON without NaN."""
    summary = summary_of(result)
    return {
        "name": result.name,
        "seconds": sum(flight.seconds_used for flight in result.flights),
        "text": result_text(result),
        "tables": [_table(table) for table in parameter_tables(result)],
        "summary": [
            {"title": title, "findings": [dataclasses.asdict(one) for one in found]}
            for title, found in summary.groups
        ],
        "counts": [{"verdict": v, "count": n, "meaning": words} for v, n, words in summary.counts],
        "validation": [
            {
                "flight": row.get("flight"),
                "configuration": row.get("configuration"),
                "errors": {k: known(v) for k, v in row.get("relative_error", {}).items()},
            }
            for row in result.validation
        ],
        "validation_predicted_well": PREDICTED_WELL,
        "advice": advice_of(result),
        "doubts": warnings_of(result),
        "hangs_on": assumptions_of(result),
        "configurations": configuration_names(result),
        "result": json.loads(result.to_json()),
    }


def _table(table: ParameterTable) -> dict[str, Any]:
    return {
        "title": table.title,
        "explanation": table.explanation,
        "rows": [_row(row) for row in table.rows],
        "notes": [dataclasses.asdict(note) for note in table.notes],
    }


def _row(row: Row) -> dict[str, Any]:
    number = row.source
    return {
        "name": row.name,
        "title": row.title,
        "shown": None if row.number is None else str(row.number),
        "value": known(number.value),
        "interval": finite_interval(number.interval),
        "std": known(number.std),
        "unit": row.unit,
        "verdict": row.verdict,
        "partner": row.partner,
        "note": row.note,
        "ends": None if row.bar is None else row.ends,
    }
