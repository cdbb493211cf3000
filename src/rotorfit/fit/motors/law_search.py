"""Fit with one motor law after the other, until a fit shows the law that it is made with."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final

from rotorfit.fit.dataset.load import ignore_progress
from rotorfit.fit.fit_flights import fit_flights
from rotorfit.fit.motors.law_from_thrust import (
    find_again,
    find_law,
    with_found_law,
    with_law,
)
from rotorfit.fit.noise_levels import fit_by_noise
from rotorfit.fit.timing.timing_fit import time_motors

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.fit.fit import Fit

MOST_LAWS: Final = 6
"""Fits with one law after the other."""


def fit_with_law(fit: Fit, wanted: Sequence[str] | None) -> Fit:
    """Fit with the law that the flight shows, until a fit shows the law it is made with."""
    law, fits = find_law(fit), 0
    if law is None:
        return fit
    dataset, terms = fit.dataset, fit.terms
    # Laws are tried with the terms and the rows' noise levels of the first fit, which hardly depend
    # on the law; both are found again with the law at the end.
    while not law.settled and fits < MOST_LAWS:
        tried, near = law, fit.dataset.motor_timing
        timed = time_motors(
            with_found_law(dataset, tried),
            lag=True,
            report=ignore_progress,
            near=near,
            terms=terms,
        )
        fit, fits = fit_flights(timed, terms), fits + 1
        law = find_again(tried, fit)
        if law.settled or fits == MOST_LAWS:
            fit = _fit_with_chosen_terms(fit, wanted)
            law, terms = find_again(tried, fit), fit.terms
    law = law.fitted
    found = dataclasses.replace(with_law(fit.dataset, law.law), law_found=law.from_flight)
    found = found.keeping_bands(fit.dataset)
    return dataclasses.replace(fit, dataset=found).with_record(law)


def _fit_with_chosen_terms(fit: Fit, wanted: Sequence[str] | None) -> Fit:
    """Choose terms and noise levels again at the timing and with the law of a fit."""
    levelled = fit_by_noise(fit, wanted)
    return fit_flights(fit.dataset, wanted) if levelled is fit else levelled
