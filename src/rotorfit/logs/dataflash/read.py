"""DataFlash files to FlightLog."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.findings import Finding, doubt, doubts
from rotorfit.logs.dataflash import HEAD, frames, is_dataflash, is_text, motors, parameters, sensors
from rotorfit.logs.dataflash.columns import (
    LEAST_LEFT,
    LEAST_RESTART,
    is_shuffled,
    possible_in_order,
    time_of,
    unit_sentences,
)
from rotorfit.logs.dataflash.controller import CONTROLLER_NAMES, controller_of
from rotorfit.logs.dataflash.firmware import lack_notes, too_slow
from rotorfit.logs.dataflash.frames import Frame, airframe_text, frame_of, frame_words
from rotorfit.logs.dataflash.messages import Messages, Wanted, find_messages
from rotorfit.logs.dataflash.parameters import Parameters, read_parameters
from rotorfit.logs.dataflash.text import binary_blocks
from rotorfit.logs.files import read_blocks, read_head, sha256_of
from rotorfit.logs.flight_log import CHANNELS, Channel, FlightLog, seconds_of, simulated_sentence

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Iterator, Mapping
    from pathlib import Path

    from rotorfit.logs.controller_log import ControllerLog


CHOICE: Final = Wanted(
    names=frozenset((*sensors.CHOICE_NAMES, *parameters.NAMES)),
    glimpsed=frozenset(sensors.GLIMPSED),
)
"""Messages that name the IMU to read."""
NAMES: Final = (
    *(*motors.NAMES, *parameters.NAMES, *sensors.NAMES, *frames.NAMES, *parameters.CIRCUMSTANCES),
    *("UNIT", "FMTU"),
)
_LONGEST_TEXT: Final = 200
_TEXT_HEAD: Final = 200
"""Bytes that tell the text form from the binary one."""
_MOTOR_PARAMETERS: Final = (
    *("FRAME_CLASS", "FRAME_TYPE", "FRAME", "Q_FRAME_CLASS", "Q_FRAME_TYPE"),
    *("MOT_THST_EXPO", "MOT_SPIN_ARM", "MOT_SPIN_MIN", "MOT_SPIN_MAX", "MOT_PWM_MIN"),
    *("MOT_PWM_MAX", "MOT_PWM_TYPE", "MOT_BAT_VOLT_MAX", "MOT_BAT_VOLT_MIN", "MOT_HOVER_LEARN"),
    *("MOT_THST_HOVER", "Q_M_THST_EXPO", "Q_M_SPIN_MIN", "Q_M_SPIN_MAX", "SERVO_BLH_POLES"),
    *("INS_GYRO_FILTER", "INS_ACCEL_FILTER", "INS_RAW_LOG_OPT", "INS_LOG_BAT_MASK"),
    *("INS_HNTCH_ENABLE", "INS_HNTCH_MODE", "INS_HNTCH_FREQ", "INS_HNTCH_BW", "INS_HNTCH_HMNCS"),
    *("INS_HNTC2_ENABLE", "INS_HNTC2_MODE", "INS_HNTC2_FREQ", "INS_HNTC2_BW", "INS_HNTC2_HMNCS"),
    *("SERVO_BLH_BDMASK", "BATT_MONITOR", "LOG_FILE_RATEMAX"),
    *("LOG_BITMASK", "SCHED_LOOP_RATE", "AHRS_ORIENTATION", "SYSID_SW_MREV"),
)


def read_dataflash(path: Path) -> FlightLog:
    """Read a DataFlash log of ArduPilot (.bin)."""
    return _read_checked(path, ())[0]


def read_with_controller(path: Path) -> tuple[FlightLog, ControllerLog]:
    """Read a DataFlash log of ArduCopter, and its rate controller, in one pass."""
    log, messages = _read_checked(path, CONTROLLER_NAMES)
    return log, controller_of(messages, path)


def _read_checked(path: Path, also: Container[str]) -> tuple[FlightLog, Messages]:
    head = read_head(path, _TEXT_HEAD)
    if not is_dataflash(head):
        shown = head[: len(HEAD)].hex(" ")
        raise LogError(f"{path}: begins with {shown}, expected a3 95 of a DataFlash log")
    sha256 = sha256_of(path)
    try:
        return _flight_log(path, sha256, also, lines=binary_blocks(path) if is_text(head) else None)
    except LogError as error:
        raise LogError(f"{path}: {error}") from error


LEAST_MOVED: Final = 0.05
"""Change of a command, of full output, by which motors were driven."""


def _flight_log(
    path: Path, sha256: str, also: Container[str], *, lines: list[bytes] | None
) -> tuple[FlightLog, Messages]:
    """Make the log of a file's messages, in `lines` if it is text, and keep those of some names."""
    settings, texts, choice = _read_settings(lines or read_blocks(path, (0.0, 0.4)))
    names = frozenset((*NAMES, *choice.names))
    # The file is gone through twice: what the other IMUs recorded would fill most of the memory.
    blocks = lines or read_blocks(path, (0.4, 0.6))
    messages = find_messages(blocks, wanted=_wanted_fields(choice, names))
    kept = messages.only(also)
    frame = frame_of(settings, texts)
    wired = motors.wiring(settings, frame)
    # Messages are let go of when their channel is made: all of both would fill the memory.
    speed, speed_notes = motors.read_rotor_speed(messages, settings, wired)
    messages = messages.without(motors.ESC_NAMES)
    appended = _find_appended(messages, choice.names)
    shuffled = _describe_shuffled(messages, choice.names)
    measured = sensors.read_imu(messages, settings, choice)
    messages = messages.without(choice.names)
    command, command_notes = _read_commands(messages, settings, wired, frame)
    messages = messages.without(motors.OUTPUT_MESSAGES)
    imu = {"gyro": measured.gyro, "accel": measured.accel}
    moved = {"rotor_speed": speed, "command": command}
    channels = _recorded_channels({**imu, **moved, **_other_sensors(messages)})
    if not channels:
        raise LogError(_explain_nothing(messages))
    text = None if frame is None else airframe_text(frame, _imu_position(settings, choice.instance))
    simulator = frames.simulator_of(settings)
    flown, unarmed = _describe_arming(messages, moved=_has_moved(command))
    begin = min(float(channel.time[0]) for channel in channels.values())
    log = FlightLog(
        path=path,
        sha256=sha256,
        format="dataflash",
        channels=channels,
        seconds=seconds_of(channels.values()),
        metadata=_read_metadata(settings, texts, text),
        notes=(
            *([simulated_sentence(simulator)] if simulator else []),
            *flown,
            *measured.notes,
            *shuffled,
            *command_notes,
            *speed_notes,
            *_frame_notes(frame, settings, texts),
            *_law_notes(settings),
            *lack_notes(messages, settings, channels, wired=None if simulator else wired),
        ),
        findings=(*unarmed, *appended, *_find_doubts(messages, settings, channels, names)),
        simulator=simulator,
        motors=frames.logged_motors(settings, battery="battery" in channels),
        gyro_lowpass=measured.gyro_lowpass,
        circumstances=parameters.circumstances_of(messages, texts, begin),
    )
    return log, kept


def _read_settings(
    blocks: Iterable[bytes],
) -> tuple[Parameters, list[str], sensors.ImuChoice]:
    """Read parameters and texts, and choose the IMU, in a first look through the file."""
    glimpse = find_messages(blocks, wanted=CHOICE)
    settings = read_parameters(glimpse)
    return settings, parameters.texts(glimpse), sensors.choose_imu(glimpse, settings)


def _recorded_channels(made: Mapping[str, Channel | None]) -> dict[str, Channel]:
    """Select the channels with any number in them, in the order of `CHANNELS`."""
    found = {n: c for n, c in made.items() if c is not None and np.isfinite(c.values).any()}
    return {name: found[name] for name in CHANNELS if name in found}


def _find_doubts(
    messages: Messages,
    settings: Parameters,
    channels: Mapping[str, Channel],
    names: frozenset[str],
) -> Iterator[Finding]:
    """Find a log that is too slow, in other units, changed on its way, or damaged."""
    yield from doubts("slow-log", too_slow(settings, channels))
    yield from doubts("other-units", unit_sentences(messages))
    yield from doubts("changed-parameters", _warn_of_changes(settings))
    yield from doubts("damaged-log", _describe_damage(messages, names))


def _wanted_fields(choice: sensors.ImuChoice, names: frozenset[str]) -> Wanted:
    """Select the fields to keep of the messages with these names: of IMUs the chosen one alone."""
    labels = dict.fromkeys(choice.names, sensors.LABELS)
    labels |= dict.fromkeys(motors.ESC_NAMES, motors.ESC_LABELS)
    return Wanted(names=names, instances=choice.instances, labels=labels)


def _read_commands(
    messages: Messages, settings: Parameters, wired: motors.Wiring, frame: Frame | None
) -> tuple[Channel | None, list[str]]:
    """Return the motors' commands, mixed again if that is faster, with notes about them."""
    command, notes = motors.read_commands(messages, settings, wired)
    if command is None:
        return None, notes
    command, mixed = frames.remixed(messages, settings, command, frame=frame)
    return command, [*notes, *mixed]


def _other_sensors(messages: Messages) -> dict[str, Channel | None]:
    """Return the channels that are neither of the IMU nor of the motors."""
    return {
        "battery": sensors.read_battery(messages),
        "velocity": sensors.read_velocity(messages),
        "reference": sensors.read_reference(messages),
        **sensors.read_pose(messages),
    }


def _imu_position(settings: Parameters, instance: int) -> tuple[float, float, float] | None:
    """Read the accelerometer's position (INS_POSn) [m], body axes FLU; None if never set."""
    names = [f"INS_POS{instance + 1}_{axis}" for axis in "XYZ"]
    x, y, z = (settings.number(name) or 0.0 for name in names)
    if x == y == z == 0.0:
        return None
    return round(x, 6), round(-y, 6) + 0.0, round(-z, 6) + 0.0


def _read_metadata(settings: Parameters, texts: list[str], text: str | None) -> dict[str, str]:
    """Read firmware, frame and the parameters that matter to motors and sensors."""
    known = [t for t in texts if t.startswith(("ArduCopter", "ArduPlane", "APM:", "ArduSub"))]
    metadata = {"Firmware revision": known[0][:_LONGEST_TEXT]} if known else {}
    named = [t for t in texts if t.startswith("Frame: ")]
    if named:
        metadata["Frame"] = named[0].removeprefix("Frame: ")[:_LONGEST_TEXT]
    if text is not None:
        metadata["airframe"] = text
    values = settings.values
    metadata |= {name: f"{values[name]:.10g}" for name in _MOTOR_PARAMETERS if name in values}
    simulator = frames.simulator_of(settings)
    if simulator:
        metadata["Simulator"] = simulator
    more = [name for name in values if name.startswith("SIM_FRM_")]
    more += [f"SERVO{output}_FUNCTION" for output in range(1, motors.OUTPUTS + 1)]
    return metadata | {name: f"{values[name]:.10g}" for name in more if name in values}


def _frame_notes(frame: Frame | None, settings: Parameters, texts: list[str]) -> list[str]:
    if frame is None:
        return [
            f"the frame is not known ({frame_words(settings, texts)}): list the rotors with "
            "position and spin under [airframe]"
        ]
    spins = ", ".join(frame.spins)
    words = "the metadata has its [airframe], with what is to be measured (--json shows it)"
    if frame.angles_deg is None:
        return [f"frame {frame.title}: motors turn {spins}; {words}"]
    angles = ", ".join(f"{angle:g}" for angle in frame.angles_deg)
    return [
        f"frame {frame.title}: motors at {angles} deg clockwise from the front, {spins}; {words}"
    ]


def _law_notes(settings: Parameters) -> list[str]:
    """State what the firmware takes for the motors' thrust over command."""
    curve = frames.thrust_curve(settings)
    if curve is None:
        return []
    e, low, width = curve.expo, curve.spin_min, curve.spin_max - curve.spin_min
    words = (
        f"the firmware takes relative thrust for {1 - e:.3g} u + {e:.3g} u^2 with "
        f"u = (command - {low:.3g}) / {width:.3g} (MOT_THST_EXPO, MOT_SPIN_MIN, MOT_SPIN_MAX)"
    )
    if (settings.number("MOT_BAT_VOLT_MAX") or 0.0) > 0.0:
        words += "; commands make up for the battery's voltage (MOT_BAT_VOLT_MAX)"
    return [words]


def _has_moved(command: Channel | None) -> bool:
    """Return whether the motors were ever driven."""
    if command is None or not np.isfinite(command.values).any():
        return False
    return float(np.nanmax(command.values) - np.nanmin(command.values)) > LEAST_MOVED


def _describe_arming(messages: Messages, *, moved: bool) -> tuple[list[str], list[Finding]]:
    """State when the vehicle was armed, and doubt a log in which it never was."""
    found = parameters.arming(messages)
    if found is None:
        return [], []
    time, states = found
    # Logs begin while arming, and may miss its record: motors that were driven were armed.
    if not any(states) and moved:
        return [
            f"armed before the log begins, disarmed at {time[0]:.1f} s of the autopilot's clock"
        ], []
    if not any(states):
        words = "the vehicle was never armed in this log: its motors did not turn"
        return [], [doubt("never-armed", words)]
    if not np.isfinite(time).all():
        count = sum(states)
        return [f"armed {'once' if count == 1 else f'{count} times'}"], []
    turns = [
        f"{'armed' if s else 'disarmed'} at {t:.1f} s" for t, s in zip(time, states, strict=True)
    ]
    return [", ".join(turns[:6]) + " of the autopilot's clock"], []


def _find_appended(messages: Messages, names: Container[str]) -> list[Finding]:
    """Find a clock that begins again: a second log stands behind the first."""
    present = {form.name for form in messages.formats if form.name in names}
    for name in sorted(present):
        time = time_of(messages, name)
        # The times of two logs overlap, so that one of them is left out.
        back = np.flatnonzero(np.diff(time) < -LEAST_RESTART)
        left = int(np.count_nonzero(~possible_in_order(time)))
        # One number that is damaged goes back, too, but leaves out hardly anything.
        if len(back) and left > LEAST_LEFT * len(time):
            words = (
                f"the clock begins anew {len(back)} time{'s' if len(back) > 1 else ''} within the "
                f"file, as where a second log is appended: {left} of {len(time)} messages {name} "
                "are left out; download the logs one by one"
            )
            return [doubt("appended-log", words)]
    return []


def _describe_shuffled(messages: Messages, names: Container[str]) -> list[str]:
    """State which messages were written in another order than they were measured."""
    words: list[str] = []
    for name in sorted({form.name for form in messages.formats if form.name in names}):
        time = time_of(messages, name)
        if len(time) and is_shuffled(time):
            late = np.maximum.accumulate(time) - time
            words.append(
                f"{np.count_nonzero(late > 0.0)} of {len(time)} messages {name} stand behind later "
                f"ones, by up to {1e3 * float(late.max()):.3g} ms: all are kept, sorted by time"
            )
    return words


def _warn_of_changes(settings: Parameters) -> list[str]:
    prefixes = ("MOT_PWM", "MOT_SPIN", "MOT_THST_EXPO", "FRAME", "INS_GYRO_F", "INS_ACCEL_F")
    names = [n for n in settings.changed if n.startswith(prefixes)]
    names += [n for n in settings.changed if n.startswith("SERVO") and n.endswith("_FUNCTION")]
    if not names:
        return []
    return [f"{', '.join(names[:6])} changed within the log: the last value is taken"]


def _explain_nothing(messages: Messages) -> str:
    read = sum(messages.counts)
    names = sorted({messages.formats[i].name for i, n in enumerate(messages.counts) if n})
    listed = ", ".join(f"{name!a}"[1:-1] for name in names[:20])
    if len(messages.formats) < 2:
        return (
            f"no message is defined in it ({read} read): the beginning of the log, with its FMT "
            "messages, is missing; download it from the autopilot again"
        )
    return (
        f"{read} messages ({listed}), none of them IMU, RCOU or ESC: set LOG_BITMASK to log "
        "IMU, fast IMU, fast attitude and RC output (bits 7, 18, 0, 10)"
    )


def _describe_damage(messages: Messages, names: Container[str]) -> list[str]:
    words: list[str] = []
    if messages.damaged_places:
        words.append(
            f"{messages.damaged_places} damaged places: {messages.skipped_bytes} bytes skipped, "
            f"{messages.dropped} messages left out"
        )
    if messages.bad_formats:
        words.append(
            f"{messages.bad_formats} definitions of messages are impossible, and passed over"
        )
    unread = sorted(
        {
            f.name
            for i, f in enumerate(messages.formats)
            if f.name in names and messages.counts[i] and not f.fields
        }
    )
    if unread:
        words.append(
            f"{', '.join(unread)}: not read, the letters of the definition do not add up to its "
            "length"
        )
    if messages.trailing_bytes > 2:
        words.append(f"{messages.trailing_bytes} bytes at the end could not be read as messages")
    return words
