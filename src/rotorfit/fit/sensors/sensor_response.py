r"""Detect gyro or rotor speeds behind a filter, or an IMU on a soft mount.

The fit predicts the turns from the rotors; the ratio H of the measured ones to these is one at all
frequencies, but for a factor of each axis and a delay. A low-pass of the rotor speeds makes it
rise, as does an IMU on springs below its resonance, a low-pass of the gyro makes it fall, each in
amplitude and phase together:

.. math:: \ln H = -\ln(1 - u^2 + 2 j \zeta u), \quad u = f / f_0

and its inverse. What is unexplained may be the autopilot's response, as in `clocks`. The
factor of an axis is that of its inertia at low frequencies, so that the filter that fits best says
by how much the fit's is off.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from rotorfit.estimation.banded_problem import solved
from rotorfit.estimation.distributions import student_quantile
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.joint.joint_problem import theta_of
from rotorfit.fit.reduction.frequency_bands import EDGES, retimed
from rotorfit.fit.reduction.windows import WINDOW, transform_rows, window_starts
from rotorfit.fit.timing.timing_faults import lowpass_of
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.signals import signal_matrix

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from jaxtyping import Complex, Float

    from rotorfit.fit.dataset.dataset import ConfigurationData, LoadedFlight
    from rotorfit.fit.fit import Fit
    from rotorfit.fit.timing.timed_fit import TimedFit
    from rotorfit.flight.flight_data import FlightData

    Shape = Callable[[Float[np.ndarray, " b"]], Complex[np.ndarray, " b"]]

LOWEST: Final = 1.0
"""Frequency below which the air responds with a phase of its own [Hz]."""
FED_BACK: Final = 0.6
"""Deviation of the share of the unexplained that goes with the rotors, because the autopilot
responds: over all bands and axes of 13 real flights, of autopilots' and of simulated ones."""
LIFT: Final = (2,)
TURNS: Final = (3, 4, 5)
"""Which of the six accelerations accelerometer and gyro measure best."""
BANDS: Final = (1.0, 2.0, 3.0, 4.5, 7.0, 10.0, 14.0, 19.0, 25.0, 30.0)
"""Edges [Hz]."""
MOST_UNEXPLAINED: Final = 0.8
"""Amplitude of what is left over that of the prediction, from which a band says nothing."""
FEWEST: Final = 6
"""Bands of all axes that separate a filter from a factor and a delay."""
CUTOFFS: Final = np.geomspace(6.0, 120.0, 40)
"""Cut-offs of the filters that are tried [Hz]."""
LEAST_SPREAD: Final = 0.25
"""Least ratio of the residual to the allowed one (mean squares): on real flights .3 and more."""
LEAST_GAIN: Final = 10.0
"""Gain of chi-square over that spread, from which a filter is reported: of 22 sound flights 5 at
most, of filters at 15 Hz in brisk ones 12 to 32."""
LAG: Final = 0.035
"""About that of motors, by which its slope is taken [s]."""


def _second_order(damping: float) -> Shape:
    """Compute ln of the denominator of a second-order filter, by frequency over its own."""

    def shape(u: Float[np.ndarray, " b"]) -> Complex[np.ndarray, " b"]:
        return np.log(1.0 - u**2 + 2j * damping * u)

    return shape


_MOUNT, _FILTER = _second_order(0.15), _second_order(0.7071)
SHAPES: Final[dict[str, Shape]] = {
    "soft mount": lambda u: -_MOUNT(u),
    "speeds low-passed": lambda u: np.log(1.0 + 1j * u),
    "speeds low-passed twice": _FILTER,
    "gyro low-passed": lambda u: -_FILTER(u),
}
TOUCHED: Final = {
    3: ("Ixx", "Ixx_com", "Ixx_over_kt"),
    4: ("Iyy", "Iyy_com", "Iyy_over_kt"),
    5: ("Izz", "Izz_com", "Izz_over_kt", "kd", "Jr", "kd_over_kt", "kd_over_Izz", "Jr_over_Izz"),
}
"""Numbers in proportion to the factor of a turn, by its place among the accelerations."""


class Spectra(NamedTuple):
    """Lines [Hz] of the six accelerations of every window, measured and predicted."""

    frequency: Float[np.ndarray, " l"]
    measured: Complex[np.ndarray, "w l k"]
    predicted: Complex[np.ndarray, "w l k"]

    def band(self, low: float, high: float) -> Spectra:
        """Select the lines of a band."""
        inside = (self.frequency >= low) & (self.frequency < high)
        return Spectra(self.frequency[inside], self.measured[:, inside], self.predicted[:, inside])


def flight_spectra(fit: Fit | TimedFit) -> Iterator[tuple[LoadedFlight, Spectra]]:
    """Yield the spectra of every flight that has a window."""
    dataset, estimate = fit.dataset, fit.estimate
    theta = theta_of(estimate.problem.map, estimate.estimate.values, fit.configurations)
    each = solved(dataset.model.tensor, theta, estimate.problem.noisy)[0]
    for configured, G in zip(dataset.configurations, each, strict=True):
        yield from _own_spectra(fit, configured, G)


def _own_spectra(
    fit: Fit | TimedFit, configured: ConfigurationData, G: Float[np.ndarray, "k z"]
) -> Iterator[tuple[LoadedFlight, Spectra]]:
    for flight in configured.flights:
        data = retimed(flight.prepared, fit.dataset.timing)
        rows = round(WINDOW * data.sample_rate)
        frequency = np.fft.rfftfreq(rows, 1.0 / data.sample_rate)
        top = min(EDGES[-1], 0.4 * flight.prepared.slowest_rate)
        inside = (frequency >= LOWEST) & (frequency < top)
        lines = [
            _transform_window(fit, data, start, G)[inside] for start in window_starts(data, rows)
        ]
        if lines:
            measured, predicted = np.split(np.array(lines), 2, axis=2)
            yield flight, Spectra(frequency[inside], measured, predicted)


def _transform_window(
    fit: Fit | TimedFit, data: FlightData, start: int, G: Float[np.ndarray, "k z"]
) -> Complex[np.ndarray, "l k2"]:
    """Transform one window: the accelerations as measured, then as predicted."""
    dataset, noisy = fit.dataset, list(fit.estimate.problem.noisy)
    stop = start + round(WINDOW * data.sample_rate)
    Z = signal_matrix(data, dataset.vehicle, start, stop, added=dataset.model.layout.added)
    both = np.column_stack([Z[:, noisy], Z[:, noisy] - Z @ G.T])
    return transform_rows(both, np.hanning(stop - start)[:, None])


def deviation_by_chance(
    score: Float[np.ndarray, " w"], information: Float[np.ndarray, " w"]
) -> float:
    """Compute the deviation of a number by windows, with their effective degrees of freedom."""
    total = float(information.sum())
    # Windows overlap by half: of three, two are their own.
    shares = information / total
    degrees = max(1.0 / float(shares @ shares) / 1.5, 1.0)
    t = float(student_quantile(0.975, degrees)) / 1.96
    return t * float(np.linalg.norm(score / total))


class BandRatio(NamedTuple):
    """Measured over predicted turn in one band: flight, axis, [Hz], ln H and its deviation."""

    flight: int
    axis: int
    frequency: float
    log: complex
    std: float


@frozen_dataclass
class FoundFilter:
    """The filter or mount that fits best.

    - `shape`: of `SHAPES`.
    - `cutoff`, `interval`: its frequency and that one's 95 % interval [Hz].
    - `gain`: of chi-square over its spread, against none.
    - `factors`: by which share it moves the factor of each axis, the mean of all flights.
    - `delay`, `lag`: by how much it moves the delay, the mean of all flights, and the motors' lag
      where that is open [s].
    """

    shape: str
    cutoff: float
    interval: tuple[float, float]
    gain: float
    factors: dict[int, float]
    delay: float
    lag: float

    @property
    def certain(self) -> bool:
        """Whether the flights show it."""
        return bool(self.gain > LEAST_GAIN and self.interval[1] < CUTOFFS[-1])


def allow_for_sensor_response(fit: Fit) -> Fit:
    """Append the shift of the numbers with the best filter or soft mount, and record it."""
    if fit.dataset.source != "imu" or lowpass_of(fit.dataset) is not None:
        return fit
    found = found_filter(fit)
    if found is None:
        return fit
    half = np.zeros(len(fit.numbers.names))
    for i, name in enumerate(fit.numbers.names):
        moved = [found.factors[k] for k, own in TOUCHED.items() if name.partition("@")[0] in own]
        half[i] = abs(sum(moved) * fit.numbers.values[i])
    term = IntervalTerm(
        name="sensor response", half_width=half, source="the filter or soft mount that fits best"
    )
    return fit.with_record(found).with_terms(term)


def found_filter(fit: Fit) -> FoundFilter | None:
    """Find the filter that brings measured and predicted turns together best; None if none can."""
    ratios = flight_ratios(fit)
    lagging = "motor_lag" in fit.estimate.estimate.names
    return best_filter(ratios, lagging=lagging)


def best_filter(ratios: Sequence[BandRatio], *, lagging: bool = False) -> FoundFilter | None:
    """Find that filter by ratios of bands; with `lagging`, the motors' lag is free, too."""
    flights = {one.flight for one in ratios}
    if len(ratios) < FEWEST * len(flights) or not ratios:
        return None
    frequency = np.array([one.frequency for one in ratios])
    without = _fit_filtered_ratios(ratios, np.zeros(len(ratios), dtype=complex), lagging=lagging)
    best: FoundFilter | None = None
    for name, shape in SHAPES.items():
        tried = [
            _fit_filtered_ratios(ratios, shape(frequency / f), lagging=lagging) for f in CUTOFFS
        ]
        chi2 = np.array([one.chi2 for one in tried])
        i = int(np.argmin(chi2))
        spread = max(float(chi2[i]) / (2.0 * len(ratios)), LEAST_SPREAD)
        gain = float(without.chi2 - chi2[i]) / spread
        if best is None or gain > best.gain:
            # 95 % of chi-square with one degree of freedom: the profile of the likelihood.
            near = CUTOFFS[chi2 < chi2[i] + 3.84 * spread]
            by = tried[i]
            best = FoundFilter(
                shape=name,
                cutoff=float(CUTOFFS[i]),
                interval=(float(near[0]), float(near[-1])),
                gain=gain,
                factors={k: by.factors[k] - without.factors[k] for k in TURNS},
                delay=by.delay - without.delay,
                lag=by.lag - without.lag,
            )
    return best


class _Left(NamedTuple):
    """What the best factors and times leave: chi-square, each axis' factor, delay and lag [s]."""

    chi2: float
    factors: dict[int, float]
    delay: float
    lag: float


def _fit_filtered_ratios(
    ratios: Sequence[BandRatio], shape: Complex[np.ndarray, " b"], *, lagging: bool
) -> _Left:
    """Fit factors, delays and, with `lagging`, the lag to ratios behind a filter."""
    omega: Float[np.ndarray, " b"] = 2.0 * np.pi * np.array([one.frequency for one in ratios])
    std: Float[np.ndarray, " b"] = np.array([one.std for one in ratios])
    logs: Complex[np.ndarray, " b"] = np.array([one.log for one in ratios])
    off = logs - shape
    amplitude = np.real(off) / std
    phase = np.angle(np.exp(1j * np.imag(off))) / std
    keys = sorted({(one.flight, one.axis) for one in ratios})
    own = np.array([[(one.flight, one.axis) == key for key in keys] for one in ratios], dtype=float)
    times = [-1j * omega * np.array([one.flight == k for one in ratios])
             for k in sorted({one.flight for one in ratios})]  # fmt: skip
    if lagging:
        times.append(-1j * omega / (1.0 + 1j * omega * LAG))
    columns = np.column_stack([own.astype(complex), *times]) / std[:, None]
    A = np.concatenate([np.real(columns), np.imag(columns)])
    b: Float[np.ndarray, " r"] = np.concatenate([amplitude, phase])
    solution: Float[np.ndarray, " p"] = np.linalg.lstsq(A, b, rcond=None)[0]
    left = b - A @ solution
    factors = {k: _mean_of([x for x, (_, axis) in zip(solution, keys, strict=False) if axis == k])
               for k in TURNS}  # fmt: skip
    rest = solution[len(keys) :].tolist()
    lag = rest.pop() if lagging else 0.0
    return _Left(float(left @ left), factors, _mean_of(rest), lag)


def _mean_of(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else 0.0


def flight_ratios(fit: Fit) -> list[BandRatio]:
    """Compare measured and predicted turns of all flights of a fit."""
    return band_ratios(spectra for _, spectra in flight_spectra(fit))


def band_ratios(flights: Iterable[Spectra]) -> list[BandRatio]:
    """Compare measured and predicted turns band by band, where the prediction explains them."""
    found = [
        _band_ratio(spectra.band(*edges), number, axis)
        for number, spectra in enumerate(flights)
        for axis in TURNS
        for edges in pairwise(BANDS)
    ]
    return [one for one in found if one is not None]


def _band_ratio(band: Spectra, flight: int, axis: int) -> BandRatio | None:
    y, p = band.measured[:, :, axis], band.predicted[:, :, axis]
    power = (np.abs(p) ** 2).sum(axis=1)
    total = float(power.sum())
    rest = float((np.abs(y - p) ** 2).sum())
    if not total > 0.0 or rest > MOST_UNEXPLAINED**2 * total:
        return None
    H = complex((p.conj() * y).sum() / total)
    chance = deviation_by_chance(np.abs((p.conj() * (y - H * p)).sum(axis=1)), power)
    frequency = float((band.frequency * (np.abs(p) ** 2).sum(axis=0)).sum() / total)
    std = float(np.hypot(chance, FED_BACK * np.sqrt(rest / total))) / abs(H)
    return BandRatio(flight, axis, frequency, complex(np.log(H)), std)
