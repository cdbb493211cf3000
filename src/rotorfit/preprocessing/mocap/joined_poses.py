"""A log with the poses of a recording of the same flight, on the log's clock and axes."""

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from rotorfit.errors import FlightError, LogError
from rotorfit.logs.flight_log import FlightLog
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
    warnings = [*log.warnings, *recording.warnings]
    if found.correlation < NOTED_FIT:
        warnings.append(
            f"the rates of motion capture and gyro agree to a correlation of "
            f"{found.correlation:.2f} only ({NOTED_FIT:g} is usual): markers that shake, lost "
            "frames, or a slow gyro log"
        )
    return dataclasses.replace(
        log,
        channels={**log.channels, "position": moved["position"], "attitude": moved["attitude"]},
        metadata={
            **log.metadata,
            "motion capture": str(recording.path.name),
            "motion capture sha256": recording.sha256,
        },
        notes=(*log.notes, *recording.notes, _note(recording, found)),
        warnings=tuple(warnings),
    )


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
