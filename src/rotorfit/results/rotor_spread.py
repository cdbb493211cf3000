"""Which rotors' own thrust coefficients the flights tell, and which are only what is usual.

The mixer of an ordinary multirotor moves squared speeds in four directions: thrust, roll, pitch and
yaw. Of six or eight rotors some differences are therefore never seen, and their estimate is the
assumption that rotors are equal, however narrow its interval looks.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from rotorfit.estimation.banded import BandedEstimate
from rotorfit.fit.joint.joint_map import spread_names
from rotorfit.fit.joint.joint_problem import JointConfiguration
from rotorfit.results.verdicts import Judgement

MOSTLY_ASSUMED = 0.5
"""Deviation after the flights over that before, from which a coefficient counts as assumed. A
quadrotor's are told to 0.2 of it; of six or eight rotors 0.6 and more is left at best."""


def assumed_rotors(
    fit: BandedEstimate, configurations: Sequence[JointConfiguration]
) -> dict[str, Judgement]:
    """Return the verdict on those coefficients that the flights do not tell, by name."""
    vehicle = configurations[0].vehicle
    spread = spread_names(vehicle)
    names = tuple(dict.fromkeys(spread))
    if not set(names) or not set(names) <= set(fit.estimate.names):
        return {}
    at = [fit.estimate.names.index(name) for name in names]
    after = fit.estimate.covariance[np.ix_(at, at)]
    before = np.diag([fit.problem.prior_std[name] ** 2 for name in names])
    left = np.sqrt(_own_variance(spread, names, after) / _own_variance(spread, names, before))
    grouped = any(rotor.group is not None for rotor in vehicle.rotors)
    judgement = _judgement(len(spread), grouped=grouped)
    return {f"kt_{i}": judgement for i, share in enumerate(left, start=1) if share > MOSTLY_ASSUMED}


def _own_variance(
    spread: Sequence[str], names: Sequence[str], covariance: Float[np.ndarray, "s s"]
) -> Float[np.ndarray, " N"]:
    """Return the variance of each rotor's coefficient over the mean one."""
    own = np.array([[float(name == mine) for name in names] for mine in spread])
    own -= own.mean(axis=0)
    return np.einsum("is,st,it->i", own, covariance, own)


def _judgement(rotors: int, *, grouped: bool) -> Judgement:
    """Return why the flights do not tell, and what to do."""
    if grouped:
        reason = "the mixer moves these groups of rotors together"
        advice = "measure thrust on a stand, or choose other groups: the rotors of one spin, say"
    elif rotors > 4:
        reason = "the mixer moves these rotors together"
        advice = 'give the rotors that are alike the same group (group = "..." in [airframe])'
    else:
        # Kept: with the CoM they make the trim of hover, and one without the other is none.
        reason = "it cannot be told apart from the average rotor"
        advice = "roll, pitch and yaw more briskly"
        return Judgement(verdict="weak", reason=reason, advice=advice)
    return Judgement(verdict="not-identified", reason=reason, advice=advice)
