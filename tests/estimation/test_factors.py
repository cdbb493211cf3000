"""Triangular factors: what they keep, however they are cut, merged, turned or scaled."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorfit.errors import EstimationError
from rotorfit.estimation.factors import (
    Factors,
    merge_triangular,
    stack_factors,
    time_block_factors,
    triangular_factors,
)

SEEDS = st.integers(0, 2**32 - 1)


def signals(rng, n, z):
    """Return signals of very different size with a common part, as a flight has them."""
    scales = 10.0 ** rng.uniform(-3, 6, z)
    return (rng.normal(size=(n, z)) + 0.5 * rng.normal(size=(n, 1))) * scales


def assert_same_gram(R, Z, tolerance=1e-13):
    """Compare R^T R with Z^T Z, entry by entry to the lengths of the two columns."""
    lengths = np.linalg.norm(Z, axis=0)
    error = np.abs(R.T @ R - Z.T @ Z)
    assert (error <= tolerance * np.outer(lengths, lengths)).all()


def assert_triangular(R):
    assert (np.tril(R, -1) == 0).all()
    assert (np.diagonal(R) >= 0).all()


@settings(max_examples=80, deadline=None)
@given(seed=SEEDS, n=st.integers(1, 300), z=st.integers(1, 20), block=st.integers(1, 120))
def test_factor_has_the_gram_matrix_of_its_rows(seed, n, z, block):
    Z = signals(np.random.default_rng(seed), n, z)
    F = time_block_factors(Z, block_rows=block)
    assert F.rows.sum() == n
    assert F.R.shape == (-(-n // block), z, z)
    starts = np.concatenate([[0], np.cumsum(F.rows)])
    for R, a, b in zip(F.R, starts[:-1], starts[1:], strict=True):
        assert_triangular(R)
        assert_same_gram(R, Z[a:b])
    assert_same_gram(F.total, Z)


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, z=st.integers(1, 12), data=st.data())
def test_merging_is_associative_and_blind_to_order(seed, z, data):
    rng = np.random.default_rng(seed)
    Z = signals(rng, 200, z)
    R = time_block_factors(Z, block_rows=7).R
    order = data.draw(st.permutations(range(len(R))))
    cut = data.draw(st.integers(1, len(R) - 1))
    shuffled = R[order]
    halves = np.stack([merge_triangular(shuffled[:cut]), merge_triangular(shuffled[cut:])])
    scale = np.linalg.norm(Z, axis=0)
    whole = merge_triangular(R)
    np.testing.assert_allclose(merge_triangular(halves) / scale, whole / scale, atol=3e-13)
    np.testing.assert_allclose(merge_triangular(shuffled) / scale, whole / scale, atol=3e-13)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, one=st.integers(1, 400), other=st.integers(1, 400))
def test_the_total_does_not_depend_on_the_size_of_blocks(seed, one, other):
    Z = signals(np.random.default_rng(seed), 300, 8)
    scale = np.linalg.norm(Z, axis=0)
    first = time_block_factors(Z, block_rows=one).total
    np.testing.assert_allclose(
        time_block_factors(Z, block_rows=other).total / scale, first / scale, atol=3e-13
    )


def test_the_total_is_blind_to_permuted_and_rotated_rows():
    rng = np.random.default_rng(3)
    Z = signals(rng, 240, 20)
    scale = np.linalg.norm(Z, axis=0)
    expected = np.linalg.qr(Z, mode="r")
    expected *= np.sign(np.diagonal(expected))[:, None]
    Q, _ = np.linalg.qr(rng.normal(size=(240, 240)))
    for rows in (Z, Z[rng.permutation(240)], Q @ Z):
        R = time_block_factors(rows, block_rows=60).total
        np.testing.assert_allclose(R / scale, expected / scale, atol=1e-12)


DEFECTS = {
    "zero column": lambda Z: np.where(np.arange(Z.shape[1]) == 4, 0.0, Z),
    "two zero columns": lambda Z: np.where(np.arange(Z.shape[1]) < 2, 0.0, Z),
    "two constant columns": lambda Z: np.where(np.arange(Z.shape[1]) % 3 == 0, 7.0, Z),
    "repeated column": lambda Z: np.where(np.arange(Z.shape[1]) == 5, 1e4 * Z[:, :1], Z),
    "sum of three": lambda Z: np.column_stack([Z[:, :-1], Z[:, :3] @ [1.0, -2.0, 5.0]]),
    "all equal": lambda Z: np.repeat(Z[:, :1], Z.shape[1], axis=1),
    "all zero": lambda Z: np.zeros_like(Z),
}


@pytest.mark.parametrize("rows", [200, 9, 1])
@pytest.mark.parametrize("defect", DEFECTS.values(), ids=DEFECTS)
def test_singular_blocks_keep_their_exact_null_directions(defect, rows):
    rng = np.random.default_rng(4)
    good, bad = rng.normal(size=(2, rows, 10)) * 10.0 ** rng.uniform(-2, 5, 10)
    bad = defect(bad)
    R = triangular_factors(np.stack([good, bad, good]))
    assert_triangular(R[1])
    assert_same_gram(R[1], bad)
    # A direction that the rows do not move must not move the factor: no square root of rounding.
    lengths = np.where(np.linalg.norm(bad, axis=0) > 0, np.linalg.norm(bad, axis=0), 1.0)
    _, s, Vt = np.linalg.svd(bad / lengths)
    rank = int((s > 1e-12 * max(s[0], 1e-300)).sum())
    assert rank < 10
    assert np.abs(R[1] / lengths @ Vt[rank:].T).max() < 1e-14 * 10
    # The good blocks beside it are no worse for it.
    assert_same_gram(R[0], good)
    np.testing.assert_array_equal(R[0], R[2])


@settings(max_examples=100, deadline=None)
@given(seed=SEEDS, z=st.integers(2, 16), missing=st.integers(1, 8), spread=st.floats(0, 3))
def test_any_rank_deficient_block_is_factored(seed, z, missing, spread):
    rng = np.random.default_rng(seed)
    rank = max(z - missing, 1)
    mix = rng.normal(size=(rank, z)) * 10.0 ** (spread * rng.normal(size=(rank, z)))
    Z = rng.normal(size=(80, rank)) @ mix
    full = rng.normal(size=(80, z))
    R = triangular_factors(np.stack([full, Z]))
    assert_same_gram(R[0], full)
    assert_same_gram(R[1], Z, 1e-12)


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, exponent=st.floats(-13, -1))
def test_nearly_dependent_columns_keep_their_difference(seed, exponent):
    """The part of one column that is not in the others is known to 1e-16 of that column."""
    rng = np.random.default_rng(seed)
    Z = rng.normal(size=(300, 6))
    new = rng.normal(size=300)
    Z[:, 5] = Z[:, :5].sum(axis=1) + 10.0**exponent * new
    R = triangular_factors(Z[None])[0]
    apart = R @ np.array([1.0, 1.0, 1.0, 1.0, 1.0, -1.0])
    expected = 10.0**exponent * np.linalg.norm(new)
    rounding = np.linalg.norm(Z[:, 5]) * 2e-16
    assert abs(np.linalg.norm(apart) - expected) < 1e-8 * expected + 20 * rounding


def test_columns_from_1e_minus_8_to_1e8_lose_nothing():
    rng = np.random.default_rng(6)
    Z = rng.normal(size=(500, 17))
    scales = 10.0 ** np.linspace(-8, 8, 17)
    plain = time_block_factors(Z, block_rows=100).total
    scaled = time_block_factors(Z * scales, block_rows=100).total
    np.testing.assert_allclose(scaled / scales, plain, atol=1e-13 * np.abs(plain).max())


def test_one_row_is_its_own_factor():
    R = time_block_factors(np.array([[3.0, -4.0, 5.0]]), block_rows=10).R[0]
    np.testing.assert_allclose(np.abs(R[0]), [3.0, 4.0, 5.0], rtol=1e-15)
    assert (R[1:] == 0).all()


def test_no_rows_are_refused():
    with pytest.raises(EstimationError, match="no rows to factor"):
        time_block_factors(np.zeros((0, 4)), block_rows=10)
    with pytest.raises(EstimationError, match="no factors to stack"):
        stack_factors([])
    with pytest.raises(EstimationError, match="no factors to merge"):
        merge_triangular(np.zeros((0, 4, 4)))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", [0, 3])
def test_nan_and_infinity_are_refused(value, column):
    Z = np.random.default_rng(0).normal(size=(50, 4))
    Z[17, column] = value
    with pytest.raises(EstimationError, match="NaN or infinite"):
        time_block_factors(Z, block_rows=20)


def test_numbers_too_large_to_square_are_refused():
    with pytest.raises(EstimationError, match="NaN or infinite"):
        triangular_factors(np.full((1, 30, 3), 1e200))


def test_stacked_factors_number_their_segments_on():
    Z = np.random.default_rng(0).normal(size=(90, 3))
    one = time_block_factors(Z[:50], block_rows=20)
    two = stack_factors([one, time_block_factors(Z[50:], block_rows=20)])
    three = stack_factors([two, one])
    assert two.segment.tolist() == [0, 0, 0, 1, 1]
    assert three.segment.tolist() == [0, 0, 0, 1, 1, 2, 2, 2]
    assert three.rows.tolist() == [20, 20, 10, 20, 20, 20, 20, 10]
    assert_same_gram(two.total, Z)
    kept = three.select(three.segment == 1)
    assert_same_gram(kept.total, Z[50:])
    assert len(kept) == 2


def test_blocks_in_succession_are_not_copied():
    Z = np.random.default_rng(2).normal(size=(90, 3))
    whole = time_block_factors(Z, block_rows=30)
    for keep, copied in (([False, True, True], False), ([True, False, True], True)):
        some = whole.select(np.array(keep))
        np.testing.assert_array_equal(some.R, whole.R[keep])
        assert np.shares_memory(some.R, whole.R) is not copied
    assert len(whole.select(np.zeros(3, dtype=bool))) == 0


def test_merged_factors_are_one_block_of_all_rows():
    Z = np.random.default_rng(0).normal(size=(90, 3))
    F = time_block_factors(Z, block_rows=20)
    F = Factors(
        R=F.R, rows=F.rows, segment=F.segment, band=np.array([[i, i + 1.0] for i in range(5)])
    )
    one = F.merged()
    assert one.rows.tolist() == [90]
    assert one.band.tolist() == [[0.0, 5.0]]
    np.testing.assert_array_equal(one.total, F.total)


def test_singular_blocks_keep_their_digits_and_change_no_other():
    """Their Gram matrices have lost them: these blocks alone are factored by Householder."""
    Z = np.random.default_rng(0).normal(size=(10, 50, 4))
    Z[2, :, 1] = 0.0
    for i, share in ((5, 1e-8), (7, 1e-9)):
        Z[i, :, 1] = Z[i, :, 0] * (1.0 + share * np.arange(50))
    R = triangular_factors(Z)
    for i in (2, 5, 7):
        pivots = np.abs(np.diagonal(np.linalg.qr(Z[i], mode="r")))
        np.testing.assert_allclose(np.diagonal(R[i]), pivots, rtol=1e-6)
    for i in (0, 1, 3, 4, 6, 8, 9):
        gram = Z[i].T @ Z[i]
        scale = np.sqrt(np.diagonal(gram))
        np.testing.assert_array_equal(
            R[i], np.linalg.cholesky(gram / (scale[:, None] * scale)).T * scale
        )
