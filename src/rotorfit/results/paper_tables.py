"""The tables of a result from the paper's procedure: its values, its sigmas, what it removed."""

from dataclasses import replace

from rotorfit.dataset.dataset import Dataset
from rotorfit.estimation.least_squares import EssentialEstimate
from rotorfit.experiment.experiment import ConfigurationEntry
from rotorfit.fit.rows.paper_fit import OWN_FREE, SHARED_FREE, PaperSettings
from rotorfit.model.parameters import PARAMETERS, full_name
from rotorfit.results.parameter_tables import (
    Tables,
    given_parameter,
    motor_parameters,
    unit_of,
)
from rotorfit.results.result import Parameter
from rotorfit.results.verdicts import judge, motion_for


def paper_tables(
    essential: EssentialEstimate, dataset: Dataset, *, settings: PaperSettings
) -> Tables:
    """Return the tables of the paper's estimate: its values, its sigmas, what it removed."""
    estimate = essential.estimate
    entries = [configured.entry for configured in dataset.configurations]
    parameters = [_paper_parameter(name, essential, entries[0]) for name in SHARED_FREE]
    if dataset.motor_timing is not None:
        parameters += motor_parameters(dataset.motors, dataset.motor_timing)
    for entry in entries:
        own = [_paper_parameter(name, essential, entry) for name in OWN_FREE]
        parameters += [given_parameter("mass", entry.mass, entry.mass_std, entry), *own]
    return Tables(
        parameters=tuple(parameters),
        derived=(),
        covariance_names=estimate.names,
        covariance=estimate.covariance,
        settings={
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
        warnings=(
            "the standard deviations are the paper's (eq. 19-21): they leave out bias and "
            "correlation between samples, and real errors are many times larger",
        ),
        diagnostics={"condition": estimate.condition_number},
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
