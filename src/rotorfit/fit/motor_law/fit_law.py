"""Lag, delay and law of the motors, from commands and the speeds that were measured beside them.

Every form of the law is fitted by least squares of the measured speeds over lag, delay and the
law's own parameters together (output error: noise of the speeds, which are the only noisy channel,
pulls nothing), with a factor for each rotor. The form is chosen by its error on blocks of time that
it was not fitted to. Intervals are those of a jackknife over blocks (`block_jackknife`): residuals
are correlated by battery, air and what no law says.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
import scipy.optimize
from jaxtyping import Float
from scipy import ndimage

from rotorfit.errors import EstimationError
from rotorfit.fit.motor_law.block_jackknife import (
    FEWEST_BLOCKS,
    Jackknife,
    blocks_of,
    jackknife,
    widest,
)
from rotorfit.fit.motor_law.command_response import (
    Recording,
    Timing,
    drawn_between,
    recording_of,
    speeds_at_delays,
)
from rotorfit.fit.motor_law.law_model import FORMS, FormName, Layout, predicted, timing_of
from rotorfit.flight.motors.command_response import (
    MeasuredResponse,
    response_spans,
    responses_within,
)
from rotorfit.flight.motors.motor_model import white_noise_std

MOST_SPEEDS: Final = 80_000
"""Measured speeds that are fitted to, of all rotors and flights."""
BLOCKS: Final = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Lengths of blocks that are tried; the widest intervals count [s]."""
CHOICE_BLOCK: Final = 1.0
"""Length of the blocks that forms are compared on [s]."""
LEAST_SECONDS: Final = 4.0
"""Of measured speeds in flight, below which no law is fitted."""
LEAST_SPREAD: Final = 0.01
"""Deviation of the commands below which they tell no law."""
OUTLYING: Final = 4.0
"""Robust deviations beyond which a speed counts less (Huber)."""
CLEAR: Final = 3.0
"""Log-likelihood by which another form must be worse, else the intervals reach to what it says."""
LEAST_VOLTS: Final = 0.005
"""Relative deviation of the battery voltage below which it tells nothing."""
STOPPED: Final = 0.1
"""Share of the median speed below which a rotor stands."""
FIRST_LAGS: Final = (0.008, 0.015, 0.03, 0.06, 0.12)
FIRST_DELAYS: Final = (-0.02, 0.0, 0.02, 0.05, 0.1, 0.2)
"""Where the search begins [s]: lag and delay together, as noise in the commands makes a minimum of
its own where only their sum is right."""
LAGS: Final = (5e-4, 0.5)
DELAYS: Final = (-0.1, 0.3)
RATIO: Final = 2.0
"""Largest logarithm of falling over rising lag."""
SLOW: Final = 12.0
"""Twice about the frequency that is slow, and tells most of a lag of 30 ms [Hz]."""
MOST_STEPS: Final = 60
Between = Callable[[Recording], Recording]
"""What commands were between those of the log."""


def held_between(recording: Recording) -> Recording:
    """Hold every command until the next."""
    return recording


@dataclass(frozen=True, slots=True, kw_only=True)
class LawFit:
    """One form, fitted.

    - `slopes`, `residuals`: of the prediction, and measured less predicted, weighted [rad/s].
    - `speed`: predicted [rad/s].
    - `held_out`: squared error of each block under the fit to the others, over its rows
      [rad^2/s^2].
    - `jackknives`: of all lengths of blocks that are many enough.
    """

    layout: Layout
    values: Float[np.ndarray, " p"]
    slopes: Float[np.ndarray, "m p"]
    residuals: Float[np.ndarray, " m"]
    speed: Float[np.ndarray, " m"]
    held_out: Float[np.ndarray, " B"]
    jackknives: tuple[Jackknife, ...]

    @property
    def timing(self) -> Timing:
        """Lag and delay."""
        return timing_of(self.layout, self.values)

    @property
    def error(self) -> float:
        """Root mean square on blocks that the fit did not see [rad/s]."""
        return float(np.sqrt(self.held_out.mean()))

    def half_width(self, function: Callable[[Float[np.ndarray, " p"]], float]) -> float:
        """Compute half of the 95 % interval of a smooth function of the parameters."""
        gradient = np.empty(len(self.values))
        for i in range(len(gradient)):
            step = 1e-6 * np.eye(len(gradient))[i]
            gradient[i] = (function(self.values + step) - function(self.values - step)) / 2e-6
        return widest(self.jackknives, gradient)


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedLaw:
    """The law of the motors, and what else it might be.

    - `best`: the form that was chosen.
    - `others`: the other forms, with the same terms beside the curve.
    - `rivals`: those that are as good, in practice or as far as the flights tell: other forms; the
      lag on the other of speed and thrust; commands held, or smooth between those of the log.
    - `open_shifts`: half of the shift by noise and quick motion: taken off, and as much is open.
    - `voltage`: the form with an exponent of the battery's voltage; None where that tells nothing.
    """

    recording: Recording
    best: LawFit
    others: tuple[LawFit, ...]
    rivals: tuple[LawFit, ...]
    open_shifts: Float[np.ndarray, "s p"]
    voltage: LawFit | None = None

    def number(
        self, function: Callable[["LawFit", Float[np.ndarray, " p"]], float]
    ) -> tuple[float, float]:
        """Evaluate a number of the law, and half of an interval that holds every rival form's."""
        value = function(self.best, self.best.values)
        reach = self.best.half_width(lambda x: function(self.best, x))
        for rival in self.rivals:
            reach = max(reach, abs(function(rival, rival.values) - value))
        moved = [function(self.best, self.best.values + shift) for shift in self.open_shifts]
        return value, reach + sum(abs(other - value) for other in moved)

    @property
    def voltage_exponent(self) -> tuple[float, float] | None:
        """Exponent of the battery's voltage with half of its interval, where that changes."""
        if self.voltage is None:
            return None
        at = self.voltage.layout.exponent
        return float(self.voltage.values[at]), self.voltage.half_width(lambda x: float(x[at]))

    def own(self, index: int) -> tuple[float, float]:
        """Return a parameter of the chosen form, and half of its interval."""
        return replace(self, rivals=()).number(lambda _, x: float(x[index]))


def bounded_recording(responses: Sequence[Sequence[MeasuredResponse]]) -> Recording | None:
    """Join the responses of all flights, not too many; None where none has both signals."""
    flights = [one for one in responses if one]
    # So many that the fit takes seconds, however many flights there are.
    most = MOST_SPEEDS // max(len(flights), 1)
    return recording_of([responses_within(one, response_spans(one), most=most) for one in flights])


def fit_law(recording: Recording) -> FittedLaw:
    """Fit lag, delay and law of the motors; raise with the reason where speeds determine none."""
    logged = _turning(recording)
    _refuse_short(logged)
    rough = _rough(logged)
    scale = 1.4826 * float(np.median(np.abs(rough.residuals)))
    made: Between = held_between
    drawn = _fitted(drawn_between(logged), rough.layout, rough.values, scale)
    if drawn.error < rough.error:
        made, rough = drawn_between, drawn
    recording = made(logged)
    fits = [_refitted(recording, replace(rough.layout, form=name), rough, scale) for name in FORMS]
    best = _two_way(recording, _likeliest(fits), scale)
    on_thrust = _on_thrust(recording, best, scale)
    if _surprise(best, on_thrust) > CLEAR:
        best, on_thrust = on_thrust, best
    others = tuple(fit for fit in fits if fit.layout.form != best.layout.form)
    other = held_between if made is drawn_between else drawn_between
    across = _fitted(other(logged), best.layout, best.values, scale)
    alike = (*others, on_thrust, across)
    open_shifts = np.zeros((2, len(best.values)))
    if not _whole(logged, made, _surprise(across, best)):
        by_noise = _shift_by_noise(logged, made, best, scale)
        open_shifts = 0.5 * np.array([by_noise, -_slow_shift(recording, best)])
    return FittedLaw(
        recording=recording,
        best=replace(best, values=best.values - open_shifts.sum(axis=0)),
        others=others,
        rivals=tuple(f for f in alike if _surprise(f, best) < CLEAR),
        open_shifts=open_shifts,
        voltage=_with_voltage(recording, best, scale),
    )


def _with_voltage(recording: Recording, best: LawFit, scale: float) -> LawFit | None:
    """Return the form with an exponent of the voltage; None where that hardly changes."""
    if best.layout.voltage or not _voltage_changes(recording):
        return best if best.layout.voltage else None
    return _refitted(recording, replace(best.layout, voltage=True), best, scale)


def _voltage_changes(recording: Recording) -> bool:
    return recording.voltage is not None and float(recording.voltage.std()) > LEAST_VOLTS


def _rough(recording: Recording) -> LawFit:
    """Fit the most general form, with voltage and a lag for each way where the flights ask for it.

    Lags that differ bend the response as a curve does: the form is compared with them in place.
    """
    rotors, flights = len(recording.rotors), int(recording.flight.max()) + 1
    general = Layout(
        form="offset power", voltage=False, two_way=False, rotors=rotors, flights=flights
    )
    rough = _fitted(recording, general, _first(general, recording))
    if _voltage_changes(recording):
        layout = replace(general, voltage=True)
        rough = _likeliest([rough, _refitted(recording, layout, rough, np.inf)])
    scale = 1.4826 * float(np.median(np.abs(rough.residuals)))
    return _two_way(recording, rough, scale)


def _two_way(recording: Recording, fit: LawFit, scale: float) -> LawFit:
    """Fit a lag for each way, where their difference exceeds its interval."""
    if fit.layout.two_way:
        return fit
    two_way = _refitted(recording, replace(fit.layout, two_way=True), fit, scale)
    ratio, half = float(two_way.values[-2]), two_way.half_width(lambda x: float(x[-2]))
    return two_way if abs(ratio) > half else fit


def _on_thrust(recording: Recording, fit: LawFit, scale: float) -> LawFit:
    """Fit the lag on the squared speed: it rises sooner than it falls, as two lags do."""
    layout = replace(fit.layout, on_thrust=True, two_way=False)
    return _two_way(recording, _refitted(recording, layout, fit, scale), scale)


def _whole(logged: Recording, made: Between, worse: float) -> bool:
    """Say whether a log has every command: held they fit clearly better than smooth ones."""
    return drawn_between(logged) is logged or (made is held_between and worse > CLEAR)


def _shift_by_noise(
    logged: Recording, made: Between, fit: LawFit, scale: float
) -> Float[np.ndarray, " p"]:
    """Measure how noise of the commands moves a fit: by the same noise once more.

    What is as strong at the top of their spectrum as below is either in the commands alone (their
    rounding; what a faster loop did between two of the log), or the motors follow it, too. (Cook
    and Stefanski, J. of the American Statistical Association 89, 1994.)
    """
    noise = _command_noise(logged)
    if not noise > 0.0:
        return np.zeros(len(fit.values))
    more = noise * np.random.default_rng(0).standard_normal(len(logged.command))
    noisier = (
        made(replace(logged, command=np.clip(logged.command + sign * more, 0.0, 1.0)))
        for sign in (1.0, -1.0)
    )
    found = [_fitted(one, fit.layout, fit.values, scale).values for one in noisier]
    return 0.5 * (found[0] + found[1]) - fit.values


def _slow_shift(recording: Recording, fit: LawFit) -> Float[np.ndarray, " p"]:
    """Compute by how much a fit moves that looks at what is slow alone.

    Between its commands a log does not say what a loop commanded; what is slow does not ask.
    """
    rows = round(1.0 / (SLOW * float(np.median(np.diff(recording.time)))))
    window = np.hanning(rows + 2)
    slopes = np.asarray(ndimage.convolve1d(fit.slopes, window, axis=0), dtype=float)
    residuals = np.asarray(ndimage.convolve1d(fit.residuals, window, axis=0), dtype=float)
    size: Float[np.ndarray, " p"] = np.linalg.norm(slopes, axis=0)
    size[size == 0.0] = 1.0
    scaled: Float[np.ndarray, "m p"] = slopes / size
    moved: Float[np.ndarray, " p"] = np.linalg.lstsq(scaled, residuals)[0] / size
    return moved


def _command_noise(logged: Recording) -> float:
    """Estimate the deviation of what is white in the commands, at the top of their spectrum."""
    edges = [*np.flatnonzero(logged.begins).tolist(), len(logged.command)]
    return white_noise_std(logged.command[:, None], list(pairwise(edges)))


def _turning(recording: Recording) -> Recording:
    """Drop the speeds of rotors that stand."""
    if not len(recording.speed):
        return recording
    used = recording.speed > STOPPED * float(np.median(recording.speed))
    return replace(
        recording,
        time=recording.time[used],
        speed=recording.speed[used],
        speed_rotor=recording.speed_rotor[used],
        speed_flight=recording.speed_flight[used],
        flight_time=recording.flight_time[used],
    )


def _refuse_short(recording: Recording) -> None:
    seconds = 0.0
    for k in np.unique(recording.speed_flight):
        seconds += float(np.ptp(recording.flight_time[recording.speed_flight == k]))
    if seconds < LEAST_SECONDS or len(recording.speed) < 20 * FEWEST_BLOCKS:
        raise EstimationError(
            f"only {seconds:.1f} s of measured speeds with commands, {LEAST_SECONDS:g} s are needed"
        )
    spread = float(recording.command.std())
    if not spread > LEAST_SPREAD or not float(recording.speed.std()) > 0.0:
        raise EstimationError(
            f"the commands hardly change (deviation {spread:.2g} of full): climb and sink"
        )


def _first(layout: Layout, recording: Recording) -> Float[np.ndarray, " p"]:
    """Choose where the first fit begins: at the times by which speeds correlate with commands."""
    x = np.zeros(layout.size)
    settled = recording.command + 0.1
    correlations = {
        (lag, delay): float(np.corrcoef(speed, recording.speed)[0, 1])
        for lag in FIRST_LAGS
        for delay, speed in zip(
            FIRST_DELAYS, speeds_at_delays(recording, settled, lag, FIRST_DELAYS), strict=True
        )
    }
    lag, delay = max(correlations, key=lambda times: correlations[times])
    x[0] = np.log(float(np.median(recording.speed)) / float(np.median(settled)))
    x[layout.curve] = FORMS[layout.form].start
    x[-2], x[-1] = np.log(lag), delay
    return x


def _refitted(recording: Recording, layout: Layout, fit: LawFit, scale: float) -> LawFit:
    """Fit another layout, begun where one ended; glitches count less."""
    x = np.zeros(layout.size)
    x[: layout.curve.stop] = _converted(layout.form, fit, recording.command)
    rotors = layout.rotors - 1
    x[layout.factors][:rotors] = fit.values[fit.layout.factors][:rotors]
    x[-2 - int(layout.two_way)], x[-1] = fit.timing.log_lag, fit.timing.delay
    if layout.two_way:
        x[-2] = fit.timing.log_ratio
    return _fitted(recording, layout, x, scale)


def _converted(
    form: FormName, fit: LawFit, command: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " p"]:
    """Convert a fit to log full speed and curve of another form, nearest at usual commands."""
    found = fit.values[: fit.layout.curve.stop]
    if form == fit.layout.form:
        return found
    one = FORMS[form]
    u = np.quantile(command, np.linspace(0.02, 0.98, 41))
    wanted = np.exp(FORMS[fit.layout.form].logarithm(u, found[1:])[0])
    bounds = [-np.inf, *one.lower], [np.inf, *one.upper]
    begin = np.array([0.0, *one.start])
    near = scipy.optimize.least_squares(
        lambda x: np.exp(x[0] + one.logarithm(u, x[1:])[0]) - wanted, begin, bounds=bounds
    )
    return np.array([found[0], *np.zeros(len(near.x) - 1)]) + near.x


def _fitted(
    recording: Recording,
    layout: Layout,
    begin: Float[np.ndarray, " p"],
    scale: float = np.inf,
) -> LawFit:
    """Fit one form; speeds further off than some of `scale` [rad/s] count less."""
    lower, upper = _bounds(layout)
    last: list[tuple[bytes, tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m p"]]]] = []

    def at(x: Float[np.ndarray, " p"]) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m p"]]:
        if not last or last[0][0] != x.tobytes():
            last[:] = [(x.tobytes(), predicted(recording, layout, x))]
        return last[0][1]

    robust = np.isfinite(scale) and scale > 0.0
    found = scipy.optimize.least_squares(
        lambda x: at(x)[0] - recording.speed,
        np.clip(begin, lower + 1e-6, upper - 1e-6),
        jac=lambda x: at(x)[1].copy(),  # some versions of SciPy weigh it in place
        bounds=(lower, upper),
        x_scale="jac",
        loss="huber" if robust else "linear",
        f_scale=OUTLYING * scale if robust else 1.0,
        xtol=1e-4,
        ftol=1e-5,
        gtol=1e-12,
        max_nfev=MOST_STEPS,
    )
    x = np.asarray(found.x, dtype=float)
    speed, slopes = at(x)
    residuals = recording.speed - speed
    limit = OUTLYING * scale if robust else np.inf
    root = np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(residuals), 1e-12)))
    return _judged(recording, layout, x, slopes * root[:, None], residuals * root, speed)


def _bounds(layout: Layout) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    form = FORMS[layout.form]
    lower, upper = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    lower[layout.curve], upper[layout.curve] = form.lower, form.upper
    lag = -2 - int(layout.two_way)
    lower[lag], upper[lag] = np.log(LAGS)
    lower[-1], upper[-1] = DELAYS
    if layout.two_way:
        lower[-2], upper[-2] = -RATIO, RATIO
    return lower, upper


def _judged(
    recording: Recording,
    layout: Layout,
    x: Float[np.ndarray, " p"],
    slopes: Float[np.ndarray, "m p"],
    residuals: Float[np.ndarray, " m"],
    speed: Float[np.ndarray, " m"],
) -> LawFit:
    """Complete the fit by its jackknives over blocks of time."""
    knives: list[Jackknife] = []
    held_out = np.full(1, np.inf)
    for seconds in BLOCKS:
        block = blocks_of(recording.speed_flight, recording.flight_time, seconds)
        sizes = np.bincount(block)
        if len(sizes) < FEWEST_BLOCKS:
            break
        knives.append(jackknife(slopes, residuals, block))
        if seconds <= CHOICE_BLOCK:
            held_out = knives[-1].held_out / sizes
    return LawFit(
        layout=layout,
        values=x,
        slopes=slopes,
        residuals=residuals,
        speed=speed,
        held_out=held_out,
        jackknives=tuple(knives),
    )


def _likeliest(fits: Sequence[LawFit]) -> LawFit:
    """Select the fit that does best on unseen blocks."""
    return min(fits, key=lambda fit: fit.error)


def _surprise(fit: LawFit, other: LawFit) -> float:
    """Compute the log-likelihood of one fit over another's, on unseen blocks.

    Each block counts as one observation: within it residuals are correlated.
    """
    return len(fit.held_out) * float(np.log(fit.error / other.error))
