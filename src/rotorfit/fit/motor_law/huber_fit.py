"""Least squares of few parameters by many measurements, within bounds; glitches count less.

Steps of Gauss and Newton on the normal equations: their sums cost a tenth of the singular values
that `scipy.optimize.least_squares` takes at every step, and to import it takes as long as a fit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Callable

    from jaxtyping import Bool, Float, Int

    Prediction = tuple[Float[np.ndarray, " m"], Float[np.ndarray, "p m"]]
    Bounds = tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]


MOST_STEPS: Final = 60
CLOSE: Final = 1.0
"""Standard deviations: a shorter step is the last one of a fit."""
LEAST_DAMPING: Final = 1e-9
FIRST_DAMPING: Final = 1e-3
"""Where a step has failed, as a share of the information of each parameter."""
HIGHEST_DAMPING: Final = 1e9
"""Where the cost does not fall at this damping, rounding alone keeps it from falling."""
FEW_BEYOND: Final = 0.1
"""Share of residuals beyond the limit, up to which the steps are Newton's."""
LEAST_SHARE: Final = 0.1
"""Share of the expected gain that a step must win: a leap that wins less may end in another
valley."""
GOOD_SHARE: Final = 0.75
"""Share of the expected gain, above which the next step is damped less."""
AT_BOUND: Final = 0.02
"""Share of the distance of two bounds: a step that crosses one that is closer ends at it."""
NEAR: Final = 0.05
"""Share of the cost that the last step may gain at most: further off, the blocks' scores scatter
by the misfit, and tell nothing of the deviations."""
EXACT: Final = 1e-18
"""Share of the measurements' squares that is left where they have no errors."""
FLAT: Final = 1e-6
"""Share of the cost: a step that gains less is along a valley whose floor is level."""
KNOWN: Final = 1e-13
"""Share of the largest eigenvalue of the scaled information, below which nothing is known."""


@frozen_dataclass
class HuberFit:
    """A fit, after its last step by the slopes.

    - `values`: of the parameters.
    - `loss`: mean of Huber's loss.
    - `predicted`: measurements by them.
    - `slopes`, `residuals`: of the prediction, and measured less predicted, both times the root
      of the weight of each measurement.
    """

    values: Float[np.ndarray, " p"]
    loss: float
    predicted: Float[np.ndarray, " m"]
    slopes: Float[np.ndarray, "p m"]
    residuals: Float[np.ndarray, " m"]


@frozen_dataclass
class _Point:
    """Parameters with their prediction, the cost and its equations."""

    x: Float[np.ndarray, " p"]
    predicted: Float[np.ndarray, " m"]
    slopes: Float[np.ndarray, "p m"]
    cost: float
    information: Float[np.ndarray, "p p"]
    score: Float[np.ndarray, " p"]


def fit_huber(
    predict: Callable[[Float[np.ndarray, " p"]], Prediction],
    measured: Float[np.ndarray, " m"],
    begin: Float[np.ndarray, " p"],
    *,
    bounds: Bounds,
    block: Int[np.ndarray, " m"],
    limit: float = np.inf,
    close: float = CLOSE,
) -> HuberFit:
    """Fit parameters within bounds; residuals beyond `limit` count less (Huber)."""
    damping = LEAST_DAMPING
    now = _evaluate_point(predict, measured, np.clip(begin, *bounds), limit)
    for _ in range(MOST_STEPS):
        step = _bounded_step(now, bounds, 0.0)
        if now.cost <= EXACT * float(measured @ measured):
            return _finish_fit(now, measured, step, limit)
        is_near = _expected_gain(now, step) < NEAR * now.cost
        # The fit ends when the step that is left moves no parameter by `close` standard deviations,
        # as errors that are correlated within a `block` of measurements make them. That step is
        # made by the slopes, without another prediction: what is then left is of second order in
        # it.
        if (
            is_near
            and (np.abs(step) <= close * _scatter_deviations(now, measured, block, limit)).all()
        ):
            return _finish_fit(now, measured, step, limit)
        better, damping = _descend_cost(predict, measured, now, damping, bounds=bounds, limit=limit)
        if better is None or better.cost > (1.0 - FLAT) * now.cost:
            now = better or now
            break
        now = better
    return _finish_fit(now, measured, np.zeros(len(begin)), limit)


def _descend_cost(
    predict: Callable[[Float[np.ndarray, " p"]], Prediction],
    measured: Float[np.ndarray, " m"],
    now: _Point,
    damping: float,
    *,
    bounds: Bounds,
    limit: float,
) -> tuple[_Point | None, float]:
    """Find a point of lower cost, None if there is none, and the damping of the next step."""
    while damping < HIGHEST_DAMPING:
        step = _bounded_step(now, bounds, damping)
        trial = _evaluate_point(predict, measured, np.clip(now.x + step, *bounds), limit)
        won, expected = now.cost - trial.cost, _expected_gain(now, step)
        if won > LEAST_SHARE * expected and won > 0.0:
            is_good = won > GOOD_SHARE * expected
            return trial, max(0.1 * damping, LEAST_DAMPING) if is_good else damping
        damping = max(10.0 * damping, FIRST_DAMPING)
    return None, damping


def _evaluate_point(
    predict: Callable[[Float[np.ndarray, " p"]], Prediction],
    measured: Float[np.ndarray, " m"],
    x: Float[np.ndarray, " p"],
    limit: float,
) -> _Point:
    """Predict, and sum the equations of Newton's step under Huber's loss."""
    predicted, slopes = predict(x)
    residuals = measured - predicted
    information = slopes @ slopes.T
    off = np.abs(residuals)
    beyond = np.flatnonzero(off > limit)
    if len(beyond):
        # Beyond the limit c the loss is 2 c |r| - c^2, with a slope, but no curvature. Far from the
        # minimum, where many are beyond, they count by their weights c / |r|: the few others may
        # not determine a step.
        steep = slopes[:, beyond]
        if len(beyond) > FEW_BEYOND * len(measured):
            steep = steep * np.sqrt(1.0 - limit / off[beyond])
        information -= steep @ steep.T
    pulling = np.clip(residuals, -limit, limit)
    cost = float(pulling @ pulling)
    if len(beyond):
        cost += 2.0 * limit * float((off[beyond] - limit).sum())
    return _Point(
        x=x,
        predicted=predicted,
        slopes=slopes,
        cost=cost,
        information=information,
        score=slopes @ pulling,
    )


def _expected_gain(now: _Point, step: Float[np.ndarray, " p"]) -> float:
    """Compute by how much a step lowers the cost, by the equations."""
    return 2.0 * float(now.score @ step) - float(step @ now.information @ step)


def _bounded_step(now: _Point, bounds: Bounds, damping: float) -> Float[np.ndarray, " p"]:
    """Solve for a step within the bounds; where one stops a parameter, solve the others again."""
    low, high = bounds[0] - now.x, bounds[1] - now.x
    # A leap ends half way to a bound that is far: at a bound, a form may lose what tells its
    # parameters apart.
    least = AT_BOUND * (high - low)
    low, high = np.where(-low > least, 0.5, 1.0) * low, np.where(high > least, 0.5, 1.0) * high
    step = np.zeros(len(now.x))
    free = ~(((low >= 0.0) & (now.score < 0.0)) | ((high <= 0.0) & (now.score > 0.0)))
    while free.any():
        held = now.information[np.ix_(free, ~free)] @ step[~free]
        solved = _solve_damped(now.information[np.ix_(free, free)], now.score[free] - held, damping)
        outside = (solved < low[free]) | (solved > high[free])
        step[free] = np.clip(solved, low[free], high[free])
        if not outside.any():
            break
        free[np.flatnonzero(free)[outside]] = False
    return step


def _solve_damped(
    information: Float[np.ndarray, "f f"], score: Float[np.ndarray, "f *k"], damping: float
) -> Float[np.ndarray, "f *k"]:
    """Solve damped normal equations, columns scaled, in the directions that are known."""
    size = np.sqrt(np.diagonal(information))
    size = np.where(size > 0.0, size, 1.0)
    eigenvalues, axes = np.linalg.eigh(information / np.outer(size, size))
    known: Bool[np.ndarray, " f"] = eigenvalues > KNOWN * max(float(eigenvalues[-1]), 0.0)
    inverse = (axes[:, known] / (eigenvalues[known] + damping)) @ axes[:, known].T
    return (inverse / np.outer(size, size)) @ score


def _scatter_deviations(
    now: _Point,
    measured: Float[np.ndarray, " m"],
    block: Int[np.ndarray, " m"],
    limit: float,
) -> Float[np.ndarray, " p"]:
    """Estimate standard deviations from the scatter of the blocks' scores."""
    pulling = np.clip(measured - now.predicted, -limit, limit)
    # Liang and Zeger, Biometrika 73(1), 1986.
    scores = np.array([np.bincount(block, slope * pulling) for slope in now.slopes])
    return np.linalg.norm(_solve_damped(now.information, scores, 0.0), axis=1)


def _finish_fit(
    now: _Point, measured: Float[np.ndarray, " m"], step: Float[np.ndarray, " p"], limit: float
) -> HuberFit:
    """Make the last step by the slopes, and weigh each measurement."""
    predicted = now.predicted + step @ now.slopes
    residuals = measured - predicted
    slopes = now.slopes
    if np.isfinite(limit):
        root = np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(residuals), 1e-12)))
        slopes, residuals = slopes * root, residuals * root
    return HuberFit(
        values=now.x + step,
        loss=(now.cost - _expected_gain(now, step)) / len(measured),
        predicted=predicted,
        slopes=slopes,
        residuals=residuals,
    )
