"""How often motor commands stand at their lowest or highest value, where no loop can go further."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.logs.flight_log import Channel

AT: Final = 1e-4
"""Of the range of the commands: two that differ by less are the same."""
ALONGSIDE: Final = 0.03
"""Of the range next to an end: where the end is a limit, more commands stand at it than there."""
ALONGSIDE_STEPS: Final = 4.0
"""The same of coarse commands, in steps of theirs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorLimits:
    """What of a flight the motors spend at the ends of their commands.

    Attributes
    ----------
    lowest, highest
        Share of the time of each motor, in the log's order.
    arrivals
        How often a second a motor comes to an end, on average [Hz].
    """

    lowest: tuple[float, ...]
    highest: tuple[float, ...]
    arrivals: float

    @property
    def share(self) -> float:
        """Of the time of all motors, at either end."""
        return float(np.mean(self.lowest) + np.mean(self.highest))


def motor_limits(command: Channel, spans: Sequence[tuple[float, float]]) -> MotorLimits | None:
    """Measure how often commands stand at their ends in flight; None where none were logged."""
    inside: Bool[np.ndarray, " n"] = np.isfinite(command.values).min(axis=1)
    flown = np.zeros(len(command.time), dtype=bool)
    for begin, end in spans:
        flown |= (command.time >= begin) & (command.time <= end)
    values = command.values[inside & flown]
    seconds = sum(end - begin for begin, end in spans)
    if not len(values) or seconds <= 0.0:
        return None
    low, high = at_ends(values)
    ends = low | high
    arrived = np.count_nonzero(ends[1:] & ~ends[:-1]) / values.shape[1]
    return MotorLimits(
        lowest=tuple(low.mean(axis=0).tolist()),
        highest=tuple(high.mean(axis=0).tolist()),
        arrivals=arrived / seconds,
    )


def at_ends(
    values: Float[np.ndarray, "n N"],
) -> tuple[Bool[np.ndarray, "n N"], Bool[np.ndarray, "n N"]]:
    """Mark the commands at the lowest and at the highest value of all motors, where it is a limit.

    One at which they pile up: a command that merely turns round there passes through what is
    beside it, too.
    """
    reach = float(np.ptp(values))
    steps = np.abs(np.diff(values, axis=0))
    step = float(steps.min(initial=reach, where=steps > AT * reach))
    ends: list[Bool[np.ndarray, "n N"]] = []
    for end in (float(values.min()), float(values.max())):
        away = np.abs(values - end)
        at = away <= 0.5 * min(step, ALONGSIDE * reach)
        alongside = ~at & (away <= max(ALONGSIDE * reach, ALONGSIDE_STEPS * step))
        piled = reach > 0.0 and np.count_nonzero(at) > max(np.count_nonzero(alongside), 1)
        ends.append(at if piled else np.zeros_like(at))
    return ends[0], ends[1]
