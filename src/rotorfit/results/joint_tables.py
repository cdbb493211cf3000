"""The tables of a result from the joint estimate: verdicts on every number."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorfit.estimation.banded import BandedEstimate
from rotorfit.experiment.experiment import ConfigurationEntry, MotorsEntry
from rotorfit.fit.intervals.excitation import HEIGHTS, LEAST_EXCITATION
from rotorfit.fit.intervals.joint_numbers import SHARED_NUMBERS, number_scale
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.joint.joint_problem import BIAS_STD, ROTOR_SPREAD_STD, JointConfiguration
from rotorfit.model.parameters import DERIVED, PARAMETERS
from rotorfit.reduction.frequency_bands import STRETCH
from rotorfit.reduction.motor_timing import MotorTiming
from rotorfit.results.parameter_tables import (
    RATIOS,
    ROW_ORDER,
    Tables,
    excitation_warnings,
    given_parameter,
    judgements,
    motor_parameters,
    number_derived,
    number_parameter,
)
from rotorfit.results.result import Derived, Parameter
from rotorfit.results.rotor_spread import assumed_rotors
from rotorfit.results.verdicts import ADVICE, Judgement


def joint_tables(
    numbers: Numbers,
    fit: BandedEstimate,
    configurations: Sequence[JointConfiguration],
    entries: Sequence[ConfigurationEntry],
    *,
    motors: MotorsEntry,
    timing: MotorTiming | None,
) -> Tables:
    """Return parameters and derived numbers of all configurations, each with its verdict."""
    judged = _judgements(numbers, configurations)
    judged |= {
        name: judgement
        for name, judgement in assumed_rotors(fit, configurations).items()
        if judged[name].verdict != "not-identified"
    }
    parameters = [
        _parameter(name, numbers, judged, entries) for name in numbers.names if _is_parameter(name)
    ]
    parameters += motor_parameters(motors, timing)
    parameters += [given_parameter("mass", e.mass, e.mass_std, e) for e in entries]
    order = {entry.name: i for i, entry in enumerate(entries)}
    parameters.sort(key=lambda p: (order.get(p.configuration or "", -1), ROW_ORDER.index(p.name)))
    known = [
        p.full_name for p in parameters if p.value is not None and p.full_name in numbers.names
    ]
    return Tables(
        parameters=tuple(parameters),
        derived=tuple(_derived_numbers(numbers, judged, entries)),
        covariance_names=tuple(known),
        covariance=numbers.covariance(known),
        settings={
            "noise": "variances of the six accelerations, per phase and band",
            "band": "0 to 30 Hz",
            "stretch": f"{STRETCH:g} s",
            "rotor_spread_prior": ROTOR_SPREAD_STD,
            "accel_bias_prior": list(BIAS_STD.values()),
        },
        warnings=excitation_warnings(
            numbers, configurations[0].vehicle, several=len(configurations) > 1
        ),
        diagnostics={
            "condition": fit.estimate.condition_number,
            "log_likelihood": fit.log_likelihood,
            "iterations": float(fit.iterations),
            **{f"excitation_{key}": value for key, value in numbers.excitation.items()},
            # Over a velocity that is felt, not known: told, but no finding with an interval.
            **{k: v for k, v in fit.estimate.by_name.items() if k.startswith("climb_drag@")},
        },
    )


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
                reason=f"signal-to-noise {numbers.link(owner):.1f} in roll and pitch, need "
                f"{LEAST_EXCITATION:.0f}",
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
        if (name in SHARED_NUMBERS) == (entry is None)
    ]
