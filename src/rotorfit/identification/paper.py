"""The paper's own procedure, for the preset ``paper``: Six et al. 2020, P5-P10, P13 and P14.

Low-pass 3 Hz on every column, decimated to 8 samples per cut-off period, total least squares,
rows weighted in one pass after an unweighted solve, essential parameters with r_sigma 250, no
rotor inertia, no lag. Its standard deviations are the paper's; they do not hold, and the result
says so.
"""

from dataclasses import dataclass, replace

import numpy as np

from rotorfit.estimation.estimate import LinearProblem
from rotorfit.estimation.factors import stack_factors
from rotorfit.estimation.parameter_map import ParameterMap, parameter_map
from rotorfit.estimation.total import EssentialEstimate, essential_total
from rotorfit.identification.experiment import ConfigurationEntry
from rotorfit.identification.flights import Flown, retimed
from rotorfit.identification.result import Parameter
from rotorfit.identification.tables import (
    Tables,
    full_name,
    given_parameter,
    motor_parameters,
    unit_of,
)
from rotorfit.identification.verdicts import judge, motion_for
from rotorfit.model.parameters import PARAMETERS
from rotorfit.model.reduce import LowPass, time_factors

SHARED_FREE = ("kt", "kd")
OWN_FREE = ("msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")


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


def paper_estimate(flown: Flown, *, settings: PaperSettings) -> EssentialEstimate:
    """Return the paper's estimate of all configurations together, and what it removed.

    k_t and k_d are shared, first moments and inertia are each configuration's own, and the rows of
    a configuration are multiplied by its weight k_w (Six et al. 2020, eq. 24, 25).
    """
    lowpass = LowPass(cutoff=settings.cutoff, samples_per_period=settings.samples_per_period)
    factors = [
        stack_factors(
            [
                time_factors(retimed(f.prepared, flown.timing), flown.vehicle, lowpass=lowpass)
                for f in c.flights
            ]
        ).merged()
        for c in flown.configurations
    ]
    count = len(flown.configurations)
    problem = LinearProblem(
        factors=tuple(factors),
        tensors=(flown.model.tensor,) * count,
        map=_paper_map(flown),
        weights=np.array([np.full(6, c.entry.weight) for c in flown.configurations]),
    )
    return essential_total(problem, r_sigma=settings.r_sigma or np.inf)


def _paper_map(flown: Flown) -> ParameterMap:
    """Return the map: coefficients shared, the body's parameters by configuration."""
    everywhere = range(len(flown.configurations))
    free = {name: {(c, name): 1.0 for c in everywhere} for name in SHARED_FREE}
    for c, configured in enumerate(flown.configurations):
        free |= {full_name(name, configured.entry): {(c, name): 1.0} for name in OWN_FREE}
    masses = {(c, "mass"): configured.mass for c, configured in enumerate(flown.configurations)}
    return parameter_map(flown.model.names, free, masses, configurations=len(flown.configurations))


def paper_tables(essential: EssentialEstimate, flown: Flown, *, settings: PaperSettings) -> Tables:
    """Return the tables of the paper's estimate: its values, its sigmas, what it removed."""
    estimate = essential.estimate
    entries = [configured.entry for configured in flown.configurations]
    parameters = [_paper_parameter(name, essential, entries[0]) for name in SHARED_FREE]
    if flown.motor_timing is not None:
        parameters += motor_parameters(flown.motors, flown.motor_timing)
    for entry in entries:
        own = [_paper_parameter(name, essential, entry) for name in OWN_FREE]
        parameters += [given_parameter("mass", entry.mass, entry.mass_std, entry), *own]
    return Tables(
        parameters=tuple(parameters),
        derived=(),
        covariance_names=estimate.names,
        covariance=estimate.covariance,
        settings={
            "estimator": "total least squares (Six et al. 2020, eq. 14-22)",
            "row_weights": "one pass, by wrench component",
            "cutoff": settings.cutoff,
            "samples_per_period": settings.samples_per_period,
            "r_sigma": settings.r_sigma,
            "configuration_weights": {entry.name: entry.weight for entry in entries},
            "rotor_inertia": False,
            "motor_lag": False,
            "removed_in_order": list(essential.removed),
        },
        warnings=(
            "the standard deviations are the paper's (eq. 19-21): they leave out bias and "
            "correlation between samples, and real errors are many times larger",
        ),
        diagnostics={"condition": estimate.condition_number},
    )


def _paper_parameter(
    name: str, essential: EssentialEstimate, entry: ConfigurationEntry
) -> Parameter:
    """Return one parameter with the paper's sigma, or the statement that it was removed."""
    estimate = essential.estimate
    shared = name in SHARED_FREE
    full = name if shared else full_name(name, entry)
    shown = Parameter(
        name=name,
        configuration=None if shared else entry.name,
        value=None,
        std=None,
        interval=None,
        unit=unit_of(PARAMETERS[name], entry),
        verdict="removed",
        reason="largest relative standard deviation (Six et al. 2020, III-B)",
    )
    if full not in estimate.names:
        return shown
    value = estimate.value(full)
    std = float(estimate.std[estimate.names.index(full)])
    judged = judge(value, 1.96 * std, scale=0.0, axis=motion_for(name))
    shown = replace(shown, verdict=judged.verdict, reason=judged.reason, advice=judged.advice)
    if judged.verdict == "not-identified":
        return shown
    return replace(shown, value=value, std=std, interval=(value - 1.96 * std, value + 1.96 * std))
