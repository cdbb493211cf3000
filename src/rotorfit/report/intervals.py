"""The small bar that draws an interval beside its number."""

from collections.abc import Sequence

from rotorfit.formatting.digits import finite_interval, known
from rotorfit.model.terms.air import DRAG_MOMENTS
from rotorfit.report.svg import drawing, tag
from rotorfit.results.result import Derived, Parameter

WIDTH, HEIGHT, MARGIN = 132.0, 18.0, 5.0

FAMILIES = (
    *("com_", "ms", "rotor_center_", "accel_bias_"),
    *("drag_", "turn_damping_", "torque_offset_"),
)


def axis_of(name: str) -> str:
    """Return the name of the axis that a number shares with its kin, so that sizes compare."""
    for family in FAMILIES:
        if name.startswith(family) and len(name) == len(family) + 1:
            return family
    if name in DRAG_MOMENTS:
        return "drag_moment_"
    if name.startswith("I") and len(name.removesuffix("_com")) == 3:
        return "I_com" if name.endswith("_com") else "I"
    return name


def axis_range(numbers: Sequence[Parameter | Derived]) -> tuple[float, float]:
    """Return the ends of an axis that shows zero and every interval."""
    ends = [0.0]
    for number in numbers:
        value = known(number.value)
        if value is not None:
            ends += [value, *(finite_interval(number.interval) or ())]
    return min(ends), max(ends)


def interval_bar(
    number: Parameter | Derived, ends: tuple[float, float], verdict: str
) -> str | None:
    """Return a drawn interval: a thin line at zero, a bar over the interval, a dot at the value."""
    value = known(number.value)
    if value is None or ends[0] == ends[1]:
        return None
    low, high = finite_interval(number.interval) or (value, value)

    def place(x: float) -> float:
        return MARGIN + (x - ends[0]) / (ends[1] - ends[0]) * (WIDTH - 2 * MARGIN)

    middle = HEIGHT / 2
    left, right = place(low), place(high)
    return drawing(
        WIDTH,
        HEIGHT,
        {"class": f"interval {verdict}", "aria-hidden": "true"},
        tag("path", {"class": "track", "d": f"M{MARGIN} {middle}H{WIDTH - MARGIN}"}),
        tag("path", {"class": "zero", "d": f"M{place(0.0):.2f} 1V{HEIGHT - 1}"}),
        tag(
            "rect",
            {
                "class": "span",
                "x": min(left, place(value) - 0.75),
                "y": middle - 4,
                "width": max(right - left, 1.5),
                "height": 8.0,
                "rx": 1.5,
            },
        ),
        tag("circle", {"class": "value", "cx": place(value), "cy": middle, "r": 2.4}),
    )
