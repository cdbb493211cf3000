"""State where a log hovers on another thrust than in the part that is used."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from rotorfit.findings import Finding
from rotorfit.model.parameters import EVERY

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rotorfit.fit.fit import Fit
    from rotorfit.flight.prepare import PreparedFlight

KIND: Final = "hovers-contradict"
NUMBERS: Final = (
    *(name for name, info in EVERY.items() if info.mass_power),
    *("hover_throttle", "thrust_to_weight", "max_thrust", "hover_speed"),
    *("max_thrust_loaded", "thrust_to_weight_loaded"),
)
"""What another load, or a thrust that changed, changes."""
SEPARATE_PARTS: Final = (
    "identify one part with --start and --end and the mass that it flew with, or both as two "
    "configurations with a mass each"
)


def left_out_hovers(fit: Fit) -> Iterator[Finding]:
    """Check that no flight leaves a hover out that contradicts it."""
    for flight in fit.dataset.flights:
        yield from contradicting_hovers(flight.prepared, Path(flight.entry.file).name)


def contradicting_hovers(prepared: PreparedFlight, file: str) -> Iterator[Finding]:
    """Yield that a log hovers on two thrusts, with the seconds of both."""
    hovers, data = prepared.other_hovers, prepared.data
    if not hovers:
        return
    begin = float(data.time[0])
    used = [(data.time[s.start] - begin, data.time[s.stop - 1] - begin) for s in data.segments]
    seconds = sum(end - start for start, end in used)
    longest = max(hovers, key=lambda one: one.seconds)
    share = 100.0 * abs(longest.thrust - 1.0)
    way = "less" if longest.thrust < 1.0 else "more"
    left = ", ".join(f"{one.start:.0f} to {one.end:.0f} s" for one in hovers)
    yield Finding(
        kind=KIND,
        severity="doubt",
        sentence=(
            f"{file}: {seconds:.0f} s are used ({used[0][0]:.0f} to {used[-1][1]:.0f} s) and "
            f"{sum(one.seconds for one in hovers):.0f} s of hover are not ({left}), because there "
            f"the same motor data mean {share:.0f} % {way} thrust: another payload or battery, or "
            f"the ground carries part of the weight; {SEPARATE_PARTS}"
        ),
        flights=(file,),
        numbers=NUMBERS,
        doubtful_because=f"another part of the log hovers on {share:.0f} % {way} thrust",
        next_step=SEPARATE_PARTS,
    )


CHECKS: Final = (left_out_hovers,)
