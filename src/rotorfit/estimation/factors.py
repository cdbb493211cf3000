"""Triangular factors of a flight, all that the estimators need of it.

A flight is a matrix Z of signals, one row per sample (or per frequency line). Every equation of
the model is linear in them, so that for any weights, parameters and geometry the least-squares
problem depends on Z only through R of Z = Q R. Factors of blocks can be kept apart (to see their
scatter) or merged in any order: R of stacked R's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.errors import EstimationError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jaxtyping import Bool, Float, Int

SMALLEST_PIVOT = 1e-3
"""Below this pivot of the column-scaled Gram matrix its rounding (1e-16 / pivot^2) would show in
the factor, and the block is factored by Householder reflections instead."""

FEW_ROWS = 28
EVERY_BLOCK = slice(None)
"""Blocks with fewer rows (14 lines) borrow from the neighbouring bands of their stretch."""


@dataclass(frozen=True, kw_only=True)
class Factors:
    """Upper triangular factors of blocks of a signal matrix.

    - `R`: one factor per block; R^T R is the block's Gram matrix.
    - `rows`: how many rows of Z each block stands for.
    - `segment`: which segment (phase of a flight) each block comes from.
    - `band`: lower and upper edge of its frequency band [Hz]; 0 and inf for blocks of time.
    - `noise`: variance per row that known errors of measurement add to each signal, where they are
      known: for signals that stand among the regressors. None: nothing is known, or none.
    - `source`: which recording (flight) each block comes from, where that is known.
    - `slopes`: derivative of the block's rows by what moves the signals themselves (the motors' lag
      and delay), for few of them: the rows are then R, `m - z` rows of zeros below it, plus slopes
      times how far each of them has moved.
    """

    R: Float[np.ndarray, "b z z"]
    rows: Int[np.ndarray, " b"]
    segment: Int[np.ndarray, " b"]
    band: Float[np.ndarray, "b 2"]
    noise: Float[np.ndarray, "b z"] | None = None
    source: Int[np.ndarray, " b"] | None = None
    slopes: Float[np.ndarray, "b t m z"] | None = None

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def total(self) -> Float[np.ndarray, "z z"]:
        """The factor of all blocks together."""
        return merge_triangular(self.R)

    def merged(self) -> Factors:
        """Merge all blocks into one, whose few rows are all that solving again costs."""
        return Factors(
            R=self.total[None],
            rows=self.rows.sum(keepdims=True),
            segment=np.zeros(1, dtype=np.int64),
            band=np.array([[self.band[:, 0].min(), self.band[:, 1].max()]]),
        )

    @property
    def recording(self) -> Int[np.ndarray, " b"]:
        """Which recording each block comes from; all from one where that is unknown."""
        return np.zeros(len(self), dtype=np.int64) if self.source is None else self.source

    @property
    def known_noise(self) -> Float[np.ndarray, "b z"]:
        """The known variances per row; zeros if nothing is known."""
        return np.zeros((len(self), self.R.shape[2])) if self.noise is None else self.noise

    def select(self, keep: Bool[np.ndarray, " b"]) -> Factors:
        """Return the blocks for which `keep` is true; nothing is copied of blocks in succession."""
        if keep.all():
            return self
        places = np.flatnonzero(keep)
        first, last = (int(places[0]), int(places[-1]) + 1) if len(places) else (0, 0)
        own = slice(first, last) if last - first == len(places) else keep
        return Factors(
            R=self.R[own],
            rows=self.rows[own],
            segment=self.segment[own],
            band=self.band[own],
            noise=None if self.noise is None else self.noise[own],
            source=None if self.source is None else self.source[own],
            slopes=None if self.slopes is None else self.slopes[own],
        )

    @cached_property
    def borrowed_shares(self) -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, " b"]]:
        """Share of the block before and of the block after that a block of few rows borrows."""
        same = self.segment[1:] == self.segment[:-1]
        shares = np.zeros((2, len(self)))
        shares[0, 1:], shares[1, :-1] = 0.5 * same, 0.5 * same
        before, after = shares * (self.rows < FEW_ROWS)
        return before, after

    @cached_property
    def rows_with_borrowed(self) -> Float[np.ndarray, " b"]:
        """Rows of every block, with those that it borrows."""
        return _with_neighbours(self.rows.astype(float), self, EVERY_BLOCK)

    @cached_property
    def columns(self) -> Float[np.ndarray, "b m a"]:
        """The rows of every block: its signals, then the slopes of those that move."""
        if self.slopes is None:
            return self.R
        b, t, m, z = self.slopes.shape
        signals = np.zeros((b, m, z))
        signals[:, : self.R.shape[1]] = self.R
        slopes = self.slopes[..., self._signals_with_slopes].transpose(0, 2, 1, 3)
        return np.concatenate(
            [signals, slopes.reshape(b, m, t * len(self._signals_with_slopes))], axis=2
        )

    @cached_property
    def gram(self) -> Float[np.ndarray, "b a a"]:
        """The Gram matrix of every block's columns."""
        return self.columns.transpose(0, 2, 1) @ self.columns

    @cached_property
    def _signals_with_slopes(self) -> Int[np.ndarray, " s"]:
        assert self.slopes is not None
        return np.flatnonzero(self.slopes.any(axis=(0, 1, 2)))

    @cached_property
    def slope_lifts(self) -> Float[np.ndarray, "t a z"]:
        """For each slope the matrix that makes it of the columns: slope = columns @ lift."""
        z = self.R.shape[2]
        if self.slopes is None:
            return np.zeros((0, z, z))
        count, moving = self.slopes.shape[1], self._signals_with_slopes
        lifts = np.zeros((count, self.columns.shape[2], z))
        for t in range(count):
            lifts[t, z + t * len(moving) + np.arange(len(moving)), moving] = 1.0
        return lifts

    def lift(self, by: Float[np.ndarray, " t"]) -> Float[np.ndarray, "a z"]:
        """Return the matrix that makes signals moved `by` so much of the columns."""
        whole = np.eye(self.columns.shape[2], self.R.shape[2])
        return whole if self.slopes is None else whole + np.tensordot(by, self.slope_lifts, axes=1)

    def moved(self, by: Float[np.ndarray, " t"]) -> Float[np.ndarray, "b m z"]:
        """Return the rows of every block with the signals moved `by` so much."""
        return self.R if self.slopes is None else self.columns @ self.lift(by)


def of_even_rows(parts: Sequence[Factors]) -> tuple[Factors, ...]:
    """Pad blocks with zero rows to the same number of rows."""
    most = max((0 if f.slopes is None else f.slopes.shape[2] for f in parts), default=0)

    def even(factors: Factors) -> Factors:
        if factors.slopes is None or factors.slopes.shape[2] == most:
            return factors
        below = ((0, 0), (0, 0), (0, most - factors.slopes.shape[2]), (0, 0))
        # Slopes of few samples need fewer rows than others.
        return replace(factors, slopes=np.pad(factors.slopes, below))

    return tuple(even(factors) for factors in parts)


def stack_factors(parts: Sequence[Factors]) -> Factors:
    """Stack the blocks of several factors, numbering their segments on."""
    if not parts:
        raise EstimationError("no factors to stack: no stretch of flight was given")
    shifts = np.cumsum([0] + [int(part.segment.max(initial=-1)) + 1 for part in parts[:-1]])
    silent = all(part.noise is None for part in parts)
    return Factors(
        R=np.concatenate([part.R for part in parts]),
        rows=np.concatenate([part.rows for part in parts]),
        segment=np.concatenate(
            [part.segment + shift for part, shift in zip(parts, shifts, strict=True)]
        ),
        band=np.concatenate([part.band for part in parts]),
        noise=None if silent else np.concatenate([part.known_noise for part in parts]),
        slopes=_all_or_none([part.slopes for part in parts]),
    )


def _all_or_none(
    parts: Sequence[Float[np.ndarray, "_ t m z"] | None],
) -> Float[np.ndarray, "b t m z"] | None:
    """Stack the slopes of all parts, None if any has none."""
    there = [part for part in parts if part is not None]
    return np.concatenate(there) if len(there) == len(parts) else None


def stack_recordings(parts: Sequence[Factors]) -> Factors:
    """Stack the blocks of several factors, each marked by the part it comes from."""
    source = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return replace(stack_factors(parts), source=source)


def flights_of(factors: Factors) -> list[Bool[np.ndarray, " b"]]:
    """Return which blocks are of each flight."""
    numbers = np.unique(factors.recording)
    if len(numbers) < 2:
        return [np.ones(len(factors), dtype=bool)]
    return [factors.recording == number for number in numbers]


def borrowed_mean_square(
    power: Float[np.ndarray, "b *k"], factors: Factors, part: slice = EVERY_BLOCK
) -> Float[np.ndarray, "b *k"]:
    """Average each block's squares, with half of its neighbours' where rows are few."""
    rows = borrowed_rows(factors, part).reshape(-1, *[1] * (power.ndim - 1))
    # A band of two lines that happens to fit well must not get all the weight. `power`: of the
    # blocks of that part.
    return _with_neighbours(power, factors, part) / rows


def borrowed_rows(factors: Factors, part: slice = EVERY_BLOCK) -> Float[np.ndarray, " b"]:
    """Return the number of rows behind each such mean square."""
    if part == EVERY_BLOCK:
        return factors.rows_with_borrowed
    return _with_neighbours(factors.rows[part].astype(float), factors, part)


def _with_neighbours(
    sums: Float[np.ndarray, "b *k"], factors: Factors, part: slice
) -> Float[np.ndarray, "b *k"]:
    """Add to each block half of its neighbours' sums where rows are few."""
    shape = (-1, *[1] * (sums.ndim - 1))
    before, after = (share[part].reshape(shape) for share in factors.borrowed_shares)
    total = sums.copy()
    total[1:] += before[1:] * sums[:-1]
    total[:-1] += after[:-1] * sums[1:]
    return total


def time_block_factors(Z: Float[np.ndarray, "n z"], *, block_rows: int) -> Factors:
    """Factor each block of `block_rows` consecutive rows (the last may be shorter)."""
    n, width = Z.shape
    whole = n // block_rows
    parts: list[Float[np.ndarray, "b z z"]] = []
    if whole:
        parts.append(triangular_factors(Z[: whole * block_rows].reshape(whole, block_rows, width)))
    if n > whole * block_rows:
        parts.append(triangular_factors(Z[None, whole * block_rows :]))
    if not parts:
        raise EstimationError("no rows to factor: the stretch of flight is empty")
    R = np.concatenate(parts)
    rows = np.full(len(R), block_rows, dtype=np.int64)
    rows[-1] = n - (len(R) - 1) * block_rows
    return Factors(
        R=R,
        rows=rows,
        segment=np.zeros(len(R), dtype=np.int64),
        band=np.tile([0.0, np.inf], (len(R), 1)),
    )


def triangular_factors(
    blocks: Float[np.ndarray, "b m z"] | Sequence[Float[np.ndarray, "_ z"]],
) -> Float[np.ndarray, "b z z"]:
    """Compute the upper triangular R of each block, with a non-negative diagonal."""
    with np.errstate(over="ignore", invalid="ignore"):  # found below, and said
        gram = np.array([rows.T @ rows for rows in blocks])
    many = np.array([len(rows) >= rows.shape[1] for rows in blocks])
    squares = np.einsum("bii->bi", gram)
    if not np.isfinite(squares).all():
        raise EstimationError("a signal of the flight is NaN or infinite where it is used")
    scale = np.sqrt(squares)
    safe = np.where(scale > 0, scale, 1.0)
    gram /= safe[:, :, None] * safe[:, None, :]
    R, accurate = np.zeros_like(gram), np.zeros(len(gram), dtype=bool)
    # Cholesky of the column-scaled Gram matrix where that is accurate, else Householder QR; blocks
    # may have different numbers of rows.
    R[many], accurate[many] = _cholesky_factors(gram[many])
    R *= safe[:, None, :]
    lengths = np.array([len(rows) for rows in blocks])
    for length in np.unique(lengths[~accurate]).tolist():
        alike = np.flatnonzero(~accurate & (lengths == length))
        R[alike] = _householder_factors(np.array([blocks[i] for i in alike.tolist()]))
    return R


def _cholesky_factors(
    gram: Float[np.ndarray, "b z z"],
) -> tuple[Float[np.ndarray, "b z z"], Bool[np.ndarray, " b"]]:
    """Factor unit-diagonal Gram matrices, and mark the factors that rounding leaves valid."""
    try:
        lower = np.linalg.cholesky(gram)
    except np.linalg.LinAlgError:
        if len(gram) == 1:
            return np.zeros_like(gram), np.zeros(1, dtype=bool)
        # A singular one fails all that are factored with it: then each half is factored by itself.
        halves = [_cholesky_factors(half) for half in np.array_split(gram, 2)]
        return np.concatenate([R for R, _ in halves]), np.concatenate([own for _, own in halves])
    accurate = np.einsum("bii->bi", lower).min(axis=1) > SMALLEST_PIVOT
    return np.ascontiguousarray(lower.transpose(0, 2, 1)), accurate


def _householder_factors(blocks: Float[np.ndarray, "b m z"]) -> Float[np.ndarray, "b z z"]:
    """Compute R of each block by Householder QR, square, with a non-negative diagonal."""
    R = np.asarray(np.linalg.qr(blocks, mode="r"))
    missing = R.shape[2] - R.shape[1]
    if missing > 0:
        # Fewer rows than signals: rows of zeros make it square and change no R^T R.
        R = np.concatenate([R, np.zeros((len(R), missing, R.shape[2]))], axis=1)
    signs = np.where(np.einsum("bii->bi", R) < 0, -1.0, 1.0)
    return R * signs[:, :, None]


def merge_triangular(R: Float[np.ndarray, "b z z"]) -> Float[np.ndarray, "z z"]:
    """Factor stacked factors, in pieces that fit a processor's cache."""
    if len(R) == 0:
        raise EstimationError("no factors to merge: no stretch of flight was given")
    while len(R) > 1:
        group = min(len(R), 16)
        whole = len(R) // group * group
        head = _householder_factors(
            R[:whole].reshape(whole // group, group * R.shape[1], R.shape[2])
        )
        R = np.concatenate([head, R[whole:]])
    return R[0]
