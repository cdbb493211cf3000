"""The rate controller of a PX4 log: topics and parameters."""

from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.errors import LogError
from rotorfit.logs.controller_log import TURNED, ControllerLog
from rotorfit.logs.ulog.firmware import log_faster
from rotorfit.logs.ulog.messages import Topic
from rotorfit.logs.ulog.scan import Scan

TOPICS: Final = {
    "vehicle_angular_velocity": ("timestamp", "timestamp_sample", "xyz", "xyz_derivative"),
    "vehicle_rates_setpoint": ("timestamp", "roll", "pitch", "yaw"),
    "vehicle_torque_setpoint": ("timestamp", "timestamp_sample", "xyz"),
}

WITHIN: Final = 0.5
"""Of a run of the controller: the set point is the last one, or came in that very run."""


def controller_of(scan: Scan, path: Path) -> ControllerLog:
    """Read the rate controller of a PX4 log, whose scan has `TOPICS`."""
    measured, asked, torque = (_topic(scan, name, path) for name in TOPICS)
    rates, slopes, outputs = (
        _vector(topic, field, path)
        for topic, field in ((measured, "xyz"), (measured, "xyz_derivative"), (torque, "xyz"))
    )
    # The controller runs on a sample of the gyro, and its output bears the time of that sample.
    sampled, at = torque.sample_time, measured.sample_time
    row = np.minimum(np.searchsorted(at, sampled - 1e-6), len(at) - 1)
    known = np.abs(at[row] - sampled) < 1e-6
    set_points = np.stack([asked.column(axis) for axis in ("roll", "pitch", "yaw")], axis=1)
    used = _used(asked.time, set_points, torque.time)
    known &= np.isfinite(outputs).all(axis=1) & np.isfinite(rates[row]).all(axis=1)
    known &= np.isfinite(used).all(axis=1)
    if known.sum() < 2:
        raise LogError(f"{path}: no run of the rate controller is complete: {_cure(scan)}")
    return ControllerLog(
        autopilot="PX4",
        firmware=str(scan.info.get("ver_sw", "version unknown"))[:12],
        parameters={
            name: value for name in scan.parameters if (value := scan.last(name)) is not None
        },
        changed=tuple(name for name, _, _ in scan.changes),
        time=torque.time[known],
        set_point=used[known] * TURNED,
        rate=rates[row][known] * TURNED,
        output=outputs[known] * TURNED,
        set_point_std=WITHIN * float(np.median(np.diff(torque.time))),
        slope=slopes[row][known] * TURNED,
    )


def _used(
    published: Float[np.ndarray, " m"],
    set_points: Float[np.ndarray, "m 3"],
    time: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n 3"]:
    """Compute the set points that the controller used: those of the run before.

    Between those logged they are interpolated: the logger loses many (a third, at 250 Hz).
    """
    finite = np.isfinite(set_points).all(axis=1)
    if finite.sum() < 2:
        return np.full((len(time), 3), np.nan)
    at = time - float(np.median(np.diff(time)))
    columns = [np.interp(at, published[finite], set_points[finite, i]) for i in range(3)]
    return np.stack(columns, axis=1)


def _cure(scan: Scan) -> str:
    return f"{log_faster(scan.number('SDLOG_PROFILE'))} and fly again"


def _topic(scan: Scan, name: str, path: Path) -> Topic:
    topic = scan.first(name)
    if topic is None or len(topic.rows) < 2:
        raise LogError(
            f"{path}: the log has no {name}, which the rate controller is: {_cure(scan)}"
        )
    return topic


def _vector(topic: Topic, name: str, path: Path) -> Float[np.ndarray, "n 3"]:
    values = topic.vector(name, 3)
    if values is None:
        raise LogError(f"{path}: {topic.label} has no field {name}: use PX4 1.14 or later")
    return values
