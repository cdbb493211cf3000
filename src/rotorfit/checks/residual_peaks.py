"""Check the residuals for narrow peaks: a vibration, or a term that the model lacks.

The errors of the six accelerations, stretch by stretch as in the fit, each band over its variance:
their mean power at one frequency, over all stretches, beside that at the frequencies around it.
Where the push of the rotors along any axis has the same peak, coherent with that of the errors, the
loop rings: an IMU beside the centre of mass feels a swing in pitch as a forward force.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.estimation.banded_problem import solved
from rotorfit.estimation.distributions import f_tail
from rotorfit.findings import Finding, doubt_or_passed
from rotorfit.fit.joint.joint_problem import theta_of
from rotorfit.fit.reduction.frequency_bands import EDGES, STRETCH, retimed
from rotorfit.fit.reduction.reduce import split_segment
from rotorfit.flight.filters import tukey_window
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.signals import signal_matrix

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Complex, Float

    from rotorfit.fit.fit import Fit
    from rotorfit.fit.timing.timed_dataset import TimedDataset
    from rotorfit.flight.prepare import PreparedFlight

BIN = 0.5
"""Width of one place in the spectrum [Hz]."""
AROUND = 4
"""How many bins on each side a peak is compared with, the nearest left out (a peak's own foot)."""
HIGHEST_RATIO = 4.0
"""A bin may have that many times the power of those around it."""
UNLIKELY = 1e-4
SHORTEST_STRETCH = 2.0
"""Lines of a shorter stretch are too far apart for bins of 0.5 Hz [s]."""
OFFSETS = np.array([o for o in range(-AROUND, AROUND + 1) if abs(o) > 1])
TINY = 1e-30
LOOP_RATIO = 2.0
"""Power of the rotors' push at a peak over that around it, from which the loop has it, too."""
AXES = ("forward force", "side force", "lift", "roll", "pitch", "yaw")


@frozen_dataclass
class Peak:
    """The highest peak in the errors of one configuration.

    - `frequency`: its place [Hz].
    - `ratio`: its power over that around it.
    - `probability`: of chance alone making the highest of all bins that high.
    - `push_ratio`: power of the rotors' push at the peak over that around it, along the axis that
      has the peak, too, and goes with the errors most.
    - `coherence`: of errors and that push at the peak.
    - `lines`: of spectra in it.
    """

    configuration: str
    axis: str
    frequency: float
    ratio: float
    probability: float
    push_ratio: float = 0.0
    coherence: float = 0.0
    lines: float = 0.0

    @property
    def of_loop(self) -> bool:
        """Whether the rotors swing at the peak, too, and with the errors for certain."""
        by_chance = 1.0 - (UNLIKELY / len(AXES)) ** (1.0 / max(self.lines - 1.0, 1.0))
        return self.push_ratio > LOOP_RATIO and self.coherence > by_chance


@frozen_dataclass
class Spectra:
    """Power of errors and of the rotors' push, per bin and axis, and of each with each."""

    errors: Float[np.ndarray, "f k"]
    push: Float[np.ndarray, "f k"]
    cross: Complex[np.ndarray, "f k k"]
    lines: Float[np.ndarray, " f"]


def residual_peaks(fit: Fit) -> Iterator[Finding]:
    """Check the residuals of every configuration for narrow peaks."""
    for peak in highest_peaks(fit):
        measured = {f"residual_peak@{peak.configuration}": peak.ratio}
        yield doubt_or_passed("residual-peak", peak_sentence(peak), measured)


def highest_peaks(fit: Fit) -> list[Peak]:
    """Find the highest peak of every configuration whose flights are long enough."""
    dataset, estimate = fit.dataset, fit.estimate
    every = theta_of(estimate.problem.map, estimate.estimate.values, fit.configurations)
    each = solved(dataset.model.tensor, every, estimate.problem.noisy)[0]
    peaks: list[Peak] = []
    for configured, fitted, G in zip(dataset.configurations, fit.configurations, each, strict=True):
        prepared = [flight.prepared for flight in configured.flights]
        spectra = _bin_spectra(_errors_of_stretches(dataset, prepared, G))
        # What an accelerometer shows above its bandwidth is noise alone, whatever lines it has.
        reach = np.full(len(AXES), np.inf)
        if fitted.reach is not None:
            reach[:3] = fitted.reach[:, :3].min(axis=0)
        peak = _find_highest_bin(spectra, configured.entry.name, reach=reach)
        if peak is not None:
            peaks.append(peak)
    return peaks


def _errors_of_stretches(
    dataset: TimedDataset, flights: Sequence[PreparedFlight], G: Float[np.ndarray, "k z"]
) -> Iterator[tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n k"], float]]:
    """Yield the errors of every stretch, the rotors' push along the same axes, and the rate."""
    vehicle = dataset.vehicle
    lever = vehicle.levers[:, :2]
    made = np.column_stack([vehicle.axes, lever, -vehicle.spins])
    for prepared in flights:
        data = dataclasses.replace(retimed(prepared, dataset.timing), segments=prepared.phases)
        for segment in data.segments:
            for stretch in split_segment(segment, STRETCH * data.sample_rate):
                if len(stretch) >= SHORTEST_STRETCH * data.sample_rate:
                    rows = stretch.start, stretch.stop
                    Z = signal_matrix(data, vehicle, *rows, added=dataset.model.layout.added)
                    push = data.rotor_speed[slice(*rows)] ** 2 @ made
                    yield Z @ G.T, push, data.sample_rate


def _bin_spectra(
    stretches: Iterator[tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n k"], float]],
) -> Spectra:
    """Sum the power per bin, every stretch over its own mean power, and count the lines per bin."""
    count = int(EDGES[-1] / BIN)
    errors, push = np.zeros((2, count, len(AXES)))
    cross = np.zeros((count, len(AXES), len(AXES)), dtype=complex)
    lines = np.zeros(count)
    for left, pushed, rate in stretches:
        place = (np.fft.rfftfreq(len(left), 1.0 / rate) / BIN).astype(int)
        inside = (place > 0) & (place < count)
        if rate < 2.5 * EDGES[-1] or not inside.any():
            continue
        one, other = (
            _normalised_spectrum(left)[inside],
            _normalised_spectrum(pushed - pushed.mean(axis=0))[inside],
        )
        one, other = (x / np.sqrt((np.abs(x) ** 2).mean(axis=0) + TINY) for x in (one, other))
        np.add.at(errors, place[inside], np.abs(one) ** 2)
        np.add.at(push, place[inside], np.abs(other) ** 2)
        np.add.at(cross, place[inside], one.conj()[:, :, None] * other[:, None, :])
        np.add.at(lines, place[inside], 1.0)
    return Spectra(errors=errors, push=push, cross=cross, lines=lines)


def _normalised_spectrum(values: Float[np.ndarray, "n k"]) -> Complex[np.ndarray, "f k"]:
    """Compute the spectrum of a stretch, each axis over its own size."""
    size = np.abs(values).max(axis=0)
    window = tukey_window(len(values), 0.2)[:, None]
    return np.fft.rfft(values / np.where(size > 0.0, size, 1.0) * window, axis=0)


def _find_highest_bin(
    spectra: Spectra, configuration: str, *, reach: Float[np.ndarray, " k"]
) -> Peak | None:
    """Find the highest bin over its surroundings; None if there is nothing to compare.

    `reach`: highest frequency that is looked at, by axis [Hz].
    """
    lines = spectra.lines
    bins = range(AROUND + 1, len(lines) - AROUND)
    best: Peak | None = None
    for f in bins:
        around = lines[f + OFFSETS].sum()
        if lines[f] == 0 or around == 0:
            continue
        ratio = _over_surroundings(spectra.errors, lines, f) * ((f + AROUND) * BIN < reach)
        k = int(np.argmax(ratio))
        if best is None or ratio[k] > best.ratio:
            tail = f_tail(float(ratio[k]), 2.0 * float(lines[f]), 2.0 * float(around))
            push_ratio, coherence = _with_push(spectra, f, k)
            best = Peak(
                configuration=configuration,
                axis=AXES[k],
                frequency=(f + 0.5) * BIN,
                ratio=float(ratio[k]),
                probability=min(tail * len(bins) * len(AXES), 1.0),
                push_ratio=push_ratio,
                coherence=coherence,
                lines=float(lines[f]),
            )
    return best


def _with_push(spectra: Spectra, f: int, k: int) -> tuple[float, float]:
    """Return the ratio and coherence of the push that goes with the errors of an axis most."""
    ratio = _over_surroundings(spectra.push, spectra.lines, f)
    both = np.maximum(spectra.errors[f, k] * spectra.push[f], TINY)
    coherence = np.abs(spectra.cross[f, k]) ** 2 / both * (ratio > LOOP_RATIO)
    j = int(np.argmax(coherence))
    return float(ratio[j]), float(coherence[j])


def _over_surroundings(
    power: Float[np.ndarray, "f k"], lines: Float[np.ndarray, " f"], f: int
) -> Float[np.ndarray, " k"]:
    """Compute the mean power of a bin over that of the bins around it."""
    around = power[f + OFFSETS].sum(axis=0) / lines[f + OFFSETS].sum()
    return (power[f] / lines[f]) / np.maximum(around, TINY)


def peak_sentence(peak: Peak) -> str | None:
    """Explain a peak; None if chance could make it, or it is not high."""
    if peak.ratio < HIGHEST_RATIO or peak.probability > UNLIKELY:
        return None
    seen = (
        f"{peak.configuration}: {peak.axis} moves at {peak.frequency:.1f} Hz in a way that the "
        f"model does not explain, {peak.ratio:.0f} times as much as at frequencies around it"
    )
    if peak.of_loop:
        return (
            f"{seen}, and the rotors swing with it (coherence {peak.coherence:.2f}): the rate loop "
            "oscillates there, or follows what shakes the gyro: unless rotorfit loop calls the "
            "axis calm, lower the rate gains (P and D), or the gyro's low-pass; else look for a "
            "loose part or a swinging load"
        )
    return f"{seen}: look for a loose part, a propeller out of balance or a swinging load"


CHECKS: Final = (residual_peaks,)
