"""How well a number about the centre of mass is known: one rule for reports and exports.

The estimate gives verdicts to parameters, which are at the origin. Inertia about the centre of mass
can be sharp where that at the origin is not, and the other way round: its own interval tells. For
the centre of mass itself, and where there is no interval, the parameter at the origin speaks.
"""

from collections.abc import Mapping
from math import isfinite

from rotorfit.fit.intervals.numbers import moments_beside, product_scale
from rotorfit.model.parameters import INERTIA_COM
from rotorfit.results.numbers import Derived, Parameter, Verdict
from rotorfit.results.verdicts import WEAK


def twin_of(name: str) -> str:
    """Return the parameter at the origin whose verdict speaks for a number about the CoM."""
    return name.replace("com_", "ms") if name.startswith("com_") else name.removesuffix("_com")


def body_verdict(
    derived: Derived, twin: Parameter | None, kin: Mapping[str, Derived] | None = None
) -> Verdict:
    """Return the verdict on a number about the CoM: by its own interval, else its twin's.

    Parameters
    ----------
    derived
        The number.
    twin
        The parameter at the origin, by `twin_of`; None where the result has none.
    kin
        All derived numbers of its body, by name: what products of inertia are measured by.
    """
    verdict = None if twin is None else twin.verdict
    if _known(derived.value) is None:
        return verdict if verdict in ("ratio-only", "removed") else "not-identified"
    relative = relative_width(derived, kin or {})
    if relative is None or verdict == "given":
        return verdict if verdict in ("weak", "given") else "identified"
    if relative <= WEAK:
        return "identified"
    # Where a moment is not known, the estimate had a better idea of what matters than the value.
    measured = twin is not None and _size(derived, kin or {}) is None
    return "identified" if measured and verdict == "identified" else "weak"


def relative_width(derived: Derived, kin: Mapping[str, Derived]) -> float | None:
    """Return half of the interval of an inertia about the CoM over what its verdict goes by.

    None where only the twin's verdict tells. See `body_verdict`.
    """
    value, interval = _known(derived.value), derived.interval
    if value is None or interval is None or derived.name not in INERTIA_COM:
        return None
    size = max(abs(value), _size(derived, kin) or 0.0)
    return 0.5 * (interval[1] - interval[0]) / size if size else None


def _size(derived: Derived, kin: Mapping[str, Derived]) -> float | None:
    """Return the size of an inertia that matters; None for a product without its two moments."""
    if derived.name in INERTIA_COM[:3]:
        return 0.0
    beside = [kin.get(f"{name}_com") for name in moments_beside(derived.name)]
    known = [value for d in beside if d is not None and (value := _known(d.value)) is not None]
    return product_scale(known[0], known[1]) if len(known) == 2 else None


def _known(number: float | None) -> float | None:
    return number if number is not None and isfinite(number) else None
