"""A fit whose body shrinks to nothing is refused."""

import pytest

import made_fit
from rotorfit.errors import UnsettledError
from rotorfit.fit.joint.joint_fit import refuse_collapse


def test_a_body_that_shrinks_to_nothing_is_refused():
    joint, values = [made_fit.configuration()], {"Ixx@A": 0.01, "Iyy@A": 0.012, "Izz@A": 0.02}
    refuse_collapse(values, joint)
    with pytest.raises(
        UnsettledError, match=r"A: the rotors explain nothing .* 20 s of quick"
    ) as caught:
        refuse_collapse(values | {"Iyy@A": -1e-9}, joint)
    assert caught.value.reached["Iyy@A"] == -1e-9
