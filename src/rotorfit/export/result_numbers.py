"""Every number that an export may need, from the flights or assumed; and why another is missing.

Here alone are undone: units per kilogram (mass unknown), units per command (no law from command to
rotor speed), parameters at the origin where a result has none about the CoM, and parameters known
only as a ratio of which the user has the other half.
"""

from __future__ import annotations

import math
from dataclasses import replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.checks.verdicts.judge import body_verdict, is_width, relative_width, twin_of
from rotorfit.digits import with_interval
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import (
    COM,
    DERIVED,
    EVERY,
    FIRST_MOMENTS,
    INERTIA,
    INERTIA_COM,
    PARAMETERS,
    effective_unit,
    inertia_about,
)
from rotorfit.model.terms.rotors import MOST_ROTORS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from rotorfit.results.result import Derived, IdentificationResult, Parameter

Origin = Literal[
    "identified", "weak", "doubtful", "given", "removed", "assumed", "from-ratio", "law"
]

FULL_COMMAND: Final = "of full command"
ROTOR_KT: Final = tuple(f"kt_{i}" for i in range(1, MOST_ROTORS + 1))
REPLACED: Final = {"kt": ROTOR_KT, "motor_lag": ("motor_lag_up", "motor_lag_down")}
"""Numbers of single rotors or directions that an assumed number replaces."""
RATIOS: Final = {"kd": "kd_over_Izz", "Jr": "Jr_over_Izz"}
"""Ratios that the yaw equation gives even where the number alone is lost."""
DOUBTFUL: Final[tuple[Origin, ...]] = ("weak", "doubtful", "removed", "assumed", "from-ratio")
MAY_BE_REMOVED: Final = (*COM, *INERTIA_COM[3:], "Jr")
"""Parameters that are zero where the paper's method took them out; of the others, zero is wrong."""
POSITIVE: Final = (
    *("mass", "kt", "kd", "max_speed", *ROTOR_KT),
    *("Ixx", "Iyy", "Izz", "Ixx_com", "Iyy_com", "Izz_com"),
)
NOT_NEGATIVE: Final = ("Jr", "motor_lag", "motor_lag_up", "motor_lag_down")
MAY_BE_ASSUMED: Final = (
    *POSITIVE,
    *NOT_NEGATIVE,
    *("com_x", "com_y", "com_z", "rotor_center_x", "rotor_center_y"),
    *(name for name in (*INERTIA, *INERTIA_COM) if name not in POSITIVE),
)


@frozen_dataclass
class Number:
    """One number as it is exported.

    - `value`, `interval`: SI; the interval is 95 %, None if there is none.
    - `origin`: ``identified`` or ``weak`` from the flights, ``given`` in the experiment,
      ``removed`` from the model (zero), ``assumed`` by the user, ``from-ratio`` to an assumed
      number, ``law`` of the motors.
    - `remark`: why it is weak, or from what it was made.
    """

    name: str
    value: float
    unit: str
    origin: Origin
    interval: tuple[float, float] | None = None
    remark: str | None = None


@frozen_dataclass
class Missing:
    """A number that the flights do not give; `cure`: another one that would have to be assumed."""

    name: str
    verdict: str
    reason: str
    cure: str | None = None


def numbers_of(
    result: IdentificationResult,
    configuration: str,
    *,
    assumed: Mapping[str, float],
    full_speed: Number | None,
) -> dict[str, Number | Missing]:
    """Collect the numbers of a configuration by name [SI]; assumed values replace estimates.

    `full_speed` is the rotor speed at full command, from the law of the motors; its unit is rad/s,
    or `FULL_COMMAND` where only thrust at full command matters: numbers per command then stay so.
    """
    found: dict[str, Number | Missing] = {
        p.name: _of_parameter(p)
        for p in result.parameters
        if p.configuration in (None, configuration)
    }
    found |= _about_com(result, configuration, found)
    found |= {
        d.name: _of_derived(d, "")
        for d in result.derived
        if d.name in RATIOS.values() and d.configuration == configuration
    }
    if full_speed is not None:
        found["max_speed"] = full_speed
    for name, parts in REPLACED.items():
        if name in assumed:
            found = {key: number for key, number in found.items() if key not in parts}
    found |= {
        name: Number(name=name, value=value, unit=unit_of(name), origin="assumed")
        for name, value in assumed.items()
    }
    found = {name: _in_si(number, found, result) for name, number in found.items()}
    return _with_ratios(_with_assumed_origin(found, assumed))


def air_of(
    result: IdentificationResult,
    owner: str,
    names: Iterable[str],
    *,
    found: Mapping[str, Number | Missing],
) -> dict[str, float]:
    """Return coefficients of the air in a file's units, those whose whole interval is above zero.

    `found`: the other numbers of the file, with mass and speed at full command.
    """
    asked, values = set(names), dict[str, float]()
    for p in result.parameters:
        if p.name not in asked or p.configuration not in (None, owner):
            continue
        number = _of_parameter(p)
        number = _in_si(number, found, result)
        if isinstance(number, Number) and number.interval is not None and number.interval[0] > 0.0:
            values[p.name] = number.value
    return values


def unit_of(name: str) -> str:
    """Return the SI unit of a number by its name."""
    return "rad/s" if name == "max_speed" else (PARAMETERS | DERIVED)[name].unit


def parse_assumptions(assignments: Sequence[str]) -> dict[str, float]:
    """Parse assumed numbers such as ``kd=3.7e-9`` [SI]; ValueError names the wrong one."""
    assumed: dict[str, float] = {}
    for assignment in assignments:
        name, sign, text = (part.strip() for part in assignment.partition("="))
        if not sign:
            raise ValueError(
                f"{assignment!r} is no assumption; write NAME=VALUE, such as kd=3.7e-9"
            )
        if name not in MAY_BE_ASSUMED:
            near = get_close_matches(name, MAY_BE_ASSUMED, n=1)
            names = ", ".join(n for n in MAY_BE_ASSUMED if not n.startswith("kt_"))
            hint = f"did you mean {near[0]}?" if near else f"known: {names}"
            raise ValueError(f"nothing named {name!r} can be assumed; {hint}")
        if name in assumed:
            raise ValueError(f"{name} is assumed twice")
        assumed[name] = _parse_physical(name, text)
    return assumed


def _parse_physical(name: str, text: str) -> float:
    """Parse a value; refuse one that is physically impossible."""
    try:
        value = float(text)
    except ValueError as error:
        raise ValueError(f"{name}={text}: {text!r} is no number [{unit_of(name)}]") from error
    if not math.isfinite(value):
        raise ValueError(f"{name}={text} is not finite [{unit_of(name)}]")
    if name in POSITIVE and value <= 0.0:
        raise ValueError(f"{name}={text} cannot be: it is above 0 [{unit_of(name)}]")
    if name in NOT_NEGATIVE and value < 0.0:
        raise ValueError(f"{name}={text} cannot be: it is 0 or more [{unit_of(name)}]")
    return value


def number_warnings(numbers: Iterable[Number]) -> list[str]:
    """List the numbers that are not simply identified, and why; those of one reason together."""
    groups: dict[tuple[str, str], list[str]] = {}
    for n in numbers:
        if n.origin in DOUBTFUL:
            shown = f"{n.name} = {_with_margin(n)} {n.unit}"
            groups.setdefault((n.origin, n.remark or ""), []).append(shown)
    return [
        f"{', '.join(shown)} {'is' if len(shown) == 1 else 'are'} {origin}"
        + (f": {reason}" if reason else "")
        for (origin, reason), shown in groups.items()
    ]


def _with_margin(number: Number) -> str:
    """Write a number with half of its interval; an assumed one with the user's digits."""
    if number.interval is None:
        return f"{number.value:.{6 if number.origin == 'assumed' else 4}g}"
    return with_interval(number.value, number.interval)


def _of_parameter(p: Parameter) -> Number | Missing:
    if p.verdict == "removed" and (
        p.name in MAY_BE_REMOVED or p.name in (*FIRST_MOMENTS, *INERTIA)
    ):
        return Number(
            name=p.name, value=0.0, unit=p.unit, origin="removed", remark="unessential: left out"
        )
    if p.value is None or p.verdict in ("ratio-only", "not-identified", "removed"):
        return Missing(name=p.name, verdict=p.verdict, reason=_explain_absence(p))
    origin: Origin = p.verdict
    return Number(
        name=p.name,
        value=p.value,
        unit=p.unit,
        origin=origin,
        interval=p.interval,
        remark=_number_remark(p) if origin in ("weak", "doubtful") else None,
    )


def _number_remark(p: Parameter) -> str | None:
    """Explain why a number is weak or doubtful, where its interval does not."""
    return None if p.interval is not None and is_width(p.reason) else p.reason


def _explain_absence(p: Parameter) -> str:
    if p.verdict == "ratio-only":
        return f"known only together with {p.partner}"
    if p.verdict == "removed":
        return "the method took it out of the model"
    return p.reason or "these flights do not show it"


def _of_derived(d: Derived, why: str) -> Number | Missing:
    if d.value is None:
        return Missing(name=d.name, verdict="not-identified", reason=why)
    return Number(name=d.name, value=d.value, unit=d.unit, origin="identified", interval=d.interval)


def _about_com(
    result: IdentificationResult, configuration: str, parameters: Mapping[str, Number | Missing]
) -> dict[str, Number | Missing]:
    """Collect the CoM and the inertia about it, derived by the estimate where it did so."""
    derived = {d.name: d for d in result.derived if d.configuration == configuration}
    twins = {p.name: p for p in result.parameters if p.configuration == configuration}
    out: dict[str, Number | Missing] = {}
    for name in (*COM, *INERTIA_COM):
        twin = parameters.get(twin_of(name))
        if name in derived and not (isinstance(twin, Number) and twin.origin == "removed"):
            why = twin.reason if isinstance(twin, Missing) else "these flights do not show it"
            number = _of_derived(derived[name], why)
            if isinstance(number, Missing) and isinstance(twin, Missing):
                number = replace(number, verdict=twin.verdict)
            out[name] = _mark_twin(number, derived[name], twins.get(twin_of(name)), derived)
        else:
            out[name] = _compute_about_com(name, parameters)
    return out


def _mark_twin(
    number: Number | Missing, of: Derived, twin: Parameter | None, kin: Mapping[str, Derived]
) -> Number | Missing:
    """Mark a number about the CoM as weak or doubtful where the report has it so."""
    if isinstance(number, Missing):
        return number
    verdict = body_verdict(of, twin, kin)
    if verdict == "doubtful":
        return replace(number, origin=verdict, remark=None if twin is None else twin.reason)
    if verdict != "weak":
        return number
    if twin is None or relative_width(of, kin) is not None:
        return replace(number, origin="weak", remark=None)
    return replace(number, origin="weak", remark=_number_remark(twin))


def _compute_about_com(name: str, parameters: Mapping[str, Number | Missing]) -> Number | Missing:
    """Compute a number about the CoM from parameters at the origin: c = ms/m, Steiner."""
    mass = parameters.get("mass")
    m = mass.value if isinstance(mass, Number) else 1.0
    needed = FIRST_MOMENTS if name not in COM else (twin_of(name),)
    if name not in COM:
        needed = (*needed, twin_of(name))
    parts = {part: parameters.get(part) for part in needed}
    for part, value in parts.items():
        if not isinstance(value, Number):
            reason = value.reason if isinstance(value, Missing) else "the result does not have it"
            verdict = value.verdict if isinstance(value, Missing) else "not-identified"
            return Missing(name=name, verdict=verdict, reason=f"{part}: {reason}")
    known = {part: value for part, value in parts.items() if isinstance(value, Number)}
    twin = known[twin_of(name)]
    if name in COM:
        value = twin.value / m
    else:
        ms = np.array([known[moment].value for moment in FIRST_MOMENTS])
        steiner = inertia_about(np.zeros(6), m, ms / m)
        value = twin.value - float(steiner[INERTIA.index(twin_of(name))])
    weak = next((part for part in known.values() if part.origin in ("weak", "doubtful")), None)
    info = DERIVED[name]
    return Number(
        name=name,
        value=value,
        unit=f"{info.unit} per kg"
        if info.mass_power and twin.unit.endswith(" per kg")
        else info.unit,
        origin=weak.origin if weak is not None and twin.origin != "removed" else twin.origin,
        remark=weak.remark if weak is not None else f"from {twin_of(name)} at the origin",
    )


def _in_si(
    number: Number | Missing, found: Mapping[str, Number | Missing], result: IdentificationResult
) -> Number | Missing:
    """Convert a number from units per kilogram and per command, missing where that cannot be."""
    if isinstance(number, Missing) or number.origin == "assumed":
        return number
    factor = 1.0
    unit = number.unit
    if unit.endswith(" per kg"):
        mass = found.get("mass")
        if not isinstance(mass, Number):
            return Missing(
                name=number.name,
                verdict="known only per kilogram",
                reason="the mass is unknown",
                cure="mass",
            )
        factor *= mass.value
        unit = unit.removesuffix(" per kg")
    if _in_commands(number.name, unit):
        speed = found.get("max_speed")
        if not isinstance(speed, Number):
            return Missing(
                name=number.name,
                verdict="known only per command",
                reason="no law from command to rotor speed is given; supply the speed at full "
                "command if speed is proportional to the command",
                cure="max_speed",
            )
        if speed.unit != FULL_COMMAND:
            factor /= speed.value ** EVERY[number.name].speed_power
            unit = _physical_unit(number.name)
    if unit == number.unit:
        return number
    ends = number.interval
    return replace(
        number,
        value=factor * number.value,
        unit=unit,
        interval=None if ends is None else (factor * ends[0], factor * ends[1]),
    )


def _physical_unit(name: str) -> str:
    return DERIVED[name].unit if name in RATIOS.values() else unit_of(name)


def _in_commands(name: str, unit: str) -> bool:
    """Test whether a unit is per command (0 to 1) instead of per rad/s."""
    physical = _physical_unit(name)
    effective = effective_unit(name, physical)
    return effective != physical and unit == effective


def _with_assumed_origin(
    found: Mapping[str, Number | Missing], assumed: Mapping[str, float]
) -> dict[str, Number | Missing]:
    """Add the inertia about the CoM from an inertia assumed at the origin."""
    out = dict(found)
    com, mass = [found.get(name) for name in COM], found.get("mass")
    for i, name in enumerate(INERTIA):
        if name not in assumed or f"{name}_com" in assumed:
            continue
        known = [c.value for c in com if isinstance(c, Number)]
        if len(known) < 3 or not isinstance(mass, Number):
            continue
        steiner = inertia_about(np.zeros(6), mass.value, np.array(known))
        out[f"{name}_com"] = Number(
            name=f"{name}_com",
            value=assumed[name] - float(steiner[i]),
            unit=PARAMETERS[name].unit,
            origin="assumed",
            remark=f"from {name} at the origin",
        )
    return out


def _with_ratios(found: Mapping[str, Number | Missing]) -> dict[str, Number | Missing]:
    """Add the other half of a known ratio to Izz, one half being assumed."""
    out = dict(found)
    for name, ratio in RATIOS.items():
        number, share, Izz = (out.get(key) for key in (name, ratio, "Izz_com"))
        if not isinstance(share, Number):
            continue
        if (
            not isinstance(number, Number)
            and isinstance(Izz, Number)
            and Izz.origin != "identified"
        ):
            out[name] = _half_of_ratio(
                name, share.value * Izz.value, f"{ratio} times Izz_com, {Izz.origin}"
            )
        if name == "kd" and isinstance(number, Number) and not isinstance(Izz, Number):
            remark = f"kd, {number.origin}, over {ratio}"
            out["Izz_com"] = _half_of_ratio("Izz_com", number.value / share.value, remark)
    return out


def _half_of_ratio(name: str, value: float, remark: str) -> Number:
    return Number(name=name, value=value, unit=unit_of(name), origin="from-ratio", remark=remark)
