"""Spectra of gyro and accelerometer in flight, and which of their peaks the rotors make.

While an autopilot injects a sweep (ArduPilot's SystemID mode, Betaflight's chirp), the rate of one
axis is nearly a sine whose frequency rises all the time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import FlightError
from rotorfit.flight.clocks import UniformChannels, uniform_channels, usable_samples
from rotorfit.flight.signals import true_runs
from rotorfit.flight.spectral_density import power_density, prominent_peaks, windowed_lines
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.flight_log import CHANNELS, COMPONENTS, Channel

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Bool, Float

WINDOW_SECONDS: Final = 1.0
SHORTEST_WINDOW: Final = 128
LONGEST_WINDOW: Final = 4096
"""Rows."""
SHORTEST_STRETCH: Final = 64
"""Rows without a gap, below which there is no spectrum."""
BLOCK_SECONDS: Final = 2.0
MOST_BLOCKS: Final = 400
"""Most blocks of a flight: peaks are held against the rotor speed block by block."""
LOWEST_PEAK: Final = 10.0
"""Slower is what pilot and autopilot do [Hz]."""
LEAST_RISE: Final = 0.4
"""Least rise of a peak over its surroundings, in powers of ten of the power; in short flights it is
more."""
LEAST_RISE_STDS: Final = 5.0
"""Standard deviations of an averaged spectrum that a peak must rise."""
MOST_PEAKS: Final = 4
HARMONICS: Final = (1, 2, 3, 4)
FOLDED: Final = (1, 2)
"""Those that shake most, balance and blades: of more, folded down, one fits any peak."""
FEWEST_COMPARED: Final = 3
NEAR: Final = 0.02
"""Share of a rotor's frequency within which a peak can come from it, where the speed changes."""
STRONGER: Final = 2.0
"""Power at a peak while a rotor turns so fast, over that while none does."""


@frozen_dataclass
class RotorBand:
    """The band of a multiple of the rotors' frequency, 10 % to 90 % of the time.

    - `harmonic`: 1 for the rotors' own frequency.
    - `low`, `high`: ends [Hz].
    """

    harmonic: int
    low: float
    high: float


@frozen_dataclass
class Peak:
    """A peak of a spectrum.

    - `frequency`: where it stands in the log [Hz].
    - `rise`: power over that of its surroundings.
    - `harmonic`: of the rotors, where they make it; None if they do not, or their speed is not
      known.
    - `true_frequency`: of the vibration, where the log is too slow for it and folds it [Hz].
    """

    frequency: float
    rise: float
    harmonic: int | None = None
    true_frequency: float | None = None

    @property
    def words(self) -> str:
        """Such as ``1st rotor harmonic, 187 Hz``."""
        at = f"{self.frequency:.0f} Hz"
        if self.harmonic is None:
            return at
        name = f"{ordinal(self.harmonic)} rotor harmonic"
        if self.true_frequency is None:
            return f"{name}, {at}"
        return f"{name} ({self.true_frequency:.0f} Hz), folded to {at}"


@frozen_dataclass
class Spectrum:
    """The spectrum of one sensor.

    - `channel`, `unit`: as in `CHANNELS`.
    - `seconds`, `airborne`: how much of the flight is in it [s]; whether only of its airborne part.
    - `sample_rate`: of the recorded samples [Hz].
    - `frequency`: rising, without 0 [Hz]; up to half the rate of new samples.
    - `density`: amplitude of each axis, `unit` per root hertz.
    - `peaks`: the clearest, by frequency.
    """

    channel: str
    unit: str
    seconds: float
    airborne: bool
    sample_rate: float
    frequency: Float[np.ndarray, " f"]
    density: dict[str, Float[np.ndarray, " f"]]
    peaks: tuple[Peak, ...]


@frozen_dataclass
class RotorTimes:
    """The speed of each rotor, block by block [Hz]: mean and deviation."""

    mean: Float[np.ndarray, "b N"]
    std: Float[np.ndarray, "b N"]


def ordinal(number: int) -> str:
    """Return 1st, 2nd, 3rd, 4th."""
    return f"{number}{ {1: 'st', 2: 'nd', 3: 'rd'}.get(number, 'th') }"


def rotor_bands(
    rotor_speed: Channel | None, spans: Sequence[tuple[float, float]]
) -> tuple[RotorBand, ...]:
    """Return the bands of the rotors' harmonics within spans of the log's clock, if measured."""
    if rotor_speed is None:
        return ()
    t = rotor_speed.time
    inside = np.any([(t >= a) & (t <= b) for a, b in spans], axis=0) if spans else t == t
    turning = rotor_speed.values[inside]
    turning = turning[np.isfinite(turning) & (turning > 0.0)] / (2.0 * np.pi)
    if not len(turning):
        return ()
    low, high = np.percentile(turning, [10.0, 90.0]).tolist()
    return tuple(RotorBand(harmonic=k, low=k * low, high=k * high) for k in HARMONICS)


def spectrum(
    name: str,
    channel: Channel,
    *,
    spans: Sequence[tuple[float, float]],
    rotor_speed: Channel | None,
    new_share: float = 1.0,
) -> Spectrum:
    """Estimate the spectrum of a sensor by Welch's method, within spans of the log's clock.

    `new_share` is that of samples that bring something new. Raises `FlightError` where no stretch
    without a gap is long enough.
    """
    uniform = uniform_channels({name: usable_samples(channel, name)}, clock=name)
    stretches = list(_stretches_within(uniform, spans))
    rows = max((b - a for a, b in stretches), default=0)
    window = max(round(WINDOW_SECONDS * uniform.sample_rate), SHORTEST_WINDOW)
    window = min(window, LONGEST_WINDOW, rows)
    if window < SHORTEST_STRETCH:
        where = "airborne stretch" if spans else "stretch"
        raise FlightError(
            f"no {where} of {name} without a gap holds {SHORTEST_STRETCH} samples: fly longer, or "
            "log faster"
        )
    blocks = _cut_blocks(stretches, uniform.sample_rate, window)
    values = uniform.values[name]
    f, mean, power = _welch_density(values, blocks, uniform.sample_rate, window)
    # Above half the rate of new samples stands what the recorder drew between them.
    shown = (f > 0.0) & (f <= 0.5 * uniform.sample_rate * new_share)
    averages = sum(max(2 * (b - a) // window - 1, 1) for a, b in blocks)
    times = [(float(uniform.time[a]), float(uniform.time[b - 1])) for a, b in blocks]
    rotors = None if rotor_speed is None else _rotor_times(rotor_speed, times)
    peaks = _find_peaks(f[shown], power[:, shown], averages, rotors, uniform.sample_rate)
    return Spectrum(
        channel=name,
        unit=CHANNELS[name][1],
        seconds=sum(b - a for a, b in blocks) / uniform.sample_rate,
        airborne=bool(spans),
        sample_rate=uniform.sample_rate,
        frequency=f[shown],
        density={
            axis: np.sqrt(mean[shown, i]) for i, axis in enumerate(COMPONENTS[values.shape[1]])
        },
        peaks=peaks,
    )


def _stretches_within(
    uniform: UniformChannels, spans: Sequence[tuple[float, float]]
) -> Iterator[tuple[int, int]]:
    """Yield the stretches without gaps inside the spans; all stretches if there are no spans."""
    for a, b in uniform.stretches:
        if not spans:
            yield a, b
        for start, end in spans:
            first = max(a, int(np.searchsorted(uniform.time, start)))
            last = min(b, int(np.searchsorted(uniform.time, end, side="right")))
            if last > first:
                yield first, last


def _cut_blocks(
    stretches: Sequence[tuple[int, int]], sample_rate: float, window: int
) -> list[tuple[int, int]]:
    """Cut the stretches into blocks of about two seconds, longer ones in long flights."""
    total = sum(b - a for a, b in stretches)
    length = max(round(BLOCK_SECONDS * sample_rate), 2 * window, total // MOST_BLOCKS)
    return [
        (start, min(start + length, b))
        for a, b in stretches
        for start in range(a, b, length)
        if min(start + length, b) - start >= window
    ]


def _welch_density(
    values: Float[np.ndarray, "n k"],
    blocks: Sequence[tuple[int, int]],
    sample_rate: float,
    window: int,
) -> tuple[Float[np.ndarray, " f"], Float[np.ndarray, "f k"], Float[np.ndarray, "b f"]]:
    """Return frequencies, the mean density of each axis, and that of all axes in each block."""
    frequency = np.fft.rfftfreq(window, 1.0 / sample_rate)
    mean = np.zeros((len(frequency), values.shape[1]))
    power = np.zeros((len(blocks), len(frequency)))
    for i, (a, b) in enumerate(blocks):
        _, density = power_density(values[a:b], sample_rate, window)
        mean += density * (b - a)
        power[i] = density.sum(axis=1)
    return frequency, mean / sum(b - a for a, b in blocks), power


def _rotor_times(rotor_speed: Channel, times: Sequence[tuple[float, float]]) -> RotorTimes | None:
    """Measure how fast the rotors turned in each block; None if that was not recorded."""
    t, hertz = rotor_speed.time, rotor_speed.values / (2.0 * np.pi)
    count = hertz.shape[1]
    mean, std = np.full((len(times), count), np.nan), np.full((len(times), count), np.nan)
    for i, (start, end) in enumerate(times):
        inside = hertz[(t >= start) & (t <= end)]
        inside = inside[np.isfinite(inside).all(axis=1)]
        if len(inside) > 1:
            mean[i], std[i] = inside.mean(axis=0), inside.std(axis=0)
    return RotorTimes(mean=mean, std=std) if np.isfinite(mean).any() else None


def _find_peaks(
    frequency: Float[np.ndarray, " f"],
    power: Float[np.ndarray, "b f"],
    averages: int,
    rotors: RotorTimes | None,
    sample_rate: float,
) -> tuple[Peak, ...]:
    """Find the clearest peaks of the mean over all blocks, by frequency."""
    mean = power.mean(axis=0)
    level = np.log10(np.maximum(mean, 1e-12 * max(float(mean.max(initial=0.0)), 1e-30)))
    least = max(LEAST_RISE, LEAST_RISE_STDS * np.log10(np.e) / np.sqrt(averages))
    kept = [(rise, i) for i, rise in prominent_peaks(level, least) if frequency[i] >= LOWEST_PEAK]
    strongest = sorted(kept, reverse=True)[:MOST_PEAKS]
    return tuple(
        _name_harmonic(float(frequency[i]), 10.0**rise, power[:, max(i - 1, 0) : i + 2].max(axis=1),
               rotors, float(frequency[1] - frequency[0]), sample_rate)
        for rise, i in sorted(strongest, key=lambda one: one[1])
    )  # fmt: skip


def _name_harmonic(
    at: float,
    rise: float,
    power: Float[np.ndarray, " b"],
    rotors: RotorTimes | None,
    step: float,
    sample_rate: float,
) -> Peak:
    """Name the harmonic of a peak that stands while a rotor turns so fast, and only then."""
    if rotors is None:
        return Peak(frequency=at, rise=rise)
    for harmonic in HARMONICS:
        near = _near_harmonic(at, harmonic, rotors, step, sample_rate)
        if not near.any():
            continue
        turning = harmonic * float(np.median(rotors.mean[near]))
        # A log slower than twice a vibration's frequency folds it down: those are looked for, too.
        folded = turning > 0.5 * sample_rate
        if folded and harmonic not in FOLDED:
            continue
        any_near: Bool[np.ndarray, " b"] = np.any(near, axis=1)
        if _goes_with(power, any_near, sure=folded):
            true = _unfold_frequency(at, turning, sample_rate) if folded else None
            return Peak(frequency=at, rise=rise, harmonic=harmonic, true_frequency=true)
    return Peak(frequency=at, rise=rise)


def _unfold_frequency(at: float, near: float, sample_rate: float) -> float:
    """Return the frequency near to one that a log of so many samples shows at another."""
    whole = sample_rate * np.arange(1 + int(near / sample_rate) + 1)
    candidates = np.concatenate([whole + at, whole - at])
    return float(candidates[np.argmin(np.abs(candidates - near))])


def _near_harmonic(
    at: float, harmonic: int, rotors: RotorTimes, step: float, sample_rate: float
) -> Bool[np.ndarray, "b N"]:
    """Return in which blocks which rotor makes a frequency."""
    true = harmonic * rotors.mean
    recorded = np.abs(true - sample_rate * np.round(true / sample_rate))
    reach = np.maximum(1.5 * step, np.minimum(harmonic * rotors.std, NEAR * true))
    within: Bool[np.ndarray, "b N"] = np.abs(recorded - at) <= reach
    return within


def _goes_with(power: Float[np.ndarray, " b"], near: Bool[np.ndarray, " b"], *, sure: bool) -> bool:
    """Return whether a peak stands in the blocks where it should, and not in the others."""
    if min(int(near.sum()), int((~near).sum())) >= FEWEST_COMPARED:
        return bool(np.median(power[near]) > STRONGER * np.median(power[~near]))
    # In a steady hover there are no others; that is enough unless it is to be `sure`.
    return not sure and bool(near.mean() > 0.5)


SWEEP_WINDOW_SECONDS: Final = 1.0
STEP_SECONDS: Final = 0.25
BAND: Final = (1.0, 60.0)
"""Looked for; a window holds too little of what is slower [Hz]."""
SWEEP_NEAR: Final = 1.5
"""Within this factor of the strongest frequency is the sine itself."""
PURE: Final = 0.6
"""Least share of the power that is in the sine."""
LEAST_SECONDS: Final = 4.0
SWEEP_LEAST_RISE: Final = 3.0
"""Least rise of a sweep from the first frequency to the last."""
STEADY: Final = 0.95
"""Least rank correlation of frequency and time."""
AXES: Final = ("roll", "pitch", "yaw")


@frozen_dataclass
class Sweep:
    """A frequency sweep about one axis: when it was in `BAND` [s], and its frequencies [Hz]."""

    axis: str
    start: float
    end: float
    lowest: float
    highest: float

    def words(self) -> str:
        """Describe the sweep."""
        return (
            f"{self.axis}: {self.start:.0f} to {self.end:.0f} s, {self.lowest:.2g} to "
            f"{self.highest:.2g} Hz"
        )


def frequency_sweeps(
    time: Float[np.ndarray, " n"], rates: Float[np.ndarray, "n 3"]
) -> tuple[Sweep, ...]:
    """Find the frequency sweeps in body rates about x, y, z, sampled in equal steps [s]."""
    if time[-1] - time[0] < LEAST_SECONDS + SWEEP_WINDOW_SECONDS:
        return ()
    fs = 1.0 / float(np.median(np.diff(time)))
    length = round(SWEEP_WINDOW_SECONDS * fs)
    step = max(round(STEP_SECONDS * fs), 1)
    power = np.abs(windowed_lines(rates, length, step, padded=4 * length)) ** 2
    frequency = np.fft.rfftfreq(4 * length, 1.0 / fs)
    at = (0.5 * length + step * np.arange(len(power))) / fs
    used = (frequency >= BAND[0]) & (frequency <= min(BAND[1], 0.4 * fs))
    found: list[Sweep] = []
    for i, axis in enumerate(AXES):
        strongest, share = _strongest_sine(frequency[used], power[:, used, i].T)
        found += _find_rises(axis, at + time[0], strongest, share > PURE)
    return tuple(found)


def _strongest_sine(
    frequency: Float[np.ndarray, " f"], power: Float[np.ndarray, "f t"]
) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
    """Find the strongest frequency of each window, and the share of the power about it."""
    strongest = frequency[np.argmax(power, axis=0)]
    ratio = frequency[:, None] / strongest
    near = (ratio < SWEEP_NEAR) & (ratio > 1.0 / SWEEP_NEAR)
    return strongest, (power * near).sum(axis=0) / np.maximum(power.sum(axis=0), 1e-30)


def _find_rises(
    axis: str,
    at: Float[np.ndarray, " t"],
    strongest: Float[np.ndarray, " t"],
    pure: np.ndarray,
) -> list[Sweep]:
    """Find the stretches of sines whose frequency rises, no window falling far back."""
    goes_on = pure[1:] & pure[:-1] & (strongest[1:] > strongest[:-1] / 1.1)
    goes_on &= strongest[1:] < 2.0 * strongest[:-1]
    sweeps: list[Sweep] = []
    for first, last in true_runs(goes_on):
        f, t = strongest[first : last + 1], at[first : last + 1]
        lowest, highest = float(f.min()), float(f.max())
        long = t[-1] - t[0] >= LEAST_SECONDS and highest >= SWEEP_LEAST_RISE * lowest
        if long and _correlate_ranks(t, f) > STEADY:
            sweep = Sweep(
                axis=axis, start=float(t[0]), end=float(t[-1]), lowest=lowest, highest=highest
            )
            sweeps.append(sweep)
    return sweeps


def _correlate_ranks(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]) -> float:
    """Compute Spearman's rank correlation; equal values share the mean of their ranks."""
    ranks: list[Float[np.ndarray, " n"]] = []
    for values in (x, y):
        _, place, count = np.unique(values, return_inverse=True, return_counts=True)
        ranks.append((np.cumsum(count) - 0.5 * (count - 1))[place])
    return float(np.corrcoef(ranks)[0, 1])
