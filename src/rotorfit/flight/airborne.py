"""Find the airborne part of a flight, its rests, and the changes of its character.

In the air nothing but the rotors pushes: the specific force is the thrust, c sum O^2 along z, up
to drag and the lever of the accelerometer. On the ground, in a hand or against a wall something
else does. So the test is on the difference of the two, never on the rotor speed: a throw with
idle rotors is flight, and its free fall and motor pulses hold the most of what can be known.

A window that the user gives may hold the ground, which carries the weight there: a fit of both
would give too small a thrust and a bias of metres per second squared. These parts are cut out.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import FlightError
from rotorfit.findings import Finding, doubt
from rotorfit.flight.signals import (
    central_difference,
    pieces,
    running_mean,
    smooth,
    true_runs,
    whole_samples,
)
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Bool, Float

GRAVITY = 9.80665
LOOK_CUTOFF = 8.0
"""Low-pass for looking at forces [Hz]: slower than vibration, faster than a landing."""
SHORTEST_FLIGHT = 0.3
LONGEST_TOUCH = 0.15
HARDEST_TOUCH = 5.0
DRIFT = 6.0
"""Changes of thrust that are slower are no response [s]."""
GUARD = 0.04
"""Taken off where flight meets the ground [s]: the low-pass sees a contact only from half."""
ACTIVITY_RATIO: Final = 3.0
"""Ratio of the angular acceleration's rms between phases."""
SHORTEST_PHASE: Final = 0.6
LEVEL_WINDOW: Final = 0.3
LEVEL_STEP: Final = 0.05
"""[s]: of a phase, of the rms, and between its values."""
MOTION_CUTOFF: Final = 20.0
"""Limit between motion and vibration [Hz]."""
LEAST_LEVEL: Final = 1e-3
"""Least level, as a share of the largest: less is rest, or a recording without noise."""
LONGEST_LEVEL: Final = 1200
"""Values of one part, for speed alone: parts as long that are alike are joined again."""


@frozen_dataclass
class Motion:
    """The signals of the search for flight, on one uniform clock.

    - `sample_rate`: [Hz]
    - `specific_force`, `angular_velocity`: body axes FLU [m/s^2], [rad/s].
    - `rotor_speed`: or the commands: anything whose square is proportional to thrust.
    - `arm`: a length of the vehicle [m], for the force that rotation adds at the accelerometer.
    - `stretches`: start and stop (exclusive) of the rows where every channel has data.
    """

    sample_rate: float
    specific_force: Float[np.ndarray, "n 3"]
    angular_velocity: Float[np.ndarray, "n 3"]
    rotor_speed: Float[np.ndarray, "n N"]
    arm: float
    stretches: tuple[tuple[int, int], ...]

    @property
    def thrust(self) -> Float[np.ndarray, " n"]:
        """Sum of the squared rotor speeds, proportional to thrust."""
        return np.einsum("nr,nr->n", self.rotor_speed, self.rotor_speed)


@frozen_dataclass
class _Features:
    """A stretch as the search sees it, all low-passed.

    - `excess`: force that the rotors do not explain, over what flight allows.
    - `upward`: its part along z [m/s^2].
    - `rates`: angular velocity [rad/s].
    """

    excess: Float[np.ndarray, " n"]
    upward: Float[np.ndarray, " n"]
    rates: Float[np.ndarray, "n 3"]


def airborne_rows(motion: Motion) -> list[tuple[int, int]]:
    """Find start and stop (exclusive) of every airborne stretch; raise `FlightError` if none."""
    thrust = motion.thrust
    c = thrust_to_force(motion, thrust)
    shortest = max(whole_samples(SHORTEST_FLIGHT * motion.sample_rate), 3)
    found: list[tuple[int, int]] = []
    for start, stop in motion.stretches:
        if stop - start >= shortest:
            features = _stretch_features(motion, c * thrust[start:stop], start)
            # Touches shorter than 0.15 s that look like a gust or a motor step are bridged; harder
            # and longer ones are cut out.
            explained = true_runs(_bridge_violations(features.excess, motion.sample_rate))
            # Standing with motors that already push is not flight.
            runs = [_without_ground(features, run, motion.sample_rate) for run in explained]
            found += [(start + a, start + b) for a, b in runs if b - a >= shortest]
    if not found:
        raise FlightError(
            f"no airborne part found: nowhere for {SHORTEST_FLIGHT:g} s does the acceleration "
            "follow the rotors; check the motor columns, the units and the axes, or set start "
            "and end of the flight yourself"
        )
    _refuse_grounded(motion, thrust, found)
    return found


def fast_rows(motion: Motion, thrust: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Mark the samples that push at least half as hard as the hardest three seconds."""
    window = max(min(whole_samples(3.0 * motion.sample_rate), len(thrust) // 4), 1)
    # Gaps of the log have no thrust to compare.
    inside = np.zeros(len(thrust), dtype=bool)
    for start, stop in motion.stretches:
        inside[start:stop] = True
    # A short flight in a long log must not be outvoted by the motors idling before it.
    level = running_mean(np.where(inside, thrust, 0.0), window)
    return inside & (thrust > 0.5 * level.max())


def thrust_to_force(motion: Motion, thrust: Float[np.ndarray, " n"]) -> float:
    """Estimate c of a_z = c thrust from the part of the log that pushes hardest."""
    fast = fast_rows(motion, thrust)
    if not fast.any():
        return 0.0
    return float(np.median(motion.specific_force[fast, 2] / thrust[fast]))


def misfit(motion: Motion) -> float:
    """Average the difference between a_z and the thrust where that is large [m/s^2]."""
    thrust = motion.thrust
    fast = fast_rows(motion, thrust)
    if not fast.any():
        return np.inf
    c = thrust_to_force(motion, thrust)
    return float(np.abs(motion.specific_force[fast, 2] - c * thrust[fast]).mean())


def _stretch_features(motion: Motion, thrust: Float[np.ndarray, " m"], start: int) -> _Features:
    """Compute the features of a stretch that begins at `start`; thrust in m/s^2."""
    rate = motion.sample_rate
    rows = slice(start, start + len(thrust))
    force = smooth(motion.specific_force[rows], rate, LOOK_CUTOFF)
    rates = motion.angular_velocity[rows]
    squares: Float[np.ndarray, " m"] = np.einsum("ni,ni->n", rates, rates)
    push, spin = smooth(np.stack([thrust, squares], axis=1), rate, LOOK_CUTOFF).T
    excess, upward = np.empty(len(thrust)), np.empty(len(thrust))
    for piece in pieces(len(thrust)):
        x, y, z = force[piece].T
        upward[piece] = z - push[piece]
        up, side = _bound_differences(push[piece], np.maximum(spin[piece], 0.0), motion.arm)
        # 1 on the ellipsoid of what flight allows.
        excess[piece] = np.hypot(np.hypot(x, y) / side, upward[piece] / up)
    del force, push, spin, squares
    return _Features(excess=excess, upward=upward, rates=smooth(rates, rate, LOOK_CUTOFF))


def _bound_differences(
    push: Float[np.ndarray, " m"], spin: Float[np.ndarray, " m"], arm: float
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Bound the difference between force and thrust in flight, along z and sideways [m/s^2]."""
    # Rotation adds force at an accelerometer off the centre; climb and descent change the thrust of
    # a rotor by a third, and drag pushes sideways while the rotors work.
    common = 0.3 * GRAVITY + 0.5 * arm * spin
    above, below = np.maximum(push - GRAVITY, 0.0), np.maximum(GRAVITY - push, 0.0)
    up = common + 0.3 * above + 0.15 * below
    side = common + 0.3 * np.clip(push, 0.0, 3.0 * GRAVITY)
    return up, side


def _bridge_violations(
    excess: Float[np.ndarray, " n"], sample_rate: float
) -> Bool[np.ndarray, " n"]:
    """Mark where the thrust explains the force, short soft violations in flight included."""
    flags = excess < 1.0
    for a, b in true_runs(~flags):
        inside = a > 0 and b < len(flags)
        short = b - a < LONGEST_TOUCH * sample_rate
        if inside and short and float(excess[a:b].max()) < HARDEST_TOUCH:
            flags[a:b] = True
    return flags


def _without_ground(
    features: _Features, run: tuple[int, int], sample_rate: float
) -> tuple[int, int]:
    """Trim the standing, or the touch, with which a run of flight begins or ends."""
    a, b = run
    n, guard = len(features.excess), whole_samples(GUARD * sample_rate + 0.5)
    if a > 0:
        stood = _count_standing(features, slice(a + guard, b))
        # Of the push-off the last is not seen, when the ground carries next to nothing.
        a += guard + stood + (2 * guard if stood > 2 * guard else 0)
    if b < n:
        b -= guard + _count_standing(features, slice(b - guard - 1, a, -1))
    return a, b


def _count_standing(features: _Features, rows: slice) -> int:
    """Count the rows, from the first on, in which the vehicle still stands."""
    rates, upward = features.rates[rows], features.upward[rows]
    for piece in pieces(len(rates)):
        turned = rates[piece] - rates[0]
        still = np.abs(turned).max(axis=1) < 0.05
        # While motors spool up on the ground, the ground carries the rest of the weight and nothing
        # turns. What follows a throw or a bump turns at once.
        carried = upward[piece] > 0.04 * GRAVITY
        flying = np.flatnonzero(~(still & carried))
        if len(flying):
            return piece.start + int(flying[0])
    return len(rates)


def _refuse_grounded(
    motion: Motion, thrust: Float[np.ndarray, " n"], found: list[tuple[int, int]]
) -> None:
    """Raise if the vehicle is on the ground or in a hand with its motors running."""
    rows = np.concatenate([np.arange(a, b) for a, b in found])
    block = max(whole_samples(motion.sample_rate / LOOK_CUTOFF), 1)
    az = block_means(motion.specific_force[rows, 2:], block)[:, 0]
    push = block_means(thrust[rows, None], block)[:, 0]
    speeds = block_means(motion.rotor_speed[rows], block)
    rates = block_means(motion.angular_velocity[rows], block)
    turning = float(rates.std(axis=0).max())
    # A battery that sags makes commands grow while the thrust stays.
    # Whatever flies has motors that work against each other, and an acceleration that follows them.
    quick, response = (take_drift_out(x, round(DRIFT * LOOK_CUTOFF)) for x in (push, az))
    change = float(quick.std() / push.mean())
    steering = float((speeds.std(axis=0) / np.maximum(speeds.mean(axis=0), 1e-12)).max())
    follows, std = following_share(response, thrust_to_force(motion, thrust) * quick)
    if follows > max(0.5, 6.0 * std):
        # However still it hovers: the ground would have carried what the thrust changed by.
        return
    if change > 0.03:
        why = "its acceleration does not follow the rotors" if follows < 0.2 else ""
    else:
        why = "it does not turn at all, and its thrust stays the same" if turning < 0.01 else ""
    if max(change, steering) < 0.004:
        why = "the motors run at one speed throughout, as on the ground or in a hand"
    if why:
        raise FlightError(
            f"the motors turn but the vehicle never flies ({why}); give the log of a flight, or "
            "set start and end of the flight yourself"
        )


def take_drift_out(values: Float[np.ndarray, " m"], width: int) -> Float[np.ndarray, " m"]:
    """Subtract a running mean of this width from the values."""
    return values - running_mean(values, width)


def following_share(
    acceleration: Float[np.ndarray, " n"], push: Float[np.ndarray, " n"]
) -> tuple[float, float]:
    """Fit the acceleration's change per change of push (1 in flight), with its deviation.

    Infinite deviation where the push never changes.
    """
    swing = push - push.mean()
    size = float(swing @ swing)
    if size < (1e-6 * GRAVITY) ** 2 * len(push):
        return 0.0, np.inf
    response = acceleration - acceleration.mean()
    follows = float(swing @ response) / size
    return follows, float((response - follows * swing).std()) / size**0.5


def block_means(values: Float[np.ndarray, "n k"], block: int) -> Float[np.ndarray, "m k"]:
    """Average consecutive blocks; an incomplete last one is left out."""
    whole = len(values) // block
    return values[: whole * block].reshape(whole, block, -1).mean(axis=1)


def rest_rows(motion: Motion, airborne: list[tuple[int, int]]) -> Bool[np.ndarray, " n"]:
    """Mark samples at rest: outside flight, quiet gyro, steady at g, motors low."""
    n = len(motion.rotor_speed)
    window = max(whole_samples(0.5 * motion.sample_rate), 8)
    thrust = motion.thrust
    push = thrust_to_force(motion, thrust) * thrust
    flying = np.zeros(n, dtype=bool)
    for a, b in airborne:
        flying[max(a - window, 0) : b + window] = True
    rest = np.zeros(n, dtype=bool)
    for begin, stop in motion.stretches:
        for start in range(begin, stop - window + 1, window):
            rows = slice(start, start + window)
            quiet = float(motion.angular_velocity[rows].std(axis=0).max()) < 0.03
            force = motion.specific_force[rows].mean(axis=0)
            level = abs(float(np.linalg.norm(force)) - GRAVITY) < 0.1 * GRAVITY
            # Outside the start and end that a user gives, a calm hover would pass for rest.
            idle = float(push[rows].mean()) < 0.5 * GRAVITY
            rest[rows] = quiet and level and idle and not flying[rows].any()
    return rest


def phase_edges(
    angular_velocity: Float[np.ndarray, "n 3"], sample_rate: float
) -> list[tuple[int, int]]:
    """Cut a stretch into phases of one character: start and stop of each."""
    n = len(angular_velocity)
    if n < 2 * max(whole_samples(SHORTEST_PHASE * sample_rate), 1):
        return [(0, n)]
    stride = max(whole_samples(LEVEL_STEP * sample_rate), 1)
    rates = smooth(angular_velocity, sample_rate, MOTION_CUTOFF)
    parts = [rates, angular_velocity - rates]
    # Noise differs between phases, and a short lively one must not drown in a long calm one. Two
    # levels show the character, logarithms of the angular acceleration's rms over 0.3 s: that of
    # the motion, under 20 Hz, and that of vibration and noise above.
    level = np.column_stack(
        [_log_angular_acceleration(part, sample_rate, stride) for part in parts]
    )
    shortest = int(np.ceil(SHORTEST_PHASE * sample_rate / stride))
    # The cuts are those with which both are nearest to constant in each phase: they lie where a
    # manoeuvre begins and ends.
    cuts = _drop_alike_cuts(level, _level_cuts(level, max(shortest, 1)))
    return list(pairwise([0, *(stride * cut for cut in cuts), n]))


def _log_angular_acceleration(
    rates: Float[np.ndarray, "n 3"], sample_rate: float, stride: int
) -> Float[np.ndarray, " m"]:
    """Compute the logarithm of the angular acceleration's rms, once in a stride."""
    acceleration = central_difference(rates, sample_rate)
    power: Float[np.ndarray, " n"] = np.einsum("ni,ni->n", acceleration, acceleration)
    window = max(whole_samples(LEVEL_WINDOW * sample_rate), 1)
    mean = running_mean(power, window)[stride // 2 :: stride]
    floor = max(LEAST_LEVEL**2 * float(mean.max()), float(np.finfo(float).tiny))
    level: Float[np.ndarray, " m"] = 0.5 * np.log(np.maximum(mean, floor))
    return level


def _level_cuts(level: Float[np.ndarray, "m k"], shortest: int) -> list[int]:
    """Cut where levels change: the least squares about each part's means, and a price for each."""
    # A shortest part that differs by the ratio is worth the price. Optimal partitioning: Jackson et
    # al., IEEE Signal Processing Letters 12(2), 2005.
    m, price = len(level), shortest * np.log(ACTIVITY_RATIO) ** 2
    centred = level - level.mean(axis=0)
    sums = np.concatenate([np.zeros((1, level.shape[1])), np.cumsum(centred, axis=0)])
    # Squares about zero are the same for every cut: what cuts cost is a price less the explained.
    paid, before = np.full(m + 1, np.inf), np.zeros(m + 1, dtype=int)
    paid[0] = 0.0
    lengths = np.arange(m, 0, -1)
    for stop in range(shortest, m + 1):
        least, most = max(stop - LONGEST_LEVEL, 0), stop - shortest + 1
        parts = sums[least:most] - sums[stop]
        explained = np.einsum("fk,fk->f", parts, parts)
        explained /= lengths[m - stop + least : m - stop + most]
        total = paid[least:most] - explained
        best = int(total.argmin())
        paid[stop], before[stop] = total[best] + price, least + best
    cuts = [int(before[m])]
    while cuts[-1] > 0:
        cuts.append(int(before[cuts[-1]]))
    return cuts[-2::-1]


def _drop_alike_cuts(level: Float[np.ndarray, "m k"], cuts: list[int]) -> list[int]:
    """Drop cuts between parts whose levels differ by less than the ratio, the least first."""
    while cuts:
        means = [level[a:b].mean(axis=0) for a, b in pairwise([0, *cuts, len(level)])]
        steps = np.abs(np.diff(means, axis=0)).max(axis=1)
        least = int(np.argmin(steps))
        if steps[least] > np.log(ACTIVITY_RATIO):
            break
        cuts = [*cuts[:least], *cuts[least + 1 :]]
    return cuts


STEADY: Final = 0.06
"""Deviation of the rates of a vehicle that stands, motors idling [rad/s]."""
SLOW: Final = 0.1
"""Mean rate of a vehicle that stands: a gyro's bias at most [rad/s]."""
LITTLE_THRUST: Final = 0.4
"""Thrust over that of the flight, below which a calm vehicle does not fly: standing ones of the
logs at hand have up to 0.2, a racer that glides at speed 0.55 and more."""
FLYING_PERCENTILE: Final = 75.0
"""Percentile of the squared rotor speeds: that of the flight even where half of a window is not."""
CARRIED: Final = 0.2
"""Share of gravity by which the specific force of what stands may differ from it; what falls with
little thrust reads less."""
PIECE: Final = 0.5
"""Looked at in pieces of this length [s]."""
SHORT: Final = 0.1
"""Over which the rates are averaged [s]."""
LEAST_PIECES: Final = 2
"""Least pieces in a row: in half a second of falling nobody stands still, but may seem to."""
ON_THE_GROUND: Final = "stands on the ground"

Rows = tuple[int, int]


def ground_contact(
    motion: Motion, flights: list[Rows], *, stretches: tuple[Rows, ...] | None = None
) -> list[Rows]:
    """Find the rows (stop exclusive) in which the vehicle stands on the ground."""
    piece, short = (whole_samples(t * motion.sample_rate) for t in (PIECE, SHORT))
    squares = motion.thrust
    rows = np.concatenate([np.arange(a, b) for a, b in flights])
    flown = float(np.percentile(squares[rows], FLYING_PERCENTILE))
    lift = thrust_to_force(replace(motion, stretches=stretches or motion.stretches), squares)
    # Little against the thrust of the flights or, where they hold only the ground, against the
    # weight by the lift in all `stretches`.
    little = LITTLE_THRUST * max(flown, GRAVITY / lift if lift > 0.0 else 0.0)
    found: list[Rows] = []
    for first, stop in flights:
        starts = np.arange(first, stop - piece + 1, piece)
        stands = np.array(
            [
                squares[at : at + piece].mean() < little
                and _is_calm(motion.angular_velocity[at : at + piece], short)
                and _is_carried(motion.specific_force[at : at + piece])
                for at in starts
            ],
            dtype=bool,
        )
        found += [
            (int(starts[a]), int(starts[b - 1]) + piece)
            for a, b in true_runs(stands)
            if b - a >= LEAST_PIECES
        ]
    return found


def _is_calm(rates: Float[np.ndarray, "n 3"], short: int) -> bool:
    # Means of a moment each: a gyro's noise, and what motors shake, is no motion.
    whole = len(rates) // short * short
    means = rates[:whole].reshape(-1, short, 3).mean(axis=1)
    return bool(means.std(axis=0).max() < STEADY and np.abs(means.mean(axis=0)).max() < SLOW)


def _is_carried(force: Float[np.ndarray, "n 3"]) -> bool:
    return abs(float(np.linalg.norm(force.mean(axis=0))) - GRAVITY) < CARRIED * GRAVITY


def aloft(motion: Motion, flights: list[Rows], standing: list[Rows]) -> list[Rows]:
    """Cut standing, and half a second around it, out of the flights; raise if nothing is left."""
    if not standing:
        return flights
    margin = whole_samples(PIECE * motion.sample_rate)
    shortest = max(whole_samples(SHORTEST_FLIGHT * motion.sample_rate), 3)
    kept: Bool[np.ndarray, " n"] = np.zeros(len(motion.rotor_speed), dtype=bool)
    for a, b in flights:
        kept[a:b] = True
    for a, b in standing:
        kept[max(a - margin, 0) : b + margin] = False
    # Flights that follow one another are apart by a gap, which `kept` does not show.
    left = [
        (first + a, first + b)
        for first, stop in flights
        for a, b in true_runs(kept[first:stop])
        if b - a >= shortest
    ]
    if not left:
        raise FlightError(
            "the vehicle stands on the ground between start and end (motors turn, nothing moves); "
            "give the start and the end of a flight, in seconds since the first sample of the log"
        )
    return left


def ground_doubts(time: Float[np.ndarray, " n"], standing: list[Rows]) -> Iterator[Finding]:
    """Find where the vehicle stands, in seconds since the log's first sample."""
    if not standing:
        return
    when = ", ".join(f"{time[a] - time[0]:.1f} to {time[b - 1] - time[0]:.1f}" for a, b in standing)
    yield doubt(
        "on-the-ground",
        f"the vehicle stands on the ground at {when} s: these parts of the stretch between "
        "start and end are left out, as the ground carries some of the weight there",
    )
