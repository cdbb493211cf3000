r"""The equations of motion as constant tensors: row_j(theta) = sum_p theta_p A_p,j z.

The residual wrench B(theta) z = body wrench - rotor wrench, force [N] then torque about the body
origin [N m], is linear in the signals z (`signals.py`) and in the parameters theta. Newton-Euler
at the body origin in body axes (Six et al. 2020, eq. 1, 2), with the specific force
:math:`\alpha = a - R^{-1} g` that an accelerometer at the origin measures:

.. math::
    m \alpha + \dot\omega \times ms + \omega \times (\omega \times ms) &= f \\
    I \dot\omega + \omega \times I \omega + ms \times \alpha &= \tau

and the rotors (eq. 8, 9, for any position r_i, thrust axis n_i and spin s_i = +1 for ccw), with
rotor inertia:

.. math::
    f = \sum k_t O_i^2 n_i, \quad
    \tau = \sum r_i \times k_t O_i^2 n_i - s_i k_d O_i^2 n_i - J_r (\dot H + \omega \times H)

the yaw torque :math:`-c \omega_z \sum O_i (x_i^2 + y_i^2)` of rotors that are carried sideways
by the turn of the body (each is held back by c O_i times its velocity in its plane), and, where
the velocity v of the origin is known, the drag of the frame, -d_x v_x, -d_y v_y, -d_z v_z
(Faessler, Franchi and Scaramuzza, IEEE Robotics and Automation Letters 3(2), 2018), wherever it
acts: at a point r it has the torque :math:`Q v` too, and of the point's own velocity the force
:math:`Q^T \omega`, with six coefficients :math:`Q_{xy} = r_z d_y, Q_{xz} = -r_y d_z` and so on.
Where it is not known, -d_z v_z over the velocity along z that the IMU feels (`climb_velocity`).
Linear damping of a turn about x and y; the thrust :math:`-k_u O_i u_i n_i` that a rotor loses where
it moves by u_i along its own axis (the inflow ratio of blade elements, Leishman, Principles of
Helicopter Aerodynamics, 2006, 3.2), and the thrust :math:`k_h (v_x^2 + v_y^2)` that all together
gain across it (Svacha, Mohta and Kumar, ICUAS 2017).

Each effect is a `Term` with the function for its entries of A: of the rigid body, its sensors and
constant torques in `terms/body.py`, of the rotors in `terms/rotors.py`, of the air in
`terms/air.py`; `terms/registry.py` lists them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.signals import AddedSignals, SignalLayout, signal_layout
from rotorfit.model.terms.body import body_first_moments
from rotorfit.model.terms.registry import terms_in

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.model.terms.term import Block
    from rotorfit.model.vehicle import Vehicle


@frozen_dataclass
class Regressor:
    """The tensor A of a vehicle.

    - `names`: parameter p of theta.
    - `tensor`: ``tensor[p, j]`` is the row vector A_p,j: equation j (Fx Fy Fz Mx My Mz) of
      parameter p.
    - `layout`: the signals that its last axis stands for.
    """

    names: tuple[str, ...]
    tensor: Float[np.ndarray, "p 6 z"]
    layout: SignalLayout

    def rows(self, Z: Float[np.ndarray, "n z"], names: Sequence[str]) -> Float[np.ndarray, "n 6 q"]:
        """Return the dense equations of the named parameters, sample by sample."""
        chosen = self.tensor[[self.names.index(name) for name in names]]
        return np.einsum("nz,qjz->njq", Z, chosen)

    def residual(
        self, Z: Float[np.ndarray, "n z"], theta: Mapping[str, float]
    ) -> Float[np.ndarray, "n 6"]:
        """Return body wrench minus rotor wrench at the named parameter values [N, N m]."""
        values = np.array([theta.get(name, 0.0) for name in self.names])
        return Z @ np.einsum("p,pjz->jz", values, self.tensor).T


def regressor(
    vehicle: Vehicle,
    *,
    added: Sequence[AddedSignals] = (),
) -> Regressor:
    """Return the constant tensor of a vehicle.

    - `vehicle`: geometry. With a known IMU position the specific force among the signals is the one
      at the IMU, and the equations hold at the body origin all the same.
    - `added`: signals of terms that are not always there (`terms.registry.added_signals`).
    """
    layout = signal_layout(vehicle, added)
    blocks: dict[str, Block] = {}
    for term in terms_in(layout):
        if term.entries is not None:
            blocks |= term.entries(vehicle, layout)
    tensor = np.array(list(blocks.values())) @ imu_lever(vehicle, layout)
    return Regressor(names=tuple(blocks), tensor=tensor, layout=layout)


def imu_lever(vehicle: Vehicle, layout: SignalLayout) -> Float[np.ndarray, "z z"]:
    """Return the map from signals with the force at the IMU to signals with it at the origin."""
    lever = np.eye(len(layout))
    p = vehicle.imu_position
    if p is None:
        return lever
    moved = body_first_moments(vehicle, layout)
    for component, name in zip(p, ("msx", "msy", "msz"), strict=True):
        # For an IMU at p the accelerometer reads alpha + dw x p + w x (w x p), which is linear in
        # the signals of the same sample.
        lever[:3] -= component * moved[name][:3]
    return lever
