"""The outcome of a flown loop: margins with intervals, what proves them, and its JSON."""

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float

from rotorfit.control_loop.proof import Band, LoopError, ReplayedMixer, ReplayedOutput
from rotorfit.control_loop.rate_controller import RateController
from rotorfit.formatting.digits import finite_json


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


def loop_to_json(outcome: LoopOutcome) -> str:
    """Return the outcome as JSON text; null where there is no number."""
    plain = {
        "name": outcome.name,
        "configuration": outcome.configuration,
        "autopilot": outcome.autopilot,
        "firmware": outcome.firmware,
        "notes": list(outcome.notes),
        "axes": [_axis_json(loop) for loop in outcome.axes],
    }
    return json.dumps(finite_json(plain), indent=1, allow_nan=False) + "\n"


def _axis_json(loop: AxisLoop) -> dict[str, Any]:
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
        "gains": [{"factor": factor, "sensitivity": peak} for factor, peak in loop.gains],
        "step": {name: values.tolist() for name, values in asdict(loop.step).items()},
    }
