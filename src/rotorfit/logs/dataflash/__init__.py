"""DataFlash logs of ArduPilot (.bin)."""

from typing import Final

HEAD: Final = b"\xa3\x95"
"""Bytes with which each message begins."""


def is_dataflash(head: bytes) -> bool:
    """Tell a DataFlash log by its first bytes."""
    return head.startswith(HEAD)
