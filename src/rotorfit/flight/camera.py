"""Frames of a motion-capture system: which are good, and when the cameras took them.

What is lost (markers hidden, the last pose repeated) is cut, never bridged: a guess across a gap,
differentiated twice, is an acceleration that nobody flew.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from rotorfit.errors import FlightError, LogError
from rotorfit.flight.clocks import FEWEST_SAMPLES, usable_samples
from rotorfit.flight.log import Channel, FlightLog

IRREGULAR_SHARE = 0.02
"""Of frames that may come further than a third of a period from where they belong."""
WORST_JITTER = 0.12
"""Of the times about a regular clock, rms in periods, that can be mended."""
NOTED_JITTER = 0.05
"""From here on mending is said, and refused unless the jitter is random from frame to frame."""
MOST_ALIKE = 0.7
"""Correlation of one frame's time error with the next, above which a queue delays whole groups."""
JUMP = (100.0, 1000.0)
"""Of a marker swap: more acceleration than flight has [m/s^2], [rad/s^2]."""
JUMP_DEVIATIONS = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraClock:
    """When the frames were taken, if the cameras ran regularly.

    Attributes
    ----------
    rate
        Frames per second [Hz].
    time
        Of each frame, regular within a run [s].
    runs
        Start and stop (exclusive) of frames that follow each other without loss.
    jitter
        Rms of the recorded times about `time`, in periods.
    """

    rate: float
    time: Float[np.ndarray, " n"]
    runs: tuple[tuple[int, int], ...]
    jitter: float


def poses(log: FlightLog) -> Channel:
    """Return the frames in which the body was seen: position, then attitude w, x, y, z.

    Left out are frames that only repeat the one before (a frozen pose, or a log that is faster
    than the cameras) and frames that jump.

    Raises
    ------
    LogError
        If the log has no pose.
    FlightError
        If too few frames are left.
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
    time, values = time[fresh], values[fresh]
    good = ~_jumps(time, values)
    source = f"{log.channels['position'].source}; {log.channels['attitude'].source}"
    return Channel(time=time[good], values=values[good], source=source)


def _jumps(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n 7"]
) -> Bool[np.ndarray, " n"]:
    """Return which frames lie off the line of their neighbours, far beyond noise and flight.

    The neighbours of a jump, seen from it, lie off too, and go with it.
    """
    period = float(np.median(np.diff(time)))
    off = np.zeros((len(values), 2))
    across = (time[2:] - time[:-2])[:, None]
    share = (time[1:-1] - time[:-2])[:, None] / across
    q = values[:, 3:] / np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    q = (
        q
        * np.where(np.einsum("ni,ni->n", q, np.roll(q, 1, axis=0)) < 0, -1.0, 1.0).cumprod()[
            :, None
        ]
    )
    for k, x in enumerate((values[:, :3], 2.0 * q)):
        middle = x[:-2] + share * (x[2:] - x[:-2])
        off[1:-1, k] = 2.0 * np.abs(x[1:-1] - middle).max(axis=1)
    noise = JUMP_DEVIATIONS * 1.4826 * np.median(off, axis=0)
    far = (off > np.maximum(np.array(JUMP) * period**2, noise)) & (off > 0)
    return np.any(far, axis=1)


def camera_clock(time: Float[np.ndarray, " n"]) -> CameraClock:
    """Return the regular clock behind recorded times of frames.

    The mean rate is taken from all runs without loss; each run keeps its own start.

    Raises
    ------
    FlightError
        If the times are those of a network rather than of cameras.
    """
    steps = np.diff(time)
    period = float(np.median(steps))
    count = np.maximum(np.round(steps / period), 1.0)
    stray = np.abs(steps / period - count) > 1.0 / 3.0
    if float(stray.mean()) > IRREGULAR_SHARE:
        raise FlightError(_irregular(steps))
    edges = [0, *(np.flatnonzero(count > 1.0) + 1).tolist(), len(time)]
    runs = [(a, b) for a, b in pairwise(edges) if b - a >= FEWEST_SAMPLES]
    if not runs:
        raise FlightError(
            f"of {len(time)} frames never {FEWEST_SAMPLES} follow each other without loss; record "
            "with more cameras or markers"
        )
    period = _mean_period(time, runs)
    regular = np.array(time, dtype=float)
    for a, b in runs:
        centred = np.arange(b - a) - 0.5 * (b - a - 1)
        regular[a:b] = time[a:b].mean() + period * centred
    error = np.concatenate([(time[a:b] - regular[a:b]) / period for a, b in runs])
    jitter = float(np.sqrt((error @ error) / len(error)))
    alike = float(error[1:] @ error[:-1]) / max(float(error @ error), np.finfo(float).tiny)
    if jitter > WORST_JITTER or (jitter > NOTED_JITTER and alike > MOST_ALIKE):
        raise FlightError(_irregular(steps))
    return CameraClock(rate=1.0 / period, time=regular, runs=tuple(runs), jitter=jitter)


def _mean_period(time: Float[np.ndarray, " n"], runs: list[tuple[int, int]]) -> float:
    """Return the slope of time over frame number, common to all runs (least squares)."""
    above = below = 0.0
    for a, b in runs:
        centred = np.arange(b - a) - 0.5 * (b - a - 1)
        above += float(centred @ time[a:b])
        below += float(centred @ centred)
    return above / below


def _irregular(steps: Float[np.ndarray, " n"]) -> str:
    """Return the message for times that no camera keeps."""
    low, middle, high = (1e3 * np.percentile(steps, [1.0, 50.0, 99.0])).tolist()
    return (
        f"the motion capture comes at irregular times (steps {low:.1f} to {high:.1f} ms about "
        f"{middle:.1f} ms): these are times of receipt over a network, not those of the cameras; "
        "export the recording with the frame numbers or times of the cameras"
    )
