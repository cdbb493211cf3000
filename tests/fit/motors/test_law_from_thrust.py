"""The law from command to speed, where only the flight shows it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rotorfit.checks.motors.motor_law import CONTRADICTED, OF_SPEED, STATED, law_finding
from rotorfit.estimation.measured import Measured
from rotorfit.fit.motors.law_from_thrust import (
    FAR,
    FULL_STD,
    LEAST_POWER,
    ROUNDING,
    STATED_STD,
    STEADY,
    USUAL,
    WRONG_FULL_STD,
    WRONG_STD,
    LawFromThrust,
    Trial,
    anchor_of,
    exponent_of,
    mistaken,
    mixed,
    thrust_ratio,
)
from rotorfit.flight.motors.motor_model import speeds
from rotorfit.logs.motor_law import MotorLaw, PolynomialCurve, PowerCurve, SquareRootCurve


def test_the_ratio_has_the_uncertainty_of_both():
    ratio = thrust_ratio(Measured(value=6.0, std=0.3), Measured(value=8.0, std=0.4))
    assert ratio.value == 0.75
    assert ratio.std == pytest.approx(0.75 * 0.05 * 2**0.5)
    assert thrust_ratio(None, Measured(value=8.0, std=0.4)) is None
    assert thrust_ratio(Measured(value=8.0, std=0.4), None) is None


def test_the_exponent_is_the_usual_until_a_flight_shows_it():
    assert exponent_of(None) == USUAL
    sure = exponent_of(Measured(value=0.5, std=0.005))
    assert sure.value == pytest.approx(0.5, abs=0.001)
    unsure = exponent_of(Measured(value=0.5, std=2.0))
    assert unsure.value == pytest.approx(USUAL.value, abs=0.01)


@pytest.mark.parametrize("power", [1.0, 1.5, 2.0])
def test_weight_and_changes_give_the_exponent_of_any_power(power):
    """Thrust T u^power about hover: k_t of u^2 by changes over that by weight is power / 2."""
    u = np.linspace(0.48, 0.52, 101)
    thrust = 7.0 * u**power
    changes = np.polyfit(u**2, thrust, 1)[0]
    weight = thrust.mean() / (u**2).mean()
    assert changes / weight == pytest.approx(power / 2, rel=1e-3)


def law(ratio, hover=0.5):
    return LawFromThrust(exponent=exponent_of(ratio), flown=ratio, hover=hover)


def trial(power, shown, std=0.02):
    return Trial(power=power, shown=Measured(value=shown, std=std))


def test_the_law_is_where_a_fit_shows_what_it_is_made_with():
    """Fits show .2 + .6 p: .5 of p = .5."""
    first, second = trial(1.0, 0.8), trial(0.8, 0.68)
    growth = second.growth_since(first)
    assert growth == pytest.approx(0.6)
    for one in (first, second):
        found = one.fixed_point(growth)
        assert found.value == pytest.approx(0.5)
        assert found.std == pytest.approx(0.05)


def test_a_fit_that_shows_what_it_is_made_with_shows_little():
    growth = trial(0.8, 0.9).growth_since(trial(1.0, 1.2))
    assert growth == STEADY
    assert trial(0.8, 0.9).fixed_point(growth).std == pytest.approx(0.4)
    assert trial(0.8, 0.9).growth_since(trial(1.0, 0.8)) == 0.0


def test_a_law_is_settled_where_its_fit_is_near_it():
    def after(power):
        at = trial(power, 0.5)
        exponent = Measured(value=0.5, std=0.05)
        return LawFromThrust(exponent=exponent, flown=at.shown, hover=0.5, trial=at)

    assert after(0.504).settled and after(0.496).settled
    assert not after(0.51).settled and not after(0.49).settled
    assert replace(law(None), trial=trial(USUAL.value, 0.5)).settled
    # Where it stays open, the law is that of the fit, and as far open as the next step is long.
    assert after(0.62).fitted.exponent.value == pytest.approx(0.62)
    assert after(0.62).fitted.exponent.std == pytest.approx(0.13)


def test_a_found_law_is_a_power_of_the_command_up_to_one():
    found = law(Measured(value=0.75, std=0.01)).law
    command = np.array([0.25, 1.0])
    exponent = exponent_of(Measured(value=0.75, std=0.01)).value
    assert speeds(found, command) == pytest.approx([0.25**exponent, 1.0])
    assert found.slope_std == pytest.approx(0.01 / 0.75, rel=0.02)
    assert found.speed_std == pytest.approx(FULL_STD * np.log(2.0))


def test_thrust_curves_differ_from_the_power_in_hover_by_so_much():
    """f u^2 + (1 - f) u behind a dead zone: mean exponent to full command less that in hover."""
    random = np.random.default_rng(3)
    f, start, hover = (random.uniform(a, b, 20_000) for a, b in ((0, 1), (-0.1, 0.15), (0.3, 0.7)))

    def log_speed(command):
        u = (command - start) / (1.0 - start)
        return 0.5 * np.log(f * u**2 + (1.0 - f) * u)

    step = 1e-4
    local = (log_speed(hover + step) - log_speed(hover - step)) / (2.0 * step / hover)
    mean = log_speed(hover) / np.log(hover)
    assert np.sqrt(((mean - local) ** 2).mean()) == pytest.approx(FULL_STD, rel=0.1)


RIGHT = MotorLaw(curve=PolynomialCurve((0.0, 1.0)))
GIVEN = MotorLaw(curve=PowerCurve(900.0, 0.1, 0.5))


def test_a_right_law_stays_and_a_wrong_one_goes():
    """One in twenty is wrong: without a flight nothing but those is open, and 95 % holds."""
    before = exponent_of(None, RIGHT)
    assert before.value == 1.0
    assert ROUNDING < before.std < 20.0 * ROUNDING
    right, unsure, wrong = (
        exponent_of(Measured(value=p, std=0.02), RIGHT) for p in (1.01, 1.06, 1.3)
    )
    assert right.value == pytest.approx(1.0, abs=1e-3)
    assert exponent_of(Measured(value=1.01, std=0.02), RIGHT, about=1.0).std < 2.0 * ROUNDING
    assert wrong.value == pytest.approx(1.3, abs=0.005)
    assert wrong.std == pytest.approx(0.02, abs=1e-3)
    assert 1.0 < unsure.value < 1.06
    assert unsure.interval[0] < 1.0 < 1.06 < unsure.interval[1]


def test_how_likely_a_law_is_wrong():
    assert mistaken(None, RIGHT) == 0.05
    assert mistaken(Measured(value=1.0, std=0.02), RIGHT) < 0.005
    assert mistaken(Measured(value=1.3, std=0.02), RIGHT) > 0.999
    assert mistaken(Measured(value=9.0, std=0.02), RIGHT) == 1.0
    assert mistaken(Measured(value=1.3, std=5.0), RIGHT) == pytest.approx(0.05, rel=0.02)


def test_the_law_of_simulated_motors_is_never_doubted():
    exact = replace(RIGHT, exact=True)
    for flown in (None, Measured(value=0.86, std=0.04), Measured(value=9.0, std=0.02)):
        assert mistaken(flown, exact) == 0.0
        known = exponent_of(flown, exact)
        assert known.value == pytest.approx(1.0, abs=1e-3)
        assert known.std < 1.1 * ROUNDING


def test_a_wrong_slope_loses_all_that_goes_with_speeds():
    names = {"kt", "kd", "Jr", "inflow", "rotor_drag", "kd_linear", "Izz_over_kt", "hover_speed"}
    assert names <= set(OF_SPEED)
    assert not {"Ixx", "Ixx_com", "com_x", "drag"} & set(OF_SPEED)


def test_nothing_jumps_as_a_law_becomes_wrong():
    # Half of std at once, where one in twenty becomes wrong: in a thousandth of the exponent.
    most = np.array([1e-3, 4e-3])

    def found(exponent):
        one = exponent_of(Measured(value=exponent, std=0.02), RIGHT)
        return np.array([one.value, one.std])

    exponents = np.linspace(0.8, 1.2, 2001)
    pairs = list(pairwise((x, found(x)) for x in exponents.tolist()))
    while pairs:
        begin, end = pairs.pop()
        step = np.abs(end[1] - begin[1])
        if end[0] - begin[0] > 5.1e-5:
            # Less than half of a jump hides none: what is smooth is less than the other half.
            if (step > 0.5 * most).any():
                middle = 0.5 * (begin[0] + end[0])
                between = (middle, found(middle))
                pairs += [(begin, between), (between, end)]
            continue
        assert (step < most).all()


def test_a_law_of_a_result_may_be_off_by_its_slope():
    known = exponent_of(Measured(value=1.08, std=0.02), replace(RIGHT, slope_std=0.08))
    assert known.value == pytest.approx(1.076, abs=0.003)


@pytest.mark.parametrize("about", [None, 1.05])
@pytest.mark.parametrize("by_mistake", [0.02, 0.3, 0.7])
def test_a_mixture_is_held_in_95_percent(by_mistake, about):
    right, wrong = Measured(value=1.0, std=0.01), Measured(value=1.2, std=0.1)
    found = mixed(right, wrong, by_mistake, about=about)
    random = np.random.default_rng(5)
    draws = np.where(
        random.random(400_000) < by_mistake,
        random.normal(wrong.value, wrong.std, 400_000),
        random.normal(right.value, right.std, 400_000),
    )
    assert found.value == pytest.approx(draws.mean() if about is None else about, abs=1e-3)
    assert (np.abs(draws - found.value) <= 1.96 * found.std).mean() == pytest.approx(0.95, abs=2e-3)


def test_wrong_laws_differ_by_so_much():
    """f u^2 + (1 - f) u from start to end, one for another: f, or both ends, or all."""
    random = np.random.default_rng(3)

    def log_speed(curve, command):
        f, start, end = curve
        u = (command - start) / (end - start)
        return 0.5 * np.log(f * u**2 + (1.0 - f) * u)

    def drawn():
        return [random.uniform(a, b, 20_000) for a, b in ((0, 1), (-0.1, 0.15), (0.95, 1.0))]

    hover, step = random.uniform(0.3, 0.7, 20_000), 1e-4

    def slope(curve):
        return log_speed(curve, hover + step) - log_speed(curve, hover - step)

    given, true = drawn(), drawn()
    stds, to_full = [], []
    for own in (given, [given[0], *true[1:]], [true[0], *given[1:]]):
        local = slope(true) / slope(own)
        mean = log_speed(true, hover) / log_speed(own, hover)
        stds.append(np.sqrt(((local - 1.0) ** 2).mean()))
        to_full.append(np.sqrt(((mean - local) ** 2).mean()))
    assert stds[2] < WRONG_STD < stds[0]
    assert to_full[0] == pytest.approx(WRONG_FULL_STD, rel=0.1)
    assert max(to_full) == to_full[0]


def given_law(power, std=0.02, tried=1.0):
    exponent = Measured(value=power, std=std)
    return LawFromThrust(
        exponent=exponent,
        flown=exponent,
        hover=0.6,
        anchor=anchor_of(GIVEN, 600.0),
        given=GIVEN,
        trial=trial(tried, power),
    )


def test_a_wrong_law_is_bent_about_hover():
    """Its speed stays in hover; relative speeds, whose k_t is of full command, stay there."""
    assert anchor_of(GIVEN, 600.0) == 600.0
    assert anchor_of(replace(GIVEN, usual_speed=500.0), 600.0) == 500.0
    relative = MotorLaw(curve=PolynomialCurve((0.1, 0.9)))
    assert anchor_of(relative, 0.6) == 1.0
    command = np.array([0.2, 0.5, 1.0])
    was = speeds(GIVEN, command)
    now = speeds(given_law(1.2).law, command)
    assert now == pytest.approx(600.0 * (was / 600.0) ** 1.2)


def test_a_law_that_stays_is_the_one_given():
    kept = given_law(1.0, 0.01)
    assert not kept.from_flight
    assert kept.law.curve == GIVEN.curve
    assert kept.law.slope_std == pytest.approx(0.01)
    assert kept.law.speed_std == 0.0
    moved = given_law(1.2, tried=1.2)
    assert moved.from_flight
    assert moved.law.speed_std == pytest.approx(WRONG_FULL_STD * abs(np.log(0.6)))


def test_a_given_law_stands_until_a_deviation_speaks_against_it():
    assert given_law(1.05, 0.06).settled
    assert not given_law(1.05, 0.04).settled
    assert not given_law(1.05, 0.06, tried=1.04).settled


def test_a_contradicted_law_is_doubted_and_says_by_how_much(assert_wording):
    found = law_finding(given_law(0.8, 0.02, tried=0.8))
    assert found.severity == "doubt"
    assert "grows 20.0 +- 3.9" in found.sentence
    assert_wording(found.sentence)
    # In rad/s nothing is known of a speed; relative ones are the flight's, and hold.
    assert {"kt", "kd", "kd_over_Izz"} <= set(found.numbers)
    assert not {"max_thrust", "Ixx_com"} & set(found.numbers)
    relative = law_finding(replace(given_law(0.8, tried=0.8), given=RIGHT, anchor=1.0))
    assert relative.severity == "doubt" and not relative.numbers
    unsure = law_finding(given_law(1.03, 0.02, tried=1.03))
    assert unsure.severity == "note"
    assert "3.0 +- 3.9 % more" in unsure.sentence


def test_the_next_fit_is_far_enough_off_to_show_the_growth():
    near = given_law(1.02)
    assert near.next_power == pytest.approx(1.0 + FAR)
    assert given_law(1.3).next_power == 1.3
    assert replace(near, growth=0.2).next_power == 1.02


def test_the_sentence_says_whether_the_flight_showed_it(assert_wording):
    shown, unknown = (law_finding(law(ratio)) for ratio in (Measured(value=0.75, std=0.01), None))
    assert_wording(shown.sentence)
    assert "of 1.500 +- 0.039" in shown.sentence
    assert_wording(unknown.sentence)
    assert "of 1.60 +- 0.78" in unknown.sentence
    assert [e.name for e in unknown.evidence] == ["law_exponent"]
    assert shown.severity == unknown.severity == "note"


SETTING = MotorLaw(curve=SquareRootCurve(1.0, 0.65), stated=True)


def stated_law(flown, *, tried=1.0, hover=0.6):
    shown = None if flown is None else Measured(value=flown, std=0.02)
    return LawFromThrust(
        exponent=exponent_of(shown, SETTING),
        flown=shown,
        hover=hover,
        given=SETTING,
        setting="MOT_THST_EXPO",
        trial=Trial(power=tried, shown=shown),
    )


def test_a_setting_is_as_wide_as_real_motors():
    unseen, seen = (exponent_of(one, SETTING) for one in (None, Measured(value=0.8, std=0.02)))
    assert STATED_STD < unseen.std < 1.1 * STATED_STD
    assert seen.value == pytest.approx(0.8, abs=0.005)
    assert seen.std == pytest.approx(0.02, rel=0.05)
    # A law that somebody gave is another matter: .8 is one that is wrong.
    assert exponent_of(None, RIGHT).std < 0.01


@pytest.mark.parametrize("true", [0.2, 0.4, 0.9])
def test_full_thrust_is_held_whatever_the_setting(true):
    """Motors of another factor than the .65 that is set, hovering on commands of .3 to .6."""
    for command in (0.3, 0.45, 0.6):
        set_thrust, real = (f * command**2 + (1.0 - f) * command for f in (0.65, true))
        law = stated_law(None, hover=set_thrust**0.5)
        off = np.log(set_thrust / real)
        assert abs(off) < 1.96 * law.thrust_std
        assert 1.96 * law.thrust_std < 1.0


def test_a_flight_that_shows_a_setting_narrows_it():
    unseen, seen = stated_law(None), stated_law(1.0)
    assert seen.thrust_std < 0.55 * unseen.thrust_std
    assert seen.slope_std < 0.15 * unseen.slope_std


def test_a_setting_is_a_note_that_says_what_settles_it():
    unseen, seen, other = stated_law(None), stated_law(1.0), stated_law(0.8, tried=0.8)
    for law in (unseen, seen, other):
        found = law_finding(law)
        assert (found.kind, found.severity) == (STATED, "note")
        assert "MOT_THST_EXPO" in found.sentence and "known payload" in found.sentence
        assert found.numbers == ("thrust_to_weight", "max_thrust")
        assert f"open by {196 * law.thrust_std:.0f} %" in found.sentence
    assert "does not show whether" in law_finding(unseen).sentence
    assert "agrees with them" in law_finding(seen).sentence
    assert "grows 19.8 +- 3.9 % less" in law_finding(other).sentence


@pytest.mark.parametrize("flown", [-0.03, 0.0, 0.2])
def test_thrust_rises_in_every_fit_that_is_made(flown):
    """A flight whose gyro died, or with settings of another vehicle, shows falling thrust."""
    assert stated_law(flown).next_power == LEAST_POWER


@pytest.mark.parametrize(("flown", "doubted"), [(0.3, True), (0.7, False), (1.6, False)])
def test_settings_far_from_the_flight_are_doubted(flown, doubted):
    found = law_finding(stated_law(flown, tried=flown))
    assert found.severity == ("doubt" if doubted else "note")
    assert found.kind == (CONTRADICTED if doubted else STATED)
    assert ("kt" in found.numbers) == doubted
    assert {"thrust_to_weight", "max_thrust"} <= set(found.numbers)


def test_a_fit_that_lost_its_way_is_no_evidence():
    law = replace(law_after(0.63, 0.59), growth=0.1)
    assert law.has_lost(trial(0.59, 0.28))
    assert not law.has_lost(trial(0.59, 0.585))
    assert not replace(law, growth=None).has_lost(trial(0.59, 0.28))


def law_after(power, shown):
    at = trial(power, shown)
    return LawFromThrust(exponent=at.shown, flown=at.shown, hover=0.5, trial=at)
