"""The parameters of the joint estimate, with the verdict on every number."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from rotorfit.estimation.banded import BandedEstimate
from rotorfit.experiment.experiment import ConfigurationEntry
from rotorfit.fit.fit import Fit
from rotorfit.fit.intervals.excitation import HEIGHTS
from rotorfit.fit.intervals.joint_numbers import number_scale
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.joint.joint_map import spread_names
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.model.parameters import PARAMETERS, ROW_ORDER
from rotorfit.verdicts.judge import ADVICE, Judgement, little_excited
from rotorfit.verdicts.numbers import Parameter
from rotorfit.verdicts.parameter_tables import (
    RATIOS,
    given_parameter,
    judgements,
    motor_parameters,
    number_parameter,
)


def joint_parameters(fit: Fit) -> list[Parameter]:
    """Judge every parameter of a joint fit, in the order of the table."""
    judged = judged_numbers(fit)
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


def judged_numbers(fit: Fit) -> dict[str, Judgement]:
    """Judge every number; a rotor's coefficient that the prior decides is named so."""
    judged = _judgements(fit.numbers, fit.configurations)
    return judged | {
        name: judgement
        for name, judgement in assumed_rotors(fit.estimate, fit.configurations).items()
        if judged[name].verdict != "not-identified"
    }


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
