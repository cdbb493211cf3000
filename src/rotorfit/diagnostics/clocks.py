"""Do accelerometer and gyro tell of the same moment? Both answer the same rotors.

The thrust of all rotors together shows in the accelerometer, their differences in the gyro, both
at once. Where one comes later than the other, its samples are stamped late or stand behind a
low-pass filter; one delay of the motors cannot serve both.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.dataset.dataset import Dataset, LoadedFlight
from rotorfit.findings import Finding, doubt, doubt_or_passed
from rotorfit.fit.fit import Fit
from rotorfit.model.vehicle import Vehicle
from rotorfit.preprocessing.flight_data import FlightData
from rotorfit.preprocessing.signals import smooth, whole_samples
from rotorfit.reduction.frequency_bands import retimed

LEAST_DELAY: Final = 0.008
"""Between accelerometer and gyro from which it is said [s]. Sound real logs have up to 1 ms, an
accelerometer stamped 30 ms late 28, a gyro behind a low-pass of 5 Hz 50, one of 20 Hz 12."""
UNEXPLAINED: Final = 0.1
"""Or from this times the share of a turn that the rotors do not explain [s]: what the autopilot
answers to gusts and noise moves the turn's time by so much at most (simulated flights: 17 to 28 ms
where they explain .8 to .65)."""
FILTERED: Final = 0.2
"""Delay of a low-pass filter times its cutoff: .16 of the first order, .23 of the second."""
EXPLAINED_FORCE: Final = 0.4
EXPLAINED_TURN: Final = 0.85
"""Share of the upward force and of a turn that the rotors must explain in the band."""
REACH: Final = 0.1
"""How far the two are looked for [s]."""
SLOW, FAST = 2.0, 12.0
"""Band in which they are compared [Hz]: below, the air answers climb and sink with a phase of its
own (16 ms at 0.5 Hz and up), above is vibration."""
SHORTEST: Final = 5.0
"""Flight that is looked at [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lateness:
    """By how much a signal comes after what the rotors do [s], and the share they explain of it."""

    seconds: float
    share: float


def accelerometer_delay(fit: Fit) -> Iterator[Finding]:
    """Check that accelerometer and gyro respond to the rotors at the same time."""
    dataset = fit.dataset
    flights = [f for c in dataset.configurations for f in c.flights if dataset.source == "imu"]
    for flight in flights:
        delay = _delay(flight, dataset)
        if delay is not None:
            sentence = _delay_sentence(Path(flight.entry.file).name, delay)
            yield doubt("imu-clocks", sentence, flights=(flight.entry.written,))
            return


def _delay_sentence(name: str, delay: float) -> str:
    late, early = ("accelerometer", "gyro") if delay > 0 else ("gyro", "accelerometer")
    return (
        f"{name}: the {late} follows the rotors {1e3 * abs(delay):.0f} ms later than the {early}, "
        f"though both respond at once: the {late} is stamped late, or passes a low-pass filter "
        f"of about {FILTERED / abs(delay):.0f} Hz that the {early} does not; log both unfiltered "
        "with one clock. Until then do not trust kt and inertia"
    )


def _delay(flight: LoadedFlight, dataset: Dataset) -> float | None:
    """Measure by how much the accelerometer responds later than the gyro [s]; None where unsure."""
    data = retimed(flight.prepared, dataset.timing)
    if data.seconds_used < SHORTEST:
        return None
    force, *turns = latenesses(data, dataset.vehicle)
    turn = max(turns, key=lambda found: found.share)
    if force.share < EXPLAINED_FORCE or turn.share < EXPLAINED_TURN:
        return None
    delay = force.seconds - turn.seconds
    return delay if abs(delay) > max(LEAST_DELAY, UNEXPLAINED * (1.0 - turn.share)) else None


def latenesses(data: FlightData, vehicle: Vehicle) -> list[Lateness]:
    """Measure by how much upward force, roll and pitch follow the rotors' speeds."""
    reach = whole_samples(REACH * data.sample_rate)
    made = np.column_stack([vehicle.axes[:, 2], np.cross(vehicle.positions, vehicle.axes)[:, :2]])
    pairs: list[tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]] = []
    for s in data.segments:
        if len(s) < 8 * reach or len(s) < 2.0 * data.sample_rate / SLOW:
            continue
        rows = slice(s.start, s.stop)
        response = np.column_stack(
            [data.specific_force[rows, 2], data.angular_acceleration[rows, :2]]
        )
        push = data.rotor_speed[rows] ** 2 @ made
        pairs.append((_band(response, data.sample_rate), _band(push, data.sample_rate)))
    if not pairs:
        return [Lateness(seconds=0.0, share=0.0)] * 3
    return [_lateness([(y[:, k], x[:, k]) for y, x in pairs], reach, data) for k in range(3)]


def _band(values: Float[np.ndarray, "n k"], rate: float) -> Float[np.ndarray, "n k"]:
    return smooth(values, rate, FAST) - smooth(values, rate, SLOW)


def _lateness(
    pairs: Sequence[tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]],
    reach: int,
    data: FlightData,
) -> Lateness:
    """Find the shift at which a push explains most of a response, between samples by a parabola.

    `pairs`: response and push of each stretch; `reach`: samples to either side that are tried.
    """
    shares = np.array([_share(pairs, shift, reach) for shift in range(-reach, reach + 1)])
    best = int(np.argmax(shares))
    if best in (0, len(shares) - 1):
        return Lateness(seconds=0.0, share=0.0)
    left, top, right = shares[best - 1 : best + 2].tolist()
    bend = left - 2.0 * top + right
    between = 0.0 if bend == 0.0 else 0.5 * (left - right) / bend
    return Lateness(seconds=(best - reach + between) / data.sample_rate, share=top)


def _share(
    pairs: Sequence[tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]],
    shift: int,
    reach: int,
) -> float:
    """Compute the share of a response explained by a push `shift` samples earlier."""
    cross = size = total = 0.0
    for y, x in pairs:
        own, moved = y[reach : len(y) - reach], x[reach - shift : len(x) - reach - shift]
        cross += float(own @ moved)
        size += float(moved @ moved)
        total += float(own @ own)
    if size == 0.0 or total == 0.0 or cross <= 0.0:
        return 0.0
    return cross**2 / (size * total)


EARLIEST: Final = -0.005
"""Delay of commanded motors that clocks and filters of a log still make [s]."""
USUAL_DELAY: Final = 0.012
"""Of measured speeds against the motion, by filters and buses [s]."""


def early_motors(fit: Fit) -> Iterator[Finding]:
    """Check that commanded motors with a given lag do not respond before the command."""
    motors, timing = fit.dataset.motors, fit.dataset.motor_timing
    if motors.speed != "commanded" or motors.lag is None or timing is None:
        return
    std = timing.delay_std or timing.total_std
    sentence = early_sentence(motors.lag, timing.response.delay, std)
    yield doubt_or_passed("motors-early", sentence, numbers=("motor_delay",))


def early_sentence(lag: float, delay: float, std: float) -> str | None:
    """Explain that motors are early; None where their delay may be over `EARLIEST` [s]."""
    if delay + 1.96 * std > EARLIEST:
        return None
    return (
        f"with the lag of {1e3 * lag:.0f} ms that is given, the motors answer "
        f"{-1e3 * delay:.0f} ms before the command (motor_delay), which is impossible: the lag "
        "given is longer than the motors'; leave it out, or give lag_std. Until then do not "
        "trust inertia, or doubts about other sensors"
    )


def late_speeds(fit: Fit) -> Iterator[Finding]:
    """Check that measured speeds are stamped near the motion that they make."""
    dataset = fit.dataset
    if dataset.motors.speed != "measured" or dataset.source != "imu":
        return
    if dataset.motor_timing is None:
        return
    delay = dataset.motor_timing.response.delay
    order = "after" if delay < 0 else "before"
    sentence = (
        f"the measured rotor speeds come {1e3 * abs(delay):.0f} ms {order} the motion that they "
        "make (motor_delay), which is corrected: the ESC telemetry is stamped late or by "
        "another clock; check that the log's clocks agree"
    )
    late = abs(delay) > USUAL_DELAY
    yield doubt_or_passed("speeds-late", sentence if late else None, numbers=("motor_delay",))


CHECKS: Final = (early_motors, late_speeds, accelerometer_delay)
