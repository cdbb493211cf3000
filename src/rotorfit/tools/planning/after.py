"""The information of an earlier result, and the manoeuvre that adds most to it."""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite, isinf
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.verdicts.judge import (
    ADVISED,
    FLOWN,
    WEAK,
    Asks,
    body_advice,
    body_asks,
    body_verdict,
    judge,
    motion_for,
    twin_of,
)
from rotorfit.digits import short
from rotorfit.errors import ExperimentError
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.fit.experiment.experiment import experiment_of_settings
from rotorfit.fit.experiment.payload import MOMENTS
from rotorfit.fit.intervals.allowances import number_scale
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import COM, INERTIA_COM, NUISANCE
from rotorfit.results.budget import BudgetLine, budget_lines
from rotorfit.results.result import (
    Derived,
    IdentificationResult,
    Parameter,
    Verdict,
    configuration_names,
    verdict_of,
)
from rotorfit.tools.planning.bound import BARE, Evidence, Problem, combined, predicted
from rotorfit.tools.planning.wanted import IN_MM, WANTABLE

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float

    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.model.vehicle import Vehicle
    from rotorfit.simulation.pilot import Manoeuvre

SAME_PLACE: Final = 1e-3
"""Rotors nearer than this are equal [m]."""
SAME_MASS: Final = 0.02
"""Masses of one configuration differ by less than this share."""
PRACTICE_SECONDS: Final = 20.0
"""How long a manoeuvre is flown for a missing number [s]."""
PRACTICE: Final[tuple[Manoeuvre, ...]] = (
    *("climb", "roll", "pitch", "yaw"),
    *("sticks", "doublets", "wiggles", "turns"),
)
"""Simple manoeuvres first: of equally good ones, the first is named."""
AS_GOOD: Final = 1.1
"""A manoeuvre this close to the best one is as good."""
UNAIDED: Final = (
    f"fly one manoeuvre for longer than {PRACTICE_SECONDS:.0f} s, or fly with a payload"
)
"""What is said to do for a number that no manoeuvre helps."""
UNAIDED_BEFORE: Final = "no manoeuvre of 20 s is enough for it: fly longer, or with a payload"
"""As older results have it, which do not say what their advice asks for."""
UNSETTLED: Final = "first settle why it is doubtful: the result says it"
"""What is said to do for a number that is doubtful, and not for want of a flight."""
SHARED: Final = ("kt", "kd", "Jr")
RATIOS: Final = {"kd_over_Izz": "kd", "Jr_over_Izz": "Jr"}
UNFLOWN: Final = ("measure", "declare", "log", "repair")
"""Remedies that are no flight."""
LACKING: Final = ("doubtful", "weak", "ratio-only", "not-identified")


@frozen_dataclass
class Knowledge:
    """An earlier result in the terms of a plan.

    - `configuration`: of the result, for which the plan is.
    - `information`: about the plan's free parameters.
    - `half_widths`, `values`: by the names of `WANTABLE`, where the result has them.
    """

    result: IdentificationResult
    configuration: str
    information: Float[np.ndarray, "f f"]
    half_widths: Mapping[str, float]
    values: Mapping[str, float]

    def narrowed(self, numbers: Numbers) -> Numbers:
        """Limit half-widths to those that the result has already, scaled to the plan's values."""
        half = np.full(len(numbers.names), np.inf)
        for name, known in self.half_widths.items():
            i, value = numbers.index(WANTABLE[name]), self.values[name]
            scale = 1.0 if name in IN_MM or value == 0 else abs(float(numbers.values[i]) / value)
            half[i] = known * scale
        return numbers.limited_to(half, source="the earlier result")


@frozen_dataclass
class Missing:
    """A number that the earlier result lacks.

    - `name`, `full_name`, `verdict`: as in the result; those of a body about its CoM, of the plan's
      configuration.
    - `now`: half of its interval over the value (or its scale); None if it has none to trust.
    - `manoeuvre`: which of the plan helps most; None if none helps.
    - `relative`, `predicted`: the same as `now` after 20 s of it, never more, and the verdict then.
    - `after`: the same after 20 s of each manoeuvre.
    - `size`: its value, or the size below which its error does not matter.
    - `advice`: what to do.
    """

    name: str
    full_name: str
    verdict: Verdict
    now: float | None
    manoeuvre: Manoeuvre | None
    relative: float
    predicted: Verdict
    after: Mapping[Manoeuvre, float]
    size: float
    advice: str

    @property
    def gain(self) -> str:
        """How far the manoeuvre sharpens it, such as ``from +-18 to +-6 %``."""
        now = None if self.now is None else self.shown(self.now)
        return gain_phrase(self.name, now, self.shown(self.relative))

    def shown(self, relative: float) -> float:
        """Convert a half-width over the size to what is shown: for a centre of mass in metres."""
        return relative * self.size if self.name in COM else relative

    def sharper(self, manoeuvre: Manoeuvre) -> float:
        """Compute how many times narrower a manoeuvre makes it; from all of it, where unknown."""
        return min(1.0 if self.now is None else self.now, 1.0) / self.after[manoeuvre]

    def is_helped_by(self, manoeuvre: Manoeuvre) -> bool:
        """Test whether a manoeuvre gives the number, or makes it clearly narrower."""
        return self.manoeuvre is not None and self.sharper(manoeuvre) > AS_GOOD


def gain_phrase(name: str, now: float | None, after: float) -> str:
    """Write how far an interval shrinks: half-widths over the value, of a centre of mass in metres.

    `now` is None where the number is unknown.
    """
    factor, unit = (1e3, "mm") if name in COM else (100.0, "%")
    before = "unknown" if now is None else f"+-{short(factor * now)}"
    return f"from {before} to +-{short(factor * after)} {unit}"


def check_same_vehicle(result: IdentificationResult, vehicle: Vehicle) -> None:
    """Raise `ExperimentError` where number, places or spins of a result's rotors differ."""
    flown = vehicle_of(experiment_of_settings(result.settings).airframe)
    if len(flown.rotors) != len(vehicle.rotors):
        raise ExperimentError(
            f"the result is of {len(flown.rotors)} rotors, the airframe has "
            f"{len(vehicle.rotors)}: give the airframe file of that vehicle"
        )
    distance = np.abs(flown.positions - vehicle.positions).max()
    if distance > SAME_PLACE or (flown.spins != vehicle.spins).any():
        raise ExperimentError(
            f"the result is of another airframe: a rotor is {1e3 * distance:.0f} mm elsewhere or "
            "turns the other way; give the airframe file that it was identified with"
        )


def result_mass(result: IdentificationResult, mass: float | None) -> tuple[str, float]:
    """Select the configuration of a result by the weighed mass, None: the first; return both [kg].

    Raises `ExperimentError` where the result has no such mass.
    """
    weighed = _weighed_masses(result)
    if not weighed:
        raise ExperimentError(
            "the result was made without a mass, everything in it is per kilogram: identify the "
            "flight again with the weighed mass, then plan after that"
        )
    if mass is None:
        return next(iter(weighed.items()))
    for name, value in weighed.items():
        if abs(value - mass) <= SAME_MASS * mass:
            return name, mass
    listed = ", ".join(f"{value:g} kg" for value in weighed.values())
    raise ExperimentError(
        f"a mass of {mass:g} kg, but the result was flown with {listed}; plan for that mass, or "
        "leave --mass out"
    )


def scaled_mass(result: IdentificationResult) -> tuple[str, float | None]:
    """Return the first configuration of a result and its mass [kg], None: all is per kilogram."""
    weighed = _weighed_masses(result)
    return result_mass(result, None) if weighed else (configuration_names(result)[0], None)


def _weighed_masses(result: IdentificationResult) -> dict[str, float]:
    """Collect the masses of the configurations that were weighed [kg]."""
    return {
        p.configuration or "": p.value
        for p in result.parameters
        if p.name == "mass" and p.value is not None
    }


def values_of(result: IdentificationResult, vehicle: Vehicle) -> dict[str, float]:
    """Return the rough values of a result, by the names that a plan takes; SI or per kilogram.

    Raises `ExperimentError` where the result is of another vehicle.
    """
    check_same_vehicle(result, vehicle)
    configuration, _ = scaled_mass(result)
    entries = {name: _find_entry(result, source, configuration) for name, source in _ROUGH.items()}
    values = {name: None if e is None else e.value for name, e in entries.items()}
    speed = result.derived_value("hover_speed", configuration).unit
    if speed != "rad/s":  # of a command without a law: no speed at all
        values |= {"hover_speed": None, "Jr": None}
    return {name: value for name, value in values.items() if value is not None and value > 0}


_ROUGH: Final = {
    **{name: f"{name}_com" for name in ("Ixx", "Iyy", "Izz")},
    **{name: name for name in ("hover_speed", "kd_over_kt", "Jr", "motor_lag")},
}


def knowledge_of(result: IdentificationResult, problem: Problem) -> Knowledge:
    """Convert a result to information about a plan's free parameters."""
    configuration, mass = scaled_mass(result)
    # A result per kilogram goes with a plan for one kilogram.
    if mass is not None:
        configuration, _ = result_mass(result, problem.configurations[0].mass)
    halves: dict[str, float] = {}
    values: dict[str, float] = {}
    for name, full in WANTABLE.items():
        entry = _trusted_entry(result, full.partition("@")[0], configuration)
        if entry is not None and entry.value is not None and entry.std is not None:
            halves[name], values[name] = 1.96 * entry.std, entry.value
    return Knowledge(
        result=result,
        configuration=configuration,
        information=_result_information(result, configuration, problem),
        half_widths=halves,
        values=values,
    )


def practised(
    problem: Problem, pieces: Mapping[Manoeuvre, Evidence], known: Knowledge
) -> dict[Manoeuvre, Numbers]:
    """Predict the numbers after `PRACTICE_SECONDS` of each manoeuvre, with the earlier result."""
    return {
        manoeuvre: predicted(problem, combined([(piece, PRACTICE_SECONDS)]), known.information)
        for manoeuvre, piece in pieces.items()
    }


def missing_numbers(
    problem: Problem, pieces: Mapping[Manoeuvre, Evidence], known: Knowledge
) -> tuple[Missing, ...]:
    """List what a result lacks, and which of the manoeuvres flown would help each most."""
    trials = practised(problem, pieces, known)
    names = next(iter(trials.values())).names
    return tuple(
        _predict_missing(number, problem, trials, known)
        for number in judged_numbers(known.result, known.configuration)
        if number.verdict in LACKING and number.name not in NUISANCE and number.full_name in names
    )


@frozen_dataclass
class JudgedNumber:
    """A number as reports have it: those of a body are about its CoM.

    `full_name`: in a plan; `parameter`: the full name in the result, by which findings go.
    `largest`: the largest contribution to its interval; None without an interval.
    `kept`: half of its interval by what no flight shrinks (a ruler, a law, a setting of the log),
    over half of all of it.
    """

    name: str
    full_name: str
    parameter: str
    verdict: Verdict
    advice: str | None
    asks: Asks | None
    largest: BudgetLine | None = None
    kept: float = 0.0

    @property
    def is_flyable(self) -> bool:
        """Test whether nothing but a manoeuvre is asked for; what is doubtful needs more."""
        if self.advice is None:
            return self.verdict != "doubtful"
        return self.asks in ("flight", "nothing")


def judged_numbers(result: IdentificationResult, owner: str) -> list[JudgedNumber]:
    """List the numbers of a configuration, each with the verdict that its report shows."""
    derived = {d.name: d for d in result.derived if d.configuration == owner}
    about = {twin_of(name): derived[name] for name in (*COM, *INERTIA_COM) if name in derived}
    found: list[JudgedNumber] = []
    for p in map(_known_asks, result.parameters):
        if p.configuration not in (None, owner):
            continue
        shown = about.get(p.name) if p.configuration else None
        verdict = p.verdict if shown is None else body_verdict(shown, p, derived)
        name = p.name if shown is None else shown.name
        lines = budget_lines(shown or p)
        found.append(
            JudgedNumber(
                name=name,
                full_name=name if p.configuration is None else f"{name}@{BARE}",
                parameter=p.full_name,
                verdict=verdict,
                advice=p.advice if shown is None else body_advice(name, verdict, p),
                asks=p.asks if shown is None else body_asks(name, verdict, p),
                largest=next(iter(lines), None),
                kept=sum(line.share for line in lines if line.remedy in UNFLOWN) ** 0.5,
            )
        )
    return found


def _known_asks(parameter: Parameter) -> Parameter:
    """Complete a parameter of an older result, which has the sentence of its advice alone."""
    if parameter.asks is not None or parameter.advice is None:
        return parameter
    if parameter.advice in (UNAIDED, UNAIDED_BEFORE):
        return replace(parameter, asks="nothing")
    return replace(parameter, asks="flight" if parameter.advice in FLOWN.values() else "other")


def _predict_missing(
    number: JudgedNumber, problem: Problem, trials: Mapping[Manoeuvre, Numbers], known: Knowledge
) -> Missing:
    """Predict a number after each manoeuvre; none that does not sharpen it is advised."""
    now, size = _current_width(number, problem, next(iter(trials.values())), known)
    kept = 0.0 if isinf(now) else now * number.kept
    relative: dict[Manoeuvre, float] = {
        m: min(max(n.number(number.full_name)[1] / size, kept), now) for m, n in trials.items()
    }
    manoeuvre = _helpful_manoeuvre(number, relative)
    after = relative[manoeuvre]
    verdict = judge(1.0, after, scale=0.0, axis="yaw").verdict
    flyable, helps = number.is_flyable, verdict != "not-identified" and after * AS_GOOD <= now
    chosen = manoeuvre if flyable and helps else None
    flown = unaided_advice(number) if chosen is None else FLOWN[chosen]
    return Missing(
        name=number.name,
        full_name=number.full_name,
        verdict=number.verdict,
        now=now if isfinite(now) else None,
        manoeuvre=chosen,
        relative=after,
        predicted=verdict,
        after=relative,
        size=size,
        advice=flown if flyable else number.advice or UNSETTLED,
    )


def unaided_advice(number: JudgedNumber) -> str:
    """State what to do where no manoeuvre helps: what shrinks the part that no flight does."""
    line = number.largest
    held = line is not None and line.remedy in UNFLOWN and number.kept**2 > 0.5
    return line.action if line is not None and held else UNAIDED


def _current_width(
    number: JudgedNumber, problem: Problem, numbers: Numbers, known: Knowledge
) -> tuple[float, float]:
    """Return half of a number's interval now over its size, infinite for none, and that size."""
    bare = problem.configurations[0]
    entry = _trusted_entry(known.result, number.name, known.configuration)
    found = 0.0 if entry is None or entry.value is None else entry.value
    half = inf if entry is None or entry.std is None else 1.96 * entry.std
    planned = abs(numbers.number(number.full_name)[0])
    if number.name in SHARED and found:
        # A result per command without a law has other units than the plan.
        found, half = planned, half * planned / abs(found)
    scale = number_scale(numbers, number.full_name, mass=bare.mass, vehicle=bare.vehicle)
    size = max(planned, abs(found), scale)
    return half / size, size


def _helpful_manoeuvre(number: JudgedNumber, relative: Mapping[Manoeuvre, float]) -> Manoeuvre:
    """Select the manoeuvre of the result's advice where it is good enough, else the best one."""
    least = min(relative.values())
    good: list[Manoeuvre] = [m for m, value in relative.items() if value <= AS_GOOD * least]
    advised = ADVISED.get(motion_for(number.name))
    if advised is not None and relative.get(advised, inf) <= max(WEAK, AS_GOOD * least):
        return advised
    return good[0]


def _result_information(
    result: IdentificationResult, configuration: str, problem: Problem
) -> Float[np.ndarray, "f f"]:
    """Convert a result's covariance and its yaw ratios to information."""
    names = problem.mapped.names
    total = np.zeros((len(names), len(names)))
    rows: list[int] = []
    places: list[int] = []
    untrusted = {p.full_name for p in result.parameters if p.verdict == "doubtful"}
    for row, name in enumerate(result.covariance_names):
        if name in untrusted:
            continue
        base, _, owner = name.partition("@")
        planned = base if base in SHARED else f"{base}@{BARE}"
        if (base in SHARED or (base in MOMENTS and owner == configuration)) and planned in names:
            rows.append(row)
            places.append(names.index(planned))
    if rows:
        size = np.array([_planned_over_found(result, names[p], problem) for p in places])
        covariance = result.covariance[np.ix_(rows, rows)] * np.outer(size, size)
        total[np.ix_(places, places)] += _invert_singular(covariance)
    return total + _ratio_information(result, configuration, problem)


def _planned_over_found(result: IdentificationResult, name: str, problem: Problem) -> float:
    """Return the plan's value of a rotor coefficient over the result's."""
    if name not in SHARED:
        return 1.0
    value = result.parameter(name).value
    planned = float(problem.phi[problem.mapped.names.index(name)])
    return planned / value if value else 1.0


def _ratio_information(
    result: IdentificationResult, configuration: str, problem: Problem
) -> Float[np.ndarray, "f f"]:
    """Compute the information of k_d / Izz and J_r / Izz where they are not known separately."""
    names, phi = problem.mapped.names, problem.phi
    total = np.zeros((len(names), len(names)))
    Izz = names.index(f"Izz@{BARE}")
    for ratio, numerator in RATIOS.items():
        found = _find_entry(result, ratio, configuration)
        alone = _find_entry(result, numerator, None)
        if found is None or not found.value or not found.std or alone is None or alone.value:
            continue
        row = np.zeros(len(names))
        row[names.index(numerator)] = 1.0 / phi[names.index(numerator)]
        row[Izz] = -1.0 / phi[Izz]
        total += np.outer(row, row) * (found.value / found.std) ** 2
    return total


def _invert_singular(covariance: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """Invert a covariance whose correlations may be all but singular."""
    s = np.sqrt(np.diagonal(covariance))
    strengths, vectors = np.linalg.eigh(covariance / np.outer(s, s))
    strengths = np.maximum(strengths, 1e-9)
    return (vectors / strengths) @ vectors.T / np.outer(s, s)


def _trusted_entry(
    result: IdentificationResult, name: str, configuration: str
) -> Parameter | Derived | None:
    """Return a number whose interval no finding disowns."""
    entry = _find_entry(result, name, configuration)
    return None if entry is None or verdict_of(result, entry) == "doubtful" else entry


def _find_entry(
    result: IdentificationResult, name: str, configuration: str | None
) -> Parameter | Derived | None:
    """Return a parameter or derived number of a configuration, or a shared one."""
    for entry in (*result.parameters, *result.derived):
        if entry.name == name and entry.configuration in (None, configuration):
            return entry
    return None
