"""Check for sensors at the end of their range, and name low-passes that the log does not.

A sensor at the end of its range cuts off what is faster or harder: that no interval covers.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from rotorfit.findings import Evidence, Finding, doubt_or_passed, note

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rotorfit.fit.dataset.dataset import LoadedFlight
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.timing.timed_dataset import TimedDataset

LEAST_CUT_OFF: Final = 1e-3
"""Least share of the flight that must be cut off: real flights without a fault have none."""

HARMFUL: Final = 0.03
"""Share from which numbers leave their intervals. Of a gyro of 250 deg/s in six simulated flights
each, k_t was within 1.1 half-widths below .02, 1.4 off (at most) at .05, 2.6 at .1, 3.4 at .2, and
inertia 2.8 at .3."""


def lowpass_sentence(dataset: TimedDataset) -> str | None:
    """Explain that the motors' times include the delay of a low-pass; None if there is none."""
    from rotorfit.fit.timing.timing_faults import filter_delay, lowpass_of

    cutoff = lowpass_of(dataset)
    if dataset.motor_timing is None or dataset.motors.speed == "measured":
        return None
    if cutoff is None:
        return _measured_lowpass_sentence(dataset)
    return (
        f"the gyro is low-passed on board at {cutoff:g} Hz: {1e3 * filter_delay(cutoff):.0f} ms of "
        "motor_lag and motor_delay together are the filter's, not the motors'; for the motors' "
        "own, log the IMU raw (ArduPilot: bit 19 of LOG_BITMASK)"
    )


def _measured_lowpass_sentence(dataset: TimedDataset) -> str | None:
    """Explain the same of a gyro whose low-pass the flights show and the log does not name."""
    found = [flight.bandwidths["gyro"] for flight in dataset.flights if "gyro" in flight.bandwidths]
    if not found:
        return None
    least = min(one.cutoff for one in found)
    return (
        f"the gyro follows the rotors up to {least:.2g} Hz only, by a filter that the log does not "
        "name: motor_lag and motor_delay include it; for the motors' own, log the gyro unfiltered"
    )


def saturated_sensors(fit: Fit) -> Iterator[Finding]:
    """Check that no sensor reached the end of its range in flight; report the worst flight."""
    found = (
        [cut for f in fit.dataset.flights for cut in cut_off(f)]
        if fit.dataset.source == "imu"
        else []
    )
    share, words = max(found, default=(0.0, None))
    because = "a sensor is at the end of its range" if share > HARMFUL else None
    yield doubt_or_passed("sensor-saturated", words, doubtful_because=because)


def cut_off(flight: LoadedFlight) -> list[tuple[float, str]]:
    """Measure the share of a flight that each sensor's end cut off, and explain it."""
    file = Path(flight.entry.file).name
    found: list[tuple[float, str]] = []
    for name, unit in (("gyro", "rad/s"), ("accel", "m/s^2")):
        cut = flight.recorded.saturation[name]
        if cut.share > LEAST_CUT_OFF:
            sensor = "gyro" if name == "gyro" else "accelerometer"
            words = (
                f"{file}: the {sensor} is at the end of its range ({cut.largest:.3g} {unit}) for "
                f"{100 * cut.share:.1f} % of the flight: what is faster or harder is cut off, and "
                "inertia or thrust comes out wrong; set a wider range, or fly more gently"
            )
            found.append((cut.share, words))
    return found


def filtered_accelerometers(fit: Fit) -> Iterator[Finding]:
    """Name the slowest low-pass whose lateness was taken off an accelerometer, and its flight."""
    flights = fit.dataset.flights
    found = [(f.bandwidths["accel"], f) for f in flights if "accel" in f.bandwidths]
    late = [(low_pass, flight) for low_pass, flight in found if low_pass.taken_off]
    if not late:
        return
    low_pass, flight = min(late, key=lambda one: one[0].cutoff)
    low, high = low_pass.interval
    yield note(
        "accelerometer-filtered",
        # Where it shows by its delay alone, samples that are stamped late look the same.
        f"{Path(flight.entry.file).name}: the accelerometer is {1e3 * low_pass.slow_delay:.0f} ms "
        f"late, as behind a low-pass of about {low_pass.cutoff:.2g} Hz ({low:.2g} to {high:.2g}) "
        "that the log does not name; this delay is taken off: log it unfiltered for narrower "
        "intervals",
        flights=(flight.entry.written,),
        evidence=(
            Evidence(
                name="accelerometer_cutoff", value=low_pass.cutoff, interval=low_pass.interval
            ),
        ),
    )


CHECKS: Final = (saturated_sensors, filtered_accelerometers)
