"""Motor commands and the measured speeds that follow, each rotor's on clocks of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.flight.signals import hampel, true_runs
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Bool, Float

    from rotorfit.logs.flight_log import Channel, FlightLog

LEAD: Final = 1.0
"""Commands before a stretch, from which the speed at its beginning is computed [s]."""
GAP: Final = 0.2
"""Commands further apart than this, and than five of their steps, are apart [s]."""
MOST_SPEEDS: Final = 120_000
"""Speeds that are looked at, of all rotors: of a longer log pieces spread over it."""
PIECE: Final = 10.0
"""Length of such a piece [s]."""
FRESH: Final = 0.3
"""Share of speeds unlike the one before, under which telemetry may be slower than the log: then
only new values count, at the moment they come."""
SINGLE_STEPS: Final = 2.0
"""Usual change of such a speed over the smallest (a twentieth are below), up to which rounding
holds it: a slow telemetry jumps over many steps."""
LARGEST: Final = 1e9

Span = tuple[float, float]


@frozen_dataclass
class MeasuredResponse:
    """The commands of one rotor over one stretch, and the speeds measured in it.

    - `rotor`: from 0, in the log's order.
    - `command_time`: rising; each command is held until the next [s].
    - `command`: 0 (stopped) to 1 (full).
    - `voltage`: of the battery at the commands [V]; None if the log has none.
    - `speed_time`: rising, within the commands' [s].
    - `speed`: as measured [rad/s].
    """

    rotor: int
    command_time: Float[np.ndarray, " n"]
    command: Float[np.ndarray, " n"]
    voltage: Float[np.ndarray, " n"] | None
    speed_time: Float[np.ndarray, " m"]
    speed: Float[np.ndarray, " m"]


def command_responses(
    log: FlightLog, *, excluded: Sequence[int] = ()
) -> tuple[MeasuredResponse, ...]:
    """Pair commands and measured speeds of every rotor; empty if the log lacks either."""
    if not {"command", "rotor_speed"} <= set(log.channels):
        return ()
    command, speed = log.channels["command"], log.channels["rotor_speed"]
    if command.values.shape[1] != speed.values.shape[1]:
        return ()
    battery = log.channels.get("battery")
    volts = None if battery is None else _known_values(battery, 0)
    volts = None if volts is None or len(volts[0]) < 2 else volts
    pieces = _sample_pieces(speed)
    found: list[MeasuredResponse] = []
    for i in range(command.values.shape[1]):
        if i not in excluded:
            commands, speeds = _known_values(command, i), _fresh_speeds(*_known_values(speed, i))
            found += [
                a for span in pieces for a in _gap_free_responses(i, commands, speeds, volts, span)
            ]
    return tuple(found)


def responses_within(
    responses: Sequence[MeasuredResponse], spans: Sequence[Span], *, most: int = MOST_SPEEDS
) -> tuple[MeasuredResponse, ...]:
    """Cut responses to spans of time [s]; above `most` speeds, to pieces spread over the spans."""
    inside = _cut_into_spans(responses, spans)
    count = sum(len(response.speed) for response in inside)
    return (
        inside if count <= most else _cut_into_spans(responses, _spread_pieces(spans, most / count))
    )


def _cut_into_spans(
    responses: Sequence[MeasuredResponse], spans: Sequence[Span]
) -> tuple[MeasuredResponse, ...]:
    cuts = (_cut_response(response, *span) for response in responses for span in spans)
    return tuple(cut for cut in cuts if cut is not None)


def response_spans(responses: Sequence[MeasuredResponse]) -> list[Span]:
    """Join the spans of time in which any rotor has speeds."""
    spans = {
        (float(a.speed_time[0]), float(np.nextafter(a.speed_time[-1], np.inf))) for a in responses
    }
    joined: list[Span] = []
    for begin, end in sorted(spans):
        if joined and begin <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], end))
        else:
            joined.append((begin, end))
    return joined


def _cut_response(response: MeasuredResponse, begin: float, end: float) -> MeasuredResponse | None:
    t = response.speed_time
    rows = slice(*np.searchsorted(t, [begin, end]).tolist())
    if rows.stop - rows.start < 2:
        return None
    commands = response.command_time
    # The command in force at the beginning is the last one before it.
    first = max(int(np.searchsorted(commands, t[rows.start] - LEAD, side="right")) - 1, 0)
    stop = int(np.searchsorted(commands, t[rows.stop - 1], side="right"))
    held = slice(first, stop)
    return replace(
        response,
        command_time=commands[held],
        command=response.command[held],
        voltage=None if response.voltage is None else response.voltage[held],
        speed_time=t[rows],
        speed=response.speed[rows],
    )


def _known_values(
    channel: Channel, column: int
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Select times and finite values of a column, in the order of time."""
    values = channel.values[:, column]
    known = (np.abs(channel.time) < LARGEST) & (np.abs(values) < LARGEST)
    time, first = np.unique(channel.time[known], return_index=True)
    return time, values[known][first]


def _fresh_speeds(
    time: Float[np.ndarray, " n"], speed: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Despike speeds, and drop repetitions of slow telemetry."""
    if len(time) < 2:
        return time, speed
    new = np.concatenate([[True], np.diff(speed) != 0.0])
    # Speeds in coarse steps repeat without being old: a rounded one is half a step ahead where it
    # changes.
    if float(new.mean()) < FRESH and not _is_rounded(np.abs(np.diff(speed[new]))):
        time, speed = time[new], speed[new]
    values, _ = hampel(speed[:, None])
    return time, values[:, 0]


def _is_rounded(jumps: Float[np.ndarray, " j"]) -> bool:
    """Return whether most changes of a speed are by one step of its resolution."""
    if not len(jumps):
        return False
    smallest, usual = np.percentile(jumps, [5.0, 50.0]).tolist()
    return usual < SINGLE_STEPS * smallest


def _sample_pieces(speed: Channel) -> list[Span]:
    """Return the whole log, or spans spread over it evenly where it is long."""
    known = speed.time[np.abs(speed.time) < LARGEST]
    if len(known) < 2:
        return []
    whole = (float(known.min()), float(np.nextafter(known.max(), np.inf)))
    share = MOST_SPEEDS / speed.values.size
    return [whole] if share >= 1.0 else _spread_pieces([whole], share)


def _spread_pieces(spans: Sequence[Span], share: float) -> list[Span]:
    """Spread pieces evenly over spans, a share of them in all."""
    step = PIECE / share
    return [
        (float(t), min(float(t) + PIECE, end))
        for begin, end in spans
        for t in np.arange(begin, end, step)
    ]


def _gap_free_responses(
    rotor: int,
    commands: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]],
    speeds: tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]],
    volts: tuple[Float[np.ndarray, " v"], Float[np.ndarray, " v"]] | None,
    span: Span,
) -> Iterator[MeasuredResponse]:
    time, command = commands
    if len(time) < 2:
        return
    steps = np.diff(time)
    together = np.append(steps <= max(GAP, 5.0 * float(np.median(steps))), False)
    for a, b in true_runs(together):
        rows = slice(a, b + 1)
        whole = MeasuredResponse(
            rotor=rotor,
            command_time=time[rows],
            command=command[rows],
            voltage=None if volts is None else np.interp(time[rows], *volts),
            speed_time=speeds[0],
            speed=speeds[1],
        )
        cut = _cut_response(whole, max(span[0], float(time[a])), min(span[1], float(time[b])))
        if cut is not None:
            yield cut


AT: Final = 1e-4
"""Share of the range of the commands: two that differ by less are the same."""
ALONGSIDE: Final = 0.03
"""Share of the range next to an end: more commands stand at an end that is a limit."""
ALONGSIDE_STEPS: Final = 4.0
"""The same of coarse commands, in steps of theirs."""


@frozen_dataclass
class MotorLimits:
    """The shares of a flight with motors at the ends of their commands.

    - `lowest`, `highest`: share of the time of each motor, in the log's order.
    - `arrivals`: how often a second a motor comes to an end, on average [Hz].
    """

    lowest: tuple[float, ...]
    highest: tuple[float, ...]
    arrivals: float

    @property
    def share(self) -> float:
        """Of the time of all motors, at either end."""
        return float(np.mean(self.lowest) + np.mean(self.highest))


def motor_limits(command: Channel, spans: Sequence[tuple[float, float]]) -> MotorLimits | None:
    """Measure how often commands stand at their ends in flight; None if none were logged."""
    inside: Bool[np.ndarray, " n"] = np.isfinite(command.values).min(axis=1)
    flown = np.zeros(len(command.time), dtype=bool)
    for begin, end in spans:
        flown |= (command.time >= begin) & (command.time <= end)
    values = command.values[inside & flown]
    seconds = sum(end - begin for begin, end in spans)
    if not len(values) or seconds <= 0.0:
        return None
    low, high = at_ends(values)
    ends = low | high
    arrived = np.count_nonzero(ends[1:] & ~ends[:-1]) / values.shape[1]
    return MotorLimits(
        lowest=tuple(low.mean(axis=0).tolist()),
        highest=tuple(high.mean(axis=0).tolist()),
        arrivals=arrived / seconds,
    )


def at_ends(
    values: Float[np.ndarray, "n N"],
) -> tuple[Bool[np.ndarray, "n N"], Bool[np.ndarray, "n N"]]:
    """Mark the commands at the lowest and the highest value of all motors, where it is a limit."""
    reach = float(np.ptp(values))
    steps = np.abs(np.diff(values, axis=0))
    step = float(steps.min(initial=reach, where=steps > AT * reach))
    ends: list[Bool[np.ndarray, "n N"]] = []
    for end in (float(values.min()), float(values.max())):
        away = np.abs(values - end)
        at = away <= 0.5 * min(step, ALONGSIDE * reach)
        alongside = ~at & (away <= max(ALONGSIDE * reach, ALONGSIDE_STEPS * step))
        # One at which they pile up: a command that merely turns round there passes through what is
        # beside it, too.
        piled = reach > 0.0 and np.count_nonzero(at) > max(np.count_nonzero(alongside), 1)
        ends.append(at if piled else np.zeros_like(at))
    return ends[0], ends[1]
