"""Do the propellers turn as declared? Yaw tells, where a pilot flies it, whatever else it tells.

Before the fit `declared_rotors` looks at one flight with the timing that was declared, and at all
axes together: one wrong spin changes little there. At the timing that was found, and only in the
bands where the rotors explain yaw, one wrong spin shows: the torque of the declared rotors leaves
several times what another pattern leaves, which then looks like tilted motors. And what drags a
rotor can only turn the body against it: k_d, and J_r where k_d does not speak against it, are
positive.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.optimize
from jaxtyping import Bool, Float, Int

from rotorfit.dataset.checks.declared_rotors import BAND, reversed_rotor
from rotorfit.errors import FrameError
from rotorfit.estimation.factors import Factors
from rotorfit.findings import Finding
from rotorfit.fit.fit import Fit
from rotorfit.fit.intervals.excitation import LEAST_EXCITATION
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.model.vehicle import Vehicle
from rotorfit.reduction.frequency_bands import EDGES, excited_bands

BETTER: Final = 0.75
"""Log of how many times less of yaw another pattern of spins leaves, from which it is taken for
the right one. On right declarations another one gets to 0.6 where rotors differ by a tenth, and
not above zero else; a wrong spin makes 0.9 to 4."""
PASSES: Final = 4
"""Of the reweighting by bands."""
CERTAIN: Final = 2.0
"""Half-widths by which J_r must be below zero: it may be about zero, and follows the timing."""
REVERSED: Final = "reverse all spins (props out instead of in, or in instead of out)"

_TINY: Final = float(np.finfo(float).tiny)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Yaw:
    """The yaw row of some blocks: its angular acceleration, and what may turn the body."""

    target: Float[np.ndarray, "b z"]
    drives: Float[np.ndarray, "b z k"]
    thrust: Float[np.ndarray, "b z"]
    band: Int[np.ndarray, " b"]
    factors: Factors


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fit:
    """What one pattern of spins leaves of yaw: log of the power per row and band.

    `log_left_by_drag` is the same without the spin-up of the rotors.
    """

    log_left: Float[np.ndarray, " b"]
    log_left_by_drag: Float[np.ndarray, " b"]
    excited: Bool[np.ndarray, " b"]
    rows: Int[np.ndarray, " b"]


def refuse_wrong_spins(fit: Fit) -> Iterator[Finding]:
    """Refuse declared spins that yaw contradicts."""
    dataset = fit.dataset
    if not dataset.timing_identifiable:
        return  # nobody flies: what yaw does is the autopilot's answer to gusts and noise
    sentence = better_spins(dataset.vehicle, dataset.yaw_bands()) or negative_drag(
        [c.name for c in fit.configurations], fit.numbers
    )
    if sentence is not None:
        raise FrameError(sentence).about(kind="wrong-spin")
    yield Finding(kind="wrong-spin", severity="passed")


def better_spins(declared: Vehicle, bands: Sequence[Factors]) -> str | None:
    """Name the spins that explain yaw much better; None where none do, or yaw is not flown.

    `bands`: factors of the signals of yaw (`model.signals.yaw_signals`) of each configuration.
    """
    plain = _fits(declared, bands)
    gains: list[tuple[float, str]] = []
    for other, words in _other_spins(declared):
        fits = _fits(other, bands)
        gain = _gain(plain, fits)
        if not (other.spins == declared.spins).any():
            # An autopilot's answer to gusts looks like a spin-up of reversed rotors, not like drag.
            gain = min(gain, _gain(plain, fits, by_drag=True))
        gains.append((gain, words))
    gain, words = max(gains)
    if gain <= BETTER:
        return None
    return (
        f"yaw contradicts the declared spins: with {words} the rotors leave {np.exp(gain):.1f} "
        "times less of it unexplained; correct the spin"
    )


def negative_drag(configurations: Sequence[str], numbers: Numbers) -> str | None:
    """Explain that the propellers turn the other way, where drag is negative; None elsewhere."""
    for name in configurations:
        low, high = numbers.interval(f"kd_over_Izz@{name}")
        if high < 0.0:
            return _reversed_sentence("kd / Izz", name, low, high)
        # Where nobody yaws, an autopilot's answer to gusts looks like reversed rotors' spin-up.
        if low > 0.0 or not (numbers.rho(f"Jr_over_Izz@{name}") or 0.0) > LEAST_EXCITATION:
            continue
        low, high = numbers.interval(f"Jr_over_Izz@{name}")
        if high + 0.5 * (CERTAIN - 1.0) * (high - low) < 0.0:
            return _reversed_sentence("Jr / Izz", name, low, high)
    return None


def _reversed_sentence(name: str, configuration: str, low: float, high: float) -> str:
    return (
        f"{name} of {configuration} comes out below zero ({low:.3g} to {high:.3g}), which no rotor "
        f"has: the propellers turn the other way than declared: {REVERSED}"
    )


def _other_spins(vehicle: Vehicle) -> Iterator[tuple[Vehicle, str]]:
    """Yield all spins reversed, then each alone."""
    rotors = vehicle.rotors
    turned = [reversed_rotor(rotor) for rotor in rotors]
    yield replace(vehicle, rotors=tuple(turned)), "every spin reversed (props out instead of in)"
    for i, rotor in enumerate(turned):
        others = (*rotors[:i], rotor, *rotors[i + 1 :])
        yield replace(vehicle, rotors=others), f"rotor {i + 1} {rotor.spin}"


def _fits(vehicle: Vehicle, bands: Sequence[Factors]) -> list[_Fit]:
    """Fit the yaw of every configuration with the spins of a vehicle."""
    return [_fit(_yaw(factors, vehicle)) for factors in bands]


def _yaw(factors: Factors, vehicle: Vehicle) -> _Yaw:
    """Select the yaw row in the band in which a vehicle responds to its rotors."""
    factors = factors.select((factors.band[:, 1] > BAND[0]) & (factors.band[:, 0] < BAND[1]))
    n, s = vehicle.axes, vehicle.spins
    squares, spin_up = np.split(factors.R[:, :, 1:], [len(s)], axis=2)
    drives = [squares @ (-s * n[:, 2]), spin_up @ (-s * n[:, 2])]
    lever = np.cross(vehicle.positions, n)[:, 2]
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


def _fit(yaw: _Yaw) -> _Fit:
    """Fit yaw by drives with positive coefficients, each band weighted by its residual."""
    left = _reweighted(yaw)
    total = (yaw.target**2).sum(axis=1)
    rows = yaw.factors.rows
    drag = _reweighted(replace(yaw, drives=yaw.drives[:, :, [0, *range(2, yaw.drives.shape[2])]]))
    return _Fit(
        log_left=np.log(_per_row(left, rows, yaw.band)),
        log_left_by_drag=np.log(_per_row(drag, rows, yaw.band)),
        excited=excited_bands(yaw.factors, total[:, None], left[:, None])[:, 0],
        rows=rows,
    )


def _reweighted(yaw: _Yaw) -> Float[np.ndarray, " b"]:
    """Compute the residual power of each block, the bands weighted by it."""
    weight, left = np.ones(len(yaw.band)), (yaw.target**2).sum(axis=1)
    for _ in range(PASSES):
        left = _left(yaw, weight)
        weight = 1.0 / _per_row(left, yaw.factors.rows, yaw.band)
    return left


def _per_row(
    power: Float[np.ndarray, " b"], rows: Int[np.ndarray, " b"], band: Int[np.ndarray, " b"]
) -> Float[np.ndarray, " b"]:
    """Return the power per row of each block's band."""
    sums = np.bincount(band, weights=power) / np.maximum(np.bincount(band, weights=rows), 1.0)
    return np.maximum(sums[band], _TINY)


def _left(yaw: _Yaw, weight: Float[np.ndarray, " b"]) -> Float[np.ndarray, " b"]:
    """Compute the residual power of each block, without the part that varies with all thrust.

    Thrust acts on a centre of mass that is off the centre, and on motors that lean.
    """
    root = np.sqrt(weight)[:, None]
    shape = yaw.drives.shape
    columns = np.concatenate([yaw.drives, yaw.target[:, :, None]], axis=2) * root[:, :, None]
    columns = columns.reshape(-1, shape[2] + 1)
    thrust = (yaw.thrust * root).reshape(-1)
    size = float(thrust @ thrust)
    if size > 0.0:
        columns = columns - np.outer(thrust, thrust @ columns / size)
    length = np.maximum(np.linalg.norm(columns[:, :-1], axis=0), _TINY)
    found, _ = scipy.optimize.nnls(columns[:, :-1] / length, columns[:, -1])
    errors = columns[:, -1] - columns[:, :-1] @ (found / length)
    return (errors.reshape(shape[:2]) ** 2).sum(axis=1) / weight


def _gain(plain: Sequence[_Fit], other: Sequence[_Fit], *, by_drag: bool = False) -> float:
    """Compute the log of how many times less another pattern leaves, over rows of excited bands.

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


REFUSALS: Final = (refuse_wrong_spins,)
