"""Whether flights of one vehicle agree.

The flights of a configuration are each held against the others. They differ by chance, by weather
and by how they were flown; another propeller, load or vehicle makes more. A joint fit does not show
it: the flight that is more certain wins.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.measured import Measured, mean_scale
from rotorfit.findings import Finding, doubt
from rotorfit.fit.alternatives.flights_alone import EachAlone

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rotorfit.fit.fit import Fit
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.fit.joint.joint_problem import JointConfiguration

LOOKED_AT: Final = ("kt", "Ixx_over_kt", "Iyy_over_kt", "Izz_over_kt", "kd_over_Izz", "Jr_over_Izz")
LEAST_SHARE: Final = 0.05
"""Least share of a number by which a flight must differ from the others."""
SURE: Final = 3.9
"""Deviations by which it must: once in ten thousand by chance. Sound real flights make up to 1.1,
two vehicles 9 and more."""


def odd_flight(fit: Fit) -> Iterator[Finding]:
    """Check that every flight of a configuration agrees with the others."""
    found: list[tuple[float, str]] = []
    flights = {c.entry.name: c.flights for c in fit.dataset.configurations}
    fitted = fit.record_of(EachAlone)
    for alone in () if fitted is None else fitted.configurations:
        c = alone.configuration
        for k, own in alone.numbers.items():
            others = [numbers for other, numbers in alone.numbers.items() if other != k]
            file = Path(flights[c.name][k].entry.file).name
            found += [
                (size, f"{c.name}: {file}{words}")
                for size, words in _outlying_numbers(c, own, others)
            ]
    if found:
        size, words = max(found)
        yield doubt(
            "flight-differs",
            f"{words}, {size:.1f} standard deviations apart: its vehicle, load, propellers or "
            "battery differed from those of the other flights; identify it separately, or as a "
            "configuration of its own",
        )


def _outlying_numbers(
    c: JointConfiguration, own: Numbers, others: Sequence[Numbers]
) -> Iterator[tuple[float, str]]:
    """Yield the deviations by which a flight differs from the mean of the others, and a phrase."""
    for name in LOOKED_AT:
        full = name if name == "kt" else f"{name}@{c.name}"
        known = [n.number(full) for n in others if full in n.names]
        # All of `LOOKED_AT` are positive: a value below zero is of a flight that does not show it.
        scales = [
            Measured(value=value, std=half / 1.96)
            for value, half in known
            if np.isfinite(half) and half > 0 and value > 0
        ]
        if full not in own.names or not scales:
            continue
        value, half = own.number(full)
        others_mean = mean_scale(scales)
        mean = others_mean.value
        std = float(np.hypot(half / 1.96, others_mean.std))
        size = abs(value - mean) / std if np.isfinite(std) else 0.0
        if size > SURE and abs(value - mean) > LEAST_SHARE * abs(mean):
            yield size, f" gives {name} = {value:.3g}, the other flights {mean:.3g}"


CHECKS: Final = (odd_flight,)
