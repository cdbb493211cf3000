"""The tables of a result from the joint estimate: verdicts on every number."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from rotorfit.estimation.banded import BandedEstimate, response_sensitivity
from rotorfit.estimation.estimate import numerical_jacobian
from rotorfit.experiment.experiment import ConfigurationEntry, Experiment
from rotorfit.fit.fit import Fit
from rotorfit.fit.intervals.excitation import HEIGHTS
from rotorfit.fit.intervals.joint_numbers import (
    SHARED_NUMBERS,
    formal_covariance,
    number_scale,
    physical,
    timing_shifts,
)
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.joint.closed_loop import NOMINAL_RESPONSE
from rotorfit.fit.joint.joint_map import spread_names
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.fit.timing.timing_fit import SUMMED
from rotorfit.model.parameters import (
    DERIVED,
    MOTOR_TIMES,
    OF_FLIGHT,
    PARAMETERS,
    ROW_ORDER,
    UNREPORTED,
)
from rotorfit.model.terms.body import BIAS_STD
from rotorfit.model.terms.rotors import ROTOR_SPREAD_STD
from rotorfit.reduction.frequency_bands import STRETCH
from rotorfit.results.assemble import assembled
from rotorfit.results.parameter_tables import (
    RATIOS,
    given_parameter,
    judgements,
    motor_parameters,
    number_derived,
    number_parameter,
    with_timing_total,
)
from rotorfit.results.result import Derived, IdentificationResult, Parameter
from rotorfit.results.verdicts import ADVICE, Judgement, little_excited


def joint_parameters(fit: Fit) -> list[Parameter]:
    """Judge every parameter of a joint fit, in the order of the table."""
    judged = _judged(fit)
    entries = [c.entry for c in fit.dataset.configurations]
    parameters = [
        _parameter(name, fit.numbers, judged, entries)
        for name in fit.numbers.names
        if _is_parameter(name)
    ]
    parameters += motor_parameters(fit.dataset.motors, fit.dataset.motor_timing)
    parameters += [given_parameter("mass", e.mass, e.mass_std, e) for e in entries]
    order = {entry.name: i for i, entry in enumerate(entries)}
    parameters.sort(key=lambda p: (order.get(p.configuration or "", -1), ROW_ORDER.index(p.name)))
    return parameters


def _judged(fit: Fit) -> dict[str, Judgement]:
    """Judge every number; a rotor's coefficient that the prior decides is named so."""
    judged = _judgements(fit.numbers, fit.configurations)
    return judged | {
        name: judgement
        for name, judgement in assumed_rotors(fit.estimate, fit.configurations).items()
        if judged[name].verdict != "not-identified"
    }


def joint_result(fit: Fit, experiment: Experiment) -> IdentificationResult:
    """Tabulate a joint fit: parameters and derived numbers of all configurations, with verdicts."""
    numbers, estimate = fit.numbers, fit.estimate
    parameters = joint_parameters(fit)
    entries = [c.entry for c in fit.dataset.configurations]
    known = [
        p.full_name for p in parameters if p.value is not None and p.full_name in numbers.names
    ]
    times = [p for p in parameters if p.name in MOTOR_TIMES and p.value is not None and p.std]
    names, covariance = joint_covariance(fit, known, times)
    return assembled(
        experiment,
        fit.dataset,
        parameters=tuple(parameters),
        derived=with_timing_total(
            _derived_numbers(numbers, _judged(fit), entries), fit.dataset.motor_timing
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
            **{f"excitation_{key}": value for key, value in numbers.excitation.items()},
            **{
                name: value
                for name, value in estimate.estimate.by_name.items()
                if name.partition("@")[0] in UNREPORTED
            },
        },
    )


def joint_covariance(
    fit: Fit, known: Sequence[str], times: Sequence[Parameter]
) -> tuple[tuple[str, ...], Float[np.ndarray, "p p"]]:
    """Compute the covariance of numbers and of the motors' times that were fitted with them.

    The fit says how they go together. Each number keeps the deviation of its interval, and the
    times keep theirs and that of their sum, the best known of them. Without fitted times: of the
    numbers alone.
    """
    timing, estimate = fit.dataset.motor_timing, fit.estimate.estimate
    stated = {p.name: p.std or 0.0 for p in times}
    free = [name for name in SUMMED if name in estimate.names and name in stated]
    if timing is None or not free:
        return tuple(known), fit.numbers.covariance(known)
    own = np.array([np.eye(len(estimate.names))[estimate.names.index(name)] for name in free])
    # Two times by their sum and the lag.
    basis = own if len(free) == 1 else np.array([own.sum(axis=0), own[0]])
    fitted = _fitted(fit, np.vstack([_slopes(fit, known), basis]))
    n = len(known)
    spread = np.sqrt(np.diagonal(fitted)[:n])
    half = np.array([fit.numbers.number(name)[1] for name in known])
    turn = np.zeros((n + len(times), n + len(free)))
    turn[:n, :n] = np.diag(half / 1.96 / np.where(spread > 0.0, spread, 1.0))
    wanted = _of_sum(timing.total_std, [stated[name] for name in free])
    widened = np.linalg.cholesky(wanted) @ np.linalg.inv(np.linalg.cholesky(fitted[n:, n:]))
    # Rising and falling go with the mean lag.
    rows = [[1.0, -1.0] if p.name == "motor_delay" else [0.0, 1.0] for p in times]
    turn[n:, n:] = (np.ones((len(times), 1)) if len(free) == 1 else np.array(rows)) @ widened
    return (*known, *stated), turn @ fitted @ turn.T


def _slopes(fit: Fit, known: Sequence[str]) -> Float[np.ndarray, "k f"]:
    """Compute the slopes of numbers by the free parameters."""
    estimate, mapped = fit.estimate.estimate, fit.estimate.problem.map

    def numbers(phi: Float[np.ndarray, " f"]) -> Float[np.ndarray, " k"]:
        found = physical(phi, mapped, fit.configurations)
        return np.array([found[name] for name in known])

    return numerical_jacobian(numbers, estimate.values, estimate.std)


def _fitted(fit: Fit, slopes: Float[np.ndarray, "q f"]) -> Float[np.ndarray, "q q"]:
    """Compute the covariance by chance, by the autopilot's answer, and by faults of the times."""
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


def _is_parameter(name: str) -> bool:
    return name.partition("@")[0] in PARAMETERS


def _judgements(
    numbers: Numbers, configurations: Sequence[JointConfiguration]
) -> dict[str, Judgement]:
    """Return the verdict on every number; a lost scale with a good ratio is ``ratio-only``."""
    masses = {c.name: c.mass for c in configurations}
    vehicle = configurations[0].vehicle

    def scale_of(name: str) -> float:
        owner = name.partition("@")[2]
        mass = masses[owner] if owner else max(masses.values())
        return number_scale(numbers, name, mass=mass, vehicle=vehicle)

    judged = judgements(numbers, scale_of)
    for name in numbers.names:
        base, _, owner = name.partition("@")
        if base in HEIGHTS and not np.isfinite(numbers.number(name)[1]):
            judged[name] = replace(
                judged[name],
                reason=little_excited("roll and pitch", numbers.link(owner)),
            )
    return judged


def _parameter(
    name: str,
    numbers: Numbers,
    judged: Mapping[str, Judgement],
    entries: Sequence[ConfigurationEntry],
) -> Parameter:
    """Return one parameter with its verdict."""
    base, _, owner = name.partition("@")
    entry = next((e for e in entries if e.name == owner), entries[0])
    shown = number_parameter(name, numbers, judged[name], owner=owner or None, entry=entry)
    ratio = None if shown.value is not None else _ratio(base, owner, entries, judged)
    if ratio is None:
        return shown
    return replace(
        shown,
        verdict="ratio-only",
        partner=ratio,
        reason=f"this flight gives it only together with {ratio}",
        advice=ADVICE["yaw"],
    )


def _ratio(
    base: str,
    owner: str,
    entries: Sequence[ConfigurationEntry],
    judged: Mapping[str, Judgement],
) -> str | None:
    """Return the partner with which a lost number is still known as a ratio."""
    if base not in RATIOS:
        return None
    ratio, partner = RATIOS[base]
    owners = [owner] if owner else [entry.name for entry in entries]
    known = any(judged[f"{ratio}@{o}"].verdict != "not-identified" for o in owners)
    return partner if known else None


def _derived_numbers(
    numbers: Numbers, judged: Mapping[str, Judgement], entries: Sequence[ConfigurationEntry]
) -> list[Derived]:
    """Return the derived numbers, shared ones first; null where the flights do not give them."""
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


MOSTLY_ASSUMED = 0.5
"""Deviation after the flights over that before, from which a coefficient counts as assumed. A
quadrotor's come to 0.2 of it; of six or eight rotors 0.6 and more is left at best."""


def assumed_rotors(
    fit: BandedEstimate, configurations: Sequence[JointConfiguration]
) -> dict[str, Judgement]:
    """Return the verdict on those coefficients that the flights do not tell, by name."""
    vehicle = configurations[0].vehicle
    spread = spread_names(vehicle)
    names = tuple(dict.fromkeys(spread))
    if not set(names) or not set(names) <= set(fit.estimate.names):
        return {}
    at = [fit.estimate.names.index(name) for name in names]
    after = fit.estimate.covariance[np.ix_(at, at)]
    before = np.diag([fit.problem.prior_std[name] ** 2 for name in names])
    left = np.sqrt(_own_variance(spread, names, after) / _own_variance(spread, names, before))
    grouped = any(rotor.group is not None for rotor in vehicle.rotors)
    judgement = _judgement(len(spread), grouped=grouped)
    return {f"kt_{i}": judgement for i, share in enumerate(left, start=1) if share > MOSTLY_ASSUMED}


def _own_variance(
    spread: Sequence[str], names: Sequence[str], covariance: Float[np.ndarray, "s s"]
) -> Float[np.ndarray, " N"]:
    """Return the variance of each rotor's coefficient over the mean one."""
    own = np.array([[float(name == mine) for name in names] for mine in spread])
    own -= own.mean(axis=0)
    return np.einsum("is,st,it->i", own, covariance, own)


def _judgement(rotors: int, *, grouped: bool) -> Judgement:
    """Return why the flights do not tell, and what to do."""
    if grouped:
        reason = "the mixer moves these groups of rotors together"
        advice = "measure thrust on a stand, or choose other groups: the rotors of one spin, say"
    elif rotors > 4:
        reason = "the mixer moves these rotors together"
        advice = 'give the rotors that are alike the same group (group = "..." in [airframe])'
    else:
        # Kept: with the CoM they make the trim of hover, and one without the other is none.
        reason = "the flights hardly separate this rotor from the average one"
        advice = "roll, pitch and yaw more briskly"
        return Judgement(verdict="weak", reason=reason, advice=advice)
    return Judgement(verdict="not-identified", reason=reason, advice=advice)
