"""Blackbox logs of Betaflight, INAV and INDIflight."""

from __future__ import annotations

from typing import Final

LOG_START: Final = b"H Product:Blackbox flight data recorder by Nicholas Sherlock"


def is_blackbox(head: bytes) -> bool:
    """Tell a Blackbox log by some thousand bytes; remains of an older log may come before."""
    return LOG_START in head
