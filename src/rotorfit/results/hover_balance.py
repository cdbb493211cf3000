"""What balances a hover, kept where the flights show only the whole of it.

The mean moments of a flight hold the centre of mass, the rotors' centre and each rotor's thrust
coefficient to one another. Where some of them alone are not known, a prediction still needs the
whole as it was fitted: the known ones beside a guess in the place of the others would push the
vehicle over.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeVar

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    import numpy as np
    from jaxtyping import Float

    from rotorfit.fit.intervals.numbers import Numbers
    from rotorfit.results.result import IdentificationResult

Number = TypeVar("Number", float, "Float[np.ndarray, ' D']")
BALANCE: Final = "balance_"
"""Prefix of the diagnostics ``balance_x@A``: CoM less the rotors' centre, as fitted [m]."""
SHARE: Final = "thrust_share_"
"""Prefix of the diagnostics ``thrust_share_1``: a rotor's kt over the mean, as fitted."""


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
