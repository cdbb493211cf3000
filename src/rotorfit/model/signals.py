"""The signals of a flight: the few columns in which every equation of the model is linear.

z = (specific force 3, angular acceleration 3, rate products 6, rotor speeds squared N, rotor spin
terms, yaw rate times rotor speeds and squared arms, rates 3, and where the velocity is asked for
velocity 3, its square across z and what inflow takes from the rotors, or the velocity along z
that the IMU feels, 1). The spin terms are dH/dt
and w x H of the rotors' spin H = sum s_i O_i n_i: six with tilted rotors, three where all axes are
z (dH_z/dt, w_y H_z, -w_x H_z; the others vanish).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.errors import FlightError
from rotorfit.model.vehicle import Vehicle
from rotorfit.preprocessing.flight_data import FlightData, Velocity

BODY_SIGNALS = (
    *("ax", "ay", "az"),
    *("dwx", "dwy", "dwz"),
    *("wxwx", "wywy", "wzwz", "wxwy", "wxwz", "wywz"),
)
SPIN_SIGNALS = ("dHx", "dHy", "dHz", "wxH_x", "wxH_y", "wxH_z")
ALIGNED_SPIN_SIGNALS = ("dHz", "wxH_x", "wxH_y")
RATE_SIGNALS = ("wx", "wy", "wz")
BODY_WIDTH: Final[Mapping[Velocity, int]] = {"none": 16, "climb": 17, "known": 20}
"""Signals that the rotors have no part in."""
VELOCITY_SIGNALS = ("vx", "vy", "vz", "vxy2")
INFLOW_SIGNALS = ("Ou_Fx", "Ou_Fy", "Ou_Fz", "Ou_Mx", "Ou_My", "Ou_Mz")
ALIGNED_INFLOW_SIGNALS = ("Ou_Fz", "Ou_Mx", "Ou_My")
"""Of a wrench sum O_i u_i (n_i, r_i x n_i), u_i being the velocity of rotor i along its axis."""
DERIVATIVES = ("dwx", "dwy", "dwz", "dHx", "dHy", "dHz")


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """Which signal stands in which column of Z."""

    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.names)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def index(self, name: str) -> int:
        """Return the column of one signal."""
        return self.names.index(name)


def rotor_columns(layout: SignalLayout, *, inflow: bool = False) -> list[int]:
    """Return the columns that the rotors' speeds stand in, those of the inflow if asked for."""
    made = {*SPIN_SIGNALS, "wzO", *(INFLOW_SIGNALS if inflow else ())}
    return [i for i, name in enumerate(layout.names) if name in made or name.startswith("O2_")]


def body_columns(layout: SignalLayout) -> list[int]:
    """Return the columns that the rotors' speeds do not stand in."""
    made = set(rotor_columns(layout, inflow=True))
    return [i for i in range(len(layout)) if i not in made]


def signal_layout(vehicle: Vehicle, *, velocity: Velocity = "none") -> SignalLayout:
    """Return the signals that the equations of this vehicle need, its velocity if asked for."""
    aligned = bool(np.all(vehicle.axes == [0.0, 0.0, 1.0]))
    squares = tuple(f"O2_{i + 1}" for i in range(len(vehicle.rotors)))
    spin = ALIGNED_SPIN_SIGNALS if aligned else SPIN_SIGNALS
    inflow = ALIGNED_INFLOW_SIGNALS if aligned else INFLOW_SIGNALS
    known: dict[Velocity, tuple[str, ...]] = {
        "none": (),
        "climb": ("climb",),
        "known": (*VELOCITY_SIGNALS, *inflow),
    }
    air = known[velocity]
    return SignalLayout((*BODY_SIGNALS, *squares, *spin, "wzO", *RATE_SIGNALS, *air, "one"))


def signal_matrix(
    flight: FlightData, vehicle: Vehicle, start: int, stop: int, *, velocity: Velocity = "none"
) -> Float[np.ndarray, "n z"]:
    """Return the signals of rows `start` to `stop` (exclusive) of a flight.

    With ``"central"`` derivatives every other column is averaged with [1 4 1]/6, Simpson's rule
    for the mean over the two samples that the difference spans, so that both sides of an equation
    have seen the same filter; the rows next to `start` and `stop` must exist.

    Returns
    -------
    Z
        SI units, columns as in `signal_layout`.

    Raises
    ------
    FlightError
        If the flight does not have these rows, or not their neighbours where they are needed, or
        not its velocity.
    """
    margin = 0 if flight.differentiation == "exact" else 1
    if start < margin or stop > len(flight.time) - margin:
        raise FlightError(
            f"rows {start} to {stop} of a flight of {len(flight.time)} samples with "
            f"{margin} neighbour row on each side do not exist; shorten the segment"
        )
    layout = signal_layout(vehicle, velocity=velocity)
    Z = np.empty((stop - start, len(layout)), order="F")  # written and multiplied by columns
    Z[:, body_columns(layout)] = body_signals(flight, start, stop, velocity=velocity)
    rotors = rotor_signals(flight, vehicle, start, stop, inflow=velocity == "known")
    Z[:, rotor_columns(layout, inflow=True)] = rotors
    return Z


def body_signals(
    flight: FlightData, start: int, stop: int, *, velocity: Velocity = "none"
) -> Float[np.ndarray, "n b"]:
    """Return those columns of `signal_matrix` that the rotors have no part in (`body_columns`)."""
    rows, exact = _with_margin(flight, start, stop)
    w = flight.angular_velocity[rows]
    Z = np.empty((len(w), BODY_WIDTH[velocity]), order="F")
    Z[:, 0:3] = flight.specific_force[rows]
    Z[:, 3:6] = flight.angular_acceleration[rows]
    np.multiply(w, w, out=Z[:, 6:9])
    for column, (i, j) in enumerate(((0, 1), (0, 2), (1, 2)), start=9):
        np.multiply(w[:, i], w[:, j], out=Z[:, column])
    Z[:, 12:15] = w
    if velocity == "climb":
        Z[:, 15] = _felt_climb(flight, rows)
    if velocity == "known":
        v = _known_velocity(flight, rows)
        Z[:, 15:18] = v
        Z[:, 18] = (v[:, :2] ** 2).sum(axis=1)
    Z[:, -1] = 1.0
    return Z if exact else _averaged(Z, [3 <= i < 6 for i in range(Z.shape[1])])


def rotor_signals(
    flight: FlightData, vehicle: Vehicle, start: int, stop: int, *, inflow: bool = False
) -> Float[np.ndarray, "n r"]:
    """Return those columns of `signal_matrix` that rotors' speeds stand in (`rotor_columns`)."""
    rows, exact = _with_margin(flight, start, stop)
    layout = signal_layout(vehicle, velocity="known" if inflow else "none")
    columns = rotor_columns(layout, inflow=inflow)
    w, O = flight.angular_velocity[rows], flight.rotor_speed[rows]
    parts = [O * O, _spin(layout, vehicle, (w, O, flight.rotor_acceleration[rows]))]
    parts.append((w[:, 2] * (O @ vehicle.squared_arms))[:, None])
    if inflow:
        parts.append(_inflow(layout, vehicle, (_known_velocity(flight, rows), w, O)))
    Z = np.concatenate(parts, axis=1)
    return Z if exact else _averaged(Z, [layout.names[i] in DERIVATIVES for i in columns])


def _with_margin(flight: FlightData, start: int, stop: int) -> tuple[slice, bool]:
    """Return the rows with a neighbour to each side, which exact derivatives do not need."""
    exact = flight.differentiation == "exact"
    margin = 0 if exact else 1
    return slice(start - margin, stop + margin), exact


def yaw_signals(
    flight: FlightData, rotor_count: int, start: int, stop: int
) -> Float[np.ndarray, "n y"]:
    """Return yaw acceleration, and of every rotor the squared speed, then the spin-up.

    Of rotors that may turn either way; averaged as those of `signal_matrix` are.
    """
    rows, exact = _with_margin(flight, start, stop)
    Z = np.column_stack(
        [
            flight.angular_acceleration[rows, 2],
            flight.rotor_speed[rows] ** 2,
            flight.rotor_acceleration[rows],
        ]
    )
    exempt = [True] + [False] * rotor_count + [True] * rotor_count
    return Z if exact else _averaged(Z, exempt)


def _averaged(wide: Float[np.ndarray, "w z"], exempt: Sequence[bool]) -> Float[np.ndarray, "n z"]:
    """Return the inner rows averaged with [1 4 1]/6, but for the columns that are exempt."""
    Z = wide[:-2] + wide[2:]
    Z += 4.0 * wide[1:-1]
    Z /= 6.0
    kept = np.flatnonzero(exempt)
    Z[:, kept] = wide[1:-1][:, kept]
    return Z


def _felt_climb(flight: FlightData, rows: slice) -> Float[np.ndarray, " n"]:
    if flight.climb is None:
        raise FlightError("the velocity along z was not made of accelerometer and gyro")
    return flight.climb[rows]


def _known_velocity(flight: FlightData, rows: slice) -> Float[np.ndarray, "n 3"]:
    if flight.velocity is None or not np.isfinite(flight.velocity[rows]).all():
        raise FlightError(
            "the velocity of the body is not known throughout the flight; log it without gaps, or "
            "leave the term drag out"
        )
    return flight.velocity[rows]


def _inflow(
    layout: SignalLayout,
    vehicle: Vehicle,
    motion: tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n N"]],
) -> Float[np.ndarray, "n i"]:
    """Return what the air through the rotors does, of velocity, rates and rotor speeds."""
    v, w, O = motion
    n = vehicle.axes
    lever = np.cross(vehicle.positions, n)
    # Velocity of each rotor along its axis: n . (v + w x r) = n . v + w . (r x n).
    wrenches = (O * (v @ n.T + w @ lever.T)) @ np.concatenate([n, lever], axis=1)
    return wrenches[:, [i for i, name in enumerate(INFLOW_SIGNALS) if name in layout]]


def _spin(
    layout: SignalLayout,
    vehicle: Vehicle,
    motion: tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n N"], Float[np.ndarray, "n N"]],
) -> Float[np.ndarray, "n s"]:
    """Return those of dH/dt and w x H that the layout has."""
    w, O, dO = motion
    spin_axes = vehicle.spins[:, None] * vehicle.axes
    if "dHx" not in layout:
        Hz = O @ spin_axes[:, 2]
        return np.column_stack([dO @ spin_axes[:, 2], w[:, 1] * Hz, -w[:, 0] * Hz])
    return np.concatenate([dO @ spin_axes, np.cross(w, O @ spin_axes)], axis=1)
