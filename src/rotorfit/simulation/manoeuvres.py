"""What a pilot can be asked to fly: each manoeuvre as the movement of the four sticks."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final, Literal

from rotorfit.simulation.pilot import STILL, Stick, Sticks

Manoeuvre = Literal[
    "hover", "roll", "pitch", "yaw", "climb", "sticks", "doublets", "wiggles", "turns"
]

_FREE: Final = Sticks()
_GENTLE_CLIMB: Final = Stick(band=(0.3, 1.5), rms=0.8)

MANOEUVRES: Final[Mapping[Manoeuvre, Sticks]] = {
    "hover": STILL,
    "roll": replace(STILL, roll=_FREE.roll),
    "pitch": replace(STILL, pitch=_FREE.pitch),
    "yaw": replace(STILL, yaw=_FREE.yaw),
    "climb": replace(STILL, climb=_FREE.climb),
    "sticks": _FREE,
    "doublets": Sticks(
        roll=Stick(band=(0.4, 1.2), rms=0.13, shape="doublets"),
        pitch=Stick(band=(0.35, 1.2), rms=0.12, shape="doublets"),
        yaw=Stick(band=(0.2, 0.5), rms=0.45, shape="doublets"),
        climb=_GENTLE_CLIMB,
    ),
    "wiggles": Sticks(
        roll=Stick(band=(1.0, 2.0), rms=0.13),
        pitch=Stick(band=(1.0, 2.0), rms=0.11),
        yaw=Stick(band=(0.1, 0.6), rms=0.5, shape="turns"),
        climb=_GENTLE_CLIMB,
    ),
    "turns": Sticks(
        roll=Stick(band=(0.3, 1.3), rms=0.16),
        pitch=Stick(band=(0.3, 1.2), rms=0.14),
        yaw=Stick(band=(0.1, 0.6), rms=1.2, shape="turns"),
        climb=_GENTLE_CLIMB,
    ),
}
"""``hover``: hands off. ``roll``, ``pitch``, ``yaw``, ``climb``: that stick alone. ``sticks``: all
four at once, as a pilot who fills a hall of 6 x 4 m. ``doublets``: short kicks out and back.
``wiggles``: roll and pitch once or twice a second during slow turns to alternating sides, 5 s each.
``turns``: turns at 1.2 rad/s to alternating sides, 5 s each, while rolling and pitching."""
