"""One form of the motors' law, fitted to commands and measured speeds.

A fit searches on few speeds and coarse commands, and ends on all of them. Its blocks of time are
summed once: jackknives of all lengths come from the sums.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.motor_law.block_jackknife import (
    FEWEST_BLOCKS,
    BlockSums,
    Jackknife,
    blocks_of,
    jackknife,
    sum_blocks,
    widest,
)
from rotorfit.fit.motor_law.command_response import (
    Recording,
    Timing,
    merged_commands,
    selected_speeds,
    speeds_at_delays,
)
from rotorfit.fit.motor_law.huber_fit import CLOSE, HuberFit, fit_huber
from rotorfit.fit.motor_law.law_model import FORMS, FormName, Layout, predicted, timing_of
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Callable

    from jaxtyping import Float, Int

    from rotorfit.fit.motor_law.huber_fit import Bounds, Prediction

BLOCKS: Final = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Lengths of blocks that are tried; the widest intervals count [s]."""
CHOICE_BLOCK: Final = 1.0
"""Length of the blocks that forms are compared on [s]."""
OUTLYING: Final = 4.0
"""Robust deviations beyond which a speed counts less (Huber)."""
SEARCH_STEP: Final = 16e-3
"""Shortest time between the commands of a search [s]: it moves a lag of 20 ms by a deviation or
two, which is then known from the first fit to all speeds."""
SEARCH_EVERY: Final = 4
SEARCH_SPEEDS: Final = 4_000
"""One speed of so many is in a search, but no fewer speeds than this in all."""
SETTLED: Final = 0.2
"""Standard deviations: a shorter step is the last one of the form that was chosen."""
FIRST_LAGS: Final = (0.008, 0.015, 0.03, 0.06, 0.12)
FIRST_DELAYS: Final = (-0.02, 0.0, 0.02, 0.05, 0.1, 0.2)
"""Where the search begins [s]: lag and delay together, as noise in the commands makes a minimum of
its own where only their sum is right."""
LAGS: Final = (5e-4, 0.5)
DELAYS: Final = (-0.1, 0.3)
RATIO: Final = 2.0
"""Largest logarithm of falling over rising lag."""


@frozen_dataclass
class PreparedRecording:
    """A recording as forms are fitted to it.

    - `fine`: all speeds and commands.
    - `coarse`: few speeds and coarse commands, for the search.
    - `stride`: one speed of so many is in `coarse`.
    - `block`: of each speed, in blocks of the shortest length.
    - `joined`: of each such block, in blocks of each longer length.
    """

    fine: Recording
    coarse: Recording
    stride: int
    block: Int[np.ndarray, " m"]
    joined: tuple[Int[np.ndarray, " B"], ...]


def prepare_recording(recording: Recording) -> PreparedRecording:
    """Thin a recording for the search, and assign its speeds to blocks."""
    stride = max(min(len(recording.speed) // SEARCH_SPEEDS, SEARCH_EVERY), 1)
    numbers = [blocks_of(recording.speed_flight, recording.flight_time, s) for s in BLOCKS]
    first = np.unique(numbers[0], return_index=True)[1]
    enough = [number[first] for number in numbers if int(number.max()) + 1 >= FEWEST_BLOCKS]
    return PreparedRecording(
        fine=recording,
        coarse=_thin_recording(recording, stride),
        stride=stride,
        block=numbers[0],
        joined=tuple(enough),
    )


def with_commands(prepared: PreparedRecording, recording: Recording) -> PreparedRecording:
    """Prepare a recording of the same speeds and other commands."""
    return replace(prepared, fine=recording, coarse=_thin_recording(recording, prepared.stride))


def _thin_recording(recording: Recording, stride: int) -> Recording:
    """Keep few speeds, and the means of neighbouring commands."""
    return merged_commands(selected_speeds(recording, slice(None, None, stride)), SEARCH_STEP)


@dataclass(frozen=True, kw_only=True)
class FormFit:
    """One form, fitted.

    - `searched`: values where the search ended, on few speeds and coarse commands.
    - `search_loss`: mean loss there [rad^2/s^2].
    - `slopes`, `residuals`: of the prediction, and measured less predicted, weighted [rad/s].
    - `speed`: predicted [rad/s].
    - `sums`: over blocks, for each length of which there are enough.
    """

    layout: Layout
    values: Float[np.ndarray, " p"]
    searched: Float[np.ndarray, " p"]
    search_loss: float
    slopes: Float[np.ndarray, "p m"]
    residuals: Float[np.ndarray, " m"]
    speed: Float[np.ndarray, " m"]
    sums: tuple[BlockSums, ...]

    @property
    def timing(self) -> Timing:
        """Lag and delay."""
        return timing_of(self.layout, self.values)

    @cached_property
    def jackknives(self) -> tuple[Jackknife, ...]:
        """What leaving out a block does, for each length of blocks."""
        return tuple(jackknife(sums) for sums in self.sums)

    @cached_property
    def held_out(self) -> Float[np.ndarray, " B"]:
        """Squared error of each block under the fit to the others, over its rows [rad^2/s^2]."""
        chosen = self.sums[: sum(seconds <= CHOICE_BLOCK for seconds in BLOCKS)]
        if not chosen:
            return np.full(1, np.inf)
        seen = chosen[-1].counts > 0
        return jackknife(chosen[-1]).held_out[seen] / chosen[-1].counts[seen]

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


def choose_start(layout: Layout, prepared: PreparedRecording) -> Float[np.ndarray, " p"]:
    """Choose where the first fit begins: at the times by which speeds correlate with commands."""
    recording = prepared.coarse
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


def search_first(prepared: PreparedRecording, layout: Layout) -> FormFit:
    """Search from where nothing is known of the law; every speed counts the same."""
    return _search_layout(prepared, layout, choose_start(layout, prepared), np.inf)


def search_form(prepared: PreparedRecording, layout: Layout, fit: FormFit, scale: float) -> FormFit:
    """Search from where another fit ended; speeds beyond some of `scale` [rad/s] count less."""
    command = prepared.coarse.command
    begin = _convert_values(fit.layout, fit.searched, layout, command)
    # All speeds will shift the values that the search finds about as they shifted those of that
    # fit.
    shift = _convert_values(fit.layout, fit.values, layout, command) - begin
    found = _search_layout(prepared, layout, begin, scale)
    return replace(found, values=np.clip(found.values + shift, *parameter_bounds(layout)))


def _search_layout(
    prepared: PreparedRecording, layout: Layout, begin: Float[np.ndarray, " p"], scale: float
) -> FormFit:
    """Fit a layout to few speeds."""
    found = _minimize_huber(prepared, layout, begin, scale, is_search=True)
    block = prepared.block[:: prepared.stride]
    return FormFit(
        layout=layout,
        values=found.values,
        searched=found.values,
        search_loss=found.loss,
        slopes=found.slopes,
        residuals=found.residuals,
        speed=found.predicted,
        sums=_sum_all_blocks(prepared, block, found.slopes, found.residuals),
    )


def finish_form(
    prepared: PreparedRecording, fit: FormFit, scale: float = np.inf, *, close: float = CLOSE
) -> FormFit:
    """Fit to all speeds, from where a search, or the fit of a recording much alike, ended."""
    found = _minimize_huber(prepared, fit.layout, fit.values, scale, close=close)
    return replace(
        fit,
        values=found.values,
        slopes=found.slopes,
        residuals=found.residuals,
        speed=found.predicted,
        sums=_sum_all_blocks(prepared, prepared.block, found.slopes, found.residuals),
    )


def _minimize_huber(
    prepared: PreparedRecording,
    layout: Layout,
    begin: Float[np.ndarray, " p"],
    scale: float = np.inf,
    *,
    is_search: bool = False,
    close: float = CLOSE,
) -> HuberFit:
    """Fit to few speeds or to all."""
    recording, block = prepared.fine, prepared.block
    if is_search:
        recording, block = prepared.coarse, block[:: prepared.stride]
    return fit_huber(
        lambda x: predicted(recording, layout, x),
        recording.speed,
        begin,
        bounds=parameter_bounds(layout),
        block=block,
        limit=OUTLYING * scale if scale > 0.0 else np.inf,
        close=close,
    )


def _convert_values(
    fitted: Layout,
    values: Float[np.ndarray, " p"],
    layout: Layout,
    command: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " q"]:
    """Convert the values of one layout to those of another, as near as it has them."""
    x = np.zeros(layout.size)
    x[: layout.curve.stop] = _convert_curve(fitted, values, layout.form, command)
    own, theirs = x[layout.factors.start : layout.drifts.stop], fitted.factors.start
    shared = len(own) if layout.voltage == fitted.voltage else layout.rotors - 1
    own[:shared] = values[theirs : theirs + shared]
    if layout.voltage and fitted.voltage:
        x[layout.exponent] = values[fitted.exponent]
    timing = timing_of(fitted, values)
    x[-2 - int(layout.two_way)], x[-1] = timing.log_lag, timing.delay
    if layout.two_way:
        x[-2] = timing.log_ratio
    return x


def _convert_curve(
    fitted: Layout,
    values: Float[np.ndarray, " p"],
    form: FormName,
    command: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " q"]:
    """Convert log full speed and curve to another form, nearest at usual commands."""
    found = values[: fitted.curve.stop]
    if form == fitted.form:
        return found
    one = FORMS[form]
    u = np.quantile(command, np.linspace(0.02, 0.98, 41))
    wanted = np.exp(FORMS[fitted.form].logarithm(u, found[1:])[0])

    def predict(x: Float[np.ndarray, " p"]) -> Prediction:
        logarithm, slopes = one.logarithm(u, x[1:])
        speed = np.exp(np.minimum(x[0] + logarithm, 30.0))
        return speed, speed * np.vstack([np.ones(len(u)), slopes])

    bounds = np.array([-np.inf, *one.lower]), np.array([np.inf, *one.upper])
    begin = np.array([0.0, *one.start])
    near = fit_huber(predict, wanted, begin, bounds=bounds, block=np.arange(len(u))).values
    return np.array([found[0], *np.zeros(len(near) - 1)]) + near


def parameter_bounds(layout: Layout) -> Bounds:
    """Return the lowest and highest values of a layout's parameters, as motors have them."""
    form = FORMS[layout.form]
    lower, upper = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    lower[layout.curve], upper[layout.curve] = form.lower, form.upper
    lag = -2 - int(layout.two_way)
    lower[lag], upper[lag] = np.log(LAGS)
    lower[-1], upper[-1] = DELAYS
    if layout.two_way:
        lower[-2], upper[-2] = -RATIO, RATIO
    return lower, upper


def _sum_all_blocks(
    prepared: PreparedRecording,
    block: Int[np.ndarray, " m"],
    slopes: Float[np.ndarray, "p m"],
    residuals: Float[np.ndarray, " m"],
) -> tuple[BlockSums, ...]:
    """Sum over blocks of each length of which there are enough."""
    if not prepared.joined:
        return ()
    shortest = sum_blocks(slopes, residuals, block, count=len(prepared.joined[0]))
    return tuple(shortest.joined(block) for block in prepared.joined)
