"""Fit each flight of a configuration by itself: a joint fit does not show whether they agree."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from rotorfit.errors import EstimationError
from rotorfit.fit.intervals.joint_numbers import joint_numbers
from rotorfit.fit.joint.closed_loop import NOMINAL_RESPONSE
from rotorfit.fit.joint.joint_fit import INTERMEDIATE
from rotorfit.fit.joint.joint_problem import joint_estimate, only
from rotorfit.fit.joint.trims import TRIM
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rotorfit.estimation.banded import BandedEstimate
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.fit.joint.joint_problem import JointConfiguration

EQUATIONS_EACH: Final = 2.0
"""Equations per free parameter of a flight that is informative by itself."""


@frozen_dataclass
class FlightsAlone:
    """The numbers of a configuration's flights, each by itself, by their places in it."""

    configuration: JointConfiguration
    numbers: Mapping[int, Numbers]


@frozen_dataclass
class EachAlone:
    """The flights of every configuration that has several, each by itself."""

    configurations: tuple[FlightsAlone, ...]


def fit_each_alone(fit: Fit) -> Fit:
    """Record the numbers of each flight of a configuration by itself."""
    return fit.with_record(
        EachAlone(
            configurations=tuple(
                FlightsAlone(
                    configuration=c,
                    numbers=dict(_fit_flights_alone(c, fit.estimate, len(configured.flights))),
                )
                for configured, c in zip(
                    fit.dataset.configurations, fit.configurations, strict=True
                )
                if len(configured.flights) >= 2 and c.payload_of is None
            )
        )
    )


def _fit_flights_alone(
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
            alone = joint_estimate([one], [], begin=begin, close=INTERMEDIATE)
            yield k, joint_numbers(alone, [one], {c.name: 0.0})
        except EstimationError:
            continue  # too short or too still to be informative by itself


def _is_of(name: str, configuration: str) -> bool:
    """Return whether a parameter belongs to a flight of a configuration that is fitted alone."""
    owner = name.partition("@")[2]
    return not name.startswith(TRIM) and owner in ("", configuration)
