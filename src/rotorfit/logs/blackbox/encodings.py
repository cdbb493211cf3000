"""The field encodings of Blackbox, read for all frames of one kind at once.

Every variable-byte number ends with a byte below 128. With the number of such bytes before each
position at hand (`ByteIndex`), a run of k numbers is skipped in one step, whatever their
lengths, and the numbers of all frames are gathered with array operations.

From fields as written to values, what the recorder predicted is added again. An I frame stands
alone; the P frames after it refer to at most two frames back, to the I frame at the earliest. So
the stretches from one I frame to the next are independent, and the k-th P frames of all of them are
computed together.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.blackbox.header import Encoding, FrameDefinition, Header, Predictor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Int, UInt8, UInt32

    Integers = Int[np.ndarray, "..."]

MAX_VB_BYTES: Final = 5
"""A 32-bit number takes at most five bytes of seven bits."""
_GROUP_SIZE: Final = {
    Encoding.TAG8_8SVB: 8,
    Encoding.TAG8_4S16: 4,
    Encoding.TAG2_3S32: 3,
    Encoding.TAG2_3SVARIABLE: 3,
}


@frozen_dataclass
class ByteIndex:
    """The bytes of one log, and the variable-byte numbers in them.

    - `data`: the bytes, and eight zero bytes more by which a cut frame can be read and refused.
    - `rank`: number of bytes below 128 before each position.
    - `ends`: position after each byte below 128.
    - `values`: of the number that ends there, if it begins right after the one before.
    - `overlong`: whether that number has more than five bytes.
    """

    data: UInt8[np.ndarray, " m"]
    rank: Int[np.ndarray, " m+1"]
    ends: Int[np.ndarray, " t"]
    values: Int[np.ndarray, " t"]
    overlong: Bool[np.ndarray, " t"]
    size: int


@frozen_dataclass
class Group:
    """Consecutive fields that are written together.

    A run of variable bytes, signed, unsigned or negated, has the encoding of signed ones.
    """

    encoding: Encoding
    first: int
    count: int


def index_bytes(data: bytes) -> ByteIndex:
    """Return the index of the bytes of one log."""
    # The padding is made of terminators, so that every look-up of a truncated frame ends.
    padded = np.frombuffer(data + bytes(8), np.uint8)
    is_end = padded < 128
    rank = np.zeros(len(padded) + 1, np.int32)
    np.cumsum(is_end, out=rank[1:])
    ends = np.flatnonzero(is_end).astype(np.int32) + np.int32(1)
    starts = np.concatenate([np.zeros(1, np.int32), ends[:-1]])
    return ByteIndex(
        data=padded,
        rank=rank,
        ends=ends,
        values=_decode_unsigned(padded, starts, ends),
        overlong=(ends - starts) > MAX_VB_BYTES,
        size=len(data),
    )


def _decode_unsigned(data: UInt8[np.ndarray, " m"], starts: Integers, ends: Integers) -> Integers:
    """Return the unsigned 32-bit numbers between `starts` and `ends`, seven bits a byte."""
    values = (data[starts] & 0x7F).astype(np.int64)
    for byte in range(1, MAX_VB_BYTES):
        longer = np.flatnonzero(ends - starts > byte)
        if len(longer) == 0:
            break
        septets = (data[starts[longer] + byte] & 0x7F).astype(np.int64)
        values[longer] |= septets << (7 * byte)
    return values & 0xFFFFFFFF


def group_fields(definition: FrameDefinition) -> tuple[Group, ...]:
    """Group the fields of a frame as they are written."""
    groups: list[Group] = []
    # One number stands for all plain variable-byte numbers.
    tagged = {*_GROUP_SIZE, Encoding.UNWRITTEN}
    run = [e if e in tagged else Encoding.SIGNED_VB for e in definition.encodings]
    first = 0
    while first < len(run):
        encoding = run[first]
        longest = min(len(run), first + _GROUP_SIZE.get(encoding, len(run)))
        stop = first + 1
        while stop < longest and run[stop] == encoding:
            stop += 1
        if encoding == Encoding.TAG8_8SVB and stop - first == 1:
            encoding = Encoding.SIGNED_VB
        groups.append(Group(encoding=encoding, first=first, count=stop - first))
        first = stop
    return tuple(groups)


def signed_from_zigzag(values: Integers) -> Integers:
    """Return signed numbers from 0, -1, 1, -2, ... counted from zero."""
    return (values >> 1) ^ -(values & 1)


def sign_extend(values: Integers, bits: int) -> Integers:
    """Return the low bits of each number as a two's complement number of so many bits."""
    half = 1 << (bits - 1)
    return ((values & (2 * half - 1)) ^ half) - half


def _bytes_at(index: ByteIndex, positions: Integers) -> Integers:
    """Return the bytes at some positions; positions beyond the end read the last padding byte."""
    return index.data[np.minimum(positions, len(index.data) - 1)].astype(np.int64)


def read_numbers(
    index: ByteIndex, starts: Int[np.ndarray, " n"], present: Bool[np.ndarray, "n k"]
) -> tuple[Int[np.ndarray, "n k"], Int[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Read runs of variable-byte numbers, of which some are left out."""
    last = len(index.ends) - 1
    before = np.cumsum(present, axis=1) - present
    first = index.rank[starts].astype(np.int64)
    token = np.minimum(first[:, None] + before, last)
    values = np.where(present, index.values[token], 0)
    bad = (index.overlong[token] & present & (before > 0)).any(axis=1)
    # The first number may begin in the middle of what the index takes for one number.
    own_first, own_end = np.minimum(first, last), index.ends[np.minimum(first, last)]
    own = _decode_unsigned(index.data, starts, own_end)
    values = np.where(present & (before == 0), own[:, None], values)
    count = present.sum(axis=1)
    bad |= (count > 0) & (own_end - starts > MAX_VB_BYTES)
    stops = np.where(count > 0, index.ends[np.minimum(own_first + count - 1, last)], starts)
    return values, stops, bad


def read_tag2_3s32(
    index: ByteIndex, starts: Int[np.ndarray, " n"], variable: bool
) -> tuple[Int[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
    """Read TAG2_3S32 (three numbers of 2, 4 or 6 bits or of 1 to 4 bytes) or its variant."""
    b0, b1, b2 = (_bytes_at(index, starts + i) for i in range(3))
    if variable:
        word = (b0 << 16) | (b1 << 8) | b2
        medium = [(word >> 17, 5), (word >> 12, 5), (word >> 8, 4)]
        large = [(word >> 14, 8), (word >> 7, 7), (word, 7)]
    else:
        medium, large = [(b0, 4), (b1 >> 4, 4), (b1, 4)], [(b0, 6), (b1, 6), (b2, 6)]
    small = [(b0 >> 4, 2), (b0 >> 2, 2), (b0, 2)]
    selector = b0 >> 6
    values = np.empty((len(starts), 3), np.int64)
    position = starts + 1
    for i in range(3):
        width = (b0 >> (2 * i)) & 3
        word = sum(_bytes_at(index, position + j) << (8 * j) for j in range(4))
        whole = _choose_elements(
            width, [sign_extend(np.asarray(word), bits) for bits in (8, 16, 24, 32)]
        )
        bits = [sign_extend(*choice[i]) for choice in (small, medium, large)]
        values[:, i] = _choose_elements(selector, [*bits, whole])
        position = position + width + 1
    return values, np.where(selector == 3, position, starts + selector + 1)


def _choose_elements(
    number: Int[np.ndarray, " n"], choices: Sequence[Int[np.ndarray, " n"]]
) -> Int[np.ndarray, " n"]:
    """Choose an element of each row by its number; numpy indexes by the platform's integers."""
    return np.choose(number.astype(np.intp), choices)


def read_tag8_4s16(
    index: ByteIndex, starts: Int[np.ndarray, " n"], version: int
) -> tuple[Int[np.ndarray, "n 4"], Int[np.ndarray, " n"]]:
    """Read TAG8_4S16: a byte of four tags, then four numbers of 0, 4, 8 or 16 bits."""
    tags = _bytes_at(index, starts)
    if version == 1:
        return _read_tag8_4s16_v1(index, starts, tags)
    # Counted in nibbles, high one first: the position needs no case distinction.
    nibble = 2 * (starts.astype(np.int64) + 1)
    values = np.empty((len(starts), 4), np.int64)
    for i in range(4):
        tag = (tags >> (2 * i)) & 3
        at, odd = nibble >> 1, nibble & 1
        word = (
            (_bytes_at(index, at) << 16)
            | (_bytes_at(index, at + 1) << 8)
            | _bytes_at(index, at + 2)
        )
        top = np.where(odd == 1, word << 4, word)  # the number begins at bit 23
        four, eight, sixteen = (sign_extend(top >> (24 - bits), bits) for bits in (4, 8, 16))
        values[:, i] = _choose_elements(tag, [np.zeros_like(four), four, eight, sixteen])
        nibble = nibble + np.array([0, 1, 2, 4])[tag]
    return values, (nibble + 1) >> 1


def _read_tag8_4s16_v1(
    index: ByteIndex, starts: Int[np.ndarray, " n"], tags: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, "n 4"], Int[np.ndarray, " n"]]:
    """Read the first version: a 4-bit tag takes the next field along, low nibble first."""
    position = starts.astype(np.int64) + 1
    values = np.zeros((len(starts), 4), np.int64)
    paired = np.zeros(len(starts), bool)  # this field was the high nibble of the one before
    for i in range(4):
        tag = np.where(paired, 0, (tags >> (2 * i)) & 3)
        low, high = _bytes_at(index, position), _bytes_at(index, position + 1)
        word = low | (high << 8)
        choices = [np.zeros_like(low), *(sign_extend(word, bits) for bits in (4, 8, 16))]
        values[:, i] += _choose_elements(tag, choices)
        paired = tag == 1
        if i < 3:
            values[:, i + 1] = np.where(paired, sign_extend(low >> 4, 4), 0)
        position = position + np.array([0, 1, 1, 2])[tag]
    return values, position


def read_frames(
    index: ByteIndex, starts: Int[np.ndarray, " n"], definition: FrameDefinition, version: int
) -> tuple[Int[np.ndarray, "n k"], Bool[np.ndarray, " n"]]:
    """Read the fields of frames of one kind as they are written, before prediction."""
    values = np.zeros((len(starts), len(definition.names)), np.int64)
    bad = np.zeros(len(starts), bool)
    position = starts
    for group in group_fields(definition):
        columns = slice(group.first, group.first + group.count)
        match group.encoding:
            case Encoding.UNWRITTEN:
                continue
            case Encoding.TAG8_8SVB:
                bits = (_bytes_at(index, position)[:, None] >> np.arange(group.count)) & 1
                block, position, wrong = read_numbers(index, position + 1, bits == 1)
                values[:, columns] = signed_from_zigzag(block)
                bad |= wrong
            case Encoding.TAG2_3S32 | Encoding.TAG2_3SVARIABLE:
                variable = group.encoding == Encoding.TAG2_3SVARIABLE
                block, position = read_tag2_3s32(index, position, variable)
                values[:, columns] = block[:, : group.count]
            case Encoding.TAG8_4S16:
                block, position = read_tag8_4s16(index, position, version)
                values[:, columns] = block[:, : group.count]
            case _:
                present = np.ones((len(starts), group.count), bool)
                block, position, wrong = read_numbers(index, position, present)
                values[:, columns] = _decode_plain(block, definition.encodings[columns])
                bad |= wrong
    return values, bad


def _decode_plain(
    values: Int[np.ndarray, "n k"], encodings: tuple[Encoding, ...]
) -> Int[np.ndarray, "n k"]:
    """Return a run of variable-byte numbers as signed, unsigned or negated, column by column."""
    result = values.copy()
    for column, encoding in enumerate(encodings):
        if encoding in (Encoding.SIGNED_VB, Encoding.TAG8_8SVB):
            result[:, column] = signed_from_zigzag(values[:, column])
        elif encoding == Encoding.NEGATIVE_14BIT:
            result[:, column] = -sign_extend(values[:, column], 14)
    return result


_WRAP: Final = 1 << 32

BLOCK_FRAMES: Final = 1 << 14
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
    least = max(BLOCK_FRAMES, _BLOCK_STRETCHES * header.i_interval)
    begin = 0
    for end in (*np.flatnonzero(is_intra).tolist(), len(written)):
        if end - begin >= least or end == len(written):
            block = written[begin:end].astype(np.int64)
            values[begin:end] = _decode_stretches(block, is_intra[begin:end], header).astype(
                np.uint32
            )
            begin = end
    return values


def _decode_stretches(
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
        for column in _columns_of_predictor(inter, Predictor.INCREMENT):
            block[:, column] += skip[previous[:, column] % header.i_interval]
        values[rows] = wrap(add_motor_0(block, inter), inter.signed)
    return values


def _columns_of_predictor(definition: FrameDefinition, predictor: Predictor) -> list[int]:
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
    for coordinate, column in enumerate(
        _columns_of_predictor(definition, Predictor.HOME_COORDINATE)
    ):
        values[:, column] += home[:, coordinate]
    for column in _columns_of_predictor(definition, Predictor.LAST_MAIN_FRAME_TIME):
        values[:, column] += main_time
    return wrap(values, definition.signed)
