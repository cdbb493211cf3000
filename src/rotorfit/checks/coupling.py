"""Explain that the flights show no gyroscopic coupling, where a step of the fit has dropped it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rotorfit.findings import Evidence, Finding
from rotorfit.fit.coupling import AbsentCoupling

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rotorfit.fit.fit import Fit

KIND: Final = "no-coupling"
SENTENCE: Final = (
    "this flight shows no gyroscopic coupling, as in a simulator that leaves it out: turns about "
    "two axes do not act on the third. "
    "Izz, kd and Jr need it, and only their ratios are given; on a real vehicle check the gyro's "
    "axes, scale and clock"
)
REASON: Final = "the flight shows no gyroscopic coupling, which alone gives the scale of yaw"
ADVICE: Final = (
    "measure Izz or kd (pendulum, thrust stand), or fly in a simulator with gyroscopic terms "
    "(PX4's SIH, Gazebo, MuJoCo)"
)


def absent_coupling(fit: Fit) -> Iterator[Finding]:
    """Explain that the flights show no coupling, and which numbers it would give the scale."""
    found = fit.record_of(AbsentCoupling)
    if found is None:
        return
    yield Finding(
        kind=KIND,
        severity="doubt",
        sentence=SENTENCE,
        numbers=tuple(name for name in fit.numbers.names if name in fit.withheld),
        evidence=(Evidence(name="gain_without_coupling", value=found.gain, limit=found.least),),
        next_step=ADVICE,
        withheld_because=REASON,
    )
