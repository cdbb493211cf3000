"""Lag, delay and law of the motors, from commands and the speeds that were measured beside them.

Every form of the law is fitted by least squares of the measured speeds over lag, delay and the
law's own parameters together (output error: noise of the speeds, which are the only noisy channel,
pulls nothing), with a factor for each rotor. The form is chosen by its error on blocks of time that
it was not fitted to. Intervals are those of a jackknife over blocks (`block_jackknife`): residuals
are correlated by battery, air and what no law says.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.fit.motor_law.block_jackknife import FEWEST_BLOCKS
from rotorfit.fit.motor_law.command_response import (
    Recording,
    drawn_between,
    recording_of,
    selected_speeds,
)
from rotorfit.fit.motor_law.form_fit import (
    SETTLED,
    FormFit,
    PreparedRecording,
    finish_form,
    parameter_bounds,
    prepare_recording,
    search_first,
    search_form,
    with_commands,
)
from rotorfit.fit.motor_law.law_model import FORMS, Layout, law_of
from rotorfit.flight.filters import correlate
from rotorfit.flight.motors.command_response import (
    MeasuredResponse,
    response_spans,
    responses_within,
)
from rotorfit.flight.motors.motor_model import white_noise_std
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from jaxtyping import Float

    from rotorfit.logs.motor_law import MotorLaw

MOST_SPEEDS: Final = 80_000
"""Measured speeds that are fitted to, of all rotors and flights."""
LEAST_SECONDS: Final = 4.0
"""Of measured speeds in flight, below which no law is fitted."""
LEAST_SPREAD: Final = 0.01
"""Deviation of the commands below which they tell no law."""
CLEAR: Final = 3.0
"""Log-likelihood by which another form must be worse, else the intervals reach to what it says."""
FAR: Final = 2.0 * CLEAR
"""Log-likelihood by which a form must be worse on few speeds not to be fitted to all."""
LEAST_VOLTS: Final = 0.005
"""Relative deviation of the battery voltage below which it tells nothing."""
STOPPED: Final = 0.1
"""Share of the median speed below which a rotor stands."""
SLOW: Final = 12.0
"""Twice about the frequency that is slow, and tells most of a lag of 30 ms [Hz]."""
Between = Callable[[Recording], Recording]
"""What commands were between those of the log."""


def held_between(recording: Recording) -> Recording:
    """Hold every command until the next."""
    return recording


@frozen_dataclass
class LawFromSpeeds:
    """The law of the motors, and what else it might be.

    - `best`: the form that was chosen.
    - `others`: the other forms, with the same terms beside the curve.
    - `rivals`: those that are as good, in practice or as far as the flights tell: other forms; the
      lag on the other of speed and thrust; commands held, or smooth between those of the log.
    - `open_shifts`: half of the shift by noise and quick motion: taken off, and as much is open.
    - `voltage`: the form with an exponent of the battery's voltage; None if that tells nothing.
    """

    recording: Recording
    best: FormFit
    others: tuple[FormFit, ...]
    rivals: tuple[FormFit, ...]
    open_shifts: Float[np.ndarray, "s p"]
    voltage: FormFit | None = None

    @property
    def law(self) -> MotorLaw:
        """The law of the mean rotor, by the chosen form."""
        return law_of(self.recording, self.best.layout, self.best.values)

    def number(
        self, function: Callable[[FormFit, Float[np.ndarray, " p"]], float]
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
    """Join the responses of all flights, not too many; None if none has both signals."""
    flights = [one for one in responses if one]
    # So many that the fit takes seconds, however many flights there are.
    most = MOST_SPEEDS // max(len(flights), 1)
    return recording_of([responses_within(one, response_spans(one), most=most) for one in flights])


def fit_law(recording: Recording) -> LawFromSpeeds:
    """Fit lag, delay and law of the motors; raise an error with the reason if this fails."""
    logged = _drop_standing_rotors(recording)
    _refuse_short(logged)
    smooth = drawn_between(logged)
    held = prepare_recording(logged)
    drawn = with_commands(held, smooth)
    rough = _fit_roughly(held)
    scale = _robust_deviation(rough)
    stepped = _refit_layout(held, rough.layout, rough, scale)  # as robust as the other
    curved = _refit_layout(drawn, rough.layout, stepped, scale)
    is_smooth = curved.error < stepped.error
    prepared, other = (drawn, held) if is_smooth else (held, drawn)
    fits = _fit_forms(prepared, curved if is_smooth else stepped, scale)
    best = _two_way(prepared, _select_likeliest(fits), scale)
    on_thrust = _on_thrust(prepared, best, scale)
    if _log_likelihood_gain(best, on_thrust) > CLEAR:
        best, on_thrust = on_thrust, best
    best = finish_form(prepared, best, scale, close=SETTLED)
    others = tuple(fit for fit in fits if fit.layout.form != best.layout.form)
    across = _refit_layout(other, best.layout, best, scale)
    open_shifts = np.zeros((2, len(best.values)))
    # A log has every command where these fit clearly better held than drawn smoothly.
    is_whole = smooth is logged or (not is_smooth and _log_likelihood_gain(across, best) > CLEAR)
    if not is_whole:
        made = drawn_between if is_smooth else held_between
        by_noise = _shift_by_noise(prepared, logged, made, best, scale)
        open_shifts = 0.5 * np.array([by_noise, -_slow_shift(logged, best)])
        _refuse_open(best, open_shifts)
    return LawFromSpeeds(
        recording=smooth if is_smooth else logged,
        best=replace(best, values=best.values - open_shifts.sum(axis=0)),
        others=others,
        rivals=tuple(
            f for f in (*others, on_thrust, across) if _log_likelihood_gain(f, best) < CLEAR
        ),
        open_shifts=open_shifts,
        voltage=_with_voltage(prepared, best, scale),
    )


def _fit_forms(prepared: PreparedRecording, begin: FormFit, scale: float) -> list[FormFit]:
    """Fit every form with the same terms beside the curve; those that are far, to few speeds."""
    fits: list[FormFit] = []
    for name in FORMS:
        fit = begin
        if name != begin.layout.form:
            fit = search_form(prepared, replace(begin.layout, form=name), begin, scale)
            fit = fit if _is_far(fit, begin) else finish_form(prepared, fit, scale)
        fits.append(fit)
    return fits


def _with_voltage(prepared: PreparedRecording, best: FormFit, scale: float) -> FormFit | None:
    """Return the form with an exponent of the voltage; None if that hardly changes."""
    if best.layout.voltage or not _voltage_changes(prepared.fine):
        return best if best.layout.voltage else None
    return _refit_layout(prepared, replace(best.layout, voltage=True), best, scale)


def _refit_layout(
    prepared: PreparedRecording, layout: Layout, fit: FormFit, scale: float
) -> FormFit:
    return finish_form(prepared, search_form(prepared, layout, fit, scale), scale)


def _voltage_changes(recording: Recording) -> bool:
    return recording.voltage is not None and float(recording.voltage.std()) > LEAST_VOLTS


def _fit_roughly(prepared: PreparedRecording) -> FormFit:
    """Fit the most general form, with voltage and a lag for each way if the flights ask for it."""
    recording = prepared.fine
    rotors, flights = len(recording.rotors), int(recording.flight.max()) + 1
    general = Layout(
        form="offset power", voltage=False, two_way=False, rotors=rotors, flights=flights
    )
    rough = finish_form(prepared, search_first(prepared, general))
    scale = _robust_deviation(rough)
    if _voltage_changes(recording):
        layouts = general, replace(general, voltage=True)
        rough = _select_likeliest(
            [_refit_layout(prepared, layout, rough, scale) for layout in layouts]
        )
    # Lags that differ bend the response as a curve does: the form is compared with them in place.
    return _two_way(prepared, rough, scale)


def _robust_deviation(fit: FormFit) -> float:
    """Estimate the deviation of the residuals by their median size [rad/s]."""
    # The median size of normal errors is their deviation over 1.4826; outliers hardly move it.
    return 1.4826 * float(np.median(np.abs(fit.residuals)))


def _two_way(prepared: PreparedRecording, fit: FormFit, scale: float) -> FormFit:
    """Fit a lag for each way, where their difference exceeds its interval."""
    if fit.layout.two_way:
        return fit
    two_way = _refit_layout(prepared, replace(fit.layout, two_way=True), fit, scale)
    ratio, half = float(two_way.values[-2]), two_way.half_width(lambda x: float(x[-2]))
    return two_way if abs(ratio) > half else fit


def _on_thrust(prepared: PreparedRecording, best: FormFit, scale: float) -> FormFit:
    """Fit the lag on the squared speed: it rises sooner than it falls, as two lags do."""
    layout = replace(best.layout, on_thrust=True, two_way=False)
    one_way = search_form(prepared, layout, best, scale)
    either = search_form(prepared, replace(layout, two_way=True), one_way, scale)
    if _is_far(either, best):  # it bends further than the other, and is not as good
        return either
    if not _is_far(one_way, best):
        one_way = finish_form(prepared, one_way, scale)
    return _two_way(prepared, one_way, scale)


def _is_far(fit: FormFit, best: FormFit) -> bool:
    """Return whether a search ended so much worse than another that all speeds cannot mend it."""
    worse = 0.5 * np.log(fit.search_loss / best.search_loss)
    return len(best.held_out) * float(worse) > FAR


def _shift_by_noise(
    prepared: PreparedRecording, logged: Recording, made: Between, fit: FormFit, scale: float
) -> Float[np.ndarray, " p"]:
    """Measure how noise of the commands moves a fit: by the same noise once more."""
    noise = _command_noise(logged)
    if not noise > 0.0:
        return np.zeros(len(fit.values))
    # What is as strong at the top of their spectrum as below is either in the commands alone (their
    # rounding; what a faster loop did between two of the log), or the motors follow it, too.
    # Cook and Stefanski, J. of the American Statistical Association 89, 1994.
    more = noise * np.random.default_rng(0).standard_normal(len(logged.command))
    moved = [fit.values]
    for sign in (1.0, -1.0):
        noisier = made(replace(logged, command=np.clip(logged.command + sign * more, 0.0, 1.0)))
        begin = replace(fit, values=moved[-1])  # either noise moves a fit the same way
        one = finish_form(with_commands(prepared, noisier), begin, scale, close=SETTLED)
        moved.append(one.values)
    return 0.5 * (moved[1] + moved[2]) - fit.values


def _slow_shift(recording: Recording, fit: FormFit) -> Float[np.ndarray, " p"]:
    """Compute by how much a fit moves that looks at what is slow alone."""
    # Between its commands a log does not say what a loop commanded; what is slow does not ask.
    rows = round(1.0 / (SLOW * float(np.median(np.diff(recording.time)))))
    window = np.hanning(rows + 2)
    slopes = np.array([_moving_sums(row, window) for row in fit.slopes])
    residuals = _moving_sums(fit.residuals, window)
    size: Float[np.ndarray, " p"] = np.linalg.norm(slopes, axis=1)
    size[size == 0.0] = 1.0
    scaled: Float[np.ndarray, "m p"] = slopes.T / size
    moved: Float[np.ndarray, " p"] = np.linalg.lstsq(scaled, residuals)[0] / size
    return moved


def _moving_sums(
    values: Float[np.ndarray, " n"], window: Float[np.ndarray, " w"]
) -> Float[np.ndarray, " n"]:
    """Weight the values around each by a window; beyond the ends stands their mirror image."""
    before = (len(window) - 1) // 2
    wide = np.pad(values, (before, len(window) - 1 - before), mode="symmetric")
    return correlate(wide, window)[len(window) - 1 :][: len(values)]


def _refuse_open(fit: FormFit, shifts: Float[np.ndarray, "s p"]) -> None:
    """Raise an error where what a log leaves open moves a law by more than motors differ."""
    lower, upper = parameter_bounds(fit.layout)
    if (np.abs(shifts).sum(axis=0) > upper - lower).any():
        raise EstimationError(
            "the measured speeds do not follow the commands along one curve, as motors do: look "
            "at both in the log, and check the ESC telemetry"
        )


def _command_noise(logged: Recording) -> float:
    """Estimate the deviation of what is white in the commands, at the top of their spectrum."""
    edges = [*np.flatnonzero(logged.begins).tolist(), len(logged.command)]
    return white_noise_std(logged.command[:, None], list(pairwise(edges)))


def _drop_standing_rotors(recording: Recording) -> Recording:
    if not len(recording.speed):
        return recording
    used = recording.speed > STOPPED * float(np.median(recording.speed))
    return selected_speeds(recording, used)


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


def _select_likeliest(fits: Sequence[FormFit]) -> FormFit:
    """Select the fit that does best on unseen blocks."""
    return min(fits, key=lambda fit: fit.error)


def _log_likelihood_gain(fit: FormFit, other: FormFit) -> float:
    """Compute the log-likelihood of one fit over another's, on unseen blocks."""
    # Each block counts as one observation: within it residuals are correlated.
    return len(fit.held_out) * float(np.log(fit.error / other.error))
