"""What is open of k_t is in every interval, and of the law in what goes with changes of thrust."""

import dataclasses

import numpy as np
import pytest

import made_fit
from rotorfit.errors import UnsettledError
from rotorfit.estimation.measured import Measured
from rotorfit.fit import fit as fitting
from rotorfit.fit import fit_flights
from rotorfit.fit.weight import weigh_thrust as steps
from rotorfit.fit.weight.flight_weights import FlightWeight
from rotorfit.fit.weight.weigh_thrust import held_at, kt_from_changes, kt_of

FLIGHTS = made_fit.dataset(made_fit.prepared())


def fit(values, half_width):
    numbers = made_fit.no_numbers("kt", "kd", values=values, half_width=half_width)
    return made_fit.fit(FLIGHTS, numbers)


ONE = fit([10.0, 4.0], [0.5, 3.0])


def test_a_deviation_is_half_of_an_interval_over_1_96():
    assert kt_of(fit([10.0, 0.0], [0.98, 1.0]).numbers) == pytest.approx((10.0, 0.5))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_open_of_kt_is_in_every_interval(monkeypatch, sign):
    """Another fit a deviation away: kt by .2 and kd by 1.1, 1.96 times of which is open."""
    tried = held_by(monkeypatch, lambda step: sign * np.array([step, 1.1 * step / 0.2]))
    held = held_at(ONE, Measured(value=10.0, std=0.2))
    assert tried == [10.0, 9.8]
    assert held.numbers.values.tolist() == [10.0, 4.0]
    assert held.numbers.half_width == pytest.approx(np.hypot([0.5, 3.0], [1.96 * 0.2, 1.96 * 1.1]))
    together = 1.96**2 * 0.2 * 1.1 / np.prod(held.numbers.half_width)
    assert held.numbers.correlation[0, 1] == pytest.approx(together)


def held_by(monkeypatch, moves):
    """Replace the fits of `held_at`; return the k_t at which they were asked for."""
    tried = []

    def refit(fit, dataset, *, begin, known):
        tried.append(known["kt"][0])
        return dataclasses.replace(fit, numbers=ONE.numbers)

    def shift(fit, dataset, *, begin, known):
        tried.append(pytest.approx(known["kt"][0]))
        return moves(known["kt"][0] - 10.0)

    for name, made in (("refit", refit), ("shift_of", shift)):
        monkeypatch.setattr(fitting, name, made)
    monkeypatch.setattr(fit_flights, "allow_for_settings", lambda fit: fit)
    return tried


def test_changes_are_open_by_what_propellers_do_in_motion(monkeypatch):
    monkeypatch.setattr(fitting, "refit", lambda fit, dataset, **_: ONE)
    found = kt_from_changes(ONE)
    assert found.value == 10.0
    assert found.std == pytest.approx(np.hypot(0.5 / 1.96, 0.02 * 10.0))


@pytest.mark.parametrize("open_share", [0.0, 0.02, 0.05])
def test_no_flight_limits_what_the_air_leaves_open(monkeypatch, open_share):
    """One flight weighs to 1 % in still air; the air's share of it is no better known for that."""
    still, held = Measured(value=10.0, std=0.1), []
    monkeypatch.setattr(steps, "thrust_shares", lambda numbers, vehicle: None)
    monkeypatch.setattr(steps, "_weigh_flights", lambda fit, shares: ([], still, open_share))
    monkeypatch.setattr(
        steps, "_weights_by_flight", lambda *_: [FlightWeight(file="one", kt=still)]
    )
    monkeypatch.setattr(steps, "kt_from_changes", lambda fit: None)
    monkeypatch.setattr(steps, "held_at", lambda fit, kt: held.append(kt) or fit)
    steps.weigh_thrust(ONE)
    assert held[0].share == pytest.approx(np.hypot(0.01, open_share))


def test_flights_that_do_not_settle_leave_the_weight(monkeypatch):
    def refit(fit, dataset, **_):
        raise UnsettledError("no")

    monkeypatch.setattr(fitting, "refit", refit)
    assert kt_from_changes(ONE) is None
