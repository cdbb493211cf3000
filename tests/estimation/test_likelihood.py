"""The likelihood as `docs/theory.md` writes it, term by term."""

import re
from pathlib import Path

import numpy as np
import pytest
from test_feedback import two_axes

from rotorfit.estimation.banded_equations import evaluated

ROOT = Path(__file__).parents[2]
SECTION = (ROOT / "docs" / "theory.md").read_text("utf-8").partition("term by term")[2]
NAMED = re.findall(r"\]\(\.\./(src/[\w/]+\.py)\)((?: `[\w.]+`,?)*)", SECTION)


def plain_cost(problem, phi):
    """Sum the terms of minus twice the log-likelihood, block by block and error by error."""
    (factors,), (tensor,), response = problem.factors, problem.tensors, problem.feedback
    theta = problem.map.constant[0] + problem.map.matrix[0] @ phi
    B = sum(value * A for value, A in zip(theta, tensor, strict=True))
    G = np.linalg.solve(B[:, list(problem.noisy)], B)
    times = [phi[problem.map.names.index(name)] for name in problem.moving]
    cost = 0.0
    for b, rows in enumerate(factors.rows):
        Z = np.zeros((factors.slopes.shape[2], G.shape[1]))
        Z[: len(factors.R[b])] = factors.R[b]
        Z += sum(dt * slope for dt, slope in zip(times, factors.slopes[b], strict=True))
        for j in range(len(G)):
            square = float(np.sum((Z @ G[j]) ** 2))
            cost += rows * np.log(square / rows)
            own = response.responses[0]
            effect = own.moves[b, j] @ G[j, list(response.inputs)]
            effect = effect if effect.real >= 0 else -effect
            T = own.complementary_sensitivity[b, j]
            cost -= 2.0 * own.rows[b, j] * (T * np.log(effect)).real
            cost -= 2.0 * own.rows[b, j] * (T * (own.log_effect_slopes[b, j] @ times)).real
    for name, value in zip(problem.map.names, phi, strict=True):
        if np.isfinite(problem.prior_std.get(name, np.inf)):
            cost += ((value - problem.prior_mean.get(name, 0.0)) / problem.prior_std[name]) ** 2
    return cost


@pytest.mark.parametrize("seed", range(20))
def test_the_cost_is_the_sum_of_the_documented_terms(seed):
    problem = two_axes(seed)
    phi = 0.3 * np.random.default_rng(seed).normal(size=len(problem.map.names))
    assert evaluated(problem, phi).cost == pytest.approx(plain_cost(problem, phi), rel=1e-10)


def test_functions_of_the_terms_are_where_the_page_says():
    assert len(NAMED) >= 8
    for path, names in NAMED:
        text = (ROOT / path).read_text("utf-8")
        for name in re.findall(r"`([\w.]+)`", names):
            assert re.search(rf"(def|class) {name.split('.')[-1]}\b", text), (path, name)
