"""What the columns of an unknown table may hold, by the words of their names."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.columns import NAMES, TIME
from rotorfit.logs.units import UNITS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_UNIT_WORDS: Final = (
    (("rad", "s"), "rad/s"),
    (("rads",), "rad/s"),
    (("radps",), "rad/s"),
    (("deg", "s"), "deg/s"),
    (("degs",), "deg/s"),
    (("dps",), "deg/s"),
    (("°", "s"), "deg/s"),
    (("mrad", "s"), "mrad/s"),
    (("mrads",), "mrad/s"),
    (("mdeg", "s"), "mdeg/s"),
    (("mdegs",), "mdeg/s"),
    (("mdps",), "mdeg/s"),
    (("cm", "s", "2"), "cm/s^2"),
    (("cms", "2"), "cm/s^2"),
    (("mm", "s", "2"), "mm/s^2"),
    (("mms", "2"), "mm/s^2"),
    (("m", "s", "2"), "m/s^2"),
    (("ms", "2"), "m/s^2"),
    (("mps", "2"), "m/s^2"),
    (("m", "s", "²"), "m/s^2"),
    (("rad", "s", "1"), "rad/s"),
    (("m", "s", "1"), "m/s"),
    (("mss",), "m/s^2"),
    (("m", "s"), "m/s"),
    (("mps",), "m/s"),
    (("µs",), "us"),
    (("percent",), "%"),
    (("%",), "%"),
    *(((word,), word) for word in ("us", "ms", "ns", "s", "rpm", "erpm", "deg", "rad", "g", "mg")),
    *(((word,), unit) for word, unit in (("sec", "s"), ("hz", "Hz"), ("v", "V"), ("mv", "mV"))),
    *(((word,), word) for word in ("m", "cm", "mm")),
)
"""Words at the end of a name, and the unit that they mean."""
_CORNERS: Final[Mapping[tuple[str, ...], int]] = {
    ("fr",): 1,
    ("rl",): 2,
    ("bl",): 2,
    ("fl",): 3,
    ("rr",): 4,
    ("br",): 4,
    ("rfront",): 1,
    ("lback",): 2,
    ("lfront",): 3,
    ("rback",): 4,
    **{
        (a, b): n
        for end, n in (("right", 1), ("left", 3))
        for a, b in (("front", end), (end, "front"))
    },
    **{
        pair: n
        for rear in ("rear", "back")
        for end, n in (("left", 2), ("right", 4))
        for pair in ((rear, end), (end, rear))
    },
}
"""Words for the corner of a quadrotor at which a motor is, and its number in PX4's order."""
_BODY_RATES: Final = {"p": 0, "q": 1, "r": 2}
"""Letters of the turns about x, y, z in flight mechanics."""
_RATE_WORDS: Final = frozenset(["rate", "rates", "body", "gyro", "omega", "vel", "velocity", "w"])
_ANGLES: Final = {"roll": 0, "pitch": 1, "yaw": 2, "phi": 0, "theta": 1, "psi": 2, "heading": 2}
_LETTERS: Final = {"w": -1, "x": 0, "y": 1, "z": 2}
_NO_MEASUREMENT: Final = frozenset(
    (
        *("bias", "std", "var", "cov", "covariance", "temp", "temperature", "mag", "baro"),
        *("status", "flag", "current", "curr", "amps", "offset", "error", "err", "integral"),
        *("accuracy", "percent", "soc", "count", "derivative", "reset", "delta", "temps"),
    )
)
_SET_POINT: Final = frozenset(["sp", "setpoint", "ref", "reference", "target", "desired", "des"])
ASKED: Final = _SET_POINT | {"cmd", "command", "commanded", "demand", "demanded", "goal"}
"""Words of what a controller asks for; the further ones are of what motors are sent, too."""
COMPRESSED_RATES: Final = "state estimate z rate angle"
"""Stem of the rates in a Crazyflie's compressed state, as its firmware has them: mrad/s, and about
y against the gyro."""
_UNITS_OF_STEMS: Final = {COMPRESSED_RATES: "mrad/s"}
"""Units of columns whose program is known by their names alone."""
_ESTIMATES: Final = frozenset([("nav", "pos"), ("nav", "vel"), ("nav", "acc")])
"""Words of INAV's estimates, which are in world axes and cm."""
SPEED_WORDS: Final = ("rpm", "speed", "omega", "rads", "hz", "rps", "rot", "velocities")
COMMAND_WORDS: Final = (
    *("pwm", "cmd", "command", "throttle", "duty", "output", "servo", "actuator"),
    *("rcou", "rcout", "dshot"),
)
_NO_MOTOR: Final = frozenset(
    (
        *(
            "voltage",
            "volts",
            "volt",
            "power",
            "state",
            "counter",
            "address",
            "failures",
            "failure",
        ),
        *(
            "timestamp",
            "online",
            "armed",
            "torque",
            "rc",
            "rcin",
            "controls",
            "manual",
            "pid",
            "axis",
        ),
        *("function", "id", "age", "stick", "input", "in"),
    )
)
"""Words of columns about motors, or of sticks, that are neither speeds nor commands of motors."""
_OF_STICKS: Final = frozenset(
    ["rc", "rcin", "channel", "channels", "stick", "sticks", "cmd", "input"]
)
"""Words of columns named after the angles that sticks ask for."""
_MOTOR_WORDS: Final = (*SPEED_WORDS, *COMMAND_WORDS, "motor", "esc", "prop", "thrust")


@frozen_dataclass
class Candidate:
    """Columns of one stem: by their index, and the unit that the names give."""

    kind: str
    stem: str
    by_index: Mapping[int, str]
    unit: str | None


def parts_of(name: str) -> tuple[tuple[str, ...], int | None, str | None]:
    """Split the name of a column into words, an index (w, x, y, z: -1 to 2), and a unit."""
    words, unit = _without_unit(_words_of(name))
    found, index = _without_index(words)
    # The g of gx is no unit, that of accel_g_x is one.
    is_glued = len(found) == len(words) and index is not None and words[-1].startswith(found[-1])
    if unit is None and not is_glued:
        found, unit = _without_unit(found)
    turns = next((word for word in words if word in ("rpm", "erpm")), None)
    return found, index, turns or unit


def _words_of(name: str) -> tuple[str, ...]:
    split = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.replace("eRPM", "erpm")).lower()
    split = re.sub(r"(roll|pitch|yaw)(?=speed|rate)", r"\1 ", split.replace("μ", "µ"))
    return tuple(re.findall(r"[a-zµ°²]+|\d+|%", split))


def _without_unit(words: tuple[str, ...]) -> tuple[tuple[str, ...], str | None]:
    for ending, unit in _UNIT_WORDS:
        if len(words) > len(ending) and words[-len(ending) :] == ending:
            kept = len(words) if unit in ("rpm", "erpm") else len(words) - len(ending)
            return words[:kept], unit
    return words, words[-1] if words and words[-1] in ("rpm", "erpm") else None


def _without_index(words: tuple[str, ...]) -> tuple[tuple[str, ...], int | None]:
    if not words:
        return words, None
    last = words[-1]
    if last.isdecimal() and len(last) < 3:
        return words[:-1], int(last)
    corner = _without_corner(words)
    if corner is not None:
        return corner
    if last in _BODY_RATES and _RATE_WORDS.intersection(words[:-1]):
        return (*words[:-1], "rate"), _BODY_RATES[last]
    known = {**_LETTERS, **_ANGLES}
    if last in known:
        is_angle = last in _ANGLES
        return (*words[:-1], *(("angle",) if is_angle else ())), known[last]
    # Glued on: gx, accx, quatw; but no letter of a word such as max.
    if last[-1] in _LETTERS and last[:-1] in _GLUED:
        return (*words[:-1], last[:-1]), _LETTERS[last[-1]]
    # Glued on in front, as MAVLink does: xgyro, yacc.
    if last[0] in _LETTERS and last[1:] in _MAVLINK:
        return (*words[:-1], last[1:]), _LETTERS[last[0]]
    # The axis before what it is of: x_gyro, roll_rate, yaw_gyro.
    for word in words[:-1]:
        if word in known:
            angle = ("angle",) if word in _ANGLES else ()
            return (*(other for other in words if other != word), *angle), known[word]
    # A number inside: ESC0 RPM.
    for i, word in enumerate(words[:-1]):
        if word.isdecimal() and len(word) < 3:
            return (*words[:i], *words[i + 1 :]), int(word)
    return words, None


def _without_corner(words: tuple[str, ...]) -> tuple[tuple[str, ...], int] | None:
    """Split off the corner of a motor at the end or at the beginning; None if there is none."""
    for corner, index in _CORNERS.items():
        size = len(corner)
        if words[-size:] == corner:
            return (*words[:-size], "motor"), index
        if words[:size] == corner and len(words) > size:
            return (*words[size:], "motor"), index
    return None


def is_by_corner(name: str) -> bool:
    """Return whether the name of a motor's column says at which corner the motor is."""
    words, _ = _without_unit(_words_of(name))
    return _without_corner(words) is not None


_GLUED: Final = frozenset(
    (
        *("g", "gyr", "gyro", "w", "om", "omega", "a", "acc", "accel", "accelerometer"),
        *("v", "vel", "p", "pos", "q", "quat", "imugyro", "imuacc"),
    )
)


_MAVLINK: Final = ("gyro", "acc")
_TURNS: Final = frozenset(["w", "om", "omega"])
"""Letters for the speed of a turn, of the body or of a rotor."""


def _kind_of_words(words: tuple[str, ...], index: int | None) -> str | None:
    """Guess what a column holds by the words of its name; None if they say nothing."""
    joined = "".join(words)
    if index is not None and _is_estimate_or_target(words, joined):
        return None
    bare = tuple(word for word in words if not word.isdecimal() and word not in _FRAMES)
    is_clock = index is None and re.search(r"time|clock|elapsed", joined) is not None
    # "offset" is a fault of a sensor, but the time since a log began, too; esc_status is a topic.
    harmless = (["offset"] if is_clock else []) + (["status"] if "rpm" in words else [])
    if _NO_MEASUREMENT.difference(harmless).intersection(words):
        return None
    if "batt" in joined and "volt" in joined and "cell" not in joined:
        return "battery"
    if index is None:
        if any(word in joined for word in ("vbat", "batt", "volt")):
            return "battery"
        if re.search(r"time|stamp|clock|second|micros|millis|elapsed", joined) or joined in (
            "t",
            "ts",
        ):
            return "time"
        return None
    if words[-2:] == ("angular", "velocities"):  # mav_msgs/Actuators: of the rotors
        return "motor"
    turns = re.search(
        r"gyr|ang(ular)?vel|bodyrate|angularrate|anglerate|rateangle|speedangle", joined
    )
    turns = turns or bare[-1:] in (("w",), ("g",), ("om",)) or "rate" in words or "rates" in words
    if (turns or ("omega" in words and index < 3 and not _is_motor(words))) and index >= 0:
        # axisRate is what the rate controller of INAV is asked for.
        is_asked = ASKED.intersection(words) or words == ("axis", "rate")
        return "reference" if is_asked else "gyro"
    if _SET_POINT.intersection(words):
        return None
    if (
        "acc" in joined or bare[-1:] in (("a",), ("f",)) or "specificforce" in joined
    ) and index >= 0:
        return None if ASKED.intersection(words) else "accel"
    return _kind_of_rest(words, bare, joined, index)


def _is_estimate_or_target(words: tuple[str, ...], joined: str) -> bool:
    """Return whether a column is an estimate in world axes, or what a Crazyflie's controller wants.

    An angular acceleration is no accelerometer either.
    """
    is_target = words[:1] == ("controller",) and not re.search("gyr|acc|imu|motor|rotor", joined)
    is_world = words[:2] == ("state", "estimate") and words[-1] == "a"
    is_angular = re.search("ang(ular)?acc", joined) is not None
    return is_target or is_world or is_angular or words in _ESTIMATES


_FRAMES: Final = frozenset(["body", "imu", "rs", "r", "s", "b", "frd", "flu", "field", "data"])
"""Words of a name for axes or messages, which say nothing about the quantity."""


def _is_motor(words: tuple[str, ...]) -> bool:
    return any(word in ("motor", "rotor", "prop", "esc") for word in words)


def _kind_of_rest(
    words: tuple[str, ...], bare: tuple[str, ...], joined: str, index: int
) -> str | None:
    if any(word in joined for word in _MOTOR_WORDS) or bare[-1:] in (
        ("m",),
        ("u",),
        ("n",),
        ("mot",),
    ):
        return None if index < 0 or _NO_MOTOR.intersection(words) else "motor"
    if words == ("control",):  # PX4's actuator_motors; of torques the values change their sign
        return "motor" if index >= 0 else None
    if ASKED.intersection(words):
        return None
    if "quat" in joined or "orientation" in joined or bare[-1:] == ("q",):
        return "quaternion"
    if "angle" in words or "euler" in joined:
        return None if _OF_STICKS.intersection(words) else "angle"
    if "vel" in joined or bare[-1:] == ("v",):
        return "velocity"
    if "pos" in joined or bare in (("p",), ()) or "loc" in joined:
        return "position"
    return None


def candidates_of(names: Sequence[str], named: Mapping[str, str]) -> list[Candidate]:
    """Group columns by the words of their names, those that are named by hand first."""
    groups: dict[tuple[str, str], dict[int, str]] = {}
    units: dict[tuple[str, str], str | None] = {}
    # A canonical name that is given an empty one leaves its kind out.
    left_out = {_place_of_name(canonical)[0] for canonical, name in named.items() if not name}
    for canonical, name in named.items():
        kind, index = _place_of_name(canonical)
        if not name:
            continue
        groups.setdefault((kind, ""), {})[index] = name
        units[kind, ""] = parts_of(name)[2]
    rotors = _rotors_by_letter(names)
    has_pqr = {"p", "q", "r"} <= {name.strip().lower() for name in names}
    has_clock = any(_kind_of_words(*parts_of(name)[:2]) == "time" for name in names)
    for name in names:
        is_rate = has_pqr and name.strip().lower() in _BODY_RATES
        words, index, unit = parts_of(f"rate_{name}" if is_rate else name)
        kind = "motor" if name in rotors else _kind_of_words(words, index)
        if kind == "motor" and re.search(r"\d", name) is None and not is_by_corner(name):
            kind = None  # what a controller asks for along x, y, z, such as u_x
        if kind is None and index is None and unit in UNITS["time"]:
            # Whatever is in ns or ms may be the clock, such as last_step_ns, where none is named.
            kind = "time" if words[:1] == ("t",) or not has_clock else None
        if kind is None or name in named.values():
            continue
        # Which wheel of letters counts is the same for q0..q3 and qw..qz only by their values.
        lettered = re.search(r"\d", name) is None if kind == "quaternion" else False
        key = (kind, f"{' '.join(words)}{' lettered' if lettered else ''}" or "plain")
        if kind in ("time", "battery"):
            key = (kind, name)
        groups.setdefault(key, {}).setdefault(0 if index is None else index, name)
        units.setdefault(key, unit or _UNITS_OF_STEMS.get(key[1]))
    return [
        Candidate(kind=kind, stem=stem, by_index=found, unit=units[kind, stem])
        for (kind, stem), found in groups.items()
        if kind not in left_out
    ]


def _rotors_by_letter(names: Sequence[str]) -> set[str]:
    """List columns such as w1 to w4: more than a gyro has, so that they are of rotors."""
    by_stem: dict[tuple[str, ...], list[str]] = {}
    for name in names:
        words, index, _ = parts_of(name)
        if (
            words
            and not _TURNS.isdisjoint((words[0], words[-1]))
            and index is not None
            and re.search(r"\d", name)
        ):
            by_stem.setdefault(words, []).append(name)
    return {name for found in by_stem.values() if len(found) > len(NAMES["gyro"]) for name in found}


def _place_of_name(canonical: str) -> tuple[str, int]:
    """Return kind and index of a canonical name."""
    if canonical == TIME:
        return "time", 0
    for kind, names in NAMES.items():
        if canonical in names:
            return kind, names.index(canonical) - (kind == "quaternion")
    return "motor", int(canonical.rpartition("_")[2])
