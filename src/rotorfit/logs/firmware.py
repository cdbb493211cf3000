"""Settings of a firmware: advice for a better log, and the filters on board."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Final, Literal

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.formats import BY_NAME, load

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Set

    from rotorfit.logs.flight_log import FlightLog

# Advice

Lack = Literal[
    "no gyro",
    "slow gyro",
    "no accel",
    "slow accel",
    "filtered accel",
    "no rotor speed",
    "no motors",
    "slow motors",
    "no battery",
]
"""What a log lacks for an identification."""
SLOW_IMU: Final[frozenset[Lack]] = frozenset({"no gyro", "slow gyro", "no accel", "slow accel"})
NO_SPEED: Final[frozenset[Lack]] = frozenset({"no rotor speed"})
SLOW_MOTORS: Final[frozenset[Lack]] = frozenset({"no motors", "slow motors"})
NO_MOTORS: Final[frozenset[Lack]] = frozenset({"no motors"})
NO_BATTERY: Final[frozenset[Lack]] = frozenset({"no battery"})
NO_ACCEL: Final[frozenset[Lack]] = frozenset({"no accel"})
FILTERED_ACCEL: Final[frozenset[Lack]] = frozenset({"filtered accel"})
FIRMWARE: Final = "firmware"
"""Name in place of a setting's where it takes another version of the firmware."""


def is_before(program: str, first: tuple[int, int], metadata: Mapping[str, str]) -> bool:
    """Test whether a version of a program (a pattern) before its `first` wrote the log."""
    found = re.search(program + r"(\d+)\.(\d+)", metadata.get("Firmware revision", ""))
    return found is not None and (int(found[1]), int(found[2])) < first


@frozen_dataclass
class Setting:
    """One setting of a firmware, what it is for, and what in a log asks for it.

    - `value`: what it is to be, in words.
    - `why`: what it is for; a second sentence says what it takes.
    - `old`, `new`: as the log has it, None if that is not known; and exactly as it is to be
      written, None if only the owner of the vehicle knows it.
    """

    name: str
    value: str
    why: str
    asked_by: frozenset[Lack]
    old: str | None = None
    new: str | None = None


@frozen_dataclass
class Advice:
    """The settings to change before the next log, and the file of all of a firmware's settings."""

    settings: tuple[Setting, ...]
    file: str


def advice_for(log_format: str, lacks: Set[Lack], metadata: Mapping[str, str]) -> Advice | None:
    """Advise settings by what a log lacks and has set; None if its firmware has no settings."""
    form = BY_NAME.get(log_format)
    if "Simulator" in metadata:  # no wire to send the speed over
        lacks = lacks - NO_SPEED
    return load(form.advice)(lacks, metadata) if form is not None and form.advice else None


def settings_of(*rows: tuple[str, str, str, frozenset[Lack]]) -> tuple[Setting, ...]:
    """Make the table of a firmware's settings from rows of name, value, reason and lacks."""
    return tuple(
        Setting(name=name, value=value, why=why, asked_by=asked_by, new=_exact_value(name, value))
        for name, value, why, asked_by in rows
    )


def _exact_value(name: str, value: str) -> str | None:
    """Return a value that can be written as it stands: one word, or a line for a file or a CLI."""
    return value if name.endswith(":") or re.fullmatch(r"[\w/.]+", value) else None


def asked_for(settings: Iterable[Setting], lacks: Set[Lack]) -> tuple[Setting, ...]:
    """Select the settings that what a log lacks asks for."""
    return tuple(setting for setting in settings if setting.asked_by & lacks)


def with_value(setting: Setting, value: str | None) -> tuple[Setting, ...]:
    """Give a setting its value for this log; empty if the log has it already."""
    if value is None:
        return ()
    # The number stands first in the words, where it is known.
    number = value.partition(",")[0]
    exact = number if number.removeprefix("-").isdecimal() else None
    return (replace(setting, value=value, new=exact),)


def needing_change(settings: Iterable[Setting], logged: Mapping[str, str]) -> tuple[Setting, ...]:
    """Give settings the values that the log has, and leave out those that need no change."""
    known = [replace(setting, old=logged.get(setting.name)) for setting in settings]
    return tuple(setting for setting in known if setting.old is None or setting.new != setting.old)


def logged_integer(metadata: Mapping[str, str], name: str) -> int | None:
    """Read a parameter of bits from a log's metadata; None if it is not known."""
    text = metadata.get(name, "")
    return int(text) if text.removeprefix("-").isdecimal() else None


def bits_set(current: int | None, bits: Mapping[int, str]) -> str | None:
    """Return the value that sets some bits and keeps those of `current`; None if all are set."""
    known = 0 if current is None else current
    missing = {bit: what for bit, what in sorted(bits.items()) if not known >> bit & 1}
    if not missing:
        return None
    words = ", ".join(f"{what} (bit {bit})" for bit, what in missing.items())
    if current is None:
        return f"what it is with {words} ticked, too (do not add numbers)"
    # Never "add so much": a bit that is set already would carry over and clear others. Negative
    # values are two's complements.
    return f"{known | sum(1 << bit for bit in missing)}, which adds {words}"


# Filters on board

FilterKind = Literal["low-pass", "notch"]
FilterShape = Literal["butterworth", "pt1", "pt2", "pt3"]
"""Of a low-pass: second order, or one to three of first order in a row."""
SENSORS: Final = {"gyro": "the gyro", "accel": "the accelerometer"}


@frozen_dataclass
class Filter:
    """One filter on board.

    - `channel`: ``gyro`` or ``accel``.
    - `low`, `high`: the cut-off of a low-pass, or the edges of a notch [Hz]; where it moves, the
      range; the same twice where it is fixed. Of one that follows the rotors, `low` is where it
      begins.
    - `middle`: of a fixed notch [Hz].
    - `harmonics`: multiples of the rotors' frequency that it follows.
    - `setting`: its name in the log's settings.
    - `passed`: whether the samples of this log went through it.
    - `shape`: of a low-pass; None if the log does not say.
    """

    channel: str
    kind: FilterKind
    low: float
    high: float
    setting: str
    passed: bool
    middle: float | None = None
    harmonics: tuple[int, ...] = ()
    shape: FilterShape | None = "butterworth"

    @property
    def is_known(self) -> bool:
        """Whether its response is known: it stands still, and its shape is in the log."""
        return self.shape is not None and not self.harmonics and self.is_fixed

    @property
    def is_fixed(self) -> bool:
        """Whether it stays where it is."""
        return self.middle is not None or self.low == self.high

    @property
    def short(self) -> str:
        """For a label in a picture."""
        if self.harmonics:
            return f"rotor {self.kind}"
        if self.middle is not None or self.low == self.high:
            return f"{self.kind} {self.middle or self.low:g} Hz"
        return f"{self.kind} {self.low:g} to {self.high:g} Hz"

    @property
    def words(self) -> str:
        """In a sentence."""
        sensor = f"{SENSORS[self.channel]}'s {self.kind}"
        if self.harmonics:
            times = ", ".join(map(str, self.harmonics))
            words = f"{sensor} follows the rotors at {times} times their frequency, from "
            words += f"{self.low:g} Hz ({self.setting})"
        elif self.middle is not None or self.low == self.high:
            words = f"{sensor} is at {self.middle or self.low:g} Hz ({self.setting})"
        else:
            words = f"{sensor} is at {self.low:g} to {self.high:g} Hz ({self.setting})"
        return words if self.passed else f"{words}; the samples of this log are from before it"


def filters_on_board(log: FlightLog) -> tuple[Filter, ...]:
    """Find the filters that a log's settings name; empty if its firmware is unknown."""
    form = BY_NAME.get(log.format)
    return tuple(load(form.filters)(log)) if form is not None and form.filters else ()


def sensor_sources(log: FlightLog) -> dict[str, str]:
    """Find the sources of the gyro and accelerometer samples; empty if there are none."""
    return {name: log.channels[name].source if name in log.channels else "" for name in SENSORS}


def logged_numbers(metadata: Mapping[str, str], name: str) -> tuple[float, ...]:
    """Read the numbers of a setting; empty if it is missing or something else."""
    try:
        return tuple(float(part) for part in metadata.get(name, "").split(","))
    except ValueError:
        return ()


def logged_number(metadata: Mapping[str, str], name: str) -> float:
    """Read a setting; 0, as if it were switched off, where it is missing."""
    found = logged_numbers(metadata, name)
    return found[0] if found else 0.0


def low_pass(
    metadata: Mapping[str, str],
    channel: str,
    setting: str,
    *,
    passed: bool,
    scale: float = 1.0,
    shape: FilterShape | None = "butterworth",
) -> list[Filter]:
    """Make the low-pass whose cut-off a setting gives in units of `scale` [Hz], if it is on."""
    at = logged_number(metadata, setting) / scale
    if not at > 0:
        return []
    return [
        Filter(
            channel=channel,
            kind="low-pass",
            low=at,
            high=at,
            setting=setting,
            passed=passed,
            shape=shape,
        )
    ]


def fixed_notch(
    metadata: Mapping[str, str], frequency: str, width: str, *, passed: bool
) -> list[Filter]:
    """Make the gyro's notch whose middle and width two settings give [Hz], if it is on."""
    middle, half = logged_number(metadata, frequency), 0.5 * logged_number(metadata, width)
    if not middle > 0:
        return []
    return [
        Filter(
            channel="gyro",
            kind="notch",
            low=max(middle - half, 0.0),
            high=middle + half,
            middle=middle,
            setting=frequency,
            passed=passed,
        )
    ]


def rotor_notch(harmonics: tuple[int, ...], least: float, setting: str, passed: bool) -> Filter:
    """Make the gyro's notch that follows the rotors from a least frequency on [Hz]."""
    return Filter(
        channel="gyro",
        kind="notch",
        low=least,
        high=least,
        harmonics=harmonics,
        setting=setting,
        passed=passed,
    )
