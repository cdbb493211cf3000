r"""The scale of the gyro, held against a velocity that does not come from it.

A gyro that reads s too much carries axes that turn too far by the share s of every turn. What the
accelerometer reads, turned into such axes, is an acceleration with a part of gravity that is not
there, and its integral leaves the logged velocity: with the turn :math:`\delta(t)` of the axes,

.. math:: C v - \int C f\,dt = v_0 + G t + \int \delta \times C f\,dt - \delta \times C v, \quad
    \delta = -\sum_k \int C e_k (s_k \omega_k + b_k)\,dt

in windows of some seconds, each with a velocity and a gravity of its own. The gyro's bias b, the
accelerometer's, a tilt and a lateness of the velocity and the lever from its place to the IMU are
estimated beside. The windows, each left out in turn (jackknife), give the deviation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.distributions import normal_density, student_density, student_quantile
from rotorfit.fit.dataset.weight_balance import grouped
from rotorfit.fit.reduction.reduce import split_segment
from rotorfit.flight.filters import first_order_recursion
from rotorfit.flight.kinematics import rotated, rotation_matrices, running_product, small_turns
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float

    from rotorfit.flight.flight_data import FlightData, Segment

    Normal = tuple[Float[np.ndarray, "p p"], Float[np.ndarray, " p"]]
    """Matrix and right side of normal equations."""

WINDOW: Final = 15.0
"""Window of one velocity and gravity [s]: slow turns show most."""
SHORTEST: Final = 5.0
BATCH: Final = 2.5
"""Batch of the jackknife [s]."""
FEWEST: Final = 4
"""Batches."""
PASSES: Final = 3
"""A bias of .05 rad/s turns the axes by .3 rad in a window."""
FLOOR: Final = 0.003
"""Deviation of a scale by what is not in the equation: samples, filters, noise that is a turn."""
GROUPS: Final = 25.0
"""Groups in a second, that are compared."""
SHARES: Final = (0.003, 0.03, 0.1, 0.3, 0.6, 1.0)
"""Shares of a random walk in the noise of a velocity: from white noise to a random walk alone."""
PRIOR: Final = np.array([0.1] * 3 + [0.1] * 3 + [0.5] * 3 + [0.05] * 3 + [0.02] * 3 + [0.02])
"""Deviations of scales, gyro's bias [rad/s], accelerometer's [m/s^2], tilt of the velocity [rad],
lever [m], lateness [s] before the flight."""
SOUND: Final = 0.003
"""Deviation of the scale of a sound gyro."""
OFF: Final = 0.04
"""The same of one that is not: another range or unit than its scale was for, a broken part."""
SHARE: Final = 0.03
"""Share of the gyros that are not."""
DRAWS: Final = 4000
TINY: Final = 1e-8
_GRID: Final = np.arange(-1200, 1201) / 4000.0


@frozen_dataclass
class GyroScale:
    """By which share a gyro reads too much about each axis.

    - `value`, `std`: by the velocity.
    - `degrees`: of freedom of that deviation.
    """

    value: Float[np.ndarray, "3"]
    std: Float[np.ndarray, "3"]
    degrees: int

    def interval(self, axis: int) -> tuple[float, float]:
        """Return the 95 % interval of an axis by the velocity alone."""
        reach = float(student_quantile(0.975, self.degrees) * self.std[axis])
        return float(self.value[axis]) - reach, float(self.value[axis]) + reach

    def _posterior_of_axis(self, axis: int) -> Float[np.ndarray, "2 n"]:
        """Weigh sound gyros, and others, over the grid."""
        off: Float[np.ndarray, " n"] = (_GRID - self.value[axis]) / self.std[axis]
        seen = student_density(off, self.degrees)
        shares = ((1.0 - SHARE, SOUND), (SHARE, OFF))
        prior = [share * normal_density(_GRID, std) for share, std in shares]
        parts: Float[np.ndarray, "2 n"] = np.array(prior) * seen
        total = float(np.sum(parts))
        return parts / total

    def probability(self, axis: int) -> float:
        """Return the probability that the scale of an axis is off."""
        return float(np.sum(self._posterior_of_axis(axis)[1]))

    def draws(self) -> Float[np.ndarray, "n 3"]:
        """Draw scales of the three axes from the posterior; that of a sound gyro is none."""
        rng = np.random.default_rng(0)
        off = (self._posterior_of_axis(axis)[1] for axis in range(3))
        # What sound ones differ by is among the assumptions, whether a log has a velocity or not.
        weights = [part + (1.0 - float(np.sum(part))) * (_GRID == 0.0) for part in off]
        return np.column_stack([rng.choice(_GRID, DRAWS, p=weight) for weight in weights])

    def half_widths(self, slopes: Float[np.ndarray, "3 q"]) -> Float[np.ndarray, " q"]:
        """Compute the half-widths that hold 95 % of the posterior about no error of scale."""
        return np.quantile(np.abs(self.draws() @ slopes), 0.95, axis=0)


def gyro_scale(
    flights: Sequence[FlightData], lever: Float[np.ndarray, "3"] | None
) -> GyroScale | None:
    """Estimate the scale of the gyro; None if too little of the velocity is in the log.

    `lever`: from the place of the velocity to the IMU [m], zero if it is not known.
    """
    lever = np.zeros(3) if lever is None else lever
    windows = [(f, w) for f in flights for w in _velocity_windows(f)]
    if not windows:
        return None
    found = np.zeros(6)
    normal: list[list[Normal]] = []
    for _ in range(PASSES):
        normal = [_normal_equations(f, w, lever, found) for f, w in windows]
        found = found + _solve_normal(normal, found)[:6]
    normal = [_normal_equations(f, w, lever, found) for f, w in windows]
    batches = [batch for each in normal for batch in each]
    count = len(batches)
    if count < FEWEST:
        return None
    without = np.array(
        [_solve_normal([batches[:i] + batches[i + 1 :]], found)[:3] for i in range(count)]
    )
    moved = without - without.mean(axis=0)
    shown = (count - 1) / count * (moved**2).sum(axis=0)
    whole = sum((a for a, _ in batches), np.diag(PRIOR**-2.0))
    formal = np.diag(np.linalg.inv(whole))[:3]
    std = np.sqrt(np.maximum(shown, formal) + FLOOR**2)
    return GyroScale(value=found[:3], std=std, degrees=count - 1)


def _velocity_windows(data: FlightData) -> Iterator[Segment]:
    """Yield the windows of a flight in which the velocity is logged."""
    if data.velocity is None:
        return
    for segment in data.segments:
        for window in split_segment(segment, WINDOW * data.sample_rate):
            long = len(window) > SHORTEST * data.sample_rate
            if long and np.isfinite(data.velocity[window.start : window.stop]).all():
                yield window


def _solve_normal(
    normal: Sequence[Sequence[Normal]],
    found: Float[np.ndarray, "6"],
) -> Float[np.ndarray, " p"]:
    """Solve the normal equations of some windows, with the prior."""
    weight: Float[np.ndarray, " p"] = PRIOR**-2.0
    A: Float[np.ndarray, "p p"] = np.diag(weight)
    b: Float[np.ndarray, " p"] = -weight * np.r_[found, np.zeros(len(PRIOR) - 6)]
    for matrix, side in (one for each in normal for one in each):
        A, b = A + matrix, b + side
    step: Float[np.ndarray, " p"] = np.linalg.solve(A, b)
    return step


def _normal_equations(
    data: FlightData, window: Segment, lever: Float[np.ndarray, "3"], found: Float[np.ndarray, "6"]
) -> list[Normal]:
    """Return the normal equations of a window's batches, in units of what is left in it."""
    rows = slice(window.start, window.stop)
    step = 1.0 / data.sample_rate
    w, f = data.angular_velocity[rows], data.specific_force[rows]
    true = w * (1.0 - found[:3]) - found[3:]
    assert data.velocity is not None
    v = data.velocity[rows] + np.cross(true, lever)
    C = running_product(small_turns(_turn_steps(true) * step))
    axes = rotation_matrices(C).transpose(2, 0, 1)
    force, moved = rotated(C, f), rotated(C, v)
    turned = [-_integrate_turns(a * x[:, None]) * step for a, x in zip(axes, w.T, strict=True)]
    turned += [-_integrate_turns(a) * step for a in axes]
    columns = [np.cross(d, moved) - _integrate_turns(np.cross(d, force)) * step for d in turned]
    columns = [-c for c in columns]
    columns += [-_integrate_turns(a) * step for a in axes]
    columns += [-rotated(C, np.cross(e, v)) for e in np.eye(3)]
    columns += [-rotated(C, np.cross(w, e)) for e in np.eye(3)]
    columns.append(-force)
    left = moved - _integrate_turns(force) * step
    group = max(round(data.sample_rate / GROUPS), 1)
    every = np.stack([grouped(c, group) for c in [*columns, left]], axis=-1)
    variance, whitened = min(
        (_whiten_columns(every, share) for share in SHARES), key=lambda x: x[0]
    )
    count = max(round(len(w) * step / BATCH), 1)
    parts = (part.reshape(-1, part.shape[-1]) for part in np.array_split(whitened, count))
    return [(a[:, :-1].T @ a[:, :-1] / variance, a[:, :-1].T @ a[:, -1] / variance) for a in parts]


def _whiten_columns(
    every: Float[np.ndarray, "m 3 k"], share: float
) -> tuple[float, Float[np.ndarray, "m 3 k"]]:
    """Whiten columns and velocity where noise is white and a random walk, without straight lines.

    Return the variance of what is left, with them. `share`: of the noise before that is forgotten.
    """
    time = np.linspace(-1.0, 1.0, len(every))
    line = _innovations_of(np.column_stack([np.ones(len(every)), time]), share)
    # Start and a constant error of the velocity are no matter of the gyro: projected out.
    line, _ = np.linalg.qr(line)
    own = _innovations_of(every.reshape(len(every), -1), share)
    own = own - line @ (line.T @ own)
    flat = own.reshape(-1, every.shape[-1])
    A, b = flat[:, :-1] * PRIOR, flat[:, -1]
    rest = b - A @ np.linalg.solve(A.T @ A + TINY * np.eye(len(PRIOR)), A.T @ b)
    return max(float(rest @ rest) / len(rest), TINY), own.reshape(every.shape)


def _innovations_of(x: Float[np.ndarray, "m k"], share: float) -> Float[np.ndarray, "m k"]:
    """Subtract from each sample an exponential mean of the samples before."""
    first = np.concatenate([x[:1], np.diff(x, axis=0)])
    return first_order_recursion(first, 1.0 - share)


def _turn_steps(w: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Return the turn from each sample to the next, times the sample rate, the first none."""
    slope = np.gradient(w, axis=0)
    out = np.zeros_like(w)
    # The integral of the cubic through both rates with their slopes (Euler-Maclaurin).
    out[1:] = 0.5 * (w[1:] + w[:-1]) - (slope[1:] - slope[:-1]) / 12.0
    return out


def _integrate_turns(x: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return np.cumsum(_turn_steps(x), axis=0)
