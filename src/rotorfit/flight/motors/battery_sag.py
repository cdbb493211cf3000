"""How far the battery's voltage falls under the motors' load, by a flight.

The current of a motor grows with what it turns into torque, a power of the cubed speed over the
voltage. Where the load changes from second to second, the voltage shows how far it falls with it;
what it loses steadily is the charge.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float

LOAD_EXPONENT: Final = 0.75
"""Power of cubed speed over voltage with which a motor's current grows: six motors with measured
speed and current from a third of their thrust to all of it (github.com/StrawsonDesign/
motor_propeller_testing, github.com/diegosdantonio/thruststand_test), .54 to .93."""
LOAD_EXPONENT_STD: Final = 0.12
"""Deviation between those motors."""
BLOCK: Final = 0.1
"""Duration of what is averaged [s]."""
PAST: Final = 8
"""Blocks of load on which a voltage depends: logged voltages are filtered."""
SHORTEST: Final = 5.0
"""Flight that shows a sag [s]."""
CLUSTER: Final = 10
"""Blocks whose errors go together: a cell recovers over a second."""
CLEAR: Final = 3.0
"""Deviations from which a sag is seen: chance alone makes one in 700."""
DROP_STD: Final = 0.2
"""Deviation of a drop between flights of one vehicle, as a share: five Crazyflie flights."""
HELD_FACTOR: Final = 1.2
"""Drop under a load that is held for seconds, over the drop with a load that changes within .8 s: a
cell also polarises slowly. From rest to hover it is 1.18 to 1.23 in five Crazyflie flights and 1.5
in one of a larger vehicle; to full throttle on a stand 1.4 +- .2 of a Crazyflie of two flights."""
HELD_STD: Final = 0.15
"""Deviation of that factor between those vehicles."""


@frozen_dataclass
class BatterySag:
    """The battery under load.

    - `voltage`: mean in flight [V].
    - `drop`, `drop_std`: by how much the mean load of the flight lowers it [V].
    """

    voltage: float
    drop: float
    drop_std: float

    def at_load(self, load: float) -> float:
        """Return the voltage at a load, given over the mean one of the flight [V]."""
        return self.voltage + self.drop * (1.0 - load)

    @property
    def held(self) -> BatterySag:
        """The battery under a load that is held for seconds."""
        share = float(np.hypot(self.drop_std / self.drop, HELD_STD / HELD_FACTOR))
        drop = HELD_FACTOR * self.drop
        return replace(self, drop=drop, drop_std=share * drop)


def relative_load(
    cubed_speed: Float[np.ndarray, "..."],
    voltage: Float[np.ndarray, "..."],
    exponent: float = LOAD_EXPONENT,
) -> Float[np.ndarray, "..."]:
    """Compute the current of motors by cubed speed and voltage, each over its mean in flight."""
    return (cubed_speed / voltage) ** exponent


def battery_sag(
    time: Float[np.ndarray, " n"],
    voltage: Float[np.ndarray, " n"],
    speed: Float[np.ndarray, "n N"],
) -> BatterySag | None:
    """Measure how far the load lowers the voltage; None if the flight does not show it.

    `speed`: of the rotors, in any unit; `voltage` [V] at the same `time` [s].
    """
    cubes = (np.maximum(speed, 0.0) ** 3).sum(axis=1)
    rows = np.isfinite(voltage) & np.isfinite(cubes) & (voltage > 0.0)
    if not rows.any() or float(cubes[rows].mean()) <= 0.0:
        return None
    t, volts, cubes = time[rows], voltage[rows], cubes[rows]
    mean = float(volts.mean())
    # The voltage's own noise must not stand on both sides: its feedback is taken out afterwards.
    load = (cubes / cubes.mean()) ** LOAD_EXPONENT
    block = ((t - t[0]) / BLOCK).astype(int)
    count = np.bincount(block)
    seen = np.flatnonzero(count)
    if len(seen) * BLOCK < SHORTEST:
        return None
    t, volts, load = (np.bincount(block, weights=x)[seen] / count[seen] for x in (t, volts, load))
    drop, std = _summed_response(t, -volts, load / load.mean())
    if not drop > CLEAR * std:
        return None
    # As the voltage falls, the same power takes more current.
    drop /= 1.0 + LOAD_EXPONENT * drop / mean
    return BatterySag(voltage=mean, drop=drop, drop_std=float(np.hypot(std, DROP_STD * drop)))


def _summed_response(
    time: Float[np.ndarray, " b"], drop: Float[np.ndarray, " b"], load: Float[np.ndarray, " b"]
) -> tuple[float, float]:
    """Fit a drop to the load of the last blocks; return the sum of its factors and its std."""
    n = len(load)
    # Before the first block the load is taken for the mean of the first ones.
    past = [np.concatenate([np.full(k, load[:PAST].mean()), load[: n - k]]) for k in range(PAST)]
    since = (time - time[0]) / np.ptp(time)
    # What the charge takes steadily, a parabola over time, is no sag.
    trend = np.stack([np.ones(n), since, since**2], axis=1)
    columns = np.column_stack([*past, trend])
    inverse = np.linalg.pinv(columns)
    factors = inverse @ drop
    weights = inverse[:PAST].sum(axis=0)
    scores = np.add.reduceat(weights * (drop - columns @ factors), np.arange(0, n, CLUSTER))
    # The residuals lack what trend and sag took: as many degrees of freedom.
    few = len(scores) / max(len(scores) - trend.shape[1] - 1, 1)
    return float(factors[:PAST].sum()), float(np.sqrt(few * (scores @ scores)))
