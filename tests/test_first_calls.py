"""Shapes are checked at a function's first calls in each test."""

import ast
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float, TypeCheckError
from jaxtyping._import_hook import Typechecker

import first_calls
from rotorfit.estimation.parameter_map import ParameterMap, parameter_map
from rotorfit.results.samples import normal_draws

OBLONG = np.ones((2, 3))


@pytest.fixture(autouse=True)
def _types_are_checked(pytestconfig):
    if not pytestconfig.getoption("jaxtyping_packages"):
        pytest.skip("wants --jaxtyping-packages=rotorfit,first_calls.checked")


def drawn(covariance):
    return normal_draws(covariance, 1, np.random.default_rng(1))


def test_a_wrong_shape_is_refused_at_the_first_calls_of_a_test():
    with pytest.raises(TypeCheckError):
        drawn(OBLONG)
    for _ in range(first_calls.CALLS if np.isfinite(first_calls.CALLS) else 0):
        drawn(np.eye(2))
    if np.isfinite(first_calls.CALLS):
        with pytest.raises(np.linalg.LinAlgError):
            drawn(OBLONG)
    first_calls.check_all_again()
    with pytest.raises(TypeCheckError):
        drawn(OBLONG)


def test_methods_are_left_out_too():
    made = parameter_map(("a",), {"a": {(0, "a"): 1.0}}, {})
    for _ in range(100):
        made.theta(np.zeros(1))
    left = getattr(ParameterMap.theta.__wrapped__, "__no_type_check__", False)
    assert left == np.isfinite(first_calls.CALLS)


def test_a_function_within_another_is_checked_at_first_too():
    @first_calls.checked_at_first
    def total(values: Float[np.ndarray, " n"]) -> float:
        return float(values.sum())

    with pytest.raises(TypeCheckError):
        total(OBLONG)
    for _ in range(100):
        total(np.ones(2))
    if np.isfinite(first_calls.CALLS):
        assert total(OBLONG) == 6.0


@pytest.mark.parametrize(
    ("head", "checked"),
    [
        ("(self: Any, **values: Any) -> None", False),
        ("(*args: object)", False),
        ("(x: Any) -> float", True),
        ("(x: Float[np.ndarray, ' n']) -> None", True),
    ],
)
def test_a_function_of_anything_is_not_decorated(head, checked):
    tree = ast.parse(f"def f{head}: ...")
    first_calls.TransformerWithTypes(typechecker=Typechecker("first_calls.checked")).visit(tree)
    assert ("checked_at_first" in ast.unparse(tree)) == checked


def test_what_is_typed_and_what_is_not_is_there():
    tests = Path(__file__).parent
    assert all((tests / one).exists() for one in (*first_calls.TYPED, *first_calls.UNTYPED))
    assert first_calls.is_typed(tests / "model" / "test_regressor.py")
    if not first_calls.ALL_CALLS:
        assert not first_calls.is_typed(tests / "fit" / "motor_law" / "test_command_law.py")
        assert not first_calls.is_typed(tests / "report" / "test_text.py")
