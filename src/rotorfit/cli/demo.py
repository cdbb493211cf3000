"""rotorfit demo: the experiment of Six et al. 2020 flown again, estimates beside the truth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, NamedTuple

import typer

from rotorfit.cli.identify import identify_quietly
from rotorfit.cli.simulate import simulate_into
from rotorfit.cli.terminal import (
    AsJson,
    Force,
    Seed,
    print_result,
    print_status,
    refuse_output_folder,
    steps,
)

if TYPE_CHECKING:
    from rotorfit.fit.experiment.experiment import Experiment
    from rotorfit.results.result import IdentificationResult, Parameter
    from rotorfit.simulation.experiments import ExperimentPlan

RESULT, PAPER, REPORT = "result.json", "result-paper.json", "report.html"
PAPERS: Final = "ordinary least squares"
SHARED: Final = ("kt", "kd")
BODY: Final = ("msx", "msy", "msz", "Ixx", "Iyy", "Izz")
INTRODUCTION: Final = """\
The experiment of Six et al. 2020, flown again in simulation: quadrotor A
(1.285 kg), and B, which is A with 125 g on +x and 42 g on -y. Noisy and biased
sensors; the log has motor commands only, and nobody knows the motors' lag. One
flight of each identifies both at once, one is kept for validation. Does the
95 % interval hold the truth: rotorfit's, and that of ordinary least squares as
the paper uses it?
"""


class Results(NamedTuple):
    """The same flights, identified by the default method and as the paper does."""

    default: IdentificationResult
    paper: IdentificationResult


def demo(
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            help="Keep flights, experiment, truth, results and report here.",
        ),
    ] = None,
    seed: Seed = 1,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Simulate the paper's experiment, identify it, compare.

    Six, Briot, Erskine and Chriette, ICRA 2020: two quadrotors that differ by a known payload,
    identified by the default method and by the paper's.
    """
    from tempfile import TemporaryDirectory

    from rotorfit.simulation.experiment_files import file_names
    from rotorfit.simulation.experiments import plan_experiment

    plan = plan_experiment("paper", "noisy", seed=seed)
    if output is None:
        with TemporaryDirectory() as folder:
            results, _ = _fly_and_identify(Path(folder), plan, force=True)
    else:
        refuse_output_folder(output, [*file_names(plan), RESULT, PAPER, REPORT], force=force)
        results, experiment = _fly_and_identify(output, plan, force=force)
        _save_results(output, results, experiment, force=force)
    print_result(results.default.to_json().rstrip() if as_json else demo_text(plan, results))


def _fly_and_identify(
    folder: Path, plan: ExperimentPlan, *, force: bool
) -> tuple[Results, Experiment]:
    """Fly into a folder, and identify from its files."""
    from rotorfit.fit.experiment.experiment import load_experiment
    from rotorfit.simulation.experiment_files import EXPERIMENT_FILE

    with steps() as report_progress:
        simulate_into(folder, plan, force=force, progress=report_progress)
    experiment = load_experiment(folder / EXPERIMENT_FILE)
    as_paper = experiment.identification.model_copy(update={"preset": "paper"})
    results = Results(
        default=identify_quietly(experiment),
        paper=identify_quietly(experiment.model_copy(update={"identification": as_paper})),
    )
    return results, experiment


def _save_results(folder: Path, results: Results, experiment: Experiment, *, force: bool) -> None:
    from rotorfit.report.result_page import write_report
    from rotorfit.results.validation.validate import validation_comparisons
    from rotorfit.simulation.experiment_files import EXPERIMENT_FILE

    results.default.save(folder / RESULT, force=force)
    results.paper.save(folder / PAPER, force=force)
    comparisons = validation_comparisons(results.default, experiment)
    write_report(folder / REPORT, results.default, comparisons=comparisons, paper=True, force=force)
    print_status(f"wrote flights, {EXPERIMENT_FILE}, {RESULT}, {PAPER}, {REPORT} to {folder}")


def demo_text(plan: ExperimentPlan, results: Results) -> str:
    """Format both estimates alongside the truth, and their errors on the validation flights."""
    from rotorfit.simulation.experiment_files import configuration_truth

    lines = [INTRODUCTION, _table_row("", "truth", "rotorfit", "holds", PAPERS, "holds")]
    truths = {c.name: configuration_truth(plan, c) for c in plan.configurations}
    first = next(iter(truths.values()))
    lines += [_number_row(name, None, first, results) for name in SHARED]
    for configuration, truth in truths.items():
        lines += ["", f"Body, configuration {configuration}"]
        lines += [_number_row(name, configuration, truth, results) for name in BODY]
    default, paper = (_count_coverage(result, truths) for result in results)
    lines += [
        "",
        f"Intervals that hold: rotorfit {default}, {PAPERS} {paper}; at 95 %",
        "one in twenty misses by chance.",
    ]
    return "\n".join([*lines, "", *_validation_lines(results)])


def _number_row(
    name: str, configuration: str | None, truth: Mapping[str, float], results: Results
) -> str:
    cells = [
        cell
        for result in results
        for cell in _estimate_cells(result.parameter(name, configuration), truth[name])
    ]
    return _table_row(name, f"{truth[name]:.4g}", *cells)


def _estimate_cells(estimate: Parameter, true: float) -> tuple[str, str]:
    """Format an estimate with its interval, and whether that holds the truth."""
    from rotorfit.digits import with_interval

    if estimate.value is None or estimate.interval is None:
        return estimate.verdict, ""
    low, high = estimate.interval
    return with_interval(estimate.value, estimate.interval), "yes" if low <= true <= high else "NO"


def _count_coverage(result: IdentificationResult, truths: Mapping[str, Mapping[str, float]]) -> str:
    """Count the shown intervals that hold the truth."""
    shared = [(name, None, next(iter(truths.values()))) for name in SHARED]
    bodies = [(name, owner, truth) for owner, truth in truths.items() for name in BODY]
    holds = [
        _estimate_cells(result.parameter(name, owner), truth[name])[1]
        for name, owner, truth in shared + bodies
    ]
    return f"{holds.count('yes')} of {len(holds) - holds.count('')}"


def _table_row(name: str, truth: str, default: str, held: str, paper: str, paper_held: str) -> str:
    line = f"  {name:<5}{truth:>10}{default:>24} {held:<5}{paper:>24} {paper_held}"
    return line.rstrip()


def _validation_lines(results: Results) -> list[str]:
    """Format the errors on flights that neither fit has seen."""
    from rotorfit.digits import short
    from rotorfit.results.validation.wrench_comparison import SHOWN

    def percents(error: Mapping[str, float]) -> str:
        return "".join(f"{short(100 * error[n]):>8}" if n in error else f"{'-':>8}" for n in SHOWN)

    names = "".join(f"{name:>8}" for name in SHOWN)
    lines = [
        "Error on the validation flights: force and moment of the rotors against those\n"
        "that the IMU measured, in % of their root mean square",
        f"  {'':<8}{'rotorfit':>32}  {PAPERS:>32}",
        f"  {'':<8}{names}  {names}",
    ]
    for default, paper in zip(results.default.validation, results.paper.validation, strict=True):
        pair = [percents(row["relative_error"]) for row in (default, paper)]
        lines.append(f"  {default['flight']:<8}{'  '.join(pair)}")
    return lines
