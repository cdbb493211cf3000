"""The vehicle between the controller's output and the rate that it hears."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Float

from rotorfit.control_loop.filters import hold


def from_lag(
    lag: Float[np.ndarray, " D"], delay: Float[np.ndarray, " D"]
) -> tuple[Float[np.ndarray, " D"], Float[np.ndarray, " D"]]:
    """Take from the lag what a delay is below zero [s]; their sum stays."""
    less = np.minimum(np.maximum(-delay, 0.0), np.maximum(lag, 0.0))
    return lag - less, delay + less


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """One axis of D vehicles, the nominal one first, hovering.

    Attributes
    ----------
    gain
        Angular acceleration per output [rad/s^2].
    damping
        Rate that air drag takes off per time [1/s].
    lag, delay
        Of the motors, without what the filter of the gyro adds [s].
    """

    gain: Float[np.ndarray, " D"]
    damping: Float[np.ndarray, " D"]
    lag: Float[np.ndarray, " D"]
    delay: Float[np.ndarray, " D"]

    @property
    def spread(self) -> Float[np.ndarray, "2 D"]:
        """Logarithm of the gain, and lag with delay [s], each over those of the nominal one."""
        late = self.lag + self.delay
        return np.stack([np.log(self.gain / self.gain[0]), late - late[0]])

    @property
    def nominal(self) -> "Plant":
        """The first of them alone."""
        first = slice(0, 1)
        return Plant(
            gain=self.gain[first],
            damping=self.damping[first],
            lag=self.lag[first],
            delay=self.delay[first],
        )

    def moved(self, gain: Float[np.ndarray, " D"], late: Float[np.ndarray, " D"]) -> "Plant":
        """Return the vehicles with the logarithm of their gain and their delay [s] changed."""
        lag, delay = from_lag(self.lag, self.delay + late)
        return replace(self, gain=self.gain * np.exp(gain), lag=lag, delay=delay)

    def response(
        self, frequency: Float[np.ndarray, " f"], period: float
    ) -> Complex[np.ndarray, "D f"]:
        """Compute the rate [rad/s] over an output that is held for a period [s]."""
        s = 2j * np.pi * frequency[None, :]
        gain, damping, lag, delay = (
            values[:, None] for values in (self.gain, self.damping, self.lag, self.delay)
        )
        return (
            hold(frequency, period) * gain * np.exp(-s * delay) / ((s + damping) * (1.0 + lag * s))
        )
