r"""Vehicles drawn from the joint distribution of a result, each of which can exist.

The estimate is normal with its joint covariance, so that what is known only together stays
together (kd and Izz, the inertias and kt). Draws that nature does not have are left out, which
makes it the posterior under the constraint that there is such a vehicle: second moments of the
mass, 1/2 tr(I) 1 - I, not negative (Wensing, Kim and Slotine 2017, arXiv 1701.04395), thrust
upwards, drag torque against the spin, motors without a lag below zero.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import COM, FIRST_MOMENTS, INERTIA, INERTIA_COM, INERTIA_PLACES
from rotorfit.sheet import DataFrame, frame

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Bool, Float

    Values = dict[str, Float[np.ndarray, " n"]]
    """Numbers by name, one for each draw."""

LEAST_KEPT: Final = 0.002
"""Share of the draws that can exist, below which the estimate itself is at fault."""
BLOCK: Final = 4096
_ABOVE_ZERO: Final = re.compile(r"mass|kt|kt_\d+|kd|max_speed")
_NOT_BELOW_ZERO: Final = re.compile(r"Jr|motor_lag(_up|_down)?")
"""A delay is below zero where motors are recorded late."""


@frozen_dataclass
class Estimated:
    """A number of a vehicle as it was estimated.

    - `value`, `std`, `unit`: SI; a number of which no std is known (0) stands still.
    - `column`: its place in the joint covariance; None if it stands apart.
    """

    value: float
    std: float
    unit: str
    column: int | None = None


@frozen_dataclass
class Samples:
    """Vehicles drawn from the joint posterior of a result.

    Attributes
    ----------
    configuration
        Whose body it is.
    values
        By the names of parameters and of derived numbers (``com_x``, ``Ixx_com``), one number for
        each vehicle; SI, FLU.
    units
        Of each.
    seed
        Of the draws.
    rejected
        Share of all draws that no vehicle can have, and that were left out.
    reasons
        Why, with the share of the draws that fail by each; a draw may fail by several.
    fixed
        Names of numbers that are the same in all vehicles: given, or without an uncertainty.
    missing
        What these flights do not determine, and no vehicle here has.
    """

    configuration: str
    values: Mapping[str, Float[np.ndarray, " n"]]
    units: Mapping[str, str]
    seed: int
    rejected: float
    reasons: Mapping[str, float]
    fixed: tuple[str, ...]
    missing: tuple[str, ...]

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    def to_frame(self) -> DataFrame:
        """Return the vehicles as a pandas DataFrame, one row each.

        Raises
        ------
        OutputError
            If pandas is not installed.
        """
        return frame({name: column.tolist() for name, column in self.values.items()})

    def __str__(self) -> str:
        why = "".join(f"; {words}: {100 * share:.2g} %" for words, share in self.reasons.items())
        lacks = f"; not determined: {', '.join(self.missing)}" if self.missing else ""
        return (
            f"{len(self)} vehicles {self.configuration}, {len(self.values)} numbers each; "
            f"{100 * self.rejected:.2g} % of the draws rejected{why}{lacks}"
        )


def draw_vehicles(
    estimated: Mapping[str, Estimated],
    covariance: Float[np.ndarray, "p p"],
    n: int,
    *,
    seed: int,
    configuration: str,
    missing: tuple[str, ...] = (),
) -> Samples:
    """Draw vehicles that can exist from the joint distribution of their numbers.

    Parameters
    ----------
    estimated
        Numbers by name, with ``mass`` [kg].
    covariance
        Joint, of those that have a column in it.
    n
        How many vehicles.
    seed
        Of the draws: the same seed gives the same vehicles.
    configuration, missing
        Passed on.

    Raises
    ------
    EstimationError
        If hardly a draw can exist.
    """
    random = np.random.default_rng(seed)
    kept: list[Values] = []
    count, drawn = 0, 0
    failed: dict[str, int] = {}
    while count < n:
        values = about_com(_draw_block(estimated, covariance, random))
        good = np.ones(BLOCK, dtype=bool)
        for words, possible in _vehicle_conditions(values).items():
            failed[words] = failed.get(words, 0) + int(np.count_nonzero(~possible))
            good &= possible
        kept.append({name: column[good] for name, column in values.items()})
        count += int(np.count_nonzero(good))
        drawn += BLOCK
        if count < LEAST_KEPT * drawn:
            raise EstimationError(_none_exists(failed, drawn))
    whole = {name: np.concatenate([block[name] for block in kept])[:n] for name in kept[0]}
    return Samples(
        configuration=configuration,
        values=whole,
        units={name: _unit_of_number(name, estimated) for name in whole},
        seed=seed,
        rejected=1.0 - count / drawn,
        reasons={words: times / drawn for words, times in failed.items() if times},
        fixed=tuple(name for name, e in estimated.items() if e.std == 0.0),
        missing=missing,
    )


def _draw_block(
    estimated: Mapping[str, Estimated],
    covariance: Float[np.ndarray, "p p"],
    random: np.random.Generator,
) -> Values:
    together = normal_draws(covariance, BLOCK, random)
    return {
        name: e.value
        + (e.std * random.standard_normal(BLOCK) if e.column is None else together[:, e.column])
        for name, e in estimated.items()
    }


def _vehicle_conditions(values: Values) -> dict[str, Bool[np.ndarray, " n"]]:
    """List the conditions of a vehicle in words, each with the draws that fulfil it."""
    out = {
        f"{name} above 0": column > 0.0
        for name, column in values.items()
        if _ABOVE_ZERO.fullmatch(name)
    }
    out |= {
        f"{name} not below 0": column >= 0.0
        for name, column in values.items()
        if _NOT_BELOW_ZERO.fullmatch(name)
    }
    if all(name in values for name in INERTIA_COM):
        inertia = tensors(values)
        half_trace = 0.5 * np.trace(inertia, axis1=1, axis2=2)
        out["a body with that inertia"] = half_trace >= np.linalg.eigvalsh(inertia)[:, -1]
    return out


def _none_exists(failed: Mapping[str, int], drawn: int) -> str:
    worst = max(failed, key=lambda words: failed[words])
    return (
        f"of {drawn} draws hardly one is a vehicle that can exist ({worst}: "
        f"{100 * failed[worst] / drawn:.3g} % fail): fly what the report advises and identify "
        "again, or project_to_physical for the nearest body"
    )


def _unit_of_number(name: str, estimated: Mapping[str, Estimated]) -> str:
    if name in estimated:
        return estimated[name].unit
    return "m" if name in COM else "kg m^2"


def normal_draws(
    covariance: Float[np.ndarray, "p p"], count: int, random: np.random.Generator
) -> Float[np.ndarray, "n p"]:
    """Draw with mean zero; a covariance may be singular, as where kt is the mean of kt_i."""
    powers, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(powers, 0.0))
    return random.standard_normal((count, len(powers))) @ root.T


def about_com(values: Values) -> Values:
    """Add the CoM, and the inertia about it, to values at the origin.

    `values` have ``mass``, and first moments and inertia as far as they are known.
    """
    m, out = values["mass"], dict(values)
    out |= {
        name: values[moment] / m
        for name, moment in zip(COM, FIRST_MOMENTS, strict=True)
        if moment in values
    }
    if not all(name in out for name in COM):
        return out
    com = np.stack([out[name] for name in COM], axis=1)
    square = np.einsum("di,di->d", com, com)
    for name, (i, j) in zip(INERTIA, INERTIA_PLACES, strict=True):
        if name in values:
            moved = m * ((square if i == j else 0.0) - com[:, i] * com[:, j])
            out[f"{name}_com"] = values[name] - moved
    return out


def tensors(values: Mapping[str, Float[np.ndarray, " n"]]) -> Float[np.ndarray, "n 3 3"]:
    """Return the inertia about the CoM of each draw [kg m^2]."""
    columns = [values[f"{name}_com"] for name in INERTIA]
    out = np.empty((len(columns[0]), 3, 3))
    for column, (i, j) in zip(columns, INERTIA_PLACES, strict=True):
        out[:, i, j] = out[:, j, i] = column
    return out
