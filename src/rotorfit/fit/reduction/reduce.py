"""A flight to its factors, in one pass over the samples and in bounded memory."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import FlightError
from rotorfit.estimation.factors import (
    Factors,
    stack_factors,
    time_block_factors,
    triangular_factors,
)
from rotorfit.flight.filters import butterworth, filter_both_ways, tukey_window
from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.flight.on_board import response_of
from rotorfit.flight.signals import fading_rows
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.signals import (
    AddedSignals,
    SignalLayout,
    body_columns,
    body_signals,
    rotor_columns,
    rotor_signals,
    signal_layout,
    signal_matrix,
    yaw_signals,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from jaxtyping import Complex, Float

    from rotorfit.model.vehicle import Vehicle

    Lines = Complex[np.ndarray, "_ b"]
    """Lines of the signals of a stretch, as far up as bands reach."""

CHUNK_ROWS = 16_384
"""Rows of Z alive at a time: 20 columns of them stay near the processor's cache."""


@frozen_dataclass
class LowPass:
    """A zero-phase Butterworth low-pass, and the decimation that follows it.

    - `cutoff`: of the forward and backward pass together [Hz].
    - `samples_per_period`: how many samples to keep per cut-off period; None keeps all.
    - `order`: of one pass.
    """

    cutoff: float
    samples_per_period: float | None = None
    order: int = 4

    def sos(self, sample_rate: float) -> Float[np.ndarray, "s 6"]:
        """Design the second-order sections of one pass."""
        # Two passes square the gain: each is widened so that together they lose 3 dB at cutoff.
        widened = self.cutoff * (np.sqrt(2.0) - 1.0) ** (-1.0 / (2 * self.order))
        if widened >= 0.5 * sample_rate:
            raise FlightError(
                f"a cut-off of {self.cutoff:g} Hz needs a log faster than {2.1 * widened:.0f} Hz, "
                f"this one has {sample_rate:.0f} Hz; lower the cut-off"
            )
        return butterworth(self.order, widened, sample_rate)

    def memory_rows(self, sample_rate: float) -> int:
        """Count the rows in which the filter's response fades to rounding."""
        return fading_rows(self.sos(sample_rate))

    def step(self, sample_rate: float) -> int:
        """Count the samples that one kept sample stands for."""
        if self.samples_per_period is None:
            return 1
        return max(int(sample_rate / (self.samples_per_period * self.cutoff)), 1)


def time_factors(
    flight: FlightData,
    vehicle: Vehicle,
    *,
    lowpass: LowPass | None = None,
    block_seconds: float = 1.0,
) -> Factors:
    """Reduce a flight to one factor per `block_seconds`, for estimators of the time domain."""
    step = 1 if lowpass is None else lowpass.step(flight.sample_rate)
    block_rows = max(round(block_seconds * flight.sample_rate / step), 1)
    parts: list[Factors] = []
    for segment in flight.segments:
        blocks = [
            time_block_factors(Z, block_rows=block_rows)
            # The low-pass acts equally on every signal, which leaves the equations between them
            # exact.
            for Z in _filtered_chunks(flight, vehicle, segment, (lowpass, block_rows * step))
        ]
        joined = stack_factors(blocks)
        parts.append(replace(joined, segment=np.zeros_like(joined.segment)))
    return _stack_parts(parts)


def filtered_signals(
    flight: FlightData,
    vehicle: Vehicle,
    segment: Segment,
    lowpass: LowPass,
    *,
    added: Sequence[AddedSignals] = (),
) -> Float[np.ndarray, "n z"]:
    """Low-pass the signals of every sample of a segment, for looking at a flight."""
    every = replace(lowpass, samples_per_period=None)
    chunks = _filtered_chunks(flight, vehicle, segment, (every, 1), added=added)
    return np.concatenate(list(chunks))


def _filtered_chunks(
    flight: FlightData,
    vehicle: Vehicle,
    segment: Segment,
    plan: tuple[LowPass | None, int],
    *,
    added: Sequence[AddedSignals] = (),
) -> Iterator[Float[np.ndarray, "n z"]]:
    """Yield the filtered, decimated signals of a segment in whole blocks of bounded size."""
    lowpass, block = plan
    chunk = max(CHUNK_ROWS // block, 1) * block
    for start in range(segment.start, segment.stop, chunk):
        stop = min(start + chunk, segment.stop)
        if lowpass is None:
            yield signal_matrix(flight, vehicle, start, stop, added=added)
            continue
        margin = lowpass.memory_rows(flight.sample_rate)
        first, last = max(start - margin, segment.start), min(stop + margin, segment.stop)
        Z = signal_matrix(flight, vehicle, first, last, added=added)
        sos = lowpass.sos(flight.sample_rate)
        # Forward and backward; the ends are continued by point reflection.
        smooth = filter_both_ways(sos, Z)
        yield smooth[start - first : stop - first : lowpass.step(flight.sample_rate)]


@frozen_dataclass
class BandPlan:
    """How a flight is cut into stretches and frequency bands.

    - `edges`: of the bands [Hz]; lines below the first and above the last are not used. A first
      edge of 0 keeps the lines up to the second edge, which hold the mean, as a band of their own.
    - `longest`: a stretch longer than this is cut into equal parts [s].
    - `fewest_lines`: a band with fewer frequency lines is merged with the next.
    - `taper`: share of a stretch in the two cosine ends of its window.
    """

    edges: tuple[float, ...]
    longest: float = 20.0
    fewest_lines: int = 10
    taper: float = 0.1


@frozen_dataclass
class BandLines:
    """The Fourier lines of one stretch of a flight, from which its bands are factored.

    - `lines`: of the signals, then the slopes of those that move, time by time.
    - `bands`: first and last (exclusive) line of each band.
    - `resolution`: distance of two lines [Hz].
    - `noise`: variance per row that the rotor speeds' noise adds to each signal, by band.
    """

    lines: Lines
    bands: list[tuple[int, int]]
    resolution: float
    noise: Float[np.ndarray, "bands signals"] | None

    @property
    def frequency(self) -> Float[np.ndarray, " l"]:
        """Frequency of every line [Hz]."""
        return self.resolution * np.arange(len(self.lines))


def band_factors(
    flight: FlightData,
    vehicle: Vehicle,
    *,
    plan: BandPlan,
    added: Sequence[AddedSignals] = (),
    moved: Sequence[tuple[FlightData, FlightData, float]] = (),
    body: Sequence[Lines] | None = None,
    top: float = np.inf,
) -> Factors:
    """Reduce a flight to one factor per stretch and frequency band; raise if none is long enough.

    `moved`, `body`, `top`: as for `band_lines`.
    """
    stretches = band_lines(flight, vehicle, plan=plan, added=added, moved=moved, body=body, top=top)
    return factors_of_lines(stretches, signal_layout(vehicle, added))


def band_lines(
    flight: FlightData,
    vehicle: Vehicle,
    *,
    plan: BandPlan,
    added: Sequence[AddedSignals] = (),
    moved: Sequence[tuple[FlightData, FlightData, float]] = (),
    body: Sequence[Lines] | None = None,
    top: float = np.inf,
) -> list[BandLines]:
    """Transform a flight to the lines of its bands, stretch by stretch.

    Each stretch is tapered (Tukey), its rows divided by their noise where that is known,
    transformed and scaled to unit window energy; a band stacks real and imaginary parts. Every step
    is linear and equal for all signals: the equations between them stay exact. `moved`: per slope
    the flight with its rotors a step later and earlier, and their distance; `body`: from
    `body_lines`; `top`: bands begin under this edge [Hz].
    """
    layout = signal_layout(vehicle, added)
    made, kept = rotor_columns(layout), body_columns(layout)
    known = body_lines(flight, plan=plan, added=added) if body is None else body
    found: list[BandLines] = []
    for stretch, own in zip(_split_stretches(flight, plan), known, strict=True):
        resolution = flight.sample_rate / len(stretch)
        bands = [
            b for b in _band_lines(stretch, flight.sample_rate, plan) if b[0] * resolution < top
        ]
        if not bands:
            continue
        rotors = rotor_signals(flight, vehicle, stretch.start, stretch.stop, added=added)
        slopes = _rotor_slopes(moved, vehicle, stretch, [s for s in added if s.sloped])
        window = stretch_window(flight, stretch, plan)
        fresh = _transform_signals(np.concatenate([rotors, *slopes], axis=1), bands, window)
        lines = np.empty((len(fresh), len(layout) + fresh.shape[1] - len(made)), dtype=complex)
        lines[:, kept], lines[:, made] = own[: len(fresh)], fresh[:, : len(made)]
        lines[:, len(layout) :] = fresh[:, len(made) :]
        edges = _edges_of(bands, resolution)
        noise = rotor_noise(flight, vehicle, stretch, edges, added=added)
        found.append(BandLines(lines=lines, bands=bands, resolution=resolution, noise=noise))
    return found


def factors_of_lines(stretches: Sequence[BandLines], layout: SignalLayout) -> Factors:
    """Factor the bands of every stretch."""
    parts: list[Factors] = []
    for own in stretches:
        every = _reduce_stretch(own.lines, own.bands, own.resolution)
        parts.append(replace(_with_slopes(every, layout), noise=own.noise))
    return _stack_parts(parts)


def body_lines(
    flight: FlightData, *, plan: BandPlan, added: Sequence[AddedSignals] = ()
) -> tuple[Lines, ...]:
    """Transform the signals that the rotors have no part in, stretch by stretch."""
    # They stay where lag and delay of the motors are tried: of a log at 1 kHz the lines that are
    # used are a sixteenth of the samples.
    return tuple(
        _transform_signals(
            body_signals(flight, stretch.start, stretch.stop, added=added),
            _band_lines(stretch, flight.sample_rate, plan),
            stretch_window(flight, stretch, plan),
        )
        for stretch in _split_stretches(flight, plan)
    )


def banded_lines(
    flight: FlightData,
    columns: Callable[[int, int], Float[np.ndarray, "n z"]],
    *,
    plan: BandPlan,
) -> Iterator[tuple[Lines, list[tuple[int, int]], Float[np.ndarray, " l"]]]:
    """Yield the lines of any `columns` (by first and last row), cut as `band_factors` does.

    With them first and last (exclusive) line of each block, and the frequencies [Hz].
    """
    for stretch in _split_stretches(flight, plan):
        bands = _band_lines(stretch, flight.sample_rate, plan)
        if bands:
            window = stretch_window(flight, stretch, plan)
            lines = _transform_signals(columns(stretch.start, stretch.stop), bands, window)
            yield lines, bands, np.arange(len(lines)) * flight.sample_rate / len(stretch)


def _split_stretches(flight: FlightData, plan: BandPlan) -> list[Segment]:
    """Split the segments into parts that are not too long."""
    longest = plan.longest * flight.sample_rate
    return [stretch for segment in flight.segments for stretch in split_segment(segment, longest)]


def yaw_factors(flight: FlightData, rotor_count: int, *, plan: BandPlan) -> Factors:
    """Reduce `yaw_signals` to one factor per stretch and band, cut as by `band_factors`."""

    def columns(start: int, stop: int) -> Float[np.ndarray, "n y"]:
        return yaw_signals(flight, rotor_count, start, stop)

    stretches = banded_lines(flight, columns, plan=plan)
    return _stack_parts(
        [_reduce_stretch(lines, bands, float(f[1])) for lines, bands, f in stretches]
    )


def _rotor_slopes(
    moved: Sequence[tuple[FlightData, FlightData, float]],
    vehicle: Vehicle,
    stretch: Segment,
    added: Sequence[AddedSignals],
) -> list[Float[np.ndarray, "n r"]]:
    """Differentiate the rotors' signals by what moves them, from both sides of each."""
    slopes: list[Float[np.ndarray, "n r"]] = []
    for ahead, behind, distance in moved:
        one, other = (
            rotor_signals(side, vehicle, stretch.start, stretch.stop, added=added)
            for side in (ahead, behind)
        )
        slopes.append((one - other) / distance)
    return slopes


def rotor_noise(
    flight: FlightData,
    vehicle: Vehicle,
    stretch: Segment,
    band: Float[np.ndarray, "b 2"],
    *,
    added: Sequence[AddedSignals] = (),
) -> Float[np.ndarray, "b z"] | None:
    """Propagate white noise of the rotor speeds to each signal, per row of a band; None without."""
    if flight.rotor_speed_std <= 0:
        return None
    layout = signal_layout(vehicle, added)
    noise = np.zeros((len(band), len(layout)))
    turn = 2.0 * np.pi * band.mean(axis=1) / flight.sample_rate
    average, difference = np.ones_like(turn), turn * flight.sample_rate
    if flight.differentiation == "central":
        # Power gain of [1 4 1]/6, and gain of the central difference, at the middle of each band.
        average = ((4.0 + 2.0 * np.cos(turn)) / 6.0) ** 2
        difference = np.sin(turn) * flight.sample_rate
    passed = np.abs(response_of(flight.filters, "gyro", band.mean(axis=1))) ** 2
    # A row is the real or the imaginary part of a line and holds half of its variance.
    half = 0.5 * flight.rotor_speed_std**2 * passed
    for i, square in enumerate(_mean_squares(flight, stretch)):
        # d(O^2) = 2 O dO.
        noise[:, layout.index(f"O2_{i + 1}")] = 4.0 * square * half * average
    for axis, weight in zip("xyz", (vehicle.axes**2).sum(axis=0), strict=True):
        if f"dH{axis}" in layout:
            noise[:, layout.index(f"dH{axis}")] = weight * half * difference**2
    return noise


def _mean_squares(flight: FlightData, stretch: Segment) -> Float[np.ndarray, " N"]:
    """Average the squared speeds of a stretch, as its rows count."""
    rows = slice(stretch.start, stretch.stop)
    speed = flight.rotor_speed[rows]
    if flight.noise_level is None:
        return (speed * speed).mean(axis=0)
    weight = flight.noise_level[rows] ** -2
    return weight @ (speed * speed) / weight.sum()


def split_segment(segment: Segment, longest_rows: float) -> list[Segment]:
    """Split a segment into the fewest equal parts no longer than `longest_rows`."""
    count = max(int(np.ceil(len(segment) / longest_rows)), 1)
    edges = np.linspace(segment.start, segment.stop, count + 1).round().astype(int)
    return [Segment(start=int(a), stop=int(b)) for a, b in pairwise(edges)]


def stretches_with_bands(flight: FlightData, plan: BandPlan) -> list[Segment]:
    """Return the stretches of a flight that are long enough for bands, as `band_factors` cuts."""
    every = _split_stretches(flight, plan)
    return [stretch for stretch in every if _band_lines(stretch, flight.sample_rate, plan)]


def _band_lines(stretch: Segment, sample_rate: float, plan: BandPlan) -> list[tuple[int, int]]:
    """Find first and last (exclusive) line of each band of a stretch."""
    return merged_bands(np.fft.rfftfreq(max(len(stretch), 1), 1.0 / sample_rate), plan)


def stretch_window(flight: FlightData, stretch: Segment, plan: BandPlan) -> Float[np.ndarray, " n"]:
    """Return the window of a stretch, of unit energy: its taper, over the noise of its rows."""
    window: Float[np.ndarray, " n"] = tukey_window(len(stretch), plan.taper)
    if flight.noise_level is not None:
        window = window / flight.noise_level[stretch.start : stretch.stop]
    energy = float(window @ window)
    return window / np.sqrt(energy) if energy > 0.0 else window  # of two rows: its ends alone


def _transform_signals(
    Z: Float[np.ndarray, "n z"], bands: Sequence[tuple[int, int]], window: Float[np.ndarray, " n"]
) -> Complex[np.ndarray, "l z"]:
    """Transform windowed signals, up to the last line that a band has."""
    if not bands:
        return np.zeros((0, Z.shape[1]), dtype=complex)
    lines = np.fft.rfft(Z * window[:, None], axis=0)
    return lines[: bands[-1][1]].copy()


def _reduce_stretch(
    lines: Complex[np.ndarray, "l z"],
    bands: Sequence[tuple[int, int]],
    resolution: float,
) -> Factors:
    """Reduce the lines of one stretch, so far apart [Hz], to band factors."""
    stacked = [line_rows(lines, first, last) for first, last in bands]
    return Factors(
        R=triangular_factors(stacked),
        rows=np.array([len(rows) for rows in stacked], dtype=np.int64),
        segment=np.zeros(len(stacked), dtype=np.int64),
        band=_edges_of(bands, resolution),
    )


def _edges_of(bands: Sequence[tuple[int, int]], resolution: float) -> Float[np.ndarray, "b 2"]:
    """Return the first and the last frequency of each band [Hz]."""
    return resolution * np.array([[a, b - 1] for a, b in bands])


def _with_slopes(factors: Factors, layout: SignalLayout) -> Factors:
    """Separate the slopes from factors of signals and slopes side by side."""
    z, rotors = len(layout), rotor_columns(layout, sloped=True)
    count = (factors.R.shape[2] - z) // len(rotors)
    if not count:
        return factors
    rows = np.zeros((len(factors), count, factors.R.shape[1], z))
    for t in range(count):
        first = z + t * len(rotors)
        rows[:, t][:, :, rotors] = factors.R[:, :, first : first + len(rotors)]
    # The first rows are those of the signals; each slope has the column of its signal.
    return replace(factors, R=factors.R[:, :z, :z], slopes=rows)


def line_rows(lines: Complex[np.ndarray, "l z"], first: int, last: int) -> Float[np.ndarray, "m z"]:
    """Stack real and imaginary parts of lines as rows that carry the same noise."""
    real = np.real(lines[first:last])
    imaginary = np.imag(lines[first:last])
    if first > 0:
        return np.concatenate([real, imaginary])
    # The mean is real, and its one row would have the variance of two.
    return np.concatenate([real[:1] / np.sqrt(2.0), real[1:], imaginary[1:]])


def merged_bands(frequency: Float[np.ndarray, " l"], plan: BandPlan) -> list[tuple[int, int]]:
    """Merge short bands upwards: first and last (exclusive) line of each."""
    marks = [int(mark) for mark in np.searchsorted(frequency, plan.edges)]
    mean: list[tuple[int, int]] = []
    if plan.edges[0] == 0.0:
        mean = [(marks[0], marks[1])]
        marks = marks[1:]
    bands: list[tuple[int, int]] = []
    start = marks[0]
    for mark in marks[1:]:
        if mark - start >= plan.fewest_lines:
            bands.append((start, mark))
            start = mark
    if bands and marks[-1] > start:
        bands[-1] = (bands[-1][0], marks[-1])
    return mean + bands if bands else []


def _stack_parts(parts: Sequence[Factors]) -> Factors:
    if not parts:
        raise FlightError(
            "the airborne part is too short to use; fly longer, or set start and end yourself"
        )
    return stack_factors(parts)
