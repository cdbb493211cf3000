"""Where a search has lost the motors' lag, every usual one is tried that is not surely worse."""

from types import SimpleNamespace

import pytest

from rotorfit.fit.timing import timing_fit
from rotorfit.fit.timing.timed_fit import TimedFit
from rotorfit.fit.timing.timing_fit import LONGER_LAGS, SURE_LOSS
from rotorfit.flight.motors.motor_model import MotorResponse


class Tried(TimedFit):
    """A fit at given times of the motors."""

    @property
    def ended(self):
        return self.dataset.response

    @property
    def free(self):
        return SimpleNamespace(names=("motor_delay",))

    @property
    def values(self):
        return {}


class Likelihoods:
    """Flights whose log-likelihood is given by the motors' lag."""

    def __init__(self, by_lag, response=None, tried=()):
        self.by_lag, self.response, self.tried = by_lag, response, tried

    def at(self, response, names):
        self.tried.append(response.lag)
        return self.fit(response)

    def fit(self, response):
        flights = Likelihoods(self.by_lag, response, self.tried)
        flights.at = self.at
        likelihood = SimpleNamespace(log_likelihood=self.by_lag[response.lag])
        return Tried(flights, likelihood, ())


@pytest.fixture
def likeliest(monkeypatch):
    monkeypatch.setattr(timing_fit, "fit_at", lambda dataset, terms, begin: dataset)
    monkeypatch.setattr(timing_fit, "settled_fit", lambda begun, terms: begun)

    def found(without, *longer):
        by_lag = {0.0: without, **dict(zip(LONGER_LAGS, longer, strict=True))}
        flights = Likelihoods(by_lag, tried=[])
        late = flights.fit(MotorResponse(lag=0.0, delay=0.017))
        best = timing_fit._likeliest_longer_lag(late, ())
        return None if best is None else best.ended, flights.tried

    return found


def test_a_lag_beyond_one_that_is_worse_is_found(likeliest):
    best, tried = likeliest(-3818.0, -3958.0, -3883.0, -3580.0)
    assert best.lag == LONGER_LAGS[2]
    assert best.lag + best.delay == pytest.approx(0.017)
    assert tried == list(LONGER_LAGS)


def test_motors_that_have_none_cost_one_trial(likeliest):
    best, tried = likeliest(0.0, -SURE_LOSS - 20.0, 100.0, 100.0)
    assert best is None
    assert tried == [LONGER_LAGS[0]]


def test_all_that_are_worse_leave_none(likeliest):
    assert likeliest(0.0, -140.0, -65.0, -200.0)[0] is None
    assert likeliest(0.0, 30.0, 50.0, 40.0)[0].lag == LONGER_LAGS[1]
