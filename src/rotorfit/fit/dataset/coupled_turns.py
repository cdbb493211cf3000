"""What products of inertia mix of the turns, in the share that rotors explain of each.

One torque turns a body about other axes, too, and a flight of one axis at a time shows more of that
there than of the other torques. A declaration is not wrong for it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.dataset.response_signals import (
    CLEAR,
    Response,
    explained_share,
    remove_parallel,
    rotor_patterns,
    square_columns,
)
from rotorfit.model.signals import signal_layout

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.model.vehicle import Vehicle

MOST_COUPLED: Final = 0.3
"""Acceleration about z over those of roll and pitch, up to which products of inertia may make it:
principal axes turned by 30 degrees make .25 where Izz is twice Ixx."""
MOST_MIXED: Final = 0.6
"""Ixy over the root of Ixx Iyy, up to which roll and pitch mix: half a vehicle's inertia again, in
two masses at the ends of one arm of an X, makes .33, and all of it .5."""
TINY: Final = float(np.finfo(float).tiny)
AS_EXPLAINED: Final = 0.5
"""Share of what rotors anywhere explain of roll and pitch, which the declared ones explain, too."""
INDEPENDENT: Final = 0.9
"""Share of the drag's pattern that is neither thrust, roll nor pitch, from which spins are such
as a vehicle needs to yaw: 1 as it should be, .25 with one of four spins reversed."""


def with_coupled_tilts(
    found: Response, products: Float[np.ndarray, "c c"], drives: Float[np.ndarray, "3 4 c"]
) -> Response:
    """Return the response with what the product of inertia Ixy mixes of roll and pitch.

    A payload at the ends of one arm of an X turns the principal axes by 45 degrees, and a flight of
    one axis at a time shows more of that than of the other torque. A body's answer is symmetric
    (1 / I); that of turned axes, or of most wrong orders, is not.

    Parameters
    ----------
    found
        Response to the rotors, each turn by its own torque.
    products
        Of the signals, `signal_products`.
    drives
        Of these rotors, `drive_columns`.
    """
    # Roll, pitch and their torques, without what goes with the thrust.
    columns = np.array([drives[0, 1], drives[1, 1], drives[0, 2], drives[1, 2]])
    along = columns @ products @ drives[0, 0]
    size = float(drives[0, 0] @ products @ drives[0, 0])
    Q = columns @ products @ columns.T - np.outer(along, along) / max(size, TINY)
    turns, torques, across = Q[:2, :2], Q[2:, 2:], Q[2:, :2]
    normal = np.array(
        [
            [torques[0, 0], torques[0, 1], 0.0],
            [torques[0, 1], torques[0, 0] + torques[1, 1], torques[0, 1]],
            [0.0, torques[0, 1], torques[1, 1]],
        ]
    )
    own = np.array([across[0, 0], across[1, 0] + across[0, 1], across[1, 1]])
    a, b, c = np.linalg.lstsq(normal, own)[0].tolist()
    if not (a > 0.0 and c > 0.0 and b**2 <= MOST_MIXED**2 * a * c):
        return found
    J = np.array([[a, b], [b, c]])
    left = np.diagonal(turns - J @ across - across.T @ J + J @ torques @ J)
    shares = 1.0 - left / np.maximum(np.diagonal(turns), TINY)
    return replace(
        found, roll=max(found.roll, float(shares[0])), pitch=max(found.pitch, float(shares[1]))
    )


def with_coupled_yaw(
    declared: Response, free: Response, R: np.ndarray, vehicle: Vehicle
) -> Response:
    """Return the response with what roll and pitch torques explain of yaw, where they may.

    By products of inertia a flight of one axis at a time turns about z more by them than by drag.

    Parameters
    ----------
    declared, free
        Responses to the declared rotors, and to rotors anywhere.
    R
        Factor of the signals.
    vehicle
        The rotors.
    """
    across = declared.shares[:2]
    if across.max() < 1.0 - CLEAR or (across < AS_EXPLAINED * free.shares[:2]).any():
        return declared
    layout, patterns = signal_layout(vehicle), rotor_patterns(vehicle)
    if 1.0 - explained_share(patterns[:, 3], patterns[:, :3]) < INDEPENDENT:
        return declared
    squares = R[:, square_columns(vehicle)] @ patterns
    turns = R[:, [layout.index(name) for name in ("dwx", "dwy", "dwz", "dHz")]]
    signals = remove_parallel(np.hstack([turns, squares[:, 1:]]), squares[:, 0])
    roll, pitch, yaw = np.linalg.norm(signals[:, :3], axis=0).tolist()
    if yaw > MOST_COUPLED * np.hypot(roll, pitch):
        return declared
    coupled = explained_share(signals[:, 2], signals[:, 3:])
    return replace(declared, yaw=max(declared.yaw, coupled))


def yaw_by_drag(R: Float[np.ndarray, "r z"], vehicle: Vehicle) -> float:
    """Return the share of yaw that drag and spin-up explain, beside thrust, roll and pitch.

    With the sign of the drag's.

    - `R`: factor of the signals.
    - `vehicle`: the rotors.
    """
    import scipy.linalg  # slow to import

    layout = signal_layout(vehicle)
    driven = R[:, square_columns(vehicle)] @ rotor_patterns(vehicle)
    others, drag = driven[:, :3], driven[:, 3]
    columns = np.column_stack([R[:, layout.index("dwz")], drag, R[:, layout.index("dHz")]])
    basis: Float[np.ndarray, "z k"] = scipy.linalg.orth(others)
    yaw, *drives = (columns - basis @ (basis.T @ columns)).T
    D = np.column_stack(drives)
    response: Float[np.ndarray, " 2"] = scipy.linalg.pinv(D, rtol=1e-9) @ yaw
    explained = float(np.sum((D @ response) ** 2)) / max(float(yaw @ yaw), np.finfo(float).tiny)
    return float(np.copysign(explained, response[0]))
