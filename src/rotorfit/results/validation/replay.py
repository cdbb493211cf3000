r"""Rotor speeds of a flight fed to the identified vehicle, over many short windows.

Each window begins with the rates that were measured, and goes on by Newton and Euler alone:

.. math::

    I_C \dot\omega = \sum_i (\tau_i \Omega_i^2 + l_i \Omega_i - d_i \Omega_i \omega_z e_z) - \dot h
    - \omega \times (I_C \omega + h)

with :math:`h` the angular momentum of the rotors in the body, :math:`l_i` the torque in proportion
to speed, and :math:`d_i` the drag of rotors that the turn carries through the air. Where the
velocity is known, the wrench of the air at that velocity and the flown rates (drag and inflow of
the rotors, wakes, drag of the frame) is there in place of :math:`d_i`. Attitude, place and gravity
are not in it: the accelerometer reads force over mass, whatever the attitude. A general engine
would give nothing more here (MuJoCo's model even leaves the reaction of spinning-up rotors out);
these few lines step all windows and all draws of the parameters at once.

What was flown is smoothed without delay (30 Hz) before windows start from it and are compared with
it: the gyro's noise at one instant would else be carried through the whole window.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import FlightError
from rotorfit.flight.signals import smooth
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float, Int

    from rotorfit.flight.flight_data import FlightData
    from rotorfit.results.validation.replay_vehicle import ReplayVehicle
    from rotorfit.results.validation.wrench_comparison import WrenchComparison

WINDOW: Final = 0.5
"""[s] Long enough for an error of inertia to show, too short for rates to drift out of hand."""
MOST_WINDOWS: Final = 240
SMOOTH: Final = 30.0
"""Low-pass of what was flown [Hz]."""
BLOCK: Final = 0.05
"""Accelerations are compared in means over this time [s], without most of the vibration."""
HOLD: Final = "constant rate"
IDENTIFIED: Final = "identified"
NORMAL_95: Final = 1.96


@frozen_dataclass
class Predicted:
    """Predictions by one set of parameters in K windows.

    - `rates`, `rates_std`: at each instant [rad/s], and the deviation of the draws, zeros without.
    - `force`: specific force at the accelerometer, means over blocks [m/s^2].
    """

    label: str
    rates: Float[np.ndarray, "K S 3"]
    rates_std: Float[np.ndarray, "K S 3"]
    force: Float[np.ndarray, "K B 3"]


@frozen_dataclass
class Replay:
    """One flight in windows: flown, and predicted by one or more sets of parameters.

    - `time`: since the log's first sample [s].
    - `block`: duration of a block of the accelerations [s].
    - `rates`, `force`: as flown, smoothed [rad/s], and means over blocks [m/s^2].
    - `predicted`: the first one is the result's.
    - `comparison`: of the wrenches of the same flight; None if it is too short.
    """

    flight: str
    sha256: str
    configuration: str
    time: Float[np.ndarray, "K S"]
    block: float
    rates: Float[np.ndarray, "K S 3"]
    force: Float[np.ndarray, "K B 3"]
    predicted: tuple[Predicted, ...]
    comparison: WrenchComparison | None = None


@frozen_dataclass
class Entrant:
    """One set of parameters, and the rotor speeds at the motors' timing that goes with it.

    `air`: wrench about the origin of a unit of each of `AIR_NAMES`; None without a velocity.
    """

    vehicle: ReplayVehicle
    rotor_speed: Float[np.ndarray, "n N"]
    air: Float[np.ndarray, "n P 6"] | None = None


def replay(
    data: FlightData,
    entrants: Mapping[str, Entrant],
    *,
    flight: str,
    sha256: str = "",
    configuration: str = "",
    seconds: float = WINDOW,
) -> Replay:
    """Replay a flight with every vehicle, window by window.

    Parameters
    ----------
    data
        The flight.
    entrants
        By label; vehicles after the first of each are draws, and make its band.
    flight, sha256, configuration
        Which flight it is.
    seconds
        Length of a window [s].

    Raises
    ------
    FlightError
        If no stretch of the flight is as long as one window.
    """
    dt, steps = 1.0 / data.sample_rate, max(round(seconds * data.sample_rate), 2)
    starts = window_starts(data, steps)
    if not len(starts):
        raise FlightError(
            f"{flight}: no airborne stretch is as long as a window of {seconds:g} s; give a longer "
            "flight (--flight)"
        )
    rows = starts[:, None] + np.arange(steps + 1)
    size = max(round(BLOCK * data.sample_rate), 1)
    w, a = _smooth_segments(data, data.angular_velocity), data.specific_force
    return Replay(
        flight=flight,
        sha256=sha256,
        configuration=configuration,
        time=data.time[rows] - data.time[0],
        block=size / data.sample_rate,
        rates=w[rows],
        force=_average_blocks(a[rows], size),
        predicted=tuple(
            _predict_windows(label, entrant, dt, rows=rows, start=w[starts], size=size)
            for label, entrant in entrants.items()
        ),
    )


def window_starts(data: FlightData, steps: int) -> Int[np.ndarray, " K"]:
    """Place windows end to end through each airborne stretch, evenly thinned."""
    starts = np.concatenate(
        [np.arange(s.start, s.stop - steps, steps) for s in data.segments]
        or [np.zeros(0, dtype=np.int64)]
    )
    if len(starts) <= MOST_WINDOWS:
        return starts
    return starts[np.linspace(0, len(starts) - 1, MOST_WINDOWS).astype(np.int64)]


def _smooth_segments(
    data: FlightData, values: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    out = values.copy()
    for s in data.segments:
        out[s.start : s.stop] = smooth(values[s.start : s.stop], data.sample_rate, SMOOTH)
    return out


def _average_blocks(values: Float[np.ndarray, "K S 3"], size: int) -> Float[np.ndarray, "K B 3"]:
    """Average consecutive samples; an incomplete block at the end is dropped."""
    count = max((values.shape[1] - 1) // size, 1)
    return values[:, : count * size].reshape(len(values), count, -1, 3).mean(axis=2)


def _predict_windows(
    label: str,
    entrant: Entrant,
    dt: float,
    *,
    rows: Int[np.ndarray, "K S"],
    start: Float[np.ndarray, "K 3"],
    size: int,
) -> Predicted:
    """Step all windows and all draws at once; keep the nominal vehicle and the draws' spread."""
    vehicle, speed = entrant.vehicle, entrant.rotor_speed[rows]
    if entrant.air is not None:
        vehicle = dataclasses.replace(vehicle, damping=np.zeros_like(vehicle.damping))
    inverse = np.linalg.inv(vehicle.inertia)
    draws = len(vehicle.mass)
    w = np.repeat(start[None], draws, axis=0)
    rates, spread, force = np.empty((3, *rows.shape, 3))
    for k in range(rows.shape[1]):
        last = k + 1 == rows.shape[1]
        begin, end = (speed[:, k - 1], speed[:, k]) if last else (speed[:, k], speed[:, k + 1])
        slope = (end - begin) / dt
        rates[:, k] = w[0]
        spread[:, k] = w[1:].std(axis=0) if draws > 2 else 0.0
        push, turn = _air_of(vehicle, entrant.air, rows[:, k])
        dw = _angular_acceleration(vehicle, inverse, w[:1], speed[:, k], slope, turn[:1])
        force[:, k] = _predict_force(vehicle, w[0], dw[0], speed[:, k]) + push[0] / vehicle.mass[0]
        if not last:
            w = _step_motion(vehicle, inverse, w, (begin, end), dt, turn)
    return Predicted(label=label, rates=rates, rates_std=spread, force=_average_blocks(force, size))


def _angular_acceleration(
    vehicle: ReplayVehicle,
    inverse: Float[np.ndarray, "D 3 3"],
    w: Float[np.ndarray, "E K 3"],
    speed: Float[np.ndarray, "K N"],
    slope: Float[np.ndarray, "K N"],
    turn: Float[np.ndarray, "E K 3"],
) -> Float[np.ndarray, "E K 3"]:
    """Compute the angular acceleration of the first E vehicles: Euler's equation about the CoM."""
    first = slice(0, len(w))
    torque = speed**2 @ vehicle.torque[first] - slope @ vehicle.spin[first]
    torque += speed @ vehicle.speed_torque[first] + vehicle.offset[first, None] + turn
    torque[..., 2] -= w[..., 2] * (vehicle.damping[first] @ speed.T)
    turning = w @ vehicle.inertia[first] + speed @ vehicle.spin[first]
    return (torque - np.cross(w, turning)) @ inverse[first]


def _step_motion(
    vehicle: ReplayVehicle,
    inverse: Float[np.ndarray, "D 3 3"],
    w: Float[np.ndarray, "D K 3"],
    speeds: tuple[Float[np.ndarray, "K N"], Float[np.ndarray, "K N"]],
    dt: float,
    turn: Float[np.ndarray, "D K 3"],
) -> Float[np.ndarray, "D K 3"]:
    """Take one Runge-Kutta step of fourth order; the speed goes straight between two samples.

    `turn`: torque of the air, which hardly changes in a step.
    """
    begin, end = speeds
    slope, middle = (end - begin) / dt, 0.5 * (begin + end)
    k1 = _angular_acceleration(vehicle, inverse, w, begin, slope, turn)
    k2 = _angular_acceleration(vehicle, inverse, w + 0.5 * dt * k1, middle, slope, turn)
    k3 = _angular_acceleration(vehicle, inverse, w + 0.5 * dt * k2, middle, slope, turn)
    k4 = _angular_acceleration(vehicle, inverse, w + dt * k3, end, slope, turn)
    return w + dt / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


def _air_of(
    vehicle: ReplayVehicle,
    air: Float[np.ndarray, "n P 6"] | None,
    rows: Int[np.ndarray, " K"],
) -> tuple[Float[np.ndarray, "D K 3"], Float[np.ndarray, "D K 3"]]:
    """Compute force and torque about the CoM of the air as flown, zeros without a velocity."""
    if air is None:
        nothing = np.zeros((len(vehicle.mass), len(rows), 3))
        return nothing, nothing
    wrench = np.einsum("dp,kpj->dkj", vehicle.air, air[rows])
    force = wrench[..., :3]
    return force, wrench[..., 3:] - np.cross(vehicle.com[:, None], force)


def _predict_force(
    vehicle: ReplayVehicle,
    w: Float[np.ndarray, "K 3"],
    dw: Float[np.ndarray, "K 3"],
    speed: Float[np.ndarray, "K N"],
) -> Float[np.ndarray, "K 3"]:
    """Predict the accelerometer of the first vehicle [m/s^2]."""
    place = vehicle.imu - vehicle.com[0]
    at_com = speed**2 @ vehicle.thrust[0] / vehicle.mass[0]
    lever = np.cross(dw, place) + np.cross(w, np.cross(w, place))
    return at_com + lever + vehicle.accel_bias[0]


def error_growth(replays: Sequence[Replay], label: str) -> Float[np.ndarray, "S 3"]:
    """Compute the rms error of the rates over all windows, by the time since their start [rad/s].

    Of `HOLD`: the error of the prediction of constant rates.
    """
    return _rms_of_errors([_rates_of_label(r, label) - r.rates for r in replays])


def band_growth(replays: Sequence[Replay], label: str) -> Float[np.ndarray, "S 3"]:
    """Compute the half-width of the 95 % band of the parameters, rms over all windows [rad/s]."""
    return NORMAL_95 * _rms_of_errors([_prediction_of(r, label).rates_std for r in replays])


def force_errors(replays: Sequence[Replay], label: str) -> Float[np.ndarray, " 3"]:
    """Compute the rms error of the specific force, per axis [m/s^2].

    Of `HOLD`: of the first block of each window, held.
    """
    errors = [
        (r.force[:, :1] if label == HOLD else _prediction_of(r, label).force) - r.force
        for r in replays
    ]
    return np.sqrt(np.mean(np.concatenate([e.reshape(-1, 3) for e in errors]) ** 2, axis=0))


def _rms_of_errors(errors: Sequence[Float[np.ndarray, "_ _ 3"]]) -> Float[np.ndarray, "S 3"]:
    """Compute the root mean square over windows; faster logs are thinned evenly to the slowest."""
    least = min(e.shape[1] for e in errors)
    thinned = [e[:, _spread_places(e.shape[1], least)] for e in errors]
    return np.sqrt(np.mean(np.concatenate(thinned) ** 2, axis=0))


def _spread_places(count: int, least: int) -> Int[np.ndarray, " k"]:
    """Return `least` of `count` places, evenly spread, both ends among them."""
    return (np.linspace(0, count - 1, least) + 0.5).astype(np.int64)


def _rates_of_label(replay: Replay, label: str) -> Float[np.ndarray, "K S 3"]:
    if label == HOLD:
        return np.repeat(replay.rates[:, :1], replay.rates.shape[1], axis=1)
    return _prediction_of(replay, label).rates


def _prediction_of(replay: Replay, label: str) -> Predicted:
    return next(p for p in replay.predicted if p.label == label)


def growth_time(replays: Sequence[Replay]) -> Float[np.ndarray, " S"]:
    """Return the time since the start of a window that belongs to `error_growth` [s]."""
    least = min(replays, key=lambda r: r.time.shape[1])
    return np.linspace(0.0, float(least.time[0, -1] - least.time[0, 0]), least.time.shape[1])
