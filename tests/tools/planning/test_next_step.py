"""The next step: what makes flying useless first, then what was doubted, then the manoeuvre."""

from dataclasses import replace

import numpy as np
import pytest

from flown import with_findings
from made_tables import judged
from rotorfit.checks.sensors.log_settings import NO_ROTOR_SPEED, NOT_SIMULATED, TOO_SLOW
from rotorfit.checks.verdicts.judge import ADVICE, FLOWN, body_advice
from rotorfit.findings import Evidence, doubt, note
from rotorfit.fit.intervals.interval_terms import TERM_KINDS, NumberTerm
from rotorfit.results.result import IdentificationResult, Parameter
from rotorfit.tools.planning.after import (
    PRACTICE,
    UNAIDED,
    UNAIDED_BEFORE,
    Missing,
    judged_numbers,
    unaided_advice,
)
from rotorfit.tools.planning.next_step import (
    BEST_MANOEUVRE,
    DONE,
    UNHELPED,
    best_manoeuvre,
    next_step,
)

SLOW = note(TOO_SLOW, "", numbers=("Jr",), next_step="set it", useless_because="it is slow")
SPEED = note(NO_ROTOR_SPEED, "", numbers=("kd",), next_step="log the speed")
SPINS = doubt("spins", "s", numbers=("kd",), next_step="look", doubtful_because="they differ")
ROLL = note(
    BEST_MANOEUVRE,
    "",
    next_step=FLOWN["turns"],
    numbers=("kd",),
    evidence=(Evidence(name="kd", value=0.062, limit=0.18), Evidence(name="Jr", value=0.12)),
)


def step(*findings, kt="identified", kd="weak", Jr="identified", advice=None, asks=None):
    """Return the next step of a result of kt, kd and Jr with these findings and verdicts."""
    usual = {"weak": FLOWN["turns"], "not-identified": FLOWN["roll"]}
    parameters = tuple(
        Parameter(
            name=name, configuration=owner, value=1.0, std=0.1, interval=(0.8, 1.2), unit="",
            verdict=verdict, advice=(advice or {}).get(name, usual.get(verdict)),
            asks=(asks or {}).get(name),
        )
        for name, owner, verdict in (("kt", "A", kt), ("kd", None, kd), ("Jr", None, Jr))
    )  # fmt: skip
    result = IdentificationResult(
        name="made", method="banded", parameters=parameters, derived=(), flights=(),
        covariance_names=(), covariance=np.zeros((0, 0)), settings={}, versions={},
    )  # fmt: skip
    return next_step(judged(with_findings(result, *findings)))


def test_a_log_that_is_too_slow_comes_before_all_else(assert_text):
    found = step(ROLL, SPINS, SPEED, SLOW, Jr="not-identified")
    assert (found.kind, found.numbers) == ("log", ("Jr",))
    assert_text(found.sentence)


def test_what_no_number_lacks_is_no_step():
    assert step(SLOW, ROLL).kind == "fly"  # Jr is known in spite of it
    assert step(SPEED, SPINS).action == "log the speed"
    assert step(SPINS).sentence == "look, because they differ"


def test_a_manoeuvre_says_what_it_gives():
    gain = "kd from +-18 to +-6.2 % and Jr from unknown to +-12 %"
    assert step(ROLL).sentence == f"{FLOWN['turns']} (gives {gain})"


def test_what_a_simulator_lacks_is_nothing_to_fly_for():
    absent = note(NOT_SIMULATED, "", numbers=("Jr",), next_step="nothing", useless_because="none")
    assert step(absent, kd="identified", Jr="not-identified").action == DONE
    assert step(kd="identified", Jr="not-identified").action == FLOWN["roll"]


def test_nothing_is_flown_for_nothing():
    assert step(note(BEST_MANOEUVRE, ""), kd="identified").action == DONE
    assert step(note(BEST_MANOEUVRE, "")).action == UNHELPED
    assert step(kd="identified").action == DONE
    assert step().action == FLOWN["turns"]


def test_what_an_advice_asks_for_decides_and_not_its_words():
    words = {"kd": "in other words than today's"}
    assert step(advice=words, asks={"kd": "flight"}).kind == "fly"
    assert step(advice=words, asks={"kd": "other"}).kind == "declare"
    assert step(advice=words, asks={"kd": "nothing"}).action == UNHELPED
    assert step(advice={"kd": UNAIDED_BEFORE}).action == UNHELPED  # an older result


def test_the_manoeuvre_kept_comes_before_that_none_is_enough():
    """Some numbers may be beyond any manoeuvre while another is worth the flight."""
    assert step(ROLL, advice={"kt": UNAIDED, "kd": UNAIDED}).action == FLOWN["turns"]
    assert step(advice={"kd": UNAIDED}).action == UNHELPED
    assert step(Jr="not-identified", advice={"kd": UNAIDED}).action == FLOWN["roll"]


def test_flights_count_together_against_what_else_is_advised():
    """Two numbers that ask for two manoeuvres are not outvoted by one that asks for a scale."""
    asked = {"kt": ADVICE["scale"], "kd": FLOWN["turns"], "Jr": FLOWN["roll"]}
    assert step(kt="ratio-only", Jr="weak", advice=asked).kind == "fly"
    asked["kd"] = ADVICE["scale"]
    assert step(kt="ratio-only", Jr="weak", advice=asked).action == ADVICE["scale"]


def test_the_manoeuvre_is_chosen_among_all_that_were_simulated():
    def missing(name, **after):
        least = min(after, key=after.get)
        flown = {m: after.get(m, 0.5) for m in PRACTICE}
        return Missing(
            name=name, full_name=name, verdict="weak", now=0.5, manoeuvre=least, size=1.0,
            relative=after[least], predicted="identified", after=flown, advice=FLOWN[least],
        )  # fmt: skip

    def best(*numbers):
        return best_manoeuvre(numbers).next_step

    assert best(missing("kd", turns=0.2, doublets=0.05)) == FLOWN["doublets"]
    assert best(missing("kd", turns=0.052, doublets=0.05)) == FLOWN["turns"]
    assert best(missing("kd", sticks=0.05), missing("Jr", sticks=0.05)) == FLOWN["sticks"]


def test_a_number_about_the_com_keeps_what_was_simulated():
    twin = Parameter(
        name="Ixy", configuration="A", value=1.0, std=0.1, interval=(0.8, 1.2), unit="",
        verdict="identified", advice=None,
    )  # fmt: skip
    assert body_advice("Ixy_com", "weak", twin) == FLOWN["roll"]
    assert body_advice("Ixy_com", "weak", replace(twin, advice=UNAIDED)) == UNAIDED


def test_a_gain_never_reaches_beyond_what_no_flight_shrinks():
    """Its law alone leaves kt open by 80 % of its interval: 20 s of any manoeuvre keep that."""
    terms = tuple(
        NumberTerm(name=name, half_width=half, source="made up")
        for name, half in (("noise", 0.3), ("motor law", 0.4))
    )
    kt = Parameter(
        name="kt", configuration=None, value=1.0, std=0.5 / 1.96, interval=(0.5, 1.5), unit="",
        verdict="weak", advice=FLOWN["climb"], asks="flight", interval_terms=terms,
    )  # fmt: skip
    result = IdentificationResult(
        name="made", method="banded", parameters=(kt,), derived=(), flights=(),
        covariance_names=(), covariance=np.zeros((0, 0)), settings={}, versions={},
    )  # fmt: skip
    [number] = judged_numbers(result, "A")
    assert number.kept == pytest.approx(0.8)
    assert unaided_advice(number) == TERM_KINDS["motor law"].action
    assert unaided_advice(replace(number, kept=0.6)) == UNAIDED


def held_by(term, share, *, of=("kd",)):
    """Return the next step where a term has a share of the squared intervals of weak numbers."""
    terms = tuple(
        NumberTerm(name=name, half_width=half**0.5, source="made up")
        for name, half in (("noise", 1.0 - share), (term, share))
    )
    parameters = tuple(
        Parameter(
            name=name, configuration=owner, value=1.0, std=0.3, interval=(0.4, 1.6), unit="",
            verdict="weak", advice=FLOWN["turns"], asks="flight",
            interval_terms=terms if name in of else (),
        )
        for name, owner in (("kt", "A"), ("kd", None), ("Jr", None))
    )  # fmt: skip
    result = IdentificationResult(
        name="made", method="banded", parameters=parameters, derived=(), flights=(),
        covariance_names=(), covariance=np.zeros((0, 0)), settings={}, versions={},
    )  # fmt: skip
    return next_step(with_findings(result, ROLL))


def test_what_no_flight_shrinks_is_named_where_it_decides():
    """Of most numbers: a ruler where the arms leave them open, a log setting for the filter."""
    found = held_by("arm lengths", 0.6, of=("kd", "Jr"))
    assert (found.kind, found.numbers) == ("declare", ("kd", "Jr"))
    assert found.action == TERM_KINDS["arm lengths"].action
    assert held_by("gyro filter", 0.9, of=("kd", "Jr")).kind == "log"
    assert held_by("arm lengths", 0.4, of=("kd", "Jr")).kind == "fly"
    assert held_by("arm lengths", 0.9, of=("kd",)).kind == "fly"
    assert held_by("autopilot response", 0.9, of=("kd", "Jr")).kind == "fly"
