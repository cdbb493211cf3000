"""Motion-capture recordings to a FlightLog of position and attitude; one module per format."""

from __future__ import annotations


def is_qualisys(head: bytes) -> bool:
    """Tell an export of Qualisys Track Manager by its first bytes."""
    return _begins_with(head, b"NO_OF_FRAMES\t", b"FILE_VERSION\t")


def is_motive(head: bytes) -> bool:
    """Tell a CSV export of OptiTrack Motive by its first bytes."""
    return _begins_with(head, b"Format Version,")


def _begins_with(head: bytes, *beginnings: bytes) -> bool:
    # Behind the mark of the encoding that some programs put first.
    return head.removeprefix(b"\xef\xbb\xbf").startswith(beginnings)
