"""rotorfit demo: the experiment of Six et al. 2020 flown again, estimates beside the truth."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from rotorfit.cli.identify import quiet_identify
from rotorfit.cli.outputs import refuse_output_folder
from rotorfit.cli.progress import steps
from rotorfit.cli.simulate import simulate_into
from rotorfit.cli.terminal import say, show
from rotorfit.experiment.experiment import Experiment, load_experiment
from rotorfit.formatting.digits import with_interval
from rotorfit.report.result_page import write_report
from rotorfit.results.result import IdentificationResult, Parameter
from rotorfit.simulation.experiment_files import EXPERIMENT_FILE, configuration_truth, file_names
from rotorfit.simulation.experiments import ExperimentPlan, Quality, plan_experiment
from rotorfit.validation.validate import validation_comparisons
from rotorfit.validation.wrench_comparison import SHOWN

VARIANT: Final[Quality] = "noisy"
RESULT, PAPER, REPORT = "result.json", "result-paper.json", "report.html"
PAPERS: Final = "paper's method"
BODY: Final = ("msx", "msy", "msz", "Ixx", "Iyy", "Izz")
INTRODUCTION: Final = """\
The experiment of Six et al. 2020, flown again in simulation: quadrotor A
(1.285 kg), and B, which is A with 125 g on +x and 42 g on -y. Noisy and biased
sensors; the log has motor commands only, and nobody knows the motors' lag. One
flight of each identifies both at once, one is kept for validation. Does the
95 % interval hold the truth?
"""


class Results(NamedTuple):
    """The same flights, identified by the default method and as the paper does."""

    ours: IdentificationResult
    paper: IdentificationResult


def run(output: Path | None, *, seed: int, force: bool, as_json: bool) -> None:
    """Fly, identify twice, print, and keep the files where asked."""
    plan = plan_experiment("paper", VARIANT, seed=seed)
    if output is None:
        with tempfile.TemporaryDirectory() as folder:
            results, _ = _demonstrate(Path(folder), plan, force=True)
    else:
        refuse_output_folder(output, [*file_names(plan), RESULT, PAPER, REPORT], force=force)
        results, experiment = _demonstrate(output, plan, force=force)
        _keep(output, results, experiment, force=force)
    show(results.ours.to_json().rstrip() if as_json else demo_text(plan, results))


def _demonstrate(folder: Path, plan: ExperimentPlan, *, force: bool) -> tuple[Results, Experiment]:
    """Fly into a folder, and identify from its files."""
    with steps() as tell:
        simulate_into(folder, plan, force=force, progress=tell)
    experiment = load_experiment(folder / EXPERIMENT_FILE)
    as_paper = experiment.identification.model_copy(update={"preset": "paper"})
    results = Results(
        ours=quiet_identify(experiment),
        paper=quiet_identify(experiment.model_copy(update={"identification": as_paper})),
    )
    return results, experiment


def _keep(folder: Path, results: Results, experiment: Experiment, *, force: bool) -> None:
    results.ours.save(folder / RESULT, force=force)
    results.paper.save(folder / PAPER, force=force)
    comparisons = validation_comparisons(results.ours, experiment)
    write_report(folder / REPORT, results.ours, comparisons=comparisons, paper=True, force=force)
    say(f"wrote flights, {EXPERIMENT_FILE}, {RESULT}, {PAPER}, {REPORT} to {folder}")


def demo_text(plan: ExperimentPlan, results: Results) -> str:
    """Return both estimates beside the truth, and their errors on flights kept apart."""
    lines = [INTRODUCTION, _row("", "truth", "rotorfit", "holds", PAPERS, "holds")]
    truths = {c.name: configuration_truth(plan, c) for c in plan.configurations}
    shared = next(iter(truths.values()))
    lines += [_number_row(name, None, shared, results) for name in ("kt", "kd")]
    for configuration, truth in truths.items():
        lines += ["", f"Body, configuration {configuration}"]
        lines += [_number_row(name, configuration, truth, results) for name in BODY]
    ours, paper = (_held(result, truths) for result in results)
    lines += ["", f"Intervals that hold the truth: rotorfit's {ours}, the paper's {paper}; at 95 %"]
    lines += ["one in twenty misses by chance."]
    return "\n".join([*lines, "", *_validation_lines(results)])


def _number_row(
    name: str, configuration: str | None, truth: Mapping[str, float], results: Results
) -> str:
    cells = [
        cell
        for result in results
        for cell in _beside(result.parameter(name, configuration), truth[name])
    ]
    return _row(name, f"{truth[name]:.4g}", *cells)


def _beside(estimate: Parameter, true: float) -> tuple[str, str]:
    """Return an estimate with its interval, and whether that holds the truth."""
    if estimate.value is None or estimate.interval is None:
        return estimate.verdict, ""
    low, high = estimate.interval
    return with_interval(estimate.value, estimate.interval), "yes" if low <= true <= high else "NO"


def _held(result: IdentificationResult, truths: Mapping[str, Mapping[str, float]]) -> str:
    """Return how many of the intervals shown hold the truth."""
    shared = [(name, None, next(iter(truths.values()))) for name in ("kt", "kd")]
    own = [(name, owner, truth) for owner, truth in truths.items() for name in BODY]
    holds = [
        _beside(result.parameter(name, owner), truth[name])[1]
        for name, owner, truth in shared + own
    ]
    return f"{holds.count('yes')} of {len(holds) - holds.count('')}"


def _row(name: str, truth: str, ours: str, held: str, paper: str, paper_held: str) -> str:
    line = f"  {name:<5}{truth:>10}{ours:>24} {held:<5}{paper:>24} {paper_held}"
    return line.rstrip()


def _validation_lines(results: Results) -> list[str]:
    """Return the errors on flights that neither fit has seen."""
    names = "".join(f"{name:>8}" for name in SHOWN)
    lines = [
        "Error on flights kept apart: body wrench against rotor wrench, % of its norm",
        f"  {'':<8}{'rotorfit':>32}  {PAPERS:>32}",
        f"  {'':<8}{names}  {names}",
    ]
    for ours, paper in zip(results.ours.validation, results.paper.validation, strict=True):
        pair = [_percents(row["relative_error"]) for row in (ours, paper)]
        lines.append(f"  {ours['flight']:<8}{'  '.join(pair)}")
    return lines


def _percents(error: Mapping[str, float]) -> str:
    return "".join(f"{100 * error[n]:>8.1f}" if n in error else f"{'-':>8}" for n in SHOWN)
