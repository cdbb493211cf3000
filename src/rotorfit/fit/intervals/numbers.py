"""Physical numbers with their intervals, of every estimator, and how gusts can bias them.

The autopilot responds to disturbances, so that rotor speeds are correlated with them, and the
estimate of what the rotors do is biased to one side: by a share of it that goes with 1 / rho, rho
being explained over residual power of the axis' angular acceleration where a pilot moves the
vehicle. The joint fit knows by how much on the very flights (`banded.response_sensitivity`): by
about 1 / rho. Row by row it is not known. There, measured on simulated flights (another rigid-body
engine, gusts and sticks of many sizes) and on real ones: the roll and pitch inertia come out too
large by up to 2.5 / rho; k_d / I_zz and J_r / I_zz too small by up to 1.5 / rho; and the scale of
I_zz and k_d, which depends on small terms, is off by up to 3 / rho either way.

The yaw equation holds I_zz, k_d and J_r only relative to one another. Their scale comes from what
yaw does to roll and pitch (products of rates, gyroscopic torque of the rotors, known geometry).
Where neither of the two is flown it is noise, up to seventeen times too large; a known payload
gives it without that link. The height of the centre of mass depends on roll and pitch, too.
"""

from __future__ import annotations

import math
from dataclasses import field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.distributions import student_quantile
from rotorfit.fit.intervals.interval_terms import (
    IntervalTerm,
    NumberTerm,
    combined_half_width,
    terms_of_number,
)
from rotorfit.flight.airborne import GRAVITY
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import EVERY, FIRST_MOMENTS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.model.terms.term import Motion, Size
    from rotorfit.model.vehicle import Vehicle

FEWEST_PHASES: Final = 3
"""Fewest phases of a flight whose scatter is informative."""
INERTIA_BIAS: Final = 2.5
CLOSED_LOOP_BIAS: Final = 1.0
RATIO_BIAS: Final = 1.5
SCALE_BIAS: Final = 3.0
"""Largest biases, as shares of the true value times rho."""
NO_EXCITATION: Final = 1.5
"""Rho below which an axis shows the disturbances, not the vehicle."""
LEAST_EXCITATION: Final = 5.0
"""Rho below which disturbances are no longer small against the pilot, and limit the fit."""

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
SHARES_OF_IZZ: Final = (*YAW_PRODUCTS, "twist")
"""What the yaw equation has in proportion to I_zz, which is at most I_xx + I_yy."""
HEIGHTS: Final = tuple(name for name, info in EVERY.items() if info.motion == "height")
ROTORS_LEAN: Final = math.radians(0.25)
"""Deviation of the mean of four motors that each lean by half a degree [rad]."""
COMMON: Final = 0.005
COMMON_YAW: Final = 0.015
"""Shares of k_t and of roll and pitch inertia, and of what yaw shows, by which many flights are off
alike: what the model lacks in all of them. Measured on 20 simulated flights with drag, of two
vehicles: k_t and kd_over_Izz .2 to .5 and 1 % too small."""


def attenuation_allowance(name: str, size: float, rho: float, *, with_response: bool) -> float:
    """Compute the half-width that lack of excitation adds, infinite if it bounds nothing.

    `name`: of the number, a key of `AXIS_OF`. `size`: of the number as found, or a size of it that
    matters where it is near zero. `rho`: explained over residual power of the axis' angular
    acceleration. `with_response`: of the joint fit, whose likelihood has a term for the autopilot's
    answer: about what the fit itself finds (`banded.response_sensitivity`), for a flight that is
    not there to fit.
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
    """Compute the largest bias by gusts of a roll or pitch inertia, at a rho of its axis."""
    return INERTIA_BIAS / (max(float(rho), 0.0) + INERTIA_BIAS) * abs(size)


def common_share(name: str) -> float:
    """Return the share of a number by which flights are off all alike, however many there are."""
    axis = "roll" if name == "kt" else AXIS_OF.get(name)
    return {"roll": COMMON, "pitch": COMMON, "yaw": COMMON_YAW, None: 0.0}[axis]


def link_allowance(size: float, link: float) -> float:
    """Return the half-width that too little roll and pitch adds to a number that depends on them.

    `size`: of the number as found. `link`: the larger rho of roll and pitch.
    """
    if not link > NO_EXCITATION:
        return float("inf")
    return SCALE_BIAS / (link + SCALE_BIAS) * abs(size)


def product_allowance(size: float, rho: float) -> float:
    """Return the half-width that too little yaw adds to a number of `YAW_PRODUCTS`.

    `size`: of the number as found. `rho`: of yaw.
    """
    return SCALE_BIAS / (max(float(rho), 0.0) + SCALE_BIAS) * abs(size)


def lean_allowance(first: float, second: float) -> float:
    """Return the half-width that the rotors' mean lean against the frame adds to a product.

    Products of inertia are those in the rotors' axes; `first` and `second` are the moments about
    the product's two axes.
    """
    return 1.96 * ROTORS_LEAN * abs(second - first)


def lean_shift(name: str, com: tuple[float, float, float], mass: float, lever: float) -> float:
    """Return the half-width that the rotors' mean lean adds to a place [m] or first moment [kg m].

    The centre of mass stands in the rotors' axes, turned about the IMU: `com` is counted from it.
    Motors lean forward and left, and turn about no vertical; drag torque that leans with them rolls
    and pitches as thrust does beside the centre, with a `lever` of k_d / k_t [m].
    """
    across = math.hypot(com[0], com[1]) if name in ("com_z", "msz") else math.hypot(com[2], lever)
    return 1.96 * ROTORS_LEAN * across * (mass if name in FIRST_MOMENTS else 1.0)


def twist_shift(com: tuple[float, float]) -> float:
    """Return the half-width that the rotors' mean lean adds to the twist [m].

    Thrust beside the centre of mass rolls and pitches, and about an axis that leans it yaws; `com`
    is counted from the rotors' centre.
    """
    return 1.96 * ROTORS_LEAN * math.hypot(*com)


def scale_stretch(value: float, half_width: float) -> float:
    """Compute the factor by which a half-width holds the inverse of the number, too."""
    relative = half_width / abs(value) if value else float("inf")
    # Small terms fix the scale of the yaw equation where it multiplies the rotors, its inverse
    # where it divides the other torques. So +-r of the inverse is as good as +-r of the scale: from
    # 1 / (1 + r) to 1 / (1 - r), which is r / (1 - r^2) to either side of its middle. The two agree
    # where they are narrow; where the interval reaches zero, the scale has no upper end.
    return 1.0 / (1.0 - relative**2) if relative < 1.0 else float("inf")


PLACES = ("com_x", "com_y", "com_z", *FIRST_MOMENTS)
"""Numbers of the centre of mass."""
LONGEST_LEVER = 0.15
"""k_d / k_t over the arm: a propeller of radius r has some .1 r."""


@frozen_dataclass
class Numbers:
    """Physical numbers of all configurations, with their intervals.

    - `names`: ``kt`` for what is shared, ``Ixx_com@A`` for what belongs to a configuration;
      estimated row by row there is one, and it is not named.
    - `values`: SI, per kilogram where the mass is unknown.
    - `terms`: what makes up their 95 % intervals, in the order of the steps that found it.
    - `half_width`: half of the 95 % interval, by the rule of `interval_terms.py`.
    - `correlation`: between them, from the covariance of the fit.
    - `excitation`: rho of each configuration and axis, by ``roll@A`` (row by row: ``roll``).
    - `weighed`: the same where the weights of the fit give another, as `enough_by_weight` has it.
    - `by_velocity`: numbers of yaw that forces show as well, where the velocity is known.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " q"]
    terms: tuple[IntervalTerm, ...]
    half_width: Float[np.ndarray, " q"] = field(init=False)
    correlation: Float[np.ndarray, "q q"]
    excitation: Mapping[str, float]
    weighed: Mapping[str, float] = field(default_factory=dict[str, float])
    by_velocity: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        # Computed once: verdicts and reports ask for it thousands of times.
        half = combined_half_width(self.terms, len(self.names))
        object.__setattr__(self, "half_width", half)

    def with_terms(self, *terms: IntervalTerm) -> Numbers:
        """Return the numbers with further interval terms; a term of zeros alone is left out."""
        added = (term for term in terms if np.any(term.half_width))
        return replace(self, terms=(*self.terms, *added))

    def without_term(self, name: str) -> Numbers:
        """Return the numbers as they were before a step appended its term."""
        return replace(self, terms=tuple(term for term in self.terms if term.name != name))

    def limited_to(self, half_width: Float[np.ndarray, " q"], *, source: str) -> Numbers:
        """Return the numbers with no interval wider than a half-width that is known already.

        Where it is narrower than the terms, it replaces them as the one term of its source.
        """
        known = half_width < self.half_width
        kept = (replace(t, half_width=np.where(known, 0.0, t.half_width)) for t in self.terms)
        limit = IntervalTerm(
            name="earlier flights", half_width=np.where(known, half_width, 0.0), source=source
        )
        return replace(self, terms=(*kept, limit))

    def terms_of(self, name: str) -> tuple[NumberTerm, ...]:
        """Return the interval terms of one number."""
        return terms_of_number(self.terms, self.index(name))

    @property
    def judged(self) -> Numbers:
        """The numbers with the rho by which their intervals go, and so verdicts and words."""
        return replace(self, excitation={**self.excitation, **self.weighed})

    def index(self, name: str) -> int:
        """Return the place of one number."""
        return self.names.index(name)

    def number(self, name: str) -> tuple[float, float]:
        """Return a number, and half of its interval."""
        i = self.index(name)
        return float(self.values[i]), float(self.half_width[i])

    def interval(self, name: str) -> tuple[float, float]:
        """Return the ends of a number's interval; infinite if nothing bounds it."""
        if name not in self.names:
            return -np.inf, np.inf
        value, half = self.number(name)
        return (value - half, value + half) if np.isfinite(half) else (-np.inf, np.inf)

    def covariance(self, names: Sequence[str]) -> Float[np.ndarray, "p p"]:
        """Return the covariance of some numbers, with the deviations of their intervals."""
        index = [self.index(name) for name in names]
        std = self.half_width[index] / 1.96
        return self.correlation[np.ix_(index, index)] * np.outer(std, std)

    def rho(self, name: str) -> float | None:
        """Return the excitation that a number depends on; None if it needs none."""
        base, _, configuration = name.partition("@")
        axis = AXIS_OF.get(base)
        if axis is None or base in self.by_velocity:
            return None
        if configuration:
            return self.excitation[f"{axis}@{configuration}"]
        return max(value for key, value in self.excitation.items() if key.startswith(axis))

    def motion(self, name: str) -> Motion:
        """Return which motion shows a number."""
        base = name.partition("@")[0]
        if base in self.by_velocity:
            return "air"
        return EVERY[base].motion if base in EVERY else "force"

    def on_yaw_scale(self, name: str) -> bool:
        """Return whether a number is known only as well as the scale of the yaw equation."""
        base = name.partition("@")[0]
        return base in SCALED and base not in self.by_velocity

    def link(self, configuration: str | None = None) -> float:
        """Return the larger rho of roll and pitch, of one configuration or of any."""
        return max(
            value
            for key, value in self.excitation.items()
            if not key.startswith("yaw") and (configuration or "") in ("", key.partition("@")[2])
        )


def moments_across(numbers: Numbers, product: str, owner: str) -> tuple[float, float]:
    """Return the moments of inertia about the two axes of a product, of a configuration."""
    first, second = (numbers.number(f"I{axis}{axis}_com@{owner}")[0] for axis in product[1:3])
    return first, second


def com_from_imu(numbers: Numbers, owner: str, vehicle: Vehicle) -> tuple[float, float, float]:
    """Return the centre of mass of a configuration, counted from the IMU [m]."""
    imu = vehicle.imu_position or (0.0, 0.0, 0.0)
    x, y, z = (
        numbers.number(f"com_{axis}@{owner}")[0] - place
        for axis, place in zip("xyz", imu, strict=True)
    )
    return x, y, z


def com_from_rotors(numbers: Numbers, owner: str, vehicle: Vehicle) -> tuple[float, float]:
    """Return the sideways centre of mass of a configuration from the rotors' centre [m]."""
    x, y = vehicle.positions[:, :2].mean(axis=0).tolist()
    centre = {f"rotor_center_x@{owner}": x, f"rotor_center_y@{owner}": y}
    x, y = (numbers.number(n)[0] if n in numbers.names else at for n, at in centre.items())
    return numbers.number(f"com_x@{owner}")[0] - x, numbers.number(f"com_y@{owner}")[0] - y


def drag_lever(numbers: Numbers, vehicle: Vehicle) -> float:
    """Return k_d / k_t [m], which no propeller has larger than a share of the arm."""
    return min(abs(numbers.number("kd_over_kt")[0]), LONGEST_LEVER * vehicle.arm)


def t_half_width(
    formal: Float[np.ndarray, "q q"], scatter: Float[np.ndarray, "q q"], degrees: float
) -> Float[np.ndarray, " q"]:
    """Compute half of the 95 % interval by chance: t times the larger of formal and scatter.

    `formal`, `scatter`: covariances: by the variances of the fit, and by the scatter between its
    blocks. `degrees`: of freedom of the scatter.
    """
    t = float(student_quantile(0.975, degrees))
    return t * np.sqrt(np.maximum(np.diagonal(formal), np.diagonal(scatter)))


def correlation_of(covariance: Float[np.ndarray, "q q"]) -> Float[np.ndarray, "q q"]:
    """Return the correlation of a covariance; zero of what does not vary."""
    std = np.sqrt(np.diagonal(covariance))
    safe = np.where(std > 0, std, 1.0)
    return covariance / np.outer(safe, safe)


def hover_speed(
    kt: Float[np.ndarray, " b"], *, mass: float, vehicle: Vehicle
) -> Float[np.ndarray, " b"]:
    """Return the rotor speed, equal for all, whose thrust along z is the weight [rad/s]."""
    lift = float(vehicle.axes[:, 2].sum())
    return np.sqrt(mass * GRAVITY / (lift * np.maximum(kt, 1e-300)))


def quadrature(parts: Iterable[float]) -> float:
    """Add the half-widths of independent parts in squares."""
    return float(np.sqrt(sum(part**2 for part in parts)))


def relevant_size(name: str, size: Size) -> float:
    """Return the size of a number below which its relative error does not matter.

    Zero where its own size alone counts; `name` is without its configuration.
    """
    relevant = EVERY[name].relevant
    return 0.0 if relevant is None else relevant(size)


def moments_of_product(product: str) -> tuple[str, str]:
    """Return the two moments of inertia about the axes of a product: Ixx and Izz of Ixz."""
    return f"I{product[1] * 2}", f"I{product[2] * 2}"
