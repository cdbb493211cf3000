"""Terms of the rotors: thrust, torques about their axes, where they sit and how they are tilted."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.airborne import GRAVITY
from rotorfit.model.signals import AddedSignals, SignalLayout, aligned
from rotorfit.model.terms.term import (
    MX,
    MY,
    MZ,
    Move,
    ParameterInfo,
    Significance,
    Size,
    Term,
    block,
)

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.flight.flight_data import FlightData
    from rotorfit.model.terms.term import Block
    from rotorfit.model.vehicle import Rotor, Vehicle

DRAG_SIGNALS: Final[tuple[str, ...]] = ("Od_Fx", "Od_Fy", "Od_Fz", "Od_Mx", "Od_My", "Od_Mz")
MOST_ROTORS: Final = 16
ROTOR_SPREAD_STD: Final = 0.04
"""Thrust coefficients of one vehicle's rotors differ by about this share: new propellers by 1 or
2 %, one rotor of a 3-inch quadrotor by 7 % in flight after flight."""
GROUP_SPREAD_STD: Final = 0.1
"""Thrust coefficients of groups that the user declares differ by about this share: lower rotors
in the wake of upper ones, other propellers."""
TWIST_STD: Final = np.radians(2.0)
"""Prior deviation of the motors' mean tilt about their arms [rad]."""
MOUNTING_STD: Final = np.radians(0.5)
"""Prior deviation of the turn of an IMU against the rotors about each axis [rad]."""
ROTOR_DRAG_STD: Final = 0.3
"""The rotors' drag over mass and velocity is of this size before the flight [1/s]: 0.54 forward and
0.39 sideways of a racing quadrotor (Faessler, Franchi and Scaramuzza 2018)."""

LINEAR_TORQUE_STD: Final = 0.03
"""Prior deviation of the drag torque in proportion to speed: all rotors in hover, as a
share of the weight at the end of an arm. It is a third of a usual drag torque, which is a tenth of
that. On 25 flights of a 3-inch quadrotor the torque went with the speed to the power of 1.7: a
share of 0.3."""


def rotor_thrust(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Thrust k_t O^2 n_i at r_i: one coefficient for all rotors, and one of each rotor's own."""
    blocks: dict[str, Block] = {"kt": block(layout, {})}
    n = vehicle.axes
    wrenches = -np.concatenate([n, vehicle.levers], axis=1)
    for i, wrench in enumerate(wrenches):
        own = block(layout, {})
        own[:, layout.index(f"O2_{i + 1}")] = wrench
        blocks[f"kt_{i + 1}"] = own
        blocks["kt"] = blocks["kt"] + own
    return blocks


def rotor_torque(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Drag torque -s_i k_d O^2 n_i."""
    out = block(layout, {})
    for i, (s, n) in enumerate(zip(vehicle.spins, vehicle.axes, strict=True)):
        out[MX:, layout.index(f"O2_{i + 1}")] = s * n
    return {"kd": out}


def rotor_inertia(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Spin-up reaction and gyroscopic torque -J_r (dH/dt + w x H)."""
    del vehicle
    out = block(layout, {})
    for row, axis in ((MX, "x"), (MY, "y"), (MZ, "z")):
        for name in (f"dH{axis}", f"wxH_{axis}"):
            if name in layout:
                out[row, layout.index(name)] = 1.0
    return {"Jr": out}


def rotor_center(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Rotors displaced together by t: torque t x thrust, parameters k_t t_x, k_t t_y, k_t t_z."""
    blocks: dict[str, Block] = {}
    columns = [layout.index(f"O2_{i + 1}") for i in range(len(vehicle.rotors))]
    for axis, direction in zip("xyz", np.eye(3), strict=True):
        out = block(layout, {})
        out[MX:, columns] = -np.cross(direction, vehicle.axes).T
        blocks[f"kt_rotor_center_{axis}"] = out
    return blocks


def twist(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Rotors tilted about their arms: yaw torque k_t twist sum O^2, parameter k_t times twist."""
    out = block(layout, {})
    for i in range(len(vehicle.rotors)):
        out[MZ, layout.index(f"O2_{i + 1}")] = -1.0
    return {"kt_twist": out}


def imu_mounting(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Rotors turned together about the IMU by small angles: all their forces and moments.

    Parameters are each angle times k_t, k_d and J_r.
    """
    blocks: dict[str, Block] = {}
    of_rotors = {
        "kt": rotor_thrust(vehicle, layout)["kt"],
        **rotor_torque(vehicle, layout),
        **rotor_inertia(vehicle, layout),
    }
    imu = np.array(vehicle.imu_position or (0.0, 0.0, 0.0))
    for name, entries in of_rotors.items():
        force, torque = entries[:MX].T, entries[MX:].T
        for axis, direction in zip("xyz", np.eye(3), strict=True):
            turned = np.cross(direction, torque) - np.cross(np.cross(direction, imu), force)
            blocks[f"{name}_mounting_{axis}"] = np.vstack([np.cross(direction, force).T, turned.T])
    return blocks


def rotor_drag(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Force -c O_i v_i on each rotor, v_i its velocity in its plane, and the torque of these.

    In proportion to a rotor's speed and to its velocity through the air (Faessler, Franchi and
    Scaramuzza, IEEE Robotics and Automation Letters 3(2), 2018). Where the velocity is not known,
    the yaw torque of the turn alone; where positions show it between their fixes, that torque with
    what carries the rotors.
    """
    if DRAG_OF_ROTORS in layout.added:
        entries = {(DRAG_SIGNALS.index(name), name): 1.0 for name in rotor_drag_names(vehicle)}
        return {"rotor_drag": block(layout, entries)}
    signals = ("wzO", "Ov_Mz") if "Ov_Mz" in layout else ("wzO",)
    return {"rotor_drag": block(layout, {(MZ, name): 1.0 for name in signals})}


def carried_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the name of the torque by the body's velocity."""
    del vehicle
    return ("Ov_Mz",)


def carried_columns(flight: FlightData, rows: slice, vehicle: Vehicle) -> Float[np.ndarray, "n 1"]:
    """Return sum O_i (x_i v_y - y_i v_x) [rad m^2/s^2]; zero in a stretch without velocity."""
    O, v = flight.rotor_speed[rows], known_rows(flight.carried, rows, flight.angular_velocity[rows])
    x, y = (O @ vehicle.positions[:, k] for k in (0, 1))
    return (x * v[:, 1] - y * v[:, 0])[:, None]


CARRIED: Final = AddedSignals(
    name="carried", names=carried_names, of_rotors=carried_columns, sloped=False
)


def yaw_damping(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Yaw torque -b w_z sum O_i (x_i^2 + y_i^2) beside that of the rotors' drag.

    What forces show of drag is the frame's, too, which turns nothing: it must not say how yaw is
    damped, on which k_d and I_zz rest.
    """
    del vehicle
    return {"yaw_damping": block(layout, {(MZ, "wzO"): 1.0})}


def rotor_drag_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the components of the rotors' drag that do not vanish."""
    if not aligned(vehicle):
        return DRAG_SIGNALS
    level = not vehicle.positions[:, 2].any()
    return ("Od_Fx", "Od_Fy", "Od_Mz") if level else ("Od_Fx", "Od_Fy", "Od_Mx", "Od_My", "Od_Mz")


def rotor_drag_columns(
    flight: FlightData, rows: slice, vehicle: Vehicle
) -> Float[np.ndarray, "n d"]:
    """Return sum O_i (v_i, r_i x v_i), v_i the velocity of a rotor across its axis [m rad/s^2]."""
    moving, n = rotor_velocities(flight, flight.any_velocity, rows, vehicle), vehicle.axes
    across = moving - (moving * n).sum(axis=2)[:, :, None] * n
    drag = flight.rotor_speed[rows][:, :, None] * across
    # r x F = sum F_k (r x e_k), of all rotors at once.
    levers = np.cross(vehicle.positions[:, None], np.eye(3)).reshape(-1, 3)
    wrench = np.hstack([drag.sum(axis=1), drag.reshape(len(drag), -1) @ levers])
    return wrench[:, [DRAG_SIGNALS.index(name) for name in rotor_drag_names(vehicle)]]


def known_rows(
    velocity: Float[np.ndarray, "n 3"] | None, rows: slice, like: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, "m 3"]:
    """Return rows of a velocity; zeros `like` others in a stretch that has none.

    What the air does there is not in the model, and the other flights keep their terms.
    """
    if velocity is None or not np.isfinite(velocity[rows]).all():
        return np.zeros_like(like)
    return velocity[rows]


def rotor_velocities(
    flight: FlightData, velocity: Float[np.ndarray, "n 3"] | None, rows: slice, vehicle: Vehicle
) -> Float[np.ndarray, "m N 3"]:
    """Compute the velocity v + w x r of each rotor, of a body with a velocity [m/s]."""
    w = flight.angular_velocity[rows]
    # w x r = sum w_k (e_k x r), of all rotors at once.
    levers = np.cross(np.eye(3)[:, None], vehicle.positions)
    return known_rows(velocity, rows, w)[:, None] + np.tensordot(w, levers, axes=1)


DRAG_OF_ROTORS: Final = AddedSignals(
    name="rotor_drag", names=rotor_drag_names, of_rotors=rotor_drag_columns, sloped=False
)


def linear_torque(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Drag torque -s_i k_l O_i n_i in proportion to speed, as at low Reynolds numbers."""
    del vehicle
    entries = {
        (row, f"sO_{axis}"): 1.0
        for row, axis in ((MX, "x"), (MY, "y"), (MZ, "z"))
        if f"sO_{axis}" in layout
    }
    return {"kd_linear": block(layout, entries)}


def spin_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the components of sum s_i O_i n_i that do not vanish."""
    return ("sO_z",) if aligned(vehicle) else ("sO_x", "sO_y", "sO_z")


def spin_columns(flight: FlightData, rows: slice, vehicle: Vehicle) -> Float[np.ndarray, "n k"]:
    """Return sum s_i O_i n_i, speeds along the axes that the rotors spin about [rad/s]."""
    axes = vehicle.spins[:, None] * vehicle.axes
    return flight.rotor_speed[rows] @ (axes[:, 2:] if aligned(vehicle) else axes)


SPIN: Final = AddedSignals(name="spin", names=spin_names, of_rotors=spin_columns)


def rotor_drag_std(size: Size) -> float:
    """Compute the prior deviation of the rotors' drag [N s^2/(m rad)]."""
    return ROTOR_DRAG_STD * size.mass / size.speeds


def spread_std(rotor: Rotor) -> float:
    """Compute the prior deviation of a rotor's own share of k_t."""
    return ROTOR_SPREAD_STD if rotor.group is None else GROUP_SPREAD_STD


def _thrust_parameter(rotor: str) -> ParameterInfo:
    return ParameterInfo(
        "N s^2/rad^2",
        1,
        f"thrust coefficient of {rotor}",
        title=f"Thrust coefficient of {rotor}",
        effective_unit="N per squared command",
        speed_power=2,
    )


def _drag_parameter(meaning: str, title: str) -> ParameterInfo:
    """Return a coefficient over a rotor's speed and its velocity across its axis."""
    return ParameterInfo(
        "N s^2/(m rad)",
        1,
        meaning,
        title=title,
        effective_unit="N s/m per command",
        speed_power=1,
        motion="yaw",
        on_yaw_scale=True,
        relevant=rotor_drag_std,
        prior=rotor_drag_std,
        step=rotor_drag_std,
    )


def _yaw_damping(drawn: Float[np.ndarray, " D"], vehicle: Vehicle) -> dict[str, np.ndarray]:
    """Return the damping of a replay by draws of such a coefficient."""
    return {"damping": drawn[:, None] * vehicle.squared_arms}


THRUST: Final = Term(
    name="thrust",
    parameters={"kt": replace(_thrust_parameter("a rotor"), between_flights="air")},
    owner="shared",
    entries=rotor_thrust,
)
TORQUE: Final = Term(
    name="torque",
    parameters={
        "kd": ParameterInfo(
            "N m s^2/rad^2",
            1,
            "drag torque coefficient of a rotor",
            title="Drag torque coefficient of a rotor",
            effective_unit="N m per squared command",
            speed_power=2,
            motion="yaw",
            on_yaw_scale=True,
            between_flights="air",
        )
    },
    owner="shared",
    entries=rotor_torque,
)
ROTOR_INERTIA: Final = Term(
    name="rotor_inertia",
    words="the spin inertia of the rotors (Jr)",
    when="default",
    parameters={
        "Jr": ParameterInfo(
            "kg m^2",
            1,
            "spin inertia of a rotor with its motor bell",
            title="Spin inertia of a rotor",
            effective_unit="N m s per command",
            speed_power=1,
            motion="yaw",
            on_yaw_scale=True,
            relevant=lambda s: abs(s.moments[2]) / 1000.0,
        )
    },
    owner="shared",
    entries=rotor_inertia,
    dropped=3,
)
ROTOR_SPREAD: Final = Term(
    name="rotor_spread",
    words="a thrust coefficient of each rotor's own (kt_1, kt_2, ...)",
    when="default",
    parameters={f"kt_{i}": _thrust_parameter(f"rotor {i}") for i in range(1, MOST_ROTORS + 1)},
    owner="rotor",
    dropped=4,
)
ROTOR_CENTER: Final = Term(
    name="rotor_center",
    parameters={
        f"rotor_center_{axis}": ParameterInfo(
            "m",
            0,
            "centre of the rotors from the origin",
            title=f"Rotor centre from the IMU, {words}",
            motion="place",
            relevant=lambda s: s.arm / 50.0,
            step=lambda s: s.arm,
        )
        for axis, words in (("x", "forward"), ("y", "to the left"))
    },
    owner="configuration",
    entries=rotor_center,
    moves=tuple(Move(f"kt_rotor_center_{a}", f"rotor_center_{a}", "kt") for a in "xy"),
    needs="unknown origin",
)
TWIST: Final = Term(
    name="twist",
    words="a yaw torque in proportion to thrust, of motors tilted about their arms",
    when="default",
    parameters={
        "twist": ParameterInfo(
            "m",
            0,
            "yaw torque over thrust: mean tilt about the arms, times arm",
            title="Yaw torque over thrust (motors tilted about their arms)",
            on_yaw_scale=True,
            relevant=lambda s: s.arm / 50.0,  # a degree
            prior=lambda s: TWIST_STD * s.arm,
            step=lambda s: s.arm,
        )
    },
    owner="configuration",
    entries=twist,
    moves=(Move("kt_twist", "twist", "kt"),),
    dropped=2,
    replayed=lambda values, vehicle: {
        "torque": (values["kt"] * values["twist"])[:, None, None] * np.array([0.0, 0.0, 1.0])
    },
)
IMU_MOUNTING: Final = Term(
    name="imu_mounting",
    words="an IMU mounted turned by a small angle against the rotors",
    when="default",
    parameters={
        f"mounting_{axis}": ParameterInfo(
            "rad",
            0,
            f"turn of the rotors about {axis} in the IMU's axes",
            title=f"Turn of the rotors about {axis} in the IMU's axes",
            prior=lambda s: MOUNTING_STD,
            step=lambda s: 10.0 * MOUNTING_STD,
        )
        for axis in "xyz"
    },
    owner="shared",
    entries=imu_mounting,
    moves=tuple(
        Move(f"{name}_mounting_{a}", f"mounting_{a}", name)
        for name in ("kt", "kd", "Jr")
        for a in "xyz"
    ),
    dropped=0,
    # It shows where the sensor sits, but motors that all lean alike look the same.
    reported=False,
)
ROTOR_DRAG: Final = Term(
    name="rotor_drag",
    words="the drag of rotors that move sideways through the air",
    when="default",
    parameters={
        "rotor_drag": replace(
            _drag_parameter(
                "in-plane drag of a rotor over its speeds",
                "In-plane drag of a rotor over its two speeds",
            ),
            form_error=0.05,  # six flights of a racing quadrotor: 3.8 to 4.35e-5
        )
    },
    owner="shared",
    entries=rotor_drag,
    carried=(CARRIED,),
    with_velocity=(DRAG_OF_ROTORS,),
    dropped=1,
    replayed=lambda values, vehicle: _yaw_damping(values["rotor_drag"], vehicle),
)
YAW_DAMPING: Final = Term(
    name="yaw_damping",
    words="a damping of yaw beside the drag of the rotors",
    when="default",
    parameters={
        "yaw_damping": _drag_parameter(
            "damping of yaw beside a rotor's drag, over its speed and squared arm",
            "Damping of yaw beside the drag of the rotors",
        )
    },
    owner="shared",
    entries=yaw_damping,
    needs="velocity",
    signals=(DRAG_OF_ROTORS,),
    dropped=7,
    replayed=lambda values, vehicle: _yaw_damping(values["yaw_damping"], vehicle),
)
LINEAR_DRAG_TORQUE: Final = Term(
    name="linear_drag_torque",
    words="a drag torque of the rotors in proportion to their speed",
    when="declared",
    parameters={
        "kd_linear": ParameterInfo(
            "N m s/rad",
            1,
            "drag torque of a rotor over its speed",
            title="Drag torque of a rotor over its speed",
            effective_unit="N m per command",
            speed_power=1,
            motion="yaw",
            on_yaw_scale=True,
            # A tenth of a usual drag torque in hover.
            relevant=lambda s: 0.01 * s.mass * GRAVITY * s.arm / s.speeds,
            prior=lambda s: LINEAR_TORQUE_STD * s.mass * GRAVITY * s.arm / s.speeds,
        )
    },
    owner="shared",
    entries=linear_torque,
    signals=(SPIN,),
    significance=Significance(parameters=("kd_linear",), least=lambda s: s.trace_torque / s.speeds),
    replayed=lambda values, vehicle: {
        "speed_torque": -values["kd_linear"][:, None, None] * vehicle.spins[:, None] * vehicle.axes
    },
)
