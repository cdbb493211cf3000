"""The outcome of `rotorfit fly`: replayed flights and flown manoeuvres, for text, page and JSON."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.results.validation.judgement import (
    AXES,
    GOOD_SHARE,
    Judgement,
    horizon,
    judgement,
    moment_splits,
)
from rotorfit.results.validation.replay import (
    HOLD,
    IDENTIFIED,
    Replay,
    band_growth,
    error_growth,
    force_errors,
    growth_time,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float

Manoeuvre = Literal["hover", "roll", "pitch", "yaw rate"]
MANOEUVRES: Final[tuple[Manoeuvre, ...]] = ("hover", "roll", "pitch", "yaw rate")
STEPS: Final[tuple[Manoeuvre, ...]] = MANOEUVRES[1:]
BEFORE: Final = 0.25
"""Level flight before a step [s]."""
STEP: Final = {"roll": 0.25, "pitch": 0.25, "yaw rate": 0.5}
"""Sizes of the steps [rad, rad, rad/s]."""
LOST: Final = 1.2
"""Tilt beyond which a vehicle counts as lost [rad]."""
WITHIN: Final = 0.1
"""Share of the step about its end: then it is settled."""
EARLY: Final = 0.1
"""The time, besides the end of a window, at which errors are reported [s]."""
STEADY: Final = 0.7
"""Share of an error from which on it is mostly steady: trim."""


@frozen_dataclass
class ModelFlight:
    """One manoeuvre: height above the start [m], angle [rad] or yaw rate [rad/s] over time [s].

    `tilt` is the angle of the body's z axis to the vertical [rad].
    """

    manoeuvre: Manoeuvre
    time: Float[np.ndarray, " n"]
    asked: Float[np.ndarray, " n"]
    flown: Float[np.ndarray, " n"]
    tilt: Float[np.ndarray, " n"]


def is_lost(flight: ModelFlight) -> bool:
    """Test whether the vehicle turned over, or its state is no number any more."""
    return not np.isfinite(flight.flown).all() or float(flight.tilt.max()) > LOST


def departure(flight: ModelFlight) -> float:
    """Compute the largest height error in hover [m]."""
    return float(np.abs(flight.flown - flight.asked).max())


def overshoot(flight: ModelFlight) -> float:
    """Compute the overshoot of a step as a share of the step."""
    return max(float(flight.flown.max()) / float(flight.asked[-1]) - 1.0, 0.0)


def settling_time(flight: ModelFlight) -> float | None:
    """Compute the time from a step until it stays within a tenth of what was asked [s].

    None where it does not within the time flown.
    """
    away = np.abs(flight.flown - flight.asked) > WITHIN * abs(float(flight.asked[-1]))
    last = int(np.flatnonzero(away)[-1]) if away.any() else 0
    if last + 1 >= len(away):
        return None
    return float(flight.time[last + 1]) - BEFORE


@frozen_dataclass
class FlyOutcome:
    """Everything that was flown with one configuration of a result.

    - `seconds`: length of a window [s].
    - `draws`: from the covariance of the result, which make the band.
    - `labels`: whose parameters: ``identified``, then the others.
    - `manoeuvres`: by label: the identified model, flown by an autopilot tuned to those parameters;
      empty where there is no MuJoCo.
    - `doubtful`: names of doubtful numbers that the model rests on.
    """

    name: str
    configuration: str
    seconds: float
    draws: int
    labels: tuple[str, ...]
    replays: tuple[Replay, ...]
    manoeuvres: Mapping[str, tuple[ModelFlight, ...]]
    notes: tuple[str, ...]
    doubtful: tuple[str, ...] = ()

    @property
    def windows(self) -> int:
        """Of all flights."""
        return sum(len(replay.time) for replay in self.replays)

    @property
    def judgement(self) -> Judgement:
        """Whether it flies as flown: what `rotorfit validate` says of the same flights."""
        return judgement(self.replays, doubtful=self.doubtful)

    def to_json(self) -> str:
        """Return the numbers as JSON text."""
        return json.dumps(_plain_outcome(self), indent=1, allow_nan=False) + "\n"


def reported_times(outcome: FlyOutcome) -> tuple[float, ...]:
    """Return the times after the start of a window at which errors are reported [s]."""
    end = float(growth_time(outcome.replays)[-1])
    return (EARLY, end) if end > 2.0 * EARLY else (end,)


def rate_errors(outcome: FlyOutcome, label: str, time: float) -> Float[np.ndarray, " 3"]:
    """Compute the rms error of the rates so long after the start of a window [rad/s]."""
    return _growth_at(outcome, error_growth(outcome.replays, label), time)


def band(outcome: FlyOutcome, time: float) -> Float[np.ndarray, " 3"]:
    """Compute the half-width that the intervals of the parameters give the rates [rad/s]."""
    return _growth_at(outcome, band_growth(outcome.replays, IDENTIFIED), time)


def _growth_at(
    outcome: FlyOutcome, growth: Float[np.ndarray, "S 3"], time: float
) -> Float[np.ndarray, " 3"]:
    return growth[int(np.argmin(np.abs(growth_time(outcome.replays) - time)))]


def ratio_to(outcome: FlyOutcome, label: str, time: float) -> Float[np.ndarray, " 3"]:
    """Compute the error of the identified parameters over that of other ones, per axis."""
    other = np.maximum(rate_errors(outcome, label, time), np.finfo(float).tiny)
    return rate_errors(outcome, IDENTIFIED, time) / other


def manoeuvre_of(outcome: FlyOutcome, label: str, name: Manoeuvre) -> ModelFlight:
    """Return one of the manoeuvres flown."""
    return next(flight for flight in outcome.manoeuvres[label] if flight.manoeuvre == name)


def steady_share(outcome: FlyOutcome) -> Float[np.ndarray, " 3"]:
    """Compute the mean of the errors at the end of the windows over their rms, per axis: 0 to 1."""
    errors = np.concatenate(
        [replay.predicted[0].rates[:, -1] - replay.rates[:, -1] for replay in outcome.replays]
    )
    size = np.maximum(np.sqrt((errors**2).mean(axis=0)), np.finfo(float).tiny)
    return np.abs(errors.mean(axis=0)) / size


def _plain_outcome(outcome: FlyOutcome) -> dict[str, Any]:
    compared = (*outcome.labels, HOLD)
    return {
        "name": outcome.name,
        "configuration": outcome.configuration,
        "window_seconds": outcome.seconds,
        "windows": outcome.windows,
        "draws": outcome.draws,
        "flights": [
            {"flight": r.flight, "sha256": r.sha256, "windows": len(r.time)}
            for r in outcome.replays
        ],
        "rate_errors": [
            {
                "seconds": time,
                "unit": "rad/s",
                "rms": {label: _by_axis(rate_errors(outcome, label, time)) for label in compared},
                "band": _by_axis(band(outcome, time)),
                "identified_over": {
                    label: _by_axis(ratio_to(outcome, label, time)) for label in compared[1:]
                },
            }
            for time in reported_times(outcome)
        ],
        "open_loop_seconds": _by_axis(horizon(outcome.replays, GOOD_SHARE)),
        "steady_share": _by_axis(steady_share(outcome)),
        "force_errors": {
            "unit": "m/s^2",
            "rms": {
                label: dict(zip("xyz", force_errors(outcome.replays, label).tolist(), strict=True))
                for label in compared
            },
        },
        "manoeuvres": {
            label: {flight.manoeuvre: _plain_flight(flight) for flight in flights}
            for label, flights in outcome.manoeuvres.items()
        },
        "notes": list(outcome.notes),
        "judgement": outcome.judgement.to_plain(),
        "moments": [
            split.to_plain()
            for split in moment_splits(
                [r.comparison for r in outcome.replays if r.comparison is not None]
            )
        ],
    }


def _by_axis(values: Float[np.ndarray, " 3"]) -> dict[str, float | None]:
    return {
        axis: value if math.isfinite(value) else None
        for axis, value in zip(AXES, values.tolist(), strict=True)
    }


def _plain_flight(flight: ModelFlight) -> dict[str, Any]:
    if is_lost(flight):
        return {"lost": True}
    if flight.manoeuvre not in STEPS:
        return {"lost": False, "height_off_m": departure(flight)}
    return {
        "lost": False,
        "overshoot": overshoot(flight),
        "settling_time_s": settling_time(flight),
    }


def liveliest(replay: Replay, seconds: float) -> list[int]:
    """Select the windows of the stretch of that length in which the rates are largest."""
    starts = replay.time[:, 0]
    power = (replay.rates**2).mean(axis=(1, 2))
    within = (starts >= starts[:, None]) & (starts < starts[:, None] + seconds)
    best = int(np.argmax(within @ power))
    return np.flatnonzero(within[best]).tolist()
