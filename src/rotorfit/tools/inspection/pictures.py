"""Pictures of a log as numbers to draw: curves, marks, spectra, filters."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.errors import FlightError
from rotorfit.flight.clocks import GAP_STEPS, LARGEST_VALUE, usable_samples
from rotorfit.flight.signals import LEAST_LIMIT, at_limit, true_runs
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.firmware import Filter, filters_on_board
from rotorfit.logs.flight_log import CHANNELS, COMPONENTS, Channel, FlightLog
from rotorfit.series import Series, thinned
from rotorfit.tools.inspection.spectra import RotorBand, Spectrum, rotor_bands, spectrum

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from jaxtyping import Bool, Float, Int

    from rotorfit.flight.prepare import Cut, PreparedFlight
    from rotorfit.tools.inspection.recording import ChannelReport

DRAWN: Final = ("gyro", "accel", "rotor_speed", "command")
NAMES: Final = {
    "gyro": "the gyro",
    "accel": "the accelerometer",
    "rotor_speed": "the rotor speeds",
    "command": "the motor commands",
    "position": "the position",
}
POSE: Final = ("position",)
"""Drawn where none of those is there."""
COLUMNS: Final = 4096
"""Columns of time that a curve keeps, two numbers each."""
FULL_COMMAND: Final = 0.995
MOST_MARKS: Final = 400
"""Marks nearer to one another than the log's length over this become one."""
GRAVITY: Final = 9.80665
AXES: Final = ("roll", "pitch", "yaw")
TURN_LEVELS: Final = (10.0, 40.0, 150.0)
"""Rms rates at which an axis moves gently, lively, hard [deg/s]."""
THRUST_LEVELS: Final = (0.03, 0.1, 0.3)
"""The same for the change of the specific force along z, over gravity."""
LEVELS: Final = ("still", "gentle", "lively", "hard")
WINDOWS: Final = 400
SHORTEST_WINDOW: Final = 0.25
SLOW: Final = {"gyro": 0.02, "accel": 0.1}
"""Means over so long leave out vibration [s]."""
NONE: Final[Mapping[str, float]] = MappingProxyType({})
MarkKind = Literal["cut", "gap", "limit"]


@frozen_dataclass
class Trace:
    """One channel over time; columns that lack other samples than the rest have their own clock.

    - `channel`, `unit`: as in `CHANNELS`.
    - `curves`: each with one column or more by its name.
    """

    channel: str
    unit: str
    curves: tuple[Series, ...]


@frozen_dataclass
class Mark:
    """A stretch that is marked, in seconds since the log's first sample.

    - `kind`: ``cut``: not used; ``gap``: samples are missing; ``limit``: a sensor or a command at
      its end.
    - `channel`: None: all.
    """

    kind: MarkKind
    channel: str | None
    start: float
    end: float
    words: str


@frozen_dataclass
class Activity:
    """The motion of one axis, window by window.

    - `axis`: ``roll``, ``pitch``, ``yaw`` or ``thrust``.
    - `unit`: of `size`: ``deg/s`` rms, or ``g`` rms of the change of thrust.
    - `start`, `step`: of the first window, and of each [s].
    - `size`: NaN where nothing was recorded.
    """

    axis: str
    unit: str
    start: float
    step: float
    size: Float[np.ndarray, " w"]

    @property
    def level(self) -> Int[np.ndarray, " w"]:
        """Index into `LEVELS` of each window; -1 if nothing was recorded."""
        ends = THRUST_LEVELS if self.axis == "thrust" else TURN_LEVELS
        return np.where(np.isfinite(self.size), np.searchsorted(ends, self.size, "right"), -1)

    def seconds(self, level: int, spans: Sequence[tuple[float, float]] = ()) -> float:
        """Return how long the axis moved at a level or above, within spans if there are any [s]."""
        middle = self.start + self.step * (np.arange(len(self.size)) + 0.5)
        counted = self.level >= level
        if spans:
            counted &= np.any([(middle >= a) & (middle <= b) for a, b in spans], axis=0)
        return self.step * float(counted.sum())


@frozen_dataclass
class TimePicture:
    """The picture of a log over time, in seconds since its first sample."""

    start: float
    end: float
    traces: tuple[Trace, ...]
    marks: tuple[Mark, ...]
    activity: tuple[Activity, ...]


def time_picture(
    log: FlightLog,
    *,
    zero: float,
    cuts: Sequence[Cut] = (),
    new_share: Mapping[str, float] = NONE,
) -> tuple[TimePicture | None, list[str]]:
    """Draw a log over time, None without a curve; and say what is left out and why.

    `zero` is the log's first sample and `cuts` what is not used, on its own clock [s]; `new_share`
    is, by channel, the share of the samples that bring something new.
    """
    names = [name for name in DRAWN if name in log.channels]
    names = names or [name for name in POSE if name in log.channels]
    traces: list[Trace] = []
    marks: list[Mark] = []
    why: list[str] = []
    for name in names:
        curves, problems = _thin_curves(log.channels[name], name, zero)
        why += [f"{NAMES[name]}, in full or in part: {problem}" for problem in problems]
        if curves:
            traces.append(Trace(channel=name, unit=CHANNELS[name][1], curves=curves))
            marks += _channel_marks(log.channels[name], name, zero, new_share.get(name, 1.0))
    if not traces:
        return None, why or ["there is no curve over time: none of the channels has samples"]
    start = min(float(s.time[0]) for trace in traces for s in trace.curves)
    end = max(float(s.time[-1]) for trace in traces for s in trace.curves)
    marks = [*_cut_marks(cuts, zero, (end - start) / MOST_MARKS), *marks]
    return TimePicture(
        start=start,
        end=end,
        traces=tuple(traces),
        marks=tuple(marks),
        activity=_measure_activities(log, zero),
    ), why


def _thin_curves(channel: Channel, name: str, zero: float) -> tuple[tuple[Series, ...], list[str]]:
    """Thin the columns, those with samples at equal times together."""
    values = channel.values
    present = np.abs(np.nan_to_num(values, nan=np.inf)) < LARGEST_VALUE
    together: dict[bytes, list[int]] = {}
    for k in range(values.shape[1]):
        if present[:, k].any():
            together.setdefault(np.packbits(present[:, k]).tobytes(), []).append(k)
    count = values.shape[1]
    names = COMPONENTS.get(count, ()) if CHANNELS[name][0] else ()
    found: list[Series] = []
    problems: list[str] = []
    for columns in together.values():
        try:
            usable = usable_samples(replace(channel, values=values[:, columns]), name)
        except FlightError as error:
            problems.append(str(error))
            continue
        series = Series(
            time=usable.time - zero,
            values={
                (names[k] if names else str(k + 1)): usable.values[:, i]
                for i, k in enumerate(columns)
            },
            gap=GAP_STEPS * float(np.median(np.diff(usable.time))),
        )
        found.append(thinned(series, columns=COLUMNS))
    return tuple(found), problems


def _channel_marks(channel: Channel, name: str, zero: float, share: float) -> list[Mark]:
    """Mark gaps of a channel, and where it stands at its limit."""
    finite = np.isfinite(channel.values).all(axis=1) & np.isfinite(channel.time)
    t, x = channel.time[finite] - zero, channel.values[finite]
    if len(t) < 2 or float(np.diff(t).min()) < 0.0:
        return []
    distance = float(t[-1] - t[0]) / MOST_MARKS
    steps = np.diff(t)
    late = np.flatnonzero(steps > GAP_STEPS * float(np.median(steps)))
    gaps = [(float(t[i]), float(t[i + 1])) for i in late.tolist()]
    limited, words = _find_limits(x, name, repeats=round(1.0 / share))
    stuck = [(float(t[a]), float(t[b - 1])) for a, b in true_runs(limited)]
    return [
        *_join_marks("gap", name, f"gap in {NAMES[name]}", gaps, distance),
        *_join_marks("limit", name, words, stuck, distance),
    ]


def _find_limits(
    values: Float[np.ndarray, "n k"], name: str, *, repeats: int
) -> tuple[Bool[np.ndarray, " n"], str]:
    """Find where a channel stands at its limit, and name that."""
    if name in LEAST_LIMIT:
        return at_limit(values, LEAST_LIMIT[name], repeats=repeats), f"{NAMES[name]} at its limit"
    if name == "command":
        full: Bool[np.ndarray, " n"] = np.any(values >= FULL_COMMAND, axis=1)
        return full, "a motor at full command"
    return np.zeros(len(values), dtype=bool), ""


def _cut_marks(cuts: Sequence[Cut], zero: float, distance: float) -> list[Mark]:
    """Mark what is not used, but for gaps: those are marked in their channels."""
    reasons = dict.fromkeys(cut.reason for cut in cuts if not cut.reason.startswith("gap in "))
    return [
        mark
        for reason in reasons
        for mark in _join_marks(
            "cut",
            None,
            reason,
            [(cut.start - zero, cut.end - zero) for cut in cuts if cut.reason == reason],
            distance,
        )
    ]


def _join_marks(
    kind: MarkKind,
    channel: str | None,
    words: str,
    spans: Iterable[tuple[float, float]],
    distance: float,
) -> list[Mark]:
    """Join spans that no eye could separate, and mark them."""
    joined: list[tuple[float, float]] = []
    for start, end in spans:
        if joined and start - joined[-1][1] < distance:
            joined[-1] = (joined[-1][0], max(end, joined[-1][1]))
        else:
            joined.append((start, end))
    return [Mark(kind=kind, channel=channel, start=a, end=b, words=words) for a, b in joined]


def _measure_activities(log: FlightLog, zero: float) -> tuple[Activity, ...]:
    """Measure how much roll, pitch, yaw and thrust moved."""
    found: list[Activity] = []
    gyro = _slow_means(log, "gyro")
    if gyro is not None:
        for i, axis in enumerate(AXES):
            found.append(_measure_activity(axis, gyro[0] - zero, np.degrees(gyro[1][:, i])))
    accel = _slow_means(log, "accel")
    if accel is not None:
        found.append(_measure_activity("thrust", accel[0] - zero, accel[1][:, 2] / GRAVITY - 1.0))
    return tuple(found)


def _slow_means(
    log: FlightLog, name: str
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 3"]] | None:
    """Average over short times; return their middles and means, None without usable samples."""
    if name not in log.channels:
        return None
    try:
        channel = usable_samples(log.channels[name], name)
    except FlightError:
        return None
    bins = np.floor((channel.time - channel.time[0]) / SLOW[name])
    starts = np.flatnonzero(np.diff(bins, prepend=-1.0))
    count = np.diff(np.append(starts, len(bins)))
    means = np.add.reduceat(channel.values, starts, axis=0) / count[:, None]
    return np.add.reduceat(channel.time, starts) / count, means


def _measure_activity(
    axis: str, time: Float[np.ndarray, " m"], values: Float[np.ndarray, " m"]
) -> Activity:
    start = float(time[0])
    span = max(float(time[-1]) - start, SHORTEST_WINDOW)
    step = max(span / WINDOWS, SHORTEST_WINDOW)
    window = np.minimum(((time - start) / step).astype(np.int64), int(np.ceil(span / step)) - 1)
    count = np.bincount(window)
    power = np.bincount(window, weights=values**2)
    size = np.sqrt(power / np.maximum(count, 1))
    return Activity(
        axis=axis,
        unit="g" if axis == "thrust" else "deg/s",
        start=start,
        step=step,
        size=np.where(count > 0, size, np.nan),
    )


@frozen_dataclass
class LogPictures:
    """The pictures of one log; their size does not grow with the log's length.

    - `bands`: of the rotors' harmonics; empty if rotor speed was not measured.
    - `filters`: on board, by the log's settings.
    - `left_out`: what cannot be drawn, and why: one sentence each.
    """

    time: TimePicture | None
    spectra: tuple[Spectrum, ...]
    bands: tuple[RotorBand, ...]
    filters: tuple[Filter, ...]
    left_out: tuple[str, ...]


def log_pictures(
    log: FlightLog, prepared: PreparedFlight | None, reports: Mapping[str, ChannelReport]
) -> LogPictures:
    """Draw a log; its airborne part where it was found, its channels by their reports."""
    shares = {name: r.true_rate / r.rate for name, r in reports.items() if r.rate > 0}
    time, left_out = time_picture(
        log,
        zero=first_sample(log) if prepared is None else float(prepared.data.time[0]),
        cuts=() if prepared is None else prepared.cuts,
        new_share=shares,
    )
    spans = _flown_spans(prepared)
    rotor_speed = log.channels.get("rotor_speed")
    spectra: list[Spectrum] = []
    for name in ("gyro", "accel"):
        if name not in log.channels:
            left_out.append(f"no spectrum of {name}: the log does not have it")
            continue
        try:
            spectra.append(
                spectrum(
                    name,
                    log.channels[name],
                    spans=spans,
                    rotor_speed=rotor_speed,
                    new_share=shares.get(name, 1.0),
                )
            )
        except FlightError as error:
            left_out.append(f"no spectrum of {name}: {error}")
    return LogPictures(
        time=time,
        spectra=tuple(spectra),
        bands=rotor_bands(rotor_speed, spans),
        filters=filters_on_board(log),
        left_out=tuple(left_out),
    )


def first_sample(log: FlightLog) -> float:
    """Return the time of the gyro's first sample, or of any channel's without one [s]."""
    firsts = {
        name: float(t[0])
        for name, t in ((n, c.time[np.isfinite(c.time)]) for n, c in log.channels.items())
        if len(t)
    }
    return firsts.get("gyro", min(firsts.values(), default=0.0))


def _flown_spans(prepared: PreparedFlight | None) -> Sequence[tuple[float, float]]:
    """Return the airborne stretches on the log's clock."""
    if prepared is None:
        return ()
    t = prepared.data.time
    return [(float(t[s.start]), float(t[s.stop - 1])) for s in prepared.data.segments]
