"""Terms of the air, besides thrust and torque of rotors that stand still in it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import FlightError
from rotorfit.flight.airborne import GRAVITY
from rotorfit.model.signals import AddedSignals, SignalLayout, aligned
from rotorfit.model.terms.rotors import known_rows, rotor_drag_std, rotor_velocities
from rotorfit.model.terms.term import (
    FX,
    FY,
    FZ,
    MX,
    MY,
    MZ,
    Motion,
    ParameterInfo,
    Significance,
    Term,
    block,
)

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.flight.flight_data import FlightData
    from rotorfit.model.terms.term import Block
    from rotorfit.model.vehicle import Vehicle

CLIMB_DRAG_STD: Final = 0.5
"""Prior deviation of the air's force against a climb, over mass and velocity [1/s]: drag
of the frame and thrust that the rotors lose."""
CLIMB_PLACE_STD: Final = 0.25
"""Prior deviation of the place of that force, over the arm: the frame's at the centre of
mass or above it, the rotors' between them."""
DRAG_STD: Final = 0.3
"""Prior deviation of the torque of drag: that of drag of this size over mass and velocity
[1/s] at the end of an arm."""
DAMPING_STD: Final = 0.3
"""Prior deviation of the damping of a turn: that of drag of this size over mass and
velocity [1/s] at the end of an arm, over its rate."""
FRAME_STD: Final = 0.1
"""Prior deviation of the frame's drag over mass and velocity [1/s], beside that of the rotors: six
flights of a racing quadrotor show none (`THEORY`, fast flight)."""
LONE_STD: Final = 1.0
"""The same where the model has no other drag."""
INFLOW_MEAN: Final = 0.65
INFLOW_STD: Final = 0.4
"""Mean and deviation, before the flight, of the thrust that a climb costs, over mass and velocity
[1/s]: .68 of a racing quadrotor, .4 to .75 in its single flights, none in simulators without."""
WAKE_STD: Final = 0.5
"""Prior deviation of the moment of the rotors' wakes, over density, disk area and arm."""
AIR_DENSITY: Final = 1.2
"""Density of the air [kg/m^3]."""
HALVINGS: Final = 8
NEWTON_STEPS: Final = 4
"""For the induced velocity: halvings of its interval, then steps of Newton's within what is left,
to rounding on 600 000 random velocities."""
LEAST_LOAD: Final = 0.01
"""Least thrust over weight for the induced velocity: momentum theory divides by its root."""
LIFT_STD: Final = 0.05
"""Prior deviation of the thrust that sideways velocity brings: over mass and squared velocity
[1/m], a tenth of the weight at 4 m/s."""
DRAG_NAMES: Final = ("drag_x", "drag_y", "drag_z")
DRAG_MOMENTS: Final = tuple(f"drag_moment_{a}{b}" for a in "xyz" for b in "xyz" if a != b)
INFLOW_SIGNALS: Final = ("Ou_Fx", "Ou_Fy", "Ou_Fz", "Ou_Mx", "Ou_My", "Ou_Mz")


def velocity_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the names of the velocity's signals."""
    del vehicle
    return "vx", "vy", "vz", "vxy2"


def velocity_columns(flight: FlightData, rows: slice) -> Float[np.ndarray, "n 4"]:
    """Return the velocity of the origin [m/s], and its square across z."""
    v = _known_velocity(flight, rows)
    return np.column_stack([v, (v[:, :2] ** 2).sum(axis=1)])


def climb_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the name of the felt velocity along z."""
    del vehicle
    return ("climb",)


def climb_columns(flight: FlightData, rows: slice) -> Float[np.ndarray, "n 1"]:
    """Return the velocity along z that the IMU feels [m/s]."""
    if flight.climb is None:
        raise FlightError("the velocity along z was not made of accelerometer and gyro")
    return flight.climb[rows][:, None]


def inflow_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the components of a wrench sum O_i u_i (n_i, r_i x n_i) that do not vanish."""
    return ("Ou_Fz", "Ou_Mx", "Ou_My") if aligned(vehicle) else INFLOW_SIGNALS


def inflow_columns(flight: FlightData, rows: slice, vehicle: Vehicle) -> Float[np.ndarray, "n i"]:
    """Compute the signals of air through the rotors, with rotor i's velocity u_i along its axis."""
    n, (through, _) = vehicle.axes, _air_through_rotors(flight, rows, vehicle)
    wrenches = (flight.rotor_speed[rows] * through) @ np.hstack([n, vehicle.levers])
    names = inflow_names(vehicle)
    return wrenches[:, [i for i, name in enumerate(INFLOW_SIGNALS) if name in names]]


def _air_through_rotors(
    flight: FlightData, rows: slice, vehicle: Vehicle
) -> tuple[Float[np.ndarray, "n N"], Float[np.ndarray, " n"]]:
    """Return the air through each rotor beyond that in still air, and the mean induced velocity.

    In still air the rotors induce more, the more thrust they give: v_h is that of hover times the
    root of thrust over weight. In a pull-up at 2 g it is 1.4 times that of hover.
    """

    def make() -> tuple[Float[np.ndarray, "n N"], Float[np.ndarray, " n"]]:
        moving, n = rotor_velocities(flight, flight.velocity, rows, vehicle), vehicle.axes
        along = (moving * n).sum(axis=2)
        if flight.hover_inflow is None:
            # Without the mass the velocity of hover is not known, and no share of it either.
            return along, np.zeros(len(along))
        across = np.sqrt(((moving - along[:, :, None] * n) ** 2).sum(axis=2))
        held = flight.hover_inflow * np.sqrt(thrust_over_weight(flight, rows))[:, None]
        induced = induced_velocity(across, along, held)
        return along + induced - held, induced.mean(axis=1)

    made_of = (
        flight.velocity,
        flight.angular_velocity,
        flight.rotor_speed,
        flight.hover_inflow,
        vehicle,
    )
    return flight.of_motion(f"air through rotors, {rows.start} to {rows.stop}", made_of, make)


def thrust_over_weight(flight: FlightData, rows: slice) -> Float[np.ndarray, " n"]:
    """Return the rotors' thrust over the weight, from their speeds alone.

    Their squares are scaled to the mean specific force of the flight: that needs no thrust
    coefficient, and the errors of single accelerations stay out of the signals.
    """
    used, squares = flight.used_rows, (flight.rotor_speed**2).mean(axis=1)
    scale = flight.specific_force[used, 2].mean() / (GRAVITY * squares[used].mean())
    load: Float[np.ndarray, " n"] = np.maximum(scale * squares[rows], LEAST_LOAD)
    return load


def induced_velocity(
    across: Float[np.ndarray, "*n"],
    along: Float[np.ndarray, "*n"],
    hover: float | Float[np.ndarray, "*#n"],
) -> Float[np.ndarray, "*n"]:
    """Solve Glauert's v_i = v_h^2 / sqrt(v_perp^2 + (u + v_i)^2) for the induced velocity [m/s].

    `across`, `along`: velocity of a rotor across its axis and along it. `hover`: v_h, the induced
    velocity of the same thrust in still air. There is one
    root where u is above -sqrt(8) v_perp or -v_h / 2, and the air may go through the disk from
    below (braking at speed). Momentum theory has no sense in a steeper descent (vortex ring): there
    u counts as -v_h / 2, to which flights agree with it (Leishman, Principles of Helicopter
    Aerodynamics, 2006, 2.13; Glauert 1935), or -2 v_perp.
    """
    # sqrt(8) v_perp would still have one root: 2 keeps away from where its slope is endless.
    u = np.maximum(along, -np.maximum(0.5 * hover, 2.0 * across))
    low, high = np.zeros_like(u), np.maximum(-u, 0.0) + 1.01 * hover
    squared = across**2
    # Newton alone may leave where the root is: halvings bring it near first.
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        above = middle * np.sqrt(squared + (u + middle) ** 2) > hover**2
        high, low = np.where(above, middle, high), np.where(above, low, middle)
    found = 0.5 * (low + high)
    for _ in range(NEWTON_STEPS):
        through = u + found
        speed = np.sqrt(squared + through**2)
        step = (found * speed - hover**2) * speed / (speed**2 + found * through)
        found = np.clip(found - step, low, high)
    return found


def hover_inflow(mass: float, vehicle: Vehicle) -> float:
    """Compute the velocity of the air through the rotors' disks in hover [m/s]."""
    # Momentum theory: v_h = sqrt(m g / (2 rho A)), A the area of all disks.
    return float(np.sqrt(mass * GRAVITY / (2.0 * AIR_DENSITY * vehicle.disk_area)))


def wake_names(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the names of the wakes' signals."""
    del vehicle
    return "wake_x", "wake_y"


def wake_columns(flight: FlightData, rows: slice, vehicle: Vehicle) -> Float[np.ndarray, "n 2"]:
    """Return the velocity of the body, x and y, times the rotors' mean induced one [m^2/s^2]."""
    _, induced = _air_through_rotors(flight, rows, vehicle)
    return _known_velocity(flight, rows)[:, :2] * induced[:, None]


def _known_velocity(flight: FlightData, rows: slice) -> Float[np.ndarray, "n 3"]:
    """Return the velocity of the body [m/s]; zero in a stretch that has none."""
    return known_rows(flight.velocity, rows, flight.angular_velocity[rows])


VELOCITY: Final = AddedSignals(name="velocity", names=velocity_names, of_body=velocity_columns)
CLIMB: Final = AddedSignals(name="climb", names=climb_names, of_body=climb_columns)
INFLOW_OF_ROTORS: Final = AddedSignals(
    name="inflow", names=inflow_names, of_rotors=inflow_columns, sloped=False
)
WAKES: Final = AddedSignals(name="wake", names=wake_names, of_rotors=wake_columns, sloped=False)


def climb_drag(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Force -d v_z over the velocity along z that the IMU feels, and its torques: it acts anywhere.

    Drag and inflow look the same. With its place at the origin, the flights would show the centre
    of mass by the torque of a force that acts there in truth.
    """
    del vehicle
    return {
        "climb_drag": block(layout, {(FZ, "climb"): 1.0}),
        "climb_moment_x": block(layout, {(MX, "climb"): 1.0}),
        "climb_moment_y": block(layout, {(MY, "climb"): 1.0}),
    }


def frame_drag(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Drag -d v along each body axis, wherever it acts.

    ``drag_moment_xy`` is the torque about x per velocity along y, and the force along y per rate
    about x: at r it is r_z d_y, the torque of -d_y v_y and the drag of the velocity w_x r_z there.
    Both are sums over all that is dragged, so that one number is enough for each. The torque
    against a rate, of second order in r, is left out.
    """
    del vehicle
    rows = dict(zip("xyz", (FX, FY, FZ), strict=True))
    blocks = {f"drag_{a}": block(layout, {(rows[a], f"v{a}"): 1.0}) for a in "xyz"}
    torques = dict(zip("xyz", (MX, MY, MZ), strict=True))
    for name in DRAG_MOMENTS:
        about, along = name[-2:]
        both = {(torques[about], f"v{along}"): -1.0, (rows[along], f"w{about}"): -1.0}
        blocks[name] = block(layout, both)
    return blocks


def turn_damping(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Torque -c_x w_x, -c_y w_y of the air on a body that turns; that about z is `rotor_drag`'s."""
    del vehicle
    rows = {"x": MX, "y": MY}
    return {
        f"turn_damping_{axis}": block(layout, {(row, f"w{axis}"): 1.0})
        for axis, row in rows.items()
    }


def inflow(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Thrust -k_u O_i (u_i + v_i - v_h) n_i at r_i, u_i being a rotor's velocity along its axis.

    v_i is its induced velocity, v_h that of the same thrust in still air: what flows through the
    disk more than there takes thrust from it. In a climb all rotors lose, in a roll those that
    rise: it damps both; in forward flight v_i falls, and they gain (translational lift).
    """
    del vehicle
    rows = {"Fx": FX, "Fy": FY, "Fz": FZ, "Mx": MX, "My": MY, "Mz": MZ}
    entries = {(row, f"Ou_{at}"): 1.0 for at, row in rows.items() if f"Ou_{at}" in layout}
    return {"inflow": block(layout, entries)}


def translational_lift(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Thrust k_h (v_x^2 + v_y^2) along z that all rotors together gain in forward flight."""
    del vehicle
    return {"translational_lift": block(layout, {(FZ, "vxy2"): -1.0})}


def wake_moment(vehicle: Vehicle, layout: SignalLayout) -> dict[str, Block]:
    """Torque that lifts the side towards which the vehicle moves: in proportion to v_i v.

    The wakes of the front rotors take lift from the rear ones, and each rotor's own wake tilts its
    lift forward (Bauersfeld et al., RSS 2021, "NeuroBEM").
    """
    del vehicle
    return {
        "wake_moment_x": block(layout, {(MX, "wake_y"): -1.0}),
        "wake_moment_y": block(layout, {(MY, "wake_x"): 1.0}),
    }


def _drag_parameter(axis: str, words: str) -> ParameterInfo:
    return ParameterInfo(
        "N s/m",
        1,
        "air drag of the frame over its velocity",
        title=f"Air drag of the frame, {words}",
        motion="air",
        relevant=lambda s: 0.3 * s.mass,  # of a small multirotor: a tenth of its weight at 3 m/s
        prior=lambda s: (FRAME_STD if s.rotors_dragged else LONE_STD) * s.mass,
        velocity_axis="xyz".index(axis),
    )


def _drag_moment(about: str, along: str) -> ParameterInfo:
    return ParameterInfo(
        "N s",
        1,
        f"torque of the air about {about} over velocity {along}",
        title=f"Torque of the air about {about} per velocity along {along}",
        motion="air",
        # At 3 m/s as of a CoM that is arm / 150 off.
        relevant=lambda s: 0.3 * s.mass * s.arm / 5.0,
        # A velocity that hardly changes looks like a CoM elsewhere: this much, and no more.
        prior=lambda s: DRAG_STD * s.mass * s.arm,
    )


def _climb_moment(axis: str) -> ParameterInfo:
    return ParameterInfo(
        "N s",
        1,
        f"torque about {axis} of that force over the felt velocity",
        title=f"Torque about {axis} per felt velocity along z",
        prior=lambda s: CLIMB_DRAG_STD * CLIMB_PLACE_STD * s.mass * s.arm,
    )


CLIMB_DRAG: Final = Term(
    name="climb_drag",
    words="a force against the velocity along z that accelerometer and gyro feel",
    when="default",
    parameters={
        "climb_drag": ParameterInfo(
            "N s/m",
            1,
            "force against the felt velocity along z",
            title="Force against the felt velocity along z",
            prior=lambda s: CLIMB_DRAG_STD * s.mass,
        ),
        **{f"climb_moment_{axis}": _climb_moment(axis) for axis in "xy"},
    },
    owner="configuration",
    entries=climb_drag,
    needs="climb",
    signals=(CLIMB,),
    dropped=5,
    one_sided=("climb_drag",),
    # Over a velocity that is felt, not known: mentioned, but no finding with an interval.
    reported=False,
)
DRAG: Final = Term(
    name="drag",
    words="air drag of the frame, in proportion to its velocity",
    when="likelihood",
    parameters={
        "drag_x": _drag_parameter("x", "forward"),
        "drag_y": _drag_parameter("y", "to the left"),
        "drag_z": _drag_parameter("z", "up"),
        **{name: _drag_moment(name[-2], name[-1]) for name in DRAG_MOMENTS},
    },
    owner="configuration",
    entries=frame_drag,
    needs="velocity",
    signals=(VELOCITY,),
    # To a side: a height controller that opposes gusts looks like drag along z.
    significance=Significance(parameters=DRAG_NAMES[:2], least=lambda s: s.trace_force),
)
LEAST_DAMPING: Final = 0.02
"""Damping over mass times arm squared, below which it is of no account [1/s]: turns that die out
in a quarter of a minute, and look early by .2 ms at 3 Hz."""
TURNS: Final[tuple[tuple[str, Motion], ...]] = (("x", "roll"), ("y", "pitch"))
TURN_DAMPING: Final = Term(
    name="turn_damping",
    words="damping of roll and pitch, in proportion to their rates",
    when="likelihood",
    parameters={
        f"turn_damping_{axis}": ParameterInfo(
            "N m s",
            1,
            f"torque of the air over the rate about {axis}",
            title=f"Damping of {turn} by the air",
            motion=turn,
            relevant=lambda s: 0.3 * s.mass * s.arm**2,
            prior=lambda s: DAMPING_STD * s.mass * s.arm**2,
        )
        for axis, turn in TURNS
    },
    owner="configuration",
    entries=turn_damping,
    significance=Significance(
        parameters=("turn_damping_x", "turn_damping_y"),
        least=lambda s: LEAST_DAMPING * s.mass * s.arm**2,
    ),
)
INFLOW: Final = Term(
    name="inflow",
    words="thrust that falls as more air flows through the rotors",
    when="default",
    parameters={
        "inflow": ParameterInfo(
            "N s^2/(m rad)",
            1,
            "thrust lost over rotor speed and climb",
            title="Thrust lost over rotor speed and climb",
            effective_unit="N s/m per command",
            speed_power=1,
            motion="air",
            relevant=rotor_drag_std,
            prior=lambda s: INFLOW_STD * s.mass / s.speeds,
            prior_mean=lambda s: INFLOW_MEAN * s.mass / s.speeds,
            form_error=0.2,  # six flights of a racing quadrotor: .74 to 1.26e-4
            velocity_axis=2,
        )
    },
    owner="shared",
    entries=inflow,
    needs="velocity",
    signals=(VELOCITY, INFLOW_OF_ROTORS),
    air_at_rotors=True,
    dropped=6,
)
TRANSLATIONAL_LIFT: Final = Term(
    name="translational_lift",
    words="thrust that rises with the square of the sideways velocity",
    when="likelihood",
    parameters={
        "translational_lift": ParameterInfo(
            "N s^2/m^2",
            1,
            "thrust over the squared sideways speed",
            title="Thrust over the squared sideways velocity",
            motion="air",
            relevant=lambda s: 0.1 * s.mass,  # a tenth of the weight at 3 m/s
            prior=lambda s: LIFT_STD * s.mass,
        )
    },
    owner="shared",
    entries=translational_lift,
    needs="velocity",
    signals=(VELOCITY,),
    air_at_rotors=True,
    significance=Significance(parameters=("translational_lift",), least=lambda s: s.trace_force),
)
WAKE_MOMENT: Final = Term(
    name="wake_moment",
    words="a torque of the rotors' wakes that lifts the side towards which the vehicle moves",
    when="likelihood",
    parameters={
        f"wake_moment_{axis}": ParameterInfo(
            "N s^2/m",
            1,
            f"torque about {axis} over the velocity and the rotors' induced one",
            title=f"Torque of the wakes in {turn}",
            motion="air",
            relevant=lambda s: 0.3 * s.mass * s.arm / 25.0,
            prior=lambda s: WAKE_STD * AIR_DENSITY * s.disk_area * s.arm,
            form_error=0.15,  # six flights of a racing quadrotor: .0028 to .0038 in pitch
        )
        for axis, turn in TURNS
    },
    owner="shared",
    entries=wake_moment,
    needs="velocity",
    signals=(VELOCITY, WAKES),
    air_at_rotors=True,
    significance=Significance(
        parameters=("wake_moment_x", "wake_moment_y"), least=lambda s: s.trace_torque / 5.0
    ),
)
