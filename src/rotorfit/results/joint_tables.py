"""The tables of a result from the joint estimate, and the covariance of its numbers."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.checks.verdicts.parameters import (
    joint_parameters,
    judged_numbers,
    number_derived,
    with_timing_total,
)
from rotorfit.estimation.banded import response_sensitivity
from rotorfit.fit.intervals.joint_numbers import (
    SHARED_NUMBERS,
    formal_covariance,
    slopes_of_numbers,
    timing_shifts,
)
from rotorfit.fit.joint.closed_loop import NOMINAL_RESPONSE
from rotorfit.fit.reduction.frequency_bands import STRETCH
from rotorfit.fit.timing.timing_fit import SUMMED
from rotorfit.model.parameters import DERIVED, MOTOR_TIMES, OF_FLIGHT, UNREPORTED
from rotorfit.model.terms.body import BIAS_STD
from rotorfit.model.terms.rotors import ROTOR_SPREAD_STD
from rotorfit.results.assemble import assemble_tables, with_diagnosis
from rotorfit.results.hover_balance import balance_diagnostics, fitted_diagnostics

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.checks.verdicts.judge import Judgement
    from rotorfit.findings import Finding
    from rotorfit.fit.experiment.experiment import ConfigurationEntry
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.fit.joint.joint_problem import JointConfiguration
    from rotorfit.results.result import Derived, Parameter
    from rotorfit.results.tables import ResultTables


def joint_tables(fit: Fit, findings: Sequence[Finding] = ()) -> ResultTables:
    """Tabulate a joint fit: the numbers of all configurations, with verdicts and findings of it."""
    numbers, estimate = fit.numbers, fit.estimate
    parameters = joint_parameters(fit)
    entries = [c.entry for c in fit.dataset.configurations]
    known = [
        p.full_name for p in parameters if p.value is not None and p.full_name in numbers.names
    ]
    times = [p for p in parameters if p.name in MOTOR_TIMES and p.value is not None and p.std]
    names, covariance = joint_covariance(fit, known, times)
    tables = assemble_tables(
        fit.dataset,
        parameters=tuple(parameters),
        derived=with_timing_total(
            _derived_numbers(numbers, judged_numbers(fit), entries), fit.dataset.motor_timing
        ),
        covariance_names=names,
        covariance=covariance,
        used={
            "noise": "variances of the six accelerations, per phase and band",
            "band": "0 to 30 Hz",
            "stretch": f"{STRETCH:g} s",
            "rotor_spread_prior": ROTOR_SPREAD_STD,
            "accel_bias_prior": list(BIAS_STD.values()),
            **fit.choice.settings,
            **_response_setting(fit.configurations[0]),
        },
        diagnostics={
            "condition": estimate.estimate.condition_number,
            "log_likelihood": estimate.log_likelihood,
            "iterations": float(estimate.iterations),
            **{f"excitation_{key}": value for key, value in numbers.judged.excitation.items()},
            **{
                name: value
                for name, value in estimate.estimate.by_name.items()
                if name.partition("@")[0] in UNREPORTED
            },
            **balance_diagnostics(numbers, names, [entry.name for entry in entries]),
        },
    )
    tables = with_diagnosis(tables, findings)
    stated = {p.full_name for p in tables.parameters if p.value is not None}
    fitted = fitted_diagnostics(
        estimate.estimate,
        fit.configurations,
        stated,
        measured=fit.dataset.motors.speed == "measured",
    )
    return dataclasses.replace(tables, diagnostics={**tables.diagnostics, **fitted})


def joint_covariance(
    fit: Fit, known: Sequence[str], times: Sequence[Parameter]
) -> tuple[tuple[str, ...], Float[np.ndarray, "p p"]]:
    """Compute the covariance of numbers and of the motors' times that were fitted with them."""
    timing, estimate = fit.dataset.motor_timing, fit.estimate.estimate
    stated = {p.name: p.std or 0.0 for p in times}
    free = [name for name in SUMMED if name in estimate.names and name in stated]
    if timing is None or not free:
        return tuple(known), fit.numbers.covariance(known)
    own = np.array([np.eye(len(estimate.names))[estimate.names.index(name)] for name in free])
    # Two times by their sum and the lag.
    basis = own if len(free) == 1 else np.array([own.sum(axis=0), own[0]])
    slopes = slopes_of_numbers(
        known, estimate.values, estimate.std, fit.estimate.problem.map, fit.configurations
    )
    fitted = _covariance_of_fit(fit, np.vstack([slopes, basis]))
    n = len(known)
    spread = np.sqrt(np.diagonal(fitted)[:n])
    half = np.array([fit.numbers.number(name)[1] for name in known])
    turn = np.zeros((n + len(times), n + len(free)))
    # Each number keeps the deviation of its interval, and the times keep theirs and that of their
    # sum, the best known of them.
    turn[:n, :n] = np.diag(half / 1.96 / np.where(spread > 0.0, spread, 1.0))
    wanted = _of_sum(timing.total_std, [stated[name] for name in free])
    widened = np.linalg.cholesky(wanted) @ np.linalg.inv(np.linalg.cholesky(fitted[n:, n:]))
    # Rising and falling go with the mean lag.
    rows = [[1.0, -1.0] if p.name == "motor_delay" else [0.0, 1.0] for p in times]
    turn[n:, n:] = (np.ones((len(times), 1)) if len(free) == 1 else np.array(rows)) @ widened
    return (*known, *stated), turn @ fitted @ turn.T


def _covariance_of_fit(fit: Fit, slopes: Float[np.ndarray, "q f"]) -> Float[np.ndarray, "q q"]:
    """Compute the covariance by chance, by the autopilot's response, and by faults of the times."""
    shifts = timing_shifts(fit.estimate, fit.configurations[0].timing)
    late = np.reshape(shifts, (-1, slopes.shape[1])) @ slopes.T
    response = response_sensitivity(fit.estimate) @ slopes.T / 1.96
    return formal_covariance(fit.estimate, slopes) + response.T @ response + late.T @ late


def _of_sum(total: float, each: Sequence[float]) -> Float[np.ndarray, "t t"]:
    """Compute the covariance of the sum and the first of one or two times, by their deviations."""
    if len(each) == 1:
        return np.array([[each[0] ** 2]])
    lag, delay = each
    most = 0.999 * total * lag
    together = float(np.clip(0.5 * (total**2 + lag**2 - delay**2), -most, most))
    return np.array([[total**2, together], [together, lag**2]])


def _response_setting(c: JointConfiguration) -> dict[str, dict[str, tuple[float, ...]]]:
    """Return the autopilot's response beyond the nominal one, where the flights show it."""
    response = c.response
    if response == NOMINAL_RESPONSE:
        return {}
    return {"autopilot_answer": {"beyond_usual": response.beyond, "half_width": response.open}}


def _derived_numbers(
    numbers: Numbers, judged: Mapping[str, Judgement], entries: Sequence[ConfigurationEntry]
) -> list[Derived]:
    """Return the derived numbers, shared ones first; null if the flights do not give them."""
    return [
        number_derived(
            name if entry is None else f"{name}@{entry.name}",
            numbers,
            judged,
            owner=None if entry is None else entry.name,
            entry=entry or entries[0],
        )
        for entry in (None, *entries)
        for name in DERIVED
        if name not in OF_FLIGHT and (name in SHARED_NUMBERS) == (entry is None)
    ]
