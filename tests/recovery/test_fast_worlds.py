"""Worlds of `benchmarks.fast_worlds`: numbers of fast flights hold what is true."""

import pytest
from benchmarks.fast_worlds import draw_world, row_of

SEED = 48


@pytest.mark.parametrize(
    "index", [15, *(pytest.param(i, marks=pytest.mark.slow) for i in (2, 6, 10, 14))]
)
def test_a_fast_flight_shows_its_thrust(tmp_path, index):
    """Without the air in the balance of the weight, kt is 1.5 to 6 % too large in all of them."""
    world = draw_world(SEED, index, seconds=20.0)
    row = row_of(world, tmp_path)
    value, half = row["numbers"]["kt"][:2]
    assert value == pytest.approx(row["truth"]["kt"], rel=0.03)
    assert half < 0.05 * row["truth"]["kt"]


def test_a_world_is_drawn_again_by_its_index():
    one, same, other = (draw_world(SEED, i, seconds=5.0) for i in (3, 3, 4))
    assert one == same
    assert one.truth != other.truth
    assert 4.0 < one.scenario.course.speed < 15.0
