"""A number of a result, with what the flights say of it."""

from dataclasses import dataclass
from typing import Literal

Verdict = Literal[
    "identified", "weak", "doubtful", "ratio-only", "not-identified", "given", "removed"
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One parameter of the model, with what this experiment says of it.

    Attributes
    ----------
    name, configuration, unit
        `configuration` is None for what all configurations share.
    value, std, interval
        SI; None where the flight does not give them. The interval is 95 %.
    verdict
        ``identified``, ``weak`` (interval wide), ``doubtful`` (may be outside its interval, as a
        finding says), ``ratio-only`` (only together with the parameter `partner`),
        ``not-identified``, ``given``, ``removed`` (an unessential parameter).
    partner
        Named under ``with`` in the file.
    reason, advice
        Why the verdict is not better, and what to fly or measure next.
    """

    name: str
    configuration: str | None
    value: float | None
    std: float | None
    interval: tuple[float, float] | None
    unit: str
    verdict: Verdict
    partner: str | None = None
    reason: str | None = None
    advice: str | None = None

    @property
    def full_name(self) -> str:
        """Its name among those of all configurations, such as ``Ixx@A``."""
        return f"{self.name}@{self.configuration}" if self.configuration else self.name


@dataclass(frozen=True, slots=True, kw_only=True)
class Derived:
    """A number computed from the parameters.

    Attributes
    ----------
    name, configuration, unit
        `configuration` is None for what all configurations share.
    value, std, interval
        SI; None where the parameters do not give it. The interval is 95 %.
    verdict, reason
        As of a `Parameter`; doubtful where a number is that it depends on.
    """

    name: str
    configuration: str | None
    value: float | None
    std: float | None
    interval: tuple[float, float] | None
    unit: str
    verdict: Verdict | None = None
    reason: str | None = None

    @property
    def full_name(self) -> str:
        """Its name among those of all configurations, such as ``com_x@A``."""
        return f"{self.name}@{self.configuration}" if self.configuration else self.name
