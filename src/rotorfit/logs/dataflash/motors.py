"""Motors of a DataFlash log: which output drives which, commands, and ESC telemetry."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.dataflash.columns import (
    columns,
    first_label,
    has_fields,
    possible_in_order,
    timed,
    vector,
)
from rotorfit.logs.flight_log import Channel

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.logs.dataflash.frames import Frame
    from rotorfit.logs.dataflash.messages import Messages
    from rotorfit.logs.dataflash.parameters import Parameters

MOTOR_FUNCTIONS: Final = {
    **{33 + i: 1 + i for i in range(8)},
    **{82 + i: 9 + i for i in range(4)},
    **{160 + i: 13 + i for i in range(20)},
}
"""SERVOn_FUNCTION to the number of the motor."""
OUTPUTS: Final = 32
OUTPUT_MESSAGES: Final = ("RCOU", "RCO2", "RCO3")
_OUTPUT_LABELS: Final = ("C", "Ch", "Chan")
MOST_ESCS: Final = 32
ESC_NAMES: Final = ("ESC", *(f"ESC{n}" for n in range(1, 13)))
ESC_LABELS: Final = ("TimeUS", "TimeMS", "Instance", "I", "RPM", "RawRPM")
"""Labels of the fields that are used."""
NAMES: Final = (*OUTPUT_MESSAGES, *ESC_NAMES)
RPM: Final = 2.0 * math.pi / 60.0
_FEW: Final = 4
"""Outputs of an old log that does not have its number of motors."""


@frozen_dataclass
class Wiring:
    """The output of each motor, numbered from 1; empty if it is not known, and why."""

    outputs: tuple[int, ...]
    words: str


@frozen_dataclass
class Range:
    """PWM of a stopped motor and of a full command [us], and where that comes from."""

    low: float
    high: float
    words: str


def wiring(parameters: Parameters, frame: Frame | None) -> Wiring:
    """Find the output of each motor by SERVOn_FUNCTION; before 3.5, motor n is output n."""
    found: dict[int, int] = {}
    known = False
    for output in range(1, OUTPUTS + 1):
        function = parameters.integer(f"SERVO{output}_FUNCTION")
        known = known or function is not None
        if function in MOTOR_FUNCTIONS:
            found.setdefault(MOTOR_FUNCTIONS[function], output)
    if not known:
        count = len(frame.factors) if frame else _FEW
        how = f"the frame {frame.title} has so many motors" if frame else "four are assumed"
        return Wiring(
            outputs=tuple(range(1, count + 1)),
            words=f"motors 1..{count} = outputs 1..{count} ({how})",
        )
    numbers = sorted(found)
    if not numbers:
        return Wiring(outputs=(), words="no SERVOn_FUNCTION is a motor (33 to 40, 82 to 85)")
    if numbers != list(range(1, len(numbers) + 1)):
        listed = ", ".join(map(str, numbers))
        return Wiring(
            outputs=(),
            words=f"SERVOn_FUNCTION names only the motors {listed}, with gaps between them",
        )
    outputs = tuple(found[n] for n in numbers)
    listed = ", ".join(map(str, outputs))
    return Wiring(
        outputs=outputs, words=f"motors 1..{len(numbers)} = outputs {listed} (SERVOn_FUNCTION)"
    )


def output_range(parameters: Parameters, outputs: tuple[int, ...]) -> Range:
    """Find the PWM range of the motors."""
    throttle = parameters.integer("RCMAP_THROTTLE") or 3
    first = f"SERVO{outputs[0] if outputs else 1}"
    # Where MOT_PWM_MIN and MOT_PWM_MAX are 0, the firmware takes the throttle's RC3_MIN and
    # RC3_MAX.
    pairs = (
        ("MOT_PWM_MIN", "MOT_PWM_MAX"),
        (f"RC{throttle}_MIN", f"RC{throttle}_MAX"),
        (f"{first}_MIN", f"{first}_MAX"),
    )
    for low_name, high_name in pairs:
        low, high = parameters.number(low_name), parameters.number(high_name)
        if low is not None and high is not None and 0 < low < high - 100 < 3000:
            return Range(low=low, high=high, words=f"{low_name}, {high_name}")
    return Range(low=1000.0, high=2000.0, words="assumed: the log has no MOT_PWM_MIN")


def read_commands(
    messages: Messages, parameters: Parameters, wired: Wiring
) -> tuple[Channel | None, list[str]]:
    """Read the motors' commands, 0 to 1 in the order of the motors, from the outputs' PWM."""
    if messages.count("RCOU") == 0:
        return None, ["no command: the log has no message RCOU"]
    if not wired.outputs:
        return None, [f"no command: {wired.words}"]
    found = _read_outputs(messages, wired.outputs)
    if isinstance(found, str):
        return None, [f"no command: {found}"]
    time, pwm, source = found
    span = output_range(parameters, wired.outputs)
    notes = [f"{wired.words}; PWM {span.low:g} to {span.high:g} us is 0 to 1 ({span.words})"]
    beyond = float((pwm > span.high + 20.0).mean()) if len(pwm) else 0.0
    if beyond > 0.01:
        notes.append(
            f"{100 * beyond:.0f} % of the motor outputs are above {span.high:g} us "
            f"(up to {pwm.max():g}): check {span.words}"
        )
    command = np.clip((pwm - span.low) / (span.high - span.low), 0.0, 1.0)
    words = f"{source}, {span.low:g}..{span.high:g} us ({span.words}) as 0..1, clipped"
    step = 1.0 / (span.high - span.low)
    return Channel(time=time, values=command, source=words, resolution=step), notes


def _read_outputs(
    messages: Messages, outputs: tuple[int, ...]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n N"], str] | str:
    """Return time and PWM of some outputs; or why not."""
    parts: dict[int, np.ndarray] = {}
    time: Float[np.ndarray, " n"] | None = None
    sources: list[str] = []
    for name in OUTPUT_MESSAGES:
        labels = {
            o: first_label(messages, name, tuple(f"{base}{o}" for base in _OUTPUT_LABELS))
            for o in outputs
            if o not in parts
        }
        here = {o: label for o, label in labels.items() if label is not None}
        found = timed(messages, name, tuple(here.values())) if here else None
        if found is None:
            continue
        if time is not None and len(found[0]) != len(time):
            return f"motor outputs are in several messages, {name} not as often as the others"
        time = found[0] if time is None else time
        parts |= {o: found[1][label] for o, label in here.items()}
        sources.append(f"{name}.{','.join(here.values())}")
    missing = [o for o in outputs if o not in parts]
    if time is None or missing:
        return f"outputs {', '.join(map(str, missing))} of the motors are in no message RCOU"
    pwm = vector({str(o): parts[o] for o in outputs}, [str(o) for o in outputs])
    return time, pwm, " and ".join(sources)


def read_rotor_speed(
    messages: Messages, parameters: Parameters, wired: Wiring
) -> tuple[Channel | None, list[str]]:
    """Read rotor speeds from ESC telemetry, in the order of the motors."""
    escs = _read_escs(messages)
    if not escs:
        return None, []
    order, how = _esc_order(sorted(escs), wired.outputs)
    if not order:
        return None, [f"no rotor speed: {how}"]
    time, rpm = _common_clock([escs.pop(i) for i in order])
    np.abs(rpm, out=rpm)
    rpm *= RPM
    label = _rpm_label(messages)
    poles = parameters.integer("SERVO_BLH_POLES")
    words = f"with SERVO_BLH_POLES = {poles}" if poles else "with the poles set there"
    notes = [f"{label} is as computed on board {words}: count your motors' magnets; {how}"]
    channel = Channel(time=time, values=rpm, source=f"ESC.{label} [rpm]")
    return channel, notes


def _rpm_label(messages: Messages) -> str:
    """Prefer the speed without the slew adjustment, where the log has it filled in."""
    raw = columns(messages, "ESC", ("RawRPM",)).get("RawRPM")
    with np.errstate(invalid="ignore"):  # a damaged number may be a signalling NaN
        return "RawRPM" if raw is not None and raw.dtype.kind in "iuf" and np.any(raw) else "RPM"


def _read_escs(
    messages: Messages,
) -> dict[int, tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]]:
    """Return time and speed [rpm] of each ESC that ever turned, by its number from 0."""
    escs: dict[int, tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]] = {}
    number_label = first_label(messages, "ESC", ("Instance", "I"))
    label = _rpm_label(messages)
    if number_label is not None:
        found = timed(messages, "ESC", (number_label, label))
        if found is not None:
            time, fields = found
            for number in range(MOST_ESCS):
                mine = fields[number_label] == number
                if mine.any():
                    rpm = vector({label: fields[label][mine]}, (label,))[:, 0]
                    escs[number] = (time[mine], rpm)
            del found, time, fields
    for number in range(12):
        if number not in escs and has_fields(messages, f"ESC{number + 1}", ("RPM",)):
            found = timed(messages, f"ESC{number + 1}", ("RPM",))
            if found is not None:
                escs[number] = (found[0], vector(found[1], ("RPM",))[:, 0])
    return {n: esc for n, esc in escs.items() if len(esc[0]) > 1 and np.any(esc[1] > 0)}


def _esc_order(numbers: list[int], outputs: tuple[int, ...]) -> tuple[list[int], str]:
    """Assign an ESC to each motor, and state how it is known; empty if it is not."""
    if len(numbers) < len(outputs) or not outputs:
        received = ", ".join(str(n + 1) for n in numbers)
        return [], (
            f"ESC telemetry comes from {len(numbers)} ESCs ({received}), the motors are "
            f"{len(outputs) or 'not known'}: check its wiring, SERVO_BLH_MASK and SERVO_BLH_BDMASK"
        )
    # ESCs are counted by output, on some boards from the first of the auxiliary ones.
    for offset in dict.fromkeys((1, *(min(outputs) - n for n in numbers))):
        wanted = [output - offset for output in outputs]
        if all(n in numbers for n in wanted):
            return wanted, f"ESC n is output n + {offset}, which gives the motor"
    if len(numbers) == len(outputs):
        ranked = dict(zip(sorted(outputs), numbers, strict=True))
        return [ranked[o] for o in outputs], "ESCs are taken to be in the order of the outputs"
    return [], "the numbers of the ESCs do not match the motors' outputs"


def _common_clock(
    series: list[tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]],
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m N"]]:
    """Return several series on the clock of the one with most samples, linear between."""
    base = max(series, key=lambda one: len(one[0]))[0]
    columns_: list[Float[np.ndarray, " m"]] = []
    step = float(np.median(np.diff(base)))
    for time, values in series:
        # ESCs are logged one right after the other; where they come in rounds, nothing is moved.
        if len(time) == len(base) and float(np.abs(time - base).max()) < 0.2 * step:
            columns_.append(values)
            continue
        columns_.append(np.interp(base, time, values, left=np.nan, right=np.nan))
    kept = possible_in_order(base)
    together = np.stack(columns_, axis=1)
    return (base, together) if kept.all() else (base[kept], together[kept])
