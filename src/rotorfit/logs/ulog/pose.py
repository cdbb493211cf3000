"""Pose from motion capture or vision, body velocity and battery of a PX4 log."""

from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.flight.log import Channel
from rotorfit.logs.axes import attitude_to_flu, vectors_to_flu
from rotorfit.logs.ulog.scan import Scan, Topic

MOCAP: Final = ("vehicle_mocap_odometry", "vehicle_visual_odometry")
TOPICS: Final = (*MOCAP, "vehicle_local_position", "vehicle_attitude", "battery_status")
NED, FRD = "north-east-down", "forward-right-down"
_FRAMES: Final = {"pose_frame": {1: NED, 2: FRD}, "local_frame": {0: NED, 1: FRD}}
"""Names of the world by the field's number: from PX4 1.14 on, and before."""


def find_pose(scan: Scan) -> tuple[dict[str, Channel], list[str]]:
    """Return position and attitude by motion capture or vision, z up, and notes."""
    for name in MOCAP:
        topic = scan.first(name)
        if topic is not None and len(topic.rows) > 1:
            return _pose(topic)
    return {}, []


def _pose(topic: Topic) -> tuple[dict[str, Channel], list[str]]:
    position, attitude = _position(topic), topic.vector("q", 4)
    world = _world(topic)
    if position is None or attitude is None or world is None:
        return {}, [f"{topic.label} is left out: its frame is neither NED nor FRD."]
    length = np.sqrt(np.einsum("nk,nk->n", attitude, attitude))
    good = np.abs(length - 1.0) < 0.05
    unit = attitude / np.where(good, length, np.nan)[:, None]
    time = topic.sample_time
    rising = time >= np.maximum.accumulate(time)
    source = f"{topic.label}, FRD in {world} turned to FLU with z up"
    place = np.where(np.isfinite(position), vectors_to_flu(position, "FRD"), np.nan)
    found = {"position": place, "attitude": attitude_to_flu(unit, "FRD")}
    return {
        name: Channel(time=time[rising], values=values[rising], source=source)
        for name, values in found.items()
        if np.isfinite(values).all(axis=1).any()
    }, []


def _position(topic: Topic) -> Float[np.ndarray, "n 3"] | None:
    """Return the position as an array (from PX4 1.14 on), or from x, y and z."""
    array = topic.vector("position", 3)
    if array is not None:
        return array
    single = [topic.number(axis) for axis in "xyz"]
    columns = [column for column in single if column is not None]
    return np.stack(columns, axis=1) if len(columns) == 3 else None


def _world(topic: Topic) -> str | None:
    for field, names in _FRAMES.items():
        frame = topic.number(field)
        if frame is not None:
            return names.get(int(frame[-1]))
    return None


def find_velocity(scan: Scan) -> Channel | None:
    """Return the estimated velocity in body axes, where position and attitude are logged."""
    place, turned = scan.first("vehicle_local_position"), scan.first("vehicle_attitude")
    if place is None or turned is None:
        return None
    parts = [place.number(name) for name in ("vx", "vy", "vz")]
    valid = [place.number(name) for name in ("v_xy_valid", "v_z_valid")]
    q = turned.vector("q", 4)
    columns = [column for column in parts if column is not None]
    if q is None or len(columns) < 3:
        return None
    known = np.all([flag != 0 for flag in valid if flag is not None], axis=0)
    attitude = _interpolated(place.time, turned.time, q)
    velocity = np.where(
        np.broadcast_to(np.atleast_1d(known)[:, None], (len(place.rows), 1)),
        _to_body(attitude, np.stack(columns, axis=1)),
        np.nan,
    )
    if not np.isfinite(velocity).all(axis=1).any():
        return None
    source = f"{place.label}.vx/vy/vz turned by {turned.label}.q, the autopilot's estimate"
    return Channel(time=place.time, values=vectors_to_flu(velocity, "FRD"), source=source)


def _interpolated(
    time: Float[np.ndarray, " n"], t: Float[np.ndarray, " m"], q: Float[np.ndarray, "m 4"]
) -> Float[np.ndarray, "n 4"]:
    """Return unit quaternions at other times, by the straight line between neighbours."""
    # q and -q are one attitude: neighbours are brought to one side first.
    flips = np.where(np.einsum("nk,nk->n", q[1:], q[:-1]) < 0, -1.0, 1.0)
    q = q * np.concatenate([[1.0], np.cumprod(flips)])[:, None]
    between = np.empty((len(time), 4))
    for k in range(4):
        between[:, k] = np.interp(time, t, q[:, k])
    length = np.sqrt(np.einsum("nk,nk->n", between, between))
    return between / np.where(length > 0.5, length, np.nan)[:, None]


def _to_body(
    q: Float[np.ndarray, "n 4"], world: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Return world vectors in body axes; q turns body into world, w first."""
    w, v = q[:, :1], -q[:, 1:]
    t = 2.0 * np.cross(v, world)
    return world + w * t + np.cross(v, t)


def find_battery(scan: Scan) -> Channel | None:
    """Return the voltage of the first battery that has one."""
    for topic in scan.all("battery_status"):
        volts = topic.number("voltage_v")
        if volts is not None and bool((volts > 0).any()):
            values = np.where(np.isfinite(volts) & (volts > 0), volts, np.nan)
            return Channel(
                time=topic.time, values=values[:, None], source=f"{topic.label}.voltage_v [V]"
            )
    return None
