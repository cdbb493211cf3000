"""Refuse an IMU with an axis that never moves; leave out seconds in which it repeats one sample.

A sensor in flight has noise: it does not read the same in all six axes for a tenth of a second. A
repeated sample says that nothing turned and no thrust changed, which the rotors contradict.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.errors import FlightError
from rotorfit.findings import Finding, doubt, note
from rotorfit.flight.dead_gyro_axis import dead_axis_runs
from rotorfit.flight.interpolated import source_rate
from rotorfit.flight.signals import repeated_rows, true_runs, whole_samples

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Bool, Float

    from rotorfit.flight.clocks import UniformChannels
    from rotorfit.logs.flight_log import FlightLog

    Runs = list[tuple[int, int]]

LONGEST: Final = 0.1
"""Duration from which a repeated sample is no sensor's [s]."""
INTERPOLATED: Final = "interpolated-imu"
"""Kind of the finding that an IMU was recorded more slowly than it is written."""
FEWEST: Final = 10
"""Repetitions from which it is none, of slow logs: rounded values may repeat a few times."""
ALONE: Final = 2.0
"""Duration from which a gyro or an accelerometer that alone repeats its sample is dead [s]: coarse
ones repeat theirs in calm flight."""
UNLIKE: Final = 1e-3
"""Least change of the rotors' speeds against one another meanwhile, over their mean: a simulator
without noise turns nothing where its rotors turn alike."""
SHORTEST: Final = 0.5
"""Length of a stretch between two of them that is still used [s]."""


def refuse_dead_axes(log: FlightLog, uniform: UniformChannels) -> None:
    """Raise an error if an axis of gyro or accelerometer never moves."""
    for name, dead in _dead_axes(uniform).items():
        values, source = uniform.values[name], log.channels[name].source
        if dead.any():
            axes = "" if dead.all() else ", ".join("xyz"[i] for i in np.flatnonzero(dead)) + " of "
            read = ", ".join(f"{v:g}" for v in values[0, dead])
            raise FlightError(
                f"{axes}the {name} channel is constant ({read}) over the whole log, which a sensor "
                f"in flight never is; check its source: {source}"
            )


def _dead_axes(uniform: UniformChannels) -> dict[str, Bool[np.ndarray, " 3"]]:
    """Mark the axes of gyro and accelerometer that never move."""
    values = {name: uniform.values[name] for name in ("gyro", "accel")}
    still = {name: np.ptp(one, axis=0) == 0.0 for name, one in values.items()}
    at_zero = {name: still[name] & (one[0] == 0.0) for name, one in values.items()}
    # A simulator without noise that flies in one plane: both sensors have an axis at zero.
    planar = all(one.any() for one in at_zero.values())
    return {
        name: one & ~at_zero[name] if planar and not one.all() else one
        for name, one in still.items()
    }


def interpolated_imu(uniform: UniformChannels) -> Iterator[Finding]:
    """Find gyro or accelerometer values that a recorder drew between slower samples."""
    # Lines show in eight seconds and more, longer than many a stretch of flight.
    a, b = max(uniform.stretches, key=lambda run: run[1] - run[0])
    slow: dict[str, float] = {}
    for name in ("gyro", "accel"):
        rate = source_rate(uniform.values[name][a:b], uniform.sample_rate)
        # Where the rows themselves come so slowly, the lines are those of the common clock.
        if rate is not None and uniform.rates[name] >= 2.0 * rate:
            slow[name] = rate
    if slow:
        words = " and ".join({"gyro": "gyro", "accel": "accelerometer"}[name] for name in slow)
        yield doubt(
            INTERPOLATED,
            f"the {words} came at {min(slow.values()):.0f} Hz, and lines are drawn (or values "
            f"repeated) between the samples up to {uniform.sample_rate:.0f} Hz: quick motion looks "
            "too small; log the IMU itself at 100 Hz or more",
        )


def imu_axes(uniform: UniformChannels) -> Float[np.ndarray, "n 6"]:
    """Return all axes of gyro and accelerometer."""
    return np.column_stack([uniform.values["gyro"], uniform.values["accel"]])


def fewest_repetitions(sample_rate: float) -> int:
    """Return the number of repetitions from which a sensor counts as hung."""
    return max(whole_samples(LONGEST * sample_rate), FEWEST)


def frozen_runs(uniform: UniformChannels, flights: Sequence[tuple[int, int]]) -> Runs:
    """Find the rows (start, stop) in which the whole IMU repeats one sample in flight."""
    least = fewest_repetitions(uniform.sample_rate)
    same = repeated_rows(imu_axes(uniform), flights)
    return [(a, b + 1) for a, b in true_runs(same) if b - a >= least]


def dead_runs(
    uniform: UniformChannels, flights: Sequence[tuple[int, int]], name: Literal["gyro", "accel"]
) -> Runs:
    """Find the rows (start, stop) in which one sensor alone repeats its sample in flight."""
    least = whole_samples(ALONE * uniform.sample_rate)
    same = repeated_rows(uniform.values[name], flights)
    motor = uniform.values["motor"]

    def is_flown(a: int, b: int) -> bool:
        rows = motor[a:b]
        unlike = rows - rows.mean(axis=1, keepdims=True)
        return bool(unlike.std(axis=0).max() > UNLIKE * rows.mean())

    return [(a, b + 1) for a, b in true_runs(same) if b - a >= least and is_flown(a, b)]


def without_runs(flights: Sequence[tuple[int, int]], runs: Runs, sample_rate: float) -> Runs:
    """Return the rows of flights outside some runs, without those whose slope a run touches."""
    kept: Runs = []
    for a, b in flights:
        start = a
        for first, stop in [run for run in runs if a <= run[0] < b]:
            kept.append((start, first))
            start = stop + 1
        kept.append((start, b))
    shortest = whole_samples(SHORTEST * sample_rate)
    return [(a, b) for a, b in kept if b - a >= shortest or (a, b) in flights]


def cut_frozen_imu(
    uniform: UniformChannels, flights: list[tuple[int, int]]
) -> tuple[Runs, list[Finding]]:
    """Return the flights without the seconds in which the IMU stands still, and say which."""
    kept, found = list(flights), list[Finding]()
    for words, runs in (
        ("gyro and accelerometer repeat", frozen_runs(uniform, flights)),
        ("the gyro alone repeats", dead_runs(uniform, flights, "gyro")),
        ("the accelerometer alone repeats", dead_runs(uniform, flights, "accel")),
        *(
            (f"the gyro's {name} axis alone repeats", dead_axis_runs(uniform, flights, axis))
            for axis, name in enumerate("xyz")
        ),
    ):
        # A hung IMU is no dead gyro.
        own = [(a, b) for a, b in runs if any(c <= a < d for c, d in kept)]
        if not own:
            continue
        kept = without_runs(kept, own, uniform.sample_rate)
        seconds = sum(b - a for a, b in own) / uniform.sample_rate
        time = uniform.time - uniform.time[0]
        at = ", ".join(f"{time[a]:.1f} to {time[b - 1]:.1f} s" for a, b in own[:3])
        seen = (
            f"{words} one sample for {seconds:.1f} s of the flight ({at}"
            f"{', ...' if len(own) > 3 else ''}): the sensor, its bus or the recorder hung"
        )
        if not kept:
            raise FlightError(f"{seen}, and nothing of the flight is left; log the flight again")
        found.append(note("frozen-imu", f"{seen}; these seconds are left out"))
    return kept, found
