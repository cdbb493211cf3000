"""What balances a hover, kept where the flights show only the whole of it.

The mean moments of a flight hold the centre of mass, the rotors' centre and each rotor's thrust
coefficient to one another. Where some of them alone are not known, a prediction still needs the
whole as it was fitted: the known ones beside a guess in the place of the others would push the
vehicle over.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeVar

from rotorfit.model.terms.body import ACCEL_BIAS
from rotorfit.model.terms.registry import TERMS
from rotorfit.model.terms.rotors import IMU_MOUNTING, ROTOR_DRAG

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    import numpy as np
    from jaxtyping import Float

    from rotorfit.estimation.estimate import Estimate
    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.fit.joint.joint_problem import JointConfiguration
    from rotorfit.results.result import IdentificationResult

Number = TypeVar("Number", float, "Float[np.ndarray, ' D']")
BALANCE: Final = "balance_"
"""Prefix of the diagnostics ``balance_x@A``: CoM less the rotors' centre, as fitted [m]."""
SHARE: Final = "thrust_share_"
"""Prefix of the diagnostics ``thrust_share_1``: a rotor's kt over the mean, as fitted."""
FITTED: Final = "fitted_"
"""Prefix of the diagnostics ``fitted_msz@A``: an unknown number as fitted, for predictions."""
HEIGHT: Final = "msz"
KEPT: Final = (
    *(HEIGHT, *ACCEL_BIAS.names, *IMU_MOUNTING.names),
    *(name for term in TERMS if term.needs == "velocity" for name in term.names),
    *ROTOR_DRAG.names,
)
"""Numbers that a prediction takes as they were fitted where they are unknown: the known ones were
fitted beside them. `BALANCE` has msx and msy."""
USUAL_HEIGHT: Final = 0.25
"""Usual height of the CoM over the origin, over the arm. Where the flights leave a larger one open,
the first moment shrinks to zero."""


def balance_diagnostics(
    numbers: Numbers, known: Collection[str], owners: Sequence[str]
) -> dict[str, float]:
    """Collect the fitted balance of hover along the axes where a part of it is not known."""
    names = set(numbers.names)

    def value(name: str) -> float:
        return numbers.number(name)[0] if name in names else 0.0

    found: dict[str, float] = {}
    for owner in owners:
        for axis in "xy":
            com, center = f"com_{axis}@{owner}", f"rotor_center_{axis}@{owner}"
            if com in names and not {f"ms{axis}@{owner}", center} & names <= set(known):
                found[f"{BALANCE}{axis}@{owner}"] = value(com) - value(center)
    own = [name for name in numbers.names if name.startswith("kt_") and name not in known]
    mean = value("kt")
    if mean > 0.0:
        found |= {f"{SHARE}{name.removeprefix('kt_')}": value(name) / mean for name in own}
    return found


def fitted_balance(result: IdentificationResult, owner: str, axis: str) -> float | None:
    """Return CoM less the rotors' centre along x or y as fitted; None where it was not kept [m]."""
    return result.diagnostics.get(f"{BALANCE}{axis}@{owner}")


def fitted_diagnostics(
    estimate: Estimate,
    configurations: Sequence[JointConfiguration],
    known: Collection[str],
    *,
    measured: bool,
) -> dict[str, float]:
    """Collect the fitted values of the numbers in `KEPT` that are not `known`.

    `measured`: whether rotor speeds are. Numbers over commands get other units in the result.

    The height of the centre of mass has no prior in the fit: its best linear prediction is the
    fitted one, times the usual variance over the sum of the usual and its own.
    """
    over_speed = {n for term in TERMS for n, info in term.parameters.items() if info.speed_power}
    kept = {name for name in KEPT if measured or name not in over_speed}
    usual = {f"{HEIGHT}@{c.name}": USUAL_HEIGHT * c.mass * c.vehicle.arm for c in configurations}
    return {
        f"{FITTED}{name}": value / (1.0 + (std / usual[name]) ** 2 if name in usual else 1.0)
        for name, value, std in zip(
            estimate.names, estimate.values.tolist(), estimate.std.tolist(), strict=True
        )
        if name.partition("@")[0] in kept and name not in known
    }


def fitted_values(result: IdentificationResult, owner: str) -> dict[str, float]:
    """Return the unknown numbers of a configuration as they were fitted, by name."""
    found = {
        name.removeprefix(FITTED).partition("@"): value
        for name, value in result.diagnostics.items()
        if name.startswith(FITTED)
    }
    return {name: value for (name, _, of), value in found.items() if of in ("", owner)}


def fitted_thrusts(result: IdentificationResult, values: Mapping[str, Number]) -> dict[str, Number]:
    """Return the fitted ``kt_1`` and so on where the rotor's own is not known, by the kt given.

    `values` may be numbers or arrays of draws; a share keeps its size where kt moves.
    """
    if "kt" not in values:
        return {}
    unknown = {p.name for p in result.parameters if p.value is None and p.verdict != "removed"}
    shares = {
        f"kt_{key.removeprefix(SHARE)}": share
        for key, share in result.diagnostics.items()
        if key.startswith(SHARE)
    }
    return {name: share * values["kt"] for name, share in shares.items() if name in unknown}
