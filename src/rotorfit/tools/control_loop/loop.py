"""Judge the loop that flew: margins with intervals, their proof, and what other gains would do.

The outcome of a loop as JSON.
"""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from threadpoolctl import threadpool_limits

from rotorfit.digits import finite_json
from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.controller_log import ControllerLog, knows_controller, read_with_controller
from rotorfit.results.result import IdentificationResult, owner_of
from rotorfit.tools.control_loop.controllers import AXES, RateController, rate_controller
from rotorfit.tools.control_loop.margins import Margins, fine_grid, last_crossover, margins
from rotorfit.tools.control_loop.measures import (
    LoopMeasures,
    StepResponse,
    bandwidth,
    closed_loop,
    measures_of,
    peak_below,
    step_harmonics,
    step_of,
)
from rotorfit.tools.control_loop.proof import (
    PROVED_AXES,
    UNKNOWN,
    Band,
    LoopError,
    MeasuredLoop,
    ReplayedMixer,
    ReplayedOutput,
    closed_loop_bands,
    contradictions,
    loop_error,
    measured_loop,
    notes_of,
    replay_mixer,
    replay_output,
    too_little,
)
from rotorfit.tools.control_loop.vehicle import (
    Flown,
    controller_response,
    flown,
    known_words,
    plant,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from jaxtyping import Bool, Complex, Float

    from rotorfit.fit.experiment.experiment import Experiment
    from rotorfit.logs.flight_log import FlightLog
    from rotorfit.tools.control_loop.plant import Plant, Response

    RateLoops = Callable[[Plant, Float[np.ndarray, " f"]], Complex[np.ndarray, "D f"]]
    """The open rate loops of vehicles at some frequencies."""

DRAWS: Final = 200
POINTS: Final = 500
LOWEST: Final = 0.01
"""Lowest of the frequencies [Hz]: below it only the integrators matter."""
NOTCH_PLACES: Final = (-1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 1.0)
"""Places about the middle of a notch at which its loop is computed, in widths of the notch."""
FACTORS: Final = (0.8, 1.0, 1.25, 1.5)
"""Factors of the rate gains in the table of what a gain would do."""
STEPS: Final = 6
"""Steps of finding how far the flown loop is from the predicted one."""
STEP: Final = (0.3, 5e-3)
"""The longest of them: logarithm of the effectiveness, and delay [s]."""


@frozen_dataclass
class AxisLoop:
    """The judged loop of one axis.

    Attributes
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    controller
        As flown.
    replay, mixer
        Of its output, and of the motors' commands by it; None if the log has no curve of them.
    contradicts
        Whether its closed loop contradicts the result.
    rate_loop, with_attitude
        Cut at the torque command: the rate loop alone, and with the attitude loop around it.
    bands, error
        Of the measured closed loop, and what they say of effectiveness and delay.
    doubts
        Why no margin of it is proved; empty if it is.
    derivative_share
        Size of what D adds to the output over that of P and I, at the crossover.
    gains
        Factor of P, I and D, and the peak of the sensitivity that 97.5 % of the vehicles stay
        below; infinite if more oscillate.
    step
        Of the rate loop alone.
    frequency, open_loop, closed_loop
        [Hz]; of each vehicle, the nominal one first: the open loop with its attitude loop, and the
        rate over the rate asked for.
    stable
        Which of these vehicles do not oscillate.
    """

    axis: str
    controller: RateController
    replay: ReplayedOutput
    mixer: ReplayedMixer | None
    contradicts: bool
    rate_loop: LoopMeasures
    with_attitude: LoopMeasures
    bands: tuple[Band, ...]
    error: LoopError
    doubts: tuple[str, ...]
    derivative_share: float
    gains: tuple[tuple[float, float], ...]
    step: StepResponse
    frequency: Float[np.ndarray, " f"]
    open_loop: Complex[np.ndarray, "D f"]
    closed_loop: Complex[np.ndarray, "D f"]
    stable: Bool[np.ndarray, " D"]

    @property
    def proved(self) -> tuple[float, float] | None:
        """The frequencies between which the log proves the closed loop [Hz]."""
        good = [band for band in self.bands if band.proved]
        return (good[0].low, good[-1].high) if good and not self.doubts else None


@frozen_dataclass
class LoopOutcome:
    """The rate loops of a flight, with notes about them.

    Attributes
    ----------
    name
        Of the result.
    configuration
        Which flew.
    autopilot, firmware
        Whose controller it is, and its version in the log's words.
    axes
        Roll, pitch and yaw.
    notes
        What they rest on.
    """

    name: str
    configuration: str
    autopilot: str
    firmware: str
    axes: tuple[AxisLoop, ...]
    notes: tuple[str, ...]


def loop_margins(
    result: IdentificationResult,
    log: Path,
    configuration: str | None = None,
    *,
    draws: int = DRAWS,
    seed: int = 0,
) -> LoopOutcome:
    """Judge how far the flown rate loops are from oscillating, with intervals.

    Parameters
    ----------
    result
        Of `identify`, from commands.
    log
        Of PX4 or ArduCopter; gains and filters [SI] are read from it.
    configuration
        Which flew; not needed if the result has only one.
    draws, seed
        Of vehicles that the flights leave open.

    Raises
    ------
    LogError
        If the log does not show the controller.
    EstimationError
        If the result does not know what the loop needs.
    OutputError
        If the result has no configuration of that name.
    """
    owner = owner_of(result, configuration)
    try:
        flight, controller = read_with_controller(log)
    except LogError as error:
        if knows_controller(log):
            raise
        raise LogError(f"{error}. {known_words(result, owner)}") from error
    with threadpool_limits(limits=1, user_api="blas"):
        return judge_flight(result, owner, flight, controller, draws=draws, seed=seed)


def first_flight_margins(result: IdentificationResult, experiment: Experiment) -> LoopOutcome:
    """Judge the first flight of an experiment's first configuration; see `loop_margins`."""
    first = experiment.configuration[0]
    return loop_margins(result, Path(first.flights[0].file), first.name)


def judge_flight(
    result: IdentificationResult,
    owner: str,
    log: FlightLog,
    controller: ControllerLog,
    *,
    read: Callable[[ControllerLog, int], RateController] = rate_controller,
    draws: int = DRAWS,
    seed: int = 0,
) -> LoopOutcome:
    """Judge the rate loops of a flight that was read already; see `loop_margins`.

    `read`: from the controller's log and an axis to its controller.
    """
    flight = flown(log, controller, result)
    axes: list[AxisLoop] = []
    for axis in range(len(AXES)):
        own = read(flight.log, axis)
        body = plant(result, owner, flight, axis=axis, period=own.period, draws=draws, seed=seed)
        axes.append(_judge_axis(body, own, log, flight, axis=axis, seed=seed))
    return LoopOutcome(
        name=result.name,
        configuration=owner,
        autopilot=controller.autopilot,
        firmware=controller.firmware,
        axes=_withhold_jointly(axes),
        notes=tuple(notes_of(flight, log)),
    )


def _withhold_jointly(axes: Sequence[AxisLoop]) -> tuple[AxisLoop, ...]:
    """Withhold the margins of an axis, too, where the other one contradicts the result."""
    out: list[AxisLoop] = []
    for i, one in enumerate(axes):
        others = [axes[k].axis for k in PROVED_AXES if k != i and axes[k].contradicts]
        # Both rest on one vehicle with one lag and delay: where that is another one, an axis with a
        # slow loop may agree by chance.
        if i in PROVED_AXES and others and not one.doubts:
            words = (
                f"{others[0]} contradicts the result, which is of one vehicle: its lag and delay "
                "may be wrong here, too, and agree by chance"
            )
            one = replace(one, doubts=(words,))
        out.append(one)
    return tuple(out)


def _judge_axis(
    body: Plant,
    controller: RateController,
    log: FlightLog,
    flight: Flown,
    *,
    axis: int,
    seed: int,
) -> AxisLoop:
    """Judge the loop of an axis: margins of vehicles that the flight does not contradict."""
    gyro_to_rate = controller_response(log, flight, controller, axis)
    loops = partial(_rate_loops, controller, gyro_to_rate)
    measured = measured_loop(controller, flight, axis)
    grid = loop_frequencies(controller)
    error = _closed_loop_error(
        body.nominal,
        loops,
        partial(_compare_bands, measured, controller),
        grid,
        flight.log.set_point_std,
    )
    replay, mixer = replay_output(controller, flight, axis), replay_mixer(flight, axis)
    wrong = axis in PROVED_AXES and error.is_wrong(body)
    doubts = contradictions(axis, replay, mixer, error if wrong else None, flight)
    vehicles = body if doubts else error.corrected(body, seed)
    frequency = fine_grid(grid, partial(_judged_loops, controller, loops, vehicles))
    inner = loops(vehicles, frequency)
    bands = _compare_bands(measured, controller, inner[0], frequency)
    found = margins(frequency, inner)
    closed = closed_loop(controller, inner, frequency)
    rate_loop = measures_of(found, bandwidth(frequency, closed))
    doubts = doubts or too_little(rate_loop.crossover.value, bands, error)
    outer = _with_attitude(inner, controller, frequency)
    return AxisLoop(
        axis=AXES[axis],
        controller=controller,
        replay=replay,
        mixer=mixer,
        contradicts=wrong and replay.is_right,
        rate_loop=rate_loop,
        with_attitude=measures_of(
            margins(frequency, outer), bandwidth(frequency, (outer - inner) / (1.0 + outer))
        ),
        bands=tuple(bands),
        error=error,
        doubts=tuple(doubts),
        derivative_share=controller.derivative_share(rate_loop.crossover.value),
        gains=_gain_peaks(controller, inner, frequency),
        step=_step_response(controller, loops, vehicles, found),
        frequency=frequency,
        open_loop=outer,
        closed_loop=closed,
        stable=found.stable,
    )


def loop_frequencies(controller: RateController) -> Float[np.ndarray, " f"]:
    """Choose frequencies at which to compute the loop of a controller, notches included [Hz]."""
    highest = 0.45 / controller.period
    notches = [
        one.frequency + np.array(NOTCH_PLACES) * one.width
        for one in controller.gyro_filters
        if one.order == 0
    ]
    grid = np.unique(np.concatenate([np.geomspace(LOWEST, highest, POINTS), *notches]))
    return grid[(grid >= LOWEST) & (grid <= highest)]


def _judged_loops(
    controller: RateController,
    loops: RateLoops,
    vehicles: Plant,
    frequency: Float[np.ndarray, " f"],
) -> Complex[np.ndarray, "L f"]:
    """Compute all open loops whose margins are judged: rate loops, and with the attitude loop."""
    inner = loops(vehicles, frequency)
    return np.concatenate([inner, *(one for _, one in _scaled_loops(controller, inner, frequency))])


def _scaled_loops(
    controller: RateController,
    inner: Complex[np.ndarray, "D f"],
    frequency: Float[np.ndarray, " f"],
) -> Iterator[tuple[float, Complex[np.ndarray, "D f"]]]:
    """Yield a factor of the rate gains, and the open loops with the attitude loop for it."""
    for factor in FACTORS:
        yield factor, _with_attitude(factor * inner, controller.scaled(factor), frequency)


def _step_response(
    controller: RateController, loops: RateLoops, vehicles: Plant, found: Margins
) -> StepResponse:
    """Compute the response of the rate loop alone to a step of the rate reference."""
    harmonics = step_harmonics(controller.period)
    closed = closed_loop(controller, loops(vehicles, harmonics), harmonics)
    return step_of(harmonics, closed, found.stable)


def _gain_peaks(
    controller: RateController,
    inner: Complex[np.ndarray, "D f"],
    frequency: Float[np.ndarray, " f"],
) -> tuple[tuple[float, float], ...]:
    """Compute the peak of the sensitivity that other rate gains would have, by their factor."""
    return tuple(
        (factor, peak_below(margins(frequency, outer)))
        for factor, outer in _scaled_loops(controller, inner, frequency)
    )


def _rate_loops(
    controller: RateController,
    gyro_to_rate: Callable[[Float[np.ndarray, " f"]], Response],
    vehicles: Plant,
    frequency: Float[np.ndarray, " f"],
) -> Complex[np.ndarray, "D f"]:
    """Compute the open rate loops, cut at the torque command."""
    response = vehicles.response(frequency, controller.period)
    return controller.from_rate(frequency) * gyro_to_rate(frequency) * response


def _with_attitude(
    inner: Complex[np.ndarray, "D f"],
    controller: RateController,
    frequency: Float[np.ndarray, " f"],
) -> Complex[np.ndarray, "D f"]:
    """Compute the open loops with the attitude loop; the feed-forward is in it, and not scaled."""
    return inner * (1.0 + controller.from_angle(frequency) / controller.from_rate(frequency))


def _compare_bands(
    measured: MeasuredLoop,
    controller: RateController,
    loop: Complex[np.ndarray, " f"],
    frequency: Float[np.ndarray, " f"],
) -> list[Band]:
    """Compare the measured closed loop with that of an open rate loop."""
    by_output = loop / (1.0 + loop) / controller.from_rate(frequency)
    closed = closed_loop(controller, loop, frequency)
    return closed_loop_bands(measured, frequency, closed, loop, by_output)


def _closed_loop_error(
    nominal: Plant,
    loops: RateLoops,
    bands_of: Callable[[Complex[np.ndarray, " f"], Float[np.ndarray, " f"]], list[Band]],
    frequency: Float[np.ndarray, " f"],
    stamp_std: float,
) -> LoopError:
    """Find how far the flown loop is from that of the nominal vehicle, step by step."""
    error = LoopError(gain=1.0, delay=0.0, covariance=UNKNOWN)
    for _ in range(STEPS):
        late = np.array([error.delay])
        inner = loops(nominal.moved(np.log([error.gain]), late), frequency)[0]
        crossover = last_crossover(frequency, inner)
        step = loop_error(bands_of(inner, frequency), crossover, stamp_std)
        error = step.within(STEP).after(error)
    return error


def loop_to_json(outcome: LoopOutcome) -> str:
    """Return the outcome as JSON text; null if there is no number."""
    plain = {
        "name": outcome.name,
        "configuration": outcome.configuration,
        "autopilot": outcome.autopilot,
        "firmware": outcome.firmware,
        "notes": list(outcome.notes),
        "axes": [_plain_axis(loop) for loop in outcome.axes],
    }
    return json.dumps(finite_json(plain), indent=1, allow_nan=False) + "\n"


def _plain_axis(loop: AxisLoop) -> dict[str, Any]:
    gain, late = loop.error.half_widths
    return {
        "axis": loop.axis,
        "controller": asdict(loop.controller),
        "replay": asdict(loop.replay),
        "mixer": None if loop.mixer is None else asdict(loop.mixer),
        "rate_loop": asdict(loop.rate_loop),
        "with_attitude": asdict(loop.with_attitude),
        "bands": [
            {
                "low": band.low,
                "high": band.high,
                "ratio": band.ratio,
                "degrees": band.degrees,
                "uncertainty": band.uncertainty,
                "proved": band.proved,
            }
            for band in loop.bands
        ],
        "effectiveness": {"value": loop.error.gain, "half_width": gain},
        "later": {"value": loop.error.delay, "half_width": late},
        "proved": None if loop.proved is None else list(loop.proved),
        "doubts": list(loop.doubts),
        "derivative_share": loop.derivative_share,
        "gains": [{"factor": factor, "sensitivity": peak} for factor, peak in loop.gains],
        "step": {name: values.tolist() for name, values in asdict(loop.step).items()},
    }
