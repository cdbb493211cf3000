r"""The thrust that carries the weight in a flight that gaps tear into pieces of a second or two.

In a piece so short an unknown change of velocity looks like gravity, so that no piece is weighed by
itself. All of a flight are weighed together: the accelerometer's bias is the same in every one, and
only what is each piece's own (the velocity, where it is logged, and what thrust leaves unexplained)
averages out over them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.distributions import student_quantile
from rotorfit.estimation.measured import Measured
from rotorfit.fit.dataset.weight_balance import VELOCITY_CHANGE, Held
from rotorfit.flight.airborne import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rotorfit.fit.dataset.vertical_motion import VerticalMotion


def needed_of_pieces(
    pieces: Sequence[VerticalMotion], *, bias: Measured, velocity_std: float
) -> Iterator[Held]:
    """Yield by what factor a push [m/s^2] carries the weight over all pieces, as one `ratio`.

    `bias`: of the accelerometer along the vertical [m/s^2]; `velocity_std`: of the velocity, where
    the log has it [m/s].
    """
    seconds = np.array([piece.seconds for piece in pieces])
    share = seconds / seconds.sum()
    read = np.array([piece.weights @ piece.read for piece in pieces])
    push = np.array([piece.weights @ piece.push for piece in pieces])
    pushed = float(share @ push)
    felt = Measured(value=float(share @ read) - GRAVITY - bias.value, std=bias.std)
    gained = _logged_acceleration(pieces, velocity_std).reconciled_with(felt)
    needed = GRAVITY + gained.value
    if pushed <= 0.0 or needed <= 0.0:
        return
    left = share * (read - push * float(share @ read) / pushed)
    few = float(student_quantile(0.975, len(pieces) - 1)) / 1.96
    scatter = few * float(np.sqrt(left @ left * len(pieces) / (len(pieces) - 1)))
    std = float(np.hypot(gained.std, scatter)) / pushed
    yield Held(ratio=needed / pushed, std=std, seconds=float(seconds.sum()))


def _logged_acceleration(pieces: Sequence[VerticalMotion], velocity_std: float) -> Measured:
    """Estimate the mean vertical acceleration by the velocity: logged, or a usual one [m/s^2]."""
    seconds = np.array([piece.seconds for piece in pieces])
    share = seconds / seconds.sum()
    unsure = float(np.linalg.norm([w * p.slope_std for w, p in zip(share, pieces, strict=True)]))
    slopes = [
        float(p.weights @ np.gradient(p.velocity, p.step)) for p in pieces if p.velocity is not None
    ]
    if len(slopes) == len(pieces):
        return Measured(value=float(share @ slopes), std=velocity_std * unsure)
    # What the velocity gains along two horizontal axes lengthens the mean force of each piece.
    sideways = np.array([VELOCITY_CHANGE * p.slope_std for p in pieces])
    longer = float(share @ sideways**2) / GRAVITY
    return Measured(value=0.0, std=float(np.hypot(VELOCITY_CHANGE * unsure, longer)))
