"""The tables of a result from the paper's procedure: its values, its sigmas, what it removed."""

from dataclasses import replace
from typing import Final

from rotorfit.estimation.least_squares import EssentialEstimate
from rotorfit.experiment.experiment import ConfigurationEntry, Experiment
from rotorfit.findings import note
from rotorfit.fit.rows.paper_fit import OWN_FREE, SHARED_FREE, PaperSettings, paper_estimate
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.model.parameters import PARAMETERS, full_name
from rotorfit.results.assemble import assembled
from rotorfit.results.result import IdentificationResult, Parameter
from rotorfit.verdicts.judge import judge, motion_for
from rotorfit.verdicts.parameter_tables import (
    given_parameter,
    motor_parameters,
    unit_of,
    with_timing_total,
)

SIGMAS: Final = (
    "the standard deviations are the paper's (eq. 19-21): they leave out bias and correlation "
    "between samples, and real errors are many times larger"
)


def paper_result(experiment: Experiment, dataset: TimedDataset) -> IdentificationResult:
    """Estimate by total least squares, the paper's way: its values, its sigmas, what it removed."""
    settings = _settings(experiment)
    return paper_tables(paper_estimate(dataset, settings=settings), settings, experiment, dataset)


def paper_tables(
    essential: EssentialEstimate,
    settings: PaperSettings,
    experiment: Experiment,
    dataset: TimedDataset,
) -> IdentificationResult:
    """Tabulate the paper's estimate with its own sigmas."""
    estimate = essential.estimate
    entries = [configured.entry for configured in dataset.configurations]
    parameters = [_paper_parameter(name, essential, entries[0]) for name in SHARED_FREE]
    if dataset.motor_timing is not None:
        parameters += motor_parameters(dataset.motors, dataset.motor_timing)
    for entry in entries:
        own = [_paper_parameter(name, essential, entry) for name in OWN_FREE]
        parameters += [given_parameter("mass", entry.mass, entry.mass_std, entry), *own]
    return assembled(
        experiment,
        dataset,
        parameters=tuple(parameters),
        derived=with_timing_total((), dataset.motor_timing),
        covariance_names=estimate.names,
        covariance=estimate.covariance,
        used={
            "estimator": "total least squares (Six et al. 2020, eq. 14-22)",
            "row_weights": "one pass, by wrench component",
            "cutoff": settings.cutoff,
            "samples_per_period": settings.samples_per_period,
            "r_sigma": settings.r_sigma,
            "configuration_weights": {entry.name: entry.weight for entry in entries},
            "rotor_inertia": False,
            "motor_lag": False,
            "removed_in_order": list(essential.removed),
        },
        diagnostics={"condition": estimate.condition_number},
        findings=(note("paper-sigmas", SIGMAS),),
    )


def _settings(experiment: Experiment) -> PaperSettings:
    """Return the paper's settings with what the experiment overrides."""
    given = experiment.identification
    default = PaperSettings()
    keep_all = given.preset is None and given.r_sigma is None
    return PaperSettings(
        cutoff=given.cutoff or default.cutoff,
        r_sigma=None if keep_all else given.r_sigma or default.r_sigma,
    )


def _paper_parameter(
    name: str, essential: EssentialEstimate, entry: ConfigurationEntry
) -> Parameter:
    """Return one parameter with the paper's sigma, or the statement that it was removed."""
    estimate = essential.estimate
    shared = name in SHARED_FREE
    full = name if shared else full_name(name, entry.name)
    shown = Parameter(
        name=name,
        configuration=None if shared else entry.name,
        value=None,
        std=None,
        interval=None,
        unit=unit_of(PARAMETERS[name], entry),
        verdict="removed",
        reason="largest relative standard deviation (Six et al. 2020, III-B)",
    )
    if full not in estimate.names:
        return shown
    value = estimate.value(full)
    std = float(estimate.std[estimate.names.index(full)])
    judged = judge(value, 1.96 * std, scale=0.0, axis=motion_for(name))
    shown = replace(shown, verdict=judged.verdict, reason=judged.reason, advice=judged.advice)
    if judged.verdict == "not-identified":
        return shown
    return replace(shown, value=value, std=std, interval=(value - 1.96 * std, value + 1.96 * std))
