"""The windows of a flight whose spectra are looked at, and their transform."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jaxtyping import Complex, Float

    from rotorfit.flight.flight_data import FlightData

WINDOW: Final = 2.0
"""Length of a window, each overlapping the next by half [s]."""


def transform_rows(
    rows: Float[np.ndarray, "n k"], window: Float[np.ndarray, "n 1"]
) -> Complex[np.ndarray, "l k"]:
    """Transform the rows of a window, without their mean."""
    return np.fft.rfft((rows - rows.mean(axis=0)) * window, axis=0)


def window_starts(data: FlightData, rows: int) -> Iterator[int]:
    """Yield the first rows of windows that overlap by half, in every segment."""
    for segment in data.segments:
        yield from range(segment.start, segment.stop - rows + 1, rows // 2)
