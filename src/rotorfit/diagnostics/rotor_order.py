"""Refuse declared rotors that do not explain the motion at the lag that the fit finds.

Before the fit the lag of commanded motors is open, and a declaration that one of several lags
allows is fitted. Of a wrong order that is often the longest, at which no rotors explain much.
"""

import dataclasses
from collections.abc import Iterable
from typing import Final

from rotorfit.dataset.checks.declared_rotors import check_flight
from rotorfit.findings import Finding
from rotorfit.fit.fit import Fit
from rotorfit.preprocessing.motors.motor_model import MotorResponse


def refuse_at_found_lag(fit: Fit) -> Iterable[Finding]:
    """Refuse rotors that a flight contradicts at every lag in the interval that the fit found."""
    tried = found_lags(fit)
    if tried and fit.dataset.timing_identifiable:
        for configuration in fit.dataset.configurations:
            for flight in configuration.flights:
                check_flight(flight, fit.dataset.vehicle, tried)
    return ()


def found_lags(fit: Fit) -> list[MotorResponse]:
    """Return the responses of commanded motors with the found lag and the ends of its interval."""
    timing = fit.dataset.motor_timing
    if timing is None or timing.lag_std is None or fit.dataset.motors.speed == "measured":
        return []
    lag, half = timing.response.mean_lag, 1.96 * timing.lag_std
    return [
        dataclasses.replace(timing.response, lag=max(one, 0.0), lag_down=None)
        for one in (lag, lag - half, lag + half)
    ]


REFUSALS: Final = (refuse_at_found_lag,)
