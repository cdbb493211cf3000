"""Compare the measured rotor speeds with the motor commands: order, dead channels, ratios.

The two are recorded by different devices on different wires, and each rotor has its own law from
command to speed, so that a log contradicts itself where a plug is swapped, a wire is off or one
controller counts other poles. Everything is looked at in the band that a pilot flies in, where a
rotor follows its command; how late the speeds are as a whole is found first.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.flight.motors.coarse_speeds import coarse_speeds_sentence
from rotorfit.flight.motors.speed_ratios import FEWEST_ALIKE, is_unlike, speed_ratios
from rotorfit.flight.motors.telemetry_pair import (
    LEAST_SECONDS,
    LONGEST_CONSTANT,
    TelemetryPair,
    advance_samples,
    despike_values,
    finite_columns,
    mark_stray_commands,
    mend_stray_commands,
    pair_channels,
)
from rotorfit.flight.signals import smooth, true_runs, whole_samples
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Bool, Float, Int

    from rotorfit.logs.flight_log import Channel, FlightLog

    _Columns = list[tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]]

BAND: Final = (0.3, 8.0)
"""Band in which commands and speeds are compared [Hz]."""
LATE: Final = (-0.1, 0.3)
"""How much later than the commands the speeds may be [s]."""
LATER: Final = 0.03
"""Time by which one rotor's speed may be later than the others' [s]; like motors differ by .01."""
MOVES: Final = 0.01
"""Deviation of a command below which it shows nothing of its speed."""
CLEAR: Final = 0.5
"""Correlation from which a command and a speed belong together."""
CLEARER: Final = 0.7
"""What another command or time leaves unexplained, over what the own one does, to be believed."""
NOTHING: Final = 0.3
"""Correlation below which a speed does not follow its command."""
LEAST_STUCK: Final = 0.02
"""Share of the time that a speed is stuck, from which it is said."""
STEPS_SEEN: Final = 3.0
"""Steps of a coarse speed by which its command must move it before it counts as stuck."""
SPIKE: Final = 0.1
"""Size of jumps of a command for single samples from which they are said [of full]."""
SPIKY_PERCENTILE: Final = 90.0
"""Share of the samples that are below that size in a command without spikes [%]."""
State = Literal[
    "follows",
    "swapped",
    "dead",
    "still",
    "stuck",
    "apart",
    "unlike",
    "late",
    "unclear",
    "coarse",
]


@frozen_dataclass
class RotorTelemetry:
    """The measured speed of one rotor compared with the commands.

    - `rotor`: from 1, in the log's order.
    - `state`: ``"follows"`` its command; ``"swapped"``: another speed does; ``"dead"``: the speed
      never changes; ``"still"``: the command never does; ``"stuck"`` now and then;
      ``"apart"``: goes with no command;
      ``"unlike"``: its speed is another than the others' at the same command; ``"late"``: it comes
      later or earlier than the others'; ``"unclear"``: the command hardly moves; ``"coarse"``:
      the speeds of all come in steps that hide their motion.
    - `correlation`: of command and speed; None if one of them is dead.
    - `speed_channel`: number of the speed that goes with this command best, where that is clear.
    - `ratio`: speed over that of the other rotors at the same command, where it is identifiable.
    - `stuck`: share of the time that the speed stays the same though the command moves.
    - `later`: how much later the speed comes than the others', 0 where that is not clear [s].
    """

    rotor: int
    state: State
    correlation: float | None = None
    speed_channel: int | None = None
    ratio: float | None = None
    stuck: float = 0.0
    later: float = 0.0


@frozen_dataclass
class Telemetry:
    """Measured rotor speeds beside the commands.

    - `seconds`: of turning motors that were looked at [s].
    - `lateness`: how much later than the commands the speeds are [s]; None if they go with none.
    - `rotors`: one for each, none where nothing could be compared.
    - `doubts`: what is wrong, one sentence each.
    """

    seconds: float
    lateness: float | None
    rotors: tuple[RotorTelemetry, ...]
    doubts: tuple[str, ...]


def telemetry(log: FlightLog) -> Telemetry | None:
    """Compare measured speeds with the commands; None if the log lacks either."""
    if not {"command", "rotor_speed"} <= set(log.channels):
        return None
    command, speed = log.channels["command"], log.channels["rotor_speed"]
    count, other = command.values.shape[1], speed.values.shape[1]
    if count != other:
        named = "; name as many of each in a columns map" if log.takes_columns else ""
        doubt = (
            f"the log has {count} motor commands ({command.source}) but {other} measured speeds "
            f"({speed.source}): they were not compared{named}"
        )
        return Telemetry(seconds=0.0, lateness=None, rotors=(), doubts=(doubt,))
    pair = pair_channels(mend_stray_commands(command), speed)
    seconds = 0.0 if pair is None else float(pair.used.sum()) / pair.rate
    if pair is None or seconds < LEAST_SECONDS:
        return Telemetry(seconds=seconds, lateness=None, rotors=(), doubts=())
    found = _compare_telemetry(pair, seconds)
    return replace(found, doubts=(*found.doubts, *describe_spiky_commands(command)))


def describe_stray_commands(strays: Bool[np.ndarray, "n N"]) -> list[str]:
    """State which commands are far off their neighbours for single samples, as marked."""
    shares = strays.mean(axis=0).tolist()
    stray = [str(i) for i, share in enumerate(shares, start=1) if share > 0.0]
    if not stray:
        return []
    return [
        f"the command of rotor {', '.join(stray)} is far off its neighbours for single samples "
        f"({100 * max(shares):.2g} % of them): these are taken from the line between their "
        "neighbours; see why the recorder or converter loses them"
    ]


def describe_spiky_commands(command: Channel) -> list[str]:
    """State which commands jump up or down for single samples, always or now and then."""
    strays = mark_stray_commands(command)
    found = describe_stray_commands(strays)
    command = mend_stray_commands(command, strays)
    sizes = [
        float(np.percentile(np.abs(x - despike_values(x)), SPIKY_PERCENTILE)) if len(x) > 2 else 0.0
        for _, x in finite_columns(command)
    ]
    spiky = [str(i) for i, size in enumerate(sizes, start=1) if size > SPIKE]
    if not spiky:
        return found
    return [
        *found,
        f"the command of rotor {', '.join(spiky)} jumps for single samples, by {max(sizes):.2f} of "
        "full in one sample of ten: the means over 10 ms are compared with the speeds; lower the "
        "gyro's low-pass or the D gains, which pass the noise on",
    ]


def _compare_telemetry(pair: TelemetryPair, seconds: float) -> Telemetry:
    live = pair.live
    coarse = coarse_speeds_sentence(_speeds_as_commanded(pair), pair.speed_step)
    if not len(live) and coarse is None:
        dead = tuple(
            RotorTelemetry(rotor=i + 1, state="dead") for i in range(pair.command.shape[1])
        )
        sentences = (
            "none of the measured rotor speeds changes together with a command while the motors "
            "turn: the ESC telemetry is dead, or the commands are"
        )
        return Telemetry(seconds=seconds, lateness=None, rotors=dead, doubts=(sentences,))
    if coarse is not None:
        every = (RotorTelemetry(rotor=i + 1, state="coarse") for i in range(pair.speed.shape[1]))
        return Telemetry(seconds=seconds, lateness=None, rotors=tuple(every), doubts=(coarse,))
    commands = _band_pass(pair.command[:, live], pair.rate)
    speeds = _band_pass(pair.speed[:, live], pair.rate)
    by_shift = _correlate_shifted(commands, speeds, pair)
    shift = _find_lateness(by_shift)
    late = advance_samples(speeds, shift)
    found = {one.rotor: one for one in _judge_live_rotors(pair, commands, late, by_shift, shift)}
    rotors = [
        found.get(i, RotorTelemetry(rotor=i, state=_dead_state(pair, i - 1)))
        for i in range(1, pair.command.shape[1] + 1)
    ]
    goes = float(by_shift[shift].max()) > NOTHING
    return Telemetry(
        seconds=seconds,
        lateness=shift / pair.rate if goes else None,
        rotors=tuple(rotors),
        doubts=tuple(_explain_telemetry(rotors, pair)),
    )


def _speeds_as_commanded(pair: TelemetryPair) -> Float[np.ndarray, "n N"]:
    """Return the speeds of turning motors; one that never changes moves as its command does.

    Steps that are wider than a speed's motion hide it, and a speed moves at most in proportion to
    its command.
    """
    speed, command = pair.speed[pair.used], pair.command[pair.used]
    if not len(speed):
        return speed
    still = (np.ptp(speed, axis=0) == 0.0) & (speed[0] > 0.0) & (command.mean(axis=0) > 0.0)
    speed[:, still] *= command[:, still] / command[:, still].mean(axis=0)
    return speed


def _dead_state(pair: TelemetryPair, i: int) -> State:
    """Return which of a rotor's two channels never changes: its speed, or its command alone."""
    speed = pair.speed[pair.used, i]
    return "still" if np.isfinite(speed).all() and float(np.ptp(speed)) > 0.0 else "dead"


def _judge_live_rotors(
    pair: TelemetryPair,
    commands: Float[np.ndarray, "n k"],
    late: Float[np.ndarray, "n k"],
    by_shift: dict[int, Float[np.ndarray, "k k"]],
    shift: int,
) -> Iterator[RotorTelemetry]:
    """Judge the rotors whose command and speed change; `late`: speeds advanced by the shift."""
    live, used, alike = pair.live, pair.used, by_shift[shift]
    of_differences = _correlate_columns(
        _differences_from_mean(commands[used]), _differences_from_mean(late[used])
    )
    best = _assign_speeds(of_differences if len(live) > 2 else alike)
    moving = commands[used].std(axis=0) > MOVES
    swapped = live[best != np.arange(len(live))]
    ratios = {} if len(swapped) else speed_ratios(pair, shift)
    later = _later_than_others(by_shift) / pair.rate
    # Beside a swapped pair a rotor's own time is compared with times of other rotors.
    later[(np.abs(later) < LATER) | (len(swapped) > 0)] = 0.0
    for k, i in enumerate(live.tolist()):
        own, ratio, stuck = float(alike[k, k]), ratios.get(i), _stuck_share(pair, i)
        known = of_differences[k, best[k]] > CLEAR or alike[k, best[k]] > CLEAR
        yield RotorTelemetry(
            rotor=i + 1,
            state=_rotor_state(
                own, i in swapped, stuck, ratio, float(later[k]), moves=bool(moving[k])
            ),
            correlation=own,
            speed_channel=int(live[best[k]]) + 1 if known else None,
            ratio=None if ratio is None else ratio[0],
            stuck=stuck,
            later=float(later[k]),
        )


def _rotor_state(
    own: float,
    is_swapped: bool,
    stuck: float,
    ratio: tuple[float, float] | None,
    later: float,
    *,
    moves: bool,
) -> State:
    if is_swapped:
        return "swapped"
    unlike = ratio is not None and is_unlike(*ratio)
    if stuck > LEAST_STUCK:
        # What it reads when it reads anything is the graver fault: no stretch of it can be used.
        return "unlike" if unlike else "stuck"
    if own < NOTHING and later == 0.0:
        return "apart" if moves else "unclear"
    if unlike:
        return "unlike"
    if later != 0.0:
        return "late"
    return "follows" if own > CLEAR else "unclear"


def _band_pass(values: Float[np.ndarray, "n k"], rate: float) -> Float[np.ndarray, "n k"]:
    low, high = BAND
    slow = values - smooth(values, rate, low)
    return smooth(slow, rate, high) if high < 0.4 * rate else slow


def _correlate_shifted(
    commands: Float[np.ndarray, "n k"], speeds: Float[np.ndarray, "n k"], pair: TelemetryPair
) -> dict[int, Float[np.ndarray, "k k"]]:
    """Correlate commands with speeds that are advanced, by the samples of the advance."""
    first, last = (round(bound * pair.rate) for bound in LATE)
    used = pair.used
    return {
        shift: _correlate_columns(commands[used], advance_samples(speeds, shift)[used])
        for shift in range(first, last + 1)
    }


def _find_lateness(by_shift: dict[int, Float[np.ndarray, "k k"]]) -> int:
    """Find the samples by which the speeds are later, whichever belongs to which."""
    scores = {shift: float(alike.max(axis=0).mean()) for shift, alike in by_shift.items()}
    return max(scores, key=lambda shift: (scores[shift], -abs(shift)))


def _later_than_others(
    by_shift: dict[int, Float[np.ndarray, "k k"]],
) -> Float[np.ndarray, " k"]:
    """Find by how many samples each speed is later than the others; 0 where that is not clear."""
    own = np.stack([np.diagonal(alike) for alike in by_shift.values()])
    shifts, count = np.array(list(by_shift)), own.shape[1]
    best = own.argmax(axis=0)
    later = np.zeros(count)
    for i in range(count if count >= FEWEST_ALIKE else 0):
        usual = int(np.median(shifts[np.delete(best, i)]))
        at, there = own[best[i], i], by_shift[usual][i, i]
        left = 1.0 - np.array([at, there]) ** 2
        if at > CLEAR and left[0] < CLEARER * left[1]:
            later[i] = shifts[best[i]] - usual
    return later


def _correlate_columns(
    a: Float[np.ndarray, "n k"], b: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "k k"]:
    """Correlate every column with every other's, 0 if one is constant."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    sizes = np.outer(np.sqrt((a * a).sum(axis=0)), np.sqrt((b * b).sum(axis=0)))
    return (a.T @ b) / np.where(sizes > 0.0, sizes, np.inf)


def _differences_from_mean(values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """Subtract the mean of all rotors: thrust moves them all alike."""
    size = values.std(axis=0)
    even = values / np.where(size > 0.0, size, 1.0)
    return even - even.mean(axis=1, keepdims=True)


def _assign_speeds(alike: Float[np.ndarray, "k k"]) -> Int[np.ndarray, " k"]:
    """Assign a speed to each command: its own, unless others do clearly better."""
    own = np.arange(len(alike))
    if len(alike) < 2:
        return own
    # The likeliest assignment leaves the least product of unexplained variances; a correlation of
    # one would leave the logarithm of nothing.
    left = 1.0 - np.clip(alike, 0.0, 0.9999) ** 2
    if (left.argmin(axis=1) == own).all():
        return own  # no assignment is better than the best of every row
    from scipy.optimize import linear_sum_assignment  # slow to import

    best: Int[np.ndarray, " k"] = linear_sum_assignment(np.log(left))[1]
    moved = best != own
    clear = (alike[own, best] > CLEAR) & (left[own, best] < CLEARER * left[own, own])
    return best if clear[moved].all() else own


def _stuck_share(pair: TelemetryPair, i: int) -> float:
    """Compute the share of time for which a speed is lost: 0, or constant unlike its command."""
    speed, command = pair.speed[:, i], pair.command[:, i]
    usual = float(command[pair.used].std())
    same = np.concatenate([np.diff(speed) == 0.0, [False]]) & pair.used
    # A coarse speed stays the same while its command moves by less than some of its steps.
    gains = (
        pair.speed[pair.used].std(axis=0)[pair.live]
        / pair.command[pair.used].std(axis=0)[pair.live]
    )
    seen = STEPS_SEEN * pair.speed_step / max(float(np.median(gains)), 1e-9)
    least = whole_samples(LONGEST_CONSTANT * pair.rate)
    # Telemetry that is lost for moments reads 0 for less than a run of constant values; a rotor at
    # no less than half of its usual command turns.
    lost = pair.used & (speed == 0.0) & (command > 0.5 * float(np.median(command[pair.used])))
    for a, b in true_runs(same):
        if b - a > least and command[a:b].std() > max(0.3 * usual, seen, 1e-3):
            lost[a:b] = True
    return int(lost.sum()) / max(int(pair.used.sum()), 1)


def _explain_telemetry(rotors: list[RotorTelemetry], pair: TelemetryPair) -> list[str]:
    sentences = [_dead_message(r, pair) for r in rotors if r.state in ("dead", "still")]
    swapped = [r for r in rotors if r.state == "swapped"]
    if swapped:
        pairs = ", ".join(f"command {r.rotor} moves speed {r.speed_channel}" for r in swapped)
        sentences.append(
            f"the measured rotor speeds are in another order than the commands: {pairs}; correct "
            "the order of the ESC telemetry (wires or mapping), or name the columns in order"
        )
    uncorrelated = [r for r in rotors if r.state == "apart"]
    if len(uncorrelated) > 1 and len(uncorrelated) == len(pair.live):
        sentences.append(
            "the measured rotor speeds match no command (correlations up to "
            f"{max(r.correlation or 0.0 for r in uncorrelated):.2f}): they are not of these "
            "motors, or on another clock"
        )
    else:
        sentences += [
            f"the measured speed of rotor {r.rotor} does not follow its command (correlation "
            f"{r.correlation or 0.0:.2f}): check its ESC telemetry"
            for r in uncorrelated
        ]
    sentences += [
        f"the measured speed of rotor {r.rotor} is stuck or zero for {100.0 * r.stuck:.0f} % of "
        "the time while the rotor turns: its ESC telemetry is stuck or lost"
        for r in rotors
        if r.state == "stuck"
    ]
    sentences += [late_speed_sentence(r) for r in rotors if r.state == "late"]
    sentences += [
        f"rotor {r.rotor} turns at {r.ratio:.2f} times the speed of the others at the same "
        "command: another number of poles, another propeller or motor, or a damaged one"
        f"{_stuck_too(r)}"
        for r in rotors
        if r.state == "unlike"
    ]
    return sentences


def late_speed_sentence(rotor: RotorTelemetry) -> str:
    """State how late a rotor's speed is beside the others', and what to do."""
    when = "later" if rotor.later > 0.0 else "earlier"
    return (
        f"the measured speed of rotor {rotor.rotor} comes {1e3 * abs(rotor.later):.0f} ms {when} "
        "than those of the other rotors: log all of them at the same rate, or take the commands "
        '(speed = "commanded" under [motors])'
    )


def _stuck_too(rotor: RotorTelemetry) -> str:
    if rotor.stuck <= LEAST_STUCK:
        return ""
    return f"; besides, it is stuck or zero for {100.0 * rotor.stuck:.0f} % of the time"


def _dead_message(rotor: RotorTelemetry, pair: TelemetryPair) -> str:
    speed = pair.speed[pair.used, rotor.rotor - 1]
    command = pair.command[pair.used, rotor.rotor - 1]
    if not np.isfinite(speed).any():
        return f"the measured speed of rotor {rotor.rotor} has no values: its ESC sends nothing"
    if float(np.ptp(speed)) == 0.0:
        return (
            f"the measured speed of rotor {rotor.rotor} is {speed[0]:g} rad/s throughout while "
            "the motors turn: its ESC telemetry is dead"
        )
    what = f"{command[0]:g} throughout" if np.isfinite(command).any() else "never there"
    return (
        f"the command of rotor {rotor.rotor} is {what} though its speed changes: another "
        "output drives this motor"
    )
