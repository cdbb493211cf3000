"""The nearest body to an estimate that can exist (`checks/impossible_inertia.py`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.checks.impossible_inertia import ESTIMATE, moment_slopes
from rotorfit.errors import EstimationError
from rotorfit.estimation.consistent import nearest_consistent
from rotorfit.fit.experiment.payload import MOMENTS
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import INERTIA, INERTIA_PLACES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.results.result import IdentificationResult


@frozen_dataclass
class Projected:
    """The body nearest to an estimate that can exist.

    Attributes
    ----------
    values
        First moments and inertia at the origin, by their names; SI.
    distance
        From the estimate, in standard deviations of its covariance; 0 if it could exist already.
    """

    values: Mapping[str, float]
    distance: float


def project_to_physical(
    result: IdentificationResult, configuration: str | None = None
) -> Projected:
    """Project an estimate to the nearest body, in its own covariance, that can exist.

    An inertia that was withheld because no body has it stands as it was estimated. A first moment
    or product that is not known stands as zero, give or take what a body of these moments of
    inertia can have.

    Parameters
    ----------
    result
        With mass and moments of inertia of the configuration.
    configuration
        Its name; may be left out where there is one.

    Raises
    ------
    EstimationError
        If mass or a moment of inertia of that configuration is not known, the configuration is not
        in the result, several are there and none is named, or the projection needs a library that
        is not installed (the extra ``physical``).
    """
    values, covariance, mass = nine_moments(result, configuration)
    # In units of the mass and of a length of the body, so that all entries are of one size.
    length = float(np.sqrt(abs(values[3:6]).max() / mass))
    units = mass * np.array([length] * 3 + [length**2] * 6)
    constant = np.zeros((4, 4))
    constant[3, 3] = 1.0
    nearest = nearest_consistent(
        values / units, covariance / np.outer(units, units), (constant, _pseudo_slopes())
    )
    return Projected(
        values=dict(zip(MOMENTS, (nearest.values * units).tolist(), strict=True)),
        distance=nearest.distance,
    )


def nine_moments(
    result: IdentificationResult, configuration: str | None
) -> tuple[Float[np.ndarray, " 9"], Float[np.ndarray, "9 9"], float]:
    """Return the nine moments of a configuration with their covariance, and its mass."""
    owners = [p.configuration for p in result.parameters if p.name == "mass"]
    if configuration is None and len(owners) > 1:
        raise EstimationError(
            f"{len(owners)} configurations ({', '.join(map(str, owners))}): name the one to project"
        )
    if configuration is not None and configuration not in owners:
        raise EstimationError(
            f"no configuration {configuration!r} in this result; it has "
            f"{', '.join(map(str, owners))}: name one of them"
        )
    mass = result.parameter("mass", configuration)
    at = {name: f"{name}@{mass.configuration}" for name in MOMENTS}
    found = {name: _moment_estimate(result, name, at[name]) for name in MOMENTS}
    unknown = [name for name in ("Ixx", "Iyy", "Izz") if found[name] is None]
    if unknown or mass.value is None:
        names = ", ".join([*(["mass"] if mass.value is None else []), *unknown])
        raise EstimationError(
            f"{mass.configuration}: {names} not known, and without it there is no nearest body; "
            "fly what the result advises, then identify again"
        )
    diagonal = [known[0] for name in ("Ixx", "Iyy", "Izz") if (known := found[name]) is not None]
    filled = [
        found[name] or (0.0, _widest_deviation(name, diagonal, mass.value)) for name in MOMENTS
    ]
    covariance = np.diag([std**2 for _, std in filled])
    names = list(result.covariance_names)
    own = [i for i, name in enumerate(MOMENTS) if at[name] in names]
    places = [names.index(at[MOMENTS[i]]) for i in own]
    covariance[np.ix_(own, own)] = result.covariance[np.ix_(places, places)]
    return np.array([value for value, _ in filled]), covariance, mass.value


def _moment_estimate(
    result: IdentificationResult, name: str, full: str
) -> tuple[float, float] | None:
    """Return value and deviation of a moment, also of a withheld one; None if it is not known."""
    parameter = result.parameter(name, full.partition("@")[2])
    if parameter.value is not None:
        return parameter.value, parameter.std or 0.0
    value, std = (result.diagnostics.get(f"{ESTIMATE}{k}_{full}") for k in ("value", "std"))
    return None if value is None or std is None else (value, std)


def _widest_deviation(name: str, diagonal: Sequence[float], mass: float) -> float:
    """Return a deviation that no body of these moments of inertia exceeds by much."""
    if name in INERTIA:
        i, j = INERTIA_PLACES[INERTIA.index(name)]
        return 0.5 * float(np.sqrt(abs(diagonal[i] * diagonal[j])))
    return 0.5 * float(np.sqrt(mass * max(map(abs, diagonal))))


def _pseudo_slopes() -> Float[np.ndarray, "9 4 4"]:
    """Return the derivative of the pseudo-inertia by each of `MOMENTS`."""
    slopes = np.zeros((len(MOMENTS), 4, 4))
    for axis in range(3):
        slopes[axis, axis, 3] = slopes[axis, 3, axis] = 1.0
    for number, matrix in enumerate(moment_slopes(), start=3):
        slopes[number, :3, :3] = matrix
    return slopes
