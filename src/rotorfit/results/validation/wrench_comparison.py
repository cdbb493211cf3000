"""Body wrench against rotor wrench over a flight: what validation yields and figures show.

Coherence and excitation are ratios of spectra of two signals that went through the same low-pass,
so that it cancels: of body wrench and rotor wrench, and of the rotor wrench over the difference.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.signals import whole_samples
from rotorfit.flight.spectral_density import cross_densities
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from jaxtyping import Bool, Float

COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
SHOWN = ("Fz", "Mx", "My", "Mz")
"""The components that rotors of a flat multirotor make (Six et al. 2020, Fig. 3 and 4)."""


@frozen_dataclass
class WrenchComparison:
    """Two sides of the equations of motion on one flight, with a result's parameters.

    Attributes
    ----------
    configuration, flight, sha256
        Which configuration the flight was flown in; its file and fingerprint.
    used_in_fit
        Whether the flight's own data made the parameters.
    time
        Since the log's first sample [s]; the steps over cuts are longer.
    body_wrench
        What the motion asks for, force then torque about the body origin [N, N m].
    rotor_wrench
        What the rotors give.
    relative_error
        Norm of the difference over the norm of the rotor wrench, by component, as a fraction
        (Six et al. 2020, Table III).
    whiteness
        Largest autocorrelation of the difference beyond the low-pass's own memory, by component:
        near 0 where nothing of the motion is left in it.
    speeds
        Between which 99.8 % of the rotor speeds in the air were [rad/s]; None if not known.
    """

    configuration: str
    flight: str
    sha256: str
    used_in_fit: bool
    time: Float[np.ndarray, " n"]
    body_wrench: Float[np.ndarray, "n 6"]
    rotor_wrench: Float[np.ndarray, "n 6"]
    relative_error: Mapping[str, float]
    whiteness: Mapping[str, float]
    speeds: tuple[float, float] | None = None


WINDOW_SECONDS: Final = 4.0
HIGHEST: Final = 8.0
"""Highest frequency: above, the comparisons' low-pass of 3 Hz leaves too little [Hz]."""
FEWEST_WINDOWS: Final = 4
"""Independent windows, below which a coherence is chance."""
INDEPENDENT: Final = 0.95
"""Share of Hann windows, overlapping by half, that count as independent (Welch 1967)."""
TINY: Final = float(np.finfo(float).tiny)


@frozen_dataclass
class WrenchSpectra:
    """Spectra of all compared flights together.

    - `frequency`: rising, without 0 [Hz].
    - `coherence`, `ratio`: of rotor and body wrench, by component, and the amplitude of the rotor
      wrench over that of the difference.
    - `random_level`: of the coherence of unrelated signals: 95 % are below.
    - `seconds`: how much of the flights is in them [s].
    """

    frequency: Float[np.ndarray, " f"]
    coherence: dict[str, Float[np.ndarray, " f"]]
    ratio: dict[str, Float[np.ndarray, " f"]]
    random_level: float
    seconds: float


def wrench_spectra(comparisons: Sequence[WrenchComparison]) -> WrenchSpectra | None:
    """Estimate the spectra of flights of one vehicle; None with too few or short stretches."""
    grid = np.arange(1, round(HIGHEST * WINDOW_SECONDS) + 1) / WINDOW_SECONDS
    sums: dict[str, np.ndarray] = {name: np.zeros((4, len(grid))) for name in SHOWN}
    windows: dict[str, int] = dict.fromkeys(SHOWN, 0)
    seconds = 0.0
    for comparison in comparisons:
        error = comparison.relative_error
        shown = [name for name in SHOWN if math.isfinite(error.get(name, math.nan))]
        for rows, rate in _whole_stretches(comparison):
            count = 2 * len(rows) // whole_samples(WINDOW_SECONDS * rate) - 1
            seconds += len(rows) / rate
            for name in shown:
                i = COMPONENTS.index(name)
                body, rotor = comparison.body_wrench[rows, i], comparison.rotor_wrench[rows, i]
                sums[name] += count * _estimate_spectra(body, rotor, rate, grid)
                windows[name] += count
    enough = [name for name in SHOWN if INDEPENDENT * windows[name] >= FEWEST_WINDOWS]
    if not enough:
        return None
    found = {name: _coherence_and_ratio(sums[name]) for name in enough}
    least = INDEPENDENT * min(windows[name] for name in enough)
    # Flights logged much slower than the first are left out.
    return WrenchSpectra(
        frequency=grid,
        coherence={name: found[name][0] for name in enough},
        ratio={name: found[name][1] for name in enough},
        random_level=float(1.0 - 0.05 ** (1.0 / (least - 1.0))),
        seconds=seconds,
    )


def _coherence_and_ratio(
    densities: Float[np.ndarray, "4 f"],
) -> tuple[Float[np.ndarray, " f"], Float[np.ndarray, " f"]]:
    """Compute the coherence, and rotor wrench over difference, at most a million."""
    body, rotor, real, imaginary = densities
    left = body + rotor - 2.0 * real
    coherence = np.hypot(real, imaginary) ** 2 / np.maximum(body * rotor, TINY)
    return coherence, np.sqrt(rotor / np.maximum(left, 1e-12 * rotor + TINY))


def _whole_stretches(comparison: WrenchComparison) -> Iterator[tuple[np.ndarray, float]]:
    """Yield the rows of stretches without a cut that hold a window, and their sample rate."""
    time = comparison.time
    if len(time) < 2:
        return
    step = float(np.median(np.diff(time)))
    both = np.column_stack([comparison.body_wrench, comparison.rotor_wrench])
    usable: Bool[np.ndarray, " n"] = np.all(np.isfinite(both), axis=1)
    jumps = np.flatnonzero((np.diff(time) > 1.5 * step) | (np.diff(usable.astype(int)) != 0)) + 1
    if step * 2.0 * HIGHEST > 1.0:
        return
    for rows in np.split(np.arange(len(time)), jumps):
        if usable[rows[0]] and len(rows) >= whole_samples(WINDOW_SECONDS / step):
            yield rows, 1.0 / step


def _estimate_spectra(
    body: Float[np.ndarray, " n"],
    rotor: Float[np.ndarray, " n"],
    rate: float,
    grid: Float[np.ndarray, " f"],
) -> Float[np.ndarray, "4 f"]:
    """Estimate the densities of body and rotor wrench, and both parts of their cross density."""
    window = whole_samples(WINDOW_SECONDS * rate)
    f, cross = cross_densities(np.column_stack([body, rotor]), rate, window)
    parts: list[Float[np.ndarray, " f"]] = [np.real(cross[0, 0]), np.real(cross[1, 1])]
    parts += [np.real(cross[0, 1]), np.imag(cross[0, 1])]
    # Each at its own rate: the bins are not quite those of the grid.
    return np.array([np.interp(grid, f, part) for part in parts])
