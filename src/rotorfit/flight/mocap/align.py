r"""Motion capture and a log of the same flight, brought together by what both measure: the rates.

Gyro and cameras see one rotation, on two clocks and in two sets of axes. The size of the rate does
not know axes: where its correlation peaks lie the candidates for the offset of the clocks. For each
the best rotation between the axes follows in closed form (Wahba 1965; Kabsch, Acta Cryst. A32,
1976), and the best candidate is refined together with the drift of the clocks and the gyro's bias:

.. math:: \omega_{gyro}(t) = R\,\omega_{mocap}(t - \tau - d\,(t - t_0)) + b.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from rotorfit.errors import FlightError, LogError
from rotorfit.findings import Finding, doubt
from rotorfit.flight.clocks import JITTER_STEPS, uniform_channels, usable_samples
from rotorfit.flight.filters import correlate
from rotorfit.flight.kinematics import continuous_quaternions, motion_from_quaternions
from rotorfit.flight.mocap.camera import camera_clock, poses
from rotorfit.flight.signals import low_pass, whole_samples
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Bool, Float

    from rotorfit.logs.flight_log import Channel, FlightLog

CUTOFF = 8.0
"""Cut-off of the low-pass on both rates [Hz], or a quarter of the slower rate."""
STEPS_PER_CUTOFF = 12.5
"""Samples of the common grid per period of the cut-off."""
SHORTEST_OVERLAP = 5.0
"""Common time from which two recordings may belong together [s]."""
CANDIDATES = 8
SEPARATION = 0.3
"""Least separation of two candidates for the offset [s]."""
WEAKEST_FIT = 0.8
"""Correlation of the two rates after alignment, below which they are not the same flight."""
CLEAREST_RIVAL = 0.95
"""Largest share of the best fit that another offset may reach."""
CLOCK_STD = 1e-4
"""Prior deviation of the drift between two clocks [s/s]."""
LARGEST_DRIFT = 2e-3
VAGUEST_MOUNTING = np.radians(2.0)
SLOWEST_TURNS = 0.05
"""Rms of the rates that an alignment needs [rad/s]."""
ITERATIONS = 8


@frozen_dataclass
class Alignment:
    """The alignment of a motion-capture recording with the clock and the axes of a log.

    - `offset`: what is added to the recording's time at `origin` [s].
    - `drift`: seconds by which the recording's clock falls behind, per second of the log.
    - `origin`: time of the log at which `offset` holds [s].
    - `rotation_marker_to_body`: from the tracked body's axes to the log's.
    - `correlation`: of the two rates after alignment.
    - `offset_std`, `rotation_std`: standard deviations [s], [rad]; of the least certain axis.
    """

    offset: float
    drift: float
    origin: float
    rotation_marker_to_body: Float[np.ndarray, "3 3"]
    correlation: float
    offset_std: float
    rotation_std: float

    def log_time(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Convert times of the recording to the log's clock [s]."""
        return self.origin + (time + self.offset - self.origin) / (1.0 - self.drift)


@frozen_dataclass
class _Rates:
    """Angular velocity on a uniform grid, zero if there is none.

    - `start`, `step`: of the grid [s].
    - `values`: [rad/s]
    - `known`: where it was measured.
    """

    start: float
    step: float
    values: Float[np.ndarray, "n 3"]
    known: Bool[np.ndarray, " n"]

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        return self.start + self.step * np.arange(len(self.values))

    @property
    def size(self) -> Float[np.ndarray, " n"]:
        """Length of the rates about its mean; zero if it is not known."""
        length = np.sqrt((self.values * self.values).sum(axis=1))
        return np.where(self.known, length - length[self.known].mean(), 0.0)


def align(recording: FlightLog, gyro: Channel) -> Alignment:
    """Align a pose recording with a gyro in time and axes; raise where their rates disagree."""
    slowest = min(
        1.0 / float(np.median(np.diff(usable_samples(channel, name).time)))
        for channel, name in ((recording.channels["attitude"], "attitude"), (gyro, "gyro"))
    )
    cutoff = min(CUTOFF, 0.25 * slowest)
    step = 1.0 / (STEPS_PER_CUTOFF * cutoff)
    body, marker = _gyro_rates(gyro, cutoff, step), _pose_rates(recording, cutoff, step)
    for rates, what in ((body, "gyro"), (marker, "motion capture")):
        turns = float(np.sqrt((rates.values[rates.known] ** 2).sum(axis=1).mean()))
        if turns < SLOWEST_TURNS:
            raise FlightError(
                f"the {what} turns by {turns:.3f} rad/s rms, where {SLOWEST_TURNS:g} are needed to "
                "align the two; fly with more roll and pitch, and check that it is the vehicle"
            )
    start = _best_start(body, marker)
    return _refine_alignment(body, marker, start, cutoff=cutoff)


def _gyro_rates(gyro: Channel, cutoff: float, step: float) -> _Rates:
    uniform = uniform_channels({"gyro": usable_samples(gyro, "gyro")}, clock="gyro")
    rate, values = uniform.sample_rate, uniform.values["gyro"]
    runs = [(a, b) for a, b in uniform.stretches if (b - a) * cutoff > rate]
    parts = [low_pass(values[a:b], rate, cutoff) for a, b in runs]
    return _on_grid([uniform.time[a:b] for a, b in runs], parts, step)


def _pose_rates(recording: FlightLog, cutoff: float, step: float) -> _Rates:
    """Differentiate the attitude of the tracked body: rates in its own axes."""
    pose = poses(recording)
    clock = camera_clock(pose.time)
    q = continuous_quaternions(pose.values[:, 3:])
    runs = [(a, b) for a, b in clock.runs if (b - a) * cutoff > clock.rate]
    parts: list[Float[np.ndarray, "n 3"]] = []
    for a, b in runs:
        smooth = continuous_quaternions(low_pass(q[a:b], clock.rate, cutoff))
        motion = motion_from_quaternions(pose.values[a:b, :3], smooth, clock.rate)
        parts.append(motion.angular_velocity)
    return _on_grid([clock.time[a:b] for a, b in runs], parts, step)


def _on_grid(
    times: list[Float[np.ndarray, " _"]], parts: list[Float[np.ndarray, "_ 3"]], step: float
) -> _Rates:
    """Interpolate runs of rates on one uniform grid; each time is as long as its rates."""
    if not times:
        raise FlightError("never runs for a second without a gap; record it again")
    start, end = float(times[0][0]), float(times[-1][-1])
    # Rounding must not decide whether the last frame counts.
    edge = JITTER_STEPS * step
    grid = start + step * np.arange(int((end + edge - start) / step) + 1)
    values, known = np.zeros((len(grid), 3)), np.zeros(len(grid), dtype=bool)
    for time, part in zip(times, parts, strict=True):
        inside = (grid >= time[0] - edge) & (grid <= time[-1] + edge)
        for k in range(3):
            values[inside, k] = np.interp(grid[inside], time, part[:, k])
        known |= inside
    return _Rates(start=start, step=step, values=values, known=known)


def _best_start(body: _Rates, marker: _Rates) -> _Start:
    """Find the offset and rotation at which the rates fit best; raise if none or two do."""
    starts = [_fit_start(body, marker, offset) for offset in _rank_offsets(body, marker)]
    starts.sort(key=lambda start: -start.fit)
    if not starts or starts[0].fit < WEAKEST_FIT:
        fit = f"{starts[0].fit:.2f} at best" if starts else "not known"
        raise FlightError(
            f"the rates of gyro and motion capture do not go together (correlation {fit}, expected "
            f"{WEAKEST_FIT:g} or more): check that both are of one flight, that the rigid body is "
            "the vehicle, and that the axes are right-handed with z up"
        )
    if len(starts) > 1 and starts[1].fit > CLEAREST_RIVAL * starts[0].fit:
        raise FlightError(
            f"motion capture fits the gyro at offsets of {starts[0].offset:.2f} and "
            f"{starts[1].offset:.2f} s alike (correlation {starts[0].fit:.2f}, {starts[1].fit:.2f})"
            ": the flight repeats itself; give a longer recording of it"
        )
    return starts[0]


@frozen_dataclass
class _Start:
    """A trial: offset [s], rotation of the axes, correlation of the rates."""

    offset: float
    rotation: Float[np.ndarray, "3 3"]
    fit: float


def _rank_offsets(body: _Rates, marker: _Rates) -> list[float]:
    """Rank the offsets at which the sizes of the rates correlate best."""

    def over_lags(
        x: Float[np.ndarray, " n"], y: Float[np.ndarray, " m"]
    ) -> Float[np.ndarray, " k"]:
        return correlate(x, y)

    x, y = body.size, marker.size
    there, here = body.known.astype(float), marker.known.astype(float)
    overlap = over_lags(there, here)
    energy = np.maximum(over_lags(x * x, here), 0.0) * np.maximum(over_lags(there, y * y), 0.0)
    floor = 1e-6 * float((x @ x) * (y @ y))
    score = over_lags(x, y) / np.sqrt(np.maximum(energy, floor))
    # Over the overlap alone, where that is long enough.
    shortest = max(SHORTEST_OVERLAP / body.step, 0.5 * min(there.sum(), here.sum()))
    score = np.where(overlap >= shortest - 0.5, score, -1.0)
    found: list[float] = []
    for _ in range(CANDIDATES):
        best = int(np.argmax(score))
        if score[best] <= 0:
            break
        found.append(body.start - marker.start + (best - len(y) + 1) * body.step)
        near = whole_samples(SEPARATION / body.step)
        score[max(best - near, 0) : best + near + 1] = -1.0
    return found


def _fit_start(body: _Rates, marker: _Rates, offset: float) -> _Start:
    """Fit the rotation at an offset, each rate about its mean."""
    seen, known = _interpolate_rates(marker, body.time - offset)
    known &= body.known
    a = body.values[known] - body.values[known].mean(axis=0)
    b = seen[known] - seen[known].mean(axis=0)
    U, S, Vt = np.linalg.svd(a.T @ b)
    handed = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    energy = float(np.sqrt((a * a).sum() * (b * b).sum()))
    fit = float(S @ handed) / max(energy, np.finfo(float).tiny)
    return _Start(offset=offset, rotation=(U * handed) @ Vt, fit=fit)


def _interpolate_rates(
    rates: _Rates, time: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
    """Interpolate rates between the samples of their grid, and mark where they are known."""
    rows = (time - rates.start) / rates.step
    left = np.clip(np.floor(rows).astype(int), 0, len(rates.values) - 2)
    share = (rows - left)[:, None]
    edge = len(rates.values) - 1 + JITTER_STEPS
    inside = (rows >= -JITTER_STEPS) & (rows <= edge)
    values = (1.0 - share) * rates.values[left] + share * rates.values[left + 1]
    return values, inside & rates.known[left] & rates.known[left + 1]


@frozen_dataclass
class _Trial:
    """The unknowns, in the order of the columns of `_linearise_trial`."""

    offset: float
    drift: float
    rotation: Float[np.ndarray, "3 3"]
    bias: Float[np.ndarray, " 3"]

    def moved(self, step: Float[np.ndarray, " 8"]) -> _Trial:
        """Move the trial by a step; the rotation turns by a small vector."""
        return _Trial(
            offset=self.offset + float(step[0]),
            drift=self.drift + float(step[1]),
            rotation=Rotation.from_rotvec(step[2:5]).as_matrix() @ self.rotation,
            bias=self.bias + step[5:],
        )


@frozen_dataclass
class _Pair:
    """Both rates, the slope of the marker's, and on the body's grid the rows known of both.

    `origin` is their mean time [s]; `correlated` low-passed residuals count as one.
    """

    body: _Rates
    marker: _Rates
    slope: _Rates
    known: Bool[np.ndarray, " n"]
    origin: float
    correlated: float


def _refine_alignment(body: _Rates, marker: _Rates, start: _Start, *, cutoff: float) -> Alignment:
    """Refine the alignment by Gauss-Newton, from a start within a step or two."""
    trial = _Trial(offset=start.offset, drift=0.0, rotation=start.rotation, bias=np.zeros(3))
    pair = _pair_rates(body, marker, trial, cutoff=cutoff)
    trial = _iterate_trial(pair, trial)
    # Which rows they share is seen anew: the start is off by a step, and a row more or less counts.
    pair = _pair_rates(body, marker, trial, cutoff=cutoff)
    trial = _iterate_trial(pair, trial)
    information, _, unexplained = _normal_equations(pair, trial)
    std = np.sqrt(np.diag(np.linalg.inv(information)))
    found = Alignment(
        offset=trial.offset,
        drift=trial.drift,
        origin=pair.origin,
        rotation_marker_to_body=trial.rotation,
        correlation=float(np.sqrt(max(1.0 - unexplained, 0.0))),
        offset_std=float(std[0]),
        rotation_std=float(std[2:5].max()),
    )
    _refuse_vague(found)
    return found


def _pair_rates(body: _Rates, marker: _Rates, trial: _Trial, *, cutoff: float) -> _Pair:
    """Pair both rates in the rows that they share at a trial."""
    known = body.known & _interpolate_rates(marker, body.time - trial.offset)[1]
    return _Pair(
        body=body,
        marker=marker,
        slope=dataclasses.replace(marker, values=np.gradient(marker.values, marker.step, axis=0)),
        known=known,
        origin=float(body.time[known].mean()),
        correlated=1.0 / (2.0 * cutoff * body.step),
    )


def _iterate_trial(pair: _Pair, trial: _Trial) -> _Trial:
    """Iterate Gauss-Newton from a trial."""
    for _ in range(ITERATIONS):
        information, gradient, _ = _normal_equations(pair, trial)
        trial = trial.moved(-np.linalg.solve(information, gradient))
    return trial


def _normal_equations(
    pair: _Pair, trial: _Trial
) -> tuple[Float[np.ndarray, "8 8"], Float[np.ndarray, " 8"], float]:
    """Compute information and gradient at a trial, and the unexplained share of the rates."""
    residual, J, rates = _linearise_trial(pair, trial)
    squares = float((residual * residual).sum())
    variance = pair.correlated * squares / residual.size + float(np.finfo(float).tiny)
    information = np.einsum("nij,nik->jk", J, J) / variance + 1e-12 * np.eye(8)
    gradient = np.einsum("nij,ni->j", J, residual) / variance
    information[1, 1] += CLOCK_STD**-2
    gradient[1] += trial.drift * CLOCK_STD**-2
    centred = rates - rates.mean(axis=0)
    return information, gradient, squares / float((centred * centred).sum())


def _linearise_trial(
    pair: _Pair, trial: _Trial
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 8"], Float[np.ndarray, "n 3"]]:
    """Compute residuals, their derivatives by the unknowns, and the gyro's rates of these rows."""
    since = pair.body.time - pair.origin
    past = pair.body.time - trial.offset - trial.drift * since
    seen, there = _interpolate_rates(pair.marker, past)
    rows = pair.known & there
    rate = seen[rows] @ trial.rotation.T
    change = _interpolate_rates(pair.slope, past)[0][rows] @ trial.rotation.T
    measured = pair.body.values[rows]
    J = np.zeros((len(rate), 3, 8))
    J[:, :, 0] = change
    J[:, :, 1] = change * since[rows][:, None]
    J[:, :, 2:5] = _cross_matrix(rate)
    J[:, :, 5:] = -np.eye(3)
    return measured - trial.bias - rate, J, measured


def _cross_matrix(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Build the matrices M with M p = vector x p."""
    x, y, z = vectors.T
    M = np.zeros((len(vectors), 3, 3))
    M[:, 0, 1], M[:, 0, 2], M[:, 1, 2] = -z, y, -x
    M[:, 1, 0], M[:, 2, 0], M[:, 2, 1] = z, -y, x
    return M


def _refuse_vague(found: Alignment) -> None:
    if found.rotation_std > VAGUEST_MOUNTING:
        raise FlightError(
            f"how the markers are mounted is known only to {np.degrees(found.rotation_std):.1f} "
            "degrees: the flight turned about one axis, or hardly at all; fly with roll, pitch and "
            "yaw"
        )
    if abs(found.drift) > LARGEST_DRIFT:
        raise FlightError(
            f"the clocks drift apart by {1e2 * abs(found.drift):.2f} %, more than clocks do: "
            "export the recording with the times of the cameras, and check its frame rate"
        )


NOTED_FIT = 0.95


def with_poses(log: FlightLog, recording: FlightLog) -> FlightLog:
    """Add the pose of a motion-capture recording of the same flight to a log.

    Position stays that of the tracked point; attitude becomes that of the log's body axes.
    """
    if "gyro" not in log.channels:
        raise LogError(
            f"{log.path.name} has no gyro (it has {', '.join(log.channels)}), which is needed to "
            f"align {recording.path.name} with it; log the raw IMU"
        )
    try:
        found = align(recording, log.channels["gyro"])
    except FlightError as error:
        raise FlightError(
            f"motion capture {recording.path.name} with {log.path.name}: {error}"
        ) from error
    moved = {
        name: dataclasses.replace(
            channel,
            time=found.log_time(np.asarray(channel.time, dtype=float)),
            source=f"{channel.source}; aligned by the rates",
        )
        for name, channel in recording.channels.items()
        if name in ("position", "attitude")
    }
    attitude = moved["attitude"].values
    good = np.isfinite(attitude).all(axis=1)
    turned = np.full(attitude.shape, np.nan)
    world = Rotation.from_quat(np.roll(attitude[good], -1, axis=1))
    body = world * Rotation.from_matrix(found.rotation_marker_to_body).inv()
    turned[good] = np.roll(body.as_quat(), 1, axis=1)
    moved["attitude"] = dataclasses.replace(moved["attitude"], values=turned)
    return dataclasses.replace(
        log,
        channels={**log.channels, "position": moved["position"], "attitude": moved["attitude"]},
        metadata={
            **log.metadata,
            "motion capture": str(recording.path.name),
            "motion capture sha256": recording.sha256,
        },
        notes=(*log.notes, *recording.notes, _alignment_note(recording, found)),
        findings=(*log.findings, *recording.findings, *_poorly_aligned(found)),
    )


def _poorly_aligned(found: Alignment) -> Iterator[Finding]:
    if found.correlation < NOTED_FIT:
        yield doubt(
            "poor-alignment",
            f"the rates of motion capture and gyro agree to a correlation of "
            f"{found.correlation:.2f} only ({NOTED_FIT:g} is usual): markers that shake, lost "
            "frames, or a slow gyro log",
        )


def _alignment_note(recording: FlightLog, found: Alignment) -> str:
    roll, pitch, yaw = Rotation.from_matrix(found.rotation_marker_to_body).as_euler(
        "ZYX", degrees=True
    )[::-1]
    return (
        f"Motion capture from {recording.path.name}: its time plus {found.offset:.4f} s (std "
        f"{1e3 * found.offset_std:.1f} ms, drift {1e6 * found.drift:.0f} ppm), its body turned by "
        f"roll {roll:.1f}, pitch {pitch:.1f}, yaw {yaw:.1f} degrees (std "
        f"{np.degrees(found.rotation_std):.1f}), found by the rates (correlation "
        f"{found.correlation:.3f})."
    )
