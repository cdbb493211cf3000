"""Motors at their limits: what a loop that swings from end to end leaves open, and its name.

At its lowest and highest command a motor does what its law does not say: it coasts, or gives what
the battery has. Where commands tell the speed, those two speeds are as open as that.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Final, Literal

import numpy as np
from jaxtyping import Float

from rotorfit.dataset.dataset import Dataset, LoadedFlight
from rotorfit.diagnostics.motors.other_speeds import Speeds, shift_by_speeds, with_other_speeds
from rotorfit.findings import Evidence, Finding
from rotorfit.fit.fit import Fit
from rotorfit.fit.timing.timed_dataset import TimedDataset

LEAST_SHARE: Final = 0.02
"""Of the time of all motors at either end, from which it is said."""
LEAST_WIDENED: Final = 0.001
"""The same, from which the intervals hold it: less moves no number."""
OPEN: Final = 0.03
"""Deviation of the speeds at the ends, of the range of speeds that was flown: battery and coasting
make some per cent of a law."""
SWINGING: Final = 3.0
"""Arrivals at an end, a second and motor, from which they are the loop's doing, not the pilot's."""
LIMITS: Final = "motors-at-limits"
GAINS: Final = (
    "the rate loop drives each of them to an end {arrivals:.0f} times a second (a limit cycle, or "
    "noise that it answers): lower the rate gains (P and D of roll and pitch)"
)
GENTLY: Final = "leave such parts out (start, end), or fly more gently"

End = Literal["lowest", "highest"]


def allow_for_motor_limits(fit: Fit) -> Fit:
    """Widen the intervals by the speeds of commanded motors at the ends of their commands."""
    dataset = fit.dataset
    if dataset.motors.speed != "commanded" or _share(dataset) < LEAST_WIDENED:
        return fit
    ends: tuple[End, ...] = ("lowest", "highest")
    moved = [shift_by_speeds(fit, _with_end(dataset, end)) for end in ends]
    variance = fit.numbers.half_width**2 + sum(1.96**2 * shift**2 for shift in moved)
    return fit.with_half_width(np.sqrt(variance))


def motors_at_limits(fit: Fit) -> Iterator[Finding]:
    """Check that commanded motors stay inside their limits; report the worst flight."""
    flights = [f for c in fit.dataset.configurations for f in c.flights if f.limits is not None]
    if fit.dataset.motors.speed != "commanded" or not flights:
        return
    worst = max(flights, key=lambda f: 0.0 if f.limits is None else f.limits.share)
    limits = worst.limits
    assert limits is not None
    said = limits.share >= LEAST_SHARE
    yield Finding(
        kind=LIMITS,
        severity=("doubt" if limits.arrivals >= SWINGING else "note") if said else "passed",
        sentence=_sentence(worst) if said else "",
        flights=(worst.entry.written,) if said else (),
        evidence=(Evidence(name="share_at_limits", value=limits.share, limit=LEAST_SHARE),),
    )


def _sentence(flight: LoadedFlight) -> str:
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


def _share(dataset: Dataset) -> float:
    """Return the largest share of a flight's commands that stand at either end."""
    flights = [f for c in dataset.configurations for f in c.flights]
    return max((f.limits.share for f in flights if f.limits is not None), default=0.0)


def _with_end(dataset: TimedDataset, end: End) -> TimedDataset:
    """Return the flights with another speed where the commands are at one end."""

    def cut(speed: Speeds, flown: Float[np.ndarray, "m N"]) -> Speeds:
        low, high = float(flown.min()), float(flown.max())
        step = OPEN * (high - low)
        return np.maximum(speed, low + step) if end == "lowest" else np.minimum(speed, high - step)

    return with_other_speeds(dataset, cut)


CHECKS: Final = (motors_at_limits,)
