"""Rotor speed and acceleration of a flight from its motor channel, for any lag and delay."""

import dataclasses
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal

import numpy as np
from jaxtyping import Float, Int

from rotorfit.logs.flight_log import LagOn
from rotorfit.logs.speed_law import SpeedLaw
from rotorfit.preprocessing.flight_data import FlightData
from rotorfit.preprocessing.motors.motor_model import MotorResponse, following_speed
from rotorfit.preprocessing.signals import central_difference
from rotorfit.preprocessing.splines import smooth_motors

SLOW_LAG: Final = 2.0
"""Lag in samples, from which means of commands do as well as these: to 1e-4 up to 30 Hz."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorModel:
    """How the log's motor channel becomes rotor speed.

    Attributes
    ----------
    speed
        ``"measured"``: the log's rotor speed. ``"commanded"``: its command, through `law`, `lag`
        and `delay`.
    law
        Speed over command; None where unknown: then the command itself stands for the speed, and
        coefficients are per squared command.
    lag
        First-order time constant [s].
    delay
        How much later than the rest of the log the motor channel takes effect [s]; negative where
        it was recorded late. None: found from the data where speed is measured, else zero.
    lag_down
        Of falling speed, where it differs from `lag` [s].
    lag_on
        What the lag acts on: the speed, as in any motor, or the thrust, as in PX4's SIH.
    """

    speed: Literal["measured", "commanded"] = "measured"
    law: SpeedLaw | None = None
    lag: float = 0.0
    delay: float | None = None
    lag_down: float | None = None
    lag_on: LagOn = "speed"

    @property
    def response(self) -> MotorResponse:
        """As declared; what was not counts as none."""
        return MotorResponse(lag=self.lag, delay=self.delay or 0.0, lag_down=self.lag_down)


def with_motors(
    data: FlightData, speed: Float[np.ndarray, "n N"], response: MotorResponse
) -> FlightData:
    """Return the flight with its rotor columns made anew from the motor channel.

    Lag and delay change nothing else: a trial of either costs only these columns.
    """
    if data.differentiation == "exact":
        jumps = clock_jumps(data.time, data.sample_rate)
        # Low-passed already: moved and differentiated by splines, as the pose is.
        moved = [
            smooth_motors(piece, data.sample_rate, lag=response.mean_lag, delay=response.delay)
            for piece in np.split(speed, jumps)
        ]
        return dataclasses.replace(
            data,
            rotor_speed=np.concatenate([value for value, _ in moved]),
            rotor_acceleration=np.concatenate([slope for _, slope in moved]),
        )
    turned = _turned(data, speed, response)
    return dataclasses.replace(
        data,
        rotor_speed=turned,
        rotor_acceleration=central_difference(turned, data.sample_rate),
    )


def _turned(
    data: FlightData, speed: Float[np.ndarray, "n N"], response: MotorResponse
) -> Float[np.ndarray, "n N"]:
    """Return the speed of the rotors; from means of commands only where these answer like each."""
    follow = partial(following_rotors, response=response, lag_on=data.lag_on)
    held, thinned = data.held, data.thinned
    if thinned is None:
        jumps = clock_jumps(data.time, data.sample_rate)
        return follow(speed, data.sample_rate, jumps=jumps)
    if held is None:
        return follow(speed, data.sample_rate, jumps=thinned.jumps)
    linear = data.lag_on == "speed" and not response.two_way
    if not linear or response.lag * data.sample_rate < SLOW_LAG:
        return thinned(follow(held.speed, held.sample_rate, jumps=held.jumps))
    held_for = 1.0 / held.sample_rate
    return follow(speed, data.sample_rate, jumps=thinned.jumps, held_for=held_for)


def clock_jumps(time: Float[np.ndarray, " n"], sample_rate: float) -> Int[np.ndarray, " j"]:
    """Return the first rows after a gap in the clock."""
    return np.flatnonzero(np.diff(time) > 1.5 / sample_rate) + 1


def following_rotors(
    speed: Float[np.ndarray, "n N"],
    sample_rate: float,
    *,
    jumps: Int[np.ndarray, " j"],
    response: MotorResponse,
    lag_on: LagOn,
    held_for: float | None = None,
) -> Float[np.ndarray, "n N"]:
    """Return the speed of rotors that follow the motor channel, anew after every gap.

    `jumps`: the first rows after a gap; `held_for`: see `following_speed`.
    """
    power = 2.0 if lag_on == "thrust" else 1.0
    held = speed**power if power != 1.0 else speed
    pieces = [
        following_speed(piece, sample_rate, response, held_for=held_for)
        for piece in np.split(held, jumps)
    ]
    followed = pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
    return np.maximum(followed, 0.0) ** (1.0 / power) if power != 1.0 else followed
