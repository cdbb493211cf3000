"""Do the flights of a configuration tell of one vehicle? Each by itself against the others.

Flights of one vehicle differ by chance, by weather and by how they were flown; another propeller,
load or vehicle makes more. A joint fit does not show it: the flight that is surer wins.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.estimation.banded import BandedEstimate
from rotorfit.findings import Finding, doubt
from rotorfit.fit.fit import Fit
from rotorfit.fit.intervals.joint_numbers import joint_numbers
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.joint.closed_loop import NOMINAL_RESPONSE
from rotorfit.fit.joint.joint_fit import NEAR
from rotorfit.fit.joint.joint_problem import JointConfiguration, joint_estimate, only
from rotorfit.fit.joint.trims import TRIM

LOOKED_AT: Final = ("kt", "Ixx_over_kt", "Iyy_over_kt", "Izz_over_kt", "kd_over_Izz", "Jr_over_Izz")
LEAST_SHARE: Final = 0.05
"""Of a number, by which a flight must differ from the others."""
SURE: Final = 3.9
"""Deviations by which it must: once in ten thousand by chance. Sound real flights make up to 1.1,
two vehicles 9 and more."""
EQUATIONS_EACH: Final = 2.0
"""Per free parameter, of a flight that tells anything by itself."""


def odd_flight(fit: Fit) -> Iterator[Finding]:
    """Check that every flight of a configuration agrees with the others."""
    found: list[tuple[float, str]] = []
    for configured, c in zip(fit.dataset.configurations, fit.configurations, strict=True):
        if len(configured.flights) < 2 or c.payload_of is not None:
            continue
        alone = dict(_alone(c, fit.estimate, len(configured.flights)))
        for k, own in alone.items():
            others = [numbers for other, numbers in alone.items() if other != k]
            file = Path(configured.flights[k].entry.file).name
            found += [
                (size, f"{c.name}: {file}{words}") for size, words in _outlying(c, own, others)
            ]
    if found:
        size, words = max(found)
        yield doubt(
            "flight-differs",
            f"{words}, {size:.1f} standard deviations apart: its vehicle, load, propellers or "
            "battery differed from those of the other flights; identify it separately, or as a "
            "configuration of its own",
        )


def _alone(
    c: JointConfiguration, fit: BandedEstimate, flights: int
) -> Iterator[tuple[int, Numbers]]:
    """Yield the numbers of each flight by itself, where they are identifiable."""
    begin = fit.estimate.by_name
    free = sum(_is_of(name, c.name) for name in begin)
    for k in range(flights):
        own = c.factors.recording == k
        if own.sum() * len(fit.problem.noisy) < EQUATIONS_EACH * free:
            continue
        one = only(replace(c, response=NOMINAL_RESPONSE), own)
        try:
            alone = joint_estimate([one], [], begin=begin, close=NEAR)
            yield k, joint_numbers(alone, [one], {c.name: 0.0})
        except EstimationError:
            continue  # too short or too still a flight to tell anything by itself


def _is_of(name: str, configuration: str) -> bool:
    """Return whether a parameter belongs to a flight of a configuration that is fitted alone."""
    owner = name.partition("@")[2]
    return not name.startswith(TRIM) and owner in ("", configuration)


def _outlying(
    c: JointConfiguration, own: Numbers, others: Sequence[Numbers]
) -> Iterator[tuple[float, str]]:
    """Yield the deviations by which a flight differs from the mean of the others, and a phrase."""
    for name in LOOKED_AT:
        full = name if name == "kt" else f"{name}@{c.name}"
        known = [n.number(full) for n in others if full in n.names]
        known = [(value, half) for value, half in known if np.isfinite(half) and half > 0]
        if full not in own.names or not known:
            continue
        value, half = own.number(full)
        weights = np.array([half**-2.0 for _, half in known])
        mean = float(weights @ np.array([v for v, _ in known]) / weights.sum())
        std = float(np.hypot(half, weights.sum() ** -0.5)) / 1.96
        size = abs(value - mean) / std if np.isfinite(std) else 0.0
        if size > SURE and abs(value - mean) > LEAST_SHARE * abs(mean):
            yield size, f" gives {name} = {value:.3g}, the other flights {mean:.3g}"


CHECKS: Final = (odd_flight,)
