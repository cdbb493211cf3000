"""Physical numbers with their intervals, whichever way they were estimated.

And the sizes below which a relative error of them does not matter.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats

from rotorfit.fit.intervals.excitation import AXIS_OF
from rotorfit.model.parameters import EVERY, FIRST_MOMENTS
from rotorfit.model.terms.term import Size
from rotorfit.model.vehicle import Vehicle
from rotorfit.preprocessing.airborne import GRAVITY

PLACES = ("com_x", "com_y", "com_z", *FIRST_MOMENTS)
"""Of the centre of mass."""
LONGEST_LEVER = 0.15
"""k_d / k_t over the arm: a propeller of radius r has some .1 r."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Numbers:
    """Physical numbers of all configurations, with their intervals.

    Attributes
    ----------
    names
        ``kt`` for what is shared, ``Ixx_com@A`` for what belongs to a configuration; estimated row
        by row there is one, and it is not named.
    values, half_width
        SI, per kilogram where the mass is unknown; half of the 95 % interval.
    correlation
        Between them, from the covariance of the fit.
    excitation
        rho of each configuration and axis, by ``roll@A`` (row by row: ``roll``).
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " q"]
    half_width: Float[np.ndarray, " q"]
    correlation: Float[np.ndarray, "q q"]
    excitation: Mapping[str, float]

    def index(self, name: str) -> int:
        """Return the place of one number."""
        return self.names.index(name)

    def number(self, name: str) -> tuple[float, float]:
        """Return a number, and half of its interval."""
        i = self.index(name)
        return float(self.values[i]), float(self.half_width[i])

    def interval(self, name: str) -> tuple[float, float]:
        """Return the ends of a number's interval; infinite where nothing bounds it."""
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
        """Return the excitation that a number depends on; None where it needs none."""
        base, _, configuration = name.partition("@")
        axis = AXIS_OF.get(base)
        if axis is None:
            return None
        if configuration:
            return self.excitation[f"{axis}@{configuration}"]
        return max(value for key, value in self.excitation.items() if key.startswith(axis))

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


def drag_lever(numbers: Numbers, vehicle: Vehicle) -> float:
    """Return k_d / k_t [m], which no propeller has larger than a share of the arm."""
    return min(abs(numbers.number("kd_over_kt")[0]), LONGEST_LEVER * vehicle.arm)


def t_half_width(
    formal: Float[np.ndarray, "q q"], scatter: Float[np.ndarray, "q q"], degrees: float
) -> Float[np.ndarray, " q"]:
    """Return half of the 95 % interval by chance: t times the larger of formal and scatter.

    Parameters
    ----------
    formal, scatter
        Covariances: by the variances of the fit, and by the scatter between its blocks.
    degrees
        Of freedom of the scatter.
    """
    t = float(stats.t.ppf(0.975, degrees))
    return t * np.sqrt(np.maximum(np.diagonal(formal), np.diagonal(scatter)))


def correlation_of(covariance: Float[np.ndarray, "q q"]) -> Float[np.ndarray, "q q"]:
    """Return the correlation of a covariance; zero of what does not vary."""
    std = np.sqrt(np.diagonal(covariance))
    safe = np.where(std > 0, std, 1.0)
    return covariance / np.outer(safe, safe)


def hover_speed(kt: float, *, mass: float, vehicle: Vehicle) -> float:
    """Return the rotor speed, equal for all, whose thrust along z is the weight [rad/s]."""
    lift = float(vehicle.axes[:, 2].sum())
    return float(np.sqrt(mass * GRAVITY / (lift * max(kt, 1e-300))))


def quadrature(parts: Iterable[float]) -> float:
    """Return the half-width of independent parts together."""
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
