"""Logs of PX4 (ULog)."""

from __future__ import annotations

from typing import Final

MAGIC: Final = b"ULog\x01\x12\x35"


def is_ulog(head: bytes) -> bool:
    """Tell a ULog by its first bytes."""
    return head.startswith(MAGIC)
