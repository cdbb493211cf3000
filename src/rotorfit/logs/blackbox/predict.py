"""From fields as written to values: what the recorder predicted is added again.

An I frame stands alone; the P frames after it refer to at most two frames back, to the I frame at
the earliest. So the stretches from one I frame to the next are independent, and the k-th P frames
of all of them are computed together.
"""

from itertools import pairwise
from typing import Final

import numpy as np
from jaxtyping import Bool, Int, UInt32

from rotorfit.logs.blackbox.header import FrameDefinition, Header, Predictor

_WRAP: Final = 1 << 32

_BLOCK_FRAMES: Final = 1 << 14
_BLOCK_STRETCHES: Final = 32
"""Frames, or else stretches, that are computed together at least."""

# prediction = (a previous + b before that) / 2, rounded toward zero as in C
_WEIGHTS: Final = {
    Predictor.PREVIOUS: (2, 0),
    Predictor.STRAIGHT_LINE: (4, -2),
    Predictor.AVERAGE_2: (1, 1),
    Predictor.INCREMENT: (2, 0),
}


def wrap(values: Int[np.ndarray, "*n k"], signed: tuple[bool, ...]) -> Int[np.ndarray, "*n k"]:
    """Return numbers as the 32-bit integers, signed or not, that the recorder calculates with."""
    # Numbers of the platform may have 32 bits themselves.
    offset = np.where(signed, np.int64(_WRAP // 2), np.int64(0))
    return ((values + offset) & (_WRAP - 1)) - offset


def add_constants(
    written: Int[np.ndarray, "n k"], definition: FrameDefinition, header: Header
) -> Int[np.ndarray, "n k"]:
    """Add the predictions that do not depend on any frame."""
    constants = {
        Predictor.MIN_THROTTLE: (header.numbers("minthrottle") or (0,))[0],
        Predictor.FIFTEEN_HUNDRED: 1500,
        Predictor.VBAT_REFERENCE: (header.numbers("vbatref") or (0,))[0],
        Predictor.MIN_MOTOR: (header.numbers("motorOutput") or (0,))[0],
    }
    offsets = [constants.get(predictor, 0) for predictor in definition.predictors]
    return written + np.array(offsets, np.int64)


def add_motor_0(
    values: Int[np.ndarray, "n k"], definition: FrameDefinition
) -> Int[np.ndarray, "n k"]:
    """Add motor[0] of the same frame to the fields that are relative to it."""
    relative = np.array([p == Predictor.MOTOR_0 for p in definition.predictors])
    if not relative.any():
        return values
    motor_0 = values[:, definition.names.index("motor[0]")]
    return values + relative * motor_0[:, None]


def position_after_intra(is_intra: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Count the frames from the last I frame to each frame; -1 before the first."""
    number = np.arange(len(is_intra), dtype=np.int32)
    last = (
        np.maximum.accumulate(np.where(is_intra, number, np.int32(-1))) if len(number) else number
    )
    return np.where(last < 0, np.int32(-1), number - last)


def main_values(
    written: UInt32[np.ndarray, "n k"], is_intra: Bool[np.ndarray, " n"], header: Header
) -> UInt32[np.ndarray, "n k"]:
    """Compute the values of the main frames, some ten thousand frames at a time."""
    values = np.empty_like(written)
    # So many stretches at once that their number outweighs that of the steps from I to I frame.
    least = max(_BLOCK_FRAMES, _BLOCK_STRETCHES * header.i_interval)
    begin = 0
    for end in (*np.flatnonzero(is_intra).tolist(), len(written)):
        if end - begin >= least or end == len(written):
            block = written[begin:end].astype(np.int64)
            values[begin:end] = _stretches(block, is_intra[begin:end], header).astype(np.uint32)
            begin = end
    return values


def _stretches(
    written: Int[np.ndarray, "n k"], is_intra: Bool[np.ndarray, " n"], header: Header
) -> Int[np.ndarray, "n k"]:
    """Return the values of the main frames from an I frame up to before another."""
    values = np.empty_like(written)
    intra = header.frames["I"]
    first = add_motor_0(add_constants(written[is_intra], intra, header), intra)
    values[is_intra] = wrap(first, intra.signed)
    inter = header.frames.get("P")
    if inter is None:
        return values
    offset = position_after_intra(is_intra)
    order = np.argsort(offset, kind="stable")
    bounds: list[int] = np.cumsum(np.bincount(offset)).tolist()
    weights = np.array([_WEIGHTS.get(p, (0, 0)) for p in inter.predictors], np.int64).T
    skip = _iterations_to_next(header)
    for step, (begin, end) in enumerate(pairwise(bounds), start=1):
        rows = order[begin:end]
        previous = values[rows - 1]
        before = values[rows - min(step, 2)]  # the first P frame has one frame of history
        total = weights[0] * previous + weights[1] * before
        predicted = (total + (total < 0)) >> 1
        block = add_constants(written[rows], inter, header) + predicted
        for column in _columns(inter, Predictor.INCREMENT):
            block[:, column] += skip[previous[:, column] % header.i_interval]
        values[rows] = wrap(add_motor_0(block, inter), inter.signed)
    return values


def _columns(definition: FrameDefinition, predictor: Predictor) -> list[int]:
    """Find the fields with a predictor."""
    return [i for i, p in enumerate(definition.predictors) if p == predictor]


def _iterations_to_next(header: Header) -> Int[np.ndarray, " interval"]:
    """Return, for each iteration of the I interval, the number of iterations to the next logged."""
    iteration = np.arange(header.i_interval)
    phase = (iteration + header.p_numerator - 1) % header.p_denominator
    logged = np.append(np.flatnonzero(phase < header.p_numerator), header.i_interval)
    following = logged[np.searchsorted(logged, iteration, side="right")]
    return following - iteration


def gps_values(
    written: Int[np.ndarray, "n k"],
    header: Header,
    *,
    home: Int[np.ndarray, "n 2"],
    main_time: Int[np.ndarray, " n"],
) -> Int[np.ndarray, "n k"]:
    """Compute the values of the GPS frames."""
    definition = header.frames["G"]
    values = add_constants(written, definition, header)
    for coordinate, column in enumerate(_columns(definition, Predictor.HOME_COORDINATE)):
        values[:, column] += home[:, coordinate]
    for column in _columns(definition, Predictor.LAST_MAIN_FRAME_TIME):
        values[:, column] += main_time
    return wrap(values, definition.signed)
