r"""The gyro's bias in a flight without rest: a constant turn that a vehicle cannot have made.

Where the log has an attitude, it turns as the gyro says but for the bias. Else gravity shows it:
turned into axes that a gyro with the bias b carries, the specific force f leans by
:math:`c = \int C b\,dt`, and what it gains of velocity goes as :math:`\int c \times f\,dt`, beyond
any that a vehicle has for long. A bias about the vertical does not show by gravity.

Small biases are left to those who carry axes (`carried_weight.py`); a large one is taken off.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.findings import Evidence, Finding, doubt
from rotorfit.flight.filters import without_line
from rotorfit.flight.flight_checks import imu_doubts
from rotorfit.flight.kinematics import (
    carried_group,
    rotated,
    rotation_matrices,
    running_product,
    small_turns,
)
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float

    from rotorfit.flight.clocks import UniformChannels
    from rotorfit.flight.flight_data import FlightData

    Runs = Sequence[tuple[int, int]]
    Windows = list[tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "m 3"]]]
    """Rates [rad/s] and specific force [m/s^2] of each window."""

GYRO_BIAS: Final = "gyro-bias"
"""Kind of the finding that a gyro's bias is large, or is left in."""
GRAVITY: Final = "gravity"
LARGE: Final = 0.08
"""Bias from which it is taken off [rad/s]: sound gyros have up to 0.01, and what 55 sound flights
show by gravity alone is up to 0.04."""
DEVIATIONS: Final = 2.5
"""Least bias over its deviation, which is a cautious one."""
BY_ATTITUDE: Final = 0.5
"""Window over which attitude and gyro are compared [s]."""
FEWEST: Final = 8
"""Such windows."""
BY_GRAVITY: Final = 8.0
"""Longest window in which gravity shows a bias [s]."""
SHORTEST: Final = 2.0
VELOCITY: Final = 1.5
"""Usual deviation of a velocity from a straight line [m/s]."""
FORGOTTEN: Final = 4.0
"""Time in which it becomes another one [s]."""
PRIOR: Final = 0.3
"""Deviation of a bias before the flight [rad/s]."""
PASSES: Final = 6
"""A bias of 0.2 rad/s turns the axes by 1.6 rad in eight seconds."""


@frozen_dataclass
class FlownBias:
    """The gyro's bias as a flight shows it.

    - `value`: body axes [rad/s].
    - `std`: its deviation.
    - `reference`: what contradicts the gyro.
    """

    value: Float[np.ndarray, "3"]
    std: Float[np.ndarray, "3"]
    reference: str

    @property
    def is_large(self) -> bool:
        """Whether some axis has a bias that no sound gyro has."""
        size = np.abs(self.value)
        return bool(((size > LARGE) & (size > DEVIATIONS * self.std)).any())


def flown_gyro_bias(uniform: UniformChannels, flights: Runs) -> FlownBias | None:
    """Return the gyro's bias by attitude or gravity; None if it is small, or not known."""
    found = bias_by_attitude(uniform, flights) or bias_by_gravity(uniform, flights)
    return found if found is not None and found.is_large else None


def doubts_of_imu(
    data: FlightData,
    uniform: UniformChannels,
    at_rest: tuple[float, float, float] | None,
    flown: FlownBias | None,
) -> Iterator[Finding]:
    """Yield the doubts of the IMU; `at_rest`, `flown`: bias at rest, or in a flight without one."""
    if flown is None:
        yield from imu_doubts(data, uniform, at_rest)
        return
    yield flown_bias_doubt(flown)
    yield from (one for one in imu_doubts(data, uniform, None) if one.kind != GYRO_BIAS)


def flown_bias_doubt(bias: FlownBias) -> Finding:
    """Say that the gyro reads a turn that the vehicle did not make."""
    x, y, z = bias.value
    known = "" if bias.reference != GRAVITY else "; about the vertical it is not known"
    return doubt(
        GYRO_BIAS,
        f"the gyro reads {x:.2f}, {y:.2f}, {z:.2f} rad/s (x, y, z) more than the vehicle turns, as "
        f"{bias.reference} shows (taken off{known}): calibrate it, and leave the vehicle still on "
        "the ground for two seconds before take-off",
        evidence=(Evidence(name="flown_gyro_bias", value=float(np.abs(bias.value).max())),),
    )


def bias_by_attitude(uniform: UniformChannels, flights: Runs) -> FlownBias | None:
    """Compare the turns of gyro and logged attitude; None without an attitude that follows it."""
    axes = uniform.values.get("world_axes")
    if axes is None:
        return None
    if not np.diff(axes[np.isfinite(axes).all(axis=1)], axis=0).any():
        return None  # one that stands still is none
    group = carried_group(uniform.sample_rate)
    length = max(round(BY_ATTITUDE * uniform.sample_rate / group), 2) * group
    starts = np.array([s for a, b in flights for s in range(a, b - length, length)], dtype=int)
    starts = starts[np.isfinite(axes[starts]).all(axis=1)]
    starts = starts[np.isfinite(axes[starts + length]).all(axis=1)]
    if len(starts) < FEWEST:
        return None
    seconds = length / uniform.sample_rate
    rows = starts + np.arange(0, length, group)[:, None, None] + np.arange(group)[:, None]
    rates = uniform.values["gyro"][rows].mean(axis=1)
    turned = running_product(small_turns(rates * group / uniform.sample_rate))[-1]
    logged = _to_world(axes[starts]).swapaxes(1, 2) @ _to_world(axes[starts + length])
    left = logged.swapaxes(1, 2) @ rotation_matrices(turned)
    off = 0.5 * np.stack([left[:, 2, 1], left[:, 0, 2], left[:, 1, 0]], axis=-1)
    off = (off - 0.5 * np.stack([left[:, 1, 2], left[:, 2, 0], left[:, 0, 1]], axis=-1)) / seconds
    value = np.median(off, axis=0)
    scatter = 1.48 * np.median(np.abs(off - value), axis=0)
    if float(scatter.max()) > max(LARGE, 0.5 * float(np.abs(value).max())):
        return None  # another vehicle's attitude, other axes
    return FlownBias(
        value=value, std=1.25 * scatter / np.sqrt(len(starts)), reference="the attitude"
    )


def _to_world(axes: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 3 3"]:
    """Return the rotations from body to world, by the world's x and y in body axes."""
    x, y = axes[:, :3], axes[:, 3:]
    return np.stack([x, y, np.cross(x, y)], axis=1)


def bias_by_gravity(uniform: UniformChannels, flights: Runs) -> FlownBias | None:
    """Fit the bias that holds the carried specific force still; None of short flights."""
    windows = _gravity_windows(uniform, flights)
    if not windows:
        return None
    step = carried_group(uniform.sample_rate) / uniform.sample_rate
    value, normal, left = np.zeros(3), np.zeros((3, 3)), 0.0
    for _ in range(PASSES):
        parts = [_velocity_by_bias(rates - value, force, step) for rates, force in windows]
        A = np.concatenate([columns.reshape(-1, 3) for columns, _ in parts])
        b = np.concatenate([gained.ravel() for _, gained in parts])
        weight = step / FORGOTTEN / VELOCITY**2
        normal = weight * A.T @ A + np.eye(3) / PRIOR**2
        moved = np.linalg.solve(normal, weight * A.T @ b - value / PRIOR**2)
        value = value + moved
        left = float(np.sqrt(np.mean((b - A @ moved) ** 2)))
    # A fast flight has larger velocities.
    std = np.sqrt(np.diag(np.linalg.inv(normal))) * max(left / VELOCITY, 1.0)
    return FlownBias(value=value, std=std, reference=GRAVITY)


def _gravity_windows(uniform: UniformChannels, flights: Runs) -> Windows:
    """Cut flights into equal windows, with samples in groups."""
    rate, group = uniform.sample_rate, carried_group(uniform.sample_rate)
    windows: Windows = []
    for a, b in flights:
        edges = np.linspace(a, b, max(int(np.ceil((b - a) / rate / BY_GRAVITY)), 1) + 1).astype(int)
        for start, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            if stop - start < SHORTEST * rate:
                continue
            whole = start + (stop - start) // group * group
            rates, force = (
                uniform.values[name][start:whole].reshape(-1, group, 3).mean(axis=1)
                for name in ("gyro", "accel")
            )
            windows.append((rates, force))
    return windows


def _velocity_by_bias(
    rates: Float[np.ndarray, "m 3"], force: Float[np.ndarray, "m 3"], step: float
) -> tuple[Float[np.ndarray, "m 3 3"], Float[np.ndarray, "m 3"]]:
    """Return the velocity that a bias about each axis makes, and the felt one, less lines."""
    attitude = running_product(small_turns(rates * step))
    carried = rotated(attitude, force)
    turns = np.cumsum(rotation_matrices(attitude).swapaxes(1, 2), axis=0) * step

    def gained(x: Float[np.ndarray, "m c"]) -> Float[np.ndarray, "m c"]:
        return without_line(np.cumsum(x, axis=0) * step)

    leaned = np.cross(turns, carried.mean(axis=0))
    columns = np.stack([gained(leaned[:, k]) for k in range(3)], axis=-1)
    return columns, gained(carried)
