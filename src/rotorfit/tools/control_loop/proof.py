"""Compare the predicted loop with the one flown: controller replayed, closed loop by bands.

The closed loop from set point r to rate y is measured with an instrument z that gusts do not move:
what the outer loop asked for beyond its feedback, r' + K y (K: rate asked for per angle), so that
T = S_zy / S_zr (instrumental variables; Soderstrom and Stoica 1989). S_ry / S_rr would take the
outer loop's response to gusts for one to the pilot.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.digits import with_half
from rotorfit.flight.filters import butterworth, filter_both_ways
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.tools.control_loop.controllers import RateController, moving_filters, thrust_curve
from rotorfit.tools.control_loop.vehicle import Flown, cross_spectra, withheld_output

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Complex, Float

    from rotorfit.logs.flight_log import FlightLog
    from rotorfit.tools.control_loop.plant import Plant

EDGES = 0.3 * 1.5 ** np.arange(13)
"""Edges of the bands [Hz]."""
LONGEST = 8.0
"""Length of a spectrum [s]."""
WINDOWS = 0.8
"""Independent spectra for each of those that overlap by half."""
SHOWN = 0.25
"""Distance from the prediction, uncertainty included, within which a band proves it."""
MODEL = 0.02
"""Distance that a linear model of hover leaves, one deviation."""
GAIN, LATE = 0.05, 0.5e-3
"""Errors of effectiveness, and of the delay [s], that a linear model of hover leaves."""
LEFT = np.diag([0.5 * GAIN, LATE]) ** 2
"""The same as covariance of what a measured closed loop says of effectiveness and delay."""
FLOWN = 0.01
"""Deviation of a flown loop's effectiveness from that of the rigid body: ArduCopter's and PX4's
loops have .98 to 1.01 times that."""
SHARP = 0.15
"""Half-widths of effectiveness, and of phase at the crossover [rad], from which on a flight does
not show them."""
UNKNOWN = np.diag([1.0, 1.0])
"""Covariance where the closed loop shows nothing."""
EXACT = 1e-5
"""Tolerance of a set point's stamp [s]."""
ABOVE = 3.0
"""Times the crossover up to which the closed loop is judged."""
SMOOTH = 15.0
"""Frequency up to which derivatives are compared [Hz]: the log is slower than the gyro."""
PIECES = 10
"""Pieces of a flight, to see how much an estimate differs among them."""
SLOPE = 0.03
"""Difference of the replayed output's slope from one, beyond which the controller was misread."""


@frozen_dataclass
class ReplayedOutput:
    """The logged output over the replayed one: slope, and share that is left.

    `derivative`: the slope of the logged derivative of the rate, where the log has it.
    """

    slope: float
    left: float
    derivative: float = 1.0

    @property
    def is_right(self) -> bool:
        """Whether the controller was read rightly."""
        return max(abs(self.slope - 1.0), abs(self.derivative - 1.0)) <= SLOPE


@frozen_dataclass
class ReplayedMixer:
    """The motors' commands over the output of an axis.

    - `name`, `factor`: of the parameter that bends the curve, and as the commands have it.
    - `slope`, `half_width`: of the thrust by the output, over that with the parameter's own value;
      half of its 95 % interval.
    """

    name: str
    factor: float
    slope: float
    half_width: float

    @property
    def is_right(self) -> bool:
        """Whether the mixer is as its parameters set it."""
        return abs(self.slope - 1.0) <= SLOPE + self.half_width


def replay_mixer(flight: Flown, axis: int) -> ReplayedMixer | None:
    """Measure the curve by which commands follow the outputs; None if the log has no curve."""
    curve = thrust_curve(flight.log)
    free = flight.free
    if curve is None or free.sum() < PIECES**2:
        return None
    u = (flight.commands[free] - curve.start) / (curve.end - curve.start)
    bent = u * u - u
    mean = (u + curve.factor * bent).mean(axis=1)
    columns = np.column_stack([flight.log.output[free], mean, np.ones(len(u))])
    # Thrust u + f (u^2 - u) of a motor is linear in the outputs and the mean thrust: what of u is
    # not is - f times what of u^2 - u is not. Pieces of the flight show how well f is known.
    by_u, by_bent = (np.linalg.lstsq(columns, x, rcond=None)[0] for x in (u, bent))
    of_u, of_bent = u - columns @ by_u, bent - columns @ by_bent
    straight, curved = (of_u * of_bent).sum(axis=1), (of_bent * of_bent).sum(axis=1)
    factors = [
        -float(straight[piece].sum() / max(curved[piece].sum(), np.finfo(float).tiny))
        for piece in (slice(None), *pieces(len(u)))
    ]
    rotor = int(np.argmax(np.abs(by_u[axis])))
    slopes = by_u[axis, rotor] + np.array([curve.factor, *factors]) * by_bent[axis, rotor]
    ratios: Float[np.ndarray, " p"] = slopes[1:] / slopes[0]
    return ReplayedMixer(
        name=curve.name,
        factor=factors[0],
        slope=float(ratios[0]),
        half_width=1.96 * float(ratios[1:].std(ddof=1)) / PIECES**0.5,
    )


def pieces(count: int) -> list[slice]:
    """Part rows into pieces of a flight."""
    edges = np.linspace(0, count, PIECES + 1).astype(int).tolist()
    return [slice(a, b) for a, b in itertools.pairwise(edges)]


@frozen_dataclass
class Band:
    """The closed loop in a band, measured over predicted.

    - `low`, `high`: [Hz]
    - `ratio`, `degrees`: measured over predicted: size, and phase [deg].
    - `uncertainty`: half of the 95 % interval of the complex ratio.
    - `by_gain`, `by_delay`: slope of the prediction's logarithm by that of the effectiveness, and
      by the delay [1/s].
    """

    low: float
    high: float
    ratio: float
    degrees: float
    uncertainty: float
    by_gain: complex
    by_delay: complex

    @property
    def proved(self) -> bool:
        """Whether it is as predicted, uncertainty included."""
        return abs(self.complex_ratio - 1.0) + self.uncertainty < SHOWN

    @property
    def complex_ratio(self) -> complex:
        """Measured over predicted, size and phase together."""
        return self.ratio * complex(np.exp(1j * np.radians(self.degrees)))


@frozen_dataclass
class LoopError:
    """The error of the predicted loop, by the closed loop as flown.

    - `gain`: effectiveness over the predicted one.
    - `delay`: by how much later the loop is than predicted [s].
    - `covariance`: of the gain's logarithm and the delay.
    """

    gain: float
    delay: float
    covariance: Float[np.ndarray, "2 2"]

    @property
    def half_widths(self) -> tuple[float, float]:
        """Half of the 95 % intervals of gain and delay [1, s]."""
        first, second = 1.96 * np.sqrt(np.diag(self.covariance))
        return float(first), float(second)

    def is_wrong(self, plant: Plant) -> bool:
        """Whether it contradicts the vehicles that the result leaves open."""
        spread = 1.96 * plant.spread.std(axis=1)
        gain, delay = np.hypot(self.half_widths, spread)
        return abs(np.log(self.gain)) > GAIN + gain or abs(self.delay) > LATE + delay

    def within(self, longest: tuple[float, float]) -> LoopError:
        """Shorten a step to the longest of effectiveness (logarithm) and delay [s]."""
        by = np.abs([np.log(self.gain), self.delay]) / longest
        share = 1.0 / max(1.0, float(by.max()))
        return replace(self, gain=self.gain**share, delay=share * self.delay)

    def after(self, first: LoopError) -> LoopError:
        """Add an error that the prediction was moved by before."""
        return replace(self, gain=first.gain * self.gain, delay=first.delay + self.delay)

    def corrected(self, plant: Plant, seed: int) -> Plant:
        """Move the vehicles to where result and closed loop agree best (ensemble Kalman update)."""
        random = np.random.default_rng(seed)
        prior = plant.spread
        count = prior.shape[1] - 1
        correlated = np.cov(prior[:, 1:])
        # The measured loop is off by what a linear model of hover leaves: no error of the vehicle.
        covariance = self.covariance + LEFT
        weight = correlated @ np.linalg.inv(correlated + covariance)
        seen = np.tile([[np.log(self.gain)], [self.delay]], 1 + count)
        seen[:, 1:] += random.multivariate_normal(np.zeros(2), covariance, count).T
        gain, late = weight @ (seen - prior)
        return plant.moved(gain + np.r_[0.0, FLOWN * random.standard_normal(count)], late)


def replay_output(controller: RateController, flight: Flown, axis: int) -> ReplayedOutput:
    """Compare the logged output with the one that the controller gives for the logged flight."""
    log = flight.log
    made = controller.replayed(
        log.set_point[:, axis], log.rate[:, axis], None if log.slope is None else log.slope[:, axis]
    )
    slope, left = _follows_log(made, log.output[:, axis], log.period)
    derivative = 1.0
    if log.slope is not None:
        smooth = butterworth(2, SMOOTH, 1.0 / log.period)
        both = [controller.derivative(log.rate[:, axis]), log.slope[:, axis]]
        low = [filter_both_ways(smooth, x) for x in both]
        derivative, _ = _follows_log(low[0], low[1], log.period)
    return ReplayedOutput(slope=slope, left=left, derivative=derivative)


def _follows_log(
    made: Float[np.ndarray, " n"], logged: Float[np.ndarray, " n"], period: float
) -> tuple[float, float]:
    """Return slope of a logged series over a made one, and the share that is left."""
    # The integral's start, and what a take-off leaves in it, are no part of the comparison.
    edge = min(len(made) // 8, round(2.0 / period))
    rows = slice(edge, len(made) - edge)
    columns = np.column_stack([made[rows], np.ones(len(made[rows]))])
    out = logged[rows]
    (slope, offset), *_ = np.linalg.lstsq(columns, out, rcond=None)
    left = np.std(out - columns @ [slope, offset]) / max(float(np.std(out)), 1e-12)
    return float(slope), float(left)


@frozen_dataclass
class MeasuredLoop:
    """Spectra of one axis: of set point r and rate y, and across with the instrument z.

    - `frequency`: [Hz]
    - `zr`, `zy`, `zv`, `ry`: cross-spectra; v is what motors at their limit add to the output.
    - `zz`, `rr`, `yy`: power spectra.
    - `count`: of independent windows.
    """

    frequency: Float[np.ndarray, " b"]
    zr: Complex[np.ndarray, " b"]
    zy: Complex[np.ndarray, " b"]
    zv: Complex[np.ndarray, " b"]
    ry: Complex[np.ndarray, " b"]
    zz: Float[np.ndarray, " b"]
    rr: Float[np.ndarray, " b"]
    yy: Float[np.ndarray, " b"]
    count: float


def measured_loop(controller: RateController, flight: Flown, axis: int) -> MeasuredLoop:
    """Measure the spectra of an axis in flight."""
    log = flight.log
    at = np.arange(log.time[0], log.time[-1], log.period)
    asked, rate, added = (
        np.interp(at, log.time, values[:, axis])
        for values in (log.set_point, log.rate, withheld_output(flight))
    )
    instrument = np.gradient(asked, log.period) + controller.angle * rate
    length = min(round(LONGEST / log.period), len(at) // 8)
    grid, spectra = cross_spectra([instrument, asked, rate, added], log.period, length)
    (zz, zr, zy, zv), (_, rr, ry, _) = spectra[:2]
    count = WINDOWS * (2 * len(at) / length - 1)
    return MeasuredLoop(
        frequency=grid,
        zr=zr,
        zy=zy,
        zv=zv,
        ry=ry,
        zz=np.real(zz),
        rr=np.real(rr),
        yy=np.real(spectra[2, 2]),
        count=count,
    )


def closed_loop_bands(
    measured: MeasuredLoop,
    frequency: Float[np.ndarray, " f"],
    predicted: Complex[np.ndarray, " f"],
    inner: Complex[np.ndarray, " f"],
    by_output: Complex[np.ndarray, " f"],
) -> list[Band]:
    """Compare the measured with the predicted closed loop, band by band.

    `predicted`: rate over set point. `inner`: the open rate loop, by which the closed one changes
    with gain and delay. `by_output`: rate over what is added to the output, in closed loop.
    """
    m, bands = measured, list[Band]()
    for low, high in itertools.pairwise(EDGES):
        own = (m.frequency >= low) & (m.frequency < high)
        if not own.any() or high > frequency[-1]:
            continue
        at_bins = m.frequency[own]
        model: Complex[np.ndarray, " b"] = np.interp(at_bins, frequency, predicted)
        expected = (model * m.zr[own]).sum()
        by_limits = np.interp(at_bins, frequency, by_output) * m.zv[own]
        ratio = (m.zy[own] - by_limits).sum() / expected
        found = ratio * model
        left = m.yy[own] - 2.0 * np.real(np.conj(found) * m.ry[own])
        left += np.abs(found) ** 2 * m.rr[own]
        variance = (np.maximum(left, 0.0) * m.zz[own]).sum() / np.abs(expected) ** 2
        free = 1.0 / (1.0 + np.interp(at_bins, frequency, inner))
        bands.append(
            Band(
                low=float(low),
                high=float(high),
                ratio=float(abs(ratio)),
                degrees=float(np.degrees(np.angle(ratio))),
                uncertainty=1.96 * float(np.sqrt(variance / m.count)),
                by_gain=complex(free.mean()),
                by_delay=complex((-2j * np.pi * at_bins * free).mean()),
            )
        )
    return bands


def loop_error(bands: list[Band], crossover: float, stamp_std: float) -> LoopError:
    """Estimate by how much effectiveness and delay differ from the predicted ones.

    One step of Gauss and Newton on the logarithm of measured over predicted, up to `ABOVE` times
    the crossover [Hz]; a set point came when the log says, within `stamp_std` [s].
    """
    used = [b for b in bands if b.low < ABOVE * crossover and b.ratio > 0.0]
    if len(used) < 2:
        return LoopError(gain=1.0, delay=0.0, covariance=UNKNOWN)
    stamp = [-1j * np.pi * (b.low + b.high) for b in used]
    slopes: Complex[np.ndarray, "b 3"] = np.column_stack(
        [[b.by_gain for b in used], [b.by_delay for b in used], stamp]
    )
    off: Complex[np.ndarray, " b"] = np.log(np.array([b.complex_ratio for b in used]))
    std = np.array([np.hypot(b.uncertainty / 1.96 / b.ratio, MODEL) for b in used])
    # Each bin's complex variance stands in both of its parts: half of it in each.
    std = np.tile(std, 2) / np.sqrt(2.0)
    rows: Float[np.ndarray, "r 3"] = (
        np.concatenate([np.real(slopes), np.imag(slopes)]) / std[:, None]
    )
    right: Float[np.ndarray, " r"] = np.concatenate([np.real(off), np.imag(off)]) / std
    known = np.diag([0.0, 0.0, max(stamp_std, EXACT) ** -2])
    covariance: Float[np.ndarray, "3 3"] = np.linalg.inv(rows.T @ rows + known)
    found: Float[np.ndarray, " 3"] = covariance @ rows.T @ right
    # What neither explains shows how far the bands are off beyond their own scatter.
    left: Float[np.ndarray, " r"] = right - rows @ found
    scale = max(1.0, float(left @ left) / (len(left) - len(found) + 1))
    return LoopError(
        gain=float(np.exp(found[0])), delay=float(found[1]), covariance=scale * covariance[:2, :2]
    )


PROVED_AXES: Final = (0, 1)
"""Yaw's closed loop is not predicted well enough to be proved."""
NEAR: Final = 2.0
"""Factor about the crossover in which the closed loop must be proved."""
LIMITED: Final = 0.02
"""Share of a flight with a motor at its limit, from which it is said."""


def contradictions(
    axis: int,
    replay: ReplayedOutput,
    mixer: ReplayedMixer | None,
    error: LoopError | None,
    flight: Flown,
) -> list[str]:
    """State what contradicts the controller and mixer as they were read, or an error the result."""
    if axis not in PROVED_AXES:
        return [
            "unproven, whatever is flown: its loop is computed from the rotors' drag torque alone, "
            "and the torque by which rotors speed up, which acts beside it, is left out; to judge "
            "yaw, fly 20 s of quick yaw steps and see whether the rate settles without swinging"
        ]
    doubts: list[str] = []
    if not replay.is_right:
        doubts.append(
            f"the logged output is {replay.slope:.2f} times, and the rate's derivative "
            f"{replay.derivative:.2f} times, that of the controller as its parameters set it: a "
            "filter or a gain is not what they say, or changed in flight"
        )
    if mixer is not None and not mixer.is_right:
        doubts.append(
            f"the motors' commands follow the output as with {mixer.name} {mixer.factor:.2f}, which"
            f" makes {mixer.slope:.2f} times the thrust that the parameters of the log do: the "
            "curve or the spin range is not what they say"
        )
    if error is not None:
        gain, late = error.half_widths
        when = "later" if error.delay > 0.0 else "earlier"
        words = (
            f"this flight's closed loop has {with_half(error.gain, gain)} times the predicted "
            f"effectiveness and answers {with_half(1e3 * abs(error.delay), 1e3 * late)} ms {when}:"
            " the vehicle, its delay or a filter is another than the result has it"
        )
        limited = 1.0 - float(flight.free.mean())
        if limited > LIMITED:
            words += (
                f", or it is the {100 * limited:.0f} % of the flight with a motor at its limit: fly"
                " with less throttle and smaller steps"
            )
        doubts.append(words)
    return doubts


def too_little(crossover: float, bands: Sequence[Band], error: LoopError) -> list[str]:
    """State where the flight does not show the closed loop about the crossover [Hz], and why."""
    near = [b for b in bands if b.high > crossover and b.low < crossover * NEAR]
    gain, late = error.half_widths
    turn = 2.0 * np.pi * crossover * late
    if not any(b.proved for b in near):
        end = max((b.high for b in bands if b.proved), default=0.0)
        why = f"it follows the set point as predicted up to {end:.1f} Hz" if end else "none is seen"
    elif gain > SHARP:
        why = f"effectiveness is seen to {100 * gain:.0f} %"
    elif turn > SHARP:
        why = f"the delay decides there, and is seen to {np.degrees(turn):.0f} degrees"
    else:
        return []
    return [
        f"the flight shows too little of the closed loop about the crossover at {crossover:.1f} Hz:"
        f" {why}; fly 30 s of quick roll and pitch steps"
    ]


def notes_of(flight: Flown, log: FlightLog) -> list[str]:
    """State what the loops rest on."""
    battery = log.channels.get("battery")
    mean = float(flight.commands.mean())
    notes = [
        f"the loops are those of hover as in this flight (motor command {mean:.2f} in the mean); "
        "fast flight and another load change them"
    ]
    if battery is not None:
        notes.append(
            f"at {float(np.nanmean(battery.values)):.1f} V: without compensation by the autopilot "
            "the gain falls with the battery's voltage"
        )
    if log.gyro_lowpass is not None:
        notes.append(
            f"the gyro's low-pass of {log.gyro_lowpass:g} Hz is in the log, and counted once"
        )
    moving = moving_filters(flight.log)
    if moving:
        notes.append(
            f"notches of the gyro that follow the rotors, or are split ({', '.join(moving)}): they "
            "are in the loop by the delay and the size that the gyro's two records show of them up "
            "to 40 Hz, not by their shape; the other filters are in it exactly"
        )
    changed = [n for n in flight.log.changed if n.startswith(("MC_", "ATC_RAT", "ATC_ANG", "IMU_"))]
    if changed:
        notes.append(f"{', '.join(changed[:4])} changed within the log: the last values are taken")
    return notes
