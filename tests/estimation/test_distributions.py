"""The distributions agree with scipy.stats."""

import numpy as np
import pytest
from scipy import stats

from rotorfit.estimation import distributions

P = (0.5, 0.75, 0.975, 0.99, 0.999999)
DEGREES = np.array([1.0, 2.0, 2.5, 7.0, 30.0, 400.0, 1e5, np.inf])
RATIOS = (0.1, 1.0, 3.7, 40.0)


@pytest.mark.parametrize("p", P)
def test_student(p: float) -> None:
    quantile = np.asarray(stats.t.ppf(p, DEGREES), dtype=float)
    np.testing.assert_allclose(
        distributions.student_quantile(p, DEGREES), quantile, rtol=1e-12, atol=1e-15
    )
    for t, degrees in zip(quantile, DEGREES, strict=True):
        found = distributions.student_density(np.array([t, 0.3]), float(degrees))
        np.testing.assert_allclose(found, stats.t.pdf([t, 0.3], degrees), rtol=1e-11)


def test_tail_of_student_is_that_of_scipy_and_ends_as_the_normal() -> None:
    for degrees in (1.0, 3.5, 80.0):
        t = np.array([-2.0, 0.0, 1.0, 30.0])
        np.testing.assert_allclose(
            distributions.student_tail(t, degrees), stats.t.sf(t, degrees), rtol=1e-10
        )
    assert distributions.student_tail(3.0, np.inf) == pytest.approx(stats.norm.sf(3.0), rel=1e-14)


def test_student_without_degrees_of_freedom_is_unknown() -> None:
    assert np.isnan(distributions.student_quantile(0.975, 0))
    assert np.isnan(distributions.student_quantile(0.975, np.array([-1.0, 3.0]))).tolist() == [
        True,
        False,
    ]


@pytest.mark.parametrize("p", [*P, 1e-12])
def test_normal(p: float) -> None:
    x = float(stats.norm.isf(p))
    assert -distributions.normal_quantile(p) == pytest.approx(x, rel=1e-12, abs=1e-15)
    assert distributions.normal_tail(x) == pytest.approx(float(stats.norm.sf(x)), rel=1e-12)
    expected = float(stats.norm.pdf(x, scale=2.5))
    assert float(distributions.normal_density(x, 2.5)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("degrees", [(1.0, 4.0), (3.0, 60.0), (7.5, 2.0)])
def test_f(ratio: float, degrees: tuple[float, float]) -> None:
    expected = float(stats.f.sf(ratio, *degrees))
    assert distributions.f_tail(ratio, *degrees) == pytest.approx(expected, rel=1e-12)
    limit = float(stats.f.ppf(0.99, *degrees))
    assert distributions.f_quantile(0.99, *degrees) == pytest.approx(limit, rel=1e-12)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("degrees", [1, 2, 17])
def test_chi_square(ratio: float, degrees: int) -> None:
    expected = float(stats.chi2.sf(ratio, degrees))
    assert distributions.chi_square_tail(ratio, degrees) == pytest.approx(expected, rel=1e-12)
