"""How far a number can be pulled by what the rotors do not explain, and whose motion helps.

The autopilot answers disturbances, so that rotor speeds are correlated with them, and an estimate
of what the rotors do is pulled to one side: by a share of it that goes with 1 / rho, rho being
explained over residual power of the axis' angular acceleration where a pilot moves the vehicle.
The joint fit knows by how much on the very flights (`banded.response_sensitivity`): by about
1 / rho. Row by row it is not known. There, measured on simulated flights (another rigid-body
engine, gusts and
sticks of many sizes) and on real ones: the roll and pitch inertia come out too large by up to
2.5 / rho; k_d / I_zz and J_r / I_zz too small by up to 1.5 / rho; and the scale of I_zz and k_d,
which depends on small terms, is off by up to 3 / rho either way.

The yaw equation holds I_zz, k_d and J_r only relative to one another. Their scale comes from what
yaw does to roll and pitch (products of rates, gyroscopic torque of the rotors, known geometry).
Where neither of the two is flown it is noise, up to seventeen times too large; a known payload
gives it without that link. The height of the centre of mass depends on roll and pitch, too.
"""

import math
from collections.abc import Mapping
from typing import Final

from rotorfit.model.parameters import EVERY, FIRST_MOMENTS

INERTIA_BIAS: Final = 2.5
CLOSED_LOOP_BIAS: Final = 1.0
RATIO_BIAS: Final = 1.5
SCALE_BIAS: Final = 3.0
"""Largest pulls, as shares of the true value times rho."""
NO_EXCITATION: Final = 1.5
"""Below this rho an axis tells of the disturbances, not of the vehicle."""
LEAST_EXCITATION: Final = 5.0
"""Below this, disturbances are no longer small against the pilot, and that is what limits."""

AXES: Final = ("roll", "pitch", "yaw")
AXIS_OF: Final[Mapping[str, str]] = {
    name: info.motion for name, info in EVERY.items() if info.motion in AXES
}
"""Whose excitation decides how far a number can be trusted."""
YAW_RATIOS: Final = ("kd_over_Izz", "Jr_over_Izz")
SCALED: Final = tuple(name for name, info in EVERY.items() if info.on_yaw_scale)
"""What is known only as well as the scale of the yaw equation."""
YAW_PRODUCTS: Final = ("Ixz", "Ixz_com", "Iyz", "Iyz_com")
"""Where roll and pitch are flown and yaw is not, these stand in the yaw equation alone, where
their scale is that of k_d."""
HEIGHTS: Final = tuple(name for name, info in EVERY.items() if info.motion == "height")
ROTORS_LEAN: Final = math.radians(0.25)
"""Deviation of the mean of four motors that each lean by half a degree [rad]."""
COMMON: Final = 0.005
COMMON_YAW: Final = 0.015
"""Shares of k_t and of roll and pitch inertia, and of what yaw tells, by which many flights are off
alike: what the model lacks in all of them. Measured on 20 simulated flights with drag, of two
vehicles: k_t and kd_over_Izz .2 to .5 and 1 % too small."""


def attenuation_allowance(name: str, size: float, rho: float, *, with_response: bool) -> float:
    """Return the half-width that lack of excitation adds, infinite where it bounds nothing.

    Parameters
    ----------
    name
        Of the number, a key of `AXIS_OF`.
    size
        Of the number as found, or a size of it that matters where it is near zero.
    rho
        Explained over residual power of the axis' angular acceleration.
    with_response
        Of the joint fit, whose likelihood has a term for the autopilot's answer: about what the
        fit itself finds (`banded.response_sensitivity`), for a flight that is not there to fit.
    """
    size, rho = float(size), float(rho)
    if not rho > NO_EXCITATION:
        return float("inf")
    if with_response:
        return CLOSED_LOOP_BIAS / (rho + CLOSED_LOOP_BIAS) * abs(size)
    too_small = RATIO_BIAS / (rho - RATIO_BIAS)
    if AXIS_OF[name] != "yaw":
        return inertia_bias(size, rho)
    scale = 0.0 if name in YAW_RATIOS else SCALE_BIAS / (rho + SCALE_BIAS)
    return max(scale, too_small) * abs(size)


def inertia_bias(size: float, rho: float) -> float:
    """Return by how much gusts may pull a roll or pitch inertia of a size, at a rho of its axis."""
    return INERTIA_BIAS / (max(float(rho), 0.0) + INERTIA_BIAS) * abs(size)


def common_share(name: str) -> float:
    """Return the share of a number by which flights are off all alike, however many there are."""
    axis = "roll" if name == "kt" else AXIS_OF.get(name)
    return {"roll": COMMON, "pitch": COMMON, "yaw": COMMON_YAW, None: 0.0}[axis]


def link_allowance(size: float, link: float) -> float:
    """Return the half-width that too little roll and pitch adds to a number that depends on them.

    Parameters
    ----------
    size
        Of the number as found.
    link
        The larger rho of roll and pitch.
    """
    if not link > NO_EXCITATION:
        return float("inf")
    return SCALE_BIAS / (link + SCALE_BIAS) * abs(size)


def product_allowance(size: float, rho: float) -> float:
    """Return the half-width that too little yaw adds to a number of `YAW_PRODUCTS`.

    Parameters
    ----------
    size
        Of the number as found.
    rho
        Of yaw.
    """
    return SCALE_BIAS / (max(float(rho), 0.0) + SCALE_BIAS) * abs(size)


def lean_allowance(first: float, second: float) -> float:
    """Return the half-width that the rotors' mean lean against the frame adds to a product.

    Products of inertia are those in the rotors' axes; `first` and `second` are the moments about
    the product's two axes.
    """
    return 1.96 * ROTORS_LEAN * abs(second - first)


def lean_shift(name: str, com: tuple[float, float, float], mass: float, lever: float) -> float:
    """Return the half-width that the same lean adds to a place [m] or first moment [kg m].

    The centre of mass stands in the rotors' axes, turned about the IMU: `com` is counted from it.
    Motors lean forward and left, and turn about no vertical; drag torque that leans with them rolls
    and pitches as thrust does beside the centre, with a `lever` of k_d / k_t [m].
    """
    across = math.hypot(com[0], com[1]) if name in ("com_z", "msz") else math.hypot(com[2], lever)
    return 1.96 * ROTORS_LEAN * across * (mass if name in FIRST_MOMENTS else 1.0)


def scale_stretch(value: float, half_width: float) -> float:
    """Return by how much more a half-width must be to hold the inverse of the number, too.

    Small terms fix the scale of the yaw equation where it multiplies the rotors, its inverse where
    it divides the other torques. So +-r of the inverse is as good as +-r of the scale: from
    1 / (1 + r) to 1 / (1 - r), which is r / (1 - r^2) to either side of its middle. The two agree
    where they are narrow; where the interval reaches zero, the scale has no upper end.
    """
    relative = half_width / abs(value) if value else float("inf")
    return 1.0 / (1.0 - relative**2) if relative < 1.0 else float("inf")
