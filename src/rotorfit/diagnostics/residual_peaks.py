"""What the model leaves should have no peaks: a narrow one is a vibration, or something missing.

The errors of the six accelerations, stretch by stretch as in the fit, each band over its variance:
their mean power at one frequency, over all stretches, beside that at the frequencies around it.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy import signal, stats

from rotorfit.dataset.dataset import Dataset
from rotorfit.estimation.banded_problem import solved
from rotorfit.findings import Finding, doubt_or_passed
from rotorfit.fit.fit import Fit
from rotorfit.fit.joint.joint_problem import theta_of
from rotorfit.model.signals import signal_matrix
from rotorfit.preprocessing.prepare import PreparedFlight
from rotorfit.reduction.frequency_bands import EDGES, STRETCH, retimed
from rotorfit.reduction.reduce import split_segment

BIN = 0.5
"""Width of one place in the spectrum [Hz]."""
AROUND = 4
"""How many bins on each side a peak is compared with, the nearest left out (a peak's own foot)."""
HIGHEST_RATIO = 4.0
"""A bin may have that many times the power of those around it."""
UNLIKELY = 1e-4
SHORTEST_STRETCH = 2.0
"""Lines of a shorter stretch are too far apart for bins of 0.5 Hz [s]."""
AXES = ("forward force", "side force", "lift", "roll", "pitch", "yaw")


@dataclass(frozen=True, slots=True, kw_only=True)
class Peak:
    """The highest peak in the errors of one configuration.

    Attributes
    ----------
    configuration, axis
        Where it is.
    frequency
        Its place [Hz].
    ratio
        Its power over that around it.
    probability
        Of chance alone making the highest of all bins that high.
    """

    configuration: str
    axis: str
    frequency: float
    ratio: float
    probability: float


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
    for configured, G in zip(dataset.configurations, each, strict=True):
        prepared = [flight.prepared for flight in configured.flights]
        power, lines = _binned(_errors(dataset, prepared, G))
        peak = _highest(power, lines, configured.entry.name)
        if peak is not None:
            peaks.append(peak)
    return peaks


def _errors(
    dataset: Dataset, flights: Sequence[PreparedFlight], G: Float[np.ndarray, "k z"]
) -> Iterator[tuple[Float[np.ndarray, "n k"], float]]:
    """Yield the errors of every stretch, and the sample rate."""
    for prepared in flights:
        data = dataclasses.replace(retimed(prepared, dataset.timing), segments=prepared.phases)
        for segment in data.segments:
            for stretch in split_segment(segment, STRETCH * data.sample_rate):
                if len(stretch) >= SHORTEST_STRETCH * data.sample_rate:
                    rows = stretch.start, stretch.stop
                    Z = signal_matrix(
                        data, dataset.vehicle, *rows, added=dataset.model.layout.added
                    )
                    yield Z @ G.T, data.sample_rate


def _binned(
    stretches: Iterator[tuple[Float[np.ndarray, "n k"], float]],
) -> tuple[Float[np.ndarray, "f k"], Float[np.ndarray, " f"]]:
    """Sum the power per bin, every stretch over its own mean power, and count the lines per bin."""
    count = int(EDGES[-1] / BIN)
    power, lines = np.zeros((count, len(AXES))), np.zeros(count)
    for errors, rate in stretches:
        window = signal.windows.tukey(len(errors), 0.2)
        spectrum = np.abs(np.fft.rfft(errors * window[:, None], axis=0)) ** 2
        place = (np.fft.rfftfreq(len(errors), 1.0 / rate) / BIN).astype(int)
        inside = (place > 0) & (place < count)
        if rate < 2.5 * EDGES[-1] or not inside.any():
            continue
        spectrum = spectrum[inside] / spectrum[inside].mean(axis=0)
        np.add.at(power, place[inside], spectrum)
        np.add.at(lines, place[inside], 1.0)
    return power, lines


def _highest(
    power: Float[np.ndarray, "f k"], lines: Float[np.ndarray, " f"], configuration: str
) -> Peak | None:
    """Find the highest bin over its surroundings; None where there is nothing to compare."""
    bins = range(AROUND + 1, len(lines) - AROUND)
    offsets = np.array([o for o in range(-AROUND, AROUND + 1) if abs(o) > 1])
    best: Peak | None = None
    for f in bins:
        around = lines[f + offsets].sum()
        if lines[f] == 0 or around == 0:
            continue
        ratio = (power[f] / lines[f]) / (power[f + offsets].sum(axis=0) / around)
        k = int(np.argmax(ratio))
        if best is None or ratio[k] > best.ratio:
            tail = float(stats.f.sf(float(ratio[k]), 2.0 * float(lines[f]), 2.0 * float(around)))
            best = Peak(
                configuration=configuration,
                axis=AXES[k],
                frequency=(f + 0.5) * BIN,
                ratio=float(ratio[k]),
                probability=min(tail * len(bins) * len(AXES), 1.0),
            )
    return best


def peak_sentence(peak: Peak) -> str | None:
    """Explain a peak; None where chance could make it, or it is not high."""
    if peak.ratio < HIGHEST_RATIO or peak.probability > UNLIKELY:
        return None
    return (
        f"{peak.configuration}: the part of {peak.axis} that the model does not explain has a "
        f"peak at {peak.frequency:.1f} Hz, {peak.ratio:.0f} times its surroundings: look for a "
        "loose part, a propeller out of balance or a swinging load"
    )


CHECKS: Final = (residual_peaks,)
