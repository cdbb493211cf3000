"""Full thrust at the battery's voltage, and under full load."""

from dataclasses import replace

import pytest

from rotorfit.flight.motors.battery_sag import BatterySag, relative_load
from rotorfit.results.full_throttle import FullLoad

SAG = BatterySag(voltage=3.7, drop=0.3, drop_std=0.05)
LOAD = FullLoad(speed=2.0, sag=SAG, nominal=3.7, exponent=0.8)


def test_battery_and_motors_agree_at_full_throttle():
    volts = LOAD.voltage
    load = relative_load(LOAD.speed_at(volts) ** 3, volts / SAG.voltage)
    assert SAG.at_load(float(load)) == pytest.approx(volts)
    assert volts < SAG.voltage
    assert LOAD.thrust == pytest.approx(4.0 * (volts / 3.7) ** 1.6)


def test_a_stiff_battery_gives_full_thrust():
    stiff = replace(LOAD, sag=replace(SAG, drop=1e-9))
    assert stiff.thrust == pytest.approx(4.0)


def test_hover_at_full_throttle_is_no_load_more():
    """With full speed that of hover the battery stays where it is."""
    assert replace(LOAD, speed=1.0).voltage == pytest.approx(3.7)
    assert replace(LOAD, speed=1.0).thrust == pytest.approx(1.0)


def test_thrust_falls_with_the_sag():
    thrusts = [replace(LOAD, sag=replace(SAG, drop=d)).thrust for d in (0.05, 0.1, 0.2, 0.4, 0.8)]
    assert thrusts == sorted(thrusts, reverse=True)
    assert min(thrusts) > 0.0
