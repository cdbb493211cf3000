"""Parameters in words, verdicts in words, numbers with their intervals."""

from rotorfit.formatting.digits import finite_interval, known
from rotorfit.model.parameters import EVERY
from rotorfit.results.result import Derived, Parameter

TITLES = {name: info.title for name, info in EVERY.items()}

VERDICT_MEANING = {
    "identified": "uncertainty up to 25 % of the value or its relevant size (docs/method.md)",
    "weak": "uncertainty over 25 % of value and relevant size, or mostly prior (marked so)",
    "doubtful": "may be outside its interval: a check contradicts it, the reason is given",
    "ratio-only": "known only together with another parameter",
    "not-identified": "this flight does not show it",
    "given": "given to rotorfit, not estimated",
    "removed": "taken out of the model as unessential",
}

PREDICTED_WELL = (
    "Good: Fz up to 5 % (the weight is in it), moments up to 30 % (a tenth of their power is left)."
)
"""What relative errors on flights kept apart are worth."""
NOTHING_PREDICTED = (
    "At 100 % and over the model predicts nothing of that component: the rotors hardly moved it "
    "in this flight (validate on one that does), or the parameters do not hold for it (vehicle "
    "changed since, wrong configuration; identify from both flights)."
)


def title_of(name: str) -> str:
    """Return a parameter's name in words."""
    return TITLES.get(name, name)


def unit_words(unit: str) -> str:
    """Return a unit with raised powers; nothing for a plain number."""
    return "" if unit == "1" else unit.replace("^2", "²").replace("^3", "³")


def half_width(number: Parameter | Derived) -> float | None:
    """Return half of the interval."""
    interval = finite_interval(number.interval)
    return None if interval is None else 0.5 * (interval[1] - interval[0])


def percent(number: Parameter | Derived) -> float | None:
    """Return the half-width relative to the value [%]; silly where the value is near zero."""
    half, value = half_width(number), known(number.value)
    return None if half is None or not value else 100.0 * half / abs(value)


def percent_words(value: float) -> str:
    """Return a percentage with two digits, or whole above 10."""
    if value >= 9.5:
        return f"{value:.0f} %"
    if value < 0.001:
        return "0.001 %"
    return f"{float(f'{value:.1g}' if value < 1 else f'{value:.2g}'):g} %"
