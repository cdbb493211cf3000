"""What each rotor does to the body, per squared rotor speed and per rotor acceleration.

With thrust kt w^2 along n at r from the CoM, drag torque -s kd w^2 n and the counter-torque
-s Jr dw/dt n of a rotor that is spun up (s = +1: ccw), specific force is F / m, and angular
acceleration I^-1 tau. These are G1 and G2 of incremental nonlinear dynamic inversion (Smeur, Chu
and de Croon, J. of Guidance, Control, and Dynamics 39(3), 2016), before a firmware's own units.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.export.file_format import frd
from rotorfit.export.vehicle import VehicleModel

LEVELS: Final = (2.5, 97.5)
"""Percentiles of drawn vehicles: the ends of a 95 % interval."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Effectiveness:
    """Body axes FRD, one column a rotor.

    Attributes
    ----------
    force
        Specific force over squared speed [m/s^2 per (rad/s)^2].
    turn
        Angular acceleration over squared speed [rad/s^2 per (rad/s)^2].
    spin_up
        Angular acceleration over that of the rotor [1]; None where Jr is not known.
    """

    force: Float[np.ndarray, "3 N"]
    turn: Float[np.ndarray, "3 N"]
    spin_up: Float[np.ndarray, "3 N"] | None


def effectiveness(model: VehicleModel) -> Effectiveness:
    """Compute the effect of the rotors on their vehicle."""
    kt = np.array([rotor.kt for rotor in model.rotors])[:, None]
    axes = np.array([rotor.axis for rotor in model.rotors])
    along = np.array([rotor.spin for rotor in model.rotors])[:, None] * axes
    inverse = np.linalg.inv(model.inertia_com)
    torques = kt * np.cross(model.arms, axes) - model.kd * along
    return Effectiveness(
        force=frd(kt * axes / model.mass).T,
        turn=frd(torques @ inverse).T,
        spin_up=None if model.Jr is None else frd(-model.Jr * along @ inverse).T,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Numbers of the estimated vehicle, with the ends of 95 % intervals from drawn ones."""

    value: Float[np.ndarray, "r c"]
    low: Float[np.ndarray, "r c"] | None = None
    high: Float[np.ndarray, "r c"] | None = None

    def row_text(self, row: int) -> str:
        """Write the numbers of a row one after the other, each with its interval."""
        values = self.value[row].tolist()
        if self.low is None or self.high is None:
            return ", ".join(f"{value:.4g}" for value in values)
        rows = zip(values, self.low[row].tolist(), self.high[row].tolist(), strict=True)
        return ", ".join(f"{value:.4g} ({low:.4g} to {high:.4g})" for value, low, high in rows)


def spread(
    of: Callable[[VehicleModel], Float[np.ndarray, "r c"]],
    model: VehicleModel,
    drawn: Sequence[VehicleModel],
) -> Spread:
    """Evaluate numbers of a vehicle, with intervals from vehicles drawn around it."""
    if not drawn:
        return Spread(value=of(model) + 0.0)
    # + 0.0: no minus before a zero.
    low, high = np.percentile([of(one) for one in drawn], LEVELS, axis=0) + 0.0
    return Spread(value=of(model) + 0.0, low=low, high=high)
