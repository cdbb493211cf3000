"""The law from command to speed, where only the flight shows it."""

import numpy as np
import pytest

from rotorfit.dataset.carried_weight import Measured
from rotorfit.diagnostics.motors.law_from_flight import (
    FULL_STD,
    STEADY,
    USUAL,
    FoundLaw,
    Trial,
    exponent_of,
    thrust_ratio,
)
from rotorfit.experiment.law_table import speed_law_of
from rotorfit.preprocessing.motors.motor_model import speeds


def test_the_ratio_has_the_uncertainty_of_both():
    ratio = thrust_ratio(Measured(value=6.0, std=0.3), Measured(value=8.0, std=0.4))
    assert ratio.value == 0.75
    assert ratio.std == pytest.approx(0.75 * 0.05 * 2**0.5)
    assert thrust_ratio(None, Measured(value=8.0, std=0.4)) is None
    assert thrust_ratio(Measured(value=8.0, std=0.4), None) is None


def test_the_exponent_is_the_usual_until_a_flight_shows_it():
    assert exponent_of(None) == USUAL
    sure = exponent_of(Measured(value=0.5, std=0.01))
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
    return FoundLaw(exponent=exponent_of(ratio), flown=ratio, hover=hover)


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
        return FoundLaw(exponent=exponent, flown=at.shown, hover=0.5, trial=at)

    assert after(0.504).settled and after(0.496).settled
    assert not after(0.51).settled and not after(0.49).settled
    assert law(None).settled
    # Where it stays open, the law is that of the fit, and as far open as the next step is long.
    assert after(0.62).fitted.exponent.value == pytest.approx(0.62)
    assert after(0.62).fitted.exponent.std == pytest.approx(0.13)


def test_a_found_law_is_a_power_of_the_command_up_to_one():
    entry = law(Measured(value=0.75, std=0.01)).entry
    command = np.array([0.25, 1.0])
    exponent = exponent_of(Measured(value=0.75, std=0.01)).value
    assert speeds(speed_law_of(entry), command) == pytest.approx([0.25**exponent, 1.0])
    assert entry.slope_std == pytest.approx(0.01 / 0.75, rel=0.02)
    assert entry.speed_std == pytest.approx(FULL_STD * np.log(2.0))


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


def test_the_sentence_says_whether_the_flight_showed_it():
    shown, unknown = (law(ratio).finding for ratio in (Measured(value=0.75, std=0.01), None))
    assert "weight and changes of thrust show that thrust grows with the command" in shown.sentence
    assert "to the power of 1.50 +- 0.04" in shown.sentence
    assert "this flight does not show it either" in unknown.sentence
    assert "to the power of 1.60 +- 0.78" in unknown.sentence
    assert [e.name for e in unknown.evidence] == ["law_exponent"]
    assert shown.severity == unknown.severity == "note"
