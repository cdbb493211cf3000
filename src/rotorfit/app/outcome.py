"""The identification of a form, its outcome as the page shows it, and the next flight."""

from __future__ import annotations

import base64
import dataclasses
import json
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from rotorfit.app.files import Progress, json_with_shown_names, with_shown_names
from rotorfit.app.form import SOURCE, experiment_of, rows, table, text_of
from rotorfit.digits import finite_interval, known
from rotorfit.errors import (
    ExperimentError,
    MissingNumbersError,
    OutputError,
    RotorfitError,
    RotorfitWarning,
)
from rotorfit.export.targets import OFFERED, RANDOM_TARGETS
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.fit.experiment.experiment import Experiment, airframe_of_tables
from rotorfit.identification import identify
from rotorfit.logs.files import watched, write_whole
from rotorfit.report.budget import size_words
from rotorfit.report.loop import loop_html, verdict
from rotorfit.report.parameters import PREDICTED_WELL, ParameterTable, Row, parameter_tables
from rotorfit.report.plan_card import card_html
from rotorfit.report.plan_text import plan_text
from rotorfit.report.result_page import report_html
from rotorfit.report.summary import Line, summary_of
from rotorfit.report.text import advice_of, assumptions_of, result_text, warnings_of
from rotorfit.results.budget import budget_of
from rotorfit.results.result import Derived, IdentificationResult, Parameter, configuration_names
from rotorfit.results.sound_result import load_sound
from rotorfit.results.validation.validate import drawn_comparisons
from rotorfit.tools.control_loop.loop import LoopOutcome, first_flight_margins
from rotorfit.tools.planning.after import check_same_vehicle, result_mass
from rotorfit.tools.planning.next_step import advise_flights
from rotorfit.tools.planning.plan import PlanRequest, plan
from rotorfit.tools.planning.wanted import wanted_accuracy

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rotorfit.findings import Finding


def identified(folder: Path, form: Mapping[str, Any], *, progress: Progress) -> dict[str, Any]:
    """Identify a form's flights, save result, report and experiment file, return the outcome."""
    experiment = experiment_of(folder, form)

    def report_step(step: str) -> None:
        progress(with_shown_names(folder, step), None)

    def report_reading(path: Path, share: float) -> None:
        progress(with_shown_names(folder, f"reading {path.name}"), share)

    with warnings.catch_warnings(), watched(report_reading):
        warnings.simplefilter("ignore", RotorfitWarning)
        result = identify(experiment, progress=report_step, adviser=advise_flights)
        report_step("drawing")
        comparisons = drawn_comparisons(result, experiment)
        report_step("judging the rate loop")
        loop = _judged_loop(result, experiment)
    judged = None if isinstance(loop, str) else loop
    words = [loop] if isinstance(loop, str) else [verdict(axis) for axis in loop.axes]
    result = _with_shown_names(folder, result)
    html = report_html(result, comparisons=comparisons, loop=judged)
    flight = Path(experiment.configuration[0].flights[0].file).name
    shown = {"flight": flight, "words": words, "page": judged is not None}
    outcome = {**outcome_of(result), "loop": json_with_shown_names(folder, shown)}
    text = text_of(form)
    files = {
        "experiment.toml": text,
        "result.json": result.to_json(),
        "report.html": with_shown_names(folder, html),
        "outcome.json": json.dumps({**outcome, "experiment": text}, allow_nan=False),
    }
    (folder / "loop.html").unlink(missing_ok=True)
    if judged is not None:
        files["loop.html"] = with_shown_names(folder, loop_html(judged))
    for name, content in files.items():
        write_whole(folder / name, content, force=True)
    return json.loads(files["outcome.json"])


def _judged_loop(result: IdentificationResult, experiment: Experiment) -> LoopOutcome | str:
    """Judge the rate loop of the first flight; where its log does not show it, say why."""
    try:
        return first_flight_margins(result, experiment)
    except RotorfitError as error:
        flight = experiment.configuration[0].flights[0].file
        return " ".join(str(error).removeprefix(f"{flight}: ").split())


def _with_shown_names(folder: Path, result: IdentificationResult) -> IdentificationResult:
    """Replace the stored names in the texts of a result."""

    def renamed(findings: Iterable[Finding]) -> tuple[Finding, ...]:
        return tuple(
            dataclasses.replace(
                one,
                sentence=with_shown_names(folder, one.sentence),
                flights=tuple(with_shown_names(folder, flight) for flight in one.flights),
            )
            for one in findings
        )

    flights = tuple(
        dataclasses.replace(flight, findings=renamed(flight.findings)) for flight in result.flights
    )
    return dataclasses.replace(
        result,
        flights=flights,
        settings=json_with_shown_names(folder, result.settings),
        findings=renamed(result.findings),
    )


def outcome_of(result: IdentificationResult) -> dict[str, Any]:
    """Collect what the page shows of a result; JSON without NaN."""
    summary = summary_of(result)
    return {
        "name": result.name,
        "seconds": sum(flight.seconds_used for flight in result.flights),
        "text": result_text(result),
        "tables": [_plain_table(one) for one in parameter_tables(result)],
        "budgets": [
            _plain_budget(result, n) for n in (*result.parameters, *result.derived) if n.std
        ],
        "summary": [
            {"title": title, "lines": [_plain_line(one) for one in lines]}
            for title, lines in summary.groups
        ],
        "in_short": [*summary.doubts, *summary.notes],
        "next_step": summary.next_step,
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


def _plain_budget(result: IdentificationResult, number: Parameter | Derived) -> dict[str, Any]:
    """Return the parts of an interval as the page stacks them."""
    budget = budget_of(result, number)
    return {
        "name": budget.full_name,
        "parts": [
            {
                "words": f"{line.name} {size_words(line.half_width, budget)}",
                "share": line.share,
                "remedy": line.remedy,
                "action": line.action,
            }
            for line in budget.lines
        ],
    }


def _plain_line(line: Line) -> dict[str, Any]:
    return {
        "title": line.heading,
        "parts": [
            {"words": part.words, "shown": part.shown, "verdict": part.doubt} for part in line.parts
        ],
        "remark": line.remark,
    }


def _plain_table(parameters: ParameterTable) -> dict[str, Any]:
    return {
        "title": parameters.title,
        "explanation": parameters.explanation,
        "rows": [_plain_row(row) for row in parameters.rows],
        "notes": [dataclasses.asdict(note) for note in parameters.notes],
    }


def _plain_row(row: Row) -> dict[str, Any]:
    number = row.source
    return {
        "name": row.name,
        "full_name": number.full_name,
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


def planned(
    folder: Path, form: Mapping[str, Any], accuracy: str, *, progress: Progress
) -> dict[str, Any]:
    """Plan the flight to fly next, after the page's result if there is one, and save its card.

    The form has the airframe, and a mass where there is no result yet; the accuracy is as
    `rotorfit plan --accuracy` takes it.
    """

    def report_progress(done: int, total: int) -> None:
        progress("flying the manoeuvres in simulation", done / total)

    request = _plan_request(folder, form, accuracy)
    with threadpool_limits(limits=1, user_api="blas"):
        flights = plan(request, progress=report_progress)
    write_whole(folder / "card.html", card_html(flights), force=True)
    write_whole(folder / "plan.json", flights.to_json(), force=True)
    return {"text": plan_text(flights), "card": True, "plan": json.loads(flights.to_json())}


def _plan_request(folder: Path, form: Mapping[str, Any], accuracy: str) -> PlanRequest:
    declared = airframe_of_tables(form, source=SOURCE)
    vehicle, motors = vehicle_of(declared.airframe), declared.motors
    earlier = folder / "result.json"
    after = load_sound(earlier) if earlier.exists() else None
    if after is not None:
        check_same_vehicle(after, vehicle)
    return PlanRequest(
        name=str(form.get("name", "vehicle")),
        vehicle=vehicle,
        mass=_mass_of_form(form) if after is None else result_mass(after, None)[1],
        speed=motors.speed,
        timed=motors.delay is None and (motors.speed == "measured" or motors.lag is None),
        wanted=wanted_accuracy(accuracy),
        after=after,
    )


def _mass_of_form(form: Mapping[str, Any]) -> float:
    entry = next(iter(rows(form.get("configuration"))), None)
    mass = table(entry).get("mass")
    if not isinstance(mass, int | float):
        raise ExperimentError("a plan needs the mass of the vehicle as it flies: weigh it")
    return float(mass)


def exported(folder: Path, argument: Mapping[str, Any]) -> dict[str, Any]:
    """Make the file of a target from the page's result."""
    from rotorfit.export.result_numbers import number_warnings
    from rotorfit.export.write import drawn_sentence, export, randomised
    from rotorfit.results.sound_result import load_sound

    target = argument["target"]
    if target not in OFFERED:
        raise OutputError(f"no target {target!r}; targets: {', '.join(OFFERED)}")
    path = folder / "result.json"
    if not path.exists():
        raise OutputError("there is no result yet: identify first")
    result = load_sound(path)
    assumed = _parse_assumed(argument.get("assume") or {})
    configuration = argument.get("configuration")
    name = f"{target}{OFFERED[target].suffix}"
    if target in RANDOM_TARGETS:
        content, found = randomised(
            result, target, Path(name), configuration=configuration, assumed=assumed
        )
        data = base64.b64encode(content).decode()
        return {"name": name, "base64": data, "notes": [drawn_sentence(found)]}
    made = export(
        result,
        target,
        configuration=configuration,
        assumed=assumed,
        project=argument.get("project") is True,
    )
    return {
        "name": name,
        "text": made.text,
        "notes": [*number_warnings(made.unsure), *made.model.notes],
    }


def missing_numbers(error: MissingNumbersError) -> list[dict[str, str]]:
    """List the numbers that the user may supply, with their units."""
    from rotorfit.export.result_numbers import unit_of

    return [{"name": name, "unit": unit_of(name)} for name in error.names]


def _parse_assumed(given: Mapping[str, Any]) -> dict[str, float]:

    from rotorfit.export.result_numbers import parse_assumptions

    try:
        return parse_assumptions([f"{name}={value}" for name, value in given.items()])
    except ValueError as error:
        raise OutputError(str(error)) from error
