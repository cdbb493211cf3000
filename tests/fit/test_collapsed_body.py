"""A fit whose body shrinks to nothing is refused."""

from types import SimpleNamespace

import pytest

from made_fit import QUAD
from rotorfit.errors import UnsettledError
from rotorfit.fit.joint.joint_fit import refuse_collapse


def fitted(Iyy):
    values = {"Ixx@A": 0.01, "Iyy@A": Iyy, "Izz@A": 0.02}
    return SimpleNamespace(estimate=SimpleNamespace(by_name=values))


def test_a_body_that_shrinks_to_nothing_is_refused():
    joint = [SimpleNamespace(name="A", mass=1.4, vehicle=QUAD)]
    refuse_collapse(fitted(0.012), joint)
    with pytest.raises(
        UnsettledError, match=r"A: the rotors explain nothing .* 20 s of quick"
    ) as e:
        refuse_collapse(fitted(-1e-9), joint)
    assert e.value.reached["Iyy@A"] == -1e-9
