"""One effect of the model as a record: what the fit, its intervals and its results need of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.flight.airborne import GRAVITY
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.model.signals import AddedSignals, SignalLayout
    from rotorfit.model.vehicle import Vehicle

    Block = Float[np.ndarray, "6 z"]
    """A_p: the entries of one parameter, rows Fx Fy Fz Mx My Mz, on the signals z."""
    Entries = Callable[[Vehicle, SignalLayout], dict[str, Block]]

FX, FY, FZ, MX, MY, MZ = range(6)

Motion = Literal["roll", "pitch", "yaw", "force", "place", "height", "air"]
"""Which motion shows a number (`checks/verdicts/judge.py` has what to fly for it)."""
LEAST_SHARE: Final = 1e-3
"""Least share of the weight that a term must make, at 1 m/s or at the end of an arm: flights
without noise show what is of no account."""


@frozen_dataclass
class Size:
    """The size of a vehicle, by which sizes and priors of its parameters are measured.

    - `mass`, `arm`: [kg], [m]
    - `speeds`: of all rotors together, about as in hover [rad/s].
    - `moments`: Ixx, Iyy, Izz about the centre of mass [kg m^2].
    - `disk_area`: of all propellers [m^2].
    - `rotors_dragged`: whether the drag of its rotors is in the model, too.
    """

    mass: float
    arm: float
    speeds: float = np.nan
    moments: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    disk_area: float = np.nan
    rotors_dragged: bool = False

    @property
    def trace_force(self) -> float:
        """Force below which a term is of no account [N]."""
        return LEAST_SHARE * self.mass * GRAVITY

    @property
    def trace_torque(self) -> float:
        """Torque below which a term is of no account [N m]."""
        return self.trace_force * self.arm


Rule = Callable[[Size], float]


@dataclass(frozen=True, slots=True)
class ParameterInfo:
    """A number of a result: unit, meaning, sizes and prior.

    - `mass_power`: for mass = "unknown", where numbers are per kilogram.
    - `effective_unit`: where the command, 0 to 1, stands for the rotor speed; None: as ever.
    - `speed_power`: power of the rotor speed that it goes with, up or down: off by so many times
      the share by which a law from command to speed is off.
    - `motion`: which motion shows it.
    - `on_yaw_scale`: whether it is known only as well as the scale of the yaw equation.
    - `relevant`: size below which its relative error does not matter; None: any counts.
    - `prior`, `prior_mean`: deviation and mean before the flight; the mean is zero if not given.
    - `step`: size over which nothing bends, where its value shows none (plan's bound).
    - `between_flights`: what differs between flights of one configuration: it moves with the
      battery, or it is in proportion to the density of the air.
    - `form_error`: share by which flights of one vehicle differ in it at speed, beyond chance: the
    term has not the whole form of the effect.
    - `velocity_axis`: axis of the velocity that it multiplies.
    """

    unit: str
    mass_power: int
    meaning: str
    _: KW_ONLY
    title: str
    effective_unit: str | None = None
    speed_power: int = 0
    motion: Motion = "force"
    on_yaw_scale: bool = False
    relevant: Rule | None = None
    prior: Rule | None = None
    prior_mean: Rule | None = None
    step: Rule | None = None
    between_flights: Literal["moves", "air"] | None = None
    velocity_axis: int | None = None
    form_error: float = 0.0


@dataclass(frozen=True, slots=True)
class Move:
    """An entry of theta that a parameter moves, times another parameter where one is named."""

    entry: str
    parameter: str
    times: str | None = None
    factor: float = 1.0


@frozen_dataclass
class Significance:
    """The rule by which a term by likelihood is more than a trace, in some configuration.

    - `parameters`: of which one must exceed `least`.
    - `brakes`: whether it must surely be above zero: the air brakes, it does not drive.
    """

    parameters: tuple[str, ...]
    least: Rule
    brakes: bool = True


@frozen_dataclass
class Term:
    """One effect of the model.

    - `name`, `words`: in the experiment file; "the model includes ..." in results.
    - `parameters`: by name, as results have them.
    - `owner`: who has a value of its own for each parameter.
    - `entries`: function for A_p of its entries of theta; None if those of other terms serve.
    - `moves`: entries that its parameters move; empty: each parameter is its own entry.
    - `when`: it is in the model always, by default, if the likelihood asks for it, or if declared.
    - `needs`: of the flights or the vehicle.
    - `signals`: that no other layout has.
    - `carried`: signals that it uses besides where a flight knows what carries its rotors.
    - `with_velocity`: signals that it uses instead where the velocity is known.
    - `air_at_rotors`: of the air that moves at the rotors, which some simulators leave out.
    - `significance`: of a term by likelihood (for a declared one: by which it may be judged).
    - `dropped`: its turn to be left out where a fit does not settle: what flights show least first.
    - `one_sided`: parameters for which it is left out where they are surely below zero.
    - `reported`: whether its parameters are numbers of a result.
    - `of_sensor`: of a sensor, not of the vehicle: nobody flies for it, no wrench has it.
    - `replayed`: from draws of its parameters to what they add to fields of
      `validation.replay_vehicle.ReplayVehicle`.
    """

    name: str
    parameters: Mapping[str, ParameterInfo]
    owner: Literal["shared", "rotor", "configuration"]
    words: str = ""
    entries: Entries | None = None
    moves: tuple[Move, ...] = ()
    when: Literal["always", "default", "likelihood", "declared"] = "always"
    needs: Literal["velocity", "climb", "unknown origin"] | None = None
    signals: tuple[AddedSignals, ...] = ()
    carried: tuple[AddedSignals, ...] = ()
    with_velocity: tuple[AddedSignals, ...] = ()
    air_at_rotors: bool = False
    significance: Significance | None = None
    dropped: int | None = None
    one_sided: tuple[str, ...] = ()
    reported: bool = True
    of_sensor: bool = False
    replayed: Callable[[Mapping[str, np.ndarray], Vehicle], dict[str, np.ndarray]] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Its parameters."""
        return tuple(self.parameters)

    @property
    def every_move(self) -> tuple[Move, ...]:
        """Entries of theta that its parameters move."""
        return self.moves or tuple(Move(name, name) for name in self.parameters)

    def stands_in(self, layout: SignalLayout) -> bool:
        """Return whether its signals are among those of a layout."""
        return all(signals in layout.added for signals in self.signals)


def block(layout: SignalLayout, entries: Mapping[tuple[int, str], float]) -> Block:
    """Return A_p from its entries by row and signal."""
    out = np.zeros((6, len(layout)))
    for (row, name), value in entries.items():
        out[row, layout.index(name)] = value
    return out
