"""The trim of a hover: where the centre of mass must be for the rotors' thrusts to balance."""

import numpy as np
from jaxtyping import Float

from rotorfit.errors import FlightError
from rotorfit.model.vehicle import Vehicle


def thrust_center(
    motors: Float[np.ndarray, "n N"], vehicle: Vehicle, *, least_share: float = 0.5
) -> Float[np.ndarray, " 2"]:
    """Return the mean centre of thrust x, y [m], which in hover lies over the centre of mass.

    All that a log without an accelerometer tells of the CoM; rotors are taken as equal, so that
    differences between flights of one vehicle are sharper than the place itself.

    Parameters
    ----------
    motors
        Rotor speed, or a command that goes with it, in the vehicle's rotor order.
    vehicle
        Its geometry.
    least_share
        Samples whose thrust is under this share of the upper quartile count as ground.

    Raises
    ------
    FlightError
        If the motors never turn.
    """
    thrust = motors * motors
    total = thrust.sum(axis=1)
    if not total.max(initial=0.0) > 0:
        raise FlightError("the motors never turn in this log: there is no trim to see")
    flying = total > least_share * np.percentile(total, 75)
    mean = thrust[flying].mean(axis=0)
    return mean @ vehicle.positions[:, :2] / mean.sum()
