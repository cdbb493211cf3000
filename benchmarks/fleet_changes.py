"""How often is a change seen in flights of a vehicle, and how often one that is not there?

    python -m benchmarks.fleet_changes [--sets 400] [--alarm 0.0028]

Each set is drawn anew: one number of one or eight vehicles, flights with unlike deviations, and
a scatter between flights that is none, as large, or all there is; the first vehicle steps, drifts,
has one strange flight, or a step and a strange flight. Sizes are in deviations of one flight.
The alarm is that of one series; 5 % of a fleet with eighteen series by default.
"""

import argparse
from collections import Counter
from collections.abc import Iterable
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.tools.fleet.changes import Change, find_changes

SETS: Final = ((6, 1), (13, 1), (25, 1), (12, 8))
"""Flights of a vehicle, and vehicles."""
SCATTER: Final = {"stated": (1.0, 0.0), "half": (0.7, 0.7), "not stated": (0.0, 1.0)}
"""Deviations that flights state, and between flights beyond."""
KINDS: Final = {
    "nothing": (0.0,),
    "step": (4.0, 6.0, 9.0),
    "drift": (6.0, 9.0),
    "outlier": (6.0, 9.0),
    "step and outlier": (9.0,),
}
UNEVEN: Final = 0.6
"""Of the logarithm of stated variances."""


def planted(kind: str, size: float, n: int, first: int) -> Float[np.ndarray, " n"]:
    """Return what the first vehicle's flights have beside their level."""
    j = np.arange(n)
    step, strange = size * (j >= first), size * (j == (first + 3) % n)
    shapes = {
        "nothing": np.zeros(n),
        "step": step,
        "drift": size * j / (n - 1.0),
        "outlier": size * (j == first),
        "step and outlier": step + strange,
    }
    return np.asarray(shapes[kind], dtype=float)


def drawn(
    rng: np.random.Generator,
    shape: Float[np.ndarray, " n"],
    vehicles: int,
    scatter: str,
    alarm: float,
) -> tuple[tuple[Change, ...], bool]:
    """Draw one set; return the first vehicle's changes, and whether another is said to have any."""
    n = len(shape)
    stated, beyond = SCATTER[scatter]
    variance = stated**2 * np.exp(rng.normal(0.0, UNEVEN, n * vehicles))
    values = 10.0 * np.repeat(rng.standard_normal(vehicles), n)
    values += np.sqrt(variance + beyond**2) * rng.standard_normal(n * vehicles)
    values[:n] += shape
    found = find_changes(values, variance, np.repeat(np.arange(vehicles), n), alarm=alarm).of_group
    return found[0], any(found[1:])


def line(
    kind: str, size: float, n: int, vehicles: int, scatter: str, sets: int, alarm: float
) -> str:
    """Return one row: what was said of the vehicle, falsely of the others, and whether it held."""
    said, others, held, dated, steps = Counter[str](), 0, 0, 0, 0
    for seed in range(sets):
        rng = np.random.default_rng([seed, n, vehicles])
        first = int(rng.integers(2, n - 2))
        changes, other = drawn(rng, planted(kind, size, n, first), vehicles, scatter, alarm)
        said["+".join(sorted(change.kind for change in changes)) or "-"] += 1
        others += other
        for change in changes:
            if kind == "step" == change.kind:
                steps += 1
                held += change.low <= size <= change.high
                dated += change.earliest <= first <= change.latest
    shares = ", ".join(f"{name} {100 * count / sets:.1f}" for name, count in said.most_common(4))
    truth = f"; size held {held / steps:.2f}, date {dated / steps:.2f}" if steps else ""
    falsely = f"; of others {100 * others / sets:.1f}" if vehicles > 1 else ""
    return (
        f"{kind:16s} {size:4.0f}  {n:3d} x {vehicles}  {scatter:10s}  [%] {shares}{falsely}{truth}"
    )


def rows(sets: int, alarm: float) -> Iterable[str]:
    """Yield the table."""
    for kind, sizes in KINDS.items():
        for size in sizes:
            for n, vehicles in SETS:
                for scatter in SCATTER:
                    yield line(kind, size, n, vehicles, scatter, sets, alarm)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=400)
    parser.add_argument("--alarm", type=float, default=0.05 / 18)
    asked = parser.parse_args()
    for row in rows(asked.sets, asked.alarm):
        print(row, flush=True)


if __name__ == "__main__":
    main()
