"""Whose a PX4 log is, when it began, and in what air."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from rotorfit.logs.flight_log import Circumstances, in_air
from rotorfit.logs.ulog.scan import Scan

_GPS: Final = ("vehicle_gps_position", "sensor_gps")
TOPICS: Final[Mapping[str, tuple[str, ...]]] = {
    "vehicle_air_data": (
        "timestamp",
        "baro_pressure_pa",
        "baro_temp_celcius",
        "ambient_temperature",
    ),
    **dict.fromkeys(_GPS, ("timestamp", "time_utc_usec")),
}
"""Topics and the fields of them that are used."""
KELVIN: Final = 273.15
_A_DATE: Final = 1e9
"""Seconds since 1970 from which a clock was set: before it is 2001."""


def circumstances_of(scan: Scan, begin: float) -> Circumstances:
    """Return what the log says of itself; `begin` is its first sample [s]."""
    pressure, temperature = _air(scan)
    number = str(scan.info.get("sys_uuid", "")).strip()
    return Circumstances(
        hardware=number if number.strip("0") else "",  # simulators have none
        started=_started(scan, begin),
        air_pressure=pressure,
        air_temperature=temperature,
    )


def _air(scan: Scan) -> tuple[float | None, float | None]:
    topic = scan.first("vehicle_air_data")
    pressure = None if topic is None else topic.number("baro_pressure_pa")
    if topic is None or pressure is None:
        return None, None
    # The name with the slip of the pen is that of PX4 before 1.15.
    for name in ("ambient_temperature", "baro_temp_celcius"):
        celsius = topic.number(name)
        if celsius is not None:
            return in_air(pressure, celsius + KELVIN)
    return None, None


def _started(scan: Scan, begin: float) -> float | None:
    """Return when the log began, by the clock of the satellites."""
    for name in _GPS:
        topic = scan.first(name)
        clock = None if topic is None else topic.number("time_utc_usec")
        if topic is None or clock is None:
            continue
        apart = clock * 1e-6 - topic.time
        known = apart > _A_DATE
        if known.any():
            return float(np.median(apart[known])) + begin
    return None
