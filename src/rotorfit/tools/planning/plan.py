"""Plan the flights for a wanted accuracy: candidates, predictions, the shortest that suffices.

Candidates are schedules of manoeuvres, flown bare or bare and with a payload, for some seconds
each. What each would give is predicted from simulated flights (`bound.py`).
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any, Final, Literal

from rotorfit.checks.verdicts.judge import judge
from rotorfit.digits import finite_json
from rotorfit.errors import ExperimentError
from rotorfit.fit.intervals.allowances import number_scale
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.sheet import DataFrame, Sheet, frame, sheet_html, sheet_text
from rotorfit.simulation.pilot import MANOEUVRES, Manoeuvre
from rotorfit.tools.planning.after import (
    PRACTICE,
    Knowledge,
    Missing,
    knowledge_of,
    missing_numbers,
    result_mass,
    values_of,
)
from rotorfit.tools.planning.bound import (
    BARE,
    LOADED,
    Evidence,
    Problem,
    combined,
    evidence,
    fly,
    planned_problem,
    predicted,
)
from rotorfit.tools.planning.vehicle import (
    GUESSABLE,
    Assumptions,
    RoughVehicle,
    assumptions_for,
    default_payload,
    payload_pair,
    rough_vehicle,
)
from rotorfit.tools.planning.wanted import (
    WANTABLE,
    Candidate,
    PredictedNumber,
    ScheduleName,
    Wanted,
    candidate_columns,
    candidate_rows,
    candidate_title,
    worst,
)

if TYPE_CHECKING:
    from rotorfit.fit.experiment.payload import PointMass
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.flight.flight_data import FlightData
    from rotorfit.model.vehicle import Vehicle
    from rotorfit.results.result import IdentificationResult

Speed = Literal["measured", "commanded"]
Progress = Callable[[int, int], None]
Pieces = Mapping[tuple[Manoeuvre, str], Evidence]

SCHEDULES: Final[Mapping[ScheduleName, Mapping[Manoeuvre, float]]] = {
    "hover": {"hover": 1.0},
    "axes": {"roll": 0.25, "pitch": 0.25, "yaw": 0.25, "climb": 0.25},
    "sticks": {"sticks": 1.0},
    "doublets": {"doublets": 1.0},
    "wiggles": {"wiggles": 1.0},
    "turns": {"turns": 1.0},
    "mixed": {"turns": 0.5, "wiggles": 0.5},
}
"""The share of each manoeuvre in a schedule."""
HEAVIEST_PAYLOAD: Final = 0.3
"""Each of two payloads, at most, in masses of the vehicle."""
SECONDS: Final = (20.0, 40.0, 75.0)
LONGER: Final = (2.0, 3.0, 4.0, 6.0, 8.0)
"""How many times the longest flight is tried, where no candidate is good enough."""


@frozen_dataclass
class PlanRequest:
    """The request for a plan.

    Attributes
    ----------
    name
        Of the airframe.
    vehicle
        Its geometry.
    mass
        As it flies [kg].
    speed
        Whether the log has rotor speeds or only commands.
    timed
        Whether the motors' timing has to be found from the flight.
    known
        Rough values that the user knows, by the names of `GUESSABLE`.
    wanted
        Largest half of the 95 % interval.
    seconds
        Lengths of flight to consider, of each flight between take-off and landing [s].
    payload
        Mass of each of two payloads [kg]; None: a handy one; 0: none at all.
    log_rate
        Samples per second of the log [Hz].
    after
        What is known already.
    """

    name: str
    vehicle: Vehicle
    mass: float
    speed: Speed = "measured"
    timed: bool = True
    known: Mapping[str, float] = field(default_factory=dict[str, float])
    wanted: Wanted
    seconds: tuple[float, ...] = SECONDS
    payload: float | None = None
    log_rate: float = 200.0
    after: IdentificationResult | None = None


@frozen_dataclass
class Remedy:
    """A change that reaches the wanted accuracy, where no candidate does.

    - `kind`: ``measured-speed``: log the rotor speed; ``longer``: fly longer.
    - `candidate`: what to fly then.
    """

    kind: Literal["measured-speed", "longer"]
    candidate: Candidate


@frozen_dataclass
class FlightPlan:
    """The candidate flights and the recommended one, or remedies if none is good enough.

    Attributes
    ----------
    request
        What was asked.
    rough
        The vehicle as it was taken to be.
    payload
        Two masses; none where none was to be considered.
    assumed
        Noise and disturbances.
    candidates
        All that were considered.
    recommended
        The shortest that reaches what is wanted.
    enough
        Whether the earlier result reaches it already.
    best
        The candidate that comes nearest, where none reaches it.
    remedies
        What would then.
    missing
        What the earlier result lacks, and what would fix each.
    """

    request: PlanRequest
    rough: RoughVehicle
    payload: tuple[PointMass, ...]
    assumed: Assumptions
    candidates: tuple[Candidate, ...]
    recommended: Candidate | None
    enough: bool
    best: Candidate
    remedies: tuple[Remedy, ...]
    missing: tuple[Missing, ...]

    @property
    def chosen(self) -> Candidate:
        """What to fly: the recommended candidate, else the one that comes nearest."""
        return self.recommended or self.best

    def candidate(self, schedule: ScheduleName, seconds: float, *, payload: bool) -> Candidate:
        """Return one of the candidates."""
        found = (c for c in self.candidates if c.schedule == schedule)
        return next(c for c in found if (c.seconds, c.payload) == (seconds, payload))

    def to_json(self) -> str:
        """Return the plan as JSON text."""
        return json.dumps(_plain_plan(self), indent=1, allow_nan=False) + "\n"

    def to_frame(self) -> DataFrame:
        """Return the candidates as a pandas DataFrame, one row each.

        Half of the 95 % interval of each number, SI, is in the column of its name.

        Raises
        ------
        OutputError
            If pandas is not installed.
        """
        return frame(candidate_columns(self.candidates))

    def __str__(self) -> str:
        return sheet_text(_plan_sheet(self))

    def _repr_html_(self) -> str:
        return sheet_html(_plan_sheet(self))


@frozen_dataclass
class _Study:
    """The simulated flights of a plan, and the information of an earlier result."""

    request: PlanRequest
    problem: Problem
    flights: Mapping[tuple[Manoeuvre, str], FlightData]
    known: Knowledge | None

    @property
    def pieces(self) -> Pieces:
        """Evidence of each flight; computed at each call."""
        return {key: evidence(self.problem, data, key[1]) for key, data in self.flights.items()}


def _plan_sheet(plan: FlightPlan) -> Sheet:
    outcome = "enough is known already" if plan.enough else f"fly {candidate_title(plan.chosen)}"
    reached = plan.enough or plan.recommended is not None
    return Sheet(
        heading=f"{plan.request.name}: {outcome}"
        + ("" if reached else "; it comes closest; no candidate reaches what is wanted"),
        columns=("flight", "enough", *plan.request.wanted.limits),
        rows=candidate_rows(plan.candidates, plan.request.wanted),
        remarks=("half of the 95 % interval, in % of the value (com_x, com_y, com_z: mm)",),
        more="manoeuvres, assumptions and advice: print(rotorfit.plan_text(plan))",
    )


def plan(request: PlanRequest, *, progress: Progress | None = None) -> FlightPlan:
    """Plan which flights to fly.

    Parameters
    ----------
    request
        The vehicle, and what is wanted.
    progress
        Told how many of how many flights have been simulated.

    Raises
    ------
    ExperimentError
        If the vehicle cannot be right, or the earlier result belongs to another.
    """
    assumed = assumptions_for(request.mass, log_rate=request.log_rate)
    rough = rough_vehicle(request.vehicle, mass=request.mass, known=_known_request(request))
    each = _payload_mass(request)
    # Without one the loaded vehicle is never flown; it only has to exist.
    pair = payload_pair(
        request.vehicle,
        each or default_payload(request.mass),
        mass_std=0.5 * assumed.mass_step,
    )
    problem = planned_problem(
        rough,
        pair,
        assumed=assumed,
        commanded=request.speed == "commanded",
        timed=request.timed,
    )
    configurations = (BARE, LOADED) if each > 0 else (BARE,)
    study = _Study(
        request=request,
        problem=problem,
        flights=_fly_manoeuvres(problem, configurations, progress),
        known=None if request.after is None else knowledge_of(request.after, problem),
    )
    pieces, known = study.pieces, study.known
    bare: dict[Manoeuvre, Evidence] = {manoeuvre: pieces[manoeuvre, BARE] for manoeuvre in PRACTICE}
    candidates = _predict_candidates(study, pieces, request.seconds)
    good = [c for c in candidates if c.meets]
    shortest = min(good, key=lambda c: (*_flying_effort(c), worst(c, request.wanted)), default=None)
    enough = known is not None and request.wanted.met_by(known.half_widths, known.values)
    return FlightPlan(
        request=request,
        rough=rough,
        payload=pair if each > 0 else (),
        assumed=assumed,
        candidates=tuple(candidates),
        recommended=shortest,
        enough=enough,
        best=min(candidates, key=lambda c: (worst(c, request.wanted), *_flying_effort(c))),
        remedies=() if shortest or enough else tuple(_find_remedies(study, pieces)),
        missing=() if known is None else missing_numbers(problem, bare, known),
    )


def _payload_mass(request: PlanRequest) -> float:
    """Return the mass of each of the two payloads; 0: none [kg]."""
    if request.payload is None:
        return default_payload(request.mass)
    if not 0.0 <= request.payload <= HEAVIEST_PAYLOAD * request.mass:
        raise ExperimentError(
            f"two payloads of {request.payload:g} kg on a vehicle of {request.mass:g} kg; expected "
            f"each at most {HEAVIEST_PAYLOAD * request.mass:.2g} kg: a payload is in kilograms"
        )
    return request.payload


def _known_request(request: PlanRequest) -> dict[str, float]:
    """Collect rough values: those of an earlier result, the user's before them."""
    earlier: dict[str, float] = {}
    if request.after is not None:
        result_mass(request.after, request.mass)  # refused before anything is flown
        earlier = values_of(request.after, request.vehicle)
    return {**{k: v for k, v in earlier.items() if k in GUESSABLE}, **request.known}


def _flying_effort(candidate: Candidate) -> tuple[float, bool]:
    return candidate.total_seconds, candidate.payload


def _fly_manoeuvres(
    problem: Problem, configurations: tuple[str, ...], progress: Progress | None
) -> dict[tuple[Manoeuvre, str], FlightData]:
    """Simulate every manoeuvre of every schedule once."""
    wanted: dict[str, list[Manoeuvre]] = {
        configuration: [m for m in MANOEUVRES if (m, configuration) != ("hover", LOADED)]
        for configuration in configurations
    }
    total = sum(map(len, wanted.values()))
    flights: dict[tuple[Manoeuvre, str], FlightData] = {}
    for configuration, manoeuvres in wanted.items():
        flown = fly(problem, manoeuvres, configuration)
        flights |= {(manoeuvre, configuration): data for manoeuvre, data in flown.items()}
        if progress is not None:
            progress(len(flights), total)
    return flights


def _predict_candidates(
    study: _Study, pieces: Pieces, lengths: tuple[float, ...]
) -> list[Candidate]:
    """Predict every schedule for every length, bare and with a payload."""
    payloads = (False, True) if any(c == LOADED for _, c in pieces) else (False,)
    return [
        _predict_candidate(study, pieces, schedule, seconds=seconds, payload=payload)
        for payload in payloads
        for schedule in SCHEDULES
        for seconds in lengths
        if not (payload and schedule == "hover")  # there is nothing in it that a payload changes
    ]


def _predict_candidate(
    study: _Study, pieces: Pieces, schedule: ScheduleName, *, seconds: float, payload: bool
) -> Candidate:
    """Predict one way to fly; no number is wider than the earlier result has it."""
    flown = combined(
        [
            (pieces[manoeuvre, configuration], share * seconds)
            for manoeuvre, share in SCHEDULES[schedule].items()
            for configuration in ((BARE, LOADED) if payload else (BARE,))
        ]
    )
    known = study.known
    numbers = predicted(study.problem, flown, None if known is None else known.information)
    narrowed = numbers if known is None else known.narrowed(numbers)
    shown = _shown_numbers(study.problem, narrowed)
    half_widths = {name: number.half_width for name, number in shown.items()}
    values = {name: number.value for name, number in shown.items()}
    return Candidate(
        schedule=schedule,
        seconds=seconds,
        payload=payload,
        numbers=shown,
        meets=study.request.wanted.met_by(half_widths, values),
    )


def _shown_numbers(problem: Problem, numbers: Numbers) -> dict[str, PredictedNumber]:
    """Return the numbers that a plan shows, each with its verdict."""
    bare = problem.configurations[0]
    shown: dict[str, PredictedNumber] = {}
    for name, full in WANTABLE.items():
        value, half = numbers.number(full)
        scale = number_scale(numbers, full, mass=bare.mass, vehicle=bare.vehicle)
        verdict = judge(value, half, scale=scale, axis="yaw").verdict
        terms = numbers.terms_of(full)
        shown[name] = PredictedNumber(
            name=name,
            value=value,
            half_width=half,
            verdict=verdict,
            largest_term=max(terms, key=lambda term: term.half_width).name if terms else "noise",
        )
    return shown


def _find_remedies(study: _Study, pieces: Pieces) -> list[Remedy]:
    """Find the changes that reach the wanted accuracy: measured rotor speed, or longer flights."""
    seconds = study.request.seconds
    found: list[Remedy] = []
    if study.problem.commanded:
        problem = dataclasses.replace(study.problem, commanded=False)
        measured = dataclasses.replace(study, problem=problem)
        found += _best_remedy(
            _predict_candidates(measured, measured.pieces, seconds), "measured-speed"
        )
    for times in LONGER:
        candidates = _predict_candidates(study, pieces, (times * max(seconds),))
        if longer := _best_remedy(candidates, "longer"):
            return [*found, *longer]
    return found


def _best_remedy(
    candidates: list[Candidate], kind: Literal["measured-speed", "longer"]
) -> list[Remedy]:
    good = [c for c in candidates if c.meets]
    return [Remedy(kind=kind, candidate=min(good, key=_flying_effort))] if good else []


def _plain_plan(plan: FlightPlan) -> dict[str, Any]:
    """Return the plan in the words of its file."""
    truth = plan.rough.truth.parameters()
    return {
        "schema": 1,
        "name": plan.request.name,
        "speed": plan.request.speed,
        "wanted": dict(plan.request.wanted.limits),
        "vehicle": {
            **{name: truth[name] for name in ("mass", "kt", "kd", "Jr", "motor_lag")},
            **{name: truth[f"{name}_com"] for name in ("Ixx", "Iyy", "Izz")},
            "guessed": list(plan.rough.guessed),
        },
        "assumed": dataclasses.asdict(plan.assumed),
        "payload": [dataclasses.asdict(item) for item in plan.payload],
        "candidates": [_plain_candidate(c) for c in plan.candidates],
        "recommended": plan.recommended and _plain_candidate(plan.recommended),
        "enough_already": plan.enough,
        "remedies": [
            {"kind": r.kind, "candidate": _plain_candidate(r.candidate)} for r in plan.remedies
        ],
        "missing": [finite_json(dataclasses.asdict(m)) for m in plan.missing],
    }


def _plain_candidate(candidate: Candidate) -> dict[str, Any]:
    return {
        "schedule": candidate.schedule,
        "seconds": candidate.seconds,
        "payload": candidate.payload,
        "meets": candidate.meets,
        "numbers": [finite_json(dataclasses.asdict(n)) for n in candidate.numbers.values()],
    }
