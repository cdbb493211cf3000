"""The battery's voltage under the motors' load."""

import numpy as np
import pytest
from scipy import ndimage, signal

from rotorfit.flight.motors.battery_sag import DROP_STD, battery_sag, relative_load

RATE = 100.0


def flight(seconds=20.0, *, drop=0.3, swing=0.1, noise=0.005, lag=0.0, slow=0.0, seed=0):
    """Four rotors whose speed swings, on a cell of 4 V that loses 5 mV a second and sags."""
    random = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    slow = ndimage.gaussian_filter1d(random.normal(size=len(time)), 0.3 * RATE)
    speed = 2000.0 * (1.0 + swing * slow / slow.std())[:, None] * np.ones(4)
    cubes = (speed**3).sum(axis=1)
    cubes = cubes / cubes.mean()
    voltage = np.full(len(time), 3.7)
    for _ in range(20):
        load = relative_load(cubes, voltage / voltage.mean())
        voltage = 4.0 - 0.005 * time - drop * load / load.mean()
    step = 1.0 / (5.0 * RATE)
    polarised = signal.lfilter([step], [1.0, step - 1.0], load / load.mean() - 1.0)
    voltage = voltage - slow * polarised
    if lag:
        width = round(lag * RATE)
        padded = np.concatenate([np.full(width - 1, voltage[0]), voltage])
        voltage = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
    return time, voltage + random.normal(0.0, noise, len(time)), speed


@pytest.mark.parametrize("drop", [0.15, 0.3, 0.6])
@pytest.mark.parametrize("lag", [0.0, 0.4])
def test_the_sag_is_found_behind_a_filter(drop, lag):
    found = battery_sag(*flight(drop=drop, lag=lag))
    assert found.drop == pytest.approx(drop, rel=0.1)
    assert found.drop_std == pytest.approx(DROP_STD * drop, rel=0.2)
    assert found.at_load(0.0) == pytest.approx(found.voltage + found.drop)


@pytest.mark.parametrize("seed", range(6))
def test_a_held_load_lowers_a_cell_that_polarises_slowly_further(seed):
    """A fifth of the fall takes 5 s, so that loads which swing within a second do not show it."""
    found = battery_sag(*flight(60.0, drop=0.3, slow=0.075, seed=seed))
    assert found.drop == pytest.approx(0.3, rel=0.2)
    held = found.held
    assert abs(held.drop - 0.375) < held.drop_std < 0.3 * held.drop


def test_a_steady_load_and_a_short_flight_show_none():
    steady = [battery_sag(*flight(swing=1e-4, seed=seed)) for seed in range(40)]
    assert sum(one is not None for one in steady) <= 1
    assert battery_sag(*flight(4.0)) is None
    time, voltage, speed = flight()
    assert battery_sag(time, np.full_like(voltage, np.nan), speed) is None
    assert battery_sag(time, voltage, 0.0 * speed) is None


def test_a_regulated_supply_does_not_sag():
    assert battery_sag(*flight(drop=0.0)) is None
