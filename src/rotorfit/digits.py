"""Numbers as they are printed: digits cut to what the interval leaves of them."""

from __future__ import annotations

import math
from typing import Any

from rotorfit.frozen_dataclass import frozen_dataclass

_POWERS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def short(value: float) -> str:
    """Write two digits of a number, without an exponent; a dash where it is not finite."""
    if not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 9.95 else f"{value:.2g}"


@frozen_dataclass
class Number:
    """A number as it is printed: digits cut to two of the interval's half-width.

    - `half`: empty where there is no interval.
    - `low`, `high`: the interval where it is not even about the value, else empty.
    - `exponent`: power of ten of all digits; 0: none.
    """

    value: str
    half: str = ""
    low: str = ""
    high: str = ""
    exponent: int = 0

    def __str__(self) -> str:
        if self.low:
            body = f"{self.value} ({self.low} to {self.high})"
        else:
            body = f"{self.value} ± {self.half}" if self.half else self.value
        if not self.exponent:
            return body
        tail = f" × 10{str(self.exponent).translate(_POWERS)}"
        return (f"({body})" if self.half else body) + tail


def known(number: float | None) -> float | None:
    """Return a finite number, else None."""
    return number if number is not None and math.isfinite(number) else None


def finite_interval(interval: tuple[float, float] | None) -> tuple[float, float] | None:
    """Return an interval with finite ends, else None."""
    if interval is None or not all(math.isfinite(end) for end in interval):
        return None
    return interval


def number_of(value: float | None, interval: tuple[float, float] | None) -> Number | None:
    """Round a value to two digits of its half-width; None if there is no value."""
    value, interval = known(value), finite_interval(interval)
    if value is None:
        return None
    if interval is None or interval[1] <= interval[0]:
        return _plain_number(value)
    half = 0.5 * (interval[1] - interval[0])
    exponent = _separate_exponent(max(abs(value), half))
    scale = 10.0**exponent
    places = min(1 - math.floor(math.log10(float(f"{half / scale:.1e}"))), 12)

    def digits(number: float) -> str:
        text = f"{round(number / scale, places):.{max(places, 0)}f}"
        return (text if float(text) else text.lstrip("-")).replace("-", "−")

    uneven = abs(0.5 * (interval[0] + interval[1]) - value) > 0.1 * half
    return Number(
        value=digits(value),
        half=digits(half),
        low=digits(interval[0]) if uneven else "",
        high=digits(interval[1]) if uneven else "",
        exponent=exponent,
    )


def _plain_number(value: float) -> Number:
    exponent = _separate_exponent(abs(value))
    text = f"{value / 10.0**exponent:.6g}".replace("-", "−")
    return Number(value=text, exponent=exponent)


def _separate_exponent(size: float) -> int:
    """Select the power of ten to separate; 0 for sizes that read well without."""
    exponent = math.floor(math.log10(size)) if size > 0 else 0
    return 0 if -3 <= exponent <= 4 else exponent


def with_interval(value: float | None, interval: tuple[float, float] | None) -> str:
    """Format a value with its half-width, such as ``(2.656 +- 0.052)e-07``.

    An interval that is not even about the value is written out.
    """
    number = number_of(value, interval)
    if number is None:
        return "-"
    body = number.value
    if number.half:
        body += f" ({number.low} to {number.high})" if number.low else f" +- {number.half}"
    if number.exponent:
        body = f"({body})" if number.half else body
        body += f"e{number.exponent:+03d}"
    return body.replace("−", "-")


def with_half(value: float, half: float) -> str:
    """Format a value with its half-width, as `with_interval` does; 0 is none."""
    return with_interval(value, (value - half, value + half))


def finite_json(value: Any) -> Any:
    """Replace numbers that JSON does not have by null, in rows and lists of them too."""
    if isinstance(value, dict):
        return {key: finite_json(one) for key, one in value.items()}  # pyright: ignore
    if isinstance(value, list):
        return [finite_json(one) for one in value]  # pyright: ignore
    return None if isinstance(value, float) and not math.isfinite(value) else value
