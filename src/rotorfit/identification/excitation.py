"""How far a number can be pulled by what the rotors do not explain, and whose motion helps.

The autopilot answers disturbances, so that rotor speeds are correlated with them, and an estimate
of what the rotors do is pulled to one side: by a share of it that goes with 1 / rho, rho being
explained over residual power of the axis' angular acceleration where a pilot moves the vehicle.
Measured on simulated flights (another rigid-body engine, gusts and sticks of many sizes) and on
real ones: the roll and pitch inertia come out too large by up to 2.5 / rho, by 1.5 / rho where the
likelihood has a term for the answer (`steering.py`); k_d / I_zz and J_r / I_zz too small by up to
1.5 / rho; and the scale of I_zz and k_d, which hangs on small terms, is off by up to 3 / rho either
way.
"""

from collections.abc import Mapping
from typing import Final

from rotorfit.identification.bands import LEAST_RATIO

INERTIA_PULL: Final = 2.5
ANSWERED_PULL: Final = 1.5
RATIO_PULL: Final = 1.5
SCALE_PULL: Final = 3.0
"""Largest pulls, as shares of the true value times rho."""
NO_EXCITATION: Final = 1.5
"""Below this rho an axis tells of the disturbances, not of the vehicle."""
LEAST_EXCITATION: Final = 5.0
"""Below this, disturbances are no longer small against the pilot, and that is what limits."""

AXIS_OF: Final[Mapping[str, str]] = {
    **{name: "roll" for name in ("Ixx", "Ixx_com", "Ixx_over_kt", "Ixy", "Ixy_com")},
    **{name: "roll" for name in ("Ixz", "Ixz_com")},
    **{name: "pitch" for name in ("Iyy", "Iyy_com", "Iyy_over_kt", "Iyz", "Iyz_com")},
    **{name: "yaw" for name in ("Izz", "Izz_com", "Izz_over_kt", "kd", "kd_over_kt", "Jr")},
    "rotor_drag": "yaw",
    **{name: "yaw" for name in ("kd_over_Izz", "Jr_over_Izz")},
}
"""Whose excitation decides how far a number can be trusted."""
YAW_RATIOS: Final = ("kd_over_Izz", "Jr_over_Izz")


def attenuation_allowance(name: str, size: float, rho: float, *, answered: bool) -> float:
    """Return the half-width that lack of excitation adds, infinite where it bounds nothing.

    Parameters
    ----------
    name
        Of the number, a key of `AXIS_OF`.
    size
        Of the number as found, or a size of it that matters where it is near zero.
    rho
        Explained over residual power of the axis' angular acceleration.
    answered
        Whether the likelihood has a term for the autopilot's answer in the bands that are flown.
    """
    size, rho = float(size), float(rho)
    if not rho > NO_EXCITATION:
        return float("inf")
    too_small = RATIO_PULL / (rho - RATIO_PULL)
    if AXIS_OF[name] != "yaw":
        pull = ANSWERED_PULL if answered and rho > LEAST_RATIO else INERTIA_PULL
        share = pull / (rho + pull)
    elif name in YAW_RATIOS:
        share = too_small
    else:
        share = max(SCALE_PULL / (rho + SCALE_PULL), too_small)
    return share * abs(size)
