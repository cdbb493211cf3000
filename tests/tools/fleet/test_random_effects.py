"""Groups about a mean against dense Gaussian algebra, the analysis of variance, and truth."""

import numpy as np
import pytest
from scipy import optimize, stats

from rotorfit.errors import EstimationError
from rotorfit.tools.fleet.random_effects import (
    LEAST_GROUPS,
    RandomEffects,
    Repeated,
    random_effects,
    restricted_cost,
)


def repeated(
    values: np.ndarray,
    covariance: np.ndarray,
    group: np.ndarray,
    changes: np.ndarray | None = None,
) -> Repeated:
    n, p = values.shape
    none = np.zeros((n, p, 0))
    return Repeated(
        values=values,
        covariance=covariance,
        group=group,
        changes=none if changes is None else changes,
    )


def drawn(
    rng: np.random.Generator,
    *,
    groups: int,
    repeats: int,
    std: float = 1.0,
    within: float = 0.5,
    between: float = 2.0,
) -> tuple[Repeated, np.ndarray]:
    """One number, and the true level of each group."""
    level = 7.0 + between * rng.standard_normal(groups)
    group = np.repeat(np.arange(groups), repeats)
    n = len(group)
    noise = np.hypot(std, within) * rng.standard_normal(n)
    values = (level[group] + noise)[:, None]
    return repeated(values, np.full((n, 1, 1), std**2), group), level


def dense_cost(data: Repeated, log_std: np.ndarray) -> float:
    """-2 log of the density of all contrasts free of fixed effects, from full matrices."""
    n, p = data.values.shape
    B, W = np.exp(2 * log_std[p:]), np.exp(2 * log_std[:p])
    V = np.zeros((n * p, n * p))
    for i in range(n):
        for j in range(n):
            if data.group[i] == data.group[j]:
                V[i * p : (i + 1) * p, j * p : (j + 1) * p] += np.diag(B)
        V[i * p : (i + 1) * p, i * p : (i + 1) * p] += np.diag(W) + data.covariance[i]
    columns = [np.tile(np.eye(p), (n, 1))]
    for g in range(data.groups):
        own = np.where((data.group == g)[:, None, None], data.changes, 0.0)
        own = own.reshape(n * p, -1)
        columns.append(own[:, np.abs(own).sum(axis=0) > 0])
    X, y = np.hstack(columns), data.values.ravel()
    kept = np.isfinite(y)
    X, y, V = X[kept], y[kept], V[np.ix_(kept, kept)]
    P = np.linalg.inv(V)
    C = X.T @ P @ X
    r = y - X @ np.linalg.solve(C, X.T @ P @ y)
    return float(np.linalg.slogdet(V)[1] + np.linalg.slogdet(C)[1] + r @ P @ r)


def test_the_likelihood_is_that_of_the_dense_matrices():
    rng = np.random.default_rng(3)
    n, p = 14, 2
    group = rng.integers(0, 4, n)
    group[:4] = range(4)
    root = rng.standard_normal((n, p, p))
    values = rng.standard_normal((n, p))
    values[rng.random((n, p)) < 0.2] = np.nan
    changes = np.zeros((n, p, 1))
    changes[group == 1, 0, 0] = np.arange((group == 1).sum())
    data = repeated(values, root @ root.transpose(0, 2, 1) + 0.1 * np.eye(p), group, changes)
    points = rng.normal(0.0, 1.0, (4, 2 * p))
    ours = [restricted_cost(data, x) for x in points]
    theirs = [dense_cost(data, x) for x in points]
    assert np.ptp(np.subtract(ours, theirs)) < 1e-9


def test_balanced_groups_give_the_analysis_of_variance():
    data, _ = drawn(np.random.default_rng(5), groups=8, repeats=5, std=0.0)
    table = data.values.reshape(8, 5)
    inside = table.var(axis=1, ddof=1).mean()
    across = 5 * table.mean(axis=1).var(ddof=1)
    found = optimize.minimize(
        lambda x: restricted_cost(data, x), np.zeros(2), method="Nelder-Mead", tol=1e-10
    ).x
    assert np.exp(2 * found) == pytest.approx([inside, (across - inside) / 5], rel=1e-4)


def test_one_repeat_each_is_a_meta_analysis():
    """The mean by the weights of DerSimonian and Laird, their variance between groups given."""
    rng = np.random.default_rng(7)
    v = rng.uniform(0.5, 2.0, 12)
    y = 3.0 + rng.standard_normal(12) * np.sqrt(v + 1.5)
    data = repeated(y[:, None], v[:, None, None], np.arange(12))
    found = random_effects(data)
    assert np.isnan(found.within[0])  # nobody flew twice
    w = 1 / (v + found.between[0] ** 2)
    assert found.mean[0] == pytest.approx(w @ y / w.sum(), abs=0.05)
    assert found.level[:, 0] == pytest.approx(y)
    assert np.all(np.abs(found.shrunk[:, 0] - found.mean[0]) < np.abs(y - found.mean[0]))


def test_units_do_not_matter():
    data, _ = drawn(np.random.default_rng(1), groups=6, repeats=4)
    found = random_effects(data)
    small = random_effects(repeated(1e-6 * data.values, 1e-12 * data.covariance, data.group))
    assert small.shrunk == pytest.approx(1e-6 * found.shrunk, rel=1e-6)
    assert small.within == pytest.approx(1e-6 * found.within, rel=1e-4)


def test_a_repeat_that_shows_one_ratio_only():
    """Two numbers known by their difference only: the covariance says it, the levels follow."""
    rng = np.random.default_rng(2)
    g, n = 10, 5
    level = rng.standard_normal((g, 2))
    group = np.repeat(np.arange(g), n)
    blind = 1e6 * np.ones((2, 2)) + 0.01 * np.eye(2)
    noise = 1e3 * rng.standard_normal((g * n, 1)) + 0.1 * rng.standard_normal((g * n, 2))
    found = random_effects(repeated(level[group] + noise, np.tile(blind, (g * n, 1, 1)), group))
    ratio = np.array([1.0, -1.0])
    std = np.sqrt(ratio @ found.level_covariance @ ratio)
    assert np.all(std < 0.15)
    assert np.all(np.abs((found.level - level) @ ratio) < 4 * std)
    assert np.all(np.sqrt(found.level_covariance[:, 0, 0]) > 100.0)


def test_an_unknown_level_is_the_mean_of_the_others():
    data, _ = drawn(np.random.default_rng(4), groups=7, repeats=3)
    values = data.values.copy()
    values[data.group == 2] = np.nan
    found = random_effects(repeated(values, data.covariance, data.group))
    assert np.isnan(found.level[2, 0])
    assert found.shrunk[2, 0] == pytest.approx(found.mean[0])
    assert found.shrunk_covariance[2, 0, 0] > found.between[0] ** 2


def test_few_groups_are_not_drawn_to_a_mean():
    data, _ = drawn(np.random.default_rng(4), groups=LEAST_GROUPS - 1, repeats=6)
    found = random_effects(data)
    assert np.isnan(found.between[0])
    assert np.isnan(found.shrunk).all()
    assert np.isfinite(found.level).all()


def test_a_number_that_nobody_knows_is_refused():
    with pytest.raises(EstimationError, match="no value in any flight"):
        random_effects(repeated(np.full((3, 1), np.nan), np.ones((3, 1, 1)), np.arange(3)))


def test_a_column_of_changes_leaves_the_level_before_them():
    rng = np.random.default_rng(6)
    data, level = drawn(rng, groups=6, repeats=20, std=0.1, within=0.1)
    step = np.where((data.group == 3) & (np.arange(120) >= 70), 1.0, 0.0)
    moved = repeated(
        data.values + 50.0 * step[:, None], data.covariance, data.group, step[:, None, None]
    )
    found = random_effects(moved)
    assert np.abs(found.level[:, 0] - level) == pytest.approx(0.0, abs=0.2)
    assert found.within[0] < 0.2


@pytest.fixture(scope="module")
def fleets() -> list[tuple[RandomEffects, np.ndarray]]:
    """Forty fleets whose groups differ by less than a group's own repeats tell."""
    rng = np.random.default_rng(11)
    drawings = [drawn(rng, groups=12, repeats=6, between=0.3) for _ in range(40)]
    return [(random_effects(data), level) for data, level in drawings]


@pytest.mark.parametrize("kind", ["level", "shrunk"])
def test_intervals_hold_the_truth_as_often_as_stated(fleets, kind):
    misses = [
        (getattr(f, kind)[:, 0] - level) / np.sqrt(getattr(f, f"{kind}_covariance")[:, 0, 0])
        for f, level in fleets
    ]
    inside = np.mean(np.abs(misses) < stats.norm.ppf(0.975))
    assert 0.93 <= inside <= 0.98


def test_shrunk_levels_are_nearer_to_the_truth(fleets):
    def rms(kind: str) -> float:
        return float(np.sqrt(np.mean([(getattr(f, kind)[:, 0] - x) ** 2 for f, x in fleets])))

    assert rms("shrunk") < 0.7 * rms("level")
