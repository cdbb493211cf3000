"""What drag leans the specific force by is no tilt of the IMU, where the velocity is known."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.fit.imu_tilt import lean_evidence
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.flight.airborne import GRAVITY
from rotorfit.flight.imu_tilt import mean_force_tilt

DRAG = 0.25
"""Over the mass [1/s]: 8 m/s lean the thrust by 11 degrees."""


def flown(*, tilt=0.0, known=True):
    """A flight of 8 m/s with slow changes, the IMU's nose up by `tilt` [rad]."""
    rng = np.random.default_rng(5)
    n = 6000
    time = np.arange(n) / 100.0
    velocity = np.zeros((n, 3))
    velocity[:, 0] = 8.0 + 2.0 * np.sin(time / 3.0)
    velocity[:, 1] = 1.0 + np.cos(time / 2.0)
    force = np.tile([0.0, 0.0, GRAVITY], (n, 1)) - DRAG * velocity * [1.0, 1.0, 0.0]
    force += rng.normal(0.0, 0.5, (n, 3))
    c, s = np.cos(tilt), np.sin(tilt)
    force = force @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    flight = made_fit.prepared(seconds=60.0, force=force)
    return replace(flight, data=replace(flight.data, velocity=velocity if known else None))


@pytest.mark.parametrize("tilt", [0.0, 0.12])
def test_drag_is_no_tilt(tilt):
    found = mean_force_tilt([flown(tilt=tilt).data])
    assert found.pitch == pytest.approx(tilt, abs=0.01)
    assert found.roll == pytest.approx(0.0, abs=0.01)
    [lean] = lean_evidence(TimedDataset.of(made_fit.dataset(flown(tilt=tilt))))
    assert lean.value == pytest.approx(tilt, abs=0.01)
    assert lean.interval[1] - lean.interval[0] < 0.02


def test_without_a_velocity_drag_leans_the_force():
    assert mean_force_tilt([flown(known=False).data]).pitch == pytest.approx(-0.2, abs=0.01)


def test_rows_without_a_velocity_keep_their_force():
    flight = flown().data
    torn = flight.velocity.copy()
    torn[::2] = np.nan
    half = mean_force_tilt([replace(flight, velocity=torn)]).pitch
    assert half == pytest.approx(-0.1, abs=0.01)
    assert mean_force_tilt([replace(flight, velocity=np.full_like(torn, np.nan))]).pitch < -0.19
