r"""By how much accelerometer and gyro come after what the rotors do, each with its interval.

The joint fit predicts each acceleration p from the rotors. In each band of frequencies the time
:math:`d` by which the measured one, y, comes later is that at which
:math:`|y - p e^{-i \omega d}|` is least. What is left there, r times p, is noise, gusts and what
the model lacks, and the autopilot answers it: as far as the rotors go with it, the time moves by up
to :math:`r / \omega`. Drag that the model lacks moves it by :math:`c / \omega^2`. A sensor that is
late is so in all bands, so that bands and axes are weighed together.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float

from rotorfit.dataset.dataset import LoadedFlight
from rotorfit.diagnostics.sensors.sensor_spectra import (
    FED_BACK,
    LIFT,
    TURNS,
    Spectra,
    deviation_by_chance,
    flight_spectra,
)
from rotorfit.fit.fit import Fit

BANDS: Final = ((1.0, 2.0), (2.0, 3.0), (3.0, 4.5), (4.5, 7.0), (7.0, 10.0))
"""In which the times are compared [Hz]: further up their phases are ambiguous."""
REACH: Final = 0.1
"""How far a time is looked for [s]."""
LEAST: Final = 1e-12
"""Of the power of a measured acceleration, below which nothing is predicted."""
DRAGGED: Final = 1.0
"""Deviation of a drag that the model lacks, over mass or inertia [1/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lateness:
    """By how much a sensor comes after another, or after the rotors, and its deviation [s]."""

    seconds: float
    std: float

    @property
    def interval(self) -> tuple[float, float]:
        """Of 95 % [s]."""
        return self.seconds - 1.96 * self.std, self.seconds + 1.96 * self.std

    @property
    def least(self) -> float:
        """What the interval leaves at least, with its sign; 0 where it holds 0 [s]."""
        low, high = self.interval
        return max(low, 0.0) + min(high, 0.0)


class BandDelay(NamedTuple):
    """A time of one axis in one band [s], its deviation [s], and the middle of the band [rad/s]."""

    seconds: float
    std: float
    omega: float


def accelerometer_lateness(fit: Fit) -> Iterator[tuple[LoadedFlight, Lateness]]:
    """Estimate by how much the accelerometer comes after the gyro, in every flight that tells."""
    for flight, spectra in flight_spectra(fit):
        force, turns = (lateness(spectra, axes) for axes in (LIFT, TURNS))
        if force is not None and turns is not None:
            std = float(np.hypot(force.std, turns.std))
            yield flight, Lateness(seconds=force.seconds - turns.seconds, std=std)


def lateness(spectra: Spectra, axes: Sequence[int]) -> Lateness | None:
    """Weigh all bands of a sensor's axes, with a drag for each axis; None where none tells."""
    rows: list[Float[np.ndarray, " p"]] = []
    found: list[BandDelay] = []
    for k, axis in enumerate(axes):
        for band in BANDS:
            delay = _band_delay(spectra.band(*band), axis)
            if delay is not None:
                found.append(delay)
                rows.append(np.r_[1.0, np.eye(len(axes))[k] * DRAGGED / delay.omega**2])
    return _weighed(np.array(rows), found) if found else None


def _weighed(rows: Float[np.ndarray, "b p"], found: Sequence[BandDelay]) -> Lateness:
    """Solve for the time common to all bands; drags are 0 +- 1."""
    weighed = rows / np.array([[one.std] for one in found])
    values = np.array([one.seconds / one.std for one in found])
    known = np.diag([0.0] + [1.0] * (rows.shape[1] - 1))
    covariance = np.linalg.inv(weighed.T @ weighed + known)
    solution = covariance @ weighed.T @ values
    left = values - weighed @ solution
    spread = np.sqrt(max(float(left @ left) / max(len(found) - 1, 1), 1.0))
    return Lateness(seconds=float(solution[0]), std=float(spread * np.sqrt(covariance[0, 0])))


def _band_delay(band: Spectra, axis: int) -> BandDelay | None:
    """Find the time in a band at which an acceleration is nearest to its prediction."""
    omega = 2.0 * np.pi * band.frequency
    y, p = band.measured[:, :, axis], band.predicted[:, :, axis]
    power = float((np.abs(p) ** 2).sum())
    if not power > LEAST * float((np.abs(y) ** 2).sum()):
        return None
    reach = min(REACH, np.pi / float(omega[-1]))
    tried = np.linspace(-reach, reach, 201)
    alike = (np.exp(1j * tried[:, None] * omega) @ (p.conj() * y).sum(axis=0)).real
    seconds = float(tried[int(np.argmax(alike))])
    late = p * np.exp(-1j * omega * seconds)
    slope = -1j * omega * late
    information = (np.abs(slope) ** 2).sum(axis=1)
    chance = deviation_by_chance((slope.conj() * (y - late)).real.sum(axis=1), information)
    middle = float(np.sqrt(information.sum() / power))
    unexplained = np.sqrt(float((np.abs(y - late) ** 2).sum()) / power)
    std = float(np.hypot(chance, FED_BACK * unexplained / middle))
    # Times between two of those tried are indistinguishable.
    return BandDelay(seconds, float(np.hypot(std, tried[1] - tried[0])), middle)
