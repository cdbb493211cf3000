"""The tables of a result from the estimate row by row, and from the paper's procedure."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.verdicts.judge import ADVICE, Judgement, judge, motion_for
from rotorfit.checks.verdicts.parameters import (
    RATIOS,
    SHARED_DERIVED,
    given_parameter,
    judgements,
    motor_parameters,
    number_derived,
    number_parameter,
    unit_of,
    with_timing_total,
)
from rotorfit.checks.weak_directions import excitation_findings, origin_findings
from rotorfit.findings import note
from rotorfit.fit.fit_flights import setting_terms
from rotorfit.fit.intervals.interval_terms import NumberTerm
from rotorfit.fit.paper_fit import OWN_FREE, SHARED_FREE, PaperSettings, paper_estimate
from rotorfit.fit.row_fits import ROWS, RowFits, fit_rows, number_scale, row_numbers
from rotorfit.model.parameters import DERIVED, OF_FLIGHT, PARAMETERS, ROW_ORDER, SHARED, full_name
from rotorfit.results.assemble import assemble_tables
from rotorfit.results.result import Parameter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float

    from rotorfit.estimation.least_squares import EssentialEstimate
    from rotorfit.fit.experiment.experiment import ConfigurationEntry, Experiment
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.fit.timing.timed_dataset import TimedDataset
    from rotorfit.results.tables import ResultTables


def estimate_by_rows(experiment: Experiment, dataset: TimedDataset) -> ResultTables:
    """Estimate row by row, and tabulate the numbers with verdicts."""
    fits = _rows_at(dataset)
    return row_tables(_with_setting_terms(dataset, fits), fits, experiment, dataset)


def row_tables(
    numbers: Numbers, fits: RowFits, experiment: Experiment, dataset: TimedDataset
) -> ResultTables:
    """Tabulate numbers with their final intervals, with verdicts."""
    configured = dataset.configurations[0]
    entry, vehicle = configured.entry, dataset.vehicle
    judged = judgements(
        numbers, lambda name: number_scale(numbers, name, mass=configured.mass, arm=vehicle.arm)
    )
    parameters = [
        *_row_parameters(numbers, judged, entry),
        *motor_parameters(experiment.motors, dataset.motor_timing),
        given_parameter("mass", entry.mass, entry.mass_std, entry),
    ]
    parameters.sort(key=lambda p: ROW_ORDER.index(p.name))
    known = [p.name for p in parameters if p.value is not None and p.name in numbers.names]
    derived = [
        number_derived(
            name,
            numbers,
            judged,
            owner=None if name in SHARED_DERIVED else entry.name,
            entry=entry,
        )
        for name in DERIVED
        if name not in OF_FLIGHT
    ]
    return assemble_tables(
        dataset,
        parameters=tuple(parameters),
        derived=with_timing_total(derived, dataset.motor_timing),
        covariance_names=tuple(full_name(name, entry.name) for name in known),
        covariance=numbers.covariance(known),
        used={"noise": "per phase and band", "band": "0 to 30 Hz", "stretch": "20 s"},
        diagnostics={
            **{f"excitation_{axis}": value for axis, value in fits.excitation.items()},
            **{f"condition_{row}": fits.fits[row].estimate.condition_number for row in ROWS},
        },
        findings=(*excitation_findings(numbers), *origin_findings(vehicle)),
    )


def _rows_at(dataset: TimedDataset, *, top: float = np.inf) -> RowFits:
    """Fit every row by the bands that begin under an edge [Hz]."""
    factors = dataset.bands(dataset.timing)[0]
    factors = factors.select(factors.band[:, 0] < top)
    return fit_rows(factors, dataset.model, mass=dataset.configurations[0].mass)


def _numbers_of_rows(dataset: TimedDataset, fits: RowFits) -> Numbers:
    configured = dataset.configurations[0]
    return row_numbers(
        fits, dataset.vehicle, mass=configured.mass, mass_std=configured.entry.mass_std
    )


def _with_setting_terms(dataset: TimedDataset, fits: RowFits) -> Numbers:
    """Compute the numbers, with interval terms by settings that could as well be others."""
    numbers = _numbers_of_rows(dataset, fits)

    def shift(other: TimedDataset, top: float) -> Float[np.ndarray, " q"]:
        return _numbers_of_rows(other, _rows_at(other, top=top)).values - numbers.values

    return numbers.with_terms(*setting_terms(dataset, shift, timed=False))


def _row_parameters(
    numbers: Numbers, judged: Mapping[str, Judgement], entry: ConfigurationEntry
) -> list[Parameter]:
    parameters: list[Parameter] = []
    for name in PARAMETERS:
        owner = None if name in SHARED else entry.name
        if name in numbers.names:
            found = number_parameter(name, numbers, judged[name], owner=owner, entry=entry)
            parameters.append(found)
        elif name in RATIOS:
            ratio, partner = RATIOS[name]
            parameters.append(_ratio_parameter(name, partner, judged[ratio], owner, entry))
    return parameters


def _ratio_parameter(
    name: str, partner: str, ratio: Judgement, owner: str | None, entry: ConfigurationEntry
) -> Parameter:
    """Return a parameter of the yaw row, which fixes it only relative to its partner."""
    fixed = ratio.verdict != "not-identified"
    return Parameter(
        name=name,
        configuration=owner,
        value=None,
        std=None,
        interval=None,
        unit=unit_of(PARAMETERS[name], entry),
        verdict="ratio-only" if fixed else "not-identified",
        partner=partner if fixed else None,
        reason="the yaw equation gives only ratios to Izz" if fixed else ratio.reason,
        advice=ADVICE["scale"] if fixed else ratio.advice,
        asks="other" if fixed else ratio.asks,
    )


SIGMAS: Final = (
    "the standard deviations are the paper's (eq. 19-21): they leave out bias and correlation "
    "between samples, and real errors are many times larger"
)


def estimate_by_paper(experiment: Experiment, dataset: TimedDataset) -> ResultTables:
    """Estimate by total least squares, the paper's way: its values, its sigmas, what it removed."""
    settings = _paper_settings(experiment)
    return paper_tables(paper_estimate(dataset, settings=settings), settings, experiment, dataset)


def paper_tables(
    essential: EssentialEstimate,
    settings: PaperSettings,
    experiment: Experiment,
    dataset: TimedDataset,
) -> ResultTables:
    """Tabulate the paper's estimate with its own sigmas."""
    estimate = essential.estimate
    entries = [configured.entry for configured in dataset.configurations]
    parameters = [_paper_parameter(name, essential, entries[0]) for name in SHARED_FREE]
    if dataset.motor_timing is not None:
        parameters += motor_parameters(dataset.motors, dataset.motor_timing)
    for entry in entries:
        own = [_paper_parameter(name, essential, entry) for name in OWN_FREE]
        parameters += [given_parameter("mass", entry.mass, entry.mass_std, entry), *own]
    return assemble_tables(
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


def _paper_settings(experiment: Experiment) -> PaperSettings:
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
    shown = replace(
        shown,
        verdict=judged.verdict,
        reason=judged.reason,
        advice=judged.advice,
        asks=judged.asks,
    )
    if judged.verdict == "not-identified":
        return shown
    half = 1.96 * std
    sigma = NumberTerm(name="noise", half_width=half, source="the paper's own deviation")
    return replace(
        shown,
        value=value,
        std=std,
        interval=(value - half, value + half),
        interval_terms=(sigma,),
    )
