"""Samples whose times are those of their arrival: several at once, or each late by chance.

A network, a serial line or a recorder that stamps messages when it gets them bunches samples that
were taken at a steady rate. Their times then differ by much less, or much more, than a step, but
lateness does not add up: over many steps time passes evenly. Where samples are lost it does not.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.findings import Finding, doubt
from rotorfit.flight.signals import running_mean
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from jaxtyping import Float

    from rotorfit.logs.flight_log import Channel

ARRIVAL: Final = "arrival-times"
"""Kind of the finding that a channel has the times at which its samples arrived."""
SPAN: Final = 64
"""Samples over which lateness must cancel: bunches of up to a quarter of it are evened out."""
FEWEST_SPANS: Final = 24
"""Spans of a log below which lateness may seem to cancel by chance: of samples lost at random, 24
have less than `CANCELLED` of the variance once in 10 000 logs."""
QUICK: Final = 0.5
"""Share of the mean step, under which half of the steps are: samples that a recorder lost at
random leave longer steps only, and the half are whole ones."""
TORN: Final = 0.5
"""Steps of over `LONG_STEP` usual ones a second, from which a log seems to have gaps all over.
Three such channels leave pieces of two thirds of a second."""
LONG_STEP: Final = 2.5
ON_GRID: Final = 0.9
"""Share of the steps that are whole numbers of the usual one, to a tenth, where rows are left out
by a pattern and the times are right: of late samples it is a half or less."""
CANCELLED: Final = 0.1
"""Variance of the time of `SPAN` steps over that of as many steps of chance, below which lateness
cancels: it is 1 of samples lost at random, and 1/64 to 1/16 of late ones. Of 600 made logs with
.2 to 10 losses a second, of up to 20 samples and with jitter up to .2 steps, none is below."""
PAUSE: Final = 0.5
"""A step longer than so many times the mean time of `SPAN` samples is a pause of the recorder."""
WORDS: Final = {
    "gyro": "gyro", "accel": "accelerometer", "rotor_speed": "rotor speeds", "command": "commands",
}  # fmt: skip


@frozen_dataclass
class Arrivals:
    """Samples in bunches.

    - `step`: in which they were taken, on average [s].
    - `late`: by how much the latest of a bunch came, as a rule [s].
    - `time`: at which they were taken, but for a delay common to all [s].
    """

    step: float
    late: float
    time: Float[np.ndarray, " n"]


def find_arrivals(t: Float[np.ndarray, " n"]) -> Arrivals | None:
    """Find rising times that are those of arrivals, and even them out; None if they are not."""
    steps = np.diff(t)
    if len(t) < FEWEST_SPANS * SPAN:
        return None
    spans = t[SPAN:] - t[:-SPAN]
    step = float(np.median(spans)) / SPAN
    if float(np.median(steps)) >= QUICK * step and not _is_torn(steps, float(t[-1] - t[0])):
        return None
    longest = PAUSE * SPAN * step
    chance = SPAN * float(np.var(steps[steps <= longest]))
    whole = spans <= 2.0 * SPAN * step
    if float(np.var(spans[whole])) > CANCELLED * chance:
        return None
    time = np.array(t)
    edges = [0, *(np.flatnonzero(steps > longest) + 1).tolist(), len(t)]
    late: list[float] = []
    for a, b in pairwise(edges):
        if b - a >= 2 * SPAN:
            time[a:b], own = _even_out(t[a:b])
            late.append(own)
    return Arrivals(step=step, late=max(late), time=time) if late else None


def _is_torn(steps: Float[np.ndarray, " m"], seconds: float) -> bool:
    """Return whether long steps are all over a log, and no row between was left out."""
    usual = steps / float(np.median(steps))
    if np.count_nonzero(usual > LONG_STEP) <= TORN * seconds:
        return False
    whole = np.abs(usual - np.maximum(np.rint(usual), 1.0)) < 0.1
    return float(np.mean(whole)) < ON_GRID


def _even_out(t: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], float]:
    """Return times of a steady rate, before which no sample arrived, and the usual lateness."""
    line = np.linspace(float(t[0]), float(t[-1]), len(t))
    even = line + running_mean(t - line, SPAN, beyond="symmetric")
    blocks = (t - even)[: len(t) // SPAN * SPAN].reshape(-1, SPAN)
    earliest = float(np.median(blocks.min(axis=1)))
    return even + earliest, float(np.median(blocks.max(axis=1))) - earliest


def at_sampling_times(t: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the times at which samples were taken, which may have those of their arrival."""
    found = find_arrivals(t)
    return t if found is None else found.time


def _rising(time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
    """Return the times of a channel in their order, each once."""
    known = time[np.isfinite(time)]
    # As most are: to sort them would take four times as long as to look for arrivals.
    return known if (np.diff(known) > 0.0).all() else np.unique(known)


def arrival_doubts(channels: Mapping[str, Channel]) -> Iterator[Finding]:
    """Find channels of a flight that have the times of their arrival."""
    late: dict[str, float] = {}
    for name, words in WORDS.items():
        if name in channels:
            found = find_arrivals(_rising(channels[name].time))
            if found is not None:
                late[words] = found.late
    if late:
        *first, last = late
        listed = f"{', '.join(first)} and {last}" if first else last
        yield doubt(
            ARRIVAL,
            f"the {listed} have the times of their arrival, up to {1e3 * max(late.values()):.0f} "
            "ms late and several at once: their times are evened out; log the time at which each "
            "was measured (in ROS the header's stamp)",
        )
