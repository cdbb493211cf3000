"""Known payloads: what point masses add to a body, and how well that is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import FIRST_MOMENTS, INERTIA, inertia_about

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float

MOMENTS = (*FIRST_MOMENTS, *INERTIA)
"""The parameters to which a payload adds, in this order."""


@frozen_dataclass
class PointMass:
    """One item of a payload: mass [kg], position of its centre from the body origin, FLU [m]."""

    mass: float
    position: tuple[float, float, float]
    mass_std: float = 0.0
    position_std: float = 0.0


def added_moments(payload: Sequence[PointMass]) -> dict[str, float]:
    """Sum first moments [kg m] and inertia at the origin [kg m^2] of point masses."""
    total = np.zeros(len(MOMENTS))
    for item in payload:
        total += _moments_at_origin(item.mass, np.array(item.position))
    return dict(zip(MOMENTS, total.tolist(), strict=True))


def tolerances(payload: Sequence[PointMass]) -> Iterator[tuple[str, float, dict[str, float]]]:
    """Yield name, deviation and effect of every error of a payload that is not exact.

    The effect is the derivative of `MOMENTS` by that error: what stands in the parameter map.
    """
    for number, item in enumerate(payload, start=1):
        position = np.array(item.position)
        if item.mass_std > 0:
            yield (
                f"payload_{number}_mass",
                item.mass_std,
                _name_moments(_moments_at_origin(1.0, position)),
            )
        if item.position_std > 0:
            for axis, step in zip("xyz", np.eye(3) * item.position_std, strict=True):
                # Quadratic in the position: the central difference is the derivative.
                up = _moments_at_origin(item.mass, position + step)
                down = _moments_at_origin(item.mass, position - step)
                effect = _name_moments((up - down) / (2.0 * item.position_std))
                yield f"payload_{number}_{axis}", item.position_std, effect


def _moments_at_origin(mass: float, position: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 9"]:
    inertia = inertia_about(np.zeros(6), mass, position)
    return np.concatenate([mass * position, inertia])


def _name_moments(values: Float[np.ndarray, " 9"]) -> dict[str, float]:
    return dict(zip(MOMENTS, values.tolist(), strict=True))
