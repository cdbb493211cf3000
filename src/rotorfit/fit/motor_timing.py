"""What is known of the motors' timing: lag, delay, and how far the flights tell them."""

from dataclasses import dataclass
from typing import Final

from rotorfit.flight.motors import MotorResponse

LAG_PRIOR: Final = (0.035, 0.03)
"""Mean and deviation of a motor's time constant before the flight [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorTiming:
    """What the flights tell of the motors' timing.

    Attributes
    ----------
    response
        Lag and delay, found or given [s].
    lag_std, delay_std
        Their standard deviations [s]; None for what was given or has no meaning.
    total_std
        Standard deviation of lag plus delay [s].
    """

    response: MotorResponse
    total_std: float
    lag_std: float | None = None
    delay_std: float | None = None

    @property
    def told(self) -> bool:
        """Whether lag plus delay is known better than by its own size, or by motors' usual lag."""
        return told(self.response.mean_lag + self.response.delay, self.total_std)


def told(value: float, std: float) -> bool:
    """Return whether a time is known better than by its own size, or by motors' usual lag.

    Parameters
    ----------
    value, std
        [s]
    """
    return 1.96 * std <= max(abs(value), LAG_PRIOR[0])
