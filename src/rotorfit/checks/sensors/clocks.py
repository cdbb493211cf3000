"""Compare the clocks of accelerometer, gyro and rotor speeds: all respond to the same rotors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rotorfit.checks.sensors.log_settings import better_log
from rotorfit.digits import with_half
from rotorfit.findings import Evidence, Finding, doubt_or_passed
from rotorfit.fit.dataset.channel_findings import BY_CLOCK
from rotorfit.fit.sensors.late_accelerometer import ForceDelays
from rotorfit.fit.timing.timing_search import ASKED_FOR
from rotorfit.logs.firmware import FILTERED_ACCEL
from rotorfit.model.parameters import INERTIA

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rotorfit.fit.fit import Fit

LEAST_DELAY: Final = 0.005
"""Relevant delay between accelerometer and gyro [s]: 3 ms move kt and inertia by up to .3 %, a
tenth of their intervals, and the centre of mass by a fifth of its own (three flights)."""
CERTAIN: Final = 3.0
"""Deviations of it within which chance and gusts stay, in the worst of several flights."""
FILTERED: Final = 0.2
"""Delay of a low-pass filter times its cutoff: .16 of the first order, .23 of the second."""


def accelerometer_delay(fit: Fit) -> Iterator[Finding]:
    """Check that accelerometer and gyro respond to the rotors at the same time."""
    recorded = fit.record_of(ForceDelays)
    if recorded is None or not recorded.left:
        return
    flight, late = max(recorded.left, key=lambda one: abs(one[1].least))
    evidence = Evidence(
        name="accelerometer_lateness",
        value=late.seconds,
        interval=late.interval,
        limit=LEAST_DELAY,
    )
    step = better_log(flight.log, FILTERED_ACCEL) if late.seconds > 0.0 else None
    step = step or "log gyro and accelerometer unfiltered, by one clock, and fly again"
    sentence = None
    if abs(late.seconds) > LEAST_DELAY + CERTAIN * late.std:
        name = Path(flight.entry.file).name
        sentence = _delay_sentence(name, late.seconds, 1.96 * late.std, step)
    checked = doubt_or_passed(
        "imu-clocks",
        sentence,
        flights=(flight.entry.written,),
        numbers=("kt", *INERTIA),
        doubtful_because=(
            f"the {_name_late(late.seconds)} lags behind the {_name_late(-late.seconds)}"
        ),
        next_step=step,
    )
    yield replace(checked, evidence=(evidence,))


def _name_late(delay: float) -> str:
    """Name the sensor that a delay makes late."""
    return "accelerometer" if delay > 0 else "gyro"


def _delay_sentence(name: str, delay: float, half: float, step: str) -> str:
    late, early = _name_late(delay), _name_late(-delay)
    return (
        f"{name}: the {late} follows the rotors {with_half(1e3 * abs(delay), 1e3 * half)} ms "
        f"later than the {early}, though both respond at once: the {late} is stamped late, or "
        f"passes a low-pass filter of about {FILTERED / abs(delay):.0f} Hz that the {early} does "
        f"not; {step}. Until then do not trust kt and inertia"
    )


EARLIEST: Final = -0.005
"""Delay of commanded motors that clocks and filters of a log still make [s]."""
USUAL_DELAY: Final = 0.012
"""Usual delay of measured speeds against the motion, by filters and buses [s]."""


def early_motors(fit: Fit) -> Iterator[Finding]:
    """Check that commanded motors with a given lag do not respond before the command."""
    motors, timing = fit.dataset.motors, fit.dataset.motor_timing
    if motors.speed != "commanded" or motors.lag is None or timing is None:
        return
    std = timing.delay_std or timing.total_std
    sentence = early_sentence(motors.lag, timing.response.delay, std)
    yield doubt_or_passed(
        "motors-early",
        sentence,
        numbers=("motor_delay", *INERTIA),
        doubtful_because="the motor lag that is given is longer than the motors'",
        next_step="leave lag out of [motors], or give lag_std, and identify again",
    )


def early_sentence(lag: float, delay: float, std: float) -> str | None:
    """Explain that motors are early; None if their delay may be over `EARLIEST` [s]."""
    if delay + 1.96 * std > EARLIEST:
        return None
    return (
        f"with the lag of {1e3 * lag:.0f} ms that is given, the motors respond "
        f"{-1e3 * delay:.0f} ms before the command (motor_delay), which is impossible: the lag "
        "given is longer than the motors'; leave it out, or give lag_std. Until then do not "
        "trust inertia, or doubts about other sensors"
    )


def late_speeds(fit: Fit) -> Iterator[Finding]:
    """Check that measured speeds are stamped near the motion that they make."""
    dataset, timing = fit.dataset, fit.dataset.motor_timing
    if dataset.motors.speed != "measured" or dataset.source != "imu":
        return
    if timing is None or timing.delay_std is None:
        return
    delay, half = timing.response.delay, 1.96 * timing.delay_std
    evidence = Evidence(
        name="speed_delay", value=delay, interval=(delay - half, delay + half), limit=USUAL_DELAY
    )
    sentence = _late_sentence(delay, half) if abs(delay) - half > USUAL_DELAY else None
    numbers, because, step = _why_off(delay, half)
    checked = doubt_or_passed(
        "speeds-late", sentence, numbers=numbers, doubtful_because=because, next_step=step
    )
    yield replace(checked, evidence=(evidence,))


LATE_MOTORS: Final = ("motor_delay", "command_delay", "motor_lag", "motor_lag_up", "motor_lag_down")
"""Times of the motors that include what makes the logged speeds late: a low-pass at 10 Hz made
`motor_lag` 8 % too large (four half-widths)."""


def _why_off(delay: float, half: float) -> tuple[tuple[str, ...], str, str]:
    """Return the numbers that a delay of the speeds [s] touches, why, and what to do."""
    if delay - half > ASKED_FOR:
        because = "the motors may reach the logged speeds later than they are asked for"
        return BY_CLOCK, because, "log the measured rotor speeds, by the clock of the gyro"
    step = "log both by one clock, and fly 20 s of brisk rolls"
    if delay < 0.0:
        step = "log the measured rotor speeds unfiltered, by the clock of the gyro"
        return LATE_MOTORS, "the logged rotor speeds are late or filtered", step
    # In 6 of 75 simulated flights whose speeds are on time, 5 with a low-passed accelerometer.
    return (
        ("motor_delay",),
        "an accelerometer behind a low-pass makes rotor speeds look early",
        step,
    )


_EARLY_CAUSE: Final = "the gyro is stamped late, filtered or softly mounted, or thrust lags"


def _late_sentence(delay: float, half: float) -> str:
    """Explain a delay [s] that no bus makes: below zero the speeds are late, else the gyro is."""
    order, cause = (
        ("after", "the ESC telemetry is filtered, stamped late or by another clock")
        if delay < 0.0
        else ("before", _EARLY_CAUSE)
    )
    if delay - half > ASKED_FOR:
        cause = f"the speeds are those that were asked for and not those measured, or {cause}"
    return (
        f"the measured rotor speeds come {with_half(1e3 * abs(delay), 1e3 * half)} ms {order} the "
        f"motion that they make (motor_delay), which is corrected: {cause}; log both by one clock "
        "and unfiltered"
    )


CHECKS: Final = (early_motors, late_speeds, accelerometer_delay)
