"""The one thing to do next with a vehicle, as `next_step` chooses it."""

from __future__ import annotations

from typing import Literal

from rotorfit.frozen_dataclass import frozen_dataclass

Kind = Literal["log", "declare", "fly", "done"]


@frozen_dataclass
class NextStep:
    """The one thing to do next.

    - `kind`: ``log``: set the log; ``declare``: mend what was declared, or the vehicle; ``fly``: a
      manoeuvre; ``done``: nothing that a simple flight betters.
    - `action`: what to do.
    - `because`: why this comes before any flying; None for the others.
    - `gain`: what it gives, such as ``kd from +-18 to +-6 %``; None if that is not predicted.
    - `numbers`: names of the numbers that it is for.
    """

    kind: Kind
    action: str
    because: str | None = None
    gain: str | None = None
    numbers: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """All of it in one sentence."""
        gain = "" if self.gain is None else f" (gives {self.gain})"
        because = "" if self.because is None else f", because {self.because}"
        return f"{self.action}{gain}{because}"
