"""Do the motors answer before they are told, or long after? Then a lag or a clock is wrong."""

from typing import Final

from rotorfit.dataset.dataset import Dataset

EARLIEST: Final = -0.005
"""Delay of commanded motors that clocks and filters of a log still make [s]."""
USUAL_DELAY: Final = 0.012
"""Of measured speeds against the motion, by filters and buses [s]."""


def early_motors(dataset: Dataset) -> str | None:
    """Return that commanded motors with a given lag would answer before the command, in words."""
    lag, found = dataset.motors.lag, dataset.motor_timing
    if dataset.motors.speed != "commanded" or lag is None or found is None:
        return None
    return early_said(lag, found.response.delay, found.delay_std or found.total_std)


def early_said(lag: float, delay: float, std: float) -> str | None:
    """Return that motors are early in words; None where a delay may be over `EARLIEST` [s]."""
    if delay + 1.96 * std > EARLIEST:
        return None
    return (
        f"with the lag of {1e3 * lag:.0f} ms that is given, the motors answer "
        f"{-1e3 * delay:.0f} ms before the command (motor_delay), which is impossible: the lag "
        "given is longer than the motors'; leave it out, or give lag_std. Until then do not "
        "trust inertia, or doubts about other sensors"
    )


def late_speeds(dataset: Dataset) -> str | None:
    """Return that measured speeds are stamped far from the motion that they make, in words."""
    found = dataset.motor_timing
    if dataset.motors.speed != "measured" or dataset.source != "imu" or found is None:
        return None
    delay = found.response.delay
    if abs(delay) <= USUAL_DELAY:
        return None
    order = "after" if delay < 0 else "before"
    return (
        f"the measured rotor speeds come {1e3 * abs(delay):.0f} ms {order} the motion that they "
        "make (motor_delay), which is corrected: the ESC telemetry is stamped late or by "
        "another clock; check that the log's clocks agree"
    )
