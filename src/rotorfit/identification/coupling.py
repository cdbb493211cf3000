"""Do roll, pitch and yaw act on one another as those of a rigid body do?

A body that turns about two axes at once turns about the third: w x I w. Nothing else tells the
scale of the yaw equation, and with it I_zz, k_d and J_r. A simulator that turns its vehicle by
torque over inertia, axis by axis, has no such term; a fit that expects it finds the only body in
which it vanishes, with I_zz near I_xx and I_yy, and all of yaw too small.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.estimation.banded import BandedEstimate
from rotorfit.experiment.model_terms import Term
from rotorfit.fit.excitation import SCALED
from rotorfit.fit.flights import Flown
from rotorfit.fit.joint_equations import JointConfiguration
from rotorfit.fit.joint_fit import joint_fit
from rotorfit.model.parameters import INERTIA
from rotorfit.model.regressor import Regressor
from rotorfit.results.parameter_tables import Tables
from rotorfit.results.physical_inertia import taken_back

LARGEST_IZZ: Final = 1.05
"""Times the larger of I_xx and I_yy up to which the coupling is looked at: a multirotor, whose
motors stand at the ends of its arms, has 1.2 and more; a body without coupling seems to have less
than 1."""
KNOWN_IZZ: Final = 0.25
"""Deviation of I_zz, as a share, from which on the flights do not tell it by any coupling."""
AS_LIKELY: Final = 3.0
"""Of the log-likelihood, by which flights may like a coupling better that they do not show."""
WORDS: Final = (
    "this flight obeys no rigid body: where roll, pitch and yaw are flown together none acts on "
    "another (log-likelihood {gain:+.0f} without the gyroscopic terms w x I w): a simulator without "
    "them? They alone give the scale of yaw, so that Izz, kd and Jr are not given, only their "
    "ratios; on a real vehicle the gyro's axes, scale or clock would be wrong"
)
REASON: Final = "the flight shows no gyroscopic coupling, which alone gives the scale of yaw"
ADVICE: Final = (
    "take Izz or kd from elsewhere (a pendulum, a bench), or fly in a simulator with gyroscopic "
    "terms (PX4's SIH, Gazebo, MuJoCo)"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncoupled:
    """A fit without gyroscopic terms, which the flights like as well or better.

    Attributes
    ----------
    flown, fit, joint
        With the model without them.
    gain
        Of the log-likelihood, over the fit with them.
    """

    flown: Flown
    fit: BandedEstimate
    joint: list[JointConfiguration]
    gain: float


def uncoupled_fit(flown: Flown, fit: BandedEstimate, *, terms: Sequence[Term]) -> Uncoupled | None:
    """Return the fit without gyroscopic terms, where the flights show none; else None.

    Parameters
    ----------
    flown, fit
        With them.
    terms
        Of the model.
    """
    if not any(_suspicious(fit, c.entry.name) for c in flown.configurations):
        return None
    other = dataclasses.replace(flown, model=without_coupling(flown.model))
    try:
        trial, joint = joint_fit(other, terms=terms, begin=fit.estimate.by_name)
    except EstimationError:
        return None
    gain = trial.log_likelihood - fit.log_likelihood
    if gain < -AS_LIKELY:
        return None
    return Uncoupled(flown=other, fit=trial, joint=joint, gain=gain)


def _suspicious(fit: BandedEstimate, configuration: str) -> bool:
    """Return whether I_zz is told, and is that of no multirotor."""
    at = fit.estimate.by_name
    names = [f"{name}@{configuration}" for name in ("Ixx", "Iyy", "Izz")]
    if any(name not in at for name in names):
        return False  # of a payload's carrier, whose body is another's
    Ixx, Iyy, Izz = (at[name] for name in names)
    std = float(fit.estimate.std[fit.estimate.names.index(names[2])])
    told = std < KNOWN_IZZ * abs(Izz)
    return told and Izz < LARGEST_IZZ * max(Ixx, Iyy)


def without_coupling(model: Regressor) -> Regressor:
    """Return a model whose body turns by torque over inertia, without w x I w."""
    products = [i for i, n in enumerate(model.layout.names) if n in _PRODUCTS]
    inertia = [model.names.index(name) for name in INERTIA]
    tensor = model.tensor.copy()
    tensor[np.ix_(inertia, range(tensor.shape[1]), products)] = 0.0
    return dataclasses.replace(model, tensor=tensor)


_PRODUCTS: Final = ("wxwx", "wywy", "wzwz", "wxwy", "wxwz", "wywz")


def without_yaw_scale(tables: Tables, gain: float) -> Tables:
    """Return the tables without the numbers that hang on the scale of yaw, and why."""
    scaleless = taken_back(tables, lambda name, _: name in SCALED, (REASON, ADVICE))
    return dataclasses.replace(
        scaleless,
        warnings=(WORDS.format(gain=gain), *tables.warnings),
        diagnostics={**tables.diagnostics, "gain_without_coupling": gain},
    )
