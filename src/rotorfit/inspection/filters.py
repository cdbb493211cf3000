"""The filters on board, as a log's own settings tell them: low-passes, notches, rotor notches.

Sources: Betaflight blackbox.c and rpm_filter.c (4.2 to 4.5), INAV blackbox.c; PX4 "Parameter
Reference" (IMU_GYRO_*) and sensors/vehicle_angular_velocity; ArduPilot "Complete Parameter List"
(INS_HNTCH_*) and "Managing Gyro Noise".
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

from rotorfit.logs.flight_log import FlightLog

FilterKind = Literal["low-pass", "notch"]
SENSORS: Final = {"gyro": "the gyro", "accel": "the accelerometer"}
ROTOR_MODES: Final = (2, 3, 5)
"""INS_HNTCH_MODE of notches that follow measured rotor speeds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Filter:
    """One filter on board.

    Attributes
    ----------
    channel
        ``gyro`` or ``accel``.
    kind
        ``low-pass`` or ``notch``.
    low, high
        What it can be at [Hz]: the cut-off of a low-pass; the edges of a notch, or between which
        it moves; the same twice where it is fixed. Of one that follows the rotors, `low` is where
        it begins.
    middle
        Of a fixed notch [Hz].
    harmonics
        Which multiples of the rotors' frequency it follows.
    setting
        Its name in the log's settings.
    passed
        Whether the samples of this log went through it.
    """

    channel: str
    kind: FilterKind
    low: float
    high: float
    setting: str
    passed: bool
    middle: float | None = None
    harmonics: tuple[int, ...] = ()

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


def filters_of(log: FlightLog) -> tuple[Filter, ...]:
    """Return the filters that a log's settings tell; none where they tell nothing."""
    readers: Mapping[str, Callable[[FlightLog], list[Filter]]] = {
        "blackbox": _blackbox,
        "ulog": _ulog,
        "dataflash": _dataflash,
    }
    reader = readers.get(log.format)
    return () if reader is None else tuple(reader(log))


def _numbers(metadata: Mapping[str, str], name: str) -> tuple[float, ...]:
    """Return the numbers of a setting, none where it is not there or is something else."""
    try:
        return tuple(float(part) for part in metadata.get(name, "").split(","))
    except ValueError:
        return ()


def _number(metadata: Mapping[str, str], name: str) -> float:
    """Return a setting; 0, as if it were switched off, where it is not there."""
    found = _numbers(metadata, name)
    return found[0] if found else 0.0


def _low_pass(channel: str, at: float, setting: str, *, passed: bool) -> list[Filter]:
    if not at > 0:
        return []
    return [
        Filter(channel=channel, kind="low-pass", low=at, high=at, setting=setting, passed=passed)
    ]


def _blackbox(log: FlightLog) -> list[Filter]:
    """Return the filters of the header; a static low-pass is off where its dynamic one is on."""
    told = log.metadata
    passed = {
        name: "unfilt" not in (log.channels[name].source.lower() if name in log.channels else "")
        for name in SENSORS
    }
    inav = told.get("Firmware revision", "").lower().startswith("inav")
    found: list[Filter] = []
    for dynamic, fixed in (
        ("gyro_lpf1_dyn_hz", "gyro_lpf1_static_hz"),
        ("gyro_lowpass_dyn_hz", "gyro_lowpass_hz"),
        ("", "gyro_lpf2_static_hz"),
        ("", "gyro_lowpass2_hz"),
        ("", "gyro_lpf_hz"),
    ):
        ends = _numbers(told, dynamic)
        if len(ends) == 2 and 0 < ends[0] < ends[1]:
            found.append(_moving("low-pass", ends[0], ends[1], dynamic, passed=passed["gyro"]))
        else:
            found += _low_pass("gyro", _number(told, fixed), fixed, passed=passed["gyro"])
    found += _blackbox_notches(told, passed=passed)
    # Betaflight writes it in hundredths.
    accel = _number(told, "acc_lpf_hz") / (1.0 if inav else 100.0)
    return found + _low_pass("accel", accel, "acc_lpf_hz", passed=passed["accel"])


def _moving(kind: FilterKind, low: float, high: float, setting: str, *, passed: bool) -> Filter:
    return Filter(channel="gyro", kind=kind, low=low, high=high, setting=setting, passed=passed)


def _blackbox_notches(told: Mapping[str, str], *, passed: Mapping[str, bool]) -> list[Filter]:
    """Return fixed notches, Betaflight's dynamic one, and those that follow the rotors."""
    found = [
        *_fixed_notches(told, "gyro", "gyro_notch", passed=passed["gyro"]),
        *_fixed_notches(told, "accel", "acc_notch", passed=passed["accel"]),
    ]
    low, high = _number(told, "dyn_notch_min_hz"), _number(told, "dyn_notch_max_hz")
    if _number(told, "dyn_notch_count") > 0 and 0 < low < high:
        setting = "dyn_notch_min_hz, dyn_notch_max_hz"
        found.append(_moving("notch", low, high, setting, passed=passed["gyro"]))
    for count, least, switch in (
        ("rpm_filter_harmonics", "rpm_filter_min_hz", "dshot_bidir"),
        ("gyro_rpm_notch_harmonics", "gyro_rpm_notch_min", "dshot_bidir"),
        ("rpm_gyro_harmonics", "rpm_gyro_min_hz", "rpm_gyro_filter_enabled"),
    ):
        harmonics = int(min(max(_number(told, count), 0.0), 10.0))
        if harmonics and _number(told, switch) > 0:
            followed = tuple(range(1, harmonics + 1))
            found.append(_following(followed, _number(told, least), count, passed["gyro"]))
    return found


def _fixed_notches(
    told: Mapping[str, str], channel: str, name: str, *, passed: bool
) -> list[Filter]:
    """Return notches by their middles and the cut-offs below them."""
    middles, cutoffs = _numbers(told, f"{name}_hz"), _numbers(told, f"{name}_cutoff")
    return [
        Filter(
            channel=channel,
            kind="notch",
            low=cutoff,
            high=middle**2 / cutoff,  # as many octaves above as the cut-off is below
            middle=middle,
            setting=f"{name}_hz",
            passed=passed,
        )
        for middle, cutoff in zip(middles, cutoffs, strict=False)
        if 0 < cutoff < middle
    ]


def _following(harmonics: tuple[int, ...], least: float, setting: str, passed: bool) -> Filter:
    return Filter(
        channel="gyro",
        kind="notch",
        low=least,
        high=least,
        harmonics=harmonics,
        setting=setting,
        passed=passed,
    )


def _ulog(log: FlightLog) -> list[Filter]:
    """Return PX4's filters: on the way to the controller, and not in the sensors' own topics."""
    told = log.metadata
    sources = {name: log.channels[name].source for name in SENSORS if name in log.channels}
    gyro = sources.get("gyro", "").startswith("vehicle_angular_velocity")
    accel = sources.get("accel", "").startswith("vehicle_acceleration")
    found = _low_pass("gyro", _number(told, "IMU_GYRO_CUTOFF"), "IMU_GYRO_CUTOFF", passed=gyro)
    for i in (0, 1):
        name = f"IMU_GYRO_NF{i}"
        found += _band("gyro", told, f"{name}_FRQ", f"{name}_BW", passed=gyro)
    sources_on = int(_number(told, "IMU_GYRO_DNF_EN"))
    if sources_on & 1:
        count = int(min(max(_number(told, "IMU_GYRO_DNF_HMC"), 1.0), 10.0))
        least = _number(told, "IMU_GYRO_DNF_MIN")
        found.append(_following(tuple(range(1, count + 1)), least, "IMU_GYRO_DNF_EN", gyro))
    return found + _low_pass(
        "accel", _number(told, "IMU_ACCEL_CUTOFF"), "IMU_ACCEL_CUTOFF", passed=accel
    )


def _band(
    channel: str, told: Mapping[str, str], frequency: str, width: str, *, passed: bool
) -> list[Filter]:
    """Return a fixed notch by its middle and its width."""
    middle, half = _number(told, frequency), 0.5 * _number(told, width)
    if not middle > 0:
        return []
    low, high = max(middle - half, 0.0), middle + half
    return [
        Filter(
            channel=channel,
            kind="notch",
            low=low,
            high=high,
            middle=middle,
            setting=frequency,
            passed=passed,
        )
    ]


def _dataflash(log: FlightLog) -> list[Filter]:
    """Return ArduPilot's filters; raw samples (INS_RAW_LOG_OPT) are from before them."""
    told = log.metadata
    source = {name: log.channels[name].source for name in SENSORS if name in log.channels}
    gyro = source.get("gyro", "").startswith("IMU")
    accel = source.get("accel", "").startswith("IMU")
    found = _low_pass("gyro", _number(told, "INS_GYRO_FILTER"), "INS_GYRO_FILTER", passed=gyro)
    for name in ("INS_HNTCH", "INS_HNTC2"):
        if not _number(told, f"{name}_ENABLE") > 0:
            continue
        mode = int(_number(told, f"{name}_MODE"))
        bits = int(_number(told, f"{name}_HMNCS")) or 1
        harmonics = tuple(i + 1 for i in range(16) if bits >> i & 1)
        if mode in ROTOR_MODES:
            found.append(_following(harmonics, _number(told, f"{name}_FREQ"), f"{name}_FREQ", gyro))
        else:
            found += _band("gyro", told, f"{name}_FREQ", f"{name}_BW", passed=gyro)
    return found + _low_pass(
        "accel", _number(told, "INS_ACCEL_FILTER"), "INS_ACCEL_FILTER", passed=accel
    )
