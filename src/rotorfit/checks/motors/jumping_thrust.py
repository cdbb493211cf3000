"""Check whether the thrust at one rotor speed jumps during a flight.

The accelerometer feels what lifts. Its mean over half a second goes with the sum of squared speeds,
and where the two part at one moment and stay apart, the scale of the speeds changed (telemetry,
another divisor), or the load or the propellers did.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.checks.motors.changed_thrust import changed_in_flight
from rotorfit.estimation.measured import change_of_means
from rotorfit.findings import Evidence, Finding, doubt
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import file_name

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rotorfit.fit.fit import Fit
    from rotorfit.flight.flight_data import FlightData

BATCH: Final = 0.5
"""Length of a batch [s]."""
FEWEST: Final = 10
"""Batches of a flight."""
INSIDE: Final = 0.2
"""Share of the flight before and after the jump: throws, take-offs and landings are at its ends."""
LEAST_JUMP: Final = 0.04
"""Change of the logarithm of thrust: sound flights whose batches scatter little have up to .014."""
CERTAIN: Final = 8.0
"""Deviations from which it is one: 30 sound flights with measured speed have up to 5."""


@frozen_dataclass
class ThrustJump:
    """Where the felt thrust over the squared speeds changes most.

    - `time`: of the change, since the first sample [s].
    - `share`: change of the thrust at one rotor speed.
    - `deviations`: the same over what scatters before and after.
    """

    time: float
    share: float
    deviations: float

    @property
    def is_certain(self) -> bool:
        """Whether sound flights do not jump so."""
        large = abs(float(np.log1p(self.share))) >= LEAST_JUMP
        return large and self.deviations >= CERTAIN


def thrust_jump(data: FlightData) -> ThrustJump | None:
    """Find the moment at which the thrust at one rotor speed changes most; None if too short."""
    rows = data.used_rows
    count = int(len(rows) / data.sample_rate / BATCH)
    if count < FEWEST:
        return None
    parts = np.array_split(rows, count)
    felt = np.array([data.specific_force[own, 2].mean() for own in parts])
    squares = np.array([np.square(data.rotor_speed[own]).sum(axis=1).mean() for own in parts])
    if not ((felt > 0.0) & (squares > 0.0)).all():
        return None
    ratio = np.log(felt / squares)
    around = max(round(INSIDE * count), 2)
    jumps = [change_of_means(ratio[:k], ratio[k:]) for k in range(around, count - around + 1)]
    sizes = [float(abs(change) / np.maximum(std, 1e-12)) for change, std in jumps]
    best = int(np.argmax(sizes))
    at = float(data.time[parts[around + best][0]] - data.time[0])
    return ThrustJump(time=at, share=float(np.expm1(jumps[best][0])), deviations=sizes[best])


def jumping_thrust(fit: Fit) -> Iterator[Finding]:
    """Check that no flight's measured speeds make another thrust from one moment on."""
    if fit.dataset.motors.speed != "measured" or any(changed_in_flight(fit)):
        return
    for flight in fit.dataset.flights:
        jump = thrust_jump(flight.prepared.data)
        if jump is not None and jump.is_certain:
            yield jump_finding(jump, file_name(flight.entry.file))


def jump_finding(jump: ThrustJump, flight: str) -> Finding:
    """Say when the thrust at one rotor speed changes, and what to do."""
    way = "more" if jump.share > 0.0 else "less"
    return doubt(
        "thrust-jumps",
        f"{flight}: from {jump.time:.1f} s on the same rotor speeds give "
        f"{100.0 * abs(jump.share):.0f} % {way} thrust than before: the scale of the measured "
        "speeds, the load or the propellers changed; find out which part is right, and give it "
        "alone (--start, --end)",
        flights=(flight,),
        evidence=(
            Evidence(name="thrust_jump", value=jump.share, limit=LEAST_JUMP),
            Evidence(name="thrust_jump_time", value=jump.time),
        ),
    )


CHECKS: Final = (jumping_thrust,)
