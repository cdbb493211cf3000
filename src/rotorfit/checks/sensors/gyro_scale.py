"""Check whether the gyro's scale is off, by a velocity of another source.

The step `allow_for_gyro_scale` estimates the scale and widens the intervals by it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from rotorfit.findings import Evidence, Finding, doubt_or_passed
from rotorfit.fit.dataset.gyro_by_velocity import GyroScale

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rotorfit.fit.fit import Fit

KIND: Final = "gyro-scale"
SAID: Final = 0.95
"""Probability of a scale that is off, from which it is said."""
AXES: Final = ("roll", "pitch", "yaw")


def wrong_gyro_scale(fit: Fit) -> Iterator[Finding]:
    """Report the scale of the gyro that a step of the fit has estimated."""
    found = fit.record_of(GyroScale)
    if found is not None:
        yield scale_finding(found)


def scale_finding(found: GyroScale) -> Finding:
    """Name the axes about which the scale is off."""
    off = [k for k in range(3) if found.probability(k) > SAID]
    checked = doubt_or_passed(KIND, _explain_scale(found, off) if off else None)
    measured = [
        Evidence(
            name=f"gyro_scale_{AXES[k]}", value=float(found.value[k]), interval=found.interval(k)
        )
        for k in range(3)
    ]
    return replace(checked, evidence=tuple(measured))


def _explain_scale(found: GyroScale, off: list[int]) -> str:
    """Explain about which axes the gyro reads too much or too little."""
    return (
        f"the gyro reads {', '.join(_axis_error(found, axis) for axis in off)}: turned by it, what "
        "the "
        "accelerometer reads does not add up to the logged velocity; the intervals of inertia, kd "
        "and Jr cover that: calibrate the gyro on a turntable, or check the scale by which its "
        "counts were read"
    )


def _axis_error(found: GyroScale, axis: int) -> str:
    """Return the error about one axis, with its interval."""
    value = float(found.value[axis])
    low, high = sorted(100.0 * abs(edge) for edge in found.interval(axis))
    way = "much" if value > 0.0 else "little"
    return f"{100.0 * abs(value):.1f} % ({low:.1f} to {high:.1f}) too {way} about {AXES[axis]}"


CHECKS: Final = (wrong_gyro_scale,)
