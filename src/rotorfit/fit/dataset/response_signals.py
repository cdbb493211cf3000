"""The signals by which a vehicle responds to its rotors, from the factors of a flight."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.signals import signal_layout

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.estimation.factors import Factors
    from rotorfit.model.vehicle import Vehicle

CLEAR = 0.3
"""A share of the angular acceleration that is explained beyond doubt."""
BAND = (0.3, 15.0)
"""Frequencies between which a vehicle responds to its rotors [Hz]."""
NEGLIGIBLE = 0.1
"""An unexplained share below which two declarations count as equal."""


@frozen_dataclass
class Response:
    """Signed share of each angular acceleration that the rotors explain (1: all, -1: reversed)."""

    roll: float
    pitch: float
    yaw: float

    @property
    def shares(self) -> Float[np.ndarray, " 3"]:
        """Roll, pitch, yaw."""
        return np.array([self.roll, self.pitch, self.yaw])

    @property
    def score(self) -> float:
        """Sum over the axes: 3 is perfect."""
        return float(self.shares.sum())

    @property
    def fits(self) -> bool:
        """Whether at least two axes are explained: one may be so by chance in a gusty hover."""
        return int((self.shares > CLEAR).sum()) >= 2

    def gain_over(self, other: Response) -> float:
        """Compute the factor by which the unexplained part is smaller, see `BETTER`."""
        left = np.maximum(1.0 - np.array([other.shares, self.shares]), NEGLIGIBLE)
        return float(np.log(left[0] / left[1]).sum())


def select_response_band(factors: Factors) -> Factors:
    """Return the factors of the band in which a vehicle responds to its rotors."""
    inside = (factors.band[:, 1] > BAND[0]) & (factors.band[:, 0] < BAND[1])
    return factors.select(inside) if inside.any() else factors


def inside_band(factors: Factors) -> Float[np.ndarray, "z z"]:
    """Return the factor of all blocks of that band."""
    return select_response_band(factors).total


def square_columns(vehicle: Vehicle) -> list[int]:
    """Return the places of the rotors' squared speeds among the signals."""
    layout = signal_layout(vehicle)
    return [layout.index(f"O2_{i + 1}") for i in range(len(vehicle.rotors))]


def rotor_patterns(vehicle: Vehicle) -> Float[np.ndarray, "N 4"]:
    """Return thrust, torques in roll and pitch, and drag torque, of each rotor's squared speed."""
    lift = vehicle.axes[:, 2]
    across = vehicle.levers[:, :2]
    return np.column_stack([lift, across, -vehicle.spins * lift])


def remove_parallel(
    columns: Float[np.ndarray, "z k"], from_: Float[np.ndarray, " z"]
) -> np.ndarray:
    """Return columns without their component along another column."""
    size = float(from_ @ from_)
    return columns if size == 0.0 else columns - np.outer(from_, from_ @ columns / size)


def cross_signals(
    R: Float[np.ndarray, "r z"], whole: Float[np.ndarray, "w z"], vehicle: Vehicle
) -> tuple[Float[np.ndarray, "r 2"], Float[np.ndarray, "r 2"]]:
    """Return torques and accelerations of roll and pitch, without what goes with the thrust.

    `R`: factor of the signals, of all blocks or one; `whole`: of all blocks.
    """
    layout = signal_layout(vehicle)
    columns = square_columns(vehicle)
    drives = rotor_patterns(vehicle)[:, :3]
    named = [layout.index("dwx"), layout.index("dwy")]
    own, every = (np.hstack([one[:, columns] @ drives, one[:, named]]) for one in (R, whole))
    thrust = every[:, 0]
    size = float(thrust @ thrust)
    along = thrust @ every[:, 1:] / size if size > 0.0 else np.zeros(4)
    rest: Float[np.ndarray, "r 4"] = own[:, 1:] - np.outer(own[:, 0], along)
    return rest[:, :2], rest[:, 2:]


def explained_share(y: Float[np.ndarray, " z"], D: Float[np.ndarray, "z d"]) -> float:
    """Compute the share of a signal that drives explain with any coefficients."""
    import scipy.linalg  # slow to import

    total = float(y @ y)
    if total == 0.0:
        return 0.0
    lengths = np.linalg.norm(D, axis=0)
    D = D / np.where(lengths > 0, lengths, 1.0)
    return float(y @ D @ scipy.linalg.pinv(D, rtol=1e-6) @ y) / total
