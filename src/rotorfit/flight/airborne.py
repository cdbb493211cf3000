"""Which part of a flight is in the air, and where its character changes.

In the air nothing but the rotors pushes: the specific force is the thrust, c sum O^2 along z, up
to drag and the lever of the accelerometer. On the ground, in a hand or against a wall something
else does. So the test is on the difference of the two, never on the rotor speed: a throw with
idle rotors is flight, and its free fall and motor pulses hold the most of what can be known.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from rotorfit.errors import FlightError
from rotorfit.flight.signals import central_difference, smooth, true_runs

GRAVITY = 9.80665
LOOK_CUTOFF = 8.0
"""Low-pass for looking at forces [Hz]: slower than vibration, faster than a landing."""
SHORTEST_FLIGHT = 0.3
LONGEST_TOUCH = 0.15
HARDEST_TOUCH = 5.0
ACTIVITY_RATIO = 3.0
SHORTEST_PHASE = 0.6


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """What the search for flight looks at, on one uniform clock.

    Attributes
    ----------
    sample_rate
        [Hz]
    specific_force, angular_velocity
        Body axes FLU [m/s^2], [rad/s].
    thrust
        Sum of rotor speeds squared, or of commands squared: anything proportional to thrust.
    arm
        A length of the vehicle [m], for the force that rotation adds at the accelerometer.
    """

    sample_rate: float
    specific_force: Float[np.ndarray, "n 3"]
    angular_velocity: Float[np.ndarray, "n 3"]
    thrust: Float[np.ndarray, " n"]
    arm: float


def airborne_rows(motion: Motion, stretches: tuple[tuple[int, int], ...]) -> list[tuple[int, int]]:
    """Return start and stop (exclusive) of every airborne stretch.

    Touches shorter than 0.15 s that look like a gust or a motor step are bridged; harder and
    longer ones are cut out.

    Raises
    ------
    FlightError
        If the rotors never turn, or the vehicle never leaves the ground.
    """
    if not float(motion.thrust.max(initial=0.0)) > 0:
        raise FlightError(
            "the motors never turn in this log (rotor speed or command is zero throughout); "
            "give the log of a flight, or the columns that hold the motors"
        )
    excess = np.concatenate(
        [_excess_force(motion, start, stop) for start, stop in stretches] or [np.full(0, np.inf)]
    )
    offsets = np.cumsum([0] + [stop - start for start, stop in stretches])
    found: list[tuple[int, int]] = []
    for (start, _), first, last in zip(stretches, offsets[:-1], offsets[1:], strict=True):
        flags = _bridged(excess[first:last], motion.sample_rate)
        shortest = int(SHORTEST_FLIGHT * motion.sample_rate)
        found += [(start + a, start + b) for a, b in true_runs(flags) if b - a >= shortest]
    if not found:
        raise FlightError(
            "no airborne part found: the specific force never follows the rotors; check motor "
            "columns, units and axes, or set start and end of the flight yourself"
        )
    _refuse_grounded(motion, found)
    return found


def thrust_to_force(motion: Motion) -> float:
    """Return c of a_z = c thrust, from the half of the flight that pushes hardest."""
    fast = motion.thrust > 0.5 * np.percentile(motion.thrust, 90)
    ratio = motion.specific_force[fast, 2] / motion.thrust[fast]
    return float(np.median(ratio))


def _excess_force(motion: Motion, start: int, stop: int) -> Float[np.ndarray, " n"]:
    """Return the force that the rotors do not explain, relative to what flight allows."""
    rows = slice(start, stop)
    c = thrust_to_force(motion)
    rate = motion.sample_rate
    thrust = c * smooth(motion.thrust[rows, None], rate, LOOK_CUTOFF)[:, 0]
    force = smooth(motion.specific_force[rows], rate, LOOK_CUTOFF)
    rates = motion.angular_velocity[rows]
    spin = smooth((rates * rates) @ np.ones((3, 1)), rate, LOOK_CUTOFF)[:, 0]
    force[:, 2] -= thrust
    rotation = 0.5 * motion.arm * np.maximum(spin, 0.0)
    allowed = 0.3 * GRAVITY + rotation + 0.15 * np.abs(thrust - GRAVITY)
    return np.linalg.norm(force, axis=1) / allowed


def _bridged(excess: Float[np.ndarray, " n"], sample_rate: float) -> Bool[np.ndarray, " n"]:
    """Return where the force is explained, short soft violations inside flight included."""
    flags = excess < 1.0
    for a, b in true_runs(~flags):
        inside = a > 0 and b < len(flags)
        short = b - a < LONGEST_TOUCH * sample_rate
        if inside and short and float(excess[a:b].max()) < HARDEST_TOUCH:
            flags[a:b] = True
    return flags


def _refuse_grounded(motion: Motion, found: list[tuple[int, int]]) -> None:
    """Raise if what looks like flight is a vehicle standing still with its motors running."""
    rows = np.concatenate([np.arange(a, b) for a, b in found])
    thrust, az = motion.thrust[rows], motion.specific_force[rows, 2]
    rates = motion.angular_velocity[rows]
    change = float(thrust.std() / thrust.mean())
    turning = float(np.sqrt(np.mean((rates - np.median(rates, axis=0)) ** 2)))
    follows = 1.0
    if change > 0.03:
        swing = thrust - thrust.mean()
        follows = float(swing @ az / (swing @ swing)) / thrust_to_force(motion)
    if follows < 0.2 or (change < 0.005 and turning < 0.01):
        raise FlightError(
            "the motors turn but the vehicle never flies (it stands still, or its acceleration "
            "does not follow the rotors); give the log of a flight, or set start and end yourself"
        )


def rest_rows(motion: Motion, airborne: list[tuple[int, int]]) -> Bool[np.ndarray, " n"]:
    """Return which samples are at rest: outside flight, quiet gyro, specific force steady at g."""
    n = len(motion.thrust)
    window = max(int(0.5 * motion.sample_rate), 8)
    flying = np.zeros(n, dtype=bool)
    for a, b in airborne:
        flying[max(a - window, 0) : b + window] = True
    rest = np.zeros(n, dtype=bool)
    for start in range(0, n - window + 1, window):
        rows = slice(start, start + window)
        quiet = float(motion.angular_velocity[rows].std(axis=0).max()) < 0.03
        force = motion.specific_force[rows].mean(axis=0)
        level = abs(float(np.linalg.norm(force)) - GRAVITY) < 0.1 * GRAVITY
        rest[rows] = quiet and level and not flying[rows].any()
    return rest


def phase_edges(
    angular_velocity: Float[np.ndarray, "n 3"], sample_rate: float
) -> list[tuple[int, int]]:
    """Return start and stop of the phases of one stretch: calm and lively parts kept apart.

    A new phase begins where the angular acceleration (rms over 0.3 s) leaves its median so far
    by more than a factor of three; none is shorter than 0.6 s. Noise differs between them, and a
    short lively phase must not drown in a long calm one.
    """
    n = len(angular_velocity)
    shortest = int(SHORTEST_PHASE * sample_rate)
    if n < 2 * shortest:
        return [(0, n)]
    rates = smooth(angular_velocity, sample_rate, 20.0)
    acceleration: Float[np.ndarray, "n 3"] = central_difference(rates, sample_rate)
    power: Float[np.ndarray, " n"] = np.einsum("ni,ni->n", acceleration, acceleration)
    window = max(int(0.3 * sample_rate), 1)
    mean = ndimage.uniform_filter1d(power, window, mode="nearest")
    level = 0.5 * np.log(np.maximum(mean, np.finfo(float).tiny))
    edges = [0]
    row = shortest
    while row < n - shortest:
        recent = level[max(edges[-1], row - int(10 * sample_rate)) : row]
        if abs(level[row] - np.median(recent)) > np.log(ACTIVITY_RATIO):
            edges.append(row)
            row += shortest
        else:
            row += max(window // 4, 1)
    edges.append(n)
    return list(pairwise(edges))
