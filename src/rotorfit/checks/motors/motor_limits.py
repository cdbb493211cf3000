"""Check whether commanded motors stood at the ends of their commands.

The step `allow_for_motor_limits` widens the intervals by their speeds there.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.findings import Evidence, Finding

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rotorfit.fit.dataset.dataset import LoadedFlight
    from rotorfit.fit.fit import Fit

LEAST_SHARE: Final = 0.02
"""Of the time of all motors at either end, from which it is said."""
SWINGING: Final = 3.0
"""Arrivals at an end, a second and motor, from which they are the loop's doing, not the pilot's."""
LIMITS: Final = "motors-at-limits"
GAINS: Final = (
    "the rate loop drives each of them to an end {arrivals:.0f} times a second (a limit cycle, or "
    "noise that it answers): lower the rate gains (P and D of roll and pitch)"
)
GENTLY: Final = "leave such parts out (start, end), or fly more gently"


def motors_at_limits(fit: Fit) -> Iterator[Finding]:
    """Check that commanded motors stay inside their limits; report the worst flight."""
    flights = [f for f in fit.dataset.flights if f.limits is not None]
    if fit.dataset.motors.speed != "commanded" or not flights:
        return
    worst = max(flights, key=lambda f: 0.0 if f.limits is None else f.limits.share)
    limits = worst.limits
    assert limits is not None
    said = limits.share >= LEAST_SHARE
    yield Finding(
        kind=LIMITS,
        severity=("doubt" if limits.arrivals >= SWINGING else "note") if said else "passed",
        sentence=_explain_limits(worst) if said else "",
        flights=(worst.entry.written,) if said else (),
        evidence=(Evidence(name="share_at_limits", value=limits.share, limit=LEAST_SHARE),),
    )


def _explain_limits(flight: LoadedFlight) -> str:
    """Explain how often the motors of a flight are at which end, and why."""
    limits = flight.limits
    assert limits is not None
    low, high = (100.0 * float(np.mean(each)) for each in (limits.lowest, limits.highest))
    swinging = limits.arrivals >= SWINGING
    return (
        f"{Path(flight.entry.file).name}: the motors are at their limits for {low + high:.0f} % of "
        f"the flight ({low:.0f} % at the lowest command, {high:.0f} % at the highest), where their "
        "speed is not what the law says; the intervals cover a few percent of it: "
        f"{GAINS.format(arrivals=limits.arrivals) if swinging else GENTLY}"
    )


CHECKS: Final = (motors_at_limits,)
