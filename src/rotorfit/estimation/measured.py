r"""Measured numbers with deviations, and how two measurements of one number are combined.

A coefficient such as k_t is a scale: measurements are off by a factor. Averaged by their absolute
variances, an estimate near zero, whose absolute deviation is small because the estimate is small,
outvotes a sound one. `combine_scales` therefore averages logarithms, by the relative deviations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Float

CHANCE: Final = 2.0
DOUBTED: Final = 2.58
"""Deviations by which two sound measurements differ once in 22 and once in 100 times: from the
second on an interval reaches both, whichever is wrong."""
CONTRADICTION: Final = 5.0
"""Deviations apart from which two measurements contradict each other: twice in a million by chance.
Then no mean of the two is right, and the second fades out; at twice as many it is gone."""


@frozen_dataclass
class Measured:
    """A measured number and its standard deviation."""

    value: float
    std: float

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval."""
        return self.value - 1.96 * self.std, self.value + 1.96 * self.std

    @property
    def share(self) -> float:
        """The standard deviation over the value."""
        return self.std / abs(self.value)

    def over(self, other: Measured) -> Measured:
        """Divide by an independent measurement of another number."""
        ratio = self.value / other.value
        std = abs(ratio) * float(np.hypot(self.share, other.share))
        return Measured(value=ratio, std=std)

    def with_other(self, other: Measured) -> Measured:
        """Combine two independent measurements of one number."""
        own, theirs = self.std**-2.0, other.std**-2.0
        value = (own * self.value + theirs * other.value) / (own + theirs)
        return Measured(value=value, std=(own + theirs) ** -0.5)

    def reconciled_with(self, other: Measured) -> Measured:
        """Combine two, of which one may be wrong: their difference scales the deviation.

        References
        ----------
        Birge, Phys. Rev. 40, 1932.
        """
        both = self.with_other(other)
        off = abs(self.value - other.value) / float(np.hypot(self.std, other.std))
        return Measured(value=both.value, std=both.std * max(off, 1.0))


def combine_scales(first: Measured, second: Measured) -> Measured:
    """Combine two measurements of one scale (a positive number), of which one may be wrong.

    The mean of the logarithms, weighted by the relative deviations, whose deviation grows with
    their difference (Birge 1932). From `DOUBTED` deviations on its 95 % interval reaches both.
    Beyond `CONTRADICTION` the second fades out, and the first remains.

    Parameters
    ----------
    first
        The one that remains where the two contradict each other; positive.
    second
        One that is not positive measures no scale, and counts as infinitely far.
    """
    deviations = scale_deviations(first, second)
    if not second.value > 0.0:
        faded = Measured(value=first.value, std=max(first.std, first.value / 1.96))
        return faded if deviations > CONTRADICTION else first
    difference = float(np.log(second.value / first.value))
    kept = float(np.clip(2.0 - deviations / CONTRADICTION, 0.0, 1.0))
    own, theirs = first.share**-2.0, second.share**-2.0
    moved = kept * theirs / (own + theirs)
    value = first.value * float(np.exp(moved * difference))
    chance = (own + theirs) ** -0.5 * (1.0 + kept * (max(deviations, 1.0) - 1.0))
    wrong = float(np.clip((deviations - CHANCE) / (DOUBTED - CHANCE), 0.0, 1.0))
    reach = wrong * max(moved, 1.0 - moved) * abs(difference) / 1.96
    return Measured(value=value, std=value * float(np.hypot(chance, reach)))


def scale_deviations(first: Measured, second: Measured) -> float:
    """Compute how many deviations two measurements of one scale differ by, in logarithms."""
    # Of a second one that is not positive, in proportion to the first.
    if not second.value > 0.0:
        return (first.value - second.value) / float(np.hypot(first.std, second.std))
    difference = abs(float(np.log(second.value / first.value)))
    return difference / float(np.hypot(first.share, second.share))


def mean_scale(measured: Sequence[Measured], *, spread: float = 0.0) -> Measured:
    """Average measurements of one scale: the mean of their logarithms by relative deviations.

    `spread`: relative deviation between what they measure, beside their own.
    """
    logs = np.log([one.value for one in measured])
    weight = 1.0 / (np.square([one.share for one in measured]) + spread**2)
    value = float(np.exp(weight @ logs / weight.sum()))
    return Measured(value=value, std=value * float(weight.sum()) ** -0.5)


def change_of_means(
    before: Float[np.ndarray, "n *k"], after: Float[np.ndarray, "m *k"]
) -> tuple[Float[np.ndarray, "*k"], Float[np.ndarray, "*k"]]:
    """Return by how much a mean changes between values, and its deviation by the scatter of both.

    References
    ----------
    Student, Biometrika 6, 1908.
    """
    n, m = len(before), len(after)
    scatter = (n * before.var(axis=0) + m * after.var(axis=0)) / (n + m - 2)
    change = after.mean(axis=0) - before.mean(axis=0)
    return np.asarray(change), np.asarray(np.sqrt(scatter * (1.0 / n + 1.0 / m)))
