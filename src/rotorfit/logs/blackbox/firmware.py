"""Settings of Betaflight and INAV: which to change for a better log, and the filters on board.

Sources: Betaflight 4.5 "CLI Command Line Reference", blackbox.c and rpm_filter.c (4.2 to 4.5);
INAV "Settings" and blackbox.c (7 to 9).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rotorfit.logs.firmware import (
    FILTERED_ACCEL,
    FIRMWARE,
    NO_ACCEL,
    NO_MOTORS,
    NO_SPEED,
    SLOW_IMU,
    SLOW_MOTORS,
    Advice,
    Filter,
    FilterKind,
    FilterShape,
    Lack,
    asked_for,
    is_before,
    logged_number,
    logged_numbers,
    low_pass,
    needing_change,
    rotor_notch,
    sensor_sources,
    settings_of,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Set

    from rotorfit.logs.flight_log import FlightLog

BETAFLIGHT: Final = settings_of(
    ("acc_lpf_hz", "100", "the accelerometer is logged after its low-pass", FILTERED_ACCEL),
    ("blackbox_sample_rate", "1/2", "gyro and motors at 1 kHz or more", SLOW_IMU | SLOW_MOTORS),
    ("blackbox_disable_acc", "OFF", "logs the accelerometer (it is on by default)", NO_ACCEL),
    ("blackbox_disable_motors", "OFF", "logs the motor commands", SLOW_MOTORS),
    ("dshot_bidir", "ON", "rotor speed (ESCs with bidirectional DShot)", NO_SPEED),
    ("blackbox_disable_rpm", "OFF", "logs the rotor speed (Betaflight 4.5 and later)", NO_SPEED),
    ("motor_poles", "magnets of a motor", "without it the rotor speed is wrong", NO_SPEED),
)
OLD_BETAFLIGHT: Final = settings_of(
    *(
        (setting.name, setting.value, setting.why, setting.asked_by)
        for setting in BETAFLIGHT
        if setting.name != "blackbox_disable_rpm"
    ),
    (FIRMWARE, "Betaflight 4.5 or later", "earlier ones do not log the rotor speed", NO_SPEED),
)
"""Before it logged rotor speeds."""
LOGS_SPEED: Final = (4, 5)
"""First Betaflight that does."""
INAV: Final = settings_of(
    (
        "acc_lpf_hz",
        "100",
        "the accelerometer is logged after its low-pass, and navigation sees it so, too",
        FILTERED_ACCEL,
    ),
    (
        "blackbox_rate_denom",
        "2",
        "with blackbox_rate_num: every second loop is logged; 500 Hz and more are good",
        SLOW_IMU | SLOW_MOTORS,
    ),
    ("blackbox_rate_num", "1", "see blackbox_rate_denom", SLOW_IMU | SLOW_MOTORS),
    ("CLI:", "blackbox ACC", "logs the accelerometer", NO_ACCEL),
    ("CLI:", "blackbox MOTORS", "logs the motor commands", NO_MOTORS),
)
"""No rotor speed: INAV to 9 has no bidirectional DShot."""


LOW_PASSES: Final[Mapping[str, FilterShape]] = {
    "0": "pt1",
    "1": "butterworth",
    "2": "pt2",
    "3": "pt3",
}
"""Shapes by the number that the header has of them (`lowpassFilterType_e`)."""
PT2_ACCEL: Final = (4, 4)
"""First Betaflight whose accelerometer has two filters of first order in place of a biquad."""


def _is_inav(metadata: Mapping[str, str]) -> bool:
    return metadata.get("Firmware revision", "").lower().startswith("inav")


def advice(lacks: Set[Lack], metadata: Mapping[str, str]) -> Advice:
    """Advise settings of the firmware that wrote the log."""
    if _is_inav(metadata):
        return Advice(settings=needing_change(asked_for(INAV, lacks), metadata), file="inav.txt")
    table = OLD_BETAFLIGHT if is_before("^Betaflight ", LOGS_SPEED, metadata) else BETAFLIGHT
    found = needing_change(asked_for(table, lacks), _as_in_cli(metadata))
    return Advice(settings=found, file="betaflight.txt")


def _as_in_cli(metadata: Mapping[str, str]) -> dict[str, str]:
    """Return Betaflight's header with the values of settings as its CLI has them."""
    switch = {"0": "OFF", "1": "ON"}
    found = dict(metadata)
    if "acc_lpf_hz" in found:
        found["acc_lpf_hz"] = f"{logged_number(metadata, 'acc_lpf_hz') / 100.0:g}"
    if found.get("dshot_bidir") in switch:
        found["dshot_bidir"] = switch[found["dshot_bidir"]]
    return found


def filters(log: FlightLog) -> list[Filter]:
    """Find the filters of the header; a static low-pass is off where its dynamic one is on."""
    logged = log.metadata
    passed = {name: "unfilt" not in word.lower() for name, word in sensor_sources(log).items()}
    found: list[Filter] = []
    for dynamic, fixed, kind in (
        ("gyro_lpf1_dyn_hz", "gyro_lpf1_static_hz", "gyro_lpf1_type"),
        ("gyro_lowpass_dyn_hz", "gyro_lowpass_hz", "gyro_lowpass_type"),
        ("", "gyro_lpf2_static_hz", "gyro_lpf2_type"),
        ("", "gyro_lowpass2_hz", "gyro_lowpass2_type"),
        ("", "gyro_lpf_hz", "gyro_lpf_type"),
    ):
        ends = logged_numbers(logged, dynamic)
        if len(ends) == 2 and 0 < ends[0] < ends[1]:
            found.append(
                _moving_filter("low-pass", ends[0], ends[1], dynamic, passed=passed["gyro"])
            )
        else:
            shape = LOW_PASSES.get(logged.get(kind, ""))
            found += low_pass(logged, "gyro", fixed, passed=passed["gyro"], shape=shape)
    found += _find_notches(logged, passed=passed)
    # Betaflight writes it in hundredths.
    scale = 1.0 if _is_inav(logged) else 100.0
    return found + low_pass(
        logged,
        "accel",
        "acc_lpf_hz",
        passed=passed["accel"],
        scale=scale,
        shape=_accelerometer_shape(logged),
    )


def _accelerometer_shape(logged: Mapping[str, str]) -> FilterShape:
    """Return the shape of the accelerometer's low-pass (`accFilter` in sensors/acceleration*)."""
    second_order = _is_inav(logged) or is_before("^Betaflight ", PT2_ACCEL, logged)
    return "butterworth" if second_order else "pt2"


def _moving_filter(
    kind: FilterKind, low: float, high: float, setting: str, *, passed: bool
) -> Filter:
    return Filter(channel="gyro", kind=kind, low=low, high=high, setting=setting, passed=passed)


def _find_notches(logged: Mapping[str, str], *, passed: Mapping[str, bool]) -> list[Filter]:
    """Find fixed notches, Betaflight's dynamic one, and those that follow the rotors."""
    found = [
        *_fixed_notches(logged, "gyro", "gyro_notch", passed=passed["gyro"]),
        *_fixed_notches(logged, "accel", "acc_notch", passed=passed["accel"]),
    ]
    low, high = (logged_number(logged, f"dyn_notch_{end}_hz") for end in ("min", "max"))
    if logged_number(logged, "dyn_notch_count") > 0 and 0 < low < high:
        setting = "dyn_notch_min_hz, dyn_notch_max_hz"
        found.append(_moving_filter("notch", low, high, setting, passed=passed["gyro"]))
    for count, least, switch in (
        ("rpm_filter_harmonics", "rpm_filter_min_hz", "dshot_bidir"),
        ("gyro_rpm_notch_harmonics", "gyro_rpm_notch_min", "dshot_bidir"),
        ("rpm_gyro_harmonics", "rpm_gyro_min_hz", "rpm_gyro_filter_enabled"),
    ):
        harmonics = int(min(max(logged_number(logged, count), 0.0), 10.0))
        if harmonics and logged_number(logged, switch) > 0:
            followed = tuple(range(1, harmonics + 1))
            found.append(rotor_notch(followed, logged_number(logged, least), count, passed["gyro"]))
    return found


def _fixed_notches(
    logged: Mapping[str, str], channel: str, name: str, *, passed: bool
) -> list[Filter]:
    """Make notches from their middles and the cut-offs below them [Hz]."""
    middles, cutoffs = (logged_numbers(logged, f"{name}_{end}") for end in ("hz", "cutoff"))
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
