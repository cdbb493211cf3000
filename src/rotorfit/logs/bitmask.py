"""Bits of a parameter that an autopilot keeps as one number: set some, lose none."""

from collections.abc import Mapping


def bits_set(current: int | None, bits: Mapping[int, str]) -> str | None:
    """Return in words the value of a parameter with bits set beside those that are set already.

    Never "add so much": a bit that is set already would carry over and clear others.

    Parameters
    ----------
    current
        Its value in the log, two's complement where negative; None where it is not known.
    bits
        What each bit to set stands for, by its number.

    Returns
    -------
    str or None
        Such as ``"917503, which adds raw IMU (bit 19)"``; None where all are set.
    """
    known = 0 if current is None else current
    missing = {bit: what for bit, what in sorted(bits.items()) if not known >> bit & 1}
    if not missing:
        return None
    words = ", ".join(f"{what} (bit {bit})" for bit, what in missing.items())
    if current is None:
        return f"what it is with {words} ticked, too (do not add numbers)"
    return f"{known | sum(1 << bit for bit in missing)}, which adds {words}"
