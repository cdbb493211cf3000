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

One function per effect; each returns the entries of A for its parameters. To add an effect, write
its function and name it in `EFFECTS`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rotorfit.model.parameters import DRAG_MOMENTS
from rotorfit.model.signals import SignalLayout, signal_layout
from rotorfit.model.vehicle import Vehicle
from rotorfit.preprocessing.flight_data import Velocity

Block = Float[np.ndarray, "6 z"]
FX, FY, FZ, MX, MY, MZ = range(6)


@dataclass(frozen=True, slots=True, kw_only=True)
class Regressor:
    """The tensor A of a vehicle.

    Attributes
    ----------
    names
        Parameter p of theta.
    tensor
        ``tensor[p, j]`` is the row vector A_p,j: equation j (Fx Fy Fz Mx My Mz) of parameter p.
    layout
        The signals that its last axis stands for.
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
    vehicle: Vehicle, *, effects: Sequence[str] | None = None, velocity: Velocity = "none"
) -> Regressor:
    """Return the constant tensor of a vehicle.

    Parameters
    ----------
    vehicle
        Geometry. With a known IMU position the specific force among the signals is the one at the
        IMU, and the equations hold at the body origin all the same.
    effects
        Names of `EFFECTS`; by default all.
    velocity
        What of the velocity is among the signals; without it there is no drag of the frame.
    """
    layout = signal_layout(vehicle, velocity=velocity)
    blocks: dict[str, Block] = {}
    for effect in EFFECTS if effects is None else effects:
        blocks |= EFFECTS[effect](vehicle, layout)
    tensor = np.array(list(blocks.values())) @ imu_lever(vehicle, layout)
    return Regressor(names=tuple(blocks), tensor=tensor, layout=layout)


def body_mass(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Mass: force m alpha (the paper's D_m)."""
    del vehicle
    return {"mass": _block(layout, {(FX, "ax"): 1.0, (FY, "ay"): 1.0, (FZ, "az"): 1.0})}


def body_first_moments(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """First moments ms = m c: force [dw]x ms + [w]x[w]x ms, torque ms x alpha."""
    del vehicle
    msx = {
        (FX, "wywy"): -1.0, (FX, "wzwz"): -1.0, (FY, "wxwy"): 1.0, (FY, "dwz"): 1.0,
        (FZ, "wxwz"): 1.0, (FZ, "dwy"): -1.0, (MY, "az"): -1.0, (MZ, "ay"): 1.0,
    }  # fmt: skip
    msy = {
        (FX, "wxwy"): 1.0, (FX, "dwz"): -1.0, (FY, "wxwx"): -1.0, (FY, "wzwz"): -1.0,
        (FZ, "wywz"): 1.0, (FZ, "dwx"): 1.0, (MX, "az"): 1.0, (MZ, "ax"): -1.0,
    }  # fmt: skip
    msz = {
        (FX, "wxwz"): 1.0, (FX, "dwy"): 1.0, (FY, "wywz"): 1.0, (FY, "dwx"): -1.0,
        (FZ, "wxwx"): -1.0, (FZ, "wywy"): -1.0, (MX, "ay"): -1.0, (MY, "ax"): 1.0,
    }  # fmt: skip
    return {
        "msx": _block(layout, msx),
        "msy": _block(layout, msy),
        "msz": _block(layout, msz),
    }


def body_inertia(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Inertia at the body origin, tensor elements: torque I dw + w x I w."""
    del vehicle
    entries = {
        "Ixx": {(MX, "dwx"): 1.0, (MY, "wxwz"): 1.0, (MZ, "wxwy"): -1.0},
        "Iyy": {(MX, "wywz"): -1.0, (MY, "dwy"): 1.0, (MZ, "wxwy"): 1.0},
        "Izz": {(MX, "wywz"): 1.0, (MY, "wxwz"): -1.0, (MZ, "dwz"): 1.0},
        "Ixy": {
            (MX, "dwy"): 1.0, (MX, "wxwz"): -1.0, (MY, "dwx"): 1.0, (MY, "wywz"): 1.0,
            (MZ, "wxwx"): 1.0, (MZ, "wywy"): -1.0,
        },
        "Ixz": {
            (MX, "dwz"): 1.0, (MX, "wxwy"): 1.0, (MY, "wzwz"): 1.0, (MY, "wxwx"): -1.0,
            (MZ, "dwx"): 1.0, (MZ, "wywz"): -1.0,
        },
        "Iyz": {
            (MX, "wywy"): 1.0, (MX, "wzwz"): -1.0, (MY, "dwz"): 1.0, (MY, "wxwy"): -1.0,
            (MZ, "dwy"): 1.0, (MZ, "wxwz"): 1.0,
        },
    }  # fmt: skip
    return {name: _block(layout, block) for name, block in entries.items()}


def rotor_thrust(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Thrust k_t O^2 n_i at r_i: one coefficient for all rotors, and one of each rotor's own."""
    blocks: dict[str, Block] = {"kt": _block(layout, {})}
    n = vehicle.axes
    wrenches = -np.concatenate([n, np.cross(vehicle.positions, n)], axis=1)
    for i, wrench in enumerate(wrenches):
        own = _block(layout, {})
        own[:, layout.index(f"O2_{i + 1}")] = wrench
        blocks[f"kt_{i + 1}"] = own
        blocks["kt"] = blocks["kt"] + own
    return blocks


def rotor_torque(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Drag torque -s_i k_d O^2 n_i."""
    block = _block(layout, {})
    for i, (s, n) in enumerate(zip(vehicle.spins, vehicle.axes, strict=True)):
        block[MX:, layout.index(f"O2_{i + 1}")] = s * n
    return {"kd": block}


def rotor_inertia(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Spin-up reaction and gyroscopic torque -J_r (dH/dt + w x H)."""
    del vehicle
    block = _block(layout, {})
    for row, axis in ((MX, "x"), (MY, "y"), (MZ, "z")):
        for name in (f"dH{axis}", f"wxH_{axis}"):
            if name in layout:
                block[row, layout.index(name)] = 1.0
    return {"Jr": block}


def rotor_center(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Rotors displaced together by t: torque t x thrust, parameters k_t t_x, k_t t_y, k_t t_z."""
    blocks: dict[str, Block] = {}
    columns = [layout.index(f"O2_{i + 1}") for i in range(len(vehicle.rotors))]
    for axis, direction in zip("xyz", np.eye(3), strict=True):
        block = _block(layout, {})
        block[MX:, columns] = -np.cross(direction, vehicle.axes).T
        blocks[f"kt_rotor_center_{axis}"] = block
    return blocks


def twist(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Rotors tilted about their arms: yaw torque k_t twist sum O^2, parameter k_t times twist."""
    block = _block(layout, {})
    for i in range(len(vehicle.rotors)):
        block[MZ, layout.index(f"O2_{i + 1}")] = -1.0
    return {"kt_twist": block}


def rotor_drag(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Yaw torque -c w_z sum O_i (x_i^2 + y_i^2) of rotors that a turn carries through the air."""
    del vehicle
    return {"rotor_drag": _block(layout, {(MZ, "wzO"): 1.0})}


def frame_drag(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Drag -d v along each body axis, wherever it acts; nothing where the velocity is unknown.

    ``drag_moment_xy`` is the torque about x per velocity along y, and the force along y per rate
    about x: at r it is r_z d_y, the torque of -d_y v_y and the drag of the velocity w_x r_z there.
    Both are sums over all that is dragged, so that one number is enough for each. The torque
    against a rate, of second order in r, is left out.
    """
    del vehicle
    if "vx" not in layout:
        return {}
    rows = dict(zip("xyz", (FX, FY, FZ), strict=True))
    blocks = {f"drag_{a}": _block(layout, {(rows[a], f"v{a}"): 1.0}) for a in "xyz"}
    torques = dict(zip("xyz", (MX, MY, MZ), strict=True))
    for name in DRAG_MOMENTS:
        about, along = name[-2:]
        both = {(torques[about], f"v{along}"): -1.0, (rows[along], f"w{about}"): -1.0}
        blocks[name] = _block(layout, both)
    return blocks


def climb_drag(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Force -d v_z over the velocity along z that the IMU feels: drag and inflow look the same."""
    del vehicle
    return {"climb_drag": _block(layout, {(FZ, "climb"): 1.0})} if "climb" in layout else {}


def turn_damping(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Torque -c_x w_x, -c_y w_y of the air on a body that turns; that about z is `rotor_drag`'s."""
    del vehicle
    rows = {"x": MX, "y": MY}
    return {
        f"turn_damping_{axis}": _block(layout, {(row, f"w{axis}"): 1.0})
        for axis, row in rows.items()
    }


def inflow(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Thrust -k_u O_i u_i n_i at r_i, u_i being the velocity of a rotor along its axis.

    In a climb all rotors lose, in a roll those that rise: it damps both.
    """
    del vehicle
    if "vx" not in layout:
        return {}
    rows = {"Fx": FX, "Fy": FY, "Fz": FZ, "Mx": MX, "My": MY, "Mz": MZ}
    entries = {(row, f"Ou_{at}"): 1.0 for at, row in rows.items() if f"Ou_{at}" in layout}
    return {"inflow": _block(layout, entries)}


def translational_lift(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Thrust k_h (v_x^2 + v_y^2) along z that all rotors together gain in forward flight."""
    del vehicle
    if "vx" not in layout:
        return {}
    return {"translational_lift": _block(layout, {(FZ, "vxy2"): -1.0})}


def constant_wrench(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Force and torque that do not change: what an accelerometer bias leaves, or a trim."""
    del vehicle
    names = ("Fx_0", "Fy_0", "Fz_0", "Mx_0", "My_0", "Mz_0")
    return {name: _block(layout, {(row, "one"): -1.0}) for row, name in enumerate(names)}


EFFECTS: dict[str, Callable[[Vehicle, SignalLayout], dict[str, Block]]] = {
    "mass": body_mass,
    "first_moments": body_first_moments,
    "inertia": body_inertia,
    "thrust": rotor_thrust,
    "torque": rotor_torque,
    "rotor_inertia": rotor_inertia,
    "rotor_center": rotor_center,
    "twist": twist,
    "rotor_drag": rotor_drag,
    "drag": frame_drag,
    "climb_drag": climb_drag,
    "turn_damping": turn_damping,
    "inflow": inflow,
    "translational_lift": translational_lift,
    "constant_wrench": constant_wrench,
}
"""Every effect of the model by name, in the order of its parameters."""


def imu_lever(vehicle: Vehicle, layout: SignalLayout) -> Float[np.ndarray, "z z"]:
    """Return the map from signals with the force at the IMU to signals with it at the origin.

    For an IMU at p the accelerometer reads alpha + dw x p + w x (w x p), which is linear in the
    signals of the same sample.
    """
    lever = np.eye(len(layout))
    p = vehicle.imu_position
    if p is None:
        return lever
    moved = body_first_moments(vehicle, layout)
    for component, name in zip(p, ("msx", "msy", "msz"), strict=True):
        lever[:3] -= component * moved[name][:3]
    return lever


def _block(layout: SignalLayout, entries: Mapping[tuple[int, str], float]) -> Block:
    block = np.zeros((6, len(layout)))
    for (row, name), value in entries.items():
        block[row, layout.index(name)] = value
    return block
