"""Find the lag with which commanded motors explain the turns of a flight best."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.reduction.frequency_bands import banded_data, prepared_bands, slow_bands
from rotorfit.fit.reduction.reduce import body_lines
from rotorfit.fit.row_fits import angular_log_likelihood
from rotorfit.fit.timing.timing_search import CLEAR_GAIN
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from rotorfit.estimation.factors import Factors
    from rotorfit.fit.reduction.reduce import Lines
    from rotorfit.flight.motors.motor_model import MotorResponse
    from rotorfit.flight.prepare import PreparedFlight
    from rotorfit.model.regressor import Regressor
    from rotorfit.model.vehicle import Vehicle

LAGS: Final = (0.01, 0.02, 0.035, 0.05, 0.065, 0.08, 0.1, 0.13)
"""Lags of commanded motors, tried one by one [s]."""


@frozen_dataclass
class TriedLag:
    """The factors of a flight whose motors follow with one lag."""

    response: MotorResponse
    factors: Factors


def lines_of_body(prepared: PreparedFlight) -> tuple[Lines, ...]:
    """Transform the signals that are the same for every vehicle and every timing of its motors."""
    data, plan = banded_data(prepared, None)
    return body_lines(data, plan=plan)


def tried_lags(
    prepared: PreparedFlight,
    vehicle: Vehicle,
    motors: MotorResponse,
    *,
    body: tuple[Lines, ...],
) -> tuple[TriedLag, ...]:
    """Reduce a flight at each lag; `motors` has the delay, `body` the lines of the body."""
    responses = (replace(motors, lag=lag) for lag in LAGS)
    return tuple(
        TriedLag(response=one, factors=prepared_bands(prepared, vehicle, one, body=body))
        for one in responses
    )


def best_lag(tried: tuple[TriedLag, ...], model: Regressor) -> TriedLag | None:
    """Select the lag that explains the turns best in the pilot's band; None at either end."""
    best = max(tried, key=lambda one: turn_likelihood(one.factors, model))
    # At either end the autopilot responds to gyro noise or gusts.
    return None if best is tried[0] or best is tried[-1] else best


def clearer_lag(tried: tuple[TriedLag, ...], model: Regressor, usual: TriedLag) -> TriedLag:
    """Select the lag of all bands where the usual one is clearly wrong, as an estimate does."""
    among = (usual, *tried)
    gains = [turn_likelihood(one.factors, model, every=True) for one in among]
    best = int(np.argmax(gains))
    return among[best] if gains[best] - gains[0] > CLEAR_GAIN else usual


def turn_likelihood(factors: Factors, model: Regressor, *, every: bool = False) -> float:
    """Compute the log-likelihood of the turns in the pilot's band, or in every one."""
    counted = slow_bands(factors) | every
    return angular_log_likelihood(factors, model, mass=1.0, counted=counted)
