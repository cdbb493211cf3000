r"""The thrust that carries the weight: k_t without a fit, and how sure it is.

Over a stretch of flight the upward thrust over mass is gravity plus the vertical acceleration. Its
mean is taken with the weights :math:`6\,t\,(T - t) / T^3`, with which the mean of an acceleration
is the slope of the straight line through the velocity: the velocity at both ends of the stretch (a
throw, a landing) does not enter, and where it stays within :math:`\sigma_v` and forgets itself in
:math:`\tau`, the unknown mean acceleration is as small as
:math:`\sigma_v \sqrt{12 \cdot 2 \tau / T} / T`. What the accelerometer reads over its bias, and the
velocity where it is logged or positions are, show that acceleration; each counts by its deviation,
and where they contradict each other more is open.

Upwards is where the mean force points in axes that the gyro carries. What the velocity gains
sideways leans that mean and lengthens it; over thirty seconds a flight gains little, and where the
velocity is known, its gain is taken off.

That thrust is not always the same at one rotor speed (inflow, the ground, a wall, a battery that
sags) the scatter of ten batches of the stretch shows (batch means).

A tether that the vehicle lifts, or the ground below, makes a force that grows with height. Heights
are integrals of the vertical velocity; what their unknown constants and a bias add is a parabola,
which is fitted beside. Few flights have such a force, so that the prior is a mixture: none, or, in
`SHARE` of them, one of some `USUAL`. Its 95 % half-width times a usual height is what the mean
thrust may lack.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rotorfit.estimation.distributions import normal_density, student_density, student_quantile
from rotorfit.estimation.measured import Measured
from rotorfit.fit.dataset.torn_weight import needed_of_pieces
from rotorfit.fit.dataset.vertical_motion import (
    FORGOTTEN,
    VerticalMotion,
    bell_weights,
    slope_std,
)
from rotorfit.fit.dataset.weight_balance import VELOCITY_CHANGE, Held, Turning, grouped
from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.kinematics import product, rotated, rotation_matrices, small_turns
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float, Int

    from rotorfit.flight.flight_data import FlightData
    from rotorfit.model.vehicle import Vehicle

SHARE: Final = 0.03
"""Prior share of the flights in which some such force acts."""
USUAL: Final = 0.25
"""Its deviation, over mass [m/s^2 a metre]: 2.5 % of the weight."""
SOUND: Final = 0.015
"""Deviation of what wakes and drag make in its place in sound flights [m/s^2 a metre]."""
HEIGHT: Final = 3.0
"""Mean height over the ground of a flight that has one, which is in no log [m]."""
BATCH: Final = 2.0
"""Length of a batch [s]."""
FEWEST, MOST = 4, 10
"""Batches of a stretch."""
ORDERS: Final = 8
"""Orders in which the batches of a stretch are tried."""
TINY: Final = 1e-12
LARGEST: Final = 1.5
"""That is looked for [m/s^2 a metre]."""


@frozen_dataclass
class HeightForce:
    """The growth of a force over mass with height [m/s^2 a metre].

    - `value`, `std`: by the regression.
    - `probability`: that there is one.
    - `half_width`: of its 95 % interval from none, by the mixture.
    """

    value: float
    std: float
    probability: float
    half_width: float

    @property
    def mean_std(self) -> float:
        """Deviation of the mean force over mass that it leaves open [m/s^2]."""
        return self.half_width * HEIGHT / 1.96


def height_force(
    left: Float[np.ndarray, " n"], velocity: Float[np.ndarray, " n"], step: float
) -> HeightForce | None:
    """Estimate how a force that is no thrust grows with height; None of a short stretch.

    `left`: specific force that thrust leaves unexplained [m/s^2]. `velocity`: upwards [m/s], with
    the samples `step` apart [s].
    """
    n = len(left)
    count = min(int(n * step / BATCH), MOST)
    if count < FEWEST:
        return None
    A = _motion_columns(velocity, step)
    whole = np.column_stack([A / np.linalg.norm(A, axis=0).clip(min=TINY), left])
    batches = np.array_split(np.arange(n), count)
    grams = np.array([whole[own].T @ whole[own] for own in batches])
    together = grams.sum(axis=0)
    found = _regress(together)
    rest = left - whole[:, :-1] @ found
    size = max(float(np.linalg.norm(A[:, -1])), TINY)
    value = -float(found[-1]) / size
    moved = np.array([-float(_regress(together - own)[-1]) / size for own in grams]) - value
    # The jackknife over batches (Quenouille, Biometrika 43, 1956).
    std = float(np.sqrt((count - 1) / count * (moved**2).sum()))
    every = (std, SOUND, _by_gusts(A, rest, batches, step))
    return weighed(value, float(np.linalg.norm(every)), degrees=count - 1)


def _motion_columns(velocity: Float[np.ndarray, " n"], step: float) -> Float[np.ndarray, "n 5"]:
    """Build the columns of a parabola, a velocity, and the height that it makes."""
    time = np.linspace(-1.0, 1.0, len(velocity))
    height = np.cumsum(velocity - velocity.mean()) * step
    return np.column_stack([np.ones(len(time)), time, time**2, velocity, height])


def _regress(gram: Float[np.ndarray, "c c"]) -> Float[np.ndarray, " k"]:
    """Regress the last of some columns on the others, of which the products are given."""
    found: Float[np.ndarray, " k"] = np.linalg.lstsq(gram[:-1, :-1], gram[:-1, -1])[0]
    return found


def _by_gusts(
    A: Float[np.ndarray, "n 5"],
    rest: Float[np.ndarray, " n"],
    batches: Sequence[Int[np.ndarray, " _"]],
    step: float,
) -> float:
    """Estimate what gusts, or noise, make of the slope by the heights that are their own."""
    # Seeded: one log has one interval.
    rng = np.random.default_rng(0)
    line, height = A[:, :2], A[:, -1]
    height = height - A[:, :-1] @ np.linalg.lstsq(A[:, :-1], height)[0]
    power = [0.0]
    for _ in range(ORDERS):
        # A force f that no thrust balances makes a height whose mean product with f is less than
        # nothing: minus the mean square of the velocity. Batches of the rest in another order are
        # such a force.
        order = rng.permutation(len(batches)).tolist()
        gained = np.cumsum(np.concatenate([rest[batches[i]] for i in order])) * step
        gained = gained - line @ np.linalg.lstsq(line, gained)[0]
        power.append(float(gained @ gained))
    return sum(power) / ORDERS / max(float(height @ height), TINY)


def weighed(value: float, std: float, *, degrees: int) -> HeightForce:
    """Weigh an estimate by the mixture of no force and a usual one."""
    grid = np.linspace(0.0, LARGEST, 601)
    prior = SHARE * 2.0 * normal_density(grid, USUAL)
    some = prior * student_density((value - grid) / std, degrees) * (grid[1] - grid[0])
    none = (1.0 - SHARE) * float(student_density(value / std, degrees))
    total = float(some.sum()) + none
    beyond = 1.0 - (none + np.cumsum(some)) / total
    return HeightForce(
        value=value,
        std=std,
        probability=float(some.sum()) / total,
        half_width=float(grid[np.searchsorted(-beyond, -0.05)]),
    )


PRIOR_VELOCITIES = 2.0
"""As many velocities of `VELOCITY_CHANGE` are taken to be seen before the flight."""
LINEAR = 0.5
"""Share of a mean drag that is open: climb and descent are no straight line."""
MOST_BATCHES = 10
SHORTEST_BATCH = 1.0
"""[s]"""
TOGETHER = 3
"""Windows that share one vertical: over thirty seconds, what is gained sideways hardly leans it."""
GYRO_BIAS_STD = 0.01
"""[rad/s]"""
PASSES = 2
"""A bias of 0.05 rad/s turns the axes by over a radian in thirty seconds."""


def carrying_stretches(
    flight: FlightData,
    axes: Turning,
    vehicle: Vehicle,
    *,
    mass: float,
    bias: Measured,
    velocity_std: float,
    air: Float[np.ndarray, "n 3"] | None = None,
) -> Iterator[Held]:
    """Yield the k_t that carries the weight over each stretch: `ratio` and `std` are in its unit.

    `bias`: of the accelerometer along the vertical [m/s^2]; `velocity_std`: of the velocity, where
    the log has it [m/s]; `air`: force of the air that carries with the thrust, over a k_t near the
    one that is sought [rad^2/s^2].
    """
    # The square of a noisy speed is larger by the noise.
    squares = flight.rotor_speed**2 - flight.rotor_speed_std**2
    push = (squares @ vehicle.axes + (0.0 if air is None else air)) / mass
    yield from needed_stretches(flight, axes, push, bias=bias, velocity_std=velocity_std)


def needed_stretches(
    flight: FlightData,
    axes: Turning,
    push: Float[np.ndarray, "n 3"],
    *,
    bias: Measured,
    velocity_std: float,
) -> Iterator[Held]:
    """Yield by what factor a push [m/s^2] carries the weight over each stretch, as `ratio`.

    What the velocity gains, as in a throw, is accounted for; `bias` and `velocity_std` as above.
    """
    if axes.is_torn:
        torn = list(vertical_motions(axes, flight, push))
        yield from needed_of_pieces(torn, bias=bias, velocity_std=velocity_std)
        return
    for motion in vertical_motions(axes, flight, push):
        pushed = float(motion.weights @ motion.push)
        gained = vertical_acceleration(motion, bias, velocity_std)
        drag, deviation = climb_drag(motion)
        needed = GRAVITY + gained.value + drag
        if pushed <= 0.0 or needed <= 0.0:
            continue
        std = float(np.hypot(gained.std, deviation)) / pushed
        yield Held(ratio=needed / pushed, std=std, seconds=motion.seconds)


def vertical_acceleration(motion: VerticalMotion, bias: Measured, velocity_std: float) -> Measured:
    """Estimate the mean vertical acceleration of a stretch, as `weights` take it [m/s^2]."""
    weights, unsure = motion.weights, slope_std(motion.seconds)
    read = Measured(value=float(weights @ motion.read) - GRAVITY - bias.value, std=bias.std)
    known = Measured(value=0.0, std=_velocity_deviation(motion) * unsure)
    if motion.velocity is not None:
        slope = np.gradient(motion.velocity, motion.step)
        known = Measured(value=float(weights @ slope), std=velocity_std * unsure)
    return known.reconciled_with(read)


def _felt_velocity(motion: VerticalMotion) -> Float[np.ndarray, " n"]:
    """Integrate the vertical velocity that the accelerometer feels [m/s]."""
    velocity = np.cumsum(motion.read - motion.read.mean()) * motion.step
    # A bias of the accelerometer makes a straight line of the velocity.
    time = np.linspace(-1.0, 1.0, len(velocity))
    line: Float[np.ndarray, " n"] = time * float(time @ velocity) / float(time @ time)
    return velocity - velocity.mean() - line


def _velocity_deviation(motion: VerticalMotion) -> float:
    """Estimate the deviation of the vertical velocity; a short stretch shows little of it [m/s]."""
    seen = motion.seconds / FORGOTTEN
    squares = PRIOR_VELOCITIES * VELOCITY_CHANGE**2
    squares += seen * float(np.mean(_felt_velocity(motion) ** 2))
    return float(np.sqrt(squares / (PRIOR_VELOCITIES + seen)))


def climb_drag(motion: VerticalMotion) -> tuple[float, float]:
    """Estimate the mean force over mass that is no thrust, and its standard deviation [m/s^2]."""
    weights, known = motion.weights, motion.velocity is not None
    left, velocity = _unexplained_force(motion), _vertical_velocity(motion)
    swing = velocity - float(weights @ velocity)
    power = float(weights @ swing**2)
    # What goes with the vertical velocity (drag, inflow) is taken off, and is the mean where that
    # velocity is logged; of the rest the batches of the stretch show the scatter.
    brake = -float(weights @ (left * swing)) / power if power > 0.0 else 0.0
    count = int(np.clip(motion.seconds / SHORTEST_BATCH, 2, MOST_BATCHES))
    rest = weights * (left + brake * swing)
    batches = np.array([float(batch.sum()) for batch in np.array_split(rest, count)])
    # So that 1.96 deviations hold 95 % with the few batches that there are.
    few = float(student_quantile(0.975, count - 1)) / 1.96
    std = few * float(np.sqrt(variance_of_sum(batches) * count / (count - 1)))
    mean = brake * float(weights @ velocity) if known else 0.0
    found = height_force_of(motion)
    # A force that grows with height is open by what it makes of a usual height.
    by_height = 0.0 if found is None else found.mean_std
    return mean, float(np.linalg.norm([std, LINEAR * mean, by_height]))


def variance_of_sum(batches: Float[np.ndarray, " b"]) -> float:
    """Estimate the variance of a sum of batches that may go on as they began (Geyer 1992)."""
    every = np.correlate(batches, batches, mode="full")[len(batches) - 1 :]
    # A wall or the ground pushes for several of them: covariances at growing distances count for as
    # long as they are positive.
    ends = np.flatnonzero(every <= 0.0)
    last = int(ends[0]) if len(ends) else len(every)
    return float(every[0] + 2.0 * every[1:last].sum()) if last else 0.0


def height_force_of(motion: VerticalMotion) -> HeightForce | None:
    """Estimate how a force that is no thrust grows with height; None of a short stretch."""
    return height_force(_unexplained_force(motion), _vertical_velocity(motion), motion.step)


def _unexplained_force(motion: VerticalMotion) -> Float[np.ndarray, " n"]:
    """Return the specific force that thrust leaves, which carries the weight in the mean."""
    weights = motion.weights
    share = float(weights @ motion.read) / float(weights @ motion.push)
    left: Float[np.ndarray, " n"] = motion.read - share * motion.push
    return left


def _vertical_velocity(motion: VerticalMotion) -> Float[np.ndarray, " n"]:
    """Return the velocity upwards [m/s]: logged, or felt."""
    return _felt_velocity(motion) if motion.velocity is None else motion.velocity


def vertical_motions(
    axes: Turning, flight: FlightData, push: Float[np.ndarray, "n 3"]
) -> Iterator[VerticalMotion]:
    """Yield the vertical motion of every stretch of windows that follow one another."""
    windows = axes.windows
    breaks = [0, *(i for i, (a, b) in enumerate(pairwise(windows), 1) if a.stop != b.start)]
    for first, last in pairwise([*breaks, len(windows)] if windows else []):
        pieces = np.array_split(np.arange(first, last), -(-(last - first) // TOGETHER))
        parts = [_project_on_vertical(axes, flight, push, piece.tolist()) for piece in pieces]
        read, pushed, velocity = (np.concatenate(part) for part in zip(*parts, strict=True))
        yield VerticalMotion(
            step=axes.group / axes.sample_rate,
            read=read,
            push=pushed,
            velocity=velocity if np.isfinite(velocity).all() else None,
        )


def _project_on_vertical(
    axes: Turning, flight: FlightData, push: Float[np.ndarray, "n 3"], piece: Sequence[int]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Project what is read, the push and the velocity of some windows on the vertical."""
    carried = flight.of_motion(
        f"carried axes, windows {piece[0]} to {piece[-1]}",
        (axes, flight.specific_force, flight.any_velocity),
        lambda: _carry_axes(axes, flight, piece),
    )
    pushed = (carried.turns @ _in_groups(axes, push, piece)[:, :, None])[:, :, 0]
    weights = bell_weights(len(pushed))
    scale = np.linalg.norm(weights @ carried.read) / np.linalg.norm(weights @ pushed)
    # The vertical is where the mean force of each points, without what the velocity gains sideways:
    # over ten seconds such a gain of 3 m/s leans the mean force by .03 rad and makes it .05 % too
    # long.
    up = weights @ (carried.read - carried.gained)
    along = weights @ (scale * pushed - carried.gained)
    up, along = up / np.linalg.norm(up), along / np.linalg.norm(along)
    return carried.read @ up, pushed @ along, carried.moved @ up


class _Carried(NamedTuple):
    """Axes that the gyro carries over some windows, without its drift, and what is seen in them.

    - `turns`: from body axes to these.
    - `read`: specific force [m/s^2].
    - `moved`, `gained`: velocity [m/s], NaN where it is not known, and its slope, then zero.
    """

    turns: Float[np.ndarray, "m 3 3"]
    read: Float[np.ndarray, "m 3"]
    moved: Float[np.ndarray, "m 3"]
    gained: Float[np.ndarray, "m 3"]


def _carry_axes(axes: Turning, flight: FlightData, piece: Sequence[int]) -> _Carried:
    """Carry axes over windows that follow one another."""
    step = axes.group / axes.sample_rate
    attitude = _carried_on(axes, piece)
    read = rotated(attitude, _in_groups(axes, flight.specific_force, piece))
    moved, gained = np.full_like(read, np.nan), np.zeros_like(read)
    if flight.any_velocity is not None:
        moved = rotated(attitude, _in_groups(axes, flight.any_velocity, piece))
    if np.isfinite(moved).all():  # of all of a stretch, or of none
        gained = np.gradient(moved, step, axis=0)
    back = small_turns(-gyro_drift(attitude, read - gained, step))
    return _Carried(
        rotation_matrices(product(back, attitude)),
        *(rotated(back, x) for x in (read, moved, gained)),
    )


def gyro_drift(
    attitude: Float[np.ndarray, "n 4"], force: Float[np.ndarray, "n 3"], step: float
) -> Float[np.ndarray, "n 3"]:
    """Estimate by how much a gyro's bias turns the axes that it carries [rad].

    Where the bias b has turned them by c, what would be a constant force f is f + c x f. The mean
    force of a stretch is as sure as the change of velocity, which is not known, allows.
    `force` is in the carried axes [m/s^2], `step` between samples [s].
    """
    # What a bias of 1 rad/s about each body axis turns the carried axes by, until each sample.
    bias_turns = np.cumsum(rotation_matrices(attitude).swapaxes(1, 2), axis=0) * step
    weights = bell_weights(len(force))
    share = weights / (VELOCITY_CHANGE * slope_std(len(force) * step)) ** 2
    drift = np.zeros_like(force)
    for _ in range(PASSES):
        # Turned back by the drift so far: the second pass sees only what the linear one left.
        left = rotated(small_turns(-drift), force)
        # A row is a sample's force less the constant one, and less what the bias leans of that.
        lean = np.cross(bias_turns, weights @ left)
        flat = lean.transpose(1, 0, 2).reshape(3, -1)
        weighed = (lean * share[:, None, None]).transpose(1, 0, 2).reshape(3, -1)
        both = weighed.reshape(3, -1, 3).sum(axis=1)
        information = np.block([[share.sum() * np.eye(3), both.T], [both, weighed @ flat.T]])
        # The prior: without it a constant force would leave the bias about itself free.
        information[3:, 3:] += np.eye(3) / GYRO_BIAS_STD**2
        known = np.concatenate([share @ left, weighed @ left.ravel()])
        bias = np.linalg.solve(information, known)[3:]
        drift = drift + np.einsum("njk,j->nk", bias_turns, bias)
    return drift


def _carried_on(axes: Turning, piece: Sequence[int]) -> Float[np.ndarray, "m 4"]:
    """Return the attitude over windows that follow one another, from the start of the first."""
    parts = [axes.attitude[piece[0]]]
    for i in piece[1:]:
        parts.append(product(parts[-1][-1:], axes.attitude[i]))
    return np.concatenate(parts)


def _in_groups(
    axes: Turning, values: Float[np.ndarray, "n 3"], piece: Sequence[int]
) -> Float[np.ndarray, "m 3"]:
    windows = (axes.windows[i] for i in piece)
    return np.concatenate([grouped(values[w.start : w.stop], axes.group) for w in windows])
