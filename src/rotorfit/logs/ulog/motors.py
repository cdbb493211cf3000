"""Rotor speeds by ESC telemetry, and motor commands, of a PX4 log."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.flight_log import Channel, pieces
from rotorfit.logs.motor_outputs import followed_group
from rotorfit.logs.ulog.firmware import log_faster

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Bool, Float

    from rotorfit.logs.ulog.messages import Topic
    from rotorfit.logs.ulog.scan import Scan

    Motion = tuple[Channel, Channel]

SPEED_TOPICS: Final[Mapping[str, tuple[str, ...]]] = {
    "esc_status": ("timestamp", "esc_count", "esc", "esc_rpm", "actuator_function")
}
COMMAND_TOPICS: Final[Mapping[str, tuple[str, ...]]] = {
    "actuator_motors": ("timestamp", "control"),
    "actuator_outputs": ("timestamp", "output"),
}
TOPICS: Final = {**SPEED_TOPICS, **COMMAND_TOPICS}
"""Topics and the fields of them that are used; those of an ESC among them."""
FIRST_MOTOR, LAST_MOTOR = 101, 112
"""Numbers of the output functions Motor 1 to Motor 12."""
MOST_MOTORS: Final = LAST_MOTOR - FIRST_MOTOR + 1
ONESHOT: Final = -1
"""PWM_MAIN_TIM0 and so on of OneShot; above are rates of PWM [Hz], below the kinds of DShot."""
_RPM: Final = 2.0 * math.pi / 60.0
FASTEST: Final = 300_000
"""No rotor turns as fast [rpm]: a telemetry value beyond it is damaged."""
VTOL_AIRFRAMES: Final = (2, 3, 4)
"""CA_AIRFRAME of a standard VTOL, one with tilting rotors, and a tailsitter."""
VTOL_TYPES: Final = tuple(range(19, 26))
"""MAV_TYPE of the same."""
VTOL_THOUSANDS: Final = 13
"""SYS_AUTOSTART of the same is 13000 to 13999."""
DSHOT_MOST: Final = 1999
DSHOT_BASIS: Final = "DSHOT_CONFIG"
LEAST_PULSE: Final = 800.0
"""No output sends a shorter pulse [us]."""
_AIRFRAMES: Final = {4: 4, 5: 4, 6: 6, 7: 6, 8: 8, 9: 8, 11: 6, 12: 8}
"""Motors of the airframes 4000 to 4999 and so on, before PX4 had parameters for the geometry."""
TELEMETRY: Final = (
    "for measured rotor speed set DSHOT_BIDIR_EN = 1 (PX4 1.16 and 1.17; from 1.18 on choose "
    "BDShot in the actuator configuration), or wire ESC telemetry and set DSHOT_TEL_CFG"
)


@frozen_dataclass
class Motors:
    """The motor channel, or None, with notes about it."""

    channel: Channel | None = None
    notes: tuple[str, ...] = ()


def motor_count(scan: Scan) -> int | None:
    """Read the number of motors by the parameters; None if they do not say."""
    declared = scan.number("CA_ROTOR_COUNT")
    if declared is not None and 0 < declared <= MOST_MOTORS:
        return int(declared)
    airframe = scan.number("SYS_AUTOSTART")
    return None if airframe is None else _AIRFRAMES.get(int(airframe) // 1000)


def has_pwm_motors(scan: Scan) -> bool:
    """Return whether the motors are on outputs of which no timer speaks DShot (PX4 1.13 on)."""
    wired = any(
        re.fullmatch(r"PWM_(MAIN|AUX)_FUNC\d+", name) and FIRST_MOTOR <= value <= LAST_MOTOR
        for name, value in scan.parameters.items()
    )
    timers = [v for n, v in scan.parameters.items() if re.fullmatch(r"PWM_(MAIN|AUX)_TIM\d", n)]
    return wired and bool(timers) and all(value >= ONESHOT for value in timers)


def is_vtol(scan: Scan) -> bool:
    """Return whether the parameters are those of a vehicle that hovers and flies on a wing."""
    own = {name: scan.number(name) for name in ("CA_AIRFRAME", "MAV_TYPE", "SYS_AUTOSTART")}
    airframe = own["SYS_AUTOSTART"]
    return (
        own["CA_AIRFRAME"] in VTOL_AIRFRAMES
        or own["MAV_TYPE"] in VTOL_TYPES
        or (airframe is not None and int(airframe) // 1000 == VTOL_THOUSANDS)
    )


# Measured speed


def find_rotor_speed(scan: Scan, *, simulated: bool = False) -> Motors:
    """Read the rotor speeds of esc_status, in the order of the motors; a simulator has no ESCs."""
    cure = "" if simulated else f"; {TELEMETRY}"
    topic = scan.first("esc_status")
    if topic is None or "esc" not in (topic.rows.dtype.names or ()):
        return Motors(notes=(f"No rotor speed (esc_status){cure}.",))
    escs = topic.rows["esc"]
    names = escs.dtype.names or ()
    if escs.ndim != 2 or "esc_rpm" not in names or len(topic.rows) < 2:
        return Motors(notes=("esc_status has no esc_rpm: rotor speed is left out.",))
    turns = np.zeros(topic.lengths["esc"], dtype=bool)
    turns[: escs.shape[1]] = escs["esc_rpm"].any(axis=0)
    places = _places_of_motors(scan, topic, turns)
    rpm = np.empty((len(escs), len(places)))
    for i, place in enumerate(places):
        np.abs(_of_esc(escs, "esc_rpm", place), out=rpm[:, i])
    if not rpm.any():
        note = f"esc_status says 0 rpm throughout: rotor speed is left out{cure}."
        return Motors(notes=(note,))
    time, rpm, fresh = _on_one_clock(topic, escs, rpm, places)
    rpm[~(rpm <= FASTEST)] = np.nan
    source = f"{topic.label}.esc[{', '.join(map(str, places))}].esc_rpm [rpm]"
    silent = [str(i + 1) for i in range(len(places)) if not np.nan_to_num(rpm[:, i]).any()]
    resolution = _smallest_step(rpm) * _RPM
    rpm *= _RPM
    channel = Channel(time=time, values=rpm, source=source, resolution=resolution)
    notes = [fresh] if fresh else []
    if silent:
        notes.append(f"Motor {', '.join(silent)}: 0 rpm throughout, check its telemetry.")
    return Motors(channel=channel, notes=tuple(notes))


def _places_of_motors(scan: Scan, topic: Topic, turns: Bool[np.ndarray, " e"]) -> list[int]:
    """Find the place of each motor in esc_status, in the order of the motors."""
    escs = topic.rows["esc"]
    if "actuator_function" in (escs.dtype.names or ()):
        functions = np.max(escs["actuator_function"], axis=0).astype(int).tolist()
        motors = {f: i for i, f in enumerate(functions) if FIRST_MOTOR <= f <= LAST_MOTOR}
        if motors:
            return [motors[function] for function in sorted(motors)]
    declared_count = topic.number("esc_count")
    turning = np.flatnonzero(turns)
    count = motor_count(scan) or int(0 if declared_count is None else declared_count.max())
    count = count or (int(turning[-1]) + 1 if len(turning) else len(turns))
    return list(range(min(count, len(turns))))


def _on_one_clock(
    topic: Topic, escs: np.ndarray, rpm: Float[np.ndarray, "n N"], places: list[int]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m N"], str]:
    """Return speeds at common times, without repetitions, and a note of what was done."""
    published = topic.time
    if "timestamp" not in (escs.dtype.names or ()):
        return published, rpm, ""
    step = float(np.median(np.diff(published)))
    is_new, prompt = np.arange(len(published)) == 0, 0
    for place in places:
        own = 1e-6 * _of_esc(escs, "timestamp", place)
        late = published - own
        if not own.any() or (own[1:] < own[:-1]).any() or late.max() > 10.0:
            return published, rpm, ""
        is_new[1:] |= own[1:] > own[:-1]
        prompt += int(np.count_nonzero(late < 0.2 * step))
    # By the median they come at once.
    if 2 * prompt > rpm.size and is_new.all():
        return published, rpm, ""
    # With telemetry by wire the ESCs report one after the other, and a message repeats what is not
    # new: then each motor's own reports are joined by lines, nowhere over a hole.
    time = published[is_new]
    joined = [
        _join_reports(time, 1e-6 * _of_esc(escs, "timestamp", place)[is_new], rpm[is_new, i])
        for i, place in enumerate(places)
    ]
    rate = 1.0 / max(float(np.median(np.diff(time))), 1e-6) if len(time) > 1 else 0.0
    note = (
        f"The ESCs report one after the other, {rate:.0f} new messages a second: their speeds are "
        "brought to common times by lines between each one's reports."
    )
    return time, np.stack(joined, axis=1), note


def _of_esc(escs: np.ndarray, name: str, place: int) -> Float[np.ndarray, " n"]:
    """Return a field of one ESC; zeros of those that never say anything, and were not kept."""
    if place >= escs.shape[1]:
        return np.zeros(len(escs))
    return escs[name][:, place].astype(float)


def _join_reports(
    time: Float[np.ndarray, " n"], own: Float[np.ndarray, " n"], rpm: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Return one motor's speed by lines between its reports; NaN over holes, and at the ends."""
    is_new = np.concatenate([[True], np.diff(own) > 0])
    t, x = own[is_new], rpm[is_new]
    if len(t) < 2:
        return np.full(len(time), np.nan)
    right = np.clip(np.searchsorted(t, time), 1, len(t) - 1)
    hole = 2.5 * float(np.median(np.diff(t)))
    inside = (time >= t[0]) & (time <= t[-1]) & (t[right] - t[right - 1] <= hole)
    return np.where(inside, np.interp(time, t, x), np.nan)


def _smallest_step(rpm: Float[np.ndarray, "n N"]) -> float:
    """Find the step of the telemetry: 1 rpm, or 100 electrical ones over the pole pairs."""
    levels, least = np.zeros(0), np.inf
    for piece in pieces(len(rpm)):
        some = rpm[piece]
        levels = np.union1d(levels, some[np.isfinite(some)])
        least = float(np.diff(levels).min(initial=np.inf))
        if least <= 1.0:
            break  # no smaller one counts, and the levels of a long log would be many
    return max(least, 1.0) if np.isfinite(least) else 1.0


# Commands


def find_command(scan: Scan, motion: Motion | None = None) -> Motors:
    """Read the motor commands as the fraction of the output range that was sent.

    `motion`: gyro and accelerometer, which show the instance that drives motors.
    """
    topic = scan.first("actuator_motors")
    if topic is not None and topic.vector("control", 1) is not None and len(topic.rows) > 1:
        return _from_thrusts(scan, topic)
    if scan.all("actuator_outputs"):
        return _from_outputs(scan, motion)
    note = (
        "No motor commands (actuator_motors, actuator_outputs): add them to the logged topics, or "
        f"{log_faster(scan.number('SDLOG_PROFILE'))}."
    )
    return Motors(notes=(note,))


def thrust_curve(scan: Scan) -> float:
    """Return THR_MDL_FAC, 0 if it is not one that PX4 acts on."""
    factor = scan.number("THR_MDL_FAC") or 0.0
    return factor if 0.0 < factor <= 1.0 else 0.0


def _from_thrusts(scan: Scan, topic: Topic) -> Motors:
    """Return actuator_motors, thrusts that PX4 turns into commands before it sends them."""
    width, kept = topic.lengths["control"], int(topic.rows.dtype["control"].shape[0])
    parts = pieces(len(topic.rows))
    used = np.zeros(width, dtype=bool)
    for part in parts:
        used[:kept] |= np.isfinite(topic.column("control", part)).any(axis=0)
    count = motor_count(scan)
    if count is None or count > width:
        count = int(np.flatnonzero(used)[-1]) + 1 if used.any() else 0
    if not used[:count].any():
        return Motors(notes=("actuator_motors drives no motor: commands are left out.",))
    factor = thrust_curve(scan)
    values = np.empty((len(topic.rows), count))
    wrong_rows = 0
    for part in parts:
        thrust = np.full((len(topic.rows[part]), count), np.nan)
        thrust[:, :kept] = topic.column("control", part)[:, :count]
        wrong = (thrust < -1e-6) | (thrust > 1.0 + 1e-6)
        stopped = np.isnan(thrust)
        # PX4 takes relative thrust to be f u^2 + (1 - f) u, with f = THR_MDL_FAC and u the fraction
        # of the output range; the log has the thrust, so u is its positive root.
        fraction = _fraction_of(np.clip(np.where(stopped | wrong, 0.0, thrust), 0.0, 1.0), factor)
        values[part] = np.where(wrong, np.nan, fraction)
        wrong_rows += int(wrong.any(axis=1).sum())
    notes: list[str] = []
    source = f"{topic.label}.control[0..{count - 1}]"
    if factor:
        source += f", turned from thrust into the output sent (THR_MDL_FAC {factor:g})"
    if wrong_rows:
        notes.append(f"{wrong_rows} commands are outside 0 to 1 (reversed motors?): left out.")
    return Motors(
        channel=Channel(time=topic.time, values=values, source=source), notes=tuple(notes)
    )


def _fraction_of(thrust: Float[np.ndarray, "n N"], factor: float) -> Float[np.ndarray, "n N"]:
    """Solve for u >= 0: factor u^2 + (1 - factor) u = thrust."""
    if factor == 0.0:
        return thrust
    b = 1.0 - factor
    # The form without cancellation for small factors.
    below = b + np.sqrt(b * b + 4.0 * factor * thrust)
    # With factor 1 a motor that stands is 0 / 0.
    return 2.0 * thrust / np.where(thrust > 0.0, below, 1.0)


@frozen_dataclass
class _Outputs:
    """Which outputs are motors: their places and ranges, and the parameters that say so."""

    places: tuple[int, ...]
    ranges: tuple[tuple[float, float], ...]
    basis: str


def _from_outputs(scan: Scan, motion: Motion | None) -> Motors:
    """Return actuator_outputs, the values sent, over their ranges."""
    assigned = _assigned_outputs(scan)
    if assigned is None and motor_count(scan) is None and is_vtol(scan):
        note = (
            "the vehicle is a VTOL, and the log does not say which of its outputs are motors and "
            "which servos: commands are left out; log actuator_motors (PX4 1.13 and later)."
        )
        return Motors(notes=(note,))
    wiring = assigned or _main_outputs(scan)
    topic = _instance_with_motors(scan, wiring, motion)
    values = None if topic is None else topic.vector("output", 1 + max(wiring.places))
    if topic is None or values is None:
        return Motors(notes=("actuator_outputs has no motors: commands are left out.",))
    values = np.take(values, list(wiring.places), axis=1)
    if wiring.basis == DSHOT_BASIS and _are_pulses(values):
        wiring = _pulse_outputs(scan, wiring.places)
    low, high = (np.array(edge) for edge in zip(*wiring.ranges, strict=True))
    if bool((values > high + 0.05 * (high - low)).any()):
        note = (
            f"{topic.label} reaches {float(np.nanmax(values)):g}, beyond its range "
            f"{low.min():g} to {high.max():g} ({wiring.basis}): commands are left out; log "
            "actuator_motors."
        )
        return Motors(notes=(note,))
    values -= low
    values /= high - low
    np.clip(values, 0.0, 1.0, out=values)
    shown = ", ".join(str(place) for place in wiring.places)
    source = f"{topic.label}.output[{shown}], {low.min():g}..{high.max():g} ({wiring.basis})"
    resolution = 1.0 / float((high - low).min()) if float((high - low).min()) >= 100 else None
    channel = Channel(time=topic.time, values=values, source=source, resolution=resolution)
    return Motors(channel=channel)


def _assigned_outputs(scan: Scan) -> _Outputs | None:
    """Find the outputs that the parameters ..._FUNC1 and so on give to motors (PX4 1.13 on)."""
    found: dict[str, dict[int, int]] = {}
    for name, value in scan.parameters.items():
        match = re.fullmatch(r"([A-Z0-9_]+)_FUNC(\d{1,2})", name)
        if match and FIRST_MOTOR <= value <= LAST_MOTOR and 1 <= int(match[2]) <= 16:
            found.setdefault(match[1], {})[int(value)] = int(match[2])
    if not found:
        return None
    prefix, outputs = max(found.items(), key=lambda item: len(item[1]))
    numbers = [outputs[function] for function in sorted(outputs)]
    ranges = tuple(_assigned_range(scan, prefix, number) for number in numbers)
    places = tuple(number - 1 for number in numbers)
    return _Outputs(places=places, ranges=ranges, basis=f"{prefix}_FUNC, _MIN, _MAX")


def _assigned_range(scan: Scan, prefix: str, number: int) -> tuple[float, float]:
    timers = [v for n, v in scan.parameters.items() if re.fullmatch(f"{prefix}_TIM\\d+", n)]
    if any(-5 <= timer <= -2 for timer in timers):
        return _dshot_range(scan)
    low, high = scan.number(f"{prefix}_MIN{number}"), scan.number(f"{prefix}_MAX{number}")
    sound = low is not None and high is not None and high > low >= 0
    return (low, high) if sound else (1000.0, 2000.0)  # type: ignore[return-value]


def _dshot_range(scan: Scan) -> tuple[float, float]:
    least = scan.number("DSHOT_MIN") or 0.0
    return (DSHOT_MOST * least if 0.0 <= least < 1.0 else 0.0), float(DSHOT_MOST)


def _main_outputs(scan: Scan) -> _Outputs:
    """Find the first outputs, which older versions of PX4 gave to the motors."""
    count = motor_count(scan) or _used_outputs(scan)
    places = tuple(range(max(count, 1)))
    if (scan.number("DSHOT_CONFIG") or 0) > 0:
        return _Outputs(
            places=places,
            ranges=(_dshot_range(scan),) * len(places),
            basis=DSHOT_BASIS,
        )
    return _pulse_outputs(scan, places)


def _are_pulses(values: Float[np.ndarray, "n N"]) -> bool:
    """Return whether outputs are pulse widths although DSHOT_CONFIG is set."""
    sent = np.where(values > 0.0, values, np.nan)
    with np.errstate(invalid="ignore"):
        least = np.fmin.reduce(sent, axis=0)
    # The outputs of an IO processor know no DShot. All motors then idle at one pulse width, where
    # DShot stands still at 0.
    return bool(np.isfinite(least).all() and least.min() >= LEAST_PULSE and np.ptp(least) == 0.0)


def _pulse_outputs(scan: Scan, places: tuple[int, ...]) -> _Outputs:
    """Return outputs that send pulse widths, with the ranges of the parameters."""
    low = _first_positive(scan, ("PWM_MAIN_MIN", "PWM_MIN"), 1000.0)
    high = _first_positive(scan, ("PWM_MAIN_MAX", "PWM_MAX"), 2000.0)
    ranges = [
        (
            _first_positive(scan, (f"PWM_MAIN_MIN{i + 1}",), low),
            _first_positive(scan, (f"PWM_MAIN_MAX{i + 1}",), high),
        )
        for i in places
    ]
    sound = tuple((a, b) if b > a else (1000.0, 2000.0) for a, b in ranges)
    return _Outputs(places=places, ranges=sound, basis="PWM_MIN, PWM_MAX")


def _first_positive(scan: Scan, names: tuple[str, ...], default: float) -> float:
    for name in names:
        value = scan.number(name)
        if value is not None and math.isfinite(value) and value > 0:
            return value
    return default


def _used_outputs(scan: Scan) -> int:
    """Count the outputs of the first instance that ever differ from 0."""
    topic = scan.first("actuator_outputs")
    values = None if topic is None else topic.vector("output", 1)
    if topic is None or values is None:
        return 0
    used = np.flatnonzero(np.nan_to_num(topic.column("output")).any(axis=0))
    return min(int(used[-1]) + 1 if len(used) else 0, MOST_MOTORS)


def _instance_with_motors(scan: Scan, wiring: _Outputs, motion: Motion | None) -> Topic | None:
    """Find the instance that the motion follows, else with outputs moving most."""
    moved: list[tuple[float, float, int, Topic]] = []
    moving: list[tuple[Topic, Channel]] = []
    for topic in scan.all("actuator_outputs"):
        values = topic.vector("output", 1 + max(wiring.places))
        if values is not None and len(topic.rows) > 1:
            chosen = np.nan_to_num(values[:, list(wiring.places)])
            # Several drivers publish their own; auxiliary outputs that are switched on and off
            # together move far, but all alike.
            between = float((chosen - chosen.mean(axis=1, keepdims=True)).std(axis=0).sum())
            span = float(np.ptp(chosen, axis=0).sum())
            moved.append((round(between, 6), span, -topic.instance, topic))
            if between > 0.0:
                moving.append((topic, Channel(time=topic.time, values=chosen, source=topic.label)))
    if motion is not None and len(moving) > 1:
        # A gimbal on auxiliary outputs may move more than motors do.
        place = followed_group([channel for _, channel in moving], *motion)
        if place is not None:
            return moving[place][0]
    return max(moved, key=lambda item: item[:3])[3] if moved else None


def output_speeds(scan: Scan) -> tuple[float, float] | None:
    """Read the speeds at no and at full output, where Gazebo makes the output the speed itself.

    By SIM_GZ_EC_MIN and _MAX [rad/s]; None elsewhere, or where the motors differ.
    """
    count = motor_count(scan) or 0
    ranges = {
        (scan.number(f"SIM_GZ_EC_MIN{i}"), scan.number(f"SIM_GZ_EC_MAX{i}"))
        for i in range(1, count + 1)
        if FIRST_MOTOR <= (scan.number(f"SIM_GZ_EC_FUNC{i}") or 0) <= LAST_MOTOR
    }
    if len(ranges) == 1:
        low, high = next(iter(ranges))
        if low is not None and high is not None and high > low:
            return low, high
    return None


def commanded_law(scan: Scan) -> str:
    """Write the ``law`` of the experiment file by the parameters; empty if unknown."""
    speeds = output_speeds(scan)
    if speeds is not None:
        low, high = speeds
        return f"law = {{ linear = [{low:.1f}, {high - low:.1f}] }}"
    # Outside Gazebo PX4 only assumes how thrust goes with the output.
    if scan.number("THR_MDL_FAC") is None:
        return ""
    return f"law = {{ sqrt = {{ full_speed = RAD_PER_S, thr_mdl_fac = {thrust_curve(scan)!r} }} }}"
