"""Bodies that cannot exist are said, taken back beyond their interval, and projected on request."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from made_tables import made_result, tables_of
from rotorfit.checks.impossible_inertia import (
    FLY,
    IMPOSSIBLE,
    SecondMoment,
    body_finding,
    negative_moment,
    negative_rotor_inertia,
    possible_sentence,
    second_moments,
    smallest_second_moment,
)
from rotorfit.errors import EstimationError
from rotorfit.estimation.consistent import nearest_consistent
from rotorfit.fit.experiment.payload import MOMENTS
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.model.parameters import INERTIA, inertia_matrix
from rotorfit.results.assemble import with_diagnosis
from rotorfit.results.physical_inertia import nine_moments, project_to_physical
from rotorfit.results.result import Derived, IdentificationResult, Parameter

MASS = 1.2


def number(name, value, *, std=1e-4, configuration="A"):
    interval = (value - 1.96 * std, value + 1.96 * std)
    return Parameter(
        name=name,
        configuration=configuration,
        value=value,
        std=std,
        interval=interval,
        unit="kg m^2",
        verdict="identified",
    )


def result_of(values, covariance):
    std = np.sqrt(np.diagonal(covariance)).tolist()
    moments = [number(n, v, std=s) for n, v, s in zip(MOMENTS, values.tolist(), std, strict=True)]
    return IdentificationResult(
        name="made",
        method="banded",
        parameters=(number("mass", MASS), *moments),
        derived=(),
        flights=(),
        covariance_names=tuple(f"{name}@A" for name in MOMENTS),
        covariance=covariance,
        settings={},
        versions={},
    )


def numbers_of(inertia, half):
    names = tuple(f"{name}_com@A" for name in INERTIA)
    return Numbers(
        names=names,
        values=np.array(inertia),
        terms=made_fit.known_to(np.full(6, half)),
        correlation=np.eye(6),
        excitation={},
    )


def without_impossible(result):
    """Return a result whose body A was found impossible."""
    names = [one.full_name for one in (*result.parameters, *result.derived)]
    moment = SecondMoment(value=-1e-3, half_width=1e-4, share=-0.1)
    finding = body_finding(moment, "A", result.parameters, names)
    return made_result(with_diagnosis(tables_of(result), [finding]))


def pseudo_inertia(values):
    P = np.zeros((4, 4))
    P[:3, :3] = second_moments(inertia_matrix(np.array(values[3:])))
    P[:3, 3] = P[3, :3] = values[:3]
    P[3, 3] = MASS
    return P


def point_masses(seed):
    """Return the nine moments of random point masses of 1.2 kg in all: a body that exists."""
    rng = np.random.default_rng(seed)
    m = rng.dirichlet(np.ones(8)) * MASS
    r = rng.normal(scale=0.1, size=(8, 3))
    second = np.einsum("i,ij,ik->jk", m, r, r)
    I = np.trace(second) * np.eye(3) - second
    elements = [I[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return np.array([*(m @ r), *elements]), second


def random_covariance(seed, size=9, scale=1e-3):
    root = np.random.default_rng(seed).normal(size=(size, size)) * scale
    return root @ root.T + 1e-2 * scale**2 * np.eye(size)


def test_second_moments_are_those_of_the_mass():
    for seed in range(5):
        values, second = point_masses(seed)
        np.testing.assert_allclose(second_moments(inertia_matrix(values[3:])), second, atol=1e-15)


def test_a_body_that_exists_stays_as_it_is():
    for seed in range(5):
        values, _ = point_masses(seed)
        projected = project_to_physical(result_of(values, random_covariance(seed)))
        assert projected.distance == 0.0
        assert list(projected.values.values()) == pytest.approx(values.tolist(), rel=1e-12)


def test_a_diagonal_body_is_projected_as_by_hand():
    # Izz over Ixx + Iyy by 3e-3: with equal variances each takes a third of it.
    values = np.array([0.0, 0.0, 0.0, 0.010, 0.011, 0.024, 0.0, 0.0, 0.0])
    projected = project_to_physical(result_of(values, np.diag([1e-4**2] * 9)))
    found = [projected.values[name] for name in ("Ixx", "Iyy", "Izz")]
    assert found == pytest.approx([0.011, 0.012, 0.023], abs=2e-8)
    assert projected.distance == pytest.approx(np.sqrt(3.0) * 10.0, rel=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_the_nearest_body_is_that_of_cvxpy(seed):
    cvxpy = pytest.importorskip("cvxpy")
    values, _ = point_masses(seed)
    values = values + np.array([0.02, -0.03, 0.01, -0.02, 0.0, 0.02, 4e-3, -6e-3, 3e-3])
    C = random_covariance(seed + 10)
    assert np.linalg.eigvalsh(pseudo_inertia(values))[0] < 0
    projected = project_to_physical(result_of(values, C))
    x = cvxpy.Variable(9)
    root = np.linalg.inv(np.linalg.cholesky(C))
    base = pseudo_inertia(np.zeros(9))
    P = base + sum(x[i] * (pseudo_inertia(unit) - base) for i, unit in enumerate(np.eye(9)))
    problem = cvxpy.Problem(cvxpy.Minimize(cvxpy.sum_squares(root @ (x - values))), [P >> 0])
    problem.solve(solver="SCS", eps=1e-9, max_iters=100_000)
    std = np.sqrt(np.diagonal(C))
    found = np.array([projected.values[name] for name in MOMENTS])
    assert np.abs((found - x.value) / std).max() < 2e-3
    assert projected.distance == pytest.approx(np.sqrt(problem.value), rel=1e-3)
    assert np.linalg.eigvalsh(pseudo_inertia(found))[0] > 0


def test_what_is_unknown_cannot_be_projected():
    values, _ = point_masses(0)
    whole = result_of(values, random_covariance(0))
    lost = tuple(
        replace(p, value=None, interval=None, std=None) if p.name == "Izz" else p
        for p in whole.parameters
    )
    with pytest.raises(EstimationError, match=r"A: Izz not known.*fly what the result advises"):
        project_to_physical(replace(whole, parameters=lost))
    with pytest.raises(EstimationError, match="deviation of every parameter"):
        nearest_consistent(np.zeros(1), np.zeros((1, 1)), (np.eye(2), np.eye(2)[None]))


def test_a_product_that_is_not_known_is_free_in_the_projection():
    values = np.array([0.0, 0.0, 0.0, 0.010, 0.011, 0.024, 0.0, 0.0, 0.0])
    whole = result_of(values, np.diag([1e-4**2] * 9))
    lost = tuple(
        replace(p, value=None, interval=None, std=None) if p.name in ("Iyz", "msz") else p
        for p in whole.parameters
    )
    keep = [i for i, name in enumerate(MOMENTS) if name not in ("Iyz", "msz")]
    projected = project_to_physical(
        replace(
            whole,
            parameters=lost,
            covariance_names=tuple(whole.covariance_names[i] for i in keep),
            covariance=whole.covariance[np.ix_(keep, keep)],
        )
    )
    found = [projected.values[name] for name in ("Ixx", "Iyy", "Izz", "Iyz")]
    assert found == pytest.approx([0.011, 0.012, 0.023, 0.0], abs=2e-8)


def test_withheld_impossible_inertia_is_projected_from_its_value():
    values = np.array([0.0, 0.0, 0.0, 0.010, 0.011, 0.024, 0.0, 0.0, 0.0])
    whole = result_of(values, np.diag([1e-4**2] * 9))
    left = without_impossible(replace(whole, diagnostics={"other": 1.0}))
    assert all(p.value is None for p in left.parameters if p.name in INERTIA)
    assert left.diagnostics["other"] == 1.0
    projected = project_to_physical(left)
    found = [projected.values[name] for name in ("Ixx", "Iyy", "Izz")]
    assert found == pytest.approx([0.011, 0.012, 0.023], abs=2e-8)


def test_of_several_configurations_one_must_be_named():
    values, _ = point_masses(0)
    whole = result_of(values, random_covariance(0))
    two = replace(whole, parameters=(*whole.parameters, number("mass", MASS, configuration="B")))
    with pytest.raises(EstimationError, match=r"2 configurations \(A, B\): name the one"):
        project_to_physical(two)
    assert project_to_physical(two, "A").distance == 0.0
    words = "no configuration 'Q' in this result; it has A, B: name one of them"
    with pytest.raises(EstimationError, match=words):
        project_to_physical(two, "Q")


def test_the_smallest_second_moment_and_its_interval():
    I = inertia_matrix(np.array([0.010, 0.012, 0.020, 1e-3, 0.0, -5e-4]))
    elements = [0.010, 0.012, 0.020, 1e-3, 0.0, -5e-4]
    moment = smallest_second_moment(numbers_of(elements, 1e-3), "A")
    low, middle, high = np.linalg.eigvalsh(I)
    assert moment.value == pytest.approx((low + middle - high) / 2.0, rel=1e-9)
    rng = np.random.default_rng(0)
    drawn = np.array(elements) + 1e-5 / 1.96 * rng.normal(size=(4000, 6))
    scatter = np.std([np.linalg.eigvalsh(second_moments(inertia_matrix(one)))[0] for one in drawn])
    small = smallest_second_moment(numbers_of(elements, 1e-5), "A")
    assert small.half_width == pytest.approx(1.96 * scatter, rel=0.05)
    assert possible_sentence(moment, "A") is None
    unbounded = smallest_second_moment(numbers_of(elements, np.inf), "A")
    assert unbounded.half_width == np.inf


def test_correlated_moment_errors_barely_move_the_smallest_sum():
    """(Ixx + Iyy - Izz) / 2 of a diagonal body: h / 2 where all three go together."""
    numbers = numbers_of([0.010, 0.012, 0.020, 0.0, 0.0, 0.0], 1e-3)
    apart = smallest_second_moment(numbers, "A")
    assert apart.half_width == pytest.approx(0.5e-3 * np.sqrt(3.0))
    alike = np.eye(6)
    alike[:3, :3] = 1.0
    together = smallest_second_moment(replace(numbers, correlation=alike), "A")
    assert together.half_width == pytest.approx(0.5e-3)


@pytest.mark.parametrize(("half_width", "impossible"), [(0.99, True), (1.01, False)])
def test_a_body_is_impossible_where_its_whole_interval_is(half_width, impossible):
    moment = SecondMoment(value=-1.0, half_width=half_width, share=-0.1)
    assert moment.impossible is impossible


def test_unknown_moments_get_the_largest_physical_deviation():
    """Half of the root of 0.01 * 0.04 for Ixy, of 1.2 kg * 0.04 for a first moment."""
    values = np.array([0.0, 0.0, 0.0, 0.01, 0.04, 0.04, 0.0, 0.0, 0.0])
    result = result_of(values, np.diag([1e-4**2] * 9))
    unknown = tuple(
        replace(p, value=None) if p.name in ("msx", "Ixy") else p for p in result.parameters
    )
    known = tuple(name for name in result.covariance_names if name not in ("msx@A", "Ixy@A"))
    partly = replace(
        result, parameters=unknown, covariance_names=known, covariance=np.diag([1e-4**2] * 7)
    )
    _, covariance, mass = nine_moments(partly, None)
    std = dict(zip(MOMENTS, np.sqrt(np.diagonal(covariance)).tolist(), strict=True))
    assert mass == MASS
    assert std["Ixy"] == pytest.approx(0.01)
    assert std["msx"] == pytest.approx(0.5 * np.sqrt(0.048))
    assert std["Ixz"] == std["msy"] == pytest.approx(1e-4)


def test_a_body_that_may_exist_within_its_interval_is_noted():
    moment = smallest_second_moment(numbers_of([0.01, 0.01, 0.021, 0, 0, 0], 2e-3), "A")
    assert not moment.impossible
    words = possible_sentence(moment, "A")
    assert words is not None
    assert words.startswith(f"A: {IMPOSSIBLE} (by 2.4 %)")
    assert "intervals allow" in words
    shown = [number(name, 0.01) for name in INERTIA]
    found = body_finding(moment, "A", shown, [p.full_name for p in shown])
    assert (found.severity, found.sentence) == ("note", words)


def test_a_moment_below_nothing_withholds_the_body(assert_text, assert_wording):
    """Though the other moments are unknown: with its whole interval, and only where reported."""
    numbers = numbers_of([-6e-4, 7e-4, 9e-4, 0.0, 0.0, 0.0], 4e-4)
    numbers = replace(numbers, terms=made_fit.known_to([4e-4, np.inf, np.inf, 1.0, 1.0, 1.0]))
    shown = [number("Ixx", -6e-4, std=2e-4)]
    found = negative_moment(numbers, "A", shown)
    assert found.numbers == tuple(f"{name}_com@A" for name in INERTIA)
    assert "negative, (-6.0 +- 4.0)e-04" in found.sentence
    assert "kg m^2: the" in found.sentence
    assert_wording(found.sentence)
    assert found.evidence[0].interval == pytest.approx((-1e-3, -2e-4))
    assert "[airframe]" in found.next_step
    assert_text(found.withheld_because)
    wide = replace(numbers, terms=made_fit.known_to(np.full(6, 7e-4)))
    assert negative_moment(wide, "A", shown) is None
    assert negative_moment(numbers, "A", [replace(shown[0], value=None)]) is None


@pytest.mark.parametrize(("Jr", "half", "doubted"), [(-4e-7, 1e-7, 1), (-1.5e-7, 1e-7, 0)])
def test_a_surely_negative_rotor_inertia_puts_yaw_in_doubt(Jr, half, doubted):
    """An interval that is negative by chance, of rotors with next to no inertia, does not."""
    numbers = made_fit.no_numbers("Jr", values=(Jr,), half_width=(half,))
    found = list(negative_rotor_inertia(made_fit.fit([], numbers)))
    assert len(found) == doubted
    for one in found:
        assert {"Jr", "kd_over_Izz", "Izz_com"} < set(one.numbers)
        assert not {"kt", "Ixx_com"} & set(one.numbers)
        assert one.doubtful_because
        assert "(-4.0 +- 1.0)e-07 kg m^2" in one.sentence


def test_so_does_one_that_is_known_over_the_inertia_alone():
    names = ("Jr", "Jr_over_Izz@A")
    numbers = made_fit.no_numbers(*names, values=(-3e-8, -3.3e-3), half_width=(np.inf, 2.8e-4))
    (found,) = negative_rotor_inertia(made_fit.fit([], numbers))
    assert "-0.00330 +- 0.00028" in found.sentence
    assert found.is_about("Jr_over_Izz@A")


def test_impossible_inertia_is_withheld_with_the_yaw_scale():
    moment = smallest_second_moment(numbers_of([0.01, 0.01, 0.03, 0, 0, 0], 1e-3), "A")
    assert moment.impossible
    shared = [number(n, 1e-8, configuration=None) for n in ("kt", "kd", "Jr")]
    other = [number(n, 0.02, configuration="B") for n in ("Ixx", "Izz")]
    shown = [*shared, *(number(n, 0.01) for n in ("msx", *INERTIA)), *other]
    derived = [
        Derived(name=n, configuration="A", value=1.0, std=0.1, interval=(0.8, 1.2), unit="")
        for n in ("com_x", "Ixx_com", "Izz_over_kt", "kd_over_kt", "kd_over_Izz", "Jr_over_Izz")
    ]
    names = tuple(f"{p.name}@{p.configuration}" if p.configuration else p.name for p in shown)
    whole = replace(
        result_of(np.zeros(9), np.eye(9)),
        parameters=tuple(shown),
        derived=tuple(derived),
        covariance_names=names,
        covariance=np.diag(np.arange(1.0, 13.0)),
    )
    left = without_impossible(whole)
    for parameter in left.parameters:
        scale = parameter.name in ("kd", "Jr", "Izz")  # its ratios are known, but not at B
        lost = scale or (parameter.configuration == "A" and parameter.name in INERTIA)
        assert (parameter.value is None) is lost
        assert (parameter.reason == IMPOSSIBLE) is lost
        ratio = scale and parameter.configuration != "B"
        assert (parameter.verdict == "ratio-only") is ratio
        assert (parameter.verdict == "not-identified") is (lost and not ratio)
        assert parameter.partner == ({"Izz": "kd"}.get(parameter.name, "Izz") if ratio else None)
    assert [d.value is None for d in left.derived] == [False, True, True, True, False, False]
    assert left.covariance_names == ("kt", "msx@A", "Ixx@B")
    np.testing.assert_array_equal(left.covariance, np.diag([1.0, 4.0, 11.0]))
    assert left.findings[0].next_step == FLY
