"""Pose from motion capture or vision, body velocity, rates asked for and battery of a PX4 log."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.logs.axes import attitude_to_flu, vectors_to_flu, world_to_body
from rotorfit.logs.flight_log import Channel, pieces
from rotorfit.logs.ulog.messages import Topic
from rotorfit.logs.ulog.scan import Scan

MOCAP: Final = ("vehicle_mocap_odometry", "vehicle_visual_odometry")
TOPICS: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(
        MOCAP,
        (
            *("timestamp", "timestamp_sample", "position", "x", "y", "z", "q"),
            *("pose_frame", "local_frame"),
        ),
    ),
    "vehicle_local_position": ("timestamp", "vx", "vy", "vz", "v_xy_valid", "v_z_valid"),
    "vehicle_attitude": ("timestamp", "q"),
    "vehicle_rates_setpoint": ("timestamp", "roll", "pitch", "yaw"),
    "battery_status": ("timestamp", "voltage_v"),
}
"""Topics and the fields of them that are used."""
NED, FRD = "north-east-down", "forward-right-down"
_FRAMES: Final = {"pose_frame": {1: NED, 2: FRD}, "local_frame": {0: NED, 1: FRD}}
"""Names of the world by the field's number: from PX4 1.14 on, and before."""


def find_pose(scan: Scan) -> tuple[dict[str, Channel], list[str]]:
    """Find position and attitude by motion capture or vision, z up, and notes."""
    for name in MOCAP:
        topic = scan.first(name)
        if topic is not None and len(topic.rows) > 1:
            return _pose(topic)
    return {}, []


def _pose(topic: Topic) -> tuple[dict[str, Channel], list[str]]:
    time = topic.sample_time
    rising = time >= np.maximum.accumulate(time)
    if not rising.all():
        time, topic = time[rising], replace(topic, rows=topic.rows[rising])
    world = _world(topic)
    if _position(topic, slice(1)) is None or not topic.has_vector("q", 4) or world is None:
        return {}, [f"{topic.label} is left out: its frame is neither NED nor FRD."]
    found = {"position": np.empty((len(topic.rows), 3)), "attitude": np.empty((len(topic.rows), 4))}
    for rows in pieces(len(topic.rows)):
        position, attitude = _position(topic, rows), topic.column("q", rows)[:, :4]
        assert position is not None  # as of the first row
        length = np.sqrt(np.einsum("nk,nk->n", attitude, attitude))
        good = np.abs(length - 1.0) < 0.05
        unit = attitude / np.where(good, length, np.nan)[:, None]
        place = np.where(np.isfinite(position), vectors_to_flu(position, "FRD"), np.nan)
        found["position"][rows], found["attitude"][rows] = place, attitude_to_flu(unit, "FRD")
    source = f"{topic.label}, FRD in {world} turned to FLU with z up"
    return {
        name: Channel(time=time, values=values, source=source)
        for name, values in found.items()
        if np.isfinite(values).all(axis=1).any()
    }, []


def _position(topic: Topic, rows: slice) -> Float[np.ndarray, "n 3"] | None:
    """Find the position as an array (from PX4 1.14 on), or from x, y and z."""
    if topic.has_vector("position", 3):
        return topic.column("position", rows)[:, :3]
    if not all(topic.has_number(axis) for axis in "xyz"):
        return None
    return np.stack([topic.column(axis, rows) for axis in "xyz"], axis=1)


def _world(topic: Topic) -> str | None:
    for field, names in _FRAMES.items():
        frame = topic.number(field)
        if frame is not None:
            return names.get(int(frame[-1]))
    return None


def find_velocity(scan: Scan) -> Channel | None:
    """Read the estimated velocity in body axes, where position and attitude are logged."""
    place, turned = scan.first("vehicle_local_position"), scan.first("vehicle_attitude")
    if place is None or turned is None:
        return None
    if not turned.has_vector("q", 4) or not all(map(place.has_number, ("vx", "vy", "vz"))):
        return None
    known = np.ones(len(place.rows), dtype=bool)
    for name in ("v_xy_valid", "v_z_valid"):
        flag = place.number(name)
        known &= True if flag is None else flag != 0
    time, turned_time = place.time, turned.time
    velocity = np.empty((len(time), 3))
    for rows in pieces(len(time)):
        columns = [place.column(name, rows) for name in ("vx", "vy", "vz")]
        attitude = _interpolated(time[rows], turned_time, turned)
        velocity[rows] = vectors_to_flu(world_to_body(np.stack(columns, axis=1), attitude), "FRD")
    velocity[~known] = np.nan
    if not np.isfinite(velocity).all(axis=1).any():
        return None
    source = f"{place.label}.vx/vy/vz turned by {turned.label}.q, the autopilot's estimate"
    return Channel(time=time, values=velocity, source=source)


def _on_one_side(q: Float[np.ndarray, "m 4"]) -> Float[np.ndarray, "m 4"]:
    """Flip quaternions to the side of their neighbours: q and -q are one attitude."""
    flips = np.where(np.einsum("nk,nk->n", q[1:], q[:-1]) < 0, -1.0, 1.0)
    return q * np.concatenate([[1.0], np.cumprod(flips)])[:, None]


def _interpolated(
    time: Float[np.ndarray, " n"], t: Float[np.ndarray, " m"], turned: Topic
) -> Float[np.ndarray, "n 4"]:
    """Interpolate unit quaternions at other times, by the straight line between neighbours."""
    first = max(int(np.searchsorted(t, float(time[0]))) - 1, 0)
    last = int(np.searchsorted(t, float(time[-1]), side="right")) + 1
    t, q = t[first:last], _on_one_side(turned.column("q", slice(first, last))[:, :4])
    between = np.empty((len(time), 4))
    for k in range(4):
        between[:, k] = np.interp(time, t, q[:, k])
    length = np.sqrt(np.einsum("nk,nk->n", between, between))
    return between / np.where(length > 0.5, length, np.nan)[:, None]


def find_reference(scan: Scan) -> Channel | None:
    """Read the rates that the rate controller was asked for, body axes [rad/s]."""
    topic = scan.first("vehicle_rates_setpoint")
    axes = ("roll", "pitch", "yaw")
    if topic is None or not all(map(topic.has_number, axes)):
        return None
    values = vectors_to_flu(np.stack([topic.column(axis) for axis in axes], axis=1), "FRD")
    source = f"{topic.label}.roll/pitch/yaw, FRD turned to FLU"
    return Channel(time=topic.time, values=values, source=source)


def find_battery(scan: Scan) -> Channel | None:
    """Read the voltage of the first battery that has one."""
    for topic in scan.all("battery_status"):
        volts = topic.number("voltage_v")
        if volts is not None and bool((volts > 0).any()):
            values = np.where(np.isfinite(volts) & (volts > 0), volts, np.nan)
            return Channel(
                time=topic.time, values=values[:, None], source=f"{topic.label}.voltage_v [V]"
            )
    return None
