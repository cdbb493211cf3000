"""Frames of a motion-capture system: which are good, and when the cameras took them.

What is lost (markers hidden, the last pose repeated) is cut, never bridged: a guess across a gap,
differentiated twice, is an acceleration that nobody flew. Single frames that jump and return are
put back on the line of their neighbours before anything is filtered (`spikes.py`).
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import FlightError, LogError
from rotorfit.flight.clocks import FEWEST_SAMPLES, usable_samples
from rotorfit.flight.kinematics import continuous_quaternions
from rotorfit.flight.mocap.spikes import without_spikes
from rotorfit.flight.signals import (
    local_medians,
)
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.flight_log import Channel, FlightLog

if TYPE_CHECKING:
    from jaxtyping import Bool, Float


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


@frozen_dataclass
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


@frozen_dataclass
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
    """Mark frames that lie off the line of their neighbours, far beyond noise and flight."""
    period = float(np.median(np.diff(time)))
    off = np.zeros((len(values), 2))
    across = (time[2:] - time[:-2])[:, None]
    share = (time[1:-1] - time[:-2])[:, None] / across
    for k, x in enumerate((values[:, :3], 2.0 * continuous_quaternions(values[:, 3:]))):
        middle = x[:-2] + share * (x[2:] - x[:-2])
        # The neighbours of a jump, seen from it, lie off too, and go with it.
        off[1:-1, k] = 2.0 * np.abs(x[1:-1] - middle).max(axis=1)
    noise = JUMP_DEVIATIONS * 1.4826 * np.median(off, axis=0)
    far = (off > np.maximum(np.array(JUMP) * period**2, noise)) & (off > 0)
    return np.any(far, axis=1)


def camera_clock(time: Float[np.ndarray, " n"]) -> CameraClock:
    """Estimate the regular clock behind recorded times of frames; raise for a network's times."""
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
        # The mean rate is that of all runs without loss; each run keeps its own start.
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
    """Move single stamps that miss their frame to where they belong."""
    steps = np.diff(time)
    period = float(np.median(steps))
    number = np.concatenate([[0.0], np.cumsum(1.0 + _count_lost_frames(time, period))])
    off = time - period * number
    due = local_medians(off, NEIGHBOURS, np.arange(len(off)))
    # A stamp may be late by most of a period while the frame is not; where that is rare, the
    # neighbours say when it was due.
    stray = np.abs(off - due) > STRAY * period
    if not 0.0 < float(stray.mean()) <= IRREGULAR_SHARE:
        return time
    return np.where(stray, due + period * number, time)


def _count_lost_frames(time: Float[np.ndarray, " n"], period: float) -> Float[np.ndarray, " m"]:
    """Count the frames lost in each step."""
    steps = np.diff(time)
    lost = np.maximum(np.round(steps / period) - 1.0, 0.0)
    long = np.flatnonzero(lost > 0)
    for k, i in enumerate(long.tolist()):
        first = max(i - NEIGHBOURS + 1, 0 if k == 0 else int(long[k - 1]) + 1)
        stop = min(i + 1 + NEIGHBOURS, len(time) if k + 1 == len(long) else int(long[k + 1]) + 1)
        if i + 1 - first < FEWEST_NEIGHBOURS or stop - i - 1 < FEWEST_NEIGHBOURS:
            continue
        # A single stamp that is late makes a long step and a short one, with nothing lost: a loss
        # shifts all that follows. So the frames before a long step and those after it each say, in
        # their median, when the one after it was due.
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
