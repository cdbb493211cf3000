"""The paper's own procedure, for the preset ``paper``: Six et al. 2020, P5-P10 and P13.

Low-pass 3 Hz on every column, decimated to 8 samples per cut-off period, total least squares,
rows weighted in one pass after an unweighted solve, essential parameters with r_sigma 250, no
rotor inertia, no lag. Its standard deviations are the paper's; they do not hold, and the result
says so.
"""

from dataclasses import dataclass

import numpy as np

from rotorfit.estimation.estimate import Estimate, LinearProblem
from rotorfit.estimation.factors import stack_factors
from rotorfit.estimation.parameter_map import parameter_map
from rotorfit.estimation.total import EssentialEstimate, essential_total, relative_std
from rotorfit.identification.flights import UsedFlight
from rotorfit.model.reduce import LowPass, time_factors
from rotorfit.model.regressor import Regressor
from rotorfit.model.vehicle import Vehicle

FREE = ("kt", "kd", "msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperSettings:
    """What the paper chose, each of which can be overridden.

    Attributes
    ----------
    cutoff
        Of the low-pass [Hz].
    samples_per_period
        Kept per cut-off period.
    r_sigma
        Largest over smallest relative standard deviation at which elimination stops; None keeps
        every parameter.
    """

    cutoff: float = 3.0
    samples_per_period: float = 8.0
    r_sigma: float | None = 250.0


def paper_estimate(
    flights: list[UsedFlight],
    vehicle: Vehicle,
    model: Regressor,
    *,
    mass: float,
    settings: PaperSettings,
) -> EssentialEstimate:
    """Return the paper's estimate of one configuration, and what it removed."""
    lowpass = LowPass(cutoff=settings.cutoff, samples_per_period=settings.samples_per_period)
    parts = [time_factors(f.prepared.data, vehicle, lowpass=lowpass) for f in flights]
    problem = LinearProblem(
        factors=(stack_factors(parts).merged(),),
        tensors=(model.tensor,),
        map=parameter_map(
            model.names, {name: {(0, name): 1.0} for name in FREE}, {(0, "mass"): mass}
        ),
        weights=np.ones((1, 6)),
    )
    return essential_total(problem, r_sigma=settings.r_sigma or np.inf)


def paper_percent(estimate: Estimate) -> dict[str, float]:
    """Return %sigma of each parameter, as the paper's tables give it (eq. 22)."""
    percent = 100.0 * relative_std(estimate)
    return dict(zip(estimate.names, percent.tolist(), strict=True))
