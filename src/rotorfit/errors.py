"""Everything rotorfit raises or warns with; one base class for each.

A message says what was met, what was expected, and what to do next.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, ClassVar

from rotorfit.findings import Finding

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


LIST_ROTORS = (
    "list the rotors as the log numbers them, in place of layout: under [airframe] write rotors = "
    "[ { position = [x, y, z], spin = 'ccw' }, ... ]"
)
"""What to do for a frame or a motor order that has no name."""


class RotorfitError(Exception):
    """Base of every error that rotorfit raises on purpose: a refusal."""

    kind: ClassVar[str] = "refused"
    _about: Mapping[str, Any] = {}

    def about(self, **fields: Any) -> RotorfitError:
        """Return the error itself, with fields of its `Finding`, such as its kind."""
        self._about = fields
        return self

    @property
    def finding(self) -> Finding:
        """The refusal as a finding; its sentence is the message."""
        fields: dict[str, Any] = {"kind": self.kind, **self._about}
        return Finding(**fields, severity="refusal", sentence=str(self))


class _OneLineError(RotorfitError):
    """Its message is one line, whatever a damaged file or the library that read it put into it.

    The middle is left out where a name in the file is thousands of letters long.
    """

    def __init__(self, message: str) -> None:
        line = re.sub(r"\s*[\r\n]\s*", " ", message)
        super().__init__(line if len(line) <= 2000 else f"{line[:1200]} [...] {line[-600:]}")


class LogError(_OneLineError):
    """A file cannot be read as a flight log, or lacks a channel that is needed."""

    kind = "log"


class FlightError(RotorfitError):
    """A log was read, but holds no stretch of flight that can be used."""

    kind = "flight"


class FrameError(FlightError):
    """The data contradict the declared axes, rotor order or spin directions."""

    kind = "declaration"


class ExcitationError(FlightError):
    """The flight does not move enough to determine what was asked."""

    kind = "excitation"


class ExperimentError(_OneLineError):
    """The experiment or airframe description is wrong or incomplete.

    `problems` are the places that are wrong, such as ``configuration[0].mass``, each with its
    sentence: for what shows them one by one.
    """

    kind = "experiment"

    def __init__(self, message: str, *, problems: Sequence[tuple[str, str]] = ()) -> None:
        super().__init__(message)
        self.problems = tuple(problems)


class EstimationError(RotorfitError):
    """The numbers handed to an estimator do not determine a solution."""

    kind = "estimation"


class UnsettledError(EstimationError):
    """The iteration of an estimator did not come to an end: the flights hardly determine it.

    `reached` are the free parameters where it was stopped, by name: for what only asks how far.
    """

    def __init__(self, message: str, *, reached: Mapping[str, float] | None = None) -> None:
        super().__init__(message)
        self.reached = dict(reached or {})


class OutputError(RotorfitError):
    """A result cannot be written or read back."""

    kind = "output"


class MissingNumbersError(OutputError):
    """A file needs numbers that the flights do not give.

    `names` are those that a user may supply: for what asks for them one by one.
    """

    def __init__(self, message: str, *, names: Sequence[str]) -> None:
        super().__init__(message)
        self.names = tuple(names)


class RotorfitWarning(UserWarning):
    """Base of every warning: a doubt about the data that does not stop the work."""


class FlightWarning(RotorfitWarning):
    """The flight is usable, with a reservation."""
