"""State that a recorder lost samples again and again in flight."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rotorfit.findings import Evidence, Finding, doubt

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rotorfit.flight.clocks import UniformChannels

GAPS: Final = "many-gaps"
"""Kind of the finding that samples are missing again and again."""
LEAST_RATE: Final = 0.1
"""Gaps a second of flight from which it is said: sound logs have up to 0.01."""
LEAST_SHARE: Final = 0.01
"""Share of the flight that they take at least."""
FEWEST: Final = 3
"""Gaps, from which it is more than one accident."""


def many_gaps(uniform: UniformChannels, flights: Sequence[tuple[int, int]]) -> Iterator[Finding]:
    """Yield a doubt if gaps cut a flight into short pieces."""
    time = uniform.time
    begin, end = float(time[flights[0][0]]), float(time[flights[-1][1] - 1])
    lost = sorted((a, b) for a, b, _ in uniform.gaps if a >= begin and b <= end)
    gaps = _join_overlapping(lost)
    seconds = sum(b - a for a, b in gaps)
    if len(gaps) < max(FEWEST, LEAST_RATE * (end - begin)) or seconds < LEAST_SHARE * (end - begin):
        return
    names = " and ".join(sorted({name for _, _, name in uniform.gaps}))
    longest = max(b - a for a, b in flights) / uniform.sample_rate
    yield doubt(
        GAPS,
        f"{len(gaps)} gaps ({names}) of {seconds / len(gaps):.2g} s each, {seconds:.1f} s "
        f"together, cut the flight into pieces of up to {longest:.1f} s, first at "
        f"{gaps[0][0] - time[0]:.1f} s: the recorder dropped samples, which tells less of the "
        "weight and of slow motion; log to a faster card, fewer topics or at a lower rate",
        evidence=(Evidence(name="gaps", value=float(len(gaps))),),
    )


def _join_overlapping(gaps: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Join gaps of several channels that overlap; `gaps` in their order."""
    joined: list[tuple[float, float]] = []
    for a, b in gaps:
        if joined and a <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(joined[-1][1], b)
        else:
            joined.append((a, b))
    return joined
