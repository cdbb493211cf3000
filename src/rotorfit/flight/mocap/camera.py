"""Frames of a motion-capture system: which are good, and when the cameras took them.

What is lost (markers hidden, the last pose repeated) is cut, never bridged: a guess across a gap,
differentiated twice, is an acceleration that nobody flew. Single frames that jump and return are
put back on the line of their neighbours before anything is filtered: differentiated twice, a jump
of 0.07 rad at 100 Hz is an angular acceleration of 1400 rad/s^2. A frame is held against the cubic
through its two neighbours on either side, which follows any flight to a small share of the noise.

The body's velocity, which the air's drag needs, is made of a pose where none is logged: position is
differentiated as motion capture is (one low-pass, one spline), and turned into body
axes by the attitude. The two need not be of the same instants: some logs have the cameras' position
and the vehicle's own attitude.

The velocity that carries the rotors sideways, from rare positions and the IMU between them.

Cameras show the place rarely and with gaps, the accelerometer what happens between: turned by the
attitude and integrated it is a place but for a slow drift, which is the smoothest curve through
what is left of the camera's (a natural cubic spline: De Boor, A Practical Guide to Splines, 1978,
chapter XIV). The position need not be of the instants of the attitude: some logs have the cameras'
position and the vehicle's own attitude.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import FlightError, LogError
from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.clocks import FEWEST_SAMPLES, usable_samples
from rotorfit.flight.kinematics import continuous_quaternions, rotated, rotated_back
from rotorfit.flight.signals import (
    SCALE_WIDTH,
    SPIKE_THRESHOLD,
    local_medians,
    low_pass,
    spline_derivatives,
    whole_samples,
)
from rotorfit.flight.smoothing_spline import smoothing_spline_derivatives
from rotorfit.logs.flight_log import Channel, FlightLog

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

REACH: Final = 2
"""Neighbours on either side that are looked at."""
CUBIC: Final = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6.0
"""The middle of a cubic through four equidistant neighbours."""
REGULAR: Final = 1.5
"""Longest step to a neighbour, in periods."""
MOST_PASSES: Final = 3
"""A jump hides a smaller one beside it."""


def without_spikes(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, "n k"], Bool[np.ndarray, " n"]]:
    """Replace single frames that jump, and mark them; columns of `values` jump as one."""
    clean, mended = values, np.zeros(len(values), dtype=bool)
    if len(values) < SCALE_WIDTH:
        return clean, mended
    steps = np.diff(time)
    near = steps < REGULAR * float(np.median(steps))
    inner = np.zeros(len(time), dtype=bool)
    inner[REACH:-REACH] = near[:-3] & near[1:-2] & near[2:-1] & near[3:]
    for _ in range(MOST_PASSES):
        off, limit = _off_and_limit(clean, inner)
        wide = np.pad(off, REACH)
        highest = np.lib.stride_tricks.sliding_window_view(wide, 2 * REACH + 1).max(axis=1)
        peaks = np.flatnonzero((off > limit) & (off >= highest))
        returned = [int(i) for i in peaks if _jumped_alone(clean, int(i), limit)]
        if not returned:
            break
        clean = clean.copy() if clean is values else clean
        for i in returned:
            clean[i] = CUBIC @ clean[i - REACH : i + REACH + 1]
        mended[returned] = True
    return clean, mended


def _off_and_limit(
    values: Float[np.ndarray, "n k"], inner: Bool[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Compute each frame's distance from the cubic, and the limit of a spike."""
    cubic = _cubic_of_neighbours(values)
    off = np.where(inner, np.linalg.norm(values - cubic, axis=1), 0.0)
    # Quiet stretches between lively ones: as for the gyro, never much below the column's own.
    floor = 0.4 * float(np.percentile(off, 95)) + np.finfo(float).tiny
    limit = np.full(len(off), SPIKE_THRESHOLD * 1.4826 * floor)
    # The median of the frames around matters about frames that are far alone.
    near_far = np.convolve(off > limit, np.ones(4 * REACH + 1), "same") > 0.0
    rows = np.flatnonzero(near_far)
    usual = local_medians(off, SCALE_WIDTH, rows)
    limit[rows] = SPIKE_THRESHOLD * 1.4826 * np.maximum(usual, floor)
    return off, limit


def _cubic_of_neighbours(values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """Compute the middle of the cubic through the neighbours of every frame."""
    wide = np.pad(values, ((REACH, REACH), (0, 0)), mode="edge")
    near = [wide[k : k + len(values)] for k in range(2 * REACH + 1)]
    return np.add.reduce([weight * part for weight, part in zip(CUBIC, near, strict=True)])


def _jumped_alone(values: Float[np.ndarray, "n k"], i: int, limit: Float[np.ndarray, " n"]) -> bool:
    """Test whether all is smooth about frame `i` once it is replaced: it jumped alone."""
    first, stop = max(i - 2 * REACH, 0), min(i + 2 * REACH + 1, len(values))
    trial = values[first:stop].copy()
    trial[i - first] = CUBIC @ values[i - REACH : i + REACH + 1]
    cubic = _cubic_of_neighbours(trial)
    off = np.linalg.norm(trial - cubic, axis=1)
    return bool((off < limit[first:stop])[REACH:-REACH].all())


IRREGULAR_SHARE = 0.02
"""Share of frames that may come further than a third of a period from where they belong."""
WORST_JITTER = 0.12
"""Largest jitter about a regular clock, rms in periods, that can be mended."""
STRAY = 0.4
"""Share of a period, from which a stamp misses its frame."""
NEIGHBOURS, FEWEST_NEIGHBOURS = 9, 3
"""Frames on either side of a long step that say whether one was lost, and the fewest that do."""
NOTED_JITTER = 0.05
"""Jitter from which mending is reported, and refused unless random from frame to frame."""
MOST_CORRELATED = 0.7
"""Correlation of one frame's time error with the next, above which a queue delays whole groups."""
JUMP = (100.0, 1000.0)
"""Accelerations of a marker swap: more acceleration than flight has [m/s^2], [rad/s^2]."""
JUMP_DEVIATIONS = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraClock:
    """The clock of the frames, if the cameras ran regularly.

    - `rate`: frames per second [Hz].
    - `time`: of each frame, regular within a run [s].
    - `runs`: start and stop (exclusive) of frames that follow each other without loss.
    - `jitter`: rms of the recorded times about `time`, in periods.
    """

    rate: float
    time: Float[np.ndarray, " n"]
    runs: tuple[tuple[int, int], ...]
    jitter: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracked:
    """The frames in which the body was seen.

    - `pose`: position, then attitude w, x, y, z.
    - `mended`: frames that jumped and returned, and were put back.
    """

    pose: Channel
    mended: int


def poses(log: FlightLog) -> Channel:
    """Select the frames of `tracked`."""
    return tracked(log).pose


def tracked(log: FlightLog) -> Tracked:
    """Select the frames in which the body was seen: position, then attitude w, x, y, z.

    Left out are frames that only repeat the one before (a frozen pose, or a log that is faster
    than the cameras) and frames that jump for longer than one frame; single ones are mended.
    """
    has = ", ".join(log.channels) or "none"
    for name in ("position", "attitude"):
        if name not in log.channels:
            named = "name its columns (pos_x, ..., quat_w, ...) with a columns map, or "
            raise LogError(
                f"the log has no {name} from motion capture (it has {has}); "
                f'{named if log.takes_columns else ""}use source = "imu"'
            )
    place = usable_samples(log.channels["position"], "position")
    attitude = usable_samples(log.channels["attitude"], "attitude")
    time, a, b = np.intersect1d(place.time, attitude.time, return_indices=True)
    if len(time) < max(FEWEST_SAMPLES, len(place.time) // 2):
        raise FlightError(
            f"position and attitude share {len(time)} of {len(place.time)} times: they must be "
            "of the same frames; export the pose of one rigid body with one time column"
        )
    values = np.concatenate([place.values[a], attitude.values[b]], axis=1)
    fresh = np.concatenate([[True], np.any(values[1:] != values[:-1], axis=1)])
    if fresh.sum() < FEWEST_SAMPLES:
        raise FlightError(
            f"the pose changes in only {int(fresh.sum())} of {len(fresh)} frames: the body was "
            "not tracked; check the rigid body in the motion-capture software"
        )
    time = restamped(time[fresh])
    positions, one = without_spikes(time, values[fresh, :3])
    quaternions, other = without_spikes(time, continuous_quaternions(values[fresh, 3:]))
    values, mended = np.concatenate([positions, quaternions], axis=1), one | other
    good = ~_mark_jumps(time, values)
    source = f"{log.channels['position'].source}; {log.channels['attitude'].source}"
    pose = Channel(time=time[good], values=values[good], source=source)
    return Tracked(pose=pose, mended=int(mended[good].sum()))


def _mark_jumps(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n 7"]
) -> Bool[np.ndarray, " n"]:
    """Mark frames that lie off the line of their neighbours, far beyond noise and flight.

    The neighbours of a jump, seen from it, lie off too, and go with it.
    """
    period = float(np.median(np.diff(time)))
    off = np.zeros((len(values), 2))
    across = (time[2:] - time[:-2])[:, None]
    share = (time[1:-1] - time[:-2])[:, None] / across
    for k, x in enumerate((values[:, :3], 2.0 * continuous_quaternions(values[:, 3:]))):
        middle = x[:-2] + share * (x[2:] - x[:-2])
        off[1:-1, k] = 2.0 * np.abs(x[1:-1] - middle).max(axis=1)
    noise = JUMP_DEVIATIONS * 1.4826 * np.median(off, axis=0)
    far = (off > np.maximum(np.array(JUMP) * period**2, noise)) & (off > 0)
    return np.any(far, axis=1)


def camera_clock(time: Float[np.ndarray, " n"]) -> CameraClock:
    """Estimate the regular clock behind recorded times of frames; raise for a network's times.

    The mean rate is taken from all runs without loss; each run keeps its own start.
    """
    time = restamped(time)
    steps = np.diff(time)
    period = float(np.median(steps))
    count = np.maximum(np.round(steps / period), 1.0)
    stray = np.abs(steps / period - count) > 1.0 / 3.0
    if float(stray.mean()) > IRREGULAR_SHARE:
        raise FlightError(_irregular_times_message(steps))
    edges = [0, *(np.flatnonzero(count > 1.0) + 1).tolist(), len(time)]
    runs = [(a, b) for a, b in pairwise(edges) if b - a >= FEWEST_SAMPLES]
    if not runs:
        raise FlightError(
            f"of {len(time)} frames never {FEWEST_SAMPLES} follow each other without loss; record "
            "with more cameras or markers"
        )
    # One slope of time over frame number for all runs (least squares).
    centred = [np.arange(b - a) - 0.5 * (b - a - 1) for a, b in runs]
    above = below = 0.0
    for n, (a, b) in zip(centred, runs, strict=True):
        above += float(n @ time[a:b])
        below += float(n @ n)
    period = above / below
    regular = np.array(time, dtype=float)
    for n, (a, b) in zip(centred, runs, strict=True):
        regular[a:b] = time[a:b].mean() + period * n
    error = np.concatenate([(time[a:b] - regular[a:b]) / period for a, b in runs])
    jitter = float(np.sqrt((error @ error) / len(error)))
    autocorrelation = float(error[1:] @ error[:-1]) / max(
        float(error @ error), np.finfo(float).tiny
    )
    if jitter > WORST_JITTER or (jitter > NOTED_JITTER and autocorrelation > MOST_CORRELATED):
        raise FlightError(_irregular_times_message(steps))
    return CameraClock(rate=1.0 / period, time=regular, runs=tuple(runs), jitter=jitter)


def restamped(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Move single stamps that miss their frame to where they belong.

    A stamp may be late by most of a period while the frame is not; where that is rare, the
    neighbours say when it was due.
    """
    steps = np.diff(time)
    period = float(np.median(steps))
    number = np.concatenate([[0.0], np.cumsum(1.0 + _count_lost_frames(time, period))])
    off = time - period * number
    due = local_medians(off, NEIGHBOURS, np.arange(len(off)))
    stray = np.abs(off - due) > STRAY * period
    if not 0.0 < float(stray.mean()) <= IRREGULAR_SHARE:
        return time
    return np.where(stray, due + period * number, time)


def _count_lost_frames(time: Float[np.ndarray, " n"], period: float) -> Float[np.ndarray, " m"]:
    """Count the frames lost in each step.

    A single stamp that is late makes a long step and a short one, with nothing lost: a loss
    shifts all that follows. So the frames before a long step and those after it each say, in
    their median, when the one after it was due.
    """
    steps = np.diff(time)
    lost = np.maximum(np.round(steps / period) - 1.0, 0.0)
    long = np.flatnonzero(lost > 0)
    for k, i in enumerate(long.tolist()):
        first = max(i - NEIGHBOURS + 1, 0 if k == 0 else int(long[k - 1]) + 1)
        stop = min(i + 1 + NEIGHBOURS, len(time) if k + 1 == len(long) else int(long[k + 1]) + 1)
        if i + 1 - first < FEWEST_NEIGHBOURS or stop - i - 1 < FEWEST_NEIGHBOURS:
            continue
        before = np.median(time[first : i + 1] + period * np.arange(i + 1 - first, 0, -1))
        after = np.median(time[i + 1 : stop] - period * np.arange(stop - i - 1))
        lost[i] = max(round(float(after - before) / period), 0)
    return lost


def _irregular_times_message(steps: Float[np.ndarray, " n"]) -> str:
    """Return the message for times that no camera keeps."""
    low, middle, high = (1e3 * np.percentile(steps, [1.0, 50.0, 99.0])).tolist()
    return (
        f"the motion capture comes at irregular times (steps {low:.1f} to {high:.1f} ms about "
        f"{middle:.1f} ms): these are times of receipt over a network, not those of the cameras; "
        "export the recording with the frame numbers or times of the cameras"
    )


CUTOFF: Final = 10.0
"""Low-pass on the position [Hz]: a velocity that moves drag lies far under it."""
CUTOFF_SHARE: Final = 0.25
"""The same at most, as a share of the frame rate."""
MARGIN: Final = 1.0
"""Left out at the ends of every run, in periods of the cut-off."""
LONGEST_BRIDGE: Final = 0.3
"""A straight line stands for the velocity over a loss of frames up to this [s]."""


def known_velocity(log: FlightLog) -> Channel | None:
    """Take the body-axes velocity of a log, else of its pose; None if neither is usable."""
    try:
        if "velocity" in log.channels:
            return usable_samples(log.channels["velocity"], "velocity")
        return velocity_of_pose(log)
    except FlightError:
        return None


def horizontal_axes(log: FlightLog) -> Channel | None:
    """Turn the world's axes x and y into body axes, six columns; None without an attitude."""
    if "attitude" not in log.channels:
        return None
    try:
        attitude = usable_samples(log.channels["attitude"], "attitude")
    except FlightError:
        return None
    axes = [
        rotated_back(attitude.values, np.full_like(attitude.values[:, 1:], axis))
        for axis in np.eye(3)[:2]
    ]
    return Channel(time=attitude.time, values=np.hstack(axes), source=attitude.source)


def velocity_of_pose(log: FlightLog) -> Channel | None:
    """Differentiate position and turn it into body axes [m/s]; None without both."""
    if not {"position", "attitude"} <= set(log.channels):
        return None
    place = usable_samples(log.channels["position"], "position")
    attitude = usable_samples(log.channels["attitude"], "attitude")
    fresh = np.concatenate([[True], np.any(place.values[1:] != place.values[:-1], axis=1)])
    time = restamped(place.time[fresh])
    position = without_spikes(time, place.values[fresh])[0]
    clock = camera_clock(time)
    cutoff = min(CUTOFF, CUTOFF_SHARE * clock.rate)
    margin = whole_samples(MARGIN / cutoff * clock.rate)
    times: list[Float[np.ndarray, " m"]] = []
    world: list[Float[np.ndarray, "m 3"]] = []
    for a, b in clock.runs:
        if b - a <= 2 * margin + 6:
            continue
        own, _ = spline_derivatives(low_pass(position[a:b], clock.rate, cutoff), clock.rate)
        times.append(clock.time[a + margin : b - margin])
        world.append(own[margin:-margin] if margin else own)
    if not times:
        return None
    return _in_body(
        *_bridge_losses(np.concatenate(times), np.concatenate(world), clock.rate),
        attitude,
        source=f"{place.source}, differentiated and turned by {attitude.source}",
    )


def _bridge_losses(
    time: Float[np.ndarray, " n"], velocity: Float[np.ndarray, "n 3"], rate: float
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 3"]]:
    """Interpolate the velocity over short losses of frames."""
    steps = np.diff(time)
    short = np.flatnonzero((steps > 1.5 / rate) & (steps < LONGEST_BRIDGE + 2.0 * MARGIN / CUTOFF))
    more: list[Float[np.ndarray, " k"]] = [
        np.linspace(time[i], time[i + 1], round(float(steps[i]) * rate) + 1)[1:-1] for i in short
    ]
    whole = np.sort(np.concatenate([time, *more]))
    return whole, _interpolate_between(whole, time, velocity)


def _interpolate_between(
    at: Float[np.ndarray, " m"], time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "m k"]:
    """Interpolate values at other times."""
    result = np.empty((len(at), values.shape[1]))
    for k in range(values.shape[1]):
        result[:, k] = np.interp(at, time, values[:, k])
    return result


def _in_body(
    time: Float[np.ndarray, " n"],
    world: Float[np.ndarray, "n 3"],
    attitude: Channel,
    *,
    source: str,
) -> Channel:
    """Turn world vectors into body axes, by the attitude between its samples."""
    q = continuous_quaternions(attitude.values)
    known: Bool[np.ndarray, " n"] = (time >= attitude.time[0]) & (time <= attitude.time[-1])
    time, world = time[known], world[known]
    between = _interpolate_between(time, attitude.time, q)
    body = rotated_back(between / np.linalg.norm(between, axis=1, keepdims=True), world)
    return Channel(time=time, values=body, source=source)


PLACE_STD: Final = 0.03
"""Error of one position [m]: its time is off by up to 10 ms."""
DRIFT_STD: Final = 0.5
"""Error of the acceleration, over a second [m/s^2]: 3 degrees of attitude."""
MOST_DRIFT: Final = 4.0 * DRIFT_STD
"""Over which attitude, position and accelerometer contradict one another."""
LONGEST_CARRIED: Final = 0.5
"""Longest time from the next position to the farthest instant with a velocity [s]."""
FEWEST: Final = 5
"""Positions of a spline."""


def carried_velocity(log: FlightLog) -> Channel | None:
    """Integrate the accelerometer between positions, body axes [m/s]; None if that is no use."""
    if not {"position", "attitude", "accel"} <= set(log.channels):
        return None
    try:
        return _between_positions(log)
    except FlightError:
        return None


def _between_positions(log: FlightLog) -> Channel | None:
    place, attitude, accel = (
        usable_samples(log.channels[name], name) for name in ("position", "attitude", "accel")
    )
    fresh = np.concatenate([[True], np.any(place.values[1:] != place.values[:-1], axis=1)])
    fixes = place.time[fresh]
    turning = (accel.time >= attitude.time[0]) & (accel.time <= attitude.time[-1])
    time = accel.time[turning]
    near = _mark_near_fixes(time, fixes)
    if len(fixes) < FEWEST or near.sum() < FEWEST:
        return None
    turned = _interpolate_attitude(time, attitude)
    force = rotated(turned, accel.values[turning])
    position = without_spikes(fixes, place.values[fresh])[0]
    world = _integrate_velocity(time, force, fixes, position, near)
    if world is None:
        return None
    return Channel(
        time=time[near],
        values=rotated_back(turned, world)[near],
        source=f"{place.source}, with {accel.source} between, turned by {attitude.source}",
    )


def _mark_near_fixes(
    time: Float[np.ndarray, " n"], fixes: Float[np.ndarray, " m"]
) -> Bool[np.ndarray, " n"]:
    """Mark the instants that have a position not far away."""
    after = np.searchsorted(fixes, time)
    distance = np.minimum(
        np.abs(time - fixes[np.clip(after, 0, len(fixes) - 1)]),
        np.abs(time - fixes[np.clip(after - 1, 0, len(fixes) - 1)]),
    )
    return distance <= LONGEST_CARRIED


def _interpolate_attitude(
    at: Float[np.ndarray, " n"], attitude: Channel
) -> Float[np.ndarray, "n 4"]:
    """Interpolate the rotation from the body to the world at other times, as quaternions."""
    q = continuous_quaternions(attitude.values)
    between = np.column_stack([np.interp(at, attitude.time, q[:, k]) for k in range(4)])
    return between / np.linalg.norm(between, axis=1, keepdims=True)


def _integrate_velocity(
    time: Float[np.ndarray, " n"],
    force: Float[np.ndarray, "n 3"],
    fixes: Float[np.ndarray, " m"],
    position: Float[np.ndarray, "m 3"],
    near: Bool[np.ndarray, " n"],
) -> Float[np.ndarray, "n 3"] | None:
    """Integrate specific force in world axes, and take the drift off; None if it is too much."""
    steps = np.diff(time, prepend=time[:1])[:, None]
    velocity: Float[np.ndarray, "n 3"] = np.cumsum((force - [0.0, 0.0, GRAVITY]) * steps, axis=0)
    path: Float[np.ndarray, "n 3"] = np.cumsum(velocity * steps, axis=0)
    for k in range(3):
        left = position[:, k] - np.interp(fixes, time, path[:, k])
        slope, bend = smoothing_spline_derivatives(
            fixes, left, time, penalty=(PLACE_STD / DRIFT_STD) ** 2
        )
        if float(np.std(bend[near])) > MOST_DRIFT:
            return None
        velocity[:, k] += slope
    return velocity
