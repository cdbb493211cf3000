"""How far a number can be pulled by what the rotors do not explain, and whose motion helps.

The autopilot answers disturbances, so that rotor speeds are correlated with them: an estimate of
what the rotors do is pulled to one side by up to about 1.5 / rho of it, rho being explained over
residual power of the axis' angular acceleration (0.5 to 1.8 / rho on real flights). The roll and
pitch response k_t / I comes out too small, so that a share of the inertia found bounds the error.
k_d / I_zz and J_r / I_zz themselves come out too small: there the share is of the true value.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

ATTENUATION: Final = 1.5
"""Largest pull, as a share over rho."""
LEAST_EXCITATION: Final = 5.0
"""Below this rho, disturbances are no longer small against the pilot, and that is what limits."""

AXIS_OF: Final[Mapping[str, str]] = {
    **{name: "roll" for name in ("Ixx", "Ixx_com", "Ixx_over_kt", "Ixy", "Ixy_com")},
    **{name: "roll" for name in ("Ixz", "Ixz_com")},
    **{name: "pitch" for name in ("Iyy", "Iyy_com", "Iyy_over_kt", "Iyz", "Iyz_com")},
    **{name: "yaw" for name in ("Izz", "Izz_com", "Izz_over_kt", "kd", "kd_over_kt", "Jr")},
    **{name: "yaw" for name in ("kd_over_Izz", "Jr_over_Izz")},
}
"""Whose excitation decides how far a number can be trusted."""


def attenuation_allowance(axis: str, size: float, rho: float) -> float:
    """Return the half-width that lack of excitation adds, infinite where it bounds nothing.

    Parameters
    ----------
    axis
        roll, pitch or yaw.
    size
        Of the number, or a size of it that matters where it is near zero.
    rho
        Explained over residual power of the axis' angular acceleration.
    """
    share = ATTENUATION / max(rho, np.finfo(float).tiny)
    if axis != "yaw":
        return share * abs(size)
    return share / (1.0 - share) * abs(size) if share < 1.0 else float("inf")
