"""The signals by which a vehicle responds to its rotors, from the factors of a flight."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.model.signals import signal_layout

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.estimation.factors import Factors
    from rotorfit.model.vehicle import Vehicle

CLEAR = 0.3
"""A share of the angular acceleration that is explained beyond doubt."""
BAND = (0.3, 15.0)
"""Frequencies between which a vehicle responds to its rotors [Hz]."""


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
