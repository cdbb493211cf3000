"""The tables of a result from the joint estimate: verdicts on every number."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorfit.estimation.banded import BandedEstimate
from rotorfit.experiment.experiment import ConfigurationEntry, MotorsEntry
from rotorfit.fit.excitation import HEIGHTS, LEAST_EXCITATION
from rotorfit.fit.frequency_bands import STRETCH
from rotorfit.fit.joint_equations import BIAS_STD, JointConfiguration
from rotorfit.fit.joint_numbers import (
    SHARED_NUMBERS,
    Numbers,
    number_scale,
)
from rotorfit.fit.motor_timing import MotorTiming
from rotorfit.fit.row_fits import ROTOR_SPREAD_STD
from rotorfit.model.parameters import DERIVED, PARAMETERS
from rotorfit.results.parameter_tables import (
    ORIGIN_IS_IMU,
    RATIOS,
    ROW_ORDER,
    Tables,
    given_parameter,
    motor_parameters,
    unit_of,
)
from rotorfit.results.result import Derived, Parameter
from rotorfit.results.rotor_spread import assumed_rotors
from rotorfit.results.verdicts import ADVICE, Judgement, judge, motion_for


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
        f"{p.name}@{p.configuration}" if p.configuration else p.name
        for p in parameters
        if p.value is not None
    ]
    known = [name for name in known if name in numbers.names]
    index = [numbers.index(name) for name in known]
    std = numbers.half_width[index] / 1.96
    return Tables(
        parameters=tuple(parameters),
        derived=tuple(_derived_numbers(numbers, judged, entries)),
        covariance_names=tuple(known),
        covariance=numbers.correlation[np.ix_(index, index)] * np.outer(std, std),
        settings={
            "noise": "variances of the six accelerations, per phase and band",
            "band": "0 to 30 Hz",
            "stretch": f"{STRETCH:g} s",
            "rotor_spread_prior": ROTOR_SPREAD_STD,
            "accel_bias_prior": list(BIAS_STD.values()),
        },
        warnings=_warnings(numbers, configurations),
        diagnostics={
            "condition": fit.estimate.condition_number,
            "log_likelihood": fit.log_likelihood,
            "iterations": float(fit.iterations),
            **{f"excitation_{key}": value for key, value in numbers.excitation.items()},
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
    judged: dict[str, Judgement] = {}
    for name, value, half in zip(
        numbers.names, numbers.values.tolist(), numbers.half_width.tolist(), strict=True
    ):
        base, _, owner = name.partition("@")
        mass = masses[owner] if owner else max(masses.values())
        judged[name] = judge(
            value,
            half,
            scale=number_scale(numbers, name, mass=mass, vehicle=vehicle),
            axis=motion_for(base),
            excitation=numbers.rho(name),
        )
        if base in HEIGHTS and not np.isfinite(half):
            judged[name] = replace(
                judged[name],
                reason=f"roll and pitch respond to the rotors at most {numbers.link(owner):.1f} "
                f"times what they do not explain (at least {LEAST_EXCITATION:.0f} is needed)",
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
    judgement = judged[name]
    shown = Parameter(
        name=base,
        configuration=owner or None,
        value=None,
        std=None,
        interval=None,
        unit=unit_of(PARAMETERS[base], entry),
        verdict=judgement.verdict,
        reason=judgement.reason,
        advice=judgement.advice,
    )
    if judgement.verdict != "not-identified":
        value, half = _value(numbers, name)
        return replace(shown, value=value, std=half / 1.96, interval=(value - half, value + half))
    ratio = _ratio(base, owner, entries, judged)
    if ratio is None:
        return shown
    return replace(
        shown,
        verdict="ratio-only",
        partner=ratio,
        reason=f"this flight gives it only together with {ratio}",
        advice=ADVICE["yaw"],
    )


def _value(numbers: Numbers, name: str) -> tuple[float, float]:
    i = numbers.index(name)
    return float(numbers.values[i]), float(numbers.half_width[i])


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
    rows: list[Derived] = []
    for entry in (None, *entries):
        for name, info in DERIVED.items():
            if (name in SHARED_NUMBERS) != (entry is None):
                continue
            full = name if entry is None else f"{name}@{entry.name}"
            known = full in numbers.names and judged[full].verdict != "not-identified"
            value, half = _value(numbers, full) if known else (0.0, 0.0)
            rows.append(
                Derived(
                    name=name,
                    configuration=None if entry is None else entry.name,
                    value=value if known else None,
                    std=half / 1.96 if known else None,
                    interval=(value - half, value + half) if known else None,
                    unit=unit_of(info, entry or entries[0]),
                )
            )
    return rows


def _warnings(numbers: Numbers, configurations: Sequence[JointConfiguration]) -> tuple[str, ...]:
    doubts: list[str] = []
    several = len(configurations) > 1
    for key, rho in numbers.excitation.items():
        axis, _, owner = key.partition("@")
        if LEAST_EXCITATION <= rho < 2.0 * LEAST_EXCITATION:
            where = f" in configuration {owner}" if several else ""
            doubts.append(
                f"{axis}{where}: the rotors explain only {rho:.1f} times what they do not; "
                f"{ADVICE[axis]}"
            )
    if configurations[0].vehicle.imu_position is None:
        doubts.append(ORIGIN_IS_IMU)
    return tuple(doubts)
