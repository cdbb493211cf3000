"""What an earlier result knows already, and which manoeuvre would add what it lacks."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.errors import ExperimentError
from rotorfit.experiment.declared_vehicle import vehicle_of
from rotorfit.experiment.experiment import experiment_of_settings
from rotorfit.experiment.payload import MOMENTS
from rotorfit.fit.intervals.joint_numbers import number_scale
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.model.parameters import COM, INERTIA_COM, NUISANCE
from rotorfit.model.vehicle import Vehicle
from rotorfit.planning.bound import BARE, Evidence, Problem, combined, predicted
from rotorfit.planning.wanted import IN_MM, WANTABLE
from rotorfit.results.result import Derived, IdentificationResult, Parameter, Verdict
from rotorfit.results.verdicts import (
    ADVICE,
    ADVISED,
    FLOWN,
    WEAK,
    body_verdict,
    judge,
    motion_for,
    twin_of,
)
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
SHARED: Final = ("kt", "kd", "Jr")
RATIOS: Final = {"kd_over_Izz": "kd", "Jr_over_Izz": "Jr"}
LACKING: Final = ("weak", "ratio-only", "not-identified")


@dataclass(frozen=True, slots=True, kw_only=True)
class Knowledge:
    """An earlier result in the terms of a plan.

    Attributes
    ----------
    configuration
        Of the result, for which the plan is.
    information
        About the plan's free parameters.
    half_widths, values
        By the names of `WANTABLE`, where the result has them.
    """

    result: IdentificationResult
    configuration: str
    information: Float[np.ndarray, "f f"]
    half_widths: Mapping[str, float]
    values: Mapping[str, float]

    def narrowed(self, numbers: Numbers) -> Float[np.ndarray, " q"]:
        """Limit half-widths to those that the result has already, scaled to the plan's values."""
        half = numbers.half_width.copy()
        for name, known in self.half_widths.items():
            i, value = numbers.index(WANTABLE[name]), self.values[name]
            scale = 1.0 if name in IN_MM or value == 0 else abs(float(numbers.values[i]) / value)
            half[i] = min(half[i], known * scale)
        return half


@dataclass(frozen=True, slots=True, kw_only=True)
class Missing:
    """A number that the earlier result lacks.

    Attributes
    ----------
    name, verdict
        As in the result.
    manoeuvre
        Which of the plan helps most; None where none makes it better than weak.
    relative, predicted
        Half of the interval predicted after 20 s of it, over the value (or its scale), and the
        verdict then.
    advice
        What to do, as the result says it.
    """

    name: str
    verdict: Verdict
    manoeuvre: Manoeuvre | None
    relative: float
    predicted: Verdict
    advice: str


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
    weighed = {
        p.configuration or "": p.value
        for p in result.parameters
        if p.name == "mass" and p.value is not None
    }
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


def values_of(result: IdentificationResult, vehicle: Vehicle) -> dict[str, float]:
    """Return the rough values of a result, by the names that a plan takes.

    Raises `ExperimentError` where the result is of another vehicle.
    """
    check_same_vehicle(result, vehicle)
    configuration, _ = result_mass(result, None)
    entries = {name: _entry(result, source, configuration) for name, source in _ROUGH.items()}
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
    configuration, _ = result_mass(result, problem.configurations[0].mass)
    halves: dict[str, float] = {}
    values: dict[str, float] = {}
    for name, full in WANTABLE.items():
        entry = _entry(result, full.partition("@")[0], configuration)
        if entry is not None and entry.value is not None and entry.std is not None:
            halves[name], values[name] = 1.96 * entry.std, entry.value
    return Knowledge(
        result=result,
        configuration=configuration,
        information=_information(result, configuration, problem),
        half_widths=halves,
        values=values,
    )


def missing_numbers(
    problem: Problem, pieces: Mapping[tuple[Manoeuvre, str], Evidence], known: Knowledge
) -> tuple[Missing, ...]:
    """List what a result lacks, and which manoeuvre would help each most."""
    trials: dict[Manoeuvre, Numbers] = {
        manoeuvre: predicted(
            problem, combined([(pieces[manoeuvre, BARE], PRACTICE_SECONDS)]), known.information
        )
        for manoeuvre in PRACTICE
    }
    names = next(iter(trials.values())).names
    return tuple(
        _missing(number, problem, trials)
        for number in _judged(known)
        if number.verdict in LACKING and number.name not in NUISANCE and number.full_name in names
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Number:
    """A number as reports have it: those of a body are about its CoM."""

    name: str
    full_name: str
    verdict: Verdict
    advice: str | None


def _judged(known: Knowledge) -> list[_Number]:
    """List the numbers of a result, each with the verdict that its report shows."""
    result, owner = known.result, known.configuration
    derived = {d.name: d for d in result.derived if d.configuration == owner}
    about = {twin_of(name): derived[name] for name in (*COM, *INERTIA_COM) if name in derived}
    found: list[_Number] = []
    for p in result.parameters:
        if p.configuration not in (None, owner):
            continue
        shown = about.get(p.name) if p.configuration else None
        verdict = p.verdict if shown is None else body_verdict(shown, p, derived)
        name = p.name if shown is None else shown.name
        found.append(
            _Number(
                name=name,
                full_name=name if p.configuration is None else f"{name}@{BARE}",
                verdict=verdict,
                advice=p.advice if verdict == p.verdict else ADVICE[motion_for(name)],
            )
        )
    return found


def _missing(number: _Number, problem: Problem, trials: Mapping[Manoeuvre, Numbers]) -> Missing:
    bare = problem.configurations[0]
    relative: dict[Manoeuvre, float] = {}
    for manoeuvre, numbers in trials.items():
        value, half = numbers.number(number.full_name)
        scale = number_scale(numbers, number.full_name, mass=bare.mass, vehicle=bare.vehicle)
        relative[manoeuvre] = half / max(abs(value), scale)
    manoeuvre = _helpful(number, relative)
    verdict = judge(1.0, relative[manoeuvre], scale=0.0, axis="yaw").verdict
    given = number.advice
    if given is not None and given not in FLOWN.values():  # not for want of a manoeuvre
        chosen, advice = None, given
    elif verdict == "not-identified":
        chosen = None
        advice = f"{given or FLOWN[manoeuvre]}; that alone is not enough, see the plan"
    else:
        chosen, advice = manoeuvre, FLOWN[manoeuvre]
    return Missing(
        name=number.name,
        verdict=number.verdict,
        manoeuvre=chosen,
        relative=relative[manoeuvre],
        predicted=verdict,
        advice=advice,
    )


def _helpful(number: _Number, relative: Mapping[Manoeuvre, float]) -> Manoeuvre:
    """Select what the result advises where that is enough or as good as any, else the best."""
    least = min(relative.values())
    good: list[Manoeuvre] = [m for m, value in relative.items() if value <= AS_GOOD * least]
    advised = ADVISED.get(motion_for(number.name))
    enough = advised is not None and relative[advised] <= max(WEAK, AS_GOOD * least)
    return advised if advised is not None and enough else good[0]


def _information(
    result: IdentificationResult, configuration: str, problem: Problem
) -> Float[np.ndarray, "f f"]:
    """Convert a result's covariance and its yaw ratios to information."""
    names = problem.mapped.names
    total = np.zeros((len(names), len(names)))
    rows: list[int] = []
    places: list[int] = []
    for row, name in enumerate(result.covariance_names):
        base, _, owner = name.partition("@")
        planned = base if base in SHARED else f"{base}@{BARE}"
        if (base in SHARED or (base in MOMENTS and owner == configuration)) and planned in names:
            rows.append(row)
            places.append(names.index(planned))
    if rows:
        size = np.array([_planned_over_found(result, names[p], problem) for p in places])
        covariance = result.covariance[np.ix_(rows, rows)] * np.outer(size, size)
        total[np.ix_(places, places)] += _inverse(covariance)
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
        found = _entry(result, ratio, configuration)
        alone = _entry(result, numerator, None)
        if found is None or not found.value or not found.std or alone is None or alone.value:
            continue
        row = np.zeros(len(names))
        row[names.index(numerator)] = 1.0 / phi[names.index(numerator)]
        row[Izz] = -1.0 / phi[Izz]
        total += np.outer(row, row) * (found.value / found.std) ** 2
    return total


def _inverse(covariance: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """Invert a covariance whose correlations may be all but singular."""
    s = np.sqrt(np.diagonal(covariance))
    strengths, vectors = np.linalg.eigh(covariance / np.outer(s, s))
    strengths = np.maximum(strengths, 1e-9)
    return (vectors / strengths) @ vectors.T / np.outer(s, s)


def _entry(
    result: IdentificationResult, name: str, configuration: str | None
) -> Parameter | Derived | None:
    """Return a parameter or derived number of a configuration, or a shared one."""
    for entry in (*result.parameters, *result.derived):
        if entry.name == name and entry.configuration in (None, configuration):
            return entry
    return None
