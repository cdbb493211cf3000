"""Find how thrust grows with the command from hovers at different masses.

A vehicle of twice the mass hovers on twice the thrust, whatever the accelerometer says: the
squared speeds of the law that is assumed must be as the masses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.measured import Measured
from rotorfit.fit.reduction.frequency_bands import retimed
from rotorfit.fit.weight.kt_from_weight import kt_from_weight

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.fit.fit import Fit
    from rotorfit.flight.flight_data import FlightData

HOVERS_STD: Final = 0.02
"""Deviation of the thrust of one command between flights, as a share: air, propellers, tilt."""
CHARGES_STD: Final = 0.055
"""The same where the law does not know the battery's voltage: thrust goes with the power 1.6 of a
voltage that differs by 3.4 % (`results/law_tables.py`)."""
LEAST_SPREAD: Final = 1e-3
"""Least deviation of the logarithms of hover speeds: less says nothing."""


def exponent_share_by_masses(fit: Fit) -> Measured | None:
    """Estimate the exponent of the speed over the one assumed, by hovers at different masses.

    None of flights at one mass, and of vehicles that nobody weighed.
    """
    dataset = fit.dataset
    if not fit.mass_known or len({c.mass for c in dataset.configurations}) < 2:
        return None
    law = dataset.motors.law
    between = HOVERS_STD if law is not None and law.voltage is not None else CHARGES_STD
    log_speeds: list[float] = []
    coefficients: list[Measured] = []
    for configured in dataset.configurations:
        kt = kt_from_weight(
            (configured,), dataset.vehicle, source=dataset.source, timing=dataset.timing
        )
        if kt is None or kt.value <= 0.0:
            continue
        hover = rms_speed([retimed(f.prepared, dataset.timing) for f in configured.flights])
        log_speeds.append(float(np.log(hover)))
        coefficients.append(kt)
    return exponent_share(log_speeds, coefficients, between)


def exponent_share(
    log_speeds: Sequence[float], coefficients: Sequence[Measured], between: float
) -> Measured | None:
    """Estimate the exponent over the one assumed, by hover speeds and the k_t that carries each.

    `between`: deviation of k_t between hovers, as a share. With the share x of the exponent k_t
    goes with the speed to the power of 2 x - 2. None where all hover on one speed.
    """
    if len(log_speeds) < 2:
        return None
    x = np.array(log_speeds)
    y = np.log([kt.value for kt in coefficients])
    weight = np.array([1.0 / (kt.share**2 + between**2) for kt in coefficients])
    centred = x - weight @ x / weight.sum()
    spread = float(weight @ centred**2)
    if spread < LEAST_SPREAD**2 * weight.sum():
        return None
    # d log kt / d log speed is 2 x - 2, so that x is 1 + half the slope.
    slope = float((weight * centred) @ y) / spread
    return Measured(value=1.0 + 0.5 * slope, std=0.5 * spread**-0.5)


def rms_speed(flights: Sequence[FlightData]) -> float:
    """Compute the rms rotor speed in flight [rad/s, or parts of the largest]."""
    squares = np.concatenate([one.rotor_speed[one.used_rows].ravel() ** 2 for one in flights])
    return float(np.sqrt(squares.mean()))
