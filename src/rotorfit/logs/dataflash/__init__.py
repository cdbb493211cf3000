"""DataFlash logs of ArduPilot: binary (.bin), and in their text form (.log)."""

from __future__ import annotations

import re
from typing import Final

HEAD: Final = b"\xa3\x95"
"""Bytes with which each message begins."""


_TEXT: Final = re.compile(rb"\s*FMT\s*,\s*\d+\s*,\s*\d+\s*,\s*\w+\s*,")
"""The first line of the text form: a definition of a message."""


def is_dataflash(head: bytes) -> bool:
    """Tell a DataFlash log by its first bytes."""
    return head.startswith(HEAD) or is_text(head)


def is_text(head: bytes) -> bool:
    """Tell the text form by its first bytes."""
    return _TEXT.match(head) is not None
