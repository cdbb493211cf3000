r"""Measure the bandwidth of the channels: up to which frequency they follow what the rotors do.

Sensors are filtered: by an autopilot's low-passes, by an estimator, by the smoothing of motion
capture. Above its bandwidth a channel shows no motion where there is some, and lines without motion
say "no thrust" with great certainty. From the spectra of windows of a flight each of four channels
y (specific force along z, three angular accelerations) is regressed on the signals x of the model,
those of the rotors behind a low-pass H and a delay,

.. math:: y(f) = H(f; f_c) e^{-2 \pi i f \tau} \sum_j \beta_j x_j(f) + \sum_k \gamma_k x_k(f)

with the noise of each band by what is left of it. The likelihood of shapes and cut-offs, against
none at all, says whether there is a filter, and where: f_c is where its gain is .71. The
accelerometer's noise passes the filter as well, and is judged by the same shapes and cut-offs
(`noise_rolloff.py`): it shows filters above the frequencies of what is flown. Roll and pitch
are of one gyro, and have one filter. Yaw shows none: the torque of propellers lags by itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.fit.reduction.channel_powers import (
    EDGES,
    Channel,
    ChannelPowers,
    likelihoods_of_gains,
    powers_of,
)
from rotorfit.fit.reduction.noise_rolloff import judge_noise
from rotorfit.fit.reduction.windows import WINDOW, transform_rows, window_starts
from rotorfit.flight.on_board import first_order, second_order
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.signals import central_average

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from jaxtyping import Bool, Complex, Float

    from rotorfit.flight.flight_data import FlightData
    from rotorfit.model.vehicle import Vehicle

    Shape = Callable[[Float[np.ndarray, " l"]], Complex[np.ndarray, " l"]]
    """Gain of a low-pass by frequency over its cut-off."""

ON_BOARD: Final[Mapping[str, Shape]] = {
    "first order": first_order,
    "second order": second_order,
}
"""Low-passes on board: PT1, Butterworth."""
SHAPES: Final[Mapping[str, Shape]] = {
    **ON_BOARD,
    "smoothed": lambda u: np.exp(-0.5 * np.log(2.0) * u**2).astype(complex),
    "smoothed both ways": lambda u: (1.0 / (1.0 + (np.sqrt(2.0) - 1.0) * u**4)).astype(complex),
    "smoothed sharply": lambda u: ((1.0 + u**8) ** -0.5).astype(complex),
}
"""Low-passes on board, and smoothing without delay (of motion capture)."""
CUTOFFS: Final = np.geomspace(1.0, 60.0, 40)
"""Cut-offs that are tried [Hz]."""
STEP: Final = float(np.sqrt(CUTOFFS[1] / CUTOFFS[0]))
"""Half of a step between them, as a factor."""
WITHIN: Final = 1.92
"""Log-likelihood by which the 95 % interval falls: half the quantile of chi^2 with one degree of
freedom (Wilks)."""
ALLOWED: Final = 0.5
"""Share of the best shape's gain that the shape of the noise must have: where rotors answer gusts,
motion prefers a wrong shape, and the right one has .6 or more (59 of 60 random fast worlds); in
calm air, where motion is right, a shape that noise prefers by chance had .42 at most."""
EACH_BAND: Final = 0.5
"""What a band of the noise counts beside its neighbours, which share its peaks."""
DELAYS: Final = np.arange(-0.012, 0.0281, 0.004)
"""Delays that are tried [s]: half of a step turns 15 Hz by a fifth of a radian."""
LOWEST: Final = 0.5
"""Frequency below which the air and what is flown make forces of their own [Hz]."""
LEAST_GAIN: Final = 20.0
"""Gain of log-likelihood for which a low-pass is taken to be there: flights without one gain 0 to
16 (CineRat, Betaflight, PX4's simulator, Crazyflie), those behind one at 4 to 20 Hz 27 to 8500."""
SOME: Final = slice(1, None, 3)
"""Cut-offs that are tried first."""
MAY_GAIN: Final = 0.5
"""Share of that gain for which all cut-offs are tried: of every third the best gains .9 of the best
of all or more, where that gains anything."""
LEAST_FOLLOWED: Final = 0.85
"""Least gain at which a band counts. What a band says of a number is off by as much as its gain."""
LEAST_SURE: Final = 12.0
"""Gain of log-likelihood for which a gyro is filtered, with the error that `FEEDBACK` leaves: 48
gyros of random fast worlds without a filter gain 0 to 9."""
FEWEST_WINDOWS: Final = 4


@frozen_dataclass
class Bandwidth:
    """The bandwidth of a channel, as a flight shows it.

    - `shape`: of `SHAPES`.
    - `cutoff`, `interval`: where the gain is .71, and its 95 % interval [Hz].
    - `delay`: beside that of the filter [s].
    - `gain`: of log-likelihood, against no low-pass.
    - `taken_off`: whether the flight's samples are no longer late by it.
    """

    shape: str
    cutoff: float
    interval: tuple[float, float]
    delay: float
    gain: float
    taken_off: bool = False

    @property
    def slow_delay(self) -> float:
        """By how much the low-pass delays slow motion [s]."""
        slow = 0.01
        phase = float(np.angle(SHAPES[self.shape](np.array([slow])))[0])
        return -phase / (2.0 * np.pi * slow * self.cutoff)

    def response(self, frequency: Float[np.ndarray, " l"]) -> Complex[np.ndarray, " l"]:
        """Compute the gain and phase of the low-pass at the lower end of the interval."""
        return SHAPES[self.shape](frequency / self.interval[0])

    def follows(self, frequency: Float[np.ndarray, " l"], *, in_phase: bool) -> float:
        """Return up to which frequency the channel follows; with `in_phase`, without being late."""
        gain = self.response(frequency)
        late = np.exp(-2j * np.pi * frequency * self.delay)
        size = np.real(gain * late) if in_phase else np.abs(gain)
        lost = np.flatnonzero(size < LEAST_FOLLOWED)
        return float(frequency[lost[0]]) if len(lost) else np.inf


Sensor = Literal["accel", "gyro"]
CHANNELS: Final[Mapping[Sensor, tuple[str, ...]]] = {"accel": ("az",), "gyro": ("dwx", "dwy")}
"""The channels by which the bandwidth of each sensor is measured."""


def bandwidths(data: FlightData, vehicle: Vehicle, *, top: float) -> dict[Sensor, Bandwidth]:
    """Find which sensors of a flight are behind a low-pass, with their bandwidth.

    `data`: with the motors as they are timed. `top`: highest frequency that is looked at [Hz].
    """
    frequency, channels = channel_lines(data, vehicle, top=top)
    found: dict[Sensor, Bandwidth] = {}
    for sensor, names in CHANNELS.items():
        own = [channels[name] for name in names]
        if len(own[0].y) < FEWEST_WINDOWS:
            continue
        noise = judge_noise(data, vehicle, SHAPES, CUTOFFS, top=top) if sensor == "accel" else None
        one = measured_bandwidth(frequency, own, noise)
        if one is not None:
            found[sensor] = one
    return found


def channel_lines(
    data: FlightData, vehicle: Vehicle, *, top: float
) -> tuple[Float[np.ndarray, " l"], dict[str, Channel]]:
    """Transform the channels of a flight and their causes, window by window."""
    rows = round(WINDOW * data.sample_rate)
    frequency = np.fft.rfftfreq(rows, 1.0 / data.sample_rate)
    inside = (frequency >= LOWEST) & (frequency < min(top, EDGES[-1]))
    signals = {
        name: (y, np.column_stack(x), made)
        for name, (y, x, made) in _causes_of_channels(data, vehicle)
    }
    Z = np.column_stack([np.column_stack([y, x]) for y, x, _ in signals.values()])
    window = np.hanning(rows)[:, None]
    lines = [
        transform_rows(Z[start : start + rows], window)[inside]
        for start in window_starts(data, rows)
    ]
    every = np.array(lines) if lines else np.zeros((0, int(inside.sum()), Z.shape[1]), complex)
    channels: dict[str, Channel] = {}
    first = 0
    for name, (_, x, made) in signals.items():
        last = first + 1 + x.shape[1]
        channels[name] = Channel(every[:, :, first], every[:, :, first + 1 : last], made)
        first = last
    return frequency[inside], channels


def _causes_of_channels(
    data: FlightData, vehicle: Vehicle
) -> Iterator[tuple[str, tuple[Float[np.ndarray, " n"], list[Float[np.ndarray, " n"]], int]]]:
    """Yield each channel with its causes: first those of the rotors, then damping and air."""
    squares, w = data.rotor_speed**2, data.angular_velocity
    torque, thrust = vehicle.levers, squares @ vehicle.axes
    average = _average_rows if data.differentiation == "central" else _keep_values
    air = [average(one) for one in _air_signals(data)]
    yield "az", (average(data.specific_force[:, 2]), [average(thrust[:, 2]), *air], 1)
    for axis, name in enumerate(CHANNELS["gyro"]):
        causes = [average(squares @ torque[:, axis]), average(w[:, axis])]
        yield name, (data.angular_acceleration[:, axis], causes, 1)


def _air_signals(data: FlightData) -> list[Float[np.ndarray, " n"]]:
    """Return the signals of inflow and of speed squared."""
    speeds = data.rotor_speed.sum(axis=1)
    velocity = data.any_velocity
    if velocity is not None:
        v = np.nan_to_num(velocity)
        return [v[:, 2] * speeds, (v[:, :2] ** 2).sum(axis=1)]
    return [] if data.climb is None else [np.nan_to_num(data.climb) * speeds]


def _average_rows(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Average with [1 4 1]/6, as central differences are."""
    found = values.copy()
    found[1:-1] = central_average(values)
    return found


def _keep_values(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return values


def measured_bandwidth(
    frequency: Float[np.ndarray, " l"],
    channels: Sequence[Channel],
    noise: Mapping[str, Float[np.ndarray, " c"]] | None = None,
) -> Bandwidth | None:
    """Find the low-pass common to the channels of a sensor; None if the flight shows none.

    `noise`: gain of log-likelihood of the noise, by shape and cut-off.
    """
    powers = [powers_of(frequency, one) for one in channels]
    none = _by_lowpass(frequency, powers, _no_filter(frequency)).max()
    if not _may_be_filtered(frequency, powers, none, noise):
        return None
    every: dict[str, Float[np.ndarray, "c d"]] = {}
    for name, shape in SHAPES.items():
        every[name] = _by_lowpass(frequency, powers, _gains_of(shape, frequency)) - none
        if noise is not None:
            every[name] += noise[name][:, None]
    whole = {name: one.max(axis=1) for name, one in every.items()}
    best, i = _likeliest_lowpass(whole)
    gain = float(whole[best][i])
    # An autopilot that works against gusts turns the motion, but not the noise. Neighbouring bands
    # of that share peaks: two count as one.
    alone = {name: EACH_BAND * one for name, one in (noise or {}).items()}
    if alone:
        best, i = _shape_by_noise(whole, alone)
    near = _mark_near_best(whole[best])
    if alone:  # where the two differ, the interval has both
        near = near | _mark_near_best(np.max(list(alone.values()), axis=0))
    late = int(np.argmax(every[best][i]))
    cutoffs = CUTOFFS[near]
    found = Bandwidth(
        shape=best,
        cutoff=float(CUTOFFS[i]),
        interval=(float(cutoffs[0]) / STEP, float(cutoffs[-1]) * STEP),
        delay=float(DELAYS[late]),
        gain=float(every[best][i, late]),
    )
    shown = gain > LEAST_GAIN and found.interval[1] < CUTOFFS[-1]
    if shown and noise is None and best in ON_BOARD:
        shown = _exceeds_response_to_gusts(frequency, channels, SHAPES[best])
    return found if shown else None


def _shape_by_noise(
    whole: Mapping[str, Float[np.ndarray, " c"]], alone: Mapping[str, Float[np.ndarray, " c"]]
) -> tuple[str, int]:
    """Return the shape and the place of the cut-off that motion and noise show together.

    Noise that tells a shape, or those on board or of smoothing, from all others shows the filter,
    if the motion allows it. `whole`, `alone`: gains of log-likelihood, by both and by the noise.
    """
    likeliest = _likeliest_lowpass(whole)
    name, k = _likeliest_lowpass(alone)
    of_its_kind = [one for one in SHAPES if (one in ON_BOARD) == (name in ON_BOARD)]
    for alike in ([name], of_its_kind):
        others = max(float(one.max()) for shape, one in alone.items() if shape not in alike)
        if alone[name][k] - others > WITHIN:
            if likeliest[0] in alike:
                break
            shown = {shape: alone[shape] if alike == [name] else whole[shape] for shape in alike}
            best, i = _likeliest_lowpass(shown)
            if whole[best].max() > ALLOWED * whole[likeliest[0]].max():
                return best, i
    return likeliest


def _likeliest_lowpass(gains: Mapping[str, Float[np.ndarray, " c"]]) -> tuple[str, int]:
    """Return the shape and the place of the cut-off with the largest gain of log-likelihood."""
    best = max(gains, key=lambda name: float(gains[name].max()))
    return best, int(np.argmax(gains[best]))


def _exceeds_response_to_gusts(
    frequency: Float[np.ndarray, " l"], channels: Sequence[Channel], shape: Shape
) -> bool:
    """Return whether a filter is shown even if bands err by the rotors' answer to gusts."""
    # Where a sensor has no noise of its own to show its filter, that answer is late as behind one
    # on board; smoothing is not late.
    powers = [powers_of(frequency, one, careful=True) for one in channels]
    filtered, none = (
        _by_lowpass(frequency, powers, gains).max()
        for gains in (_gains_of(shape, frequency), _no_filter(frequency))
    )
    return bool(filtered - none > LEAST_SURE)


def _gains_of(
    shape: Shape, frequency: Float[np.ndarray, " l"], cutoffs: Float[np.ndarray, " c"] = CUTOFFS
) -> Complex[np.ndarray, "c l"]:
    """Return the gain of a low-pass at each cut-off."""
    return np.array([shape(frequency / cutoff) for cutoff in cutoffs])


def _no_filter(frequency: Float[np.ndarray, " l"]) -> Complex[np.ndarray, "1 l"]:
    return np.ones((1, len(frequency)), dtype=complex)


def _mark_near_best(likelihood: Float[np.ndarray, " c"]) -> Bool[np.ndarray, " c"]:
    """Mark the cut-offs in the 95 % interval."""
    return likelihood > likelihood.max() - WITHIN


def _may_be_filtered(
    frequency: Float[np.ndarray, " l"],
    powers: Sequence[ChannelPowers],
    none: float,
    noise: Mapping[str, Float[np.ndarray, " c"]] | None,
) -> bool:
    """Return whether one of few low-passes gains enough that the search among all is worth it."""
    most = -np.inf
    for name, shape in SHAPES.items():
        gains = _gains_of(shape, frequency, CUTOFFS[SOME])
        gained = _by_lowpass(frequency, powers, gains).max(axis=1) - none
        if noise is not None:
            gained = gained + noise[name][SOME]
        most = max(most, float(gained.max()))
    return most > MAY_GAIN * LEAST_GAIN


def _by_lowpass(
    frequency: Float[np.ndarray, " l"],
    powers: Sequence[ChannelPowers],
    gains: Complex[np.ndarray, "c l"],
) -> Float[np.ndarray, "c d"]:
    """Compute the log-likelihood of all channels, by low-pass and delay."""
    # A delay has to be free beside the low-pass: errors of the motors' time look like the phase of
    # one.
    late = np.exp(-2j * np.pi * DELAYS[:, None] * frequency)
    H = (gains[:, None] * late).reshape(-1, len(frequency))
    every = [likelihoods_of_gains(one, H) for one in powers]
    return np.sum(every, axis=0).reshape(len(gains), len(DELAYS))
