"""`frozen_dataclass` makes what `dataclass(frozen=True, slots=True, kw_only=True)` makes."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
from dataclasses import field
from typing import Any

import pytest

from rotorfit.frozen_dataclass import frozen_dataclass

standard = dataclasses.dataclass(frozen=True, slots=True, kw_only=True)


class Body:
    """A rigid body."""

    mass: float
    name: str = "quad"
    moments: list[float] = field(default_factory=list[float], hash=False)
    secret: int = field(default=3, repr=False, compare=False)
    weight: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "weight", 9.81 * self.mass)


class Named:
    """A class that compares and shows itself in its own way."""

    name: str

    def __eq__(self, other: object) -> bool:
        return True

    def __hash__(self) -> int:
        return 7

    def __repr__(self) -> str:
        return "named"


def twins(plain: type) -> tuple[Any, Any]:
    """Make one class twice, by the library and by ours."""
    names = {"__dict__", "__weakref__"}
    body = {name: value for name, value in vars(plain).items() if name not in names}
    return standard(type("Twin", (), dict(body))), frozen_dataclass(type("Twin", (), dict(body)))


LIBRARY, OURS = twins(Body)


@frozen_dataclass
class Pickled:
    """A class that can be found by its name."""

    one: int
    two: tuple[str, ...] = ()


@pytest.mark.parametrize(
    "values",
    [
        {"mass": 1.5},
        {"mass": 2.0, "name": "hexa", "moments": [1.0, 2.0], "secret": 9},
        {},
        {"name": "no mass"},
        {"mass": 1.0, "colour": "red"},
        {"mass": 1.0, "weight": 3.0},
    ],
)
def test_instances_are_those_of_the_library(values: dict[str, Any]) -> None:
    try:
        expected = LIBRARY(**values)
    except TypeError:
        with pytest.raises(TypeError):
            OURS(**values)
        return
    made = OURS(**values)
    assert repr(made) == repr(expected)
    assert hash(made) == hash(expected)
    assert dataclasses.asdict(made) == dataclasses.asdict(expected)
    assert [f.name for f in dataclasses.fields(made)] == [
        f.name for f in dataclasses.fields(expected)
    ]


def test_a_default_is_made_anew_for_each_instance() -> None:
    OURS(mass=1.0).moments.append(4.0)
    assert OURS(mass=1.0).moments == []


def test_equality_and_hash_leave_out_what_is_not_compared() -> None:
    assert OURS(mass=1.0, secret=1) == OURS(mass=1.0, secret=2)
    assert OURS(mass=1.0) != OURS(mass=2.0)
    assert OURS(mass=1.0) != LIBRARY(mass=1.0)
    assert hash(OURS(mass=1.0, moments=[1.0])) == hash(OURS(mass=1.0))


def test_nothing_changes_an_instance() -> None:
    made = OURS(mass=1.0)
    with pytest.raises(dataclasses.FrozenInstanceError, match="mass"):
        made.mass = 2.0
    with pytest.raises(dataclasses.FrozenInstanceError, match="mass"):
        del made.mass
    with pytest.raises(dataclasses.FrozenInstanceError, match="colour"):
        made.colour = "red"
    assert made.mass == 1.0


def test_replace_makes_another_instance() -> None:
    changed = dataclasses.replace(OURS(mass=1.0, name="a"), mass=2.0)
    assert (changed.mass, changed.name, changed.weight) == (2.0, "a", 19.62)


def test_copies_and_pickles_are_equal() -> None:
    made = Pickled(one=1, two=("a",))
    assert pickle.loads(pickle.dumps(made)) == made
    assert copy.deepcopy(made) == made
    assert copy.copy(made) is not made


def test_methods_of_the_class_stay() -> None:
    library, ours = twins(Named)
    for one in (library, ours):
        assert one(name="a") == one(name="b")
        assert hash(one(name="a")) == 7
        assert repr(one(name="a")) == "named"


@pytest.mark.parametrize("decorate", [standard, frozen_dataclass])
def test_a_class_stands_upon_another(decorate: Any) -> None:
    class More(Pickled):
        """One field more."""

        three: float

    more = decorate(More)
    assert dataclasses.astuple(more(one=1, three=2.0)) == (1, (), 2.0)
    assert list(inspect.signature(more).parameters) == ["one", "two", "three"]
    with pytest.raises(dataclasses.FrozenInstanceError):
        more(one=1, three=2.0).one = 3


def test_the_signature_names_the_fields() -> None:
    ours = inspect.signature(Pickled).parameters
    assert {name: one.default for name, one in ours.items()} == {
        "one": inspect.Parameter.empty,
        "two": (),
    }
    assert inspect.signature(OURS).parameters.keys() == inspect.signature(LIBRARY).parameters.keys()
