"""Speeds that make another thrust from one moment on are said, and what rests on them."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.checks.motors.jumping_thrust import jump_finding, thrust_jump
from rotorfit.fit.dataset.channel_findings import name_resting_numbers
from rotorfit.flight.airborne import GRAVITY


def hover(seconds=10.0, *, factor=1.0, begin=5.0, scatter=0.01):
    """A hover whose speeds are `factor` times too large until `begin` seconds."""
    rng = np.random.default_rng(2)
    n = round(100 * seconds)
    push = 1.0 + 0.1 * np.sin(np.arange(n) / 40.0) + rng.normal(0.0, 7.0 * scatter, n)
    force = np.zeros((n, 3))
    force[:, 2] = GRAVITY * (1.0 + 0.1 * np.sin(np.arange(n) / 40.0))
    data = made_fit.prepared(seconds=seconds, force=force).data
    speeds = 500.0 * np.sqrt(push) * np.where(np.arange(n) < 100 * begin, factor, 1.0)
    return replace(data, rotor_speed=np.repeat(speeds[:, None], 4, axis=1))


@pytest.mark.parametrize("factor", [1.06, 0.95])
def test_speeds_of_another_scale_in_one_half(factor):
    data = hover(factor=factor)
    jump = thrust_jump(replace(data, time=data.time + 700.0))
    assert jump.is_certain
    assert jump.time == pytest.approx(5.0, abs=0.5)
    assert jump.share == pytest.approx(factor**2 - 1.0, abs=0.02)
    [found] = name_resting_numbers([jump_finding(jump, "a.csv")])
    assert {"kd", "kd_over_Izz"} <= set(found.numbers)
    assert not found.is_about("kt")  # whose interval has the change in it
    assert found.doubtful_because
    assert "6 %" not in found.sentence
    assert f"{100 * abs(factor**2 - 1):.0f} %" in found.sentence


def test_a_sound_hover_and_its_ends_do_not_jump():
    assert not thrust_jump(hover()).is_certain
    assert not thrust_jump(hover(factor=1.06, begin=1.0)).is_certain
    assert thrust_jump(hover(3.0)) is None
