"""A vehicle that flies bare and loaded, as the paper's procedure asks for."""

import numpy as np
from benchmarks.payload_worlds import compared, loaded, payload, report, rows
from benchmarks.worlds.world import draw_world

SEED, ON_AN_ARM = 401, 41
"""A hexarotor with masses at both ends of an arm, in gusts, about one axis at a time."""


def test_point_masses_keep_the_laws_of_a_body() -> None:
    world = draw_world(SEED, ON_AN_ARM, {})
    masses, places = payload(world)
    other = loaded(world.vehicle, masses, places)
    assert other.mass == world.vehicle.mass + masses.sum()
    moment = world.vehicle.mass * world.vehicle.com + masses @ places
    np.testing.assert_allclose(other.mass * other.com, moment)
    assert np.linalg.eigvalsh(other.inertia - world.vehicle.inertia).min() > -1e-12
    same = loaded(world.vehicle, np.zeros(1), np.ones((1, 3)))
    np.testing.assert_allclose(same.inertia, world.vehicle.inertia)


def test_masses_at_the_ends_of_an_arm_are_no_wrong_order() -> None:
    [row] = rows(SEED, [ON_AN_ARM])
    for estimate in ("declared", "weighed"):
        assert "sentence" not in row[estimate]
        off = {name: error for name, error, _ in compared(row, estimate)}
        assert {"kd_over_kt", "Izz_com", "Ixx_com"} <= set(off)
        assert np.mean(np.abs(list(off.values())) <= 1.0) > 0.9
    assert "declared: 0 refused" in report([row])
