r"""The wind of a flight whose velocity is relative to the ground, and the velocity through the air.

Rotors are held back in proportion to their velocity through the air. Of a steady horizontal wind
:math:`w` in the world's axes the specific force across z is

.. math:: \alpha_{xy} = -c \sum O_i (v - R^T w)_{xy} + b

with the velocity v over the ground, the attitude R and a bias b of the accelerometer, which also
stands for a lean of the rotors. It is linear in c, c w and b. Only a vehicle that turns its nose,
or whose bias is known, tells wind from bias. Means of half a second are regressed; the deviation is
that of the jackknife, with what is not known of the bias.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.distributions import f_quantile
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.flight.flight_data import FlightData

BLOCK: Final = 0.5
"""Length of the means that are regressed [s]: gusts and turns are gone from them."""
GROUPS: Final = 12
"""Of the jackknife."""
FEWEST_IN_GROUP: Final = 4
BIAS_STD: Final = 0.2
"""Of accelerometer and lean before the flight [m/s^2]: 20 mg, or one degree."""
CHANCE: Final = 0.999
"""Probability that a wind which is taken off is not chance."""
LEAST_WIND: Final = 0.5
"""Wind that is worth taking off [m/s]."""
LEAST_SHARE: Final = 0.25
"""The same over the rms speed that was flown: of less, drag that is no straight line over the
velocity, and air that the vehicle stirs itself, make a wind of a tenth or two indoors."""
SURE_DRAG: Final = 4.0
"""Deviations by which the drag must be above zero for a wind that is a force over it."""


@frozen_dataclass
class Wind:
    """A steady wind over one flight, along the world's horizontal axes x and y.

    - `velocity`: of the air over the ground [m/s].
    - `std`: of its size [m/s].
    """

    velocity: tuple[float, float]
    std: float

    @property
    def speed(self) -> float:
        """Its size [m/s]."""
        return float(np.hypot(*self.velocity))


def estimate_wind(data: FlightData) -> Wind | None:
    """Estimate the steady wind of a flight; None where it shows none, or cannot."""
    rows = _block_equations(data)
    if rows is None:
        return None
    X, y = rows
    whole = _solve_regression(X, y)
    parts = np.array_split(np.arange(len(X)), GROUPS)
    left = np.array([_solve_regression(*_leave_out(X, y, part)) for part in parts])
    c, wind = whole[0], whole[1:3] / whole[0]
    spread = np.sqrt((GROUPS - 1) * left[:, 0].var())
    if not c > SURE_DRAG * spread:
        return None
    winds = left[:, 1:3] / left[:, :1]
    # What nobody knows of the bias: the nose that does not turn shows a wind as one.
    biased = [_solve_regression(X, y, bias=np.array(b)) for b in ((BIAS_STD, 0.0), (0.0, BIAS_STD))]
    shifts = np.array([one[1:3] / one[0] - wind for one in biased])
    chance: Float[np.ndarray, "2 2"] = np.asarray(np.cov(winds.T, bias=True), dtype=float)
    covariance: Float[np.ndarray, "2 2"] = (GROUPS - 1) * chance + shifts.T @ shifts
    away: Float[np.ndarray, " 2"] = np.asarray(np.linalg.solve(covariance, wind), dtype=float)
    distance = 0.5 * float(wind @ away)
    shown = distance > f_quantile(CHANCE, 2, GROUPS - 1)
    flown = float(np.sqrt((X[:, :, 0] ** 2).sum(axis=1).mean()))
    if not shown or float(np.hypot(*wind)) < max(LEAST_WIND, LEAST_SHARE * flown):
        return None
    std = float(np.sqrt(0.5 * np.diagonal(covariance).sum()))
    return Wind(velocity=(float(wind[0]), float(wind[1])), std=std)


def _block_equations(
    data: FlightData,
) -> tuple[Float[np.ndarray, "k 2 5"], Float[np.ndarray, "k 2"]] | None:
    """Return the equations of x and y of every block; None where something is missing."""
    v, axes = data.velocity, data.world_axes
    step = round(BLOCK * data.sample_rate)
    if v is None or axes is None:
        return None
    speeds = data.rotor_speed.sum(axis=1)
    mean = float(speeds[data.used_rows].mean())
    blocks: list[np.ndarray] = []
    for s in data.segments:
        count = len(s) // step
        rows = np.arange(s.start, s.start + count * step)
        share = speeds[rows, None] / mean
        felt = np.hstack(
            [data.specific_force[rows, :2], -share * v[rows, :2]]
            + [share * axes[rows, k : k + 2] for k in (0, 3)]
        )
        blocks.append(felt.reshape(count, step, 8).mean(axis=1))
    every = np.concatenate(blocks) if blocks else np.zeros((0, 8))
    every = every[np.isfinite(every).all(axis=1)]
    if len(every) < GROUPS * FEWEST_IN_GROUP:
        return None
    X = np.zeros((len(every), 2, 5))
    X[:, :, 0], X[:, :, 1], X[:, :, 2] = every[:, 2:4], every[:, 4:6], every[:, 6:8]
    X[:, 0, 3] = X[:, 1, 4] = 1.0
    return X, every[:, :2]


def _leave_out(
    X: Float[np.ndarray, "k 2 5"], y: Float[np.ndarray, "k 2"], part: np.ndarray
) -> tuple[Float[np.ndarray, "m 2 5"], Float[np.ndarray, "m 2"]]:
    return np.delete(X, part, axis=0), np.delete(y, part, axis=0)


def _solve_regression(
    X: Float[np.ndarray, "k 2 5"],
    y: Float[np.ndarray, "k 2"],
    *,
    bias: Float[np.ndarray, " 2"] | None = None,
) -> Float[np.ndarray, " 5"]:
    """Solve for c, c w and the bias, which is known to `BIAS_STD` about `bias` (or zero)."""
    A, b = X.reshape(-1, 5), y.reshape(-1)
    found: Float[np.ndarray, " 5"] = np.linalg.lstsq(A, b)[0]
    noise = float(np.mean((b - A @ found) ** 2))
    prior = np.zeros((2, 5))
    # Blocks of a slow error tell of a mean as one flight does, not as many.
    prior[0, 3] = prior[1, 4] = np.sqrt(noise * len(X) / GROUPS) / BIAS_STD
    mean = np.zeros(2) if bias is None else bias
    known = np.concatenate([b, prior[[0, 1], [3, 4]] * mean])
    return np.asarray(np.linalg.lstsq(np.vstack([A, prior]), known)[0])
