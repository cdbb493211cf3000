"""Sensors and estimates of a DataFlash log: IMU, battery, pose, velocity and rates asked for.

Of the IMUs one is taken, from its fastest messages; NED and FRD are turned.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.dataflash.columns import (
    by_time,
    columns,
    first_label,
    format_named,
    has_fields,
    is_shuffled,
    possible_in_order,
    rate_of,
    timed,
    vector,
)
from rotorfit.logs.flight_log import Channel
from rotorfit.logs.units import attitude_from_euler, attitude_to_flu, vectors_to_flu, world_to_body

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.logs.dataflash.messages import Messages
    from rotorfit.logs.dataflash.parameters import Parameters

GYRO: Final = ("GyrX", "GyrY", "GyrZ")
ACCEL: Final = ("AccX", "AccY", "AccZ")
LOOP_NAMES: Final = ("IMU", "IMU2", "IMU3")
MOST_IMUS: Final = 8
FASTER: Final = 1.2
"""Raw messages are taken where they come so many times as often as IMU does."""
GLIMPSED: Final = ("IMU", "GYR")
"""Messages of which some have the instances there are."""
LABELS: Final = ("TimeUS", "TimeMS", "I", "SampleUS", *GYRO, *ACCEL)
"""Labels of the fields that are used."""
CHOICE_NAMES: Final = ("XKF4", "NKF4")


@frozen_dataclass
class Series:
    """Vectors of one sensor in the file's axes, with their times [s] and where they come from."""

    time: Float[np.ndarray, " n"]
    values: Float[np.ndarray, "n 3"]
    source: str


@frozen_dataclass
class ImuChannels:
    """What one IMU recorded; `gyro_lowpass` is the cut-off on board [Hz], None if unknown."""

    gyro: Channel | None
    accel: Channel | None
    notes: tuple[str, ...]
    gyro_lowpass: float | None = None


@frozen_dataclass
class ImuChoice:
    """Which IMU is read, counted from 0, and why."""

    instance: int
    notes: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Messages that it may have written."""
        number = self.instance + 1
        loop = "IMU" if number == 1 else f"IMU{number}"
        return (*self.instances, loop, f"GYR{number}", f"ACC{number}")

    @property
    def instances(self) -> dict[str, int]:
        """Messages that have a field for the instance, and what it is."""
        return dict.fromkeys(("IMU", "GYR", "ACC"), self.instance)


def read_imu(messages: Messages, parameters: Parameters, choice: ImuChoice) -> ImuChannels:
    """Read gyro and accelerometer of the IMU that was chosen, body axes FLU."""
    loop = _read_loop(messages, choice.instance)
    raw = _read_raw(messages, choice.instance)
    gyro, accel = raw or loop or (None, None)
    if loop and raw:
        loop_rate = max(rate_of(series.time) for series in loop)
        if min(rate_of(series.time) for series in raw) <= FASTER * loop_rate:
            gyro, accel = loop
    notes = list(choice.notes)
    lowpass: float | None = None
    if gyro is not None and gyro.source.startswith("IMU"):
        notes += _filter_notes(parameters)
        lowpass = parameters.number("INS_GYRO_FILTER") or None
    if gyro is not None and gyro.source.startswith("GYR"):
        notes += _raw_notes(parameters)
    return ImuChannels(
        gyro=_flu_channel(gyro, "rad/s"),
        accel=_flu_channel(accel, "m/s^2"),
        notes=tuple(notes),
        gyro_lowpass=lowpass,
    )


def choose_imu(messages: Messages, parameters: Parameters) -> ImuChoice:
    """Choose the IMU that the autopilot used, as far as the log has it.

    Of the messages `GLIMPSED` some are enough.
    """
    present = _list_instances(messages)
    if not present:
        return ImuChoice(instance=0, notes=())
    chosen, why = _choose_imu(messages, parameters, present)
    words = [f"IMU {chosen + 1} of {len(present)} is used: {why}"] if len(present) > 1 else []
    flown = _primary_imu(messages, parameters)
    if flown is not None and flown not in present:
        # mavlogdump --reduce drops whole IMUs: findings/pymavlink_reduce_instances.sh.
        words.append(
            f"the estimator flew with IMU {flown + 1}, which is not in this log; IMU {chosen + 1} "
            "may have other filters and another place: give the whole log, if this one was reduced"
        )
    return ImuChoice(instance=chosen, notes=tuple(words))


def _list_instances(messages: Messages) -> list[int]:
    """List the IMUs that a log has messages of, from 0."""
    if has_fields(messages, "IMU", ("I", *GYRO)):
        return _instance_numbers(messages, "IMU")
    found = [n for n, name in enumerate(LOOP_NAMES) if has_fields(messages, name, GYRO)]
    if found:
        return found
    if has_fields(messages, "GYR", ("I", *GYRO)):
        return _instance_numbers(messages, "GYR")
    return [n for n in range(3) if has_fields(messages, f"GYR{n + 1}", GYRO)]


def _instance_numbers(messages: Messages, name: str) -> list[int]:
    """Find the instances that messages of a name are of."""
    numbers = columns(messages, name, ("I",)).get("I")
    if numbers is None or numbers.dtype.kind not in "iu":
        return []
    inside = numbers[(numbers >= 0) & (numbers < MOST_IMUS)]
    counts = np.bincount(inside.astype(np.intp), minlength=1)
    # A damaged message or two is no IMU.
    return np.flatnonzero(counts > 0.02 * counts.max()).tolist()


def _choose_imu(messages: Messages, parameters: Parameters, present: list[int]) -> tuple[int, str]:
    """Choose the IMU of the estimator's primary core, else the first that is in use; and why."""
    primary = _primary_imu(messages, parameters)
    if primary is not None and primary in present:
        return primary, "the estimator's primary core flew with it"
    names = {i: "INS_USE" if i == 0 else f"INS_USE{i + 1}" for i in present}
    used = [i for i in present if parameters.number(names[i]) != 0.0]
    if not used:
        return present[0], "none is switched on by INS_USE; the first is taken"
    if used[0] == present[0]:
        return used[0], "the first, as no other is known to have been preferred"
    return used[0], f"the first that {names[present[0]]} and the like do not switch off"


def _primary_imu(messages: Messages, parameters: Parameters) -> int | None:
    """Find the IMU of the estimator's primary core."""
    primary = _primary_core(messages)
    mask = parameters.integer("EK3_IMU_MASK") or parameters.integer("EK2_IMU_MASK") or 0
    cores = [i for i in range(MOST_IMUS) if mask & (1 << i)]
    return cores[primary] if primary is not None and primary < len(cores) else None


def _primary_core(messages: Messages) -> int | None:
    """Find the core of the estimator that was in charge most of the time."""
    for name in ("XKF4", "NKF4"):
        numbers = columns(messages, name, ("PI",)).get("PI")
        if numbers is not None and numbers.dtype.kind in "iu" and len(numbers):
            inside = numbers[(numbers >= 0) & (numbers < MOST_IMUS)].astype(np.int64)
            return int(np.bincount(inside, minlength=1).argmax())
    return None


def _read_series(
    messages: Messages, name: str, labels: tuple[str, ...], instance: int | None
) -> Series | None:
    """Return time and vectors of messages of a name, of one instance where they have several."""
    extra = [x for x in ("I", "SampleUS") if has_fields(messages, name, (x, *labels))]
    found = timed(messages, name, (*labels, *extra))
    if found is None or len(found[0]) == 0:
        return None
    time, fields = found
    of_instance = fields["I"] == instance if "I" in extra and instance is not None else None
    if of_instance is not None and not of_instance.all():
        time = time[of_instance]
        fields = {label: values[of_instance] for label, values in fields.items()}
    time = _sample_time(time, fields.get("SampleUS"))
    kept = possible_in_order(time)
    if not kept.all():
        kept = by_time(time) if is_shuffled(time) else kept
        time, fields = time[kept], {name: values[kept] for name, values in fields.items()}
    source = f"{name}{f'[{instance}]' if 'I' in extra else ''}.{','.join(labels)}"
    if not len(time):
        return None
    return Series(time=time, values=vector(fields, labels), source=source)


def _sample_time(
    time: Float[np.ndarray, " n"], sampled: np.ndarray | None
) -> Float[np.ndarray, " n"]:
    """Return when samples were taken, where the log says so, else when they were logged."""
    if sampled is None or len(time) == 0:
        return time
    taken = sampled * 1e-6
    return taken if float(np.median(np.abs(taken - time))) < 1.0 else time


def _read_loop(messages: Messages, instance: int) -> tuple[Series, Series] | None:
    """Return gyro and accelerometer as the autopilot's loop used them (message IMU)."""
    has_instances = has_fields(messages, "IMU", ("I",))
    if not has_instances and instance >= len(LOOP_NAMES):
        return None
    name = "IMU" if has_instances else LOOP_NAMES[instance]
    both = [_read_series(messages, name, labels, instance) for labels in (GYRO, ACCEL)]
    return (both[0], both[1]) if both[0] is not None and both[1] is not None else None


def _read_raw(messages: Messages, instance: int) -> tuple[Series, Series] | None:
    """Return gyro and accelerometer as sampled (messages GYR and ACC)."""
    found: list[Series] = []
    for base, labels in (("GYR", GYRO), ("ACC", ACCEL)):
        name = base if has_fields(messages, base, ("I",)) else f"{base}{instance + 1}"
        series = _read_series(messages, name, labels, instance)
        if series is None:
            return None
        found.append(series)
    return found[0], found[1]


def _flu_channel(series: Series | None, unit: str) -> Channel | None:
    if series is None:
        return None
    values = vectors_to_flu(series.values, "FRD")
    return Channel(time=series.time, values=values, source=f"{series.source} [{unit}]")


def _filter_notes(parameters: Parameters) -> list[str]:
    """State how IMU messages are filtered on board."""
    gyro = parameters.number("INS_GYRO_FILTER")
    accel = parameters.number("INS_ACCEL_FILTER")
    if not gyro or not accel:
        return []
    words = (
        f"IMU messages are low-passed on board: the gyro at {gyro:g} Hz (INS_GYRO_FILTER), the "
        f"accelerometer at {accel:g} Hz (INS_ACCEL_FILTER)"
    )
    if abs(gyro - accel) > 0.1 * accel:
        words += "; filters that differ delay the two differently: set them alike"
    return [words]


def _raw_notes(parameters: Parameters) -> list[str]:
    options = parameters.integer("INS_RAW_LOG_OPT") or 0
    filtered = "after" if options & 4 else "before"
    return [f"raw IMU messages (GYR, ACC) are used: the gyro {filtered} the filters on board"]


NAMES: Final = ("BAT", "CURR", "VISP", "ATT", "XKF1", "NKF1", "EKF1", "RATE")
_ESTIMATES: Final = ("XKF1", "NKF1", "EKF1")
_VISION_ANGLES: Final = (("Roll", "Pitch", "Yaw"), ("R", "P", "Y"))
_ANGLES: Final = ("Roll", "Pitch", "Yaw")
_VELOCITY: Final = ("VN", "VE", "VD")
_RATES: Final = ("RDes", "PDes", "YDes")
_DEGREE: Final = np.pi / 180.0


def read_battery(messages: Messages) -> Channel | None:
    """Read the voltage of the first battery [V], where it has one."""
    for name in ("BAT", "CURR"):
        form = format_named(messages, name)
        if form is None or "Volt" not in form.fields:
            continue
        number = first_label(messages, name, ("Instance", "Inst", "I"))
        found = timed(messages, name, ("Volt", number) if number else ("Volt",))
        if found is None or len(found[0]) == 0:
            continue
        time, fields = found
        first = np.ones(len(time), dtype=bool) if number is None else fields[number] == 0
        # Before version 3.4 a plain integer of centivolts.
        factor = 0.01 if form.fields["Volt"].letter in "hH" else 1.0
        values = vector(fields, ("Volt",), factor=factor)
        # A monitor without a battery, or one that is not wired, reads 0 V.
        first &= values[:, 0] > 0.0
        if first.any():
            words = f"{name}.Volt [{'0.01 V' if factor != 1.0 else 'V'}]"
            return Channel(time=time[first], values=values[first], source=words)
    return None


def read_pose(messages: Messages) -> dict[str, Channel]:
    """Read position and attitude from a camera system (VISP), else the attitude on board."""
    for angles in _VISION_ANGLES:
        found = timed(messages, "VISP", ("PX", "PY", "PZ", *angles))
        if found is not None and len(found[0]):
            time, fields = found
            place = vectors_to_flu(vector(fields, ("PX", "PY", "PZ")), "FRD")
            source = "VISP.PX,PY,PZ [m], north-east-down turned to north-west-up"
            attitude = _read_attitude(fields, angles)
            words = f"VISP.{','.join(angles)} [deg], FRD turned to FLU"
            return {
                "position": Channel(time=time, values=place, source=source),
                "attitude": Channel(time=time, values=attitude, source=words),
            }
    found = timed(messages, "ATT", _ANGLES)
    if found is None or len(found[0]) == 0:
        return {}
    words = "ATT.Roll,Pitch,Yaw [deg], FRD turned to FLU, estimate on board"
    return {
        "attitude": Channel(time=found[0], values=_read_attitude(found[1], _ANGLES), source=words)
    }


def _read_attitude(
    fields: dict[str, np.ndarray], angles: tuple[str, ...]
) -> Float[np.ndarray, "n 4"]:
    return attitude_to_flu(attitude_from_euler(vector(fields, angles, factor=_DEGREE)), "FRD")


def read_velocity(messages: Messages) -> Channel | None:
    """Read the velocity of the estimator's first core, body axes [m/s]."""
    for name in _ESTIMATES:
        labels = (*_VELOCITY, *_ANGLES)
        core = ("C",) if has_fields(messages, name, ("C",)) else ()
        found = timed(messages, name, (*labels, *core))
        if found is None or len(found[0]) == 0:
            continue
        time, fields = found
        first = fields["C"] == 0 if core else np.ones(len(time), dtype=bool)
        world = vectors_to_flu(vector(fields, _VELOCITY), "FRD")
        body = world_to_body(world, _read_attitude(fields, _ANGLES))
        source = f"{name}.VN,VE,VD [m/s], turned into the body by its angles"
        return Channel(time=time[first], values=body[first], source=source)
    return None


def read_reference(messages: Messages) -> Channel | None:
    """Read the rates that the rate controllers were asked for, body axes [rad/s]."""
    found = timed(messages, "RATE", _RATES)
    if found is None or len(found[0]) == 0:
        return None
    time, fields = found
    # Logs with a clock in milliseconds are of the time of centidegrees.
    per_degree = 100.0 if has_fields(messages, "RATE", ("TimeMS",)) else 1.0
    values = vectors_to_flu(vector(fields, _RATES, factor=_DEGREE / per_degree), "FRD")
    words = f"RATE.RDes,PDes,YDes [{'0.01 ' if per_degree > 1.0 else ''}deg/s], FRD turned to FLU"
    return Channel(time=time, values=values, source=words)
