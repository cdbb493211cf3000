"""The signals of a flight: the few columns in which every equation of the model is linear.

z = (specific force 3, angular acceleration 3, rate products 6, rotor speeds squared N, rotor spin
terms, yaw rate times rotor speeds and squared arms, rates 3, what some terms of the model add
(`AddedSignals`: the velocity, say), 1). The spin terms are dH/dt
and w x H of the rotors' spin H = sum s_i O_i n_i: six with tilted rotors, three where all axes are
z (dH_z/dt, w_y H_z, -w_x H_z; the others vanish).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import FlightError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from jaxtyping import Float

    from rotorfit.flight.flight_data import FlightData
    from rotorfit.model.vehicle import Vehicle

BODY_SIGNALS = (
    *("ax", "ay", "az"),
    *("dwx", "dwy", "dwz"),
    *("wxwx", "wywy", "wzwz", "wxwy", "wxwz", "wywz"),
)
SPIN_SIGNALS = ("dHx", "dHy", "dHz", "wxH_x", "wxH_y", "wxH_z")
ALIGNED_SPIN_SIGNALS = ("dHz", "wxH_x", "wxH_y")
RATE_SIGNALS = ("wx", "wy", "wz")
DERIVATIVES = ("dwx", "dwy", "dwz", "dHx", "dHy", "dHz")


@frozen_dataclass
class AddedSignals:
    """Signals that a layout has only for terms that need them: more columns round otherwise.

    - `names`: from the vehicle to their names.
    - `of_body`, `of_rotors`: from a flight and its rows to their columns; the one where the rotors
      have no part in them.
    - `sloped`: whether their slopes by the motors' times are made, too.
    """

    name: str
    names: Callable[[Vehicle], tuple[str, ...]]
    of_body: Callable[[FlightData, slice], Float[np.ndarray, "n k"]] | None = None
    of_rotors: Callable[[FlightData, slice, Vehicle], Float[np.ndarray, "n k"]] | None = None
    sloped: bool = True


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """The signals of the columns of Z; `rotors` are those that depend on rotor speeds.

    `sloped`: of these, the ones with slopes by the motors' times.
    """

    names: tuple[str, ...]
    added: tuple[AddedSignals, ...] = ()
    rotors: frozenset[str] = frozenset()
    sloped: frozenset[str] = frozenset()

    def __len__(self) -> int:
        return len(self.names)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def index(self, name: str) -> int:
        """Return the column of one signal."""
        return self.names.index(name)


def rotor_columns(layout: SignalLayout, *, sloped: bool = False) -> list[int]:
    """Return the columns that the rotors' speeds stand in, or of these the ones with slopes."""
    made = layout.sloped if sloped else layout.rotors
    return [i for i, name in enumerate(layout.names) if name in made]


def body_columns(layout: SignalLayout) -> list[int]:
    """Return the columns that the rotors' speeds do not stand in."""
    return [i for i, name in enumerate(layout.names) if name not in layout.rotors]


def aligned(vehicle: Vehicle) -> bool:
    """Return whether all rotors thrust along z."""
    return bool(np.all(vehicle.axes == [0.0, 0.0, 1.0]))


def signal_layout(vehicle: Vehicle, added: Sequence[AddedSignals] = ()) -> SignalLayout:
    """Return the signals that the equations of this vehicle need, with those that terms add."""
    squares = tuple(f"O2_{i + 1}" for i in range(len(vehicle.rotors)))
    spin = ALIGNED_SPIN_SIGNALS if aligned(vehicle) else SPIN_SIGNALS
    always = {*squares, *spin, "wzO"}
    more = [name for signals in added for name in signals.names(vehicle)]
    made = {n for s in added if s.of_rotors is not None for n in s.names(vehicle)}
    sloped = {n for s in added if s.of_rotors is not None and s.sloped for n in s.names(vehicle)}
    return SignalLayout(
        (*BODY_SIGNALS, *squares, *spin, "wzO", *RATE_SIGNALS, *more, "one"),
        added=tuple(added),
        rotors=frozenset(always | made),
        sloped=frozenset(always | sloped),
    )


def signal_matrix(
    flight: FlightData,
    vehicle: Vehicle,
    start: int,
    stop: int,
    *,
    added: Sequence[AddedSignals] = (),
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
        not what an added signal is made of.
    """
    margin = 0 if flight.differentiation == "exact" else 1
    if start < margin or stop > len(flight.time) - margin:
        raise FlightError(
            f"rows {start} to {stop} of a flight of {len(flight.time)} samples with "
            f"{margin} neighbour row on each side do not exist; shorten the segment"
        )
    layout = signal_layout(vehicle, added)
    Z = np.empty((stop - start, len(layout)), order="F")  # written and multiplied by columns
    Z[:, body_columns(layout)] = body_signals(flight, start, stop, added=added)
    Z[:, rotor_columns(layout)] = rotor_signals(flight, vehicle, start, stop, added=added)
    return Z


def body_signals(
    flight: FlightData, start: int, stop: int, *, added: Sequence[AddedSignals] = ()
) -> Float[np.ndarray, "n b"]:
    """Compute the columns of `signal_matrix` without rotors (`body_columns`)."""
    rows, exact = _with_margin(flight, start, stop)
    w = flight.angular_velocity[rows]
    more = [s.of_body(flight, rows) for s in added if s.of_body is not None]
    # Specific force, angular acceleration, six products of rates, rates; last the constant.
    Z = np.empty((len(w), 16 + sum(part.shape[1] for part in more)), order="F")
    Z[:, 0:3] = flight.specific_force[rows]
    Z[:, 3:6] = flight.angular_acceleration[rows]
    np.multiply(w, w, out=Z[:, 6:9])
    for column, (i, j) in enumerate(((0, 1), (0, 2), (1, 2)), start=9):
        np.multiply(w[:, i], w[:, j], out=Z[:, column])
    Z[:, 12:15] = w
    if more:
        Z[:, 15:-1] = np.concatenate(more, axis=1)
    Z[:, -1] = 1.0
    return Z if exact else _average_rows(Z, [3 <= i < 6 for i in range(Z.shape[1])])


def rotor_signals(
    flight: FlightData,
    vehicle: Vehicle,
    start: int,
    stop: int,
    *,
    added: Sequence[AddedSignals] = (),
) -> Float[np.ndarray, "n r"]:
    """Compute the columns of `signal_matrix` with rotors' speeds (`rotor_columns`)."""
    rows, exact = _with_margin(flight, start, stop)
    layout = signal_layout(vehicle, added)
    w, O = flight.angular_velocity[rows], flight.rotor_speed[rows]
    parts = [O * O, _spin_components(layout, vehicle, (w, O, flight.rotor_acceleration[rows]))]
    parts.append((w[:, 2] * (O @ vehicle.squared_arms))[:, None])
    parts += [s.of_rotors(flight, rows, vehicle) for s in added if s.of_rotors is not None]
    Z = np.concatenate(parts, axis=1)
    return (
        Z
        if exact
        else _average_rows(Z, [layout.names[i] in DERIVATIVES for i in rotor_columns(layout)])
    )


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
    return Z if exact else _average_rows(Z, exempt)


def central_average(wide: Float[np.ndarray, "w *z"]) -> Float[np.ndarray, "n *z"]:
    """Average the inner rows with their neighbours, [1 4 1]/6, as central differences do."""
    Z = wide[:-2] + wide[2:]
    Z += 4.0 * wide[1:-1]
    Z /= 6.0
    return Z


def _average_rows(
    wide: Float[np.ndarray, "w z"], exempt: Sequence[bool]
) -> Float[np.ndarray, "n z"]:
    """Return the inner rows averaged with [1 4 1]/6, but for the columns that are exempt."""
    Z = central_average(wide)
    kept = np.flatnonzero(exempt)
    Z[:, kept] = wide[1:-1][:, kept]
    return Z


def _spin_components(
    layout: SignalLayout,
    vehicle: Vehicle,
    motion: tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n N"], Float[np.ndarray, "n N"]],
) -> Float[np.ndarray, "n s"]:
    """Compute the components of dH/dt and w x H that the layout has."""
    w, O, dO = motion
    spin_axes = vehicle.spins[:, None] * vehicle.axes
    if "dHx" not in layout:
        Hz = O @ spin_axes[:, 2]
        return np.column_stack([dO @ spin_axes[:, 2], w[:, 1] * Hz, -w[:, 0] * Hz])
    return np.concatenate([dO @ spin_axes, np.cross(w, O @ spin_axes)], axis=1)
