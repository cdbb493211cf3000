r"""Find an accelerometer whose x and y are not the gyro's, by the direction of the drag.

Gravity in a hover shows z alone. Across, an accelerometer reads the drag of the air, which is
against the velocity: the gyro gives the lean (integrated), the lean the velocity (integrated once
more), each without what is slower than `MEMORY`. With all in complex numbers x + i y,

.. math:: f = -\alpha v - \beta \bar v ,

a vehicle with drag has a positive :math:`\alpha`, and a smaller :math:`\beta` by how much its drag
differs between x and y. Axes both reversed make :math:`\alpha` negative, x and y swapped or one of
them reversed make :math:`\beta` the larger.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rotorfit.findings import Evidence, Finding, doubt
from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.recursion import solve_recursion
from rotorfit.flight.signals import running_mean

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Complex, Float

    from rotorfit.flight.flight_data import FlightData

DRAG_DIRECTION: Final = "accelerometer-axes"
"""Kind of the finding that drag has another direction than against the velocity."""
MEMORY: Final = 2.0
"""Time constant with which lean and velocity are forgotten [s]: a bias of the gyro is."""
STEP: Final = 0.01
SMOOTHED: Final = 0.25
"""Steps and length of the mean that are taken [s]: quicker motion is vibration and lever arm."""
BLOCK: Final = 2.0
"""Length of a block that counts as one [s]."""
FEWEST: Final = 6
"""Blocks whose scatter is a deviation."""
MOST_LEAN: Final = 0.6
"""Sine of the largest lean at which velocity grows with it as it should."""
LEAST_ACROSS: Final = 1e-6
"""Share of the motion that is across its main direction, below which the two are one."""
SURE: Final = 6.0
"""Deviations by which a wrong direction is there."""
PURE: Final = 2.0
"""Least size of a wrong direction over all others'."""
LEAST_DRAG: Final = 0.05
"""Least drag that has a direction [1/s]: propellers alone make .1 to .5, misaligned axes .01."""


class DragDirection(NamedTuple):
    """Drag over mass [1/s], by the velocity and by its mirror image, with their deviations."""

    along: complex
    mirrored: complex
    std: float

    @property
    def wrong_axes(self) -> str | None:
        """Name what is wrong with the accelerometer's axes; None where drag is as it should be."""
        found = {
            "both reversed": -self.along.real,
            "turned by 90 degrees": abs(self.along.imag),
            "swapped": abs(self.mirrored.imag),
            "mirrored (one of them reversed)": abs(self.mirrored.real),
        }
        name = max(found, key=lambda key: found[key])
        others = (max(self.along.real, 0.0), *(found[key] for key in found if key != name))
        size = found[name]
        clear = size > max(SURE * self.std, LEAST_DRAG) and size > PURE * max(others)
        return name if clear else None


def accelerometer_axes(data: FlightData) -> Iterator[Finding]:
    """Find accelerometer axes that contradict the direction of the drag."""
    found = drag_direction(data)
    wrong = None if found is None else found.wrong_axes
    if found is None or wrong is None:
        return
    size = max(abs(found.along), abs(found.mirrored))
    yield doubt(
        DRAG_DIRECTION,
        "the air's drag is not against the velocity, as where x and y of the accelerometer are "
        f"{wrong} against the gyro's, which makes the centre of mass and inertia wrong; correct "
        "the accelerometer's axes (columns), and identify again",
        evidence=(Evidence(name="drag_direction", value=size, limit=SURE * found.std),),
    )


def drag_direction(data: FlightData) -> DragDirection | None:
    """Estimate the drag of a flight along the velocity and its mirror; None of short flights."""
    blocks = [
        block
        for segment in data.segments
        for block in _blocks_of_segment(
            data.angular_velocity[segment.start : segment.stop],
            data.specific_force[segment.start : segment.stop],
            data.sample_rate,
        )
    ]
    if len(blocks) < FEWEST:
        return None
    A: Complex[np.ndarray, "b 2 2"] = np.array([np.conj(v).T @ v for v, _ in blocks])
    b: Complex[np.ndarray, "b 2"] = np.array([-np.conj(v).T @ f for v, f in blocks])
    whole: Complex[np.ndarray, "2 2"] = A.sum(axis=0)
    # Hermitian: where its smaller eigenvalue is nothing, all moved along one line.
    if not np.linalg.eigvalsh(whole)[0] > LEAST_ACROSS * float(np.trace(whole).real):
        return None
    found: Complex[np.ndarray, " 2"] = np.asarray(
        np.linalg.solve(whole, b.sum(axis=0)), dtype=complex
    )
    # By the scatter of the blocks (White, Econometrica 48, 1980).
    off: Complex[np.ndarray, "2 b"] = np.asarray(
        np.linalg.solve(whole, np.transpose(b - A @ found)), dtype=complex
    )
    variance = (np.abs(off) ** 2).sum(axis=1) * len(blocks) / (len(blocks) - 2)
    return DragDirection(complex(found[0]), complex(found[1]), float(np.sqrt(variance.max())))


def _blocks_of_segment(
    rates: Float[np.ndarray, "n 3"], force: Float[np.ndarray, "n 3"], sample_rate: float
) -> Iterator[tuple[Complex[np.ndarray, "r 2"], Complex[np.ndarray, " r"]]]:
    """Yield velocity, with its mirror image, and force across of every block of a segment."""
    rows = max(round(STEP * sample_rate), 1)
    count, step = len(rates) // rows, rows / sample_rate
    first, length = round(2.0 * MEMORY / step), round(BLOCK / step)
    if count < first + length or length < 4:
        return
    w, a = (one[: count * rows].reshape(count, rows, 3).mean(axis=1) for one in (rates, force))
    kept = float(np.exp(-step / MEMORY))
    # In axes that do not turn with yaw, lean and velocity are plain integrals.
    turn: Complex[np.ndarray, " n"] = np.exp(1j * np.cumsum(w[:, 2]) * step)
    leaning: Complex[np.ndarray, " n"] = GRAVITY * (w[:, 1] - 1j * w[:, 0]) * turn
    lean = _forget(step * leaning, kept)
    velocity = _forget(step * lean, kept)
    across: Complex[np.ndarray, " n"] = (a[:, 0] + 1j * a[:, 1]) * turn
    for _ in range(2):
        across = _forget(np.diff(across, prepend=across[0]), kept)
    mean = max(round(SMOOTHED / step), 1)
    v, f = (running_mean(x, mean) * np.conj(turn) for x in (velocity, across))
    for start in range(first, count - length - mean, length):
        own = slice(start, start + length)
        if np.abs(lean[own]).max() < MOST_LEAN * GRAVITY:
            yield np.column_stack([v[own], np.conj(v[own])]), f[own]


def _forget(values: Complex[np.ndarray, " n"], kept: float) -> Complex[np.ndarray, " n"]:
    """Sum values up, of which each step keeps a share of what was before."""
    bands = np.full((2, len(values)), -kept, order="F")
    bands[0] = 1.0
    found = solve_recursion(bands, np.column_stack([np.real(values), np.imag(values)]))
    return found[:, 0] + 1j * found[:, 1]
