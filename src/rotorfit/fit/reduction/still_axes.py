"""Find stretches in which an axis of the accelerometer stands still on a step of its log.

Where motion and noise are less than half a step, a log repeats one value. Its errors are up to half
a step and do not average out; but they look like none, and a likelihood that takes the noise of
each stretch from its errors would believe that value without end.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.fit.reduction.frequency_bands import banded_data
from rotorfit.fit.reduction.reduce import stretches_with_bands

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

    from rotorfit.flight.prepare import PreparedFlight

STILL: Final = 1e-3
"""Deviation of an axis in a stretch, over that in its liveliest one, below which it is still: what
filters leave of steps before and after. The noise of a sensor, .02 m/s^2, is more of any motion."""


def still_axes(prepared: PreparedFlight) -> Bool[np.ndarray, "s 3"]:
    """Mark the axes of the accelerometer that are still, for each stretch that has bands."""
    data = prepared.data
    made_of = (data.specific_force, prepared.phases)
    return data.of_motion("still axes", made_of, lambda: _find_still_axes(prepared))


def _find_still_axes(prepared: PreparedFlight) -> Bool[np.ndarray, "s 3"]:
    data, plan = banded_data(prepared, None)
    stretches = stretches_with_bands(data, plan)
    each = [data.specific_force[one.start : one.stop].std(axis=0) for one in stretches]
    moved: Float[np.ndarray, "s 3"] = np.array(each).reshape(-1, 3)
    return moved < STILL * moved.max(axis=0, initial=0.0)
