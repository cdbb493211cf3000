"""What is asked of each world's autopilot, millisecond by millisecond, and what the air does."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from benchmarks.worlds.world import World
from jaxtyping import Float
from scipy.signal import lfilter

STEP: Final = 1e-3
"""Of engine and autopilot [s]."""
REST: Final = 2.0
"""On the ground before take-off [s]."""
LANDING: Final = 5.0
"""Before the end a landing vehicle begins to sink [s]."""
VIGOUR: Final = {
    "throw": (0.15, 0.5, 0.3), "hover": (0.015, 0.05, 0.05), "calm": (0.18, 0.5, 0.4),
    "lively": (0.55, 2.0, 1.2), "sweep": (0.3, 1.0, 0.8), "one-axis": (0.5, 1.8, 1.0),
}  # fmt: skip
"""Tilt [rad], yaw rate [rad/s] and climb [m/s] of each manoeuvre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """One world's sticks (tilt forward and left, yaw rate, climb), height [m], gusts [N, N m].

    `released` and `landing` are steps: when it may leave the ground (or the hand), and when it
    begins to sink for good; `noise` is what the sensors add [rad/s, m/s^2].
    """

    sticks: Float[np.ndarray, "n 4"]
    gusts: Float[np.ndarray, "n 6"]
    noise: Float[np.ndarray, "n 6"]
    heard: Float[np.ndarray, "n 4"]
    released: int
    landing: int


def plan(world: World) -> Plan:
    """Return what one world's pilot, air and sensors do."""
    n = round(world.flight.seconds / STEP)
    released = round(REST / STEP) if world.flight.ground_start else 0
    landing = n - round(LANDING / STEP) if world.flight.lands else 10 * n
    sticks = _sticks(world, n, world.chance(1))
    sticks[: released + 1500] *= 0.0
    sticks[min(landing, n) :] *= 0.1
    air = _coloured(world.chance(2), n, 6, world.air.gust_seconds) * world.air.gust
    air[:released] = 0.0
    rng, s = world.chance(3), world.sensors
    noise = s.white * rng.standard_normal((n, 6))
    noise += s.coloured * _coloured(rng, n, 6, 1.0 / (2.0 * np.pi * s.colour)) + s.bias
    heard = _coloured(world.chance(4), n, 4, 0.3) * [0.01, 0.01, 0.05, 0.03]
    return Plan(
        sticks=sticks, gusts=air, noise=noise, heard=heard, released=released, landing=landing
    )


def _sticks(world: World, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return what the sticks ask for: tilt forward and left, yaw rate and climb."""
    kind = world.flight.manoeuvre
    tilt, yaw, climb = (world.flight.vigour * x for x in VIGOUR[kind])
    size = np.array([tilt, tilt, yaw, climb])
    if kind == "sweep":
        return size * _sweeps(n)
    hold = {"lively": 0.45, "one-axis": 0.7, "throw": 1.0}.get(kind, 1.5)
    sticks = size * np.column_stack([_steps(rng, n, hold) for _ in range(4)])
    if kind == "one-axis":
        sticks *= np.where(np.arange(4) == world.flight.axis, 1.0, 0.03)
    return sticks


def _sweeps(n: int) -> np.ndarray:
    """Return a chirp from .2 to 4 Hz on one stick after the other."""
    sticks = np.zeros((n, 4))
    first = round((REST + 2.0) / STEP)
    bounds = np.linspace(first, n - LANDING / STEP, 5).astype(int)
    for axis, (a, b) in enumerate(pairwise(bounds)):
        t, total = STEP * np.arange(b - a), STEP * max(b - a, 1)
        rising = np.log(4.0 / 0.2) / total
        sticks[a:b, axis] = np.sin(2 * np.pi * 0.2 * (np.exp(rising * t) - 1) / rising)
    return sticks


def _steps(rng: np.random.Generator, n: int, hold: float) -> np.ndarray:
    """Return steps of random height, held for random times of this mean [s], a little rounded."""
    lengths = np.maximum(rng.exponential(hold, size=round(4 * n * STEP / hold) + 20), 0.15)
    ends = np.minimum(np.cumsum(lengths / STEP).astype(int), n)
    values = np.zeros(n)
    for start, end, height in zip(
        np.r_[0, ends[:-1]], ends, rng.uniform(-1, 1, len(ends)), strict=True
    ):
        values[start:end] = height
    values -= lfilter([STEP / 3.0], [1.0, STEP / 3.0 - 1.0], values)
    return lfilter([0.03], [1.0, -0.97], values)


def _coloured(rng: np.random.Generator, n: int, k: int, seconds: float) -> np.ndarray:
    """Return first-order Gauss-Markov processes of deviation one (n, k)."""
    keep = float(np.exp(-STEP / seconds))
    first = rng.standard_normal(k)
    push = (1.0 - keep**2) ** 0.5 * rng.standard_normal((n, k))
    return lfilter([1.0], [1.0, -keep], push, axis=0, zi=(keep * first)[None])[0]
