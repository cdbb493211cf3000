"""Sensors and estimates of a PX4 log: gyro, accelerometer, pose, velocity, battery, set rates.

Gyro and accelerometer come from the best of the topics that have them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.flight_log import Channel, pieces
from rotorfit.logs.ulog.firmware import log_faster
from rotorfit.logs.units import attitude_to_flu, vectors_to_flu, world_to_body

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jaxtyping import Bool, Float

    from rotorfit.logs.ulog.messages import Topic
    from rotorfit.logs.ulog.scan import Scan

_SIGNAL: Final = ("timestamp", "timestamp_sample", "xyz")
_FIFO: Final = (
    *("timestamp", "timestamp_sample", "device_id", "dt", "scale", "samples"),
    *("x", "y", "z"),
)
IMU_TOPICS: Final[Mapping[str, tuple[str, ...]]] = {
    "sensor_combined": (
        *("timestamp", "gyro_rad", "accelerometer_timestamp_relative"),
        "accelerometer_m_s2",
    ),
    "vehicle_imu": (
        *("timestamp", "timestamp_sample", "gyro_device_id"),
        *("delta_angle", "delta_velocity", "delta_angle_dt", "delta_velocity_dt"),
    ),
    "vehicle_angular_velocity": _SIGNAL,
    "vehicle_acceleration": _SIGNAL,
    "sensor_selection": ("timestamp", "gyro_device_id"),
}
"""Topics and the fields of them that are used."""
FIFO_TOPICS: Final[Mapping[str, tuple[str, ...]]] = {
    "sensor_gyro_fifo": _FIFO,
    "sensor_accel_fifo": _FIFO,
}
GOOD_RATE: Final = 90.0
"""A source this fast is taken before faster, later ones [Hz]."""
NO_ACCEL: Final = 0x7FFFFFFF
"""accelerometer_timestamp_relative of a row without an acceleration."""
COMPLETE: Final = 0.98
"""Share of the time that raw samples must cover."""


@frozen_dataclass
class Imu:
    """Gyro and accelerometer from one source, with notes about it."""

    gyro: Channel | None
    accel: Channel | None
    notes: tuple[str, ...] = ()

    @property
    def rate(self) -> float:
        """Median rate of the slower of the two [Hz]; 0 if one is missing."""
        return min(rate_of(self.gyro), rate_of(self.accel))

    @property
    def rank(self) -> float:
        """How much it is worth: its rate, as far as rate still helps; half a path a little."""
        return self.rate or 1e-3 * max(rate_of(self.gyro), rate_of(self.accel))


def rate_of(channel: Channel | None) -> float:
    """Compute the median rate of a channel [Hz]; 0 if there is none."""
    if channel is None or len(channel.time) < 2:
        return 0.0
    return 1.0 / max(float(np.median(np.diff(channel.time))), 1e-6)


def find_imu(scan: Scan, *, raw: Callable[[], Scan]) -> Imu:
    """Find the first source that is fast enough, else the fastest.

    In the order of sensor_combined, vehicle_imu, the controllers' signals and raw samples.
    """
    best = Imu(gyro=None, accel=None)
    makers = (
        lambda: _read_sensor_combined(scan),
        lambda: _read_vehicle_imu(scan),
        lambda: _read_filtered(scan),
        lambda: _read_fifo(scan, raw),
    )
    for maker in makers:
        found = maker()
        if found.rank > best.rank:
            best = found
        if best.rate >= GOOD_RATE:
            return best
    return best


def _flu_channel(
    time: Float[np.ndarray, " n"], frd: Float[np.ndarray, "n 3"] | None, source: str
) -> Channel | None:
    """Return a channel of body vectors, turned to FLU; None if nothing usable is in it."""
    if frd is None:
        return None
    values = vectors_to_flu(frd, "FRD")
    del frd
    values[~np.isfinite(values)] = np.nan
    if not np.isfinite(values).all(axis=1).any():
        return None
    return Channel(time=time, values=values, source=f"{source}, FRD turned to FLU")


def _read_sensor_combined(scan: Scan) -> Imu:
    """Return sensor_combined: means over the time between two samples, not filtered otherwise."""
    topic = scan.first("sensor_combined")
    if topic is None:
        return Imu(gyro=None, accel=None)
    label = topic.label
    gyro = _flu_channel(topic.time, topic.vector("gyro_rad", 3), f"{label}.gyro_rad")
    relative = topic.number("accelerometer_timestamp_relative")
    values = topic.vector("accelerometer_m_s2", 3)
    if relative is None or values is None:
        return Imu(gyro=gyro, accel=None)
    there = relative != NO_ACCEL
    relative *= 1e-6
    relative += topic.time
    time, values = _pick_samples(there, relative, values)
    # A sample whose own time is wrong is left out; the clock must not run backwards.
    time, values = _pick_samples(_rising_samples(time), time, values)
    return Imu(gyro=gyro, accel=_flu_channel(time, values, f"{label}.accelerometer_m_s2"))


def _rising_samples(time: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Select which samples are not earlier than one before."""
    return time >= np.maximum.accumulate(time)


def _pick_samples(
    rows: Bool[np.ndarray, " n"], time: Float[np.ndarray, " n"], values: Float[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m k"]]:
    """Return some of the samples; where it is all of them, without a copy."""
    return (time, values) if rows.all() else (time[rows], values[rows])


def _read_vehicle_imu(scan: Scan) -> Imu:
    """Return vehicle_imu: angles and velocities over their times, so means between samples."""
    topic = _select_instance(scan, scan.all("vehicle_imu"), "gyro_device_id")
    if topic is None:
        return Imu(gyro=None, accel=None)
    gyro = _over_time(topic, "delta_angle")
    accel = _over_time(topic, "delta_velocity")
    note = f"Gyro and accelerometer are means from {topic.label}: sensor_combined is not faster."
    return Imu(gyro=gyro, accel=accel, notes=(note,))


def _over_time(topic: Topic, name: str) -> Channel | None:
    change, span = topic.vector(name, 3), topic.number(f"{name}_dt")
    if change is None or span is None:
        return None
    change /= np.where(span > 0, 1e-6 * span, np.nan)[:, None]
    time = topic.sample_time
    time, rates = _pick_samples(_rising_samples(time), time, change)
    return _flu_channel(time, rates, f"{topic.label}.{name} over {name}_dt")


def _read_filtered(scan: Scan) -> Imu:
    """Read the signals of the controllers, low-passed on board."""
    gyro, accel = scan.first("vehicle_angular_velocity"), scan.first("vehicle_acceleration")
    cutoffs = [
        f"{name} = {cutoff:g} Hz" if cutoff is not None else f"{name} unknown"
        for name in ("IMU_GYRO_CUTOFF", "IMU_ACCEL_CUTOFF")
        for cutoff in (scan.number(name),)
    ]
    faster = log_faster(scan.number("SDLOG_PROFILE"))
    note = (
        f"Gyro and accelerometer were low-passed on board ({', '.join(cutoffs)}), each with a "
        f"delay of its own, and logged slowly: {faster} for sensor_combined, which is not filtered."
    )
    return Imu(gyro=_controller_signal(gyro), accel=_controller_signal(accel), notes=(note,))


def _controller_signal(topic: Topic | None) -> Channel | None:
    if topic is None:
        return None
    time, values = topic.sample_time, topic.vector("xyz", 3)
    if values is None:
        return None
    time, values = _pick_samples(_rising_samples(time), time, values)
    return _flu_channel(time, values, f"{topic.label}.xyz, filtered on board")


def _select_instance(scan: Scan, instances: tuple[Topic, ...], device: str) -> Topic | None:
    """Find the instance of the sensor that the autopilot flew with, else the first."""
    selection = scan.first("sensor_selection")
    chosen = None if selection is None else selection.number(device)
    for topic in instances:
        mine = topic.number(device)
        if chosen is not None and mine is not None and mine[0] == chosen[-1]:
            return topic
    return next(iter(instances), None)


def _read_fifo(scan: Scan, raw: Callable[[], Scan]) -> Imu:
    """Average the raw samples of each transfer."""
    turned = scan.number("SENS_BOARD_ROT")
    if not any(name in scan.counts for name in FIFO_TOPICS) or turned not in (None, 0.0):
        return Imu(gyro=None, accel=None)
    found = raw()
    gyro = _selected_fifo(found, "gyro")
    accel = _selected_fifo(found, "accel")
    note = (
        "Gyro and accelerometer are raw samples (sensor_gyro_fifo, sensor_accel_fifo), the mean "
        "of each transfer, without the autopilot's calibration."
    )
    return Imu(gyro=gyro, accel=accel, notes=(note,))


def _selected_fifo(found: Scan, kind: str) -> Channel | None:
    selected = _select_instance(found, found.all(f"sensor_{kind}_fifo"), "device_id")
    return None if selected is None else _transfer_means(selected)


def _transfer_means(topic: Topic) -> Channel | None:
    """Average each transfer, at the middle of its samples; None with holes in them."""
    step, scale, count = (topic.number(name) for name in ("dt", "scale", "samples"))
    axes = [topic.vector(axis, 1) for axis in "xyz"]
    if step is None or scale is None or count is None or any(a is None for a in axes):
        return None
    time = topic.sample_time
    size = min(int(topic.rows.dtype[axis].shape[0]) for axis in "xyz")
    sound = (count >= 1) & (count <= size) & (step > 0) & (step < 1e5)
    if np.count_nonzero(sound) < 2:
        return None
    covered = float((1e-6 * count * step)[sound][1:].sum()) / max(float(np.ptp(time)), 1e-6)
    if covered < COMPLETE:
        return None
    inside = np.repeat(np.arange(size)[None], len(time), axis=0) < (count * sound)[:, None]
    sums = [np.einsum("ns,ns->n", topic.column(axis)[:, :size], 1.0 * inside) for axis in "xyz"]
    with np.errstate(all="ignore"):
        means = np.stack(sums, axis=1) * (scale / np.where(sound, count, np.nan))[:, None]
    middle = time - 1e-6 * np.where(sound, 0.5 * (count - 1) * step, 0.0)
    middle, means = _pick_samples(_rising_samples(middle), middle, means)
    return _flu_channel(middle, means, f"{topic.label}.x/y/z, the mean of each transfer")


MOCAP: Final = ("vehicle_mocap_odometry", "vehicle_visual_odometry")
POSE_TOPICS: Final[Mapping[str, tuple[str, ...]]] = {
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
            return _read_pose(topic)
    return {}, []


def _read_pose(topic: Topic) -> tuple[dict[str, Channel], list[str]]:
    time = topic.sample_time
    rising = time >= np.maximum.accumulate(time)
    if not rising.all():
        time, topic = time[rising], replace(topic, rows=topic.rows[rising])
    world = _world_frame(topic)
    if _find_position(topic, slice(1)) is None or not topic.has_vector("q", 4) or world is None:
        return {}, [f"{topic.label} is left out: its frame is neither NED nor FRD."]
    found = {"position": np.empty((len(topic.rows), 3)), "attitude": np.empty((len(topic.rows), 4))}
    for rows in pieces(len(topic.rows)):
        position, attitude = _find_position(topic, rows), topic.column("q", rows)[:, :4]
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


def _find_position(topic: Topic, rows: slice) -> Float[np.ndarray, "n 3"] | None:
    """Find the position as an array (from PX4 1.14 on), or from x, y and z."""
    if topic.has_vector("position", 3):
        return topic.column("position", rows)[:, :3]
    if not all(topic.has_number(axis) for axis in "xyz"):
        return None
    return np.stack([topic.column(axis, rows) for axis in "xyz"], axis=1)


def _world_frame(topic: Topic) -> str | None:
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
        attitude = _interpolate_quaternions(time[rows], turned_time, turned)
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


def _interpolate_quaternions(
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
