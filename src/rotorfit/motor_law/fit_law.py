"""Lag, delay and law of the motors, from commands and the speeds that were measured beside them.

Every form of the law is fitted by least squares of the measured speeds over lag, delay and the
law's own parameters together (output error: noise of the speeds, which are the only noisy channel,
pulls nothing), with a factor for each rotor. The form is chosen by its error on blocks of time that
it was not fitted to. Intervals are those of a jackknife over blocks (`block_jackknife`): residuals
are correlated by battery, air and what no law says.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np
import scipy.optimize
from jaxtyping import Float

from rotorfit.errors import EstimationError
from rotorfit.motor_law.block_jackknife import (
    FEWEST_BLOCKS,
    Jackknife,
    blocks_of,
    jackknife,
    widest,
)
from rotorfit.motor_law.command_response import Recording, Timing, recording_of, speed_response
from rotorfit.motor_law.law_model import FORMS, FormName, Layout, predicted, timing_of
from rotorfit.preprocessing.motors.command_response import (
    MeasuredResponse,
    response_spans,
    responses_within,
)

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
MOST_STEPS: Final = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class LawFit:
    """One form, fitted.

    Attributes
    ----------
    layout
        Of the parameters.
    values
        The parameters.
    slopes, residuals
        Of the prediction, and measured less predicted, weighted [rad/s].
    speed
        Predicted [rad/s].
    held_out
        Squared error of each block under the fit to the others, over its rows [rad^2/s^2].
    jackknives
        Of all lengths of blocks that are many enough.
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

    Attributes
    ----------
    recording
        What it was fitted to.
    best
        The form that was chosen.
    others
        The other forms, with the same terms beside the curve.
    rivals
        Those of them that are as good, in practice or as far as the flights tell.
    """

    recording: Recording
    best: LawFit
    others: tuple[LawFit, ...]
    rivals: tuple[LawFit, ...]

    def number(
        self, function: Callable[["LawFit", Float[np.ndarray, " p"]], float]
    ) -> tuple[float, float]:
        """Evaluate a number of the law, and half of an interval that holds every rival form's."""
        value = function(self.best, self.best.values)
        reach = self.best.half_width(lambda x: function(self.best, x))
        for rival in self.rivals:
            reach = max(reach, abs(function(rival, rival.values) - value))
        return value, reach

    def own(self, index: int) -> tuple[float, float]:
        """Return a parameter of the chosen form, and half of its interval."""
        return float(self.best.values[index]), self.best.half_width(lambda x: float(x[index]))


def bounded_recording(responses: Sequence[Sequence[MeasuredResponse]]) -> Recording | None:
    """Join the responses of all flights, not too many; None where none has both signals."""
    flights = [one for one in responses if one]
    # So many that the fit takes seconds, however many flights there are.
    most = MOST_SPEEDS // max(len(flights), 1)
    return recording_of([responses_within(one, response_spans(one), most=most) for one in flights])


def fit_law(recording: Recording) -> FittedLaw:
    """Fit lag, delay and law of the motors; raise with the reason where speeds determine none."""
    recording = _turning(recording)
    _refuse_short(recording)
    rotors, flights = len(recording.rotors), int(recording.flight.max()) + 1
    general = Layout(
        form="offset power", voltage=False, two_way=False, rotors=rotors, flights=flights
    )
    rough = _fitted(recording, general, _first(general, recording))
    if recording.voltage is not None and float(recording.voltage.std()) > LEAST_VOLTS:
        layout = replace(general, voltage=True)
        rough = _likeliest([rough, _refitted(recording, layout, rough, np.inf)])
    scale = 1.4826 * float(np.median(np.abs(rough.residuals)))
    fits = [_refitted(recording, replace(rough.layout, form=name), rough, scale) for name in FORMS]
    best = _likeliest(fits)
    others = tuple(fit for fit in fits if fit is not best)
    two_way = _refitted(recording, replace(best.layout, two_way=True), best, scale)
    ratio, half = float(two_way.values[-2]), two_way.half_width(lambda x: float(x[-2]))
    return FittedLaw(
        recording=recording,
        best=two_way if abs(ratio) > half else best,
        others=others,
        rivals=tuple(f for f in others if _surprise(f, best) < CLEAR),
    )


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
    settled, none = recording.command + 0.1, np.zeros((len(recording.command), 0))

    def correlation(times: tuple[float, float]) -> float:
        timing = Timing(log_lag=np.log(times[0]), log_ratio=0.0, delay=times[1])
        speed, _ = speed_response(recording, settled, none, timing)
        return float(np.corrcoef(speed, recording.speed)[0, 1])

    lag, delay = max(product(FIRST_LAGS, FIRST_DELAYS), key=correlation)
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
        xtol=1e-6,
        ftol=1e-7,
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
