r"""Estimate by how much a sensor comes later than the rotors, or than another sensor.

The thrust of all rotors together shows in the accelerometer, their differences in the gyro, both
at once. Where one comes later than the other, its samples are stamped late or stand behind a
low-pass filter; one delay of the motors cannot serve both.

The joint fit predicts each acceleration p from the rotors. In each band of frequencies the time
:math:`d` by which the measured one, y, comes later is that at which
:math:`|y - p e^{-i \omega d}|` is least. What is left there, r times p, is noise, gusts and what
the model lacks, and the autopilot responds to it: as far as the rotors go with it, the time moves
by up to :math:`r / \omega`. Drag that the model lacks moves it by :math:`c / \omega^2`. A sensor
that is late is so in all bands, so that bands and axes are weighed together.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rotorfit.estimation.dispersion import common_mean
from rotorfit.fit.sensors.sensor_response import (
    FED_BACK,
    LIFT,
    TURNS,
    Spectra,
    deviation_by_chance,
    flight_spectra,
)
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float

    from rotorfit.fit.dataset.dataset import LoadedFlight
    from rotorfit.fit.fit import Fit

BANDS: Final = ((1.0, 2.0), (2.0, 3.0), (3.0, 4.5), (4.5, 7.0), (7.0, 10.0))
"""Bands in which the times are compared [Hz]: further up their phases are ambiguous."""
REACH: Final = 0.1
"""How far a time is looked for [s]."""
LEAST: Final = 1e-12
"""Least share of a measured acceleration's power that is predicted."""
DRAGGED: Final = 1.0
"""Deviation of a drag that the model lacks, over mass or inertia [1/s]."""

ROUNDS: Final = 20
"""After the first, until what is left belongs to the time that is found."""


@frozen_dataclass
class Lateness:
    """The delay of a sensor after another, or after the rotors, and its deviation [s]."""

    seconds: float
    std: float

    @property
    def interval(self) -> tuple[float, float]:
        """Of 95 % [s]."""
        return self.seconds - 1.96 * self.std, self.seconds + 1.96 * self.std

    @property
    def least(self) -> float:
        """The end of the interval nearest to 0; 0 if it holds 0 [s]."""
        low, high = self.interval
        return max(low, 0.0) + min(high, 0.0)


class BandDelay(NamedTuple):
    """A time of one axis in one band [s], its deviation [s], and the middle of the band [rad/s].

    - `left`, `common`: powers over that of the prediction: what is left at that time, and what both
      have in common.
    """

    seconds: float
    std: float
    omega: float
    left: float
    common: float

    def unexplained(self, seconds: float) -> float:
        """Return the power that is left at another time, over that of the prediction."""
        difference = np.sin(0.5 * self.omega * (seconds - self.seconds))
        return self.left + 4.0 * self.common * float(difference) ** 2


def accelerometer_lateness(fit: Fit) -> Iterator[tuple[LoadedFlight, Lateness]]:
    """Estimate the delay of the accelerometer after the gyro, in every informative flight."""
    for flight, spectra in flight_spectra(fit):
        force, turns = (lateness(spectra, axes) for axes in (LIFT, TURNS))
        if force is not None and turns is not None:
            std = float(np.hypot(force.std, turns.std))
            yield flight, Lateness(seconds=force.seconds - turns.seconds, std=std)


def lateness(spectra: Spectra, axes: Sequence[int]) -> Lateness | None:
    """Estimate the time of some axes after the rotors; None if no band counts."""
    delays = [[_band_delay(spectra.band(*band), axis) for band in BANDS] for axis in axes]
    found = [[delay for delay in own if delay is not None] for own in delays]
    return weigh_bands(found) if any(found) else None


def weigh_bands(found: Sequence[Sequence[BandDelay]]) -> Lateness:
    """Weigh all bands of a sensor's axes, each axis with a drag and a phase of its own."""
    weighed = _at_one_time(found, about=0.0)
    for _ in range(ROUNDS):
        weighed = _at_one_time(found, about=weighed.seconds)
    return weighed


def _at_one_time(found: Sequence[Sequence[BandDelay]], *, about: float) -> Lateness:
    """Weigh the bands of each axis, with the phase that is open near a time [s]."""
    rows: list[Float[np.ndarray, " p"]] = []
    for own, bands in zip(np.eye(len(found)), found, strict=True):
        phase = FED_BACK * _mean_unexplained(bands, about)
        rows += [np.r_[1.0, own * DRAGGED / one.omega**2, own * phase / one.omega] for one in bands]
    return _solve_lateness(np.array(rows), [one for bands in found for one in bands])


def _mean_unexplained(found: Sequence[BandDelay], about: float) -> float:
    """Average the root of what is left at a time over the bands of an axis, as they tell it."""
    weight = np.array([one.std**-2.0 for one in found])
    power = np.array([one.unexplained(about) for one in found])
    return float(np.sqrt(weight @ power / weight.sum())) if found else 0.0


def _solve_lateness(rows: Float[np.ndarray, "b p"], found: Sequence[BandDelay]) -> Lateness:
    """Solve for the time common to all bands; drags and phases are 0 +- 1."""
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
    # Further off than half a period, the highest line has the same phase once more.
    reach = min(REACH, np.pi / float(omega[-1]))
    tried = np.linspace(-reach, reach, 201)
    alike = (np.exp(1j * tried[:, None] * omega) @ (p.conj() * y).sum(axis=0)).real
    seconds = float(tried[int(np.argmax(alike))])
    late = p * np.exp(-1j * omega * seconds)
    slope = -1j * omega * late
    information = (np.abs(slope) ** 2).sum(axis=1)
    chance = deviation_by_chance((slope.conj() * (y - late)).real.sum(axis=1), information)
    middle = float(np.sqrt(information.sum() / power))
    left = float((np.abs(y - late) ** 2).sum()) / power
    # Times between two of those tried are indistinguishable.
    step = float(tried[1] - tried[0])
    std = float(np.linalg.norm([chance, FED_BACK * np.sqrt(left) / middle, step]))
    return BandDelay(seconds, std, middle, left=left, common=max(float(alike.max()) / power, 0.0))


def of_one_vehicle(found: Sequence[Lateness]) -> list[Lateness]:
    """Draw the times of flights to their mean: the others of the vehicle may refute one."""
    if len(found) < 2:
        return list(found)
    values, chance = np.array([(one.seconds, one.std**2) for one in found]).T
    common = common_mean(values, chance)
    drawn = [common.drawn(one.seconds, one.std**2) for one in found]
    return [Lateness(seconds=value, std=variance**0.5) for value, variance in drawn]
