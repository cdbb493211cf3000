"""From the motor channel to rotor speed and acceleration: law, lag and delay of the motors."""

from __future__ import annotations

import dataclasses
from functools import cache, partial
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.flight.filters import first_order_recursion
from rotorfit.flight.recursion import solve_recursion
from rotorfit.flight.signals import central_difference, smooth_motors
from rotorfit.flight.spectral_density import power_density
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.flight_log import LONG, LagOn, pieces
from rotorfit.logs.motor_law import MotorLaw, SquareRootCurve, speed_from_command

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float, Int

    from rotorfit.flight.flight_data import FlightData

MOST_ROUNDS = 40
SETTLED = 1e-9
"""Relative distance between command and speed at which rising and falling are the same."""
NOISE_ROWS = 256
"""Length of the spectra in which the noise of rotor speeds is looked for."""


@frozen_dataclass
class MotorResponse:
    """The response of the rotors to the motor channel: lags and delay.

    - `lag`: first-order time constant [s]; of rising speed where `lag_down` is given.
    - `delay`: pure delay [s].
    - `lag_down`: time constant of falling speed [s]; None: as `lag`.
    """

    lag: float = 0.0
    delay: float = 0.0
    lag_down: float | None = None

    @property
    def two_way(self) -> bool:
        """Whether rising and falling speed differ."""
        return self.lag_down is not None and self.lag_down != self.lag

    @property
    def mean_lag(self) -> float:
        """Of rising and falling speed [s]."""
        return self.lag if self.lag_down is None else 0.5 * (self.lag + self.lag_down)


def following_speed(
    held: Float[np.ndarray, "n N"],
    sample_rate: float,
    response: MotorResponse,
    *,
    held_for: float | None = None,
) -> Float[np.ndarray, "n N"]:
    """Filter held commands [rad/s] by delay and lag.

    `held_for`: how long one command held [s] where each sample is the mean of several, the first
    at the sample's time; None: each is one command. Means need one lag above zero.
    """
    early = 0.0 if held_for is None else _delay_of_mean(held_for, 1.0 / sample_rate, response.lag)
    late = shift_time(held, sample_rate, response.delay - early)
    if response.lag_down is None or not response.two_way:
        return first_order_lag(late, sample_rate, response.lag)
    return two_way_lag(late, sample_rate, up=response.lag, down=response.lag_down)


def _delay_of_mean(one: float, several: float, lag: float) -> float:
    """Compute how much later than its own time a mean of several commands takes effect [s]."""
    # Behind a lag tau what was commanded during a time T counts with exp(t / tau): its middle is
    # T/2 coth(T / 2 tau) - tau later than half of T.
    together, each = (0.5 * held / np.tanh(0.5 * held / lag) for held in (several, one))
    return float(together - each)


def first_order_lag(
    held: Float[np.ndarray, "n N"], sample_rate: float, lag: float
) -> Float[np.ndarray, "n N"]:
    r"""Filter held commands [rad/s] by a first-order lag [s].

    The command is held between samples (zero-order hold), for which
    :math:`O_{k+1} = a O_k + (1 - a) u_k, a = e^{-dt/\tau}` is exact; an ordinary sampled low-pass
    would be off by half a sample. The motors start settled.
    """
    if lag <= 0:
        return held
    a = remaining_share(sample_rate, lag)
    return first_order_recursion(np.concatenate([held[:1], (1.0 - a) * held[:-1]]), a)


def two_way_lag(
    held: Float[np.ndarray, "n N"], sample_rate: float, *, up: float, down: float
) -> Float[np.ndarray, "n N"]:
    """Filter held commands with one time constant for rising speed and another for falling."""
    if len(held) > LONG and held.shape[1] > 1:
        # One rotor after the other: the rounds need several copies of what they act on.
        each = np.empty(held.shape)
        for k in range(held.shape[1]):
            each[:, k] = two_way_lag(held[:, k : k + 1], sample_rate, up=up, down=down)[:, 0]
        return each
    keep_up, keep_down = remaining_share(sample_rate, up), remaining_share(sample_rate, down)
    # A driven rotor is pushed up by the motor and, without active braking, falls by its own drag:
    # the recursion is one of two linear ones at every sample. Which one is guessed, the whole
    # record solved, the guess corrected: Newton's iteration on a piecewise linear equation, which
    # ends after a few rounds.
    speed = first_order_lag(held, sample_rate, 0.5 * (up + down))
    rising = held > speed
    for _ in range(MOST_ROUNDS):
        speed = _solve_lag(held, np.where(rising, keep_up, keep_down))
        changed = (held > speed) != rising
        # Where command and speed are one but for rounding, the guess would flip for ever.
        if not (changed & (np.abs(held - speed) > SETTLED * np.abs(held))).any():
            break
        rising ^= changed
    return speed


def remaining_share(sample_rate: float, lag: float) -> float:
    """Return the share of the distance that is left after a sample."""
    return float(np.exp(-1.0 / (sample_rate * lag))) if lag > 0 else 0.0


def _solve_lag(
    held: Float[np.ndarray, "n N"], remaining: Float[np.ndarray, "n N"]
) -> Float[np.ndarray, "n N"]:
    """Solve O_0 = u_0, O_k+1 = a_k O_k + (1 - a_k) u_k."""
    return follow_shares(remaining, (1.0 - remaining) * held, held[0])


def follow_shares(
    share: Float[np.ndarray, "n N"], input: Float[np.ndarray, "n N"], first: Float[np.ndarray, " N"]
) -> Float[np.ndarray, "n N"]:
    """Solve S_0 = first, S_k+1 = a_k S_k + f_k, `share` and `input` being a and f."""
    n, rotors = share.shape
    if not n:
        return np.zeros_like(share)
    # One rotor after the other in one system, of which each takes nothing of the last.
    kept = np.zeros((rotors, n))
    kept[:, :-1] = -share[:-1].T
    bands = np.ones((2, rotors * n), order="F")
    bands[1] = kept.ravel()
    right = np.empty((rotors, n))
    right[:, 0], right[:, 1:] = first, input[:-1].T
    return np.ascontiguousarray(solve_recursion(bands, right.ravel()).reshape(rotors, n).T)


def shift_time(
    values: Float[np.ndarray, "n N"], sample_rate: float, delay: float, *, slope: bool = False
) -> Float[np.ndarray, "n N"]:
    """Interpolate values as they were `delay` seconds before each sample; or their slope by it."""
    if delay == 0 and not slope:
        return values
    whole = int(np.floor(delay * sample_rate))
    part = delay * sample_rate - whole
    # A straight line between two samples would average their noise away at half a sample, and a
    # search for the delay would take that for a good fit.
    nodes = np.arange(-4, 6)
    weights = _slope_weights(part, nodes) * sample_rate if slope else _lagrange_weights(part, nodes)
    n = len(values)
    shifted = np.zeros(values.shape)
    for piece in pieces(n, longest=LONG // len(nodes)):
        first = int(piece.start) - whole - int(nodes[-1])
        rows = np.arange(first, int(piece.stop) - whole - int(nodes[0]))
        near = values[np.clip(rows, 0, n - 1)]
        for weight, k in zip(weights.tolist(), nodes.tolist(), strict=True):
            begin = int(nodes[-1]) - k
            shifted[piece] += weight * near[begin : begin + piece.stop - piece.start]
    return shifted


def _lagrange_weights(part: float, nodes: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    powers = part ** np.arange(len(nodes))
    weights: Float[np.ndarray, " k"] = _lagrange_polynomials(tuple(nodes.tolist())) @ powers
    return weights


def _slope_weights(part: float, nodes: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Differentiate Lagrange's weights by the place."""
    degree = np.arange(1, len(nodes))
    slopes: Float[np.ndarray, " d"] = degree * part ** (degree - 1)
    weights: Float[np.ndarray, " k"] = _lagrange_polynomials(tuple(nodes.tolist()))[:, 1:] @ slopes
    return weights


@cache
def _lagrange_polynomials(nodes: tuple[int, ...]) -> Float[np.ndarray, "k d"]:
    """Return the coefficients of the polynomials of Lagrange's weights, lowest power first."""
    return np.array(
        [
            np.poly([m for m in nodes if m != k])[::-1] / np.prod([k - m for m in nodes if m != k])
            for k in nodes
        ]
    )


def white_noise_std(
    values: Float[np.ndarray, "n N"], stretches: Sequence[tuple[int, int]]
) -> float:
    """Estimate the standard deviation of the white noise in measured rotor speeds [rad/s]."""
    levels: list[float] = []
    for start, stop in stretches:
        if stop - start < NOISE_ROWS:
            continue
        # A rotor cannot follow the fastest changes that a log can hold: what is left of its
        # spectrum close to the Nyquist frequency is error of measurement. The median over that
        # tenth of the spectrum, so that a single line of vibration does not count.
        top = _mean_spectrum(values[start:stop])[-NOISE_ROWS // 20 :]
        levels.append(0.5 * float(np.median(top)))  # one-sided density, half a cycle a sample
    return float(np.sqrt(np.median(levels))) if levels else 0.0


def _mean_spectrum(values: Float[np.ndarray, "n N"]) -> Float[np.ndarray, "f N"]:
    """Average the power spectrum of windows that overlap by half, piece by piece."""
    half = NOISE_ROWS // 2
    windows = len(values) // half - 1
    mean = np.zeros((half + 1, values.shape[1]))
    for piece in pieces(windows, longest=LONG // half):
        rows = values[piece.start * half : (piece.stop + 1) * half]
        _, density = power_density(rows, 1.0, NOISE_ROWS)
        mean += (piece.stop - piece.start) / windows * density
    return mean


SLOW_LAG: Final = 2.0
"""Lag in samples, from which means of commands do as well as these: to 1e-4 up to 30 Hz."""


@frozen_dataclass
class MotorModel:
    """The model from the log's motor channel to rotor speed.

    Attributes
    ----------
    speed
        ``"measured"``: the log's rotor speed. ``"commanded"``: its command, through `law`, `lag`
        and `delay`.
    law
        Speed over command; None if unknown: then the command itself stands for the speed, and
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
    law: MotorLaw | None = None
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
    """Recompute the rotor columns of a flight from the motor channel, for any lag and delay."""
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
    turned = _filter_by_response(data, speed, response)
    return dataclasses.replace(
        data,
        rotor_speed=turned,
        rotor_acceleration=central_difference(turned, data.sample_rate),
    )


def _filter_by_response(
    data: FlightData, speed: Float[np.ndarray, "n N"], response: MotorResponse
) -> Float[np.ndarray, "n N"]:
    """Filter the motor channel by the response; commands as recorded where means would not do."""
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
    """Find the first rows after a gap in the clock."""
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
    """Filter the motor channel by the response, again after every gap (`jumps`).

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


GRID = np.linspace(0.0, 1.0, 501)
"""Commands on which a curve is compared with another."""
LINEAR_RANGE: Final = (0.0, 1.5)
"""Betaflight's ``thrust_linear`` / 100."""
NEARBY: Final = 1e-3 * np.array([-1.0, 0.0, 1.0])
"""Factors to either side, for slope and curvature."""
NEWTON_STEPS: Final = 4
TINY: Final = 1e-12


@frozen_dataclass
class ThrustCurve:
    """Relative thrust f u^2 + (1 - f) u of a command u, PX4's model and ArduPilot's.

    - `factor`: f: THR_MDL_FAC of PX4, MOT_THST_EXPO of ArduPilot.
    - `error`: largest difference to the law, as a fraction of full thrust.
    """

    factor: float
    error: float

    def command(self, thrust: float) -> float:
        """Solve for the command u at a thrust, both as a fraction of full."""
        f = self.factor
        if f < 1e-12:
            return thrust
        b = 1.0 - f
        return float((-b + np.sqrt(b * b + 4.0 * f * thrust)) / (2.0 * f))


def speeds(law: MotorLaw, commands: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Compute the speed at commands, at the battery's nominal voltage [rad/s]."""
    nominal = MotorLaw(curve=law.curve)
    return speed_from_command(commands[:, None], nominal)[:, 0]


def command_range(law: MotorLaw) -> tuple[float, float]:
    """Return the commands at which a law's rotor begins to turn, and is at full speed."""
    if isinstance(law.curve, SquareRootCurve):
        return law.curve.start, law.curve.end
    return dead_zone(law), 1.0


def dead_zone(law: MotorLaw) -> float:
    """Find the largest command at which a law's rotor stands; 0 if it turns at any."""
    standing = np.flatnonzero(speeds(law, GRID) <= 0.0)
    return float(GRID[standing[-1]]) if len(standing) else 0.0


def betaflight_linear(law: MotorLaw) -> ThrustCurve:
    """Fit the factor by which Betaflight's ``thrust_linear`` makes thrust linear, 0 to 1.5."""
    # From the best of a few, as Newton's steps end in the nearest minimum.
    tried = np.linspace(*LINEAR_RANGE, 7)
    # Betaflight moves each motor's output x to x (1 + c (1 - x)^2), c being thrust_linear / 100
    # (src/main/flight/pid.c, pidApplyThrustLinearization): the c for which thrust between idle and
    # full is nearest to a straight line.
    c = float(tried[np.argmin(np.mean(bends_of_thrust(law, tried) ** 2, axis=1))])
    for _ in range(NEWTON_STEPS):
        below, here, above = np.mean(bends_of_thrust(law, c + NEARBY) ** 2, axis=1).tolist()
        slope = (above - below) / (2.0 * NEARBY[2])
        curvature = (above - 2.0 * here + below) / NEARBY[2] ** 2
        c = float(np.clip(c - slope / max(curvature, TINY), *LINEAR_RANGE))
    return ThrustCurve(factor=c, error=float(np.abs(bends_of_thrust(law, np.array([c]))).max()))


def bends_of_thrust(law: MotorLaw, factors: Float[np.ndarray, " c"]) -> Float[np.ndarray, "c n"]:
    """Compute thrust's distance from a straight line, as a share of full thrust over idle."""
    moved = np.clip(GRID * (1.0 + factors[:, None] * (1.0 - GRID) ** 2), 0.0, 1.0)
    thrust = speeds(law, moved.ravel()).reshape(moved.shape) ** 2
    idle, full = thrust[:, :1], thrust[:, -1:]
    return (thrust - idle) / (full - idle) - GRID


def thrust_curve(law: MotorLaw, *, start: float = 0.0, end: float = 1.0) -> ThrustCurve:
    """Fit the curve nearest to a law, in the mean square of thrust over all commands.

    Its command u is 0 at the command `start` of the law, and 1 at its command `end`.

    Thrust goes with the speed squared; r = f u^2 + (1 - f) u is r - u = f (u^2 - u), so that f is
    one quotient, kept between 0 and 1 as both autopilots do.
    """
    u = GRID
    speed = speeds(law, start + (end - start) * u)
    relative = (speed / speed[-1]) ** 2
    bend = u**2 - u
    f = float(np.clip(bend @ (relative - u) / (bend @ bend), 0.0, 1.0))
    return ThrustCurve(factor=f, error=float(np.abs(f * bend + u - relative).max()))
