"""Logs of PX4 (ULog); its body axes are FRD and its world is NED, turned here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.findings import Finding, doubt, doubts
from rotorfit.logs.controller_log import TURNED, ControllerLog
from rotorfit.logs.flight_log import SIH, Channel, FlightLog, simulated_sentence
from rotorfit.logs.ulog import motors, sensors, vehicle
from rotorfit.logs.ulog.firmware import log_faster
from rotorfit.logs.ulog.scan import Scan, scan_file

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from jaxtyping import Float

    from rotorfit.logs.ulog.messages import Topic

CONTROLLER_TOPICS: Final = {
    "vehicle_angular_velocity": ("timestamp", "timestamp_sample", "xyz", "xyz_derivative"),
    "vehicle_rates_setpoint": ("timestamp", "roll", "pitch", "yaw"),
    "vehicle_torque_setpoint": ("timestamp", "timestamp_sample", "xyz"),
}

WITHIN: Final = 0.5
"""Share of a run of the controller: the set point is the last one, or came in that very run."""


def controller_of(scan: Scan, path: Path) -> ControllerLog:
    """Read the rate controller of a PX4 log, whose scan has `CONTROLLER_TOPICS`."""
    measured, asked, torque = (_required_topic(scan, name, path) for name in CONTROLLER_TOPICS)
    rates, slopes, outputs = (
        _required_vector(topic, field, path)
        for topic, field in ((measured, "xyz"), (measured, "xyz_derivative"), (torque, "xyz"))
    )
    # The controller runs on a sample of the gyro, and its output bears the time of that sample.
    sampled, at = torque.sample_time, measured.sample_time
    row = np.minimum(np.searchsorted(at, sampled - 1e-6), len(at) - 1)
    known = np.abs(at[row] - sampled) < 1e-6
    set_points = np.stack([asked.column(axis) for axis in ("roll", "pitch", "yaw")], axis=1)
    used = _used_set_points(asked.time, set_points, torque.time)
    known &= np.isfinite(outputs).all(axis=1) & np.isfinite(rates[row]).all(axis=1)
    known &= np.isfinite(used).all(axis=1)
    if known.sum() < 2:
        raise LogError(f"{path}: no run of the rate controller is complete: {_cure_words(scan)}")
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


def _used_set_points(
    published: Float[np.ndarray, " m"],
    set_points: Float[np.ndarray, "m 3"],
    time: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n 3"]:
    """Compute the set points that the controller used: those of the run before."""
    finite = np.isfinite(set_points).all(axis=1)
    if finite.sum() < 2:
        return np.full((len(time), 3), np.nan)
    at = time - float(np.median(np.diff(time)))
    # Between those logged they are interpolated: the logger loses many (a third, at 250 Hz).
    columns = [np.interp(at, published[finite], set_points[finite, i]) for i in range(3)]
    return np.stack(columns, axis=1)


def _cure_words(scan: Scan) -> str:
    return f"{log_faster(scan.number('SDLOG_PROFILE'))} and fly again"


def _required_topic(scan: Scan, name: str, path: Path) -> Topic:
    topic = scan.first(name)
    if topic is None or len(topic.rows) < 2:
        raise LogError(
            f"{path}: the log has no {name}, which the rate controller is: {_cure_words(scan)}"
        )
    return topic


def _required_vector(topic: Topic, name: str, path: Path) -> Float[np.ndarray, "n 3"]:
    values = topic.vector(name, 3)
    if values is None:
        raise LogError(f"{path}: {topic.label} has no field {name}: use PX4 1.14 or later")
    return values


WANTED: Final = {
    **sensors.IMU_TOPICS,
    **motors.TOPICS,
    **sensors.POSE_TOPICS,
    **vehicle.TOPICS,
}
SLOW_MOTORS: Final = 50.0
"""Commands slower than this say little of inertia [Hz]."""
_LISTED: Final = 20


def read_ulog(path: Path) -> FlightLog:
    """Read a log of PX4."""
    return _read_with_scan(path, {})[0]


def read_with_controller(path: Path) -> tuple[FlightLog, ControllerLog]:
    """Read a log of PX4, and its rate controller, in one pass."""
    log, scan = _read_with_scan(path, CONTROLLER_TOPICS)
    return log, controller_of(scan, path)


def _read_with_scan(path: Path, also: Mapping[str, tuple[str, ...]]) -> tuple[FlightLog, Scan]:
    """Read a log of PX4, and a scan of other topics that are wanted."""
    try:
        channels, notes, scan, kept = _read_channels(path, also)
        if not channels:
            raise LogError(_no_channels(scan))
    except LogError as error:
        raise LogError(f"{path}: {error}") from error
    simulator = vehicle.simulator_of(scan)
    # A topic begins with its last message before the log: the sensors say when the log began.
    timed = [c for name, c in channels.items() if name in ("gyro", "accel")] or [*channels.values()]
    begin, end = min(c.time[0] for c in timed), max(c.time[-1] for c in timed)
    log = FlightLog(
        path=path,
        sha256=scan.sha256,
        format="ulog",
        channels=channels,
        seconds=float(end - begin),
        metadata={**vehicle.metadata_of(scan), **vehicle.simulated_metadata(scan)},
        notes=(
            *([simulated_sentence(simulator)] if simulator else []),
            *notes,
            *vehicle.geometry_notes(scan),
            *vehicle.flown_notes(scan, float(begin)),
            *vehicle.change_notes(scan),
            *_appended_note(scan),
        ),
        findings=(
            *doubts("damaged-log", scan.damage),
            *vehicle.flight_doubts(scan),
            *_slow_motors(channels, scan),
        ),
        simulator=simulator,
        motors=vehicle.logged_motors(scan),
        circumstances=vehicle.circumstances_of(scan, float(begin)),
    )
    return log, kept


def _read_channels(
    path: Path, also: Mapping[str, tuple[str, ...]]
) -> tuple[dict[str, Channel], list[str], Scan, Scan]:
    """Return channels in the order of `CHANNELS`, words, what is left, and the topics of `also`."""
    fields = {name: (*WANTED.get(name, ()), *labels) for name, labels in also.items()}
    scan = scan_file(path, {**WANTED, **fields})
    kept = scan.only(also)
    speed = motors.find_rotor_speed(scan, simulated=bool(vehicle.simulator_of(scan)))
    # Every topic is let go of when its channel is made: all of both would fill the memory.
    scan = scan.without(motors.SPEED_TOPICS)
    found = sensors.find_imu(scan, raw=lambda: scan_file(path, sensors.FIFO_TOPICS))
    scan = scan.without(sensors.IMU_TOPICS)
    motion = (found.gyro, found.accel) if found.gyro and found.accel else None
    command = motors.find_command(scan, motion)
    scan = scan.without(motors.COMMAND_TOPICS)
    posed, pose_notes = sensors.find_pose(scan)
    scan = scan.without(sensors.MOCAP)
    made: dict[str, Channel | None] = {
        "gyro": found.gyro,
        "accel": found.accel,
        "rotor_speed": speed.channel,
        "command": command.channel,
        "battery": sensors.find_battery(scan),
        "velocity": sensors.find_velocity(scan),
        "reference": sensors.find_reference(scan),
        **posed,
    }
    scan = scan.without(sensors.POSE_TOPICS)
    channels = {name: channel for name, channel in made.items() if channel is not None}
    missing = [name for name in ("gyro", "accel") if name not in channels]
    faster = log_faster(scan.number("SDLOG_PROFILE"))
    notes = [
        *found.notes,
        *(f"No {name}: {faster}." for name in missing),
        *speed.notes,
        *command.notes,
        *_law_notes(scan, channels),
        *pose_notes,
    ]
    return channels, notes, scan, kept


def _slow_motors(channels: dict[str, Channel], scan: Scan) -> Iterator[Finding]:
    """Find motor data that come too slowly for rotations, and what to set."""
    faster = log_faster(scan.number("SDLOG_PROFILE"))
    for name in ("rotor_speed", "command"):
        channel = channels.get(name)
        rate = 0.0 if channel is None else sensors.rate_of(channel)
        if 0.0 < rate < SLOW_MOTORS:
            yield doubt(
                "slow-motor-data",
                f"the {name} channel comes at {rate:.0f} Hz, too slow for inertia and motor lag: "
                f"{faster}",
            )


def _law_notes(scan: Scan, channels: dict[str, Channel]) -> list[str]:
    """State how commands and speed belong together, by the parameters."""
    law = motors.commanded_law(scan)
    if "command" not in channels or not law or vehicle.simulator_of(scan) == SIH:
        return []
    if "linear" in law:
        return [f"Simulated motors: the command is a speed, by [motors] {law}."]
    factor = motors.thrust_curve(scan)
    curve = f"{factor:g} u^2 + {1 - factor:g} u of the command u"
    curve = {0.0: "the command", 1.0: "the square of the command"}.get(factor, curve)
    taken = "taken for their law" if factor else "no law"
    return [
        f"PX4 takes the thrust of a motor as proportional to {curve} (THR_MDL_FAC = {factor:g}): "
        f"{taken}; if it was measured, write under [motors] {law}, with the speed at full command."
    ]


def _appended_note(scan: Scan) -> list[str]:
    if not scan.appended:
        return []
    return [f"{scan.appended} stretches of data were appended to the log later (after a crash?)."]


def _no_channels(scan: Scan) -> str:
    """Describe a log with nothing to use."""
    topics = sorted(name for name, count in scan.counts.items() if count)
    if not topics:
        return (
            "no data behind the declarations: the file was cut off, or logging ended at once; copy "
            "it from the card again, or give another flight"
        )
    faster = log_faster(scan.number("SDLOG_PROFILE"))
    shown = ascii(", ".join(topics[:_LISTED]))[1:-1]
    more = f" and {len(topics) - _LISTED} more" if len(topics) > _LISTED else ""
    return (
        f"no sensor, motor or pose topic with usable messages in it (topics: {shown}{more}); "
        f"{faster}, and log actuator_motors and esc_status"
    )
