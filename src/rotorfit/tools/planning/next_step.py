"""Choose the one next step with a vehicle, for every command, report and page.

First what makes all flying pointless (settings of the log, rotor speed that is not logged, what was
declared wrongly), then the one manoeuvre that sharpens most, and how far; nothing to fly where all
that matters is known.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rotorfit.checks.left_out_hovers import KIND as CONTRADICTING
from rotorfit.checks.sensors.log_settings import NO_ROTOR_SPEED, NOT_SIMULATED, TOO_SLOW
from rotorfit.checks.verdicts.judge import ADVISED, FLOWN, WEAK, Asks, motion_for
from rotorfit.errors import ExperimentError
from rotorfit.findings import Evidence, Finding, note
from rotorfit.fit.dataset.load import ignore_progress
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.fit.experiment.experiment import experiment_of_settings
from rotorfit.model.parameters import COM, INERTIA_COM, NUISANCE
from rotorfit.results.result import IdentificationResult, configuration_names
from rotorfit.results.tables import Advice
from rotorfit.tools.planning.advised_step import Kind, NextStep
from rotorfit.tools.planning.after import (
    AS_GOOD,
    LACKING,
    PRACTICE,
    UNAIDED,
    UNFLOWN,
    JudgedNumber,
    Missing,
    gain_phrase,
    judged_numbers,
    knowledge_of,
    missing_numbers,
    scaled_mass,
    values_of,
)
from rotorfit.tools.planning.bound import BARE, Problem, evidence, fly, planned_problem
from rotorfit.tools.planning.vehicle import (
    GUESSABLE,
    PER_KILOGRAM,
    assumptions_for,
    default_payload,
    payload_pair,
    rough_vehicle,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rotorfit.simulation.pilot import Manoeuvre
    from rotorfit.tools.planning import bound

BEST_MANOEUVRE: Final = "best-manoeuvre"
"""Kind of the note that a result keeps of what its best manoeuvre gives."""
MAIN: Final = ("kt", "kd", "Jr", *COM, *INERTIA_COM[:3])
"""Numbers for which a step is worth a flight."""
DONE: Final = "nothing more to fly: check the result on another flight, with rotorfit validate"
UNHELPED: Final = (
    "fly longer than 20 s, or with a payload, for what is still missing; rotorfit plan says how "
    "long, and which manoeuvres"
)
MOST_OF_IT: Final = 0.5
"""Share of a squared interval over which a contribution decides it."""
NAMED: Final = 2
"""How many of the numbers that a manoeuvre sharpens are named."""


def next_step(result: IdentificationResult, *, predicted: Finding | None = None) -> NextStep:
    """Choose the next step of a result, by its findings and verdicts.

    `predicted` is the best manoeuvre, where the result itself does not keep it.
    """
    lacking = _lacking_numbers(result)
    stored = next((one for one in result.findings if one.kind == BEST_MANOEUVRE), predicted)
    step = _before_flying(result, lacking) or _not_by_flying(lacking) or _most_advised(lacking)
    about_flying = step.kind == "fly" or step.action == UNHELPED
    return _stored_step(stored) if about_flying and stored is not None else step


def asks_for_a_plan(result: IdentificationResult) -> bool:
    """Return whether the next step is a flight that only a plan finds."""
    return next_step(result).action == UNHELPED


def advise_flights(
    result: IdentificationResult, report: Callable[[str], None] = ignore_progress
) -> Advice | None:
    """Simulate what to fly for each number that a result lacks, and which manoeuvre gives most."""
    if not any(one.is_flyable for one in _all_lacking(result)):
        return None
    try:
        report("simulating what to fly next")
        # Every manoeuvre of a plan is simulated with the vehicle of the result: `rotorfit plan
        # --after` says the same. A result per kilogram is judged as one of one kilogram: no share
        # depends on the mass.
        problem = _planning_problem(result)
        pieces: dict[Manoeuvre, bound.Evidence] = {
            m: evidence(problem, data, BARE) for m, data in fly(problem, PRACTICE, BARE).items()
        }
        known = knowledge_of(result, problem)
        missing = missing_numbers(problem, pieces, known)
    except ExperimentError:
        return None
    worth_flying = next_step(result).kind == "fly"
    advice = {one.full_name: one.advice for one in missing}
    return Advice(
        by_number={
            one.parameter: (words, _what_is_asked(words, one))
            for one in judged_numbers(result, known.configuration)
            if (words := advice.get(one.full_name))
        },
        findings=(best_manoeuvre(missing),) if worth_flying else (),
    )


def _what_is_asked(advice: str, number: JudgedNumber) -> Asks:
    if not number.is_flyable:
        return "other"
    if advice == UNAIDED:
        return "nothing"
    return "flight" if advice in FLOWN.values() else "other"


def best_manoeuvre(missing: Sequence[Missing]) -> Finding:
    """Store the manoeuvre that improves most of a result's missing numbers, if any helps.

    The most numbers made sharp count, then how much all are sharpened; of equally good ones the
    usual one is named.
    """
    main = [one for one in missing if one.name in MAIN and one.verdict != "doubtful"]
    best: tuple[tuple[int, float], Manoeuvre, list[Missing]] | None = None
    for manoeuvre in _advised_first([one.name for one in main if one.manoeuvre is not None]):
        helped = [one for one in main if one.is_helped_by(manoeuvre)]
        sharp = sum(one.after[manoeuvre] <= WEAK for one in helped)
        gain = sum(one.sharper(manoeuvre) for one in helped)
        if helped and (best is None or (sharp, gain / AS_GOOD) > best[0]):
            best = ((sharp, gain), manoeuvre, helped)
    if best is None:
        return note(BEST_MANOEUVRE, "")
    _, manoeuvre, helped = best
    helped.sort(key=lambda one: -one.sharper(manoeuvre))
    return note(
        BEST_MANOEUVRE,
        "",
        next_step=FLOWN[manoeuvre],
        numbers=tuple(one.name for one in helped),
        evidence=tuple(
            Evidence(
                name=one.name,
                value=one.shown(one.after[manoeuvre]),
                limit=None if one.now is None else one.shown(one.now),
            )
            for one in helped
        ),
    )


def _lacking_numbers(result: IdentificationResult) -> list[JudgedNumber]:
    """List the numbers that are worth a flight and not known well."""
    return [one for one in _all_lacking(result) if one.name in MAIN]


def _all_lacking(result: IdentificationResult) -> list[JudgedNumber]:
    """List the numbers of all configurations that are not known well, each once."""
    # Numbers that a simulator does not have lack nothing.
    absent = [one for one in result.findings if one.kind == NOT_SIMULATED]
    found = [
        number
        for owner in configuration_names(result)
        for number in judged_numbers(result, owner)
        if number.verdict in LACKING and number.name not in NUISANCE
        if not any(one.is_about(number.parameter) for one in absent)
    ]
    return list({one.parameter: one for one in found}.values())


def _before_flying(
    result: IdentificationResult, lacking: Sequence[JudgedNumber]
) -> NextStep | None:
    """Find the step without which more flying is pointless, if there is one."""
    usable = [
        (one, numbers)
        for one in result.every_finding
        if one.next_step is not None
        and (numbers := [n.name for n in lacking if one.is_about(n.parameter)])
    ]
    parts = [pair for pair in usable if pair[0].kind == CONTRADICTING]
    logs = [pair for kind in (TOO_SLOW, NO_ROTOR_SPEED) for pair in usable if pair[0].kind == kind]
    disowning = [p for p in usable if p[0].doubtful_because or p[0].withheld_because]
    for one, numbers in (*parts, *logs, *disowning):
        return NextStep(
            kind="log" if (one, numbers) in logs else "declare",
            action=one.next_step or "",
            because=one.useless_because or one.doubtful_because or one.withheld_because,
            numbers=tuple(dict.fromkeys(numbers)),
        )
    return None


def _not_by_flying(lacking: Sequence[JudgedNumber]) -> NextStep | None:
    """Name the largest contribution where it is one that no flight shrinks, of most numbers."""
    groups: dict[str, list[JudgedNumber]] = {}
    for number in lacking:
        line = number.largest
        # Over half of the squared interval: without all the rest, seven tenths would be left.
        if line is not None and line.share > MOST_OF_IT and line.remedy in UNFLOWN:
            groups.setdefault(line.name, []).append(number)
    held = sum(len(numbers) for numbers in groups.values())
    if 2 * held <= len(lacking):
        return None
    term, numbers = max(groups.items(), key=lambda group: len(group[1]))
    line = numbers[0].largest
    assert line is not None
    names = tuple(dict.fromkeys(number.name for number in numbers))
    return NextStep(
        kind="log" if line.remedy == "log" else "declare",
        action=line.action,
        because=f"{term} makes up most of the interval of {', '.join(names[:NAMED])}",
        numbers=names,
    )


def _stored_step(best: Finding) -> NextStep:
    """Describe the manoeuvre that a result keeps, and what it gives."""
    if best.next_step is None:
        return NextStep(kind="done", action=UNHELPED)
    parts = [
        f"{one.name} {gain_phrase(one.name, one.limit, one.value)}" for one in best.evidence[:NAMED]
    ]
    gain = " and ".join(parts)
    return NextStep(kind="fly", action=best.next_step, gain=gain, numbers=best.numbers)


def _most_advised(lacking: Sequence[JudgedNumber]) -> NextStep:
    """Choose what is advised for most numbers, without a prediction; flights count together."""
    advised = [one for one in lacking if one.advice is not None]
    flown = [one for one in advised if one.is_flyable]
    others = [one for one in advised if not one.is_flyable]
    kind: Kind = "fly" if len(flown) > len(others) else "declare"
    groups: dict[str, list[str]] = {}
    for one in flown if kind == "fly" else others:
        if one.asks != "nothing":
            groups.setdefault(one.advice or "", []).append(one.name)
    if not groups:
        return NextStep(kind="done", action=UNHELPED if advised else DONE)
    action = max(groups, key=lambda advice: len(groups[advice]))
    return NextStep(kind=kind, action=action, numbers=tuple(dict.fromkeys(groups[action])))


def _advised_first(names: Sequence[str]) -> list[Manoeuvre]:
    """Order the manoeuvres: first those that numbers usually ask for, by how many do."""
    asked = [ADVISED[motion_for(name)] for name in names if motion_for(name) in ADVISED]
    return sorted(PRACTICE, key=lambda m: (-asked.count(m), PRACTICE.index(m))) if names else []


def _planning_problem(result: IdentificationResult) -> Problem:
    """Return the problem of a plan for the vehicle of a result, as `rotorfit plan` poses it."""
    _, weighed = scaled_mass(result)
    mass = PER_KILOGRAM if weighed is None else weighed
    experiment = experiment_of_settings(result.settings)
    vehicle, motors = vehicle_of(experiment.airframe), experiment.motors
    assumed = assumptions_for(mass)
    known = {n: v for n, v in values_of(result, vehicle).items() if n in GUESSABLE}
    return planned_problem(
        rough_vehicle(vehicle, mass=weighed, known=known),
        payload_pair(vehicle, default_payload(mass), mass_std=0.5 * assumed.mass_step),
        assumed=assumed,
        commanded=motors.speed == "commanded",
        timed=motors.delay is None and (motors.speed == "measured" or motors.lag is None),
    )
