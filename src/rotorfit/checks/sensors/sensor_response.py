"""Name the filter or soft mount by which measured turns differ from predicted ones.

The step `allow_for_sensor_response` finds it and widens the intervals by it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from rotorfit.findings import Evidence, Finding, doubt_or_passed
from rotorfit.fit.sensors.sensor_response import LEAST_GAIN, FoundFilter

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rotorfit.fit.fit import Fit


def sensor_response(fit: Fit) -> Iterator[Finding]:
    """Name the filter that a step of the fit has found, where the flights show it."""
    found = fit.record_of(FoundFilter)
    if found is not None:
        yield name_filter(found)


def name_filter(found: FoundFilter) -> Finding:
    """Name the filter where the flights show it."""
    checked = doubt_or_passed("sensor-response", _explain_filter(found) if found.certain else None)
    measured = (
        Evidence(name="response_cutoff", value=found.cutoff, interval=found.interval),
        Evidence(name="response_gain", value=found.gain, limit=LEAST_GAIN),
    )
    return replace(checked, evidence=measured)


def _explain_filter(found: FoundFilter) -> str:
    low, high = found.interval
    at = f"{found.cutoff:.0f} Hz ({low:.0f} to {high:.0f})"
    if found.shape == "gyro low-passed":
        seen = (
            f"look late and small, as behind a low-pass of about {at}: the logged gyro is filtered"
        )
        todo = "log the gyro unfiltered"
    else:
        seen = (
            f"are larger than the rotors can make them: the IMU moves on a soft mount (at {at}), "
            "or the rotor speeds are logged after a low-pass"
        )
        todo = "mount the IMU stiffly, and log rotor speeds unfiltered"
    most = 100.0 * max(abs(value) for value in found.factors.values())
    return (
        f"quick turns {seen}; inertia, kd and Jr are off by up to {most:.0f} % and the motors' "
        f"delay by {1e3 * abs(found.delay):.0f} ms, which their intervals cover: {todo}"
    )


CHECKS: Final = (sensor_response,)
