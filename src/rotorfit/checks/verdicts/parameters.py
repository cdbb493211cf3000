"""Tabulate the parameters and derived numbers of a result, with verdicts."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.checks.verdicts.judge import (
    ADVICE,
    WEAK,
    Derived,
    Judgement,
    Parameter,
    judge,
    little_excited,
)
from rotorfit.digits import short
from rotorfit.fit.intervals.allowances import number_scale
from rotorfit.fit.intervals.interval_terms import NumberTerm
from rotorfit.fit.intervals.numbers import HEIGHTS, Numbers
from rotorfit.fit.joint.joint_map import spread_names
from rotorfit.fit.reduction.motor_timing import MotorTiming, is_time_identifiable
from rotorfit.model.parameters import DERIVED, PARAMETERS, ROW_ORDER

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.estimation.banded import BandedEstimate
    from rotorfit.fit.experiment.experiment import ConfigurationEntry, MotorsEntry
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.joint.joint_problem import JointConfiguration
    from rotorfit.model.terms.term import ParameterInfo

SHARED_DERIVED = ("kd_over_kt", "motor_lag_total")
TIME_SCALE = 0.008
"""A motor delay of this size matters [s]: known to a quarter of it, it is identified."""
RATIOS = {
    "kd": ("kd_over_Izz", "Izz"),
    "Jr": ("Jr_over_Izz", "Izz"),
    "Izz": ("kd_over_Izz", "kd"),
}
"""The ratio that the yaw equation gives even where the number alone is lost, and with whom."""


def unit_of(info: ParameterInfo, entry: ConfigurationEntry) -> str:
    """Return the unit, per kilogram where the mass is unknown."""
    return f"{info.unit} per kg" if entry.mass == "unknown" and info.mass_power else info.unit


def judgements(numbers: Numbers, scale_of: Callable[[str], float]) -> dict[str, Judgement]:
    """Judge every number with its final interval.

    `scale_of`: from a number's name to a size of it that matters.
    """
    judged = numbers.judged
    return {
        name: judge(
            *numbers.number(name),
            scale=scale_of(name),
            axis=numbers.motion(name),
            excitation=judged.rho(name),
        )
        for name in numbers.names
    }


def number_parameter(
    name: str,
    numbers: Numbers,
    judgement: Judgement,
    *,
    owner: str | None,
    entry: ConfigurationEntry,
) -> Parameter:
    """Tabulate one parameter with its verdict, and with its value if the verdict allows it.

    `owner`: the configuration it belongs to; None for what all share. `entry`: by which its unit
    goes.
    """
    known = judgement.verdict != "not-identified"
    base = name.partition("@")[0]
    value, half = numbers.number(name)
    return Parameter(
        name=base,
        configuration=owner,
        value=value if known else None,
        std=half / 1.96 if known else None,
        interval=(value - half, value + half) if known else None,
        unit=unit_of(PARAMETERS[base], entry),
        verdict=judgement.verdict,
        reason=judgement.reason,
        advice=judgement.advice,
        asks=judgement.asks,
        interval_terms=numbers.terms_of(name) if known else (),
    )


def number_derived(
    name: str,
    numbers: Numbers,
    judged: Mapping[str, Judgement],
    *,
    owner: str | None,
    entry: ConfigurationEntry,
) -> Derived:
    """Return one derived number; null if the flights do not give it. See `number_parameter`."""
    known = name in numbers.names and judged[name].verdict != "not-identified"
    base = name.partition("@")[0]
    value, half = numbers.number(name) if known else (0.0, 0.0)
    return Derived(
        name=base,
        configuration=owner,
        value=value if known else None,
        std=half / 1.96 if known else None,
        interval=(value - half, value + half) if known else None,
        unit=unit_of(DERIVED[base], entry),
        verdict=judged[name].verdict if name in numbers.names else "not-identified",
        reason=judged[name].reason if name in numbers.names else None,
        interval_terms=numbers.terms_of(name) if known else (),
    )


def motor_parameters(motors: MotorsEntry, timing: MotorTiming | None) -> list[Parameter]:
    """Return lag and delay, given or found; rising and falling apart where they differ."""
    found: dict[str, tuple[float, float]] = {}
    if timing is not None:
        response = timing.response
        if timing.lag_std is not None:
            found["motor_lag"] = (response.mean_lag, timing.lag_std)
        if timing.lag_std is not None and response.lag_down is not None:
            found["motor_lag_up"] = (response.lag, timing.lag_std)
            found["motor_lag_down"] = (response.lag_down, timing.lag_std)
        if timing.delay_std is not None:
            found["motor_delay"] = (response.delay, timing.delay_std)
    declared = {
        "motor_lag": motors.lag if motors.lag_down is None else None,
        "motor_lag_up": None if motors.lag_down is None else motors.lag,
        "motor_lag_down": motors.lag_down,
        "motor_delay": motors.delay,
    }
    given = [
        _given_time(name, value)
        for name, value in declared.items()
        if value is not None and name not in found
    ]
    return [*given, *(found_time(name, *number) for name, number in found.items())]


def _given_time(name: str, value: float) -> Parameter:
    return Parameter(
        name=name,
        configuration=None,
        value=value,
        std=None,
        interval=None,
        unit="s",
        verdict="given",
    )


def found_time(name: str, value: float, std: float) -> Parameter:
    """Tabulate an estimated time; identified if known to a quarter of its relevant scale."""
    half = 1.96 * std
    sharp, known = half <= WEAK * max(abs(value), TIME_SCALE), is_time_identifiable(value, std)
    # No rotor follows before its command; a delay is negative where motors are recorded late.
    low = value - half if name.endswith("_delay") else max(value - half, 0.0)
    return Parameter(
        name=name,
        configuration=None,
        value=value if known else None,
        std=std if known else None,
        interval=(low, value + half) if known else None,
        unit="s",
        verdict=("identified" if sharp else "weak") if known else "not-identified",
        reason=None if sharp else f"known only to +-{short(1e3 * half)} ms",
        advice=None if sharp else ADVICE["roll"],
        asks=None if sharp else "flight",
        interval_terms=timing_terms(half) if known else (),
    )


def timing_terms(half: float) -> tuple[NumberTerm, ...]:
    """Return the one term of a time of the motors, whose parts its search has combined."""
    source = "search of the motors' times: noise, the autopilot's response, how commands hold"
    return (NumberTerm(name="timing of the motors", half_width=half, source=source),)


def with_timing_total(
    derived: Iterable[Derived], timing: MotorTiming | None
) -> tuple[Derived, ...]:
    """Add lag plus delay of commands, which is sharper than either alone."""
    if timing is None or timing.response.mean_lag == 0.0:
        return tuple(derived)
    value, half = timing.response.mean_lag + timing.response.delay, 1.96 * timing.total_std
    total = Derived(
        name="motor_lag_total",
        configuration=None,
        value=value if timing.identifiable else None,
        std=timing.total_std if timing.identifiable else None,
        interval=(value - half, value + half) if timing.identifiable else None,
        unit="s",
        interval_terms=timing_terms(half) if timing.identifiable else (),
    )
    return (total, *(d for d in derived if d.name != total.name))


def given_parameter(
    name: str, value: float | str, std: float, entry: ConfigurationEntry
) -> Parameter:
    """Tabulate a parameter that the user gave, or left unknown."""
    known = isinstance(value, float)
    tolerance = NumberTerm(
        name="weight", half_width=1.96 * std, source="declared tolerance of the mass"
    )
    return Parameter(
        name=name,
        configuration=entry.name,
        value=value if known else None,
        std=std if known and std > 0 else None,
        interval=(value - 1.96 * std, value + 1.96 * std) if known and std > 0 else None,
        unit=PARAMETERS[name].unit,
        verdict="given" if known else "not-identified",
        reason=None if known else "everything scales with the mass",
        advice=None if known else "weigh the vehicle as it flies, battery included",
        interval_terms=(tolerance,) if known and std > 0 else (),
    )


def joint_parameters(fit: Fit) -> list[Parameter]:
    """Judge every parameter of a joint fit, in the order of the table."""
    judged = judged_numbers(fit)
    entries = [c.entry for c in fit.dataset.configurations]
    parameters = [
        _tabulate_parameter(name, fit.numbers, judged, entries)
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
    judged = _judge_numbers(fit.numbers, fit.configurations)
    return judged | {
        name: judgement
        for name, judgement in assumed_rotors(fit.estimate, fit.configurations).items()
        if judged[name].verdict != "not-identified"
    }


def _is_parameter(name: str) -> bool:
    return name.partition("@")[0] in PARAMETERS


def _judge_numbers(
    numbers: Numbers, configurations: Sequence[JointConfiguration]
) -> dict[str, Judgement]:
    """Judge every number; an unknown scale with a good ratio is ``ratio-only``."""
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
                reason=little_excited("roll and pitch", numbers.judged.link(owner)),
            )
    return judged


def _tabulate_parameter(
    name: str,
    numbers: Numbers,
    judged: Mapping[str, Judgement],
    entries: Sequence[ConfigurationEntry],
) -> Parameter:
    base, _, owner = name.partition("@")
    entry = next((e for e in entries if e.name == owner), entries[0])
    shown = number_parameter(name, numbers, judged[name], owner=owner or None, entry=entry)
    ratio = None if shown.value is not None else _find_ratio_partner(base, owner, entries, judged)
    if ratio is None:
        return shown
    return replace(
        shown,
        verdict="ratio-only",
        partner=ratio,
        reason=f"this flight gives it only together with {ratio}",
        advice=ADVICE["yaw"],
        asks="flight",
    )


def _find_ratio_partner(
    base: str,
    owner: str,
    entries: Sequence[ConfigurationEntry],
    judged: Mapping[str, Judgement],
) -> str | None:
    """Return the partner with which a number of unknown scale is known as a ratio."""
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
    """Judge the rotors' coefficients that the flights do not identify, by name."""
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
    judgement = _judge_coefficients(len(spread), grouped=grouped)
    return {f"kt_{i}": judgement for i, share in enumerate(left, start=1) if share > MOSTLY_ASSUMED}


def _own_variance(
    spread: Sequence[str], names: Sequence[str], covariance: Float[np.ndarray, "s s"]
) -> Float[np.ndarray, " N"]:
    """Compute the variance of each rotor's coefficient over the mean one."""
    own = np.array([[float(name == mine) for name in names] for mine in spread])
    own -= own.mean(axis=0)
    return np.einsum("is,st,it->i", own, covariance, own)


def _judge_coefficients(rotors: int, *, grouped: bool) -> Judgement:
    """Explain why the flights do not identify the coefficients, and advise."""
    if grouped:
        reason = "the mixer moves these groups of rotors together"
        advice = "measure thrust on a stand, or choose other groups: the rotors of one spin, say"
    elif rotors > 4:
        reason = "the mixer moves these rotors together"
        advice = 'give the rotors that are alike the same group (group = "..." in [airframe])'
    else:
        # Kept: with the CoM they make the trim of hover, and one without the other is none.
        reason = "these flights hardly show how a rotor differs from the average one"
        advice = "roll, pitch and yaw more briskly"
        return Judgement(verdict="weak", reason=reason, advice=advice, asks="other")
    return Judgement(verdict="not-identified", reason=reason, advice=advice, asks="other")
