"""Search the spins that leave the least residual of yaw, without the rest of the model.

Only the yaw row is looked at, band by band; `spin_search.py` fits what it suspects with the whole
model.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.least_squares import nonnegative_solution
from rotorfit.fit.dataset.response_signals import BAND
from rotorfit.fit.reduction.frequency_bands import EDGES, excited_bands
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.vehicle import Vehicle, reversed_rotor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float, Int

    from rotorfit.estimation.factors import Factors

    Pattern = Float[np.ndarray, " N"]
    """A sign for each rotor: +1 where it spins as declared, -1 where it spins the other way."""

WORTH: Final = 0.05
"""Log of how many times less of yaw other spins must leave by themselves to be looked at."""
HOPELESS: Final = 0.7
"""Log of how many times more of yaw spins may leave by themselves to be fitted at all: what the yaw
row alone lacks (products of inertia, trims) does not double its residual."""
PASSES: Final = 4
"""Passes of the reweighting by bands."""
_TINY: Final = float(np.finfo(float).tiny)


@frozen_dataclass
class _Yaw:
    """The yaw row of some blocks: its angular acceleration, and what may turn the body."""

    target: Float[np.ndarray, "b z"]
    drives: Float[np.ndarray, "b z k"]
    thrust: Float[np.ndarray, "b z"]
    band: Int[np.ndarray, " b"]
    factors: Factors


@frozen_dataclass
class _Fit:
    """The residual of yaw with one pattern of spins: log of the power per row and band.

    `log_left_by_drag` is the same without the spin-up of the rotors.
    """

    log_left: Float[np.ndarray, " b"]
    log_left_by_drag: Float[np.ndarray, " b"]
    excited: Bool[np.ndarray, " b"]
    rows: Int[np.ndarray, " b"]


def with_spins(vehicle: Vehicle, pattern: Pattern) -> Vehicle:
    """Return the vehicle with those rotors reversed where the pattern is -1."""
    rotors = (
        reversed_rotor(rotor) if sign < 0.0 else rotor
        for rotor, sign in zip(vehicle.rotors, pattern.tolist(), strict=True)
    )
    return replace(vehicle, rotors=tuple(rotors))


def smaller_yaw_residuals(declared: Vehicle, bands: Sequence[Factors]) -> list[Pattern]:
    """List the spins that leave a smaller residual of yaw: one reversed after the other, or all.

    `bands`: factors of the signals of yaw (`model.signals.yaw_signals`) of each configuration.
    """
    ones = np.ones(len(declared.rotors))
    plain = _fit_configurations(declared, bands)
    best, reached = ones, plain
    suspects: list[Pattern] = []
    for _ in range(len(ones) // 2):
        tried = [(best * _flip_spins(len(ones), i)) for i in range(len(ones))]
        fits = [_fit_configurations(with_spins(declared, p), bands) for p in tried]
        gains = [_pattern_gain(reached, one) for one in fits]
        most = int(np.argmax(gains))
        if gains[most] < WORTH:
            break
        best, reached = tried[most], fits[most]
        suspects.append(best)
    # An autopilot's response to gusts looks like a spin-up of reversed rotors, not like drag.
    if (
        _pattern_gain(plain, _fit_configurations(with_spins(declared, -ones), bands), by_drag=True)
        > WORTH
    ):
        suspects.append(-ones)
    return suspects


def plausible_patterns(
    declared: Vehicle, bands: Sequence[Factors], patterns: Sequence[Pattern]
) -> list[Pattern]:
    """Keep the spins that leave not far more of yaw by itself than the declared ones."""
    plain = _fit_configurations(declared, bands)
    kept: list[Pattern] = []
    for pattern in patterns:
        other = _fit_configurations(with_spins(declared, pattern), bands)
        excited = any(
            (one.excited | two.excited).any() for one, two in zip(plain, other, strict=True)
        )
        # Where nobody yaws the residual is the same with all.
        if excited and _pattern_gain(plain, other) > -HOPELESS:
            kept.append(pattern)
    return kept


def _flip_spins(rotors: int, which: int) -> Pattern:
    pattern = np.ones(rotors)
    pattern[which] = -1.0
    return pattern


def _fit_configurations(vehicle: Vehicle, bands: Sequence[Factors]) -> list[_Fit]:
    """Fit the yaw of every configuration with the spins of a vehicle."""
    return [_fit_yaw(_select_yaw_row(factors, vehicle)) for factors in bands]


def _select_yaw_row(factors: Factors, vehicle: Vehicle) -> _Yaw:
    """Select the yaw row in the band in which a vehicle responds to its rotors."""
    factors = factors.select((factors.band[:, 1] > BAND[0]) & (factors.band[:, 0] < BAND[1]))
    n, s = vehicle.axes, vehicle.spins
    squares, spin_up = np.split(factors.R[:, :, 1:], [len(s)], axis=2)
    drives = [squares @ (-s * n[:, 2]), spin_up @ (-s * n[:, 2])]
    lever = vehicle.levers[:, 2]
    if lever.any():
        drives.append(squares @ lever)
    middle: Float[np.ndarray, " b"] = factors.band.mean(axis=1)
    band: Int[np.ndarray, " b"] = (middle[:, None] >= np.array(EDGES)).sum(axis=1)
    return _Yaw(
        target=factors.R[:, :, 0],
        drives=np.stack(drives, axis=-1),
        thrust=squares @ n[:, 2],
        band=band,
        factors=factors,
    )


def _fit_yaw(yaw: _Yaw) -> _Fit:
    """Fit yaw by drives with positive coefficients, each band weighted by its residual."""
    left = _reweighted_residual(yaw)
    total = (yaw.target**2).sum(axis=1)
    rows = yaw.factors.rows
    drag = _reweighted_residual(
        replace(yaw, drives=yaw.drives[:, :, [0, *range(2, yaw.drives.shape[2])]])
    )
    return _Fit(
        log_left=np.log(_per_row(left, rows, yaw.band)),
        log_left_by_drag=np.log(_per_row(drag, rows, yaw.band)),
        excited=excited_bands(yaw.factors, total[:, None], left[:, None])[:, 0],
        rows=rows,
    )


def _reweighted_residual(yaw: _Yaw) -> Float[np.ndarray, " b"]:
    """Compute the residual power of each block, the bands weighted by it."""
    weight, left = np.ones(len(yaw.band)), (yaw.target**2).sum(axis=1)
    for _ in range(PASSES):
        left = _residual_power(yaw, weight)
        weight = 1.0 / _per_row(left, yaw.factors.rows, yaw.band)
    return left


def _per_row(
    power: Float[np.ndarray, " b"], rows: Int[np.ndarray, " b"], band: Int[np.ndarray, " b"]
) -> Float[np.ndarray, " b"]:
    sums = np.bincount(band, weights=power) / np.maximum(np.bincount(band, weights=rows), 1.0)
    return np.maximum(sums[band], _TINY)


def _residual_power(yaw: _Yaw, weight: Float[np.ndarray, " b"]) -> Float[np.ndarray, " b"]:
    """Compute the residual power of each block, without the part that varies with all thrust."""
    root = np.sqrt(weight)[:, None]
    shape = yaw.drives.shape
    columns = np.concatenate([yaw.drives, yaw.target[:, :, None]], axis=2) * root[:, :, None]
    columns = columns.reshape(-1, shape[2] + 1)
    thrust = (yaw.thrust * root).reshape(-1)
    size = float(thrust @ thrust)
    # Thrust acts on a centre of mass that is off the centre, and on motors that lean.
    if size > 0.0:
        columns = columns - np.outer(thrust, thrust @ columns / size)
    length = np.maximum(np.linalg.norm(columns[:, :-1], axis=0), _TINY)
    scaled = columns[:, :-1] / length
    found = nonnegative_solution(scaled.T @ scaled, scaled.T @ columns[:, -1])
    errors = columns[:, -1] - columns[:, :-1] @ (found / length)
    return (errors.reshape(shape[:2]) ** 2).sum(axis=1) / weight


def _pattern_gain(plain: Sequence[_Fit], other: Sequence[_Fit], *, by_drag: bool = False) -> float:
    """Compute the gain of log-likelihood of another pattern, over rows of excited bands.

    A band is excited where either pattern explains it.
    """
    gain = rows = 0.0
    for one, two in zip(plain, other, strict=True):
        excited = one.excited | two.excited
        less = one.log_left - two.log_left
        if by_drag:
            less = one.log_left_by_drag - two.log_left_by_drag
        gain += float((less * one.rows)[excited].sum())
        rows += float(one.rows[excited].sum())
    return gain / rows if rows > 0.0 else 0.0
