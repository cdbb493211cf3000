"""The prepared flight: one uniform clock, SI units, FLU body axes."""

from __future__ import annotations

import operator
from dataclasses import field
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Callable

    from jaxtyping import Float, Int

    from rotorfit.flight.signals import Thinning
    from rotorfit.logs.firmware import Filter
    from rotorfit.logs.flight_log import LagOn

Differentiation = Literal["exact", "central"]
T = TypeVar("T")


@frozen_dataclass
class Segment:
    """A stretch of consecutive samples: rows ``start`` to ``stop`` (exclusive).

    Attributes
    ----------
    start, stop
        Rows.
    """

    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


@frozen_dataclass
class HeldCommands:
    """Commands of which a decimated flight has means: each was held until the next.

    A lag that differs between up and down acts on every one of them, and not their mean.

    - `speed`: that each would settle at [rad/s].
    - `sample_rate`: as recorded [Hz].
    - `jumps`: first rows after a gap.
    """

    speed: Float[np.ndarray, "r N"]
    sample_rate: float
    jumps: Int[np.ndarray, " j"]


@frozen_dataclass
class FlightData:
    """A flight on one uniform clock, in SI units and FLU body axes.

    Attributes
    ----------
    sample_rate
        Samples per second of the uniform clock [Hz].
    time
        Clock of the samples, in the log's own time [s].
    specific_force
        Acceleration minus gravity at the accelerometer's place [m/s^2].
    angular_velocity
        Of the body relative to the world [rad/s].
    angular_acceleration
        Its time derivative [rad/s^2].
    rotor_speed
        Magnitude, in the airframe's rotor order [rad/s] (or its effective unit, see `prepare`).
    rotor_acceleration
        Time derivative of rotor_speed [rad/s^2].
    differentiation
        ``"central"``: the two derivatives are differences over two samples, so that every other
        column of a linear equation must be averaged with [1 4 1]/6 before they are compared.
        ``"exact"``: they belong to the same instant as the other columns, as they do in a
        simulation, and in motion capture, where one spline gives a signal and its derivatives.
    segments
        The airborne stretches without gaps. With ``"central"`` derivatives each row of a segment
        has a valid neighbour on both sides in the arrays, outside the segment if at its edge.
    rotor_speed_std
        Standard deviation of one recorded rotor speed, from its resolution [rad/s].
    velocity
        Of the body relative to the ground, body axes [m/s], where the log has it.
    carried
        Velocity by positions, with the accelerometer between them (`carried_velocity`), body
        axes [m/s], where the log has them; NaN if they are far.
    world_axes
        The world's horizontal axes x and y in body axes, side by side, where the log has an
        attitude.
    climb
        Velocity along the body's z axis as accelerometer and gyro feel it, without what is slow
        (`climb_velocity`) [m/s]; where nothing else gives a velocity.
    hover_inflow
        Velocity with which the rotors draw air through their disks in hover [m/s]; None where the
        mass is not known.
    lag_on
        What of a motor follows its command with a lag.
    reference
        Angular velocity that pilot or mission asked for [rad/s], where the log has it; NaN in rows
        without.
    thinned
        How these rows were made of those that were recorded, where they are fewer.
    held
        The commands as recorded, where a row of the motor channel is the mean of several.
    noise_level
        How noisy a row is beside others of its phase, where a fit has shown it.
    filters
        On board, that gyro and accelerometer passed; those of the gyro the rotor speeds passed, too
        (`on_board.py`).
    motion_memo
        What was made by `of_motion`; copies with other rotor speeds share it.
    """

    sample_rate: float
    time: Float[np.ndarray, " n"]
    specific_force: Float[np.ndarray, "n 3"]
    angular_velocity: Float[np.ndarray, "n 3"]
    angular_acceleration: Float[np.ndarray, "n 3"]
    rotor_speed: Float[np.ndarray, "n N"]
    rotor_acceleration: Float[np.ndarray, "n N"]
    differentiation: Differentiation
    segments: tuple[Segment, ...]
    rotor_speed_std: float = 0.0
    velocity: Float[np.ndarray, "n 3"] | None = None
    carried: Float[np.ndarray, "n 3"] | None = None
    world_axes: Float[np.ndarray, "n 6"] | None = None
    climb: Float[np.ndarray, " n"] | None = None
    hover_inflow: float | None = None
    lag_on: LagOn = "speed"
    reference: Float[np.ndarray, "n 3"] | None = None
    thinned: Thinning | None = None
    held: HeldCommands | None = None
    noise_level: Float[np.ndarray, " n"] | None = None
    filters: tuple[Filter, ...] = ()
    motion_memo: dict[str, tuple[tuple[object, ...], Any]] = field(
        default_factory=dict[str, tuple[tuple[object, ...], Any]], compare=False, repr=False
    )

    def of_motion(self, name: str, made_of: tuple[object, ...], make: Callable[[], T]) -> T:
        """Return a value that the body's motion alone decides, made once for all motor timings.

        `name`: under which it is kept. `made_of`: all that it depends on, compared by identity.
        """
        known = self.motion_memo.get(name)
        if known is None or not all(map(operator.is_, known[0], made_of)):
            known = self.motion_memo[name] = made_of, make()
        made: T = known[1]
        return made

    @property
    def used_rows(self) -> Int[np.ndarray, " u"]:
        """Rows of all segments, one after the other."""
        rows = [np.arange(s.start, s.stop) for s in self.segments]
        return np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)

    @property
    def any_velocity(self) -> Float[np.ndarray, "n 3"] | None:
        """The velocity [m/s], else that by positions; None if the log has neither."""
        return self.carried if self.velocity is None else self.velocity

    @property
    def samples_used(self) -> int:
        """Number of samples in all segments."""
        return sum(len(segment) for segment in self.segments)

    @property
    def seconds_used(self) -> float:
        """Total duration of all segments [s]."""
        return self.samples_used / self.sample_rate
