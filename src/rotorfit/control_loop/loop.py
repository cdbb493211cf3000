"""Judge the loop that flew: margins with intervals, their proof, and what other gains would do."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Complex, Float
from threadpoolctl import threadpool_limits

from rotorfit.control_loop.controllers import AXES, moving_filters, rate_controller
from rotorfit.control_loop.margins import Margins, margins
from rotorfit.control_loop.plant import Plant
from rotorfit.control_loop.proof import (
    UNKNOWN,
    Band,
    LoopError,
    MeasuredLoop,
    ReplayedMixer,
    ReplayedOutput,
    closed_loop_bands,
    loop_error,
    measured_loop,
    replay_mixer,
    replay_output,
)
from rotorfit.control_loop.rate_controller import RateController
from rotorfit.control_loop.vehicle import Flown, controller_response, flown, known_words, plant
from rotorfit.errors import LogError
from rotorfit.experiment.experiment import Experiment
from rotorfit.logs.controller_log import ControllerLog, knows_controller, read_with_controller
from rotorfit.logs.flight_log import FlightLog
from rotorfit.results.result import IdentificationResult, owner_of

DRAWS: Final = 200
POINTS: Final = 400
LOWEST: Final = 0.1
"""Of the frequencies [Hz]."""
FACTORS: Final = (0.8, 1.0, 1.25, 1.5)
"""Of the rate gains in the table of what a gain would do."""
NEAR: Final = 2.0
"""Factor about the crossover in which the closed loop must be proved."""
STEPS: Final = 6
"""Of finding how far the flown loop is from the predicted one."""
STEP: Final = (0.3, 5e-3)
"""The longest of them: logarithm of the effectiveness, and delay [s]."""
LIMITED: Final = 0.02
"""Share of a flight with a motor at its limit, from which it is said."""
PROVED_AXES: Final = (0, 1)
"""Yaw's closed loop is not predicted well enough to be proved."""
SIDES: Final = (0.025, 0.975)
SETTLED: Final = 4.0
"""By then the answer to a step has come to rest [s]."""
STEP_TIMES: Final = np.linspace(0.0, 0.6, 121)
"""At which it is shown [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """A number of the loop with its 95 % interval; NaN where the loop has none.

    Attributes
    ----------
    value
        Of the nominal vehicle.
    low, high
        Ends of the interval.
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopMeasures:
    """How far a loop is from oscillating.

    Attributes
    ----------
    crossover
        Frequency at which the gain falls to 1 for the last time [Hz].
    phase
        Phase margin [deg].
    gain
        Factor of the gain at which the loop oscillates.
    delay
        Time by which the loop may be later until it oscillates [s].
    sensitivity
        Peak of ``1 / |1 + L|``: by how much disturbances are amplified at worst.
    stable
        Share of the vehicles that the flights leave open in which the closed loop is stable.
    """

    crossover: Measure
    phase: Measure
    gain: Measure
    delay: Measure
    sensitivity: Measure
    stable: float


@dataclass(frozen=True, slots=True, kw_only=True)
class StepResponse:
    """Rate over the rate asked for, that steps to 1 at time 0 [s], with its 95 % band.

    Without noise, at no motor's limit; NaN where the nominal loop oscillates.
    """

    time: Float[np.ndarray, " t"]
    value: Float[np.ndarray, " t"]
    low: Float[np.ndarray, " t"]
    high: Float[np.ndarray, " t"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisLoop:
    """What is said of one axis.

    Attributes
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    controller
        As flown.
    replay, mixer
        Of its output, and of the motors' commands by it; None where the log has no curve of them.
    contradicts
        Whether its closed loop contradicts the result.
    rate_loop, with_attitude
        Cut at the torque command: the rate loop alone, and with the attitude loop around it.
    bands, error
        Of the measured closed loop, and what they say of effectiveness and delay.
    doubts
        Why no margin of it is proved; empty where it is.
    gains
        Factor of P, I and D, and the peak of the sensitivity that 97.5 % of the vehicles stay
        below; infinite where more oscillate.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopOutcome:
    """The loops of a flight, and what to know of them.

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
    axes = [
        _axis(result, owner, log, flight, i, read(flight.log, i), draws, seed)
        for i in range(len(AXES))
    ]
    return LoopOutcome(
        name=result.name,
        configuration=owner,
        autopilot=controller.autopilot,
        firmware=controller.firmware,
        axes=_jointly(axes),
        notes=tuple(_notes(flight, log)),
    )


def _jointly(axes: Sequence[AxisLoop]) -> tuple[AxisLoop, ...]:
    """Withhold the margins of an axis, too, where the other one contradicts the result.

    Both rest on one vehicle with one lag and delay: where that is another one, an axis with a
    slow loop may agree by chance.
    """
    out: list[AxisLoop] = []
    for i, one in enumerate(axes):
        others = [axes[k].axis for k in PROVED_AXES if k != i and axes[k].contradicts]
        if i in PROVED_AXES and others and not one.doubts:
            words = (
                f"{others[0]} contradicts the result, which is of one vehicle: its lag and delay "
                "may be wrong here, too, and agree by chance"
            )
            one = replace(one, doubts=(words,))
        out.append(one)
    return tuple(out)


def _axis(
    result: IdentificationResult,
    owner: str,
    log: FlightLog,
    flight: Flown,
    axis: int,
    controller: RateController,
    draws: int,
    seed: int,
) -> AxisLoop:
    frequency = np.geomspace(LOWEST, 0.45 / controller.period, POINTS)
    body = plant(
        result,
        owner,
        flight,
        axis=axis,
        period=controller.period,
        gyro_lowpass=log.gyro_lowpass,
        draws=draws,
        seed=seed,
    )
    harmonics = step_harmonics(controller.period)
    both = np.concatenate([frequency, harmonics])
    response = controller_response(log, flight, controller, axis, both)
    filtered, at_harmonics = np.split(response, [len(frequency)])
    loops = partial(_rate_loops, controller, filtered=filtered, frequency=frequency)
    bands_of = partial(
        _bands, measured_loop(controller, flight, axis), controller, frequency=frequency
    )
    error = _closed_loop_error(body.nominal, loops, bands_of, frequency, flight.log.set_point_std)
    replay = replay_output(controller, flight, axis)
    mixer = replay_mixer(flight, axis)
    wrong = axis in PROVED_AXES and error.is_wrong(body)
    doubts = _contradictions(axis, replay, mixer, error if wrong else None, flight)
    vehicles = body if doubts else error.corrected(body, seed)
    inner = loops(vehicles)
    bands = bands_of(inner[0])
    found = margins(frequency, inner)
    rate_loop = _measures(found)
    alone = _rate_loops(controller, vehicles, filtered=at_harmonics, frequency=harmonics)
    closed = closed_loop(controller, alone, harmonics)
    doubts = doubts or _too_little(rate_loop.crossover.value, bands, error)
    outer = _with_attitude(inner, controller, frequency)
    gains = [
        (factor, _peak(margins(frequency, _with_attitude(factor * inner, scaled, frequency))))
        for factor in FACTORS
        for scaled in [controller.scaled(factor)]
    ]
    return AxisLoop(
        axis=AXES[axis],
        controller=controller,
        replay=replay,
        mixer=mixer,
        contradicts=wrong and replay.is_right,
        rate_loop=rate_loop,
        with_attitude=_measures(margins(frequency, outer)),
        bands=tuple(bands),
        error=error,
        doubts=tuple(doubts),
        gains=tuple(gains),
        step=_step(step_response(harmonics, closed, STEP_TIMES), found.stable),
        frequency=frequency,
        open_loop=outer,
        closed_loop=closed_loop(controller, inner, frequency),
        stable=found.stable,
    )


def _rate_loops(
    controller: RateController,
    vehicles: Plant,
    *,
    filtered: Complex[np.ndarray, " f"],
    frequency: Float[np.ndarray, " f"],
) -> Complex[np.ndarray, "D f"]:
    """Compute the open rate loops, cut at the torque command."""
    response = vehicles.response(frequency, controller.period)
    return controller.from_rate(frequency) * filtered * response


def _with_attitude(
    inner: Complex[np.ndarray, "D f"],
    controller: RateController,
    frequency: Float[np.ndarray, " f"],
) -> Complex[np.ndarray, "D f"]:
    """Compute the open loops with the attitude loop; the feed-forward is in it, and not scaled."""
    return inner * (1.0 + controller.from_angle(frequency) / controller.from_rate(frequency))


def closed_loop(
    controller: RateController,
    loops: Complex[np.ndarray, "*D f"],
    frequency: Float[np.ndarray, " f"],
) -> Complex[np.ndarray, "*D f"]:
    """Compute the rate over the rate asked for, from open rate loops."""
    asked = controller.from_set_point(frequency) / controller.from_rate(frequency)
    return loops / (1.0 + loops) * asked


def step_harmonics(period: float) -> Float[np.ndarray, " f"]:
    """Choose the frequencies of a square wave that rests `SETTLED` on either side [Hz]."""
    first = 0.5 / SETTLED
    return first * np.arange(1.0, 0.45 / period / first, 2.0)


def step_response(
    harmonics: Float[np.ndarray, " f"],
    closed: Complex[np.ndarray, "D f"],
    time: Float[np.ndarray, " t"],
) -> Float[np.ndarray, "D t"]:
    """Compute the answer to a step, as that to one edge of a slow square wave from 0 to 1."""
    waves = np.exp(2j * np.pi * np.outer(harmonics, time))
    parts = 2.0 / np.pi * closed * harmonics[0] / harmonics
    # Both sides at rest: the answer to the edge begins at none.
    return np.imag(parts @ waves) - np.imag(parts.sum(axis=1, keepdims=True))


def _step(responses: Float[np.ndarray, "D t"], stable: Bool[np.ndarray, " D"]) -> StepResponse:
    """Collect the nominal answer, which comes first, and the band of the stable ones."""
    if not stable[0]:
        nothing = np.full_like(STEP_TIMES, np.nan)
        return StepResponse(time=STEP_TIMES, value=nothing, low=nothing, high=nothing)
    low, high = np.quantile(responses[stable], SIDES, axis=0)
    return StepResponse(time=STEP_TIMES, value=responses[0], low=low, high=high)


def _bands(
    measured: MeasuredLoop,
    controller: RateController,
    loop: Complex[np.ndarray, " f"],
    *,
    frequency: Float[np.ndarray, " f"],
) -> list[Band]:
    """Compare the measured closed loop with that of an open rate loop."""
    by_output = loop / (1.0 + loop) / controller.from_rate(frequency)
    closed = closed_loop(controller, loop, frequency)
    return closed_loop_bands(measured, frequency, closed, loop, by_output)


def _closed_loop_error(
    nominal: Plant,
    loops: Callable[[Plant], Complex[np.ndarray, "D f"]],
    bands_of: Callable[[Complex[np.ndarray, " f"]], list[Band]],
    frequency: Float[np.ndarray, " f"],
    stamp_std: float,
) -> LoopError:
    """Find how far the flown loop is from that of the nominal vehicle, step by step."""
    error = LoopError(gain=1.0, delay=0.0, covariance=UNKNOWN)
    for _ in range(STEPS):
        late = np.array([error.delay])
        inner = loops(nominal.moved(np.log([error.gain]), late))
        crossover = float(margins(frequency, inner).crossover[0])
        step = loop_error(bands_of(inner[0]), crossover, stamp_std)
        error = step.within(STEP).after(error)
    return error


def _measures(found: Margins) -> LoopMeasures:
    return LoopMeasures(
        crossover=_measure(found.crossover),
        phase=_measure(found.phase),
        gain=_measure(found.gain),
        delay=_measure(found.delay),
        sensitivity=_measure(found.sensitivity),
        stable=float(found.stable.mean()),
    )


def _measure(values: Float[np.ndarray, " D"]) -> Measure:
    """Return the nominal number, which comes first, and the interval of all."""
    known = values[np.isfinite(values)]
    if not np.isfinite(values[0]):
        return Measure(value=np.nan, low=np.nan, high=np.nan)
    low, high = np.quantile(known, SIDES)
    return Measure(value=float(values[0]), low=float(low), high=float(high))


def _peak(found: Margins) -> float:
    """Return the peak of the sensitivity that 97.5 % of the vehicles stay below."""
    peaks = np.where(found.stable, found.sensitivity, np.inf)
    return float(np.sort(peaks)[int(np.ceil(SIDES[1] * len(peaks))) - 1])


def _contradictions(
    axis: int,
    replay: ReplayedOutput,
    mixer: ReplayedMixer | None,
    error: LoopError | None,
    flight: Flown,
) -> list[str]:
    """Say what contradicts the controller and mixer as they were read, or an error the result."""
    if axis not in PROVED_AXES:
        return ["unproven: drag torque and the rotors' inertia act together"]
    doubts: list[str] = []
    if not replay.is_right:
        doubts.append(
            f"the logged output is {replay.slope:.2f} times, and the rate's derivative "
            f"{replay.derivative:.2f} times, that of the controller as its parameters set it: a "
            "filter or a gain is not what they say, or changed in flight"
        )
    if mixer is not None and not mixer.is_right:
        doubts.append(
            f"the motors' commands follow the output as with {mixer.name} {mixer.factor:.2f}, which"
            f" makes {mixer.slope:.2f} times the thrust that the parameters of the log do: the "
            "curve or the spin range is not what they say"
        )
    if error is not None:
        gain, late = error.half_widths
        when = "later" if error.delay > 0.0 else "earlier"
        words = (
            f"this flight's closed loop has {error.gain:.2f} +- {gain:.2f} times the predicted "
            f"effectiveness and answers {1e3 * abs(error.delay):.1f} +- {1e3 * late:.1f} ms {when}:"
            " the vehicle, its delay or a filter is another than the result has it"
        )
        limited = 1.0 - float(flight.free.mean())
        if limited > LIMITED:
            words += (
                f", or it is the {100 * limited:.0f} % of the flight with a motor at its limit: fly"
                " with less throttle and smaller steps"
            )
        doubts.append(words)
    return doubts


def _too_little(crossover: float, bands: Sequence[Band], error: LoopError) -> list[str]:
    """Say where the flight does not show the closed loop about the crossover [Hz]."""
    near = [b for b in bands if b.high > crossover and b.low < crossover * NEAR]
    if error.is_sharp(crossover) and any(b.proved for b in near):
        return []
    return [
        f"the flight shows too little of the closed loop about the crossover at {crossover:.1f} Hz:"
        " fly 30 s of quick roll and pitch steps"
    ]


def _notes(flight: Flown, log: FlightLog) -> list[str]:
    """Say what the loops rest on."""
    battery = log.channels.get("battery")
    notes = [
        "the loops are those of hover at the speeds of this flight; fast flight and another load "
        "change them"
    ]
    if battery is not None:
        notes.append(
            f"at {float(np.nanmean(battery.values)):.1f} V: without compensation by the autopilot "
            "the gain falls with the battery's voltage"
        )
    if log.gyro_lowpass is not None:
        notes.append(
            f"the gyro's low-pass of {log.gyro_lowpass:g} Hz is in the log, and counted once"
        )
    moving = moving_filters(flight.log)
    if moving:
        notes.append(
            f"notches of the gyro that follow the rotors, or are split ({', '.join(moving)}): they "
            "are in the loop by the delay and the size that the gyro's two records show of them up "
            "to 40 Hz, not by their shape; the other filters are in it exactly"
        )
    changed = [n for n in flight.log.changed if n.startswith(("MC_", "ATC_RAT", "ATC_ANG", "IMU_"))]
    if changed:
        notes.append(f"{', '.join(changed[:4])} changed within the log: the last values are taken")
    return notes
