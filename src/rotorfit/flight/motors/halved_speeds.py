"""Tell a measured speed that is halved or doubled in stretches from one that came too slowly."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Float

NEAR: Final = 0.2
"""Distance of a jump between two samples from a factor of two, in octaves: no rotor makes it."""
FEWEST: Final = 5
"""Jumps each way."""


def halved_speed_sentence(speed: Float[np.ndarray, "n N"]) -> str | None:
    """Say which measured speed jumps to half of itself and back; None if none does."""
    for rotor, column in enumerate(speed.T, start=1):
        with np.errstate(divide="ignore", invalid="ignore"):
            octaves = np.diff(np.log2(np.maximum(column, 0.0)))
        down = np.flatnonzero(np.abs(octaves + 1.0) < NEAR)
        up = np.flatnonzero(np.abs(octaves - 1.0) < NEAR)
        if min(len(down), len(up)) < FEWEST:
            continue
        ends = up[np.minimum(np.searchsorted(up, down), len(up) - 1)]
        share = float(np.maximum(ends - down, 0).sum()) / len(column)
        return (
            f"the measured speed of rotor {rotor} jumps to half of itself and back {len(down)} "
            f"times, and is low for {100.0 * share:.0f} % of the time: repair its ESC telemetry, "
            'or take the commands instead ([motors] speed = "commanded")'
        )
    return None
