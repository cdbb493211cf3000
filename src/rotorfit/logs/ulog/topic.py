"""The messages of one topic of a ULog, field by field."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from rotorfit.logs.flight_log import pieces

LARGEST_VALUE: Final = 1e100
"""Beyond it a number of double precision is damage, and its square no number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """The messages of one instance of a topic, in order of time.

    Attributes
    ----------
    rows
        The fields that were asked for; arrays of rows, and long ones of floats, without the last
        ones that say nothing.
    lengths
        Of those arrays, as declared.
    """

    name: str
    instance: int
    rows: np.ndarray
    lengths: Mapping[str, int]

    @property
    def label(self) -> str:
        """As PX4's people write it."""
        return f"{self.name}[{self.instance}]" if self.instance else self.name

    def has(self, *fields: str) -> bool:
        """Return whether the topic has all these fields, as numbers or arrays of numbers."""
        names = self.rows.dtype.names or ()
        return all(name in names for name in fields)

    def column(self, name: str, rows: slice = slice(None)) -> Float[np.ndarray, "*shape"]:
        """Return a field as floats: one value a row, or one array; what is no number is NaN."""
        return _floats(self.rows[name][rows])

    def has_vector(self, name: str, columns: int) -> bool:
        """Return whether a field is an array of at least so many numbers."""
        if not self.has(name) or self.rows.dtype[name].names:
            return False
        return self.rows[name].ndim == 2 and self.rows[name].shape[1] >= columns

    def has_number(self, name: str) -> bool:
        """Return whether a field is one number."""
        return self.has(name) and not self.rows.dtype[name].names and self.rows[name].ndim == 1

    def vector(self, name: str, columns: int) -> Float[np.ndarray, "n k"] | None:
        """Return a field that is an array of at least so many numbers; None if it is not."""
        return _floats(self.rows[name][:, :columns]) if self.has_vector(name, columns) else None

    def number(self, name: str) -> Float[np.ndarray, " n"] | None:
        """Return a field that is one number; None if it is not."""
        return self.column(name) if self.has_number(name) else None

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        """When each message was published, since boot [s]."""
        stamps = self.column("timestamp")
        stamps *= 1e-6
        return stamps

    @property
    def sample_time(self) -> Float[np.ndarray, " n"]:
        """When what it tells was measured [s]; where it does not say, when it was published."""
        sampled = self.number("timestamp_sample")
        if sampled is None or not sampled.all():
            return self.time
        sampled *= 1e-6
        return sampled

    @property
    def rate(self) -> float:
        """Median rate [Hz]."""
        steps = np.diff(self.time)
        return 1.0 / max(float(np.median(steps)), 1e-6) if len(steps) else 0.0


def _floats(recorded: np.ndarray) -> Float[np.ndarray, "*shape"]:
    """Return a copy as floats; what is no number is NaN."""
    with np.errstate(invalid="ignore"):  # some NaN of single precision signal
        values = recorded.astype(np.float64)
    if recorded.dtype.kind == "f":
        for rows in pieces(len(values)):
            some = values[rows]
            some[~(np.abs(some) < LARGEST_VALUE)] = np.nan
    return values
