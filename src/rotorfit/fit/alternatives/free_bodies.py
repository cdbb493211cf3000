"""Fit the bodies with and without a known payload freely, as if nobody had weighed it."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from rotorfit.fit.fit import numbers_of
from rotorfit.fit.joint.joint_problem import joint_estimate
from rotorfit.fit.row_fits import fit_rows
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.intervals.numbers import Numbers


@frozen_dataclass
class FreeBodies:
    """The numbers of all bodies without what is known of their payloads."""

    numbers: Numbers


def fit_free_bodies(fit: Fit) -> Fit:
    """Record what the flights say of every body where a payload is declared."""
    if all(c.payload_of is None for c in fit.configurations):
        return fit
    free = [dataclasses.replace(c, payload=(), payload_of=None) for c in fit.configurations]
    estimate = joint_estimate(free, [fit_rows(c.factors, c.model, mass=c.mass) for c in free])
    return fit.with_record(FreeBodies(numbers=numbers_of(fit.dataset, estimate, free)))
