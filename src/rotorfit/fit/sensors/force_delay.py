r"""Estimate how much later the forces of a flight come than its turns, with everything else.

Thrust shows in the accelerometer when the rotors' differences show in the gyro. The joint fit
takes both at one delay of the motors; here the forces of each flight have a delay of their own
beside it. To first order the signals of the rotors then move by both, and their slopes by the
motors' delay serve for this one, too: nothing is reduced again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.estimation.banded import response_sensitivity
from rotorfit.fit.intervals.joint_numbers import formal_covariance, physical, random_half_width
from rotorfit.fit.joint.joint_fit import INTERMEDIATE
from rotorfit.fit.joint.joint_map import force_delay_names
from rotorfit.fit.joint.joint_problem import joint_estimate
from rotorfit.fit.reduction.motor_timing import DELAYING
from rotorfit.fit.sensors.lateness import Lateness, accelerometer_lateness

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rotorfit.estimation.banded import BandedEstimate
    from rotorfit.fit.dataset.dataset import LoadedFlight
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.reduction.motor_timing import FreeTiming

USUAL_DELAY: Final = 0.03
"""Deviation of the delay of forces before the flight [s]."""
MODEL_FAULT: Final = 0.0005
"""Deviation by what the model lacks, such as drag along the thrust without a velocity [s]."""


class DelayedForces(NamedTuple):
    """The delays of the forces after the turns, and the numbers of the fit that has them.

    - `flights`: those that show one.
    - `numbers`: by name, with the motors' free times; none where gyro and accelerometer were
      compared alone.
    """

    flights: list[tuple[LoadedFlight, Lateness]]
    numbers: Mapping[str, float]


def force_delays(fit: Fit) -> DelayedForces:
    """Estimate the delay of the forces after the turns, of every flight.

    Of motors whose times are given, or unknown, as far as gyro and accelerometer alone show it.
    """
    timing = fit.configurations[0].timing
    if timing is None or timing.delay_slope is None:
        return DelayedForces(list(accelerometer_lateness(fit)), {})
    delayed = [
        replace(one, timing=replace(timing, force_std=USUAL_DELAY)) for one in fit.configurations
    ]
    try:
        found = joint_estimate(
            delayed,
            [],
            known=fit.known,
            terms=fit.terms,
            begin=fit.estimate.estimate.by_name,
            close=INTERMEDIATE,
        )
    except EstimationError:
        return DelayedForces([], {})
    names = force_delay_names(delayed)
    flights = [
        configured.flights[int(number)]
        for configured, one in zip(fit.dataset.configurations, delayed, strict=True)
        for number in np.unique(one.factors.recording)
    ]
    numbers = physical(found.estimate.values, found.problem.map, delayed)
    numbers |= times_of(timing, found.estimate.by_name)
    return DelayedForces(list(zip(flights, _delays(found, names), strict=True)), numbers)


def times_of(timing: FreeTiming, values: Mapping[str, float]) -> dict[str, float]:
    """Return the motors' free lag and delay where a fit ends, and their sum [s]."""
    at = {"motor_lag": timing.at.mean_lag, "motor_delay": timing.at.delay}
    times = {name: at[name] + values[name] for name in DELAYING if name in timing.names}
    return times | {"motor_lag_total": sum(times.values())}


def _delays(found: BandedEstimate, names: tuple[str, ...]) -> list[Lateness]:
    """Return the delays of a fit by these names: with deviations by chance, gusts and the model."""
    every = found.estimate.names
    rows = np.eye(len(every))[[every.index(name) for name in names]]
    chance = random_half_width(found, rows, formal_covariance(found, rows)) / 1.96
    by_response = np.abs(response_sensitivity(found) @ rows.T).sum(axis=0) / 1.96
    std = np.sqrt(chance**2 + by_response**2 + MODEL_FAULT**2)
    values = rows @ found.estimate.values
    return [Lateness(seconds=v, std=s) for v, s in zip(values.tolist(), std.tolist(), strict=True)]
