"""Small vehicles, whose turns the inflow of their rotors damps more than those of large ones."""

from pathlib import Path

import pytest
from benchmarks.worlds.engine import fly
from benchmarks.worlds.hazards import chances
from benchmarks.worlds.sensing import truth, write_world
from benchmarks.worlds.study import identified
from benchmarks.worlds.world import draw_world

from rotorfit.model.terms.registry import terms_named
from rotorfit.model.terms.term import Size

SEED, SMALL = 190001, 9
"""A quadrotor of 32 g with inflow: its turns die out in two seconds."""


def test_damping_counts_by_how_soon_turns_die_out() -> None:
    (term,) = terms_named(["turn_damping"])
    assert term.significance is not None
    least = term.significance.least
    small, large = Size(mass=0.03, arm=0.05), Size(mass=5.0, arm=0.5)
    shares = [least(one) / (one.mass * one.arm**2) for one in (small, large)]
    assert shares[0] == pytest.approx(shares[1])


def test_damping_of_a_small_vehicle_is_no_delay_of_its_motors(tmp_path: Path) -> None:
    world = draw_world(SEED, SMALL, chances(None), 15.0)
    [record] = fly([world])
    known = truth(world)
    row = identified(write_world(world, record, tmp_path), known)
    delay, half, _ = row["numbers"]["motor_delay"]
    assert abs(delay - known["motor_delay"]) <= half < 4e-4
    ratio, wide, _ = row["numbers"]["Jr_over_Izz"]
    assert abs(ratio - known["Jr_over_Izz"]) <= wide
