"""Results in the units of commands where no law gives rotor speeds, and a pilot's numbers.

These are the throttle in hover, the thrust over the weight and of a motor, and how equally the
motors pull.
"""

from __future__ import annotations

from dataclasses import replace
from math import hypot, isfinite, sqrt
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.verdicts.judge import judge
from rotorfit.findings import doubt, note
from rotorfit.fit.intervals.interval_terms import NumberTerm, half_width_of_number, scale_terms
from rotorfit.fit.motors.commanded_speeds import hover_share
from rotorfit.flight.motors.motor_model import GRID, speeds
from rotorfit.logs.motor_law import MotorLaw, PowerCurve
from rotorfit.model.parameters import DERIVED, effective_unit
from rotorfit.results.law_tables import full_speed_term
from rotorfit.results.result import (
    Derived,
    Parameter,
    is_per_command,
    owners_of,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rotorfit.fit.dataset.dataset import Dataset
    from rotorfit.fit.experiment.experiment import MotorsEntry
    from rotorfit.results.tables import ResultTables


NO_LAW: Final = (
    "no law from command to rotor speed is given: speed is taken to be proportional to the command "
    "(0 to 1), so that kt and kd are thrust and drag torque of one rotor at full command, and Jr "
    "is per command; where that is not so, kt, inertia and CoM are wrong with it: give law under "
    "[motors], or log the rotor speed"
)
RELATIVE_LAW: Final = (
    "the motors' law has no speed in rad/s: kt and kd are thrust and drag torque of one rotor at "
    "full command, and Jr is per command; inertia and CoM do not depend on it"
)
NO_COMMANDS: Final = (
    "no rotor speed at full command: log the motor commands as well, or give law under [motors]"
)
NO_MASS: Final = "weigh the vehicle as it flies, battery included"
NO_KT: Final = "the flights do not give the thrust coefficients"

SURE_SHARE: Final = 0.1
"""To which share of itself the part of the law in a width is known."""
SEEN_IN_TRIM: Final = 0.1
"""Difference between motors that matters to a pilot, as a share of the mean one."""

Range = tuple[float, float]
"""A value with half of its 95 % interval as a share of it."""


def in_command_units(tables: ResultTables, dataset: Dataset) -> ResultTables:
    """Convert the tables to the units of commands, where no law makes speeds of them."""
    motors = dataset.motors
    if motors.speed == "measured" or not motors.law_is_relative or dataset.speeds_commanded:
        return tables
    relative = note("no-speed-law", RELATIVE_LAW)
    if motors.law is None:
        relative = doubt(
            "no-speed-law",
            NO_LAW,
            numbers=("thrust_to_weight", "max_thrust"),
            doubtful_because="thrust is taken to grow with the square of the command",
            next_step="log the rotor speed, or measure thrust over command and give law under "
            "[motors]",
        )
    return replace(
        tables,
        parameters=tuple(
            replace(p, unit=effective_unit(p.name, p.unit)) for p in tables.parameters
        ),
        derived=tuple(replace(d, unit=effective_unit(d.name, d.unit)) for d in tables.derived),
    ).found(relative)


def with_flight_numbers(tables: ResultTables, motors: MotorsEntry) -> ResultTables:
    """Add hover throttle, thrust over weight, largest thrust of a motor and their imbalance."""
    law = _select_law(tables, motors)
    full = None if law is None else _full_speed(tables, law, motors.law)
    bodies: list[Derived] = []
    for owner in owners_of(tables.parameters):
        hover = _hover_speed(tables, owner)
        terms = _terms_of(tables.derived, "hover_speed", owner)
        own = hover and _without_law(hover, motors.law)
        throttle = _hover_throttle(own, owner, law, full)
        ratio = _thrust_to_weight(hover, owner, full)
        bodies += [
            _with_terms(throttle, own, full, [t for t in terms if t.name != "motor law"]),
            _with_terms(ratio, hover, full, terms),
        ]
    thrust = _max_thrust(tables, full)
    kt = next((_relative_range(p) for p in tables.parameters if p.name == "kt"), None)
    doubled = full and (full[0], 2.0 * full[1])
    terms = _terms_of(tables.parameters, "kt", None)
    shared = (_with_terms(thrust, kt, doubled, terms), _motor_imbalance(tables))
    return replace(tables, derived=(*tables.derived, *shared, *bodies))


def _terms_of(
    numbers: Iterable[Parameter | Derived], name: str, owner: str | None
) -> tuple[NumberTerm, ...]:
    """Return the interval terms of a number of a result."""
    found = (n for n in numbers if (n.name, n.configuration) == (name, owner))
    return next((n.interval_terms for n in found), ())


def _with_terms(
    number: Derived, base: Range | None, full: Range | None, terms: Sequence[NumberTerm]
) -> Derived:
    """Add the interval terms of a number that is made of another one and of the full speed.

    `base`: the other number, whose interval terms, as far as they count here, are `terms`.
    """
    if number.std is None or base is None or full is None:
        return number
    own = half_width_of_number(terms)
    shares = scale_terms(terms, base[1] / own if own > 0.0 else 0.0)
    if full[1] > 0.0:
        shares = (*shares, full_speed_term(full[1]))
    whole = half_width_of_number(shares)
    factor = 1.96 * number.std / whole if whole > 0.0 else 0.0
    return replace(number, interval_terms=scale_terms(shares, factor))


def _select_law(tables: ResultTables, motors: MotorsEntry) -> MotorLaw | None:
    """Select the law from command to speed; the command itself where speeds are in commands."""
    found = tables.command_law
    if found is not None and found.known:
        return found.law
    if motors.law is not None:
        return motors.law
    proportional = MotorLaw(curve=PowerCurve(full_speed=1.0, offset=0.0, exponent=1.0))
    return proportional if is_per_command(tables.parameters) else None


def _full_speed(tables: ResultTables, law: MotorLaw, entry: MotorLaw | None) -> Range:
    """Return the speed at full command [rad/s, or 1 of relative speeds]."""
    fitted = next((p for p in tables.parameters if p.name == "max_speed"), None)
    full = law.full_speed
    by_slope = 0.0 if entry is None else 1.96 * hover_share(entry, full, 0.0)
    return (fitted and _relative_range(fitted)) or (full, by_slope)


def _relative_range(number: Parameter | Derived) -> Range | None:
    if number.value is None or not isfinite(number.value) or not number.value:
        return None
    low, high = number.interval or (number.value, number.value)
    return number.value, 0.5 * (high - low) / abs(number.value)


def _hover_speed(tables: ResultTables, owner: str) -> Range | None:
    hover = (d for d in tables.derived if (d.name, d.configuration) == ("hover_speed", owner))
    return next((_relative_range(d) for d in hover), None)


def _without_law(hover: Range, law: MotorLaw | None) -> Range:
    """Take the law's share out of the uncertainty of the speed in hover."""
    if law is None:
        return hover
    # The command in hover does not hang on the law: another speed there goes with the same command.
    by_law = 1.96 * hover_share(law, hover[0], law.speed_std)
    return hover[0], sqrt(max(hover[1] ** 2 - by_law**2, (SURE_SHARE * by_law) ** 2))


def _hover_throttle(
    hover: Range | None, owner: str, law: MotorLaw | None, full: Range | None
) -> Derived:
    """Return the command, 0 to 1, whose speed carries the weight."""
    if law is None or full is None or hover is None:
        return _unknown_number("hover_throttle", owner, NO_COMMANDS if hover else NO_KT)
    speed, share = hover[0], hypot(hover[1], full[1])
    # Where a law is flat its speeds do not give the command: np.interp takes the last.
    low, value, high = np.interp(
        [speed * (1.0 - share), speed, speed * (1.0 + share)], speeds(law, GRID), GRID
    ).tolist()
    return flight_number("hover_throttle", owner, value, max(high - value, value - low))


def _thrust_to_weight(hover: Range | None, owner: str, full: Range | None) -> Derived:
    """Return the thrust of all rotors at full command over the weight."""
    if full is None or hover is None:
        return _unknown_number("thrust_to_weight", owner, NO_COMMANDS if hover else NO_KT)
    value = (full[0] / hover[0]) ** 2
    return flight_number("thrust_to_weight", owner, value, 2.0 * hypot(full[1], hover[1]) * value)


def _max_thrust(tables: ResultTables, full: Range | None) -> Derived:
    """Return the thrust of the mean rotor at full command [N]."""
    parameter = next((p for p in tables.parameters if p.name == "kt"), None)
    kt = None if parameter is None else _relative_range(parameter)
    if parameter is None or kt is None or full is None:
        return _unknown_number("max_thrust", None, NO_COMMANDS if kt else NO_KT)
    if parameter.unit.endswith(" per kg"):
        return _unknown_number("max_thrust", None, NO_MASS)
    value = kt[0] * full[0] ** 2
    return flight_number("max_thrust", None, value, hypot(kt[1], 2.0 * full[1]) * value)


def _motor_imbalance(tables: ResultTables) -> Derived:
    """Return the largest thrust coefficient less the smallest, over the mean."""
    rotors = list(_rotor_values(tables))
    if len(rotors) < 2:
        reasons = [p.reason for p in tables.parameters if p.name.startswith("kt_") and p.reason]
        return _unknown_number("motor_imbalance", None, reasons[0] if reasons else NO_KT)
    mean = float(np.mean([value for _, value in rotors]))
    (strong, most), (weak, least) = (pick(rotors, key=lambda r: r[1]) for pick in (max, min))
    ends = [tables.covariance_names.index(name) for name in (strong, weak)]
    C = tables.covariance[np.ix_(ends, ends)]
    std = sqrt(max(float(C[0, 0] + C[1, 1] - 2.0 * C[0, 1]), 0.0)) / mean
    # Of equal motors chance alone makes the number larger than zero: half of the interval is that
    # of the difference, and one that reaches to zero says that none is seen.
    half = 1.96 * std
    found = flight_number("motor_imbalance", None, (most - least) / mean, half, scale=SEEN_IN_TRIM)
    source = "the thrust coefficients of two rotors together"
    term = NumberTerm(name="noise", half_width=half, source=source)
    return found if found.std is None else replace(found, interval_terms=(term,))


def _rotor_values(tables: ResultTables) -> Iterator[tuple[str, float]]:
    for p in tables.parameters:
        if p.name.startswith("kt_") and p.value and p.name in tables.covariance_names:
            yield p.name, p.value


def flight_number(
    name: str, owner: str | None, value: float, half: float, *, scale: float = 0.0
) -> Derived:
    """Return a derived number with half of its interval, judged by it."""
    judgement = judge(value, half, scale=scale, axis="force")
    if judgement.verdict == "not-identified":
        return _unknown_number(name, owner, judgement.reason or "")
    return Derived(
        name=name,
        configuration=owner,
        value=value,
        std=half / 1.96,
        interval=(max(value - half, 0.0), value + half),
        unit=DERIVED[name].unit,
        verdict=judgement.verdict,
        reason=judgement.reason,
    )


def _unknown_number(name: str, owner: str | None, why: str) -> Derived:
    return Derived(
        name=name,
        configuration=owner,
        value=None,
        std=None,
        interval=None,
        unit=DERIVED[name].unit,
        verdict="not-identified",
        reason=why,
    )
