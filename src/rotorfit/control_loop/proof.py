"""Is the predicted loop the one that flew? Replay of the controller, and the closed loop by bands.

The closed loop from set point r to rate y is measured with an instrument z that gusts do not move:
what the outer loop asked for beyond its feedback, r' + K y (K: rate asked for per angle), so that
T = S_zy / S_zr (instrumental variables; Soderstrom and Stoica 1989). S_ry / S_rr would take the
outer loop's answer to gusts for a response to the pilot.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from rotorfit.control_loop.plant import Plant
from rotorfit.control_loop.rate_controller import RateController
from rotorfit.control_loop.vehicle import Flown, cross_spectrum

EDGES = 0.3 * 1.5 ** np.arange(13)
"""Of the bands [Hz]."""
LONGEST = 8.0
"""Length of a spectrum [s]."""
WINDOWS = 0.8
"""Independent spectra for each of those that overlap by half."""
SHOWN = 0.25
"""Distance from the prediction, uncertainty included, within which a band proves it."""
MODEL = 0.02
"""Distance that a linear model of hover leaves, one deviation."""
GAIN, LATE = 0.08, 0.5e-3
"""Errors of effectiveness, and of the delay [s], that a linear model of hover leaves."""
LEFT = np.diag([0.5 * GAIN, LATE]) ** 2
"""The same as covariance: one deviation of effectiveness and of the time between stamps."""
SHARP = (0.15, 3e-3)
"""Half-widths of the two beyond which a flight does not show them."""
UNKNOWN = np.diag([1.0, 1.0])
"""Covariance where the closed loop shows nothing."""
ABOVE = 3.0
"""Times the crossover up to which the closed loop is judged."""
SLOPE = 0.03
"""Of the replayed output from one, beyond which the controller was not read rightly."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayedOutput:
    """How the logged output follows the replayed one: slope, and share that is left."""

    slope: float
    left: float

    @property
    def is_right(self) -> bool:
        """Whether the controller was read rightly."""
        return abs(self.slope - 1.0) <= SLOPE


@dataclass(frozen=True, slots=True, kw_only=True)
class Band:
    """The closed loop in a band, measured over predicted.

    Attributes
    ----------
    low, high
        [Hz]
    ratio, degrees
        Measured over predicted: size, and phase [deg].
    uncertainty
        Half of the 95 % interval of the complex ratio.
    by_gain, by_delay
        Slope of the prediction's logarithm by that of the effectiveness, and by the delay [1/s].
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


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopError:
    """How far the flown loop is from the predicted one, by its closed loop.

    Attributes
    ----------
    gain
        Effectiveness over the predicted one.
    delay
        By how much later the loop is than predicted [s].
    covariance
        Of the gain's logarithm and the delay.
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

    @property
    def is_sharp(self) -> bool:
        """Whether the flight shows it well enough to prove the prediction."""
        gain, delay = self.half_widths
        return gain <= SHARP[0] and delay <= SHARP[1]

    def corrected(self, plant: Plant, seed: int) -> Plant:
        """Move the vehicles to where result and closed loop agree best (ensemble Kalman update)."""
        prior = plant.spread
        correlated = np.cov(prior[:, 1:])
        # What the linear model of hover leaves is no error of the vehicle, but stays open.
        covariance = self.covariance + LEFT
        weight = correlated @ np.linalg.inv(correlated + covariance)
        seen = np.tile([[np.log(self.gain)], [self.delay]], prior.shape[1])
        noise = np.random.default_rng(seed).multivariate_normal(
            np.zeros(2), covariance, prior.shape[1] - 1
        )
        seen[:, 1:] += noise.T
        left = np.random.default_rng(seed + 1).multivariate_normal(
            np.zeros(2), LEFT, prior.shape[1]
        )
        left[0] = 0.0
        return plant.moved(*(weight @ (seen - prior) + left.T))


def replay_output(controller: RateController, flight: Flown, axis: int) -> ReplayedOutput:
    """Compare the logged output with the one that the controller gives for the logged flight."""
    log = flight.log
    made = controller.replayed(
        log.set_point[:, axis], log.rate[:, axis], None if log.slope is None else log.slope[:, axis]
    )
    # The integral's start, and what a take-off leaves in it, are no part of the comparison.
    edge = min(len(made) // 8, round(2.0 / log.period))
    rows = slice(edge, len(made) - edge)
    columns = np.column_stack([made[rows], np.ones(len(made[rows]))])
    out = log.output[rows, axis]
    (slope, offset), *_ = np.linalg.lstsq(columns, out, rcond=None)
    left = np.std(out - columns @ [slope, offset]) / max(float(np.std(out)), 1e-12)
    return ReplayedOutput(slope=float(slope), left=float(left))


def closed_loop_bands(
    frequency: Float[np.ndarray, " f"],
    predicted: Complex[np.ndarray, " f"],
    inner: Complex[np.ndarray, " f"],
    controller: RateController,
    flight: Flown,
    axis: int,
) -> list[Band]:
    """Compare the measured with the predicted closed loop, band by band.

    `inner`: the open rate loop, by which the closed one changes with gain and delay.
    """
    log = flight.log
    at = np.arange(log.time[0], log.time[-1], log.period)
    asked, rate = (np.interp(at, log.time, values[:, axis]) for values in (log.set_point, log.rate))
    instrument = np.gradient(asked, log.period) + controller.angle * rate
    length = min(round(LONGEST / log.period), len(at) // 8)
    grid, zr = cross_spectrum(instrument, asked, log.period, length)
    _, zy = cross_spectrum(instrument, rate, log.period, length)
    _, ry = cross_spectrum(asked, rate, log.period, length)
    zz, rr, yy = (
        np.real(cross_spectrum(v, v, log.period, length)[1]) for v in (instrument, asked, rate)
    )
    count = WINDOWS * (2 * len(at) / length - 1)
    bands: list[Band] = []
    for low, high in itertools.pairwise(EDGES):
        own = (grid >= low) & (grid < high)
        if not own.any() or high > frequency[-1]:
            continue
        at_bins = grid[own]
        model: Complex[np.ndarray, " b"] = np.interp(at_bins, frequency, predicted)
        ratio = zy[own].sum() / (model * zr[own]).sum()
        found = ratio * model
        left = yy[own] - 2.0 * np.real(np.conj(found) * ry[own]) + np.abs(found) ** 2 * rr[own]
        variance = (np.maximum(left, 0.0) * zz[own]).sum() / np.abs((model * zr[own]).sum()) ** 2
        free = 1.0 / (1.0 + np.interp(at_bins, frequency, inner))
        bands.append(
            Band(
                low=float(low),
                high=float(high),
                ratio=float(abs(ratio)),
                degrees=float(np.degrees(np.angle(ratio))),
                uncertainty=1.96 * float(np.sqrt(variance / count)),
                by_gain=complex(free.mean()),
                by_delay=complex((-2j * np.pi * at_bins * free).mean()),
            )
        )
    return bands


def loop_error(bands: list[Band], crossover: float) -> LoopError:
    """Estimate by how much effectiveness and delay differ from the predicted ones.

    One step of Gauss and Newton on the logarithm of measured over predicted, up to `ABOVE` times
    the crossover [Hz].
    """
    used = [b for b in bands if b.low < ABOVE * crossover and b.ratio > 0.0]
    if len(used) < 2:
        return LoopError(gain=1.0, delay=0.0, covariance=UNKNOWN)
    slopes: Complex[np.ndarray, "b 2"] = np.array([[b.by_gain, b.by_delay] for b in used])
    off: Complex[np.ndarray, " b"] = np.log(np.array([b.complex_ratio for b in used]))
    std = np.array([np.hypot(b.uncertainty / 1.96 / b.ratio, MODEL) for b in used])
    rows = np.concatenate([np.real(slopes), np.imag(slopes)]) / np.tile(std, 2)[:, None]
    right = np.concatenate([np.real(off), np.imag(off)]) / np.tile(std, 2)
    found, *_ = np.linalg.lstsq(rows, right)
    # Each bin's complex variance stands in both of its parts: half of it in each.
    return LoopError(
        gain=float(np.exp(found[0])),
        delay=float(found[1]),
        covariance=0.5 * np.linalg.inv(rows.T @ rows),
    )
