"""How thrust grows with the command, by hovers at different masses."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.estimation.measured import Measured
from rotorfit.fit.motors.hovers_by_mass import exponent_share
from rotorfit.fit.motors.law_from_thrust import heaviest_hover


def hovers(true, masses, std=0.01):
    """Speeds u of hover for thrust u^(2 x), and k_t = mass / u^2 by an assumed exponent of 1."""
    u = np.array(masses) ** (1.0 / (2.0 * true)) * 0.4
    kt = [Measured(value=m / v**2, std=std * m / v**2) for m, v in zip(masses, u, strict=True)]
    return np.log(u).tolist(), kt


@pytest.mark.parametrize("true", [0.7, 1.0, 1.3])
@pytest.mark.parametrize("masses", [(1.0, 1.4), (1.0, 1.2, 1.5)])
def test_hovers_at_known_masses_show_the_exponent(true, masses):
    found = exponent_share(*hovers(true, masses), 0.02)
    assert found.value == pytest.approx(true)


def test_its_interval_holds_the_truth():
    random, inside = np.random.default_rng(4), 0
    for _ in range(400):
        speeds, kt = hovers(0.8, (1.0, 1.3, 1.6), std=0.01)
        off = 1.0 + random.normal(0.0, np.hypot(0.01, 0.02), 3)
        kt = [Measured(value=k.value * f, std=k.std) for k, f in zip(kt, off, strict=True)]
        found = exponent_share(speeds, kt, 0.02)
        inside += found.interval[0] <= 0.8 <= found.interval[1]
    assert 0.92 < inside / 400 < 0.98


def test_one_speed_shows_nothing():
    speeds, kt = hovers(1.0, (1.0, 1.3))
    assert exponent_share(speeds[:1], kt[:1], 0.02) is None
    assert exponent_share([speeds[0], speeds[0]], kt, 0.02) is None


@pytest.mark.parametrize(("mass_known", "speed"), [(True, 0.6), (False, (0.5 * 0.61) ** 0.5)])
def test_the_law_is_open_from_the_heaviest_hover_on(mass_known, speed):
    """Its weight tells what the command there makes; of unknown masses no hover tells it."""
    light, heavy = (made_fit.dataset(made_fit.prepared(speed=u)) for u in (0.5, 0.6))
    both = replace(light, configurations=(*light.configurations, *heavy.configurations))
    assert heaviest_hover(both, mass_known=mass_known) == pytest.approx(speed)
    assert heaviest_hover(light, mass_known=mass_known) == pytest.approx(0.5)
