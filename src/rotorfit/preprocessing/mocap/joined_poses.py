"""A log with the poses of a recording of the same flight, on the log's clock and axes."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from rotorfit.errors import FlightError, LogError
from rotorfit.logs.flight_log import Channel, FlightLog
from rotorfit.preprocessing.mocap.align import Alignment, align

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
    moved = {name: _moved(recording.channels[name], found) for name in ("position", "attitude")}
    attitude = moved["attitude"]
    turned = _turned(attitude.values, found.rotation_marker_to_body)
    moved["attitude"] = dataclasses.replace(attitude, values=turned)
    return dataclasses.replace(
        log,
        channels={**log.channels, **moved},
        metadata={
            **log.metadata,
            "motion capture": str(recording.path.name),
            "motion capture sha256": recording.sha256,
        },
        notes=(*log.notes, *recording.notes, _note(recording, found)),
        warnings=(*log.warnings, *recording.warnings, *_warnings(found)),
    )


def _moved(channel: Channel, found: Alignment) -> Channel:
    return dataclasses.replace(
        channel,
        time=found.log_time(np.asarray(channel.time, dtype=float)),
        source=f"{channel.source}; aligned by the rates",
    )


def _turned(
    attitude_wxyz: Float[np.ndarray, "n 4"], rotation: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "n 4"]:
    """Turn attitudes of the tracked body to the log's body axes; NaN stays."""
    good = np.isfinite(attitude_wxyz).all(axis=1)
    turned = np.full(attitude_wxyz.shape, np.nan)
    world = Rotation.from_quat(np.roll(attitude_wxyz[good], -1, axis=1))
    body = world * Rotation.from_matrix(rotation).inv()
    turned[good] = np.roll(body.as_quat(), 1, axis=1)
    return turned


def _note(recording: FlightLog, found: Alignment) -> str:
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


def _warnings(found: Alignment) -> tuple[str, ...]:
    if found.correlation >= NOTED_FIT:
        return ()
    return (
        f"the rates of motion capture and gyro agree to a correlation of {found.correlation:.2f} "
        f"only ({NOTED_FIT:g} is usual): markers that shake, lost frames, or a slow gyro log",
    )
