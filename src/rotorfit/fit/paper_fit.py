"""The paper's own procedure, for the preset ``paper``: Six et al. 2020, P5-P10, P13 and P14.

Low-pass 3 Hz on every column, decimated to 8 samples per cut-off period, total least squares,
rows weighted in one pass after an unweighted solve, essential parameters with r_sigma 250, no
rotor inertia, no lag. Its standard deviations are the paper's; they do not hold, and the result
says so.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rotorfit.estimation.estimate import LinearProblem
from rotorfit.estimation.factors import stack_factors
from rotorfit.estimation.least_squares import EssentialEstimate, essential_total
from rotorfit.estimation.parameter_map import ParameterMap, parameter_map
from rotorfit.fit.reduction.frequency_bands import retimed
from rotorfit.fit.reduction.reduce import LowPass, time_factors
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import full_name

if TYPE_CHECKING:
    from rotorfit.fit.timing.timed_dataset import TimedDataset

SHARED_FREE = ("kt", "kd")
OWN_FREE = ("msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")


@frozen_dataclass
class PaperSettings:
    """What the paper chose, each of which can be overridden.

    - `cutoff`: of the low-pass [Hz].
    - `samples_per_period`: kept per cut-off period.
    - `r_sigma`: largest over smallest relative standard deviation at which elimination stops; None
      keeps every parameter.
    """

    cutoff: float = 3.0
    samples_per_period: float = 8.0
    r_sigma: float | None = 250.0


def paper_estimate(dataset: TimedDataset, *, settings: PaperSettings) -> EssentialEstimate:
    """Compute the paper's estimate of all configurations, and list the parameters it removed.

    k_t and k_d are shared, first moments and inertia are each configuration's own, and the rows of
    a configuration are multiplied by its weight k_w (Six et al. 2020, eq. 24, 25).
    """
    lowpass = LowPass(cutoff=settings.cutoff, samples_per_period=settings.samples_per_period)
    factors = [
        stack_factors(
            [
                time_factors(retimed(f.prepared, dataset.timing), dataset.vehicle, lowpass=lowpass)
                for f in c.flights
            ]
        ).merged()
        for c in dataset.configurations
    ]
    count = len(dataset.configurations)
    problem = LinearProblem(
        factors=tuple(factors),
        tensors=(dataset.model.tensor,) * count,
        map=_paper_map(dataset),
        weights=np.array([np.full(6, c.entry.weight) for c in dataset.configurations]),
    )
    return essential_total(problem, r_sigma=settings.r_sigma or np.inf)


def _paper_map(dataset: TimedDataset) -> ParameterMap:
    """Return the map: coefficients shared, the body's parameters by configuration."""
    everywhere = range(len(dataset.configurations))
    free = {name: {(c, name): 1.0 for c in everywhere} for name in SHARED_FREE}
    for c, configured in enumerate(dataset.configurations):
        free |= {full_name(name, configured.entry.name): {(c, name): 1.0} for name in OWN_FREE}
    masses = {(c, "mass"): configured.mass for c, configured in enumerate(dataset.configurations)}
    return parameter_map(
        dataset.model.names, free, masses, configurations=len(dataset.configurations)
    )
