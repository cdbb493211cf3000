"""What flights cannot tell apart is said in words, and only where it matters."""

from dataclasses import replace

import numpy as np
import pytest

import flown
from rotorfit.checks.weak_directions import (
    WeakDirection,
    body_directions,
    condition_number,
    condition_words,
    weak_sentence,
)
from rotorfit.estimation.estimate import Estimate
from rotorfit.simulation import STILL, Scenario


def estimate(names, values, information):
    return Estimate(
        names=names,
        values=np.array(values),
        covariance=np.linalg.inv(information),
        condition_number=1.0,
    )


def test_a_ratio_is_called_a_ratio(assert_wording):
    # Two equations: kd / Izz known to 1e-3, the sizes to 50 %, in units far apart; kt by itself.
    kd, Izz, kt = 5e-8, 0.03, 3e-6
    rows = np.array([[1e3 / kd, -1e3 / Izz, 0.0], [2.0 / kd, 0.0, 0.0], [0.0, 0.0, 100.0 / kt]])
    made = estimate(("kd", "Izz@A", "kt"), [kd, Izz, kt], rows.T @ rows)
    directions = body_directions(made)
    assert list(directions[0].parts) in (["kd", "Izz@A"], ["Izz@A", "kd"])
    assert directions[0].is_ratio
    # By hand: unit columns (1, -1) of the ratio, and 2e-3 of the size: root(2) over 1e-3 root(2).
    assert condition_number(directions) == pytest.approx(1000.0, rel=0.01)
    words = weak_sentence(directions, {"kd", "Izz@A"})
    assert words is not None
    assert "number 1000: as" in words
    assert_wording(words)
    assert weak_sentence(directions, {"kt"}) is None
    assert weak_sentence(directions, set()) is None


def test_what_has_no_number_is_not_said_to_be_known_together():
    rows = np.array([[100.0, 100.0], [1.0, 0.0]])
    directions = body_directions(estimate(("msz@A", "Ixz@A"), [-1.0, 3.0], rows.T @ rows))
    assert weak_sentence(directions, {"msz@A"}, lost={"msz@A"}) is None
    words = weak_sentence(directions, {"msz@A"}, several=False)
    assert words is not None and " of A" not in words


def test_what_is_not_a_ratio_is_known_together(assert_wording):
    rows = np.array([[100.0, 100.0], [1.0, 0.0]])
    directions = body_directions(estimate(("msz@A", "Ixz@A"), [-1.0, 3.0], rows.T @ rows))
    assert not directions[0].is_ratio
    words = weak_sentence(directions, {"msz@A"})
    assert words is not None
    assert_wording(words)


def test_nuisances_are_no_direction_of_the_body():
    rows = np.array([[1.0, 0.0, 1e-3], [0.0, 1.0, 0.0], [0.0, 0.0, 1e-6]])
    made = estimate(("kt", "kd", "spread_1"), [1.0, 1.0, 0.0], rows.T @ rows)
    assert all("spread_1" not in d.parts for d in body_directions(made))


def test_condition_numbers_in_words(assert_text):
    said = [condition_words(c) for c in (10.0, 30.0, 254.0, 255.0)]
    assert_text(said)
    assert [condition_words(c) for c in (10.1, 30.1)] == ["fair", "poor"]


@pytest.mark.parametrize(("condition", "said"), [(29.0, False), (31.0, True)])
def test_a_combination_is_said_from_a_condition_number_of_30(condition, said):
    """Of two columns of unit length at right angles but for c: root of (1 + c) / (1 - c)."""
    c = (condition**2 - 1.0) / (condition**2 + 1.0)
    directions = body_directions(estimate(("msz@A", "Ixz@A"), [1.0, 3.0], [[1.0, c], [c, 1.0]]))
    assert condition_number(directions) == pytest.approx(condition)
    assert (weak_sentence(directions, {"msz@A"}) is not None) is said


@pytest.mark.parametrize(("part", "named"), [(0.29, False), (0.31, True)])
def test_what_has_less_than_0_3_of_the_largest_part_is_not_named(part, named):
    """In unit columns; of a direction in which nothing but a millionth is known."""
    weak = np.array([1.0, 1.0, part])
    weak /= np.linalg.norm(weak)
    # Columns of unit length whose null vector it is: the Gram matrix of a plane in scaled axes.
    gram = np.eye(3)
    gram[0, 1] = gram[1, 0] = -(1.0 - 0.5 * part**2)
    gram[0, 2] = gram[2, 0] = gram[1, 2] = gram[2, 1] = -0.5 * part
    assert gram @ weak == pytest.approx(np.zeros(3), abs=1e-12)
    directions = body_directions(
        estimate(("kt", "msz@A", "Ixz@A"), [1.0, 1.0, 1.0], gram + 1e-6 * np.eye(3))
    )
    assert ("Ixz@A" in directions[0].parts) is named
    assert {"kt", "msz@A"} <= set(directions[0].parts)


@pytest.mark.parametrize(("spread", "ratio"), [(0.19, True), (0.21, False)])
def test_changes_within_a_fifth_are_one_factor(spread, ratio):
    made = WeakDirection(strength=1e-3, parts={"kd": 1.0, "Izz@A": 1.0 - spread})
    assert made.is_ratio is ratio


def test_one_axis_at_a_time_gives_kd_and_izz_only_as_a_ratio(tmp_path):
    sticks = Scenario().sticks
    alone = [replace(STILL, **{axis: getattr(sticks, axis)}) for axis in ("roll", "pitch", "yaw")]
    flights = [
        flown.simulated(
            "A", "disturbed", seed=i, seconds=20.0, ground_seconds=2.0, sticks=s, physics_rate=200.0
        )
        for i, s in enumerate(alone)
    ]
    result = flown.identified(tmp_path, flights, extra="[motors]\ndelay = 0.0\n")
    assert result.diagnostics["condition_bodies"] > 100.0
    (words,) = [w for w in result.warnings if "condition number" in w]
    assert "kd" in words
    assert "Izz and kd" in words or "kd and Izz" in words
    assert "are known only as a ratio" in words
